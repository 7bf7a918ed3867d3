"""Ceilings and walls for buildings without them: open-top floor plans, dioramas, bare roofs.

Input: upright triangles (F, 3, 3) in metres, and the closed rooms found in them. Output:
triangles of the ceilings and walls that close the open spaces.

An open space is an area of floor with room to stand, seen in a section just below the top of the
walls. It becomes a room if walls stand along enough of its outline. It gets a ceiling at the
height of its walls, or at `_LEAST_CEILING` above the floor if they are lower, and then the walls
are continued up to it. Where a wall is missing over more than the width of a doorway, it is
added; the longest added wall has a window. If there is none, continued walls have windows.
World: metres, Z up.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import shapely
import trimesh
from shapely.geometry import LineString, Polygon
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient
from shapely.ops import substring

from pbrnet.scenes.arrays import BoolArray, Float64Array
from pbrnet.scenes.geometry.mesh import face_areas
from pbrnet.scenes.geometry.regions import (
    buffered,
    difference,
    intersection,
    polygon_parts,
    simplified,
    thickened,
    union,
)
from pbrnet.scenes.reconstruction.orientation import surface_heights, upright_columns
from pbrnet.scenes.reconstruction.raycast import RayCaster
from pbrnet.scenes.reconstruction.rooms import MAX_HEIGHT, MIN_HEIGHT, FoundRoom, slice_segments

LEAST_WALLS = 0.4  # share of a floor's outline along which walls must stand
_LEAST_LOW_WALLS = 0.5  # the same of walls lower than a person: backs of furniture are no walls
_LEAST_WALLS_OUTDOORS = 0.75  # the same where the ground is the floor, or beside closed rooms
_LEAST_OUTER_WALLS = 0.2  # the same along the convex hull; a terrace has the house's walls inside
_MAX_CELLS = 40_000  # of the grid of vertical rays
_MANY_TRIANGLES = 300_000  # above which there are fewer rays: among slivers each takes longer
_CELL = 0.1  # metres, at least
_SAME_LEVEL = 0.04  # metres
_LEAST_WALL = 0.9  # metres; what is lower is no wall
_LEAST_CEILING = 2.4  # metres above the floor
_BELOW_TOP = 0.12  # metres below the top of the walls, where the section is
_HALF_GAP = 0.03  # metres; gaps in walls up to twice as wide are closed
_HALF_JOINT = 0.045  # metres; half the widest joint between the planks or tiles of a floor
_HALF_PASSAGE = 0.35  # metres; half the least width of a passage within one space
_NEAR_WALL = 0.4  # metres beside a floor's outline within which a wall counts as along it
_DOORWAY = 1.3  # metres; a wider gap in a wall is a missing wall
_LEAST_AREA = 3.0  # square metres
_LEAST_SMALL = 1.2  # square metres of a closet beside larger spaces, open above as they are
_LEAST_WALLS_OF_SMALL = 0.75  # share of its outline along which walls must stand
MOST_CLOSED = 0.2  # of the open spaces' area that closed ones beside them may have
_THICK = 0.1  # metres of added walls and ceilings
_INTO = 0.01  # metres by which added walls stand inside the edge of the floor
_OVER = 0.25  # metres by which a ceiling covers the walls
_BELOW_FLOOR = 0.03  # metres
_SILL, _HEAD = 0.9, 2.1  # of added windows, metres above the floor
_WIDEST_WINDOW, _LEAST_WINDOW = 2.4, 0.5  # metres
_STEP = 0.05  # metres along outlines
_WIDEST_SLIT = 0.5  # metres between a ceiling and a wall
_ALONG = 0.8  # of a room's shorter side: least length of a slit; a shorter one may be a skylight
_BESIDE_WALL = 0.3  # least share of a slit's outline that a wall is beside
_NEAR_SLIT = 0.06  # metres
_ROUNDING = 1e-3  # metres
_HALF_SLIT = 0.02  # metres; half the width of a slit that needs more than an enclosure
_UNDER, _ABOVE = 0.3, 0.5  # metres below a ceiling and above it, between which a slit is free
_PROBES = 40


@dataclass(frozen=True)
class Completion:
    """Ceilings and walls that close a building, or the reason why there are none."""

    ceilings: Float64Array  # triangles (F, 3, 3)
    walls: Float64Array  # triangles (F, 3, 3)
    spaces: tuple[Polygon, ...]  # floors of the spaces that became rooms
    raised: bool = False  # whether low walls were continued upwards
    has_added_walls: bool = False
    has_window: bool = False
    floor_z: float = 0.0  # height of their floors
    slits: int = 0  # rooms whose ceilings end before the walls, and were continued up to them
    refused: str = ""  # why an open space did not become a room


NOTHING = Completion(np.empty((0, 3, 3)), np.empty((0, 3, 3)), ())


@dataclass(frozen=True)
class _Storey:
    """The floor level of the open spaces, the top of their walls, and their plan."""

    floor_z: float
    top_z: float
    floor: BaseGeometry
    walls: BaseGeometry  # section just below the top
    lower_walls: BaseGeometry  # section at half the height


def complete(
    corners: Float64Array, is_ground: BoolArray, closed: Sequence[FoundRoom]
) -> Completion:
    """Close the open spaces of a building.

    `is_ground` (F,) tells which of the triangles `corners` (F, 3, 3) are ground. Open spaces
    beside `closed` ones are left as they are, unless those are a small share of them. Open spaces
    above closed ones, as over a basement, are a storey of their own if people can stand between
    its walls.
    """
    storey = _storey(corners, closed)
    if storey is None:
        return NOTHING
    below = [space for space in closed if space.ceiling_z <= storey.floor_z + _SAME_LEVEL]
    if below and storey.top_z - storey.floor_z < MIN_HEIGHT:  # a parapet around a flat roof
        return NOTHING
    taken = union([space.floor for space in closed if not any(space is each for each in below)])
    built = _level_plan(corners[~is_ground], storey.floor_z)
    spaces, small, best = [], [], 0.0
    is_low = storey.top_z - storey.floor_z < MIN_HEIGHT
    least = _LEAST_LOW_WALLS if is_low else LEAST_WALLS
    for piece in _pieces(storey):
        if intersection(piece, taken).area > 0.5 * piece.area:
            continue
        share, outer = _walled_shares(piece, storey)
        if outer < _LEAST_OUTER_WALLS:
            share = min(share, outer)
        if piece.area < _LEAST_AREA:
            small += [piece] if share >= _LEAST_WALLS_OF_SMALL else []
            continue
        best = max(best, share)
        on_ground = intersection(piece, built).area < 0.5 * piece.area
        if share >= (_LEAST_WALLS_OUTDOORS if on_ground else least):
            spaces.append(piece)
    if taken.area > MOST_CLOSED * sum(space.area for space in spaces):
        return NOTHING
    if not spaces:
        return NOTHING if best == 0.0 else replace(NOTHING, refused=_refusal(best, least))
    spaces += small
    ceiling_z = max(storey.top_z, storey.floor_z + _LEAST_CEILING)
    foot = storey.floor_z - _BELOW_FLOOR
    sill, head = storey.floor_z + _SILL, storey.floor_z + _HEAD
    added, window = _missing_walls(spaces, storey)
    walls = _pierced(added, window, (foot, sill, head, ceiling_z))
    raised = ceiling_z > storey.top_z + _SAME_LEVEL
    if raised:
        base = storey.top_z - _INTO
        sill = max(sill, storey.top_z + _INTO)
        lit = not window.is_empty or sill > head - _LEAST_WINDOW
        for space in spaces:
            rim = difference(buffered(space, _THICK, join_style="mitre"), union([space, added]))
            panes = Polygon() if lit else _pane(_longest_edge(space.exterior, spaces))
            walls += _pierced(rim, panes, (base, sill, head, ceiling_z))
    roof = union([buffered(each, _OVER, join_style="mitre", mitre_limit=2.0) for each in spaces])
    there = buffered(_level_plan(corners, ceiling_z), -_INTO)  # a ceiling over a part of them
    roof = difference(roof, intersection(there, union(spaces)))  # not the tops of walls
    return Completion(
        extruded(roof, ceiling_z, ceiling_z + _THICK),
        np.concatenate(walls),
        tuple(spaces),
        raised,
        not added.is_empty,
        not window.is_empty,
        storey.floor_z,
    )


def closed_slits(corners: Float64Array, rays: RayCaster, rooms: Sequence[FoundRoom]) -> Completion:
    """Continue the ceilings of rooms up to the walls, where they end a little before them.

    `corners` (F, 3, 3) are the triangles that `rays` holds. Holes in the middle of a ceiling, short
    ones, and those below a higher ceiling, as around a suspended one, stay.
    """
    parts, count = [], 0
    for room in rooms:
        strip = union(_slits(corners, rays, room))
        if not strip.is_empty:
            there = buffered(_level_faces(corners, room.ceiling_z), -_INTO)
            over = difference(buffered(strip, _NEAR_SLIT, join_style="mitre"), there)
            parts.append(extruded(over, room.ceiling_z, room.ceiling_z + _THICK))
            count += 1
    return replace(NOTHING, ceilings=np.concatenate(parts), slits=count) if parts else NOTHING


def _slits(corners: Float64Array, rays: RayCaster, room: FoundRoom) -> list[Polygon]:
    """The plans of the slits between a room's ceiling and its walls."""
    reach = buffered(room.floor, _WIDEST_SLIT + 2 * _HALF_GAP, join_style="mitre")
    west, south, east, north = reach.bounds
    low, high = corners[:, :, :2].min(axis=1), corners[:, :, :2].max(axis=1)
    near = corners[((low <= (east, north)) & (high >= (west, south))).all(axis=1)]
    walls = _section(near, room.ceiling_z - _BELOW_TOP)
    inside = [part for part in polygon_parts(difference(reach, walls))
              if intersection(part, room.floor).area > 0.5 * part.area]  # fmt: skip
    cover = buffered(_level_faces(near, room.ceiling_z), _ROUNDING, join_style="mitre")
    free = union([buffered(part, _HALF_GAP, join_style="mitre") for part in inside])
    wide = buffered(buffered(difference(free, cover), -_HALF_SLIT), _HALF_SLIT + _ROUNDING)
    side = min(east - west, north - south) - 2 * _WIDEST_SLIT
    return [
        piece
        for piece in polygon_parts(intersection(wide, free))
        if _is_slit(piece, walls, reach, _ALONG * side) and _is_free_above(piece, rays, room)
    ]


def _is_slit(piece: Polygon, walls: BaseGeometry, reach: BaseGeometry, least_length: float) -> bool:
    """Return whether a gap in a ceiling is narrow and long, and lies beside a wall."""
    west, south, east, north = piece.bounds
    if max(east - west, north - south) < least_length:
        return False
    if not buffered(piece, -0.5 * _WIDEST_SLIT).is_empty:
        return False
    outline = piece.boundary
    leaks = intersection(outline, buffered(reach.boundary, _ROUNDING)).length
    beside = intersection(outline, buffered(walls, _NEAR_SLIT)).length
    return bool(leaks == 0.0 and beside >= _BESIDE_WALL * outline.length)


def _is_free_above(piece: Polygon, rays: RayCaster, room: FoundRoom) -> bool:
    """Return whether nothing lies above a slit within a short distance."""
    count = max(2, min(_PROBES, int(piece.length / (4 * _STEP))))
    ring = shapely.line_interpolate_point(
        piece.exterior, (np.arange(count) + 0.5) / count, normalized=True
    )
    inner = buffered(piece, -0.4 * piece.area / max(0.5 * piece.length, 1e-9))
    if not inner.is_empty:
        ring = shapely.get_point(shapely.shortest_line(ring, inner), 1)
    points = shapely.get_coordinates(ring)
    origins = np.column_stack([points, np.full(len(points), room.ceiling_z - _UNDER)])
    distance, _ = rays.cast(origins, np.array([0.0, 0.0, 1.0]))
    return bool((distance > _UNDER + _ABOVE).mean() > 0.5)


def _refusal(share: float, least: float) -> str:
    return (
        f"walls stand along {share:.0%} of the largest floor's outline; a room needs "
        f"{least:.0%}, or {_LEAST_WALLS_OUTDOORS:.0%} on bare ground"
    )


def _storey(corners: Float64Array, closed: Sequence[FoundRoom]) -> _Storey | None:
    """The storey that is open above, not below `closed` ones; None without a floor with walls."""
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    size = np.maximum(high - low, 1e-6)
    cells = _MAX_CELLS * min(1.0, _MANY_TRIANGLES / len(corners))
    step = max(_CELL, math.sqrt(float(size[0] * size[1]) / cells))
    xs, ys = (np.arange(low[axis] + 0.37 * step, high[axis], step) for axis in (0, 1))
    points = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
    columns = surface_heights(RayCaster(corners), points, float(low[2]), float(high[2]))
    foot = np.full(len(points), low[2])
    for space in closed:
        inside = shapely.contains_xy(space.floor, points)
        foot[inside] = np.maximum(foot[inside], space.ceiling_z)
    columns = [column[column >= z] for column, z in zip(columns, foot, strict=True)]
    lows = [_standing_height(column) for column in columns]
    heights = np.array([height for height in lows if height is not None])
    if len(heights) * step**2 < _LEAST_AREA:
        return None
    floor_z = _commonest(heights, np.ones(len(heights)))
    top_z = _wall_top(corners, floor_z)
    if top_z is None:
        return None
    floor = _level_plan(corners, floor_z)
    if floor.is_empty:
        return None
    walls = [
        _section(corners, height)
        for height in (top_z - _BELOW_TOP, floor_z + 0.5 * (top_z - floor_z))
    ]
    return _Storey(floor_z, top_z, floor, walls[0], walls[1])


def _standing_height(column: Float64Array) -> float | None:
    """The lowest surface of a column with the height of a room above it, or the sky.

    What is higher than a room is the inside of a block, such as the earth below a house.
    """
    if not len(column):
        return None
    gaps = np.diff(column)
    stands = np.append((gaps >= MIN_HEIGHT) & (gaps <= MAX_HEIGHT), True)
    return float(column[int(np.argmax(stands))])


def _commonest(values: Float64Array, weights: Float64Array) -> float:
    """The centre of the interval of `_SAME_LEVEL` with the most weight."""
    order = np.argsort(values, kind="stable")
    ordered, total = values[order], np.append(0.0, np.cumsum(weights[order]))
    ends = np.searchsorted(ordered, ordered + _SAME_LEVEL, side="right")
    sums = total[ends] - total[: len(ordered)]
    start = int(np.argmax(sums))
    return float(np.median(ordered[start : ends[start]]))


def _wall_top(corners: Float64Array, floor_z: float) -> float | None:
    """The height at which most of the walls on a floor end; None without walls."""
    bottom, top, areas = upright_columns(corners, _THICK, _LEAST_WALL)
    is_wall = (
        (top - floor_z >= _LEAST_WALL)
        & (top - floor_z <= MAX_HEIGHT)
        & (bottom - floor_z <= 0.5 * (top - floor_z))
    )
    if not is_wall.any():
        return None
    return _commonest(top[is_wall], areas[is_wall])


def _section(corners: Float64Array, height: float) -> BaseGeometry:
    """The surfaces in a level section, thickened by `_HALF_GAP`."""
    lines = shapely.linestrings(slice_segments(corners, height))
    return thickened(lines, _HALF_GAP, cap_style="square")


def _level_plan(corners: Float64Array, level: float) -> BaseGeometry:
    """Plan of the level triangles at a height, with joints closed."""
    closed = buffered(_level_faces(corners, level), _HALF_JOINT, join_style="mitre")
    return buffered(closed, -_HALF_JOINT, join_style="mitre")


def _level_faces(corners: Float64Array, level: float) -> BaseGeometry:
    """The union of the level triangles at a height, on the plan."""
    _, normals = face_areas(corners)
    near = np.abs(corners[:, :, 2] - level).max(axis=1, initial=0.0) < 0.06
    triangles = corners[near & (np.abs(normals[:, 2]) > 0.95)][:, :, :2]
    return union(shapely.polygons(triangles).tolist())


def _pieces(storey: _Storey) -> list[Polygon]:
    """The areas of floor between walls, closets included."""
    pieces = []
    for part in polygon_parts(difference(storey.floor, storey.walls)):
        grown = buffered(
            buffered(part, -_HALF_PASSAGE), _HALF_PASSAGE + _HALF_GAP, join_style="mitre",
            mitre_limit=2.0,
        )  # fmt: skip
        for piece in polygon_parts(
            intersection(grown, buffered(part, _HALF_GAP, join_style="mitre"))
        ):
            outline = simplified(Polygon(piece.exterior), 0.02)
            if outline.area >= _LEAST_SMALL and outline.is_valid:
                pieces.append(orient(outline))
    return pieces


def _walled_shares(piece: Polygon, storey: _Storey) -> tuple[float, float]:
    """Shares of an outline, and of its part on the convex hull, along which a wall stands.

    At the top or at half its height.
    """
    ring = piece.exterior
    places = shapely.line_interpolate_point(ring, np.arange(0, ring.length, 2 * _STEP))
    near = [shapely.distance(walls, places) < _NEAR_WALL
            for walls in (storey.walls, storey.lower_walls)]  # fmt: skip
    walled = near[0] | near[1]
    is_outer = shapely.distance(piece.convex_hull.exterior, places) < _NEAR_WALL
    return float(walled.mean()), float(walled[is_outer].mean())


def _missing_walls(spaces: list[Polygon], storey: _Storey) -> tuple[BaseGeometry, BaseGeometry]:
    """The plan of added walls, and the part of it that has a window."""
    added: list[BaseGeometry] = []
    edges: list[LineString] = []
    for number, space in enumerate(spaces):
        others = union([other for k, other in enumerate(spaces) if k != number])
        band = difference(
            buffered(space, _THICK, join_style="mitre", mitre_limit=2.0), buffered(space, -_INTO)
        )
        for run in _open_runs(space, storey, others):
            reach = buffered(run, _THICK + _INTO, cap_style="square", join_style="mitre")
            added.append(intersection(band, reach))
            edges += [LineString(ends) for ends in pairwise(run.coords)]
    longest = max(edges, key=lambda edge: float(edge.length), default=LineString())
    return union(added), _pane(longest)


def _longest_edge(ring: LineString, spaces: list[Polygon]) -> LineString:
    """The longest edge of a space's outline that no other space lies behind."""
    edges = [LineString(ends) for ends in pairwise(ring.coords)]
    outer = [
        edge for edge in edges if sum(space.distance(edge) < _NEAR_WALL for space in spaces) == 1
    ]
    return max(outer, key=lambda edge: float(edge.length), default=LineString())


def _pane(edge: LineString) -> BaseGeometry:
    """The plan of a window in the middle of a wall along `edge`; empty if the wall is short."""
    width = min(_WIDEST_WINDOW, 0.6 * edge.length)
    if width < _LEAST_WINDOW:
        return Polygon()
    middle = 0.5 * edge.length
    line = substring(edge, middle - 0.5 * width, middle + 0.5 * width)
    return buffered(line, 2 * _THICK, cap_style="flat")


def _pierced(
    plan: BaseGeometry, window: BaseGeometry, levels: tuple[float, float, float, float]
) -> list[Float64Array]:
    """Triangles of walls from the first to the last of `levels`, but for a window between.

    `window` is its plan, and the middle levels are its sill and head.
    """
    foot, sill, head, top = levels
    if window.is_empty:
        return [extruded(plan, foot, top)]
    inside = intersection(plan, window)
    return [
        extruded(difference(plan, window), foot, top),
        extruded(inside, foot, sill),
        extruded(inside, head, top),
    ]


def _open_runs(space: Polygon, storey: _Storey, others: BaseGeometry) -> list[LineString]:
    """The stretches of an outline without a wall, other than doorways and ways to `others`."""
    ring = space.exterior
    covered = buffered(union([storey.walls, others]), _NEAR_WALL)
    runs = shapely.line_merge(difference(ring, covered))
    lines = [line for line in shapely.get_parts(runs).tolist() if isinstance(line, LineString)]
    lines = _joined(lines)
    # `covered` reaches `_NEAR_WALL` beyond the end of each wall.
    return [
        _extended(line, ring, storey.walls)
        for line in lines
        if line.is_closed or line.length + 2 * _NEAR_WALL > _DOORWAY
    ]


def _joined(lines: list[LineString]) -> list[LineString]:
    """Lines of which the last continues in the first, over the start of the ring, are one."""
    if len(lines) > 1 and lines[-1].coords[-1] == lines[0].coords[0]:
        merged = LineString([*lines[-1].coords, *lines[0].coords[1:]])
        return [merged, *lines[1:-1]]
    return lines


def _extended(line: LineString, ring: LineString, walls: BaseGeometry) -> LineString:
    """The line, continued along the ring at both ends up to the walls there."""
    if line.is_closed:
        return line
    start, end = (ring.project(shapely.Point(line.coords[k])) for k in (0, -1))
    length, reach = ring.length, 2 * _NEAR_WALL
    longer = _along(ring, (start - reach) % length, (end + reach) % length)
    free = shapely.line_merge(difference(longer, buffered(walls, _HALF_GAP)))
    middle = line.interpolate(0.5, normalized=True)
    parts = [part for part in shapely.get_parts(free).tolist() if isinstance(part, LineString)]
    return min(parts, key=lambda part: float(part.distance(middle)), default=line)


def _along(ring: LineString, start: float, end: float) -> LineString:
    """The part of a ring from one distance to another, over its start if need be."""
    if start < end:
        return substring(LineString(ring.coords), start, end)
    first = substring(LineString(ring.coords), start, ring.length)
    last = substring(LineString(ring.coords), 0.0, end)
    return LineString([*first.coords, *last.coords[1:]])


def extruded(plan: BaseGeometry, low: float, high: float) -> Float64Array:
    """Triangles (F, 3, 3) of the prism over a plan."""
    parts = [np.empty((0, 3, 3))]
    for part in polygon_parts(plan):
        if part.area > 1e-4 and high - low > 1e-3:
            solid = trimesh.creation.extrude_polygon(part, high - low, engine="earcut")
            parts.append(np.asarray(solid.triangles) + np.array([0.0, 0.0, low]))
    return np.concatenate(parts)
