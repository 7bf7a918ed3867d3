"""Relighting: images are linear in the light, and added lamps are in the right place."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pbrnet.model.data.encoding import solid_angles
from pbrnet.model.studies.illumination.cases import lamp_radiance, possible_changes, visible_light
from pbrnet.model.studies.illumination.lamp_position import RADIUS, left_rear_position
from pbrnet.model.studies.illumination.relight import (
    ADDED_LAMP_ID,
    AddedLamp,
    LightChange,
    open_relit,
)
from pbrnet.pipeline.passes.groundtruth import render_truth
from pbrnet.pipeline.passes.illumination import render_illumination
from pbrnet.pipeline.passes.inputs import render_inputs
from pbrnet.pipeline.passes.settings import IlluminationParams
from pbrnet.pipeline.render.scene import open_scene
from pbrnet.pipeline.views import View
from pbrnet.scenes.contract import Light, Scene
from pbrnet.scenes.errors import InputError
from tests.fixtures.light import PARAMS, room, views
from tests.fixtures.render import ball, diffuse, glow, make_view, quad, room_walls, write_scene

pytestmark = pytest.mark.usefixtures("variant")


def image(scene: Scene, change: LightChange, view: View) -> np.ndarray:
    """Render colour, float64 (H, W, 3)."""
    with open_relit(scene, change) as opened:
        channels, _ = render_truth(opened, view, PARAMS.groundtruth, 5)
    return np.stack([channels[band] for band in "RGB"], -1).astype(np.float64)


def panorama(scene: Scene, change: LightChange, view: View, width: int = 32) -> np.ndarray:
    """Render the intensity of the panorama."""
    with open_relit(scene, change) as opened:
        return render_illumination(opened, view, IlluminationParams(width=width))["intensity.Y"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("window", "change", "factor"),
    [
        (False, LightChange(lamps=2.0), 2.0),
        (False, LightChange(lamps=0.25, outdoors=9.0), 0.25),
        (True, LightChange(lamps=3.0, outdoors=3.0), 3.0),
    ],
)
def test_light_times_a_factor_is_the_picture_times_it(
    tmp_path: Path, window: bool, change: LightChange, factor: float
) -> None:
    scene = room(tmp_path / "s", window=window)
    view = views("s")[0]
    before, after = image(scene, LightChange(), view), image(scene, change, view)
    assert before.max() > 0
    np.testing.assert_allclose(after, factor * before, rtol=2e-4)
    lit = panorama(scene, LightChange(), view)
    np.testing.assert_allclose(panorama(scene, change, view), factor * lit, rtol=1e-5)


@pytest.mark.slow
def test_only_what_is_meant_gets_brighter(tmp_path: Path) -> None:
    scene, view = room(tmp_path / "s"), views("s")[0]
    before = panorama(scene, LightChange(), view)
    lamps = panorama(scene, LightChange(lamps=2.0), view) - before
    sky = panorama(scene, LightChange(outdoors=2.0), view) - before
    out = panorama(scene, LightChange(without="lamp"), view)
    assert lamps.max() > 1 and sky.max() > 0.1
    np.testing.assert_allclose(lamps + sky, before, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(out, sky, rtol=1e-4, atol=1e-5)


def test_sources_are_told_apart(tmp_path: Path) -> None:
    scene, view = room(tmp_path / "s"), views("s")[0]
    opened = open_scene(scene)
    seen = visible_light(opened, view, PARAMS.illumination)
    lit = render_illumination(opened, view, PARAMS.illumination)["intensity.Y"]
    total = float((lit * solid_angles(lit)).sum())
    assert seen.lamps + seen.outdoors == pytest.approx(total, rel=1e-4)
    # A sphere of radiance 3 and radius 0.15 m, fully visible at a distance of 1.5 m.
    away = np.linalg.norm(np.array([0.5, 0.8, 2.5]) - view.eye)
    cap = 2 * math.pi * (1 - math.sqrt(1 - (0.15 / away) ** 2))
    assert seen.lamps == pytest.approx(3.0 * cap, rel=0.02)
    assert seen.each == {"lamp": pytest.approx(seen.lamps)} and seen.brightest == "lamp"


def test_the_scene_of_a_change_says_what_is_in_it(tmp_path: Path) -> None:
    scene = room(tmp_path / "s")
    untouched = scene.xml.read_bytes()
    with open_relit(scene, LightChange(without="lamp", added=AddedLamp((0, 0, 2), 0.1, 1))) as new:
        assert [light.id for light in new.scene.lights] == ["sky", ADDED_LAMP_ID]
        assert ADDED_LAMP_ID in [thing.id for thing in new.scene.objects]
    assert scene.xml.read_bytes() == untouched


@pytest.mark.parametrize(
    ("emitter", "words"),
    [
        (
            '<emitter type="area"><texture type="bitmap" name="radiance">'
            '<string name="filename" value="x.png"/></texture></emitter>',
            "radiance of an emitter of type 'area' is not a number",
        ),
        ('<emitter type="projector"/>', "emitters of type 'projector' cannot be scaled"),
    ],
)
def test_what_cannot_be_scaled_is_named(tmp_path: Path, emitter: str, words: str) -> None:
    scene = write_scene(tmp_path / "s", ball("b", (0, 0, 1), 0.5, emitter), {"b": ("b",)})
    with pytest.raises(InputError, match=words), open_relit(scene, LightChange(lamps=2.0)):
        pass


def test_a_lamp_that_is_not_there_cannot_be_put_out(tmp_path: Path) -> None:
    scene = room(tmp_path / "s")
    for name in ("chandelier", "sky"):
        with (
            pytest.raises(InputError, match=f"no light '{name}'"),
            open_relit(scene, LightChange(without=name)),
        ):
            pass


POSES = [
    ((0.0, 0.0, 1.5), (0, 1, -0.2)),
    ((0.5, -0.5, 1.55), (1, 0.3, -0.2)),
    ((-0.4, 0.2, 1.3), (-1, -0.5, -0.2)),
    ((0.3, 0.9, 1.6), (0.2, -1, -0.2)),
]


@pytest.mark.slow
@pytest.mark.parametrize(("eye", "towards"), POSES)
def test_the_added_lamp_is_at_the_left_rear_and_in_the_panorama(
    tmp_path: Path, eye: Any, towards: Any
) -> None:
    scene = room(tmp_path / "s", window=False)
    view = replace(make_view(eye, towards), room="r")
    opened = open_scene(scene)
    place = left_rear_position(opened, view)
    assert place is not None
    local = (np.array(place) - view.eye) @ view.pose[:3, :3]
    assert local[0] < -RADIUS and local[2] < -RADIUS, "left of the camera, and behind it"
    assert all(abs(place[axis]) + RADIUS < 2 for axis in (0, 1)) and RADIUS < place[2] < 2.9
    lamp = AddedLamp(place, RADIUS, 7.0)
    width = 64
    with open_relit(scene, LightChange(added=lamp)) as changed:
        new = render_illumination(changed, view, IlluminationParams(width=width))["intensity.Y"]
        # The lamp is behind the camera: the image itself does not change.
        for name, channel in render_inputs(changed, view).items():
            assert np.array_equal(channel, render_inputs(opened, view)[name]), name
    more = new - panorama(scene, LightChange(), view, width)
    _, columns = np.nonzero(more > 1e-6)
    assert len(columns) and columns.max() < width / 4, "in the left quarter, which is the left rear"
    cap = 2 * math.pi * (1 - math.sqrt(1 - (RADIUS / np.linalg.norm(local)) ** 2))
    assert float((more * solid_angles(more)).sum()) == pytest.approx(7.0 * cap, rel=0.03)


def test_a_lamp_is_never_put_inside_furniture(tmp_path: Path) -> None:
    view = replace(make_view((0, 0, 1.5), (0, 1, -0.2)), room="r")
    free = left_rear_position(open_scene(room(tmp_path / "free", window=False)), view)
    assert free is not None
    box = ball("globe", free, 0.3, diffuse())
    moved = left_rear_position(open_scene(room(tmp_path / "in", window=False, more=box)), view)
    assert moved is not None
    assert np.linalg.norm(np.array(moved) - free) > 0.3 + RADIUS, "neither in it nor through it"
    # A screen across the whole left rear hides all places.
    screen = quad("screen", (-0.25, -0.25, 1.5), (1, 1, 0), (4, 1.6), diffuse())
    assert (
        left_rear_position(open_scene(room(tmp_path / "out", window=False, more=screen)), view)
        is None
    )


def test_in_a_corner_there_is_no_left_rear(tmp_path: Path) -> None:
    scene = room(tmp_path / "s")
    corner = replace(make_view((-1.8, -1.8, 1.5), (1, 1, -0.2)), room="r")
    found = possible_changes(open_scene(scene), corner, PARAMS.illumination, 4.0, 1.0)
    assert "added" not in found.changes and "no free place" in found.skipped["added"]


def test_only_light_that_is_seen_is_changed(tmp_path: Path) -> None:
    view = views("s")[0]
    by_night = open_scene(room(tmp_path / "night", window=False))
    found = possible_changes(by_night, view, PARAMS.illumination, 4.0, 1.0)
    assert found.changes["lamps"] == LightChange(lamps=4.0)
    assert found.skipped == {
        "outdoors": "no sky or sun in the panorama",
        "without": "the lamp is the only light in the panorama",
    }
    by_day = open_scene(room(tmp_path / "day"))
    found = possible_changes(by_day, view, PARAMS.illumination, 4.0, 1.0)
    assert found.changes["outdoors"] == LightChange(outdoors=0.25)
    assert found.changes["without"] == LightChange(without="lamp")
    walls, names = room_walls(diffuse())
    hidden = ball("bulb", (0, 0, 9), 0.2, glow()), [Light("lamp", "area", ("bulb",))]
    dark = write_scene(tmp_path / "dark", walls + hidden[0], {"walls": names}, (), hidden[1])
    found = possible_changes(open_scene(dark), view, PARAMS.illumination, 4.0, 1.0)
    assert set(found.changes) == {"added"}


def test_the_added_lamp_is_as_strong_as_was_asked_for(tmp_path: Path) -> None:
    radiance = lamp_radiance(log_average=0.25, albedo=0.5, strength=3.0)
    lamp = ball("lamp", (0, 0, 2), RADIUS, glow(radiance))
    floor = quad("floor", (0, 0, 0), (0, 0, 1), (0.01, 0.01), diffuse(0.5), (0, 1, 0))
    scene = write_scene(tmp_path / "s", floor + lamp, {"floor": ("floor",)})
    view = make_view((0, 0.0, 0.5), (0, 0, -1), (16, 16), focal=2000, up=(0, 1, 0))
    params = replace(PARAMS.groundtruth, spp=64, block_spp=16)
    channels, _ = render_truth(open_scene(scene), view, params, 0)
    assert float(channels["G"].mean()) == pytest.approx(3.0 * 0.25, rel=0.02)


def test_a_lamp_that_cannot_be_scaled_is_left_out_with_the_reason(tmp_path: Path) -> None:
    scene, view = room(tmp_path / "s"), views("s")[0]
    opened = open_scene(scene)
    text = scene.xml.read_text()
    image = '<texture type="checkerboard" name="radiance"/>'
    scene.xml.write_text(text.replace('<rgb name="radiance" value="3.0"/>', image))
    assert scene.xml.read_text() != text
    found = possible_changes(opened, view, PARAMS.illumination, 4.0, 1.0)
    assert set(found.changes) == {"added", "outdoors", "without"}
    assert "radiance of an emitter of type 'area'" in found.skipped["lamps"]
