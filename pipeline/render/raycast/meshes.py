"""Triangles of all meshes of a scene in one table, so that kernels know of no single shape.

`scene.ray_intersect` calls every shape's own code, and Dr.Jit traces each such call in Python, some
30 ms in a furnished home. What this table gives has the same bits.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from pbrnet.pipeline.render.drjit_arrays import column, shape_table
from pbrnet.pipeline.render.raycast import triangles
from pbrnet.scenes.arrays import Float32Array

_NORMALS, _UV, _FLIPPED = 1, 2, 4  # marks of a shape


@dataclass(frozen=True)
class Triangles:
    """Triangles of a scene of meshes."""

    vertices: mi.Float  # two rows of four a vertex: position and u, normal and v
    faces: mi.UInt32  # rows of four: vertices of a triangle
    first: mi.UInt32  # a shape's first triangle, by registry id
    marks: mi.UInt32  # what a shape has, by registry id

    def interaction(
        self, found: mi.PreliminaryIntersection3f, ray: mi.Ray3f, active: mi.Bool
    ) -> mi.SurfaceInteraction3f:
        """Return what `found.compute_surface_interaction(ray, mi.RayFlags.All, active)` does.

        In the order of Mitsuba's meshes, for equal rounding.
        """
        hit = active & found.is_valid()
        shape = dr.reinterpret_array(mi.UInt32, found.shape)
        marks = dr.gather(mi.UInt32, self.marks, shape, hit)
        places, normals = (self._rows(found, which, hit) for which in range(2))
        a, b, c = (mi.Point3f(row.xyz) for row in places)
        uv = [mi.Point2f(p.w, n.w) for p, n in zip(places, normals, strict=True)]
        flat = dr.normalize(dr.cross(b - a, c - a))
        smooth = _weighted(found, *(mi.Normal3f(row.xyz) for row in normals))
        smooth *= dr.rsqrt(dr.squared_norm(smooth))
        shading = dr.select(marks & _NORMALS != 0, smooth, mi.Normal3f(flat))
        side = dr.select(marks & _FLIPPED != 0, mi.Float(-1), mi.Float(1))
        si = dr.zeros(mi.SurfaceInteraction3f, dr.width(hit))
        si.t = dr.select(hit, found.t, dr.inf)
        si.time, si.wavelengths = ray.time, ray.wavelengths
        si.p = dr.select(hit, _between(found, a, b, c), 0)
        si.n = dr.select(hit, mi.Normal3f(flat) * side, 0)
        si.sh_frame.n = dr.select(hit, shading * side, 0)
        derivatives = _derivatives(flat, b - a, c - a, uv, marks & _UV != 0)
        si.dp_du, si.dp_dv = (dr.select(hit, each, 0) for each in derivatives)
        mapped = dr.select(marks & _UV != 0, _weighted(found, *uv), found.prim_uv)
        si.uv = dr.select(hit, mapped, 0)
        si.initialize_sh_frame()
        si.shape = dr.select(hit, found.shape, dr.zeros(mi.ShapePtr))
        si.prim_index = dr.select(hit, found.prim_index, 0)
        si.wi = dr.select(hit, si.to_local(-ray.d), -ray.d)
        return si

    def _rows(
        self, found: mi.PreliminaryIntersection3f, which: int, hit: mi.Bool
    ) -> list[mi.Vector4f]:
        """Return the first or the second row of each vertex of the triangle that is met."""
        shape = dr.reinterpret_array(mi.UInt32, found.shape)
        face = dr.gather(mi.UInt32, self.first, shape, hit) + found.prim_index
        corners = dr.gather(mi.Vector4u, self.faces, face, hit)
        return [
            dr.gather(mi.Vector4f, self.vertices, 2 * corners[i] + which, hit) for i in range(3)
        ]


def ray_intersect(
    scene: mi.Scene,
    meshes: Triangles | None,
    ray: mi.Ray3f,
    coherent: mi.Bool,
    active: mi.Bool,
) -> mi.SurfaceInteraction3f:
    """Return what a Mitsuba scene's `ray_intersect` does; `meshes` are its triangles, if any."""
    found = scene.ray_intersect_preliminary(ray, coherent=coherent, active=active)
    return interaction(meshes, found, ray, active)


def interaction(
    meshes: Triangles | None,
    found: mi.PreliminaryIntersection3f,
    ray: mi.Ray3f,
    active: mi.Bool,
) -> mi.SurfaceInteraction3f:
    """Return the surface interaction of what a ray has found; `meshes` as in `ray_intersect`."""
    if meshes is None:
        return found.compute_surface_interaction(ray, mi.RayFlags.All, active)
    return meshes.interaction(found, ray, active)


def _between(found: mi.PreliminaryIntersection3f, a: Any, b: Any, c: Any) -> Any:
    """Interpolate three vertices' positions at the point that is met."""
    u, v = found.prim_uv
    return dr.fma(a, 1 - u - v, dr.fma(b, u, c * v))


def _weighted(found: mi.PreliminaryIntersection3f, a: Any, b: Any, c: Any) -> Any:
    """Interpolate three vertices' other values, which Mitsuba adds up in another order."""
    u, v = found.prim_uv
    return dr.fma(c, v, dr.fma(b, u, a * (1 - u - v)))


def _derivatives(
    normal: mi.Vector3f,
    along: mi.Vector3f,
    across: mi.Vector3f,
    uv: list[mi.Point2f],
    mapped: mi.Bool,
) -> tuple[mi.Vector3f, mi.Vector3f]:
    """Return dp_du and dp_dv of triangles with two given sides and three texture coordinates."""
    first, second = uv[1] - uv[0], uv[2] - uv[0]
    determinant = dr.fma(first.x, second.y, -(first.y * second.x))
    inverse = dr.rcp(determinant)
    found = mapped & (determinant != 0)
    du = dr.fma(second.y, along, -(first.y * across)) * inverse
    dv = dr.fma(-second.x, along, first.x * across) * inverse
    s, t = mi.coordinate_system(normal)
    return dr.select(found, du, s), dr.select(found, dv, t)


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
    vertices = np.concatenate([np.zeros((1, 8), np.float32), *map(_vertices, shapes)])
    marks = [
        _NORMALS * (shape.has_vertex_normals() and not shape.has_face_normals())
        + _UV * shape.has_vertex_texcoords()
        + _FLIPPED * shape.has_flipped_normals()
        for shape in shapes
    ]
    return Triangles(
        column(mi.Float, vertices.ravel()),
        column(mi.UInt32, np.pad(found.faces, ((0, 0), (0, 1))).ravel()),
        shape_table(shapes, found.first),
        shape_table(shapes, marks),
    )


def _vertices(shape: mi.Mesh) -> Float32Array:
    """Return the rows of a mesh's vertices, (V, 8)."""
    found = np.zeros((shape.vertex_count(), 8), np.float32)
    found[:, :3] = np.asarray(shape.vertex_positions_buffer()).reshape(-1, 3)
    if shape.has_vertex_normals():
        found[:, 4:7] = np.asarray(shape.vertex_normals_buffer()).reshape(-1, 3)
    if shape.has_vertex_texcoords():
        found[:, [3, 7]] = np.asarray(shape.vertex_texcoords_buffer()).reshape(-1, 2)
    return found


def forget() -> None:
    """Forget the last scene."""
    triangles_of.cache_clear()
