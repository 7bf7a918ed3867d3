"""Rooms and openings of a scene of bare triangles, found by slicing it and by casting rays.

A horizontal cut a little below the ceiling shows the walls and little else: doors are closed
there by their lintels, and furniture seldom reaches so high. What is free in that cut, under a
ceiling and over a floor, is a room. Openings are looked for wall by wall: rays go straight out
on a grid, and where many neighbours leave the building an opening is.
World: metres, Z up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import shapely
from scipy import ndimage
from shapely.geometry import MultiPolygon, Point, Polygon
from shapely.ops import unary_union

from scenes.arrays import BoolArray, Float64Array
from scenes.geometry.directions import fibonacci_sphere
from scenes.geometry.mesh import face_areas
from scenes.reconstruction.orientation import crossings
from scenes.reconstruction.raycast import RayCaster

_MAX_COLUMNS = 250_000  # of rays from below that look for ceilings
MIN_HEIGHT, MAX_HEIGHT = 1.9, 8.0
MIN_AREA = 1.2  # square metres
_SLICES = (0.25, 0.12, 0.06, 0.4)  # metres below the ceiling, tried in this order
_SEAL = 0.03  # gaps in walls up to twice this are closed
_SLIM = 0.35  # free strips narrower than twice this are wall cavities, not rooms
_CELL = 0.05  # grid of the search for openings
_INSET = 0.12  # metres inside the wall where that search starts
_REVEAL = 0.65  # metres a wall may be thick around an opening
MIN_OPENING = 0.08  # square metres
_SUNK = 0.02  # metres behind the wall's face from which something stands in a hole of it
_OPEN_SHARE = 0.2  # of an opening, the rest being frame and bars
_FRAME = 4  # cells that a window's frame may be wide in a hole


@dataclass
class FoundRoom:
    """A room: `floor` counter-clockwise, its heights, and whether it was a guess."""

    floor: Polygon
    floor_z: float
    ceiling_z: float
    guessed: bool = False

    @property
    def centre(self) -> Float64Array:
        """A point well inside, at eye height."""
        point = shapely.maximum_inscribed_circle(self.floor).coords[0]
        return np.array([*point, self.floor_z + 0.55 * (self.ceiling_z - self.floor_z)])

    def holds(self, point: Float64Array, margin: float = 0.0) -> bool:
        """Whether a point (3,) lies inside, or within `margin` metres of it."""
        inside = self.floor_z - margin <= point[2] <= self.ceiling_z + margin
        return bool(inside and self.floor.buffer(margin).contains(Point(point[0], point[1])))


@dataclass
class FoundOpening:
    """An opening to the outside: a planar polygon (N, 3) in the plane of the wall."""

    room: int
    polygon: Float64Array
    normal: Float64Array  # points outdoors
    wall_share: float  # of the wall's area
    overhead: bool = False
    panes: list[str] = field(default_factory=list)
    hidden: bool = False  # found by walks of light, not by looking straight out
    # Points (K, 3) in its plane from which light goes straight out.
    seeds: Float64Array = field(default_factory=lambda: np.empty((0, 3)))


def find_rooms(rays: RayCaster, corners: Float64Array, eye: Float64Array | None) -> list[FoundRoom]:
    """All rooms with a level ceiling; else the space that is seen from `eye`; else nothing.

    `corners` (F, 3, 3) are the triangles that `rays` casts against.
    """
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    step = float(np.clip(np.max(high - low)[None] / 100, 0.2, 2.0)[0])
    columns: list[Float64Array] = []
    if float(np.prod(np.ceil((high - low)[:2] / step))) <= _MAX_COLUMNS:
        xs = np.arange(low[0] + 0.37 * step, high[0], step)
        ys = np.arange(low[1] + 0.41 * step, high[1], step)
        points = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
        columns = crossings(rays, points, low[2], high[2])
    rooms: list[FoundRoom] = []
    for level in _ceiling_levels(columns, step):
        for polygon in _free_below(corners, level):
            room = _confirm(rays, polygon, level)
            if room is not None and not any(_same(room, other) for other in rooms):
                rooms.append(room)
    rooms = _without_lesser(rooms)
    least = 1.0  # metres high, for a space with a camera in it
    if eye is None and not rooms:
        least = MIN_HEIGHT
        eye = np.array([*(0.5 * (low + high))[:2], low[2] + 0.6 * min(high[2] - low[2], 2.5)])
    if eye is not None and not any(room.holds(eye, 0.3) for room in rooms):
        seen = _seen_from(rays, eye, low, high)
        if seen is not None and seen.ceiling_z - seen.floor_z >= least:
            rooms = [room for room in rooms if not _overlap(room, seen)]
            rooms.insert(0, seen)
    return rooms


def find_openings(rays: RayCaster, rooms: list[FoundRoom]) -> list[FoundOpening]:
    """Windows, doors to the outside and missing walls of every room, and skylights."""
    openings = []
    for index, room in enumerate(rooms):
        if not _sees_out(rays, room):
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
            found = _open_parts(rays, origin, along, np.array([0.0, 0, 1]), length, height, outward)
            for outline, share, seeds in found:
                openings.append(FoundOpening(index, outline, outward, share, seeds=seeds))
        west, south, east, north = room.floor.bounds
        origin = np.array([west, south, room.ceiling_z])
        up = np.array([0.0, 0, 1])
        found = _open_parts(
            rays,
            origin,
            np.array([1.0, 0, 0]),
            np.array([0.0, 1, 0]),
            east - west,
            north - south,
            up,
            room.floor,
        )
        openings += [
            FoundOpening(index, outline, up, share, True, seeds=seeds)
            for outline, share, seeds in found
        ]
    return [opening for opening in openings if not _leads_to_room(opening, rooms)]


def _leads_to_room(opening: FoundOpening, rooms: list[FoundRoom]) -> bool:
    """Whether another room, not the outside, lies right behind an opening."""
    middle = opening.polygon.mean(axis=0)
    return any(
        room.holds(middle + depth * opening.normal)
        for depth in (0.15, 0.3, 0.5, 0.8)
        for number, room in enumerate(rooms)
        if number != opening.room
    )


def _sees_out(rays: RayCaster, room: FoundRoom) -> bool:
    """Whether any ray from a few places in the room escapes."""
    inner = room.floor.buffer(-0.3)
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
    for place in places:
        distance, _ = rays.cast(place, directions)
        if np.isinf(distance).any():
            return True
    return False


def _open_parts(
    rays: RayCaster,
    origin: Float64Array,
    u: Float64Array,
    v: Float64Array,
    width: float,
    height: float,
    outward: Float64Array,
    within: Polygon | None = None,
) -> list[tuple[Float64Array, float, Float64Array]]:
    """Outlines (N, 3) of the open parts of a rectangle, their shares of its area, and the points
    (K, 3) in them from which rays get out."""
    columns, rows = max(2, round(width / _CELL)), max(2, round(height / _CELL))
    columns, rows = min(columns, 600), min(rows, 600)
    us = (np.arange(columns) + 0.5) * width / columns
    vs = (np.arange(rows) + 0.5) * height / rows
    grid = origin + us[None, :, None] * u + vs[:, None, None] * v
    flat = grid.reshape(-1, 3)
    distance, _ = rays.cast(flat - _INSET * outward, outward)
    open_cells = (distance > _INSET + _REVEAL).reshape(rows, columns)
    hollow = (distance > _INSET + _SUNK).reshape(rows, columns)
    if within is not None:
        inside = shapely.contains_xy(within, flat[:, 0], flat[:, 1]).reshape(rows, columns)
        open_cells &= inside
    if not open_cells.any():
        return []
    open_cells &= _reaches_sky(rays, grid, open_cells, outward)
    bars = np.ones((3, 3), dtype=bool)  # bridges window bars up to about 10 cm
    padded = np.pad(open_cells, 3)
    joined = ndimage.binary_closing(padded, bars, iterations=2)[3:-3, 3:-3]
    # Up to the edges of the wall's hole: slanting rays get past a frame that stands in it.
    joined |= ndimage.binary_dilation(joined, bars, iterations=_FRAME, mask=hollow | joined)
    if within is not None:
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
            continue  # a slit of one cell: a seam, not an opening
        outline = np.clip(_outline(cells, du, dv), 0.0, [width, height])
        points = origin + outline[:, :1] * u + outline[:, 1:] * v
        parts.append((points, area / (width * height), grid[cells & open_cells]))
    return parts


def _reaches_sky(
    rays: RayCaster, grid: Float64Array, cells: BoolArray, outward: Float64Array
) -> BoolArray:
    """Of the open cells, those from which some of 24 directions outwards hit nothing."""
    fan = fibonacci_sphere(48)
    fan = fan[fan @ outward > 0.05]
    points = grid[cells] + 0.02 * outward
    origins = np.repeat(points, len(fan), axis=0)
    distance, _ = rays.cast(origins, np.tile(fan, (len(points), 1)))
    free = np.isinf(distance).reshape(len(points), len(fan)).any(axis=1)
    found = np.zeros_like(cells)
    found[cells] = free
    return found


def _outline(cells: BoolArray, du: float, dv: float) -> Float64Array:
    """The cells' outline in metres: their bounding rectangle where they nearly fill it, else a
    simplified polygon. Larger by a cell, by which the opening's edge is known, so that nothing
    gets out beside it."""
    rows, columns = np.nonzero(cells)
    low = np.array([columns.min() * du, rows.min() * dv])
    high = np.array([(columns.max() + 1) * du, (rows.max() + 1) * dv])
    if cells.sum() * du * dv >= 0.8 * float(np.prod(high - low)):
        cell = np.array([du, dv])
        low, high = low - cell, high + cell
        return np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    boxes = shapely.box(columns * du, rows * dv, (columns + 1) * du, (rows + 1) * dv)
    shape = unary_union(list(boxes)).buffer(max(du, dv), join_style="mitre")
    if isinstance(shape, MultiPolygon):
        shape = max(shape.geoms, key=lambda part: part.area)
    ring = np.array(Polygon(shape.exterior).simplify(0.06).exterior.coords)[:-1]
    # Anticlockwise in (u, v), as the rectangle is.
    return ring if Polygon(ring).exterior.is_ccw else ring[::-1]


def _ceiling_levels(columns: list[Float64Array], step: float) -> list[float]:
    """Heights of level ceilings with at least a small room's area below them, highest first."""
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


def _free_below(corners: Float64Array, level: float) -> list[Polygon]:
    """The free areas in a cut below the ceiling at height `level`, bounded by that ceiling."""
    cover = _cover(corners, level)
    if cover.is_empty:
        return []
    polygons: list[Polygon] = []
    for drop in _SLICES[:3]:
        # Each by itself, then together: to buffer their union takes a hundred times as long.
        lines = shapely.linestrings(slice_segments(corners, level - drop))
        walls = shapely.union_all(shapely.buffer(lines, _SEAL, cap_style="square"))
        free = cover.difference(walls)
        for part in _parts(free):
            grown = part.buffer(-_SLIM).buffer(_SLIM + _SEAL, join_style="mitre", mitre_limit=2.0)
            within = part.buffer(_SEAL, join_style="mitre").intersection(cover)
            for piece in _parts(grown.intersection(within)):
                outline = Polygon(piece.exterior).simplify(0.03)
                if outline.area >= MIN_AREA and outline.is_valid:
                    polygons.append(shapely.geometry.polygon.orient(outline))
        if polygons:
            break
    return polygons


def slice_segments(corners: Float64Array, height: float) -> Float64Array:
    """Where the plane z = `height` cuts the triangles: segments (N, 2, 2) in x and y."""
    # Columns, not `min(axis=1)`: that takes ten times as long on rows of three.
    first, second, third = corners[:, 0, 2], corners[:, 1, 2], corners[:, 2, 2]
    lowest = np.minimum(np.minimum(first, second), third)
    highest = np.maximum(np.maximum(first, second), third)
    cut = corners[(lowest <= height) & (highest >= height)]
    z = cut[:, :, 2] - height
    z = np.where(z == 0, 1e-9, z)
    mixed = (z.min(axis=1) < 0) & (z.max(axis=1) > 0)
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


def _cover(corners: Float64Array, level: float) -> Polygon:
    """The plan of all level triangles at the ceiling's height."""
    _, normals = face_areas(corners)
    z = corners[:, :, 2]
    near = (np.abs(normals[:, 2]) > 0.95) & (np.abs(z - level).max(axis=1) < 0.06)
    triangles = corners[near][:, :, :2]
    if not len(triangles):
        return Polygon()
    # Sealed: ceilings are often made of tiles with seams.
    merged = unary_union(shapely.polygons(triangles).tolist())
    return merged.buffer(_SEAL, join_style="mitre").buffer(-_SEAL, join_style="mitre")


def _confirm(rays: RayCaster, polygon: Polygon, level: float) -> FoundRoom | None:
    """A free area as a room if it has a floor and walls; else None."""
    points = _inside_points(polygon, 160)
    if not len(points):
        return None
    heights = np.full(len(points), level - 0.3)
    origins = np.column_stack([points, heights])
    down, _ = rays.cast(origins, np.array([0.0, 0, -1]))
    up, _ = rays.cast(origins, np.array([0.0, 0, 1]))
    if np.isfinite(down).mean() < 0.8 or np.isfinite(up).mean() < 0.8:
        return None
    below = level - 0.3 - down[np.isfinite(down)]
    floor = _lowest_common(below)
    if not MIN_HEIGHT <= level - floor <= MAX_HEIGHT:
        return None
    if _enclosure(rays, polygon, floor, level) < 0.45:
        return None
    return FoundRoom(polygon, floor, level)


def _lowest_common(heights: Float64Array) -> float:
    """The floor among heights that are partly furniture: the lowest level that a tenth share."""
    ordered = np.sort(heights)
    window = max(1, len(ordered) // 10)
    for start in range(len(ordered) - window + 1):
        if ordered[start + window - 1] - ordered[start] < 0.06:
            return float(np.median(ordered[start : start + window]))
    return float(ordered[0])


def _enclosure(rays: RayCaster, polygon: Polygon, floor: float, ceiling: float) -> float:
    """The share of level rays, from inside at three heights, that end soon behind the outline."""
    centre = shapely.maximum_inscribed_circle(polygon).coords[0]
    angle = 2 * np.pi * (np.arange(72) + 0.5) / 72
    ways = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(72)])
    hits = 0
    reach = polygon.hausdorff_distance(Point(centre)) + 1.0
    for share in (0.35, 0.7, 0.9):
        place = np.array([*centre, floor + share * (ceiling - floor)])
        distance, _ = rays.cast(place, ways)
        hits += int((distance <= reach).sum())
    return hits / (3 * 72)


def _inside_points(polygon: Polygon, count: int) -> Float64Array:
    """About `count` points on a grid inside the polygon, kept off its edge."""
    inner = polygon.buffer(-0.1)
    inner = polygon if inner.is_empty else inner
    west, south, east, north = inner.bounds
    step = math.sqrt(max(inner.area, 1e-9) / count)
    xs, ys = np.arange(west + step / 2, east, step), np.arange(south + step / 2, north, step)
    grid = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
    return grid[shapely.contains_xy(inner, grid[:, 0], grid[:, 1])]


def _seen_from(
    rays: RayCaster, eye: Float64Array, low: Float64Array, high: Float64Array
) -> FoundRoom | None:
    """The space around a camera, for scenes without a level ceiling or proper walls."""
    vertical, _ = rays.cast(np.stack([eye, eye]), np.array([[0.0, 0, -1], [0, 0, 1]]))
    floor = eye[2] - vertical[0] if np.isfinite(vertical[0]) else low[2]
    ceiling = eye[2] + vertical[1] if np.isfinite(vertical[1]) else max(high[2], floor + 2.4)
    angle = 2 * np.pi * np.arange(360) / 360
    ways = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(360)])
    # Low rays end at furniture, high ones pass over walls: the median of several heights does not.
    heights = {floor + share * min(ceiling - floor, 3.0) for share in (0.3, 0.45, 0.6, 0.75, 0.9)}
    around = [rays.cast(np.array([eye[0], eye[1], height]), ways)[0] for height in sorted(heights)]
    distance = np.median(around, axis=0)
    if np.isfinite(distance).mean() < 0.25:
        return None
    box = shapely.box(low[0], low[1], high[0], high[1]).buffer(0.01)
    far = float(np.linalg.norm(high - low))
    ring = eye[:2] + np.minimum(distance, far)[:, None] * ways[:, :2]
    seen = Polygon(ring).buffer(0).intersection(box).simplify(0.05)
    parts = [part for part in _parts(seen) if part.buffer(0.05).contains(Point(eye[:2]))]
    if not parts or parts[0].area < MIN_AREA:
        return None
    outline = shapely.geometry.polygon.orient(Polygon(parts[0].exterior))
    points = _inside_points(outline, 60)
    down, _ = rays.cast(
        np.column_stack([points, np.full(len(points), eye[2])]), np.array([0.0, 0, -1])
    )
    if np.isfinite(down).any():
        floor = min(floor, _lowest_common(eye[2] - down[np.isfinite(down)]))
    return FoundRoom(outline, float(floor), float(ceiling), guessed=True)


def _parts(shape: shapely.Geometry) -> list[Polygon]:
    found = [part for part in shapely.get_parts(shape).tolist() if isinstance(part, Polygon)]
    return [part for part in found if not part.is_empty]


def _overlap(first: FoundRoom, second: FoundRoom) -> bool:
    """Whether two rooms share a good part of the smaller one's space."""
    height = min(first.ceiling_z, second.ceiling_z) - max(first.floor_z, second.floor_z)
    if height <= 0.5:
        return False
    shared = first.floor.intersection(second.floor).area
    return shared > 0.4 * min(first.floor.area, second.floor.area)


def _same(first: FoundRoom, second: FoundRoom) -> bool:
    return _overlap(first, second) and abs(first.ceiling_z - second.ceiling_z) < 0.03


def _without_lesser(rooms: list[FoundRoom]) -> list[FoundRoom]:
    """Of rooms that overlap (a bulkhead, a lowered ceiling) the one with the larger floor."""
    kept: list[FoundRoom] = []
    for room in sorted(rooms, key=lambda room: -room.floor.area):
        if not any(_overlap(room, other) for other in kept):
            kept.append(room)
    return kept
