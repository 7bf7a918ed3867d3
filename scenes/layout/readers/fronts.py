"""Fronts of objects whose boxes leave open which of two opposite sides is in front."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from shapely.geometry import LineString, Point

from pbrnet.scenes.layout.layout import LayoutObject
from pbrnet.scenes.layout.readers.enclosed import Segment

_SEATS = ("chair", "stool", "bench")
_TABLES = ("table", "desk", "sideboard")
_AT_TABLE = 0.8  # metres from a seat to the table that it belongs to


def facing(objects: Sequence[LayoutObject], walls: Sequence[Segment]) -> list[LayoutObject]:
    """Turn each object by 180 degrees if that puts its back to a wall, a chair to face its table.

    Seats face the table within 0.8 m of them; everything else has the nearer wall behind it.
    """
    lines = [LineString(wall) for wall in walls if wall[0] != wall[1]]
    tables = [one for one in objects if one.category in _TABLES]
    return [
        replace(one, yaw=(one.yaw + 180.0) % 360.0) if _is_reversed(one, lines, tables) else one
        for one in objects
    ]


def _is_reversed(
    one: LayoutObject, walls: Sequence[LineString], tables: Sequence[LayoutObject]
) -> bool:
    yaw = math.radians(one.yaw)
    front = np.array([math.sin(yaw), -math.cos(yaw)])
    place = np.array(one.center[:2])
    if one.category in _SEATS:
        reach = _AT_TABLE + 0.5 * one.size[1]
        near = [table for table in tables if _distance(place, table) < reach]
        if near:
            nearest = min(near, key=lambda table: _distance(place, table))
            return bool(np.dot(np.array(nearest.center[:2]) - place, front) < 0)
    ahead, behind = (
        min(wall.distance(Point(place + sign * 0.5 * one.size[1] * front)) for wall in walls)
        for sign in (1, -1)
    )
    return ahead < behind


def _distance(place: np.ndarray, table: LayoutObject) -> float:
    """Distance from a place to the box of a table on the plan."""
    yaw = math.radians(table.yaw)
    x, y = place - np.array(table.center[:2])
    along = abs(x * math.cos(yaw) + y * math.sin(yaw)) - 0.5 * table.size[0]
    across = abs(y * math.cos(yaw) - x * math.sin(yaw)) - 0.5 * table.size[1]
    return math.hypot(max(along, 0.0), max(across, 0.0))
