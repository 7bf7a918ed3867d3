"""Lights of `scene.json` by room, and the rooms that light reaches.

A room has light if it has a lamp, a portal, or an opening to a room that has one. Only a wide
opening lets in enough that it needs no lamp.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from xml.etree.ElementTree import Element

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.contract import Light, Portal
from pbrnet.scenes.geometry.directions import fibonacci_sphere
from pbrnet.scenes.geometry.mesh import face_areas
from pbrnet.scenes.importing.light.plan import OUTDOORS
from pbrnet.scenes.importing.shape import Emitter, Shape
from pbrnet.scenes.importing.shapes.panes import solid_corners
from pbrnet.scenes.reconstruction.connections import ARCHWAY, DOOR, connected_rooms
from pbrnet.scenes.reconstruction.raycast import RayCaster
from pbrnet.scenes.reconstruction.rooms import FoundRoom, has_view_outside

_LAMP_POINTS = 4  # of an area light, on each side
_LAMP_OFFSET = 0.01  # metres from its surface
_MOST_POINTS = 64
_DIRECTIONS = 256
_BEFORE = 0.05  # metres before a surface, where a ray is still in the room that it lights


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


@dataclass(frozen=True)
class RoomLighting:
    """All that decides which rooms of a scene have light."""

    shapes: list[Shape]
    rooms: list[FoundRoom]
    room_ids: list[str]
    lights: tuple[Light, ...]
    portals: tuple[Portal, ...]
    positions: Sequence[tuple[float, float, float]] = ()  # of point lights
    dim: frozenset[str] = frozenset()  # ids of rooms whose own lamps are too weak to count

    @cached_property
    def rays(self) -> RayCaster:
        """The surfaces that stop light."""
        return RayCaster(solid_corners(self.shapes))

    @cached_property
    def lit(self) -> set[str | None]:
        """The ids of rooms with a lamp or a portal, and of those that see one through an opening.

        A guessed room has light, too, if a ray leaves the building from it, and any room that a
        ray enters from a lamp in no room, such as one in a recess.
        """
        return self._lit(has_outdoors=True, way=DOOR)

    @property
    def dark(self) -> list[int]:
        """Numbers of the rooms that need a lamp: without light, or with that of a door alone.

        Portals count only if something shines outdoors.
        """
        has_outdoors = any(light.kind in OUTDOORS for light in self.lights)
        lit = self._lit(has_outdoors, way=ARCHWAY)
        return [number for number, name in enumerate(self.room_ids) if name not in lit]

    def _lit(self, has_outdoors: bool, way: int) -> set[str | None]:
        lit = {light.room for light in self.lights} - self.dim
        if has_outdoors:
            lit |= {portal.room for portal in self.portals}
        if lit.issuperset(self.room_ids):
            return lit
        in_no_room = [
            each
            for each in self.positions
            if _room_at(np.array(each), self.rooms, self.room_ids) is None
        ]
        points = _lamp_points(self.shapes, self.lights, in_no_room)
        lit |= {
            name
            for name, room in zip(self.room_ids, self.rooms, strict=True)
            if (name not in lit and _is_reached(self.rays, points, room))
            or (has_outdoors and room.guessed and has_view_outside(self.rays, room))
        }
        neighbours = [
            (self.room_ids[a], self.room_ids[b])
            for i, j in connected_rooms(self.rays, self.rooms, way)
            for a, b in ((i, j), (j, i))
        ]
        return lit | {there for here, there in neighbours if here in lit}


def _lamp_points(
    shapes: list[Shape],
    lights: tuple[Light, ...],
    positions: Sequence[tuple[float, float, float]],
) -> Float64Array:
    """Points (N, 3) on both sides of the area lights in no room, and of point lights."""
    names = {name for light in lights if light.room is None for name in light.shapes}
    points = [np.array(positions, dtype=np.float64).reshape(-1, 3)]
    for shape in shapes:
        if shape.id in names:
            corners = shape.mesh.corners
            some = corners[np.linspace(0, len(corners) - 1, _LAMP_POINTS).astype(np.int64)]
            _, normals = face_areas(some)
            points += [some.mean(axis=1) + side * _LAMP_OFFSET * normals for side in (-1, 1)]
    found = np.concatenate(points)
    count = min(len(found), _MOST_POINTS)
    return found[np.linspace(0, max(len(found) - 1, 0), count).astype(np.int64)]


def _is_reached(rays: RayCaster, points: Float64Array, room: FoundRoom) -> bool:
    """Return whether a ray from one of `points` (N, 3) ends inside a room."""
    directions = fibonacci_sphere(_DIRECTIONS)
    for point in points:
        distance, _ = rays.cast(point, directions)
        hits = np.isfinite(distance)
        ends = point + (distance[hits, None] - _BEFORE) * directions[hits]
        if any(room.contains(end) for end in ends):
            return True
    return False


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
