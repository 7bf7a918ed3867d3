"""COLLADA and 3DS as scenes of their own: unit, up axis, materials, textures, objects, damage."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pbrnet.scenes.color import decode_srgb_value
from pbrnet.scenes.contract import Scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.registry import import_scene
from tests.fixtures import model_file as files
from tests.fixtures.imported import CORNERS, RULED, look_down, ruler, values

pytestmark = pytest.mark.usefixtures("few_walks")

ROOM = files.POINTS * [2.5, 2.6, 1.0]  # 5 m wide, 2.6 m high, 4 m deep


def imported(
    folder: Path, content: str | bytes, name: str = "model.dae", **options: object
) -> Scene:
    path = folder / "in" / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return import_scene(path, folder / "out", **options)


def size_of(scene: Scene, category: str) -> list[float]:
    (found,) = [item for item in scene.objects if item.category == category]
    return [b - a for a, b in zip(found.bbox_min, found.bbox_max, strict=True)]


def test_unit_and_up_axis_are_those_of_the_file(tmp_path: Path) -> None:
    points = ROOM[:, [0, 2, 1]] * [1, -1, 1] / 0.0254
    text = files.dae(geometries=files.box(points), up="Z_UP", meter=0.0254)
    scene = imported(tmp_path, text)
    (room,) = scene.rooms
    assert room.ceiling_z - room.floor_z == pytest.approx(2.6, abs=0.01)
    x, y = np.ptp(room.floor, axis=0)
    assert (x, y) == (pytest.approx(5, abs=0.05), pytest.approx(4, abs=0.05))
    assert not any("lengths were read" in change for change in scene.changes)


def test_a_unit_that_cannot_be_is_overruled_and_said(tmp_path: Path) -> None:
    scene = imported(tmp_path, files.dae(geometries=files.box(ROOM * 100), meter=1))
    assert scene.rooms[0].ceiling_z - scene.rooms[0].floor_z == pytest.approx(2.6, abs=0.01)
    assert any("read as centimetres, though the file states 1 m" in each for each in scene.changes)


def test_a_wall_painted_on_both_sides_has_the_inner_colour_inside(tmp_path: Path) -> None:
    """As SketchUp writes it: each face twice, in opposite windings, with two materials."""
    white = files.PLAIN.replace("1 0.5 0.25 1", "1 1 1 1")
    text = files.dae(
        nodes=f"<node name='one'>{files.instance()}{files.instance('inner', 'white-id')}</node>",
        geometries=files.box(ROOM) + files.box(ROOM, "inner", inwards=True),
        materials=files.effect("red", files.PLAIN) + files.effect("white", white),
    )
    scene = imported(tmp_path, text)
    assert any("painted differently on their two sides" in change for change in scene.changes)
    west, south = np.min(scene.rooms[0].floor, axis=0)
    seen = look_down(scene, [(west + x, south + y) for x in (0.5, 2.5, 4.5) for y in (0.5, 3.0)])
    np.testing.assert_allclose(seen, 1.0, atol=0.01)


def test_colour_gloss_and_glass(tmp_path: Path) -> None:
    shading = files.PLAIN + (
        "<specular><color>0.5 0.5 0.5 1</color></specular><shininess><float>30</float></shininess>"
    )
    scene = imported(tmp_path, files.dae(materials=files.effect("red", shading)))
    (color,) = values(scene, "principled", "base_color")
    assert color == pytest.approx([decode_srgb_value(each) for each in (1.0, 0.5, 0.25)], rel=1e-5)
    # Phong's exponent 30 is alpha = (2 / 32)^(1/2) = 1/4, and roughness its root.
    assert values(scene, "principled", "roughness") == [[pytest.approx(0.5)]]
    clear = files.PLAIN + "<transparent opaque='A_ONE'><color>1 1 1 0.2</color></transparent>"
    scene = imported(tmp_path, files.dae(materials=files.effect("red", clear)))
    assert "thindielectric" in scene.xml.read_text()
    assert any("became clear glass: red" in change for change in scene.changes)


def test_emission_makes_a_lamp(tmp_path: Path) -> None:
    shading = files.PLAIN + "<emission><color>1 1 0 1</color></emission>"
    scene = imported(tmp_path, files.dae(materials=files.effect("red", shading)))
    (radiance,) = [each for each in values(scene, "area", "radiance") if each[2] == 0]
    assert radiance[0] == radiance[1] > 0
    assert any(light.kind == "area" and "one" in light.shapes for light in scene.lights)


def ground(image: str) -> str:
    """A ground of 8 m whose image lies the right way round for one who looks along -z."""
    points = 8 * np.array([[0.0, 0, 0], [0, 0, 1], [1, 0, 1], [1, 0, 0]])
    inputs = (
        "<input semantic='VERTEX' source='#g-v' offset='0'/>"
        "<input semantic='TEXCOORD' source='#g-uv' offset='0' set='0'/>"
    )
    geometry = (
        f"<geometry id='g' name='g'><mesh>{files.source('g-p', points, 'XYZ')}"
        f"{files.source('g-uv', [[0, 1], [0, 0], [1, 0], [1, 1]], 'ST')}"
        "<vertices id='g-v'><input semantic='POSITION' source='#g-p'/></vertices>"
        f"<triangles count='2' material='m'>{inputs}<p>0 1 2 0 2 3</p></triangles>"
        "</mesh></geometry>"
    )
    library = (
        f"<library_images><image id='img'><init_from>{image}</init_from></image></library_images>"
    )
    return files.dae(
        f"<node name='ground'>{files.instance('g')}</node>",
        geometry,
        files.effect("red", files.TEXTURED, files.SAMPLER),
        library,
    )


def test_an_image_lies_the_right_way_round(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    Image.fromarray(ruler()).resize((64, 64), Image.Resampling.NEAREST).save(
        tmp_path / "in" / "a tile.png"
    )
    scene = imported(tmp_path, ground("file:///C:/other/machine/a%20tile.png"))
    assert np.allclose(look_down(scene, CORNERS), RULED, atol=0.01)


@pytest.mark.parametrize(("alpha", "masked"), [(255, False), (0, True)])
def test_an_image_cuts_out_where_it_is_transparent(
    tmp_path: Path, alpha: int, masked: bool
) -> None:
    (tmp_path / "in").mkdir()
    pixels = np.full((4, 4, 4), 255, np.uint8)
    pixels[0, 0, 3] = alpha
    Image.fromarray(pixels).save(tmp_path / "in" / "leaf.png")
    scene = imported(tmp_path, ground("leaf.png"))
    assert ('type="mask"' in scene.xml.read_text()) == masked


def test_a_missing_image_is_named(tmp_path: Path) -> None:
    scene = imported(tmp_path, ground("gone.png"))
    assert any("missing texture" in each and "gone.png" in each for each in scene.changes)


def test_an_image_outside_of_the_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "secret.png").write_bytes(b"")
    with pytest.raises(InputError, match=r"lies outside .* --root"):
        imported(tmp_path, ground("../secret.png"))
    scene = imported(tmp_path, ground("../../gone.png"))
    assert any("missing texture" in change for change in scene.changes)


def test_nodes_give_objects_and_what_is_left_out_is_said(tmp_path: Path) -> None:
    chair = files.POINTS * [0.25, 0.9, 0.125] + [1, 0.01, 1]
    nodes = (
        f"<node name='shell'>{files.instance('room')}</node>"
        f"<node name='Chair 3'><node name='part'>{files.instance('chair')}</node></node>"
        "<node name='sun'><instance_light url='#l'/></node>"
    )
    geometries = files.box(ROOM, "room") + files.box(chair, "chair")
    scene = imported(tmp_path, files.dae(nodes, geometries))
    assert size_of(scene, "chair") == pytest.approx([0.5, 0.5, 0.9], abs=1e-4)
    assert any("lights, whose strength COLLADA does not define" in each for each in scene.changes)


def test_truncated_files_are_refused(tmp_path: Path) -> None:
    whole = files.dae()
    for share in (0.0, 0.3, 0.6, 0.99):
        with pytest.raises(InputError, match=r"model\.dae"):
            imported(tmp_path, whole[: int(share * len(whole))])
    assert not (tmp_path / "out").exists()


def test_3ds_is_z_up_without_a_unit(tmp_path: Path) -> None:
    room = files.file_3ds(files.material_3ds(), files.mesh_3ds(points=ROOM * 100))
    scene = imported(tmp_path, room, "room.3ds")
    assert scene.rooms[0].ceiling_z - scene.rooms[0].floor_z == pytest.approx(2.6, abs=0.01)
    assert any("lengths were read as centimetres" in each for each in scene.changes)
    (color,) = values(scene, "principled", "base_color")
    expected = [decode_srgb_value(each / 255) for each in (255, 128, 64)]
    assert color == pytest.approx(expected, rel=1e-4)
    with pytest.raises(InputError, match=r"room\.3ds: damaged"):
        imported(tmp_path, room[: len(room) // 2], "room.3ds")


def test_things_of_sketchup_have_the_names_of_their_components(tmp_path: Path) -> None:
    """Nodes of the scene are called after instances, those of the library after what they are."""
    shell = f"<node name='SketchUp'>{files.instance()}"
    text = files.dae(
        nodes=f"{shell}<node name='instance_0'><matrix>1 0 0 1 0 1 0 0 0 0 1 0 0 0 0 1</matrix>"
        "<instance_node url='#ID3'/></node></node>",
        geometries=files.box(ROOM) + files.box(files.POINTS * 0.25, "seat"),
    ).replace(
        "<library_visual_scenes>",
        f"<library_nodes><node id='ID3' name='Stool'>{files.instance('seat')}</node>"
        "</library_nodes><library_visual_scenes>",
    )
    scene = imported(tmp_path, text)
    assert [item.name for item in scene.objects if item.category == "stool"] == ["Stool"]
