"""Where a hole in a wall is narrowest: cuts parallel to the wall, at several depths.

Light that gets through a hole passes every cut across it. Where the air in a cut is closed in on
all sides, a portal as large as that air stops all of it, whatever lies before or behind: deep
niches, leaves of doors that stand ajar, splayed reveals. World: metres, Z up.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import shapely
from shapely.geometry import Polygon, box

from scenes.arrays import BoolArray, Float64Array
from scenes.geometry.mesh import face_areas
from scenes.reconstruction.rooms import FoundOpening, slice_segments

DEPTHS = np.arange(-0.03, 0.95, 0.04)  # metres outwards from a wall's face
_GAP = 0.02  # half of the widest gap in what closes a hole in
_OVERLAP = 0.03  # metres by which a portal reaches into what closes its hole in
_AROUND = 1.0  # metres around the seeds that a hole may reach
_EQUAL = 1.1  # holes up to this many times as large as the least are as good
_FULL = 0.8  # of its rectangle: then the rectangle is taken
_GRID = 0.01  # metres to which the ends of a cut's segments are rounded
_FLAT = 2e-3  # metres within which triangles lie in a cut, not across it
_SHEET = 0.05  # square metres, the least of a sheet that a hole may be in
_SHEETS = 6  # at most, the largest
_LARGEST = 200_000  # segments of a cut; more are noise of vegetation, not a wall


@dataclass(frozen=True)
class Frame:
    """A plane with axes `u` and `v` (unit, 3), right-handed with `normal`, through `origin`."""

    origin: Float64Array
    u: Float64Array
    v: Float64Array

    @property
    def normal(self) -> Float64Array:
        """Unit, on the side that larger depths lie."""
        return np.cross(self.u, self.v)

    def local(self, points: Float64Array) -> Float64Array:
        """World points (..., 3) as u, v and depth."""
        return (points - self.origin) @ np.stack([self.u, self.v, self.normal], axis=1)

    def world(self, plane: Float64Array, depth: float) -> Float64Array:
        """Points (N, 2) of the cut at `depth` in the world, (N, 3)."""
        return self.origin + plane @ np.stack([self.u, self.v]) + depth * self.normal


@dataclass
class Cuts:
    """Cuts through triangles `corners` (F, 3, 3)."""

    corners: Float64Array
    _low: Float64Array = field(init=False)
    _high: Float64Array = field(init=False)

    def __post_init__(self) -> None:
        self._low, self._high = _extremes(self.corners)

    def near(self, frame: Frame, low: Float64Array, high: Float64Array) -> Float64Array:
        """The triangles near the box from `low` to `high` (3,) of the frame, in its axes."""
        edges = np.stack([low, high])
        points = np.array([[edges[i, 0], edges[j, 1], edges[k, 2]]
                           for i in (0, 1) for j in (0, 1) for k in (0, 1)])  # fmt: skip
        world = frame.world(points[:, :2], 0.0) + points[:, 2:] * frame.normal
        meets = _meeting(self._low, self._high, world.min(axis=0), world.max(axis=0))
        local = frame.local(self.corners[meets])
        return local[_meeting(*_extremes(local), low, high)]


def _meeting(
    lowest: Float64Array, highest: Float64Array, low: Float64Array, high: Float64Array
) -> BoolArray:
    """Which of the boxes from `lowest` to `highest` (F, 3) meet the box from `low` to `high`."""
    meets = np.ones(len(lowest), dtype=bool)
    for axis in range(3):  # not `all(axis=1)`: that takes ten times as long on rows of three
        meets &= (lowest[:, axis] <= high[axis]) & (highest[:, axis] >= low[axis])
    return meets


def _extremes(corners: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Lowest and highest coordinates (F, 3) of triangles (F, 3, 3)."""
    first, second, third = corners[:, 0], corners[:, 1], corners[:, 2]
    low = np.minimum(np.minimum(first, second), third)
    return low, np.maximum(np.maximum(first, second), third)


def air(
    local: Float64Array, depth: float, seeds: Float64Array, around: float = _AROUND
) -> list[Polygon]:
    """The closed-in parts of the air in a cut that hold any of `seeds` (K, 2).

    `local` are triangles in the frame's axes. Air that reaches `around` metres past the seeds
    is not closed in, and left out.
    """
    if not len(seeds):
        return []
    low, high = seeds.min(axis=0) - around, seeds.max(axis=0) + around
    lines = slice_segments(local, depth)
    meets = (lines.min(axis=1) <= high) & (lines.max(axis=1) >= low)
    lines = _coarse(lines[meets.all(axis=1)])
    lowest, highest = _extremes(local)
    sheet = local[(lowest[:, 2] > depth - _FLAT) & (highest[:, 2] < depth + _FLAT)][..., :2]
    if not len(lines) + len(sheet) or len(lines) + len(sheet) > _LARGEST:
        return []
    window = box(*low, *high)
    solid = [*shapely.linestrings(lines), *shapely.polygons(sheet)]
    walls = shapely.union_all(shapely.buffer(solid, _GAP, cap_style="square"))
    rim = window.exterior
    return [
        part
        for part in shapely.get_parts(window.difference(walls)).tolist()
        if not part.intersects(rim) and shapely.contains_xy(part, seeds[:, 0], seeds[:, 1]).any()
    ]


def outline_of(parts: list[Polygon]) -> Float64Array:
    """A counter-clockwise outline (N, 2) around holes and the bars between them, reaching into
    what closes them in."""
    whole = shapely.union_all(parts).buffer(_GAP + _OVERLAP, join_style="mitre")
    low, high = np.array(whole.bounds).reshape(2, 2)
    if whole.area < _FULL * float(np.prod(high - low)):
        whole = whole.buffer(0.1, join_style="mitre").buffer(-0.1, join_style="mitre")
    if not isinstance(whole, Polygon) or whole.area >= _FULL * float(np.prod(high - low)):
        return np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    ring = Polygon(whole.exterior).simplify(0.5 * _OVERLAP)
    return np.array(shapely.geometry.polygon.orient(ring).exterior.coords)[:-1]


def seated(cuts: Cuts, opening: FoundOpening) -> FoundOpening:
    """The opening in the cut where its hole is narrowest, at its pane's depth if there is one;
    as it is where no cut closes it in."""
    frame = frame_of(opening)
    rest = frame.local(opening.polygon)
    seeds = frame.local(opening.seeds)[:, :2] if len(opening.seeds) else rest[:, :2]
    pane = opening.panes != []
    low = np.append(seeds.min(axis=0) - _AROUND, DEPTHS.min())
    high = np.append(seeds.max(axis=0) + _AROUND, DEPTHS.max())
    local = cuts.near(frame, low, high)
    found = {}
    for depth in sorted({*DEPTHS.tolist(), *([0.0] if pane else []), *_sheets(local)}):
        parts = air(local, depth, seeds)
        if parts:
            found[depth] = parts
    if not found:
        return opening
    least = min(sum(part.area for part in parts) for parts in found.values())
    good = {
        depth: parts
        for depth, parts in found.items()
        if sum(part.area for part in parts) <= _EQUAL * least
    }
    depth = 0.0 if pane and 0.0 in good else min(good, key=abs)
    return replace(opening, polygon=frame.world(outline_of(good[depth]), depth))


def _coarse(lines: Float64Array) -> Float64Array:
    """Segments (N, 2, 2) with ends on a grid, each once: leaves of plants in a cut are thousands
    of segments that one line of the grid's width shows as well."""
    ends = np.round(lines / _GRID).astype(np.int64)
    ends = ends[(ends[:, 0] != ends[:, 1]).any(axis=1)]
    turn = (ends[:, 0, 0] > ends[:, 1, 0]) | (
        (ends[:, 0, 0] == ends[:, 1, 0]) & (ends[:, 0, 1] > ends[:, 1, 1])
    )
    ends[turn] = ends[turn][:, ::-1]
    kept: Float64Array = np.unique(ends.reshape(-1, 4), axis=0).reshape(-1, 2, 2) * _GRID
    return kept


def _sheets(local: Float64Array) -> list[float]:
    """Depths of the largest surfaces parallel to a cut: a hole in one has no depth itself."""
    areas, _ = face_areas(local)
    lowest, highest = _extremes(local)
    parallel = highest[:, 2] - lowest[:, 2] < _FLAT
    steps = np.round(lowest[parallel, 2] / _FLAT).astype(np.int64)
    levels, index = np.unique(steps, return_inverse=True)
    total = np.bincount(index.reshape(-1), weights=areas[parallel], minlength=len(levels))
    largest = np.argsort(-total, kind="stable")[:_SHEETS]
    depths = (levels * _FLAT)[largest[total[largest] > _SHEET]]
    return [float(depth) for depth in depths if DEPTHS[0] <= depth <= DEPTHS[-1]]


def frame_of(opening: FoundOpening) -> Frame:
    """The plane of an opening: `u` level, `v` up a wall."""
    normal = opening.normal / np.linalg.norm(opening.normal)
    level = abs(normal[2]) > 0.9
    u = np.array([1.0, 0.0, 0.0]) if level else np.cross([0.0, 0.0, 1.0], normal)
    u = u / np.linalg.norm(u)
    return Frame(opening.polygon[0], u, np.cross(normal, u))
