"""Illumination panoramas: analytic directions, distances and energies of lights."""

import math
from pathlib import Path

import numpy as np
import pytest

from pbrnet.pipeline.channels import TINT
from pbrnet.pipeline.frames import Channels
from pbrnet.pipeline.passes.groundtruth import render_truth
from pbrnet.pipeline.passes.illumination import Panorama, render_illumination
from pbrnet.pipeline.passes.settings import IlluminationParams
from pbrnet.pipeline.render.scene import open_scene
from pbrnet.pipeline.views import View
from pbrnet.scenes.color import REC709
from pbrnet.scenes.contract import Portal
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

WIDTH = 160
EYE = np.array([0.3, -0.4, 1.4])


def panorama(
    folder: Path, body: str, view: View, portals: tuple[Portal, ...] = (), width: int = WIDTH
) -> Channels:
    scene = write_scene(folder / f"scene{len(list(folder.iterdir()))}", body, portals=portals)
    params = IlluminationParams(width=width)
    return render_illumination(open_scene(scene), view, params)


def energy(channels: Channels) -> float:
    """Illuminance at the camera: intensity integrated over the sphere, as the frame defines it."""
    intensity = channels["intensity.Y"].astype(np.float64)
    height, width = intensity.shape
    edges = np.linspace(math.pi / 2, -math.pi / 2, height + 1)
    solid = 2 * math.pi / width * (np.sin(edges[:-1]) - np.sin(edges[1:]))
    return float((intensity * solid[:, None]).sum())


def brightest(channels: Channels) -> tuple[float, float]:
    """Azimuth (right of ahead positive) and elevation, radians, of the light's centroid."""
    weight = channels["intensity.Y"].astype(np.float64)
    height, width = weight.shape
    azimuth = ((np.arange(width) + 0.5) / width - 0.5) * 2 * math.pi
    elevation = math.pi / 2 - (np.arange(height) + 0.5) / height * math.pi
    weight = weight * np.cos(elevation)[:, None]
    vector = np.array(
        [
            (weight * np.cos(elevation)[:, None] * np.sin(azimuth)).sum(),
            (weight * np.sin(elevation)[:, None]).sum(),
            (weight * np.cos(elevation)[:, None] * np.cos(azimuth)).sum(),
        ]
    )
    vector /= np.linalg.norm(vector)
    return math.atan2(vector[0], vector[2]), math.asin(vector[1])


# (azimuth, elevation) in degrees, in the camera's own frame
PLACES = [(0, 0), (30, 20), (-75, -35), (179, 3), (-140, 10), (10, 88), (-60, -89)]
CAMERAS = [((0, 1, 0), (0, 0, 1)), ((1, 1, -0.4), (0, 0, 1)), ((-0.3, -1, 0.2), (0.4, 0, 1))]


def placed(view: View, azimuth: float, elevation: float, distance: float) -> tuple[float, ...]:
    a, e = math.radians(azimuth), math.radians(elevation)
    local = np.array([math.sin(a) * math.cos(e), -math.sin(e), math.cos(a) * math.cos(e)])
    return tuple(view.eye + view.pose[:3, :3] @ local * distance)


@pytest.mark.parametrize(("towards", "up"), CAMERAS)
def test_a_lamp_shows_at_its_angle_and_distance(
    tmp_path: Path, towards: tuple[float, ...], up: tuple[float, ...]
) -> None:
    view = make_view(tuple(EYE), towards, up=up)
    for azimuth, elevation in PLACES:
        centre = placed(view, azimuth, elevation, 2.0)
        got = panorama(tmp_path, ball("lamp", centre, 0.1, glow("2,1,0.5")), view)
        a, e = brightest(got)
        off = math.degrees(abs(e - math.radians(elevation)))
        turn = (math.degrees(a) - azimuth + 180) % 360 - 180
        assert off < 1.0 and abs(turn) * math.cos(e) < 1.0
        lit = got["intensity.Y"] > 0
        # The near side of the sphere, between its nearest point and its rim.
        assert (got["distance.Z"][lit] > 1.899).all()
        assert (got["distance.Z"][lit] < math.sqrt(4 - 0.01) + 1e-3).all()
        luminance = 2 * 0.2126 + 0.7152 + 0.5 * 0.0722
        solid = 2 * math.pi * (1 - math.sqrt(1 - (0.1 / 2) ** 2))
        assert energy(got) == pytest.approx(luminance * solid, rel=0.03)


@pytest.mark.parametrize(("towards", "up"), CAMERAS)
def test_a_pane_shows_at_its_angle_and_distance(
    tmp_path: Path, towards: tuple[float, ...], up: tuple[float, ...]
) -> None:
    walls, _ = room_walls(diffuse(), window=True)
    view = make_view(tuple(EYE), towards, up=up)
    got = panorama(tmp_path, walls + '<emitter type="constant"/>', view, (WINDOW,))
    pano = Panorama(WIDTH, view.pose[:3, :3])
    directions = pano.centres
    reach = (2 - EYE[1]) / directions[:, 1]
    point = EYE + reach[:, None] * directions
    margin = 0.06  # metres at the window: about a pixel
    inside = (
        (reach > 0) & (abs(point[:, 0]) < 0.5 - margin) & (abs(point[:, 2] - 1.5) < 0.5 - margin)
    )
    outside = (
        (reach < 0) | (abs(point[:, 0]) > 0.5 + margin) | (abs(point[:, 2] - 1.5) > 0.5 + margin)
    )
    intensity, distance = got["intensity.Y"].ravel(), got["distance.Z"].ravel()
    assert inside.sum() > 20
    np.testing.assert_allclose(intensity[inside], 1, rtol=1e-5)
    np.testing.assert_allclose(distance[inside], reach[inside], rtol=2e-3)
    assert (intensity[outside] == 0).all() and (distance[outside] == 0).all()


def test_without_portals_the_sky_is_at_the_bounding_box(tmp_path: Path) -> None:
    walls, _ = room_walls(diffuse(), window=True)
    body = walls + '<emitter type="constant"/>'
    with_portal = panorama(tmp_path, body, make_view(), (WINDOW,))
    without = panorama(tmp_path, body, make_view())
    # The window lies in the box's north face, so both distances are the same here.
    np.testing.assert_allclose(with_portal["distance.Z"], without["distance.Z"], rtol=1e-4)
    np.testing.assert_allclose(with_portal["intensity.Y"], without["intensity.Y"])


@pytest.mark.parametrize("radius", [0.004, 0.02, 0.06])
@pytest.mark.parametrize(
    ("azimuth", "elevation"), [(1.0, 0.0), (180, 0), (45, 89.9), (22.5, 33.75)]
)
def test_a_small_lamp_keeps_its_energy(
    tmp_path: Path, radius: float, azimuth: float, elevation: float
) -> None:
    # On pixel borders, on the seam behind the camera, at the pole, on a corner of four pixels.
    view = make_view(tuple(EYE))
    body = ball("lamp", placed(view, azimuth, elevation, 3.0), radius, glow(7))
    got = panorama(tmp_path, body, view)
    solid = 2 * math.pi * (1 - math.sqrt(1 - (radius / 3) ** 2))
    # The renderer's single precision costs up to 0.6 % on the smallest.
    assert energy(got) == pytest.approx(7 * solid, rel=0.01)


def test_a_thin_tube_keeps_its_energy(tmp_path: Path) -> None:
    # 1.2 m by 1 cm, 2 m straight ahead, facing the camera: a grid would miss or double it.
    for tilt in (0.0, 0.005, 0.011):
        centre = (0.0, 2.0, 1.5 + tilt)
        body = quad("tube", centre, (0, -1, 0), (0.6, 0.005), glow(50))
        got = panorama(tmp_path, body, make_view())
        x = np.linspace(-0.6, 0.6, 2001)
        solid = 0.01 * np.trapezoid(2 / (x**2 + 4) ** 1.5, x)
        assert energy(got) == pytest.approx(50 * solid, rel=0.01)
        assert (got["intensity.Y"].sum(axis=0) > 0).sum() >= 14  # columns, without gaps


def test_a_large_lamp_is_as_bright_as_it_is(tmp_path: Path) -> None:
    body = quad("panel", (0, 1, 2.8), (0, 0, -1), (0.8, 0.8), glow(3), (0, 1, 0))
    got = panorama(tmp_path, body, make_view())
    assert got["intensity.Y"].max() == pytest.approx(3, rel=1e-5)
    assert (got["intensity.Y"] == got["intensity.Y"].max()).sum() > 50
    from_behind = panorama(tmp_path, body, make_view((0, 1, 3.5)))
    assert not from_behind["intensity.Y"].any()  # it shines downwards only


def test_point_and_spot_lights_give_their_illuminance(tmp_path: Path) -> None:
    view = make_view(tuple(EYE))
    x, y, z = placed(view, 100, 25, 2.5)
    place = f'<point name="position" x="{x}" y="{y}" z="{z}"/>'
    point = emitter("point", place, intensity=(3,))
    got = panorama(tmp_path, ball("far", (0, 0, 50), 0.1, diffuse()) + point, view)
    assert energy(got) == pytest.approx(3 / 2.5**2, rel=1e-4)
    assert got["distance.Z"].max() == pytest.approx(2.5, rel=1e-4)
    assert (got["intensity.Y"] > 0).sum() == 1
    aims = f'<lookat origin="{x},{y},{z}" target="{EYE[0]},{EYE[1]},{EYE[2]}" up="0,0,1"/>'
    away = f'<lookat origin="{x},{y},{z}" target="{x},{y},{z + 9}" up="0,1,0"/>'
    for transform, expected in ((aims, 5 / 2.5**2), (away, 0.0)):
        turned = f'<transform name="to_world">{transform}</transform>'
        spot = emitter("spot", turned, intensity=(5,))
        got = panorama(tmp_path, ball("far", (0, 0, 50), 0.1, diffuse()) + spot, view)
        assert energy(got) == pytest.approx(expected, rel=1e-4)


def test_occluders_hide_lights_and_clear_glass_does_not(tmp_path: Path) -> None:
    view = make_view()
    for radius in (0.02, 0.4):  # sampled from the light's side, and from the camera's
        lamp = ball("lamp", (0, 3, 1.5), radius, glow(5))
        screen = quad("screen", (0, 1, 1.5), (0, -1, 0), (0.5, 0.5), diffuse())
        pane = screen.replace(diffuse(), '<bsdf type="thindielectric"/>')
        bare = panorama(tmp_path, lamp, view)
        hidden = panorama(tmp_path, lamp + screen, view)
        seen = panorama(tmp_path, lamp + pane, view)
        assert not hidden["intensity.Y"].any() and not hidden["distance.Z"].any()
        np.testing.assert_allclose(seen["intensity.Y"], bare["intensity.Y"], rtol=1e-5)


def test_half_a_lamp_is_half_its_energy(tmp_path: Path) -> None:
    view = make_view()
    lamp = ball("lamp", (0, 3, 1.5), 0.02, glow(5))
    half = quad("half", (0.5, 1, 1.5), (0, -1, 0), (0.5, 0.5), diffuse())
    ratio = energy(panorama(tmp_path, lamp + half, view)) / energy(panorama(tmp_path, lamp, view))
    assert ratio == pytest.approx(0.5, abs=0.05)


def test_the_sun_keeps_its_energy_through_a_window(tmp_path: Path) -> None:
    walls, _ = room_walls(diffuse(), window=True)
    towards = '<vector name="sun_direction" x="0" y="1" z="0.2"/>'
    body = walls + emitter("sunsky", towards, sky_scale=0.0)
    direction = np.array([0, 1, 0.2]) / math.hypot(1, 0.2)
    energies = []
    for shift in (0.0, 0.013, 0.029):  # another part of a pixel each time
        view = make_view((0, 0, 1.2), (shift, 1, 0))
        got = panorama(tmp_path, body, view, (WINDOW,))
        energies.append(energy(got))
        assert got["distance.Z"].max() == pytest.approx(2 / direction[1], rel=5e-3)
    assert np.ptp(energies) < 2e-3 * energies[0]
    shadow = panorama(tmp_path, body, make_view((0, 0, 2.7)), (WINDOW,))
    assert energy(shadow) == 0
    # What the sun gives a white, facing surface at that place: radiance E / pi.
    x, y, z = (0, 0, 1.2) + direction * 1e-3
    facing = tuple(float(value) for value in direction)
    card = quad("card", (x, y, z), facing, (0.01, 0.01), diffuse(1.0))
    scene = write_scene(tmp_path / "card", body.replace(walls, card))
    image, _ = render_truth(
        open_scene(scene),
        make_view(tuple((0, 0, 1.2) + direction * 0.5), tuple(-direction), (16, 16), 800.0),
        plain_truth(spp=64, max_depth=2),
        1,
    )
    radiance = 0.2126 * image["R"] + 0.7152 * image["G"] + 0.0722 * image["B"]
    assert energies[0] == pytest.approx(float(radiance[8, 8]) * math.pi, rel=0.03)


def environment(row: int, column: int) -> bytes:
    pixels = np.full((64, 128, 3), 0.01, dtype=np.float32)
    pixels[row, column] = 500
    return exr(pixels)


@pytest.mark.parametrize("turn", [0.0, 37.0])
def test_an_environment_map_lies_where_the_render_shows_it(tmp_path: Path, turn: float) -> None:
    """A bright texel through the window: same direction in the panorama and in the image."""
    walls, _ = room_walls(diffuse(), window=True)
    # z up as the importers write it; the texel is looked for, not computed: Mitsuba is the judge.
    for column in range(0, 128, 8):
        rotated = f'<rotate x="1" angle="90"/><rotate z="1" angle="{turn}"/>'
        placed_so = f'<transform name="to_world">{rotated}</transform>'
        body = walls + emitter("envmap", placed_so, filename="textures/env.exr")
        files = {"textures/env.exr": environment(29, column)}
        scene = open_scene(write_scene(tmp_path / str(column), body, portals=[WINDOW], files=files))
        view = make_view((0.1, 0.4, 1.4), (0.05, 1, 0.05), (48, 48), 40.0)
        image, _ = render_truth(scene, view, plain_truth(spp=16, max_depth=1), 3)
        if image["G"].max() < 20:
            continue
        got = render_illumination(scene, view, IlluminationParams(width=WIDTH))
        y, x = np.unravel_index(np.argmax(image["G"]), image["G"].shape)
        local = np.linalg.inv(view.intrinsics) @ [x + 0.5, y + 0.5, 1]
        expected = math.atan2(local[0], local[2]), -math.atan2(local[1], math.hypot(local[0], 1))
        brow, bcol = np.unravel_index(np.argmax(got["intensity.Y"]), got["intensity.Y"].shape)
        azimuth = ((bcol + 0.5) / WIDTH - 0.5) * 2 * math.pi
        elevation = math.pi / 2 - (brow + 0.5) / (WIDTH / 2) * math.pi
        assert abs(azimuth - expected[0]) < 0.05 and abs(elevation - expected[1]) < 0.05
        return
    pytest.fail("no column of the environment was seen through the window")


def test_energy_of_a_detailed_environment_map_is_kept(tmp_path: Path) -> None:
    # A speck of one texel of 2048 x 1024, far finer than the panorama's grid.
    pixels = np.zeros((1024, 2048, 3), dtype=np.float32)
    pixels[400:402, 700:702] = 1000
    body = ball("far", (0, 0, -50), 0.1, diffuse())
    body += emitter("envmap", filename="textures/env.exr")
    scene = open_scene(write_scene(tmp_path / "s", body, files={"textures/env.exr": exr(pixels)}))
    solid = 4 * (2 * math.pi / 2048) * (math.pi / 1024) * math.sin(math.pi * 401 / 1024)
    for towards in ((0, 1, 0), (0.013, 1, 0.007)):
        got = render_illumination(
            scene, make_view((0, 0, 0), towards), IlluminationParams(width=WIDTH)
        )
        assert energy(got) == pytest.approx(1000 * solid, rel=0.05)


@pytest.mark.parametrize("radius", [0.02, 0.5])  # sampled from the lamp's side, and by a grid
def test_each_light_has_its_colour(tmp_path: Path, radius: float) -> None:
    """A red lamp at the left, a blue one at the right: colours of luminance 1, apart."""
    colours = {-60: np.array([9, 1, 0.5]), 60: np.array([0.5, 1, 9])}
    view = make_view(tuple(EYE))
    body = "".join(
        ball(f"lamp{a}", placed(view, a, 5, 2.0), radius, glow(",".join(map(str, rgb))))
        for a, rgb in colours.items()
    )
    got = panorama(tmp_path, body, view)
    tint = np.stack([got[name] for name in TINT], axis=-1)
    for half, rgb in zip(np.split(tint, 2, axis=1), colours.values(), strict=True):
        lit = half.any(axis=-1)
        assert lit.sum() > 0
        expected = rgb / (rgb @ REC709)
        np.testing.assert_allclose(half[lit], np.broadcast_to(expected, half[lit].shape), rtol=1e-5)
    assert not tint[got["intensity.Y"] == 0].any()


def test_lights_in_one_pixel_mix_their_colours(tmp_path: Path) -> None:
    """Two specks within one pixel: the tint of the sum of their radiances."""
    view = make_view(tuple(EYE))
    specks = [(np.array([40, 0, 0]), 0.0), (np.array([0, 0, 90]), 0.04)]
    body = "".join(
        ball(f"s{i}", placed(view, 40.3 + shift, 5.3, 2.0), 0.001, glow(",".join(map(str, rgb))))
        for i, (rgb, shift) in enumerate(specks)
    )
    got = panorama(tmp_path, body, view)
    lit = got["intensity.Y"] > 0
    assert lit.sum() == 1
    mixed = np.array([40, 0, 90]) / (np.array([40, 0, 90]) @ REC709)
    found = [float(got[name][lit].item()) for name in TINT]
    assert found == pytest.approx(mixed.tolist(), rel=0.02)


def test_an_unlit_room_is_black(tmp_path: Path) -> None:
    walls, _ = room_walls(diffuse())
    got = panorama(tmp_path, walls, make_view())
    assert got["intensity.Y"].shape == (WIDTH // 2, WIDTH)
    assert not any(channel.any() for channel in got.values())
