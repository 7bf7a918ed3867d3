"""Layout contract: rooms, openings and boxes of objects, and nothing else.

World: metres, right-handed, Z up; yaw in degrees, counter-clockwise seen from above. A reader of a
format makes a `Layout`, calls `check_layout` of `checks.py`, and is one line in `formats.py`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from pbrnet.scenes.contract import Point2, Point3

RoomType = Literal["living", "bedroom", "kitchen", "bathroom", "study", "dining", "hall", "other"]
# "archway": an opening with lining and casings; "opening": a bare one
OpeningKind = Literal["door", "window", "opening", "archway", "entrance"]
MAX_PLACE = 1000.0  # metres from the origin
MAX_SIZE = 100.0  # metres, of an object


@dataclass(frozen=True)
class LayoutRoom:
    """A room; `polygon` is simple and counter-clockwise, at any angles, metres."""

    id: str
    type: RoomType
    polygon: tuple[Point2, ...]
    name: str = ""
    floor_z: float = 0.0  # metres
    height: float | None = None  # metres from floor to ceiling; None: the layout's


@dataclass(frozen=True)
class LayoutOpening:
    """A door, window or opening in a wall, along the line from `start` to `end` on it.

    The line may lie on either face of the wall or inside it. `bottom` and `top` are metres above
    the floor. An entrance leads outdoors; a window that begins at the floor is a glazed door. A
    door's leaf hangs at its `hinge` and swings into the room `swing`, None: into either.
    """

    id: str
    kind: OpeningKind
    start: Point2
    end: Point2
    bottom: float
    top: float
    open_degrees: float | None = None  # of a door's leaf, 0 to 110; None: drawn
    hinge: Literal["start", "end"] = "start"
    swing: str | None = None
    room: str | None = None  # a room that it opens; None: any at its place


@dataclass(frozen=True)
class LayoutObject:
    """An object: its category and box.

    `category` is one of pbrnet's, such as "chair" or "night table". `size` is the box along its
    own axes: width (x), depth (y), height (z), metres. At yaw 0 its front faces -Y.
    """

    id: str
    category: str
    center: Point3
    size: Point3
    yaw: float = 0.0  # degrees
    name: str = ""
    kind: str = ""  # of furniture that it must be, such as "round_table"; empty: what fits
    room: str | None = None  # None: the room that it lies in
    on: str | None = None  # id of the object that carries it


@dataclass(frozen=True)
class Layout:
    """Rooms with openings and objects.

    Walls are not stated. `wall` is the thickness between rooms whose polygons touch; where
    polygons are apart, the gap is the wall. With `polygons` "inner", their other sides are the
    inner faces of outer walls, with "centre" the middle of these.
    """

    name: str
    rooms: tuple[LayoutRoom, ...]
    openings: tuple[LayoutOpening, ...] = ()
    objects: tuple[LayoutObject, ...] = ()
    height: float = 2.6  # metres from floor to ceiling
    wall: float = 0.12  # metres
    outer_wall: float = 0.3  # metres
    polygons: Literal["inner", "centre"] = "inner"
    style: str = ""  # interior style; empty: drawn
    seed: int | None = None  # of all that is drawn; None: that of the import
    author: str = ""
    licence: str = ""
    source: str = ""  # where the layout came from, such as a public page
    # False: what cannot be built, such as an opening far from each wall, is left out and named in
    # `changes` of the scene; True: it is refused
    strict: bool = False
    changes: tuple[str, ...] = ()  # what the reader changed or lost, a sentence each

    def room_ids(self) -> Iterable[str]:
        """Ids of the rooms, in order."""
        return (room.id for room in self.rooms)
