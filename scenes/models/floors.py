"""Floors of models that have walls alone, as scanners of rooms wrote them until 2023.

RoomPlan's first version writes walls, openings and things, but no floor. Where the file states its
axis and unit, and walls by name surround an area without a floor, one is added at their foot.
"""

from __future__ import annotations

import numpy as np
import shapely
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.geometry.mesh import Mesh, face_areas
from pbrnet.scenes.geometry.regions import buffered, polygon_parts, union
from pbrnet.scenes.importing.categories import words_of
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.shape import Shape
from pbrnet.scenes.importing.shapes.sealing_shapes import FLOOR, sealing_shape
from pbrnet.scenes.reconstruction.completion import extruded
from pbrnet.scenes.reconstruction.orientation import upright

_LEAST_WALLS = 3
_HALF_GAPS = (0.6, 1.2, 2.5)  # metres: half the widest gap between walls around a room
_STEP, _HULL = 0.3, 0.2  # metres along walls, and ratio of the concave hull of these places
_ENCLOSED = 0.6  # share of that hull
_LEAST_AREA = 3.0  # square metres
_SAME_FOOT = 0.1  # metres between the feet of walls
_AROUND = 0.8  # metres from the feet of walls to a floor
_MOST_FLOOR = 0.3  # share of the area that level surfaces, such as bottoms of boxes, may cover
_THICK = 0.1  # metres


def missing_floor(
    shapes: list[Shape], up: Float64Array, unit: float, changes: Changes
) -> list[Shape]:
    """The floor that `shapes` lack between their walls, in their own axes and unit; or nothing."""
    frame = np.eye(4)
    frame[:3, :3] = unit * upright(up)
    walls = [one.mesh.transformed(frame) for one in shapes if "wall" in words_of(one.name)]
    if len(walls) < _LEAST_WALLS:
        return []
    foot = float(np.median([mesh.bounds[0, 2] for mesh in walls]))
    standing = [mesh for mesh in walls if abs(mesh.bounds[0, 2] - foot) <= _SAME_FOOT]
    area = _surrounded(standing)
    corners = np.concatenate([one.mesh.transformed(frame).corners for one in shapes])
    if area.area < _LEAST_AREA or _level_area(corners, foot) > _MOST_FLOOR * area.area:
        return []
    changes.note("walls without a floor got a plain one at their foot")
    name = "added_floor"
    while any(one.id == name for one in shapes):
        name += "_"
    made = sealing_shape(name, extruded(area, foot - _THICK, foot), FLOOR)
    return [made.transformed(np.array(np.linalg.inv(frame), np.float64))]


def _surrounded(walls: list[Mesh]) -> BaseGeometry:
    """The plan of walls and of what lies between them, with gaps as narrow as will do."""
    plan = union([shapely.MultiPoint(mesh.vertices[:, :2]).convex_hull for mesh in walls])
    places = shapely.get_coordinates(shapely.segmentize(plan, _STEP))
    whole = shapely.concave_hull(shapely.MultiPoint(places), ratio=_HULL)
    area: BaseGeometry = Polygon()
    for half in _HALF_GAPS:
        closed = buffered(plan, half, join_style="mitre")
        filled = union([Polygon(part.exterior) for part in polygon_parts(closed)])
        area = buffered(filled, -half, join_style="mitre")
        if area.area >= _ENCLOSED * whole.area:
            break
    return area


def _level_area(corners: Float64Array, foot: float) -> float:
    """The largest area of level surfaces at one height around the foot of the walls."""
    areas, normals = face_areas(corners)
    heights = corners[:, :, 2].mean(axis=1) - foot
    is_level = np.abs(normals[:, 2]) > 0.95
    near = is_level & (heights > -_AROUND) & (heights < _AROUND)
    steps = np.rint((heights[near] + _AROUND) / _SAME_FOOT).astype(int)
    return float(np.bincount(steps, weights=areas[near], minlength=1).max())
