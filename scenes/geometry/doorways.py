"""Doorways in the plan of free air: gaps of a door's width between two ends of walls.

A door usually has a lintel, so that a section just below the ceiling shows a whole wall. Where the
gap reaches up to the ceiling, two rooms are one region of that section. A person still sees two
rooms if the gap is as wide as a door and wall runs on both sides of it, or if a wall ends a door's
width before another one. Lengths are in metres.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from scipy.spatial import KDTree
from shapely.geometry import Polygon

from pbrnet.scenes.arrays import BoolArray, Float64Array, Int64Array
from pbrnet.scenes.geometry.regions import (
    buffered,
    difference,
    intersection,
    polygon_parts,
    simplified,
    union,
)

_NARROWEST, _WIDEST = 0.5, 1.25  # of a gap
_THICKEST = 0.5  # of a wall beside it
_BESIDE = (0.05, 0.1, 0.2, 0.3)  # from the gap's edge, where wall is looked for
_LEAST_WALL = 0.3  # on both sides together; there is some on each
_STEP = 0.02  # along the lines that look for it
_AIR = 0.2  # in front of the wall and behind it
_OFF = 0.06  # by which the wall may begin off the gap's edge
_LEAST_ROOM = 2.0  # square metres; a smaller part is a niche
_LEAST_BEHIND = 5.0  # the same, behind a wall that ends before another one
_ALONE = 1.0  # least length of such a wall
_MOST_CORNERS = 5_000
_MOST_GAPS = 20_000


def parts_at_doorways(free: Polygon) -> list[Polygon]:
    """The region, parted at gaps of a door's width; what lies in such a gap is left out."""
    between = _thresholds(free)
    found = [(each, _LEAST_ROOM) for each in between]
    found += [(each, _LEAST_BEHIND) for each in _thresholds_at_ends(free)
              if not any(each.intersects(other) for other in between)]  # fmt: skip
    while found:
        parts = polygon_parts(difference(free, union([each for each, _ in found])))
        kept = [each for each in found if _separates(*each, parts)]
        if len(kept) == len(found):
            return parts
        found = kept
    return [free]


def _separates(threshold: Polygon, least: float, parts: list[Polygon]) -> bool:
    """Return whether a threshold lies between two parts of a `least` area, and nothing else."""
    near = [part for part in parts if part.distance(threshold) < _STEP]
    return len(near) == 2 and all(part.area >= least for part in near)


def _thresholds_at_ends(free: Polygon) -> list[Polygon]:
    """The plans of gaps between the end of a wall and another wall that it would meet."""
    found: list[Polygon] = []
    oriented = shapely.geometry.polygon.orient(free)
    shapely.prepare(free)
    for ring in (oriented.exterior, *oriented.interiors):
        points = shapely.get_coordinates(simplified(ring, 0.5 * _STEP))[:-1]
        if len(points) > _MOST_CORNERS:
            continue
        before, after = points - np.roll(points, 1, axis=0), points - np.roll(points, -1, axis=0)
        is_end = -before[:, 0] * after[:, 1] < -before[:, 1] * after[:, 0]
        for place, face in [*zip(points[is_end], before[is_end], strict=True),
                            *zip(points[is_end], after[is_end], strict=True)]:  # fmt: skip
            length = float(np.linalg.norm(face))
            if length < _ALONE:
                continue
            threshold = _threshold_at_end(free, place, face / length)
            if threshold is not None and not any(each.intersects(threshold) for each in found):
                found.append(threshold)
    return found


def _threshold_at_end(free: Polygon, place: Float64Array, along: Float64Array) -> Polygon | None:
    """The plan of the gap that begins at the end of a wall, `place` (2,), and runs `along` it."""
    line = shapely.LineString([place + 0.02 * along, place + (_WIDEST + 0.02) * along])
    way = shapely.get_parts(intersection(line, free))
    ends = shapely.get_coordinates(way[:1])
    if not len(ends):
        return None
    gap = float(np.linalg.norm(ends - place, axis=1).max())
    if not _NARROWEST <= gap <= _WIDEST:
        return None
    faces, extent = _wall_beside(free, place[None], -along[None], (*_BESIDE, 0.6, 0.9))
    if extent[0] < 0.9:
        return None
    across = np.array([along[1], -along[0]])
    low, high = faces[0]
    ring = [place + low * across, place + high * across,
            place + (gap + 0.1) * along + high * across,
            place + (gap + 0.1) * along + low * across]  # fmt: skip
    made = buffered(Polygon(ring), 0.5 * _STEP, join_style="mitre")
    return made if isinstance(made, Polygon) else None


def _thresholds(free: Polygon) -> list[Polygon]:
    """The plans of gaps between two ends of walls, from one face of the wall to the other."""
    corners = _corners_of_walls(free)
    if not 2 <= len(corners) <= _MOST_CORNERS:
        return []
    pairs = KDTree(corners).query_pairs(_WIDEST, output_type="ndarray")
    first, second = corners[pairs[:, 0]], corners[pairs[:, 1]]
    length = np.linalg.norm(second - first, axis=1)
    order = np.lexsort((pairs[:, 1], pairs[:, 0], length))
    order = order[length[order] >= _NARROWEST]
    first, second, length = first[order], second[order], length[order]
    along = (second - first) / length[:, None]
    inside = shapely.linestrings(np.stack([first + 0.02 * along, second - 0.02 * along], axis=1))
    shapely.prepare(free)
    is_free = shapely.contains(free, inside)
    first, second, along = first[is_free], second[is_free], along[is_free]
    if not 0 < len(first) <= _MOST_GAPS:
        return []
    ends = [_wall_beside(free, first, -along), _wall_beside(free, second, along)]
    found: list[Polygon] = []
    is_gap = (np.minimum(ends[0][1], ends[1][1]) > 0) & (ends[0][1] + ends[1][1] >= _LEAST_WALL)
    for number in np.nonzero(is_gap)[0].tolist():
        across = np.array([along[number, 1], -along[number, 0]])
        (low, high), (other_low, other_high) = ends[0][0][number], -ends[1][0][number][::-1]
        start, end = first[number], second[number]
        ring = [start + low * across, start + high * across,
                end + other_high * across, end + other_low * across]  # fmt: skip
        threshold = buffered(Polygon(ring).convex_hull, 0.5 * _STEP, join_style="mitre")
        if not any(each.intersects(threshold) for each in found):
            found += polygon_parts(threshold)
    return found


def _corners_of_walls(free: Polygon) -> Float64Array:
    """The corners (N, 2) of a region at which walls stand out into it."""
    found = []
    oriented = shapely.geometry.polygon.orient(free)
    for ring in (oriented.exterior, *oriented.interiors):
        points = shapely.get_coordinates(simplified(ring, 0.5 * _STEP))[:-1]
        before, after = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
        found.append(points[before[:, 0] * after[:, 1] < before[:, 1] * after[:, 0]])
    return np.concatenate(found)


def _wall_beside(
    free: Polygon,
    places: Float64Array,
    away: Float64Array,
    distances: Sequence[float] = _BESIDE,
) -> tuple[Float64Array, Float64Array]:
    """Wall that begins at `places` (N, 2) and continues in the directions `away` (N, 2).

    Returns the distances (N, 2) of its faces from the places, to the right of `away` (negative)
    and to the left, and how far it was found to continue (N,), 0 for none.
    """
    reach = np.arange(-_THICKEST - _AIR, _THICKEST + _AIR + 0.5 * _STEP, _STEP)
    left = np.column_stack([-away[:, 1], away[:, 0]])
    faces, extents = np.zeros((len(places), 2)), np.zeros(len(places))
    continues = np.ones(len(places), dtype=bool)
    for distance in distances:
        centres = places + distance * away
        points = centres[:, None] + reach[None, :, None] * left[:, None]
        is_air = shapely.contains_xy(free, points[..., 0], points[..., 1])
        bounds, is_wall = _walls_at(is_air, reach)
        continues &= is_wall
        if distance == distances[0]:
            faces = bounds
        extents[continues] = distance
    return faces, extents


def _walls_at(is_air: BoolArray, reach: Float64Array) -> tuple[Float64Array, BoolArray]:
    """Bounds (N, 2) of the wall nearest to the middle of each row, and whether it is one.

    It is thin enough, begins near the middle, and has air on both sides.
    """
    count, size = is_air.shape
    rows = np.arange(count)
    near = np.abs(reach) <= _OFF
    distance = np.where(is_air | ~near, np.inf, np.abs(reach))
    seed = np.argmin(distance, axis=1)
    is_wall = np.isfinite(distance[rows, seed])
    index: Int64Array = np.broadcast_to(np.arange(size), is_air.shape)
    before = np.where(is_air & (index < seed[:, None]), index, -1).max(axis=1)
    behind = np.where(is_air & (index > seed[:, None]), index, size).min(axis=1)
    room = round(_AIR / _STEP)
    is_wall &= (before >= room - 1) & (behind <= size - room)
    is_wall &= (behind - before) * _STEP <= _THICKEST + _STEP
    total = np.cumsum(np.column_stack([np.zeros(count, int), is_air]), axis=1)
    safe_before, safe_behind = np.clip(before, room - 1, size - 1), np.clip(behind, 0, size - room)
    is_wall &= total[rows, safe_before + 1] - total[rows, safe_before + 1 - room] == room
    is_wall &= total[rows, safe_behind + room] - total[rows, safe_behind] == room
    low, high = reach[np.clip(before, 0, size - 1)], reach[np.clip(behind, 0, size - 1)]
    return np.column_stack([low, high]), is_wall
