"""Mesh primitives for furniture and buildings: positions and uvs in metres, closed, outward faces.

Imported as `g`. Round bodies have duplicate vertices at creases and at uv seams;
`PiecePart.normals` averages their normals where the surface is smooth.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import accumulate, pairwise
from typing import Literal

import mapbox_earcut
import numpy as np
import shapely

from pbrnet.scenes.arrays import BoolArray, Float64Array, Int64Array
from pbrnet.scenes.procedural.piece import CREASE_COSINE

Axis = Literal["x", "y", "z"]
AXES: dict[str, int] = {"x": 0, "y": 1, "z": 2}
CORNERS = ((-1, -1), (-1, 1), (1, -1), (1, 1))  # signs of x and y
_MIN_AREA = 1e-10  # square metres; smaller triangles are degenerate


@dataclass(frozen=True)
class BodyMesh:
    """Triangle mesh with uvs in metres.

    `vertices` (V, 3) metres; `faces` (F, 3), counter-clockwise seen from outside; `uvs` (V, 2)
    metres; `smooth`: shaded with `PiecePart.normals` (round or bevelled bodies) instead of flat
    facets.
    """

    vertices: Float64Array
    faces: Int64Array
    uvs: Float64Array
    smooth: bool = True

    def moved(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> BodyMesh:
        """Return the mesh translated by metres."""
        return self._with(self.vertices + np.array([x, y, z]))

    def turned(self, axis: Axis, degrees: float) -> BodyMesh:
        """Return the mesh rotated about an axis through the origin by the right-hand rule."""
        return self._with(self.vertices @ _rotation(axis, degrees).T)

    def scaled(self, x: float = 1.0, y: float = 1.0, z: float = 1.0) -> BodyMesh:
        """Return the mesh scaled by positive factors; uvs do not change."""
        return self._with(self.vertices * np.array([x, y, z]))

    def _with(self, vertices: Float64Array) -> BodyMesh:
        # Four times as fast as `replace`.
        return BodyMesh(vertices, self.faces, self.uvs, self.smooth)


@lru_cache(maxsize=512)
def _rotation(axis: Axis, degrees: float) -> Float64Array:
    sine, cosine = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    a, b = (AXES[axis] + 1) % 3, (AXES[axis] + 2) % 3
    rotation = np.eye(3)
    rotation[a, a] = rotation[b, b] = cosine
    rotation[a, b], rotation[b, a] = -sine, sine
    return rotation


def merge(meshes: Iterable[BodyMesh]) -> BodyMesh:
    """Concatenate meshes into one."""
    meshes = list(meshes)
    starts = accumulate((len(mesh.vertices) for mesh in meshes), initial=0)
    return BodyMesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]),
        np.concatenate([mesh.uvs for mesh in meshes]),
        any(mesh.smooth for mesh in meshes),
    )


def grid(points: Float64Array, uvs: Float64Array | None = None) -> BodyMesh:
    """Triangulate a quad grid `points` (n, m, 3); its front faces d/di x d/dj.

    Without `uvs` (n, m, 2), u runs along j and v along i, by mean arc length. Degenerate
    triangles (at poles) are left out.
    """
    n, m = points.shape[:2]
    if uvs is None:
        uvs = np.zeros((n, m, 2))
        along = np.add.reduce(_lengths(points[:, 1:] - points[:, :-1]), axis=0)
        across = np.add.reduce(_lengths(points[1:] - points[:-1]), axis=1)
        uvs[:, 1:, 0] = (along / n).cumsum()
        uvs[1:, :, 1] = (across / m).cumsum()[:, None]
    faces = _grid_faces(n, m)
    solid = _nondegenerate(points)
    return BodyMesh(
        points.reshape(-1, 3), faces.copy() if solid.all() else faces[solid], uvs.reshape(-1, 2)
    )


@lru_cache(maxsize=512)
def _grid_faces(n: int, m: int) -> Int64Array:
    index = np.arange(n * m).reshape(n, m)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    return np.concatenate(
        [np.stack([a, b, c], axis=-1).reshape(-1, 3), np.stack([a, c, d], axis=-1).reshape(-1, 3)]
    )


def box(
    size: Sequence[float],
    at: Sequence[float] = (0.0, 0.0, 0.0),
    bevel: float = 0.0,
    grain: Axis | None = None,
) -> BodyMesh:
    """Return a box of `size` (x, y, z) with the centre of its bottom at `at`, metres.

    `bevel` chamfers the edges. u runs along the axis `grain`, by default the longest edge.
    """
    half = np.asarray(size, dtype=float) / 2
    centre = np.asarray(at, dtype=float) + np.array([0, 0, half[2]])
    sizes = half.tolist()
    bevel = min(bevel, 0.45 * 2 * min(sizes))
    along = AXES[grain] if grain else sizes.index(max(sizes))
    signs, inset, _, faces = _box_template(bevel > 0)
    corners = signs * (half - inset * max(bevel, 0.0))
    # (u, v) of the faces across each axis
    axes = []
    for axis in range(3):
        first, second = (other for other in range(3) if other != axis)
        u = along if along in (first, second) else max(first, second, key=sizes.__getitem__)
        axes.append((u, first + second - u))
    # Offset the uvs by position, so that boards of one texture look different.
    start = np.array([1.7, 2.3]) @ np.array([[centre[0], centre[1]], [centre[2], centre[0]]])
    uvs = corners.reshape(-1)[_box_columns(bevel > 0, tuple(axes))] + start
    return BodyMesh(corners + centre, faces.copy(), uvs, smooth=bevel > 0)


@lru_cache
def _box_columns(bevelled: bool, axes: tuple[tuple[int, int], ...]) -> Int64Array:
    """Indices (V, 2) of u and v of each vertex in the flattened array of a box's corners."""
    facing = _box_template(bevelled)[2]
    return 3 * np.arange(len(facing))[:, None] + np.array(axes)[facing]


@lru_cache
def _box_template(bevelled: bool) -> tuple[Float64Array, Float64Array, Int64Array, Int64Array]:
    """Topology of all boxes: (signs, inset, axis, faces).

    `signs` (V, 3): signs of the corner of each vertex; `inset` (V, 3): 1 along the axes where the
    bevel moves it inwards; `axis` (V,): axis of its face's normal; `faces` (F, 3).
    """
    bevel = 0.25 if bevelled else 0.0
    half = np.ones(3)
    vertices: list[Float64Array] = []
    across: list[int] = []
    faces: list[list[int]] = []

    def polygon(corners: Float64Array, axis: int) -> None:
        first = len(across)
        vertices.append(corners)
        across.extend([axis] * len(corners))
        faces.extend([first, first + i, first + i + 1] for i in range(1, len(corners) - 1))

    for axis in range(3):
        b, c = (axis + 1) % 3, (axis + 2) % 3
        for sign in (-1.0, 1.0):
            corners = np.zeros((4, 3))
            corners[:, axis] = sign * half[axis]
            corners[:, b] = np.array([-1, 1, 1, -1]) * (half[b] - bevel)
            corners[:, c] = np.array([-1, -1, 1, 1]) * (half[c] - bevel)
            polygon(corners if sign > 0 else corners[::-1], axis)
            if bevel <= 0:
                continue
            for other_sign in (-1.0, 1.0):  # chamfer between the faces across `axis` and `b`
                edge = np.zeros((4, 3))
                edge[:, c] = np.array([-1, 1, 1, -1]) * (half[c] - bevel)
                edge[:2, axis], edge[2:, axis] = sign * half[axis], sign * (half[axis] - bevel)
                edge[:2, b] = other_sign * (half[b] - bevel)
                edge[2:, b] = other_sign * half[b]
                polygon(edge if sign * other_sign < 0 else edge[::-1], axis)
    if bevel > 0:
        for sx in (-1.0, 1.0):
            for sy in (-1.0, 1.0):
                for sz in (-1.0, 1.0):
                    signs = np.array([sx, sy, sz])
                    corner = signs * (half - bevel) + np.diag(signs * bevel)
                    polygon(corner if sx * sy * sz > 0 else corner[::-1], 2)
    points = np.concatenate(vertices)
    inset = (np.abs(points) < 0.9).astype(float)
    return np.sign(points), inset, np.array(across), np.array(faces, dtype=np.int64)


def span(
    low: Sequence[float], high: Sequence[float], bevel: float = 0.0, grain: Axis | None = None
) -> BodyMesh:
    """Return the box between two opposite corners."""
    low_, high_ = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    middle = (low_ + high_) / 2
    return box(high_ - low_, (middle[0], middle[1], low_[2]), bevel, grain)


def frame_bars(
    outer: Sequence[float], inner: Sequence[float]
) -> list[tuple[float, float, float, float]]:
    """Return the bars (a0, a1, b0, b1) between two such rectangles: two posts, rails between them.

    There is no rail where the lower or the upper sides of both agree.
    """
    (a, b, c, d), (e, f, g, h) = outer, inner
    rails = [(e, f, low, high) for low, high in ((c, g), (h, d)) if low != high]
    return [(a, e, c, d), (f, b, c, d), *rails]


def rounded_box(
    size: Sequence[float],
    at: Sequence[float] = (0.0, 0.0, 0.0),
    radius: float = 0.03,
    bulge: Sequence[float] = (0.0, 0.0, 0.0),
    steps: int = 2,
    inner: int = 3,
) -> BodyMesh:
    """Return a box with rounded edges, the centre of its bottom at `at`.

    `radius` of the edges and `bulge` of the faces per axis in metres; `steps` segments per eighth
    of a turn at each edge, `inner` segments across the flat middle.
    """
    half = np.asarray(size, dtype=float) / 2
    radius = min(radius, 0.999 * float(half.min()))
    arc = radius * np.tan(np.radians(45) * np.arange(1, steps + 1) / steps)

    def stations(axis: int) -> Float64Array:
        core = half[axis] - radius
        middle = np.linspace(-core, core, inner + 1)
        return np.concatenate([-core - arc[::-1], middle, core + arc])

    meshes = []
    for axis in range(3):
        b, c = (axis + 1) % 3, (axis + 2) % 3
        for sign in (-1.0, 1.0):
            first, second = (b, c) if sign > 0 else (c, b)
            points = np.zeros((2 * steps + inner + 1, 2 * steps + inner + 1, 3))
            points[..., axis] = sign * half[axis]
            points[..., first] = stations(first)[:, None]
            points[..., second] = stations(second)[None, :]
            u, v = (first, second) if half[first] >= half[second] else (second, first)
            uvs = np.stack([points[..., u], points[..., v]], axis=-1)
            core = np.clip(points, -(half - radius), half - radius)
            away = points - core
            points = core + radius * away / np.linalg.norm(away, axis=-1, keepdims=True)
            meshes.append(grid(points, uvs))
    mesh = merge(meshes)
    share = 1 - (mesh.vertices / half) ** 2
    for axis in range(3):
        b, c = (axis + 1) % 3, (axis + 2) % 3
        push = bulge[axis] * np.clip(share[:, b] * share[:, c], 0, 1)
        mesh.vertices[:, axis] += push * np.sign(np.round(mesh.vertices[:, axis], 9))
    return mesh.moved(at[0], at[1], at[2] + float(half[2]))


def loft(rings: Sequence[Float64Array] | Float64Array, closed: bool = True) -> BodyMesh:
    """Return a body through `rings` (k, m, 3), each counter-clockwise seen from the last ring.

    Flat caps close the first and last ring unless `closed` is False or the ring is a point.
    u runs along the body, v around it; flat horizontal bands have u, v = x, y.
    """
    rings = np.asarray(rings, dtype=float)
    spans = rings.max(axis=1) - rings.min(axis=1)
    if closed:
        middles = np.add.reduce(rings[[0, -1]], axis=1) / rings.shape[1]
        first, last = (np.broadcast_to(middle, (1, *rings.shape[1:])) for middle in middles)
        opened = spans[[0, -1]].max(axis=1) > 1e-9
        parts = [first] * bool(opened[0]) + [rings] + [last] * bool(opened[1])
        rings = np.concatenate(parts)
        spans = np.pad(spans, ((int(opened[0]), int(opened[1])), (0, 0)))
    steps = rings[1:] - rings[:-1]
    directions = steps / np.maximum(_lengths(steps), 1e-12)[..., None]
    turns = np.add.reduce((directions[1:] * directions[:-1]).sum(axis=2), axis=1) / rings.shape[1]
    # Level bands are flat and horizontal; their uvs are x, y.
    level = (spans[1:, 2] < 1e-6) & (np.abs(steps[..., 2]).max(axis=1) < 1e-6)
    corners = (turns < CREASE_COSINE) | (level[1:] != level[:-1])
    breaks = [0, *(int(k) + 1 for k in np.flatnonzero(corners)), len(rings) - 1]
    around = np.concatenate([rings, rings[:, :1]], axis=1)
    bands = []
    for start, stop in pairwise(breaks):
        points = around[start : stop + 1].swapaxes(0, 1)  # (m + 1, k, 3): i around, j along
        bands.append(grid(points, points[..., :2].copy() if level[start] else None))
    return merge(bands)


def lathe(profile: Sequence[Sequence[float]], segments: int = 24) -> BodyMesh:
    """Return a solid of revolution about Z; `profile` of (radius, z) starts at the bottom, outside.

    Flat discs close profiles that do not begin and end on the axis.
    """
    return loft(_rings(profile, segments))


def hollow_lathe(profile: Sequence[Sequence[float]], segments: int) -> BodyMesh:
    """Return a solid of revolution about Z with a hole; `profile` of (radius, z) goes around it."""
    return loft(_rings([*profile, profile[0]], segments), closed=False)


def _rings(profile: Sequence[Sequence[float]], segments: int) -> Float64Array:
    points = np.asarray(profile, dtype=float)
    angle = 2 * np.pi * np.arange(segments) / segments
    rings = np.zeros((len(points), segments, 3))
    rings[..., :2] = points[:, None, :1] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    rings[..., 2] = points[:, 1:]
    return rings


def cylinder(
    radius: float, z0: float, z1: float, segments: int = 24, bevel: float = 0.0, top: float = 1.0
) -> BodyMesh:
    """Return a cylinder about Z; `top` is the ratio of its upper to its lower radius."""
    upper = radius * top
    if bevel > 0:
        return lathe(
            [(radius - bevel, z0), (radius, z0 + bevel), (upper, z1 - bevel), (upper - bevel, z1)],
            segments,
        )
    return lathe([(radius, z0), (upper, z1)], segments)


def disc(radius: float, low: float, high: float, segments: int, bevel: float = 0.0) -> BodyMesh:
    """Return a cylinder that faces -Y, from `low` to `high` metres before the plane y = 0."""
    return cylinder(radius, low, high, segments, bevel).turned("x", 90)


def sphere(radius: float, segments: int = 20, rings: int = 10) -> BodyMesh:
    """Return a sphere about the origin."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, rings + 1)
    profile = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    profile[[0, -1], 0] = 0
    return lathe(profile.tolist(), segments)


def superellipse(
    half_x: float,
    half_y: float,
    z: float,
    power: float = 2.5,
    count: int = 32,
    x: float = 0.0,
    y: float = 0.0,
) -> Float64Array:
    """Return a horizontal ring (count, 3) for `loft`: |x/a|^p + |y/b|^p = 1; p = 2: ellipse."""
    angle = 2 * np.pi * (np.arange(count) + 0.5) / count
    cosine, sine = np.cos(angle), np.sin(angle)
    ring = np.empty((count, 3))
    ring[:, 0] = x + half_x * np.sign(cosine) * np.abs(cosine) ** (2 / power)
    ring[:, 1] = y + half_y * np.sign(sine) * np.abs(sine) ** (2 / power)
    ring[:, 2] = z
    return ring


def arc(
    x: float, z: float, half_x: float, half_z: float, start: float = -90.0, count: int = 9
) -> Float64Array:
    """Return a path (count, 3) along half an ellipse about (x, 0, z), from `start` degrees on."""
    turn = np.linspace(np.radians(start), np.radians(start + 180), count)
    return np.stack([x + half_x * np.cos(turn), 0 * turn, z + half_z * np.sin(turn)], axis=1)


def tube(
    path: Sequence[Sequence[float]] | Float64Array,
    radius: float | Sequence[float] | Float64Array,
    segments: int = 10,
    closed: bool = False,
) -> BodyMesh:
    """Return a tube with round section along `path` (N, 3); `closed` joins its ends."""
    points = np.asarray(path, dtype=float)
    radii = np.broadcast_to(np.asarray(radius, dtype=float), (len(points),))
    if closed:
        tangents = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    else:
        tangents = np.gradient(points, axis=0)
    tangents /= _lengths(tangents)[:, None]
    sides, others = _carried_frames(tangents)
    angle = 2 * np.pi * np.arange(segments) / segments
    ring = np.cos(angle)[:, None] * sides[:, None] + np.sin(angle)[:, None] * others[:, None]
    rings = points[:, None] + radii[:, None, None] * ring
    if not closed:
        return loft(rings)
    # Transported around a planar loop, the frame returns to its start.
    return loft(np.concatenate([rings, rings[:1]]), closed=False)


def _carried_frames(tangents: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Two unit normals (N, 3) of each tangent (N, 3), by parallel transport along the path."""
    first = tangents[0].tolist()
    least = min(range(3), key=lambda axis: abs(first[axis]))
    side = _cross(first, [float(axis == least) for axis in range(3)])
    sides, others = [], []
    for tangent in tangents.tolist():
        along = sum(s * t for s, t in zip(side, tangent, strict=True))
        side = [s - t * along for s, t in zip(side, tangent, strict=True)]
        length = math.hypot(*side)
        side = [s / length for s in side]
        sides.append(side)
        others.append(_cross(tangent, side))
    return np.array(sides), np.array(others)


def _cross(a: list[float], b: list[float]) -> list[float]:
    # For single vectors, twenty times faster than NumPy.
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def bar(
    start: Sequence[float], end: Sequence[float], radius: float, segments: int = 10
) -> BodyMesh:
    """Return a straight bar with round section."""
    first = np.asarray(start, dtype=float)
    along = np.asarray(end, dtype=float) - first
    body = _bar_from_origin(tuple(along.tolist()), float(radius), segments)
    return BodyMesh(body.vertices + first, body.faces.copy(), body.uvs.copy())


@lru_cache(maxsize=256)
def _bar_from_origin(along: tuple[float, ...], radius: float, segments: int) -> BodyMesh:
    # Cached: radiators, chairs and railings have many equal bars.
    return tube([(0.0, 0.0, 0.0), along], radius, segments)


def post(points: Sequence[Sequence[float]], sizes: Sequence[Sequence[float]]) -> BodyMesh:
    """Return a four-sided post through horizontal rectangles; a splayed post has a flat foot.

    `points` (n, 3): centres from the bottom up; `sizes` (n, 2): extents in x and y.
    """
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2
    rings = np.zeros((len(points), 4, 3))
    for ring, point, size in zip(rings, points, sizes, strict=True):
        ring[:, :2] = np.asarray(point[:2]) + corners * np.asarray(size)
        ring[:, 2] = point[2]
    bodies = [grid(rings[:, [k, (k + 1) % 4]].swapaxes(0, 1)) for k in range(4)]
    two = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int64)
    bodies += [BodyMesh(end.copy(), two, end[:, :2].copy()) for end in (rings[0][::-1], rings[-1])]
    return replace(merge(bodies), smooth=len(points) > 2)


def prism(
    outline: Sequence[Sequence[float]] | Float64Array,
    z0: float,
    z1: float,
    holes: Sequence[Sequence[Sequence[float]] | Float64Array] = (),
) -> BodyMesh:
    """Extrude a polygon (N, 2) with holes (M, 2) from z0 to z1; loops of either orientation."""
    loops = [np.asarray(loop, dtype=float) for loop in (outline, *holes)]
    loops = [loop if shapely.LinearRing(loop).is_ccw else loop[::-1] for loop in loops]
    flat = np.concatenate(loops)
    ends = np.cumsum([len(loop) for loop in loops]).astype(np.uint32)
    triangles = mapbox_earcut.triangulate_float64(flat, ends).reshape(-1, 3).astype(np.int64)
    a, b, c = (flat[triangles[:, k]] for k in range(3))
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    triangles[area < 0] = triangles[area < 0][:, ::-1]
    triangles = triangles[np.abs(area) > 1e-10]
    meshes = []
    for z, faces in ((z1, triangles), (z0, triangles[:, ::-1])):
        meshes.append(
            BodyMesh(
                np.column_stack([flat, np.full(len(flat), z)]), faces, flat - flat.mean(axis=0)
            )
        )
    for number, loop in enumerate(loops):
        ring = np.concatenate([loop, loop[:1]])
        points = np.stack([np.column_stack([ring, np.full(len(ring), z)]) for z in (z0, z1)], 1)
        meshes.append(_facets(points if number == 0 else points[::-1]))
    return merge(meshes)


def thick_sheet(points: Float64Array, thickness: float) -> BodyMesh:
    """Return a closed sheet of `thickness` whose front is the grid `points` (n, m, 3)."""
    across, along = np.gradient(points, axis=0), np.gradient(points, axis=1)
    normals = np.cross(across, along)
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-12)
    inner = points - thickness * normals
    front = grid(points)
    back = grid(inner.swapaxes(0, 1), front.uvs.reshape(*points.shape[:2], 2).swapaxes(0, 1))
    rims = [
        grid(np.stack([inner[:, 0], points[:, 0]], axis=1)),
        grid(np.stack([points[:, -1], inner[:, -1]], axis=1)),
        grid(np.stack([points[0], inner[0]], axis=1)),
        grid(np.stack([inner[-1], points[-1]], axis=1)),
    ]
    return merge([front, back, *rims])


def rims(
    upper: Float64Array, lower: Float64Array, faces: Int64Array, uvs: Float64Array
) -> BodyMesh:
    """Return the faces that join the open edges of a mesh (`upper`, `faces`) to those of a copy.

    `upper` and `lower` (V, 3) are the same vertices of both; the copy's faces are reversed.
    """
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    count = len(upper)
    open_ones = ~np.isin(edges @ [count, 1], edges @ [1, count])
    a, b = edges[open_ones].T
    used, numbers = np.unique(np.concatenate([a, b]), return_inverse=True)
    a, b = numbers[: len(a)], numbers[len(a) :]
    below = len(used)
    joined = np.concatenate(
        [np.stack([b, a, a + below], 1), np.stack([b, a + below, b + below], 1)]
    )
    across = np.linalg.norm(upper[used] - lower[used], axis=1)
    aside = uvs[used] + np.stack([across, across], axis=1)
    return BodyMesh(
        np.concatenate([upper[used], lower[used]]), joined, np.concatenate([uvs[used], aside])
    )


def _facets(points: Float64Array) -> BodyMesh:
    """`grid` with separate vertices for each strip along i: corners between strips stay sharp."""
    strips = []
    start = 0.0
    for k in range(len(points) - 1):
        strip = grid(points[k : k + 2])
        strips.append(BodyMesh(strip.vertices, strip.faces, strip.uvs + np.array([0, start])))
        start += float(strip.uvs[:, 1].max())
    return merge(strips)


def _nondegenerate(points: Float64Array) -> BoolArray:
    """Mask (F,) of the triangles of `_grid_faces` that are not degenerate."""
    # Written out by coordinate: np.cross would dominate the cost of small grids.
    n, m = points.shape[:2]
    edges = np.empty((3, 3, n - 1, m - 1))  # of (x, y, z), from a to b, c and d
    planes = points.transpose(2, 0, 1)
    a = planes[:, :-1, :-1]
    np.subtract(planes[:, 1:, :-1], a, out=edges[:, 0])
    np.subtract(planes[:, 1:, 1:], a, out=edges[:, 1])
    np.subtract(planes[:, :-1, 1:], a, out=edges[:, 2])
    (x0, y0, z0), (x1, y1, z1) = edges[:, :2], edges[:, 1:]
    nx, ny, nz = y0 * z1 - z0 * y1, z0 * x1 - x0 * z1, x0 * y1 - y0 * x1
    return np.asarray(nx * nx + ny * ny + nz * nz > (2 * _MIN_AREA) ** 2).reshape(-1)


def _lengths(vectors: Float64Array) -> Float64Array:
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    return np.asarray(np.sqrt(x * x + y * y + z * z))
