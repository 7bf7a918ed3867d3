"""The narrowest cross-section of an opening in a wall.

Input: an opening found roughly and the triangles around it. Output: the same opening moved to
the depth where the hole is smallest, with the outline that the hole has there.

Light that passes a hole passes every section across it. Where surfaces enclose the air of a
section on all sides, a portal of that outline catches all the light, whatever lies before or
behind it: deep niches, doors ajar, splayed reveals. So parallel sections are taken every few
centimetres, and the one with the least enclosed air wins. World: metres, Z up.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import shapely
from shapely.geometry import Polygon, box

from pbrnet.scenes.arrays import BoolArray, Float64Array
from pbrnet.scenes.geometry.directions import cross
from pbrnet.scenes.geometry.mesh import face_areas
from pbrnet.scenes.geometry.regions import (
    buffered,
    difference,
    meets,
    polygon_parts,
    simplified,
    thickened,
    union,
)
from pbrnet.scenes.geometry.section_raster import cut_off_regions
from pbrnet.scenes.reconstruction.rooms import FoundOpening, slice_segments

DEPTHS = np.arange(-0.03, 0.95, 0.04)  # of the sections, metres outwards from a wall's face
_MOST_SEEDS = 4096  # of an opening that are looked up in its sections
LEAST_SEEDS = 3  # that a region holds to be estimated
_HALF_GAP = 0.02  # half of the widest gap in the surfaces that enclose a hole, metres
_OVERLAP = 0.03  # metres by which a portal reaches into what encloses its hole
_MARGIN = 1.0  # metres around the seed points that a hole may reach
_NEARLY_LEAST = 1.1  # times the least area: sections up to this count as equally good
_MIN_FILL = 0.8  # share of its bounding rectangle from which that rectangle is the outline
_GRID = 0.01  # metres to which the ends of a section's segments are rounded
_BLOCK = 128  # triangles with a common box
_ROUNDING = 1e-6  # metres
_FLAT = 2e-3  # metres; a triangle within this depth range is parallel to the section
_MIN_SHEET = 0.05  # square metres of parallel triangles at one depth
_MAX_SHEETS = 6
_MAX_SEGMENTS = 200_000  # of a section; more come from vegetation, not from a wall


@dataclass(frozen=True)
class PlaneFrame:
    """A plane through `origin` with unit axes `u` and `v` (3,), right-handed with `normal`."""

    origin: Float64Array
    u: Float64Array
    v: Float64Array

    @cached_property
    def normal(self) -> Float64Array:
        """Unit normal (3,), in the direction of growing depth."""
        return cross(self.u, self.v)

    @cached_property
    def _axes(self) -> Float64Array:
        return np.stack([self.u, self.v, self.normal], axis=1)

    def to_local(self, points: Float64Array) -> Float64Array:
        """World points (..., 3) as u, v and depth."""
        local: Float64Array = (points - self.origin) @ self._axes
        return local

    def to_world(self, plane: Float64Array, depth: float) -> Float64Array:
        """Points (N, 2) of the section at `depth` as world points (N, 3)."""
        return self.origin + plane @ np.stack([self.u, self.v]) + depth * self.normal


@dataclass
class CrossSections:
    """Triangles `corners` (F, 3, 3) with their bounding boxes, to take sections from.

    Neighbours in a file mostly lie close together, so blocks of them have boxes, too.
    """

    corners: Float64Array
    _low: Float64Array = field(init=False)
    _high: Float64Array = field(init=False)
    _block_low: Float64Array = field(init=False)
    _block_high: Float64Array = field(init=False)

    def __post_init__(self) -> None:
        self._low, self._high = _bounds(self.corners)
        starts = np.arange(0, len(self.corners), _BLOCK)
        self._block_low = np.minimum.reduceat(self._low, starts, axis=0)
        self._block_high = np.maximum.reduceat(self._high, starts, axis=0)

    def near(self, frame: PlaneFrame, low: Float64Array, high: Float64Array) -> Float64Array:
        """Triangles that meet the box from `low` to `high` (3,) of a frame, in its axes."""
        edges = np.stack([low, high])
        points = np.array([[edges[i, 0], edges[j, 1], edges[k, 2]]
                           for i in (0, 1) for j in (0, 1) for k in (0, 1)])  # fmt: skip
        world = frame.to_world(points[:, :2], 0.0) + points[:, 2:] * frame.normal
        lowest, highest = world.min(axis=0), world.max(axis=0)
        blocks = np.nonzero(_boxes_meet(self._block_low, self._block_high, lowest, highest))[0]
        rows = (_BLOCK * blocks[:, None] + np.arange(_BLOCK)).reshape(-1)
        rows = rows[rows < len(self.corners)]
        rows = rows[_boxes_meet(self._low[rows], self._high[rows], lowest, highest)]
        local = frame.to_local(self.corners[rows])
        return local[_boxes_meet(*_bounds(local), low, high)]


def _boxes_meet(
    lowest: Float64Array, highest: Float64Array, low: Float64Array, high: Float64Array
) -> BoolArray:
    """Return which boxes from `lowest` to `highest` (F, 3) meet the box from `low` to `high`."""
    touching = np.ones(len(lowest), dtype=bool)
    for axis in range(3):  # `all(axis=1)` takes ten times as long on rows of three
        touching &= (lowest[:, axis] <= high[axis]) & (highest[:, axis] >= low[axis])
    return touching


def _bounds(corners: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Lowest and highest coordinates (F, 3) of triangles (F, 3, 3)."""
    first, second, third = corners[:, 0], corners[:, 1], corners[:, 2]
    low = np.minimum(np.minimum(first, second), third)
    return low, np.maximum(np.maximum(first, second), third)


def enclosed_air(
    local: Float64Array,
    depth: float,
    seeds: Float64Array,
    wanted: Callable[[list[Float64Array]], bool] | None = None,
) -> list[Polygon]:
    """Regions of air in a section that surfaces enclose and that hold any of `seeds` (K, 2).

    `local` are triangles in the frame's axes. A region that reaches `_MARGIN` metres past the
    seeds is not enclosed and left out. `wanted` tells from a quick estimate of the regions, points
    (M, 2) of each that may hold `LEAST_SEEDS` seeds, whether to compute them; if not, there are
    none.
    """
    if not len(seeds):
        return []
    low, high = seeds.min(axis=0) - _MARGIN, seeds.max(axis=0) + _MARGIN
    lines = slice_segments(local, depth)
    start, end = lines[:, 0], lines[:, 1]
    inside = (np.minimum(start, end) <= high) & (np.maximum(start, end) >= low)
    lines = merged_segments(lines[inside[:, 0] & inside[:, 1]])
    lowest, highest = _bounds(local)
    sheet = local[(lowest[:, 2] > depth - _FLAT) & (highest[:, 2] < depth + _FLAT)][..., :2]
    if not len(lines) + len(sheet) or len(lines) + len(sheet) > _MAX_SEGMENTS:
        return []
    if wanted is not None and not wanted(_estimated_air(lines, sheet, seeds)):
        return []
    window = box(*low, *high)
    solid = [*shapely.linestrings(lines), *shapely.polygons(sheet)]
    walls = thickened(solid, _HALF_GAP, cap_style="square")
    return _holding_seeds(polygon_parts(difference(window, walls)), seeds, window)


def _holding_seeds(parts: list[Polygon], seeds: Float64Array, window: Polygon) -> list[Polygon]:
    """Those of `parts` that hold any of `seeds` (K, 2) and do not meet the border of a window."""
    west, south, east, north = window.bounds
    by_x = seeds[np.argsort(seeds[:, 0], kind="stable")]
    bounds = shapely.bounds(parts)
    first = np.searchsorted(by_x[:, 0], bounds[:, 0], "left").tolist()
    last = np.searchsorted(by_x[:, 0], bounds[:, 2], "right").tolist()
    kept = []
    for part, start, end, (left, low, right, high) in zip(
        parts, first, last, bounds.tolist(), strict=True
    ):
        if start == end:
            continue
        near = by_x[start:end]
        near = near[(near[:, 1] >= low) & (near[:, 1] <= high)]
        if not len(near) or not shapely.contains_xy(part, near[:, 0], near[:, 1]).any():
            continue
        is_clear = (
            left > west + _ROUNDING and low > south + _ROUNDING
            and right < east - _ROUNDING and high < north - _ROUNDING
        )  # fmt: skip
        if is_clear or not meets(part, window.exterior):
            kept.append(part)
    return kept


def _estimated_air(
    lines: Float64Array, sheet: Float64Array, seeds: Float64Array
) -> list[Float64Array]:
    """Points (M, 2) of each region that segments and parallel triangles may enclose.

    One seed of `LEAST_SEEDS` may lie in a tail too narrow for the estimate.
    """
    edges = np.stack([sheet, np.roll(sheet, -1, axis=1)], axis=2).reshape(-1, 2, 2)
    walls = np.concatenate([lines, edges])
    return cut_off_regions(walls, seeds, _HALF_GAP, _MARGIN, LEAST_SEEDS - 1)


def portal_outline(parts: list[Polygon]) -> Float64Array:
    """One counter-clockwise outline (N, 2) around regions of air and the bars between them.

    It reaches into the surfaces that enclose the regions.
    """
    whole = buffered(union(parts), _HALF_GAP + _OVERLAP, join_style="mitre")
    low, high = np.array(whole.bounds).reshape(2, 2)
    if whole.area < _MIN_FILL * float(np.prod(high - low)):
        whole = buffered(buffered(whole, 0.1, join_style="mitre"), -0.1, join_style="mitre")
    if not isinstance(whole, Polygon) or whole.area >= _MIN_FILL * float(np.prod(high - low)):
        return np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    ring = simplified(Polygon(whole.exterior), 0.5 * _OVERLAP)
    return np.array(shapely.geometry.polygon.orient(ring).exterior.coords)[:-1]


def at_narrowest_section(sections: CrossSections, opening: FoundOpening) -> FoundOpening:
    """Move an opening to the section where its hole is narrowest.

    It stays in the plane of its window pane if the hole is nearly as narrow there, and unchanged
    where no section is enclosed.
    """
    frame = opening_frame(opening)
    outline = frame.to_local(opening.polygon)
    seeds = frame.to_local(opening.seeds)[:, :2] if len(opening.seeds) else outline[:, :2]
    if len(seeds) > _MOST_SEEDS:  # tenths of a metre apart in an opening as large as a wall
        corners = [*seeds.argmin(axis=0).tolist(), *seeds.argmax(axis=0).tolist()]
        chosen = np.linspace(0, len(seeds) - 1, _MOST_SEEDS).astype(int)
        seeds = seeds[np.unique([*corners, *chosen.tolist()])]
    has_pane = opening.panes != []
    low = np.append(seeds.min(axis=0) - _MARGIN, DEPTHS.min())
    high = np.append(seeds.max(axis=0) + _MARGIN, DEPTHS.max())
    local = sections.near(frame, low, high)
    found = {}
    for depth in sorted({*DEPTHS.tolist(), *([0.0] if has_pane else []), *_sheet_depths(local)}):
        parts = enclosed_air(local, depth, seeds)
        if parts:
            found[depth] = parts
    if not found:
        return opening
    least = min(sum(part.area for part in parts) for parts in found.values())
    good = {
        depth: parts
        for depth, parts in found.items()
        if sum(part.area for part in parts) <= _NEARLY_LEAST * least
    }
    depth = 0.0 if has_pane and 0.0 in good else min(good, key=abs)
    return replace(opening, polygon=frame.to_world(portal_outline(good[depth]), depth))


def merged_segments(lines: Float64Array) -> Float64Array:
    """Segments (N, 2, 2) with their ends on a grid; those that meet on one line become one.

    The leaves of a plant give thousands of segments that a few of the grid's width represent, and
    a flat wall gives one for each of its triangles.
    """
    ends = np.round(lines / _GRID).astype(np.int64)
    ends = ends[(ends[:, 0] != ends[:, 1]).any(axis=1)]
    if not len(ends):
        return np.empty((0, 2, 2))
    way = ends[:, 1] - ends[:, 0]
    is_backward = (way[:, 0] < 0) | ((way[:, 0] == 0) & (way[:, 1] < 0))
    ends[is_backward] = ends[is_backward][:, ::-1]
    way[is_backward] *= -1
    # A line is known by its direction in lowest terms, and by its distance from the origin.
    way //= np.gcd(way[:, 0], way[:, 1])[:, None]
    line = np.column_stack([way, ends[:, 0, 0] * way[:, 1] - ends[:, 0, 1] * way[:, 0]])
    # Two points of a line are whole steps apart.
    start, end = np.where(way[:, :1] > 0, ends[..., 0], ends[..., 1]).T
    order = np.lexsort((start, *line.T))
    ends, line, start, end = ends[order], line[order], start[order], end[order]
    new_line = np.append(True, (line[1:] != line[:-1]).any(axis=1))
    shift = (np.cumsum(new_line) - 1) * (end.max() - start.min() + 2)  # sets lines apart
    reached = np.maximum.accumulate(end + shift)
    first = np.nonzero(np.append(True, (start + shift)[1:] > reached[:-1]))[0]
    steps = reached[np.append(first[1:], len(reached)) - 1] - (start + shift)[first]
    steps //= np.where(line[first, 0] > 0, line[first, 0], line[first, 1])
    merged = np.stack([ends[first, 0], ends[first, 0] + steps[:, None] * line[first, :2]], axis=1)
    return merged.astype(np.float64) * _GRID


def _sheet_depths(local: Float64Array) -> list[float]:
    """Depths of the largest surfaces parallel to the sections.

    A hole in such a surface has no depth itself and can fall between two regular sections.
    """
    areas, _ = face_areas(local)
    lowest, highest = _bounds(local)
    parallel = highest[:, 2] - lowest[:, 2] < _FLAT
    steps = np.round(lowest[parallel, 2] / _FLAT).astype(np.int64)
    levels, index = np.unique(steps, return_inverse=True)
    total = np.bincount(index.reshape(-1), weights=areas[parallel], minlength=len(levels))
    largest = np.argsort(-total, kind="stable")[:_MAX_SHEETS]
    depths = (levels * _FLAT)[largest[total[largest] > _MIN_SHEET]]
    return [float(depth) for depth in depths if DEPTHS[0] <= depth <= DEPTHS[-1]]


def opening_frame(opening: FoundOpening) -> PlaneFrame:
    """The plane of an opening; `u` is level, `v` points up in a wall."""
    normal = opening.normal / np.linalg.norm(opening.normal)
    is_level = abs(normal[2]) > 0.9
    u = np.array([1.0, 0.0, 0.0]) if is_level else np.cross([0.0, 0.0, 1.0], normal)
    u = u / np.linalg.norm(u)
    return PlaneFrame(opening.polygon[0], u, np.cross(normal, u))
