"""Faces that a file holds once for each side, in other materials, move apart."""

import numpy as np
import pytest

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.geometry.mesh import Mesh
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.materials.surface import Surface
from pbrnet.scenes.importing.shape import Shape
from pbrnet.scenes.importing.shapes.doubled_faces import with_doubled_faces_apart
from pbrnet.scenes.importing.xml_elements import plugin
from pbrnet.scenes.reconstruction.raycast import RayCaster

SQUARE = np.array([[0.0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])


def surface(grey: float, transmissive: bool = False) -> Surface:
    return Surface(plugin("bsdf", "diffuse", reflectance=(grey, grey, grey)), transmissive)


def sheet(name: str, faces: np.ndarray, made_of: Surface, uvs: Float64Array | None = None) -> Shape:
    return Shape(name, name, Mesh(SQUARE, faces, uvs=uvs), made_of)


def seen(shapes: list[Shape], z: float) -> str:
    """The shape that a ray from height `z` at the middle meets first."""
    owners = np.repeat(np.arange(len(shapes)), [len(shape.mesh.faces) for shape in shapes])
    rays = RayCaster(np.concatenate([shape.mesh.corners for shape in shapes]))
    _, triangles = rays.cast(np.array([[1.2, 0.8, z]]), np.array([[0.0, 0, -np.sign(z)]]))
    return shapes[owners[triangles[0]]].id


def test_each_side_is_seen_from_its_own() -> None:
    uvs = SQUARE[:, :2] / 2
    up, down = sheet("up", FACES, surface(0.8), uvs), sheet("down", FACES[:, ::-1], surface(0.2))
    for shapes in ([up, down], [down, up]):
        changes = Changes()
        made = with_doubled_faces_apart(shapes, (), changes)
        assert (seen(made, 1.0), seen(made, -1.0)) == ("up", "down")
        moved = next(shape for shape in made if shape.id == "up").mesh
        assert moved.uvs is not None
        np.testing.assert_allclose(moved.uvs, moved.vertices[:, :2] / 2)
        np.testing.assert_allclose(
            np.ptp([shape.mesh.bounds for shape in made], axis=(0, 1))[2], 5e-4
        )
        assert changes.sentences() == (
            "faces that are painted differently on their two sides were moved apart by 0.5 mm (2)",
        )


def test_faces_alone_stay_to_the_bit() -> None:
    shapes = [sheet("a", FACES, surface(0.8)), sheet("b", np.array([[0, 1, 3]]), surface(0.2))]
    assert with_doubled_faces_apart(shapes, (), Changes()) == shapes


def test_two_bodies_of_one_material_that_touch_stay_closed() -> None:
    same = surface(0.8)
    shapes = [sheet("wall", FACES, same), sheet("cupboard", FACES[:, ::-1], same)]
    made = with_doubled_faces_apart(shapes, (), Changes())
    assert [shape.mesh for shape in made] == [shape.mesh for shape in shapes]


@pytest.mark.parametrize("emitting", [(), ("both",)])
def test_one_of_two_sides_of_one_material_is_enough_unless_they_shine(
    emitting: tuple[str, ...],
) -> None:
    both = sheet("both", np.concatenate([FACES, FACES[:, ::-1]]), surface(0.8))
    (made,) = with_doubled_faces_apart([both], emitting, Changes())
    assert len(made.mesh.faces) == (4 if emitting else 2)
    np.testing.assert_array_equal(made.mesh.corners[:2], both.mesh.corners[:2])


def test_the_second_of_two_that_face_the_same_way_is_left_out() -> None:
    changes = Changes()
    made = with_doubled_faces_apart(
        [sheet("first", FACES, surface(0.8)), sheet("second", FACES[:1], surface(0.2))], (), changes
    )
    assert [(shape.id, len(shape.mesh.faces)) for shape in made] == [("first", 2)]
    assert changes.sentences() == ("faces in the place of others were left out (1)",)


def test_a_pane_that_is_painted_on_its_back_is_a_pane() -> None:
    back, pane = sheet("back", FACES, surface(0.8)), sheet("pane", FACES, surface(0.9, True))
    made = with_doubled_faces_apart([back, pane], (), Changes())
    assert [shape.id for shape in made] == ["pane"]


@pytest.mark.parametrize("order", [1, -1])
def test_a_side_that_shines_is_another_material(order: int) -> None:
    same = surface(0.8)
    shapes = [sheet("dark", FACES, same), sheet("lit", FACES[:, ::-1], same)][::order]
    made = with_doubled_faces_apart(shapes, ("lit",), Changes())
    assert (seen(made, 1.0), seen(made, -1.0)) == ("dark", "lit")
