"""Openings of a room that rays along a wall's normal do not find.

Input: the light-stopping triangles, the rooms and the openings found so far. Output: further
openings to the outside, such as behind a door that stands ajar, around a corner, or up a
fireplace without a flue.

Random walks (`light_walks`) start in every room. Cross-sections of the building at many depths,
parallel to walls, floors and ceilings, are searched for enclosed holes that many escaped walks
pass through. The smallest hole that explains nearly the most walks becomes an opening; the walks
through it are set aside, and the search repeats until the rest looks like mere cracks. Open
rooms have thousands of sections without such a hole, so the search also ends when it has
computed a certain number of them. World: metres, Z up.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise

import numpy as np
import shapely
from shapely.geometry import Polygon

from pbrnet.scenes.arrays import Float64Array, Int64Array
from pbrnet.scenes.geometry.mesh import face_areas
from pbrnet.scenes.geometry.regions import buffered, intersection
from pbrnet.scenes.reconstruction.aperture_sections import (
    DEPTHS,
    LEAST_SEEDS,
    CrossSections,
    PlaneFrame,
    enclosed_air,
    portal_outline,
)
from pbrnet.scenes.reconstruction.light_walks import MAX_BOUNCES, EscapedWalk, LightWalker
from pbrnet.scenes.reconstruction.raycast import RayCaster
from pbrnet.scenes.reconstruction.room_index import RoomIndex
from pbrnet.scenes.reconstruction.rooms import MIN_OPENING, FoundOpening, FoundRoom

_WALKS_PER_ROOM = 4096
_WALKS_PER_SCENE = 65_536
_ROUNDS = 4
_MARGIN = 0.3  # metres beside a wall that an opening through it may be
_MIN_HALF_WIDTH = 0.04  # metres; a narrower hole is a crack
_LEVEL_STEP = 0.04  # metres between level sections
_MAX_WALKS = 400  # escaped walks that are examined, evenly chosen
_MIN_WALKS = LEAST_SEEDS  # through an opening; fewer show a crack
_MIN_SHARE = 0.05  # of the walks that an unobstructed hole would let out: a door leaf or a fire
# may stand before it
_NEARLY_MOST = 0.7  # of the walks that the best hole explains
_MOST_FRUITLESS = 100  # exact sections of a scene without an opening, after which to give up
_LEAST_FRUITLESS = 20  # of them that each room may have in any case

_CLEARLY, _CLEARLY_LEVEL = 0.9, 0.5  # share of an estimate in a room from which it is indoors

SectionBounds = tuple[Float64Array, Float64Array] | None  # lowest and highest (u, v)


@dataclass(frozen=True)
class _Aperture:
    """Enclosed air in the section at `depth` of `frame`, and the walks (numbers) through it."""

    frame: PlaneFrame
    depth: float
    air: Polygon
    walks: frozenset[int]

    @property
    def width(self) -> float:
        """Extent along `u`, metres."""
        west, _, east, _ = self.air.bounds
        return float(east - west)


@dataclass
class _Search:
    """Sections computed so far, and how many more may be computed without finding an opening.

    Sections are known by the axes of the frame, depth, and the points where walks cross them.
    """

    index: RoomIndex
    fruitless_left: int
    known: dict[tuple[bytes, float, bytes], list[Polygon]] = field(default_factory=dict)

    def wants(self, regions: list[Float64Array], frame: PlaneFrame, depth: float) -> bool:
        """Return whether to compute a section exactly, and count it as fruitless if so.

        `regions` are those of `_may_lead_out`.
        """
        leads_out = _may_lead_out(regions, frame, depth, self.index)
        self.fruitless_left -= leads_out
        return leads_out


def hidden_openings(
    rays: RayCaster,
    sections: CrossSections,
    rooms: list[FoundRoom],
    openings: list[FoundOpening],
) -> list[FoundOpening]:
    """Return the openings that random walks find besides `openings`.

    `rays` and `sections` hold the triangles that stop light.
    """
    normals = face_areas(sections.corners)[1]
    hidden: list[FoundOpening] = []
    search = _Search(RoomIndex(rooms), max(_MOST_FRUITLESS, _LEAST_FRUITLESS * len(rooms)))
    count = max(1, min(_WALKS_PER_ROOM, _WALKS_PER_SCENE // max(1, len(rooms))))
    for round_ in range(_ROUNDS):
        walker = LightWalker(rays, normals, openings + hidden)
        escaped = walker.escaped_walks(rooms, count, round_)
        found = _openings_of(escaped, count, sections, rooms, search)
        if not found:
            break
        hidden += found
    return hidden


def _openings_of(
    escaped: list[EscapedWalk],
    walks: int,
    sections: CrossSections,
    rooms: list[FoundRoom],
    search: _Search,
) -> list[FoundOpening]:
    """Openings that explain the escaped ones of `walks` walks a room, the busiest first."""
    stride = max(1, -(-len(escaped) // _MAX_WALKS))
    remaining, walks = escaped[::stride], walks // stride
    openings = []
    search.known.clear()
    while len(remaining) >= _MIN_WALKS:
        aperture = _busiest_aperture(remaining, walks, sections, rooms, search)
        if aperture is None:
            break
        room, frame = remaining[min(aperture.walks)].room, aperture.frame
        is_level = abs(frame.normal[2]) > 0.9
        wall_area = (
            rooms[room].floor.area
            if is_level
            else aperture.width * (rooms[room].ceiling_z - rooms[room].floor_z)
        )
        openings.append(
            FoundOpening(
                room,
                frame.to_world(portal_outline([aperture.air]), aperture.depth),
                frame.normal,
                min(1.0, aperture.air.area / wall_area),
                overhead=bool(frame.normal[2] > 0.9),
                hidden=True,
            )
        )
        remaining = [walk for index, walk in enumerate(remaining) if index not in aperture.walks]
    return openings


def _busiest_aperture(
    escaped: list[EscapedWalk],
    walks: int,
    sections: CrossSections,
    rooms: list[FoundRoom],
    search: _Search,
) -> _Aperture | None:
    """The smallest of the holes that nearly the most walks pass; None if all are cracks.

    None, too, if `search` gives up, unless it found holes until then.
    """
    known = search.known
    crossings = [
        (frame, depth, indices, points)
        for frame, depths, bounds in _section_planes(escaped, rooms)
        for depth, indices, points in _crossings(escaped, frame, depths, bounds)
    ]
    crossings.sort(key=lambda crossing: -len(crossing[2]))
    found: list[_Aperture] = []
    most = _MIN_WALKS
    for frame, depth, indices, points in crossings:
        if len(indices) < _NEARLY_MOST * most or search.fruitless_left <= 0:
            break  # no hole in this section or in those that follow has enough walks
        key = (frame.origin.tobytes() + frame.u.tobytes(), depth, points.tobytes())
        is_new, before = key not in known, len(found)
        if is_new:
            low, high = np.append(points.min(axis=0) - 1.0, depth), points.max(axis=0) + 1.0
            nearby = sections.near(frame, low, np.append(high, depth))
            wanted = partial(search.wants, frame=frame, depth=depth)
            known[key] = enclosed_air(nearby, depth, points, wanted)
        for part in known[key]:
            inside = set(indices[shapely.contains_xy(part, points[:, 0], points[:, 1])].tolist())
            if not inside or part.area < MIN_OPENING:
                continue
            room = rooms[escaped[min(inside)].room]
            if (
                len(inside) >= _min_walks(part.area, walks, room)
                and not buffered(part, -_MIN_HALF_WIDTH).is_empty
                and not _is_indoors(part, frame, depth, search.index)
            ):
                found.append(_Aperture(frame, depth, part, frozenset(inside)))
                most = max(most, len(inside))
        if is_new and len(found) > before:
            search.fruitless_left += 1
    candidates = [aperture for aperture in found if len(aperture.walks) >= _NEARLY_MOST * most]
    return min(candidates, key=lambda aperture: aperture.air.area, default=None)


def _min_walks(area: float, walks: int, room: FoundRoom) -> float:
    """The number of a room's walks that a hole of `area` square metres lets out at least.

    Fewer belong to a crack that merely lies in the same section.
    """
    walls = room.floor.length * (room.ceiling_z - room.floor_z)
    surface = 2 * room.floor.area + walls
    return max(_MIN_WALKS, _MIN_SHARE * walks * min(1.0, MAX_BOUNCES * area / surface))


def _section_planes(
    escaped: list[EscapedWalk], rooms: list[FoundRoom]
) -> Iterator[tuple[PlaneFrame, Float64Array, SectionBounds]]:
    """Families of parallel sections with their depths and bounds.

    Along every wall of the rooms that walks escaped from, then level ones, upwards through the
    ceilings and downwards through the floors.
    """
    up = np.array([0.0, 0.0, 1.0])
    for number in sorted({walk.room for walk in escaped}):
        room = rooms[number]
        height = room.ceiling_z - room.floor_z
        for start, end in pairwise(np.array(room.floor.exterior.coords)):
            length = float(np.linalg.norm(end - start))
            if length < _MARGIN:
                continue
            along = np.append((end - start) / length, 0.0)
            low = np.array([-_MARGIN, -_MARGIN])
            high = np.array([length + _MARGIN, height + _MARGIN])
            yield PlaneFrame(np.append(start, room.floor_z), along, up), DEPTHS, (low, high)
    east, north = np.eye(3)[0], np.eye(3)[1]
    for floor, ceiling in sorted({(room.floor_z, room.ceiling_z) for room in rooms}):
        top = np.array([0.0, 0.0, ceiling])
        levels = np.arange(floor - ceiling + _LEVEL_STEP, DEPTHS.max(), _LEVEL_STEP)
        yield PlaneFrame(top, east, north), levels, None
        yield PlaneFrame(np.array([0.0, 0.0, floor]), north, east), DEPTHS, None


def _crossings(
    escaped: list[EscapedWalk], frame: PlaneFrame, depths: Float64Array, bounds: SectionBounds
) -> Iterator[tuple[float, Int64Array, Float64Array]]:
    """Sections that enough walks cross outwards.

    Yields depth, walk numbers (M,) and the points (M, 2) of their last crossing.
    """
    tracks = frame.to_local(np.concatenate([walk.points for walk in escaped]))
    walks = np.repeat(np.arange(len(escaped)), [len(walk.points) for walk in escaped])
    same = walks[:-1] == walks[1:]
    before, after, walks = tracks[:-1][same], tracks[1:][same], walks[:-1][same]
    for depth in depths.tolist():
        rows = np.nonzero((before[:, 2] < depth) & (after[:, 2] >= depth))[0]
        rows = rows[np.append(walks[rows][1:] != walks[rows][:-1], True)[: len(rows)]]
        start, end = before[rows], after[rows]
        share = (depth - start[:, 2]) / (end[:, 2] - start[:, 2])
        points = start[:, :2] + share[:, None] * (end - start)[:, :2]
        if bounds is not None:
            inside = ((points >= bounds[0]) & (points <= bounds[1])).all(axis=1)
            rows, points = rows[inside], points[inside]
        if len(rows) >= _MIN_WALKS:
            yield depth, walks[rows], points


def _may_lead_out(
    regions: list[Float64Array], frame: PlaneFrame, depth: float, index: RoomIndex
) -> bool:
    """Return whether any of `regions`, points (M, 2) in a section, is not clearly in a room."""
    is_level = abs(frame.normal[2]) > 0.9
    share = _CLEARLY_LEVEL if is_level else _CLEARLY
    low, high = (0.05, 0.02) if is_level else (-0.1, 0.1)
    for points in regions:
        world = frame.to_world(points, depth)
        for number in index.near(world.min(axis=0), world.max(axis=0), 0.0):
            room = index.rooms[number]
            inner = room.floor if is_level else index.grown(number, -0.1)
            inside = shapely.contains_xy(inner, world[:, 0], world[:, 1])
            inside &= (world[:, 2] > room.floor_z - low) & (world[:, 2] < room.ceiling_z - high)
            if inside.mean() > share:
                break
        else:
            return True
    return False


def _is_indoors(part: Polygon, frame: PlaneFrame, depth: float, index: RoomIndex) -> bool:
    """Return whether the air of a section is inside a room, not in a hole of its enclosure."""
    middle = frame.to_world(np.array([part.representative_point().coords[0]]), depth)[0]
    if abs(frame.normal[2]) < 0.9:
        return index.containing(middle, -0.1) is not None
    plan = shapely.transform(part, lambda flat: frame.to_world(flat, depth)[:, :2])
    west, south, east, north = plan.bounds
    near = index.near(np.array([west, south]), np.array([east, north]), 0.0)
    return any(
        room.floor_z - 0.05 < middle[2] < room.ceiling_z - 0.02
        and intersection(plan, room.floor).area > 0.25 * plan.area
        for room in (index.rooms[number] for number in near)
    )
