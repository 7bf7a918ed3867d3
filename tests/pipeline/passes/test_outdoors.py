"""Light from outdoors in the panorama: surfaces seen through openings, against theory and paths."""

import math
from pathlib import Path

import numpy as np
import pytest

from pbrnet.pipeline.channels import TINT
from pbrnet.pipeline.frames import Channels
from pbrnet.pipeline.passes import illumination
from pbrnet.pipeline.passes.groundtruth import render_truth
from pbrnet.pipeline.passes.illumination import Panorama, render_illumination
from pbrnet.pipeline.passes.settings import IlluminationParams
from pbrnet.pipeline.render.scene import RenderScene, open_scene
from pbrnet.pipeline.views import View
from pbrnet.scenes.color import luminance
from pbrnet.scenes.contract import Portal
from pbrnet.scenes.geometry.directions import turned
from tests.fixtures.encoded import exr
from tests.fixtures.params import plain_truth
from tests.fixtures.render import (
    WINDOW,
    ball,
    diffuse,
    glow,
    make_view,
    quad,
    room_walls,
    write_scene,
)
from tests.fixtures.xml import emitter

pytestmark = pytest.mark.usefixtures("variant")

PARAMS = IlluminationParams(width=256)
ROOM, _ = room_walls(diffuse(), window=True)
EYE = (0.0, 0.0, 1.5)
# All of the image lies within the window.
THROUGH_WINDOW = make_view(EYE, (0, 1, 0), (16, 16), 36.0)
# From behind and above: the wall at y = 6 is in the sun, and the room's shadow lies below z = -1.
SUN = emitter("directional", '<vector name="direction" x="0" y="1" z="-1"/>', irradiance=("3,2,1",))
FACADE = quad("facade", (0, 6, 1.5), (0, -1, 0), (8, 8), diffuse("0.2 0.5 0.4"))
GROUND = quad("ground", (0, 0, -0.1), (0, 0, 1), (60, 60), diffuse(0.4), (0, 1, 0))


def opened(folder: Path, body: str, portals: tuple[Portal, ...] = (WINDOW,)) -> RenderScene:
    name = f"scene{len(list(folder.iterdir()))}"
    return open_scene(write_scene(folder / name, body, portals=portals))


def energy(channels: Channels) -> float:
    """Illuminance at the camera."""
    intensity = channels["intensity.Y"].astype(np.float64)
    solid = Panorama(intensity.shape[1], np.eye(3)).solid_angles
    return float((intensity * solid[:, None]).sum())


def window_solid_angle(half: float, distance: float) -> float:
    """Solid angle of a square seen from straight before its centre."""
    return 4 * math.asin(half**2 / (half**2 + distance**2))


def mean_seen(channels: Channels, view: View) -> float:
    """Mean intensity of the panorama within the image of a view."""
    width = channels["intensity.Y"].shape[1]
    panorama = Panorama(width, view.pose[:3, :3])
    local = turned(panorama.centres, view.pose[:3, :3].T) @ view.intrinsics.T
    with np.errstate(divide="ignore", invalid="ignore"):
        place = local[:, :2] / local[:, 2:]
    size = (view.width, view.height)
    inside = (local[:, 2] > 0) & (place > 0).all(axis=1) & (place < size).all(axis=1)
    weights = np.repeat(panorama.solid_angles, width)[inside]
    assert inside.sum() > 40
    return float(np.average(channels["intensity.Y"].ravel()[inside], weights=weights))


def mean_traced(scene: RenderScene, view: View, spp: int = 256, depth: int = 9) -> float:
    """The same by tracing paths."""
    image, _ = render_truth(scene, view, plain_truth(spp=spp, max_depth=depth), 3)
    rays = view.rays().reshape(-1, 3)
    weights = 1 / np.linalg.norm(rays, axis=1) ** 3
    seen = luminance(np.stack([image[band].ravel() for band in "RGB"], axis=1).astype(np.float64))
    return float(np.average(seen, weights=weights))


def check_sunlit_wall(folder: Path) -> None:
    """Assert the analytic radiance of the wall, at the window, in its colour."""
    view = make_view(EYE)
    got = render_illumination(opened(folder, ROOM + FACADE + SUN), view, PARAMS)
    sent = np.array([0.2, 0.5, 0.4]) * [3, 2, 1] / math.pi * math.cos(math.pi / 4)
    expected = float(luminance(sent)) * window_solid_angle(0.5, 2.0)
    assert energy(got) == pytest.approx(expected, rel=0.02)
    whole = got["intensity.Y"] > 0.99 * got["intensity.Y"].max()
    assert whole.sum() > 50
    reach = 2 / Panorama(PARAMS.width, view.pose[:3, :3]).centres[:, 1].reshape(whole.shape)
    np.testing.assert_allclose(got["distance.Z"][whole], reach[whole], rtol=2e-3)
    tint = np.stack([got[name][whole] for name in TINT], axis=-1)
    np.testing.assert_allclose(tint, np.broadcast_to(sent / luminance(sent), tint.shape), rtol=1e-3)


def test_a_sunlit_wall_outside_shines_at_the_window(tmp_path: Path) -> None:
    check_sunlit_wall(tmp_path)


def test_a_panorama_that_forgets_the_outdoors_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(illumination, "outdoor_radiance", lambda scene, eye, d: np.zeros_like(d))
    with pytest.raises(AssertionError):
        check_sunlit_wall(tmp_path)


def test_ground_and_sky_share_a_window(tmp_path: Path) -> None:
    """Above the horizon the sky's radiance; below it the ground's, by as much sky as it sees."""
    scene = opened(tmp_path, ROOM + GROUND + emitter("constant"))
    got = render_illumination(scene, THROUGH_WINDOW, PARAMS)
    assert mean_seen(got, THROUGH_WINDOW) == pytest.approx(
        mean_traced(scene, THROUGH_WINDOW), rel=0.03
    )
    panorama = Panorama(PARAMS.width, THROUGH_WINDOW.pose[:3, :3])
    slope = panorama.centres[:, 2] / np.maximum(panorama.centres[:, 1], 1e-9)
    aside = np.abs(panorama.centres[:, 0] / np.maximum(panorama.centres[:, 1], 1e-9)) < 0.2
    rows = (panorama.centres[:, 1] > 0) & aside
    intensity = got["intensity.Y"].ravel()
    sky, ground = rows & (slope > 0.02) & (slope < 0.2), rows & (slope < -0.03) & (slope > -0.2)
    np.testing.assert_allclose(intensity[sky], 1, rtol=1e-5)
    assert 0.3 < intensity[ground].mean() < 0.4


def roof_room() -> tuple[str, Portal]:
    """A room with a hole of 1 m x 1 m in its ceiling, z = 3."""
    walls, _ = room_walls(diffuse())
    parts = walls.split("<shape")
    flat = (0.0, 1.0, 0.0)
    rest = "<shape".join(part for part in parts if 'id="ceiling"' not in part)
    places = (((-1.25, 0), (0.75, 2)), ((1.25, 0), (0.75, 2)))
    places += (((0, -1.25), (0.5, 0.75)), ((0, 1.25), (0.5, 0.75)))
    for number, (centre, half) in enumerate(places):
        rest += quad(f"roof{number}", (*centre, 3.0), (0, 0, -1), half, diffuse(), flat)
    corners = ((-0.5, -0.5, 3), (0.5, -0.5, 3), (0.5, 0.5, 3), (-0.5, 0.5, 3))
    return rest, Portal("roof", "window", corners, (0, 0, 1), True)


def test_a_roof_window_shows_a_facade(tmp_path: Path) -> None:
    walls, portal = roof_room()
    tower = quad("tower", (0, 1.5, 18), (0, -1, 0), (10, 15), diffuse("0.7 0.4 0.3"))
    sky = '<emitter type="constant"><rgb name="radiance" value="0.2 0.3 0.5"/></emitter>'
    scene = opened(tmp_path, walls + tower + sky + SUN, (portal,))
    view = make_view((0, -0.3, 1.0), (0, 0.15, 1), (16, 16), 50.0, up=(0, 1, 0))
    got = render_illumination(scene, view, PARAMS)
    assert mean_seen(got, view) == pytest.approx(mean_traced(scene, view), rel=0.04)
    lit = got["intensity.Y"] > 0.5 * got["intensity.Y"].max()
    assert (got["distance.Z"][lit] < 3).all()


NIGHT = ball("lantern", (1.0, 4.0, 4.5), 0.1, glow("30,20,10"))


@pytest.mark.parametrize(
    ("light", "rel"),
    [
        pytest.param(NIGHT, 0.05, id="lantern"),
        pytest.param(SUN, 0.03, id="sun"),
        pytest.param(emitter("constant") + NIGHT, 0.05, id="sky"),
    ],
)
def test_a_yard_has_the_light_of_traced_paths(tmp_path: Path, light: str, rel: float) -> None:
    """Ground and facade light each other, and lamps that the camera cannot see light both."""
    body = ROOM + FACADE + GROUND + light
    scene = opened(tmp_path, body)
    got = render_illumination(scene, THROUGH_WINDOW, PARAMS)
    traced = mean_traced(scene, THROUGH_WINDOW, 1024)
    assert mean_seen(got, THROUGH_WINDOW) == pytest.approx(traced, rel=rel)


def test_a_bright_spot_of_an_environment_map_lights_the_yard(tmp_path: Path) -> None:
    """A sun of a few texels, which cosine-distributed rays would miss or meet by chance."""
    pixels = np.full((64, 128, 3), 0.05, dtype=np.float32)
    pixels[14:16, 30:32] = 800
    turn = '<transform name="to_world"><rotate x="1" angle="90"/></transform>'
    found = []
    for column in (30, 60, 90):
        moved = np.roll(pixels, column, axis=1)
        folder = tmp_path / str(column)
        body = ROOM + FACADE + emitter("envmap", turn, filename="textures/env.exr")
        files = {"textures/env.exr": exr(moved)}
        scene = open_scene(write_scene(folder, body, portals=[WINDOW], files=files))
        got = mean_seen(render_illumination(scene, THROUGH_WINDOW, PARAMS), THROUGH_WINDOW)
        found.append((got, mean_traced(scene, THROUGH_WINDOW)))
    ours, traced = np.array(found).T
    assert traced.max() > 5 * traced.min()  # it lights the wall in some of them
    np.testing.assert_allclose(ours, traced, rtol=0.05)


@pytest.mark.parametrize(("away", "clear"), [(0.01, True), (0.5, False)])
def test_closed_and_frosted_openings_send_nothing(tmp_path: Path, away: float, clear: bool) -> None:
    leaf = quad("leaf", (0, 2 + away, 1.5), (0, -1, 0), (0.6, 0.6), diffuse())
    portal = Portal("p", "door", WINDOW.polygon, WINDOW.normal, clear)
    scene = opened(tmp_path, ROOM + leaf + ball("lamp", (0, 0, 2.8), 0.05, glow(40)), (portal,))
    got = render_illumination(scene, make_view(EYE), PARAMS)
    alone = opened(tmp_path, ROOM + leaf + ball("lamp", (0, 0, 2.8), 0.05, glow(40)), ())
    assert energy(got) == energy(render_illumination(alone, make_view(EYE), PARAMS))


def test_a_lamp_outdoors_is_at_the_window(tmp_path: Path) -> None:
    for radius in (0.02, 0.3):  # sampled from the lamp's side, and by a grid
        scene = opened(tmp_path, ROOM + ball("lamp", (0, 9, 1.5), radius, glow(5)))
        got = render_illumination(scene, make_view(EYE), PARAMS)
        assert got["intensity.Y"].any() and got["distance.Z"].max() < 2.2


def test_a_screen_before_the_window_hides_the_yard(tmp_path: Path) -> None:
    screen = quad("screen", (0, 1.5, 1.5), (0, -1, 0), (1, 1), diffuse())
    got = render_illumination(
        opened(tmp_path, ROOM + screen + FACADE + SUN), make_view(EYE), PARAMS
    )
    assert not got["intensity.Y"].any()


def test_facing_and_far_surfaces_do_not_shadow_themselves(tmp_path: Path) -> None:
    """A wall two kilometres away, where single precision counts in tenths of millimetres."""
    wall = quad("wall", (0, 2000, 0), (0, -1, 0), (3000, 3000), diffuse(0.5))
    got = render_illumination(opened(tmp_path, ROOM + wall + SUN), make_view(EYE), PARAMS)
    sent = 0.5 * luminance(np.array([3.0, 2, 1])) / math.pi * math.cos(math.pi / 4)
    assert energy(got) == pytest.approx(float(sent) * window_solid_angle(0.5, 2.0), rel=0.02)
