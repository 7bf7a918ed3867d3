"""Intersection of a ray with a triangle in double precision: the same bits on every processor.

Embree finds the triangle. The distance and the barycentric coordinates that it returns are made of
approximate reciprocals, which differ by instruction set and vendor; here they are computed again.
Only +, -, * and / occur, so NumPy, Python and Dr.Jit agree.

Which of the faces at an edge a ray meets, and whether it meets one at a silhouette, Embree decides
with the same rounding. So it looks along three rays close by (`ASIDE`), which such an edge parts,
and of the faces found the nearest one counts that the ray itself meets, or passes by less than
`_REACH`: too little to see, and more than Embree's rounding. What Embree finds along the ray itself
counts only where the three find nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from pbrnet.scenes.arrays import BoolArray, Float32Array, Float64Array, Int64Array

Vector = Any  # x, y, z: a sequence of numbers, or of arrays
_COPLANAR = 1e-5  # metres between two faces that are in one plane
_BESIDE = 1e-3  # metres between the bounds of shapes that may touch, and more than rounding
_GRID = 1e-3  # of normals and of distances to the origin (metres): first guess of equal planes
_REACH = 2e-6  # radians by which a ray may pass a face that it meets
# Sideways parts of the three directions, ten times as far; no line has all of them on one side.
ASIDE = ((1.9e-5, 6.2e-6), (-1.49e-5, 1.33e-5), (-4.1e-6, -1.95e-5))
_SMALL = 1e-5  # square metres: smaller faces are met by hardly a ray


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


def owners_of(triangles: Triangles) -> Int64Array:
    """Return the shape of each face, (F,); face 0, which belongs to none, gets the first."""
    meshes = np.flatnonzero(triangles.first)
    place = np.searchsorted(triangles.first[meshes], np.arange(len(triangles.faces)), "right") - 1
    return np.append(meshes, 0)[np.maximum(place, 0)]


def partners_of(
    triangles: Triangles, opaque: BoolArray, same_side: bool, clear: BoolArray | None = None
) -> tuple[Int64Array, Int64Array]:
    """Return which faces of other shapes each face overlaps in a common plane.

    Which of them a ray meets first is a matter of rounding. `opaque[i]` says whether shape i takes
    part; faces below `_SMALL` do not. With `same_side`, partners have the same front: others are
    things that touch, such as a cupboard and its wall, and seldom seen. Faces of `clear` shapes,
    such as the bottom of a glass, get the opaque ones below or behind them as partners. The
    partners of face f are `partners[starts[f] : starts[f + 1]]`.
    """
    first, second = _overlaps(triangles, opaque, same_side)
    if clear is not None and clear.any():
        beside = _shapes_beside(triangles, clear)
        found = _overlaps(triangles, (opaque | clear) & beside, same_side=False)
        owner = owners_of(triangles)
        mixed = clear[owner[found[0]]] & opaque[owner[found[1]]]
        first, second = (
            np.concatenate([some, more[mixed]])
            for some, more in zip((first, second), found, strict=True)
        )
        order = np.lexsort((second, first))
        first, second = first[order], second[order]
    starts = np.searchsorted(first, np.arange(len(triangles.faces) + 1))
    return starts.astype(np.int64), second


def _shapes_beside(triangles: Triangles, chosen: BoolArray) -> BoolArray:
    """Return which shapes have bounds that touch those of any of the `chosen` shapes."""
    meshes = np.flatnonzero(triangles.first)
    beside = np.zeros(len(triangles.first), dtype=bool)
    if len(meshes):
        corners = triangles.vertices[triangles.faces]
        starts = triangles.first[meshes]
        low = np.minimum.reduceat(corners.min(axis=1), starts) - _BESIDE
        high = np.maximum.reduceat(corners.max(axis=1), starts) + _BESIDE
        some = chosen[meshes]
        apart = (low[:, None] > high[some]) | (high[:, None] < low[some])
        beside[meshes] = np.any(~np.any(apart, axis=2), axis=1)
    return beside


def _overlaps(
    triangles: Triangles, taken: BoolArray, same_side: bool
) -> tuple[Int64Array, Int64Array]:
    """Return the pairs of faces of two shapes that overlap in a plane, each pair both ways around.

    `taken[i]` says whether shape i takes part. Sorted.
    """
    faces = triangles.faces
    owner = owners_of(triangles)
    corners = triangles.vertices[faces].astype(np.float64)
    edges = (corners[:, k].T - corners[:, 0].T for k in (1, 2))
    normal: Float64Array = np.stack(_cross(*edges), axis=1)
    doubled = np.sqrt(_dot(normal.T, normal.T))
    chosen = np.flatnonzero((doubled > 2 * _SMALL) & taken[owner])
    normal = normal[chosen] / doubled[chosen, None]
    axis = np.abs(normal).argmax(axis=1)
    if not same_side:
        normal *= np.sign(normal[np.arange(len(chosen)), axis])[:, None]
    height = _dot(normal.T, corners[chosen, 0].T)
    figures = np.column_stack([normal, height]) / _GRID
    # Equal planes on two sides of a border of the grid are on one side in the shifted grid.
    found = [
        _in_planes(
            _numbered(np.floor(figures + shift).astype(np.int64)),
            corners[chosen],
            owner[chosen],
            axis,
            normal,
            height,
        )
        for shift in (0.5, 0.2)  # neither splits planes along axes, nor at whole millimetres
    ]
    first, second = (np.concatenate(part) for part in zip(*found, strict=True))
    pairs = np.unique(np.concatenate([first * len(chosen) + second, second * len(chosen) + first]))
    first, second = np.divmod(pairs, max(len(chosen), 1))
    return chosen[first], chosen[second]


def _in_planes(
    plane: Int64Array,
    corners: Float64Array,
    owner: Int64Array,
    axis: Int64Array,
    normal: Float64Array,
    height: Float64Array,
) -> tuple[Int64Array, Int64Array]:
    """Return the pairs of faces (N,) of two owners that overlap in a plane, among equal `plane`.

    `axis` is that of the largest part of each `normal` (N, 3); `height` is the distance of each
    face's plane from the origin.
    """
    some = np.zeros(len(plane), dtype=np.int64)  # by plane: one of its shapes
    some[plane] = owner
    mixed = np.zeros(len(plane), dtype=bool)  # by plane: whether it has several shapes
    mixed[plane[owner != some[plane]]] = True
    shared = np.flatnonzero(mixed[plane])
    first, second = _overlapping(corners[shared], axis[shared], plane[shared], owner[shared])
    first, second = shared[first], shared[second]
    near = np.ones(len(first), dtype=bool)
    for k in range(3):
        distance = _dot(normal[first].T, corners[second, k].T) - height[first]
        near &= np.abs(distance) < _COPLANAR
    return first[near], second[near]


def _overlapping(
    corners: Float64Array, axis: Int64Array, plane: Int64Array, owner: Int64Array
) -> tuple[Int64Array, Int64Array]:
    """Return the pairs of triangles (N, 3, 3) in one plane that overlap, seen along `axis` (N,).

    Only pairs of two owners.
    """
    kept = np.array([[1, 2], [0, 2], [0, 1]])[axis]
    flat = np.take_along_axis(corners, kept[:, None, :].repeat(3, axis=1), axis=2)
    low, high = flat.min(axis=1) + _COPLANAR, flat.max(axis=1) - _COPLANAR
    # Planes lie side by side, so that one search serves all.
    offset = plane * 4 * (1 + np.abs(flat).max(initial=0))
    boxes = shapely.box(low[:, 0] + offset, low[:, 1], high[:, 0] + offset, high[:, 1])
    first, second = shapely.STRtree(boxes).query(boxes, predicate="intersects")
    upper = (first < second) & (owner[first] != owner[second])
    first, second = first[upper], second[upper]
    apart = np.zeros(len(first), dtype=bool)
    for one, other in ((first, second), (second, first)):
        for k in range(3):
            edge = flat[one, (k + 1) % 3] - flat[one, k]
            edge /= np.maximum(np.sqrt(edge[:, 0] ** 2 + edge[:, 1] ** 2), 1e-12)[:, None]
            x, y = -edge[:, 1:], edge[:, :1]
            mine = flat[one, :, 0] * x + flat[one, :, 1] * y
            theirs = flat[other, :, 0] * x + flat[other, :, 1] * y
            apart |= mine.max(axis=1) - _COPLANAR < theirs.min(axis=1)
            apart |= theirs.max(axis=1) - _COPLANAR < mine.min(axis=1)
    return first[~apart], second[~apart]


def _numbered(rows: Int64Array) -> Int64Array:
    """Return a number for each row (N, 4): equal ones for equal rows."""
    code = rows[:, 0]
    for column in rows.T[1:]:
        code = code * 1_000_003 + column  # wraps around; rows that collide are told apart later
    return np.unique(code, return_inverse=True)[1].astype(np.int64)


def meet(origin: Vector, direction: Vector, a: Vector, b: Vector, c: Vector) -> tuple[Any, ...]:
    """Return t, u and v, each times the determinant, and the determinant, of ray and triangle.

    The ray meets the triangle's plane at origin + t direction = (1 - u - v) a + u b + v c. The
    determinant is 0 where they are parallel. Möller and Trumbore, "Fast, minimum storage
    ray-triangle intersection", 1997.
    """
    edge_b, edge_c, offset = _minus(b, a), _minus(c, a), _minus(origin, a)
    p, q = _cross(direction, edge_c), _cross(offset, edge_b)
    return _dot(edge_c, q), _dot(offset, p), _dot(direction, q), _dot(edge_b, p)


def comes_near(
    origin: Vector, direction: Vector, corners: Sequence[Vector], determinant: Any
) -> Any:
    """Return whether a ray meets a triangle or passes it by an angle of at most `_REACH`.

    The angles are those to the planes through the ray's origin and an edge. `determinant` is that
    of `meet`, whose sign says on which side of these planes the triangle lies.
    """
    a, b, c = (_minus(corner, origin) for corner in corners)
    near = determinant != 0
    for first, second in ((a, b), (b, c), (c, a)):
        normal = _cross(second, first)
        side = _dot(direction, normal)
        within = side * side <= _REACH**2 * _dot(normal, normal)
        near = near & ((side * determinant >= 0) | within)
    return near


def _minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _dot(a: Vector, b: Vector) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
