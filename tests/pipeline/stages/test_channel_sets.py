"""Sets of channels as frames of their stage: kept, resumed, sent, removed."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from pbrnet.pipeline.cameras.settings import TrajectoryFile
from pbrnet.pipeline.costs.ledger import read_ledger
from pbrnet.pipeline.farm.settings import FarmParams
from pbrnet.pipeline.frames import frame_path, read_frame, read_meta, write_frame
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.passes.settings import EnvironmentParams
from pbrnet.pipeline.stages.cameras import camera_fingerprint, run_cameras
from pbrnet.pipeline.stages.frame_stage import plan_frames, run_frames
from pbrnet.pipeline.stages.runner import plan_line
from pbrnet.pipeline.views import ImageParams, load_cameras
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.params import SceneParams
from tests.fixtures.in_process import worker_processes
from tests.fixtures.params import pbrs_cameras, pbrs_params, plain_truth, view_params
from tests.fixtures.stages import files_in, write_room
from tests.fixtures.traces import frame_fingerprint

pytestmark = pytest.mark.slow

PAPER = pbrs_params(
    image=ImageParams(48, 36),
    farm=FarmParams(workers=1, batch=2),
    scenes=SceneParams(homes=0, imports=("nothing",)),
    cameras=pbrs_cameras(views_per_room=2),
)
ALL = replace(PAPER, channels=("materials", "labels"))
TRUTH = replace(
    PAPER,
    image=ImageParams(32, 24),
    groundtruth=plain_truth(spp=4, block_spp=2, max_depth=3, denoise="oidn"),
)
AROUND = replace(TRUTH, channels=("environment",), environment=EnvironmentParams(32, 4))
FRAMES = ("inputs", "materials", "labels", "video")


@pytest.mark.parametrize(
    ("stage", "paper", "more", "sets"),
    [
        ("inputs", PAPER, ALL, ("materials", "labels")),
        pytest.param("groundtruth", TRUTH, AROUND, ("environment",), marks=pytest.mark.check),
    ],
    ids=["surfaces", "environment"],
)
def test_sets_are_added_and_removed_and_change_no_other_frame(
    stage: Any, paper: Params, more: Params, sets: Any, tmp_path: Path, monkeypatch: Any
) -> None:
    data, frames = tmp_path / "data", ("inputs", "video", "shading", "color", *sets)
    write_room(data / "scenes" / "alpha")
    run_cameras(data, paper)
    count, new = run_frames(stage, data, paper).made, 2 * len(sets)
    before = files_in(data, *frames)
    assert len(before) == count >= 2 and all((data / kind).is_dir() for kind in sets)
    run = run_frames(stage, data, more)
    assert (run.made, run.kept) == (new, count)
    both = files_in(data, *frames)
    assert len(both) == count + new and both.items() >= before.items()
    rows = [row for row in read_ledger(data).to_pylist() if row["stage"] in sets]
    assert len(rows) == new
    view = load_cameras(data / "cameras" / "alpha.json").views[0]
    if "environment" in sets:
        assert {(row["width"], row["height"], row["spp"]) for row in rows} == {(32, 16, 4)}
        meta = read_meta(frame_path(data, "environment", view))
        assert meta["denoiser"].startswith("oidn") and meta["noise"] > 0

    # Damaged and missing frames are rendered again, to the same bytes.
    broken = frame_path(data, sets[0], view)
    broken.write_bytes(broken.read_bytes()[:-40])
    for kind in sets[1:]:
        frame_path(data, kind, view).unlink()
    run = run_frames(stage, data, more)
    assert run.made == len(sets) and files_in(data, *frames) == both

    # The same through dask, by workers that get scenes sent and send frames back.
    far = tmp_path / "far"
    far.mkdir()
    for folder in ("scenes", "cameras"):
        (data / folder).rename(far / folder)
    monkeypatch.setenv("PBRNET_CACHE", str(tmp_path / "cache"))
    with worker_processes():
        run_frames(stage, far, replace(more, farm=FarmParams(workers=1, transfer="send")))
    assert files_in(far, *frames) == both

    run = run_frames(stage, far, paper)
    assert (run.made, run.kept, run.removed) == (0, count, new)
    assert files_in(far, *frames) == before


def test_trajectories_are_frames_like_others(tmp_path: Path) -> None:
    """They resume, and follow their neighbours' cameras in their flow alone."""
    data, path = tmp_path / "data", tmp_path / "given.txt"
    write_room(data / "scenes" / "alpha")
    path.write_text("".join(f"{n} {1 + 0.05 * n} 1.2 1.5 -0.5 0.5 -0.5 0.5\n" for n in range(4)))
    cameras = replace(PAPER.cameras, trajectories=(TrajectoryFile("alpha", str(path)),))
    film = replace(PAPER, channels=("video",), cameras=cameras, farm=FarmParams(workers=1))
    run_cameras(data, film)
    views = load_cameras(data / "cameras" / "alpha.json").views
    frames = [view for view in views if view.trajectory]
    assert [view.view_id for view in frames] == [f"path-00-{n:04d}" for n in range(4)]
    assert frames[2].eye.tolist() == [1.1, 1.2, 1.5] and frames[0].room == "living"
    assert run_frames("inputs", data, film).made == 6 + 6
    whole = files_in(data, *FRAMES)
    frame_path(data, "video", frames[1]).unlink()
    run = run_frames("inputs", data, film)
    assert (run.made, run.kept) == (1, 11) and files_in(data, *FRAMES) == whole

    # What the dataset would reject is not path-traced: here all of a frame is called hidden.
    place = frame_path(data, "video", frames[1])
    frame = read_frame(place)
    wrong = {**frame.channels, "forward.occluded": 1 - frame.channels["forward.outside"]}
    write_frame(place, "video", wrong, frames[1], fingerprint=frame.meta["fingerprint"])
    plan = plan_frames("groundtruth", data, film)[0]
    assert list(plan.left_out) == [frames[1].name] and len(plan.items) == 5
    assert "misaligned, video: forward" in plan.left_out[frames[1].name]
    assert "1 view skipped" in plan_line(plan)
    whole_walks = replace(film.dataset.checks, whole_walks=True)
    strict = replace(film, dataset=replace(film.dataset, checks=whole_walks))
    plan = plan_frames("groundtruth", data, strict)[0]
    assert [*plan.left_out] == [view.name for view in frames] and len(plan.items) == 2
    lenient = replace(film.dataset.checks, max_called_hidden=1.0)
    film = replace(film, dataset=replace(film.dataset, checks=lenient))
    assert not plan_frames("groundtruth", data, film)[0].left_out

    for kind, changes in (("inputs", False), ("color", False), ("video", True)):
        moved = replace(frames[1], pose_after=frames[1].camera_to_world)
        one, other = (
            frame_fingerprint(kind, view, film, "scene", "r")  # type: ignore[arg-type]
            for view in (frames[1], moved)
        )
        assert (one != other) == changes, kind

    was = camera_fingerprint("alpha", view_params(film), film.seed, "scene", "r")
    assert camera_fingerprint(
        "beta", view_params(film), film.seed, "scene", "r"
    ) == camera_fingerprint("beta", view_params(PAPER), PAPER.seed, "scene", "r")
    path.write_text(path.read_text().replace("3 1.15", "3 1.14"))
    assert camera_fingerprint("alpha", view_params(film), film.seed, "scene", "r") != was
    unknown = replace(cameras, trajectories=(TrajectoryFile("beta", str(path)),))
    with pytest.raises(InputError, match="no scene 'beta'"):
        run_cameras(data, replace(film, cameras=unknown))
