"""Boxes of furniture kept clear of walls and of each other, within a tolerance.

Boxes stand at any yaw. Only what stands on the floor is compared with each other: things may lie
in and on furniture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely.geometry import MultiPolygon, Polygon

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.geometry.regions import buffered, difference, intersection, polygon_parts
from pbrnet.scenes.procedural.furnishing.space import CONTACT_TOLERANCE, GAP, SKIRTING_TOP
from pbrnet.scenes.procedural.piece import FurniturePiece
from pbrnet.scenes.procedural.plan import PlanRoom, WallEdge
from pbrnet.scenes.procedural.scene_item import Pose

TOLERANCE = 0.15  # metres that a box may be moved
_ROUNDS = 4  # of moves out of walls
_ON_FLOOR = 0.03  # metres; what begins lower stands on the floor
_FLAT = 0.04  # metres; lower things are stood on
# Furniture with free space between its parts: its bodies are compared, not its box
_OPEN = ("table", "desk", "chair", "stool", "curtain", "bench", "kitchen unit", "stove", "sink")


@dataclass(frozen=True)
class Standing:
    """A piece at its pose in a room; `on` is true if another object carries it."""

    piece: FurniturePiece
    pose: Pose
    room: PlanRoom
    category: str
    on: bool = False

    @property
    def reach(self) -> float:
        """Greatest distance of the piece from its origin, seen from above, metres."""
        return float(np.hypot(*np.abs(self.piece.bounds[:, :2]).max(axis=0)))

    @property
    def footprint(self) -> Polygon:
        """The box of the piece seen from above."""
        return self._rectangle(self.piece.bounds)

    @property
    def solids(self) -> list[tuple[Polygon, float, float]]:
        """The space that it fills: areas seen from above, each with its lower and upper height."""
        bodies = self.piece.bodies if self.category in _OPEN else self.piece.bounds[None]
        return [
            (
                self._rectangle(body),
                float(body[0, 2]) + self.pose.z,
                float(body[1, 2]) + self.pose.z,
            )
            for body in bodies
        ]

    @property
    def on_floor(self) -> bool:
        """Tell whether it stands on the floor, is no rug and does not hang at a wall."""
        low, high = self.piece.bounds[:, 2] + self.pose.z
        hangs = self.on or self.piece.anchor == "on_wall"
        return not hangs and low < _ON_FLOOR and high - low > _FLAT

    def _rectangle(self, bounds: Float64Array) -> Polygon:
        (x0, y0, _), (x1, y1, _) = bounds
        corners = np.array([[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0]])
        return Polygon(self.pose.apply(corners)[:, :2])

    def moved(self, by: Float64Array) -> Standing:
        """The same, moved by (2,) metres."""
        x, y = self.pose.x + float(by[0]), self.pose.y + float(by[1])
        return replace(self, pose=replace(self.pose, x=x, y=y))


def out_of_walls(one: Standing) -> Standing | None:
    """The piece moved into its room; None if it would have to move farther than the tolerance."""
    low = float(one.piece.bounds[0, 2]) + one.pose.z
    free = buffered(one.room.shape, CONTACT_TOLERANCE, join_style="mitre")
    if low < SKIRTING_TOP and one.on_floor:
        free = buffered(one.room.shape, CONTACT_TOLERANCE - GAP, join_style="mitre")
    moved = one
    for _ in range(_ROUNDS):
        outside = difference(moved.footprint, free)
        if outside.area < 1e-5:
            return moved
        push = _push(outside, free)
        if push is None:
            return None
        moved = moved.moved(push)
        if _distance(one, moved) > TOLERANCE:
            return None
    return None


def _push(outside: Polygon | MultiPolygon, free: Polygon | MultiPolygon) -> Float64Array | None:
    """The move (2,) along one wall's normal that brings most of what is outside in again."""
    points = shapely.get_coordinates(outside)
    best: tuple[float, Float64Array] | None = None
    for ring in (part.exterior for part in polygon_parts(free)):
        corners = np.array(ring.coords)[:-1]
        corners = corners if ring.is_ccw else corners[::-1]
        for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            edge = WallEdge((start[0], start[1]), (end[0], end[1]), False)
            places = np.array([edge.coordinates((x, y)) for x, y in points])
            beside = (places[:, 0] > -TOLERANCE) & (places[:, 0] < edge.length + TOLERANCE)
            near = beside & (places[:, 1] > -2 * TOLERANCE)
            if not near.any():
                continue
            depth = float(-places[near, 1].min())
            touches = (np.abs(places[near, 1]) < 1e-6).sum() >= 2
            if depth > 1e-6 and touches and (best is None or depth > best[0]):
                best = (depth, (depth + 1e-6) * np.array(edge.inward))
    return None if best is None else best[1]


def apart(standing: Sequence[Standing]) -> tuple[list[Standing], set[int]]:
    """Pieces that no longer collide, and the places of those that still do.

    Of two, the smaller one moves, by at most the tolerance in all.
    """
    made = list(standing)
    places = np.array([[one.pose.x, one.pose.y, one.reach] for one in made]).reshape(-1, 3)
    order = sorted(range(len(made)), key=lambda k: -made[k].footprint.area)
    done: list[int] = []
    stuck: set[int] = set()
    for k in order:
        one = made[k]
        if not one.on_floor:
            continue
        away = np.hypot(*(places[done, :2] - places[k, :2]).T) - places[done, 2] - places[k, 2]
        near = [made[done[j]] for j in np.flatnonzero(away < 2 * TOLERANCE)]
        moved = _clear(one, [other for other in near if other.room.id == one.room.id])
        if moved is None:
            stuck.add(k)
        else:
            made[k] = moved
        done.append(k)
    return made, stuck


def _clear(one: Standing, others: Sequence[Standing]) -> Standing | None:
    """The piece moved out of the others; None if it would have to move too far."""
    moved = one
    for _ in range(_ROUNDS):
        hits = [move for other in others if (move := _overlap(moved, other)) is not None]
        if not hits:
            return moved
        deepest = max(hits, key=lambda move: float(np.hypot(*move)))
        moved = moved.moved(deepest)
        if _distance(one, moved) > TOLERANCE or out_of_walls(moved) is not moved:
            return None
    return None


def _overlap(one: Standing, other: Standing) -> Float64Array | None:
    """The least move (2,) of one piece out of another; None if they are apart."""
    if not intersection(one.footprint, other.footprint).area > 1e-5:
        return None
    best: Float64Array | None = None
    for area, low, high in one.solids:
        for their, floor, top in other.solids:
            if min(high, top) - max(low, floor) < 5e-3:
                continue
            move = _least_move(area, their)
            if move is not None and (best is None or np.hypot(*move) > np.hypot(*best)):
                best = move
    return best


def _least_move(area: Polygon, other: Polygon) -> Float64Array | None:
    """The least move (2,) of a rectangle out of another (separating axes); None if apart."""
    corners = [np.array(each.exterior.coords)[:4] for each in (area, other)]
    best: tuple[float, Float64Array] | None = None
    for ring in corners:
        for k in (0, 1):
            axis = ring[k + 1] - ring[k]
            axis = axis / max(float(np.hypot(*axis)), 1e-12)
            ours, theirs = corners[0] @ axis, corners[1] @ axis
            up, down = float(theirs.max() - ours.min()), float(ours.max() - theirs.min())
            depth = min(up, down)
            if depth < 2 * CONTACT_TOLERANCE:
                return None
            if best is None or depth < best[0]:
                best = (depth, axis * (up if up < down else -down))
    return None if best is None else best[1]


def _distance(one: Standing, other: Standing) -> float:
    return float(np.hypot(one.pose.x - other.pose.x, one.pose.y - other.pose.y))
