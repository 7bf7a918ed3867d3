"""Tables to dine at: chairs about them, a rug below, a lamp above."""

from __future__ import annotations

import numpy as np

from scenes.procedural.furnishing.furnisher import Furnisher
from scenes.procedural.furnishing.space import Item
from scenes.procedural.piece import Piece
from scenes.procedural.scene_item import Pose


def place_dining_group(maker: Furnisher, small: bool) -> Item | None:
    """A table, chairs around it, a rug below and a lamp above."""
    rng, space = maker.rng, maker.space
    for attempt in range(14):
        round_one = maker.chance(0.35)
        shrink = 1.0 - 0.03 * attempt
        if round_one:
            table = maker.make("round_table", width=float(rng.uniform(0.9, 1.2)) * shrink)
        else:
            width = float(rng.uniform(1.1, 1.4) if small else rng.uniform(1.4, 2.0)) * shrink
            table = maker.make("dining_table", width=width)
        centre = maker.space.open_middle()
        spread = 0.15 + 0.12 * attempt
        x, y = (float(value) for value in centre + rng.normal(0, spread, 2))
        pose = Pose(x, y, 0.0, float(rng.choice([0.0, 90.0])))
        if not space.fits(table, pose, ()):
            continue
        x0, y0, x1, y1 = space.shape.bounds
        if min(x - x0, x1 - x, y - y0, y1 - y) < 0.5:
            continue
        lifted = 0.0
        if not small and maker.chance(0.6):
            lifted = _lay_rug_under(maker, table, pose)
        pose = Pose(x, y, lifted, pose.turn)
        item = space.try_place("dining_table", table, pose, zone=False)
        if item is None:
            if lifted:
                space.remove_last()
            continue
        chairs = _place_chairs(maker, item, round_one)
        if chairs < 2 and attempt < 10:
            for _ in range(chairs + 1):
                space.remove_last()
            if lifted:
                space.remove_last()
            continue
        _hang_pendant(maker, item)
        return item
    return None


def _lay_rug_under(maker: Furnisher, table: Piece, pose: Pose) -> float:
    size = np.ptp(table.bounds, axis=0)
    rug = maker.make("rug", width=float(size[0]) + 1.5, depth=float(size[1]) + 1.5)
    item = maker.space.try_place("rug", rug, pose, zone=False)
    return float(rug.bounds[1, 2]) if item else 0.0


def _place_chairs(maker: Furnisher, table: Item, round_one: bool) -> int:
    rng, space = maker.rng, maker.space
    low, high = table.piece.bounds
    chair = maker.make("dining_chair")
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
        if width > 1.3 and maker.chance(0.5):
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


def _hang_pendant(maker: Furnisher, table: Item) -> None:
    top = float(table.bounds[1, 2])
    drop = maker.plan.height - top - float(maker.rng.uniform(0.62, 0.78))
    if drop < 0.35:
        return
    lamp = maker.make("pendant_lamp", drop=drop)
    pose = Pose(table.pose.x, table.pose.y, maker.plan.height, 0.0)
    maker.space.try_place("pendant_lamp", lamp, pose, zone=False, on_floor=False)
