"""Up axis and unit of length of a scene whose file does not state them.

Input: triangles (F, 3, 3) in the file's axes and units. Output: the up axis, a rotation that
makes it +Z, and the factor to metres.

The up axis is the one with the most area of level triangles at both ends of the scene, where
floors and ceilings are. Vertical rays give the height between floor and ceiling; the unit is the
one that makes this height that of a usual room.
"""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.geometry.mesh import face_areas
from pbrnet.scenes.reconstruction.raycast import RayCaster

ROOM_HEIGHTS = (2.0, 6.5)  # metres between floor and ceiling of a usual room, least and most
_USUAL_HEIGHT = 2.7
_UNITS = {
    "centimetres": 0.01,
    "millimetres": 0.001,
    "inches": 0.0254,
    "feet": 0.3048,
    "decimetres": 0.1,
    "kilometres": 1000.0,
}
_MAX_SURFACES = 48
_STRAIGHT = 0.98  # least cosine between a view and an axis that it is along
_MORE_LEVEL = 1.3  # times as much level area


def signed_axis(vector: Float64Array) -> Float64Array:
    """Return the signed coordinate axis (3,) nearest to `vector` (3,)."""
    axis = np.zeros(3)
    largest = int(np.argmax(np.abs(vector)))
    axis[largest] = 1.0 if vector[largest] >= 0 else -1.0
    return axis


def up_from_geometry(corners: Float64Array, default: Float64Array) -> Float64Array:
    """Return the axis (3,) with the most area of level triangles at both ends of the scene.

    Returns `default` unless another axis is far ahead.
    """
    shares = _level_areas(corners)
    best = int(np.argmax(shares))
    guess = int(np.argmax(np.abs(default)))
    # Walls are as flat as floors, so another axis must be far ahead.
    if best == guess or shares[best] < 3 * shares[guess]:
        return default
    return np.eye(3)[best]


def _level_areas(corners: Float64Array) -> Float64Array:
    """Area (3,) of the triangles across each axis that lie at both ends of the scene."""
    areas, normals = face_areas(corners)
    centres = corners.mean(axis=1)
    shares = np.zeros(3)
    for axis in range(3):
        along = centres[:, axis]
        low, high = along.min(), along.max()
        edge = 0.08 * max(high - low, 1e-9)
        level = np.abs(normals[:, axis]) > 0.95
        ends = (along < low + edge) | (along > high - edge)
        shares[axis] = areas[level & ends].sum()
    return shares


def looks_down(corners: Float64Array, up: Float64Array, forward: Float64Array) -> bool:
    """Return whether a camera with `up` and `forward` (3,) seems to look straight down or up.

    It looks along an axis that has more floor and ceiling across it than its `up`.
    """
    shares = _level_areas(corners)
    along, across = (int(np.argmax(np.abs(one))) for one in (forward, up))
    straight = abs(float(forward[along])) > _STRAIGHT * float(np.linalg.norm(forward))
    return straight and shares[along] > _MORE_LEVEL * shares[across]


def upright(up: Float64Array) -> Float64Array:
    """Return a rotation (3, 3) that turns the axis `up` to +Z.

    For Y up it maps (x, y, z) to (x, -z, y).
    """
    axis = int(np.argmax(np.abs(up)))
    sign = 1.0 if up[axis] > 0 else -1.0
    if axis == 2:
        return np.eye(3) if sign > 0 else np.diag([1.0, -1.0, -1.0])
    turn = np.zeros((3, 3))
    keep = 0 if axis == 1 else 1
    turn[0, keep] = 1.0
    turn[2] = sign * np.eye(3)[axis]
    turn[1] = np.cross(turn[2], turn[0])
    return turn


def surface_heights(
    rays: RayCaster, points: Float64Array, low: float, high: float
) -> list[Float64Array]:
    """Return, for each of `points` (N, 2), the heights of the surfaces on a vertical line.

    Heights are sorted upwards; `low` and `high` bound the scene.
    """
    step = 1e-5 * max(high - low, 1e-6)
    heights: list[list[float]] = [[] for _ in points]
    start = np.full(len(points), low - 10 * step)
    alive = np.arange(len(points))
    for _ in range(_MAX_SURFACES):
        if not len(alive):
            break
        origins = np.column_stack([points[alive], start[alive]])
        distance, _ = rays.cast(origins, np.array([0.0, 0.0, 1.0]))
        hit = np.isfinite(distance)
        alive = alive[hit]
        found = start[alive] + distance[hit]
        for index, height in zip(alive.tolist(), found.tolist(), strict=True):
            heights[index].append(height)
        start[alive] = found + step
    return [np.array(column) for column in heights]


def upright_columns(
    corners: Float64Array, cell: float, tall: float, steepest: float = 0.1
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return lowest and highest ends (N,) and areas (N,) of upright faces above cells of the plan.

    The faces (F, 3, 3) of a finely divided wall tell its height only together; those that are
    at least `tall` themselves stand alone. `steepest` is the greatest vertical part of normals; a
    face belongs to the cell of its middle.
    """
    areas, normals = face_areas(corners)
    chosen = (np.abs(normals[:, 2]) < steepest) & (areas > 0)
    areas, faces = areas[chosen], corners[chosen]
    if not len(faces):
        return np.empty(0), np.empty(0), np.empty(0)
    places = np.floor(faces.mean(axis=1)[:, :2] / cell).astype(np.int64)
    _, number = np.unique(places, axis=0, return_inverse=True)
    number = number.ravel()
    alone = np.flatnonzero(np.ptp(faces[:, :, 2], axis=1) >= tall)
    number[alone] = int(number.max()) + 1 + np.arange(len(alone))
    number = np.unique(number, return_inverse=True)[1].ravel()
    count = int(number.max()) + 1
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(low, number, faces[:, :, 2].min(axis=1))
    np.maximum.at(high, number, faces[:, :, 2].max(axis=1))
    return low, high, np.bincount(number, areas, count).astype(np.float64)


def tallest_gaps(columns: list[Float64Array], through: float | None) -> Float64Array:
    """Return the tallest free interval (low, high) of each column, (M, 2).

    With `through`, the interval that contains this height instead. Columns without one are
    skipped.
    """
    gaps = []
    for column in columns:
        if len(column) < 2:
            continue
        if through is not None:
            above = int(np.searchsorted(column, through))
            if 0 < above < len(column):
                gaps.append((column[above - 1], column[above]))
        else:
            tallest = int(np.argmax(np.diff(column)))
            gaps.append((column[tallest], column[tallest + 1]))
    return np.array(gaps).reshape(-1, 2)


def guess_scale(height: float) -> tuple[float, str]:
    """Return the factor to metres for a room `height` units high, and the name of the unit."""
    low, high = ROOM_HEIGHTS
    if low <= height <= high:
        return 1.0, "metres"
    fitting = [
        (abs(np.log(height * factor / _USUAL_HEIGHT)), factor, name)
        for name, factor in _UNITS.items()
        if low <= height * factor <= high
    ]
    if fitting:
        _, factor, name = min(fitting)
        return factor, name
    return _USUAL_HEIGHT / height, f"units of {_USUAL_HEIGHT / height:.3g} m"
