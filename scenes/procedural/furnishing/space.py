"""A room while it is being furnished: what stands where, what must stay free, where one walks.

Everything is decided on boxes. Most pieces are one box; those with room below or between their
parts (tables, chairs, curtains) are a box for every connected body of their meshes, so that a
chair goes under a table. Quarter turns keep boxes exact; other turns take the box around.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import shapely
from scipy import ndimage
from shapely.geometry import Polygon, box
from shapely.prepared import prep

from scenes.arrays import BoolArray, Float64Array
from scenes.procedural.piece import Piece
from scenes.procedural.plan import Opening, Plan, PlanRoom, WallEdge
from scenes.procedural.scene_item import Pose, Thing, placed
from scenes.procedural.structure import CASING, SKIRTING, leaf_footprint

Boxes = Float64Array  # (N, 2, 3): low and high corners

TOUCH = 1e-3  # metres that may overlap: surfaces in contact
BODY = 0.21  # half the width of a person who passes
STEP_OVER = 0.06  # metres; lower things are walked over
HEAD = 1.75  # higher things are walked under
_FLAT = 0.02  # metres from the wall; what is flatter is walked past
CELL = 0.05  # of the walking grid, metres
SKIRTING_TOP = 0.125  # metres; no skirting is higher
GAP = SKIRTING + 0.004  # between a wall and what stands against it
# Categories whose bodies are looked at one by one.
_OPEN = ("table", "desk", "chair", "stool", "curtain", "radiator", "bench", "kitchen unit")


@dataclass
class Item:
    """A piece at its place; `taken` are the boxes (M, 2, 2) used up on each of its surfaces."""

    id: str
    kind: str
    piece: Piece
    pose: Pose
    solids: Boxes
    taken: list[list[Float64Array]] = field(default_factory=list)

    @property
    def bounds(self) -> Boxes:
        """World bounds (2, 3)."""
        return np.stack([self.solids[:, 0].min(axis=0), self.solids[:, 1].max(axis=0)])

    def thing(self, room: str) -> Thing:
        """The scene object."""
        return placed(self.piece, self.pose, self.id, room)


@dataclass(frozen=True)
class _Zone:
    """Floor to keep free of what stands on it: (2, 2) bounds, and who may stand there still."""

    low: tuple[float, float]
    high: tuple[float, float]
    owner: str


class RoomSpace:
    """The state of one room; poses are tried and, where everything holds, kept."""

    def __init__(self, plan: Plan, room: PlanRoom) -> None:
        self.plan, self.room = plan, room
        self.shape: Polygon = room.shape
        self.inside = prep(self.shape.buffer(TOUCH, join_style="mitre"))
        # Between the skirtings, for what reaches down to them.
        self._between = prep(self.shape.buffer(TOUCH - GAP, join_style="mitre"))
        self.items: list[Item] = []
        self._boxes: Boxes = np.zeros((0, 2, 3))
        self._owners: list[str] = []
        self._zones: list[_Zone] = []
        self._blocked: Boxes = np.zeros((0, 2, 3))  # openings: nothing may hang or stand before
        x0, y0, x1, y1 = self.shape.bounds
        self._origin = np.array([x0, y0])
        columns, rows = math.ceil((x1 - x0) / CELL), math.ceil((y1 - y0) / CELL)
        xs = x0 + (np.arange(columns) + 0.5) * CELL
        ys = y0 + (np.arange(rows) + 0.5) * CELL
        body = self.shape.buffer(-BODY, join_style="mitre")
        self._free = shapely.contains_xy(body, xs[:, None], ys[None, :])
        self.doors: list[tuple[float, float]] = []
        for opening in plan.openings:
            if room.id in opening.rooms:
                self._keep_opening(opening)

    # -- openings -------------------------------------------------------------------------

    def edge_of(self, opening: Opening) -> WallEdge:
        """The opening's piece of wall, seen from this room."""
        if opening.rooms[0] == self.room.id:
            return opening.edge
        edge = opening.edge
        return WallEdge(
            edge.at(opening.width, -opening.thickness), edge.at(0, -opening.thickness), edge.outer
        )

    def _keep_opening(self, opening: Opening) -> None:
        edge, width = self.edge_of(opening), opening.width
        margin = CASING[0] if opening.kind != "window" else 0.045
        deep = 0.06 if opening.kind == "window" else 0.12
        front = edge.strip(-margin, width + margin, 0.0, deep)
        self._blocked = np.concatenate([self._blocked, _raised(front, opening.z0 - 0.05, 2.3)])
        if opening.kind == "window":
            return
        deep = 0.7 if opening.kind != "patio" else 0.6
        self._keep(edge.strip(0, width, 0.0, deep), "way")
        self.doors.append(edge.at(width / 2, 0.35))
        if opening.kind in ("door", "entrance") and opening.swing == self.room.id:
            self._keep(edge.strip(0, width, 0.0, width), "swing")
            leaf = leaf_footprint(self.plan, opening)
            if leaf is not None:
                self._keep(leaf.buffer(0.05), "leaf")
                # Nothing may touch the leaf, but who walks pushes it aside.
                self._boxes = np.concatenate([self._boxes, _raised(leaf.buffer(0.06), 0.0, 2.05)])
                self._owners.append("leaf")

    def _keep(self, area: Polygon, owner: str) -> None:
        x0, y0, x1, y1 = area.bounds
        self._zones.append(_Zone((x0, y0), (x1, y1), owner))

    def windows(self) -> list[Opening]:
        """This room's windows."""
        return [
            opening
            for opening in self.plan.openings
            if opening.rooms == (self.room.id,) and opening.kind in ("window", "patio")
        ]

    # -- trying ---------------------------------------------------------------------------

    def try_place(
        self,
        kind: str,
        piece: Piece,
        pose: Pose,
        *,
        allow: Collection[str] = (),
        zone: bool = True,
        beneath: Collection[str] = (),
        on_floor: bool = True,
    ) -> Item | None:
        """Keep `piece` at `pose` if nothing forbids it, else None.

        `allow` names items (or "way", "swing") whose free zones it may stand in; `beneath` items
        it may touch, such as what carries it. `zone` reserves the floor before its front.
        """
        item = Item(
            f"{self.room.id}-{kind}-{len(self.items)}", kind, piece, pose, solids(piece, pose)
        )
        if not self._holds(item, allow, beneath, on_floor):
            return None
        front = _front(piece, pose) if zone and on_floor and piece.front_clearance > 0 else None
        if front is not None and not self._zone_holds(front, allow):
            return None
        if on_floor and not self._walkable(item, front):
            return None
        self._commit(item, front)
        return item

    def fits(self, piece: Piece, pose: Pose, allow: Collection[str] = ()) -> bool:
        """Whether `try_place` without a zone would succeed, walking aside."""
        return self._holds(Item("", "", piece, pose, solids(piece, pose)), allow, (), True)

    def remove_last(self) -> None:
        """Take back the item placed last."""
        item = self.items.pop()
        keep = [owner != item.id for owner in self._owners]
        self._boxes = self._boxes[np.array(keep, dtype=bool)]
        self._owners = [owner for owner in self._owners if owner != item.id]
        self._zones = [zone for zone in self._zones if zone.owner != item.id]
        self._rebuild_walk()

    def _holds(
        self, item: Item, allow: Collection[str], beneath: Collection[str], on_floor: bool
    ) -> bool:
        low, high = item.bounds
        if high[2] > self.plan.height + TOUCH or low[2] < -TOUCH:
            return False
        if not self._between.covers(box(low[0], low[1], high[0], high[1])):
            for body in item.solids:
                limit = self._between if body[0, 2] < SKIRTING_TOP else self.inside
                if not limit.covers(box(*body[0, :2], *body[1, :2])):
                    return False
        if _overlap(item.solids, self._blocked).any():
            return False
        hits = _overlap(item.solids, self._boxes)
        if any(self._owners[k] not in beneath for k in np.flatnonzero(hits.any(axis=0))):
            return False
        if on_floor and high[2] > STEP_OVER and low[2] < 1.2:
            for zone in self._zones:
                if zone.owner in allow:
                    continue
                if _overlap_2d(item.solids[item.solids[:, 0, 2] < 1.2], zone.low, zone.high):
                    return False
        return True

    def _zone_holds(self, front: Boxes, allow: Collection[str]) -> bool:
        hits = _overlap(front, self._boxes).any(axis=0)
        for k in np.flatnonzero(hits):
            standing = self._boxes[k, 1, 2] > STEP_OVER and self._boxes[k, 0, 2] < 1.2
            if standing and self._owners[k] not in allow:
                return False
        centre = shapely.Point(*front[0, :, :2].mean(axis=0))
        return bool(self.inside.covers(centre))

    # -- walking --------------------------------------------------------------------------

    def _window_of(self, low: npt.NDArray, high: npt.NDArray) -> tuple[slice, slice]:
        first = np.floor((low - BODY - self._origin) / CELL).astype(int)
        last = np.ceil((high + BODY - self._origin) / CELL).astype(int)
        first, last = np.maximum(first, 0), np.maximum(last, 0)
        return slice(first[0], last[0]), slice(first[1], last[1])

    def _without(self, free: BoolArray, boxes: Boxes) -> BoolArray:
        free = free.copy()
        for low, high in boxes:
            if high[2] > STEP_OVER and low[2] < HEAD:
                free[self._window_of(low[:2], high[:2])] = False
        return free

    def _walkable(self, item: Item, front: Boxes | None) -> bool:
        """Whether all doors and the item's front can still be reached from one another."""
        free = self._without(self._free, item.solids)
        labels = ndimage.label(free)[0]
        goals = list(self.doors)
        if front is not None:
            x, y = front[0, :, :2].mean(axis=0)
            goals.append((float(x), float(y)))
        seen = {
            self._label_near(labels, goal, 0.3 if k < len(self.doors) else 0.45)
            for k, goal in enumerate(goals)
        }
        if not seen:
            return True
        if len(seen) > 1 or 0 in seen:
            return False
        reach = float((labels == seen.pop()).sum()) * CELL * CELL
        return reach > 0.09 * self.shape.area

    def _label_near(self, labels: npt.NDArray, point: tuple[float, float], within: float) -> int:
        cell = np.floor((np.array(point) - self._origin) / CELL).astype(int)
        radius = round(within / CELL)
        low = np.maximum(cell - radius, 0)
        patch = labels[low[0] : cell[0] + radius + 1, low[1] : cell[1] + radius + 1]
        if not (patch > 0).any():
            return 0
        where = np.argwhere(patch > 0)
        nearest = where[np.argmin(((where + low - cell) ** 2).sum(axis=1))]
        return int(patch[nearest[0], nearest[1]])

    def _rebuild_walk(self) -> None:
        body = self.shape.buffer(-BODY, join_style="mitre")
        columns, rows = self._free.shape
        xs = self._origin[0] + (np.arange(columns) + 0.5) * CELL
        ys = self._origin[1] + (np.arange(rows) + 0.5) * CELL
        self._free = shapely.contains_xy(body, xs[:, None], ys[None, :])
        moveless = np.array([owner != "leaf" for owner in self._owners], dtype=bool)
        self._free = self._without(self._free, self._boxes[moveless])

    # -- keeping --------------------------------------------------------------------------

    def _commit(self, item: Item, front: Boxes | None) -> None:
        item.taken = [[] for _ in item.piece.surfaces]
        self.items.append(item)
        self._add_solids(item.solids, item.id)
        if front is not None:
            low, high = front[0, :, :2]
            self._zones.append(
                _Zone((float(low[0]), float(low[1])), (float(high[0]), float(high[1])), item.id)
            )

    def _add_solids(self, boxes: Boxes, owner: str) -> None:
        self._boxes = np.concatenate([self._boxes, boxes])
        self._owners += [owner] * len(boxes)
        self._free = self._without(self._free, boxes)

    def without_blocks(self) -> Boxes:
        """Let things hang before openings for a while; returns what `restore_blocks` wants."""
        kept, self._blocked = self._blocked, np.zeros((0, 2, 3))
        return kept

    def restore_blocks(self, kept: Boxes) -> None:
        """The reverse of `without_blocks`."""
        self._blocked = kept

    def middle(self) -> Float64Array:
        """The point of the floor farthest from the walls."""
        return np.array(shapely.maximum_inscribed_circle(self.shape, 0.1).coords[0])

    def open_middle(self) -> Float64Array:
        """The point of the free floor farthest from all that stands."""
        return self.open_circle()[0]

    def open_circle(self) -> tuple[Float64Array, float]:
        """The widest circle of free floor: its middle, and its radius in metres."""
        depth = ndimage.distance_transform_edt(np.pad(self._free, 1))[1:-1, 1:-1]
        index = np.unravel_index(int(np.argmax(depth)), depth.shape)
        return self._origin + (np.array(index) + 0.5) * CELL, float(depth[index]) * CELL

    def place_on_sill(self, kind: str, piece: Piece, pose: Pose, window: Opening) -> Item | None:
        """Stand a small thing on a window's sill, inside the reveal."""
        item = Item(
            f"{self.room.id}-{kind}-{len(self.items)}", kind, piece, pose, solids(piece, pose)
        )
        high = item.bounds[1]
        if high[2] > window.z1 or _overlap(item.solids, self._boxes).any():
            return None
        self._commit(item, None)
        return item

    # -- ways of placing ------------------------------------------------------------------

    def wall_pose(self, piece: Piece, edge: WallEdge, s: float, z: float = 0.0) -> Pose:
        """The pose with the piece's back to the wall, its middle `s` along it."""
        back = 0.0 if piece.anchor == "on_wall" else float(piece.bounds[1, 1]) + GAP
        x, y = edge.at(s, back)
        return Pose(x, y, z, facing(edge.inward))

    def along_walls(
        self,
        rng: np.random.Generator,
        piece: Piece,
        edges: Iterable[WallEdge] | None = None,
        where: str = "any",
        step: float = 0.15,
    ) -> list[tuple[WallEdge, float]]:
        """Places (edge, s) along the walls in a random order: "any", "corner" or "middle" first."""
        low, high = piece.bounds[:, 0]
        half = 0.5 * float(high - low)
        places = []
        for edge in self.room.edges if edges is None else edges:
            margin = GAP if piece.mount_height < SKIRTING_TOP else TOUCH
            first, last = half + margin, edge.length - half - margin
            if last < first:
                continue
            count = max(1, int((last - first) / step) + 1)
            for s in np.linspace(first, last, count):
                if where == "corner":
                    rank = min(s - first, last - s)
                elif where == "middle":
                    rank = abs(s - edge.length / 2) / edge.length
                else:
                    rank = 0.0
                # The piece's x runs against the wall's direction.
                places.append(
                    (float(rank) + 0.4 * rng.random(), edge, float(s) + 0.5 * (low + high))
                )
        places.sort(key=lambda place: place[0])
        return [(edge, float(s)) for _, edge, s in places]

    def against_wall(
        self,
        rng: np.random.Generator,
        kind: str,
        piece: Piece,
        *,
        edges: Iterable[WallEdge] | None = None,
        where: str = "any",
        allow: Collection[str] = (),
        zone: bool = True,
        tries: int = 60,
    ) -> Item | None:
        """Stand a piece with its back to some wall."""
        for edge, s in self.along_walls(rng, piece, edges, where)[:tries]:
            item = self.try_place(
                kind, piece, self.wall_pose(piece, edge, s), allow=allow, zone=zone
            )
            if item is not None:
                return item
        return None

    def on_wall(
        self,
        rng: np.random.Generator,
        kind: str,
        piece: Piece,
        *,
        edges: Iterable[WallEdge] | None = None,
        z: float | None = None,
        where: str = "any",
        tries: int = 30,
    ) -> Item | None:
        """Hang a piece on some wall at its mounting height."""
        height = piece.mount_height if z is None else z
        for edge, s in self.along_walls(rng, piece, edges, where)[:tries]:
            item = self.hang(kind, piece, edge, s, height)
            if item is not None:
                return item
        return None

    def hang(self, kind: str, piece: Piece, edge: WallEdge, s: float, z: float) -> Item | None:
        """Hang a piece at one place of a wall."""
        pose = self.wall_pose(piece, edge, s, z)
        walked = float(piece.bounds[0, 2]) + z < HEAD and float(piece.bounds[0, 1]) < -_FLAT
        return self.try_place(kind, piece, pose, zone=False, on_floor=walked)

    def in_corner(
        self, rng: np.random.Generator, kind: str, piece: Piece, turned: bool = True
    ) -> Item | None:
        """Stand a piece into a corner of the room."""
        low, high = piece.bounds
        reach = float(max(np.abs(low[:2]).max(), np.abs(high[:2]).max())) + GAP
        edges = self.room.edges
        corners = []
        for before, after in zip(edges, edges[1:] + edges[:1], strict=True):
            if before.along[0] * after.along[1] - before.along[1] * after.along[0] > 0:
                corners.append((before, after))
        for index in rng.permutation(len(corners)):
            before, after = corners[int(index)]
            away = reach + float(rng.uniform(0.0, 0.06))
            x = after.start[0] + away * (after.inward[0] + before.inward[0])
            y = after.start[1] + away * (after.inward[1] + before.inward[1])
            turn = facing(after.inward) + (90.0 * int(rng.integers(4)) if turned else 0.0)
            item = self.try_place(kind, piece, Pose(x, y, 0.0, turn), zone=False)
            if item is not None:
                return item
        return None

    def anywhere(
        self,
        rng: np.random.Generator,
        kind: str,
        piece: Piece,
        *,
        near: Float64Array | None = None,
        spread: float = 0.6,
        tries: int = 40,
        turn: Callable[[float, float], float] | None = None,
    ) -> Item | None:
        """Stand a piece on free floor, near a point if one is given."""
        x0, y0, x1, y1 = self.shape.bounds
        for _ in range(tries):
            if near is None:
                x, y = float(rng.uniform(x0, x1)), float(rng.uniform(y0, y1))
            else:
                x, y = (float(value) for value in near + rng.normal(0, spread, 2))
            angle = turn(x, y) if turn else 90.0 * int(rng.integers(4))
            item = self.try_place(kind, piece, Pose(x, y, 0.0, angle))
            if item is not None:
                return item
        return None

    def on_top(
        self,
        rng: np.random.Generator,
        kind: str,
        piece: Piece,
        carrier: Item,
        *,
        surface: int | None = None,
        centre: bool = False,
        yaw: float = 0.0,
        tries: int = 12,
    ) -> Item | None:
        """Stand a piece on one of the surfaces of `carrier`, clear of what stands there."""
        surfaces = carrier.piece.surfaces
        order = rng.permutation(len(surfaces)) if surface is None else [surface]
        for index in order:
            place = surfaces[int(index)]
            turned = Pose(0.0, 0.0, 0.0, yaw).apply(_corners(piece.bounds))
            low, high = turned.min(axis=0), turned.max(axis=0)
            room_x = place.half_x - 0.5 * (high[0] - low[0])
            room_y = place.half_y - 0.5 * (high[1] - low[1])
            if room_x < -1e-6 or room_y < -1e-6 or high[2] - low[2] > place.headroom:
                continue
            for _ in range(1 if centre else tries):
                dx, dy = (0.0, 0.0) if centre else rng.uniform(-1, 1, 2) * (room_x, room_y)
                x = place.x + dx - 0.5 * (low[0] + high[0])
                y = place.y + dy - 0.5 * (low[1] + high[1])
                rect = np.array([[x + low[0], y + low[1]], [x + high[0], y + high[1]]])
                if any(_overlap_2d_rect(rect, other) for other in carrier.taken[int(index)]):
                    continue
                at = carrier.pose.apply(np.array([[x, y, place.z]]))[0]
                pose = Pose(
                    float(at[0]), float(at[1]), float(at[2]), (carrier.pose.turn + yaw) % 360
                )
                item = self.try_place(
                    kind, piece, pose, zone=False, beneath=(carrier.id,), on_floor=False
                )
                if item is not None:
                    carrier.taken[int(index)].append(rect)
                    return item
        return None

    def nearest_edge(self, direction: tuple[float, float], point: npt.NDArray) -> WallEdge | None:
        """The wall that a look from `point` along `direction` meets first."""
        best: tuple[float, WallEdge] | None = None
        for edge in self.room.edges:
            facing_it = -(edge.inward[0] * direction[0] + edge.inward[1] * direction[1])
            if facing_it < 0.9:
                continue
            offset = (edge.start[0] - point[0], edge.start[1] - point[1])
            distance = offset[0] * direction[0] + offset[1] * direction[1]
            s = -(offset[0] * edge.along[0] + offset[1] * edge.along[1])
            if distance > 0 and 0 < s < edge.length and (best is None or distance < best[0]):
                best = (distance, edge)
        return best[1] if best else None

    def position_on(self, edge: WallEdge, point: npt.NDArray) -> float:
        """How far along a wall the foot of `point` lies."""
        return float(
            (point[0] - edge.start[0]) * edge.along[0] + (point[1] - edge.start[1]) * edge.along[1]
        )


def facing(direction: tuple[float, float]) -> float:
    """The turn in degrees that makes a piece's front look along `direction`."""
    degrees = math.degrees(math.atan2(direction[0], -direction[1])) % 360
    nearest = round(degrees / 90) * 90
    return float(nearest % 360) if abs(degrees - nearest) < 1e-6 else degrees


def solids(piece: Piece, pose: Pose) -> Boxes:
    """World boxes (N, 2, 3) of a piece: its whole, or each of its bodies where it is open."""
    local = piece.bodies if piece.category in _OPEN else piece.bounds[None]
    if pose.turn % 90 == 0:
        corners = pose.apply(local.reshape(-1, 3)).reshape(-1, 2, 3)
        return np.stack([corners.min(axis=1), corners.max(axis=1)], axis=1)
    world = np.stack([pose.apply(_corners(body)) for body in local])
    return np.stack([world.min(axis=1), world.max(axis=1)], axis=1)


def _corners(bounds: Boxes) -> Float64Array:
    x, y, z = bounds.T
    return np.array([[a, b, c] for a in x for b in y for c in z])


def _front(piece: Piece, pose: Pose) -> Boxes:
    """The zone before a piece that its use needs, as a box (1, 2, 3)."""
    low, high = piece.bounds
    zone = np.array([[low[0], low[1] - piece.front_clearance, 0.1], [high[0], low[1], 1.2]])
    corners = pose.apply(_corners(zone))
    return np.stack([corners.min(axis=0), corners.max(axis=0)])[None]


def _raised(area: Polygon, z0: float, z1: float) -> Boxes:
    x0, y0, x1, y1 = area.bounds
    return np.array([[[x0, y0, z0], [x1, y1, z1]]])


def _overlap(first: Boxes, second: Boxes) -> BoolArray:
    """(N, M): which boxes share more than a touch."""
    low = np.maximum(first[:, None, 0], second[None, :, 0])
    high = np.minimum(first[:, None, 1], second[None, :, 1])
    return np.asarray((high - low > TOUCH).all(axis=2))


def _overlap_2d(boxes: Boxes, low: tuple[float, float], high: tuple[float, float]) -> bool:
    inner_low = np.maximum(boxes[:, 0, :2], np.array(low))
    inner_high = np.minimum(boxes[:, 1, :2], np.array(high))
    return bool((inner_high - inner_low > TOUCH).all(axis=1).any())


def _overlap_2d_rect(first: npt.NDArray, second: npt.NDArray) -> bool:
    low, high = np.maximum(first[0], second[0]), np.minimum(first[1], second[1])
    return bool((high - low > -0.01).all())
