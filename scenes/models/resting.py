"""Things that rest on something: evidence of what is up in a model that does not say it.

Furniture and smaller things touch a level surface below them, seldom one above. Beside them are
walls, but on one side as often as on the other.
"""

from __future__ import annotations

import numpy as np
import shapely
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from pbrnet.scenes.arrays import Float64Array, Int64Array
from pbrnet.scenes.geometry.mesh import face_areas
from pbrnet.scenes.reconstruction.surroundings import connected_parts, part_bounds

_MOST_TRIANGLES = 400_000
_MOST_PARTS = 3_000
_SMALLEST, _LARGEST = 0.005, 0.6  # of the model's extent; larger parts are floors and walls
_TOUCH = 0.003  # of that extent, within which surfaces touch
_INWARDS = 0.05  # share of the way to a thing's middle, of places at its foot
_FOOT = 0.02  # of its height, up to which points of a thing are its foot
_LEVEL = 0.7  # part of a surface's normal along the axis


def resting_shares(corners: Float64Array) -> tuple[Float64Array, int]:
    """Share (3,) of the things that touch a surface at their lower end along each axis.

    Less the share that touch one at their upper end. Also returns the number of things in the
    triangles `corners` (F, 3, 3).
    """
    if len(corners) > _MOST_TRIANGLES:
        return np.zeros(3), 0
    part = _things(corners, connected_parts(corners))
    lows, highs = part_bounds(corners, part)
    size = (highs - lows).max(axis=1)
    extent = float((highs.max(axis=0) - lows.min(axis=0)).max())
    things = np.nonzero((size >= _SMALLEST * extent) & (size <= _LARGEST * extent))[0]
    if not len(things):
        return np.zeros(3), 0
    order = np.argsort(part, kind="stable")
    starts = np.searchsorted(part[order], np.arange(len(lows) + 1))
    points = [corners[order[starts[k] : starts[k + 1]]].reshape(-1, 3) for k in things.tolist()]
    normals = face_areas(corners)[1]
    shares = np.zeros(3)
    for axis in range(3):
        level = np.nonzero(np.abs(normals[:, axis]) > _LEVEL)[0]
        surfaces = _Surfaces(corners[level], normals[level], part[level], axis)
        for sign in (1.0, -1.0):
            feet = [_foot(each, axis, sign) for each in points]
            owners = np.repeat(things, [len(each) for each in feet])
            resting = surfaces.touching(np.concatenate(feet), owners, _TOUCH * extent)
            shares[axis] += sign * len(np.unique(owners[resting])) / len(things)
    return shares, len(things)


def _things(corners: Float64Array, part: Int64Array) -> Int64Array:
    """Numbers (F,) of things: small parts that touch, such as a table's legs and its top, are one.

    Beyond `_MOST_PARTS`, small parts stay as they are.
    """
    lows, highs = part_bounds(corners, part)
    size = (highs - lows).max(axis=1)
    extent = float((highs.max(axis=0) - lows.min(axis=0)).max())
    small = np.nonzero(size <= _LARGEST * extent)[0]
    if len(small) > _MOST_PARTS:
        return part
    reach = _TOUCH * extent
    low, high = lows[small], highs[small] + reach
    meets = ((low[:, None] <= high) & (high[:, None] >= low)).all(axis=2)
    _, label = connected_components(coo_matrix(meets), directed=False)
    number = len(small) + np.arange(len(lows))
    number[small] = label
    _, thing = np.unique(number[part], return_inverse=True)
    return thing.reshape(-1).astype(np.int64)


def _foot(points: Float64Array, axis: int, sign: float) -> Float64Array:
    """Places (4, 3) at the lowest points of a thing, within its outline."""
    height = sign * points[:, axis]
    low, high = float(height.min()), float(height.max())
    foot = points[height <= low + _FOOT * (high - low)]
    flat = [k for k in range(3) if k != axis]
    chosen = [int(pick(foot[:, k])) for k in flat for pick in (np.argmin, np.argmax)]
    places = foot[chosen] + _INWARDS * (foot.mean(axis=0) - foot[chosen])
    places[:, axis] = sign * low
    return places


class _Surfaces:
    """Triangles (F, 3, 3) across an axis, with their normals (F, 3) and parts (F,)."""

    def __init__(
        self, corners: Float64Array, normals: Float64Array, part: Int64Array, axis: int
    ) -> None:
        self.axis, self.part, self.normals = axis, part, normals
        self.first = corners[:, 0]
        self.flat = [k for k in range(3) if k != axis]
        self.tree = shapely.STRtree(shapely.polygons(corners[:, :, self.flat]))

    def touching(self, places: Float64Array, owners: Int64Array, reach: float) -> Int64Array:
        """Numbers of the places (N, 3) of parts `owners` (N,) that another part touches."""
        points = shapely.points(places[:, self.flat])
        place, face = self.tree.query(points, predicate="intersects")
        away = np.sum((places[place] - self.first[face]) * self.normals[face], axis=1)
        is_near = (np.abs(away) <= reach) & (self.part[face] != owners[place])
        return np.unique(place[is_near])
