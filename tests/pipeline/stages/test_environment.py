"""Panoramas of the environment as frames of their stage: kept, resumed, sent, removed."""

from dataclasses import replace
from pathlib import Path

import pytest

from pbrnet.pipeline.costs.ledger import read_ledger
from pbrnet.pipeline.farm.settings import FarmParams
from pbrnet.pipeline.frames import frame_path, read_meta
from pbrnet.pipeline.passes.settings import EnvironmentParams
from pbrnet.pipeline.stages.cameras import run_cameras
from pbrnet.pipeline.stages.frame_stage import run_frames
from pbrnet.pipeline.views import ImageParams, load_cameras
from pbrnet.scenes.params import SceneParams
from tests.fixtures.in_process import worker_processes
from tests.fixtures.params import pbrs_cameras, pbrs_params, plain_truth
from tests.fixtures.stages import files_in, write_room

PAPER = pbrs_params(
    image=ImageParams(32, 24),
    farm=FarmParams(workers=2, batch=1),
    scenes=SceneParams(homes=0, imports=("nothing",)),
    cameras=pbrs_cameras(views_per_room=2),
    groundtruth=plain_truth(spp=4, block_spp=2, max_depth=3, denoise="oidn"),
)
MORE = replace(PAPER, channels=("environment",), environment=EnvironmentParams(32, 4))
FRAMES = ("shading", "color", "environment")


@pytest.mark.check
def test_the_set_is_added_and_removed_and_changes_no_other_frame(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = tmp_path / "data"
    write_room(data / "scenes" / "alpha")
    run_cameras(data, PAPER)
    assert run_frames("groundtruth", data, PAPER).made == 4
    paper = files_in(data, *FRAMES)
    assert len(paper) == 4 and (data / "environment").is_dir()
    run = run_frames("groundtruth", data, MORE)
    assert (run.made, run.kept) == (2, 4)
    both = files_in(data, *FRAMES)
    assert len(both) == 6 and both.items() >= paper.items()
    rows = [row for row in read_ledger(data).to_pylist() if row["stage"] == "environment"]
    assert [(row["width"], row["height"], row["spp"]) for row in rows] == [(32, 16, 4)] * 2
    view = load_cameras(data / "cameras" / "alpha.json").views[0]
    path = frame_path(data, "environment", view)
    meta = read_meta(path)
    assert meta["denoiser"].startswith("oidn") and meta["noise"] > 0

    # A damaged frame is rendered again, to the same bytes.
    path.write_bytes(path.read_bytes()[:-40])
    run = run_frames("groundtruth", data, MORE)
    assert (run.made, run.kept) == (1, 5) and files_in(data, *FRAMES) == both

    # The same through dask, by one worker that gets scenes sent and sends frames back.
    far = tmp_path / "far"
    far.mkdir()
    for folder in ("scenes", "cameras"):
        (data / folder).rename(far / folder)
    monkeypatch.setenv("PBRNET_CACHE", str(tmp_path / "cache"))
    with worker_processes():
        run_frames("groundtruth", far, replace(MORE, farm=FarmParams(workers=1, transfer="send")))
    assert files_in(far, *FRAMES) == both

    run = run_frames("groundtruth", far, PAPER)
    assert (run.made, run.kept, run.removed) == (0, 4, 2) and files_in(far, *FRAMES) == paper
