"""Detection of light leaks in a building: the dark-house test.

With every lamp off and every portal blocked, a closed building is black inside. Light paths are
reversible, so the test traces random diffuse walks from inside every room and checks whether a
walk leaves the building other than through a portal. The test needs no sky and no lamps outdoors:
their light would enter along the same paths.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry import Polygon

from pbrnet.pipeline.render import raycast
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.scenes.arrays import BoolArray, Float64Array
from pbrnet.scenes.contract import Room
from pbrnet.scenes.geometry.directions import unit
from pbrnet.scenes.reconstruction.light_walks import (
    OpeningIndex,
    diffuse_bounce,
    sample_room_points,
)
from pbrnet.scenes.seeds import generator

WALKS = 4096  # a room
BOUNCES = 8


@dataclass(frozen=True)
class Leak:
    """Light leak of one room.

    `room` is the room's id and `share` the fraction of its walks that left the building. `point`
    (world, metres) and `direction` are the last ones inside a room of one such walk.
    """

    room: str
    share: float
    point: tuple[float, float, float]
    direction: tuple[float, float, float]

    def __str__(self) -> str:
        x, y, z = self.point
        return (
            f"light leaks into {self.room} near ({x:.2f}, {y:.2f}, {z:.2f}): "
            f"{100 * self.share:.2g} % of the light walks from this room leave the building "
            "other than through a portal"
        )


def find_leaks(
    scene: RenderScene, walks: int = WALKS, bounces: int = BOUNCES, seed: int = 0
) -> list[Leak]:
    """Return the leaks, in the order of the scene's rooms; empty if the building is dark.

    `walks` random walks start in each room, with up to `bounces` segments each. A room that is
    meant to be open (a terrace without a ceiling) appears as a leak with a large share.
    """
    found = []
    portals = OpeningIndex(scene.scene.portals)
    for room in scene.scene.rooms:
        rng = generator(seed, "leaks", room.id)
        origins = sample_room_points(Polygon(room.floor), room.floor_z, room.ceiling_z, walks, rng)
        directions = unit(rng.normal(size=(walks, 3)))
        # Start and direction of each walk's last segment that began indoors.
        indoor_origins, indoor_directions = origins.copy(), directions.copy()
        alive, escaped = np.arange(walks), []
        for _ in range(bounces):
            hits = raycast.surfaces(scene.geometry, origins[alive], directions[alive], colors=False)
            distance = np.where(hits.shape >= 0, hits.distance, np.inf).astype(np.float64)
            stopped = portals.crossed(origins[alive], directions[alive], distance)
            escaped += alive[~stopped & np.isinf(distance)].tolist()
            going = ~stopped & np.isfinite(distance)
            normals, alive = unit(hits.geometric_normal[going]), alive[going]
            if not len(alive):
                break
            origins[alive], directions[alive] = diffuse_bounce(
                origins[alive], directions[alive], distance[going], normals, rng
            )
            indoors = alive[_within(scene.scene.rooms, origins[alive])]
            indoor_origins[indoors] = origins[indoors]
            indoor_directions[indoors] = directions[indoors]
        if escaped:
            one = min(escaped)
            found.append(
                Leak(
                    room.id,
                    len(escaped) / walks,
                    _triple(indoor_origins[one]),
                    _triple(indoor_directions[one]),
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
