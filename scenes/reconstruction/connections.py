"""Ways from room to room: archways, doors that stand open or ajar, and beams that part nothing.

Input: the triangles that stop light, as a ray caster, and the rooms. Output: pairs of rooms that
see each other, or rooms joined. An opening between rooms is no portal, for it does not lead
outdoors, but light passes it. World: metres, Z up.
"""

from __future__ import annotations

from itertools import combinations, pairwise

import numpy as np
import shapely
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from pbrnet.scenes.arrays import BoolArray, Float64Array
from pbrnet.scenes.geometry.directions import fibonacci_sphere
from pbrnet.scenes.geometry.regions import buffered, largest_part, simplified, union
from pbrnet.scenes.reconstruction.light_walks import points_in_room
from pbrnet.scenes.reconstruction.raycast import RayCaster
from pbrnet.scenes.reconstruction.rooms import FoundRoom
from pbrnet.scenes.seeds import generator

_RAYS = 4096  # from each room
DOOR = 10  # of them that end in the other room through a door that stands open by half a metre
ARCHWAY = 100  # the same through a passage of two metres
_MOST_WALL = 1.0  # metres between two rooms
_SAME_FLOOR, _SAME_CEILING = 0.15, 0.6  # metres between the heights of two parts of a room
_WIDEST_BEAM = 0.8  # metres
_BREAST, _ABOVE_HEAD = 1.4, 1.95  # metres above the floor where the way below a beam is free
_LEAST_BEAM = 0.05  # metres
_LEAST_BORDER, _OPEN_BORDER = 1.5, 0.7  # metres, and the share of it that is open below a beam
_STEP, _WITHIN, _SLACK = 0.1, 0.1, 0.03  # metres along a border, inside a room, beyond an edge
_INSIDE = 0.05  # metres inside a room where a ray must have ended or passed


def connected_rooms(
    rays: RayCaster, rooms: list[FoundRoom], least: int = DOOR
) -> list[tuple[int, int]]:
    """Return the pairs (i, j), i < j, of rooms with an opening between them.

    `least` is its size: `DOOR` or `ARCHWAY`.
    """
    pairs = set()
    for number, room in enumerate(rooms):
        near = [k for k, other in enumerate(rooms) if k != number and _are_near(room, other)]
        if not near:
            continue
        rng = generator(0, "connections", number)
        origins = points_in_room(room, _RAYS, rng)
        directions = rng.permutation(fibonacci_sphere(_RAYS))
        distances, _ = rays.cast(origins, directions)
        ends = origins + np.where(np.isfinite(distances), distances, 0.0)[:, None] * directions
        for other in near:
            if int(_are_inside(rooms[other], ends).sum()) >= least:
                pairs.add((min(number, other), max(number, other)))
    return sorted(pairs)


def _are_near(first: FoundRoom, second: FoundRoom) -> bool:
    """Return whether a wall at most may lie between two rooms."""
    height = min(first.ceiling_z, second.ceiling_z) - max(first.floor_z, second.floor_z)
    return bool(
        height > 0
        and first.is_near(second, _MOST_WALL)
        and first.floor.distance(second.floor) < _MOST_WALL
    )


def _are_inside(room: FoundRoom, points: Float64Array) -> BoolArray:
    """Return which of `points` (N, 3) lie in a room or on its surfaces, off its outline in plan."""
    inner = buffered(room.floor, -_INSIDE)
    level = (points[:, 2] > room.floor_z - _INSIDE) & (points[:, 2] < room.ceiling_z + _INSIDE)
    return level & shapely.contains_xy(inner, points[:, 0], points[:, 1])


def joined_below_beams(rooms: list[FoundRoom], rays: RayCaster) -> list[FoundRoom]:
    """The rooms, those that only a beam below the ceiling parts joined: a person sees one room.

    Such neighbours are open to each other along most of their border, above a person's height.
    """
    groups = {number: [number] for number in range(len(rooms))}
    strips: list[BaseGeometry] = []
    for first, second in combinations(range(len(rooms)), 2):
        strip = _below_beam(rooms[first], rooms[second], rays)
        if strip is not None:
            strips.append(strip)
            if groups[first] is not groups[second]:
                groups[first] += groups[second]
                for number in groups[second]:
                    groups[number] = groups[first]
    made = []
    for number, members in groups.items():
        if number != members[0]:
            continue
        if len(members) == 1:
            made.append(rooms[number])
            continue
        parts = [rooms[member] for member in members]
        floors = union([room.floor for room in parts])
        whole = union([floors, *(strip for strip in strips if strip.intersects(floors))])
        outline = simplified(Polygon(largest_part(whole).exterior), _SLACK)
        largest = max(parts, key=lambda room: float(room.floor.area))
        made.append(FoundRoom(orient(outline), largest.floor_z, largest.ceiling_z))
    return made


def _below_beam(first: FoundRoom, second: FoundRoom, rays: RayCaster) -> BaseGeometry | None:
    """The plan of the beam between two rooms that are one below it; None if they are not."""
    if (
        abs(first.floor_z - second.floor_z) > _SAME_FLOOR
        or abs(first.ceiling_z - second.ceiling_z) > _SAME_CEILING
        or min(first.ceiling_z, second.ceiling_z) - first.floor_z < _ABOVE_HEAD + _LEAST_BEAM
        or not first.is_near(second, _WIDEST_BEAM)
    ):
        return None
    facing, strips = 0, []
    for start, end in pairwise(np.array(first.floor.exterior.coords)):
        length = float(np.linalg.norm(end - start))
        if length < _STEP:
            continue
        along = (end - start) / length
        outward = np.array([along[1], -along[0]])
        places = start + np.arange(0.5 * _STEP, length, _STEP)[:, None] * along
        across = shapely.linestrings(np.stack([places, places + _WIDEST_BEAM * outward], axis=1))
        meets = shapely.intersects(across, second.floor)
        places = places[meets]
        if not len(places):
            continue
        facing += len(places)
        width = shapely.distance(shapely.points(places), second.floor)
        free = np.ones(len(places), dtype=bool)
        for height in (_BREAST, _ABOVE_HEAD):
            level = np.full(len(places), first.floor_z + height)
            eyes = np.column_stack([places - _WITHIN * outward, level])
            free &= rays.cast(eyes, np.append(outward, 0.0))[0] > width + 2 * _WITHIN
        ends = places + (width + _SLACK)[:, None] * outward
        lines = shapely.linestrings(np.stack([places - _SLACK * outward, ends], axis=1)[free])
        strips += [buffered(line, 0.51 * _STEP, cap_style="flat") for line in lines]
    if facing * _STEP < _LEAST_BORDER or len(strips) < _OPEN_BORDER * facing:
        return None
    return union(strips)
