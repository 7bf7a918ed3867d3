"""Plan of a layout for the generator of procedural homes."""

from __future__ import annotations

import re

from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.layout.building.openings import cut_openings
from pbrnet.scenes.layout.building.walls import build_shell
from pbrnet.scenes.layout.layout import Layout, LayoutOpening
from pbrnet.scenes.procedural.plan import Plan, PlanRoom, WallEdge

_PLAIN = re.compile(r"[A-Za-z][A-Za-z0-9_]*(-[A-Za-z0-9_]+)*")
_LONGEST = 40  # characters of a room's id that stays
_REPLACED = "space-"  # beginning of the other ids
_RESERVED = (  # beginnings of ids of parts of the building
    *(_REPLACED, "floor", "walls", "ceiling", "trim", "beams", "niche", "stair", "facade", "slabs"),
    *("outside", "portal", "door", "window", "entrance", "archway", "opening", "cloud"),
)


def plan_of(
    layout: Layout, ground: float, changes: Changes
) -> tuple[Plan, dict[str, LayoutOpening]]:
    """Return the plan of a checked layout, and by their ids what its openings were stated as.

    The rooms have the layout's order. `ground` is the height of the ground outdoors, metres.
    Raises `InputError` that names what cannot be built.
    """
    shell = build_shell(layout, changes)
    tallest = max(room.height or layout.height for room in layout.rooms)
    rooms = tuple(
        PlanRoom(
            id=room_id,
            type=stated.type,
            polygon=floor,
            edges=_edges(floor),
            name=printable(stated.name),
            height=None
            if (stated.height or layout.height) == tallest
            else (stated.height or layout.height),
        )
        for stated, floor, room_id in zip(layout.rooms, shell.floors, _ids(layout), strict=True)
    )
    first, *further = shell.parts
    rings = (*shell.parts, *shell.yards)
    cut = cut_openings(layout, rooms, rings, changes)
    plan = Plan(
        rooms=rooms,
        openings=tuple(opening for opening, _ in cut),
        inner=rooms[0].polygon,
        outline=first,
        outer_thickness=layout.outer_wall,
        partition=layout.wall,
        height=tallest,
        ground=ground,
        further=(*further, *shell.yards),
    )
    return plan, {opening.id: stated for opening, stated in cut}


def _edges(floor: tuple[tuple[float, float], ...]) -> tuple[WallEdge, ...]:
    ends = floor[1:] + floor[:1]
    return tuple(WallEdge(start, end, False) for start, end in zip(floor, ends, strict=True))


def _ids(layout: Layout) -> list[str]:
    """Ids of the rooms, which become parts of file names; unsuitable ones are replaced."""
    made: list[str] = []
    used: set[str] = set()
    for number, room_id in enumerate(layout.room_ids()):
        suits = _PLAIN.fullmatch(room_id) and len(room_id) <= _LONGEST
        taken = room_id.lower() in used or room_id.lower().startswith(_RESERVED)
        made.append(room_id if suits and not taken else f"{_REPLACED}{number}")
        used.add(made[-1].lower())
    return made


def printable(name: str) -> str:
    """A name from outside without control characters, at most 80 characters."""
    return "".join(sign if sign.isprintable() else " " for sign in name[:80]).strip()
