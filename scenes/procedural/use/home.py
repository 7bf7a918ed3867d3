"""Traces of use on all surfaces of a home."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from pbrnet.scenes.procedural.plan import Plan
from pbrnet.scenes.procedural.scene_item import SceneItem
from pbrnet.scenes.procedural.use.faces import split, whole
from pbrnet.scenes.procedural.use.floors import on_floor
from pbrnet.scenes.procedural.use.furniture import TOPS, on_leaf, on_seats
from pbrnet.scenes.procedural.use.walls import on_walls
from pbrnet.scenes.seeds import generator


def leave_traces(items: Iterable[SceneItem], plan: Plan, seed: int) -> list[SceneItem]:
    """Return the items with traces of use on the surfaces that hands and feet reach."""
    items = list(items)
    rooms = {room.id: room for room in plan.rooms}
    done = []
    for item in items:
        rng = generator(seed, "use", item.id)
        if item.category == "floor" and item.room in rooms:
            room = rooms[item.room]
            standing = [each for each in items if each.room == item.room and not each.is_structure]
            item = whole(item, on_floor(plan, room, standing), rng)
        elif item.category == "wall" and item.room in rooms:
            beside = [each for each in items if each.room == item.room and not each.is_structure]
            item = on_walls(item, beside, rng)
        elif item.category == "door":
            levers = [part.vertices.mean(axis=0) for part in item.parts if part.name == "lever"]
            if levers:
                item = on_leaf(item, levers[0], rng)
        elif item.name in TOPS:
            name, marks = TOPS[item.name]
            item = split(item, name, np.array([0.0, 0.0, 1.0]), marks, rng)
        elif item.category in ("sofa", "armchair"):
            item = on_seats(item, rng)
        done.append(item)
    return done
