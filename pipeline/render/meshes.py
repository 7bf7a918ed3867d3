"""Triangles of all meshes of a scene in one table, so that kernels know of no single shape.

`scene.ray_intersect` calls every shape's own code, and Dr.Jit traces each such call in Python, some
30 ms in a furnished home. Points and normals from this table have the same bits.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import drjit as dr
import mitsuba as mi

from pbrnet.pipeline.render.drjit_arrays import column, shape_table
from pbrnet.pipeline.render.raycast import triangles


@dataclass(frozen=True)
class Triangles:
    """Triangles of a scene of meshes."""

    vertices: mi.Float  # three coordinates a vertex
    faces: mi.UInt32  # three vertices a triangle
    first: mi.UInt32  # a shape's first triangle, by registry id

    def intersect(self, scene: mi.Scene, ray: mi.Ray3f) -> tuple[mi.Point3f, mi.Vector3f, mi.Bool]:
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
def triangles_of(scene: mi.Scene) -> Triangles | None:
    """Return the triangles of a Mitsuba scene; None if a shape of it is no mesh.

    That of the last scene is kept, until `forget`.
    """
    shapes = list(scene.shapes())
    # Rectangles pass for meshes, too, but have no vertices.
    if not shapes or not all("vertex_positions" in mi.traverse(shape) for shape in shapes):
        return None
    found = triangles.triangles_of(shapes)
    return Triangles(
        column(mi.Float, found.vertices.ravel()),
        column(mi.UInt32, found.faces.ravel()),
        shape_table(shapes, found.first),
    )


def forget() -> None:
    """Forget the last scene."""
    triangles_of.cache_clear()
