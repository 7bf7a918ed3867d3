"""One room being furnished: its space, its style, and how single pieces find their places."""

from __future__ import annotations

import numpy as np

from scenes.procedural.furnishing.asset_sampler import Shop
from scenes.procedural.furnishing.space import GAP, Item, RoomSpace, facing
from scenes.procedural.furniture import Style, catalogue
from scenes.procedural.piece import Piece
from scenes.procedural.plan import Opening, Plan, PlanRoom, WallEdge
from scenes.procedural.scene_item import Pose

Point = np.ndarray
_PLANTS = 6


class Furnisher:
    """Fills one room. `plants`: the small ones of the whole home, a few kinds seen again."""

    def __init__(
        self,
        rng: np.random.Generator,
        plan: Plan,
        room: PlanRoom,
        style: Style,
        plants: list[Piece],
        shop: Shop | None = None,
    ) -> None:
        self.shop = shop
        self.rng, self.plan, self.room, self.style = rng, plan, room, style
        self.plants = plants
        self.space = RoomSpace(plan, room)
        self.area = room.shape.area

    def chance(self, probability: float) -> bool:
        """True with that probability."""
        return bool(self.rng.random() < probability)

    def make(self, kind: str, **options: float) -> Piece:
        """A piece in the home's style, or one of the shop's in place of it."""
        bought = self.shop.offer(kind, options) if self.shop is not None else None
        if bought is not None:
            return bought
        if kind != "small_plant":
            return self._new(kind, options)
        if len(self.plants) < _PLANTS:
            self.plants.append(self._new(kind, options))
            return self.plants[-1]
        return self.plants[int(self.rng.integers(_PLANTS))]

    def _new(self, kind: str, options: dict[str, float]) -> Piece:
        return catalogue[kind].make(self.rng, self.style, **options)

    def along_wall(self, kind: str, where: str = "any") -> Item | None:
        """Stand a piece with its back to some wall."""
        for _ in range(2):
            item = self.space.against_wall(self.rng, kind, self.make(kind), where=where)
            if item is not None:
                return item
        return None

    def put_plant(self) -> None:
        """A large plant in a corner."""
        self.space.in_corner(self.rng, "plant", self.make("plant"))

    def lay_rug(self) -> None:
        """Perhaps a rug in the middle of the free floor."""
        if not self.chance(0.5):
            return
        rug = self.make("rug", width=float(self.rng.uniform(1.2, 1.8)), depth=1.0)
        middle = self.space.open_middle()
        pose = Pose(float(middle[0]), float(middle[1]), 0.0, float(self.rng.choice([0.0, 90.0])))
        self.space.try_place("rug", rug, pose, zone=False)

    def hang(self, kind: str) -> Item | None:
        """Hang a piece on some bare wall."""
        piece = self.make(kind)
        return self.space.on_wall(self.rng, kind, piece)

    def hang_pictures(self, count: int) -> None:
        """Pictures: first over what stands low against a wall, then on bare walls."""
        rng, space = self.rng, self.space
        below = [
            item
            for item in space.items
            if item.kind in ("sofa", "double_bed", "single_bed", "sideboard", "chest_of_drawers")
        ]
        for index in rng.permutation(len(below)):
            if count <= 0:
                return
            item = below[int(index)]
            edge = self.edge_behind(item)
            if edge is None:
                continue
            s = space.position_on(edge, np.array([item.pose.x, item.pose.y]))
            number = 2 if self.chance(0.3) else 1
            for k in range(number):
                piece = self.make("picture")
                size = 0.5 * float(np.ptp(piece.bounds[:, 0]))
                offset = 0.0 if number == 1 else (2 * k - 1) * (size + 0.08)
                clearance = float(item.bounds[1, 2]) + 0.15 - float(piece.bounds[0, 2])
                height = max(piece.mount_height, clearance)
                if height + float(piece.bounds[1, 2]) < self.plan.height - 0.1:
                    space.hang("picture", piece, edge, s + offset, height)
            count -= 1
        for _ in range(count):
            piece = self.make("picture")
            space.on_wall(rng, "picture", piece, where="middle")

    def edge_behind(self, item: Item) -> WallEdge | None:
        """The wall that an item has its back to."""
        for edge in self.room.edges:
            s = self.space.position_on(edge, np.array([item.pose.x, item.pose.y]))
            behind = abs(_depth(edge, item) - float(item.piece.bounds[1, 1]) - GAP) < 0.05
            if facing(edge.inward) == item.pose.turn and 0 < s < edge.length and behind:
                return edge
        return None


def has_opening(edge: WallEdge, opening: Opening) -> bool:
    """Whether an opening of this room lies in that wall."""
    dx, dy = opening.start[0] - edge.start[0], opening.start[1] - edge.start[1]
    depth = dx * edge.inward[0] + dy * edge.inward[1]
    along = dx * edge.along[0] + dy * edge.along[1]
    same = edge.inward[0] * opening.edge.inward[0] + edge.inward[1] * opening.edge.inward[1]
    return abs(depth) < 1e-3 and -1e-3 <= along <= edge.length and same > 0.99


def _depth(edge: WallEdge, item: Item) -> float:
    return float(
        (item.pose.x - edge.start[0]) * edge.inward[0]
        + (item.pose.y - edge.start[1]) * edge.inward[1]
    )
