"""Triangles of all meshes in one table: the same bits as Mitsuba's own intersections."""

from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from pbrnet.pipeline.pathtrace.irradiance import first_hits
from pbrnet.pipeline.render.raycast.meshes import forget, ray_intersect, triangles_of

pytestmark = pytest.mark.usefixtures("wavefront")


def scene(*others: str) -> Any:
    shapes: dict[str, Any] = {"type": "scene"}
    for number in range(5):
        centre, axis = [number - 2.0, 0.3 * number, 1.0], [0.6, 0.8, 0.0]
        place = mi.ScalarTransform4f().translate(centre)
        turn = mi.ScalarTransform4f().rotate(axis, 30.0 * number)
        shapes[f"cube{number}"] = {
            "type": "cube",
            "to_world": place @ turn @ mi.ScalarTransform4f().scale(0.4),
        }
    for name in others:
        shapes[name] = {"type": name}
    return mi.load_dict(shapes)


def test_points_and_normals_have_the_bits_of_the_shapes_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    random, meshes = np.random.default_rng(1), scene()
    directions = random.normal(size=(5000, 3))
    rays = np.tile([0.1, 0.3, -0.5], (5000, 1)), directions
    assert triangles_of(meshes) is not None
    fast = first_hits(meshes, *rays)
    assert 50 < fast[2].sum() < 5000
    monkeypatch.setattr("pbrnet.pipeline.pathtrace.irradiance.triangles_of", lambda scene: None)
    for one, other in zip(fast, first_hits(meshes, *rays), strict=True):
        assert np.array_equal(one, other)


def test_interactions_have_the_bits_of_the_shapes_own(tmp_path: Path) -> None:
    """With and without normals, texture coordinates and flipped sides; hits and misses."""
    cube = mi.load_dict({"type": "cube"})
    cube.write_ply(str(tmp_path / "cube.ply"))
    bare = mi.Mesh("bare", 3, 1)
    params = mi.traverse(bare)
    params["vertex_positions"] = [-3.0, -3, -2, 3, -3, -2, 0, 3, -2]
    params["faces"] = [0, 1, 2]
    params.update()
    shapes: dict[str, Any] = {"type": "scene", "bare": bare}
    for number, flags in enumerate([{}, {"face_normals": True}, {"flip_normals": True}]):
        place = mi.ScalarTransform4f().translate([2.0 * number - 2, 0, 0.3 * number])
        turn = mi.ScalarTransform4f().rotate([1, 2, 3], 40.0 * number).scale(0.6)
        file = str(tmp_path / "cube.ply")
        shapes[f"cube{number}"] = {
            "type": "ply",
            "filename": file,
            "to_world": place @ turn,
        } | flags
    meshes = mi.load_dict(shapes)
    random = np.random.default_rng(2)
    origin, direction = (random.normal(size=(3, 4000)).astype(np.float32) for _ in range(2))
    ray = mi.Ray3f(mi.Point3f(origin), dr.normalize(mi.Vector3f(direction)))
    active = mi.Bool(random.random(4000) < 0.9)
    table = triangles_of(meshes)
    assert table is not None
    found = [ray_intersect(meshes, each, ray, False, active) for each in (table, None)]
    assert 500 < dr.count(found[0].is_valid()) < 3500
    for name in ("t", "p", "n", "uv", "dp_du", "dp_dv", "wi", "prim_index"):
        own, theirs = (np.array(getattr(each, name)) for each in found)
        assert np.array_equal(own, theirs), name
    for name in "stn":
        own, theirs = (np.array(getattr(each.sh_frame, name)) for each in found)
        assert np.array_equal(own, theirs, equal_nan=True), name
    assert dr.all(found[0].shape == found[1].shape)


def test_other_shapes_and_no_shapes_have_no_triangles() -> None:
    assert triangles_of(scene("sphere")) is None
    assert triangles_of(scene("rectangle")) is None
    assert triangles_of(mi.load_dict({"type": "scene"})) is None
    forget()
    assert triangles_of.cache_info().currsize == 0
