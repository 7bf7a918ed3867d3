"""Furnishing by rules: what goes into a room of each kind, and where.

Every room is filled in the same order: what belongs to its windows, the groups that make the
room what it is, lamps, further pieces along free walls, things on the walls, small things on
surfaces. A piece that finds no place is left out; rules of space are in `space`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from scenes.procedural.extras import furnish_further
from scenes.procedural.finishes import WALL_TILES
from scenes.procedural.furniture import Style, catalogue
from scenes.procedural.furniture.geometry import Mesh, span
from scenes.procedural.furniture.style import tone
from scenes.procedural.piece import Material, Piece
from scenes.procedural.plan import Opening, Plan, PlanRoom, WallEdge
from scenes.procedural.shop import Shop
from scenes.procedural.space import GAP, Item, RoomSpace, facing
from scenes.procedural.structure import pane_depth
from scenes.procedural.thing import Pose, Thing, part_of

Point = np.ndarray
_PLANTS = 6


def furnish(
    rng: np.random.Generator, plan: Plan, style: Style, shop: Shop | None = None
) -> list[Thing]:
    """The furniture of a whole home, as things in the world; some of it from a `shop`."""
    things: list[Thing] = []
    plants: list[Piece] = []
    for room in plan.rooms:
        maker = Furnisher(rng, plan, room, style, plants, shop)
        maker.fill()
        if shop is not None:
            furnish_further(maker.space, shop)
        things += [item.thing(room.id) for item in maker.space.items]
    return things


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

    def fill(self) -> None:
        """Everything, in order."""
        programmes: dict[str, Callable[[], None]] = {
            "living": self._living,
            "bedroom": self._bedroom,
            "kitchen": self._kitchen,
            "bathroom": self._bathroom,
            "study": self._study,
            "dining": self._dining,
        }
        if self.room.type not in ("kitchen", "bathroom"):
            self._dress_windows()
        programmes[self.room.type]()
        self._light_ceiling()
        self._sills()
        self._tops()

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

    # -- windows --------------------------------------------------------------------------

    def _dress_windows(self) -> None:
        dressed = self.chance(0.75)
        for window in self.space.windows():
            edge, width = window.edge, window.width
            if window.kind == "window" and window.z0 > 0.72 and self.chance(0.65):
                low = max(0.5, min(width - 0.6, 1.4))
                radiator = self.make("radiator", width=low)
                self._hang_at(edge, width / 2, "radiator", radiator, radiator.mount_height)
            if dressed:
                height = min(window.z1 + 0.12, self.plan.height - 0.06)
                curtains = self.make("curtains", width=width, height=height)
                self._curtain(edge, width / 2, curtains)

    def _curtain(self, edge: WallEdge, s: float, piece: Piece) -> None:
        """Curtains hang before their own window, so openings do not forbid them."""
        space = self.space
        kept = space.without_blocks()
        item = self._hang_at(edge, s, "curtains", piece, 0.0)
        space.restore_blocks(kept)
        if item is None:
            return

    def _hang_at(self, edge: WallEdge, s: float, kind: str, piece: Piece, z: float) -> Item | None:
        return self.space.hang(kind, piece, edge, s, z)

    def _sills(self) -> None:
        """Small things on window sills."""
        for window in self.space.windows():
            deep = pane_depth(window) - 0.05
            if window.z0 <= 0 or deep < 0.14:
                continue
            for _ in range(int(self.rng.integers(0, 3))):
                kind = str(self.rng.choice(["small_plant", "small_plant", "vase", "candle"]))
                piece = self.make(kind)
                low, high = piece.bounds
                size = float((high - low)[:2].max())
                if size > deep + 0.04 or high[2] > window.z1 - window.z0:
                    continue
                s = float(self.rng.uniform(size / 2 + 0.08, window.width - size / 2 - 0.08))
                centre = 0.5 * (low + high)
                x, y = window.edge.at(s, 0.03 - max(size / 2, deep / 2))
                pose = Pose(float(x - centre[0]), float(y - centre[1]), window.z0 + 0.022, 0.0)
                self.space.place_on_sill(kind, piece, pose, window)

    # -- rooms ----------------------------------------------------------------------------

    def _living(self) -> None:
        sofa = self._seating_group()
        if self.area > 19 and "dining" not in {room.type for room in self.plan.rooms}:
            self._dining_group(small=True)
        for kind, probability in (("bookshelf", 0.8), ("sideboard", 0.45), ("console_table", 0.25)):
            if self.chance(probability):
                self._along_wall(kind)
        if sofa is None or self.chance(0.5):
            self._armchair(sofa)
        if self.chance(0.8):
            self.space.in_corner(self.rng, "floor_lamp", self.make("floor_lamp"))
        for _ in range(int(self.rng.integers(1, 3))):
            self._plant()
        if self.area > 20 and self.chance(0.4):
            self._along_wall("bookshelf")
        self._second_seats()
        if self.chance(0.3):
            self.space.anywhere(self.rng, "pouf", self.make("pouf"))
        self._pictures(int(self.rng.integers(1, 4)))
        if self.chance(0.4):
            self._wall_things("wall_shelf")
        if self.chance(0.3):
            self._wall_things("wall_clock")
        if self.chance(0.25):
            self._wall_things("wall_lamp")

    def _bedroom(self) -> None:
        rng, space = self.rng, self.space
        bed = None
        if self.area > 9.5 and self.chance(0.85):
            bed = self._bed("double_bed")
        if bed is None:
            bed = self._bed("single_bed")
        if self.chance(0.95):
            self._along_wall("wardrobe", where="corner")
        if self.chance(0.6):
            self._along_wall("chest_of_drawers")
        if self.area > 12 and self.chance(0.35):
            self._desk_group()
        if self.chance(0.35):
            space.against_wall(rng, "floor_mirror", self.make("floor_mirror"), where="corner")
        if self.area > 13 and self.chance(0.4):
            self._armchair(None)
        if self.chance(0.55):
            self._plant()
        if self.chance(0.3):
            space.in_corner(rng, "floor_lamp", self.make("floor_lamp"))
        for kind, probability in (("storage_box", 0.35), ("pouf", 0.25), ("waste_bin", 0.15)):
            if self.chance(probability):
                space.in_corner(rng, kind, self.make(kind)) or space.anywhere(
                    rng, kind, self.make(kind)
                )
        self._pictures(int(rng.integers(1, 3)))
        if self.chance(0.35):
            self._wall_things("wall_shelf")
        if self.chance(0.3):
            self._wall_things("wall_mirror")

    def _kitchen(self) -> None:
        rng, space = self.rng, self.space
        runs = self._kitchen_run()
        for kind in ("hob_unit", "fridge"):
            if kind not in {item.kind for item in runs}:
                space.against_wall(rng, kind, self.make(kind), tries=80)
        self._dress_windows_lightly()
        if self.area > 9.0 and "dining" not in {room.type for room in self.plan.rooms}:
            self._dining_group(small=True)
        elif self.chance(0.4):
            for _ in range(2):
                space.anywhere(rng, "stool", self.make("stool"))
        if not runs or self.chance(0.25):
            self._along_wall("sideboard")
        if self.chance(0.4):
            self._plant()
        if self.chance(0.6):
            self._wall_things("wall_clock")
        self._pictures(int(rng.integers(0, 3)))
        if self.chance(0.3):
            self._wall_things("wall_shelf")

    def _bathroom(self) -> None:
        rng, space = self.rng, self.space
        tub, basin = self._sanitary()
        if basin is not None:
            self._over_basin(basin)
        if self.area > 7 and tub is not None and tub.kind == "bath_tub":
            self._shower()
        if self.chance(0.5):
            space.against_wall(
                rng, "washing_machine", self.make("washing_machine"), where="corner", tries=80
            )
        if self.chance(0.8):
            space.on_wall(rng, "towel_rail", self.make("towel_rail"))
        self._dress_windows_lightly()
        self._bath_mat(tub or basin)
        for kind, probability in (("waste_bin", 0.7), ("stool", 0.25)):
            if self.chance(probability):
                space.in_corner(rng, kind, self.make(kind))
        if self.chance(0.35):
            self._plant()
        if self.chance(0.25):
            self._pictures(1)

    def _sanitary(self) -> tuple[Item | None, Item | None]:
        """Bath or shower, toilet and basin; in a tight room smaller ones, at last without either.

        Returns the bath or shower, and the basin.
        """
        baths = [("bath_tub", False), ("bath_tub", True)] if self.chance(0.65) else []
        for first, tight in (*baths, ("shower", False), ("shower", True)):
            found = tub, _, basin = self._try_sanitary(first, tight)
            if all(found):
                return tub, basin
            for item in found:
                if item is not None:
                    self.space.remove_last()
        _, _, basin = self._try_sanitary("", True)
        return None, basin

    def _try_sanitary(
        self, first: str, tight: bool
    ) -> tuple[Item | None, Item | None, Item | None]:
        rng, space = self.rng, self.space
        tub = None
        if first == "bath_tub":
            piece = self.make("bath_tub", width=1.6 if tight else float(rng.choice([1.6, 1.7])))
            tub = space.against_wall(rng, "bath_tub", piece, where="corner", tries=120)
        elif first == "shower":
            tub = self._shower()
        toilet = space.against_wall(rng, "toilet", self.make("toilet"), tries=160)
        sink = self.make("wash_basin", width=0.55) if tight else self.make("wash_basin")
        return tub, toilet, space.against_wall(rng, "wash_basin", sink, tries=160)

    def _study(self) -> None:
        rng, space = self.rng, self.space
        self._desk_group()
        for _ in range(int(rng.integers(1, 4))):
            self._along_wall("bookshelf")
        if self.chance(0.5):
            self._armchair(None)
        if self.chance(0.3):
            self._along_wall("chest_of_drawers")
        if self.chance(0.5):
            space.in_corner(rng, "floor_lamp", self.make("floor_lamp"))
        if self.chance(0.6):
            self._plant()
        for kind, probability in (("waste_bin", 0.7), ("storage_box", 0.4)):
            if self.chance(probability):
                space.in_corner(rng, kind, self.make(kind)) or space.anywhere(
                    rng, kind, self.make(kind)
                )
        self._floor_rug()
        self._pictures(int(rng.integers(1, 3)))
        if self.chance(0.5):
            self._wall_things("wall_shelf")
        if self.chance(0.4):
            self._wall_things("wall_clock")

    def _dining(self) -> None:
        rng, space = self.rng, self.space
        self._dining_group(small=False)
        for kind, probability in (("sideboard", 0.85), ("console_table", 0.3), ("bookshelf", 0.3)):
            if self.chance(probability):
                self._along_wall(kind)
        if self.chance(0.3):
            self._along_wall("bench")
        if self.chance(0.4):
            space.in_corner(rng, "floor_lamp", self.make("floor_lamp"))
        for _ in range(int(rng.integers(1, 3))):
            self._plant()
        self._pictures(int(rng.integers(1, 4)))
        if self.chance(0.3):
            self._wall_things("wall_lamp")

    # -- groups ---------------------------------------------------------------------------

    def _seating_group(self) -> Item | None:
        """Sofa against a wall, coffee table on a rug before it, television opposite."""
        rng, space = self.rng, self.space
        for attempt in range(3):
            sofa_piece = self.make("sofa") if attempt < 2 else self.make("sofa", width=1.6)
            table_piece = self.make("coffee_table")
            stand_piece = self.make("tv_stand")
            for need_tv in (True, False):
                places = space.along_walls(rng, sofa_piece, where="middle", step=0.25)
                for edge, s in places[:40]:
                    sofa = self._try_seating(edge, s, sofa_piece, table_piece, stand_piece, need_tv)
                    if sofa is not None:
                        self._beside_sofa(sofa)
                        return sofa
        return self._island()

    def _island(self) -> Item | None:
        """Sofa, low table and armchair in the middle, where doors leave no wall for them."""
        rng, space = self.rng, self.space
        sofa_piece, table = self.make("sofa", width=1.7), self.make("coffee_table")
        for attempt in range(40):
            x, y = space.open_middle() + rng.normal(0, 0.1 + 0.03 * attempt, 2)
            pose = Pose(float(x), float(y), 0.0, 90.0 * int(rng.integers(4)))
            sofa = space.try_place("sofa", sofa_piece, pose)
            if sofa is None:
                continue
            ahead = float(-sofa_piece.bounds[0, 1]) + 0.4 + 0.5 * float(np.ptp(table.bounds[:, 1]))
            at = sofa.pose.apply(np.array([[0.0, -ahead, 0.0]]))[0]
            low = Pose(float(at[0]), float(at[1]), 0.0, pose.turn)
            space.try_place("coffee_table", table, low, allow=(sofa.id,), zone=False)
            self._armchair(sofa)
            return sofa
        return None

    def _try_seating(
        self, edge: WallEdge, s: float, sofa: Piece, table: Piece, stand: Piece, need_tv: bool
    ) -> Item | None:
        rng, space = self.rng, self.space
        pose = space.wall_pose(sofa, edge, s)
        if not space.fits(sofa, pose):
            return None
        centre = np.array([pose.x, pose.y])
        ahead = np.array(edge.inward)
        opposite = space.nearest_edge(edge.inward, centre)
        stand_pose = None
        if opposite is not None:
            stand_pose = space.wall_pose(stand, opposite, space.position_on(opposite, centre))
            distance = float(np.dot(np.array([stand_pose.x, stand_pose.y]) - centre, ahead))
            if not 2.0 < distance < 5.5 or not space.fits(stand, stand_pose):
                stand_pose = None
        if need_tv and stand_pose is None:
            return None
        sofa_front = float(-sofa.bounds[0, 1])
        table_deep = float(np.ptp(table.bounds[:, 1]))
        reach = sofa_front + 0.4 + table_deep / 2
        spot = centre + reach * ahead
        rug_top = self._rug_before(edge, centre + (sofa_front + 0.08) * ahead, sofa, table_deep)
        kept_sofa = space.try_place("sofa", sofa, pose)
        if kept_sofa is None:
            if rug_top > 0:
                space.remove_last()
            return None
        aside = np.array(edge.along)
        for shift in (0.0, 0.2, -0.2, 0.4, -0.4):
            x, y = spot + shift * aside
            table_pose = Pose(float(x), float(y), rug_top, pose.turn)
            if space.try_place(
                "coffee_table", table, table_pose, allow=(kept_sofa.id,), zone=False
            ):
                break
        if stand_pose is not None:
            kept_stand = space.try_place("tv_stand", stand, stand_pose)
            if kept_stand is not None:
                width = min(float(rng.uniform(0.95, 1.35)), float(np.ptp(stand.bounds[:, 0])) - 0.1)
                space.on_top(
                    rng,
                    "television",
                    self.make("television", width=width),
                    kept_stand,
                    centre=True,
                )
        return kept_sofa

    def _rug_before(self, edge: WallEdge, start: Point, sofa: Piece, table_deep: float) -> float:
        """A rug from just before the sofa outwards; returns its thickness, 0 if there is none."""
        if not self.chance(0.75):
            return 0.0
        width = min(float(np.ptp(sofa.bounds[:, 0])) + float(self.rng.uniform(-0.1, 0.5)), 2.9)
        depth = table_deep + float(self.rng.uniform(0.75, 1.05))
        rug = self.make("rug", width=width, depth=depth)
        deep = float(np.ptp(rug.bounds[:, 1]))
        at = start + 0.5 * deep * np.array(edge.inward)
        item = self.space.try_place(
            "rug", rug, Pose(float(at[0]), float(at[1]), 0.0, facing(edge.inward)), zone=False
        )
        return float(rug.bounds[1, 2]) if item else 0.0

    def _beside_sofa(self, sofa: Item) -> None:
        rng, space = self.rng, self.space
        half = 0.5 * float(np.ptp(sofa.piece.bounds[:, 0]))
        for side in rng.permutation([-1, 1]):
            if not self.chance(0.7):
                continue
            kind = "side_table" if self.chance(0.6) else "floor_lamp"
            piece = self.make(kind)
            size = 0.5 * float(np.ptp(piece.bounds[:, 0]))
            local = np.array([[side * (half + size + 0.06), 0.12, 0.0]])
            x, y, _ = sofa.pose.apply(local)[0]
            item = space.try_place(kind, piece, Pose(float(x), float(y), 0.0, sofa.pose.turn))
            if item is not None and kind == "side_table" and self.chance(0.7):
                space.on_top(rng, "table_lamp", self.make("table_lamp"), item, centre=True)
        if self.chance(0.4):
            space.on_top(rng, "folded_blanket", self.make("folded_blanket"), sofa)

    def _armchair(self, sofa: Item | None) -> None:
        rng, space = self.rng, self.space
        piece = self.make("armchair")
        if sofa is not None:
            for side in rng.permutation([-1, 1]):
                local = np.array([[side * float(rng.uniform(1.5, 1.9)), -1.45, 0.0]])
                x, y, _ = sofa.pose.apply(local)[0]
                turn = (sofa.pose.turn + side * -90.0) % 360
                pose = Pose(float(x), float(y), 0.0, turn)
                if space.try_place("armchair", piece, pose, allow=(sofa.id,)):
                    return
        item = space.against_wall(rng, "armchair", piece, where="corner")
        if item is not None and self.chance(0.5):
            table = self.make("side_table")
            side = float(rng.choice([-1.0, 1.0]))
            half = 0.5 * float(np.ptp(piece.bounds[:, 0])) + 0.5 * float(np.ptp(table.bounds[:, 0]))
            x, y, _ = item.pose.apply(np.array([[side * (half + 0.05), 0.1, 0.0]]))[0]
            space.try_place("side_table", table, Pose(float(x), float(y), 0.0, item.pose.turn))

    def _second_seats(self) -> None:
        """Two armchairs about a small table, where the floor is still wide and bare."""
        rng, space = self.rng, self.space
        middle, radius = space.open_circle()
        if radius < 1.2:
            return
        chair, table = self.make("armchair"), self.make("side_table")
        reach = 0.5 * float(np.ptp(table.bounds[:, 0])) - float(chair.bounds[0, 1]) + 0.12
        for _ in range(12):
            x, y = middle + rng.normal(0, 0.15, 2)
            pose = Pose(float(x), float(y), 0.0, 90.0 * int(rng.integers(4)))
            seat = space.try_place("side_table", table, pose, zone=False)
            if seat is None:
                continue
            for turn, offset in ((-65.0, reach), (65.0, -reach)):
                at = seat.pose.apply(np.array([[offset, 0.15, 0.0]]))[0]
                facing_table = Pose(float(at[0]), float(at[1]), 0.0, (seat.pose.turn + turn) % 360)
                space.try_place("armchair", chair, facing_table, allow=(seat.id,), zone=False)
            return

    def _bed(self, kind: str) -> Item | None:
        """A bed, its head against a wall, with night tables and a rug."""
        rng, space = self.rng, self.space
        piece = self.make(kind)
        free = 0.55 if kind == "double_bed" else 0.0
        half = 0.5 * float(np.ptp(piece.bounds[:, 0]))
        where = "middle" if kind == "double_bed" else "corner"
        places = space.along_walls(rng, piece, where=where, step=0.2)
        for slack in (free, 0.0):
            for edge, s in places:
                if s - half < slack or edge.length - s - half < slack:
                    continue
                bed = space.try_place(kind, piece, space.wall_pose(piece, edge, s))
                if bed is None:
                    continue
                self._beside_bed(bed, edge, s, half)
                return bed
        return None

    def _beside_bed(self, bed: Item, edge: WallEdge, s: float, half: float) -> None:
        rng, space = self.rng, self.space
        table = self.make("night_table")
        lamp = self.make("table_lamp")
        size = 0.5 * float(np.ptp(table.bounds[:, 0]))
        for side in (-1.0, 1.0):
            place = s + side * (half + size + float(rng.uniform(0.03, 0.08)))
            item = space.try_place("night_table", table, space.wall_pose(table, edge, place))
            if item is not None:
                space.on_top(rng, "table_lamp", lamp, item, centre=True) or space.on_top(
                    rng, "table_lamp", lamp, item
                )
        if self.chance(0.65):
            rug = self.make("rug", width=float(rng.uniform(1.2, 1.7)), depth=0.7)
            foot = float(-bed.piece.bounds[0, 1]) + 0.45
            x, y, _ = bed.pose.apply(np.array([[0.0, -foot, 0.0]]))[0]
            space.try_place("rug", rug, Pose(float(x), float(y), 0.0, bed.pose.turn), zone=False)
        elif self.chance(0.3):
            bench = self.make("bench", width=1.1)
            foot = float(-bed.piece.bounds[0, 1]) + 0.5 * float(np.ptp(bench.bounds[:, 1])) + 0.06
            x, y, _ = bed.pose.apply(np.array([[0.0, -foot, 0.0]]))[0]
            space.try_place(
                "bench", bench, Pose(float(x), float(y), 0.0, bed.pose.turn), allow=(bed.id,)
            )

    def _dining_group(self, small: bool) -> Item | None:
        """A table, chairs around it, a rug below and a lamp above."""
        rng, space = self.rng, self.space
        for attempt in range(14):
            round_one = self.chance(0.35)
            shrink = 1.0 - 0.03 * attempt
            if round_one:
                table = self.make("round_table", width=float(rng.uniform(0.9, 1.2)) * shrink)
            else:
                width = float(rng.uniform(1.1, 1.4) if small else rng.uniform(1.4, 2.0)) * shrink
                table = self.make("dining_table", width=width)
            centre = self._open_middle()
            spread = 0.15 + 0.12 * attempt
            x, y = (float(value) for value in centre + rng.normal(0, spread, 2))
            pose = Pose(x, y, 0.0, float(rng.choice([0.0, 90.0])))
            if not space.fits(table, pose, ()):
                continue
            x0, y0, x1, y1 = space.shape.bounds
            if min(x - x0, x1 - x, y - y0, y1 - y) < 0.5:
                continue
            lifted = 0.0
            if not small and self.chance(0.6):
                lifted = self._rug_under(table, pose)
            pose = Pose(x, y, lifted, pose.turn)
            item = space.try_place("dining_table", table, pose, zone=False)
            if item is None:
                if lifted:
                    space.remove_last()
                continue
            chairs = self._chairs(item, round_one)
            if chairs < 2 and attempt < 10:
                for _ in range(chairs + 1):
                    space.remove_last()
                if lifted:
                    space.remove_last()
                continue
            self._pendant(item)
            return item
        return None

    def _rug_under(self, table: Piece, pose: Pose) -> float:
        size = np.ptp(table.bounds, axis=0)
        rug = self.make("rug", width=float(size[0]) + 1.5, depth=float(size[1]) + 1.5)
        item = self.space.try_place("rug", rug, pose, zone=False)
        return float(rug.bounds[1, 2]) if item else 0.0

    def _chairs(self, table: Item, round_one: bool) -> int:
        rng, space = self.rng, self.space
        low, high = table.piece.bounds
        chair = self.make("dining_chair")
        deep = float(np.ptp(chair.bounds[:, 1]))
        seats: list[tuple[float, float, float]] = []  # direction of the chair's back, offset
        if round_one:
            seats = [(0.0, 0.0, 0.0), (90.0, 0.0, 0.0), (180.0, 0.0, 0.0), (270.0, 0.0, 0.0)]
        else:
            width = float(high[0] - low[0])
            per_side = max(1, int((width - 0.2) / 0.58))
            for k in range(per_side):
                offset = (k - (per_side - 1) / 2) * (width - 0.15) / per_side
                seats += [(0.0, offset, 0.0), (180.0, offset, 0.0)]
            if width > 1.3 and self.chance(0.5):
                seats += [(90.0, 0.0, 0.0), (270.0, 0.0, 0.0)]
        count = 0
        for back, offset, _ in seats:
            # At back 0 the chair stands beyond the table's +y edge and looks to -y.
            edge = float(high[1]) if back in (0.0, 180.0) else float(high[0])
            for pulled in (float(rng.uniform(-0.12, 0.12)), 0.12, 0.3):
                distance = edge + deep / 2 - 0.16 + pulled
                way = Pose(0.0, 0.0, 0.0, back).apply(np.array([[offset, distance, 0.0]]))
                if back == 180.0:
                    way[0, 0] = offset
                at = table.pose.apply(way)[0]
                turn = (table.pose.turn + back) % 360
                pose = Pose(float(at[0]), float(at[1]), table.pose.z, turn)
                if space.try_place("dining_chair", chair, pose, zone=False, allow=(table.id,)):
                    count += 1
                    break
        return count

    def _pendant(self, table: Item) -> None:
        top = float(table.bounds[1, 2])
        drop = self.plan.height - top - float(self.rng.uniform(0.62, 0.78))
        if drop < 0.35:
            return
        lamp = self.make("pendant_lamp", drop=drop)
        pose = Pose(table.pose.x, table.pose.y, self.plan.height, 0.0)
        self.space.try_place("pendant_lamp", lamp, pose, zone=False, on_floor=False)

    def _open_middle(self) -> Point:
        """The free point farthest from everything that stands."""
        return self.space.open_middle()

    def _desk_group(self) -> Item | None:
        rng, space = self.rng, self.space
        chair = self.make("office_chair")
        for _ in range(3):
            desk = self.make("desk")
            window_edges = [
                edge
                for edge in self.room.edges
                if any(_on(edge, window) and window.z0 > 0.78 for window in space.windows())
            ]
            item = None
            if window_edges and self.chance(0.45):
                item = space.against_wall(rng, "desk", desk, edges=window_edges, where="middle")
            item = item or space.against_wall(rng, "desk", desk)
            if item is None:
                continue
            # The chair belongs in the knee room, beside the pedestal.
            knees = _knee_room(desk)
            for pulled in (0.1, 0.2, 0.32, 0.45):
                local = np.array([[knees, float(desk.bounds[0, 1]) - pulled, 0.0]])
                x, y, _ = item.pose.apply(local)[0]
                turn = (item.pose.turn + 180.0) % 360
                if space.try_place(
                    "office_chair",
                    chair,
                    Pose(float(x), float(y), 0.0, turn),
                    zone=False,
                    allow=(item.id,),
                ):
                    break
            kind = "monitor" if self.chance(0.65) else "laptop"
            space.on_top(rng, kind, self.make(kind), item, tries=30)
            space.on_top(rng, "desk_lamp", self.make("desk_lamp"), item, tries=30)
            return item
        return None

    def _kitchen_run(self) -> list[Item]:
        """Units side by side along the wall that takes most of them, cupboards and hood above."""
        rng = self.rng
        units: list[tuple[str, float]] = [("sink_unit", 0.8), ("drawer_unit", 0.6)]
        units.append(("hob_unit", 0.6))
        if self.chance(0.5):
            units.reverse()
        extras = int(rng.integers(1, 4)) if self.area > 8 else 1
        units += [("base_cupboard", float(rng.choice([0.4, 0.5, 0.6]))) for _ in range(extras)]
        units.insert(0 if self.chance(0.6) else len(units), ("fridge", 0.61))
        pieces = [(kind, width, self.make(kind, width=min(width, 0.8))) for kind, width in units]
        # Where doors and windows leave no wall for the whole run, sink and hob must do.
        core = [unit for unit in pieces if unit[0] in ("sink_unit", "hob_unit")]
        sink = [unit for unit in core if unit[0] == "sink_unit"]
        both = 1 + max(pieces.index(unit) for unit in core)
        for wanted, least, zone in (
            (pieces, both, True),
            (core, 2, True),
            (core, 2, False),
            (sink, 1, False),
        ):
            places = []
            for edge in self.room.edges:
                for way in (1.0, -1.0):
                    places += self._run_places(edge, way, wanted, least)
            places.sort(key=lambda place: -place[0])
            for _, edge, way, begin in places[:6]:
                run = self._place_run(edge, way, begin, wanted, least, zone)
                if run:
                    if self.area > 9 and self.chance(0.5):
                        self._second_run()
                    return run
        return []

    def _run_places(
        self, edge: WallEdge, way: float, pieces: Sequence[tuple[str, float, Piece]], least: int
    ) -> list[tuple[float, WallEdge, float, float]]:
        """(how good, edge, way, first s) of runs of `least` units and more along a wall."""
        places = []
        for begin in np.arange(GAP, max(0.02, edge.length - 0.6), 0.2):
            s = float(begin) if way > 0 else edge.length - float(begin)
            count = 0
            for _, width, piece in pieces:
                end = s + way * width
                if not 0 <= end <= edge.length or not self.space.fits(
                    piece, self.space.wall_pose(piece, edge, s + way * width / 2)
                ):
                    break
                s, count = end, count + 1
            if count >= least:
                in_corner = 1.5 if begin < 0.05 else 0.0
                places.append((count + in_corner + self.rng.random(), edge, way, float(begin)))
        return places

    def _place_run(
        self,
        edge: WallEdge,
        way: float,
        begin: float,
        pieces: Sequence[tuple[str, float, Piece]],
        least: int,
        zone: bool,
    ) -> list[Item]:
        space = self.space
        placed: list[Item] = []
        s = begin if way > 0 else edge.length - begin
        for kind, width, piece in pieces:
            if not 0 <= s + way * width <= edge.length:
                break
            item = space.try_place(
                kind,
                piece,
                space.wall_pose(piece, edge, s + way * width / 2),
                allow=[item.id for item in placed],
                zone=zone,
            )
            if item is None:
                break
            placed.append(item)
            s += way * (width + 0.001)
        if len(placed) < least:
            for _ in placed:
                space.remove_last()
            return []
        self._splashback(edge, placed)
        for item in placed:
            self._above_unit(edge, item)
        return placed

    def _splashback(self, edge: WallEdge, run: Sequence[Item]) -> None:
        """A band of tiles on the wall behind the worktops, below window sills."""
        units = [item for item in run if item.kind != "fridge"]
        ends = [
            self.space.position_on(edge, np.array([item.pose.x, item.pose.y]))
            + side * 0.5 * float(np.ptp(item.piece.bounds[:, 0]))
            for item in units
            for side in (-1, 1)
        ]
        s0, s1 = max(0.0, min(ends)), min(edge.length, max(ends))
        low = self.style.worktop_height + 0.002
        high = low + 0.5
        for window in self.space.windows():
            at = self.space.position_on(edge, np.array(window.start))
            if _on(edge, window) and at < s1 and at + window.width > s0:
                high = min(high, window.z0 - 0.02)
        if high - low < 0.08:
            return
        tile = Material(
            "tiles",
            tone(WALL_TILES[int(self.rng.integers(len(WALL_TILES)))]),
            0.15,
            accent=(0.6, 0.59, 0.57),
            scale=float(self.rng.choice([0.35, 0.5])),
            variant=int(self.rng.integers(1 << 30)),
        )
        half = 0.5 * (s1 - s0)
        panel = span((-half, -0.008, 0.0), (half, 0.0, high - low))
        flat = Mesh(panel.vertices, panel.faces, panel.vertices[:, [0, 2]].copy())
        piece = Piece("splashback", "splashback", (part_of("tiles", tile, flat),), "on_wall")
        self.space.hang("splashback", piece, edge, 0.5 * (s0 + s1), low)

    def _above_unit(self, edge: WallEdge, item: Item) -> None:
        space = self.space
        width = float(np.ptp(item.piece.bounds[:, 0]))
        s = space.position_on(edge, np.array([item.pose.x, item.pose.y]))
        if item.kind == "fridge":
            return
        if item.kind == "hob_unit":
            hood = self.make("extractor_hood", width=0.6, height=self.plan.height - 1.58)
            space.hang("extractor_hood", hood, edge, s, 1.58)
        elif self.chance(0.85):
            cupboard = self.make("wall_cupboard", width=width)
            if cupboard.mount_height + 0.7 < self.plan.height:
                space.hang("wall_cupboard", cupboard, edge, s, cupboard.mount_height)

    def _second_run(self) -> None:
        """A few more units along another wall."""
        rng, space = self.rng, self.space
        unit = self.make("base_cupboard", width=0.6)
        item = space.against_wall(rng, "base_cupboard", unit, where="corner", tries=40)
        if item is None:
            return
        edge = self._edge_behind(item)
        if edge is not None:
            s = space.position_on(edge, np.array([item.pose.x, item.pose.y]))
            for side in (-1.0, 1.0):
                nxt = self.make("drawer_unit", width=0.6)
                pose = space.wall_pose(nxt, edge, s + side * 0.601)
                if space.try_place("drawer_unit", nxt, pose, allow=(item.id,)):
                    return
        space.remove_last()  # one cupboard alone looks lost

    def _shower(self) -> Item | None:
        rng, space = self.rng, self.space
        for width in (0.9, 0.8):
            piece = self.make("shower", width=width)
            edges = self.room.edges
            for index in rng.permutation(len(edges)):
                edge = edges[int(index)]
                half = 0.5 * float(np.ptp(piece.bounds[:, 0]))
                for s in (half + GAP, edge.length - half - GAP):
                    item = space.try_place("shower", piece, space.wall_pose(piece, edge, s))
                    if item is not None:
                        return item
        return None

    def _over_basin(self, basin: Item) -> None:
        space = self.space
        edge = self._edge_behind(basin)
        if edge is None:
            return
        s = space.position_on(edge, np.array([basin.pose.x, basin.pose.y]))
        width = float(np.ptp(basin.piece.bounds[:, 0]))
        if self.chance(0.5):
            mirror = self.make("mirror_cabinet", width=min(width, 0.8))
            hung = space.hang("mirror_cabinet", mirror, edge, s, mirror.mount_height)
        else:
            mirror = self.make("wall_mirror")
            hung = space.hang("wall_mirror", mirror, edge, s, mirror.mount_height)
        if hung is None:  # there is a window
            self._wall_things("wall_mirror")
        lamp = self.make("light_strip", width=min(0.6, width))
        top = float(hung.bounds[1, 2]) if hung else 1.9
        height = max(lamp.mount_height, top + 0.09)
        if height < self.plan.height - 0.05:
            space.hang("light_strip", lamp, edge, s, height)

    def _bath_mat(self, before: Item | None) -> None:
        if before is None or not self.chance(0.75):
            return
        mat = self.make("rug", width=0.8, depth=0.5)
        deep = float(-before.piece.bounds[0, 1]) + 0.32
        x, y, _ = before.pose.apply(np.array([[0.0, -deep, 0.0]]))[0]
        self.space.try_place(
            "rug", mat, Pose(float(x), float(y), 0.0, before.pose.turn), zone=False
        )

    # -- single things --------------------------------------------------------------------

    def _along_wall(self, kind: str, where: str = "any") -> Item | None:
        for _ in range(2):
            item = self.space.against_wall(self.rng, kind, self.make(kind), where=where)
            if item is not None:
                return item
        return None

    def _plant(self) -> None:
        self.space.in_corner(self.rng, "plant", self.make("plant"))

    def _floor_rug(self) -> None:
        if not self.chance(0.5):
            return
        rug = self.make("rug", width=float(self.rng.uniform(1.2, 1.8)), depth=1.0)
        middle = self._open_middle()
        pose = Pose(float(middle[0]), float(middle[1]), 0.0, float(self.rng.choice([0.0, 90.0])))
        self.space.try_place("rug", rug, pose, zone=False)

    def _dress_windows_lightly(self) -> None:
        """Radiators only: no cloth near water and fire."""
        for window in self.space.windows():
            if window.z0 > 0.72 and self.chance(0.6):
                radiator = self.make("radiator", width=max(0.5, min(window.width, 1.0)))
                self._hang_at(
                    window.edge, window.width / 2, "radiator", radiator, radiator.mount_height
                )

    def _wall_things(self, kind: str) -> Item | None:
        piece = self.make(kind)
        return self.space.on_wall(self.rng, kind, piece)

    def _pictures(self, count: int) -> None:
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
            edge = self._edge_behind(item)
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

    def _edge_behind(self, item: Item) -> WallEdge | None:
        """The wall that an item has its back to."""
        for edge in self.room.edges:
            s = self.space.position_on(edge, np.array([item.pose.x, item.pose.y]))
            behind = abs(_depth(edge, item) - float(item.piece.bounds[1, 1]) - GAP) < 0.05
            if facing(edge.inward) == item.pose.turn and 0 < s < edge.length and behind:
                return edge
        return None

    def _light_ceiling(self) -> None:
        """A lamp under the ceiling, unless a pendant already hangs over a table nearby."""
        rng, space = self.rng, self.space
        hanging = any(item.kind == "pendant_lamp" for item in space.items)
        if hanging and self.area < 16:
            return
        kinds = {
            "study": ["ceiling_lamp", "spot_rail"],
            "kitchen": ["ceiling_lamp", "spot_rail"],
            "living": ["ceiling_lamp", "pendant_lamp"],
            "bedroom": ["ceiling_lamp", "ceiling_lamp", "pendant_lamp"],
            "dining": ["ceiling_lamp", "pendant_lamp"],
            "bathroom": ["ceiling_lamp"],
        }[self.room.type]
        kind = str(rng.choice(kinds))
        lamp = (
            self.make(kind, drop=min(0.5, self.plan.height - 2.05))
            if kind == "pendant_lamp"
            else self.make(kind)
        )
        middle = self.space.middle()
        for attempt in range(12):
            x, y = middle + rng.normal(0, 0.05 + 0.1 * attempt, 2)
            pose = Pose(float(x), float(y), self.plan.height, float(rng.choice([0.0, 90.0])))
            if space.try_place(kind, lamp, pose, zone=False, on_floor=False):
                return

    def _tops(self) -> None:
        """Small things where things are put down."""
        rng = self.rng
        wanted: dict[str, tuple[tuple[str, ...], int, int]] = {
            "coffee_table": (("books_stack", "vase", "candle", "fruit_bowl", "laptop"), 1, 4),
            "side_table": (("books_stack", "small_plant", "candle", "vase"), 0, 2),
            "night_table": (("books_stack", "small_plant", "candle"), 0, 2),
            "tv_stand": (("vase", "small_plant", "books_stack", "candle"), 0, 3),
            "desk": (("books_stack", "small_plant", "books_stack", "vase"), 1, 4),
            "dining_table": (("fruit_bowl", "vase", "crockery", "candle", "bottle"), 1, 4),
            "sideboard": (("vase", "books_stack", "small_plant", "candle", "table_lamp"), 2, 4),
            "console_table": (("vase", "small_plant", "table_lamp", "books_stack"), 1, 4),
            "chest_of_drawers": (("table_lamp", "vase", "books_stack", "small_plant"), 1, 4),
            "base_cupboard": (("kettle", "microwave", "bottle", "fruit_bowl", "crockery"), 0, 2),
            "drawer_unit": (("kettle", "bottle", "crockery", "cooking_pot", "small_plant"), 0, 2),
            "sink_unit": (("bottle", "crockery"), 0, 1),
            "wash_basin": (("toiletries", "toiletries", "candle"), 1, 3),
            "washing_machine": (("toiletries", "storage_box", "small_plant"), 0, 2),
            "toilet": (("small_plant", "candle"), 0, 1),
            "bookshelf": (("small_plant", "storage_box", "vase"), 0, 2),
            "wardrobe": (("storage_box",), 0, 2),
            "fridge": (("storage_box", "small_plant"), 0, 1),
            "wall_shelf": (("small_plant", "books_stack", "vase", "candle"), 1, 3),
            "bath_tub": (("toiletries", "candle"), 0, 2),
        }
        for item in list(self.space.items):
            if item.kind not in wanted or not item.piece.surfaces:
                continue
            kinds, low, high = wanted[item.kind]
            for _ in range(int(rng.integers(low, high + 1))):
                kind = str(rng.choice(kinds))
                yaw = float(rng.uniform(-25, 25))
                self.space.on_top(rng, kind, self.make(kind), item, yaw=yaw, tries=6)


def _on(edge: WallEdge, opening: Opening) -> bool:
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


def _knee_room(desk: Piece) -> float:
    """x of the middle of the free side below a desk with one pedestal."""
    low, high = desk.bounds[:, 0]
    below = [
        part.vertices[(part.vertices[:, 2] > 0.25) & (part.vertices[:, 2] < 0.5)]
        for part in desk.parts
    ]
    points = np.concatenate(below)
    if len(points) == 0:
        return 0.0
    heavier = float(np.mean(points[:, 0]))
    if desk.credit is not None and abs(heavier) < 0.1 * (high - low):
        return 0.0  # legs alike on both sides
    return float(-np.sign(heavier) * 0.22 * (high - low))
