"""An index of rooms finds the same rooms as asking each of them."""

import numpy as np
import pytest
import shapely

from pbrnet.scenes.geometry.regions import buffered
from pbrnet.scenes.reconstruction.room_index import RoomIndex
from pbrnet.scenes.reconstruction.rooms import FoundRoom


def rooms(count: int) -> list[FoundRoom]:
    """Rooms of two storeys, some of which overlap."""
    rng = np.random.default_rng(3)
    made = []
    for number in range(count):
        x, y = rng.uniform(0, 20, 2)
        width, depth = rng.uniform(1, 6, 2)
        floor = shapely.Polygon([(x, y), (x + width, y), (x + 0.7 * width, y + depth)])
        low = 3.0 * (number % 2)
        made.append(FoundRoom(floor, low, low + 2.6))
    return made


@pytest.mark.parametrize("margin", [-0.1, 0.0, 0.1, 0.8])
def test_the_first_room_that_contains_a_point(margin: float) -> None:
    found = rooms(40)
    index = RoomIndex(found)
    inside = 0
    for point in np.random.default_rng(4).uniform(-1, 27, (300, 3)) * [1, 1, 0.25]:
        expected = next(
            (number for number, room in enumerate(found) if contains(room, point, margin)), None
        )
        assert index.containing(point, margin) == expected
        inside += expected is not None
    assert 20 < inside < 290


def contains(room: FoundRoom, point: np.ndarray, margin: float) -> bool:
    """Return whether a room contains a point, by the distance to its floor alone."""
    place = shapely.Point(point[:2])
    high_enough = room.floor_z - margin <= point[2] <= room.ceiling_z + margin
    if margin > 0:
        return bool(high_enough and room.floor.distance(place) < margin)
    within = room.floor.contains(place) and room.floor.boundary.distance(place) > -margin
    return bool(high_enough and within)


def test_no_room_near_a_box_is_missing() -> None:
    found = rooms(40)
    index = RoomIndex(found)
    for low in np.random.default_rng(5).uniform(-1, 27, (50, 3)):
        high = low + 2.0
        region = shapely.box(*low[:2], *high[:2])
        near = index.near(low, high, 0.3)
        assert near == sorted(near)
        for number, room in enumerate(found):
            assert number in near or room.floor.distance(region) > 0.3


def test_grown_floors_are_those_of_the_rooms() -> None:
    found = rooms(3)
    index = RoomIndex(found)
    for _ in range(2):  # made, then remembered
        assert index.grown(1, -0.05).equals(buffered(found[1].floor, -0.05))
        assert index.grown(2, 0.3).equals(buffered(found[2].floor, 0.3))


def test_without_rooms_nothing_is_found() -> None:
    assert RoomIndex([]).containing(np.zeros(3), 1.0) is None
