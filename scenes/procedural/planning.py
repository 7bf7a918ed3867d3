"""Drawing of floor plans: rooms, walls, doors and windows of one storey.

A rectangle is split recursively in proportion to the rooms' areas; then a room may lose a corner
to the outside or to a bathroom, so that not all outlines and rooms are rectangles. A hall is a
corridor between two rows of rooms, whose end may belong to the room beside it. Draws with
uninhabitable rooms (too narrow, unreachable, no outer wall) are rejected. Last come what stands in
a drawn plan: beams, stairs, a sloping roof, niches.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace

import numpy as np
import shapely
from shapely import transform
from shapely.geometry import LineString, MultiPolygon, Point, Polygon, box
from shapely.geometry.polygon import orient

from pbrnet.scenes.checked import build
from pbrnet.scenes.contract import Point2
from pbrnet.scenes.errors import PbrnetError
from pbrnet.scenes.files import data_beside
from pbrnet.scenes.geometry.regions import (
    buffered,
    difference,
    intersection,
    on_grid,
    simplified,
    union,
)
from pbrnet.scenes.procedural.niches import draw_niches
from pbrnet.scenes.procedural.plan import (
    LEAST_LINTEL,
    STEP,
    WINDOWLESS,
    Beam,
    Opening,
    OpeningKind,
    Plan,
    PlanRoom,
    RoomType,
    Stairs,
    WallEdge,
)
from pbrnet.scenes.procedural.roof import draw_roof
from pbrnet.scenes.seeds import Draw

GRID = 0.05  # metres; cell boundaries lie on this grid
MAX_DRAWS = 600  # an accepted plan needs a few dozen draws at most


@dataclass(frozen=True)
class _Rules:
    """The tables of `planning.yaml`."""

    sizes: dict[RoomType, tuple[float, float, float]]
    longest: dict[RoomType, float]
    programmes: dict[str, tuple[tuple[float, tuple[RoomType, ...]], ...]]
    door_cost: dict[str, float]
    hall_cost: float
    through_cost: dict[RoomType, float]
    hubs: tuple[RoomType, ...]


_RULES = build(_Rules, data_beside(__file__))
SIZES = _RULES.sizes
_DOOR_COST = {frozenset(pair.split()): cost for pair, cost in _RULES.door_cost.items()}
_Stretch = tuple[WallEdge, float, float]  # of a wall, from one place along it to another


class PlanError(PbrnetError):
    """No floor plan was found for a seed."""


def make_plan(rng: Draw, rooms_min: int, rooms_max: int) -> Plan:
    """Draw a floor plan of `rooms_min` to `rooms_max` rooms (1-6).

    Raises `PlanError` if every draw is rejected.
    """
    count = rng.whole(rooms_min, rooms_max + 1)
    programmes = _RULES.programmes[str(count)]
    weights = np.array([weight for weight, _ in programmes])
    programme = rng.weighted(programmes, weights / weights.sum())[1]
    partition = rng.pick([0.12, 0.14])
    outer = rng.pick([0.26, 0.30, 0.36, 0.40])
    height = rng.pick([2.4, 2.5, 2.55, 2.6, 2.7, 2.85])
    ground = rng.weighted([-0.15, -0.3, -0.45, -3.2, -6.1], [0.3, 0.25, 0.15, 0.2, 0.1])
    for _ in range(MAX_DRAWS):
        cells = _draw_cells(rng, programme, partition)
        if cells is None or not all(map(_may_be_habitable, cells, programme)):
            continue
        rooms, inner = _net_rooms(cells, programme, partition)
        if not all(map(_habitable, rooms)):
            continue
        outline = orient(simplified(buffered(inner, outer, join_style="mitre", mitre_limit=10), 0))
        if outline.interiors or _closes_recess(inner, outer):
            continue
        shell = _Shell(difference(outline, inner), outline, outer)
        openings = _draw_openings(rng, rooms, shell, partition, height)
        if openings is None:
            continue
        beams = _draw_beams(rng, rooms, height)
        plan = Plan(
            rooms=tuple(rooms),
            openings=tuple(openings),
            inner=_ring(inner),
            outline=_ring(outline),
            outer_thickness=shell.thickness,
            partition=partition,
            height=height,
            ground=ground,
            beams=tuple(beams),
            stairs=None if beams else _draw_stairs(rng, rooms, openings, height),
        )
        return draw_niches(rng, draw_roof(rng, plan))
    raise PlanError(
        f"no floor plan for rooms {', '.join(programme)} within {MAX_DRAWS} draws; use another seed"
    )


def _draw_beams(rng: Draw, rooms: list[PlanRoom], height: float) -> list[Beam]:
    """Beams of equal spacing across the dry rooms of one high home in three."""
    drawn = rng.random()
    spacing, wide = rng.between(0.75, 1.2), rng.between(0.1, 0.18)
    depth = rng.between(0.1, LEAST_LINTEL - 0.01)
    if height < 2.5 or drawn > 0.33:
        return []
    beams = []
    for room in rooms:
        if room.type not in ("living", "dining", "bedroom", "study"):
            continue
        x0, y0, x1, y1 = room.shape.bounds
        along_x = x1 - x0 < y1 - y0  # across the shorter side
        first, last = (y0, y1) if along_x else (x0, x1)
        count = int((last - first) / spacing)
        for k in range(count):
            middle = first + (last - first) * (k + 0.5) / count
            a, b = middle - wide / 2, middle + wide / 2
            strip = box(x0, a, x1, b) if along_x else box(a, y0, b, y1)
            within = intersection(strip, room.shape)
            for part in getattr(within, "geoms", [within]):
                # Not where a wall of an L-shaped room runs within the beam.
                is_polygon = part.geom_type == "Polygon"
                if is_polygon and part.area > 0.999 * box(*part.bounds).area > 0.05:
                    low, high = part.bounds[:2], part.bounds[2:]
                    beams.append(Beam(room.id, _rounded(low), _rounded(high), depth))
    return beams


def _draw_stairs(
    rng: Draw, rooms: list[PlanRoom], openings: list[Opening], height: float
) -> Stairs | None:
    """Stairs in the living room of one home in three, if a wall has place for them."""
    drawn = rng.random()
    going, width = rng.between(0.22, 0.25), rng.between(0.8, 0.9)
    length = (round(height / STEP) - 1) * going
    for room in rooms:
        if drawn > 0.33 or room.type != "living" or room.shape.area < 20:
            continue
        ways = [
            one.edge_in(room.id).strip(-0.1, one.width + 0.1, 0, 0.3 if one.kind == "window" else 1)
            for one in openings
            if room.id in one.rooms
        ]
        for edge in rng.shuffled(room.edges):
            for begin in (0.0, edge.length - length):  # the upper end is in a corner
                stairs = Stairs(room.id, edge, begin, begin + length, width, begin == 0.0)
                near, far = stairs.foot
                whole = edge.strip(min(begin, near), max(begin + length, far), 0.0, width + 0.05)
                if buffered(room.shape, 1e-3, join_style="mitre").covers(whole) and not any(
                    whole.intersects(way) for way in ways
                ):
                    return stairs
    return None


def _snap(value: float) -> float:
    return round(round(value / GRID) * GRID, 6)


def _ring(polygon: Polygon) -> tuple[Point2, ...]:
    points = shapely.get_coordinates(orient(polygon).exterior)[:-1]
    return tuple((round(float(x), 6), round(float(y), 6)) for x, y in points)


def _draw_cells(
    rng: Draw, programme: tuple[RoomType, ...], partition: float
) -> list[Polygon] | None:
    """Gross cells of the rooms, in the programme's order; they tile the interior."""
    areas = [rng.between(*SIZES[kind][:2]) for kind in programme]
    if "hall" in programme:
        return _corridor_cells(rng, programme, areas, partition)
    carved = None
    if "bathroom" in programme and len(programme) >= 2 and rng.chance(0.45):
        carved = programme.index("bathroom")
    sliced = [index for index in range(len(programme)) if index != carved]
    # The host room loses the area of the bathroom that is carved from it: start larger.
    host = max(sliced, key=lambda index: areas[index])
    if carved is not None:
        areas[host] += areas[carved]
    total = sum(areas[index] for index in sliced)
    aspect = rng.between(1.0, 1.5 if len(sliced) < 3 else 1.75)
    width = _snap(math.sqrt(total * aspect))
    depth = _snap(total / width)
    if rng.chance(0.5):
        width, depth = depth, width
    order = rng.shuffled(sliced)
    cells: dict[int, Polygon] = {}
    _slice(rng, (0.0, 0.0, width, depth), order, areas, cells)
    if carved is not None:
        pair = _carve(rng, cells[host], areas[carved])
        if pair is None:
            return None
        cells[host], cells[carved] = pair
    if rng.chance(0.55):
        _notch(rng, cells, partition)
    result = [cells[index] for index in range(len(programme))]
    return result if all(cell.geom_type == "Polygon" for cell in result) else None


def _corridor_cells(
    rng: Draw, programme: tuple[RoomType, ...], areas: list[float], partition: float
) -> list[Polygon] | None:
    """Gross cells of two rows of rooms with a corridor between them, in the programme's order."""
    hall = programme.index("hall")
    order = [k for k in rng.shuffled(range(len(programme))) if k != hall]
    rows = order[: (len(order) + 1) // 2], order[(len(order) + 1) // 2 :]
    total = sum(areas[index] for index in order)
    width = _snap(math.sqrt(total * rng.between(1.1, 1.7)))
    wide = _snap(rng.between(1.2, 1.75) + partition)
    cells: dict[int, Polygon] = {}
    first = _snap(sum(areas[index] for index in rows[0]) / width)
    second = _snap(sum(areas[index] for index in rows[1]) / width)
    _slice_row((0.0, first), width, rows[0], areas, cells)
    _slice_row((first + wide, first + wide + second), width, rows[1], areas, cells)
    end = width
    row = rows[rng.whole(2)]
    last = max(row, key=lambda index: cells[index].bounds[2])
    x0, _, x1, _ = cells[last].bounds
    if rng.chance(0.65):  # a room takes the end of the corridor and becomes L-shaped
        end = _snap(rng.between(x0 + 1.45, max(x0 + 1.5, x1 - 0.9)))
        tail = box(end, first, width, first + wide)
        cells[last] = union([cells[last], tail])
    cells[hall] = box(0.0, first, end, first + wide)
    if rng.chance(0.5):
        cells = {index: transform(cell, _swapped) for index, cell in cells.items()}
    return [cells[index] for index in range(len(programme))]


def _swapped(points: np.ndarray) -> np.ndarray:
    return points[:, ::-1]


def _slice_row(
    between: tuple[float, float],
    width: float,
    row: list[int],
    areas: list[float],
    cells: dict[int, Polygon],
) -> None:
    """Split a row of rooms between two values of y by area."""
    total = sum(areas[index] for index in row)
    x = 0.0
    for position, index in enumerate(row):
        end = width if position == len(row) - 1 else _snap(x + width * areas[index] / total)
        cells[index] = box(x, between[0], end, between[1])
        x = end


def _slice(
    rng: Draw,
    rect: tuple[float, float, float, float],
    order: list[int],
    areas: list[float],
    cells: dict[int, Polygon],
) -> None:
    """Split `rect` (x0, y0, x1, y1) recursively by area into one rectangle per room."""
    x0, y0, x1, y1 = rect
    if len(order) == 1:
        cells[order[0]] = box(x0, y0, x1, y1)
        return
    cut = rng.whole(1, len(order))
    if len(order) > 3:  # balanced splits give better proportions
        cut = len(order) // 2
    share = sum(areas[index] for index in order[:cut]) / sum(areas[index] for index in order)
    if (x1 - x0) * rng.between(0.8, 1.25) > (y1 - y0):
        middle = _snap(x0 + share * (x1 - x0))
        first, second = (x0, y0, middle, y1), (middle, y0, x1, y1)
    else:
        middle = _snap(y0 + share * (y1 - y0))
        first, second = (x0, y0, x1, middle), (x0, middle, x1, y1)
    _slice(rng, first, order[:cut], areas, cells)
    _slice(rng, second, order[cut:], areas, cells)


def _corner_box(
    bounds: tuple[float, float, float, float], corner: int, width: float, depth: float
) -> tuple[float, float, float, float]:
    x0, y0, x1, y1 = bounds
    left, low = corner in (0, 3), corner in (0, 1)
    return (
        x0 if left else x1 - width,
        y0 if low else y1 - depth,
        x0 + width if left else x1,
        y0 + depth if low else y1,
    )


def _carve(rng: Draw, host: Polygon, area: float) -> tuple[Polygon, Polygon] | None:
    """Split a rectangle into an L-shaped cell and the cell in its corner."""
    x0, y0, x1, y1 = host.bounds
    ratio = rng.between(0.7, 1.45)
    width, depth = _snap(math.sqrt(area * ratio)), _snap(math.sqrt(area / ratio))
    if x1 - x0 - width < 2.2 or y1 - y0 - depth < 2.2:
        return None
    part = box(*_corner_box((x0, y0, x1, y1), rng.whole(4), width, depth))
    return difference(host, part), part


def _notch(rng: Draw, cells: dict[int, Polygon], partition: float) -> None:
    """Remove a corner of a large rectangular room, for an L, T or U outline."""
    whole = union(list(cells.values()))
    options = []
    for index, cell in sorted(cells.items()):
        x0, y0, x1, y1 = cell.bounds
        if len(cell.exterior.coords) != 5 or min(x1 - x0, y1 - y0) < 3.9:
            continue
        for corner in range(4):
            probe = box(*_corner_box(cell.bounds, corner, 0.2, 0.2)).centroid
            point = Point(x0 if corner in (0, 3) else x1, y0 if corner in (0, 1) else y1)
            if whole.boundary.distance(point) < 1e-6 and cell.contains(probe):
                options.append((index, corner))
    if not options:
        return
    index, corner = rng.pick(options)
    x0, y0, x1, y1 = cells[index].bounds
    width = _snap(rng.between(1.3, max(1.35, min(3.0, x1 - x0 - 2.4))))
    depth = _snap(rng.between(1.0, max(1.05, min(2.6, y1 - y0 - 2.4))))
    notch = box(*_corner_box((x0, y0, x1, y1), corner, width, depth))
    # Cut half a partition from the neighbours too: their walls continue in one plane where
    # they become outer walls.
    grown = intersection(
        buffered(notch, partition / 2, join_style="mitre"),
        notch.union(difference(whole, cells[index])),
    )
    for other in sorted(cells):
        cut = notch if other == index else grown
        cells[other] = difference(cells[other], cut)


def _net_rooms(
    cells: list[Polygon], programme: tuple[RoomType, ...], partition: float
) -> tuple[list[PlanRoom], Polygon]:
    """Net rooms without the partition walls, and the interior of the outer walls."""
    inner = union(cells)
    lines = [
        intersection(first, second)
        for first, second in itertools.combinations(cells, 2)
        if first.distance(second) < 1e-9
    ]
    straight = [line for line in lines if line.length > 1e-6]
    walls = union(
        [buffered(line, partition / 2, cap_style="square", join_style="mitre") for line in straight]
    )
    rooms = []
    inner = orient(simplified(_largest(inner), 0))
    for index, (cell, kind) in enumerate(zip(cells, programme, strict=True)):
        net = _largest(intersection(difference(cell, walls), inner))
        points = _ring(simplified(on_grid(net, 1e-4), 0))
        edges = []
        for start, end in zip(points, points[1:] + points[:1], strict=True):
            middle = LineString([start, end]).interpolate(0.5, normalized=True)
            edges.append(WallEdge(start, end, bool(inner.boundary.distance(middle) < 1e-3)))
        rooms.append(PlanRoom(f"room-{index}", kind, points, tuple(edges)))
    return rooms, inner


def _largest(shape: Polygon | MultiPolygon) -> Polygon:
    if shape.geom_type == "Polygon":
        return shape
    return max(shape.geoms, key=lambda part: part.area)


def _may_be_habitable(cell: Polygon, kind: RoomType) -> bool:
    """Quick test on the gross cell: False if its net room cannot be habitable."""
    low, _, narrow = SIZES[kind]
    x0, y0, x1, y1 = cell.bounds
    return bool(cell.area >= 0.75 * low and min(x1 - x0, y1 - y0) >= narrow)


def _habitable(room: PlanRoom) -> bool:
    low, _, narrow = SIZES[room.type]
    shape = room.shape
    if shape.is_empty or shape.area < 0.75 * low or shape.area > 60:
        return False
    x0, y0, x1, y1 = shape.bounds
    if min(x1 - x0, y1 - y0) < narrow:
        return False
    if max(x1 - x0, y1 - y0) > _RULES.longest.get(room.type, 3.0) * min(x1 - x0, y1 - y0):
        return False
    if any(edge.length < 0.25 for edge in room.edges):
        return False
    # Morphological opening with a square: it removes arms of an L that are too narrow.
    half_width = 0.5 * min(narrow, 1.5) - 0.02
    core = buffered(shape, -half_width, join_style="mitre")
    if core.geom_type != "Polygon" or core.is_empty:
        return False
    opened = buffered(core, half_width, join_style="mitre")
    return bool(opened.area > 0.97 * shape.area)


def _closes_recess(inner: Polygon, outer: float) -> bool:
    """Return True if the outer walls would close a recess of the outline, or nearly so."""
    grown = buffered(inner, outer + 0.3, join_style="mitre", mitre_limit=10)
    return len(grown.interiors) > 0 or simplified(grown, 0).exterior.coords.__len__() != len(
        inner.exterior.coords
    )


@dataclass
class _Shell:
    """Outer walls of a home: their area, outline and thickness, and what openings take of them."""

    walls: Polygon
    outline: Polygon
    thickness: float
    taken: list[Polygon] = field(default_factory=list)

    def is_solid(self, edge: WallEdge, s0: float, s1: float) -> bool:
        """True if the wall around an opening [s0, s1] is solid and borders the outdoors."""
        hole = edge.strip(s0 - 0.12, s1 + 0.12, -0.001, -self.thickness + 0.001)
        return buffered(self.walls, 1e-6).covers(hole) and all(
            self.outline.exterior.distance(Point(edge.at(s, -self.thickness))) < 1e-3
            for s in (s0, 0.5 * (s0 + s1), s1)
        )

    def has_place(self, edge: WallEdge, s0: float, s1: float, strip: Polygon) -> bool:
        """True if an opening may be at [s0, s1], with `strip` free of other openings."""
        return self.is_solid(edge, s0, s1) and not any(map(strip.intersects, self.taken))


def _draw_openings(
    rng: Draw, rooms: list[PlanRoom], shell: _Shell, partition: float, height: float
) -> list[Opening] | None:
    doors = _draw_doors(rng, rooms, partition, height)
    if doors is None:
        return None
    shell.taken += [buffered(door.footprint, 0.15, join_style="mitre") for door in doors]
    entrance = _draw_entrance(rng, rooms, shell)
    if entrance is None:
        return None
    shell.taken.append(buffered(entrance.footprint, 0.15, join_style="mitre"))
    windows = _draw_windows(rng, rooms, shell, height)
    with_window = {window.rooms[0] for window in windows}
    if any(room.id not in with_window and room.type not in WINDOWLESS for room in rooms):
        return None
    if len(rooms) == 1 and not windows:
        return None
    return [*doors, entrance, *windows]


def _shared_walls(
    first: PlanRoom, second: PlanRoom, partition: float
) -> list[tuple[WallEdge, float, float]]:
    """Stretches of wall between two rooms: (edge of `first`, s0, s1)."""
    found = []
    for a in first.edges:
        for b in second.edges:
            if a.inward[0] * b.inward[0] + a.inward[1] * b.inward[1] > -0.99:
                continue
            gap = -a.coordinates(b.start)[1]
            if abs(gap - partition) > 1e-3:
                continue
            ends = sorted(a.coordinates(point)[0] for point in (b.start, b.end))
            s0, s1 = max(0.0, ends[0]), min(a.length, ends[1])
            if s1 - s0 > 0.5:
                found.append((a, s0, s1))
    return found


def _draw_doors(
    rng: Draw, rooms: list[PlanRoom], partition: float, height: float
) -> list[Opening] | None:
    """Doors that join all rooms, and some more; None if a room needs a bathroom passage."""
    stretches: dict[tuple[int, int], list[_Stretch]] = {}
    for i, j in itertools.combinations(range(len(rooms)), 2):
        shared = [
            item for item in _shared_walls(rooms[i], rooms[j], partition) if item[2] - item[1] > 1.2
        ]
        if shared:
            stretches[i, j] = shared
    pairs = _door_tree(rooms, sorted(stretches))
    if pairs is None:
        return None
    extra = [
        (i, j)
        for i, j in sorted(stretches)
        if (i, j) not in pairs
        and (j, i) not in pairs
        and _DOOR_COST.get(frozenset({rooms[i].type, rooms[j].type}), 9) < 1.0
    ]
    pairs += [pair for pair in extra if rng.chance(0.6)]
    doors = []
    for number, (known, fresh) in enumerate(pairs):
        first, second = sorted((known, fresh))
        longest = max(stretches[first, second], key=lambda item: item[2] - item[1])
        joined = rooms[first], rooms[second]
        door = _draw_door(rng, f"door-{number}", joined, longest, partition, height)
        doors.append(replace(door, swing=rooms[fresh].id, angle=draw_angle(rng)))
    return doors


def _door_tree(rooms: list[PlanRoom], walls: list[tuple[int, int]]) -> list[tuple[int, int]] | None:
    """Cheapest tree of doors, grown from the hub through shared `walls` (pairs of rooms).

    Each door is (room reached before, new room). None if a room needs a bathroom passage.
    """
    hub = min(range(len(rooms)), key=lambda index: _RULES.hubs.index(rooms[index].type))
    reached, pairs = [hub], []
    while len(reached) < len(rooms):
        best: tuple[float, int, int] | None = None
        for i, j in walls:
            if (i in reached) == (j in reached):
                continue
            known, fresh = (i, j) if i in reached else (j, i)
            kinds = frozenset({rooms[known].type, rooms[fresh].type})
            cost = _RULES.hall_cost if "hall" in kinds else _DOOR_COST.get(kinds, 4.0)
            if known != hub:
                cost += _RULES.through_cost.get(rooms[known].type, 0.0)
            if best is None or cost < best[0]:
                best = (cost, known, fresh)
        if best is None or best[0] >= 50:
            return None
        pairs.append(best[1:])
        reached.append(best[2])
    return pairs


def _draw_door(
    rng: Draw,
    name: str,
    rooms: tuple[PlanRoom, PlanRoom],
    stretch: _Stretch,
    partition: float,
    height: float,
) -> Opening:
    """Draw a door, an archway or a wide opening in the stretch of wall that two rooms share."""
    edge, s0, s1 = stretch
    open_plan = {room.type for room in rooms} <= {"living", "dining", "kitchen"} and s1 - s0 > 2.0
    drawn = rng.random() if open_plan else 1.0
    kind: OpeningKind = "open" if drawn < 0.4 else ("archway" if drawn < 0.7 else "door")
    if kind == "open":
        width = _snap(s1 - s0 - 2 * rng.between(0.13, 0.4))
        top = height - rng.between(LEAST_LINTEL, 0.3)
    elif kind == "archway":
        width = _snap(min(rng.between(1.2, 2.4), s1 - s0 - 0.5))
        top = rng.pick((2.1, 2.2, 2.25))
    else:
        width = rng.pick((0.8, 0.85, 0.9))
        top = 2.05
    # Doors are mostly near a corner, which leaves long walls for furniture.
    low = s0 + 0.13
    high = max(low, s1 - 0.13 - width)  # a rounded width may leave a little less
    place = rng.weighted((low, high, rng.between(low, high)), (0.4, 0.4, 0.2))
    if kind == "archway":
        place = rng.between(low, high)
    elif kind == "open":
        place = 0.5 * (s0 + s1 - width)
    return Opening(
        id=name,
        kind=kind,
        start=_rounded(edge.at(place)),
        end=_rounded(edge.at(place + width)),
        thickness=partition,
        z0=0.0,
        z1=top,
        rooms=(rooms[0].id, rooms[1].id),
        hinge_at_start=bool(place - s0 < s1 - place - width),
    )


def draw_angle(rng: Draw) -> float:
    """Draw the opening angle of a door in degrees: closed, ajar or wide open."""
    kind = rng.random()
    if kind < 0.3:
        return 0.0
    return rng.between(12, 60) if kind < 0.6 else rng.between(80, 92)


def _rounded(point: Point2) -> Point2:
    return (round(point[0], 4), round(point[1], 4))


def _draw_entrance(rng: Draw, rooms: list[PlanRoom], shell: _Shell) -> Opening | None:
    order = sorted(rooms, key=lambda room: _RULES.hubs.index(room.type))
    for room in order:
        least = 1.3 if room.type == "hall" else 1.5
        edges = [edge for edge in room.edges if edge.outer and edge.length > least]
        for edge in rng.shuffled(edges):
            width = rng.pick([0.9, 0.95, 1.0])
            places = [0.2, edge.length - 0.2 - width]
            if rng.chance(0.5):
                places.reverse()
            places.append(0.5 * (edge.length - width))
            for place in places:
                strip = edge.strip(place, place + width, 0.7, -shell.thickness)
                if not shell.has_place(edge, place, place + width, strip):
                    continue
                return Opening(
                    id="entrance",
                    kind="entrance",
                    start=_rounded(edge.at(place)),
                    end=_rounded(edge.at(place + width)),
                    thickness=shell.thickness,
                    z0=0.0,
                    z1=2.1,
                    rooms=(room.id,),
                    hinge_at_start=place < 0.5 * edge.length,
                    swing=room.id,
                )
    return None


def _draw_windows(rng: Draw, rooms: list[PlanRoom], shell: _Shell, height: float) -> list[Opening]:
    head = min(rng.pick([2.1, 2.2, 2.3]), height - 0.18)
    window_scale = rng.between(0.95, 1.3)  # of all windows of the home
    windows: list[Opening] = []
    patio_wanted = rng.chance(0.5)
    for room in rooms:
        edges = sorted(
            (edge for edge in room.edges if edge.outer and edge.length > 1.1),
            key=lambda edge: -edge.length,
        )
        wanted = 1 if room.type in WINDOWLESS else max(1, round(room.shape.area / 9.0))
        found = 0
        for edge in edges:
            if found >= wanted:
                break
            kind, width, sill, top = _window_size(rng, room.type, window_scale, head)
            if room.type == "living" and patio_wanted and not found and edge.length > 3:
                kind, width, sill, top = "patio", rng.between(1.5, 2.4), 0.0, head
            width = _snap(min(width, edge.length - 0.5))
            slots = 2 if edge.length > 2 * width + 1.6 and wanted - found >= 2 else 1
            for slot in range(slots):
                place = edge.length * (slot + 0.5) / slots - width / 2
                place += rng.between(-0.15, 0.15) * (edge.length / slots - width)
                if not shell.is_solid(edge, place, place + width):
                    place = edge.length * (slot + 0.5) / slots - width / 2
                strip = edge.strip(place - 0.1, place + width + 0.1, 0.0, -shell.thickness)
                if not shell.has_place(edge, place, place + width, strip):
                    continue
                shell.taken.append(strip)
                windows.append(
                    Opening(
                        id=f"window-{len(windows)}",
                        kind="patio" if kind == "patio" else "window",
                        start=_rounded(edge.at(place)),
                        end=_rounded(edge.at(place + width)),
                        thickness=shell.thickness,
                        z0=sill,
                        z1=top,
                        rooms=(room.id,),
                    )
                )
                found += 1
                kind = "window" if kind == "patio" else kind
                if slots == 2 and slot == 0 and windows[-1].kind == "patio":
                    break
    return windows


def _window_size(
    rng: Draw, room: RoomType, window_scale: float, head: float
) -> tuple[str, float, float, float]:
    """Draw (kind, width, sill height, head height) of a window for a room type, metres."""
    if room == "bathroom":
        return "window", _snap(rng.between(0.7, 1.1)), 1.25, head
    if room == "kitchen":
        return "window", _snap(window_scale * rng.between(1.1, 1.7)), 1.1, head
    if room in ("living", "dining"):
        sill = rng.pick([0.4, 0.55, 0.75])
        return "window", _snap(window_scale * rng.between(1.6, 2.5)), sill, head
    sill = rng.pick([0.75, 0.85])
    return "window", _snap(window_scale * rng.between(1.3, 1.9)), sill, head
