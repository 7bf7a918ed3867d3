"""Panoramas of the environment: radiometry in closed form, directions, seam, and fingerprints."""

import math
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pbrnet.pipeline.channels import RGB
from pbrnet.pipeline.dataset.agreement import disagreement
from pbrnet.pipeline.frames import Channels
from pbrnet.pipeline.passes.denoise import denoise
from pbrnet.pipeline.passes.environment import render_environment, rounded, settings
from pbrnet.pipeline.passes.groundtruth import render_truth
from pbrnet.pipeline.passes.inputs import render_inputs
from pbrnet.pipeline.passes.settings import EnvironmentParams
from pbrnet.pipeline.render.scene import RenderScene, open_scene, set_variant
from pbrnet.pipeline.views import View
from pbrnet.scenes.geometry.directions import equirectangular_directions
from tests.fixtures.light import SKY, room
from tests.fixtures.params import plain_truth
from tests.fixtures.paths import ROOT
from tests.fixtures.render import ball, diffuse, glow, make_view, write_scene

pytestmark = pytest.mark.usefixtures("variant")

WIDTH = 64
# Looks down and is rolled: a transposed rotation is another one.
TILTED = make_view((0.3, -0.4, 1.4), (1, 0.6, -0.5), up=(0.3, 0, 1))


def panorama(scene: RenderScene, view: View, width: int = WIDTH, **truth: object) -> Channels:
    traced = plain_truth(**{"max_depth": 6, **truth})  # type: ignore[arg-type]
    own = settings(traced, EnvironmentParams(width, traced.spp))
    return render_environment(scene, view, own, 1)["environment"][0]


def image(channels: Channels) -> np.ndarray:
    """Radiance, float64 (H, W, 3)."""
    return np.stack([channels[band] for band in RGB], -1).astype(np.float64)


def solid_angles(width: int) -> np.ndarray:
    """Steradians of the pixels of each row, (H, 1)."""
    edges = np.linspace(math.pi / 2, -math.pi / 2, width // 2 + 1)
    return (2 * math.pi / width * (np.sin(edges[:-1]) - np.sin(edges[1:])))[:, None]


def pixel_of(direction: np.ndarray, view: View, width: int) -> tuple[int, int]:
    """Row and column of a world direction, as the documentation defines them."""
    right, down, ahead = view.pose[:3, :3].T @ direction / np.linalg.norm(direction)
    azimuth, elevation = math.atan2(right, ahead), math.asin(-down)
    column = int((azimuth / (2 * math.pi) + 0.5) * width)
    return int((0.5 - elevation / math.pi) * (width // 2)), column


def test_a_white_furnace_is_white(tmp_path: Path) -> None:
    body = ball("s", (0, 0, 1.5), 1.0, diffuse(1.0)) + SKY
    scene = open_scene(write_scene(tmp_path / "a", body))
    view = make_view((0, -2, 1.5), (1, 0.5, 0.2))
    channels = panorama(scene, view, max_depth=100, rr_depth=100, spp=64)
    got, there = image(channels), channels["distance.Z"] > 0
    assert 0.03 < there.mean() < 0.1
    np.testing.assert_allclose(got, 1, rtol=0.1)
    np.testing.assert_allclose(
        got[~there & ~np.roll(there, 1, 0) & ~np.roll(there, -1, 0)], 1, rtol=0.02
    )
    assert got[there].mean() == pytest.approx(1, rel=5e-3)


LAMPS = {  # radiance in one band each, centre relative to the camera, radius
    "R": ((5.0, 0.0, 0.0), (1.0, 2.0, 0.5), 0.4),
    "G": ((0.0, 3.0, 0.0), (-1.5, 0.2, -0.7), 0.3),
    "B": ((0.0, 0.0, 90000.0), (-0.2, -1.0, 1.6), 0.5),  # more than half floats can say
}


def test_lamps_have_their_directions_radiances_and_irradiances(tmp_path: Path) -> None:
    balls = "".join(
        ball(band, tuple(TILTED.eye + offset), radius, glow(",".join(map(str, light))))
        for band, (light, offset, radius) in LAMPS.items()
    )
    channels = panorama(open_scene(write_scene(tmp_path / "a", balls)), TILTED, 128, spp=16)
    directions = equirectangular_directions(128) @ TILTED.pose[:3, :3].T
    for index, (band, (light, offset, radius)) in enumerate(LAMPS.items()):
        radiance, away = max(light), float(np.linalg.norm(offset))
        pixel = pixel_of(np.array(offset), TILTED, 128)
        assert channels[band][pixel] == pytest.approx(radiance, rel=5e-4), band
        assert image(channels)[pixel][[i for i in range(3) if i != index]].max() == 0
        assert channels["distance.Z"][pixel] == pytest.approx(away - radius, abs=0.01)
        lit = channels[band] * solid_angles(128)
        cap = 2 * math.pi * (1 - math.sqrt(1 - (radius / away) ** 2))
        assert lit.sum() == pytest.approx(radiance * cap, rel=0.01), band
        # Irradiance of a surface that faces the lamp, and of one turned by 30 degrees from it.
        towards = np.array(offset) / away
        sideways = np.cross(towards, (0, 0, 1))
        for angle in (0, math.pi / 6):
            normal = math.cos(angle) * towards
            normal += math.sin(angle) * sideways / np.linalg.norm(sideways)
            found = (lit * np.maximum(directions @ normal, 0)).sum()
            exact = math.pi * radiance * (radius / away) ** 2 * math.cos(angle)
            assert found == pytest.approx(exact, rel=0.01), band


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> RenderScene:
    """A room with a lamp, a table and a window to a white sky."""
    set_variant()
    return open_scene(room(tmp_path_factory.mktemp("home") / "scene"))


IN_ROOM = make_view((-0.3, -0.5, 1.5), (0.3, 1, -0.4), (48, 40), up=(0.2, 0, 1))


def seen_through(view: View, picture: np.ndarray, width: int) -> tuple[np.ndarray, np.ndarray]:
    """A perspective image averaged over each panorama pixel, and which pixels lie within it."""
    parts = (np.arange(8) + 0.5) / 8
    row, column = np.indices((width // 2, width))
    pitch = 2 * math.pi / width
    azimuth = (column[..., None, None] + parts) * pitch - math.pi
    elevation = math.pi / 2 - (row[..., None, None] + parts[:, None]) * pitch
    x, y = np.tan(azimuth), -np.tan(elevation) / np.cos(azimuth)
    fx, cx, cy = view.K[0][0], view.K[0][2], view.K[1][2]
    across, down = fx * x + cx, fx * y + cy
    inside = (across >= 0) & (across < view.width) & (down >= 0) & (down < view.height)
    inside &= np.cos(azimuth) > 0
    values = picture[np.where(inside, down, 0).astype(int), np.where(inside, across, 0).astype(int)]
    return values.mean(axis=(2, 3)), inside.all(axis=(2, 3))


def test_it_agrees_with_the_image_of_the_view(home: RenderScene) -> None:
    fine = replace(IN_ROOM, width=96, height=80, K=((76.8, 0, 48), (0, 76.8, 40), (0, 0, 1)))
    truth, _ = render_truth(home, fine, plain_truth(spp=64, max_depth=6), 3)
    got = image(panorama(home, fine, spp=64))

    expected, inside = seen_through(fine, image(truth), WIDTH)
    assert inside.sum() > 60

    def apart(panoramic: np.ndarray) -> float:
        ratio = panoramic[inside].sum(-1) / expected[inside].sum(-1)
        return float(np.median(np.abs(ratio - 1)))

    assert apart(got) < 0.06
    assert got[inside].mean() == pytest.approx(expected[inside].mean(), rel=0.03)
    assert apart(got[:, ::-1]) > 0.15 and apart(got[::-1]) > 0.15


def test_distance_and_normal_are_those_of_the_same_rays(home: RenderScene) -> None:
    width, rotation = 32, IN_ROOM.pose[:3, :3]
    channels = panorama(home, IN_ROOM, width, spp=1)
    normals = np.stack([channels[f"N.{axis}"] for axis in "XYZ"], -1)
    random = np.random.default_rng(4)
    surfaces = 0
    for row, column in zip(random.integers(0, 16, 60), random.integers(0, 32, 60), strict=True):
        azimuth = (column + 0.5) / width * 2 * math.pi - math.pi
        elevation = math.pi / 2 - (row + 0.5) / 16 * math.pi
        right, ahead = (f(azimuth) * math.cos(elevation) for f in (math.sin, math.cos))
        towards = rotation @ (right, -math.sin(elevation), ahead)
        view = make_view(tuple(IN_ROOM.eye), tuple(towards), (1, 1), up=(0.31, 0.2, 0.93))
        straight = render_inputs(home, view)
        assert channels["distance.Z"][row, column] == pytest.approx(straight["Z"][0, 0], rel=2e-6)
        normal = np.array([straight[f"N.{axis}"][0, 0] for axis in "XYZ"])
        expected = rotation.T @ view.pose[:3, :3] @ normal
        np.testing.assert_allclose(normals[row, column], expected, atol=1e-5)
        surfaces += int(straight["valid"][0, 0])
    assert surfaces > 40


@pytest.mark.parametrize(
    ("name", "mutant"),
    [
        ("right", lambda values: values),
        ("mirrored", lambda values: values[:, ::-1]),
        ("upside down", lambda values: values[::-1]),
        ("behind", lambda values: np.roll(values, 32, axis=1)),
    ],
)
def test_the_check_finds_panoramas_of_another_direction(
    home: RenderScene, name: str, mutant: Callable[[np.ndarray], np.ndarray]
) -> None:
    view = make_view((-1.4, -0.5, 1.5), (0.4, 1, -0.4), (48, 40), up=(0.2, 0, 1))
    wrong = {band: mutant(values) for band, values in panorama(home, view, spp=1).items()}
    share = disagreement(wrong, render_inputs(home, view), view)
    assert share < 0.05 if name == "right" else share > 0.3


def test_the_denoiser_sees_no_seam() -> None:
    """Turned by half a circle, the denoised panorama is the same."""
    random = np.random.default_rng(0)
    steps = (np.indices((32, 192))[1] // 24 % 2)[..., None] * [0.3, 0.1, 0.2] + 0.2
    noisy = steps * random.gamma(2, 0.5, (32, 192, 1))
    normals = np.zeros((32, 192, 3), np.float32)

    def denoised(turn: int) -> np.ndarray:
        turned = np.roll(noisy, turn, axis=1)
        bands = {band: turned[..., i].astype(np.float32) for i, band in enumerate(RGB)}
        albedo = np.roll(steps, turn, axis=1).astype(np.float32)
        return np.roll(image(denoise(bands, albedo, normals, around=True)), -turn, axis=1)

    error = np.abs(denoised(96) / denoised(0) - 1).max(axis=(0, 2))
    assert error[:8].max() < 0.02 and error[-8:].max() < 0.02 and error[88:104].max() < 0.02


def test_a_denoised_wall_has_no_jump_at_the_seam(home: RenderScene) -> None:
    got = image(panorama(home, IN_ROOM, spp=16, denoise="oidn")).sum(-1)
    steps = np.abs(got - np.roll(got, 1, axis=1)).mean(axis=0)
    assert steps[0] < 1.5 * np.median(steps)


def test_views_do_not_depend_on_those_before(home: RenderScene) -> None:
    """A replayed launch gives the pixels of a recorded one."""
    first, second = panorama(home, IN_ROOM, 32, spp=4), panorama(home, TILTED, 32, spp=4)
    again = panorama(home, IN_ROOM, 32, spp=4)
    for band, values in first.items():
        np.testing.assert_array_equal(values, again[band])
    assert not np.array_equal(first["R"], second["R"])


SCALAR = """
import sys
import numpy as np
from pathlib import Path
from pbrnet.pipeline.passes.groundtruth import path_integrator
from pbrnet.pipeline.lenses.model import Lens
from pbrnet.pipeline.pathtrace.launches import trace_scalar
from pbrnet.pipeline.render.scene import open_scene, set_variant
from pbrnet.scenes.contract import load_scene
from tests.pipeline.passes.test_environment import IN_ROOM

set_variant("scalar_rgb")
scene = open_scene(load_scene(Path(sys.argv[1]))).mitsuba
lens = Lens("equirectangular", 16, 8, ())
path = path_integrator(6, 3)
np.save(sys.argv[2], trace_scalar(scene, path, IN_ROOM.pose, lens, 2, 16, 5))
"""


@pytest.mark.check
def test_the_scalar_variant_traces_the_same_panorama(tmp_path: Path) -> None:
    scene, out = room(tmp_path / "scene", window=False), tmp_path / "got.npy"
    expected = image(panorama(open_scene(scene), IN_ROOM, 16, spp=256))
    command = [sys.executable, "-c", SCALAR, str(scene.folder), str(out)]
    subprocess.run(command, check=True, env={**os.environ, "PYTHONPATH": str(ROOT)})
    got = np.load(out)
    weights = solid_angles(16)[..., None]
    mean = (got.mean(axis=1) * weights).sum() / (expected * weights).sum()
    assert mean == pytest.approx(1, rel=0.05)
    apart = np.abs(got.mean(axis=1) - expected).sum(-1) / expected.sum(-1)
    assert np.median(apart) < 0.2
    assert not np.array_equal(got[:, 0], got[:, 1])


def test_rounding_keeps_range_and_precision() -> None:
    values = np.array([0, 1, 1 + 2**-10, 1 + 2**-12, 1e-7, 3e8, 70001], np.float32)
    got = rounded(values)
    np.testing.assert_allclose(got, values, rtol=2**-11)
    assert got[0] == 0 and got[2] == values[2] and got[3] == 1
    assert not (got.view(np.uint32) & np.uint32(0x1FFF)).any()
