"""Light leaks of imported homes: found by random walks, and sealed."""

from pathlib import Path

import numpy as np
import pytest

from pbrnet.pipeline.render.leaks import find_leaks
from pbrnet.pipeline.render.scene import open_scene
from pbrnet.scenes.contract import Scene
from pbrnet.scenes.reconstruction import gap_sealing
from pbrnet.scenes.registry import import_scene
from tests.fixtures import sweethome as draw

pytestmark = pytest.mark.usefixtures("variant")

ROOM = draw.room(0, 0, 500, 400)
# Walls that are not joined: free ends of straight walls are extended to their neighbours, but the
# bent one in the east stops 5 mm short with its closer corner of the north one.
APART = (
    draw.wall("north", (-10, -10), (510, -10))
    + draw.wall("east", (510, 1.5), (510, 410), arcExtent=0.2)
    + draw.wall("south", (500, 410), (-10, 410))
    + draw.wall("west", (-10, 400), (-10, 3))
)
# A wall below stairs, between the halves of a room: from 0.5 m up to the ceiling.
BELOW_STAIRS = draw.box_walls(-10, -10, 520, 420) + draw.wall(
    "spandrel", (250, 100), (250, 400), thickness=8, height=50, heightAtEnd=240
)
HALVES = draw.room(0, 0, 246, 400) + draw.room(246, 0, 254, 400)
# A partition below a roof from 1 m at the eaves to 2.5 m.
ROOF = (
    draw.wall("low", (0, 0), (600, 0), height=100, wallAtEnd="right", wallAtStart="left")
    + draw.wall("right", (600, 0), (600, 400), height=100, heightAtEnd=250,
                wallAtStart="low", wallAtEnd="high")
    + draw.wall("high", (600, 400), (0, 400), height=250, wallAtStart="right", wallAtEnd="left")
    + draw.wall("left", (0, 400), (0, 0), height=250, heightAtEnd=100,
                wallAtStart="high", wallAtEnd="low")
    + draw.wall("partition", (300, 0), (300, 400), height=100, heightAtEnd=250)
)  # fmt: skip
ATTIC = draw.room(10, 10, 280, 380) + draw.room(310, 10, 280, 380)


def bring(folder: Path, body: str) -> Scene:
    return import_scene(draw.pack(folder / "test.sh3d", draw.home(body)), folder / "out")


def leaks(scene: Scene) -> list[str]:
    return [str(leak) for leak in find_leaks(open_scene(scene), walks=6000)]


@pytest.mark.slow
def test_a_gap_between_walls_is_sealed(tmp_path: Path) -> None:
    scene = bring(tmp_path, APART + ROOM)
    assert any("slabs were added" in note for note in scene.changes)
    (slabs,) = [one for one in scene.objects if one.id == gap_sealing.GAP_SEALING_ID]
    assert slabs.is_structure and slabs.category == "structure"
    assert leaks(scene) == []


def test_the_gap_leaks_without_slabs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pbrnet.scenes.sweethome.importer.seal_home", lambda *_: [])
    assert leaks(bring(tmp_path, APART + ROOM))


@pytest.mark.parametrize(
    ("body", "heights"),
    [(BELOW_STAIRS + HALVES, (2.5, 2.5)), (ROOF + ATTIC, (1.75, 1.75))],
    ids=["wall below stairs", "partition below a roof"],
)
def test_ceilings_follow_walls_that_carry_them(
    tmp_path: Path, body: str, heights: tuple[float, float]
) -> None:
    scene = bring(tmp_path, body)
    assert [room.ceiling_z for room in scene.rooms] == pytest.approx(heights, abs=0.02)
    assert not any("slabs were added" in note for note in scene.changes)
    assert leaks(scene) == []


def test_a_floor_ends_at_the_walls(tmp_path: Path) -> None:
    drawn_over = draw.box_walls(-10, -10, 520, 420) + draw.room(-20, -20, 540, 440)
    (room,) = bring(tmp_path, drawn_over).rooms
    xs, ys = zip(*room.floor, strict=True)
    assert (min(xs), max(xs), min(ys), max(ys)) == pytest.approx((0, 5, -4, 0), abs=1e-4)


def test_rooms_drawn_askew_end_at_the_walls(tmp_path: Path) -> None:
    """Drawn half a metre too far to the north, a room would lie on both sides of its window."""
    body = draw.box_walls(-10, -10, 520, 420) + draw.window(x=250, y=-10)
    (room,) = (scene := bring(tmp_path, body + draw.room(0, -50, 500, 400))).rooms
    xs, ys = zip(*room.floor, strict=True)
    assert (min(xs), max(xs), min(ys), max(ys)) == pytest.approx((0, 5, -4, 0), abs=1e-4)
    assert [(portal.kind, portal.room) for portal in scene.portals] == [("window", room.id)]
    assert any("drawn across the walls" in note for note in scene.changes)


@pytest.mark.parametrize("ends", [(150, 250), (140, 260), (160, 240)])
def test_a_door_in_a_gap_between_walls_parts_two_rooms(
    tmp_path: Path, ends: tuple[int, int]
) -> None:
    """The door is a metre wide; the walls end at its sides, or up to 10 cm off, or behind them."""
    door = draw.window(name="door", x=250, y=200, elevation=0, height=210, depth=60, angle=1.5708)
    body = (
        draw.box_walls(-10, -10, 520, 420)
        + draw.wall("m1", (250, -10), (250, ends[0]))
        + draw.wall("m2", (250, ends[1]), (250, 410))
        + door
        + draw.window(x=100, y=-10)
    )
    scene = bring(tmp_path, body)
    assert [np.ptp(room.floor, axis=0).tolist() for room in scene.rooms] == [
        pytest.approx([2.4, 4]), pytest.approx([2.4, 4])
    ]  # fmt: skip
    assert [portal.kind for portal in scene.portals] == ["window"]
    assert all(room.has_light for room in scene.rooms)  # through the door's hole
    assert any("around doors and windows were closed: door" in note for note in scene.changes)
    assert leaks(scene) == []


def test_a_gap_in_a_lining_before_a_window_stays_a_recess(tmp_path: Path) -> None:
    lining = draw.wall("l1", (0, 5), (200, 5), thickness=10) + draw.wall(
        "l2", (300, 5), (500, 5), thickness=10
    )
    body = draw.box_walls(-10, -10, 520, 420) + lining + draw.window(x=250, y=-10)
    scene = bring(tmp_path, body)
    assert not any("around doors" in note for note in scene.changes)
    assert [portal.kind for portal in scene.portals] == ["window"]


@pytest.mark.parametrize("inset", [0, 6])
def test_gaps_between_walls_of_a_sketch_are_openings(tmp_path: Path, inset: int) -> None:
    """A window drawn as a low wall, doors as gaps, ceilings hidden; rooms drawn up to the walls,
    or `inset` cm beside them.
    """
    hidden = {"ceilingVisible": "false"}
    body = (
        draw.wall("n1", (-10, -10), (150, -10))
        + draw.wall("low", (150, -10), (300, -10), height=80)
        + draw.wall("n2", (300, -10), (1030, -10))
        + draw.wall("east", (1030, -10), (1030, 410))
        + draw.wall("south", (1030, 410), (-10, 410))
        + draw.wall("w1", (-10, 410), (-10, 250))
        + draw.wall("w2", (-10, 150), (-10, -10))
        + draw.wall("m1", (510, 0), (510, 150))
        + draw.wall("m2", (510, 240), (510, 400))
        + draw.room(inset, inset, 500 - inset, 400 - 2 * inset, **hidden)
        + draw.room(520, inset, 500 - inset, 400 - 2 * inset, **hidden)
        + draw.room(-300, 0, 280, 400, **hidden)
    )
    scene = bring(tmp_path, body)
    assert [room.ceiling_z for room in scene.rooms] == pytest.approx([2.5, 2.5])
    assert any("walls leave gaps" in note for note in scene.changes)
    assert {portal.kind for portal in scene.portals} == {"opening"}
    assert {portal.room for portal in scene.portals} == {"room_0"}
    sizes = [float(np.ptp(portal.polygon, axis=0).max()) for portal in scene.portals]
    assert max(sizes) < 2.7  # the height, not a side of the room
    sides = sorted(tuple(round(value) for value in portal.normal) for portal in scene.portals)
    assert sides == [(-1, 0, 0), (0, 1, 0)]
    assert scene.rooms[0].has_light
    assert inset or leaks(scene) == []
