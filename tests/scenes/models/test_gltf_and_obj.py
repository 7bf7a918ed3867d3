"""glTF, GLB and OBJ: transforms, textures, materials and lights as their formats define them."""

import base64
import json
import math
import resource
import struct
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mitsuba as mi
import numpy as np
import pytest
from PIL import Image

from pbrnet.pipeline.render import raycast
from pbrnet.pipeline.render.scene import open_scene, set_variant
from pbrnet.scenes.contract import Scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.formats.mtl import MtlMap, read_mtl
from pbrnet.scenes.formats.ply import read_ply
from pbrnet.scenes.geometry.mesh import Mesh, face_areas
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.materials.surface import Surface
from pbrnet.scenes.importing.materials.textures import TextureStore
from pbrnet.scenes.importing.sandbox import Sandbox
from pbrnet.scenes.importing.shape import Shape
from pbrnet.scenes.importing.xml_elements import plugin
from pbrnet.scenes.models.gltf.container import open_asset
from pbrnet.scenes.models.gltf.images import Images, texture_matrix
from pbrnet.scenes.models.gltf.reader import read_gltf
from pbrnet.scenes.models.importer import _without_black, import_model
from pbrnet.scenes.models.model import Emission, Model
from pbrnet.scenes.models.options import READERS, ModelOptions
from pbrnet.scenes.opened_files import OpenedFiles
from pbrnet.scenes.photometry import LUMEN
from pbrnet.scenes.registry import import_scene
from tests.fixtures.changed import changed
from tests.fixtures.encoded import empty_png
from tests.fixtures.gltf import SQUARE, SQUARE_FACES, SQUARE_UV, Builder, square
from tests.fixtures.imported import CORNERS, RULED, look_down, ruler, values
from tests.fixtures.rooms import Block, shell, write_obj

pytestmark = pytest.mark.usefixtures("few_walks")

HALF = math.sqrt(0.5)


def read(builder: Builder, folder: Path, suffix: str = ".glb") -> Model:
    """The model of a file, in the axes of the file."""
    path = builder.save(folder / f"model{suffix}")
    (folder / "textures").mkdir(exist_ok=True)
    changes = Changes()
    asset = open_asset(path, Sandbox(OpenedFiles(folder)))
    images = Images(asset, folder / "textures", changes)
    return read_gltf(asset, images, TextureStore(folder / "textures", changes), changes)


def imported(builder: Builder, folder: Path, **options: object) -> Scene:
    """A file through the whole import."""
    return import_scene(builder.save(folder / "in" / "model.glb"), folder / "out", **options)


def test_author_and_licence_are_found_in_the_extras(tmp_path: Path) -> None:
    made = square()
    made.json["asset"]["extras"] = {
        "author": "A. Maker (https://example.org/a)",
        "license": "CC-BY-4.0 (http://creativecommons.org/licenses/by/4.0/)",
    }
    model = read(made, tmp_path)
    assert (model.author, model.licence) == ("A. Maker (https://example.org/a)", "CC-BY-4.0")


def test_transforms_of_nodes_multiply_down_the_tree(tmp_path: Path) -> None:
    made = Builder()
    leaf = made.node(root=False, mesh=made.mesh(), scale=[2, 2, 2])
    # A quarter turn about +Y takes +Z to +X and +X to -Z.
    turned = made.node(root=False, children=[leaf], rotation=[0, HALF, 0, HALF])
    made.node(children=[turned], translation=[1, 2, 3])
    (shape,) = read(made, tmp_path).shapes
    # (0, 0, 1) * 2 = (0, 0, 2), turned (2, 0, 0), moved (3, 2, 3); (1, 0, 0) -> (1, 2, 1).
    expected = np.array([[1, 2, 3], [3, 2, 3], [3, 2, 1], [1, 2, 1]])
    assert np.allclose(shape.mesh.vertices, expected, atol=1e-6)


def test_a_matrix_is_stored_column_by_column(tmp_path: Path) -> None:
    made = Builder()
    made.node(mesh=made.mesh(), matrix=[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1])
    (shape,) = read(made, tmp_path).shapes
    assert np.allclose(shape.mesh.vertices, SQUARE + np.array([5, 6, 7]))


@pytest.mark.parametrize("scale", [[1, 1, 1], [-1, 1, 1], [1, 1, -1], [-1, 1, -1]])
def test_a_mirrored_node_keeps_its_front(tmp_path: Path, scale: list[int]) -> None:
    made = Builder()
    made.node(mesh=made.mesh(), scale=scale)
    (shape,) = read(made, tmp_path).shapes
    _, normals = face_areas(shape.mesh.corners)
    assert np.allclose(normals, [0, 1, 0])


def test_y_up_becomes_z_up_in_metres(tmp_path: Path) -> None:
    made = square()
    made.node(mesh=made.mesh(np.array([[0.0, 3, 0], [1, 3, 0], [0, 3, -2]]), [0, 1, 2]), name="up")
    scene = imported(made, tmp_path)
    mesh = read_ply(scene.folder / "meshes" / "up.ply")
    assert np.allclose(sorted(map(tuple, mesh.vertices)), [(0, 0, 3), (0, 2, 3), (1, 0, 3)])


@pytest.mark.parametrize(("mode", "faces"), [(4, [0, 1, 2, 0, 2, 3]), (5, [0, 1, 3, 2]),
                                             (6, [0, 1, 2, 3])])  # fmt: skip
def test_lists_strips_and_fans_of_triangles_face_alike(
    tmp_path: Path, mode: int, faces: list[int]
) -> None:
    made = Builder()
    made.node(mesh=made.mesh(faces=faces, mode=mode))
    (shape,) = read(made, tmp_path).shapes
    areas, normals = face_areas(shape.mesh.corners)
    assert np.isclose(areas.sum(), 1) and np.allclose(normals, [0, 1, 0])


def test_interleaved_sparse_and_quantised_accessors(tmp_path: Path) -> None:
    made = Builder()
    mixed = np.hstack([SQUARE, np.full((4, 3), 9.0)]).astype("<f4")
    view = made.view(mixed.tobytes())
    made.json["bufferViews"][view]["byteStride"] = 24
    points = made.add(
        "accessors", {"bufferView": view, "componentType": 5126, "count": 4, "type": "VEC3"}
    )
    made.add("meshes", {"primitives": [{"attributes": {"POSITION": points}, "mode": 6}]})
    made.node(mesh=0)
    sparse = {
        "count": 1,
        "indices": {"bufferView": made.view(b"\2\0"), "componentType": 5123},
        "values": {"bufferView": made.view(np.array([7, 8, 9], "<f4").tobytes())},
    }
    base = made.accessor(SQUARE)
    made.json["accessors"][base]["sparse"] = sparse
    made.add("meshes", {"primitives": [{"attributes": {"POSITION": base}, "mode": 6}]})
    made.node(mesh=1)
    small = made.accessor(np.round(SQUARE * 32767), "i2", normalized=True)
    # Three shorts are 6 bytes; a vertex must start at a multiple of 4 only when interleaved.
    made.add("meshes", {"primitives": [{"attributes": {"POSITION": small}, "mode": 6}]})
    made.node(mesh=2)
    made.json["extensionsRequired"] = ["KHR_mesh_quantization"]
    first, second, third = (shape.mesh.vertices for shape in read(made, tmp_path).shapes)
    assert np.allclose(first, SQUARE)
    assert np.allclose(second[2], [7, 8, 9]) and np.allclose(second[[0, 1, 3]], SQUARE[[0, 1, 3]])
    assert np.allclose(third, SQUARE, atol=1e-4)


def test_a_camera_looks_along_its_minus_z(tmp_path: Path) -> None:
    made = square()
    made.add("cameras", {"type": "perspective", "perspective": {"yfov": 0.8, "aspectRatio": 1.5,
                                                                "znear": 0.1}})  # fmt: skip
    made.node(camera=0, translation=[4, 1.5, 6], name="eye")
    scene = imported(made, tmp_path)
    (view,) = scene.source["views"]
    pose = np.array(view["camera_to_world"])
    assert np.allclose(pose[:3, 3], [4, -6, 1.5])
    # Right stays +x, image down is the world's -z, ahead is the file's -z: our +y.
    assert np.allclose(pose[:3, :3].T, [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-6)
    assert math.isclose(math.tan(view["half_fov_x"]), 1.5 * math.tan(0.4), rel_tol=1e-6)


def test_a_ruler_texture_lies_the_right_way_round(tmp_path: Path) -> None:
    made = square(pbrMetallicRoughness={"baseColorTexture": {"index": 0}, "metallicFactor": 0})
    made.texture(ruler(), magFilter=9728)
    # v = 0 is the image's top row, here at z = 0, the far edge: our y = 0.
    assert np.allclose(look_down(imported(made, tmp_path), CORNERS), RULED, atol=0.01)


def test_a_texture_is_multiplied_by_its_factor(tmp_path: Path) -> None:
    made = square(pbrMetallicRoughness={"baseColorTexture": {"index": 0},
                                        "baseColorFactor": [0.5, 0.25, 1, 1]})  # fmt: skip
    made.texture(ruler())
    seen = look_down(imported(made, tmp_path), CORNERS)
    assert np.allclose(seen, np.array(RULED) * [0.5, 0.25, 1], atol=0.01)


def test_samplers_clamp_and_repeat(tmp_path: Path) -> None:
    for wrap, expected in ((33071, RULED[3]), (10497, RULED[0])):
        made = Builder()
        made.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})
        made.texture(ruler(), wrapS=wrap, wrapT=wrap, magFilter=9728)
        made.node(mesh=made.mesh(8 * SQUARE, uv=SQUARE_UV + 1.0, material=0))
        folder = tmp_path / str(wrap)
        assert np.allclose(look_down(imported(made, folder), CORNERS[:1]), expected, atol=0.01)


def test_a_texture_transform_scales_then_turns_then_shifts(tmp_path: Path) -> None:
    moved = {"offset": [0.1, 0.2], "rotation": math.pi / 2, "scale": [2, 3]}
    # (0.5, 0.1) scaled is (1, 0.3); a quarter turn to the left in a plane whose v points down
    # takes (u, v) to (v, -u): (0.3, -1); shifted (0.4, -0.8).
    found = texture_matrix(moved, "here") @ np.array([0.5, 0.1, 0, 1])
    assert np.allclose(found[:2], [0.3 + 0.1, -1 + 0.2])
    made = square(
        pbrMetallicRoughness={
            "baseColorTexture": {
                "index": 0,
                "extensions": {"KHR_texture_transform": {"offset": [0.5, 0]}},
            }
        }
    )
    made.texture(ruler(), magFilter=9728)
    seen = look_down(imported(made, tmp_path), CORNERS)
    assert np.allclose(seen, [RULED[1], RULED[0], RULED[3], RULED[2]], atol=0.01)


@pytest.mark.parametrize(("alpha", "seen"), [(100, False), (160, True)])
def test_a_mask_cuts_at_its_threshold(tmp_path: Path, alpha: int, seen: bool) -> None:
    made = square(pbrMetallicRoughness={"baseColorTexture": {"index": 0}}, alphaMode="MASK")
    pixels = np.full((2, 2, 4), 255, dtype=np.uint8)
    pixels[..., 3] = alpha  # of 255; the threshold is one half
    made.texture(pixels)
    set_variant("auto")
    scene = imported(made, tmp_path, sky=False)
    target = open_scene(scene).geometry
    (shape,) = raycast.surfaces(target, np.array([4.0, -4, 1]), np.array([[0.0, 0, -1]])).position
    assert (abs(float(shape[2])) < 1e-3) == seen  # else the ground below, added with the sky


def test_metalness_and_roughness_go_over_as_they_are(tmp_path: Path) -> None:
    paint = {"baseColorFactor": [0.2, 0.4, 0.6, 1], "roughnessFactor": 0.35, "metallicFactor": 0.75}
    made = square(pbrMetallicRoughness=paint)
    scene = imported(made, tmp_path)
    assert values(scene, "principled", "base_color") == [[0.2, 0.4, 0.6]]
    assert values(scene, "principled", "roughness") == [[0.35]]
    assert values(scene, "principled", "metallic") == [[0.75]]
    assert values(scene, "principled", "specular") == [[0.5]]  # F0 = 0.04 of ior 1.5


def test_green_is_roughness_and_blue_is_metalness(tmp_path: Path) -> None:
    made = square(
        pbrMetallicRoughness={"metallicRoughnessTexture": {"index": 0}, "roughnessFactor": 0.5}
    )
    made.texture(np.full((2, 2, 3), (10, 200, 60), dtype=np.uint8))
    scene = imported(made, tmp_path)
    files = {
        Path(item.get("value", "")).name: item
        for item in ElementTree.parse(scene.xml).getroot().iter("string")
        if item.get("name") == "filename" and "png" in item.get("value", "")
    }
    means = {
        name: np.asarray(Image.open(scene.folder / "textures" / name)).mean() for name in files
    }
    assert sorted(means.values()) == [60.0, 100.0]  # blue as it is, green by one half


def test_index_of_refraction_sets_the_reflectance_at_normal_incidence(tmp_path: Path) -> None:
    scene = imported(square(extensions={"KHR_materials_ior": {"ior": 2.0}}), tmp_path)
    # ((2 - 1) / (2 + 1))^2 = 0.111; `specular` 1 stands for 8 %.
    assert values(scene, "principled", "specular") == [[1.0]]
    scene = imported(square(extensions={"KHR_materials_ior": {"ior": 1.33}}), tmp_path / "w")
    assert np.isclose(values(scene, "principled", "specular")[0][0], 0.020059 / 0.08, rtol=1e-3)


@pytest.mark.parametrize(
    ("more", "roughness", "kind"),
    [({}, 0.0, "thindielectric"), ({"KHR_materials_volume": {"thicknessFactor": 0.01}}, 0.0,
     "dielectric"), ({}, 0.5, "principledthin"),
     ({"KHR_materials_volume": {"thicknessFactor": 0.01}}, 0.5, "roughdielectric")],
)  # fmt: skip
def test_transmission_becomes_glass(
    tmp_path: Path, more: dict[str, Any], roughness: float, kind: str
) -> None:
    made = square(
        pbrMetallicRoughness={"roughnessFactor": roughness},
        extensions={"KHR_materials_transmission": {"transmissionFactor": 1}, **more},
    )
    scene = imported(made, tmp_path)
    root = ElementTree.parse(scene.xml).getroot()
    assert next(bsdf.get("type") for bsdf in root.findall("bsdf")) == kind


@pytest.mark.parametrize("kind", ["point", "spot"])
def test_candela_become_our_radiant_intensity(tmp_path: Path, kind: str) -> None:
    made = square()
    lamp = made.light(kind, 100.0, color=[1, 0.5, 0.25])
    made.node(extensions=lamp, translation=[1, 2, 3])
    scene = imported(made, tmp_path)
    # 100 cd at 1.6e-5 of our units a lumen.
    assert np.allclose(values(scene, kind, "intensity"), [[1.6e-3, 0.8e-3, 0.4e-3]])
    assert [item.kind for item in scene.lights] == [kind]


def test_a_point_light_of_known_candela_gives_the_illuminance_of_its_law(tmp_path: Path) -> None:
    made = square()
    made.node(extensions=made.light("point", 80.0), translation=[4, 2, 4])
    set_variant("auto")
    scene = mi.load_file(str(imported(made, tmp_path).xml), optimize=False, parallel=False)
    si = scene.ray_intersect(mi.Ray3f([4.0, -4.0, 1.0], [0.0, 0.0, -1.0]))
    _, spectrum = scene.sample_emitter_direction(si, mi.Point2f(0.5, 0.5))
    # 80 cd at 2 m is 20 lx.
    assert np.allclose(np.array(spectrum).ravel(), 20 * LUMEN, rtol=1e-4)


def test_a_directional_light_shines_along_its_minus_z_in_lux(tmp_path: Path) -> None:
    made = square()
    # A quarter turn about +X takes -Z to +Y: turn the other way to shine down.
    made.node(extensions=made.light("directional", 5000), rotation=[-HALF, 0, 0, HALF])
    scene = imported(made, tmp_path)
    assert np.allclose(values(scene, "directional", "irradiance"), 5000 * LUMEN)
    (way,) = values(scene, "directional", "direction")
    assert np.allclose(way, [0, 0, -1], atol=1e-6)


def test_emissive_strength_is_luminance(tmp_path: Path) -> None:
    made = square(
        emissiveFactor=[1, 0.5, 0],
        extensions={"KHR_materials_emissive_strength": {"emissiveStrength": 2000}},
    )
    scene = imported(made, tmp_path)
    assert np.allclose(values(scene, "area", "radiance"), [[0.032, 0.016, 0]])
    assert [light.kind for light in scene.lights] == ["area"]


@pytest.mark.parametrize("level", [0, 200])
def test_a_black_emission_image_makes_no_lamp(tmp_path: Path, level: int) -> None:
    made = square(emissiveFactor=[1, 1, 1], emissiveTexture={"index": 0})
    made.texture(np.full((2, 2, 3), level, np.uint8))
    lights = imported(made, tmp_path, lamps="home").lights
    assert any(light.kind == "area" for light in lights) == (level > 0)


def test_faint_radiance_of_a_screen_shines(tmp_path: Path) -> None:
    """As exports to USD write it, in units of the scene and with a factor."""
    emissions = {}
    for name, level in (("screen", 1e-4), ("off", 0.0)):
        mi.Bitmap(np.full((2, 2, 3), level, np.float32)).write(str(tmp_path / f"{name}.exr"))
        emissions[name] = Emission((62500.0, 62500.0, 62500.0), tmp_path / f"{name}.exr")
    assert _without_black(emissions).keys() == {"screen"}


def test_emission_in_display_units_is_raised_and_said(tmp_path: Path) -> None:
    scene = imported(square(emissiveFactor=[1, 1, 1]), tmp_path)
    assert np.allclose(values(scene, "area", "radiance"), 1000 * LUMEN)
    assert any("1000 cd/m^2" in change for change in scene.changes)


def test_a_single_object_stands_on_the_floor_of_a_room_of_its_own(tmp_path: Path) -> None:
    made = Builder()
    made.node(mesh=made.box((0, 5, 0), (1, 6.2, 0.8)), name="Cupboard")
    scene = imported(made, tmp_path)
    (room,) = scene.rooms
    (cupboard,) = [thing for thing in scene.objects if thing.name == "Cupboard"]
    assert cupboard.category == "cabinet" and cupboard.room == room.id
    assert np.allclose(cupboard.bbox_min, [-0.5, -0.4, 0])
    assert np.allclose(cupboard.bbox_max, [0.5, 0.4, 1.2])
    assert room.floor_z == pytest.approx(0, abs=1e-5)
    assert room.ceiling_z - room.floor_z == pytest.approx(2.6, abs=0.01)
    (portal,) = scene.portals
    assert portal.kind == "window" and portal.room == room.id
    assert np.allclose(portal.normal, [0, -1, 0], atol=1e-6)
    kinds = {thing.category for thing in scene.objects if thing.is_structure}
    assert {"floor", "ceiling", "wall"} <= kinds
    assert len(scene.source["views"]) == 4


def a_box(made: Builder, low: float, name: str, **node: Any) -> None:
    made.node(mesh=made.box((0, low, 0), (0.5, low + 0.4, 0.4)), name=name, **node)


@pytest.mark.parametrize(
    "file, nodes, expected",
    [
        # The file says what it is: all of it is that one thing.
        ("WoodenChair_02", ("Object_1", "cushion"), {("WoodenChair_02", "chair")}),
        # The nodes say it: each is what it is called.
        ("export", ("Desk.001", "TableLamp"), {("Desk.001", "desk"), ("TableLamp", "lamp")}),
        # Some say it, and what says nothing is one thing by the file's name.
        ("thing7", ("Sofa", "Cube", "Cube.001"), {("Sofa", "sofa"), ("thing7", "other")}),
    ],
)
def test_a_single_object_is_named_for_its_file_or_nodes(
    tmp_path: Path, file: str, nodes: tuple[str, ...], expected: set[tuple[str, str]]
) -> None:
    made = Builder()
    for number, name in enumerate(nodes):
        a_box(made, 0.6 * number, name)
    scene = import_scene(made.save(tmp_path / "in" / f"{file}.glb"), tmp_path / "out")
    things = [thing for thing in scene.objects if not thing.is_structure]
    found = {(thing.name, thing.category) for thing in things if thing.name != "room_lamp"}
    assert found == expected


def obj_box(*sides: float) -> str:
    x, y, z = sides
    text = "".join(f"v {a} {b} {c}\n" for a in (0, x) for b in (0, y) for c in (0, z))
    return text + "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n"


@pytest.mark.parametrize(
    "scale, up, height", [(0.01, "y", 0.8), (0.01, "z", 0.6), (0.0254, "x", 1.27)]
)
def test_units_and_axis_are_those_that_were_given(
    tmp_path: Path, scale: float, up: str, height: float
) -> None:
    (tmp_path / "chair.obj").write_text(obj_box(50, 80, 60))
    scene = import_scene(tmp_path / "chair.obj", tmp_path / "out", scale=scale, up=up)
    (chair,) = [thing for thing in scene.objects if thing.category == "chair"]
    assert chair.bbox_max[2] - chair.bbox_min[2] == pytest.approx(height)
    assert chair.bbox_min[2] == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize(("unit", "metres"), [("inches", 0.0254), ("meters", 1.0)])
def test_sketchup_states_its_unit_in_a_comment(tmp_path: Path, unit: str, metres: float) -> None:
    """A box of 2.6 m is a room in any unit; of other candidates none is clearly better."""
    sides = [np.round(side / metres, 3) for side in (5.0, 2.6, 4.0)]
    head = f"# Exported from SketchUp\n# File units = {unit}\n\n"
    (tmp_path / "a.obj").write_text(head + obj_box(*sides))
    scene = import_scene(tmp_path / "a.obj", tmp_path / "out")
    (room,) = scene.rooms
    assert room.ceiling_z - room.floor_z == pytest.approx(2.6, abs=0.01)
    assert scene.source["placement"]["scale"] == metres


def test_a_chair_of_many_triangles_comes_in_quickly(tmp_path: Path) -> None:
    made = Builder()
    side = 224  # 2 x 223^2: about 100,000 triangles
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, side), np.linspace(0, np.pi, side))
    ball = 0.5 * np.stack([np.cos(u) * np.sin(v), np.cos(v), np.sin(u) * np.sin(v)], axis=-1)
    first = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    faces = np.concatenate(
        [
            np.stack([first, first + 1, first + side], axis=1),
            np.stack([first + 1, first + side + 1, first + side], axis=1),
        ]
    )
    mesh = {"POSITION": made.accessor(ball.reshape(-1, 3))}
    item = {"attributes": mesh, "indices": made.accessor(faces.ravel(), "u4")}
    made.node(mesh=made.add("meshes", {"primitives": [item]}), name="chair")
    path = made.save(tmp_path / "in" / "chair.glb")
    started = time.process_time()
    scene = import_scene(path, tmp_path / "out")
    assert time.process_time() - started < 5.0
    (chair,) = [thing for thing in scene.objects if thing.category == "chair"]
    stored = read_ply(scene.folder / "meshes" / f"{chair.shapes[0]}.ply")
    assert len(stored.faces) == pytest.approx(2 * 223**2, rel=0.02)


@pytest.mark.parametrize(
    ("names", "apart", "expected"),
    [
        # A scan's group of chairs, which stand apart.
        (("Chair0", "Chair1", "Chair2"), 1.0, 3),
        # Parts of one chair by material, which share its place.
        (("Chair0", "Chair1", "Chair2"), 0.1, 1),
        # Parts that say which they are.
        (("chair leg 0", "chair leg 1", "chair back"), 1.0, 1),
    ],
)
def test_a_group_of_things_is_told_from_a_thing_of_parts(
    tmp_path: Path, names: tuple[str, ...], apart: float, expected: int
) -> None:
    made = Builder()
    made.node(mesh=made.box((0, 0, 0), (5, 2.7, 4), room=True), name="shell")
    parts = []
    for number, name in enumerate(names):
        a_box(made, 0.1, name, root=False, translation=[0.5 + apart * number, 0, 1.5])
        parts.append(len(made.json["nodes"]) - 1)
    made.node(name="Chair_grp", children=parts)
    scene = imported(made, tmp_path)
    assert sum(thing.category == "chair" for thing in scene.objects) == expected


def test_a_building_keeps_its_own_rooms(tmp_path: Path) -> None:
    made = Builder()
    made.node(mesh=made.box((0, 0, 0), (5, 2.7, 4), room=True), name="shell")
    made.node(mesh=made.mesh(0.5 * SQUARE + [2, 0.7, 2]), name="Desk")
    scene = imported(made, tmp_path)
    (room,) = scene.rooms
    assert room.ceiling_z - room.floor_z == pytest.approx(2.7, abs=0.01)
    assert not any("single object" in change for change in scene.changes)
    assert any(thing.category == "desk" and thing.room == room.id for thing in scene.objects)


def test_poles_far_apart_in_an_unlikely_unit_are_no_scene(tmp_path: Path) -> None:
    """No room, and metres are no likelier than centimetres: it is asked for, not guessed."""
    made = Builder()
    pole = made.box((0, 0, 0), (1, 90, 1), room=True)
    for x in (0, 150):
        made.node(mesh=pole, translation=[x, 0, 0])
    with pytest.raises(InputError, match=r"no room was found in a scene 151 m .*--scale 0\.01"):
        imported(made, tmp_path)
    assert imported(made, tmp_path, scale=1.0).source["placement"]["kind"] == "building"


def test_a_file_against_its_stated_up_axis_asks_for_up_and_scale(tmp_path: Path) -> None:
    """Millimetres with +Z up, as converters of CAD formats write them: 9 m high by the standard."""
    made = Builder()
    made.node(mesh=made.box((0, 0, 0), (4000, 9000, 2500), room=True))
    with pytest.raises(InputError, match=r"\+Z points up: --up z --scale 0\.001 \(millimetres"):
        imported(made, tmp_path)
    (room,) = imported(made, tmp_path, scale=0.001, up="z").rooms
    assert room.ceiling_z - room.floor_z == pytest.approx(2.5, abs=0.01)


OBJ = """mtllib some thing.mtl
o Table
v 0 0 0\nv 8 0 0\nv 8 0 -8\nv 0 0 -8
vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1
usemtl ruled
f 1/1 2/2 3/3 4/4
o Lamp
v 1 2 0\nv 2 2 0\nv 2 2 -1\nv 1 2 -1
usemtl glow
f -4/1 -3/2 -2/3 -1/4
"""
MTL = """newmtl ruled
Kd 0 0 0
map_Kd -s 1 1 1 C:\\old\\place\\my ruler.png
newmtl glow
Kd 0.5 0.5 0.5
Ke 100 200 300
"""


def test_an_obj_brings_its_materials_and_objects(tmp_path: Path) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    (folder / "model.obj").write_text(OBJ)
    (folder / "some thing.mtl").write_text(MTL)
    Image.fromarray(ruler()).save(folder / "my ruler.png")
    scene = import_scene(folder / "model.obj", tmp_path / "out", up="y")
    # v = 0 is an OBJ image's bottom row, here at z = 0: our y = 0; black Kd is no factor.
    seen = look_down(scene, [(1.0, 1.0), (7.0, 1.0), (1.0, 7.0), (7.0, 7.0)])
    assert np.allclose(seen, [RULED[2], RULED[3], RULED[0], RULED[1]], atol=0.01)
    names = {thing.name: thing.category for thing in scene.objects}
    assert names["Lamp"] == "lamp"
    assert np.allclose(values(scene, "area", "radiance"), [[0.0016, 0.0032, 0.0048]])


def test_groups_below_an_object_keep_their_names(tmp_path: Path) -> None:
    things = [Block("Chair_1", (1, 1, 0), (1.5, 1.5, 0.9)), Block("Box", (3, 1, 0), (4, 2, 0.7))]
    path = write_obj(tmp_path / "in" / "flat.obj", [*shell(), *things])
    path.write_text("o Everything\n" + path.read_text())
    scene = import_scene(path, tmp_path / "out", up="z")
    found = {item.name: item.category for item in scene.objects}
    assert (found["Chair_1"], found["Box"]) == ("chair", "box")
    assert found["floor"] == "floor" and found["wall_a"] == "wall"


def test_missing_libraries_and_textures_are_named(tmp_path: Path) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    (folder / "model.obj").write_text(OBJ)
    scene = import_scene(folder / "model.obj", tmp_path / "out")
    assert any("some thing.mtl" in change for change in scene.changes)
    (folder / "some thing.mtl").write_text(MTL)
    scene = import_scene(folder / "model.obj", tmp_path / "out")
    assert any("my ruler.png" in change for change in scene.changes)


def map_of(line: str) -> MtlMap:
    return read_mtl(f"newmtl a\n{line}\n".encode(), "a.mtl")["a"].maps["map_Kd"]


@pytest.mark.parametrize(
    ("line", "name"),
    [("map_Kd wood.png", "wood.png"), ("map_Kd -o 0 0 0 -s 2 2 my wood.png", "my wood.png"),
     ("map_Kd -clamp on a.png", "a.png"), ("map_Kd", "")],
)  # fmt: skip
def test_options_before_a_map_are_skipped(line: str, name: str) -> None:
    assert map_of(line).name == name


def test_options_of_a_map_move_the_coordinates() -> None:
    found = map_of("map_Kd -s 2 4 1 -o 0.1 0.2 0 -clamp on a.png")
    assert found.clamp and found.to_uv is not None
    # OBJ: (0.5, 0.25) scaled (1, 1), shifted (1.1, 1.2); from the top that is v = 1 - 1.2, and
    # the point itself stands at v = 0.75 from the top.
    assert np.allclose((found.to_uv @ [0.5, 0.75, 0, 1])[:2], [1.1, -0.2])


Edit = Callable[[Builder], None]
FIRST = ("meshes", 0, "primitives", 0)


def _edited(*path: str | int, to: Any) -> Edit:
    """The file's JSON with one part exchanged."""

    def edit(made: Builder) -> None:
        made.json = changed(made.json, path, to)

    return edit


def _without_scenes(made: Builder) -> None:
    made.json = changed(made.json, ("nodes", 0, "children"), 5)
    del made.json["scenes"]


def _buffer(length: int, uri: str) -> Edit:
    return _edited("buffers", to=[{"byteLength": length, "uri": uri}])


def _index(made: Builder) -> None:
    made.json = changed(made.json, (*FIRST, "indices"), made.accessor([0, 1, 99], "u2"))


def _nan(made: Builder) -> None:
    bad = SQUARE.copy()
    bad[1, 1] = np.nan
    place = (*FIRST, "attributes", "POSITION")
    made.json = changed(made.json, place, made.accessor(bad))


CHAIN = [{"children": [i + 1]} for i in range(2000)] + [{}]
HOSTILE: dict[str, tuple[Edit, str]] = {
    "cycle": (_edited("nodes", to=[{"children": [1]}, {"children": [0]}]), "tree"),
    "a chain of 2000 nodes": (_edited("nodes", to=CHAIN), "deep"),
    "view beyond the buffer": (_edited("bufferViews", 0, "byteLength", to=10**6),
                               "truncated or damaged"),
    "accessor beyond the view": (_edited("accessors", 0, "count", to=50_000_000), "end at byte"),
    "index beyond the vertices": (_index, "does not exist"),
    "NaN": (_nan, "not a finite number"),
    "a path that climbs": (_buffer(4, "../../../../etc/passwd"), "outside"),
    "a coded path that climbs": (_buffer(4, "..%2f..%2f..%2fetc%2fpasswd"), "outside"),
    "a buffer on the net": (_buffer(4, "https://example.org/a.bin"), "not downloaded"),
    "a short data URI": (_buffer(10**8, "data:;base64,AAAA"), "declares"),
    "a damaged data URI": (_buffer(4, "data:;base64,####"), "data URI"),
    "a quaternion of zero": (_edited("nodes", 0, "rotation", to=[0, 0, 0, 0]), "quaternion"),
    "a texture that is not there": (_edited("materials", 0, "pbrMetallicRoughness",
                                            to={"baseColorTexture": {"index": 7}}), "integer"),
    "version 1": (_edited("asset", to={"version": "1.0"}), "version"),
    "no asset": (_edited("asset", to=None), "no 'asset'"),
    "an unknown extension": (_edited("extensionsRequired", to=["VENDOR_x"]), "VENDOR_x"),
    "an extension that is no text": (_edited("extensionsRequired", to=[["VENDOR_x"]]), "VENDOR_x"),
    "children that are no list": (_without_scenes, "list of node numbers"),
    "nodes that are no list": (_edited("nodes", to={"a": 1}), "list of objects"),
    "a scene number that is text": (_edited("scene", to="x"), "integer"),
    "an empty file of nodes": (_edited("scenes", to=[{"nodes": []}]), "no surfaces"),
    "a node many times": (_edited("scenes", 0, "nodes", to=[0] * 4000), "referenced twice"),
}  # fmt: skip


def _refused(path: Path, tmp_path: Path, message: str) -> None:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    started = time.process_time()
    with pytest.raises(InputError, match=message):
        import_scene(path, tmp_path / "out")
    assert time.process_time() - started < 10
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 2**20
    assert sorted(item.name for item in tmp_path.iterdir()) == ["in"]


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_gltf_is_refused_with_a_reason(tmp_path: Path, name: str) -> None:
    edit, message = HOSTILE[name]
    made = square()
    edit(made)
    _refused(made.save(tmp_path / "in" / "model.gltf"), tmp_path, message)


def _glb(*chunks: tuple[int, bytes], length: int | None = None) -> bytes:
    body = b"".join(struct.pack("<II", len(data), kind) + data for kind, data in chunks)
    return b"glTF" + struct.pack("<II", 2, length or 12 + len(body)) + body


RAW = {
    "empty.gltf": (b"", "JSON is damaged"),
    "text.gltf": (b"hello", "JSON is damaged"),
    "nan.gltf": (b'{"asset":{"version":"2.0"},"x":NaN}', "NaN"),
    "deep.gltf": (b"[" * 200_000 + b"]" * 200_000, "JSON is damaged"),
    "short.glb": (b"glTF\2\0\0\0", "truncated"),
    "long.glb": (_glb((0x4E4F534A, b"{}  "), length=10**6), "truncated"),
    "chunk.glb": (b"glTF" + struct.pack("<IIII", 2, 24, 10**6, 0x4E4F534A) + b"{}  ", "beyond"),
    "binary.glb": (_glb((0x004E4942, b"0000")), "not JSON"),
    "empty.obj": (b"", "no faces"),
    "beyond.obj": (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "does not exist"),
    "nan.obj": (b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "not a finite number"),
    "two.obj": (b"v 0 0 0\nv 1 0 0\nf 1 2\n", "fewer than three"),
    "climb.obj": (b"mtllib ../../../etc/passwd\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "outside"),
    "words.obj": (b"v a b c\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "damaged"),
}


@pytest.mark.parametrize("name", RAW)
def test_damaged_files_are_refused_with_a_reason(tmp_path: Path, name: str) -> None:
    content, message = RAW[name]
    (tmp_path / "in").mkdir()
    path = tmp_path / "in" / name
    path.write_bytes(content)
    _refused(path, tmp_path, message)


def test_a_file_of_nothing_but_clear_glass_is_refused(tmp_path: Path) -> None:
    made = square(alphaMode="BLEND", pbrMetallicRoughness={"baseColorFactor": [1, 1, 1, 0]})
    with pytest.raises(InputError, match="nothing in the scene is visible"):
        import_scene(made.save(tmp_path / "glass.glb"), tmp_path / "out")


def test_an_image_of_a_billion_pixels_is_not_decoded(tmp_path: Path) -> None:
    bomb = base64.b64encode(empty_png(40_000, 40_000)).decode()
    uri = f"data:image/png;base64,{bomb}"
    made = square(pbrMetallicRoughness={"baseColorTexture": {"index": 0}})
    made.json["images"] = [{"uri": uri}]
    made.json["textures"] = [{"source": 0}]
    imported(square(), tmp_path / "warm")  # what is slow only once in a process
    started = time.monotonic()
    scene = imported(made, tmp_path)
    assert time.monotonic() - started < 10
    assert any("damaged texture" in change for change in scene.changes)


def test_a_damaged_library_is_refused_by_line(tmp_path: Path) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    (folder / "model.obj").write_text("mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (folder / "m.mtl").write_text("newmtl a\nKd 1 nan 0\n")
    with pytest.raises(InputError, match=r"m\.mtl:2: Kd"):
        import_scene(folder / "model.obj", tmp_path / "out")


def test_the_same_file_gives_the_same_bytes(tmp_path: Path) -> None:
    for turn in ("a", "b"):
        made = square(pbrMetallicRoughness={"baseColorTexture": {"index": 0}})
        made.texture(ruler())
        imported(made, tmp_path / turn)
    for file in sorted((tmp_path / "a" / "out").rglob("*")):
        if file.is_file():
            twin = tmp_path / "b" / "out" / file.relative_to(tmp_path / "a" / "out")
            assert file.read_bytes() == twin.read_bytes(), file.name


def test_json_and_binary_files_hold_the_same(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
    one, two = read(square(), tmp_path / "a", ".gltf"), read(square(), tmp_path / "b", ".glb")
    assert np.array_equal(one.shapes[0].mesh.vertices, two.shapes[0].mesh.vertices)
    assert json.loads((tmp_path / "a" / "model.gltf").read_text())["asset"]["version"] == "2.0"
    assert len(one.shapes[0].mesh.faces) == len(SQUARE_FACES) // 3


def read_triangles(path: Path, *_: object) -> Model:
    """A reader of bare corners, nine numbers a line."""
    corners = np.loadtxt(path, ndmin=2).reshape(-1, 3)
    mesh = Mesh(corners, np.arange(len(corners)).reshape(-1, 3))
    grey = plugin("bsdf", "twosided", bsdf=plugin("bsdf", "diffuse"))
    return Model([Shape("chair", "chair", mesh, Surface(grey, double=True))], kind="triangles")


def test_a_new_format_needs_no_more_than_a_reader(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A format of bare corners, nine numbers a line, comes in like any other."""
    assert ModelOptions.suffixes == tuple(READERS)
    monkeypatch.setitem(READERS, ".tri", f"{__name__}:read_triangles")
    (tmp_path / "chair.tri").write_text("0 0 0 1 0 0 0 1 0\n0 0 0 0 1 0 0 1 1\n")
    path, options = tmp_path / "chair.tri", ModelOptions()
    scene = import_model(path, tmp_path / "out", "chair", options, OpenedFiles(tmp_path))
    (chair,) = [item for item in scene.objects if item.shapes == ("chair",)]
    assert chair.category == "chair" and scene.source["kind"] == "triangles"
    assert np.allclose(np.subtract(chair.bbox_max, chair.bbox_min), [1, 1, 1])


def test_a_mesh_without_material_is_matt_and_black_vertex_colours_are_no_colours(
    tmp_path: Path,
) -> None:
    builder = Builder()
    number = builder.mesh()
    stored = builder.accessor(np.ones((4, 4)), "u2")
    builder.json["accessors"][stored]["normalized"] = True
    builder.json["meshes"][number]["primitives"][0]["attributes"]["COLOR_0"] = stored
    builder.node(mesh=number, name="Board")
    scene = imported(builder, tmp_path)
    assert values(scene, "principled", "base_color") == [[0.8, 0.8, 0.8]]
    assert values(scene, "principled", "metallic") == [[0]]
    assert any("black everywhere were left out: Board" in each for each in scene.changes)
