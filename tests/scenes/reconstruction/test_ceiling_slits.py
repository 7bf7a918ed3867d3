"""Ceilings that end before the walls, as in loosely drawn models, reach them afterwards."""

from pathlib import Path

import numpy as np
import pytest
from shapely.geometry import Polygon

from pbrnet.scenes.contract import Scene
from pbrnet.scenes.registry import import_scene
from tests.fixtures.buildings import (
    DOOR,
    WINDOW,
    Building,
    Part,
    furniture,
    part,
    slab,
    wall,
    walls,
)

pytestmark = pytest.mark.usefixtures("few_walks")

WIDTH, DEPTH, HEIGHT = 7.15, 4.0, 2.6
CONTINUED = "ceilings that ended before the walls were continued"


def flat(*ceilings: Part) -> list[Part]:
    """Two rooms below the given ceilings, with a door between, and a window in the first."""
    return [
        slab("Floor", WIDTH, DEPTH, -0.2, 0), *ceilings,
        *walls(WIDTH, DEPTH, HEIGHT, south=[WINDOW]),
        wall("Partition", (4, 0), (4.15, DEPTH), HEIGHT, [DOOR]), *furniture(),
    ]  # fmt: skip


def ceiling(west: float, south: float, east: float, north: float, z: float = HEIGHT) -> Part:
    return part("Ceiling", ((west, south, z), (east, north, z + 0.1)))


def sheet(west: float, south: float, east: float, north: float) -> Part:
    ring = [(west, south), (west, north), (east, north), (east, south)]
    return Part("Ceiling", np.array([[(x, y, HEIGHT) for x, y in ring]]))


def imported(folder: Path, parts: list[Part]) -> Scene:
    building = Building(tuple(parts), (), 1, suffix=".glb")
    return import_scene(building.save(folder / "in"), folder / "out", lamps="home")


@pytest.mark.parametrize(
    "ceilings",
    [
        [ceiling(0.15, 0.15, 7.0, 3.85)],
        [ceiling(0.1, 0.1, 3.9, 3.9), sheet(4.3, 0.1, 7.0, 3.9)],
        [ceiling(-0.2, -0.2, 7.35, 3.6)],
    ],
)
def test_a_ceiling_is_continued_up_to_the_walls(tmp_path: Path, ceilings: list[Part]) -> None:
    scene = imported(tmp_path, flat(*ceilings))
    areas = sorted(Polygon(room.floor).area for room in scene.rooms)
    assert areas == pytest.approx([12.0, 16.0], rel=0.03)
    assert [portal.kind for portal in scene.portals] == ["window"]
    assert any(CONTINUED in change for change in scene.changes)


@pytest.mark.parametrize(
    "ceilings",
    [
        [ceiling(-0.2, -0.2, 7.35, 4.2)],
        # A suspended ceiling, with the building's own above it.
        [ceiling(0.2, 0.2, 3.8, 3.8, 2.4), ceiling(-0.2, -0.2, 7.35, 4.2)],
        # A skylight beside a wall.
        [ceiling(-0.2, -0.2, 7.35, 3.6), ceiling(-0.2, 3.6, 1, 4.2), ceiling(2, 3.6, 7.35, 4.2)],
    ],
)
def test_other_ceilings_stay_as_they_are(tmp_path: Path, ceilings: list[Part]) -> None:
    scene = imported(tmp_path, flat(*ceilings))
    assert len(scene.rooms) == 2
    assert not any(CONTINUED in change for change in scene.changes)
