"""What the dark-house test stands on: where its walks of light begin, and what its blockers stop.

With every lamp off and every portal blocked a house is black inside. Importers use these to find
where light would get in besides, `pipeline.render.leaks` to prove that it does not.
World: metres, Z up.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry import Polygon

from scenes.arrays import BoolArray, Float64Array

_OFF = 1e-4  # metres that a bounce starts above its surface
_STEEP = 0.01  # cosine below which it starts less high
_EDGE = 2e-3  # metres by which a portal's blocker overlaps its frame


class Hole(Protocol):
    """A planar opening: corners (N, 3) and the normal (3,) of its plane."""

    @property
    def polygon(self) -> Any: ...

    @property
    def normal(self) -> Any: ...


def blocked(
    holes: Sequence[Hole], origins: Float64Array, directions: Float64Array, distances: Float64Array
) -> BoolArray:
    """Which stretches (N,) from `origins` (N, 3) along unit `directions` cross a hole.

    A stretch ends after its distance (N,), infinite where it hits nothing.
    """
    crossed = np.zeros(len(origins), dtype=bool)
    for hole in holes:
        corners = np.asarray(hole.polygon, dtype=np.float64)
        normal = np.asarray(hole.normal, dtype=np.float64)
        normal = normal / np.linalg.norm(normal)
        across = directions @ normal
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = ((corners[0] - origins) @ normal) / across
        near = np.isfinite(reach) & (reach > 0) & (reach < distances + _OFF)
        if not near.any():
            continue
        first = np.cross(normal, [0.0, 0.0, 1.0] if abs(normal[2]) < 0.9 else [1.0, 0.0, 0.0])
        first = first / np.linalg.norm(first)
        frame = np.stack([first, np.cross(normal, first)], axis=1)
        blocker = Polygon((corners - corners[0]) @ frame).buffer(_EDGE, join_style="mitre")
        points = origins[near] + reach[near, None] * directions[near]
        local = (points - corners[0]) @ frame
        crossed[near] |= shapely.contains_xy(blocker, local[:, 0], local[:, 1])
    return crossed


def places(
    floor: Polygon, floor_z: float, ceiling_z: float, count: int, rng: np.random.Generator
) -> Float64Array:
    """Random places (count, 3) in the lower half of a room's air, a little off floor and walls.

    A room's ceiling height is that of most of it: under a roof its upper half may be outdoors.
    """
    inner = floor.buffer(-0.05)
    if inner.is_empty:
        inner = floor
    west, south, east, north = inner.bounds
    made: list[Float64Array] = []
    while sum(map(len, made)) < count:
        drawn = rng.uniform((west, south), (east, north), (4 * count, 2))
        made.append(drawn[shapely.contains_xy(inner, drawn[:, 0], drawn[:, 1])])
    plan = np.concatenate(made)[:count]
    low = floor_z + 0.02
    high = max(0.5 * (floor_z + ceiling_z), floor_z + 0.03)
    return np.column_stack([plan, rng.uniform(low, high, count)])


def bounce(
    origins: Float64Array,
    ways: Float64Array,
    distances: Float64Array,
    normals: Float64Array,
    rng: np.random.Generator,
) -> tuple[Float64Array, Float64Array]:
    """How walks go on from where they hit something: origins and unit directions, (N, 3) each.

    They came from `origins` along unit `ways` and met, after `distances` (N,), matt surfaces of
    unit `normals` (N, 3), of either side. They start again a little back on their own way: above
    the surface, and never behind another one that meets it in a crease.
    """
    towards = np.sum(normals * ways, axis=-1, keepdims=True)
    facing = np.where(towards > 0, -normals, normals)
    back = np.minimum(_OFF / np.maximum(np.abs(towards[:, 0]), _STEEP), 0.5 * distances)
    onward = _unit(facing + _unit(rng.normal(size=facing.shape)))
    return origins + (distances - back)[:, None] * ways, onward


def _unit(vectors: npt.ArrayLike) -> Float64Array:
    """Vectors (..., 3) scaled to length 1; zero stays zero."""
    rows = np.asarray(vectors, dtype=np.float64)
    length = np.linalg.norm(rows, axis=-1, keepdims=True)
    return rows / np.where(length > 0, length, 1)
