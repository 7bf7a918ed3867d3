"""Studies: desk, preferably at a window, with a chair, shelves, armchair."""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.procedural.furnishing.furnisher import Furnisher, has_opening
from pbrnet.scenes.procedural.furnishing.rooms.living import place_armchair
from pbrnet.scenes.procedural.furnishing.space import PlacedPiece
from pbrnet.scenes.procedural.piece import FurniturePiece


def furnish_study(furnisher: Furnisher) -> None:
    """Furnish a study."""
    place_desk(furnisher)
    for _ in range(furnisher.number(1, 3)):
        furnisher.along_wall("bookshelf")
    if furnisher.wants(0.5):
        place_armchair(furnisher, None)
    furnisher.along_wall("chest_of_drawers", wanted=0.3)
    furnisher.in_corner("floor_lamp", wanted=0.5)
    furnisher.in_corner("plant", wanted=0.6)
    for kind, probability in (("waste_bin", 0.6), ("storage_box", 0.2)):
        if furnisher.wants(probability):
            furnisher.in_corner(kind) or furnisher.on_floor(kind)
    furnisher.lay_rug()
    furnisher.hang_pictures(furnisher.number(2, 4))
    furnisher.hang_row(4, wanted=0.25)
    furnisher.hang("wall_shelf", wanted=0.6)
    furnisher.hang_clock()


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
            pose = item.pose.beside(knees, float(desk.bounds[0, 1]) - pulled, 180.0 + turn)
            if space.try_place("office_chair", chair, pose, zone=False, allow=(item.id,)):
                break
        kind = "monitor" if furnisher.chance(0.85) else "laptop"
        furnisher.on_top(kind, item, tries=30)
        furnisher.on_top("desk_lamp", item, tries=30)
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
