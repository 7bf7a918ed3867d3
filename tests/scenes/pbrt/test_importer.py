"""PBRT scenes of versions 3 and 4: what they say, in metres and Z up; nothing from outside."""

import gzip
import math
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
import pytest
from PIL import Image

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.contract import Scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.geometry.mesh import Mesh, face_areas
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.materials.textures import TextureStore, UnreadableImage, read_radiance
from pbrnet.scenes.importing.sandbox import Sandbox
from pbrnet.scenes.importing.shape import Shape
from pbrnet.scenes.opened_files import OpenedFiles
from pbrnet.scenes.pbrt import parser, reader, shapes
from pbrnet.scenes.pbrt.importer import cameras_of
from pbrnet.scenes.pbrt.lights import Lights, from_octahedral
from pbrnet.scenes.pbrt.materials import Materials
from pbrnet.scenes.pbrt.reader import PbrtScene, read_scene
from pbrnet.scenes.pbrt.shapes import ShapeReader
from pbrnet.scenes.pbrt.textures import Textures
from pbrnet.scenes.pbrt.values import Context
from pbrnet.scenes.registry import import_scene
from tests.fixtures.pbrt_files import HEAD_V4, LAMP, room, write

TRIANGLE = 'Shape "trianglemesh" "point3 P" [0 0 0 1 0 0 0 1 0] "integer indices" [0 1 2]'


class Read:
    """A scene file read without the assembly: shapes and emitters in the reader's world."""

    def __init__(self, folder: Path, body: str, head: str = HEAD_V4) -> None:
        path = write(folder, body, head)
        self.changes = Changes()
        context = Context(Sandbox(OpenedFiles(folder)), self.changes)
        self.scene: PbrtScene = read_scene(path, context)
        (folder / "textures").mkdir(exist_ok=True)
        self.store = TextureStore(folder / "textures", self.changes)
        self.textures = Textures(context, self.store)
        self.shapes: list[Shape] = ShapeReader(context, Materials(context, self.textures)).read(
            self.scene.shapes
        )
        lights = Lights(context, self.textures, self.store, np.eye(4))
        self.emitters = [
            made for light, pose in self.scene.lights if (made := lights.world(light, pose))
        ]
        self.area = [lights.area(one.emitter) for one in self.shapes if one.emitter is not None]

    @property
    def bsdf(self) -> Element:
        """The BSDF of the first shape, inside `twosided` if it is wrapped."""
        element = self.shapes[0].surface.element
        assert element is not None
        return element[0] if element.get("type") == "twosided" else element

    def said(self, *words: str) -> bool:
        """Return whether one of the changes holds all these words."""
        return any(all(word in change for word in words) for change in self.changes.sentences())


def value(element: Element, name: str) -> Float64Array:
    """The numbers of a property."""
    found = element.find(f"*[@name='{name}']")
    assert found is not None, ElementTree.tostring(element)
    return np.array(found.get("value", "").split(), dtype=float)


def front(mesh: Mesh) -> Float64Array:
    """The unit normal of the first face."""
    return face_areas(mesh.corners)[1][0]


def with_material(text: str, more: str = "") -> str:
    return f"{more}\nMaterial {text}\n{TRIANGLE}"


def imported(folder: Path, body: str, head: str = HEAD_V4, **options: object) -> Scene:
    return import_scene(write(folder / "in", body, head), folder / "out", **options)


def test_meshes_that_are_all_missing_are_named_though_they_may_be(tmp_path: Path) -> None:
    mesh = 'Shape "plymesh" "string filename" "{}.ply"\n'
    with pytest.raises(InputError, match=r"all meshes are missing, 'a\.ply' first of 2"):
        imported(tmp_path, mesh.format("a") + mesh.format("b"), skip_missing=True)
    scene = imported(tmp_path, room() + LAMP + mesh.format("a"), skip_missing=True)
    assert any("missing mesh" in change and "a.ply" in change for change in scene.changes)


def test_a_room_comes_in_upright_with_its_lamp_and_its_camera(tmp_path: Path) -> None:
    scene = imported(tmp_path, room() + LAMP)
    (found,) = scene.rooms
    corners = np.array(found.floor)
    assert np.ptp(corners, axis=0) == pytest.approx([4, 3], abs=0.02)
    assert found.ceiling_z - found.floor_z == pytest.approx(2.6, abs=0.02)
    assert [light.kind for light in scene.lights] == ["area"] and found.has_light
    root = ElementTree.parse(scene.xml).getroot()
    assert value(root.find("integrator"), "max_depth") == 9  # type: ignore[arg-type]
    (view,) = scene.source["views"]
    assert scene.source["kind"] == "pbrt" and len(scene.source["views"]) == 1
    assert (view["width"], view["height"]) == (64, 48)


@pytest.mark.parametrize("mirrored", [False, True])
def test_what_is_right_in_the_image_stays_right(tmp_path: Path, mirrored: bool) -> None:
    """pbrt's world is left-handed, unless the camera's transform mirrors it."""
    sign = -1 if mirrored else 1
    head = 'LookAt 0 0 0  0 0 1  0 1 0\nCamera "perspective"\n'
    if mirrored:
        head = "Scale -1 1 1\n" + head
    # The camera's +x is to the right, so that this triangle is seen right of the centre.
    body = f"Translate {sign} 0 5\n{TRIANGLE}"
    read = Read(tmp_path, body, head)
    pose = read.scene.camera_to_world @ np.diag([-1.0, 1, 1, 1])
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)
    seen = np.linalg.inv(pose) @ [*read.shapes[0].mesh.vertices.mean(axis=0), 1]
    assert seen[0] < 0 and seen[2] > 0  # Mitsuba's x axis points to the left


@pytest.mark.parametrize(
    ("width", "height", "more", "half"),
    [
        (200, 100, "", math.atan(2 * math.tan(math.radians(30)))),
        (100, 200, "", math.radians(30)),
        (100, 100, '"float screenwindow" [-.5 .5 -.5 .5]', math.atan(0.5 * math.tan(math.pi / 6))),
        (200, 100, '"float frameaspectratio" 1', math.radians(30)),
    ],
)
def test_field_of_view_is_that_of_the_shorter_side(
    tmp_path: Path, width: int, height: int, more: str, half: float
) -> None:
    head = (
        f'LookAt 2 1.5 1.5  3 1.5 2  0 1 0\nCamera "perspective" "float fov" 60 {more}\n'
        f'Film "image" "integer xresolution" {width} "integer yresolution" {height}'
    )
    read = Read(tmp_path, TRIANGLE, head)
    (camera,) = cameras_of(read.scene, read.changes)
    assert camera.half_fov_x == pytest.approx(half, abs=1e-6)


def test_transforms_apply_in_the_order_of_the_file(tmp_path: Path) -> None:
    body = f"""
    AttributeBegin
      Translate 1 2 3
      Rotate 90 0 0 1
      Scale 2 1 1
      {TRIANGLE}
    AttributeEnd
    TransformBegin
      Transform [ 1 0 0 0  0 1 0 0  0 0 1 0  5 6 7 1 ]
      CoordinateSystem "there"
    TransformEnd
    {TRIANGLE}
    CoordSysTransform "there"
    ConcatTransform [ 1 0 0 0  0 1 0 0  0 0 1 0  0 0 1 1 ]
    {TRIANGLE}
    Identity
    {TRIANGLE}"""
    meshes = [shape.mesh.vertices * [-1, 1, 1] for shape in Read(tmp_path, body).shapes]
    assert np.allclose(meshes[0], [[1, 2, 3], [1, 4, 3], [0, 2, 3]])
    assert np.allclose(meshes[1], meshes[3]) and np.allclose(meshes[1][1], [1, 0, 0])
    assert np.allclose(meshes[2][0], [5, 6, 8])


def test_instances_have_the_transforms_of_definition_and_use(tmp_path: Path) -> None:
    body = f"""
    ObjectBegin "chair"
      Translate 1 0 0
      {TRIANGLE}
      {TRIANGLE}
    ObjectEnd
    AttributeBegin
      Rotate 90 0 1 0
      ObjectInstance "chair"
    AttributeEnd
    Translate 0 5 0
    ObjectInstance "chair" """
    shapes = Read(tmp_path, body).shapes
    assert len(shapes) == 4 and len({shape.id for shape in shapes}) == 4
    assert all(shape.id.startswith("chair") for shape in shapes)
    first = shapes[0].mesh.vertices * [-1, 1, 1]
    assert np.allclose(first[0], [0, 0, -1]) and np.allclose(first[1], [0, 0, -2])
    assert np.allclose(shapes[2].mesh.vertices[0] * [-1, 1, 1], [1, 5, 0])


def test_fronts_follow_winding_normals_and_reverse_orientation(tmp_path: Path) -> None:
    normals = TRIANGLE + ' "normal N" [0 0 -1 0 0 -1 0 0 -1]'
    body = f"{TRIANGLE}\n{normals}\nReverseOrientation\n{TRIANGLE}\nScale 1 1 -1\n{TRIANGLE}"
    fronts = [front(shape.mesh)[2] for shape in Read(tmp_path, body).shapes]
    assert fronts == pytest.approx([1, -1, -1, 1])


def test_ply_files_are_read_packed_or_not_and_their_images_stand_upright(tmp_path: Path) -> None:
    ply = (
        b"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
        b"property float z\nproperty float u\nproperty float v\nelement face 1\n"
        b"property list uchar int vertex_indices\nend_header\n"
        b"0 0 0 0 0\n1 0 0 1 0\n1 1 0 1 1\n0 1 0 0 1\n4 0 1 2 3\n"
    )
    (tmp_path / "sofa.ply").write_bytes(ply)
    (tmp_path / "table.ply.gz").write_bytes(gzip.compress(ply))
    body = 'Shape "plymesh" "string filename" "sofa.ply"\n'
    body += 'Shape "plymesh" "string filename" [ "table.ply.gz" ]'
    shapes = Read(tmp_path, body).shapes
    assert [shape.name for shape in shapes] == ["sofa", "table"]
    for shape in shapes:
        assert len(shape.mesh.faces) == 2 and shape.mesh.uvs is not None
        bottom = shape.mesh.vertices[:, 1] == 0
        assert (shape.mesh.uvs[bottom, 1] == 1).all()  # the bottom row of an image


def test_all_shapes_have_their_area(tmp_path: Path) -> None:
    quad = '"point3 P" [0 0 0  1 0 0  0 2 0  1 2 0] "integer indices" [0 1 2 3]'
    body = f"""
    Shape "sphere" "float radius" 2
    Shape "disk" "float radius" 3 "float height" 1
    Shape "cylinder" "float radius" 1 "float zmin" 0 "float zmax" 2
    Shape "bilinearmesh" {quad}
    Shape "loopsubdiv" "integer levels" 3 "point3 P" [0 0 0 1 0 0 0 1 0] "integer indices" [0 1 2]
    Shape "curve" "point3 P" [0 0 0 1 0 0 1 1 0 0 1 0]"""
    read = Read(tmp_path, body)
    areas = [face_areas(shape.mesh.corners)[0].sum() for shape in read.shapes]
    known = [16 * math.pi, 9 * math.pi, 4 * math.pi, 2, 0.5]
    assert areas == pytest.approx(known, rel=3e-3)
    assert read.said("unsupported", "curve") and read.said("subdivision")


@pytest.mark.parametrize(
    ("material", "kind", "checks"),
    [
        ('"matte" "rgb Kd" [.1 .2 .3]', "diffuse", {"reflectance": [0.1, 0.2, 0.3]}),
        ('"diffuse" "rgb reflectance" [.1 .2 .3]', "diffuse", {"reflectance": [0.1, 0.2, 0.3]}),
        ('"diffuse" "spectrum reflectance" [400 .3 700 .3]', "diffuse", {"reflectance": [0.3] * 3}),
        ('"coateddiffuse" "float roughness" 0', "plastic", {"int_ior": 1.5}),
        ('"coateddiffuse" "float roughness" .25', "roughplastic", {"alpha": 0.5}),
        (
            '"coateddiffuse" "float roughness" .25 "bool remaproughness" false',
            "roughplastic",
            {"alpha": 0.25},
        ),
        ('"plastic" "float roughness" 1 "bool remaproughness" "false"', "roughplastic",
         {"alpha": 1, "specular_reflectance": [0.25] * 3}),
        ('"substrate" "rgb Ks" [.04 .04 .04]', "roughplastic", {"int_ior": 1.5}),
        ('"uber" "rgb Kd" [.2 .2 .2]', "roughplastic", {"diffuse_reflectance": [0.2] * 3}),
        ('"mirror"', "conductor", {"specular_reflectance": [0.9] * 3}),
        ('"metal" "float roughness" 1', "roughconductor", {"alpha": 1}),
        ('"conductor" "rgb reflectance" [.5 .4 .3]', "conductor",
         {"specular_reflectance": [0.5, 0.4, 0.3]}),
        ('"conductor" "rgb eta" [1 2 3] "rgb k" [4 5 6]', "conductor",
         {"eta": [1, 2, 3], "k": [4, 5, 6]}),
        ('"coatedconductor" "float conductor.roughness" .25', "roughconductor", {"alpha": 0.5}),
        ('"glass" "float index" 1.3', "dielectric", {"int_ior": 1.3}),
        ('"dielectric" "spectrum eta" "glass-BK7"', "dielectric", {"int_ior": 1.5168}),
        ('"dielectric" "float roughness" .25', "roughdielectric", {"alpha": 0.5}),
        ('"thindielectric" "float eta" 1.4', "thindielectric", {"int_ior": 1.4}),
        ('"disney" "rgb color" [.1 .2 .3] "float metallic" 1', "principled",
         {"base_color": [0.1, 0.2, 0.3], "metallic": 1}),
        ('"diffusetransmission" "rgb reflectance" [.1 .1 .1] "rgb transmittance" [.3 .3 .3]',
         "principledthin", {"base_color": [0.4] * 3, "diff_trans": 1.5}),
        ('"translucent" "rgb Kd" [.4 .4 .4]', "principledthin",
         {"base_color": [0.4] * 3, "diff_trans": 1}),
        ('"hair"', "roughplastic", {}),
    ],
)  # fmt: skip
def test_materials_keep_their_parameters(
    tmp_path: Path, material: str, kind: str, checks: dict[str, object]
) -> None:
    bsdf = Read(tmp_path, with_material(material)).bsdf
    assert bsdf.get("type") == kind
    for name, expected in checks.items():
        assert value(bsdf, name) == pytest.approx(np.atleast_1d(np.array(expected)), rel=1e-4)


def test_named_metals_are_mitsubas(tmp_path: Path) -> None:
    body = with_material('"conductor" "spectrum eta" "metal-Au-eta" "spectrum k" "metal-Au-k"')
    found = Read(tmp_path, body).bsdf.find("string[@name='material']")
    assert found is not None and found.get("value") == "Au"


def test_the_amount_of_a_mixture_is_the_firsts_in_version_3_and_the_seconds_in_4(
    tmp_path: Path,
) -> None:
    named = (
        'MakeNamedMaterial "a" "string type" "mirror"\n'
        'MakeNamedMaterial "b" "string type" "diffuse"'
    )
    old = with_material('"mix" "string namedmaterial1" "a" "string namedmaterial2" "b" '
                        '"rgb amount" [.3 .3 .3]', named)  # fmt: skip
    new = with_material('"mix" "string materials" ["a" "b"] "float amount" .3', named)
    for body, kinds in ((old, ["diffuse", "conductor"]), (new, ["conductor", "diffuse"])):
        bsdf = Read(tmp_path, body).bsdf
        assert value(bsdf, "weight") == pytest.approx(0.3)
        assert [one.get("type") for one in bsdf.findall("bsdf")] == kinds


def test_names_belong_to_their_block_in_version_3_and_are_known_everywhere_in_4(
    tmp_path: Path,
) -> None:
    body = f"""
    MakeNamedMaterial "m" "string type" "diffuse" "rgb reflectance" [.1 .1 .1]
    AttributeBegin
      MakeNamedMaterial "m" "string type" "diffuse" "rgb reflectance" [.2 .2 .2]
      MakeNamedMaterial "inner" "string type" "diffuse" "rgb reflectance" [.3 .3 .3]
    AttributeEnd
    NamedMaterial "m"
    {TRIANGLE}
    NamedMaterial "inner"
    {TRIANGLE}
    NamedMaterial "nobody"
    {TRIANGLE}"""
    read = Read(tmp_path, body)
    shades = []
    for shape in read.shapes:
        assert shape.surface.element is not None
        shades.append(value(shape.surface.element[0], "reflectance")[0])
    assert shades == pytest.approx([0.1, 0.3, 0.5])
    assert read.said("not defined became grey", "nobody")


def test_textures_are_scaled_tiled_and_cut_out(tmp_path: Path) -> None:
    Image.new("RGB", (4, 4), (200, 100, 50)).save(tmp_path / "wood.png")
    Image.new("L", (4, 4), 255).save(tmp_path / "leaf.png")
    body = f"""
    Texture "wood" "spectrum" "imagemap" "string filename" "wood.png" "float uscale" 2
        "float vscale" 3 "float vdelta" .25 "string wrap" "clamp"
    Texture "dark" "spectrum" "scale" "texture tex" "wood" "float scale" .5
    Texture "leaf" "float" "imagemap" "string filename" "leaf.png"
    Texture "tiles" "spectrum" "checkerboard" "rgb tex1" [1 0 0] "rgb tex2" [0 0 1]
        "float uscale" 8 "float vscale" 8
    Texture "lost" "spectrum" "imagemap" "string filename" "lost.png"
    Material "diffuse" "texture reflectance" "dark"
    {TRIANGLE} "texture alpha" "leaf"
    Material "diffuse" "texture reflectance" "tiles"
    {TRIANGLE}
    Material "diffuse" "texture reflectance" "lost"
    {TRIANGLE}"""
    read = Read(tmp_path, body)
    mask = read.shapes[0].surface.element
    assert mask is not None and mask.get("type") == "mask"
    bitmap = mask.find(".//texture[@name='reflectance']")
    assert bitmap is not None
    stored = bitmap.find("string[@name='filename']")
    assert stored is not None
    pixel = Image.open(tmp_path / stored.get("value", "")).getpixel((0, 0))
    assert np.abs(np.subtract(pixel, (147, 71, 34))).max() <= 2  # half the light
    matrix = bitmap.find("transform/matrix")
    assert matrix is not None
    to_uv = np.array(matrix.get("value", "").split(), float).reshape(4, 4)
    # v = 0.25 of the file is 0.75 of the mesh; 3 x 0.25 + 0.25 = 1 of the file is its 0.
    assert to_uv[:2, :2] @ [0.5, 0.75] + to_uv[:2, 3] == pytest.approx([1, 0])
    tiles = read.shapes[1].surface.element
    assert tiles is not None and tiles[0][0].get("type") == "checkerboard"
    assert read.said("missing texture", "lost.png")


def test_lights_keep_strength_place_and_direction(tmp_path: Path) -> None:
    body = f"""
    LightSource "point" "rgb I" [1 2 3] "float scale" 2 "point3 from" [1 2 3]
    LightSource "distant" "rgb L" [4 4 4] "point3 from" [0 1 0] "point3 to" [0 0 0]
    LightSource "spot" "blackbody I" [6500 10] "float coneangle" 40 "float conedeltaangle" 10
    LightSource "infinite" "rgb L" [.5 .6 .7]
    AreaLightSource "diffuse" "rgb L" [1 1 1] "float scale" 7 "bool twosided" true
    {TRIANGLE}"""
    read = Read(tmp_path, body)
    point, distant, spot, sky = (emitter.element for emitter in read.emitters)
    assert value(point, "intensity") == pytest.approx([2, 4, 6])
    assert value(point, "position") == pytest.approx([-1, 2, 3])  # mirrored in X
    assert value(distant, "direction") == pytest.approx([0, -1, 0])
    assert value(spot, "cutoff_angle") == 40 and value(spot, "beam_width") == 30
    assert value(spot, "intensity") @ [0.2126, 0.7152, 0.0722] == pytest.approx(10)
    assert value(sky, "radiance") == pytest.approx([0.5, 0.6, 0.7])
    assert read.area[0] is not None and value(read.area[0], "radiance") == pytest.approx([7] * 3)
    assert read.said("both sides")


def _pfm(pixels: Float64Array) -> bytes:
    height, width, _ = pixels.shape
    return f"PF\n{width} {height}\n-1.0\n".encode() + pixels[::-1].astype("<f4").tobytes()


@pytest.mark.parametrize("square", [False, True])
def test_environment_maps_shine_from_where_they_do_in_pbrt(tmp_path: Path, square: bool) -> None:
    """A bright spot in a known direction: latitude and longitude, or an octahedral square."""
    sought = np.array([0.6, -0.64, 0.48])  # in the light's frame
    if square:
        size = 64
        pixels = np.zeros((size, size, 3))
        # The third quadrant of the upper half: Clarberg's map for z >= 0.
        radius = math.sqrt(1 - sought[2])
        v = math.atan2(0.64, 0.6) * 2 / math.pi * radius
        column, row = ((1 + radius - v) / 2 * size, (1 - v) / 2 * size)
    else:
        pixels = np.zeros((32, 64, 3))
        turn = math.atan2(sought[1], sought[0]) / (2 * math.pi) % 1
        column, row = turn * 64, math.acos(sought[2]) / math.pi * 32
    pixels[int(row) - 1 : int(row) + 2, int(column) - 1 : int(column) + 2] = 5
    (tmp_path / "sky.pfm").write_bytes(_pfm(pixels))
    body = f'Rotate 90 1 0 0\nLightSource "infinite" "string filename" "sky.pfm"\n{TRIANGLE}'
    read = Read(tmp_path, body)
    stored = read.emitters[0].element.find("string[@name='filename']")
    assert stored is not None
    map_ = read_radiance(tmp_path / stored.get("value", ""))[..., 0]
    rows, columns = np.nonzero(map_ > 0.8 * map_.max())
    u = (columns.mean() + 0.5) / map_.shape[1] * 2 * math.pi
    theta = (rows.mean() + 0.5) / map_.shape[0] * math.pi
    # Mitsuba's envmap: +Y is the top row, u grows from -Z towards +X.
    local = np.array(
        [math.sin(theta) * math.sin(u), math.cos(theta), -math.sin(theta) * math.cos(u)]
    )
    matrix = read.emitters[0].element.find("transform/matrix")
    assert matrix is not None
    pose = np.array(matrix.get("value", "").split(), float).reshape(4, 4)[:3, :3]
    assert np.linalg.det(pose) == pytest.approx(1)
    # Rotated by 90 degrees about X, then mirrored in X as the world is.
    expected = np.array([-sought[0], -sought[2], sought[1]])
    assert pose @ local @ expected > math.cos(math.radians(6))


def test_an_octahedral_map_of_a_constant_sky_is_constant() -> None:
    assert np.allclose(from_octahedral(np.full((16, 16, 3), 2.0, np.float32)), 2)


def test_damaged_float_maps_are_refused(tmp_path: Path) -> None:
    for number, data in enumerate((b"PF\n4 4\n-1.0\n" + bytes(20), b"PF\n0 4\n-1\n", b"P6 1 1")):
        path = tmp_path / f"{number}.pfm"
        path.write_bytes(data)
        with pytest.raises(UnreadableImage):
            read_radiance(path)


def test_files_are_included_and_imports_keep_their_state_to_themselves(tmp_path: Path) -> None:
    tmp_path.joinpath("a.pbrt").write_text('Material "mirror"\n# the end')
    tmp_path.joinpath("b.pbrt.gz").write_bytes(gzip.compress(b'Material "mirror"'))
    body = f'Import "a.pbrt"\n{TRIANGLE}\nInclude "b.pbrt.gz"\n{TRIANGLE}'
    kinds = [
        shape.surface.element[0].get("type")
        for shape in Read(tmp_path, body).shapes
        if shape.surface.element is not None
    ]
    assert kinds == ["diffuse", "conductor"]


def test_attribute_sets_defaults(tmp_path: Path) -> None:
    body = f"""
    AttributeBegin
      Attribute "material" "rgb reflectance" [.2 .2 .2]
      Material "diffuse"
      {TRIANGLE}
    AttributeEnd"""
    assert value(Read(tmp_path, body).bsdf, "reflectance") == pytest.approx([0.2] * 3)


def _chain(folder: Path) -> str:
    for number in range(40):
        (folder / f"{number}.pbrt").write_text(f'Include "{number + 1}.pbrt"')
    return 'Include "0.pbrt"'


def _bomb(folder: Path) -> str:
    for number in range(12):
        (folder / f"{number}.pbrt").write_text(f'Include "{number + 1}.pbrt"\n' * 9)
    (folder / "12.pbrt").write_text("# nothing")
    return 'Include "0.pbrt"'


HOSTILE = {
    "unknown word": ("Nonsense 1 2", "unknown directive 'Nonsense'"),
    "open bracket": ('Shape "sphere" "float radius" [ 1', "bracket is not closed"),
    "open string": ('Shape "sphere', "string without an end"),
    "no value": ('Shape "sphere" "float radius" ]', "no value"),
    "no type": ('Shape "sphere" "radius" 1', "expected a parameter"),
    "words for numbers": ('Shape "sphere" "float radius" [ a ]', "expected numbers"),
    "infinite": ('Shape "sphere" "float radius" [ 1e400 ]', "not finite"),
    "short transform": ("Transform [ 1 2 3 ]", "16 numbers"),
    "flat transform": (f"Scale 0 1 1\n{TRIANGLE}", "not invertible"),
    "projective": (f"Transform [{' 1' * 16}]", "not affine"),
    "no axis": ("Rotate 90 0 0 0", "axis"),
    "end without begin": ("AttributeEnd", "AttributeEnd without AttributeBegin"),
    "crossed blocks": ("AttributeBegin TransformBegin AttributeEnd", "without AttributeBegin"),
    "deep": ("AttributeBegin\n" * 2000, "nested more than"),
    "unknown object": ('ObjectInstance "x"', "no object"),
    "nested objects": ('ObjectBegin "a" ObjectBegin "b"', "cannot be nested"),
    "outside": ('Include "../../../etc/passwd"', "outside"),
    "missing include": ('Include "none.pbrt"', "missing"),
    "missing mesh": ('Shape "plymesh" "string filename" "none.ply"', "--skip-missing"),
    "index": (TRIANGLE.replace("[0 1 2]", "[0 1 9]"), "does not exist"),
    "cage index": (TRIANGLE.replace("[0 1 2]", "[0 1 -9]").replace("trianglemesh", "loopsubdiv"),
                   "does not exist"),
    "odd indices": (TRIANGLE.replace("[0 1 2]", "[0 1]"), "multiple of 3"),
    "unknown shape": ('Shape "teapot"', "unknown type of shape"),
    "radius": ('Shape "sphere" "float radius" -1', "positive"),
    "mix of itself": (
        'MakeNamedMaterial "m" "string type" "mix" "string materials" ["m" "m"]\n'
        f'NamedMaterial "m"\n{TRIANGLE}',
        "inside themselves",
    ),
    "texture of itself": (
        'Texture "t" "spectrum" "scale" "texture tex" "t" "texture scale" "t"\n'
        f'Material "diffuse" "texture reflectance" "t"\n{TRIANGLE}',
        "inside themselves",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_scenes_are_refused_with_place_and_reason(tmp_path: Path, name: str) -> None:
    body, message = HOSTILE[name]
    path = write(tmp_path / "in", body)
    with pytest.raises(InputError, match=message) as caught:
        import_scene(path, tmp_path / "out")
    assert "scene.pbrt:" in str(caught.value)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("make", "message"), [(_chain, "deep"), (_bomb, "200 files")])
def test_chains_and_bombs_of_includes_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, make: object, message: str
) -> None:
    monkeypatch.setattr(parser, "MAX_INCLUDES", 200)
    with pytest.raises(InputError, match=message):
        Read(tmp_path, make(tmp_path))  # type: ignore[operator]


def test_instances_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reader, "MAX_SHAPES", 1000)
    body = f'ObjectBegin "a"\n{TRIANGLE}\nObjectEnd\n' + 'ObjectInstance "a"\n' * 1001
    with pytest.raises(InputError, match="1,000 shapes"):
        Read(tmp_path, body)


def test_comments_of_many_signs_take_linear_time(tmp_path: Path) -> None:
    read = Read(tmp_path, f"{'#' * 200_000}\n{TRIANGLE}\n{'# ' * 100_000}")
    assert len(read.shapes) == 1


def test_a_scene_without_light_gets_one_or_asks_for_sky(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--sky"):
        imported(tmp_path, room(), lamps="home")
    assert all(room.has_light for room in imported(tmp_path / "lit", room()).rooms)


def test_a_texture_that_is_its_own_value_ends(tmp_path: Path) -> None:
    body = (
        'Texture "t" "float" "constant" "texture value" "t"\n'
        f'Material "conductor" "texture roughness" "t"\n{TRIANGLE}'
    )
    assert Read(tmp_path, body).said("a texture of a number was replaced by its mean value")


def test_instances_are_counted_before_they_take_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shapes, "MAX_SCENE_TRIANGLES", 9)
    monkeypatch.setattr(Mesh, "transformed", lambda *_: pytest.fail("a mesh was placed"))
    body = f'ObjectBegin "o"\n{TRIANGLE}\nObjectEnd\n' + 'ObjectInstance "o"\n' * 10
    with pytest.raises(InputError, match="limit of 9 triangles"):
        Read(tmp_path, body)
