"""Ways out of rooms that no straight look along a wall's normal finds: by walks of light.

Behind a door that stands ajar, up a fireplace without a flue, around a corner: walks go at random
from inside every room, bouncing as on matt surfaces, and those that get out other than by an
opening show where another one is. World: metres, Z up.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from shapely.geometry import Polygon

from scenes.arrays import Float64Array, Int64Array
from scenes.geometry.mesh import face_areas
from scenes.reconstruction.aperture_sections import DEPTHS, Cuts, Frame, air, outline_of
from scenes.reconstruction.light_walks import blocked, bounce, places
from scenes.reconstruction.raycast import RayCaster
from scenes.reconstruction.rooms import MIN_OPENING, FoundOpening, FoundRoom
from scenes.seeds import generator

_WALKS = 4096  # a room
_ALL_WALKS = 65_536  # a scene
_BOUNCES = 8
_ROUNDS = 4
_FAR = 3.0  # metres that an escape's last stretch is followed
_BESIDE = 0.3  # metres beside a wall that a way out through it may be
_NARROW = 0.04  # metres, half of the least width: what is narrower is a crack
_STEP = 0.04  # metres between level cuts
_LOOKED_AT = 400  # escapes at most, evenly chosen
_FEWEST = 3  # walks that show an opening rather than a crack
_BUSY = 0.05  # of the walks that an open hole lets out: a leaf or a fire may stand before it
_AS_GOOD = 0.7  # of the most walks that one cut explains


@dataclass(frozen=True)
class Escape:
    """A walk that got out of room number `room`: where it turned, (K, 3), its end outdoors."""

    room: int
    points: Float64Array


@dataclass(frozen=True)
class _Passage:
    """Closed-in air in a cut at `depth` of `frame`, and the numbers of the walks through it."""

    frame: Frame
    depth: float
    air: Polygon
    walks: frozenset[int]

    @property
    def width(self) -> float:
        """Metres along `u`."""
        west, _, east, _ = self.air.bounds
        return float(east - west)


@dataclass(frozen=True)
class Walker:
    """Walks of light among triangles with unit `normals` (F, 3), stopped by `openings`."""

    rays: RayCaster
    normals: Float64Array
    openings: list[FoundOpening]

    def escapes(self, rooms: list[FoundRoom], count: int, seed: int) -> list[Escape]:
        """Of `count` walks in each of `rooms` those that get out."""
        return self.walks(rooms, count, seed)[0]

    def walks(
        self, rooms: list[FoundRoom], count: int, seed: int
    ) -> tuple[list[Escape], Float64Array]:
        """Of `count` walks in each of `rooms` those that get out, and where all of them met
        something, (N, 3)."""
        found, met = [], [np.empty((0, 3))]
        for number, room in enumerate(rooms):
            rng = generator(seed, "escapes", number)
            origins = places(room.floor, room.floor_z, room.ceiling_z, count, rng)
            ways = rng.normal(size=(count, 3))
            ways /= np.linalg.norm(ways, axis=1, keepdims=True)
            escapes, turns = self.follow(number, origins, ways, rng)
            found += escapes
            met += turns
        return found, np.concatenate(met)

    def follow(
        self, room: int, origins: Float64Array, ways: Float64Array, rng: np.random.Generator
    ) -> tuple[list[Escape], list[Float64Array]]:
        """Those of the walks that begin at `origins` (N, 3) along `ways` that get out, and where
        the walks turned, (M, 3) each time."""
        found = []
        turns = [origins]
        history = np.arange(len(origins))[:, None]  # of each living walk, its row in each of turns
        for _ in range(_BOUNCES):
            distance, triangle = self.rays.cast(origins, ways)
            stopped = blocked(self.openings, origins, ways, distance)
            for row in np.nonzero(~stopped & np.isinf(distance))[0].tolist():
                past = [turn[index] for turn, index in zip(turns, history[row], strict=True)]
                found.append(Escape(room, np.array([*past, origins[row] + _FAR * ways[row]])))
            going = ~stopped & np.isfinite(distance)
            if not going.any():
                break
            met = self.normals[triangle[going]]
            origins, ways = bounce(origins[going], ways[going], distance[going], met, rng)
            turns.append(origins)
            history = np.column_stack([history[going], np.arange(len(origins))])
        return found, turns[1:]


def hidden_openings(
    rays: RayCaster, cuts: Cuts, rooms: list[FoundRoom], openings: list[FoundOpening]
) -> tuple[list[FoundOpening], list[Escape]]:
    """Openings that walks find besides `openings`, and the walks that still get out.

    `rays` are cast at the triangles that stop light, `cuts` go through them.
    """
    normals = face_areas(cuts.corners)[1]
    hidden: list[FoundOpening] = []
    escapes: list[Escape] = []
    count = max(1, min(_WALKS, _ALL_WALKS // max(1, len(rooms))))
    for round_ in range(_ROUNDS):
        escapes = Walker(rays, normals, openings + hidden).escapes(rooms, count, round_)
        found = _openings_of(escapes, count, cuts, rooms)
        if not found:
            break
        hidden += found
    return hidden, escapes


def _openings_of(
    escapes: list[Escape], walks: int, cuts: Cuts, rooms: list[FoundRoom]
) -> list[FoundOpening]:
    """Openings that the escapes of `walks` a room went through, the busiest first."""
    every = max(1, -(-len(escapes) // _LOOKED_AT))
    left, walks = escapes[::every], walks // every
    made = []
    while len(left) >= _FEWEST:
        passage = _busiest(left, walks, cuts, rooms)
        if passage is None:
            break
        room, frame = left[min(passage.walks)].room, passage.frame
        level = abs(frame.normal[2]) > 0.9
        wall = (
            rooms[room].floor.area
            if level
            else passage.width * (rooms[room].ceiling_z - rooms[room].floor_z)
        )
        made.append(
            FoundOpening(
                room,
                frame.world(outline_of([passage.air]), passage.depth),
                frame.normal,
                min(1.0, passage.air.area / wall),
                overhead=bool(frame.normal[2] > 0.9),
                hidden=True,
            )
        )
        left = [escape for index, escape in enumerate(left) if index not in passage.walks]
    return made


def _busiest(
    escapes: list[Escape], walks: int, cuts: Cuts, rooms: list[FoundRoom]
) -> _Passage | None:
    """The least of the holes that (nearly) the most escapes went through; None if all of them
    are cracks."""
    crossed = [
        (frame, depth, who, points)
        for frame, depths, limits in _families(escapes, rooms)
        for depth, who, points in _crossings(escapes, frame, depths, limits)
    ]
    crossed.sort(key=lambda cut: -len(cut[2]))
    found: list[_Passage] = []
    most = _FEWEST
    for frame, depth, who, points in crossed:
        if len(who) < _AS_GOOD * most:
            break  # no hole in this cut or in those that follow can be as busy
        low, high = np.append(points.min(axis=0) - 1.0, depth), points.max(axis=0) + 1.0
        for part in air(cuts.near(frame, low, np.append(high, depth)), depth, points):
            inside = set(who[shapely.contains_xy(part, points[:, 0], points[:, 1])].tolist())
            if not inside or part.area < MIN_OPENING or part.buffer(-_NARROW).is_empty:
                continue
            room = rooms[escapes[min(inside)].room]
            if len(inside) >= _least(part.area, walks, room) and not _is_indoors(
                part, frame, depth, rooms
            ):
                found.append(_Passage(frame, depth, part, frozenset(inside)))
                most = max(most, len(inside))
    good = [passage for passage in found if len(passage.walks) >= _AS_GOOD * most]
    return min(good, key=lambda passage: passage.air.area, default=None)


def _least(area: float, walks: int, room: FoundRoom) -> float:
    """How many of a room's walks an open hole of `area` lets out at least; fewer show a crack
    that merely lies in the same cut."""
    around = room.floor.length * (room.ceiling_z - room.floor_z)
    surface = 2 * room.floor.area + around
    return max(_FEWEST, _BUSY * walks * min(1.0, _BOUNCES * area / surface))


Limits = tuple[Float64Array, Float64Array] | None  # of a cut, lowest and highest (u, v)


def _families(
    escapes: list[Escape], rooms: list[FoundRoom]
) -> Iterator[tuple[Frame, Float64Array, Limits]]:
    """Planes across which a way out may be: along walls, and level, seen from below and above."""
    up = np.array([0.0, 0.0, 1.0])
    for number in sorted({escape.room for escape in escapes}):
        room = rooms[number]
        height = room.ceiling_z - room.floor_z
        for start, end in pairwise(np.array(room.floor.exterior.coords)):
            length = float(np.linalg.norm(end - start))
            if length < _BESIDE:
                continue
            along = np.append((end - start) / length, 0.0)
            low = np.array([-_BESIDE, -_BESIDE])
            high = np.array([length + _BESIDE, height + _BESIDE])
            yield Frame(np.append(start, room.floor_z), along, up), DEPTHS, (low, high)
    east, north = np.eye(3)[0], np.eye(3)[1]
    for floor, ceiling in sorted({(room.floor_z, room.ceiling_z) for room in rooms}):
        top = np.array([0.0, 0.0, ceiling])
        levels = np.arange(floor - ceiling + _STEP, DEPTHS.max(), _STEP)
        yield Frame(top, east, north), levels, None
        yield Frame(np.array([0.0, 0.0, floor]), north, east), DEPTHS, None


def _crossings(
    escapes: list[Escape], frame: Frame, depths: Float64Array, limits: Limits
) -> Iterator[tuple[float, Int64Array, Float64Array]]:
    """Cuts that walks cross outwards: depth, which walks, and where they do so last, (M, 2)."""
    tracks = [frame.local(escape.points) for escape in escapes]
    for depth in depths.tolist():
        who, points = [], []
        for index, track in enumerate(tracks):
            before, after = track[:-1, 2], track[1:, 2]
            rows = np.nonzero((before < depth) & (after >= depth))[0]
            if not len(rows):
                continue
            row = rows[-1]
            share = (depth - before[row]) / (after[row] - before[row])
            point = track[row, :2] + share * (track[row + 1, :2] - track[row, :2])
            if limits is None or ((point >= limits[0]) & (point <= limits[1])).all():
                who.append(index)
                points.append(point)
        if len(who) >= _FEWEST:
            yield depth, np.array(who, dtype=np.int64), np.array(points)


def _is_indoors(part: Polygon, frame: Frame, depth: float, rooms: list[FoundRoom]) -> bool:
    """Whether a cut's air is that of a room rather than of a hole in what encloses it."""
    middle = frame.world(np.array([part.representative_point().coords[0]]), depth)[0]
    if abs(frame.normal[2]) < 0.9:
        return any(room.holds(middle, -0.1) for room in rooms)
    ring = shapely.transform(part, lambda flat: frame.world(flat, depth)[:, :2])
    return any(
        room.floor_z - 0.05 < middle[2] < room.ceiling_z - 0.02
        and ring.intersection(room.floor).area > 0.25 * ring.area
        for room in rooms
    )
