"""Rooms and openings of a building given as plain triangles.

Input: triangles (F, 3, 3) and a ray caster for them. Output: rooms with floor polygon and
heights, and the planar openings through which they see outdoors.

A horizontal section a little below a ceiling shows the walls and little else: lintels close the
doors there, and furniture seldom reaches so high. The free areas of that section, under a ceiling
and over a floor, are the rooms, parted where a doorway reaches up to the ceiling. Openings are
searched wall by wall with a grid of rays straight outwards; connected rays that leave the building
form an opening. World: metres, Z up.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np
import shapely
from scipy import ndimage
from shapely.geometry import Point, Polygon

from pbrnet.scenes.arrays import BoolArray, Float64Array
from pbrnet.scenes.geometry.directions import fibonacci_sphere, horizontal_directions
from pbrnet.scenes.geometry.doorways import parts_at_doorways
from pbrnet.scenes.geometry.mesh import face_areas
from pbrnet.scenes.geometry.regions import (
    buffered,
    deepest_point,
    difference,
    intersection,
    largest_part,
    polygon_parts,
    simplified,
    thickened,
    union,
)
from pbrnet.scenes.reconstruction.orientation import surface_heights
from pbrnet.scenes.reconstruction.raycast import RayCaster

_MAX_COLUMNS = 250_000  # of the grid of vertical rays that looks for ceilings
MIN_HEIGHT, MAX_HEIGHT = 1.9, 8.0
MIN_AREA = 1.2  # square metres
_SLICES = (0.25, 0.12, 0.06, 0.4)  # metres below the ceiling, tried in this order
_HALF_GAP = 0.03  # metres; gaps in walls up to twice as wide are closed
_HALF_CAVITY = 0.35  # metres; free strips less than twice as wide are wall cavities, not rooms
_CELL = 0.05  # metres; grid of the search for openings
_MOST_CELLS = 50_000  # of that grid in one wall or ceiling; larger ones get larger cells
_INSET = 0.12  # metres inside the wall at which the rays of that search start
_LEAST_SLOPE = 0.1  # vertical part of the normal of a ceiling's face
_REVEAL = 0.65  # greatest thickness of a wall around an opening, metres
MIN_OPENING = 0.08  # square metres
_RECESS = 0.02  # metres behind the wall's face from which a surface stands in a hole of the wall
_OPEN_SHARE = 0.2  # least share of free cells in an opening; the rest is frame and bars
_ROOF_STEP, _OUTDOORS = 0.1, 1.5  # metres along a ray; so far without a roof is outdoors
_FARTHEST_WALL = 40.0  # metres from a camera
_JAMB = 0.2  # metres; narrower recesses of the outline are sides of windows
_LINTELS = (0.1, 0.25)  # metres below the ceiling
_ROUNDING = 1e-6  # metres, by which comparisons of bounds are wider
_PARTS = 8  # of the directions of a view
_FAN_SAMPLE = 64  # open cells that show which directions lead outdoors most often
_FRAME_CELLS = 4  # greatest width of a window's frame, in cells


@dataclass
class FoundRoom:
    """A room: floor polygon (counter-clockwise), heights in metres, and whether it is a guess.

    `solid` (F, 3, 3) are the triangles around its air where that is no prism, as below a roof;
    `ceiling_z` is the highest place then.
    """

    floor: Polygon
    floor_z: float
    ceiling_z: float
    guessed: bool = False
    solid: Float64Array | None = field(default=None, repr=False, compare=False)

    @cached_property
    def _solid_rays(self) -> RayCaster | None:
        return None if self.solid is None else RayCaster(self.solid)

    def encloses(self, points: Float64Array) -> BoolArray:
        """Return which points (N, 3) over the floor the solid contains; all without a solid."""
        if self._solid_rays is None:
            return np.ones(len(points), dtype=bool)
        up = np.array([0.0, 0.0, 1.0])
        ends = [self._solid_rays.cast(points, way)[0] for way in (up, -up)]
        return np.isfinite(ends[0]) & np.isfinite(ends[1])

    def lowered(self, points: Float64Array) -> Float64Array:
        """Return points (N, 3) over the floor, their heights squeezed below a sloping ceiling."""
        if self._solid_rays is None:
            return points
        above = np.column_stack([points[:, :2], np.full(len(points), self.ceiling_z + 1.0)])
        depth, _ = self._solid_rays.cast(above, np.array([0.0, 0.0, -1.0]))
        top = np.where(np.isfinite(depth), above[:, 2] - depth, self.ceiling_z)
        share = (points[:, 2] - self.floor_z) / (self.ceiling_z - self.floor_z)
        return np.column_stack([points[:, :2], self.floor_z + share * (top - self.floor_z)])

    @cached_property
    def bounds(self) -> tuple[float, float, float, float]:
        """Least x and y, greatest x and y of the floor."""
        west, south, east, north = self.floor.bounds
        return float(west), float(south), float(east), float(north)

    @property
    def centre(self) -> Float64Array:
        """A point (3,) well inside, at eye height."""
        point = deepest_point(self.floor)
        return np.array([*point, self.floor_z + 0.55 * (self.ceiling_z - self.floor_z)])

    def contains(self, point: Float64Array, margin: float = 0.0) -> bool:
        """Return whether a point (3,) lies inside or at most `margin` metres outside."""
        if not self.floor_z - margin <= point[2] <= self.ceiling_z + margin:
            return False
        west, south, east, north = self.bounds
        x, y, reach = float(point[0]), float(point[1]), max(margin, 0.0) + _ROUNDING
        if not (west - reach <= x <= east + reach and south - reach <= y <= north + reach):
            return False
        place = Point(x, y)
        if margin > 0:
            return bool(self.floor.distance(place) < margin)
        return bool(self.floor.contains(place) and self.floor.boundary.distance(place) > -margin)

    def is_near(self, other: FoundRoom, reach: float) -> bool:
        """Return whether the bounds of two floors come within `reach` metres of each other."""
        west, south, east, north = self.bounds
        reach += _ROUNDING
        return (
            west - reach <= other.bounds[2]
            and south - reach <= other.bounds[3]
            and east + reach >= other.bounds[0]
            and north + reach >= other.bounds[1]
        )


@dataclass
class FoundOpening:
    """An opening from a room to the outside."""

    room: int  # number in the list of rooms
    polygon: Float64Array  # corners (N, 3), in one plane
    normal: Float64Array  # unit (3,), points outdoors
    wall_share: float  # share of the wall's area
    overhead: bool = False  # in the ceiling
    panes: list[str] = field(default_factory=list)  # ids of shapes that held its window panes
    hidden: bool = False  # found by random walks, not by rays along the wall's normal
    # Points (K, 3) in its plane from which rays along the normal leave the building.
    seeds: Float64Array = field(default_factory=lambda: np.empty((0, 3)))


def closed_rooms(rays: RayCaster, corners: Float64Array) -> list[FoundRoom]:
    """Find all rooms with a level ceiling, a floor and walls.

    `corners` (F, 3, 3) are the triangles that `rays` holds.
    """
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    step = float(np.clip(np.max(high - low)[None] / 100, 0.2, 2.0)[0])
    columns: list[Float64Array] = []
    if float(np.prod(np.ceil((high - low)[:2] / step))) <= _MAX_COLUMNS:
        xs = np.arange(low[0] + 0.37 * step, high[0], step)
        ys = np.arange(low[1] + 0.41 * step, high[1], step)
        points = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
        columns = surface_heights(rays, points, low[2], high[2])
    rooms: list[FoundRoom] = []
    for level in _ceiling_levels(columns, step):
        for polygon in _free_areas(corners, level):
            room = _room_below(rays, polygon, level)
            if room is not None and not any(_is_same_room(room, other) for other in rooms):
                rooms.append(room)
    return rooms


def with_visible_space(
    rays: RayCaster, corners: Float64Array, rooms: list[FoundRoom], eye: Float64Array | None
) -> list[FoundRoom]:
    """Add the space around a camera at `eye` (3,) as a guessed room if no room contains it.

    Without a camera and without rooms, a point in the middle of the scene stands for the camera.
    """
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    least = 1.0  # metres of height of a space that contains a camera
    if eye is None and not rooms:
        least = MIN_HEIGHT
        eye = np.array([*(0.5 * (low + high))[:2], low[2] + 0.6 * min(high[2] - low[2], 2.5)])
    if eye is not None and not any(room.contains(eye, 0.3) for room in rooms):
        seen = _visible_space(rays, eye, low, high)
        if seen is not None and seen.ceiling_z - seen.floor_z >= least:
            rooms = [room for room in rooms if not _overlap(room, seen)]
            rooms.insert(0, seen)
    return rooms


def find_openings(rays: RayCaster, rooms: list[FoundRoom]) -> list[FoundOpening]:
    """Find the windows, outside doors, missing walls and skylights of every room."""
    openings = []
    for index, room in enumerate(rooms):
        if not has_view_outside(rays, room):
            continue
        height = room.ceiling_z - room.floor_z
        ring = np.array(room.floor.exterior.coords)
        for start, end in pairwise(ring):
            length = float(np.linalg.norm(end - start))
            if length < 0.3:
                continue
            along = np.append((end - start) / length, 0.0)
            outward = np.array([along[1], -along[0], 0.0])
            origin = np.append(start, room.floor_z)
            up = np.array([0.0, 0, 1])
            found = _open_areas(rays, origin, along, up, length, height, outward, room)
            for outline, share, seeds in found:
                openings.append(FoundOpening(index, outline, outward, share, seeds=seeds))
        for plan, normal, origin, u, v in _ceiling_faces(room):
            corners = np.array(plan.exterior.coords)
            heights = origin[2] - ((corners - origin[:2]) @ normal[:2]) / normal[2]
            offsets = np.column_stack([corners, heights]) - origin
            low = np.array([(offsets @ u).min(), (offsets @ v).min()])
            width, depth = np.array([(offsets @ u).max(), (offsets @ v).max()]) - low
            start = origin + low[0] * u + low[1] * v
            found = _open_areas(rays, start, u, v, width, depth, normal, room, plan)
            openings += [
                FoundOpening(index, outline, normal, share, True, seeds=seeds)
                for outline, share, seeds in found
            ]
    return [opening for opening in openings if not _leads_to_room(opening, rooms)]


def _ceiling_faces(
    room: FoundRoom,
) -> Iterator[tuple[Polygon, Float64Array, Float64Array, Float64Array, Float64Array]]:
    """The planes of a room's ceiling: plan, outward normal (3,), a point (3,), two axes (3,)."""
    east = np.array([1.0, 0, 0])
    if room.solid is None:
        west, south, *_ = room.floor.bounds
        corner = np.array([west, south, room.ceiling_z])
        yield room.floor, np.array([0.0, 0, 1]), corner, east, np.array([0.0, 1, 0])
        return
    areas, normals = face_areas(room.solid)
    normals = np.where(normals[:, 2:] < 0, -normals, normals)  # whichever way they are written
    middles = room.solid.mean(axis=1)
    is_top = ~room.encloses(middles + 0.01 * normals) & room.encloses(middles - 0.01 * normals)
    is_top &= (normals[:, 2] > _LEAST_SLOPE) & (areas > 0)
    keys = np.round(np.column_stack([normals, np.sum(normals * middles, axis=1)]), 2)
    _, groups = np.unique(keys[is_top], axis=0, return_inverse=True)
    for number in range(int(groups.max(initial=-1)) + 1):
        chosen = np.nonzero(is_top)[0][groups.ravel() == number]
        plan = largest_part(union(shapely.polygons(room.solid[chosen][:, :, :2])))
        if plan.area >= MIN_OPENING:
            normal = normals[chosen[0]]
            level = np.cross([0.0, 0.0, 1.0], normal)
            length = float(np.linalg.norm(level))
            u = level / length if length > _ROUNDING else east
            yield Polygon(plan.exterior), normal, middles[chosen[0]], u, np.cross(normal, u)


def _leads_to_room(opening: FoundOpening, rooms: list[FoundRoom]) -> bool:
    """Return whether another room lies right behind an opening."""
    middle = opening.polygon.mean(axis=0)
    return any(
        room.contains(middle + depth * opening.normal)
        for depth in (0.15, 0.3, 0.5, 0.8)
        for number, room in enumerate(rooms)
        if number != opening.room
    )


def has_view_outside(rays: RayCaster, room: FoundRoom) -> bool:
    """Return whether any ray from a few points of a room leaves the building."""
    inner = buffered(room.floor, -0.3)
    inner = room.floor if inner.is_empty else inner
    west, south, east, north = inner.bounds
    places = [room.centre]
    for u in (0.2, 0.5, 0.8):
        for v in (0.2, 0.5, 0.8):
            point = Point(west + u * (east - west), south + v * (north - south))
            if inner.contains(point):
                for share in (0.3, 0.8):
                    z = room.floor_z + share * (room.ceiling_z - room.floor_z)
                    places.append(np.array([point.x, point.y, z]))
    directions = fibonacci_sphere(2048)
    # By interleaved parts, since one ray is enough.
    return any(
        rays.escapes(place, directions[part::_PARTS]).any()
        for place in places
        for part in range(_PARTS)
    )


def _open_areas(
    rays: RayCaster,
    origin: Float64Array,
    u: Float64Array,
    v: Float64Array,
    width: float,
    height: float,
    outward: Float64Array,
    room: FoundRoom,
    within: Polygon | None = None,
) -> list[tuple[Float64Array, float, Float64Array]]:
    """Find the open areas of a rectangle in a wall or ceiling of `room`, over the plan `within`.

    Returns for each its outline (N, 3), its share of the rectangle's area, and the points (K, 3)
    in it from which rays leave the building.
    """
    cell = max(_CELL, math.sqrt(width * height / _MOST_CELLS))
    columns, rows = max(2, round(width / cell)), max(2, round(height / cell))
    columns, rows = min(columns, 600), min(rows, 600)
    us = (np.arange(columns) + 0.5) * width / columns
    vs = (np.arange(rows) + 0.5) * height / rows
    grid = origin + us[None, :, None] * u + vs[:, None, None] * v
    flat = grid.reshape(-1, 3)
    distance, _ = rays.cast(flat - _INSET * outward, outward)
    open_cells = (distance > _INSET + _REVEAL).reshape(rows, columns)
    hollow = (distance > _INSET + _RECESS).reshape(rows, columns)
    inside = room.encloses(flat - _INSET * outward).reshape(rows, columns)
    if within is not None:
        inside &= shapely.contains_xy(within, flat[:, 0], flat[:, 1]).reshape(rows, columns)
    open_cells &= inside
    if not open_cells.any():
        return []
    open_cells &= _reaches_sky(rays, grid, open_cells, outward)
    neighbours = np.ones((3, 3), dtype=bool)
    padded = np.pad(open_cells, 3)
    # Closing bridges window bars up to about 10 cm wide.
    joined = ndimage.binary_closing(padded, neighbours, iterations=2)[3:-3, 3:-3]
    # Grown to the edges of the wall's hole: oblique rays pass a frame that stands in it.
    joined |= ndimage.binary_dilation(
        joined, neighbours, iterations=_FRAME_CELLS, mask=hollow | joined
    )
    if within is not None or room.solid is not None:
        joined &= inside
    labels, count = ndimage.label(joined)
    du, dv = width / columns, height / rows
    parts = []
    for label in range(1, count + 1):
        cells = labels == label
        area = float(cells.sum()) * du * dv
        if area < MIN_OPENING or (cells & open_cells).sum() < _OPEN_SHARE * cells.sum():
            continue
        if min(np.ptp(np.nonzero(cells)[0]), np.ptp(np.nonzero(cells)[1])) < 1:
            continue  # a slit one cell wide is a seam
        outline = np.clip(_outline(cells, du, dv), 0.0, [width, height])
        points = origin + outline[:, :1] * u + outline[:, 1:] * v
        parts.append((points, area / (width * height), grid[cells & open_cells]))
    return parts


def _reaches_sky(
    rays: RayCaster, grid: Float64Array, cells: BoolArray, outward: Float64Array
) -> BoolArray:
    """Return the open cells from which any of 24 directions outwards hits nothing.

    Every other cell of every other row is tested first, then the neighbours of those that see the
    sky: an opening two cells wide holds one of the first.
    """
    first = np.zeros_like(cells)
    first[::2, ::2] = cells[::2, ::2]
    found = _see_sky(rays, grid, first, outward)
    near = ndimage.binary_dilation(found, np.ones((3, 3), dtype=bool))
    return found | _see_sky(rays, grid, cells & near & ~first, outward)


def _see_sky(
    rays: RayCaster, grid: Float64Array, cells: BoolArray, outward: Float64Array
) -> BoolArray:
    """Return those of `cells` from which any of 24 directions outwards hits nothing."""
    found = np.zeros_like(cells)
    if not cells.any():
        return found
    fan = fibonacci_sphere(48)
    fan = fan[fan @ outward > 0.05]
    points = grid[cells] + 0.02 * outward
    # The directions that are free most often come first, as further ones are for the rest only.
    some = points[:: 1 + len(points) // _FAN_SAMPLE]
    counts = [int(rays.escapes(some, direction).sum()) for direction in fan]
    left = np.arange(len(points))
    for number in np.argsort(-np.array(counts), kind="stable").tolist():
        left = left[~rays.escapes(points[left], fan[number])]
        if not len(left):
            break
    free = np.ones(len(points), dtype=bool)
    free[left] = False
    found[cells] = free
    return found


def _outline(cells: BoolArray, du: float, dv: float) -> Float64Array:
    """Outline (N, 2) of cells in metres, counter-clockwise in (u, v).

    The bounding rectangle of cells that nearly fill it, else a simplified polygon. It is larger
    by one cell, the accuracy of the opening's edge, so that no light passes beside it.
    """
    rows, columns = np.nonzero(cells)
    low = np.array([columns.min() * du, rows.min() * dv])
    high = np.array([(columns.max() + 1) * du, (rows.max() + 1) * dv])
    if cells.sum() * du * dv >= 0.8 * float(np.prod(high - low)):
        cell = np.array([du, dv])
        low, high = low - cell, high + cell
        return np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    # One box for each run of cells in a row: the union of single cells takes thirty times as long.
    new = (np.diff(rows, prepend=-1) != 0) | (np.diff(columns, prepend=-1) != 1)
    first, last = np.nonzero(new)[0], np.append(np.nonzero(new)[0][1:], len(rows)) - 1
    boxes = shapely.box(
        columns[first] * du, rows[first] * dv, (columns[last] + 1) * du, (rows[first] + 1) * dv
    )
    shape = buffered(union(list(boxes)), max(du, dv), join_style="mitre")
    outline = Polygon(largest_part(shape).exterior)
    ring = np.array(simplified(outline, 0.06).exterior.coords)[:-1]
    return ring if Polygon(ring).exterior.is_ccw else ring[::-1]


def _ceiling_levels(columns: list[Float64Array], step: float) -> list[float]:
    """Heights of level ceilings over at least one square metre, highest first."""
    tops = []
    for column in columns:
        gaps = np.diff(column)
        fits = (gaps >= MIN_HEIGHT) & (gaps <= MAX_HEIGHT)
        tops += column[1:][fits].tolist()
    if not tops:
        return []
    heights = np.sort(np.array(tops))
    groups = np.split(heights, np.nonzero(np.diff(heights) > 0.04)[0] + 1)
    return [float(np.median(group)) for group in reversed(groups) if len(group) * step**2 > 1.0]


def _free_areas(corners: Float64Array, level: float) -> list[Polygon]:
    """Free areas in a section below the ceiling at height `level`, inside the ceiling's plan."""
    cover = _ceiling_plan(corners, level)
    if cover.is_empty:
        return []
    polygons: list[Polygon] = []
    for drop in _SLICES:
        if drop == _SLICES[-1]:  # below joists, whose bays are too narrow for rooms
            cover = buffered(buffered(cover, _HALF_CAVITY), -_HALF_CAVITY)
        # Buffering the union of the lines takes a hundred times as long.
        lines = shapely.linestrings(slice_segments(corners, level - drop))
        walls = thickened(lines, _HALF_GAP, cap_style="square")
        free = [
            part
            for region in polygon_parts(difference(cover, walls))
            for part in parts_at_doorways(region)
        ]
        for part in free:
            grown = buffered(
                buffered(part, -_HALF_CAVITY),
                _HALF_CAVITY + _HALF_GAP,
                join_style="mitre",
                mitre_limit=2.0,
            )
            within = intersection(buffered(part, _HALF_GAP, join_style="mitre"), cover)
            for piece in polygon_parts(intersection(grown, within)):
                outline = simplified(Polygon(piece.exterior), 0.03)
                if outline.area >= MIN_AREA and outline.is_valid:
                    polygons.append(shapely.geometry.polygon.orient(outline))
        if polygons:
            break
    return polygons


def slice_segments(corners: Float64Array, height: float) -> Float64Array:
    """Cut triangles (F, 3, 3) with the plane z = `height`: segments (N, 2, 2) in x and y."""
    # By columns: `min(axis=1)` takes ten times as long on rows of three.
    first, second, third = corners[:, 0, 2], corners[:, 1, 2], corners[:, 2, 2]
    lowest = np.minimum(np.minimum(first, second), third)
    highest = np.maximum(np.maximum(first, second), third)
    cut = corners[(lowest <= height) & (highest >= height)]
    z = cut[:, :, 2] - height
    z = np.where(z == 0, 1e-9, z)
    below = z < 0
    mixed = (below[:, 0] != below[:, 1]) | (below[:, 1] != below[:, 2])
    cut, z = cut[mixed], z[mixed]
    ends = np.zeros((len(cut), 2, 2))
    filled = np.zeros(len(cut), dtype=int)
    for a, b in ((0, 1), (1, 2), (2, 0)):
        crossing = (z[:, a] < 0) != (z[:, b] < 0)
        share = z[:, a] / np.where(crossing, z[:, a] - z[:, b], 1.0)
        point = cut[:, a, :2] + share[:, None] * (cut[:, b, :2] - cut[:, a, :2])
        rows = np.nonzero(crossing)[0]
        ends[rows, np.minimum(filled[rows], 1)] = point[rows]
        filled[rows] += 1
    return ends[np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) > 1e-6]


def _ceiling_plan(corners: Float64Array, level: float) -> Polygon:
    """Plan of all level triangles at the height of a ceiling."""
    _, normals = face_areas(corners)
    z = corners[:, :, 2]
    near = (np.abs(normals[:, 2]) > 0.95) & (np.abs(z - level).max(axis=1) < 0.06)
    triangles = corners[near][:, :, :2]
    if not len(triangles):
        return Polygon()
    # Ceilings are often made of tiles with seams, which this closes.
    merged = union(shapely.polygons(triangles).tolist())
    return buffered(buffered(merged, _HALF_GAP, join_style="mitre"), -_HALF_GAP, join_style="mitre")


def _room_below(rays: RayCaster, polygon: Polygon, level: float) -> FoundRoom | None:
    """The room of a free area below a ceiling, or None if it lacks a floor or walls."""
    points = inside_points(polygon, 160)
    if not len(points):
        return None
    heights = np.full(len(points), level - 0.3)
    origins = np.column_stack([points, heights])
    down, _ = rays.cast(origins, np.array([0.0, 0, -1]))
    up, _ = rays.cast(origins, np.array([0.0, 0, 1]))
    if np.isfinite(down).mean() < 0.8 or np.isfinite(up).mean() < 0.8:
        return None
    below = level - 0.3 - down[np.isfinite(down)]
    floor = _floor_height(below)
    if not MIN_HEIGHT <= level - floor <= MAX_HEIGHT:
        return None
    if _enclosed_share(rays, polygon, floor, level) < 0.45:
        return None
    return FoundRoom(polygon, floor, level)


def _floor_height(heights: Float64Array) -> float:
    """Height of the floor among `heights` (N,) of floor and furniture.

    The lowest level that a tenth of them share.
    """
    ordered = np.sort(heights)
    window = max(1, len(ordered) // 10)
    for start in range(len(ordered) - window + 1):
        if ordered[start + window - 1] - ordered[start] < 0.06:
            return float(np.median(ordered[start : start + window]))
    return float(ordered[0])


def _enclosed_share(rays: RayCaster, polygon: Polygon, floor: float, ceiling: float) -> float:
    """Share of horizontal rays from inside, at three heights, that hit a wall near the outline."""
    centre = deepest_point(polygon)
    directions = horizontal_directions(72, 0.5)
    hits = 0
    limit = polygon.hausdorff_distance(Point(centre)) + 1.0
    for share in (0.35, 0.7, 0.9):
        place = np.array([*centre, floor + share * (ceiling - floor)])
        distance, _ = rays.cast(place, directions)
        hits += int((distance <= limit).sum())
    return hits / (3 * 72)


def inside_points(polygon: Polygon, count: int, margin: float = 0.1) -> Float64Array:
    """About `count` grid points (N, 2) inside a polygon, `margin` off its edge if it is as wide."""
    inner = buffered(polygon, -margin)
    inner = polygon if inner.is_empty else inner
    west, south, east, north = inner.bounds
    step = math.sqrt(max(inner.area, 1e-9) / count)
    xs, ys = np.arange(west + step / 2, east, step), np.arange(south + step / 2, north, step)
    grid = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
    return grid[shapely.contains_xy(inner, grid[:, 0], grid[:, 1])]


def _visible_space(
    rays: RayCaster, eye: Float64Array, low: Float64Array, high: Float64Array
) -> FoundRoom | None:
    """The space visible from a camera, for scenes without level ceilings or complete walls."""
    vertical, _ = rays.cast(np.stack([eye, eye]), np.array([[0.0, 0, -1], [0, 0, 1]]))
    floor = eye[2] - vertical[0] if np.isfinite(vertical[0]) else low[2]
    ceiling = eye[2] + vertical[1] if np.isfinite(vertical[1]) else max(high[2], floor + 2.4)
    directions = horizontal_directions(360)
    # Low rays end at furniture and high ones pass over walls, so the median of several counts.
    heights = {floor + share * min(ceiling - floor, 3.0) for share in (0.3, 0.45, 0.6, 0.75, 0.9)}
    around = [
        rays.cast(np.array([eye[0], eye[1], height]), directions)[0] for height in sorted(heights)
    ]
    distance = np.median(around, axis=0)
    if np.isfinite(distance).mean() < 0.25:
        return None
    box = buffered(shapely.box(low[0], low[1], high[0], high[1]), 0.01)
    far = float(np.linalg.norm(high - low))
    roofed = distance
    if np.isfinite(vertical[1]):
        roofed = _roofed(rays, eye, float(ceiling), directions, distance)
    ring = eye[:2] + np.minimum(roofed, far)[:, None] * directions[:, :2]
    seen = intersection(buffered(Polygon(ring), 0), box)
    if (roofed < distance).any():  # what rays saw of the sides of windows is no part of the room
        inner = buffered(seen, -_JAMB, join_style="mitre")
        seen = intersection(seen, buffered(inner, _JAMB, join_style="mitre"))
    seen = simplified(seen, 0.05)
    parts = [part for part in polygon_parts(seen) if part.distance(Point(eye[:2])) < 0.05]
    if not parts or parts[0].area < MIN_AREA:
        return None
    outline = shapely.geometry.polygon.orient(Polygon(parts[0].exterior))
    points = inside_points(outline, 60)
    down, _ = rays.cast(
        np.column_stack([points, np.full(len(points), eye[2])]), np.array([0.0, 0, -1])
    )
    if np.isfinite(down).any():
        floor = min(floor, _floor_height(eye[2] - down[np.isfinite(down)]))
    return FoundRoom(outline, float(floor), float(ceiling), guessed=True)


def _roofed(
    rays: RayCaster,
    eye: Float64Array,
    ceiling: float,
    directions: Float64Array,
    distances: Float64Array,
) -> Float64Array:
    """Distances (N,) from a camera along level `directions` (N, 3), but no farther than the roof.

    Rays that leave through a window end at the wall around it: where nothing is overhead for
    `_OUTDOORS` metres they are outdoors, and the wall is what stands below the ceiling before that.
    """
    steps = np.arange(_ROOF_STEP, min(_FARTHEST_WALL, float(distances.max())), _ROOF_STEP)
    if not len(steps):
        return distances
    places = eye + steps[:, None, None] * directions  # (M, N, 3)
    overhead, _ = rays.cast(places.reshape(-1, 3), np.array([0.0, 0.0, 1.0]))
    is_open = overhead.reshape(places.shape[:2]) > 2 * (ceiling - eye[2]) + 0.5
    size = round(_OUTDOORS / _ROOF_STEP)
    origin = -(size // 2)  # a window of the filter begins at its step
    outdoors = ndimage.minimum_filter1d(is_open, size, axis=0, mode="nearest", origin=origin)
    outdoors &= steps[:, None] < distances
    first = steps[np.argmax(outdoors, axis=0)]
    ends = np.where(outdoors.any(axis=0), first, distances)
    below = [
        rays.cast(np.array([eye[0], eye[1], ceiling - drop]), directions)[0] for drop in _LINTELS
    ]
    wall = np.max(below, axis=0)
    is_lintel = (ends < distances) & (wall < ends) & (wall > ends - _OUTDOORS)
    return np.where(is_lintel, wall, ends)


def _overlap(first: FoundRoom, second: FoundRoom) -> bool:
    """Return whether two rooms share more than 0.4 of the smaller area, at the same heights."""
    height = min(first.ceiling_z, second.ceiling_z) - max(first.floor_z, second.floor_z)
    if height <= 0.5 or not first.is_near(second, 0.0):
        return False
    shared = intersection(first.floor, second.floor).area
    return shared > 0.4 * min(first.floor.area, second.floor.area)


def _is_same_room(first: FoundRoom, second: FoundRoom) -> bool:
    return _overlap(first, second) and abs(first.ceiling_z - second.ceiling_z) < 0.03


def without_overlaps(rooms: list[FoundRoom]) -> list[FoundRoom]:
    """The rooms without those that overlap one with a larger floor, such as under a bulkhead."""
    kept: list[FoundRoom] = []
    for room in sorted(rooms, key=lambda room: -room.floor.area):
        if not any(_overlap(room, other) for other in kept):
            kept.append(room)
    return kept
