"""Rooms of a building given as plain triangles: closed ones, and those that were left open.

Input: triangles (F, 3, 3) in metres, Z up. Grounds are set apart, solids and furniture left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from shapely.geometry import Polygon

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.reconstruction.completion import NOTHING, Completion, complete
from pbrnet.scenes.reconstruction.habitable import Bounds, habitable, is_shut_in
from pbrnet.scenes.reconstruction.raycast import RayCaster
from pbrnet.scenes.reconstruction.rooms import (
    FoundRoom,
    closed_rooms,
    with_visible_space,
    without_overlaps,
)
from pbrnet.scenes.reconstruction.surroundings import without_ground


@dataclass(frozen=True)
class Interior:
    """The closed rooms of a building and what its open spaces lack to be rooms."""

    rooms: list[FoundRoom]
    completion: Completion
    has_ground: bool

    @property
    def floors(self) -> list[Polygon]:
        """The floors of closed rooms and of open spaces that become rooms."""
        return [*(room.floor for room in self.rooms), *self.completion.spaces]


def find_interior(corners: Float64Array, furniture: Sequence[Bounds] = ()) -> Interior:
    """Find closed rooms; if there is none, how open spaces can become rooms.

    Closed spaces that are hardly open and small beside the open ones, such as pillars, shafts
    and built-in cupboards, do not count as rooms.
    """
    building, is_ground = without_ground(corners)
    rays = RayCaster(building)
    rooms = _closed(rays, building, furniture)
    if all(is_shut_in(room, rays, building) for room in rooms):
        completion = complete(building, is_ground, rooms)
        if completion.spaces:
            rooms = []
    else:
        completion = NOTHING
    return Interior(rooms, completion, bool(is_ground.any()))


def find_rooms(
    corners: Float64Array, eye: Float64Array | None, furniture: Sequence[Bounds] = ()
) -> list[FoundRoom]:
    """Find all closed rooms, and the space around a camera at `eye` (3,).

    That space is added as a guessed room if no room contains the camera. Without a camera and
    without rooms, a point in the middle of the scene stands for the camera.
    """
    building, _ = without_ground(corners)
    rays = RayCaster(building)
    return with_visible_space(rays, building, _closed(rays, building, furniture), eye)


def _closed(rays: RayCaster, corners: Float64Array, furniture: Sequence[Bounds]) -> list[FoundRoom]:
    return without_overlaps(habitable(closed_rooms(rays, corners), rays, corners, furniture))
