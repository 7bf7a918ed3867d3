"""Bathrooms: bath or shower, toilet and basin, tight rooms smaller ones."""

from __future__ import annotations

import numpy as np

from scenes.procedural.furnishing.furnisher import Furnisher
from scenes.procedural.furnishing.rooms.windows import hang_radiators
from scenes.procedural.furnishing.space import GAP, Item
from scenes.procedural.scene_item import Pose


def furnish_bathroom(maker: Furnisher) -> None:
    """All of a bathroom, in order."""
    rng, space = maker.rng, maker.space
    tub, basin = _place_sanitary(maker)
    if basin is not None:
        _hang_over_basin(maker, basin)
    if maker.area > 7 and tub is not None and tub.kind == "bath_tub":
        _place_shower(maker)
    if maker.chance(0.5):
        space.against_wall(
            rng, "washing_machine", maker.make("washing_machine"), where="corner", tries=80
        )
    if maker.chance(0.8):
        space.on_wall(rng, "towel_rail", maker.make("towel_rail"))
    hang_radiators(maker)
    _lay_mat(maker, tub or basin)
    for kind, probability in (("waste_bin", 0.7), ("stool", 0.25)):
        if maker.chance(probability):
            space.in_corner(rng, kind, maker.make(kind))
    if maker.chance(0.35):
        maker.put_plant()
    if maker.chance(0.25):
        maker.hang_pictures(1)


def _place_sanitary(maker: Furnisher) -> tuple[Item | None, Item | None]:
    """Bath or shower, toilet and basin; in a tight room smaller ones, at last without either.

    Returns the bath or shower, and the basin.
    """
    baths = [("bath_tub", False), ("bath_tub", True)] if maker.chance(0.65) else []
    for first, tight in (*baths, ("shower", False), ("shower", True)):
        found = tub, _, basin = _try_sanitary(maker, first, tight)
        if all(found):
            return tub, basin
        for item in found:
            if item is not None:
                maker.space.remove_last()
    _, _, basin = _try_sanitary(maker, "", True)
    return None, basin


def _try_sanitary(
    maker: Furnisher, first: str, tight: bool
) -> tuple[Item | None, Item | None, Item | None]:
    rng, space = maker.rng, maker.space
    tub = None
    if first == "bath_tub":
        piece = maker.make("bath_tub", width=1.6 if tight else float(rng.choice([1.6, 1.7])))
        tub = space.against_wall(rng, "bath_tub", piece, where="corner", tries=120)
    elif first == "shower":
        tub = _place_shower(maker)
    toilet = space.against_wall(rng, "toilet", maker.make("toilet"), tries=160)
    sink = maker.make("wash_basin", width=0.55) if tight else maker.make("wash_basin")
    return tub, toilet, space.against_wall(rng, "wash_basin", sink, tries=160)


def _place_shower(maker: Furnisher) -> Item | None:
    rng, space = maker.rng, maker.space
    for width in (0.9, 0.8):
        piece = maker.make("shower", width=width)
        edges = maker.room.edges
        for index in rng.permutation(len(edges)):
            edge = edges[int(index)]
            half = 0.5 * float(np.ptp(piece.bounds[:, 0]))
            for s in (half + GAP, edge.length - half - GAP):
                item = space.try_place("shower", piece, space.wall_pose(piece, edge, s))
                if item is not None:
                    return item
    return None


def _hang_over_basin(maker: Furnisher, basin: Item) -> None:
    space = maker.space
    edge = maker.edge_behind(basin)
    if edge is None:
        return
    s = space.position_on(edge, np.array([basin.pose.x, basin.pose.y]))
    width = float(np.ptp(basin.piece.bounds[:, 0]))
    if maker.chance(0.5):
        mirror = maker.make("mirror_cabinet", width=min(width, 0.8))
        hung = space.hang("mirror_cabinet", mirror, edge, s, mirror.mount_height)
    else:
        mirror = maker.make("wall_mirror")
        hung = space.hang("wall_mirror", mirror, edge, s, mirror.mount_height)
    if hung is None:  # there is a window
        maker.hang("wall_mirror")
    lamp = maker.make("light_strip", width=min(0.6, width))
    top = float(hung.bounds[1, 2]) if hung else 1.9
    height = max(lamp.mount_height, top + 0.09)
    if height < maker.plan.height - 0.05:
        space.hang("light_strip", lamp, edge, s, height)


def _lay_mat(maker: Furnisher, before: Item | None) -> None:
    if before is None or not maker.chance(0.75):
        return
    mat = maker.make("rug", width=0.8, depth=0.5)
    deep = float(-before.piece.bounds[0, 1]) + 0.32
    x, y, _ = before.pose.apply(np.array([[0.0, -deep, 0.0]]))[0]
    maker.space.try_place("rug", mat, Pose(float(x), float(y), 0.0, before.pose.turn), zone=False)
