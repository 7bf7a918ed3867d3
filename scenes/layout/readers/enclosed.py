"""Rooms that lines of walls enclose.

Walls of scans and of language models end some centimetres from each other. Each line is thickened
until the plan is closed: holes in the union of the thickened lines, grown back by as much, are the
rooms. Where lines meet, this gives their exact corners.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from shapely.geometry import LineString, Point, Polygon
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from pbrnet.scenes.contract import Point2
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.geometry.regions import (
    buffered,
    largest_part,
    polygon_parts,
    simplified,
    thickened,
)
from pbrnet.scenes.importing.changes import Changes

MAX_GAP = 0.5  # metres between ends of walls that are closed
_GAPS = (0.02, 0.06, 0.12, 0.2, 0.32, MAX_GAP)
_ENOUGH = 0.97  # of the area that the widest gap encloses
_MOST_WALLS = 600
_NAMED_GAP = 0.1  # metres
_NARROWEST = 0.6  # metres; what is narrower is the inside of a wall
_SPIKE = 0.25  # metres
_STRAIGHT = 0.02  # metres that a corner may move
_ENTRANCE = 0.45  # metres from a door at which it has a room

Segment = tuple[Point2, Point2]


def enclosed_rooms(walls: Sequence[Segment], changes: Changes) -> list[Polygon]:
    """Return the rooms between walls, counter-clockwise, sorted by place.

    Walls are lines, metres. Of the gaps between them, up to `MAX_GAP`, the smallest that encloses
    nearly all area is closed, and named if it is wide. Rooms inside others are left out and named.
    Raises `InputError` for more than 600 walls, whose crossings would take minutes.
    """
    if len(walls) > _MOST_WALLS:
        raise InputError(
            f"{len(walls):,} walls and edges of floors; at most {_MOST_WALLS} are read"
        )
    lines = [LineString(wall) for wall in walls if wall[0] != wall[1]]
    tried = [(_rooms(lines, 0.5 * gap), gap) for gap in _GAPS] if lines else []
    most = max((sum(room.area for room in rooms) for rooms, _ in tried), default=0.0)
    for rooms, gap in tried:
        if rooms and sum(room.area for room in rooms) >= _ENOUGH * most:
            if gap > _NAMED_GAP:
                changes.note(f"gaps of up to {gap:g} m between walls were closed")
            return sorted(_outermost(rooms, changes), key=lambda room: room.bounds)
    return []


def _outermost(rooms: Sequence[Polygon], changes: Changes) -> list[Polygon]:
    """The rooms that do not lie in a hole of another one."""
    kept: list[Polygon] = []
    for room in sorted(rooms, key=lambda each: -each.area):
        if any(other.contains(room.representative_point()) for other in kept):
            changes.note(f"a room of {room.area:.1f} square metres inside another one was left out")
        else:
            kept.append(room)
    return kept


def _rooms(lines: list[LineString], half_width: float) -> list[Polygon]:
    walls = thickened(lines, half_width, cap_style="square")
    holes = [Polygon(ring) for part in polygon_parts(walls) for ring in part.interiors]
    grown = [_grown(hole, half_width) for hole in holes]
    wide = [hole for hole in grown if not buffered(hole, -0.5 * _NARROWEST).is_empty]
    made = (tidied(hole) for hole in wide)
    return [orient(Polygon(room.exterior)) for room in made if not room.is_empty]


def tidied(region: BaseGeometry) -> Polygon:
    """The largest part of a region without seams, narrow parts and corners that hardly matter.

    Seams between the faces of a floor, up to 0.04 m, are closed; parts narrower than 0.25 m, as
    between a wall and a floor's outline, are cut off; corners move by up to 0.02 m.
    """
    closed = _grown(_grown(region, _STRAIGHT), -_STRAIGHT)
    opened = _grown(_grown(closed, -0.5 * _SPIKE), 0.5 * _SPIKE)
    return largest_part(simplified(closed if opened.is_empty else opened, _STRAIGHT))


def _grown(region: BaseGeometry, distance: float) -> BaseGeometry:
    return buffered(region, distance, join_style="mitre")


def outline(room: Polygon) -> tuple[Point2, ...]:
    """Return the corners of a polygon without holes, counter-clockwise, to a micrometre."""
    corners = orient(room).exterior.coords[:-1]
    return tuple((round(float(x), 6), round(float(y), 6)) for x, y in corners)


def rooms_beside(rooms: Sequence[Polygon], start: Point2, end: Point2) -> list[int]:
    """Return the numbers of the rooms on both sides of an opening, each once."""
    along = np.subtract(end, start)
    length = float(np.hypot(*along)) or 1.0
    normal = np.array([-along[1], along[0]]) / length
    middle = 0.5 * np.add(start, end)
    found: list[int] = []
    for side in (1.0, -1.0):
        place = Point(middle + side * _ENTRANCE * normal)
        found += [n for n, room in enumerate(rooms) if room.contains(place)][:1]
    return list(dict.fromkeys(found))
