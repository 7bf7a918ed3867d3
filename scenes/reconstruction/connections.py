"""Ways from room to room: archways, doors that stand open or ajar.

Input: the triangles that stop light, as a ray caster, and the rooms. Output: pairs of rooms that
see each other. Such an opening is no portal, for it does not lead outdoors, but light passes it.
World: metres, Z up.
"""

from __future__ import annotations

import numpy as np
import shapely

from pbrnet.scenes.arrays import BoolArray, Float64Array
from pbrnet.scenes.geometry.directions import fibonacci_sphere
from pbrnet.scenes.geometry.regions import buffered
from pbrnet.scenes.reconstruction.light_walks import points_in_room
from pbrnet.scenes.reconstruction.raycast import RayCaster
from pbrnet.scenes.reconstruction.rooms import FoundRoom
from pbrnet.scenes.seeds import generator

_RAYS = 4096  # from each room
DOOR = 10  # of them that end in the other room through a door that stands open by half a metre
ARCHWAY = 100  # the same through a passage of two metres
_MOST_WALL = 1.0  # metres between two rooms
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
