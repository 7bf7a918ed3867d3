"""Intersection of a ray with a triangle in double precision: the same bits on every processor.

Embree finds the triangle. The distance and the barycentric coordinates that it returns are made of
approximate reciprocals, which differ by instruction set and vendor; here they are computed again.
Only +, -, * and / occur, so NumPy, Python and Dr.Jit agree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from scenes.arrays import Float32Array, Int64Array

Vector = Sequence[Any]  # x, y, z: numbers, or arrays of them


@dataclass(frozen=True)
class Triangles:
    """Triangles of all meshes of a scene.

    `vertices` is (V, 3), world metres; `faces` (F, 3) holds their numbers. The faces of shape i
    begin at `first[i]`; 0 for a shape that is no mesh: face 0 belongs to none.
    """

    vertices: Float32Array
    faces: Int64Array
    first: Int64Array


def triangles_of(shapes: Sequence[Any]) -> Triangles:
    """Return the triangles of loaded Mitsuba shapes, with at least one vertex and one face."""
    vertices, faces = [np.zeros((1, 3), np.float32)], [np.zeros((1, 3), np.int64)]
    first = np.zeros(len(shapes), dtype=np.int64)
    vertex_count = face_count = 1
    for number, shape in enumerate(shapes):
        if not shape.is_mesh():
            continue
        first[number] = face_count
        vertices.append(np.asarray(shape.vertex_positions_buffer()).reshape(-1, 3))
        faces.append(np.asarray(shape.faces_buffer()).reshape(-1, 3).astype(np.int64))
        faces[-1] += vertex_count
        vertex_count += len(vertices[-1])
        face_count += len(faces[-1])
    return Triangles(np.concatenate(vertices), np.concatenate(faces), first)


def meet(origin: Vector, direction: Vector, a: Vector, b: Vector, c: Vector) -> tuple[Any, ...]:
    """Return t, u and v, each times the determinant, and the determinant, of ray and triangle.

    The ray meets the triangle's plane at origin + t direction = (1 - u - v) a + u b + v c. The
    determinant is 0 where they are parallel. Möller and Trumbore, "Fast, minimum storage
    ray-triangle intersection", 1997.
    """
    edge_b, edge_c, offset = _minus(b, a), _minus(c, a), _minus(origin, a)
    p, q = _cross(direction, edge_c), _cross(offset, edge_b)
    return _dot(edge_c, q), _dot(offset, p), _dot(direction, q), _dot(edge_b, p)


def _minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _dot(a: Vector, b: Vector) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
