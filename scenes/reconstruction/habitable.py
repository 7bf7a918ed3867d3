"""Tells rooms from the insides of furniture and of solid walls.

Input: closed spaces found in triangles. Output: those that a person can be in.

- A space inside a piece of furniture is none.
- A solid, modelled by its surface, shows only the backs of its triangles from inside. If other
  spaces show fronts, it is none.
- A small closed space with nothing in it and no way out is a box if there are others, or if the
  scene is much larger.

World: metres, Z up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.geometry.directions import fibonacci_sphere
from pbrnet.scenes.geometry.mesh import face_areas
from pbrnet.scenes.geometry.regions import buffered, deepest_point
from pbrnet.scenes.reconstruction.raycast import RayCaster
from pbrnet.scenes.reconstruction.rooms import FoundRoom

_RAYS = 512  # from each of the points below
_HEIGHTS = (0.25, 0.55, 0.85)  # shares of the height where points are
_LEAST_FRONTS = 0.5  # share of the rays to walls that meet fronts in a space that proves the
# file's triangles to be oriented
_LEAST_BACKS = 0.95  # share of the rays in a solid that meet the back of a triangle first
_SAME_PLANE = 1e-3  # metres
_MARGIN = 0.5  # metres around a space in which its surfaces lie
_LEVEL = 0.5  # cosine of a normal's angle to the vertical, from which a surface is level
_INSIDE = 0.12  # metres off floor, walls and ceiling where something counts as in a space
_LEAST_CONTENTS = 0.005  # share of the rays
_LEAST_WAY_OUT = 0.02  # share of the rays; a shaft has gaps, a room has windows and doors
_LEAST_AREA = 3.0  # square metres of a closed space with nothing in it
_ELSEWHERE = 4.0  # times a single space's extent on the plan, from which a scene is much larger
_AROUND = 0.1  # metres by which a space may be larger than the furniture that it lies in

Bounds = tuple[Float64Array, Float64Array]  # lowest and highest corner (3,)


@dataclass(frozen=True)
class _Look:
    """Shares of the rays from inside a space: fronts of upright surfaces, contents, ways out."""

    fronts: float
    contents: float
    beyond: float

    @property
    def is_shut(self) -> bool:
        """Return whether the space is empty and has no way out."""
        return self.contents < _LEAST_CONTENTS and self.beyond == 0


def habitable(
    spaces: Sequence[FoundRoom],
    rays: RayCaster,
    corners: Float64Array,
    furniture: Sequence[Bounds] = (),
) -> list[FoundRoom]:
    """Return the spaces that are rooms.

    `corners` (F, 3, 3) are the triangles that `rays` holds, `furniture` the bounds of closed
    furniture, such as wardrobes.
    """
    outside = [
        space for space in spaces if not any(_lies_in(space, bounds) for bounds in furniture)
    ]
    if len(outside) == 1 and not _is_small_part(outside[0], corners):
        return outside  # a room may be all that a file holds, with triangles that face either way
    normals = face_areas(corners)[1]
    looks = [_look(space, rays, normals) for space in outside]
    oriented = len(outside) == 1 or any(look.fronts >= _LEAST_FRONTS for look in looks)
    return [
        space
        for space, look in zip(outside, looks, strict=True)
        if not look.is_shut
        or (
            space.floor.area >= _LEAST_AREA
            and not (oriented and _is_solid(space, rays, corners, normals))
        )
    ]


def is_shut_in(space: FoundRoom, rays: RayCaster, corners: Float64Array) -> bool:
    """Return whether a space is hardly open, as the inside of a pillar or a cupboard.

    `corners` (F, 3, 3) are the triangles that `rays` holds.
    """
    return _look(space, rays, face_areas(corners)[1]).beyond < _LEAST_WAY_OUT


def _lies_in(space: FoundRoom, bounds: Bounds) -> bool:
    low, high = bounds[0] - _AROUND, bounds[1] + _AROUND
    west, south, east, north = space.floor.bounds
    return bool(
        low[0] <= west and low[1] <= south and high[0] >= east and high[1] >= north
        and low[2] <= space.floor_z and high[2] >= space.ceiling_z
    )  # fmt: skip


def _is_small_part(space: FoundRoom, corners: Float64Array) -> bool:
    """Return whether the scene covers much more of the plan than a space does."""
    west, south, east, north = space.floor.bounds
    points = corners[..., :2].reshape(-1, 2)
    width, depth = points.max(axis=0) - points.min(axis=0)
    return bool(width * depth > _ELSEWHERE * (east - west) * (north - south))


def _origins(space: FoundRoom) -> Float64Array:
    """Points (N, 3) on a vertical line in the middle of a space."""
    middle = deepest_point(space.floor)
    height = space.ceiling_z - space.floor_z
    return np.array([[*middle, space.floor_z + share * height] for share in _HEIGHTS])


def _is_solid(
    space: FoundRoom, rays: RayCaster, corners: Float64Array, normals: Float64Array
) -> bool:
    """Return whether the first surface in nearly every direction is the back of a triangle.

    Fronts of neighbours may lie in the same plane, so backs are looked for alone.
    """
    west, south, east, north = space.floor.bounds
    low = np.array([west, south, space.floor_z]) - _MARGIN
    high = np.array([east, north, space.ceiling_z]) + _MARGIN
    near = ((corners.max(axis=1) >= low) & (corners.min(axis=1) <= high)).all(axis=1)
    origin = _origins(space)[1]
    backs = near & (np.sum((corners[:, 0] - origin) * normals, axis=1) > 0)
    if not backs.any():
        return False
    fan = fibonacci_sphere(_RAYS)
    first, _ = rays.cast(origin, fan)
    back, _ = RayCaster(corners[backs]).cast(origin, fan)
    return float((back <= first + _SAME_PLANE).mean()) >= _LEAST_BACKS


def _look(space: FoundRoom, rays: RayCaster, normals: Float64Array) -> _Look:
    """The shares of rays from the middle of a space."""
    origins = _origins(space)
    fan = fibonacci_sphere(_RAYS)
    starts = np.repeat(origins, _RAYS, axis=0)
    directions = np.tile(fan, (len(origins), 1))
    distances, triangles = rays.cast(starts, directions)
    hit = np.isfinite(distances)
    if not hit.any():
        return _Look(0.0, 0.0, 1.0)
    facing = normals[triangles[hit]]
    upright = np.abs(facing[:, 2]) < _LEVEL
    cosines = np.sum(facing * directions[hit], axis=1)[upright]
    points = starts[hit] + distances[hit, None] * directions[hit]
    inner, outer = buffered(space.floor, -_INSIDE), buffered(space.floor, 4 * _INSIDE)
    contents = (
        shapely.contains_xy(inner, points[:, 0], points[:, 1])
        & (points[:, 2] > space.floor_z + _INSIDE)
        & (points[:, 2] < space.ceiling_z - _INSIDE)
    )
    beyond = ~shapely.contains_xy(outer, points[:, 0], points[:, 1])
    return _Look(
        float((cosines < 0).mean()) if upright.any() else 0.0,
        float(contents.mean()),
        float((beyond.sum() + (~hit).sum()) / len(distances)),
    )
