"""Triangles of all meshes of a scene in one table, so that kernels know of no single shape.

`scene.ray_intersect` calls every shape's own code, and Dr.Jit traces each such call in Python, some
30 ms in a furnished home. Points and normals from this table have the same bits.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from pbrnet.pipeline.render.drjit_arrays import column, registry_table


@dataclass(frozen=True)
class Triangles:
    """Triangles of a scene of meshes."""

    vertices: Any  # mi.Float, three coordinates a vertex
    faces: Any  # mi.UInt32, three vertices a triangle
    first: Any  # mi.UInt32: a shape's first triangle, by registry id

    def intersect(self, scene: Any, ray: Any) -> tuple[Any, Any, Any]:
        """Return the first point along each ray, its geometric normal, and hit flags.

        Either side's normal; undefined where nothing is hit.
        """
        found = scene.ray_intersect_preliminary(ray)
        hit = found.is_valid()
        shape = dr.reinterpret_array(mi.UInt32, found.shape)
        face = dr.gather(mi.UInt32, self.first, shape, hit) + found.prim_index
        corners = dr.gather(mi.Vector3u, self.faces, face, hit)
        a, b, c = (dr.gather(mi.Point3f, self.vertices, corner, hit) for corner in corners)
        u, v = found.prim_uv
        # In the order of Mitsuba's meshes, for equal rounding.
        point = dr.fma(a, 1 - u - v, dr.fma(b, u, c * v))
        return point, dr.normalize(dr.cross(b - a, c - a)), hit


@lru_cache(maxsize=1)
def triangles_of(scene: Any) -> Triangles | None:
    """Return the triangles of a Mitsuba scene; None if a shape of it is no mesh.

    That of the last scene is kept, until `forget`.
    """
    shapes = [(shape, mi.traverse(shape)) for shape in scene.shapes()]
    # Rectangles pass for meshes, too, but have no vertices.
    if not shapes or not all("vertex_positions" in params for _, params in shapes):
        return None
    vertices, faces, first = [], [], []
    vertex_count = face_count = 0
    for shape, params in shapes:
        points = np.array(params["vertex_positions"], dtype=np.float32)
        corners = np.array(params["faces"], dtype=np.uint32)
        vertices.append(points)
        faces.append(corners + np.uint32(vertex_count))
        first.append((shape, face_count))
        vertex_count += len(points) // 3
        face_count += len(corners) // 3
    return Triangles(
        column(mi.Float, np.concatenate(vertices)),
        column(mi.UInt32, np.concatenate(faces)),
        registry_table(first, mi.ShapePtr, 0, mi.UInt32),
    )


def forget() -> None:
    """Forget the last scene."""
    triangles_of.cache_clear()
