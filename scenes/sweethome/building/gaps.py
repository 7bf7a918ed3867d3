"""Openings of rooms whose walls leave gaps, for homes drawn as sketches.

Where doors and windows are drawn as gaps between walls, or as low walls, no piece states the
opening. The outline of the rooms, less the walls, does: openings reach from floor to ceiling, also
where a low wall stands beside them. World coordinates, metres.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.geometry.regions import buffered, difference, intersection, simplified, union
from pbrnet.scenes.sweethome.building.levels import Storey
from pbrnet.scenes.sweethome.building.portals import Doorway
from pbrnet.scenes.sweethome.building.slabs import CeilingHeights
from pbrnet.scenes.sweethome.building.solids import polygons, world_region
from pbrnet.scenes.sweethome.building.spaces import CLOSING, Space, is_tall
from pbrnet.scenes.sweethome.building.walls import PlannedWall

_ALONG_WALL = 0.05  # metres between the outline of a room and the wall along it
_BESIDE_WALL = 0.2  # metres to a wall beside an outline that was drawn less exactly
_SHORTEST = 0.05  # metres of a gap
_BEYOND = 0.25  # metres in front of and behind a gap: points that tell the rooms on its sides
_EXTENSION = 0.07  # metres by which an opening reaches into what bounds it


def find_gaps(
    storey: Storey, spaces: list[Space], walls: list[PlannedWall], heights: CeilingHeights
) -> list[Doorway]:
    """Return the gaps in the walls around the rooms of a storey that has rooms with gaps."""
    indoors = [space for space in spaces if space.is_indoors]
    if not any(space.has_gaps for space in indoors):
        return []
    rooms = buffered(union([space.floor for space in indoors]), CLOSING, join_style="mitre")
    rooms = simplified(buffered(rooms, -CLOSING, join_style="mitre"), 0.01)
    tall = union([world_region(one.outline.region) for one in walls if is_tall(one, storey)])
    near, beside = buffered(tall, _ALONG_WALL), buffered(tall, _BESIDE_WALL)
    bottom = 0.01 * storey.elevation
    found = []
    for part in polygons(rooms):
        for ring in (part.exterior, *part.interiors):
            corners = np.asarray(ring.coords)
            for start, end in pairwise(corners):
                for line in _free(shapely.LineString([start, end]), near, beside):
                    if line.length > _SHORTEST:
                        ends = np.asarray(line.coords)
                        top = float(heights.at(line.centroid.coords[:1] * np.ones((1, 2)))[0])
                        found.append(_doorway(ends[0], ends[-1], bottom, top))
    return found


def _free(edge: BaseGeometry, near: BaseGeometry, beside: BaseGeometry) -> list[BaseGeometry]:
    """The parts of an edge without a wall on it (`near`), nor along it (`beside`)."""
    widened = _BESIDE_WALL - _ALONG_WALL
    found = []
    for line in _lines(difference(edge, near)):
        open_parts = difference(line, beside)
        if open_parts.length >= line.length - 2 * _BESIDE_WALL:  # walls only at its ends
            found.append(line)
        else:
            found += [intersection(line, buffered(part, widened)) for part in _lines(open_parts)]
    return [line for each in found for line in _lines(each)]


def _lines(geometry: BaseGeometry) -> list[BaseGeometry]:
    parts = shapely.get_parts(geometry).tolist()
    return [part for part in parts if part.geom_type == "LineString" and not part.is_empty]


def _doorway(start: Float64Array, end: Float64Array, bottom: float, top: float) -> Doorway:
    """Return a rectangle over the plan's segment from `start` to `end`, rooms on its left."""
    along = (end - start) / np.linalg.norm(end - start)
    outward = np.array([along[1], -along[0], 0.0])
    left, right = start - _EXTENSION * along, end + _EXTENSION * along
    low, high = bottom - _EXTENSION, top + _EXTENSION
    polygon = np.array([[*left, low], [*right, low], [*right, high], [*left, high]])
    middle = polygon.mean(axis=0)
    return Doorway(
        polygon, outward, middle + _BEYOND * outward, middle - _BEYOND * outward, _ALONG_WALL
    )
