"""Preparation of a view: pictures are the same as without it, with one light plan and guides."""

from pathlib import Path

import numpy as np
import pytest

from pbrnet.pipeline.frames import Channels
from pbrnet.pipeline.passes import groundtruth
from pbrnet.pipeline.passes.settings import NoisyParams
from pbrnet.pipeline.passes.transport import render_transport
from pbrnet.pipeline.passes.truth import noisy_trace, prepare, render_samples
from pbrnet.pipeline.pathtrace import integrator
from pbrnet.pipeline.pathtrace.light_sampling import PlannedLights
from pbrnet.pipeline.render.scene import RenderScene, open_scene
from pbrnet.pipeline.transport.settings import TransportParams
from pbrnet.pipeline.views import View
from tests.fixtures.params import pbrs_params, plain_truth
from tests.fixtures.render import WINDOW, diffuse, glow, make_view, quad, room_walls, write_scene

pytestmark = pytest.mark.usefixtures("wavefront")

PARAMS = pbrs_params(
    groundtruth=plain_truth(max_depth=3),
    noisy=NoisyParams(spp=2),
    transport=TransportParams(samples=4, surfels=2000),
)
TRACE = noisy_trace(PARAMS.groundtruth, PARAMS.noisy.spp)
LAMP = quad("lamp", (0.5, 0.5, 2.4), (0, 0, -1), (0.2, 0.2), glow(20), (0.0, 1.0, 0.0))


def opened(folder: Path, *more: str) -> tuple[RenderScene, View]:
    walls, _ = room_walls(diffuse(0.6), window=True)
    scene = open_scene(write_scene(folder, walls + "".join(more), portals=[WINDOW]))
    return scene, make_view(size=(24, 16))


def equal(one: Channels, other: Channels) -> bool:
    return one.keys() == other.keys() and all(np.array_equal(one[k], other[k]) for k in one)


def test_pictures_of_a_prepared_view_are_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    room = opened(tmp_path / "a", LAMP)
    samples = render_samples(*room, TRACE, 3)
    transport = render_transport(*room, PARAMS.transport, 3)[0]
    prepared = prepare(*room, 3)
    assert isinstance(prepared.lights, PlannedLights)
    monkeypatch.setattr(groundtruth, "plan_lights", lambda *_: pytest.fail("plans again"))
    assert equal(render_samples(*room, TRACE, 3, prepared), samples)
    assert equal(render_transport(*room, PARAMS.transport, 3, prepared)[0], transport)
    assert np.concatenate([samples[band] for band in "RGB"]).any()


def test_samples_of_uniform_lights_take_the_guides_alone(tmp_path: Path) -> None:
    room = opened(tmp_path / "a", LAMP)
    uniform = pbrs_params(
        groundtruth=plain_truth(max_depth=3, lights="uniform"), noisy=NoisyParams(spp=2)
    )
    trace = noisy_trace(uniform.groundtruth, uniform.noisy.spp)
    known = render_samples(*room, trace, 3)
    assert equal(render_samples(*room, trace, 3, prepare(*room, 4)), known)
    assert not equal(render_samples(*room, TRACE, 3, prepare(*room, 4)), known)


def test_nothing_is_planned_without_lights_or_in_a_scalar_variant(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert prepare(*opened(tmp_path / "a"), 1).lights is None
    room = opened(tmp_path / "b", LAMP)
    assert prepare(*room, 1).lights is not None
    monkeypatch.setattr(integrator, "available", lambda: False)
    found = prepare(*room, 1)
    assert found.lights is None
    assert [guide.shape for guide in found.guides] == [(16, 24, 3)] * 2
