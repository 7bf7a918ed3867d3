"""Assembly of scenes without rooms."""

from pathlib import Path

from pbrnet.scenes.registry import import_scene
from tests.fixtures.rooms import Block, write_obj


def test_without_rooms_the_file_bounds_the_room_not_the_added_ground(tmp_path: Path) -> None:
    posts = [Block(f"post{x}", (x, x, 0), (x + 0.2, x + 0.2, 2.5)) for x in (1, 7)]
    path = write_obj(tmp_path / "in" / "yard.obj", [Block("slab", (0, 0, -0.1), (9, 8, 0)), *posts])
    scene = import_scene(path, tmp_path / "out", up="z", scale=1.0)
    assert any(item.category == "ground" for item in scene.objects)
    assert any("NO ROOM WAS FOUND" in note for note in scene.changes)
    xs, ys = zip(*scene.rooms[0].floor, strict=True)
    assert (min(xs), max(xs), min(ys), max(ys)) == (0, 9, 0, 8)
