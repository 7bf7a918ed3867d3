"""Things in meshes without telling names become objects of category "unknown"."""

from pathlib import Path

import numpy as np

from pbrnet.scenes.contract import Scene
from pbrnet.scenes.geometry.mesh import Mesh
from pbrnet.scenes.importing.materials.surface import Surface
from pbrnet.scenes.importing.shape import Shape
from pbrnet.scenes.models.pieces import UNKNOWN, split_unnamed
from pbrnet.scenes.registry import import_scene
from tests.fixtures.rooms import Block, corners_of, shell, write_obj

TABLE = [
    Block("top", (2.0, 1.5, 0.7), (3.2, 2.3, 0.75)),
    *(
        Block("leg", (x, y, 0.001), (x + 0.05, y + 0.05, 0.7))
        for x in (2.02, 3.12)
        for y in (1.52, 2.22)
    ),
]
SOFA = Block("seat", (0.5, 3.0, 0.0005), (2.5, 3.9, 0.8))
CUP = Block("cup", (4.5, 0.5, 0.9), (4.53, 0.53, 0.93))
LAMP = Block("bulb", (2.3, 1.8, 2.2), (2.7, 2.2, 2.4), 3000)


def imported(folder: Path, merged: str, *things: Block) -> Scene:
    """A room that is one mesh of the name `merged`, through the whole import."""
    path = write_obj(folder / "in" / "room.obj", [*shell(), *things], merged)
    return import_scene(path, folder / "out", up="z")


def test_a_room_in_one_mesh_has_its_things_as_objects(tmp_path: Path) -> None:
    scene = imported(tmp_path, "Mesh_0", SOFA, *TABLE, LAMP, CUP)
    things = {each.name: each for each in scene.objects if not each.is_structure}
    sizes = sorted(
        tuple(np.round(np.subtract(each.bbox_max, each.bbox_min), 2)) for each in things.values()
    )
    assert sizes == [(0.4, 0.4, 0.2), (1.2, 0.8, 0.75), (2.0, 0.9, 0.8)]
    assert sorted(each.category for each in things.values()) == ["lamp", UNKNOWN, UNKNOWN]
    assert {each.room for each in things.values()} == {"room_0"}
    assert any("connected parts" in change and UNKNOWN in change for change in scene.changes)
    assert any(each.is_structure for each in scene.objects)
    assert [light.kind for light in scene.lights] == ["area"]


def test_a_mesh_with_a_telling_name_stays_whole(tmp_path: Path) -> None:
    scene = imported(tmp_path, "Walls", SOFA, *TABLE)
    assert not any("connected parts" in change for change in scene.changes)


def test_a_room_that_is_named_as_furniture_has_its_things_as_objects(tmp_path: Path) -> None:
    """As after joining all meshes of a room to its last chair."""
    scene = imported(tmp_path, "Chair_003", SOFA, *TABLE)
    assert sum(each.category == UNKNOWN for each in scene.objects) == 2
    assert not any(each.category == "chair" for each in scene.objects)


def box_shape(name: str, *blocks: Block) -> Shape:
    """Boxes as one mesh."""
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    faces = np.array([half for a, b, c, d in quads for half in ((a, b, c), (a, c, d))])
    points = np.concatenate([corners_of(block) for block in blocks])
    return Shape(name, name, Mesh(points, np.concatenate(
        [faces + 8 * number for number in range(len(blocks))])), Surface(None))  # fmt: skip


def test_nothing_is_lost_or_doubled_and_parts_of_two_meshes_are_one_piece() -> None:
    wood = box_shape("a", *shell(), *TABLE[1:])
    cloth = box_shape("b", TABLE[0], SOFA)
    far = box_shape("c", TABLE[0], Block("x", (9.0, 0, 0), (9.5, 1, 1)))
    found = split_unnamed([wood, cloth, far], {})
    assert sum(len(shape.mesh.faces) for shape in found.shapes) == sum(
        len(shape.mesh.faces) for shape in (wood, far, cloth)
    )
    assert len({shape.id for shape in found.shapes}) == len(found.shapes)
    legs = {found.piece[id_] for id_, origin in found.origin.items() if origin == "a"}
    tops = {found.piece[id_] for id_, origin in found.origin.items() if origin == "c"}
    assert len(legs & tops) == 1  # the table's; the others are parts of walls, and a box
    assert cloth in found.shapes  # smaller than a room: one thing


def test_a_small_mesh_and_one_of_a_single_part_stay_as_they_are() -> None:
    shapes = [box_shape("a", TABLE[0]), box_shape("b", Block("x", (0, 0, 0), (8, 8, 0.1)))]
    assert split_unnamed(shapes, {}).shapes == shapes


def test_the_shapes_of_a_wide_node_without_a_name_are_its_things() -> None:
    """As SketchUp writes a room: one node, one shape for each material."""
    shapes = [
        box_shape("wood", *TABLE[1:]),
        box_shape("varnish", TABLE[0]),
        box_shape("cloth", SOFA),
        box_shape("paint", Block("x", (0, 0, 0), (5, 0.1, 2.5))),
    ]
    found = split_unnamed(shapes, {shape.id: (":SketchUp",) for shape in shapes})
    table = {
        found.piece[id_] for id_, origin in found.origin.items() if origin in ("wood", "varnish")
    }
    seat = {found.piece[id_] for id_, origin in found.origin.items() if origin == "cloth"}
    assert len(table) == len(seat) == 1 and table != seat
    assert any(shape.id == "paint" for shape in found.shapes)
    named = {shape.id: (":Sofa 3",) for shape in shapes}
    assert split_unnamed(shapes, named).shapes == shapes
