"""Window panes: Fresnel's reflectance, its complement behind the pane, and light that passes."""

from dataclasses import replace
from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest

from pbrnet.pipeline.passes.groundtruth import Truth, render_both, render_truth
from pbrnet.pipeline.pathtrace.panes import GLASS
from pbrnet.pipeline.pathtrace.panes import reflectance as reflectance_of
from pbrnet.pipeline.render.scene import open_scene
from pbrnet.scenes.contract import Portal
from pbrnet.scenes.geometry.directions import pixel_directions
from tests.fixtures.params import plain_truth
from tests.fixtures.render import WINDOW, diffuse, glow, make_view, quad, write_scene
from tests.fixtures.xml import emitter

pytestmark = pytest.mark.usefixtures("wavefront")

PARAMS = plain_truth(spp=64, block_spp=64)
SKY = '<emitter type="constant"><rgb name="radiance" value="{0},{0},{0}"/></emitter>'
IN_PANE = np.s_[9:15, 11:21]  # pixels of a 32x24 view


def image_of(truth: Truth) -> np.ndarray:
    return np.stack([truth[0][band] for band in "RGB"], axis=-1).astype(np.float64)


def reflectance(cosine: float | np.ndarray, panes: int) -> np.ndarray:
    found = reflectance_of(mi.Float(np.ravel(cosine)), panes)
    return np.array(found, dtype=np.float64).reshape(np.shape(cosine))


def glazed(panes: int) -> Portal:
    return replace(WINDOW, panes=panes)


def test_reflectance_is_that_of_the_textbook() -> None:
    """At normal incidence ((n - 1)/(n + 1))^2 a surface; a sheet 2 r/(1 + r); grazing: all."""
    once = ((GLASS - 1) / (GLASS + 1)) ** 2
    assert reflectance(1.0, 1) == pytest.approx(2 * once / (1 + once))
    assert reflectance(1.0, 2) == pytest.approx(4 * once / (1 + 3 * once))
    assert reflectance(0.0, 1) == pytest.approx(1)
    brewster = np.cos(np.arctan(GLASS))  # only one polarisation is reflected
    once = ((1 - GLASS**2) / (1 + GLASS**2)) ** 2
    assert reflectance(brewster, 1) == pytest.approx(once / (1 + once))


@pytest.mark.parametrize("panes", [0, 1, 2])
def test_a_pane_shows_both_sides_by_fresnel_in_both_images(panes: int, tmp_path: Path) -> None:
    """Sky of radiance 1 behind the pane, a wall of radiance 5 behind the camera."""
    wall = quad("wall", (0, -1, 1.5), (0, 1, 0), (30, 30), glow(5))
    scene = open_scene(write_scene(tmp_path / "s", SKY.format(1) + wall, portals=[glazed(panes)]))
    view = make_view((0, 0, 1.5))
    rays = pixel_directions(view.intrinsics, view.width, view.height).reshape(24, 32, 3)
    cosine = (rays[..., 2] / np.linalg.norm(rays, axis=-1))[IN_PANE]
    share = reflectance(cosine, panes) if panes else np.zeros_like(cosine)
    both = render_both(scene, view, PARAMS, 0.5, 3)
    alone = render_truth(scene, view, PARAMS, 4)
    # In the neutral twin the wall reflects half of the sky beside its own light.
    for truth, behind in ((both.color, 5), (both.shading, 5.5), (alone, 5)):
        image = image_of(truth)
        expected = np.broadcast_to((1 + (behind - 1) * share)[..., None], image[IN_PANE].shape)
        np.testing.assert_allclose(image[IN_PANE], expected, rtol=0.02)
        assert np.ptp(image[:5]) == pytest.approx(0, abs=1e-5), "beside the pane is the sky alone"


def test_energy_is_kept_and_what_stands_before_a_pane_hides_it(tmp_path: Path) -> None:
    """In a furnace of radiance 1 a pane cannot be seen."""
    wall = quad("wall", (0, -1, 1.5), (0, 1, 0), (30, 30), glow(1))
    board = quad("board", (-0.6, 1.5, 1.5), (0, -1, 0), (0.6, 3), diffuse(0))
    body = SKY.format(1) + wall + board
    scene = open_scene(write_scene(tmp_path / "s", body, portals=[glazed(2)]))
    image = image_of(render_both(scene, make_view((0, 0, 1.5)), PARAMS, 0.5, 3).color)
    np.testing.assert_allclose(image[IN_PANE][:, 6:], 1, rtol=1e-3)
    np.testing.assert_allclose(image[:, 17:].mean(), 1, rtol=2e-3)  # its edges cross pixels
    assert image[IN_PANE][:, :4].max() == 0


def test_light_passes_as_if_the_pane_were_open_and_parts_stay_parts(tmp_path: Path) -> None:
    """A grey floor behind the pane: as bright as without, but for what the pane reflects of it."""
    floor = quad("floor", (0, 6, 0), (0, 0, 1), (20, 4), diffuse(0.4), (0, 1, 0))
    found = {}
    for panes in (0, 2):
        body = SKY.format(1) + floor
        scene = open_scene(write_scene(tmp_path / str(panes), body, portals=[glazed(panes)]))
        view = make_view((0, 1, 1.9), (0, 1, -0.5))
        found[panes] = render_both(scene, view, PARAMS, 0.5, 3, light=True)
        inside = render_both(scene, make_view((0, 6, 1.5), (0, 0.5, -1)), PARAMS, 0.5, 3)
        found[panes].parts["inside"] = inside.color
    pixels = np.s_[10:14, 14:18]
    closed, opened = (image_of(found[panes].parts["inside"]).mean() for panes in (2, 0))
    assert closed == pytest.approx(opened, rel=0.01)
    clear, dim = (image_of(found[panes].parts["diffuse"])[pixels].mean() for panes in (0, 2))
    assert clear == pytest.approx(0.4, rel=0.02)
    cosine = 1 / np.hypot(1, 0.5)
    assert dim == pytest.approx(0.4 * (1 - reflectance(cosine, 2)), rel=0.03)
    mirrored = image_of(found[2].color) - image_of(found[2].parts["diffuse"])
    assert mirrored[pixels].mean() == pytest.approx(reflectance(cosine, 2), rel=0.05), "of the sky"


def test_mirror_images_are_direct_light_and_of_no_first_surface(tmp_path: Path) -> None:
    """A lit wall behind the camera, darkness behind the pane."""
    wall = quad("wall", (0, -1, 1.5), (0, 1, 0), (30, 30), diffuse(0.5))
    place = '<point name="position" x="0" y="0.5" z="1.5"/>'
    body = wall + emitter("point", place, intensity=(5,))
    scene = open_scene(write_scene(tmp_path / "s", body, portals=[glazed(2)]))
    truths = render_both(scene, make_view((0, 0, 1.5)), PARAMS, 0.5, 3, light=True)
    color, direct = image_of(truths.color)[IN_PANE], image_of(truths.parts["direct"])[IN_PANE]
    assert color.min() > 0.01
    np.testing.assert_allclose(direct, color, rtol=1e-5)
    for name in ("diffuse", "irradiance"):
        assert image_of(truths.parts[name])[IN_PANE].max() == 0
