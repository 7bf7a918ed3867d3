"""Ways between rooms: an open door is one, a crack is none."""

import numpy as np
import pytest
from shapely.geometry import box

from pbrnet.scenes.reconstruction.connections import ARCHWAY, connected_rooms
from pbrnet.scenes.reconstruction.raycast import RayCaster
from pbrnet.scenes.reconstruction.rooms import FoundRoom
from tests.fixtures.buildings import Part, block


def quads_of(*boxes: tuple[tuple[float, float, float], tuple[float, float, float]]) -> np.ndarray:
    """Triangles (F, 3, 3) of boxes."""
    quads = np.concatenate([Part("", block(*each)).quads for each in boxes])
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


@pytest.mark.parametrize(
    ("width", "is_way", "is_wide"),
    [(0.0, False, False), (0.05, False, False), (0.8, True, False), (3.0, True, True)],
)
def test_rooms_are_connected_by_a_door_and_not_by_a_crack(
    width: float, is_way: bool, is_wide: bool
) -> None:
    """Two rooms of 4 m by 3 m, and a doorway of 2.1 m height between them."""
    walls = [
        ((4.0, 0, 0), (4.1, 3 - width, 2.5)),
        ((4.0, 0, 2.1), (4.1, 3, 2.5)),
        ((0, 0, -0.1), (8.1, 3, 0)),
        ((0, 0, 2.5), (8.1, 3, 2.6)),
        ((0, -0.1, 0), (8.1, 0, 2.5)),
        ((0, 3, 0), (8.1, 3.1, 2.5)),
        ((-0.1, 0, 0), (0, 3, 2.5)),
        ((8.1, 0, 0), (8.2, 3, 2.5)),
    ]
    rooms = [FoundRoom(box(0, 0, 4, 3), 0.0, 2.5), FoundRoom(box(4.1, 0, 8.1, 3), 0.0, 2.5)]
    rays = RayCaster(quads_of(*walls))
    assert connected_rooms(rays, rooms) == ([(0, 1)] if is_way else [])
    assert connected_rooms(rays, rooms, ARCHWAY) == ([(0, 1)] if is_wide else [])
