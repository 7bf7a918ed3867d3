"""Bedrooms: a bed with night tables, wardrobe, chest of drawers, desk."""

from __future__ import annotations

from pbrnet.scenes.procedural.furnishing.furnisher import Furnisher, has_opening
from pbrnet.scenes.procedural.furnishing.rooms.living import place_armchair
from pbrnet.scenes.procedural.furnishing.rooms.study import place_desk
from pbrnet.scenes.procedural.furnishing.space import GAP, PlacedPiece
from pbrnet.scenes.procedural.plan import WallEdge


def furnish_bedroom(furnisher: Furnisher) -> None:
    """Furnish a bedroom."""
    rng, space = furnisher.rng, furnisher.space
    built_in = furnisher.chance(0.5) and furnisher.area > 9 and _build_in_wardrobe(furnisher)
    bed = None
    if furnisher.area > 9.5 and furnisher.chance(0.85):
        bed = _place_bed(furnisher, "double_bed")
    if bed is None:
        bed = _place_bed(furnisher, "single_bed")
    if bed is None and built_in:  # which leaves no place for a bed
        space.remove_last()
        built_in = False
        bed = _place_bed(furnisher, "double_bed") or _place_bed(furnisher, "single_bed")
    if not built_in:
        furnisher.along_wall("wardrobe", where="corner", wanted=0.95)
    furnisher.along_wall("chest_of_drawers", wanted=0.6)
    if furnisher.area > 12 and furnisher.wants(0.35):
        place_desk(furnisher)
    if furnisher.wants(0.35):
        space.against_wall(rng, "floor_mirror", furnisher.make("floor_mirror"), where="corner")
    if furnisher.area > 13 and furnisher.wants(0.4):
        place_armchair(furnisher, None)
    furnisher.in_corner("plant", wanted=0.55)
    furnisher.in_corner("floor_lamp", wanted=0.3)
    for kind, probability in (("storage_box", 0.2), ("pouf", 0.18), ("waste_bin", 0.3)):
        if furnisher.wants(probability):
            furnisher.in_corner(kind) or furnisher.on_floor(kind)
    furnisher.hang_pictures(furnisher.number(1, 3))
    furnisher.hang_row(4, wanted=0.25)
    for _ in range(furnisher.number(0, 3)):
        furnisher.hang("wall_shelf")
    furnisher.hang("wall_mirror", wanted=0.3)


def _build_in_wardrobe(furnisher: Furnisher) -> bool:
    """Fill a short wall between two corners with a wardrobe; returns whether one fits."""
    space = furnisher.space
    for edge in furnisher.rng.shuffled(furnisher.room.edges):
        if not 1.5 < edge.length < 3.4 or any(
            has_opening(edge, one) for one in space.plan.openings
        ):
            continue
        under = max(
            (beam.depth for beam in space.plan.beams if beam.room == furnisher.room.id), default=0.0
        )
        width, height = edge.length - 2 * GAP - 0.001, space.plan.height - under - 0.002
        for _ in range(3):  # until its doors are closed where there is no room for open ones
            piece = furnisher.make("built_in_wardrobe", width=width, height=height)
            middle = 0.5 * (edge.length + float(piece.bounds[:, 0].sum()))
            if space.try_place("built_in_wardrobe", piece, space.wall_pose(piece, edge, middle)):
                return True
    return False


def _place_bed(furnisher: Furnisher, kind: str) -> PlacedPiece | None:
    """Place a bed with its head against a wall, night tables and a rug."""
    rng, space = furnisher.rng, furnisher.space
    piece = furnisher.make(kind)
    free = 0.55 if kind == "double_bed" else 0.0
    half = 0.5 * piece.size[0]
    where = "middle" if kind == "double_bed" else "corner"
    places = space.along_walls(rng, piece, where=where, step=0.2)
    for slack in (free, 0.0):
        for edge, s in places:
            if s - half < slack or edge.length - s - half < slack:
                continue
            bed = space.try_place(kind, piece, space.wall_pose(piece, edge, s))
            if bed is None:
                continue
            _stand_beside(furnisher, bed, edge, s, half)
            return bed
    return None


def _stand_beside(
    furnisher: Furnisher, bed: PlacedPiece, edge: WallEdge, s: float, half: float
) -> None:
    rng, space = furnisher.rng, furnisher.space
    table = furnisher.make("night_table")
    lamp = furnisher.make("table_lamp")
    size = 0.5 * table.size[0]
    for side in (-1.0, 1.0):
        place = s + side * (half + size + rng.between(0.03, 0.08))
        item = space.try_place("night_table", table, space.wall_pose(table, edge, place))
        if item is not None:
            space.on_top(rng, "table_lamp", lamp, item, centre=True) or space.on_top(
                rng, "table_lamp", lamp, item
            )
    if furnisher.wants(0.65):
        rug = furnisher.make("rug", width=rng.between(1.2, 1.7), depth=0.7)
        foot = float(-bed.piece.bounds[0, 1]) + 0.45
        furnisher.place_beside("rug", rug, bed, 0.0, -foot, zone=False)
    elif furnisher.wants(0.3):
        bench = furnisher.make("bench", width=1.1)
        foot = float(-bed.piece.bounds[0, 1]) + 0.5 * bench.size[1] + 0.06
        furnisher.place_beside("bench", bench, bed, 0.0, -foot, allow=(bed.id,))
