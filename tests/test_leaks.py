"""The dark-house test finds gaps that light would come through, and only those."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from click.testing import CliRunner
from stages_fixtures import write_room

from pipeline.cli import cli
from pipeline.leaks import blocked, find_leaks
from pipeline.renderer import open_scene, set_variant
from scenes.contract import Portal, Scene, load_scene, save_scene
from scenes.registry import import_scene

SIZE = (4.0, 3.0, 2.6)
EAST = ((4.0, 0.0, 0.0), (4.0, 3.0, 0.0), (4.0, 3.0, 2.6), (4.0, 0.0, 2.6))


def room(folder: Path, without: str = "", portals: tuple[Portal, ...] = ()) -> Scene:
    """A closed room, or one that lacks a wall, or has portals where it does."""
    scene = write_room(folder, size=SIZE)
    file = folder / "scene.xml"
    tree = ElementTree.parse(file)
    for shape in tree.getroot().findall("shape"):
        if shape.get("id") == without:
            tree.getroot().remove(shape)
    tree.write(file)
    kept = tuple(thing for thing in scene.objects if thing.id != without)
    save_scene(folder, replace(scene, objects=kept, portals=portals))
    return load_scene(folder)


@pytest.fixture(autouse=True)
def renderer() -> None:
    set_variant("auto")


def test_a_closed_room_is_dark(tmp_path: Path) -> None:
    assert find_leaks(open_scene(room(tmp_path / "closed")), walks=500) == []


def test_a_missing_wall_is_found_and_a_portal_in_it_mends_it(tmp_path: Path) -> None:
    (leak,) = find_leaks(open_scene(room(tmp_path / "open", "wall-e")), walks=500)
    assert leak.room == "living" and leak.share > 0.3
    assert all(-0.01 <= value <= most + 0.01 for value, most in zip(leak.point, SIZE, strict=True))
    _x, y, z = np.array(leak.point) + (4.0 - leak.point[0]) / leak.direction[0] * np.array(
        leak.direction
    )
    assert leak.direction[0] > 0 and 0 <= y <= 3 and 0 <= z <= 2.6, "it points at the missing wall"
    assert "living" in str(leak)

    whole = Portal("gap", "opening", EAST, (1.0, 0.0, 0.0), True, "living")
    assert find_leaks(open_scene(room(tmp_path / "mended", "wall-e", (whole,))), walks=500) == []
    low = tuple((x, y, 0.9 * z) for x, y, z in EAST)
    half = replace(whole, polygon=low)
    (left,) = find_leaks(open_scene(room(tmp_path / "half", "wall-e", (half,))), walks=2000)
    assert 0 < left.share < leak.share


def test_portals_block_what_crosses_them_and_nothing_else() -> None:
    portal = Portal("p", "window", EAST, (1.0, 0.0, 0.0), True)
    origins = np.array([[2.0, 1.5, 1.0]] * 4)
    ways = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [1 / np.sqrt(2), 0, 1 / np.sqrt(2)]])
    far, near = np.full(4, np.inf), np.full(4, 1.0)
    assert blocked((portal,), origins, ways, far).tolist() == [True, False, False, False]
    assert not blocked((portal,), origins, ways, near).any(), "something stands before it"


def test_inspect_says_where_light_leaks(tmp_path: Path) -> None:
    room(tmp_path / "open", "ceiling")
    told = CliRunner().invoke(cli, ["inspect", str(tmp_path / "open"), "--leaks", "--text-only"])
    assert told.exit_code == 0, told.output
    assert "light leaks into living" in told.output
    room(tmp_path / "closed")
    told = CliRunner().invoke(cli, ["inspect", str(tmp_path / "closed"), "--leaks", "--text-only"])
    assert "no light gets in" in told.output


def test_light_enters_a_real_room_by_its_windows(shared_scenes: Path, tmp_path: Path) -> None:
    """Arched windows whose frames stand deep in splayed holes, and radiators in the niches below:
    what passes beside the portals found for them is next to nothing."""
    file = shared_scenes / "mitsuba" / "grey-white-room" / "scene.xml"
    scene = open_scene(import_scene(file, tmp_path / "room"))
    assert len(scene.scene.portals) == 4
    assert sum(leak.share for leak in find_leaks(scene)) < 0.02
    bare = replace(scene, scene=replace(scene.scene, portals=()))
    (leak,) = find_leaks(bare)
    assert leak.share > 0.2, "without portals the windows are leaks"
