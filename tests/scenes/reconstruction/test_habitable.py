"""Insides of furniture and of solid walls are no rooms, alone or beside others."""

import numpy as np
import pytest
import trimesh

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.reconstruction.habitable import habitable
from pbrnet.scenes.reconstruction.raycast import RayCaster
from pbrnet.scenes.reconstruction.rooms import FoundRoom, closed_rooms

BLOCK, CUPBOARD = (3.0, 2.5, 2.6), (1.6, 1.2, 2.4)  # metres


def solid(size: tuple[float, float, float], x: float = 0.0, y: float = 0.0) -> Float64Array:
    """Triangles (12, 3, 3) of a box that stands on the ground; they face outwards."""
    box = trimesh.creation.box(size)
    box.apply_translation((x, y, size[2] / 2))
    return np.asarray(box.triangles)


def rooms(*things: Float64Array) -> list[FoundRoom]:
    corners = np.concatenate(things)
    rays = RayCaster(corners)
    closed = closed_rooms(rays, corners)
    assert closed, "there is a closed space to be judged"
    return habitable(closed, rays, corners)


AROUND = [solid((0.4, 0.4, 0.45), x, y) for x in (-6.0, 6.0) for y in (-5.0, 5.0)]


@pytest.mark.parametrize("size", [BLOCK, CUPBOARD])
def test_the_inside_of_the_only_large_thing_of_a_scene_is_no_room(
    size: tuple[float, float, float],
) -> None:
    assert rooms(solid(size), *AROUND) == []


def test_a_shut_box_that_is_all_of_a_file_is_a_room_whichever_way_it_faces() -> None:
    assert len(rooms(solid(BLOCK))) == len(rooms(solid(BLOCK)[:, ::-1])) == 1


def test_a_single_empty_room_that_faces_inwards_stays() -> None:
    assert len(rooms(solid(BLOCK)[:, ::-1], *AROUND)) == 1
