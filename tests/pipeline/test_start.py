"""Announcement of a rendering command before it starts."""

from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from pbrnet.pipeline.cli import cli
from pbrnet.pipeline.commands.options import Request
from pbrnet.pipeline.commands.start import plan_stages, start_lines
from pbrnet.pipeline.costs.forecast import view_size
from pbrnet.pipeline.costs.ledger import Ledger
from pbrnet.pipeline.inspection.renders import view_at
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.passes.settings import GroundTruthParams
from pbrnet.pipeline.stages.cameras import plan_cameras
from pbrnet.pipeline.stages.runner import StagePlan, Target, plan_line
from pbrnet.pipeline.views import CameraFile, save_cameras
from pbrnet.scenes.params import SceneParams
from tests.fixtures.stages import write_room


@pytest.fixture(autouse=True)
def no_scheduler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DASK_SCHEDULER_ADDRESS", raising=False)


def test_a_run_says_what_matters(tmp_path: Path) -> None:
    params = Params(scenes=SceneParams(homes=3, variants=2))
    params = replace(params, farm=replace(params.farm, workers=4))
    assert start_lines(Request(params, tmp_path)) == [
        "images: 160x120, framing photograph, channels paper",
        "samples: 16 per pixel, denoised by oidn",
        "views: at most 30 of 6 scenes",
        "workers: up to 4 on this machine",
    ]
    assert start_lines(Request(params, tmp_path, "tcp://head:8786"))[-1] == (
        "workers: from the dask scheduler tcp://head:8786"
    )


@pytest.mark.parametrize(
    ("truth", "said"),
    [
        (GroundTruthParams(64, denoise="none"), "64 per pixel, not denoised"),
        (
            GroundTruthParams(64, noise=0.02, train_spp=8),
            "16 to 64 per pixel, until the noise is 0.02, "
            "8 in training and validation views, denoised by oidn",
        ),
    ],
)
def test_samples_and_denoiser_are_said(tmp_path: Path, truth: GroundTruthParams, said: str) -> None:
    params = Params(groundtruth=truth)
    assert f"samples: {said}" in start_lines(Request(params, tmp_path))
    assert not any(
        "samples" in line for line in start_lines(Request(params, tmp_path), ("inputs",))
    )


def test_the_ledger_tells_the_time(tmp_path: Path) -> None:
    """Two scenes of one view took 600 s each, for 16 samples: 32 take 1,200 s in three scenes."""
    ledger = Ledger(tmp_path)
    for scene in ("one", "two"):
        for stage in ("shading", "color"):
            ledger.add(
                (stage, scene, "0"),
                seconds=300.0,
                threads=1,
                first=False,
                width=160,
                height=120,
                spp=16,
            )
    ledger.save()
    params = Params(groundtruth=GroundTruthParams(32))
    plan = StagePlan(tmp_path, params.farm, view_size(params), "groundtruth", "frames", print)
    for scene in ("one", "two", "three"):
        frames = [Target(tmp_path / kind, kind, scene, "0") for kind in ("shading", "color")]
        plan.add(None, *frames)
    said = plan_line(plan)
    assert (
        said
        == "groundtruth: 6 to make, 0 up to date, about 60 minutes of one core, from the ledger"
    )
    plan.add(None, Target(tmp_path, "inputs", "one", "0"))
    assert plan_line(plan).endswith("of a typical core"), "nothing is known about inputs"


def test_views_are_counted_where_cameras_are_there(tmp_path: Path) -> None:
    views = tuple(view_at((0, 0, 1), (1, 0, 1), name=name) for name in ("a", "b"))
    save_cameras(tmp_path / "cameras" / "one.json", CameraFile("one", views))
    assert "views: 2 of 1 scene" in start_lines(Request(Params(), tmp_path), ("inputs",))
    (tmp_path / "cameras" / "two.json").write_text("broken")
    assert any("views: at most" in line for line in start_lines(Request(Params(), tmp_path)))


def test_a_dry_run_counts_imported_scenes_and_their_cameras(tmp_path: Path) -> None:
    data, params = tmp_path / "data", Params(scenes=SceneParams(homes=0))
    write_room(data / "scenes" / "alpha", source={"views": [{}, {}]})

    def said() -> list[str]:
        names = ("scenes", "cameras", "inputs")
        return [plan_line(plan) for plan in plan_stages(names, Request(params, data))]

    assert said() == [
        "scenes: 0 to make, 0 up to date, 1 of 'pbrnet import'",
        "cameras: 1 to make, 0 up to date, at most 7 views of 1 scene",
        "inputs: 0 to make, at most 7 more after earlier stages, 0 up to date",
    ]
    (item,) = plan_cameras(data, params)[0].items
    mark = next(iter(item.payload.fingerprint.values()))
    view = replace(view_at((1, 1, 1), (2, 1, 1)), scene_id="alpha")
    save_cameras(item.payload.path, CameraFile("alpha", (view,), fingerprint=mark))
    assert said()[1:] == [
        "cameras: 0 to make, 1 up to date, 1 view of 1 scene",
        "inputs: 1 to make, 0 up to date",
    ]


def test_it_is_said_on_stderr_before_anything_is_made(tmp_path: Path) -> None:
    (tmp_path / "params.yaml").write_text("scenes: {homes: 0}\n")
    runner = CliRunner()
    given = ["--params", str(tmp_path / "params.yaml"), "--data", str(tmp_path / "data")]
    for name in ("run", "cameras", "inputs", "groundtruth"):
        result = runner.invoke(cli, [name, *given])
        assert result.exit_code, name
        assert "images: 160x120" in result.stderr and "images:" not in result.stdout, name
