"""Assembly of scenes without rooms."""

from pathlib import Path

import pytest
from shapely.geometry import box

from pbrnet.scenes.importing.assembly import _with_some_room
from pbrnet.scenes.importing.changes import NO_ROOM, Changes
from pbrnet.scenes.reconstruction.rooms import FoundRoom
from pbrnet.scenes.registry import import_scene
from tests.fixtures.rooms import Block, shell, write_obj


def test_without_rooms_the_file_bounds_the_room_not_the_added_ground(tmp_path: Path) -> None:
    posts = [Block(f"post{x}", (x, x, 0), (x + 0.2, x + 0.2, 2.5)) for x in (1, 7)]
    path = write_obj(tmp_path / "in" / "yard.obj", [Block("slab", (0, 0, -0.1), (9, 8, 0)), *posts])
    scene = import_scene(path, tmp_path / "out", up="z", scale=1.0)
    assert any(item.category == "ground" for item in scene.objects)
    assert any("NO ROOM WAS FOUND" in note for note in scene.changes)
    xs, ys = zip(*scene.rooms[0].floor, strict=True)
    assert (min(xs), max(xs), min(ys), max(ys)) == (0, 9, 0, 8)


@pytest.mark.parametrize(
    ("depth", "has_camera", "is_room"), [(3, True, True), (3, False, False), (0.5, True, False)]
)
def test_only_what_a_camera_sees_is_a_room_without_a_warning(
    depth: float, has_camera: bool, is_room: bool
) -> None:
    changes = Changes()
    guess = FoundRoom(box(0, 0, 4, depth), 0.0, 2.5, guessed=True)
    rooms, _, is_closed = _with_some_room([guess], ["room_0"], guess, has_camera, changes)
    assert rooms == [guess] and is_closed == [False]
    (note,) = changes.sentences()
    assert note.startswith(NO_ROOM) != is_room


@pytest.mark.parametrize("thing", ["block", "sofa", "toilet"])
def test_rooms_without_furniture_are_named(thing: str, tmp_path: Path) -> None:
    blocks = [*shell(), Block(thing, (1, 1, 0), (2, 2, 0.8))]
    path = write_obj(tmp_path / "in" / "room.obj", blocks)
    scene = import_scene(path, tmp_path / "out", up="z", scale=1.0)
    named = any(note.startswith("no object is known as furniture") for note in scene.changes)
    assert named == (thing == "block")
