"""The wall that two rooms share."""

from __future__ import annotations

import math

import numpy as np

from pbrnet.scenes.contract import Point2
from pbrnet.scenes.procedural.plan import WallEdge

_THICKEST = 0.6  # metres between the faces of a shared wall
_LEAST = 0.3  # metres of it


def shared_wall(
    first: tuple[Point2, ...], second: tuple[Point2, ...]
) -> tuple[Point2, Point2] | None:
    """The longest stretch of the first polygon's sides that the second one runs along, in metres.

    It goes from west to east, or from south to north. None if they share none.
    """
    best: tuple[float, Point2, Point2] | None = None
    for edge in _edges(first):
        for other in _edges(second):
            if abs(float(np.dot(edge.along, other.along))) < math.cos(math.radians(2)):
                continue
            places = [edge.coordinates(point) for point in (other.start, other.end)]
            low = max(0.0, min(place[0] for place in places))
            high = min(edge.length, max(place[0] for place in places))
            away = max(abs(place[1]) for place in places)
            if away < _THICKEST and high - low > max(_LEAST, best[0] if best else 0.0):
                ends = sorted((edge.at(low), edge.at(high)))
                best = (high - low, ends[0], ends[1])
    return None if best is None else best[1:]


def _edges(polygon: tuple[Point2, ...]) -> list[WallEdge]:
    pairs = zip(polygon, polygon[1:] + polygon[:1], strict=True)
    return [WallEdge(start, end, False) for start, end in pairs if math.dist(start, end) > 1e-6]
