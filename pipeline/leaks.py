"""Where a building lets light through that should not: the dark-house test.

With every lamp off and every portal blocked, a house is black inside. Light paths are reversible,
so it is enough to walk at random from inside every room, bouncing as matt surfaces do, and to see
whether a walk ever gets out other than through a portal. Sky and lamps outside need no mention:
whatever light there is beyond the walls would come in the same way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry import Polygon

from pipeline import rays
from pipeline.renderer import RenderScene
from scenes.contract import Portal, Room
from scenes.seeds import generator

WALKS = 4096  # a room
BOUNCES = 8
_OFF = 1e-4  # metres that a bounce starts above its surface
_EDGE = 2e-3  # metres by which a portal's blocker overlaps its frame

Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]


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
        origins = _inside(room, walks, rng)
        way = rays.unit(rng.normal(size=(walks, 3)))
        kept_origin, kept_way = origins.copy(), way.copy()  # of the last stretch from indoors
        alive, escaped = np.arange(walks), []
        for _ in range(bounces):
            hits = rays.surfaces(scene.target, origins[alive], way[alive], colors=False)
            distance = np.where(hits.shape >= 0, hits.distance, np.inf).astype(np.float64)
            stopped = blocked(scene.scene.portals, origins[alive], way[alive], distance)
            escaped += alive[~stopped & np.isinf(distance)].tolist()
            going = ~stopped & np.isfinite(distance)
            normal = _facing(hits.geometric[going], way[alive[going]])
            alive = alive[going]
            if not len(alive):
                break
            origins[alive] = hits.position[going] + _OFF * normal
            way[alive] = rays.unit(normal + rays.unit(rng.normal(size=normal.shape)))
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


def blocked(
    portals: tuple[Portal, ...], origins: Floats, directions: Floats, distances: Floats
) -> Mask:
    """Which stretches (N,) from `origins` (N, 3) along unit `directions` cross a portal."""
    crossed = np.zeros(len(origins), dtype=bool)
    for portal in portals:
        corners = np.asarray(portal.polygon, dtype=np.float64)
        normal = rays.unit(np.asarray(portal.normal))
        across = directions @ normal
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = ((corners[0] - origins) @ normal) / across
        near = np.isfinite(reach) & (reach > 0) & (reach < distances + _OFF)
        if not near.any():
            continue
        first = rays.unit(np.cross(normal, [0.0, 0.0, 1.0] if abs(normal[2]) < 0.9 else [1, 0, 0]))
        frame = np.stack([first, np.cross(normal, first)], axis=1)
        blocker = Polygon((corners - corners[0]) @ frame).buffer(_EDGE, join_style="mitre")
        points = origins[near] + reach[near, None] * directions[near]
        local = (points - corners[0]) @ frame
        crossed[near] |= shapely.contains_xy(blocker, local[:, 0], local[:, 1])
    return crossed


def _inside(room: Room, count: int, rng: np.random.Generator) -> Floats:
    """Random places (count, 3) in the lower half of a room's air, a little off floor and walls.

    A room's ceiling height is that of most of it: under a roof its upper half may be outdoors.
    """
    floor = Polygon(room.floor).buffer(-0.05)
    if floor.is_empty:
        floor = Polygon(room.floor)
    west, south, east, north = floor.bounds
    made: list[Floats] = []
    while sum(map(len, made)) < count:
        drawn = rng.uniform((west, south), (east, north), (4 * count, 2))
        made.append(drawn[shapely.contains_xy(floor, drawn[:, 0], drawn[:, 1])])
    plan = np.concatenate(made)[:count]
    low = room.floor_z + 0.02
    high = max(0.5 * (room.floor_z + room.ceiling_z), room.floor_z + 0.03)
    return np.column_stack([plan, rng.uniform(low, high, count)])


def _within(rooms: tuple[Room, ...], points: Floats) -> Mask:
    inside = np.zeros(len(points), dtype=bool)
    for room in rooms:
        level = (points[:, 2] > room.floor_z - 0.05) & (points[:, 2] < room.ceiling_z + 0.05)
        inside |= level & shapely.contains_xy(Polygon(room.floor), points[:, 0], points[:, 1])
    return inside


def _facing(normals: npt.NDArray[np.float32], directions: Floats) -> Floats:
    unit = rays.unit(normals)
    towards = np.sum(unit * directions, axis=-1, keepdims=True)
    return np.where(towards > 0, -unit, unit)


def _triple(values: Floats) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z
