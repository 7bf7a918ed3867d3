"""Reader of the house files of ProcTHOR and AI2-THOR, and of Holodeck, which writes the same.

Deitke et al., *ProcTHOR: Large-Scale Embodied AI Using Procedural Generation*, 2022. Unity's axes
are left-handed with Y up; x and z become x and y here, seen from above unchanged. A rotation turns
clockwise about Y, and an object at rotation 0 faces +z. Holes in walls are measured along the wall
from its first lower corner. House files hold no sizes of objects: those of the database of assets
stand in, or usual ones of the type (`procthor.yaml`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from shapely.geometry import Polygon

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.contract import Point2, Point3
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import data_beside, read_json
from pbrnet.scenes.importing.categories import category_of
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.layout.layout import (
    Layout,
    LayoutObject,
    LayoutOpening,
    LayoutRoom,
    OpeningKind,
)
from pbrnet.scenes.layout.readers.enclosed import outline
from pbrnet.scenes.layout.readers.labels import labelled_room, plain_label
from pbrnet.scenes.layout.readers.node import Node

_TABLE = data_beside(__file__)
_TYPES: dict[str, tuple[str, Point3]] = {
    name: (category, (width, depth, height))
    for name, (category, width, depth, height) in _TABLE["types"].items()
}
_TYPE_OF_WORDS = {**{name.lower(): name for name in _TYPES}, **_TABLE["words"]}
_HASH = re.compile(r"[0-9a-f]{32}")  # an asset of Objaverse, whose name tells nothing
_WORDS = 12  # of a name that are looked at
_LAMP: Point3 = (0.5, 0.5, 0.15)
_USUAL_HEIGHT = 2.6  # metres, of rooms
_UNKNOWN: Point3 = (0.4, 0.4, 0.4)
_ON_FLOOR = 0.6, 1.7  # of the usual height: heights that twice the centre's may tell
_BY_WALL = 0.4, 1.3  # of the usual size: distances to walls that tell a size
_WALL = 0.06  # metres, thickness: the houses' own walls have none
_DEEPEST = 6  # levels of objects on objects

Sizes = Mapping[str, Point3]


@dataclass(frozen=True)
class _Wall:
    """A wall: its lower corner from which holes are measured, the other one, and height."""

    start: Float64Array  # (2,)
    end: Float64Array  # (2,)
    height: float

    @property
    def along(self) -> Float64Array:
        """Unit direction (2,) from start to end."""
        ahead = self.end - self.start
        return np.asarray(ahead / max(float(np.hypot(*ahead)), 1e-9))


def recognises(content: Any) -> bool:
    """Test whether a file's content is a house: walls, and rooms with floor polygons or none."""
    if not isinstance(content, dict) or not isinstance(content.get("walls"), list):
        return False
    rooms = content.get("rooms")
    return isinstance(rooms, list) and all(
        isinstance(room, dict) and "floorPolygon" in room for room in rooms[:1]
    )


def read(content: Any, path: Path, assets: Path | None = None) -> Layout:
    """Read a house; raises `InputError` with file and key.

    `assets` is AI2-THOR's `asset-database.json`, whose bounding boxes are the sizes of objects.
    """
    house, changes = Node(content, f"{path}: "), Changes()
    sizes = asset_sizes(assets) if assets is not None else {}
    rooms = [_room(room, changes) for room in house["rooms"].items()]
    if not rooms:
        raise house["rooms"].error("the house has none")
    walls = {wall["id"].text(): _wall(wall) for wall in house["walls"].items()}
    objects = [
        made
        for thing in house["objects"].items()
        for made in _objects(thing, sizes, changes, None, 0)
    ]
    if assets is None:
        objects = [_fitted(one, list(walls.values())) for one in objects]
    heights = [wall.height for wall in walls.values() if wall.height > 0]
    height = float(np.median(heights)) if heights else _USUAL_HEIGHT
    objects += _lamps(house["proceduralParameters"]["lights"], height)
    return Layout(
        name=path.stem,
        rooms=tuple(rooms),
        openings=tuple(_openings(house, walls, {room.id for room in rooms}, changes)),
        objects=tuple(_numbered(objects)),
        height=height,
        wall=_WALL,
        changes=changes.sentences(),
    )


def asset_sizes(path: Path) -> dict[str, Point3]:
    """Read the sizes (width, depth, height) of assets by their id; raises `InputError`."""
    content = read_json(path)
    if not isinstance(content, dict):
        raise InputError(f"{path}: expected a mapping of object types, as in asset-database.json")
    found = {}
    for kind in content:
        for asset in Node(content[kind], f"{path}: {kind}").items():
            box = asset["boundingBox"]
            sides = [max(box[axis].number(), 0.001) for axis in "xzy"]
            found[asset["assetId"].text()] = (sides[0], sides[1], sides[2])
    return found


def _place(node: Node) -> Point2:
    return node["x"].number(), node["z"].number()


def _room(node: Node, changes: Changes) -> LayoutRoom:
    name = node["roomType"].text("") or node["type"].text("room")
    corners = [_place(corner) for corner in node["floorPolygon"].items()]
    if len(corners) < 3:
        raise node["floorPolygon"].error("expected three corners or more")
    if any(True for _ in node["children"].items()):
        changes.note("parts of rooms that are rooms themselves were left out")
    floor_z = node["floorPolygon"].value[0].get("y", 0)
    return LayoutRoom(
        _room_id(node["id"]),
        labelled_room(name),
        outline(Polygon(corners)),
        plain_label(name),
        floor_z=Node(floor_z, node.where).number(0.0),
    )


def _room_id(node: Node) -> str:
    """The id of a room without signs that no file name has: "room|2" is "room_2"."""
    return re.sub(r"[^A-Za-z0-9]+", "_", node.text())


def _wall(node: Node) -> _Wall:
    corners = [(*_place(corner), corner["y"].number(0.0)) for corner in node["polygon"].items()]
    if len(corners) < 3:
        raise node["polygon"].error("expected three corners or more")
    low, high = (pick(z for *_, z in corners) for pick in (min, max))
    start, *others = (np.array(corner[:2]) for corner in corners if corner[2] - low < 1e-3)
    return _Wall(start, others[0] if others else start, high - low)


def _openings(
    house: Node, walls: Mapping[str, _Wall], rooms: set[str], changes: Changes
) -> Iterator[LayoutOpening]:
    for kind in ("doors", "windows"):
        for node in house[kind].items():
            name = node["id"].text()
            wall = walls.get(node["wall0"].text()) or walls.get(node["wall1"].text(""))
            if wall is None:
                changes.note("openings of walls that are missing were left out: {}", name)
                continue
            yield _opening(node, kind, name, wall, rooms)


def _opening(node: Node, kind: str, name: str, wall: _Wall, rooms: set[str]) -> LayoutOpening:
    hole = list(node["holePolygon"].items()) or [
        node["boundingBox"]["min"],
        node["boundingBox"]["max"],
    ]
    across = [corner["x"].number() for corner in hole]
    up = [corner["y"].number() for corner in hole]
    start, end = (wall.start + place * wall.along for place in (min(across), max(across)))
    beside = {_room_id(node[key]) for key in ("room0", "room1") if node[key]} & rooms
    told: OpeningKind = "window"
    if kind == "doors":
        bare = node["assetId"].text("").startswith("Doorframe")
        told = "entrance" if len(beside) < 2 else "archway" if bare else "door"
    return LayoutOpening(
        name,
        told,
        (float(start[0]), float(start[1])),
        (float(end[0]), float(end[1])),
        bottom=max(min(up), 0.0),
        top=max(up),
        open_degrees=90.0 * min(max(node["openness"].number(0.0), 0.0), 1.0),
    )


def _objects(
    node: Node, sizes: Sizes, changes: Changes, on: str | None, depth: int
) -> Iterator[LayoutObject]:
    """An object, and what stands on it."""
    if depth > _DEEPEST:
        raise InputError(f"{node.where}: objects on objects on {_DEEPEST} others and more")
    name = node["id"].text()
    asset = node["assetId"].text("") or node["objectType"].text("")
    words = re.split(r"[|(]", node["object_name"].text("") or name)[0]
    category, usual, kind = _kind(asset, words, changes)
    position = node["position"]
    x, y = _place(position)
    z = position["y"].number()
    size = sizes.get(asset) or _sized(usual, z, on)
    yield LayoutObject(
        name,
        category,
        (x, y, z),
        size,
        yaw=(180.0 - node["rotation"]["y"].number(0.0)) % 360.0,
        name=asset,
        kind=kind,
        on=on,
    )
    for child in node["children"].items():
        yield from _objects(child, sizes, changes, name, depth + 1)


def _lamps(lights: Node, ceiling: float) -> Iterator[LayoutObject]:
    """Ceiling lamps where a house has lights without a body, one in the middle of each room."""
    for light in lights.items():
        if light["type"].text("") == "point":
            place = _place(light["position"])
            yield LayoutObject(
                light["id"].text(), "lamp", (*place, ceiling - 0.5 * _LAMP[2]), _LAMP, name="light"
            )


def _kind(asset: str, words: str, changes: Changes) -> tuple[str, Point3, str]:
    """Category, usual size and known kind of an object, from the names of its asset and itself."""
    names = [text for text in (words, asset) if not _HASH.fullmatch(text)]
    for name in names:
        if known := [_TYPE_OF_WORDS[run] for run in _runs(name) if run in _TYPE_OF_WORDS]:
            return *_TYPES[known[0]], _TABLE["kinds"].get(known[0], "")
    category = category_of(*names)
    if category == "other":
        changes.note("kinds of objects that are not known became plain boxes: {}", words or asset)
    alike = (size for told, size in _TYPES.values() if told == category)
    return category, next(alike, _UNKNOWN), ""


def _runs(name: str) -> list[str]:
    """Neighbouring words of a name, joined, the longest first: "tvstand", "stand", "tv"."""
    words = re.findall(r"[a-z]+", name.lower())[:_WORDS]
    found = {
        "".join(words[first:last])
        for first in range(len(words))
        for last in range(first + 1, len(words) + 1)
    }
    return sorted(found, key=lambda run: (-len(run), run))


def _sized(usual: Point3, centre: float, on: str | None) -> Point3:
    """The usual size, with the height that the centre of a thing on the floor tells."""
    width, depth, height = usual
    low, high = _ON_FLOOR
    if on is None and low * height < 2 * centre < high * height:
        return width, depth, 2 * centre
    return usual


def _fitted(one: LayoutObject, walls: Sequence[_Wall]) -> LayoutObject:
    """An object of usual size, made narrower where walls are, and as deep as its wall tells.

    ProcTHOR puts furniture with its back to a wall, or in the room's middle.
    """
    yaw, (width, depth, height) = math.radians(one.yaw), one.size
    right = np.array([math.cos(yaw), math.sin(yaw)])
    back = np.array([-right[1], right[0]])
    place = np.array(one.center[:2])
    beside, behind = (
        min(_free(place, sign * axis, walls) for sign in (1.0, -1.0)) for axis in (right, back)
    )
    low, high = _BY_WALL
    if low * width < 2 * beside < width:
        width = 2 * beside
    if one.on is None and low * depth < 2 * behind < high * depth:
        depth = 2 * behind
    return replace(one, size=(width, depth, height))


def _free(place: Float64Array, direction: Float64Array, walls: Sequence[_Wall]) -> float:
    """Metres from a place to the next wall in a direction (2,), infinite where there is none."""
    nearest = math.inf
    for wall in walls:
        ahead, across = wall.end - wall.start, wall.start - place
        crossing = direction[0] * ahead[1] - direction[1] * ahead[0]
        if abs(crossing) < 1e-9:
            continue
        along = (across[0] * ahead[1] - across[1] * ahead[0]) / crossing
        share = (across[0] * direction[1] - across[1] * direction[0]) / crossing
        if along >= 0 and 0 <= share <= 1:
            nearest = min(nearest, along)
    return nearest


def _numbered(objects: list[LayoutObject]) -> Iterator[LayoutObject]:
    """The objects, with numbers added to ids that are there twice."""
    seen: dict[str, int] = {}
    for one in objects:
        count = seen[one.id] = seen.get(one.id, 0) + 1
        yield one if count == 1 else replace(one, id=f"{one.id}#{count}")
