"""Where a building lets light through that should not: the dark-house test.

With every lamp off and every portal blocked, a house is black inside. Light paths are reversible,
so it is enough to walk at random from inside every room, bouncing as matt surfaces do, and to see
whether a walk ever gets out other than through a portal. Sky and lamps outside need no mention:
whatever light there is beyond the walls would come in the same way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry import Polygon

from pipeline.render import raycast
from pipeline.render.scene import RenderScene
from scenes.arrays import BoolArray, Float64Array
from scenes.contract import Room
from scenes.geometry.directions import unit
from scenes.reconstruction.light_walks import blocked, bounce, places
from scenes.seeds import generator

WALKS = 4096  # a room
BOUNCES = 8


@dataclass(frozen=True)
class Leak:
    """Walks that left room `room` (id): their `share`, and the last `point` (world, metres)
    inside a room and `direction` of one of them."""

    room: str
    share: float
    point: tuple[float, float, float]
    direction: tuple[float, float, float]

    def __str__(self) -> str:
        x, y, z = self.point
        return (
            f"light leaks into {self.room} near ({x:.2f}, {y:.2f}, {z:.2f}): "
            f"{100 * self.share:.2g} % of what bounces there gets out other than by a portal"
        )


def find_leaks(
    scene: RenderScene, walks: int = WALKS, bounces: int = BOUNCES, seed: int = 0
) -> list[Leak]:
    """The rooms that walks of light leave, in the scene's order; empty if the house is dark.

    `walks` start at random places in each room. A room that is meant to be open (a terrace
    without a ceiling) shows as a leak of a large share.
    """
    found = []
    for room in scene.scene.rooms:
        rng = generator(seed, "leaks", room.id)
        origins = places(Polygon(room.floor), room.floor_z, room.ceiling_z, walks, rng)
        way = unit(rng.normal(size=(walks, 3)))
        kept_origin, kept_way = origins.copy(), way.copy()  # of the last stretch from indoors
        alive, escaped = np.arange(walks), []
        for _ in range(bounces):
            hits = raycast.surfaces(scene.target, origins[alive], way[alive], colors=False)
            distance = np.where(hits.shape >= 0, hits.distance, np.inf).astype(np.float64)
            stopped = blocked(scene.scene.portals, origins[alive], way[alive], distance)
            escaped += alive[~stopped & np.isinf(distance)].tolist()
            going = ~stopped & np.isfinite(distance)
            normals, alive = unit(hits.geometric[going]), alive[going]
            if not len(alive):
                break
            origins[alive], way[alive] = bounce(
                origins[alive], way[alive], distance[going], normals, rng
            )
            indoors = alive[_within(scene.scene.rooms, origins[alive])]
            kept_origin[indoors], kept_way[indoors] = origins[indoors], way[indoors]
        if escaped:
            one = min(escaped)
            found.append(
                Leak(
                    room.id, len(escaped) / walks, _triple(kept_origin[one]), _triple(kept_way[one])
                )
            )
    return found


def _within(rooms: tuple[Room, ...], points: Float64Array) -> BoolArray:
    inside = np.zeros(len(points), dtype=bool)
    for room in rooms:
        level = (points[:, 2] > room.floor_z - 0.05) & (points[:, 2] < room.ceiling_z + 0.05)
        inside |= level & shapely.contains_xy(Polygon(room.floor), points[:, 0], points[:, 1])
    return inside


def _triple(values: Float64Array) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z
