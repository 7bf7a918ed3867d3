"""Floor plans of one storey: rooms, walls, openings, roof and niches as data.

A plan lies in the world's XY plane, metres. Rooms are rectilinear polygons of net floor area; the
space between and around them is wall. `pbrnet.scenes.procedural.planning` draws plans.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeVar

import numpy as np
from shapely.geometry import MultiPolygon, Polygon

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.contract import Point2
from pbrnet.scenes.geometry.regions import difference, union

Metres = TypeVar("Metres", float, Float64Array)

RoomType = Literal["living", "bedroom", "kitchen", "bathroom", "study", "dining", "hall", "other"]
# "open": nearly the whole wall between two rooms is left out, below a lintel.
OpeningKind = Literal["door", "archway", "open", "entrance", "window", "patio"]

LEAST_LINTEL = 0.16  # metres from the ceiling to the top of an opening; beams are less deep
STEP = 0.19  # metres, rise of a step
WINDOWLESS: tuple[RoomType, ...] = ("bathroom", "hall")  # rooms that need no window


@dataclass(frozen=True)
class WallEdge:
    """Straight wall face of a room; the room lies to the left of `start` -> `end`."""

    start: Point2
    end: Point2
    outer: bool

    @property
    def length(self) -> float:
        """Length in metres."""
        return math.dist(self.start, self.end)

    @property
    def along(self) -> Point2:
        """Unit vector from start to end."""
        return (
            (self.end[0] - self.start[0]) / self.length,
            (self.end[1] - self.start[1]) / self.length,
        )

    @property
    def inward(self) -> Point2:
        """Unit normal into the room."""
        x, y = self.along
        return (-y, x)

    def at(self, s: float, depth: float = 0.0) -> Point2:
        """Return the point `s` metres along the wall, `depth` metres into the room."""
        (x, y), (nx, ny) = self.along, self.inward
        return (self.start[0] + s * x + depth * nx, self.start[1] + s * y + depth * ny)

    def points(self, s: Float64Array, depth: Float64Array, up: Float64Array) -> Float64Array:
        """Return points (N, 3) from metres along the wall, into the room and up, (N,) each."""
        (x, y), (nx, ny) = self.along, self.inward
        across = self.start[0] + s * x + depth * nx, self.start[1] + s * y + depth * ny
        return np.stack([*across, up], axis=1)

    def coordinates(self, point: Point2) -> tuple[float, float]:
        """Return (s, depth) of a point, metres: the inverse of `at`."""
        dx, dy = point[0] - self.start[0], point[1] - self.start[1]
        (x, y), (nx, ny) = self.along, self.inward
        return (float(dx * x + dy * y), float(dx * nx + dy * ny))

    def faces_like(self, other: WallEdge) -> bool:
        """Return True if both wall faces look in the same direction."""
        return self.inward[0] * other.inward[0] + self.inward[1] * other.inward[1] > 0.99

    def strip(self, s0: float, s1: float, near: float, far: float) -> Polygon:
        """Return the rectangle [s0, s1] along the wall x [near, far] into the room, metres."""
        return Polygon([self.at(s0, near), self.at(s1, near), self.at(s1, far), self.at(s0, far)])


@dataclass(frozen=True)
class Opening:
    """Door or window opening in a wall, from height `z0` to `z1`.

    `start` -> `end` lies on the wall face in `rooms[0]`, in the direction of the room's edge; the
    opening extends `thickness` metres away from that room. Doors have their hinge at `start`
    (`hinge_at_start`) or `end` and swing into room `swing`.
    """

    id: str
    kind: OpeningKind
    start: Point2
    end: Point2
    thickness: float
    z0: float
    z1: float
    rooms: tuple[str, ...]  # one for an outer wall, two for a partition
    hinge_at_start: bool = True
    swing: str = ""
    angle: float = 0.0  # opening angle of the leaf, degrees

    @property
    def edge(self) -> WallEdge:
        """The stretch of wall face that is cut away, in `rooms[0]`."""
        return WallEdge(self.start, self.end, len(self.rooms) == 1)

    def edge_in(self, room_id: str) -> WallEdge:
        """Return the stretch of wall face that is cut away, in either of the rooms."""
        edge = self.edge
        if room_id == self.rooms[0]:
            return edge
        return WallEdge(
            edge.at(self.width, -self.thickness), edge.at(0, -self.thickness), edge.outer
        )

    @property
    def width(self) -> float:
        """Width in metres."""
        return math.dist(self.start, self.end)

    @property
    def is_outer(self) -> bool:
        """True if the opening leads outdoors."""
        return len(self.rooms) == 1

    @property
    def footprint(self) -> Polygon:
        """The opening seen from above."""
        return self.edge.strip(0, self.width, 0, -self.thickness)


@dataclass(frozen=True)
class PlanRoom:
    """A room; `polygon` is its net floor, counter-clockwise, metres."""

    id: str
    type: RoomType
    polygon: tuple[Point2, ...]
    edges: tuple[WallEdge, ...]
    name: str = ""
    height: float | None = None  # metres, of its ceiling; None: the plan's

    @property
    def shape(self) -> Polygon:
        """The floor as a shapely polygon."""
        return Polygon(self.polygon)


@dataclass(frozen=True)
class Beam:
    """A beam below the ceiling of a room, from wall to wall: its rectangle and depth, metres."""

    room: str
    low: Point2
    high: Point2
    depth: float


@dataclass(frozen=True)
class Stairs:
    """A straight flight along a wall to a storey above, which is closed.

    It covers `edge.strip(s0, s1, 0, width)` and rises towards s1, or towards s0 if `reverse`.
    """

    room: str
    edge: WallEdge
    s0: float
    s1: float
    width: float
    reverse: bool

    @property
    def foot(self) -> tuple[float, float]:
        """Stretch of the wall before the first step, from which the flight is entered."""
        return (self.s1, self.s1 + 0.85) if self.reverse else (self.s0 - 0.85, self.s0)

    @property
    def footprint(self) -> Polygon:
        """The flight seen from above."""
        return self.edge.strip(self.s0, self.s1, 0.0, self.width)


@dataclass(frozen=True)
class Slope:
    """Part of the roof that comes down along an outer wall of the home.

    The ceiling falls from full height, `run` metres before the wall, to the knee wall. `edge` is
    the wall's inner face, along the whole side of the home.
    """

    edge: WallEdge
    knee: float  # height of the ceiling at the wall, metres
    run: float  # metres
    height: float  # of the level ceiling, metres

    @property
    def rise(self) -> float:
        """Rise of the ceiling in metres per metre away from the wall."""
        return (self.height - self.knee) / self.run

    def height_at(self, x: Metres, y: Metres) -> Metres:
        """Height of the slope's plane, which goes on beyond its run."""
        (nx, ny), (x0, y0) = self.edge.inward, self.edge.start
        return self.knee + self.rise * ((x - x0) * nx + (y - y0) * ny)

    def strip(self, margin: float = 0.0) -> Polygon:
        """Area below the slope and the eaves, seen from above; it ends `margin` past the ridge."""
        return self.edge.strip(-9.0, self.edge.length + 9.0, -9.0, self.run + margin)


@dataclass(frozen=True)
class RoofWindow:
    """Window in a slope: [s0, s1] along the slope's edge, [near, far] from the wall, metres."""

    id: str
    room: str
    slope: Slope
    s0: float
    s1: float
    near: float
    far: float

    @property
    def footprint(self) -> Polygon:
        """The window seen from above."""
        return self.slope.edge.strip(self.s0, self.s1, self.near, self.far)


@dataclass(frozen=True)
class Niche:
    """A lining in front of a wall, from floor to ceiling, with a recess that holds boards.

    The lining covers `edge.strip(s0, s1, 0, depth)`; its recess is `hole`, (s0, s1, z0, z1), open
    to the room and as deep as the lining but for its back.
    """

    room: str
    edge: WallEdge
    s0: float
    s1: float
    depth: float
    hole: tuple[float, float, float, float]
    boards: tuple[float, ...]  # heights of their tops, metres

    @property
    def footprint(self) -> Polygon:
        """The lining seen from above."""
        return self.edge.strip(self.s0, self.s1, 0.0, self.depth)


@dataclass(frozen=True)
class Plan:
    """Floor plan of one storey."""

    rooms: tuple[PlanRoom, ...]
    openings: tuple[Opening, ...]
    inner: tuple[Point2, ...]  # inner faces of the outer walls
    outline: tuple[Point2, ...]  # outer faces of the outer walls
    outer_thickness: float
    partition: float  # thickness of inner walls
    height: float  # floor to ceiling
    ground: float  # height of the ground outdoors, at most 0
    beams: tuple[Beam, ...] = ()
    stairs: Stairs | None = None
    slopes: tuple[Slope, ...] = ()
    roof_windows: tuple[RoofWindow, ...] = ()
    niches: tuple[Niche, ...] = ()
    # Outer faces of further parts, counter-clockwise, and of walls around courtyards, clockwise
    further: tuple[tuple[Point2, ...], ...] = ()

    @property
    def with_window(self) -> set[str]:
        """Ids of the rooms with a window or a glazed door."""
        upright = {
            opening.rooms[0] for opening in self.openings if opening.kind in ("window", "patio")
        }
        return upright | {window.room for window in self.roof_windows}

    @property
    def covered(self) -> Polygon | MultiPolygon:
        """Everything inside the outer faces of the outer walls, seen from above."""
        whole = Polygon(self.outline)
        for ring in map(Polygon, self.further):
            part = ring.exterior.is_ccw
            whole = union([whole, ring]) if part else difference(whole, ring)
        return whole

    def free_height(self, area: Polygon) -> float:
        """Least height of the ceiling over an area, metres."""
        x0, y0, x1, y1 = area.bounds
        corners = ((x0, y0), (x0, y1), (x1, y0), (x1, y1))
        return min(
            [self.height, *(slope.height_at(*each) for slope in self.slopes for each in corners)]
        )

    def room(self, room_id: str) -> PlanRoom:
        """Return the room with an id."""
        return next(room for room in self.rooms if room.id == room_id)
