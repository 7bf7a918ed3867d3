"""Triangles of all meshes in one table: the same bits as Mitsuba's own intersections."""

from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from pbrnet.pipeline.pathtrace.irradiance import first_hits
from pbrnet.pipeline.render.meshes import forget, triangles_of

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


def test_other_shapes_and_no_shapes_have_no_triangles() -> None:
    assert triangles_of(scene("sphere")) is None
    assert triangles_of(scene("rectangle")) is None
    assert triangles_of(mi.load_dict({"type": "scene"})) is None
    forget()
    assert triangles_of.cache_info().currsize == 0
