"""Cameras, inputs, materials, labels and flow have the same bits under another instruction set."""

from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from pbrnet.pipeline.render import raycast
from pbrnet.pipeline.render.raycast import triangles
from pbrnet.pipeline.render.scene import open_scene
from pbrnet.scenes.geometry.directions import unit
from tests.fixtures.instruction_sets import NARROW, digests_under, embree_shim, has_avx512
from tests.fixtures.render import diffuse, quad, write_scene

GLASS = '<bsdf type="thindielectric"/>'
WIDE = pytest.mark.skipif(not has_avx512(), reason="this processor has no wider instructions")


@WIDE
@pytest.mark.slow
@pytest.mark.usefixtures("wavefront")
def test_numpy_blas_and_dr_jit_give_the_same_bits_with_avx2(tmp_path: Path) -> None:
    home = tmp_path / "home"
    assert digests_under(home, {}) == digests_under(home, NARROW)


@WIDE
@pytest.mark.check
@pytest.mark.usefixtures("wavefront")
def test_embree_gives_the_same_bits_with_avx2(tmp_path: Path) -> None:
    """In so few pixels, Embree misses no face; in millions it does (docs/rendering.md)."""
    shim = embree_shim(tmp_path)
    if shim is None:
        pytest.skip("needs a C compiler")
    home = tmp_path / "home"
    assert digests_under(home, {}) == digests_under(home, {**NARROW, **shim})


@pytest.mark.usefixtures("wavefront")
def test_reciprocal_square_roots_are_ieee() -> None:
    values = np.random.default_rng(0).uniform(1e-3, 1e3, 4096).astype(np.float32)
    np.testing.assert_array_equal(dr.rsqrt(mi.Float(values)).numpy(), np.sqrt(1 / values))


@pytest.mark.usefixtures("variant")
def test_distances_are_those_of_exact_arithmetic_rounded_once(tmp_path: Path) -> None:
    plane = quad("p", (0.1, 3.3, 1.7), (0.3, -1, 0.2), (5, 5), diffuse())
    geometry = open_scene(write_scene(tmp_path / "scene", plane)).geometry
    generator = np.random.default_rng(1)
    directions = generator.uniform((-0.4, 0.8, -0.4), (0.4, 1.2, 0.4), (500, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    directions = directions.astype(np.float32).astype(np.float64)
    eye = np.array([0.5, -0.25, 1.5])
    _, distance = raycast.nearest(geometry, eye, directions)
    found = triangles.triangles_of(geometry.shapes)
    corners = found.vertices[found.faces[found.first[0]]].astype(np.float64)
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    expected = (corners[0] - eye) @ normal / (directions @ normal)
    assert np.isfinite(distance).all()
    np.testing.assert_allclose(distance, expected, rtol=2**-23, atol=0)


@pytest.mark.usefixtures("variant")
def test_of_faces_in_one_plane_the_last_is_seen_and_all_are_met(tmp_path: Path) -> None:
    """A wall, a sheet on it with the same front, and a box's back that touches it."""
    wall = quad("wall", (0, 2, 1.5), (0, -1, 0), (2, 1.5), diffuse())
    sheet = quad("sheet", (0.1, 2, 1.5), (0, -1, 0), (0.7, 0.4), diffuse())
    back = quad("back", (-0.3, 2, 1.6), (0, 1, 0), (0.5, 0.6), diffuse())
    geometry = open_scene(write_scene(tmp_path / "scene", sheet + wall + back)).geometry
    names = [shape.id() for shape in geometry.shapes]
    x, z = (a.ravel() for a in np.meshgrid(np.linspace(-1, 1, 41), np.linspace(0.7, 2.3, 33)))
    rays = unit(np.stack([x - 0.013, np.full_like(x, 2.0), z - 1.487], axis=1))
    places = np.array([0, 0, 1.5]) + rays * (2 / rays[:, 1:2])
    on = {
        "wall": np.ones(len(rays), dtype=bool),
        "sheet": (np.abs(places[:, [0, 2]] - [0.1, 1.5]) < [0.7, 0.4]).all(axis=1),
        "back": (np.abs(places[:, [0, 2]] - [-0.3, 1.6]) < [0.5, 0.6]).all(axis=1),
    }
    eye = (0.0, 0.0, 1.5)
    seen, _ = raycast.nearest(geometry, eye, rays)
    front = ~on["back"]  # which of two opposite faces is seen is open
    assert (seen[front] == names.index("wall")).all()
    met = raycast.objects_along(geometry, np.arange(3, dtype=np.int32), eye, rays)[:, 0]
    for number, name in enumerate(names):
        np.testing.assert_array_equal(met >> number & 1 > 0, on[name], err_msg=name)


@pytest.mark.parametrize("turn", [0.0, 0.3])
def test_faces_in_one_plane_are_partners_at_every_distance_from_the_origin(turn: float) -> None:
    """A wall and a picture on it, as far from the origin as rounding to float32 makes them.

    Planes are compared on a grid of a millimetre: distances at its borders are the hard ones.
    """
    normal = np.array([np.cos(turn), np.sin(turn), 0.0])
    along = np.array([-np.sin(turn), np.cos(turn), 0.0])
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    for distance in (2.0, 2.0002, 2.0005, 2.0008):
        for gap in (0.0, 1e-7, -1e-7):
            places = [
                normal * (distance + offset)
                + (first + size * x) * along
                + np.array([0, 0, 0.1 + size * z])
                for offset, first, size in ((0.0, 0.0, 2.0), (gap, 0.2, 0.1))
                for x, z in corners
            ]
            vertices = np.array([np.zeros(3), *places], dtype=np.float32)
            faces = np.array([[0, 0, 0], [1, 2, 3], [4, 5, 6]])
            scene = triangles.Triangles(vertices, faces, np.array([1, 2]))
            starts, partners = triangles.partners_of(scene, np.array([True, True]), True)
            assert partners.tolist() == [2, 1] and starts.tolist() == [0, 0, 1, 2]


@pytest.mark.usefixtures("variant")
def test_a_table_is_seen_through_the_bottom_of_the_glass_that_stands_on_it(tmp_path: Path) -> None:
    """Bottom and table lie in one plane; a ray that passes the one must not pass the other."""
    table = quad("table", (0, 2, 0.5), (0, 0, 1), (1, 1), diffuse(), (0, 1, 0))
    bottom = quad("glass", (0, 2, 0.5), (0, 0, -1), (0.1, 0.1), GLASS, (0, 1, 0))
    floor = quad("floor", (0, 2, 0), (0, 0, 1), (3, 3), diffuse(), (0, 1, 0))
    geometry = open_scene(write_scene(tmp_path / "scene", bottom + table + floor)).geometry
    names = [shape.id() for shape in geometry.shapes]
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-0.2, 0.2, 31), np.linspace(1.8, 2.2, 29)))
    rays = unit(np.stack([x, y, np.full_like(x, -1.1)], axis=1))
    seen, distance = raycast.nearest(geometry, (0.0, 0.0, 1.6), rays)
    assert (seen == names.index("table")).all()
    np.testing.assert_allclose(rays[:, 2] * distance, -1.1, rtol=1e-6)


@pytest.mark.usefixtures("variant")
def test_no_ray_slips_between_the_faces_that_meet_at_an_edge(tmp_path: Path) -> None:
    """Rays at the diagonals of small quads far off, which are the edges of their triangles."""
    place = np.array([300.1, 401.7, 55.3])
    front = quad("front", tuple(place), (0, -1, 0), (0.05, 0.05), diffuse())
    wall = quad("wall", (300, 402, 55), (0, -1, 0), (9, 9), diffuse())
    geometry = open_scene(write_scene(tmp_path / "scene", wall + front)).geometry
    names = [shape.id() for shape in geometry.shapes]
    eye = np.array([299.3, 398.2, 54.9])
    for slope in (1, -1):
        s = np.linspace(-0.049, 0.049, 101)
        rays = unit(place + np.stack([s, 0 * s, slope * s], axis=1) - eye)
        seen, _ = raycast.nearest(geometry, tuple(eye), rays)
        assert (seen == names.index("front")).all()
