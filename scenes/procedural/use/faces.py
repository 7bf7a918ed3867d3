"""Faces that show use: their places in (s, t), and the parts that carry their images.

Surfaces that show use get materials of their own (`Material.use`). Nothing is added to the
geometry: faces are dealt out to other parts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from pbrnet.scenes.arrays import BoolArray, Float64Array, Int64Array
from pbrnet.scenes.procedural.piece import Material, PiecePart, Trace, Use
from pbrnet.scenes.procedural.scene_item import SceneItem
from pbrnet.scenes.seeds import Draw

_GRID = 4  # decimals of metres: the last bits of coordinates depend on the processor
_ASIDE = 1.3e-6  # metres; keeps multiples of half a step of that grid off its borders

Point = tuple[float, float]


@dataclass(frozen=True)
class Face:
    """Parallel faces of a part that one set of images covers.

    (s, t) = `axes` @ point + `start`; `panels` as in `Use`.
    """

    axes: Float64Array  # (2, 3)
    start: Float64Array  # (2,)
    faces: Int64Array
    st: Float64Array  # (V, 2) of all vertices of the part; of others than the faces' unused
    low: Point
    high: Point
    panels: tuple[tuple[float, float, float, float, float, float], ...]

    def at(self, point: Float64Array) -> Point:
        """(s, t) of a point in the world."""
        place = (self.axes * point).sum(axis=1) + self.start
        return rounded(place)

    @property
    def size(self) -> Point:
        """Metres along s and t."""
        return self.high[0] - self.low[0], self.high[1] - self.low[1]

    def inside(self, s: float, t: float) -> Point:
        """(s, t) of a place in shares of the extent."""
        return rounded(np.array(self.low) + np.array([s, t]) * self.size)


def whole(item: SceneItem, traces: Callable[[Face, Draw], list[Trace]], rng: Draw) -> SceneItem:
    """Give the whole first part of an item a material with traces on its upper face."""
    part = item.parts[0]
    face = face_of(part, np.array([0.0, 0.0, 1.0]))
    if face is None or not isinstance(part.material, Material):
        return item
    made = replace(part, material=with_traces(part.material, face, traces, rng), uvs=face.st)
    return replace(item, parts=(made, *item.parts[1:]))


def split(
    item: SceneItem,
    name: str,
    towards: Float64Array,
    traces: Callable[[Face, Draw], list[Trace]],
    rng: Draw,
) -> SceneItem:
    """Deal the faces of a part that look in a direction out to a part with traces of use."""
    parts = list(item.parts)
    for number, part in enumerate(parts):
        if (name and part.name != name) or not isinstance(part.material, Material):
            continue
        face = face_of(part, towards)
        if face is None or part.lumens > 0:
            return item
        rest = np.ones(len(part.faces), dtype=bool)
        rest[face.faces] = False
        material = with_traces(part.material, face, traces, rng)
        normals = part.normals if part.smooth else None
        upper = of_faces(replace(part, uvs=face.st, given_normals=normals), ~rest)
        parts[number] = replace(upper, name=f"{part.name}used", material=material)
        if rest.any():
            parts.append(of_faces(part, rest))
        return replace(item, parts=tuple(parts))
    return item


def with_traces(
    material: Material, face: Face, traces: Callable[[Face, Draw], list[Trace]], rng: Draw
) -> Material:
    """Return a material with the traces on a face."""
    left = tuple(traces(face, rng))
    return replace(material, use=Use(face.low, face.high, face.panels, left, rng.variant()))


def of_faces(part: PiecePart, keep: BoolArray) -> PiecePart:
    """The part with some of its faces, and the vertices that they need."""
    needed, faces = np.unique(part.faces[keep], return_inverse=True)
    normals = None if part.given_normals is None else part.given_normals[needed]
    return replace(
        part,
        vertices=part.vertices[needed],
        faces=faces.reshape(-1, 3),
        uvs=part.uvs[needed],
        given_normals=normals,
    )


def face_of(part: PiecePart, towards: Float64Array) -> Face | None:
    """The largest face of a part in a direction, with those that are parallel in pattern, too."""
    corners = part.vertices[part.faces]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.sqrt((facing * facing).sum(axis=1))
    ahead = (facing * towards).sum(axis=1) > 0.75 * area
    count = len(part.vertices)
    ends = (part.faces[:, [0, 1]].T, part.faces[:, [1, 2]].T)
    pairs = np.concatenate(ends, axis=1)
    links = coo_array((np.ones(pairs.shape[1], dtype=bool), pairs), shape=(count, count))
    number, labels = connected_components(links, directed=False)
    of_face = labels[part.faces[:, 0]]
    sizes = np.bincount(of_face, area, number)
    astray = np.bincount(of_face, np.where(ahead, 0.0, area), number)
    islands = np.flatnonzero((sizes > 1e-3) & (astray < 0.2 * sizes))
    islands = islands[np.argsort(-np.round(sizes[islands], 6), kind="stable")]
    chosen: list[int] = []
    panels = []
    axes = start = None
    st = part.uvs.copy()
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for island in islands.tolist():
        own = np.flatnonzero(labels == island)
        fitted = _fitted(part.vertices[own], part.uvs[own], towards)
        if fitted is None:
            continue
        linear, constant, sign = fitted
        if axes is None or start is None:
            axes, start = linear, constant
        elif np.abs(linear - axes).max() > 0.02:
            continue
        shift = on_grid(constant - start)
        st[own] = part.uvs[own] * [sign, 1.0] - shift
        a, b = on_grid(st[own].min(axis=0)), on_grid(st[own].max(axis=0))
        low, high = np.minimum(low, a), np.maximum(high, b)
        panels.append((*a.tolist(), *b.tolist(), *shift.tolist()))
        chosen.append(island)
    if axes is None or start is None or (high - low).min() < 0.05:
        return None
    faces = np.flatnonzero(np.isin(of_face, chosen))
    return Face(axes, start, faces, st, rounded(low), rounded(high), tuple(panels[::-1]))


def _fitted(
    points: Float64Array, uvs: Float64Array, towards: Float64Array
) -> tuple[Float64Array, Float64Array, float] | None:
    """Affine map from points to right-handed uvs: (2, 3), (2,), and the sign that u got."""
    middle, centre = points.mean(axis=0), uvs.mean(axis=0)
    linear = np.linalg.lstsq(points - middle, uvs - centre, rcond=1e-6)[0].T
    if np.abs((points - middle) @ linear.T + centre - uvs).max() > 0.03:
        return None
    sign = 1.0 if (np.cross(linear[0], linear[1]) * towards).sum() > 0 else -1.0
    linear = linear * [[sign], [1.0]]
    constant = centre * [sign, 1.0] - (linear * middle).sum(axis=1)
    return linear, constant, sign


def rounded(point: Float64Array) -> Point:
    """Return a point (2,) of a face on the grid."""
    s, t = on_grid(point).tolist()
    return s, t


def on_grid(values: Float64Array) -> Float64Array:
    """Return coordinates in metres, rounded to the grid."""
    return np.asarray(np.round(values + _ASIDE, _GRID))
