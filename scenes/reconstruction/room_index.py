"""Rooms by their place on the plan, to find those near a point or box among many."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.geometry.regions import buffered
from pbrnet.scenes.reconstruction.rooms import FoundRoom

_SLACK = 1e-6  # metres, against rounding


class RoomIndex:
    """Rooms, numbered from 0, with their bounds on the plan in a tree."""

    def __init__(self, rooms: Sequence[FoundRoom]) -> None:
        self.rooms = list(rooms)
        bounds = np.array([room.bounds for room in self.rooms]).reshape(-1, 4)
        self._tree = shapely.STRtree(shapely.box(*bounds.T))
        self._grown: dict[tuple[int, float], BaseGeometry] = {}

    def grown(self, number: int, margin: float) -> BaseGeometry:
        """The floor of a room grown by `margin` metres, or shrunk if that is negative."""
        key = (number, margin)
        if key not in self._grown:
            self._grown[key] = buffered(self.rooms[number].floor, margin)
        return self._grown[key]

    def near(self, low: Float64Array, high: Float64Array, margin: float) -> list[int]:
        """Numbers of the rooms within `margin` metres of a box on the plan, in ascending order.

        `low` and `high` are its corners, of which x and y count. Further rooms may be among them,
        but none that lies closer is missing.
        """
        reach = margin + _SLACK
        around = shapely.box(low[0] - reach, low[1] - reach, high[0] + reach, high[1] + reach)
        found: list[int] = np.sort(self._tree.query(around)).tolist()
        return found

    def containing(self, point: Float64Array, margin: float = 0.0) -> int | None:
        """Number of the first room that contains a point (3,), as `FoundRoom.contains`; or None."""
        return next(
            (
                number
                for number in self.near(point, point, max(margin, 0.0))
                if self.rooms[number].contains(point, margin)
            ),
            None,
        )
