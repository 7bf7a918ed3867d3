"""Grounds and backdrops that a building stands on or in.

Input: triangles (F, 3, 3), Z up, in any unit. Output: the triangles of the building, with the
piece of ground below it.

A ground is a connected part that is wide and flat, lies below everything else and reaches far
beyond it. Without it, the extent of the rest is the extent of the building.
"""

from __future__ import annotations

import numpy as np
import trimesh
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from pbrnet.scenes.arrays import BoolArray, Float64Array, Int64Array

_MOST_TRIANGLES = 1_500_000  # that are split into parts
_WELD = 1e-6  # of the extent; vertices closer than this are one
_FLATNESS = 0.1  # greatest height of a ground, of its own width
_WIDER = 1.6  # times as wide as the rest, both ways, is a ground
_BELOW = 0.25  # of the rest's height above its lowest point, up to which a ground may rise
_LEAST_HEIGHT = 0.1  # of the rest, of its own width: a rug on a floor is no building on a ground
_MARGIN = 0.02  # of the rest's extent around it that stays ground


def connected_parts(corners: Float64Array) -> Int64Array:
    """Return the part (F,) of each triangle (F, 3, 3); parts share no vertex."""
    low = corners.min(axis=(0, 1))
    extent = float(np.max(corners.max(axis=(0, 1)) - low))
    cells = np.round((corners.reshape(-1, 3) - low) / max(_WELD * extent, 1e-300)).astype(np.int64)
    # At most 1e6 cells along an axis, so that one integer holds all three.
    keys = (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2]
    vertices, vertex = np.unique(keys, return_inverse=True)
    faces = np.repeat(np.arange(len(corners)), 3)
    shape = (len(corners), len(vertices))
    incidence = coo_matrix((np.ones(len(faces), dtype=np.int8), (faces, vertex)), shape=shape)
    count = sum(shape)
    rows, columns = incidence.row, incidence.col + len(corners)
    graph = coo_matrix((incidence.data, (rows, columns)), shape=(count, count))
    return connected_components(graph, directed=False)[1][: len(corners)].astype(np.int64)


def without_ground(corners: Float64Array) -> tuple[Float64Array, BoolArray]:
    """Return the triangles with grounds cut to the building's plan, and which of them are ground.

    `corners` (F, 3, 3) are upright. Without a ground they are returned as they are.
    """
    nothing = np.zeros(len(corners), dtype=bool)
    if not 1 < len(corners) <= _MOST_TRIANGLES:
        return corners, nothing
    part = connected_parts(corners)
    lows, highs = part_bounds(corners, part)
    count = len(lows)
    order = np.argsort(-np.prod(highs[:, :2] - lows[:, :2], axis=1))
    grounds: list[int] = []
    for number in order.tolist():
        rest = np.ones(count, dtype=bool)
        rest[[*grounds, number]] = False
        if not rest.any() or not _is_ground(
            lows[number], highs[number], lows[rest].min(axis=0), highs[rest].max(axis=0)
        ):
            break
        grounds.append(number)
    if not grounds:
        return corners, nothing
    is_ground = np.isin(part, grounds)
    building = corners[~is_ground]
    low, high = building.min(axis=(0, 1)), building.max(axis=(0, 1))
    margin = _MARGIN * float(np.max(high - low))
    piece = _cut_to_plan(corners[is_ground], low - margin, high + margin)
    kept = np.concatenate([building, piece])
    return kept, np.arange(len(kept)) >= len(building)


def without_backdrop(corners: Float64Array) -> Float64Array | None:
    """Return the triangles without a part that encloses all others at a distance; None without it.

    `corners` (F, 3, 3) are upright.
    """
    if not 1 < len(corners) <= _MOST_TRIANGLES:
        return None
    part = connected_parts(corners)
    lows, highs = part_bounds(corners, part)
    number = int(np.argmax(np.prod(highs - lows, axis=1)))
    rest = np.arange(len(lows)) != number
    if not rest.any():
        return None
    low, high = lows[rest].min(axis=0), highs[rest].max(axis=0)
    size = highs[number] - lows[number]
    is_around = (lows[number] <= low).all() and (highs[number] >= high).all()
    is_wider = (size[:2] >= _WIDER * (high - low)[:2]).all()
    return corners[part != number] if is_around and is_wider else None


def part_bounds(corners: Float64Array, part: Int64Array) -> tuple[Float64Array, Float64Array]:
    """Return the lowest and highest corner (N, 3) of each part; `part` (F,) is the triangles'."""
    count = int(part.max()) + 1
    lows, highs = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(lows, part, corners.min(axis=1))
    np.maximum.at(highs, part, corners.max(axis=1))
    return lows, highs


def _is_ground(
    low: Float64Array, high: Float64Array, rest_low: Float64Array, rest_high: Float64Array
) -> bool:
    """Return whether a part with bounds `low` and `high` (3,) is the ground of the rest."""
    size, rest = high - low, rest_high - rest_low
    return bool(
        size[2] <= _FLATNESS * size[:2].min()
        and (size[:2] >= _WIDER * rest[:2]).all()
        and rest[2] >= _LEAST_HEIGHT * rest[:2].max()
        and (low[:2] <= rest_low[:2]).all()
        and (high[:2] >= rest_high[:2]).all()
        and high[2] <= rest_low[2] + _BELOW * rest[2]
    )


def _cut_to_plan(corners: Float64Array, low: Float64Array, high: Float64Array) -> Float64Array:
    """Cut triangles (F, 3, 3) to a rectangle of the plan."""
    mesh = trimesh.Trimesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3),
                           process=False)  # fmt: skip
    for axis in (0, 1):
        inwards = np.eye(3)[axis]
        for origin, normal in ((low, inwards), (high, -inwards)):
            mesh = trimesh.intersections.slice_mesh_plane(mesh, normal, origin, cap=False)
    return np.asarray(mesh.triangles, dtype=np.float64).reshape(-1, 3, 3)
