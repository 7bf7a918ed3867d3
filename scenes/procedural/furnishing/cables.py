"""Cables from what stands at a wall to sockets beside it."""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.procedural.furnishing.furnisher import Furnisher
from pbrnet.scenes.procedural.furnishing.space import PlacedPiece
from pbrnet.scenes.procedural.furniture.things.packages import power_cable

# Kind of furniture -> chance that a cable leads from behind it, and height where it ends, metres.
_DRIVEN: dict[str, tuple[float, float]] = {
    "tv_stand": (0.9, 0.36),
    "desk": (0.9, 0.68),
    "night_table": (0.6, 0.4),
    "sideboard": (0.35, 0.45),
    "chest_of_drawers": (0.3, 0.6),
    "bookshelf": (0.2, 0.4),
    "washing_machine": (0.6, 0.6),
}
_SOCKET = 0.3  # metres above the floor


def run_cables(furnisher: Furnisher) -> None:
    """Lead cables from furniture with a lamp or a device to sockets beside it."""
    rng, space = furnisher.rng, furnisher.space
    for item in list(space.items):
        chance, end = _DRIVEN.get(item.kind, (0.0, 0.0))
        if not furnisher.chance(chance):
            continue
        for side in (1.0, -1.0) if furnisher.chance(0.5) else (-1.0, 1.0):
            if _lead(furnisher, item, side, rng.between(0.1, 0.4), end):
                break


def _lead(furnisher: Furnisher, item: PlacedPiece, side: float, run: float, end: float) -> bool:
    """Mount a socket `run` metres beside an item, and lead its cable there."""
    edge = furnisher.edge_behind(item)
    if edge is None:
        return False
    space = furnisher.space
    # The x axis of what hangs on a wall points against the wall's direction.
    beside = float(item.piece.bounds[0 if side > 0 else 1, 0])
    middle = space.position_on(edge, np.array([item.pose.x, item.pose.y]))
    at = middle - beside + side * run
    if not 0.1 < at < edge.length - 0.1:
        return False
    cable = power_cable(furnisher.rng, furnisher.style, side * run, end - _SOCKET)
    return space.hang("cable", cable, edge, at, _SOCKET) is not None
