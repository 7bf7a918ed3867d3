"""Categories of objects and types of rooms from the labels of layout formats."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import cast

from shapely.geometry import Point, Polygon

from pbrnet.scenes.files import data_beside
from pbrnet.scenes.importing.categories import category_of, room_type, words_of
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.layout.layout import LayoutObject, LayoutRoom, RoomType

_LABELS = data_beside(__file__)
_HALLS = frozenset(_LABELS["halls"])


def plain_label(label: str) -> str:
    """Return a label as lower-case words: "washerDryer" and "washer_dryer" are "washer dryer"."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", label)
    return " ".join(re.findall(r"[a-z0-9]+", spaced.lower()))


def labelled_category(format_name: str, label: str, changes: Changes) -> str:
    """Return the category of a label of a format, "-" for one that is no object.

    What is not known is "other", and named in the changes.
    """
    words = plain_label(label)
    found: str = _LABELS[format_name].get(words) or category_of(words)
    if found == "other":
        changes.note("kinds of objects that are not known became plain boxes: {}", label[:60])
    return found


def attribute_category(name: str, value: str) -> str | None:
    """Return the category that an attribute of a RoomPlan object tells, or None."""
    found: str | None = _LABELS["attributes"].get(f"{name} {value}")
    return found


def labelled_room(name: str) -> RoomType:
    """Return the type of a room from its name; "other" where no word tells it."""
    if words_of(name) & _HALLS:
        return "hall"
    return cast(RoomType, room_type(name, ()))


def typed_rooms(
    rooms: Iterable[LayoutRoom], objects: Sequence[LayoutObject]
) -> tuple[LayoutRoom, ...]:
    """The rooms, those whose name tells no type with that of the objects in them."""
    made = []
    for room in rooms:
        if room.type == "other":
            plan = Polygon(room.polygon)
            inside = [one.category for one in objects if plan.contains(Point(one.center[:2]))]
            room = replace(room, type=cast(RoomType, room_type("", inside)))
        made.append(room)
    return tuple(made)
