"""Reader of pbrnet's own layouts: a JSON file that a person writes in twenty lines.

docs/layouts.md describes the format, whose keys are the fields of `OwnLayout`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

import yaml
from shapely.geometry import Polygon

from pbrnet.scenes.checked import build, within
from pbrnet.scenes.contract import Point2, Point3
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import data_beside
from pbrnet.scenes.importing.categories import CATEGORIES, category_of, room_type
from pbrnet.scenes.layout.layout import (
    MAX_PLACE,
    MAX_SIZE,
    Layout,
    LayoutObject,
    LayoutOpening,
    LayoutRoom,
    OpeningKind,
    RoomType,
)
from pbrnet.scenes.layout.readers.shared_walls import shared_wall

KEY, VALUE = "pbrnet", "layout"  # at the top of each file
_PLACE = within(-MAX_PLACE, MAX_PLACE)
_SIZE = within(high=MAX_SIZE, above=0.0)
_LONGEST_TEXT = 4 << 20  # of a file in which the line of an error is looked for


@dataclass(frozen=True)
class _Usual:
    """The tables of `own.yaml`."""

    openings: dict[str, tuple[float, float, float]]
    sizes: dict[str, Point3]
    bottoms: dict[str, float]


_USUAL = build(_Usual, data_beside(__file__))


@dataclass(frozen=True)
class OwnRoom:
    """A room: a polygon, or a rectangle of west, south, east and north."""

    id: str = field(default="", metadata={"meaning": "by default its number, such as room-0"})
    type: RoomType | None = field(default=None, metadata={"meaning": "by default from name or id"})
    name: str = ""
    polygon: tuple[Point2, ...] | None = field(default=None, metadata=_PLACE)
    rectangle: tuple[float, float, float, float] | None = field(default=None, metadata=_PLACE)
    floor_z: float = field(default=0.0, metadata=_PLACE)
    height: float | None = field(default=None, metadata=_SIZE)


@dataclass(frozen=True)
class OwnOpening:
    """An opening: on a line, in a side of a room, or in the wall between two rooms."""

    kind: OpeningKind
    id: str = ""
    start: Point2 | None = field(default=None, metadata=_PLACE)
    end: Point2 | None = field(default=None, metadata=_PLACE)
    between: tuple[str, str] | None = None
    room: str | None = None
    wall: Literal["north", "south", "east", "west"] | None = None
    at: float | None = field(default=None, metadata=_SIZE)
    width: float | None = field(default=None, metadata=_SIZE)
    bottom: float | None = field(default=None, metadata=within(0, MAX_SIZE))
    top: float | None = field(default=None, metadata=_SIZE)
    open_degrees: float | None = field(default=None, metadata=within(0, 180))
    hinge: Literal["start", "end"] = "start"
    swing: str | None = None


@dataclass(frozen=True)
class OwnObject:
    """An object: its category, and the middle of the bottom of its box."""

    category: str
    at: tuple[float, ...] = field(metadata=_PLACE)
    id: str = ""
    size: Point3 | None = field(default=None, metadata=_SIZE)
    yaw: float = 0.0
    name: str = ""
    kind: str = ""
    room: str | None = None
    on: str | None = None


@dataclass(frozen=True)
class OwnLayout:
    """The whole file."""

    pbrnet: Literal["layout"]
    rooms: tuple[OwnRoom, ...]
    openings: tuple[OwnOpening, ...] = ()
    objects: tuple[OwnObject, ...] = ()
    version: Literal[1] = 1
    name: str = ""
    height: float = 2.6
    wall: float = 0.12
    outer_wall: float = 0.3
    polygons: Literal["inner", "centre"] = "inner"
    style: str = ""
    seed: int | None = None
    author: str = ""
    licence: str = ""
    source: str = ""
    strict: bool = True


def recognises(content: Any) -> bool:
    """Test whether JSON is a layout of pbrnet's own."""
    return isinstance(content, Mapping) and content.get(KEY) == VALUE


def read(content: Any, path: Path) -> Layout:
    """Return the layout; raises `InputError` that begins with the key of what is wrong."""
    stated = build(OwnLayout, content, error=InputError)
    rooms = tuple(_room(each, number) for number, each in enumerate(stated.rooms))
    by_id = {room.id: room for room in rooms}
    openings = tuple(_opening(each, k, by_id) for k, each in enumerate(stated.openings))
    objects: dict[str, LayoutObject] = {}
    for number, each in enumerate(stated.objects):
        made = _object(each, number, objects, by_id)
        if made.id in objects:
            raise InputError(f"objects[{number}].id: {made.id!r} is used twice")
        objects[made.id] = made
    same = {one.name for one in fields(Layout)} & {one.name for one in fields(OwnLayout)}
    common = {name: getattr(stated, name) for name in same}
    name = stated.name or path.name.removesuffix(".json").removesuffix(".layout")
    parts = {"rooms": rooms, "openings": openings, "objects": tuple(objects.values())}
    return Layout(**{**common, **parts, "name": name})


def _room(stated: OwnRoom, number: int) -> LayoutRoom:
    where = f"rooms[{number}]"
    if (stated.polygon is None) == (stated.rectangle is None):
        raise InputError(f"{where}: give it either a polygon or a rectangle")
    polygon = stated.polygon or ()
    if stated.rectangle is not None:
        west, south, east, north = stated.rectangle
        if west >= east or south >= north:
            raise InputError(f"{where}.rectangle: give [west, south, east, north]")
        polygon = ((west, south), (east, south), (east, north), (west, north))
    kind = stated.type or _type(f"{stated.name} {stated.id} ")
    return LayoutRoom(
        stated.id or f"room-{number}", kind, polygon, stated.name, stated.floor_z, stated.height
    )


def _type(name: str) -> RoomType:
    """The type of a room from its name or id."""
    words = re.sub(r"[\d_-]+", " ", name)
    if "hall" in words.lower() or "corridor" in words.lower():
        return "hall"
    found = room_type(words, ())
    return next((one for one in _TYPES if one == found), "other")


_TYPES: tuple[RoomType, ...] = ("living", "bedroom", "kitchen", "bathroom", "study", "dining")


def _opening(stated: OwnOpening, number: int, rooms: Mapping[str, LayoutRoom]) -> LayoutOpening:
    where = f"openings[{number}]"
    low, high, width = _USUAL.openings[stated.kind]
    start, end = _line(stated, where, rooms, width)
    return LayoutOpening(
        id=stated.id or f"{stated.kind}-{number}",
        kind=stated.kind,
        start=start,
        end=end,
        bottom=low if stated.bottom is None else stated.bottom,
        top=high if stated.top is None else stated.top,
        open_degrees=stated.open_degrees,
        hinge=stated.hinge,
        swing=stated.swing,
        room=stated.room or (stated.between[0] if stated.between else None),
    )


def _line(
    stated: OwnOpening, where: str, rooms: Mapping[str, LayoutRoom], width: float
) -> tuple[Point2, Point2]:
    """The line of an opening, stated in one of three ways."""
    if stated.start is not None and stated.end is not None:
        return stated.start, stated.end
    named: tuple[str, ...] = stated.between or (
        (stated.room,) if stated.room and stated.wall else ()
    )
    if not named:
        raise InputError(f"{where}: give it start and end, or room and wall, or between two rooms")
    for name in named:
        if name not in rooms:
            raise InputError(f"{where}: {name!r} is the id of no room")
    if stated.between:
        first, second = stated.between
        wall = shared_wall(rooms[first].polygon, rooms[second].polygon)
        problem = f"the rooms {named[0]!r} and {named[1]!r} share no wall"
    else:
        wall = _side(rooms[named[0]].polygon, stated.wall or "")
        problem = f"the room {named[0]!r} has no wall in the {stated.wall}"
    if wall is None:
        raise InputError(f"{where}: {problem}")
    wide = width if stated.width is None else stated.width
    length = math.dist(*wall)
    middle = 0.5 * length if stated.at is None else stated.at
    if wide > length or not 0.5 * wide - 1e-6 <= middle <= length - 0.5 * wide + 1e-6:
        raise InputError(
            f"{where}: {wide:g} m wide in the middle of {middle:g} m does not fit into a wall of "
            f"{length:.2f} m"
        )
    return _between(*wall, middle - 0.5 * wide), _between(*wall, middle + 0.5 * wide)


def _between(start: Point2, end: Point2, metres: float) -> Point2:
    share = metres / math.dist(start, end)
    return (start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1]))


def _side(polygon: tuple[Point2, ...], wall: str) -> tuple[Point2, Point2] | None:
    """The longest side of a room whose outward normal points there, west to east or south first."""
    if len(polygon) < 3:
        return None  # reported with the room
    outward = {"north": (0, 1), "south": (0, -1), "east": (1, 0), "west": (-1, 0)}[wall]
    ring = polygon if Polygon(polygon).exterior.is_ccw else polygon[::-1]
    best: tuple[float, tuple[Point2, Point2]] | None = None
    for start, end in zip(ring, ring[1:] + ring[:1], strict=True):
        length = math.dist(start, end)
        facing = (end[1] - start[1]) * outward[0] - (end[0] - start[0]) * outward[1]
        if length > 0 and facing / length > math.cos(math.radians(40)) and (
            best is None or length > best[0]
        ):  # fmt: skip
            best = (length, (min(start, end), max(start, end)))
    return None if best is None else best[1]


def _object(
    stated: OwnObject,
    number: int,
    others: Mapping[str, LayoutObject],
    rooms: Mapping[str, LayoutRoom],
) -> LayoutObject:
    where = f"objects[{number}]"
    category = _category(stated.category)
    size = stated.size or _USUAL.sizes.get(category)
    if size is None:
        raise InputError(f"{where}.size: missing; {stated.category[:60]!r} has no usual one")
    if len(stated.at) not in (2, 3):
        raise InputError(f"{where}.at: give [x, y], or [x, y, z] of the bottom of the box")
    if stated.on is not None and stated.on not in others:
        raise InputError(f"{where}.on: {stated.on[:60]!r} is the id of no object before it")
    room = None if stated.room is None else rooms.get(stated.room)
    floor = 0.0 if room is None else room.floor_z
    bottom = floor + _USUAL.bottoms.get(category, 0.0)
    if stated.on is not None:
        carrier = others[stated.on]
        bottom = carrier.center[2] + 0.5 * carrier.size[2]
    if len(stated.at) == 3:
        bottom = stated.at[2]
    return LayoutObject(
        id=stated.id or f"object-{number}",
        category=category,
        center=(stated.at[0], stated.at[1], bottom + 0.5 * size[2]),
        size=size,
        yaw=stated.yaw,
        name=stated.name,
        kind=stated.kind,
        room=stated.room,
        on=stated.on,
    )


def _category(stated: str) -> str:
    """Return the category that a word means: "tv" is a television. Unknown words stay."""
    if stated in CATEGORIES:
        return stated
    found = category_of(stated)
    return stated if found == "other" else found


def line_of(text: str, message: str) -> str:
    """The line of the key that a message begins with, such as "line 12: "; empty if unknown."""
    keys = re.findall(r"([A-Za-z_]\w*)|\[(\d+)\]", message.partition(":")[0])
    if len(text) > _LONGEST_TEXT:
        return ""
    try:
        node = yaml.compose(text, getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    except (yaml.YAMLError, RecursionError, ValueError):
        return ""
    for name, index in keys:
        inner = _inside(node, name, index)
        if inner is None:
            break
        node = inner
    return f"line {node.start_mark.line + 1}: "


def _inside(node: Any, name: str, index: str) -> Any:
    """The value of a key, or the element of a list, in a node of a file."""
    if name and isinstance(node, yaml.MappingNode):
        return next((value for key, value in node.value if key.value == name), None)
    if index and isinstance(node, yaml.SequenceNode) and int(index) < len(node.value):
        return node.value[int(index)]
    return None
