"""Lights of `scene.json` by room, and the rooms that light reaches.

A room has light if it has a lamp, a portal, or an opening to a room that has one.
"""

from __future__ import annotations

from xml.etree.ElementTree import Element

import numpy as np

from scenes.arrays import Float64Array
from scenes.contract import Light, Portal
from scenes.importing.light.plan import OUTDOORS
from scenes.importing.panes import solid_corners
from scenes.importing.shape import Emitter, Shape
from scenes.reconstruction.connections import connected_rooms
from scenes.reconstruction.raycast import RayCaster
from scenes.reconstruction.rooms import FoundRoom, has_view_outside


def lights_of(
    shapes: list[Shape],
    area: dict[str, Element],
    others: list[Emitter],
    rooms: list[FoundRoom],
    room_ids: list[str],
) -> tuple[Light, ...]:
    """The lights of `scene.json`: area emitters by shape, then one for each kind of the others."""
    lights: list[Light] = []
    for shape in shapes:
        if shape.id in area:
            centre = shape.mesh.bounds.mean(axis=0)
            lights.append(
                Light(
                    f"light_{len(lights)}", "area", (shape.id,), _room_at(centre, rooms, room_ids)
                )
            )
    for emitter in others:
        for kind in emitter.kinds:
            room = None
            if emitter.position is not None:
                room = _room_at(np.array(emitter.position), rooms, room_ids)
            lights.append(Light(f"light_{len(lights)}", kind, (), room))
    return tuple(lights)


def rooms_with_light(
    shapes: list[Shape],
    rooms: list[FoundRoom],
    room_ids: list[str],
    lights: tuple[Light, ...],
    portals: tuple[Portal, ...],
    dim: frozenset[str] = frozenset(),
    is_day: bool = True,
) -> set[str | None]:
    """The ids of rooms with a lamp or a portal, and of those that see one through an opening.

    A guessed room has light, too, if a ray leaves the building from it. Lamps of the rooms with
    ids in `dim` do not count, and nothing from outdoors does unless `is_day`.
    """
    lit = {light.room for light in lights} - dim
    if is_day:
        lit |= {portal.room for portal in portals}
    if any(light.room is None and light.kind not in OUTDOORS for light in lights):
        lit.update(room_ids)
    if lit.issuperset(room_ids):
        return lit
    rays = RayCaster(solid_corners(shapes))
    lit |= {
        name
        for name, room in zip(room_ids, rooms, strict=True)
        if is_day and room.guessed and has_view_outside(rays, room)
    }
    neighbours = [
        (room_ids[a], room_ids[b])
        for i, j in connected_rooms(rays, rooms)
        for a, b in ((i, j), (j, i))
    ]
    return lit | {there for here, there in neighbours if here in lit}


def rooms_to_fill(
    shapes: list[Shape],
    rooms: list[FoundRoom],
    room_ids: list[str],
    lights: tuple[Light, ...],
    portals: tuple[Portal, ...],
    dim: frozenset[str] = frozenset(),
) -> list[int]:
    """Numbers of the rooms that have no light of their own and none from outdoors."""
    is_day = any(light.kind in OUTDOORS for light in lights)
    lit = rooms_with_light(shapes, rooms, room_ids, lights, portals, dim, is_day)
    return [number for number, name in enumerate(room_ids) if name not in lit]


def _room_at(point: Float64Array, rooms: list[FoundRoom], room_ids: list[str]) -> str | None:
    """The id of the room that contains a point (3,), or None."""
    for room, name in zip(rooms, room_ids, strict=True):
        if room.contains(point, 0.15):
            return name
    return None


def lighting_of(lights: tuple[Light, ...]) -> str:
    """Classify lights as "day", "night" or "mixed"."""
    outdoors = any(light.kind in OUTDOORS for light in lights)
    lamps = any(light.kind in ("area", "point", "spot") for light in lights)
    if outdoors and lamps:
        return "mixed"
    return "day" if outdoors else "night"
