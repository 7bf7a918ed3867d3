"""Small things in the rooms of a layout that it does not state: as people leave them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from pbrnet.scenes.procedural.furnishing.furnisher import Furnisher
from pbrnet.scenes.procedural.furnishing.placement import PlacedInRoom, leave_small_objects
from pbrnet.scenes.procedural.furniture import Style
from pbrnet.scenes.procedural.piece import FurniturePiece
from pbrnet.scenes.procedural.plan import Plan
from pbrnet.scenes.seeds import Draw

_FIRST = 10_000  # number of the first thing of a room, above those of stated objects


def left_things(
    rng: Draw, plan: Plan, style: Style, placed: Iterable[PlacedInRoom]
) -> tuple[PlacedInRoom, ...]:
    """Return cloth, things, switches and sockets in rooms with placed furniture.

    They keep clear of all that is placed; at slanted walls there are none.
    """
    placed = list(placed)
    found = []
    plants: list[FurniturePiece] = []
    for room in plan.rooms:
        own = plan if room.height is None else replace(plan, height=room.height)
        kind = room.type if room.type != "other" else "hall"
        furnisher = Furnisher(rng, own, replace(room, type=kind), style, plants)
        stated = [each.placed for each in placed if each.room == room.id]
        for one in stated:
            furnisher.space.add(replace(one))
        leave_small_objects(furnisher)
        for number, item in enumerate(furnisher.space.items[len(stated) :]):
            renamed = replace(item, id=f"{room.id}-{item.kind}-{_FIRST + number}")
            found.append(PlacedInRoom(room.id, renamed))
    return tuple(found)
