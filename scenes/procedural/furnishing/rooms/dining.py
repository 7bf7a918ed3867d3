"""Dining rooms: table with chairs, rug and pendant lamp; sideboards."""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.procedural.furnishing.furnisher import Furnisher
from pbrnet.scenes.procedural.furnishing.space import PlacedPiece
from pbrnet.scenes.procedural.piece import FurniturePiece
from pbrnet.scenes.procedural.scene_item import Pose


def furnish_dining(furnisher: Furnisher) -> None:
    """Furnish a dining room."""
    place_dining_group(furnisher, small=False)
    furnisher.along_wall("sideboard", wanted=0.85)
    for kind in ("console_table", "bookshelf", "bench"):
        furnisher.along_wall(kind, wanted=0.3)
    furnisher.in_corner("floor_lamp", wanted=0.4)
    for _ in range(furnisher.number(1, 2)):
        furnisher.in_corner("plant")
    furnisher.hang_pictures(furnisher.number(2, 4))
    furnisher.hang_row(4, wanted=0.25)
    furnisher.hang("wall_lamp", wanted=0.3)


def place_dining_group(furnisher: Furnisher, small: bool) -> PlacedPiece | None:
    """Place a table with chairs around it, sometimes a rug below, and a pendant lamp above."""
    rng, space = furnisher.rng, furnisher.space
    for attempt in range(14):
        round_one = furnisher.chance(0.35)
        shrink = 1.0 - 0.03 * attempt
        if round_one:
            table = furnisher.make("round_table", width=rng.between(0.9, 1.2) * shrink)
        else:
            width = float(rng.uniform(1.1, 1.4) if small else rng.uniform(1.4, 2.0)) * shrink
            table = furnisher.make("dining_table", width=width)
        spread = 0.15 + 0.12 * attempt
        x, y = (space.open_middle() + rng.normal(0, spread, 2)).tolist()
        pose = Pose(x, y, 0.0, rng.pick([0.0, 90.0]))
        if not space.fits(table, pose, ()):
            continue
        x0, y0, x1, y1 = space.shape.bounds
        if min(x - x0, x1 - x, y - y0, y1 - y) < 0.5:
            continue
        lifted = 0.0
        if not small and furnisher.chance(0.6):
            lifted = _lay_rug_under(furnisher, table, pose)
        pose = Pose(x, y, lifted, pose.yaw)
        item = space.try_place("dining_table", table, pose, zone=False)
        if item is None:
            if lifted:
                space.remove_last()
            continue
        chairs = _place_chairs(furnisher, item, round_one)
        if chairs < 2 and attempt < 10:
            for _ in range(chairs + 1):
                space.remove_last()
            if lifted:
                space.remove_last()
            continue
        _hang_pendant(furnisher, item)
        return item
    return None


def _lay_rug_under(furnisher: Furnisher, table: FurniturePiece, pose: Pose) -> float:
    size = np.ptp(table.bounds, axis=0)
    rug = furnisher.make("rug", width=float(size[0]) + 1.5, depth=float(size[1]) + 1.5)
    item = furnisher.space.try_place("rug", rug, pose, zone=False)
    return float(rug.bounds[1, 2]) if item else 0.0


def _place_chairs(furnisher: Furnisher, table: PlacedPiece, round_one: bool) -> int:
    rng, space = furnisher.rng, furnisher.space
    low, high = table.piece.bounds
    chair = furnisher.make("dining_chair")
    depth = chair.size[1]
    seats: list[tuple[float, float]] = []  # yaw relative to the table, offset along its edge
    if round_one:
        seats = [(0.0, 0.0), (90.0, 0.0), (180.0, 0.0), (270.0, 0.0)]
    else:
        width = float(high[0] - low[0])
        per_side = max(1, int((width - 0.2) / 0.58))
        for k in range(per_side):
            offset = (k - (per_side - 1) / 2) * (width - 0.15) / per_side
            seats += [(0.0, offset), (180.0, offset)]
        if width > 1.3 and furnisher.chance(0.5):
            seats += [(90.0, 0.0), (270.0, 0.0)]
    count = 0
    for relative_yaw, offset in seats:
        # At yaw 0 the chair is beyond the table's +Y edge and faces -Y.
        edge = float(high[1]) if relative_yaw in (0.0, 180.0) else float(high[0])
        disorder = furnisher.style.disorder
        drawn = rng.between(-0.12, 0.12)
        if furnisher.chance(0.5 * disorder):  # somebody got up and left it so
            drawn = rng.between(0.1, 0.4)
        askew = rng.normal(0, 2 + 10 * disorder) * (2.0 if drawn > 0.12 else 1.0)
        for pulled, turn in ((drawn, askew), (drawn, 0.0), (0.12, 0.0), (0.3, 0.0)):
            distance = edge + depth / 2 - 0.16 + pulled
            local = Pose(0.0, 0.0, 0.0, relative_yaw).apply(np.array([[offset, distance, 0.0]]))
            if relative_yaw == 180.0:
                local[0, 0] = offset
            at = table.pose.apply(local)[0]
            yaw = (table.pose.yaw + relative_yaw + turn) % 360
            pose = Pose(float(at[0]), float(at[1]), table.pose.z, yaw)
            if space.try_place("dining_chair", chair, pose, zone=False, allow=(table.id,)):
                count += 1
                break
    return count


def _hang_pendant(furnisher: Furnisher, table: PlacedPiece) -> None:
    top = float(table.bounds[1, 2])
    drop = furnisher.plan.height - top - furnisher.rng.between(0.62, 0.78)
    if drop < 0.35:
        return
    lamp = furnisher.make("pendant_lamp", drop=drop)
    pose = Pose(table.pose.x, table.pose.y, furnisher.plan.height, 0.0)
    furnisher.space.try_place("pendant_lamp", lamp, pose, zone=False, on_floor=False)
