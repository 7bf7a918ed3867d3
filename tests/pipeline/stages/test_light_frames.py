"""Light frames of the groundtruth stage: added, resumed and removed beside shading and colour."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pbrnet.pipeline.channels import DIFFUSE, DIRECT, TRACED, light_bands
from pbrnet.pipeline.farm.settings import FarmParams
from pbrnet.pipeline.frames import frame_path, read_frame
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.passes.registry import TRACE_OF
from pbrnet.pipeline.passes.settings import LightParams
from pbrnet.pipeline.passes.truth import truth_settings
from pbrnet.pipeline.pathtrace import integrator
from pbrnet.pipeline.stages.cameras import run_cameras
from pbrnet.pipeline.stages.frame_stage import run_frames
from pbrnet.pipeline.views import ImageParams, load_cameras
from pbrnet.scenes.checked import build
from pbrnet.scenes.errors import InputError, ParameterError
from pbrnet.scenes.params import SceneParams
from tests.fixtures.params import pbrs_cameras, pbrs_params, plain_truth
from tests.fixtures.stages import files_in, write_room
from tests.fixtures.traces import render

PAPER = pbrs_params(
    image=ImageParams(32, 24),
    farm=FarmParams(workers=1),
    scenes=SceneParams(homes=0, imports=("nothing",)),
    cameras=pbrs_cameras(views_per_room=1),
    groundtruth=plain_truth(spp=4, block_spp=2, max_depth=4, denoise="oidn"),
)
LIGHT = replace(PAPER, channels=("light",))
FRAMES = ("shading", "color", "light")


@pytest.mark.slow
@pytest.mark.usefixtures("wavefront")
def test_light_frames_are_added_and_removed_and_change_no_other_frame(tmp_path: Path) -> None:
    data, other = tmp_path / "data", tmp_path / "other"
    write_room(data / "scenes" / "alpha")
    run_cameras(data, PAPER)
    shutil.copytree(data, other)
    assert run_frames("groundtruth", data, PAPER).made == 2
    paper = files_in(data, *FRAMES)
    run = run_frames("groundtruth", data, LIGHT)  # the light frame alone
    assert (run.made, run.kept) == (1, 2)
    all_frames = files_in(data, *FRAMES)
    assert len(all_frames) == 3 and all_frames.items() > paper.items()
    assert run_frames("groundtruth", other, LIGHT).made == 3  # all of one trace
    assert files_in(other, *FRAMES) == all_frames

    (view,) = load_cameras(data / "cameras" / "alpha.json").views
    color, light = (read_frame(frame_path(data, kind, view)) for kind in ("color", "light"))  # type: ignore[arg-type]
    assert light.meta["color_digest"] == color.meta["digest"]
    for bands in (DIRECT, DIFFUSE):
        part = light.stack(*bands)
        assert 0.2 * color.rgb.mean() < part.mean() and (part <= color.rgb).all()
    assert 0 < light.meta["noise_indirect"] < 1

    grouped = replace(LIGHT, light=LightParams(groups=1))
    run = run_frames("groundtruth", data, grouped)
    assert (run.made, run.kept) == (1, 2)
    light = read_frame(frame_path(data, "light", view))
    assert light.meta["light_names"] == ["", "", "lamp", ""]
    np.testing.assert_array_equal(light.stack(*light_bands(2)), color.rgb)

    run = run_frames("groundtruth", data, PAPER)
    assert (run.kept, run.removed) == (2, 1) and files_in(data, *FRAMES) == paper


def test_light_needs_a_joint_trace(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ParameterError, match="joint"):
        build(Params, {"channels": ["light"], "groundtruth": {"joint": False}})
    monkeypatch.setattr(integrator, "available", lambda: False)
    nothing: Any = None
    with pytest.raises(InputError, match="scalar_rgb"):
        render(TRACED, nothing, nothing, LIGHT, 0)


def test_what_one_trace_gives_is_planned_before_a_variant_is_chosen(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(integrator, "available", lambda: pytest.fail("asks for the variant"))
    settings = truth_settings(PAPER.groundtruth, PAPER.shading, PAPER.light)
    assert TRACE_OF["color"].together(settings["color"])
