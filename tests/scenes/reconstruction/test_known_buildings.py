"""Made buildings come in with the rooms, scale, up axis, portals and light that they have."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shapely.geometry import Polygon

from pbrnet.scenes.contract import Scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.registry import import_scene
from tests.fixtures import model_file as files
from tests.fixtures.buildings import BUILDINGS, Building, Part, block, furniture, slab, wall

AREA_TOLERANCE = 0.03  # share of a room's area
# Others differ from these in one thing alone, and are imported by `make check`.
SAMPLE = ("door ajar", "walls cut low", "hollow furniture", "open top on a ground plane",
         "centimetres in a glTF file", "millimetres, Z up", "open top in one mesh",
         "diorama, inches", "twice as large", "hall with a pillar", "block of earth",
         "closed basement", "basement with a window", "tall cupboards", "couch", "cup")  # fmt: skip
QUICK = ("door ajar", "hall with a pillar", "couch")  # of them, for `make quick`


def marked(name: str) -> Any:
    """A building's name, marked by the command that imports it."""
    if name in QUICK:
        return name
    return pytest.param(name, marks=pytest.mark.slow if name in SAMPLE else pytest.mark.check)


def imported(building: Building, folder: Path) -> Scene:
    return import_scene(building.save(folder / "in"), folder / "out", lamps="home")


@pytest.mark.parametrize("name", [marked(name) for name in BUILDINGS])
def test_a_known_building_comes_in_as_it_is(tmp_path: Path, name: str) -> None:
    building = BUILDINGS[name]
    scene = imported(building, tmp_path)
    is_object = any("single object" in change for change in scene.changes)
    assert is_object == building.is_object
    assert len(scene.portals) == building.portals
    assert sum(not room.has_light for room in scene.rooms) == building.unlit
    placement = scene.source["placement"]
    assert placement["kind"] == ("object" if building.is_object else "building")
    assert placement["scale"] == pytest.approx(building.scale)
    assert placement["up"] == building.up
    assert 0.5 <= placement["confidence"] <= 1
    assert any("1 unit is" in reason for reason in placement["reasons"])
    points = np.concatenate([part.quads.reshape(-1, 3) for part in building.parts])
    if building.is_object:
        own = [item for item in scene.objects if not item.is_structure and item.category != "lamp"]
        sizes = np.max([np.subtract(item.bbox_max, item.bbox_min) for item in own], axis=0)
        assert np.sort(sizes) == pytest.approx(np.sort(np.ptp(points, axis=0)), rel=0.02)
        return
    rooms = sorted(scene.rooms, key=lambda room: -Polygon(room.floor).area)
    areas = [Polygon(room.floor).area for room in rooms]
    assert areas == pytest.approx(list(building.areas), rel=AREA_TOLERANCE)
    heights = [room.ceiling_z - room.floor_z for room in rooms]
    assert all(2.3 < height < 5.1 for height in heights)
    if building.heights:
        assert heights == pytest.approx(list(building.heights), abs=0.05)


def test_a_stated_unit_holds_though_another_one_is_as_likely(tmp_path: Path) -> None:
    """A garage in inches, too large and too high for a home; the report names the other unit."""
    corners = files.POINTS * [50.0, 7.0, 15.0] / 0.0254
    path = tmp_path / "garage.dae"
    path.write_text(files.dae(geometries=files.box(corners), meter=0.0254))
    scene = import_scene(path, tmp_path / "out")
    placement = scene.source["placement"]
    assert placement["scale"] == pytest.approx(0.0254) and placement["confidence"] < 0.5
    assert any("the stated unit was taken" in reason and "centimetres" in reason
               for reason in placement["reasons"])  # fmt: skip


def test_an_unclear_unit_is_asked_for(tmp_path: Path) -> None:
    """A cube of 20 units without a name: 20 m, or 20 inches, or 20 cm."""
    cube = Building((Part("", block((0, 0, 0), (20, 20, 20))),), (), 1, is_object=True, name="x")
    with pytest.raises(InputError, match=r"--scale 0\.01 .*centimetres.*probability"):
        imported(cube, tmp_path)


def test_a_backdrop_is_no_room(tmp_path: Path) -> None:
    """One wall and a floor, with names of a room's parts."""
    parts = (slab("Floor", 6, 4, -0.1, 0), wall("Wall", (0, 4), (6, 4.2), 2.5), *furniture())
    with pytest.raises(InputError, match=r"walls stand along 3[0-9]% of the largest floor"):
        imported(Building(parts, (), 0), tmp_path)
