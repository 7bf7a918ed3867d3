"""Unusual but valid homes: each is imported, and the result is plausible."""

from pathlib import Path

import numpy as np
import pytest

from pbrnet.pipeline.render.leaks import find_leaks
from pbrnet.pipeline.render.scene import open_scene, set_variant
from pbrnet.scenes.contract import Scene
from pbrnet.scenes.registry import import_scene
from tests.fixtures import model_file as files
from tests.fixtures import sweethome as draw

MEMBERS: dict[str, str | bytes] = {
    "0/box.obj": draw.BOX,
    "box": draw.BOX,
    "0/my model.obj": draw.BOX.replace("usemtl", "mtllib my model.mtl\nusemtl", 1),
    "0/my model.mtl": "newmtl amber\nKd 1 0 0\nmap_Kd no such.png\n",
    "9/m.dae": files.dae(),
    "9/m.3ds": files.file_3ds(),
    "ContentDigests": "ContentDigests 1.0\n\nName: box\nSHA-1-Digest: x\n",
}
LEVELS = (
    "<level id='a' name='a' elevation='{}' floorThickness='12' height='250'/>"
    "<level id='b' name='b' elevation='{}' floorThickness='12' height='250'/>"
)


def storey(level: str, x: float = 0.0) -> str:
    return draw.box_walls(x, 0, 420, 320, tag=level, level=level) + draw.room(
        x + 10, 10, 400, 300, level=level
    )


def bring(folder: Path, xml: str | bytes) -> Scene:
    path = draw.pack(folder / "test.sh3d", xml, MEMBERS)
    return import_scene(path, folder / "out", lamps="home")


def items(scene: Scene) -> int:
    return sum(not item.is_structure for item in scene.objects)


BOX = draw.piece(model="0/box.obj", x=100, y=100)
WALLS = draw.box_walls(0, 0, 420, 320)
LINES = draw.box_walls(0, 0, 420, 320, thickness=0) + draw.room(0, 0, 420, 320)
PLAN = (
    "<polyline><point x='0' y='0'/></polyline><label x='1' y='1'><text>a</text></label>"
    "<dimensionLine xStart='0' yStart='0' xEnd='3' yEnd='3' offset='1'/>"
    "<backgroundImage image='3'/>"
)
LOST_IMAGE = draw.piece(
    "pieceOfFurniture", "<texture name='x' width='10' height='10' image='78'/>",
    model="0/my model.obj", x=100, y=100,
)  # fmt: skip
GROUPS = (
    "<furnitureGroup name='g' x='1' y='1' width='1' depth='1' height='1'>"
    f"<furnitureGroup name='h'>{draw.lamp(x=100, y=100)}{BOX}</furnitureGroup>"
    "<furnitureGroup name='empty'/></furnitureGroup>"
)
UTF_16 = draw.usual(BOX).replace("version='1.0'?>", "version='1.0' encoding='UTF-16'?>")
# Body -> rooms and things it holds.
HOMES: dict[str, tuple[str | bytes, int, int]] = {
    "of 5.3": (draw.home(WALLS + draw.room(10, 10, 400, 300) + BOX, version=5300), 1, 1),
    "without a version": (draw.usual(BOX).replace("version='7200'", ""), 1, 1),
    "walls alone": (draw.home(WALLS + BOX), 1, 1),
    "walls that are open": (draw.home(draw.wall("a", (0, 0), (400, 0)) + BOX), 0, 1),
    "walls as lines": (draw.home(LINES + BOX), 1, 1),
    "a wall without length": (draw.usual(draw.wall("z", (200, 100), (200, 100)) + BOX), 1, 1),
    "a wall without height": (draw.usual(draw.wall("z", (200, 0), (200, 320), height=0)), 1, 0),
    "walls without own heights": (draw.usual(BOX).replace("height='250'", ""), 1, 1),
    "levels side by side": (
        draw.home(LEVELS.format(0, 0) + storey("a") + storey("b", 500) + BOX), 2, 1),
    "a cellar": (draw.home(LEVELS.format(-262, 0) + storey("a") + storey("b")), 2, 0),
    "walls of a level that is gone": (draw.home(storey("gone")), 1, 0),
    "a room drawn twice, one in it": (
        draw.usual(draw.room(10, 10, 400, 300) + draw.room(100, 100, 200, 100)), 2, 0),
    "rooms of two points": (
        draw.usual("<room><point x='1' y='1'/><point x='2' y='2'/></room><room/>"), 1, 0),
    "pieces without size": (draw.usual(draw.piece(model="box", x=50, y=50, width=0) + BOX), 1, 1),
    # Doors belong to the building.
    "a door in no wall": (
        draw.usual(draw.piece("doorOrWindow", model="box", x=200, y=160, width=90)), 1, 0),
    "a window as wide as its wall": (draw.usual(draw.window(x=210, y=0, width=400) + BOX), 1, 1),
    "lamps in groups in groups": (draw.usual(GROUPS), 1, 2),
    "a lamp without sources": (draw.usual(draw.piece("light", model="box", x=100, y=100)), 1, 1),
    "plans' words and pictures": (draw.usual(PLAN + BOX), 1, 1),
    "images that are gone": (draw.usual(LOST_IMAGE), 1, 1),
    "a time zone that nobody knows": (
        draw.usual("<compass x='5' y='5' longitude='-1.3' latitude='0.7' timeZone='No/Where'/>"),
        1, 0),
    "other models": (draw.usual(draw.piece(model="9/m.dae", x=100, y=100)
                                + draw.piece(model="9/m.3ds", x=250, y=100)), 1, 2),
    "UTF-16": (UTF_16.encode("utf-16"), 1, 1),
    "a byte order mark": (b"\xef\xbb\xbf" + draw.usual(BOX).encode(), 1, 1),
}  # fmt: skip
DARK = {"of 5.3", "walls alone", "walls as lines", "a cellar", "a room drawn twice, one in it",
        "levels side by side", "a window as wide as its wall", "other models"}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", HOMES)
def test_it_comes_in_and_its_rooms_are_dark_with_portals_closed(tmp_path: Path, name: str) -> None:
    xml, rooms, count = HOMES[name]
    scene = bring(tmp_path, xml)
    assert len(scene.rooms) == rooms
    assert items(scene) == count
    if name in DARK:
        set_variant("auto")
        leaks = find_leaks(open_scene(scene), walks=800)
        assert not leaks, str(leaks[0])


def test_walls_as_lines_stand_where_they_are_drawn(tmp_path: Path) -> None:
    scene = bring(tmp_path, HOMES["walls as lines"][0])
    walls = [item for item in scene.objects if item.category == "wall"]
    low = np.min([wall.bbox_min for wall in walls], axis=0)
    high = np.max([wall.bbox_max for wall in walls], axis=0)
    assert low[:2] == pytest.approx([0, -3.2], abs=0.006)
    assert high[:2] == pytest.approx([4.2, 0], abs=0.006)
    assert any("drawn as lines" in change for change in scene.changes)


@pytest.mark.parametrize("visible", ["true", "false"])
def test_a_hidden_ceiling_is_shown_where_walls_enclose_the_room(
    tmp_path: Path, visible: str
) -> None:
    body = draw.home(
        draw.box_walls(0, 0, 420, 320)
        + draw.room(10, 10, 400, 300, name="Room", ceilingVisible=visible)
        + draw.box_walls(600, 0, 420, 320, tag="b", height=90)
        + draw.room(610, 10, 400, 300, name="Terrace", ceilingVisible="false")
    )
    scene = import_scene(draw.pack(tmp_path / "a.sh3d", body), tmp_path / "scene")
    assert [(room.name, round(room.ceiling_z, 2)) for room in scene.rooms] == [("Room", 2.5)]
    noted = [change for change in scene.changes if "hidden ceilings" in change]
    assert len(noted) == (visible == "false") and all("Room" in change for change in noted)


@pytest.mark.parametrize("name", ["/Users/somebody/Desktop/cottage.sh3d", r"C:\homes\cottage.sh3d"])
def test_folders_in_a_home_s_name_stay_private(tmp_path: Path, name: str) -> None:
    scene = bring(tmp_path, draw.usual(name=name))
    assert scene.credits[0].title == "cottage"


def test_a_bent_floor_belongs_to_the_room_that_it_fills(tmp_path: Path) -> None:
    """A corridor around a bedroom, and a terrace around both: the middle of both is the bedroom."""

    def bent(low: float, high: float, width: float, **more: object) -> str:
        inner = low + width
        corners = [(low, low), (high, low), (high, inner), (inner, inner), (inner, high)]
        points = "".join(f"<point x='{x}' y='{y}'/>" for x, y in [*corners, (low, high)])
        given = " ".join(f"{key}='{value}'" for key, value in more.items())
        return f"<room {given}>{points}</room>"

    body = (
        draw.box_walls(0, 0, 600, 600)
        + draw.wall("across", (200, 200), (600, 200))
        + draw.wall("along", (200, 200), (200, 600))
        + draw.room(210, 210, 380, 380, name="Bedroom")
        + bent(10, 590, 180, name="Corridor")
        + bent(-300, 1000, 280, name="Terrace", ceilingVisible="false")
    )
    home = bring(tmp_path, draw.home(body))
    named = {room.name: room.id for room in home.rooms}
    rooms = {item.name: item.room for item in home.objects}
    for kind in ("floor", "ceiling"):
        assert rooms[f"Bedroom {kind}"] == named["Bedroom"]
        assert rooms[f"Corridor {kind}"] == named["Corridor"]
    assert named.keys() == {"Bedroom", "Corridor"}
    assert rooms["Terrace floor"] is None
