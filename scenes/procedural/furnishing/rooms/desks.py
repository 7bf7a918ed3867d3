"""Desk with a chair, preferably at a window."""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.procedural.furnishing.furnisher import Furnisher, has_opening
from pbrnet.scenes.procedural.furnishing.space import PlacedPiece
from pbrnet.scenes.procedural.piece import FurniturePiece
from pbrnet.scenes.procedural.scene_item import Pose


def place_desk(furnisher: Furnisher) -> PlacedPiece | None:
    """Place a desk, a chair in its knee space, a screen and a lamp."""
    rng, space = furnisher.rng, furnisher.space
    chair = furnisher.make("office_chair")
    for _ in range(3):
        desk = furnisher.make("desk")
        window_edges = [
            edge
            for edge in furnisher.room.edges
            if any(has_opening(edge, window) and window.z0 > 0.78 for window in space.windows())
        ]
        item = None
        if window_edges and furnisher.chance(0.45):
            item = space.against_wall(rng, "desk", desk, edges=window_edges, where="middle")
        item = item or space.against_wall(rng, "desk", desk)
        if item is None:
            continue
        # The knee space is beside the pedestal.
        knees = _knee_space(desk)
        askew = rng.normal(0, 10 + 50 * furnisher.style.disorder)
        for pulled, turn in ((0.2, askew), (0.1, 0.0), (0.2, 0.0), (0.32, askew), (0.45, 0.0)):
            local = np.array([[knees, float(desk.bounds[0, 1]) - pulled, 0.0]])
            x, y, _ = item.pose.apply(local)[0]
            yaw = (item.pose.yaw + 180.0 + turn) % 360
            if space.try_place(
                "office_chair",
                chair,
                Pose(float(x), float(y), 0.0, yaw),
                zone=False,
                allow=(item.id,),
            ):
                break
        kind = "monitor" if furnisher.chance(0.85) else "laptop"
        space.on_top(rng, kind, furnisher.make(kind), item, tries=30)
        space.on_top(rng, "desk_lamp", furnisher.make("desk_lamp"), item, tries=30)
        return item
    return None


def _knee_space(desk: FurniturePiece) -> float:
    """x of the centre of the knee space below a desk with at most one pedestal."""
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
        return 0.0  # symmetric legs
    return float(-np.sign(heavier) * 0.22 * (high - low))
