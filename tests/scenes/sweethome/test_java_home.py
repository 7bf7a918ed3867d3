"""Homes of versions before 5.3: the objects that they hold are read, never made."""

import random
import struct
import time
from pathlib import Path
from typing import Any

import pytest

from pbrnet.scenes.errors import InputError
from pbrnet.scenes.formats.java_objects import JavaRecord, read_java_object
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.registry import import_scene
from pbrnet.scenes.sweethome.home import Home
from pbrnet.scenes.sweethome.java_home import home_xml
from pbrnet.scenes.sweethome.reader import read_home
from tests.fixtures import sweethome as draw
from tests.fixtures.encoded import zipped
from tests.fixtures.java import Java, boxed, content, model, serialised


def wall(start: tuple[float, float], end: tuple[float, float], **more: Any) -> Java:
    return model(
        "Wall",
        xStart=float(start[0]),
        yStart=float(start[1]),
        xEnd=float(end[0]),
        yEnd=float(end[1]),
        thickness=10.0,
        leftSideShininess=0.0,
        rightSideShininess=0.0,
        **{"height": None, "level": None, "wallAtStart": None, "wallAtEnd": None, **more},
    )


def a_home(version: int = 3400, **more: Any) -> Java:
    """A room of 4 x 3 m with joined walls, a window and a box."""
    corners = [(0, 0), (400, 0), (400, 300), (0, 300)]
    walls = [wall(corners[n], corners[(n + 1) % 4]) for n in range(4)]
    for n, one in enumerate(walls):
        one.fields["wallAtEnd"] = walls[(n + 1) % 4]
        one.fields["wallAtStart"] = walls[n - 1]
    walls[0].fields |= {
        "leftSideColor": boxed("Integer", 0xFF8000),
        "height": boxed("Float", 270.0),
    }
    base = model(
        "HomePieceOfFurniture",
        name="Fenetre",
        x=200.0,
        y=0.0,
        angle=0.0,
        width=100.0,
        depth=10.0,
        height=100.0,
        elevation=90.0,
        visible=True,
        model=content("1/box.obj"),
        modelRotation=((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)),
        level=None,
    )
    window = model("HomeDoorOrWindow", base, wallThickness=1.0, wallDistance=0.0, sashes=[])
    box = model(
        "HomePieceOfFurniture",
        name="Caisse",
        x=100.0,
        y=150.0,
        width=50.0,
        depth=60.0,
        height=70.0,
        visible=True,
        model=content("1/box.obj"),
    )
    room = model(
        "Room",
        name="Salon",
        floorVisible=True,
        ceilingVisible=True,
        floorShininess=0.0,
        ceilingShininess=0.0,
        floorColor=boxed("Integer", 0x336699),
        points=((5.0, 5.0), (395.0, 5.0), (395.0, 295.0), (5.0, 295.0)),
    )
    fields = {
        "version": version,
        "wallHeight": 250.0,
        "groundColor": 0x808080,
        "skyColor": 0xCCE4FC,
        "name": "maison.sh3d",
        "walls": walls,
        "rooms": [room],
        "levels": [],
        "furniture": [],
        "furnitureWithDoorsAndWindows": [window, box],
        **more,
    }
    return model("Home", **fields)


def read(home: Java) -> tuple[Home, Changes]:
    changes = Changes()
    return read_home(Path("old.sh3d"), home_xml(serialised(home), "old.sh3d"), changes), changes


@pytest.mark.parametrize("version", [1000, 1800, 2400, 3400, 5200])
def test_every_version_gives_the_same_rooms_walls_and_furniture(version: int) -> None:
    home, _ = read(a_home(version))
    assert home.version == version and home.name == "maison.sh3d"
    assert [one.height for one in home.walls] == [270.0, 250.0, 250.0, 250.0]
    assert home.walls[0].left.color == 0xFF8000 and home.walls[1].left.color is None
    assert [one.wall_at_end for one in home.walls] == ["wall1", "wall2", "wall3", "wall0"]
    assert home.rooms[0].name == "Salon" and len(home.rooms[0].points) == 4
    assert home.rooms[0].floor.color == 0x336699
    window, box = home.pieces
    assert window.cut is not None and box.cut is None
    assert window.rotation == ((1, 0, 0), (0, 0, -1), (0, 1, 0)) and box.rotation is None
    assert (box.width, box.depth, box.height) == (50, 60, 70) and box.model == "1/box.obj"


def test_the_ground_of_old_versions_is_darkened_as_the_application_does() -> None:
    assert read(a_home(3400))[0].environment.ground_color == 0x606060
    assert read(a_home(3500))[0].environment.ground_color == 0x808080


def test_the_newest_list_of_furniture_counts() -> None:
    chair = model("HomePieceOfFurniture", name="chair", x=0.0, y=0.0, width=1.0, depth=1.0,
                  height=1.0, visible=True)  # fmt: skip
    group = model("HomeFurnitureGroup", model("HomePieceOfFurniture", name="group", visible=True),
                  furniture=[chair])  # fmt: skip
    home, _ = read(a_home(furnitureWithGroups=[group]))
    assert [piece.name for piece in home.pieces] == ["chair"]


@pytest.mark.slow
def test_an_old_home_comes_in_as_a_room(tmp_path: Path) -> None:
    path = tmp_path / "old.sh3d"
    path.write_bytes(zipped({"Home": serialised(a_home()), "1/box.obj": draw.BOX}))
    scene = import_scene(path, tmp_path / "scene", lamps="home")
    assert len(scene.rooms) == 1 and len(scene.portals) == 1
    assert [one.name for one in scene.objects if not one.is_structure] == ["Caisse"]
    assert any("before 5.3" in change for change in scene.changes)


def test_a_long_chain_of_joined_walls_is_read() -> None:
    """Objects that refer to one another are nested in the stream as deep as the chain is long."""
    data = bytearray(struct.pack(">HH", 0xACED, 5))
    count = 5_000
    for n in range(count):
        if n == 0:
            data += b"\x73\x72\x00\x01W" + struct.pack(">qBH", 1, 2, 1)
            data += b"L\x00\x04next\x74\x00\x03LW;\x78\x70"
        else:
            data += b"\x73\x71" + struct.pack(">I", 0x7E0000)
    data += b"\x70"
    first = read_java_object(bytes(data), "chain")
    length = 0
    while isinstance(first, JavaRecord):
        length, first = length + 1, first["next"]
    assert length == count


def test_objects_of_other_classes_are_no_home() -> None:
    evil = Java("java.lang.ProcessBuilder", {"command": ["touch", "/tmp/x"]})
    assert read_java_object(serialised(evil), "x").kind == "java.lang.ProcessBuilder"
    with pytest.raises(InputError, match=r"old\.sh3d: Java objects, but no home"):
        home_xml(serialised(evil), "old.sh3d")


@pytest.mark.parametrize(
    "home",
    [
        a_home(walls=["no wall"]),
        a_home(walls=3),
        a_home(rooms=[model("Room", points=((1.0,),))]),
        a_home(furnitureWithDoorsAndWindows=[model("HomeLight", lightSources=[None])]),
        a_home(compass="north"),
    ],
)
def test_fields_of_a_wrong_kind_are_refused(home: Java) -> None:
    with pytest.raises(InputError, match=r"^old\.sh3d"):
        read(home)


def test_cut_and_flipped_streams_end_in_one_line_and_soon() -> None:
    whole = serialised(a_home())
    rng = random.Random(0)
    cases = [whole[:cut] for cut in range(0, len(whole), 97)]
    for _ in range(200):
        data = bytearray(whole)
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        cases.append(bytes(data))
    started = time.process_time()
    refused = 0
    for data in cases:
        try:
            read_home(Path("old.sh3d"), home_xml(data, "old.sh3d"), Changes())
        except InputError as error:
            refused += 1
            assert str(error).startswith("old.sh3d") and "\n" not in str(error)
    assert refused >= len(range(0, len(whole), 97))  # all that are cut, and some of the others
    assert time.process_time() - started < 60


def test_an_array_that_claims_two_billion_elements_is_refused() -> None:
    data = struct.pack(">HH", 0xACED, 5) + b"\x75\x72\x00\x02[F" + struct.pack(">qBH", 1, 2, 0)
    with pytest.raises(InputError, match="damaged Java objects"):
        read_java_object(data + b"\x78\x70" + struct.pack(">I", 2**31 - 1), "x")
