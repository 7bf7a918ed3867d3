"""Living rooms: sofas and armchairs with tables, rugs and televisions; shelves, lamps, plants."""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.procedural.furnishing.furnisher import Furnisher, Point
from pbrnet.scenes.procedural.furnishing.rooms.dining import place_dining_group
from pbrnet.scenes.procedural.furnishing.space import PlacedPiece, yaw_facing
from pbrnet.scenes.procedural.piece import FurniturePiece
from pbrnet.scenes.procedural.plan import PlanRoom, Point2, WallEdge
from pbrnet.scenes.procedural.scene_item import Pose


def furnish_living(furnisher: Furnisher) -> None:
    """Furnish a living room."""
    sofa = place_seating(furnisher)
    if furnisher.chance(0.6) and all(item.kind != "tv_stand" for item in furnisher.space.items):
        stand = furnisher.along_wall("tv_stand")
        if stand is not None:
            width = stand.piece.size[0] - 0.1
            television = furnisher.make("television", width=min(1.2, width))
            furnisher.space.on_top(furnisher.rng, "television", television, stand, centre=True)
    dines_elsewhere = "dining" in {room.type for room in furnisher.plan.rooms} or any(
        opening.kind == "open" and furnisher.room.id in opening.rooms
        for opening in furnisher.plan.openings
    )
    if furnisher.area > 19 and not dines_elsewhere:
        place_dining_group(furnisher, small=True)
    for kind, probability in (("bookshelf", 0.8), ("sideboard", 0.45), ("console_table", 0.25)):
        furnisher.along_wall(kind, wanted=probability)
    if sofa is None or furnisher.wants(0.5):
        place_armchair(furnisher, sofa)
    furnisher.in_corner("floor_lamp", wanted=0.8)
    for _ in range(furnisher.number(1, 2)):
        furnisher.in_corner("plant")
    if furnisher.area > 20:
        furnisher.along_wall("bookshelf", wanted=0.4)
    place_second_seats(furnisher)
    furnisher.on_floor("pouf", wanted=0.3)
    furnisher.hang_pictures(furnisher.number(1, 4))
    furnisher.hang_row(5, wanted=0.25)
    furnisher.hang("wall_shelf", wanted=0.4)
    furnisher.hang_clock()
    furnisher.hang("wall_lamp", wanted=0.25)


def place_seating(furnisher: Furnisher) -> PlacedPiece | None:
    """Place a sofa against a wall, a coffee table in front of it, a television opposite."""
    rng, space = furnisher.rng, furnisher.space
    for attempt in range(3):
        sofa_piece = furnisher.make("sofa") if attempt < 2 else furnisher.make("sofa", width=1.6)
        table_piece = furnisher.make("coffee_table")
        stand_piece = furnisher.make("tv_stand")
        for need_tv in (True, False):
            places = space.along_walls(rng, sofa_piece, where="middle", step=0.25)
            for edge, s in places[:40]:
                sofa = _try_seating(
                    furnisher, edge, s, sofa_piece, table_piece, stand_piece, need_tv
                )
                if sofa is not None:
                    _stand_beside(furnisher, sofa)
                    return sofa
    return _place_island(furnisher)


def _place_island(furnisher: Furnisher) -> PlacedPiece | None:
    """Place sofa, coffee table and armchair in mid-room, for rooms without a free wall."""
    rng, space = furnisher.rng, furnisher.space
    sofa_piece, table = furnisher.make("sofa", width=1.7), furnisher.make("coffee_table")
    for attempt in range(40):
        x, y = space.open_middle() + rng.normal(0, 0.1 + 0.03 * attempt, 2)
        pose = Pose(float(x), float(y), 0.0, 90.0 * rng.whole(4))
        sofa = space.try_place("sofa", sofa_piece, pose)
        if sofa is None:
            continue
        ahead = float(-sofa_piece.bounds[0, 1]) + 0.4 + 0.5 * table.size[1]
        how = {"allow": (sofa.id,), "zone": False}
        furnisher.place_beside("coffee_table", table, sofa, 0.0, -ahead, **how)
        place_armchair(furnisher, sofa)
        return sofa
    return None


def _try_seating(
    furnisher: Furnisher,
    edge: WallEdge,
    s: float,
    sofa: FurniturePiece,
    table: FurniturePiece,
    stand: FurniturePiece,
    need_tv: bool,
) -> PlacedPiece | None:
    rng, space = furnisher.rng, furnisher.space
    pose = space.wall_pose(sofa, edge, s)
    if not space.fits(sofa, pose):
        return None
    centre = np.array([pose.x, pose.y])
    ahead = np.array(edge.inward)
    stand_pose = None
    if (hit := _wall_ahead(space.room, edge.inward, (pose.x, pose.y))) is not None:
        stand_pose = space.wall_pose(stand, *hit)
        distance = float(np.dot(np.array([stand_pose.x, stand_pose.y]) - centre, ahead))
        if not 2.0 < distance < 5.5 or not space.fits(stand, stand_pose):
            stand_pose = None
    if need_tv and stand_pose is None:
        return None
    sofa_front = float(-sofa.bounds[0, 1])
    table_deep = table.size[1]
    table_centre = centre + (sofa_front + 0.4 + table_deep / 2) * ahead
    rug_top = _lay_rug_before(
        furnisher, edge, centre + (sofa_front + 0.08) * ahead, sofa, table_deep
    )
    kept_sofa = space.try_place("sofa", sofa, pose)
    if kept_sofa is None:
        if rug_top > 0:
            space.remove_last()
        return None
    aside = np.array(edge.along)
    for shift in (0.0, 0.2, -0.2, 0.4, -0.4):
        x, y = table_centre + shift * aside
        table_pose = Pose(float(x), float(y), rug_top, pose.yaw)
        if space.try_place("coffee_table", table, table_pose, allow=(kept_sofa.id,), zone=False):
            break
    if stand_pose is not None:
        kept_stand = space.try_place("tv_stand", stand, stand_pose)
        if kept_stand is not None:
            width = min(rng.between(0.95, 1.35), stand.size[0] - 0.1)
            television = furnisher.make("television", width=width)
            space.on_top(rng, "television", television, kept_stand, centre=True)
    return kept_sofa


def _wall_ahead(room: PlanRoom, direction: Point2, point: Point2) -> tuple[WallEdge, float] | None:
    """Return the wall that a ray hits first, and how far along the wall in metres."""
    hits = []
    for edge in room.edges:
        offset = (edge.start[0] - point[0], edge.start[1] - point[1])
        distance = offset[0] * direction[0] + offset[1] * direction[1]
        faces = -(edge.inward[0] * direction[0] + edge.inward[1] * direction[1]) >= 0.9
        if faces and distance > 0 and 0 < (s := edge.coordinates(point)[0]) < edge.length:
            hits.append((distance, edge, s))
    return min(hits, key=lambda hit: hit[0])[1:] if hits else None


def _lay_rug_before(
    furnisher: Furnisher, edge: WallEdge, start: Point, sofa: FurniturePiece, table_deep: float
) -> float:
    """Lay a rug in front of the sofa; returns its thickness in metres, 0 without a rug."""
    if not furnisher.chance(0.75):
        return 0.0
    width = min(sofa.size[0] + furnisher.rng.between(-0.1, 0.5), 2.9)
    depth = table_deep + furnisher.rng.between(0.75, 1.05)
    rug = furnisher.make("rug", width=width, depth=depth)
    deep = rug.size[1]
    at = start + 0.5 * deep * np.array(edge.inward)
    item = furnisher.space.try_place(
        "rug", rug, Pose(float(at[0]), float(at[1]), 0.0, yaw_facing(edge.inward)), zone=False
    )
    return float(rug.bounds[1, 2]) if item else 0.0


def _stand_beside(furnisher: Furnisher, sofa: PlacedPiece) -> None:
    half = 0.5 * sofa.piece.size[0]
    for side in furnisher.rng.shuffled((-1.0, 1.0)):
        if not furnisher.chance(0.7):
            continue
        kind = "side_table" if furnisher.chance(0.6) else "floor_lamp"
        piece = furnisher.make(kind)
        size = 0.5 * piece.size[0]
        item = furnisher.place_beside(kind, piece, sofa, side * (half + size + 0.06), 0.12)
        if item is not None and kind == "side_table" and furnisher.chance(0.7):
            furnisher.on_top("table_lamp", item, centre=True)
    if furnisher.chance(0.4):
        furnisher.on_top("folded_blanket", sofa)


def place_armchair(furnisher: Furnisher, sofa: PlacedPiece | None) -> None:
    """Place an armchair facing the sofa, else near a corner, there sometimes with a side table."""
    rng, space = furnisher.rng, furnisher.space
    piece = furnisher.make("armchair")
    if sofa is not None:
        for side in rng.shuffled((-1.0, 1.0)):
            pose = sofa.pose.beside(side * rng.between(1.5, 1.9), -1.45, side * -90.0)
            if space.try_place("armchair", piece, pose, allow=(sofa.id,)):
                return
    item = space.against_wall(rng, "armchair", piece, where="corner")
    if item is not None and furnisher.chance(0.5):
        table = furnisher.make("side_table")
        side = rng.pick([-1.0, 1.0])
        half = 0.5 * piece.size[0] + 0.5 * table.size[0]
        furnisher.place_beside("side_table", table, item, side * (half + 0.05), 0.1)


def place_second_seats(furnisher: Furnisher) -> None:
    """Place two armchairs at a side table if a large part of the floor is still free."""
    rng, space = furnisher.rng, furnisher.space
    middle, radius = space.open_circle()
    if radius < 1.2:
        return
    chair, table = furnisher.make("armchair"), furnisher.make("side_table")
    distance = 0.5 * table.size[0] - float(chair.bounds[0, 1]) + 0.12
    for _ in range(12):
        x, y = middle + rng.normal(0, 0.15, 2)
        pose = Pose(float(x), float(y), 0.0, 90.0 * rng.whole(4))
        seat = space.try_place("side_table", table, pose, zone=False)
        if seat is None:
            continue
        for yaw, offset in ((-65.0, distance), (65.0, -distance)):
            facing_table = seat.pose.beside(offset, 0.15, yaw)
            space.try_place("armchair", chair, facing_table, allow=(seat.id,), zone=False)
        return
