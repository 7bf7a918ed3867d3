"""Bathrooms: bath or shower, toilet and wash basin, smaller ones in small rooms."""

from __future__ import annotations

from pbrnet.scenes.procedural.furnishing.furnisher import Furnisher
from pbrnet.scenes.procedural.furnishing.rooms.windows import hang_radiators
from pbrnet.scenes.procedural.furnishing.space import GAP, PlacedPiece


def furnish_bathroom(furnisher: Furnisher) -> None:
    """Furnish a bathroom."""
    rng, space = furnisher.rng, furnisher.space
    tub, basin = _place_sanitary(furnisher)
    if basin is not None:
        _hang_over_basin(furnisher, basin)
    if furnisher.area > 7 and tub is not None and tub.kind == "bath_tub":
        _place_shower(furnisher)
    if furnisher.chance(0.5):
        space.against_wall(
            rng, "washing_machine", furnisher.make("washing_machine"), where="corner", tries=80
        )
    if furnisher.chance(0.8):
        furnisher.hang("towel_rail")
    hang_radiators(furnisher)
    _lay_mat(furnisher, tub or basin)
    for kind, probability in (("waste_bin", 0.6), ("stool", 0.25)):
        if furnisher.chance(probability):
            furnisher.in_corner(kind)
    if furnisher.chance(0.35):
        furnisher.in_corner("plant")
    furnisher.hang("wall_board", wanted=0.8)
    furnisher.along_wall("rack", wanted=0.6)
    furnisher.hang("wall_board", wanted=0.45)
    if furnisher.chance(0.5):
        furnisher.hang_pictures(furnisher.number(1, 2))


def _place_sanitary(furnisher: Furnisher) -> tuple[PlacedPiece | None, PlacedPiece | None]:
    """Place a bath or shower, a toilet and a basin; smaller ones or no bath where they do not fit.

    Returns the bath or shower and the basin.
    """
    baths = [("bath_tub", False), ("bath_tub", True)] if furnisher.chance(0.65) else []
    for first, tight in (*baths, ("shower", False), ("shower", True)):
        found = tub, _, basin = _try_sanitary(furnisher, first, tight)
        if all(found):
            return tub, basin
        for item in found:
            if item is not None:
                furnisher.space.remove_last()
    _, _, basin = _try_sanitary(furnisher, "", True)
    return None, basin


def _try_sanitary(
    furnisher: Furnisher, first: str, tight: bool
) -> tuple[PlacedPiece | None, PlacedPiece | None, PlacedPiece | None]:
    rng, space = furnisher.rng, furnisher.space
    tub = None
    if first == "bath_tub":
        piece = furnisher.make("bath_tub", width=1.6 if tight else rng.pick([1.6, 1.7]))
        tub = space.against_wall(rng, "bath_tub", piece, where="corner", tries=120)
    elif first == "shower":
        tub = _place_shower(furnisher)
    toilet = space.against_wall(rng, "toilet", furnisher.make("toilet"), tries=160)
    sink = furnisher.make("wash_basin", width=0.55) if tight else furnisher.make("wash_basin")
    return tub, toilet, space.against_wall(rng, "wash_basin", sink, tries=160)


def _place_shower(furnisher: Furnisher) -> PlacedPiece | None:
    rng, space = furnisher.rng, furnisher.space
    for width in (0.9, 0.8):
        piece = furnisher.make("shower", width=width)
        for edge in rng.shuffled(furnisher.room.edges):
            half = 0.5 * piece.size[0]
            for s in (half + GAP, edge.length - half - GAP):
                item = space.try_place("shower", piece, space.wall_pose(piece, edge, s))
                if item is not None:
                    return item
    return None


def _hang_over_basin(furnisher: Furnisher, basin: PlacedPiece) -> None:
    space = furnisher.space
    edge = furnisher.edge_behind(basin)
    if edge is None:
        return
    s = basin.along(edge)
    width = basin.piece.size[0]
    if furnisher.chance(0.5):
        mirror = furnisher.make("mirror_cabinet", width=min(width, 0.8))
        hung = space.hang("mirror_cabinet", mirror, edge, s, mirror.mount_height)
    else:
        mirror = furnisher.make("wall_mirror")
        hung = space.hang("wall_mirror", mirror, edge, s, mirror.mount_height)
    if hung is None:  # a window is in the way
        furnisher.hang("wall_mirror")
    lamp = furnisher.make("light_strip", width=min(0.6, width))
    top = float(hung.bounds[1, 2]) if hung else 1.9
    height = max(lamp.mount_height, top + 0.09)
    if height < furnisher.plan.height - 0.05:
        space.hang("light_strip", lamp, edge, s, height)


def _lay_mat(furnisher: Furnisher, before: PlacedPiece | None) -> None:
    if before is None or not furnisher.chance(0.75):
        return
    mat = furnisher.make("rug", width=0.8, depth=0.5)
    depth = float(-before.piece.bounds[0, 1]) + 0.32
    furnisher.place_beside("rug", mat, before, 0.0, -depth, zone=False)
