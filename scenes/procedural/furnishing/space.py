"""Spatial state of a room during furnishing: collisions, clear zones and walkability.

All tests use axis-aligned boxes. Most pieces are one box; pieces with free space below or between
their parts (tables, chairs, curtains) have one box per connected body of their meshes, so that a
chair fits under a table. Boxes are exact at quarter turns; at other yaws they are the bounds of
the rotated box.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import shapely
from scipy import ndimage
from shapely.geometry import Polygon, box
from shapely.prepared import prep

from pbrnet.scenes.arrays import BoolArray, Float64Array
from pbrnet.scenes.geometry.regions import buffered, deepest_point, largest_part
from pbrnet.scenes.procedural.niches import niche_piece, niche_solids
from pbrnet.scenes.procedural.piece import FurniturePiece
from pbrnet.scenes.procedural.plan import Niche, Opening, Plan, PlanRoom, WallEdge
from pbrnet.scenes.procedural.roof import level_part
from pbrnet.scenes.procedural.scene_item import Pose, SceneItem, place_piece
from pbrnet.scenes.procedural.structure import CASING, SKIRTING, leaf_footprint

Boxes = Float64Array  # (N, 2, 3): low and high corners

CONTACT_TOLERANCE = 1e-3  # metres; smaller overlaps count as contact
HALF_BODY_WIDTH = 0.21  # metres, of a walking person
STEP_OVER = 0.06  # metres; lower obstacles do not block walking
HEADROOM = 1.75  # metres; obstacles above do not block walking
_BEFORE_NICHE = 0.4  # metres of floor that stay free
CELL = 0.05  # of the walking grid, metres
SKIRTING_TOP = 0.125  # metres; upper bound of skirting heights
GAP = SKIRTING + 0.004  # metres between a wall and furniture against it
# Categories with one box per connected body.
_SEVERAL_BOXES = (
    *("table", "desk", "chair", "stool", "curtain", "radiator", "bench", "kitchen unit", "cable"),
)


@dataclass
class PlacedPiece:
    """A piece at its pose.

    `occupied` lists, for each of its support surfaces, the rectangles (2, 2) that are in use.
    """

    id: str
    kind: str
    piece: FurniturePiece
    pose: Pose
    collision_boxes: Boxes
    occupied: list[list[Float64Array]] = field(default_factory=list)

    @property
    def bounds(self) -> Boxes:
        """World bounds (2, 3)."""
        return np.stack(
            [self.collision_boxes[:, 0].min(axis=0), self.collision_boxes[:, 1].max(axis=0)]
        )

    def along(self, edge: WallEdge) -> float:
        """Return the position of its origin along a wall, metres."""
        return edge.coordinates((self.pose.x, self.pose.y))[0]

    def scene_items(self, room: str) -> list[SceneItem]:
        """Return the piece and the things that it holds as items of the scene."""
        return place_piece(self.piece, self.pose, self.id, room)


@dataclass(frozen=True)
class _ClearZone:
    """Rectangle of floor to keep free for its `owner`: an item id, "passage", "niche"..."""

    low: tuple[float, float]
    high: tuple[float, float]
    owner: str


class RoomSpace:
    """Spatial state of one room; valid poses are kept, others rejected."""

    def __init__(self, plan: Plan, room: PlanRoom) -> None:
        self.plan, self.room = plan, room
        self.shape: Polygon = room.shape
        self.inside = prep(buffered(self.shape, CONTACT_TOLERANCE, join_style="mitre"))
        # Floor between the skirtings, for boxes that extend down to them.
        self._between = prep(buffered(self.shape, CONTACT_TOLERANCE - GAP, join_style="mitre"))
        self.items: list[PlacedPiece] = []
        self.niches: list[PlacedPiece] = []  # parts of the building that hold things
        self._boxes: Boxes = np.zeros((0, 2, 3))
        self._owners: list[str] = []
        self._zones: list[_ClearZone] = []
        self._blocked: Boxes = np.zeros((0, 2, 3))  # in front of openings: kept free
        self._origin = np.array(self.shape.bounds[:2])
        self._free = self._walkable_floor()
        for beam in plan.beams:
            if beam.room == room.id:
                under = _raised(box(*beam.low, *beam.high), plan.height - beam.depth, plan.height)
                self._add_boxes(under, "beam")
        self.doors: list[tuple[float, float]] = []
        stairs = plan.stairs
        if stairs is not None and stairs.room == room.id:
            self._add_solids(_raised(buffered(stairs.footprint, 0.04), 0.0, plan.height), "stairs")
            before = stairs.edge.strip(*stairs.foot, 0.0, stairs.width)
            self._keep_clear(before, "passage")
            self.doors.append(stairs.edge.at(sum(stairs.foot) / 2, 0.5 * stairs.width))
        for niche in plan.niches:
            if niche.room == room.id:
                self._register_niche(niche)
        for opening in plan.openings:
            if room.id in opening.rooms:
                self._register_opening(opening)

    def _register_niche(self, niche: Niche) -> None:
        edge, height = niche.edge, self.plan.height
        solids = niche_solids(niche, height)
        item = PlacedPiece(
            f"{self.room.id}-niche",
            "niche",
            niche_piece(niche),
            Pose(*edge.at(0.5 * (niche.s0 + niche.s1)), 0.0, yaw_facing(edge.inward)),
            solids,
        )
        item.occupied = [[] for _ in item.piece.surfaces]
        self.niches.append(item)
        skirting = edge.strip(niche.s0 - GAP, niche.s1 + GAP, 0.0, niche.depth + GAP)
        self._add_solids(np.concatenate([solids, _raised(skirting, 0.0, SKIRTING_TOP)]), item.id)
        self._keep_clear(
            edge.strip(niche.s0, niche.s1, niche.depth, niche.depth + _BEFORE_NICHE), "niche"
        )

    def _register_opening(self, opening: Opening) -> None:
        edge, width = opening.edge_in(self.room.id), opening.width
        margin = CASING[0] if opening.kind != "window" else 0.045
        depth = 0.06 if opening.kind == "window" else 0.12
        front = edge.strip(-margin, width + margin, 0.0, depth)
        self._blocked = np.concatenate([self._blocked, _raised(front, opening.z0 - 0.05, 2.3)])
        if opening.kind == "window":
            return
        depth = 0.7 if opening.kind != "patio" else 0.6
        # A way of a person's width leads through a wall that is left out.
        aside = max(0.0, 0.5 * width - 0.6) if opening.kind == "open" else 0.0
        self._keep_clear(edge.strip(aside, width - aside, 0.0, depth), "passage")
        self.doors.append(edge.at(width / 2, 0.35))
        if opening.kind in ("door", "entrance") and opening.swing == self.room.id:
            self._keep_clear(edge.strip(0, width, 0.0, width), "swing")
            leaf = leaf_footprint(self.plan, opening)
            if leaf is not None:
                self._keep_clear(buffered(leaf, 0.05), "leaf")
                # The leaf blocks furniture, not walking: a person pushes it aside.
                self._add_boxes(_raised(buffered(leaf, 0.06), 0.0, 2.05), "leaf")

    def _keep_clear(self, area: Polygon, owner: str) -> None:
        x0, y0, x1, y1 = area.bounds
        self._zones.append(_ClearZone((x0, y0), (x1, y1), owner))

    def windows(self) -> list[Opening]:
        """Return the windows and patio doors of the room."""
        return [
            opening
            for opening in self.plan.openings
            if opening.rooms == (self.room.id,) and opening.kind in ("window", "patio")
        ]

    def try_place(
        self,
        kind: str,
        piece: FurniturePiece,
        pose: Pose,
        *,
        allow: Collection[str] = (),
        zone: bool = True,
        touching: Collection[str] = (),
        on_floor: bool = True,
    ) -> PlacedPiece | None:
        """Place `piece` at `pose` if that is valid; returns None otherwise.

        `allow` holds owners of clear zones that the piece may enter (item ids, "passage", "swing");
        `touching` holds ids of items that it may touch, such as its carrier. `zone` reserves the
        floor in front of it; `on_floor` tests walkability.
        """
        item = self._candidate(kind, piece, pose)
        if not self._is_clear(item, allow, touching, on_floor):
            return None
        front = _front(piece, pose) if zone and on_floor and piece.front_clearance > 0 else None
        if front is not None and not self._zone_is_clear(front, allow):
            return None
        if on_floor and not self._walkable(item, front):
            return None
        self.add(item, front)
        return item

    def fits(self, piece: FurniturePiece, pose: Pose, allow: Collection[str] = ()) -> bool:
        """Return True if a pose is free of collisions and clear zones; ignores walkability."""
        return self._is_clear(
            PlacedPiece("", "", piece, pose, collision_boxes(piece, pose)), allow, (), True
        )

    def remove_last(self) -> None:
        """Remove the item that was placed last."""
        item = self.items.pop()
        keep = [owner != item.id for owner in self._owners]
        self._boxes = self._boxes[np.array(keep, dtype=bool)]
        self._owners = [owner for owner in self._owners if owner != item.id]
        self._zones = [zone for zone in self._zones if zone.owner != item.id]
        fixed = np.array([owner != "leaf" for owner in self._owners], dtype=bool)
        self._free = self._without(self._walkable_floor(), self._boxes[fixed])

    def _is_clear(
        self, item: PlacedPiece, allow: Collection[str], touching: Collection[str], on_floor: bool
    ) -> bool:
        low, high = item.bounds
        if high[2] > self.plan.height + CONTACT_TOLERANCE or low[2] < -CONTACT_TOLERANCE:
            return False
        if self.plan.slopes and not self._are_below_slopes(item.collision_boxes):
            return False
        if not self._between.covers(box(low[0], low[1], high[0], high[1])):
            for body in item.collision_boxes:
                limit = self._between if body[0, 2] < SKIRTING_TOP else self.inside
                if not limit.covers(box(*body[0, :2], *body[1, :2])):
                    return False
        if _overlap(item.collision_boxes, self._blocked).any():
            return False
        hits = _overlap(item.collision_boxes, self._boxes)
        if any(self._owners[k] not in touching for k in np.flatnonzero(hits.any(axis=0))):
            return False
        if not on_floor or high[2] <= STEP_OVER or low[2] >= 1.2:
            return True
        bodies = item.collision_boxes[item.collision_boxes[:, 0, 2] < 1.2]
        zones = [zone for zone in self._zones if zone.owner not in allow]
        return not any(_overlap_2d(bodies, zone.low, zone.high) for zone in zones)

    def _are_below_slopes(self, bodies: Boxes) -> bool:
        x, y = bodies[:, [0, 0, 1, 1], 0], bodies[:, [0, 1, 0, 1], 1]  # of four corners
        free = [np.full(len(bodies), self.plan.height)]
        free += [slope.height_at(x, y).min(axis=1) for slope in self.plan.slopes]
        return bool((bodies[:, 1, 2] < np.min(free, axis=0) + CONTACT_TOLERANCE).all())

    def _zone_is_clear(self, front: Boxes, allow: Collection[str]) -> bool:
        hits = _overlap(front, self._boxes).any(axis=0)
        for k in np.flatnonzero(hits):
            standing = self._boxes[k, 1, 2] > STEP_OVER and self._boxes[k, 0, 2] < 1.2
            if standing and self._owners[k] not in allow:
                return False
        centre = shapely.Point(*front[0, :, :2].mean(axis=0))
        return bool(self.inside.covers(centre))

    def _cells_near(self, low: npt.NDArray, high: npt.NDArray) -> tuple[slice, slice]:
        """Cells of the walking grid where a person would touch a rectangle."""
        first = np.floor((low - HALF_BODY_WIDTH - self._origin) / CELL).astype(int)
        last = np.ceil((high + HALF_BODY_WIDTH - self._origin) / CELL).astype(int)
        first, last = np.maximum(first, 0), np.maximum(last, 0)
        return slice(first[0], last[0]), slice(first[1], last[1])

    def _without(self, free: BoolArray, boxes: Boxes) -> BoolArray:
        free = free.copy()
        for low, high in boxes:
            if high[2] > STEP_OVER and low[2] < HEADROOM:
                free[self._cells_near(low[:2], high[:2])] = False
        return free

    def _walkable(self, item: PlacedPiece, front: Boxes | None) -> bool:
        """Return True if paths still join all doors and the item's front."""
        free = self._without(self._free, item.collision_boxes)
        labels = ndimage.label(free)[0]
        seen = {self._label_near(labels, door, 0.3) for door in self.doors}
        if front is not None:
            x, y = front[0, :, :2].mean(axis=0)
            seen.add(self._label_near(labels, (float(x), float(y)), 0.45))
        if not seen:
            return True
        if len(seen) > 1 or 0 in seen:
            return False
        area = float((labels == seen.pop()).sum()) * CELL * CELL
        return area > 0.09 * self.shape.area

    def _label_near(self, labels: npt.NDArray, point: tuple[float, float], within: float) -> int:
        """Label of the free cell nearest to a point, 0 if none is `within` metres."""
        cell = np.floor((np.array(point) - self._origin) / CELL).astype(int)
        radius = round(within / CELL)
        low = np.maximum(cell - radius, 0)
        patch = labels[low[0] : cell[0] + radius + 1, low[1] : cell[1] + radius + 1]
        if not (patch > 0).any():
            return 0
        where = np.argwhere(patch > 0)
        nearest = where[np.argmin(((where + low - cell) ** 2).sum(axis=1))]
        return int(patch[nearest[0], nearest[1]])

    def _walkable_floor(self) -> BoolArray:
        """Grid cells (columns, rows) of the empty room where a person can stand."""
        x0, y0, x1, y1 = self.shape.bounds
        columns, rows = math.ceil((x1 - x0) / CELL), math.ceil((y1 - y0) / CELL)
        xs = x0 + (np.arange(columns) + 0.5) * CELL
        ys = y0 + (np.arange(rows) + 0.5) * CELL
        body = buffered(self.shape, -HALF_BODY_WIDTH, join_style="mitre")
        free = np.asarray(shapely.contains_xy(body, xs[:, None], ys[None, :]))
        for slope in self.plan.slopes:
            free &= slope.height_at(xs[:, None], ys[None, :]) > HEADROOM
        return free

    def add(self, item: PlacedPiece, front: Boxes | None = None) -> None:
        """Keep a piece at its pose without a test, and its clear zone if given, (1, 2, 3)."""
        item.occupied = [[] for _ in item.piece.surfaces]
        self.items.append(item)
        self._add_solids(item.collision_boxes, item.id)
        if front is not None:
            self._keep_clear(box(*front[0, :, :2].ravel()), item.id)

    def _add_solids(self, boxes: Boxes, owner: str) -> None:
        self._add_boxes(boxes, owner)
        self._free = self._without(self._free, boxes)

    def _add_boxes(self, boxes: Boxes, owner: str) -> None:
        self._boxes = np.concatenate([self._boxes, boxes])
        self._owners += [owner] * len(boxes)

    @contextmanager
    def openings_unblocked(self) -> Iterator[None]:
        """Context in which items may hang in front of openings."""
        blocked, self._blocked = self._blocked, np.zeros((0, 2, 3))
        try:
            yield
        finally:
            self._blocked = blocked

    def middle(self) -> Float64Array:
        """Return the point below the level ceiling that is farthest from its edges, (2,)."""
        level = level_part(self.plan, self.shape) if self.plan.slopes else self.shape
        return deepest_point(largest_part(level), 0.1)

    def open_middle(self) -> Float64Array:
        """Return the point of the free floor that is farthest from all obstacles, (2,)."""
        return self.open_circle()[0]

    def open_circle(self) -> tuple[Float64Array, float]:
        """Return the largest circle of free floor: its centre (2,) and radius in metres."""
        depth = ndimage.distance_transform_edt(np.pad(self._free, 1))[1:-1, 1:-1]
        index = np.unravel_index(int(np.argmax(depth)), depth.shape)
        return self._origin + (np.array(index) + 0.5) * CELL, float(depth[index]) * CELL

    def _candidate(self, kind: str, piece: FurniturePiece, pose: Pose) -> PlacedPiece:
        """Return a piece at a pose, under the next free id, not placed yet."""
        name = f"{self.room.id}-{kind}-{len(self.items)}"
        return PlacedPiece(name, kind, piece, pose, collision_boxes(piece, pose))

    def place_on_sill(
        self, kind: str, piece: FurniturePiece, pose: Pose, window: Opening
    ) -> PlacedPiece | None:
        """Place a small object on a window sill, inside the reveal."""
        item = self._candidate(kind, piece, pose)
        high = item.bounds[1]
        if high[2] > window.z1 or _overlap(item.collision_boxes, self._boxes).any():
            return None
        self.add(item)
        return item


def yaw_facing(direction: tuple[float, float]) -> float:
    """Return the yaw in degrees at which the front of a piece faces `direction`."""
    degrees = math.degrees(math.atan2(direction[0], -direction[1])) % 360
    nearest = round(degrees / 90) * 90
    return float(nearest % 360) if abs(degrees - nearest) < 1e-6 else degrees


def collision_boxes(piece: FurniturePiece, pose: Pose) -> Boxes:
    """Return the world boxes (N, 2, 3) of a piece: its bounds, or those of its bodies."""
    local = piece.bodies if piece.category in _SEVERAL_BOXES else piece.bounds[None]
    if pose.yaw % 90 == 0:
        corners = pose.apply(local.reshape(-1, 3)).reshape(-1, 2, 3)
        return np.stack([corners.min(axis=1), corners.max(axis=1)], axis=1)
    world = np.stack([pose.apply(corners_of(body)) for body in local])
    return np.stack([world.min(axis=1), world.max(axis=1)], axis=1)


def corners_of(bounds: Boxes) -> Float64Array:
    """Return the eight corners (8, 3) of a box (2, 3)."""
    x, y, z = bounds.T
    return np.array([[a, b, c] for a in x for b in y for c in z])


def _front(piece: FurniturePiece, pose: Pose) -> Boxes:
    """Clear zone in front of a piece as a box (1, 2, 3)."""
    low, high = piece.bounds
    zone = np.array([[low[0], low[1] - piece.front_clearance, 0.1], [high[0], low[1], 1.2]])
    corners = pose.apply(corners_of(zone))
    return np.stack([corners.min(axis=0), corners.max(axis=0)])[None]


def _raised(area: Polygon, z0: float, z1: float) -> Boxes:
    x0, y0, x1, y1 = area.bounds
    return np.array([[[x0, y0, z0], [x1, y1, z1]]])


def _overlap(first: Boxes, second: Boxes) -> BoolArray:
    """Pairs of boxes that overlap by more than contact, bool (N, M)."""
    low = np.maximum(first[:, None, 0], second[None, :, 0])
    high = np.minimum(first[:, None, 1], second[None, :, 1])
    return np.asarray((high - low > CONTACT_TOLERANCE).all(axis=2))


def _overlap_2d(boxes: Boxes, low: tuple[float, float], high: tuple[float, float]) -> bool:
    inner_low = np.maximum(boxes[:, 0, :2], np.array(low))
    inner_high = np.minimum(boxes[:, 1, :2], np.array(high))
    return bool((inner_high - inner_low > CONTACT_TOLERANCE).all(axis=1).any())
