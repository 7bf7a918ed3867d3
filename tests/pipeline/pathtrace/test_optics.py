"""Lens and shutter against closed forms: blur circle, focus, motion blur, skew, interpolation."""

import math
from dataclasses import replace
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from pbrnet.pipeline.passes.groundtruth import color_blocks
from pbrnet.pipeline.pathtrace.launches import ray_arrays, ray_kind, sample_rays
from pbrnet.pipeline.pathtrace.optics import Aperture, Optics, Shutter
from pbrnet.pipeline.pathtrace.samples import PathSampler
from pbrnet.pipeline.render.scene import RenderScene, open_scene
from pbrnet.pipeline.views import View, as_matrix, look
from tests.fixtures.params import plain_truth
from tests.fixtures.render import diffuse, glow, make_view, quad, write_scene

pytestmark = pytest.mark.usefixtures("wavefront")

SIZE, FOCAL, DISTANCE = (32, 24), 40.0, 2.0  # pixels, metres
VIEW = make_view((0, 0, 0), (0, 1, 0), SIZE, FOCAL)
LENS = Aperture(0.06, DISTANCE)


class Exposure(NamedTuple):
    """Aperture and shutter, of any view."""

    aperture: Aperture | None = None
    shutter: Shutter | None = None

    def optics(self, view: View) -> Optics:
        return Optics.of(view, self.aperture, self.shutter)


def rays(view: View, exposure: Exposure, spp: int = 64) -> tuple[np.ndarray, np.ndarray]:
    """Origins and directions of all samples in world axes, (H, W, spp, 3)."""
    lens, optics = view.lens, exposure.optics(view)
    arrays, kind = ray_arrays(view.pose, lens, optics), ray_kind(lens, optics, 1, spp)
    sampler = PathSampler.of(dr.arange(mi.UInt32, kind.rays), spp, mi.UInt32(7))
    ray, _ = sample_rays(sampler, arrays, kind)
    dr.eval(ray)
    size = (3, view.height, view.width, spp)
    origins, directions = (np.moveaxis(np.array(p).reshape(size), 0, -1) for p in (ray.o, ray.d))
    return origins, directions


def at_depth(view: View, optics: Exposure, depth: float, spp: int = 64) -> np.ndarray:
    """Samples on the plane at a depth, as pixels of the pinhole, (H, W, spp, 2)."""
    origins, directions = rays(view, optics, spp)
    inverse = np.linalg.inv(view.pose)
    local = origins @ inverse[:3, :3].T + inverse[:3, 3]
    towards = directions @ inverse[:3, :3].T
    points = local + towards * ((depth - local[..., 2]) / towards[..., 2])[..., None]
    return (points @ view.intrinsics.T)[..., :2] / depth


def centres(view: View) -> np.ndarray:
    """Pixel centres, (H, W, 1, 2)."""
    rows, columns = np.mgrid[: view.height, : view.width] + 0.5
    return np.stack([columns, rows], axis=-1)[:, :, None]


def moved(view: View, before: np.ndarray, after: np.ndarray) -> View:
    return replace(view, pose_before=as_matrix(before), pose_after=as_matrix(after))


def walk(across: float) -> View:
    """The view from a camera that moves to the right by so many pixels of a wall at DISTANCE."""
    step = np.array([across * DISTANCE / FOCAL, 0, 0])
    return moved(VIEW, look(VIEW.eye - step, (0, 1, 0)), look(VIEW.eye + step, (0, 1, 0)))


@pytest.mark.parametrize("depth", [1.0, 3.0, 50.0])
def test_a_point_is_spread_over_the_circle_of_confusion(depth: float) -> None:
    spread = at_depth(VIEW, Exposure(LENS), depth) - centres(VIEW)
    radius = FOCAL * LENS.radius * abs(1 / LENS.focus - 1 / depth)
    assert np.linalg.norm(spread, axis=-1).max() <= radius + math.sqrt(0.5) + 1e-3
    # Variances of a disc and of a pixel add up.
    expected = radius**2 / 4 + 1 / 12
    np.testing.assert_allclose(spread.var(axis=(0, 1, 2)), expected, rtol=0.01)


def test_other_lenses_focus_as_they_measure_depth() -> None:
    """In a plane with distortion, on a sphere through a fisheye; chief rays are the lens's own."""
    bent = replace(VIEW, distortion=(-0.2, 0.05, 0.001, -0.002))
    fisheye = replace(VIEW, K=((9.0, 0, 16), (0, 9.0, 12), (0, 0, 1)), projection="fisheye")
    for view in (bent, fisheye):
        origins, directions = rays(view, Exposure(LENS), 16)
        chief = view.lens.rays()
        ahead = (
            chief.directions if view is fisheye else (chief.directions / chief.directions[..., 2:])
        )
        target = (ahead * LENS.focus) @ view.pose[:3, :3].T
        offset = target[:, :, None] - origins
        along = (offset * directions).sum(axis=-1, keepdims=True)
        missed = np.linalg.norm(offset - along * directions, axis=-1)
        pixel = LENS.focus / view.K[0][0]
        assert missed[chief.valid].max() < 1.6 * pixel and chief.valid.mean() > 0.9
        assert np.linalg.norm(origins, axis=-1).max() > 0.9 * LENS.radius


def test_the_plane_in_focus_is_that_of_the_pinhole() -> None:
    spread = at_depth(VIEW, Exposure(LENS), LENS.focus) - centres(VIEW)
    assert np.abs(spread).max() <= 0.5 + 1e-3
    np.testing.assert_allclose(spread.var(axis=(0, 1, 2)), 1 / 12, rtol=0.01)


@pytest.mark.parametrize("blades", [3, 6, 11])
def test_blades_keep_the_area_of_the_aperture(blades: int) -> None:
    origins, _ = rays(VIEW, Exposure(LENS._replace(blades=blades)))
    across, up = origins[..., 0].ravel() / LENS.radius, origins[..., 2].ravel() / LENS.radius
    angle = (np.arctan2(across, up) % (2 * math.pi / blades)) - math.pi / blades
    apothem = math.sqrt(math.pi / (blades * math.tan(math.pi / blades)))
    edge = np.hypot(across, up) * np.cos(angle) / apothem
    assert 0.99 < edge.max() <= 1 + 1e-5
    # Of a polygon filled evenly, the share within a scaled one is the scale squared.
    assert (edge < 0.5).mean() == pytest.approx(0.25, abs=0.01)


def test_a_moving_camera_averages_over_the_way_of_the_exposure() -> None:
    optics = Exposure(shutter=Shutter(0.5))
    shift = at_depth(walk(6.0), optics, DISTANCE) - centres(VIEW)
    assert np.abs(shift[..., 0]).max() <= 0.5 + 0.25 * 6
    expected = [(0.5 * 6) ** 2 / 12 + 1 / 12, 1 / 12]  # box filters of exposure and pixel
    np.testing.assert_allclose(shift.var(axis=(0, 1, 2)), expected, rtol=0.01)
    np.testing.assert_allclose(shift.mean(axis=(0, 1, 2)), 0, atol=0.01)


def test_a_rolling_shutter_skews_by_speed_times_time_of_the_row() -> None:
    shift = at_depth(walk(6.0), Exposure(shutter=Shutter(0.0, 0.8)), DISTANCE) - centres(VIEW)
    rows = (np.arange(VIEW.height) + 0.5) / VIEW.height - 0.5
    np.testing.assert_allclose(shift[..., 0].mean(axis=(1, 2)), 6 * 0.8 * rows, atol=0.01)
    np.testing.assert_allclose(shift[..., 0].var(axis=(1, 2)), 1 / 12, rtol=0.03)


def test_poses_between_frames_are_straight_and_spherical() -> None:
    tall = replace(make_view((0, 0, 0), (0, 1, 0), (2, 32), 400.0), K=as_matrix(
        np.array([[400.0, 0, 1], [0, 400.0, 16], [0, 0, 1]])
    ))  # fmt: skip
    before = look((-0.3, 0.1, 0), (-0.4, 1, 0.2))
    after = look((0.2, 0.2, -0.1), (0.5, 1, -0.1))
    origins, directions = rays(moved(tall, before, after), Exposure(shutter=Shutter(0, 1)))
    times = (np.arange(32) + 0.5) / 32 - 0.5
    poses = np.array([before, tall.pose, after])
    turns = Slerp([-1, 0, 1], Rotation.from_matrix(poses[:, :3, :3]))(times).as_matrix()
    eyes = [np.interp(times, [-1, 0, 1], poses[:, axis, 3]) for axis in range(3)]
    np.testing.assert_allclose(origins.mean(axis=(1, 2)), np.transpose(eyes), atol=1e-6)
    pixels = centres(tall)[:, :, 0]
    local = np.concatenate([(pixels - (1, 16)) / 400, np.ones((32, 2, 1))], axis=-1).mean(axis=1)
    expected = np.einsum("rij,rj->ri", turns, local)
    found = directions.mean(axis=(1, 2))
    found *= np.linalg.norm(expected, axis=1, keepdims=True) / np.linalg.norm(
        found, axis=1, keepdims=True
    )
    np.testing.assert_allclose(found, expected, atol=2e-4)


def test_the_first_frame_goes_on_as_it_begins_and_a_single_view_stands_still() -> None:
    optics = Exposure(shutter=Shutter(0.0, 1.0))
    first = replace(walk(6.0), pose_before=())
    last = replace(walk(6.0), pose_after=())
    whole = at_depth(walk(6.0), optics, DISTANCE)
    np.testing.assert_allclose(at_depth(first, optics, DISTANCE), whole, atol=1e-3)
    np.testing.assert_allclose(at_depth(last, optics, DISTANCE), whole, atol=1e-3)
    alone = at_depth(VIEW, optics, DISTANCE) - centres(VIEW)
    assert np.abs(alone).max() <= 0.5 + 1e-3


@pytest.fixture(scope="module")
def target(tmp_path_factory: pytest.TempPathFactory) -> RenderScene:
    """A wall at DISTANCE, lit on its right half alone, in front of an evenly bright one."""
    half = quad("right", (4, DISTANCE, 0), (0, -1, 0), (4, 8), glow(1))
    dark = quad("left", (-4, DISTANCE, 0), (0, -1, 0), (4, 8), diffuse(0))
    return open_scene(write_scene(tmp_path_factory.mktemp("optics") / "target", half + dark))


def profile(scene: RenderScene, view: View, exposure: Exposure, spp: int = 64) -> np.ndarray:
    """Colour (H, W), green."""
    blocks = color_blocks(
        scene, view, plain_truth(spp=spp, block_spp=spp), 3, optics=exposure.optics(view)
    )
    return blocks.image()["G"]


def test_images_are_those_of_the_rays(target: RenderScene) -> None:
    columns = np.arange(SIZE[0]) + 0.5 - SIZE[0] / 2
    sharp = (columns > 0).astype(float)
    focused = profile(target, VIEW, Exposure(LENS))
    np.testing.assert_array_equal(focused, np.broadcast_to(sharp, focused.shape))
    still = profile(target, VIEW, Exposure(shutter=Shutter(0.5)))
    np.testing.assert_array_equal(still, np.broadcast_to(sharp, still.shape))
    blurred = profile(target, walk(10.0), Exposure(shutter=Shutter(0.8)))
    trapezoid = np.clip(0.5 + np.clip(columns, -4, 4) / 8, 0, 1)  # of a box of 8 pixels
    np.testing.assert_allclose(blurred.mean(axis=0), trapezoid, atol=0.02)
    assert blurred.mean() == pytest.approx(sharp.mean(), abs=0.002)
