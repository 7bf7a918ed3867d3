"""Plain ceiling lamps: one in a room, several in a hall or a corridor with corners."""

import numpy as np
import pytest
import shapely
from shapely.geometry import Polygon, box

from pbrnet.scenes.importing.light.ceiling_lamps import (
    LUMENS_PER_AREA,
    CeilingLamp,
    free_ceiling_lamps,
)
from pbrnet.scenes.reconstruction.raycast import RayCaster
from pbrnet.scenes.reconstruction.rooms import FoundRoom

HEIGHT = 2.5
CORRIDOR = Polygon([(0, 0), (9, 0), (9, 9), (7.6, 9), (7.6, 1.4), (0, 1.4)])


def lamps(floor: Polygon) -> list[CeilingLamp]:
    """The lamps of a room below a level ceiling."""
    west, south, east, north = floor.buffer(1).bounds
    low, high = [west, south, HEIGHT], [east, north, HEIGHT]
    one, two = [east, south, HEIGHT], [west, north, HEIGHT]
    return free_ceiling_lamps(
        FoundRoom(floor, 0.0, HEIGHT), RayCaster(np.array([[low, one, high], [low, high, two]]))
    )


def test_a_usual_room_has_one_lamp_over_its_middle() -> None:
    (lamp,) = lamps(box(0, 0, 5, 4))
    assert lamp.centre[:2] == pytest.approx((2.5, 2), abs=0.6)
    assert lamp.lumens == pytest.approx(20 * LUMENS_PER_AREA)


@pytest.mark.parametrize(
    ("floor", "least"), [(CORRIDOR, 2), (box(0, 0, 20, 15), 3)], ids=["corridor", "hall"]
)
def test_lamps_are_in_sight_of_most_of_a_floor(floor: Polygon, least: int) -> None:
    found = lamps(floor)
    assert least <= len(found) <= 16
    assert sum(lamp.lumens for lamp in found) >= 0.4 * LUMENS_PER_AREA * floor.area
    west, south, east, north = floor.bounds
    rng = np.random.default_rng(0)
    points = rng.uniform((west, south), (east, north), (2000, 2))
    points = points[shapely.contains_xy(floor, points[:, 0], points[:, 1])]
    sights = [
        shapely.covers(floor, shapely.linestrings([[lamp.centre[:2], p] for p in points]))
        & (np.linalg.norm(points - lamp.centre[:2], axis=1) < 6.5)
        for lamp in found
    ]
    assert np.any(sights, axis=0).mean() > 0.75
    assert all(floor.contains(shapely.Point(lamp.centre[:2])) for lamp in found)
