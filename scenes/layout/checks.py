"""Checks of a layout that a reader made, before anything is built."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable

from pbrnet.scenes.checked import shown
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.layout.building.walls import check_ring, counter_clockwise
from pbrnet.scenes.layout.layout import MAX_PLACE, MAX_SIZE, Layout, LayoutObject
from pbrnet.scenes.layout.storey import main_storey
from pbrnet.scenes.looks import STYLES

MOST_ROOMS = 200
MOST_CORNERS = 400  # of a room
MOST_OPENINGS = 2000
MOST_OBJECTS = 10_000
_SPREAD = 300.0  # metres between the farthest rooms
_LOW, _HIGH = 1.8, 20.0  # metres, of rooms


def check_layout(layout: Layout) -> Layout:
    """Return a layout that can be built: one storey, polygons counter-clockwise, floors at 0.

    Raises `InputError` that begins with the key, such as "rooms[2].polygon".
    """
    for key, most in (
        ("rooms", MOST_ROOMS),
        ("openings", MOST_OPENINGS),
        ("objects", MOST_OBJECTS),
    ):
        found = getattr(layout, key)
        if len(found) > most:
            raise InputError(f"{key}: {len(found):,} are too many; at most {most:,} are read")
        _check_ids(key, [each.id for each in found])
    if not layout.rooms:
        raise InputError("rooms: there is none; a layout needs at least one room")
    if layout.style and layout.style not in STYLES:
        raise InputError(f"style: {shown(layout.style)} is not one of {', '.join(STYLES)}")
    for key, low, high in (("height", _LOW, _HIGH), ("wall", 0.02, 1.0), ("outer_wall", 0.05, 2.0)):
        _check(key, [getattr(layout, key)], low, high)
    _check_rooms(layout)
    _check_openings(layout)
    names = {each.id for each in layout.rooms}
    carriers = {each.id for each in layout.objects}
    for number, each in enumerate(layout.objects):
        where = f"objects[{number}]"
        _check_object(each, where)
        _check_known(f"{where}.room", each.room, names, "room")
        _check_known(f"{where}.on", each.on, carriers - {each.id}, "other object")
    return counter_clockwise(main_storey(layout))


def _check_rooms(layout: Layout) -> None:
    for number, room in enumerate(layout.rooms):
        where = f"rooms[{number}]"
        if len(room.polygon) > MOST_CORNERS:
            raise InputError(f"{where}.polygon: more than {MOST_CORNERS} corners")
        _check(f"{where}.polygon", [x for point in room.polygon for x in point])
        check_ring(room.polygon, f"{where}.polygon")
        _check(f"{where}.floor_z", [room.floor_z])
        if room.height is not None:
            _check(f"{where}.height", [room.height], _LOW, _HIGH)
    for axis in (0, 1):
        places = [point[axis] for room in layout.rooms for point in room.polygon]
        if max(places) - min(places) > _SPREAD:
            raise InputError(
                f"rooms: they spread over more than {_SPREAD:g} m; is the unit metres?"
            )


def _check_openings(layout: Layout) -> None:
    names = {each.id for each in layout.rooms}
    for number, each in enumerate(layout.openings):
        where = f"openings[{number}]"
        _check(where, [*each.start, *each.end])
        _check(f"{where}.bottom", [each.bottom], 0.0, MAX_SIZE)
        _check(f"{where}.top", [each.top], 0.0, MAX_SIZE)
        if each.top <= each.bottom:
            raise InputError(f"{where}.top: {each.top:g} is not above bottom {each.bottom:g}")
        if math.dist(each.start, each.end) < 0.05:
            raise InputError(f"{where}: less than 0.05 m wide")
        if each.open_degrees is not None:
            _check(f"{where}.open_degrees", [each.open_degrees], 0.0, 180.0)
        _check_known(f"{where}.swing", each.swing, names, "room")
        _check_known(f"{where}.room", each.room, names, "room")


def _check_object(each: LayoutObject, where: str) -> None:
    _check(f"{where}.center", each.center)
    _check(f"{where}.size", each.size, 1e-4, MAX_SIZE)
    _check(f"{where}.yaw", [each.yaw], -1e6, 1e6)
    if not each.category.strip():
        raise InputError(f"{where}.category: is empty")


def _check(
    where: str, values: Iterable[float], low: float = -MAX_PLACE, high: float = MAX_PLACE
) -> None:
    """Check that numbers are finite and in a range."""
    for value in values:
        if not low <= value <= high:  # NaN is in no range
            raise InputError(f"{where}: {value:g} is not from {low:g} to {high:g}")


def _check_known(where: str, name: str | None, known: Iterable[str], what: str) -> None:
    if name is not None and name not in known:
        raise InputError(f"{where}: {shown(name)} is the id of no {what}")


def _check_ids(key: str, ids: list[str]) -> None:
    for name, count in Counter(ids).items():
        if count > 1:
            raise InputError(f"{key}: the id {shown(name)} is used {count} times")
