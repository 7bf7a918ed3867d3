"""Rooms of a building given as plain triangles: closed ones, and those that were left open.

Input: triangles (F, 3, 3) in metres, Z up. Grounds are set apart, solids and furniture left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from shapely.geometry import Polygon

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.geometry.directions import horizontal_directions
from pbrnet.scenes.geometry.mesh import face_areas
from pbrnet.scenes.geometry.regions import difference, intersection, union
from pbrnet.scenes.reconstruction.completion import (
    MOST_CLOSED,
    Completion,
    closed_slits,
    complete,
)
from pbrnet.scenes.reconstruction.connections import joined_below_beams
from pbrnet.scenes.reconstruction.habitable import Bounds, habitable, is_shut_in
from pbrnet.scenes.reconstruction.raycast import RayCaster
from pbrnet.scenes.reconstruction.rooms import (
    MAX_HEIGHT,
    MIN_HEIGHT,
    FoundRoom,
    closed_rooms,
    inside_points,
    with_visible_space,
    without_overlaps,
)
from pbrnet.scenes.reconstruction.surroundings import without_backdrop, without_ground

_OPEN_SIDES = 0.25  # share of a room's outline without walls, from which it is part of a space
_TINY = 5.0  # square metres of all closed rooms together, of what may be holes in thick walls
_STEP = 0.25  # metres along an outline, and beyond it
_INSET = 0.1  # metres within an outline
_HEIGHTS = (0.4, 0.75)  # shares of a room's height
_PART = 0.7  # share of a space that its covered part has at most, and the sky over the rest
_PLACES = 200
_UPRIGHT = 0.1  # greatest vertical part of a wall's normal
_WALLED = 0.5  # share of the horizontal rays from a camera in a room that meet walls
_BESIDE = 0.3  # metres that a camera in a room may be outside it
_SLAB = 0.6  # metres from a ceiling to above the next storey's floor
_UP = np.array([0.0, 0.0, 1.0])


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


def find_interior(corners: Float64Array) -> Interior:
    """Find closed rooms; if there is none, how open spaces can become rooms.

    A room whose ceiling covers a part of an open space, as in scans, is that space, and tiny rooms
    beside much larger open spaces do not count.

    A storey that is open above closed ones, as over a basement, becomes rooms, too.

    Closed spaces that are hardly open and small beside the open ones, such as pillars, shafts
    and built-in cupboards, do not count as rooms.
    """
    building, is_ground = without_ground(corners)
    rays = RayCaster(building)
    rooms = _closed(rays, building)
    completion = closed_slits(building, rays, rooms)
    if completion.slits:
        added = completion.ceilings
        building, rays = np.concatenate([building, added]), RayCaster(added, rays)
        is_ground = np.append(is_ground, np.zeros(len(added), dtype=bool))
        rooms = _closed(rays, building)
    elif (is_shut := all(is_shut_in(room, rays, building) for room in rooms)) or (
        _has_walls_above(rooms, rays, building)
    ):
        completion = complete(building, is_ground, rooms)
        if completion.spaces and is_shut:
            rooms = [room for room in rooms if room.ceiling_z <= completion.floor_z]
    elif (is_tiny := sum(room.floor.area for room in rooms) < _TINY) or any(
        _open_share(room, rays) > _OPEN_SIDES for room in rooms
    ):
        whole = complete(building, is_ground, ())
        if whole.spaces and (
            (is_tiny and _are_small(rooms, whole.spaces))
            or all(_is_partly_covered(one, rooms, rays) for one in whole.spaces)
        ):
            rooms, completion = [], whole
    return Interior(rooms, completion, bool(is_ground.any()))


def _has_walls_above(rooms: Sequence[FoundRoom], rays: RayCaster, corners: Float64Array) -> bool:
    """Return whether walls stand above the highest rooms under the open sky: a storey cut open."""
    top = max(room.ceiling_z for room in rooms)
    high = [room for room in rooms if room.ceiling_z > top - MIN_HEIGHT]
    _, normals = face_areas(corners)
    reach = corners[:, :, 2].max(axis=1) - top
    if not (
        (np.abs(normals[:, 2]) < _UPRIGHT) & (reach >= MIN_HEIGHT) & (reach <= MAX_HEIGHT)
    ).any():
        return False
    origins = np.concatenate(
        [
            np.column_stack([points, np.full(len(points), room.ceiling_z + _SLAB)])
            for room in high
            for points in [inside_points(room.floor, _PLACES)]
        ]
    )
    return bool(len(origins)) and float(rays.escapes(origins, _UP).mean()) > _PART


def _open_share(room: FoundRoom, rays: RayCaster) -> float:
    """Share of a room's outline beside which no wall stands."""
    ring = np.array(room.floor.exterior.coords)
    open_length = 0.0
    for start, end in pairwise(ring):
        length = float(np.linalg.norm(end - start))
        along = (end - start) / max(length, 1e-9)
        outward = np.array([along[1], -along[0], 0.0])
        places = np.arange(0.5 * _STEP, length, _STEP)
        if not len(places):
            continue
        plan = start + places[:, None] * along
        is_open = np.ones(len(places), dtype=bool)
        for share in _HEIGHTS:
            z = room.floor_z + share * (room.ceiling_z - room.floor_z)
            origins = np.column_stack([plan, np.full(len(plan), z)]) - _INSET * outward
            is_open &= rays.cast(origins, outward)[0] > _INSET + _STEP
        open_length += float(is_open.mean()) * length
    return open_length / float(room.floor.length)


def _are_small(rooms: Sequence[FoundRoom], spaces: Sequence[Polygon]) -> bool:
    """Return whether rooms are small beside open spaces, as a window's hole in a thick wall."""
    area = sum(space.area for space in spaces)
    return bool(sum(room.floor.area for room in rooms) <= MOST_CLOSED * area)


def _is_partly_covered(space: Polygon, rooms: Sequence[FoundRoom], rays: RayCaster) -> bool:
    """Return whether rooms are the covered part of an open space that is much larger."""
    inside = [
        room for room in rooms
        if intersection(space, room.floor).area > _PART * room.floor.area
    ]  # fmt: skip
    if not inside or len(inside) < len(rooms):
        return False
    covered = union([room.floor for room in inside])
    if covered.area > _PART * space.area:
        return False
    points = inside_points(difference(space, covered), _PLACES)
    z = inside[0].floor_z + 0.5 * (inside[0].ceiling_z - inside[0].floor_z)
    origins = np.column_stack([points, np.full(len(points), z)])
    return bool(len(points)) and float(rays.escapes(origins, _UP).mean()) > _PART


def find_rooms(
    corners: Float64Array, eye: Float64Array | None, furniture: Sequence[Bounds] = ()
) -> list[FoundRoom]:
    """Find all closed rooms, and the space around a camera at `eye` (3,).

    That space is added as a guessed room if no room contains the camera. Without a camera and
    without rooms, a point in the middle of the scene stands for the camera. A box around walls
    that surround the camera is a backdrop, not the room.
    """
    building, _ = without_ground(corners)
    inner = None if eye is None else without_backdrop(building)
    if eye is not None and inner is not None and _is_walled(rays := RayCaster(inner), eye):
        rooms = with_visible_space(rays, inner, _closed(rays, inner, furniture), eye)
        if any(room.contains(eye, _BESIDE) for room in rooms):
            return rooms
    rays = RayCaster(building)
    return with_visible_space(rays, building, _closed(rays, building, furniture), eye)


def _is_walled(rays: RayCaster, eye: Float64Array) -> bool:
    """Return whether a floor is below `eye` (3,), and walls around half of it or more."""
    ways = np.concatenate([horizontal_directions(_PLACES), -_UP[None]])
    meets = np.isfinite(rays.cast(eye[None], ways)[0])
    return bool(meets[-1] and meets[:-1].mean() >= _WALLED)


def _closed(
    rays: RayCaster, corners: Float64Array, furniture: Sequence[Bounds] = ()
) -> list[FoundRoom]:
    rooms = without_overlaps(habitable(closed_rooms(rays, corners), rays, corners, furniture))
    return joined_below_beams(rooms, rays)
