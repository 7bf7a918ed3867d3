"""Reader of SpatialLM's text: walls, doors, windows and boxes, one a line.

SpatialLM (Mao et al., *SpatialLM: Training Large Language Models for Structured Indoor Modeling*,
2025) writes lines that look like code. They are matched with a grammar, never run. Metres, Z up; an
angle is in radians about Z. The rooms are what the walls enclose.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from shapely.geometry import Polygon

from pbrnet.scenes.checked import shown
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
    enclosed_rooms,
    outline,
    rooms_beside,
)
from pbrnet.scenes.layout.readers.fronts import facing
from pbrnet.scenes.layout.readers.labels import labelled_category, typed_rooms

_LINE = re.compile(r"(wall|door|window|bbox)_(\d{1,6})\s*=\s*(Wall|Door|Window|Bbox)\(([^()]*)\)")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?")
_WALL = re.compile(r"wall_(\d{1,6})")
_LABEL = re.compile(r"[A-Za-z0-9][A-Za-z0-9 _./-]{0,63}")
_FIELDS = {"wall": 8, "door": 6, "window": 6, "bbox": 8}
_MAX_LINES = 20_000
_LARGEST = 1e5
_BINS = 100.0  # extent from which whole numbers are bins of the model, not metres
_THINNEST = 0.01  # metres
_THRESHOLD = 0.25  # metres above the floor up to which a door begins at the floor


@dataclass(frozen=True)
class _Entity:
    """A line: its kind and number, its reference or label, its numbers, and its place."""

    kind: str
    number: int
    label: str  # of a box
    wall: int  # of a door or window
    values: tuple[float, ...]
    where: str


def recognises(text: str) -> bool:
    """Test whether the first line that is not empty is one of SpatialLM's."""
    first = next((line for line in text[:100_000].splitlines() if line.strip()), "")
    return re.match(r"\s*(wall|door|window|bbox)_\d+\s*=\s*[A-Z]", first) is not None


def read(text: str, path: Path) -> Layout:
    """Read a layout; raises `InputError` with file and line."""
    entities = _parsed(text, path)
    walls = {one.number: one for one in entities if one.kind == "wall"}
    _check_metres(entities, path)
    changes = Changes()
    lines = [_ends(wall) for wall in walls.values()]
    polygons = enclosed_rooms(lines, changes)
    if not polygons:
        raise InputError(
            f"{path}: the {len(walls)} walls enclose no room, gaps of {MAX_GAP:g} m closed; "
            "add the walls that are missing"
        )
    floor = float(np.median([wall.values[2] for wall in walls.values()]))
    height = float(np.median([wall.values[6] for wall in walls.values()]))
    objects = facing(_objects(entities, floor, changes), lines)
    rooms = (
        LayoutRoom(f"room_{n}", "other", outline(polygon)) for n, polygon in enumerate(polygons)
    )
    return Layout(
        name=path.stem,
        rooms=typed_rooms(rooms, objects),
        openings=tuple(_openings(entities, walls, polygons, floor, changes)),
        objects=tuple(objects),
        height=height,
        changes=changes.sentences(),
    )


def _parsed(text: str, path: Path) -> list[_Entity]:
    lines = text.splitlines()
    if len(lines) > _MAX_LINES:
        raise InputError(f"{path}: {len(lines):,} lines; at most {_MAX_LINES:,}")
    found = [
        _entity(line.strip(), f"{path}: line {number}")
        for number, line in enumerate(lines, 1)
        if line.strip()
    ]
    names = [(one.kind, one.number) for one in found]
    for one, name in zip(found, names, strict=True):
        if one.kind == "wall" and names.count(name) > 1:
            raise InputError(f"{one.where}: wall_{one.number} is there twice")
    if not any(one.kind == "wall" for one in found):
        raise InputError(f"{path}: no line of a wall, such as wall_0=Wall(0,0,0,4,0,0,2.6,0)")
    return found


def _entity(line: str, where: str) -> _Entity:
    match = _LINE.fullmatch(line)
    if match is None or match[1] != match[3].lower():
        raise InputError(
            f"{where}: expected a line such as wall_0=Wall(...), door_0=Door(...), "
            f"window_0=Window(...) or bbox_0=Bbox(...), got {shown(line)}"
        )
    kind, fields = match[1], [part.strip() for part in match[4].split(",")]
    if len(fields) != _FIELDS[kind]:
        raise InputError(f"{where}: a {kind} has {_FIELDS[kind]} values, got {len(fields)}")
    label, wall = "", -1
    if kind == "bbox":
        label = fields.pop(0)
        if not _LABEL.fullmatch(label):
            raise InputError(f"{where}: {shown(label)} is no name of a category")
    elif kind != "wall":
        reference = _WALL.fullmatch(fields.pop(0))
        if reference is None:
            raise InputError(f"{where}: the first value of a {kind} is its wall, such as wall_0")
        wall = int(reference[1])
    values = tuple(_number(field, where) for field in fields)
    return _Entity(kind, int(match[2]), label, wall, values, where)


def _number(text: str, where: str) -> float:
    value = float(text) if len(text) < 64 and _NUMBER.fullmatch(text) else math.inf
    if not abs(value) <= _LARGEST:
        raise InputError(f"{where}: expected a number, got {shown(text)}")
    return value


def _check_metres(entities: Sequence[_Entity], path: Path) -> None:
    """Refuse the bins in which the model writes, before its program turns them into metres."""
    numbers = [value for one in entities if one.kind == "wall" for value in one.values]
    if max(map(abs, numbers)) > _BINS and all(value == int(value) for value in numbers):
        raise InputError(
            f"{path}: whole numbers up to {max(numbers):g}, the bins of the model's own output; "
            "save the layout that SpatialLM's inference.py writes, in metres"
        )


def _ends(wall: _Entity) -> tuple[Point2, Point2]:
    ax, ay, _, bx, by = wall.values[:5]
    return (ax, ay), (bx, by)


def _openings(
    entities: Sequence[_Entity],
    walls: Mapping[int, _Entity],
    rooms: Sequence[Polygon],
    floor: float,
    changes: Changes,
) -> list[LayoutOpening]:
    made = []
    for one in entities:
        if one.kind not in ("door", "window"):
            continue
        if one.wall not in walls:
            changes.note("openings of walls that are missing were left out: {}", _name(one))
            continue
        x, y, z, width, height = one.values
        start, end = (np.array(point) for point in _ends(walls[one.wall]))
        along = (end - start) / max(float(np.hypot(*(end - start))), 1e-9)
        centre = start + along * float(np.dot(np.array([x, y]) - start, along))
        half = 0.5 * abs(width) * along
        ends = _point(centre - half), _point(centre + half)
        bottom = max(z - 0.5 * abs(height) - floor, 0.0)
        top = z + 0.5 * abs(height) - floor
        if one.kind == "door" and bottom < _THRESHOLD:
            bottom = 0.0
        if top - bottom < 0.1 or abs(width) < 0.1:
            changes.note("openings of no size were left out: {}", _name(one))
            continue
        outside = len(rooms_beside(rooms, *ends)) < 2
        kind: OpeningKind = "entrance" if outside else "door"
        if one.kind == "window":
            kind = "window"
        made.append(LayoutOpening(_name(one), kind, *ends, bottom, top))
    return made


def _objects(entities: Sequence[_Entity], floor: float, changes: Changes) -> list[LayoutObject]:
    made = []
    for one in entities:
        if one.kind != "bbox":
            continue
        category = labelled_category("spatiallm", one.label, changes)
        if category == "-":
            changes.note("boxes of doors and windows were left out: {}", _name(one))
            continue
        x, y, z, angle, *sides = one.values
        width, depth, height = (max(abs(side), _THINNEST) for side in sides)
        yaw = math.degrees(angle) % 360.0
        centre = (x, y, z - floor)
        made.append(
            LayoutObject(_name(one), category, centre, (width, depth, height), yaw, name=one.label)
        )
    return made


def _name(one: _Entity) -> str:
    return f"{one.kind}_{one.number}"


def _point(values: np.ndarray) -> Point2:
    return float(values[0]), float(values[1])
