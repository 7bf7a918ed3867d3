"""Reader of the JSON of RoomPlan: a `CapturedRoom`, or a `CapturedStructure` of several.

Apple, *RoomPlan*, 2022 to 2024. Y is up; (x, y, z) becomes (x, -z, y). A transform is 16 numbers by
column; a surface lies in its own x and y, and an object's front is its own +z. RoomPlan states no
thickness of walls, and rooms by a label and a centre alone: a room is what walls, and outlines of
floors where they are stated, enclose.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from shapely.geometry import Point, Polygon

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.contract import Point2
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.layout.layout import (
    Layout,
    LayoutObject,
    LayoutOpening,
    LayoutRoom,
    OpeningKind,
)
from pbrnet.scenes.layout.readers.enclosed import (
    MAX_GAP,
    Segment,
    enclosed_rooms,
    outline,
    rooms_beside,
)
from pbrnet.scenes.layout.readers.labels import (
    attribute_category,
    labelled_category,
    labelled_room,
    plain_label,
    typed_rooms,
)
from pbrnet.scenes.layout.readers.node import Node

_SURFACES = ("walls", "doors", "windows", "openings", "floors")
_THINNEST = 0.01  # metres
_THRESHOLD = 0.25  # metres above the floor up to which a door begins at the floor
_OPEN = 80.0  # degrees
_UPRIGHT = 0.9  # least share of an object's own y axis that is vertical


@dataclass(frozen=True)
class _Box:
    """A surface or object in the world, metres, Z up.

    `centre` (3,); `axes` (3, 3), columns are its own x, y and z; `sides` (3,) along them.
    """

    name: str
    centre: Float64Array
    axes: Float64Array
    sides: Float64Array
    node: Node

    @property
    def ends(self) -> Segment:
        """Both ends of a surface on the plan."""
        half = 0.5 * self.sides[0] * self.axes[:2, 0]
        return _point(self.centre[:2] - half), _point(self.centre[:2] + half)

    @property
    def low(self) -> float:
        """Height of the lower edge."""
        return float(self.centre[2] - 0.5 * self.sides[1])


def recognises(content: Any) -> bool:
    """Test whether a file's content is a captured room, or a structure of such rooms."""
    if not isinstance(content, dict):
        return False
    rooms = content.get("rooms")
    if isinstance(rooms, list) and rooms and not isinstance(content.get("walls"), list):
        return recognises(rooms[0])
    walls = content.get("walls")
    return (
        isinstance(walls, list)
        and isinstance(content.get("objects"), list)
        and all(isinstance(wall, dict) and "transform" in wall for wall in walls[:1])
        and ("doors" in content or "referenceOriginTransform" in content)
    )


def read(content: Any, path: Path) -> Layout:
    """Read a capture; raises `InputError` with file and key."""
    node, changes = Node(content, f"{path}: "), Changes()
    captures = [node] if node["walls"] else list(node["rooms"].items())
    surfaces = {kind: list(_boxes(captures, kind)) for kind in _SURFACES}
    walls = surfaces["walls"]
    _note_unread(captures, walls, changes)
    if not walls:
        raise InputError(f"{path}: no wall was captured; scan the room once more")
    lines = [wall.ends for wall in walls]
    lines += [edge for floor in surfaces["floors"] for edge in _outline(floor)]
    polygons = enclosed_rooms(lines, changes)
    if not polygons:
        raise InputError(
            f"{path}: the {len(walls)} walls enclose no room, gaps of {MAX_GAP:g} m closed; "
            "scan the walls that are missing"
        )
    floor_z = min(wall.low for wall in walls)
    objects = tuple(_objects(captures, floor_z, changes))
    return Layout(
        name=path.stem,
        rooms=typed_rooms(_rooms(polygons, captures, changes), objects),
        openings=tuple(_openings(surfaces, polygons, floor_z)),
        objects=objects,
        height=float(np.median([wall.sides[1] for wall in walls])),
        changes=changes.sentences(),
    )


def _note_unread(captures: Sequence[Node], walls: Sequence[_Box], changes: Changes) -> None:
    curved = [wall.name for wall in walls if wall.node["curve"]]
    for name in curved:
        changes.note("curved walls became straight ones: {}", name)
    storeys = {wall.node["story"].number(0.0) for wall in walls}
    if len(storeys) > 1:
        raise captures[0].error(f"walls on {len(storeys)} storeys; export each storey alone")


def _boxes(captures: Sequence[Node], kind: str) -> Iterator[_Box]:
    for capture in captures:
        for number, node in enumerate(capture[kind].items()):
            yield _box(node, f"{kind.removesuffix('s')}_{number}")


def _box(node: Node, usual: str) -> _Box:
    by_column = np.array(node["transform"].numbers(16)).reshape(4, 4).T
    turned = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]) @ by_column[:3]
    lengths = np.linalg.norm(turned[:, :3], axis=0)
    if not (np.abs(lengths - 1.0) < 0.05).all():
        raise node["transform"].error("expected a rotation and a place")
    sides = np.abs(node["dimensions"].numbers(3))
    name = node["identifier"].text(usual)
    return _Box(name, turned[:, 3], turned[:, :3] / lengths, sides, node)


def _outline(floor: _Box) -> list[Segment]:
    """Edges of a floor on the plan; none where its outline is not stated."""
    corners = [np.array(corner.numbers(3)) for corner in floor.node["polygonCorners"].items()]
    places = [_point((floor.centre + floor.axes @ corner)[:2]) for corner in corners]
    return list(zip(places, places[1:] + places[:1], strict=True)) if len(places) > 2 else []


def _rooms(
    polygons: Sequence[Polygon], captures: Sequence[Node], changes: Changes
) -> Iterator[LayoutRoom]:
    """Rooms with the labels of the sections whose centres they hold."""
    sections = []
    for capture in captures:
        for section in capture["sections"].items():
            x, _, z = section["center"].numbers(3)
            sections.append((section["label"].text("unidentified"), Point(x, -z)))
    for number, polygon in enumerate(polygons):
        inside = [label for label, place in sections if polygon.contains(place)]
        if len(inside) > 1:
            changes.note("rooms without a wall between them became one: {}", " and ".join(inside))
        known = [label for label in inside if label != "unidentified"]
        label = plain_label(known[0]) if known else ""
        yield LayoutRoom(f"room_{number}", labelled_room(label), outline(polygon), label)


def _openings(
    surfaces: dict[str, list[_Box]], polygons: Sequence[Polygon], floor_z: float
) -> Iterator[LayoutOpening]:
    for kind in ("doors", "windows", "openings"):
        for one in surfaces[kind]:
            if min(one.sides[:2]) < 0.1:
                continue
            start, end = one.ends
            outside = len(rooms_beside(polygons, start, end)) < 2
            bottom = max(one.low - floor_z, 0.0)
            top = max(one.low + float(one.sides[1]) - floor_z, bottom + 0.1)
            told: OpeningKind = "window" if kind == "windows" else "opening"
            if kind == "doors":
                told = "entrance" if outside else "door"
            if kind != "windows" and bottom < _THRESHOLD:
                bottom = 0.0
            degrees = _opened(one.node["category"]) if kind == "doors" else None
            yield LayoutOpening(one.name, told, start, end, bottom, top, degrees)


def _opened(category: Node) -> float | None:
    """Angle of a door that was captured open or closed, degrees; None where neither is stated."""
    if not isinstance(category.value, dict):
        return None
    return {True: _OPEN, False: 0.0}.get(category["door"]["isOpen"].value)


def _objects(captures: Sequence[Node], floor_z: float, changes: Changes) -> Iterator[LayoutObject]:
    boxes = list(_boxes(captures, "objects"))
    names = {box.name for box in boxes}
    for box in boxes:
        label = box.node["category"].single_key()
        category = labelled_category("roomplan", label, changes)
        attributes = box.node["attributes"].value
        for key, value in (attributes if isinstance(attributes, dict) else {}).items():
            category = attribute_category(str(key)[:60], str(value)[:60]) or category
        if abs(box.axes[2, 1]) < _UPRIGHT:
            changes.note("objects that are not upright were set upright: {}", label)
        width, height, depth = (max(float(side), _THINNEST) for side in box.sides)
        front = box.axes[:2, 2]
        parent = box.node["parentIdentifier"].text("")
        yield LayoutObject(
            box.name,
            category,
            (float(box.centre[0]), float(box.centre[1]), float(box.centre[2]) - floor_z),
            (width, depth, height),
            yaw=math.degrees(math.atan2(front[0], -front[1])) % 360.0,
            name=plain_label(label),
            on=parent if parent in names and _stands_on(box, boxes, parent) else None,
        )


def _stands_on(box: _Box, boxes: Sequence[_Box], parent: str) -> bool:
    """Test whether a box lies on its parent: RoomPlan also makes chairs parts of tables."""
    carrier = next(one for one in boxes if one.name == parent)
    return box.centre[2] > carrier.low + 0.5 * carrier.sides[1]


def _point(values: Float64Array) -> Point2:
    return float(values[0]), float(values[1])
