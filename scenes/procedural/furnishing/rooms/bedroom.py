"""Bedrooms: a bed with what stands beside it, cupboards, a desk."""

from __future__ import annotations

import numpy as np

from scenes.procedural.furnishing.furnisher import Furnisher
from scenes.procedural.furnishing.rooms.desks import place_desk
from scenes.procedural.furnishing.rooms.seats import place_armchair
from scenes.procedural.furnishing.space import Item
from scenes.procedural.plan import WallEdge
from scenes.procedural.scene_item import Pose


def furnish_bedroom(maker: Furnisher) -> None:
    """All of a bedroom, in order."""
    rng, space = maker.rng, maker.space
    bed = None
    if maker.area > 9.5 and maker.chance(0.85):
        bed = _place_bed(maker, "double_bed")
    if bed is None:
        bed = _place_bed(maker, "single_bed")
    if maker.chance(0.95):
        maker.along_wall("wardrobe", where="corner")
    if maker.chance(0.6):
        maker.along_wall("chest_of_drawers")
    if maker.area > 12 and maker.chance(0.35):
        place_desk(maker)
    if maker.chance(0.35):
        space.against_wall(rng, "floor_mirror", maker.make("floor_mirror"), where="corner")
    if maker.area > 13 and maker.chance(0.4):
        place_armchair(maker, None)
    if maker.chance(0.55):
        maker.put_plant()
    if maker.chance(0.3):
        space.in_corner(rng, "floor_lamp", maker.make("floor_lamp"))
    for kind, probability in (("storage_box", 0.35), ("pouf", 0.25), ("waste_bin", 0.15)):
        if maker.chance(probability):
            space.in_corner(rng, kind, maker.make(kind)) or space.anywhere(
                rng, kind, maker.make(kind)
            )
    maker.hang_pictures(int(rng.integers(1, 3)))
    if maker.chance(0.35):
        maker.hang("wall_shelf")
    if maker.chance(0.3):
        maker.hang("wall_mirror")


def _place_bed(maker: Furnisher, kind: str) -> Item | None:
    """A bed, its head against a wall, with night tables and a rug."""
    rng, space = maker.rng, maker.space
    piece = maker.make(kind)
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
            _stand_beside(maker, bed, edge, s, half)
            return bed
    return None


def _stand_beside(maker: Furnisher, bed: Item, edge: WallEdge, s: float, half: float) -> None:
    rng, space = maker.rng, maker.space
    table = maker.make("night_table")
    lamp = maker.make("table_lamp")
    size = 0.5 * float(np.ptp(table.bounds[:, 0]))
    for side in (-1.0, 1.0):
        place = s + side * (half + size + float(rng.uniform(0.03, 0.08)))
        item = space.try_place("night_table", table, space.wall_pose(table, edge, place))
        if item is not None:
            space.on_top(rng, "table_lamp", lamp, item, centre=True) or space.on_top(
                rng, "table_lamp", lamp, item
            )
    if maker.chance(0.65):
        rug = maker.make("rug", width=float(rng.uniform(1.2, 1.7)), depth=0.7)
        foot = float(-bed.piece.bounds[0, 1]) + 0.45
        x, y, _ = bed.pose.apply(np.array([[0.0, -foot, 0.0]]))[0]
        space.try_place("rug", rug, Pose(float(x), float(y), 0.0, bed.pose.turn), zone=False)
    elif maker.chance(0.3):
        bench = maker.make("bench", width=1.1)
        foot = float(-bed.piece.bounds[0, 1]) + 0.5 * float(np.ptp(bench.bounds[:, 1])) + 0.06
        x, y, _ = bed.pose.apply(np.array([[0.0, -foot, 0.0]]))[0]
        space.try_place(
            "bench", bench, Pose(float(x), float(y), 0.0, bed.pose.turn), allow=(bed.id,)
        )
