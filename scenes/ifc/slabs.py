"""Floors and ceilings of rooms that a file states but does not build.

World: metres, Z up.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import numpy as np
from shapely.geometry import Polygon

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.geometry.mesh import face_areas
from pbrnet.scenes.geometry.regions import buffered, union
from pbrnet.scenes.reconstruction.completion import extruded
from pbrnet.scenes.reconstruction.raycast import RayCaster
from pbrnet.scenes.reconstruction.rooms import FoundRoom, inside_points

_BEYOND = 1.0  # metres beyond a room's stated height at which a surface still bounds it
_LEAST_HITS = 0.5  # share of a floor over which there must be one
_PLACES = 100
_THICK = 0.1  # metres
_OVER = 0.25  # metres by which slabs cover the walls
_LEAST_SLOPE = 0.1  # vertical part of the normal of a sloping ceiling
_FURNITURE = 0.5  # metres above a floor from which a level surface over all of it is a ceiling
_FINISH = 0.15  # metres; the same below the open sky
_COVERED = 0.8  # share of a floor that it covers at least
_SAME_LEVEL = 0.1  # metres


def lacks_slab(room: FoundRoom, rays: RayCaster, above: bool) -> bool:
    """Return whether a room has no ceiling (or floor) over half of its floor or more."""
    plan = inside_points(room.floor, _PLACES)
    middle = np.full(len(plan), 0.5 * (room.floor_z + room.ceiling_z))
    points = room.lowered(np.column_stack([plan, middle]))
    distances, _ = rays.cast(points, np.array([0.0, 0.0, 1.0 if above else -1.0]))
    reach = (room.ceiling_z - points[:, 2] if above else points[:, 2] - room.floor_z) + _BEYOND
    return float((distances <= reach).mean()) < _LEAST_HITS


def built_ceiling(room: FoundRoom, rays: RayCaster) -> float:
    """Return the height of the level ceiling that is built in a room, else the stated one.

    Authoring tools give spaces a default height, which often reaches through ceiling and roof.
    """
    plan = inside_points(room.floor, _PLACES)
    if room.solid is not None or not len(plan):
        return room.ceiling_z
    for foot in (_FURNITURE, _FINISH):  # a plenum may be lower than furniture
        points = np.column_stack([plan, np.full(len(plan), room.floor_z + foot)])
        levels = points[:, 2] + rays.cast(points, np.array([0.0, 0.0, 1.0]))[0]
        if np.isfinite(levels).mean() > 1 - _COVERED:
            break
    level = float(np.median(levels))
    is_ceiling = (np.abs(levels - level) < _SAME_LEVEL).mean() >= _COVERED
    return level if is_ceiling and level < room.ceiling_z - _SAME_LEVEL else room.ceiling_z


def slabs_of(rooms: Sequence[FoundRoom], above: bool) -> Float64Array:
    """Return triangles (F, 3, 3) of the ceilings (or floors) of rooms, those of one level as one.

    Below a sloping roof, the ceiling is the upper part of the room's solid.
    """
    plans: dict[float, list[Polygon]] = defaultdict(list)
    made = [np.empty((0, 3, 3))]
    for room in rooms:
        if above and room.solid is not None:
            made.append(room.solid[np.abs(face_areas(room.solid)[1][:, 2]) > _LEAST_SLOPE])
            made[-1] = made[-1][made[-1].mean(axis=1)[:, 2] > room.floor_z + _THICK]
            continue
        level = round(room.ceiling_z if above else room.floor_z, 3)
        plans[level].append(buffered(room.floor, _OVER, join_style="mitre", mitre_limit=2.0))
    for level, floors in plans.items():
        low, high = (level, level + _THICK) if above else (level - _THICK, level)
        made.append(extruded(union(floors), low, high))
    return np.concatenate(made)
