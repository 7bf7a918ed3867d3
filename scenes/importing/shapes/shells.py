"""Shells of rooms in one mesh: floor, ceiling and walls as shapes of their own.

Scans, merged exports and rooms modelled as a box have floors and walls in one mesh, which could be
only one of them. Input: shapes in metres, Z up, and the rooms found. World: metres, Z up.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
import shapely

from pbrnet.scenes.arrays import BoolArray, Float64Array
from pbrnet.scenes.geometry.mesh import face_areas
from pbrnet.scenes.geometry.regions import buffered
from pbrnet.scenes.importing.names import extended
from pbrnet.scenes.importing.shape import Shape
from pbrnet.scenes.reconstruction.rooms import FoundRoom

_LEVEL, _UPRIGHT = 0.9, 0.3  # vertical parts of the normals of level faces, and of walls
_ON_LEVEL = 0.06  # metres from a room's floor or ceiling at which a face belongs to it
_BESIDE = 0.1  # metres beyond a room's outline
_COVERED = 0.5  # least share of a room's floor that its floor or ceiling in a shell covers
_LEAST_WALL = 1.0  # square metres of upright faces between floor and ceiling
_HALF_WAY = 0.3  # of a room's height, from its middle to the middle of such a face


def with_parted_shells(
    shapes: list[Shape], rooms: Sequence[FoundRoom], whole: Collection[str]
) -> list[Shape]:
    """Part shapes that are walls and also floors or ceilings of rooms.

    The walls keep the id; those of `whole` are left as they are, as are see-through ones.
    """
    taken = {shape.id.lower() for shape in shapes}
    made: list[Shape] = []
    for shape in shapes:
        levels = None
        if shape.id not in whole and shape.sphere is None and not shape.surface.see_through:
            levels = _levels(shape, rooms)
        if levels is None:
            made.append(shape)
            continue
        rest = ~(levels["floor"] | levels["ceiling"])
        made.append(replace(shape, mesh=shape.mesh.subset(rest)))
        for kind, chosen in levels.items():
            if chosen.any():
                id_ = extended(f"{shape.id}_{kind}", taken)
                made.append(replace(shape, id=id_, name=kind, mesh=shape.mesh.subset(chosen)))
    return made


def _levels(shape: Shape, rooms: Sequence[FoundRoom]) -> dict[str, BoolArray] | None:
    """The faces (F,) of rooms' floors and ceilings in a shell; None if it is no shell."""
    low, high = shape.mesh.bounds
    near = [
        room
        for room in rooms
        if not room.guessed
        and (high[:2] - low[:2]).prod() >= _COVERED * room.floor.area
        and low[2] < room.ceiling_z
        and high[2] > room.floor_z
    ]
    if not near:
        return None
    corners = shape.mesh.corners
    areas, normals = face_areas(corners)
    middles, steep = corners.mean(axis=1), np.abs(normals[:, 2])
    first, last = corners[:, :, :2].min(axis=1), corners[:, :, :2].max(axis=1)
    found = {kind: np.zeros(len(corners), dtype=bool) for kind in ("floor", "ceiling")}
    wall = np.zeros(len(corners), dtype=bool)
    for room in near:
        share = (middles[:, 2] - room.floor_z) / (room.ceiling_z - room.floor_z)
        wall |= _over(room, middles) & (steep < _UPRIGHT) & (np.abs(share - 0.5) < _HALF_WAY)
        for kind, height in (("floor", room.floor_z), ("ceiling", room.ceiling_z)):
            level = (steep > _LEVEL) & (np.abs(corners[:, :, 2] - height).max(axis=1) < _ON_LEVEL)
            level &= ((last >= room.bounds[:2]) & (first <= room.bounds[2:])).all(axis=1)
            if areas[level].sum() >= _COVERED * room.floor.area:
                found[kind] |= level
    if areas[wall].sum() < _LEAST_WALL or not (found["floor"] | found["ceiling"]).any():
        return None
    return found


def _over(room: FoundRoom, points: Float64Array) -> BoolArray:
    """Return which points (N, 3) lie over a room's floor, or close beside it."""
    grown = buffered(room.floor, _BESIDE, join_style="mitre")
    shapely.prepare(grown)
    return np.asarray(shapely.contains_xy(grown, points[:, 0], points[:, 1]))
