"""Sofas, armchairs and what stands about them."""

from __future__ import annotations

import numpy as np

from scenes.procedural.furnishing.furnisher import Furnisher, Point
from scenes.procedural.furnishing.space import Item, facing
from scenes.procedural.piece import Piece
from scenes.procedural.plan import WallEdge
from scenes.procedural.scene_item import Pose


def place_seating(maker: Furnisher) -> Item | None:
    """Sofa against a wall, coffee table on a rug before it, television opposite."""
    rng, space = maker.rng, maker.space
    for attempt in range(3):
        sofa_piece = maker.make("sofa") if attempt < 2 else maker.make("sofa", width=1.6)
        table_piece = maker.make("coffee_table")
        stand_piece = maker.make("tv_stand")
        for need_tv in (True, False):
            places = space.along_walls(rng, sofa_piece, where="middle", step=0.25)
            for edge, s in places[:40]:
                sofa = _try_seating(maker, edge, s, sofa_piece, table_piece, stand_piece, need_tv)
                if sofa is not None:
                    _stand_beside(maker, sofa)
                    return sofa
    return _place_island(maker)


def _place_island(maker: Furnisher) -> Item | None:
    """Sofa, low table and armchair in the middle, where doors leave no wall for them."""
    rng, space = maker.rng, maker.space
    sofa_piece, table = maker.make("sofa", width=1.7), maker.make("coffee_table")
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
        place_armchair(maker, sofa)
        return sofa
    return None


def _try_seating(
    maker: Furnisher,
    edge: WallEdge,
    s: float,
    sofa: Piece,
    table: Piece,
    stand: Piece,
    need_tv: bool,
) -> Item | None:
    rng, space = maker.rng, maker.space
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
    rug_top = _lay_rug_before(maker, edge, centre + (sofa_front + 0.08) * ahead, sofa, table_deep)
    kept_sofa = space.try_place("sofa", sofa, pose)
    if kept_sofa is None:
        if rug_top > 0:
            space.remove_last()
        return None
    aside = np.array(edge.along)
    for shift in (0.0, 0.2, -0.2, 0.4, -0.4):
        x, y = spot + shift * aside
        table_pose = Pose(float(x), float(y), rug_top, pose.turn)
        if space.try_place("coffee_table", table, table_pose, allow=(kept_sofa.id,), zone=False):
            break
    if stand_pose is not None:
        kept_stand = space.try_place("tv_stand", stand, stand_pose)
        if kept_stand is not None:
            width = min(float(rng.uniform(0.95, 1.35)), float(np.ptp(stand.bounds[:, 0])) - 0.1)
            space.on_top(
                rng,
                "television",
                maker.make("television", width=width),
                kept_stand,
                centre=True,
            )
    return kept_sofa


def _lay_rug_before(
    maker: Furnisher, edge: WallEdge, start: Point, sofa: Piece, table_deep: float
) -> float:
    """A rug from just before the sofa outwards; returns its thickness, 0 if there is none."""
    if not maker.chance(0.75):
        return 0.0
    width = min(float(np.ptp(sofa.bounds[:, 0])) + float(maker.rng.uniform(-0.1, 0.5)), 2.9)
    depth = table_deep + float(maker.rng.uniform(0.75, 1.05))
    rug = maker.make("rug", width=width, depth=depth)
    deep = float(np.ptp(rug.bounds[:, 1]))
    at = start + 0.5 * deep * np.array(edge.inward)
    item = maker.space.try_place(
        "rug", rug, Pose(float(at[0]), float(at[1]), 0.0, facing(edge.inward)), zone=False
    )
    return float(rug.bounds[1, 2]) if item else 0.0


def _stand_beside(maker: Furnisher, sofa: Item) -> None:
    rng, space = maker.rng, maker.space
    half = 0.5 * float(np.ptp(sofa.piece.bounds[:, 0]))
    for side in rng.permutation([-1, 1]):
        if not maker.chance(0.7):
            continue
        kind = "side_table" if maker.chance(0.6) else "floor_lamp"
        piece = maker.make(kind)
        size = 0.5 * float(np.ptp(piece.bounds[:, 0]))
        local = np.array([[side * (half + size + 0.06), 0.12, 0.0]])
        x, y, _ = sofa.pose.apply(local)[0]
        item = space.try_place(kind, piece, Pose(float(x), float(y), 0.0, sofa.pose.turn))
        if item is not None and kind == "side_table" and maker.chance(0.7):
            space.on_top(rng, "table_lamp", maker.make("table_lamp"), item, centre=True)
    if maker.chance(0.4):
        space.on_top(rng, "folded_blanket", maker.make("folded_blanket"), sofa)


def place_armchair(maker: Furnisher, sofa: Item | None) -> None:
    """An armchair that turns to the sofa; without one in a corner, perhaps with a small table."""
    rng, space = maker.rng, maker.space
    piece = maker.make("armchair")
    if sofa is not None:
        for side in rng.permutation([-1, 1]):
            local = np.array([[side * float(rng.uniform(1.5, 1.9)), -1.45, 0.0]])
            x, y, _ = sofa.pose.apply(local)[0]
            turn = (sofa.pose.turn + side * -90.0) % 360
            pose = Pose(float(x), float(y), 0.0, turn)
            if space.try_place("armchair", piece, pose, allow=(sofa.id,)):
                return
    item = space.against_wall(rng, "armchair", piece, where="corner")
    if item is not None and maker.chance(0.5):
        table = maker.make("side_table")
        side = float(rng.choice([-1.0, 1.0]))
        half = 0.5 * float(np.ptp(piece.bounds[:, 0])) + 0.5 * float(np.ptp(table.bounds[:, 0]))
        x, y, _ = item.pose.apply(np.array([[side * (half + 0.05), 0.1, 0.0]]))[0]
        space.try_place("side_table", table, Pose(float(x), float(y), 0.0, item.pose.turn))


def place_second_seats(maker: Furnisher) -> None:
    """Two armchairs about a small table, where the floor is still wide and bare."""
    rng, space = maker.rng, maker.space
    middle, radius = space.open_circle()
    if radius < 1.2:
        return
    chair, table = maker.make("armchair"), maker.make("side_table")
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
