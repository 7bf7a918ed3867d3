"""Fingerprints of frames: which parameter changes which kind, and what of a view does."""

from dataclasses import replace
from typing import Any

import pytest

from pbrnet.pipeline.params import Params
from pbrnet.pipeline.passes.registry import TRACE_OF
from pbrnet.pipeline.passes.settings import EnvironmentParams, LightParams, NoisyParams
from tests.fixtures.params import pbrs_params
from tests.fixtures.render import make_view
from tests.fixtures.traces import frame_fingerprint

PARAMS, VIEW = pbrs_params(noisy=NoisyParams(spp=2)), make_view()
TRUTH, ILLUMINATION = {"shading", "color", "light"}, {"illumination", "visibility"}


def altered(section: str, **values: Any) -> Params:
    return replace(PARAMS, **{section: replace(getattr(PARAMS, section), **values)})


@pytest.mark.parametrize(
    ("other", "changed"),
    [
        (altered("farm", workers=7, batch=1, window=9, retries=0), set()),
        (altered("cameras", min_score=3.0), set()),
        (altered("scenes", texture_size=64), set()),
        (altered("train", batch=7), set()),
        (altered("tone", key=0.5), set()),
        (altered("dataset", row_group=3), set()),
        (replace(PARAMS, channels=("all",)), set()),
        (altered("groundtruth", spp=8), TRUTH),
        (altered("groundtruth", block_spp=4), TRUTH | {"environment"}),
        (altered("groundtruth", max_depth=4), TRUTH | {"noisy", "environment"}),
        (altered("groundtruth", joint=False), TRUTH | {"noisy"}),
        (altered("shading", albedo=0.4), {"shading", "color", "light", "noisy"}),
        (replace(PARAMS, light=LightParams(groups=1)), {"light"}),
        (replace(PARAMS, noisy=NoisyParams(spp=4)), {"noisy"}),
        (replace(PARAMS, environment=EnvironmentParams(64, 64)), {"environment"}),
        (altered("transport", samples=2), {"transport"}),
        (altered("illumination", width=64), ILLUMINATION),
        (altered("illumination", supersampling=2), ILLUMINATION),
        (altered("illumination", shadow_rays=3), {"visibility"}),
        (replace(PARAMS, seed=1), {*TRUTH, "noisy", "environment", "transport"}),
    ],
)
def test_a_parameter_changes_the_frames_that_it_determines(other: Params, changed: set) -> None:
    found = {
        kind
        for kind in TRACE_OF
        if frame_fingerprint(kind, VIEW, PARAMS, "s", "r")
        != frame_fingerprint(kind, VIEW, other, "s", "r")
    }
    assert found == changed


def test_camera_size_scene_and_renderer_change_all_and_a_score_none() -> None:
    moved = [[*row] for row in VIEW.camera_to_world]
    moved[0][3] += 1e-6
    for kind in TRACE_OF:
        mark = frame_fingerprint(kind, VIEW, PARAMS, "s", "r")
        scored = replace(VIEW, score=99.0, seen={"chair": 3})
        assert frame_fingerprint(kind, scored, PARAMS, "s", "r") == mark
        for other in (
            replace(VIEW, camera_to_world=tuple(map(tuple, moved))),
            replace(VIEW, width=49),
            replace(VIEW, view_id="x"),
        ):
            assert frame_fingerprint(kind, other, PARAMS, "s", "r") != mark
        assert frame_fingerprint(kind, VIEW, PARAMS, "other", "r") != mark
        assert frame_fingerprint(kind, VIEW, PARAMS, "s", "other") != mark
