"""Furnishing state of one room, and placement of single pieces."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pbrnet.scenes.procedural.furnishing.asset_sampler import AssetSampler
from pbrnet.scenes.procedural.furnishing.search import SearchedSpace
from pbrnet.scenes.procedural.furnishing.space import GAP, PlacedPiece, yaw_facing
from pbrnet.scenes.procedural.furniture import FURNITURE_KINDS, Style
from pbrnet.scenes.procedural.furniture.plants import SPECIES
from pbrnet.scenes.procedural.furniture.things.kinds import THINGS
from pbrnet.scenes.procedural.piece import FurniturePiece
from pbrnet.scenes.procedural.plan import Opening, Plan, PlanRoom, WallEdge
from pbrnet.scenes.procedural.scene_item import Pose
from pbrnet.scenes.seeds import Draw

Point = np.ndarray
# Furniture that is left like a thing: in few rooms each.
_SMALL = (
    *("books_stack", "vase", "candle", "fruit_bowl", "laptop", "crockery", "bottle", "kettle"),
    *("microwave", "cooking_pot", "toiletries", "storage_box", "wall_clock"),
)
_SHARE = 0.12  # of the rooms in which a kind of thing may be left


class Furnisher:
    """Furnishes one room; `plants` are the small plants that all rooms of the home share."""

    def __init__(
        self,
        rng: Draw,
        plan: Plan,
        room: PlanRoom,
        style: Style,
        plants: list[FurniturePiece],
        sampler: AssetSampler | None = None,
    ) -> None:
        self.sampler = sampler
        self.rng, self.plan, self.room, self.style = rng, plan, room, style
        self.plants = plants
        self.space = SearchedSpace(plan, room)
        self.area = room.shape.area
        self._species = [k for k in rng.shuffled(range(len(SPECIES))) if self.chance(_SHARE)]
        self.left: set[str] = set()  # kinds of things that were left in the room
        names = (*THINGS, *_SMALL)
        drawn = rng.random(len(names))
        self._kept_out = {name for name, one in zip(names, drawn, strict=True) if one > _SHARE}

    def chance(self, probability: float) -> bool:
        """Return True with that probability."""
        return self.rng.chance(probability)

    def may_leave(self, kind: str) -> bool:
        """Test whether a kind of thing may be left in this room, so that none is in most."""
        return bool(self._species) if kind == "small_plant" else kind not in self._kept_out

    def wants(self, probability: float) -> bool:
        """Return True with that probability in a home of middling density; for optional pieces."""
        return self.chance(1.0 - (1.0 - probability) ** self.style.interior.density)

    def number(self, low: int, high: int) -> int:
        """Draw a number from `low` to `high`, times the density of the style."""
        drawn = float(self.rng.integers(low, high + 1)) * self.style.interior.density
        return int(drawn + self.rng.random())

    def make(self, kind: str, **options: float) -> FurniturePiece:
        """Make a piece in the home's style, or sample one from the catalogues."""
        sampled = self.sampler.substitute(kind, options) if self.sampler is not None else None
        if sampled is not None:
            return sampled
        if kind != "small_plant":
            return self._generate(kind, options)
        wanted = self._species.pop() if self._species else self.rng.whole(len(SPECIES))
        for known in self.plants:
            if known.name == SPECIES[wanted]:
                return known
        self.plants.append(self._generate(kind, {**options, "species": wanted}))
        return self.plants[-1]

    def _generate(self, kind: str, options: Mapping[str, float]) -> FurniturePiece:
        made = THINGS[kind] if kind in THINGS else FURNITURE_KINDS[kind]
        return made.make(self.rng, self.style, **options)

    def _unwanted(self, wanted: float | None) -> bool:
        return wanted is not None and not self.wants(wanted)

    def along_wall(
        self, kind: str, where: str = "any", wanted: float | None = None
    ) -> PlacedPiece | None:
        """Place a piece with its back to a wall; two attempts with different pieces.

        `wanted`, here and below: the share of rooms in homes of middling density that have it.
        """
        if self._unwanted(wanted):
            return None
        for _ in range(2):
            item = self.space.against_wall(self.rng, kind, self.make(kind), where=where)
            if item is not None:
                return item
        return None

    def in_corner(self, kind: str, wanted: float | None = None) -> PlacedPiece | None:
        """Place a piece in a corner."""
        if self._unwanted(wanted):
            return None
        return self.space.in_corner(self.rng, kind, self.make(kind))

    def on_floor(self, kind: str, wanted: float | None = None) -> PlacedPiece | None:
        """Place a piece anywhere on the floor."""
        if self._unwanted(wanted):
            return None
        return self.space.anywhere(self.rng, kind, self.make(kind))

    def lay_rug(self) -> None:
        """With probability 1/2, lay a rug in the middle of the free floor."""
        if not self.chance(0.5):
            return
        rug = self.make("rug", width=self.rng.between(1.2, 1.8), depth=1.0)
        middle = self.space.open_middle()
        pose = Pose(float(middle[0]), float(middle[1]), 0.0, self.rng.pick([0.0, 90.0]))
        self.space.try_place("rug", rug, pose, zone=False)

    def hang(self, kind: str, wanted: float | None = None) -> PlacedPiece | None:
        """Hang a piece on a bare wall."""
        if self._unwanted(wanted):
            return None
        return self.space.on_wall(self.rng, kind, self.make(kind))

    def hang_clock(self) -> None:
        """Hang a clock in the rooms that may have one."""
        if self.may_leave("wall_clock"):
            self.hang("wall_clock")

    def on_top(
        self, kind: str, carrier: PlacedPiece, *, centre: bool = False, tries: int = 12
    ) -> PlacedPiece | None:
        """Place a piece on a support surface of another."""
        return self.space.on_top(
            self.rng, kind, self.make(kind), carrier, centre=centre, tries=tries
        )

    def place_beside(
        self, kind: str, piece: FurniturePiece, item: PlacedPiece, x: float, y: float, **how: Any
    ) -> PlacedPiece | None:
        """Place a piece on the floor at (x, y) of an item's frame, turned as it is."""
        return self.space.try_place(kind, piece, item.pose.beside(x, y), **how)

    def hang_pictures(self, count: int) -> None:
        """Hang pictures: first above low furniture against a wall, then on bare walls."""
        rng, space = self.rng, self.space
        below = [
            item
            for item in space.items
            if item.kind in ("sofa", "double_bed", "single_bed", "sideboard", "chest_of_drawers")
        ]
        for item in rng.shuffled(below):
            if count <= 0:
                return
            edge = self.edge_behind(item)
            if edge is None:
                continue
            s = item.along(edge)
            number = 2 if self.chance(0.35) else 1
            for k in range(number):
                piece = self.make("picture")
                size = 0.5 * piece.size[0]
                offset = 0.0 if number == 1 else (2 * k - 1) * (size + 0.08)
                clearance = float(item.bounds[1, 2]) + 0.15 - float(piece.bounds[0, 2])
                height = max(piece.mount_height, clearance)
                if height + float(piece.bounds[1, 2]) < self.plan.height - 0.1:
                    space.hang("picture", piece, edge, s + offset, height)
            count -= 1
        for _ in range(count):
            piece = self.make("picture")
            space.on_wall(rng, "picture", piece, where="middle")

    def hang_row(self, most: int, wanted: float) -> None:
        """Hang three to `most` pictures of one size in a row, where a wall has room for three."""
        if self._unwanted(wanted):
            return
        rng, space = self.rng, self.space
        width = rng.between(0.22, 0.38)
        height = width * rng.pick([1.0, 1.3, 1.4])
        count, gap = rng.whole(3, most + 1), rng.between(0.05, 0.12)
        row = [self._generate("picture", {"width": width, "height": height}) for _ in range(count)]
        level = row[0].mount_height
        for edge, middle in space.along_walls(rng, row[0], where="middle")[:12]:
            hung = 0
            for k, piece in enumerate(row):
                s = middle + (k - 0.5 * (count - 1)) * (width + gap)
                hung += space.hang("picture", piece, edge, s, level) is not None
            if hung >= 3:
                return
            for _ in range(hung):
                space.remove_last()

    def edge_behind(self, item: PlacedPiece) -> WallEdge | None:
        """Return the wall that the back of an item faces, or None."""
        for edge in self.room.edges:
            s, depth = edge.coordinates((item.pose.x, item.pose.y))
            behind = abs(depth - float(item.piece.bounds[1, 1]) - GAP) < 0.05
            if yaw_facing(edge.inward) == item.pose.yaw and 0 < s < edge.length and behind:
                return edge
        return None


def has_opening(edge: WallEdge, opening: Opening) -> bool:
    """Return True if an opening of the room lies in a wall."""
    s, depth = edge.coordinates(opening.start)
    return abs(depth) < 1e-3 and -1e-3 <= s <= edge.length and edge.faces_like(opening.edge)
