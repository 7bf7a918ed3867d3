"""A desk with its chair, by a window if one is free."""

from __future__ import annotations

import numpy as np

from scenes.procedural.furnishing.furnisher import Furnisher, has_opening
from scenes.procedural.furnishing.space import Item
from scenes.procedural.piece import Piece
from scenes.procedural.scene_item import Pose


def place_desk(maker: Furnisher) -> Item | None:
    """A desk, its chair in the knee room, a screen and a lamp on it."""
    rng, space = maker.rng, maker.space
    chair = maker.make("office_chair")
    for _ in range(3):
        desk = maker.make("desk")
        window_edges = [
            edge
            for edge in maker.room.edges
            if any(has_opening(edge, window) and window.z0 > 0.78 for window in space.windows())
        ]
        item = None
        if window_edges and maker.chance(0.45):
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
        kind = "monitor" if maker.chance(0.65) else "laptop"
        space.on_top(rng, kind, maker.make(kind), item, tries=30)
        space.on_top(rng, "desk_lamp", maker.make("desk_lamp"), item, tries=30)
        return item
    return None


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
