"""Outlines of straight and round walls on the plan, mitred with the walls that they join.

Plan coordinates as in the file: centimetres, y down. The left side lies to the left of the
direction from start to end as seen on the screen: (sin, -cos) of the direction.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from shapely.geometry import Polygon

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.geometry.regions import buffered, valid
from pbrnet.scenes.sweethome.home import Wall

_SHORT = 1e-5  # cm: a wall shorter than this has no direction
_LEAST_ARC = 1e-3  # radians
_MAX_STEPS = 256  # segments of a round wall
_PARALLEL = 4e-3  # sine of the angle below which two sides are taken as parallel


@dataclass(frozen=True)
class Outline:
    """The two sides of a wall, (N, 2) each, from start to end; N = 2 for straight walls."""

    left: Float64Array
    right: Float64Array

    @property
    def middle(self) -> Float64Array:
        """Centre line, (N, 2)."""
        return 0.5 * (self.left + self.right)

    def ring(self, first: Float64Array, second: Float64Array) -> Polygon:
        """Return the region between two lines along the wall as a valid polygon."""
        return polygon(np.concatenate([first, second[::-1]]))

    @property
    def region(self) -> Polygon:
        """Region of the whole wall."""
        return self.ring(self.left, self.right)


def polygon(points: Float64Array) -> Polygon:
    """Return a valid polygon of `points` (N, 2), repaired where it crosses itself; may be empty."""
    shape = Polygon(points)
    return shape if shape.is_valid else buffered(valid(shape), 0)


def arc_centre(wall: Wall) -> Float64Array:
    """Return the centre (2,) of a round wall: rotating the start by `arc` about it gives the end.

    Positive angles are clockwise on the screen.
    """
    start, end = np.array(wall.start), np.array(wall.end)
    chord = end - start
    assert wall.arc is not None
    half = 0.5 * wall.arc
    return 0.5 * (start + end) + 0.5 * np.array([-chord[1], chord[0]]) / math.tan(half)


def is_round(wall: Wall) -> bool:
    """Return whether the wall is an arc: neither straight nor a full circle."""
    return (
        wall.arc is not None
        and _LEAST_ARC < abs(wall.arc) < 2 * math.pi - _LEAST_ARC
        and has_length(wall)
    )


def unjoined(wall: Wall, left: float = 0.0, right: float = 0.0) -> Outline:
    """Return the outline without regard to other walls; `left`, `right` thicken the sides (cm)."""
    start, end = np.array(wall.start), np.array(wall.end)
    to_left, to_right = 0.5 * wall.thickness + left, 0.5 * wall.thickness + right
    if is_round(wall):
        assert wall.arc is not None
        centre = arc_centre(wall)
        radius = math.dist(centre, wall.start)
        outer = (radius + 0.5 * wall.thickness) * abs(wall.arc)
        steps = min(max(math.ceil(math.sqrt(outer)), 2), _MAX_STEPS)
        first = math.atan2(start[1] - centre[1], start[0] - centre[0])
        angles = first + np.linspace(0, wall.arc, steps + 1)
        spokes = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        outward = 1.0 if wall.arc > 0 else -1.0  # the left side is outside when turning clockwise
        return Outline(
            centre + max(radius + outward * to_left, 0.0) * spokes,
            centre + max(radius - outward * to_right, 0.0) * spokes,
        )
    along = (end - start) / math.dist(wall.start, wall.end)
    normal = np.array([along[1], -along[0]])
    ends = np.stack([start, end])
    return Outline(ends + to_left * normal, ends - to_right * normal)


def joined(
    wall: Wall, walls: Mapping[str, Wall], thickenings: Mapping[str, tuple[float, float]] = {}
) -> Outline:
    """Return the outline, its corners moved to meet the sides of the walls that it joins.

    A corner that would move by twice the thickness or more stays. `thickenings` are the baseboards'
    thicknesses (left, right) by wall id, for outlines that include them.
    """
    own = unjoined(wall, *thickenings.get(wall.id, (0.0, 0.0)))
    left, right = own.left.copy(), own.right.copy()
    limit = 2 * wall.thickness
    for at_start, other_id in ((True, wall.wall_at_start), (False, wall.wall_at_end)):
        other = walls.get(other_id) if other_id is not None else None
        if other is None or other is wall or not has_length(other):
            continue
        end_of_other = _joined_end(wall, other, at_start)
        if end_of_other is None:
            continue
        theirs = unjoined(other, *thickenings.get(other.id, (0.0, 0.0)))
        # Left stays left where the direction continues; it changes where two starts or ends meet.
        straight_on = at_start != (end_of_other == "start")
        their_left, their_right = (
            (theirs.left, theirs.right) if straight_on else (theirs.right, theirs.left)
        )
        for mine, other_side in ((left, their_left), (right, their_right)):
            near, next_to = (0, 1) if at_start else (-1, -2)
            tip, before = (0, 1) if end_of_other == "start" else (-1, -2)
            meeting = _meeting(mine[near], mine[next_to], other_side[tip], other_side[before])
            if meeting is not None and math.dist(meeting, mine[near]) < limit:
                mine[near] = meeting
    return Outline(left, right)


def has_length(wall: Wall) -> bool:
    """Return whether the wall has a direction and a thickness."""
    return math.dist(wall.start, wall.end) > _SHORT and wall.thickness > 0


def _joined_end(wall: Wall, other: Wall, at_start: bool) -> str | None:
    """Return the end of `other` at this end of `wall`, "start" or "end"; None if not mutual."""
    here = wall.start if at_start else wall.end
    back = [
        name
        for name, target, place in (
            ("end", other.wall_at_end, other.end),
            ("start", other.wall_at_start, other.start),
        )
        if target == wall.id
    ]
    if len(back) == 2:  # joined at both ends: take the nearer one
        return min(
            back, key=lambda name: math.dist(here, other.end if name == "end" else other.start)
        )
    return back[0] if back else None


def _meeting(
    a: Float64Array, b: Float64Array, c: Float64Array, d: Float64Array
) -> Float64Array | None:
    """Return the intersection (2,) of the lines a-b and c-d; None if they are almost parallel."""
    u, v = b - a, d - c
    cross = u[0] * v[1] - u[1] * v[0]
    if abs(cross) < _PARALLEL * np.linalg.norm(u) * np.linalg.norm(v):
        return None
    w = c - a
    return a + u * (w[0] * v[1] - w[1] * v[0]) / cross
