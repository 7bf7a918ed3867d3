"""Halls and corridors: coat hooks, shoe rack, console table, mirror, mats, pictures."""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.procedural.furnishing.furnisher import Furnisher
from pbrnet.scenes.procedural.furnishing.space import yaw_facing
from pbrnet.scenes.procedural.scene_item import Pose


def furnish_hall(furnisher: Furnisher) -> None:
    """Furnish a hall or corridor."""
    furnisher.hang("coat_hooks")
    furnisher.along_wall("shoe_rack", wanted=0.8)
    if furnisher.wants(0.6):
        furnisher.along_wall("console_table")
    else:
        furnisher.along_wall("bench", wanted=0.6)
    furnisher.hang("wall_mirror", wanted=0.5)
    if furnisher.wants(0.55):
        _lay_runner(furnisher)
    furnisher.in_corner("plant", wanted=0.4)
    if furnisher.wants(0.5):
        _lay_doormat(furnisher)
    furnisher.hang_row(5, wanted=0.4)
    furnisher.hang_pictures(furnisher.number(1, 4))
    furnisher.hang("wall_lamp", wanted=0.35)


def _lay_runner(furnisher: Furnisher) -> None:
    """Lay a long rug along the hall."""
    rng, space = furnisher.rng, furnisher.space
    x0, y0, x1, y1 = space.shape.bounds
    along_x = x1 - x0 > y1 - y0
    width = min(rng.between(1.4, 2.6), 0.75 * max(x1 - x0, y1 - y0))
    depth = min(rng.between(0.6, 0.8), 0.6 * min(x1 - x0, y1 - y0))
    runner = furnisher.make("rug", width=width, depth=depth)
    middle = space.middle()
    yaw = 0.0 if along_x else 90.0
    for _ in range(6):
        shift = rng.uniform(-1, 1) * np.array([1.0, 0.0] if along_x else [0.0, 1.0])
        x, y = middle + shift
        if space.try_place("rug", runner, Pose(float(x), float(y), 0.0, yaw), zone=False):
            return


def _lay_doormat(furnisher: Furnisher) -> None:
    """Lay a mat before the door of the home."""
    for opening in furnisher.plan.openings:
        if opening.kind == "entrance" and furnisher.room.id in opening.rooms:
            mat = furnisher.make("rug", width=0.7, depth=0.45)
            edge = opening.edge_in(furnisher.room.id)
            for away in (0.35, 0.6, 1.1):
                x, y = edge.at(0.5 * opening.width, away)
                pose = Pose(x, y, 0.0, yaw_facing(edge.inward))
                if furnisher.space.try_place("rug", mat, pose, zone=False):
                    break
