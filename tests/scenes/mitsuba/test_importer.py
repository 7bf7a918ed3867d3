"""Mitsuba scenes of all versions: upright, in metres, with a note for everything left out."""

import json
import struct
import time
import zlib
from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image
from shapely.geometry import Point, Polygon

from pbrnet.pipeline.cli import cli
from pbrnet.pipeline.render.scene import set_variant
from pbrnet.scenes.contract import Scene, load_scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.formats.ply import read_ply
from pbrnet.scenes.geometry.mesh import Mesh, cleaned, creased, smooth_normals
from pbrnet.scenes.geometry.primitives import cube, cylinder, disk, sphere
from pbrnet.scenes.importing.changes import UNSURE_SCALE, UNSURE_UP
from pbrnet.scenes.importing.materials.spectra import spectrum_to_rgb
from pbrnet.scenes.importing.materials.textures import read_rgbe
from pbrnet.scenes.mitsuba.values import snake
from pbrnet.scenes.reconstruction.orientation import guess_scale, upright
from pbrnet.scenes.registry import import_scene
from tests.fixtures.command import printed
from tests.fixtures.encoded import empty_png, exr
from tests.fixtures.mitsuba_files import (
    LAMP_0_6,
    SENSOR_0_6,
    ply,
    room,
    scene_text,
    serialized,
    usual,
    wall_with_hole,
    write,
)
from tests.fixtures.xml import bitmap, bsdf, emitter, texture

pytestmark = pytest.mark.usefixtures("few_walks")

TRIANGLE = ply([[1, 1, -1], [2, 1, -1], [1, 2, -1.5]], [[0, 1, 2]])
TEXTURED = (
    '<bsdf type="diffuse"><texture name="reflectance" type="bitmap">'
    '<string name="filename" value="{}"/></texture></bsdf>'
)
SPHERE = '<shape type="sphere"><float name="radius" value="{}"/></shape>'
IMAGE = texture("bitmap", filename="b.png")
VEIL = '<spectrum name="opacity" value=".4"/>'
MOVED = '<shape type="cube"><transform name="toWorld">{}</transform></shape>'
TRIANGLE_SHAPE = '<shape type="ply" id="thing"><string name="filename" value="t.ply"/></shape>'


def imported(folder: Path, body: str, version: str = "0.6.0", **options: object) -> Scene:
    """Write a scene and import it with its lengths as they are."""
    return import_scene(
        write(folder / "in", body, version), folder / "out", **{"scale": 1.0, **options}
    )


def said(scene: Scene, *words: str) -> bool:
    """Return whether one of the changes holds all these words."""
    return any(all(word in change for word in words) for change in scene.changes)


def loads(scene: Scene) -> object:
    """Load the scene in plain Mitsuba."""
    set_variant("auto")
    return mi.load_file(str(scene.xml), optimize=False, parallel=False)


def render(scene: object, spp: int = 16) -> np.ndarray:
    """A picture of a loaded scene through its own sensor."""
    return np.array(mi.render(scene, spp=spp, seed=1))[..., :3]


def test_y_up_becomes_z_up_and_stays_right_handed(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "t.ply").write_text(TRIANGLE)
    scene = imported(tmp_path, usual(TRIANGLE_SHAPE))
    found = read_ply(scene.folder / "meshes" / "thing.ply").vertices
    assert np.allclose(found, [[1, 1, 1], [2, 1, 1], [1, 1.5, 2]], atol=1e-6)
    assert said(scene, "+Y axis points up")


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_every_up_axis_is_turned_by_a_proper_rotation(axis: int, sign: float) -> None:
    up = sign * np.eye(3)[axis]
    turn = upright(up)
    assert np.allclose(turn @ up, [0, 0, 1])
    assert np.allclose(turn @ turn.T, np.eye(3))
    assert np.linalg.det(turn) == pytest.approx(1)


def test_look_at_becomes_an_opencv_pose(tmp_path: Path) -> None:
    scene = imported(tmp_path, usual())
    view = scene.source["views"][0]
    pose = np.array(view["camera_to_world"])
    # Y up (3.5, 1.5, -0.5) is Z up (3.5, 0.5, 1.5); the target (1, 1, -2.5) is (1, 2.5, 1).
    assert np.allclose(pose[:3, 3], [3.5, 0.5, 1.5])
    target = np.linalg.inv(pose) @ [1, 2.5, 1, 1]
    assert np.allclose(target[:2], 0, atol=1e-6) and target[2] > 0
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)
    assert pose[2, 1] < 0  # image rows grow downwards
    above = np.linalg.inv(pose) @ [1, 2.5, 2, 1]
    right = np.linalg.inv(pose) @ [*(np.array([1, 2.5, 1]) + np.cross(pose[:3, 2], [0, 0, 1])), 1]
    assert above[1] < 0 < right[0]
    assert view["half_fov_x"] == pytest.approx(np.radians(30))
    assert (view["width"], view["height"]) == (64, 48)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("axis", "half"),
    [("x", 0.5), ("y", 0.5 * 4 / 3), ("smaller", 0.5 * 4 / 3), ("larger", 0.5),
     ("diagonal", 0.5 * 0.8)],
)  # fmt: skip
def test_the_field_of_view_is_the_horizontal_one(tmp_path: Path, axis: str, half: float) -> None:
    fov = np.degrees(2 * np.arctan(0.5))
    sensor = SENSOR_0_6.replace(
        'value="60"/>', f'value="{fov}"/><string name="fovAxis" value="{axis}"/>'
    )
    scene = imported(tmp_path, sensor + LAMP_0_6 + room())
    assert np.tan(scene.source["views"][0]["half_fov_x"]) == pytest.approx(half)


def test_a_scene_in_centimetres_is_brought_to_metres(tmp_path: Path) -> None:
    sensor = SENSOR_0_6.replace("3.5, 1.5, -0.5", "350,150,-50").replace(
        "1, 1, -2.5", "100,100,-250"
    )
    lamp = LAMP_0_6.replace('x="2" y="2.2" z="-1.5"', 'x="200" y="220" z="-150"').replace(
        "0.1", "10"
    )
    scene = imported(tmp_path, sensor + lamp + room(scale=100), scale=None)
    (found,) = scene.rooms
    assert found.ceiling_z - found.floor_z == pytest.approx(2.6, abs=0.01)
    assert Polygon(found.floor).area == pytest.approx(12, rel=0.03)
    assert scene.source["views"][0]["camera_to_world"][2][3] == pytest.approx(1.5)
    assert said(scene, "centimetres")


@pytest.mark.parametrize("radio", [True, False])
def test_a_camera_that_looks_down_tells_no_up_axis(tmp_path: Path, radio: bool) -> None:
    """A room without a ceiling, Z up; Sionna's scenes have fixed axes, others raise a doubt."""
    sides = {
        "floor": ("4", "3", "0", "0", "0"), "north": ("4", "1.3", "90", "0", "3"),
        "south": ("4", "1.3", "-90", "0", "-3"),
    }  # fmt: skip
    body = "".join(
        f'<shape type="rectangle" id="{name}"><transform name="to_world"><scale x="{x}" y="{y}"/>'
        f'<rotate x="1" angle="{turn}"/><translate x="{east}" y="{north}" '
        f'z="{0 if name == "floor" else 1.3}"/></transform><ref id="itu"/></shape>'
        for name, (x, y, turn, east, north) in sides.items()
    )
    for name, east in (("west", -4), ("east", 4)):
        body += (
            f'<shape type="rectangle" id="{name}"><transform name="to_world"><scale x="1.3" y="3"/>'
            f'<rotate y="1" angle="90"/><translate x="{east}" z="1.3"/></transform></shape>'
        )
    name = "mat-itu_concrete" if radio else "mat-concrete"
    body = f'<bsdf type="diffuse" id="{name}"/>' + body.replace('"itu"', f'"{name}"')
    body += """<sensor type="perspective"><transform name="to_world">
        <lookat origin="0, 0, 20" target="0, 0, 0" up="-1, 0, 0"/></transform></sensor>"""
    scene = import_scene(write(tmp_path, body, "2.1.0"), tmp_path / "out")
    assert any(change.startswith(UNSURE_UP) for change in scene.changes) != radio
    if radio:
        (room,) = scene.rooms
        assert np.ptp(room.floor, axis=0) == pytest.approx([8, 6], abs=0.05)
        assert (room.floor_z, room.ceiling_z) == pytest.approx((0, 2.6), abs=0.01)


def test_units_are_guessed_by_the_height_of_a_room() -> None:
    assert guess_scale(2.6) == (1.0, "metres")
    assert guess_scale(260)[1] == "centimetres"
    assert guess_scale(2600)[1] == "millimetres"
    assert guess_scale(102)[1] == "inches"
    assert guess_scale(8.5)[1] == "feet"
    assert guess_scale(1e6)[0] * 1e6 == pytest.approx(2.7)


def cube_obj(smooth: str = "") -> str:
    corners = [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]
    faces = [(1, 3, 4, 2), (5, 6, 8, 7), (1, 2, 6, 5), (3, 7, 8, 4), (1, 5, 7, 3), (2, 4, 8, 6)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + [smooth]
    return "\n".join(lines + ["f " + " ".join(map(str, face)) for face in faces])


def test_an_obj_without_normals_is_smooth_unless_facets_are_asked_for(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "c.obj").write_text(cube_obj("s 1"))
    shape = '<shape type="obj" id="{}"><string name="filename" value="c.obj"/>{}{}</shape>'
    move = '<transform name="toWorld"><translate x="1" z="-2"/></transform>'
    body = usual(
        shape.format("soft", "", move)
        + shape.format("flat", '<boolean name="faceNormals" value="true"/>', move)
        + shape.format("crisp", '<float name="maxSmoothAngle" value="30"/>', move)
    )
    scene = imported(tmp_path, body)
    soft, flat, crisp = (
        read_ply(scene.folder / "meshes" / f"{name}.ply") for name in ("soft", "flat", "crisp")
    )
    assert len(soft.vertices) == 8 and soft.normals is not None
    centre = soft.vertices.mean(axis=0)
    outwards = (soft.vertices - centre) / np.linalg.norm(soft.vertices - centre, axis=1)[:, None]
    assert np.allclose(soft.normals, outwards, atol=1e-5)
    assert flat.normals is None
    assert crisp.normals is not None
    assert np.allclose(np.abs(crisp.normals).max(axis=1), 1, atol=1e-6)


def test_creases_follow_the_angle() -> None:
    box = Mesh(cube().vertices, cube().faces)
    assert np.allclose(np.abs(creased(box, 30).normals).max(axis=1), 1)
    assert np.allclose(np.abs(creased(box, 100).normals), 3**-0.5, atol=1e-6)


@pytest.mark.parametrize(
    "made", [cube(), disk(), sphere(), cylinder(np.zeros(3), np.array([0.0, 0, 2]), 0.5)],
    ids=["cube", "disk", "sphere", "cylinder"],
)  # fmt: skip
def test_primitives_face_where_their_normals_point(made: Mesh) -> None:
    normals = smooth_normals(made.vertices, made.faces) if made.normals is None else made.normals
    a, b, c = (made.corners[:, i] for i in range(3))
    face = np.cross(b - a, c - a)
    assert (np.linalg.norm(face, axis=1) > 0).all()
    assert ((face * normals[made.faces[:, 0]]).sum(axis=1) > 0).all()
    centre = made.vertices.mean(axis=0)
    if np.ptp(made.vertices, axis=0).min() > 0:
        assert ((face * (a - centre)).sum(axis=1) > 0).all()


def test_texture_coordinates_beyond_all_texels_become_zero() -> None:
    """A catalogue's vase has 3443870976 in its `vt`; its texture then returned 1e9."""
    uvs = np.array([[3443870976.0, 1.0], [0.25, np.nan], [-7.5, np.inf]])
    mesh, _ = cleaned(Mesh(np.eye(3), np.array([[0, 1, 2]]), None, uvs), "vase")
    assert mesh.uvs is not None and mesh.uvs.tolist() == [[0, 1], [0.25, 0], [-7.5, 0]]


@pytest.mark.parametrize("order", ["little", "big"])
def test_binary_ply_of_both_byte_orders_with_polygons(tmp_path: Path, order: str) -> None:
    sign = "<" if order == "little" else ">"
    path = tmp_path / "q.ply"
    header = (
        f"ply\nformat binary_{order}_endian 1.0\nelement vertex 4\nproperty float x\n"
        "property float y\nproperty double z\nproperty float u\nproperty float v\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = b"".join(
        struct.pack(sign + "ffdff", x, y, 0.5, x, y) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))
    )
    path.write_bytes(header.encode() + rows + struct.pack(sign + "B4i", 4, 0, 1, 2, 3))
    mesh = read_ply(path)
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert np.allclose(mesh.vertices[:, 2], 0.5)
    assert np.allclose(mesh.uvs, mesh.vertices[:, :2])


def test_the_right_mesh_of_a_serialized_file_is_read(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    faces = np.array([[0, 1, 2]])
    first = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    second = np.array([[1, 1, -1], [2, 1, -1], [1, 2, -1]])
    (tmp_path / "in" / "m.serialized").write_bytes(serialized([(first, faces), (second, faces)]))
    body = (
        '<shape type="serialized" id="second"><string name="filename" value="m.serialized"/>'
        '<integer name="shapeIndex" value="1"/></shape>'
    )
    scene = imported(tmp_path, usual(body))
    found = read_ply(scene.folder / "meshes" / "second.ply")
    assert np.allclose(found.vertices, [[1, 1, 1], [2, 1, 1], [1, 1, 2]])


def test_a_mirrored_shape_keeps_its_front(tmp_path: Path) -> None:
    shape = (
        '<shape type="cube" id="box"><transform name="toWorld"><scale x="-0.2" y="0.2" z="0.2"/>'
        '<translate x="2" y="0.5" z="-1"/></transform></shape>'
    )
    mesh = read_ply(imported(tmp_path, usual(shape)).folder / "meshes" / "box.ply")
    a, b, c = (mesh.corners[:, i] for i in range(3))
    assert ((np.cross(b - a, c - a) * (a - mesh.vertices.mean(axis=0))).sum(axis=1) > 0).all()


def test_instances_become_shapes_with_ids_of_their_own(tmp_path: Path) -> None:
    group = (
        '<shape type="shapegroup" id="g"><shape type="cube" id="leg">'
        '<transform name="toWorld"><scale value="0.1"/></transform></shape></shape>'
    )
    places = "".join(
        f'<shape type="instance" id="i{n}"><ref id="g"/><transform name="toWorld">'
        f'<translate x="{1 + n}" y="0.1" z="-1"/></transform></shape>'
        for n in range(2)
    )
    scene = imported(tmp_path, usual(group + places))
    ids = [shape for thing in scene.objects for shape in thing.shapes]
    assert "i0_leg" in ids and "i1_leg" in ids and "leg" not in ids
    centre = read_ply(scene.folder / "meshes" / "i1_leg.ply").vertices.mean(axis=0)
    assert np.allclose(centre, [2, 1, 0.1], atol=1e-6)


# The same pixels as Mitsuba's own loading, where it can load both

OWN = """
<integrator type="{integrator}">{inner}</integrator>
<sensor type="perspective"><float name="fov" value="60"/>
  <transform name="to_world">
    <lookat origin="0, 1.2, 3" target="0, 0.8, 0" up="0, 1, 0"/></transform>
  <film type="hdrfilm"><integer name="width" value="96"/><integer name="height" value="72"/>
    <rfilter type="box"/></film><sampler type="multijitter"/></sensor>
<bsdf type="twosided" id="ruled"><bsdf type="diffuse"><texture type="bitmap" name="reflectance">
  <string name="filename" value="ruler.png"/><string name="filter_type" value="nearest"/>
  <transform name="to_uv"><scale x="2"/></transform></texture></bsdf></bsdf>
<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="4"/>
  </transform><bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>
<shape type="obj"><string name="filename" value="c.obj"/><transform name="to_world">
  <rotate y="1" angle="-100"/><translate x="-1.5" z="0.5"/></transform><ref id="ruled"/></shape>
<shape type="rectangle"><transform name="to_world"><scale value="0.5"/>
  <translate x="0" y="0.7" z="-0.5"/></transform><ref id="ruled"/></shape>
<shape type="cube"><transform name="to_world"><scale value="0.3"/><rotate y="1" angle="20"/>
  <translate x="1.2" y="0.3"/></transform><ref id="ruled"/></shape>
<shape type="sphere"><point name="center" x="0.9" y="1.4" z="0"/><float name="radius" value="0.3"/>
  <ref id="ruled"/></shape>
<shape type="disk"><transform name="to_world"><scale value="0.25"/>
  <translate x="-0.9" y="1.7"/></transform></shape>
<shape type="cylinder"><point name="p0" x="-0.5" y="0" z="0.8"/>
  <point name="p1" x="-0.5" y="0.5" z="0.8"/><float name="radius" value="0.15"/>
  <ref id="ruled"/></shape>
<shape type="ply"><string name="filename" value="uv.ply"/></shape>
{light}
"""
AOVS = '<string name="aovs" value="d:depth,a:albedo,n:sh_normal"/>'
LIGHTS = {
    "envmap": '<emitter type="envmap"><string name="filename" value="sky.exr"/><float name="scale" '
    'value="0.7"/><transform name="to_world"><rotate y="1" angle="40"/></transform></emitter>',
    "point": '<emitter type="point"><point name="position" x="1" y="2" z="1.5"/>'
    '<rgb name="intensity" value="4, 3, 2"/></emitter>',
    "spot": '<emitter type="spot"><transform name="to_world"><lookat origin="1, 2.5, 2" '
    'target="0, 0.5, 0" up="0, 1, 0"/></transform><rgb name="intensity" value="9"/>'
    '<float name="cutoff_angle" value="25"/></emitter>',
    "directional": '<emitter type="directional"><vector name="direction" x="-1" y="-2" z="-1"/>'
    '<rgb name="irradiance" value="2"/></emitter>',
    "area": '<shape type="rectangle"><transform name="to_world"><scale value="0.4"/><rotate x="1" '
    'angle="90"/><translate y="2.6"/></transform><emitter type="area"><rgb name="radiance" '
    'value="9, 8, 7"/></emitter></shape>',
}  # fmt: skip


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A Y-up folder with a ruler texture, a sky, an OBJ with uv and smooth shading, and a PLY."""
    folder = tmp_path_factory.mktemp("own")
    ruler = np.zeros((16, 8, 3), dtype=np.uint8)
    ruler[..., 0] = np.linspace(250, 20, 16)[:, None]  # red fades from the top row down
    ruler[..., 1] = np.linspace(20, 250, 8)  # green grows to the right
    ruler[0] = (255, 255, 255)
    Image.fromarray(ruler).save(folder / "ruler.png")
    sky = np.full((16, 32, 3), 0.2, dtype=np.float32)
    sky[2:6, 4:9] = (20, 15, 8)
    sky[8:] = 0.05
    (folder / "sky.exr").write_bytes(exr(sky))
    angle = np.linspace(0, np.pi, 13)
    lines = [f"v {0.3 * np.cos(a)} {y} {0.3 * np.sin(a)}" for y in (0, 1) for a in angle]
    lines += [f"vt {a / np.pi} {y}" for y in (0, 1) for a in angle]
    lines += [
        f"f {i}/{i} {i + 13}/{i + 13} {i + 14}/{i + 14} {i + 1}/{i + 1}" for i in range(1, 13)
    ]
    (folder / "c.obj").write_text("\n".join(lines))
    (folder / "uv.ply").write_text(
        ply([[-1.4, 1.1, 0.3], [-1.0, 1.1, 0.3], [-1.2, 1.5, 0.1]], [[0, 1, 2]])
    )
    return folder


def both(own: Path, tmp_path: Path, body: str) -> tuple[object, object]:
    """The original in Mitsuba, and its import."""
    path = write(own, body, "3.0.0", name=f"{tmp_path.name}.xml")
    set_variant("auto")
    original = mi.load_file(str(path), optimize=False, parallel=False)
    scene = import_scene(path, tmp_path / "out", scale=1.0)
    return original, mi.load_file(str(scene.xml), optimize=False, parallel=False)


def test_depth_normals_and_textures_equal_mitsubas_own_loading(own: Path, tmp_path: Path) -> None:
    body = OWN.format(integrator="aov", inner=AOVS, light=LIGHTS["point"])
    original, copy = both(own, tmp_path, body)
    aov = mi.load_dict({"type": "aov", "aovs": "d:depth,a:albedo,n:sh_normal"})
    ours = np.array(mi.render(copy, integrator=aov, spp=1, seed=3))
    theirs = np.array(mi.render(original, integrator=aov, spp=1, seed=3))
    depth, albedo, normal = (slice(-7, -6), slice(-6, -3), slice(-3, None))
    turned = theirs[..., normal] @ np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0.0]]).T
    # The 96 sides of disk and cylinder leave a few rim pixels different.
    for mine, wanted in (
        (ours[..., depth], theirs[..., depth]),
        (ours[..., albedo], theirs[..., albedo]),
        (ours[..., normal], turned),
    ):
        wrong = (np.abs(mine - wanted) > 0.02).any(axis=-1)
        assert wrong.mean() < 0.01, f"{wrong.mean():.1%} of the pixels differ"


@pytest.mark.slow
@pytest.mark.parametrize("light", LIGHTS)
def test_lights_shine_as_in_mitsubas_own_loading(own: Path, tmp_path: Path, light: str) -> None:
    body = OWN.format(integrator="path", inner="", light=LIGHTS[light])
    original, copy = both(own, tmp_path, body)
    ours, theirs = (
        render(scene, 128).reshape(6, 12, 6, 16, 3).mean(axis=(1, 3)) for scene in (copy, original)
    )
    assert theirs.max() > 0.05
    assert np.allclose(ours, theirs, rtol=0.12, atol=0.03 * theirs.max())


@pytest.mark.parametrize(
    ("old", "new"),
    [("specularReflectance", "specular_reflectance"), ("intIOR", "int_ior"), ("alphaU", "alpha_u"),
     ("toWorld", "to_world"), ("kNN", "k_nn"), ("sunRadiusScale", "sun_radius_scale"),
     ("to_uv", "to_uv"), ("extEta", "ext_eta"), ("color0", "color0"), ("uoffset", "uoffset")],
)  # fmt: skip
def test_names_are_spelled_as_today(old: str, new: str) -> None:
    assert snake(old) == new


MATERIALS = {  # a material in the words of version 0.6, and what is said of its import
    "roughdiffuse": (bsdf("roughdiffuse", reflectance=(0.3,), alpha=0.4), "replaced by diffuse"),
    "ext_eta": (bsdf("roughconductor", alpha=0.1, extEta=1.0, eta=(1.6, 0.9, 0.5), k=(9, 6, 5)),
                ""),
    "ashikhmin": (bsdf("roughconductor", distribution="as", alphaU=0.1, alphaV=0.3),
                  "replaced by beckmann: 'as'"),
    "metal": (bsdf("conductor", material="Unobtainium"), "perfect mirror: 'Unobtainium'"),
    "negative eta": (bsdf("conductor", '<rgb name="eta" value="1.4,.2,-.01"/>'
                          '<spectrum name="k" value="-.02,2,3"/>'),
                     "measured metal became 0: 1.4,.2,-.01, -.02,2,3"),
    "phong": (bsdf("phong", exponent=50.0, diffuseReflectance=(0.4,), specularReflectance=(0.2,)),
              "phong was"),
    "ward": (bsdf("ward", variant="balanced", alphaU=0.1, alphaV=0.2), "ward was replaced"),
    "coating": (bsdf("coating", bsdf("diffuse", reflectance=(0.4, 0.1, 0.1)), intIOR=1.7),
                "replaced by plastic"),
    "coated metal": (bsdf("roughcoating", bsdf("conductor"), alpha=0.1), "clear coat"),
    "mixture": (bsdf("mixturebsdf", bsdf("diffuse"), bsdf("conductor"), weights="0.5, 0.3"),
                "replaced by blendbsdf"),
    "blend": (bsdf("blendbsdf", bsdf("diffuse"), bsdf("dielectric"), weight=0.3), ""),
    "bump": (bsdf("bumpmap", IMAGE, bsdf("plastic")), ""),
    "scaled bump": (bsdf("bumpmap", texture("scale", IMAGE, scale=3.0), bsdf("diffuse")),
                    "factor of a scaled texture"),
    "difftrans": (bsdf("difftrans", transmittance=(0.5,)), "difftrans was replaced"),
    "hk": (bsdf("hk", material="skin1"), "'hk'"),
    "mask": (bsdf("mask", VEIL, bsdf("twosided", bsdf("diffuse"))), ""),
    "two sided mask": (bsdf("twosided", bsdf("mask", VEIL, bsdf("diffuse"))), ""),
    "cut out": (bsdf("mask", bitmap("opacity", "a.png"), bsdf("diffuse")), "alpha channel: a.png"),
    "grid": (bsdf("diffuse", texture("gridtexture", name="reflectance")), "grid texture"),
    "checkerboard": (bsdf("diffuse", texture("checkerboard", name="reflectance", uscale=4.0)), ""),
    "trilinear": (bsdf("diffuse", bitmap("reflectance", "b.png", filterType="ewa", gamma=2.2,
                                         maxAnisotropy=8.0)), "replaced by bilinear: 'ewa'"),
    "scaled": (bsdf("diffuse", texture("scale", IMAGE, scale=0.5, name="reflectance")), ""),
    "vertex colours": (bsdf("diffuse", texture("vertexcolors", name="reflectance")),
                       "mesh vertices"),
    "missing texture": (bsdf("diffuse", bitmap("reflectance", "gone.png")), "'gone.png'"),
    "absolute path": (bsdf("diffuse", bitmap("reflectance", r"C:\\art\\B.PNG")), "as 'b.png'"),
    "spectrum": (bsdf("diffuse", '<spectrum name="reflectance" value="400:.1 500:.2 600:.7"/>'),
                 "measured spectrum"),
    "srgb": (bsdf("diffuse", '<srgb name="reflectance" value="#ff8000"/>'), ""),
    "too bright": (bsdf("diffuse", reflectance=(1.5,)), "clipped"),
    "unknown": (bsdf("marzipan"), "'marzipan'"),
    "unknown property": (bsdf("diffuse", sweetness=1.0), "'sweetness'"),
    "glass": (bsdf("dielectric", intIOR="water"), ""),
    "odd glass": (bsdf("roughdielectric", intIOR="jelly", distribution="phong"), "'jelly'"),
    "plastic": (bsdf("roughplastic", nonlinear=True, alphaU=0.1, alphaV=0.2), "made isotropic"),
}  # fmt: skip


@pytest.fixture(scope="module")
def old_materials(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """A room with a cube of each material."""
    folder = tmp_path_factory.mktemp("materials")
    (folder / "in").mkdir()
    Image.new("RGB", (8, 8), (90, 120, 200)).save(folder / "in" / "b.png")
    Image.new("RGBA", (8, 8), (90, 120, 200, 128)).save(folder / "in" / "a.png")
    cubes = "".join(
        f'<shape type="cube" id="cube{n}">{made}<transform name="toWorld"><scale value="0.1"/>'
        f'<translate x="{0.3 + 0.48 * (n % 8)}" y="0.5" z="{-0.5 - 0.48 * (n // 8)}"/></transform>'
        "</shape>"
        for n, (made, _) in enumerate(MATERIALS.values())
    )
    return imported(folder, usual(cubes))


@pytest.mark.slow
def test_old_materials_load_and_render(old_materials: Scene) -> None:
    shown = {shape for thing in old_materials.objects for shape in thing.shapes}
    assert shown >= {f"cube{n}" for n in range(len(MATERIALS))}
    image = render(loads(old_materials), 4)
    assert np.isfinite(image).all() and image.mean() > 0


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name, (_, change) in MATERIALS.items() if change])
def test_changes_of_old_materials_are_named(old_materials: Scene, name: str) -> None:
    assert said(old_materials, MATERIALS[name][1]), old_materials.changes


def test_no_surface_is_black_from_behind(tmp_path: Path) -> None:
    turned = usual(
        '<shape type="rectangle" id="sheet"><boolean name="flipNormals" value="true"/>'
        '<transform name="toWorld"><scale value="0.4"/><rotate y="1" angle="225"/>'
        '<translate x="2" y="1.2" z="-1.5"/></transform><bsdf type="diffuse"/></shape>'
    )
    scene = imported(tmp_path, turned)
    image = render(loads(scene), 16)
    assert (image.mean(axis=-1) > 0).mean() > 0.99


def test_spectra_of_constant_value_are_grey() -> None:
    grey = spectrum_to_rgb(np.array([300.0, 900.0]), np.array([0.4, 0.4]))
    assert np.allclose(grey, 0.4, atol=1e-9)
    red = spectrum_to_rgb(np.array([300.0, 600.0, 610.0, 900.0]), np.array([0, 0, 1.0, 1]))
    assert red[0] > 0.3 and red[0] > 3 * red[1] and red[0] > 10 * red[2]


SUN = '<vector name="sunDirection" x="1" y="1" z="-1"/>'
EMITTERS = {  # an emitter, the kind of light it becomes, and what is said of its import
    "spectrum": (emitter("constant", '<spectrum name="radiance" value="2.5"/>'), "environment", ""),
    "sky": (emitter("sky", SUN, turbidity=4.0, resolution=256), "sky", ""),
    "sun": (emitter("sun", SUN, sunRadiusScale=3.0), "sun", ""),
    "point": (emitter("point", '<point name="position" x="1" y="2" z="-1"/>'
                      '<spectrum name="intensity" value="2"/>'), "point", ""),
    "collimated": (emitter("collimated") + emitter("point"), "point", "'collimated'"),
    "blackbody": (emitter("constant", '<blackbody name="radiance" temperature="5000K" '
                          'scale="0.001"/>'), "environment", "blackbody"),
    "missing sky": (emitter("envmap", filename="gone.exr", scale=3.0), "environment", "'gone.exr'"),
    "unnamed sky": (emitter("envmap", filename="$sky"), "environment", "'$sky'"),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", EMITTERS)
def test_old_lights_load_and_their_changes_are_named(tmp_path: Path, name: str) -> None:
    emitter, kind, change = EMITTERS[name]
    scene = imported(tmp_path, SENSOR_0_6 + room(without=("north",)) + emitter)
    assert kind in {light.kind for light in scene.lights}
    assert not change or said(scene, change), scene.changes
    assert render(loads(scene), 4).mean() > 0


def test_the_sun_stands_where_it_stood(tmp_path: Path) -> None:
    sun = EMITTERS["sun"][0]
    scene = imported(tmp_path, SENSOR_0_6 + room(without=("north",)) + sun)
    text = scene.xml.read_text()
    direction = text.split('name="sun_direction" value="')[1].split('"')[0]
    assert np.allclose(np.array(direction.split(), dtype=float), np.array([1, 1, 1]) / 3**0.5)
    assert 'name="sun_aperture" value="1.6074"' in text


def test_parameters_take_what_is_given_then_the_files_default(tmp_path: Path) -> None:
    body = '<default name="w" value="80"/><default name="fov" value="50"/>' + usual().replace(
        'value="64"', 'value="$w"'
    ).replace('value="60"', 'value="$fov"')
    scene = imported(tmp_path, body, parameter={"fov": "90", "nothing": "1"})
    view = scene.source["views"][0]
    assert view["width"] == 80
    assert view["half_fov_x"] == pytest.approx(np.pi / 4)
    assert said(scene, "does not use", "nothing")


def test_a_sensor_without_its_parameters_is_left_out_by_name(tmp_path: Path) -> None:
    scene = imported(tmp_path, usual().replace("3.5, 1.5, -0.5", "$origin"))
    assert scene.source["views"] == []
    assert said(scene, "sensor was left out", "$origin")
    assert len(scene.rooms) == 1


def test_includes_and_aliases_are_followed(tmp_path: Path) -> None:
    write(tmp_path / "in", '<bsdf type="diffuse" id="paint"/>', name="materials.xml")
    shape = (
        '<include filename="materials.xml"/><alias id="paint" as="colour"/>'
        '<shape type="cube" id="thing"><ref id="colour"/><transform name="toWorld">'
        '<scale value="0.2"/><translate x="2" y="0.2" z="-1"/></transform></shape>'
    )
    scene = imported(tmp_path, shape + usual())
    assert "thing" in {thing.id for thing in scene.objects}


def test_a_closed_room_is_found_with_its_size(tmp_path: Path) -> None:
    scene = imported(tmp_path, usual())
    (found,) = scene.rooms
    floor = Polygon(found.floor)
    assert floor.area == pytest.approx(12, rel=0.02)
    assert floor.exterior.is_ccw
    assert np.allclose(floor.bounds, (0, 0, 4, 3), atol=0.05)
    assert found.floor_z == pytest.approx(0, abs=1e-3)
    assert found.ceiling_z == pytest.approx(2.6, abs=1e-3)
    assert floor.contains(Point(scene.source["views"][0]["camera_to_world"][0][3], 0.5))
    assert found.has_light and scene.portals == ()
    kinds = {thing.id: thing for thing in scene.objects}
    assert kinds["floor"].category == "floor" and kinds["ceiling"].category == "ceiling"
    assert all(kinds[name].is_structure for name in ("floor", "ceiling", "north", "west"))
    assert kinds["lamp"].category == "lamp" and not kinds["lamp"].is_structure
    (lamp,) = scene.lights
    assert (lamp.kind, lamp.room, lamp.shapes) == ("area", found.id, ("lamp",))
    assert scene.lighting == "night"


SKY = '<emitter type="constant"><rgb name="radiance" value="1"/></emitter>'


def test_a_window_becomes_a_portal_where_it_is(tmp_path: Path) -> None:
    scene = imported(tmp_path, SENSOR_0_6 + SKY + room(without=("north",)) + wall_with_hole())
    (portal,) = scene.portals
    corners = np.array(portal.polygon)
    assert portal.kind == "window" and portal.clear and portal.room == scene.rooms[0].id
    assert np.allclose(portal.normal, [0, 1, 0], atol=1e-6)
    assert np.allclose(corners.min(axis=0), [1.5, 3, 0.9], atol=0.06)
    assert np.allclose(corners.max(axis=0), [2.5, 3, 2.0], atol=0.06)
    assert scene.lighting == "day"


def pane(bsdf: str, z: float = -3.02) -> str:
    return (
        '<shape type="cube" id="pane"><transform name="toWorld">'
        '<scale x="0.5" y="0.55" z="0.004"/>'
        f'<translate x="2" y="1.45" z="{z}"/></transform>{bsdf}</shape>'
    )


def test_a_clear_pane_is_a_portal_and_no_longer_a_shape(tmp_path: Path) -> None:
    vase = (
        '<shape type="sphere" id="vase"><point name="center" x="1" y="0.1" z="-1"/>'
        '<float name="radius" value="0.1"/><bsdf type="dielectric"/></shape>'
    )
    body = SENSOR_0_6 + SKY + room(without=("north",)) + wall_with_hole() + vase
    scene = imported(tmp_path, body + pane('<bsdf type="dielectric"/>'))
    (portal,) = scene.portals
    assert portal.clear and portal.kind == "window"
    # The hole is in the wall at 3.0 m, and is closed there; the pane hangs 2 cm behind it.
    assert np.allclose(np.array(portal.polygon)[:, 1], 3.01, atol=0.015)
    ids = {shape for thing in scene.objects for shape in thing.shapes}
    assert "pane" not in ids and "vase" in ids
    assert said(scene, "became portals", "pane")
    # Light comes in straight: the floor is lit by the sky without a caustic in the way.
    assert render(loads(scene), 16).max() < 1.5


def test_a_frosted_pane_stays_and_its_portal_is_not_clear(tmp_path: Path) -> None:
    body = SENSOR_0_6 + SKY + room(without=("north",)) + wall_with_hole()
    rough = '<bsdf type="roughdielectric"><float name="alpha" value="0.4"/></bsdf>'
    scene = imported(tmp_path, body + pane(rough))
    (portal,) = scene.portals
    assert not portal.clear
    assert "pane" in {shape for thing in scene.objects for shape in thing.shapes}


def test_a_missing_wall_is_an_opening_and_the_room_ends_there(tmp_path: Path) -> None:
    scene = imported(tmp_path, SENSOR_0_6 + SKY + room(without=("north",)))
    assert Polygon(scene.rooms[0].floor).area == pytest.approx(12, rel=0.02)
    (portal,) = scene.portals
    assert portal.kind == "opening"
    assert np.ptp(np.array(portal.polygon)[:, 0]) == pytest.approx(4, abs=0.1)


@pytest.mark.parametrize(
    ("inner", "size"),
    [
        (room(without=("north",)) + wall_with_hole(), (4, 3)),
        (room(without=("south", "ceiling")), (4, 3)),
        ("", (16, 16)),  # a hall with a table
    ],
)
def test_a_box_around_a_room_is_a_backdrop(
    tmp_path: Path, inner: str, size: tuple[float, float]
) -> None:
    box = """<shape type="cube" id="{}"><transform name="toWorld">
        <scale x="{}" y="{}" z="{}"/><translate x="2" y="{}" z="-1.5"/></transform></shape>"""
    body = inner + box.format("table", 0.5, 0.35, 0.4, 0.36) + box.format("box", 8, 4, 8, 3.99)
    (found,) = imported(tmp_path, body + SENSOR_0_6 + LAMP_0_6).rooms
    assert np.ptp(found.floor, axis=0) == pytest.approx(size, abs=0.05)


def test_a_skylight_is_a_portal_that_points_up(tmp_path: Path) -> None:
    strips = {"a": (0, -3, 4, -2), "b": (0, -1, 4, 0), "c": (0, -2, 1.5, -1), "d": (2.5, -2, 4, -1)}
    roof = "".join(
        f'<shape type="rectangle" id="roof_{name}"><transform name="toWorld">'
        '<rotate x="1" angle="90"/>'
        f'<scale x="{(x1 - x0) / 2}" z="{(z1 - z0) / 2}"/>'
        f'<translate x="{(x0 + x1) / 2}" y="2.6" z="{(z0 + z1) / 2}"/></transform></shape>'
        for name, (x0, z0, x1, z1) in strips.items()
    )
    scene = imported(tmp_path, SENSOR_0_6 + SKY + room(without=("ceiling",)) + roof)
    portals = [portal for portal in scene.portals if portal.normal[2] > 0.9]
    assert len(portals) == 1
    corners = np.array(portals[0].polygon)
    assert np.allclose(corners.min(axis=0), [1.5, 1, 2.6], atol=0.08)
    assert np.allclose(corners.max(axis=0), [2.5, 2, 2.6], atol=0.08)


def test_a_door_between_rooms_is_no_portal(tmp_path: Path) -> None:
    second = room(without=("south",)).replace('id="', 'id="b_')
    second = second.replace('"/><scale value="1.0"/>', '"/><translate z="-3"/>')
    body = SENSOR_0_6 + LAMP_0_6 + SKY + room(without=("north",)) + second
    scene = imported(tmp_path, body + wall_with_hole((1.5, 0.0), (2.4, 2.0)))
    assert len(scene.rooms) == 2
    assert scene.portals == ()


def test_the_licence_is_read_or_its_absence_said_loudly(tmp_path: Path) -> None:
    first = imported(tmp_path / "a", usual())
    assert first.credits[0].licence == "unknown"
    assert said(first, "LICENCE OR AUTHOR UNKNOWN")
    (tmp_path / "b" / "in").mkdir(parents=True)
    (tmp_path / "b" / "in" / "LICENSE.txt").write_text(
        "This is 'The Room' by Some One, see https://creativecommons.org/licenses/by-sa/4.0/\n"
    )
    second = imported(tmp_path / "b", usual())
    credit = second.credits[0]
    assert (credit.title, credit.author, credit.licence) == ("The Room", "Some One", "CC-BY-SA-4.0")
    third = imported(tmp_path / "c", usual(), licence="CC0-1.0", author="Me")
    assert (third.credits[0].licence, third.credits[0].author) == ("CC0-1.0", "Me")


def test_the_same_import_gives_the_same_bytes(tmp_path: Path) -> None:
    body = SENSOR_0_6 + SKY + room(without=("north",)) + wall_with_hole()
    path = write(tmp_path / "in", body)
    for out in ("one", "two"):
        import_scene(path, tmp_path / out / "scene")
    for name in ("scene.xml", "scene.json", "meshes/floor.ply"):
        first, second = (tmp_path / out / "scene" / name for out in ("one", "two"))
        assert first.read_bytes() == second.read_bytes()


def test_a_scene_folder_is_checked_and_copied(tmp_path: Path) -> None:
    scene = imported(tmp_path, usual())
    again = import_scene(scene.folder, tmp_path / "copy")
    assert again.scene_id == "copy" and again.objects == scene.objects
    assert (tmp_path / "copy" / "meshes" / "floor.ply").is_file()
    (scene.folder / "scene.xml").unlink()
    with pytest.raises(InputError, match=r"scene\.xml is missing"):
        import_scene(scene.folder, tmp_path / "third")
    assert not (tmp_path / "third").exists()


def test_radiance_hdr_files_are_read(tmp_path: Path) -> None:
    path = tmp_path / "sky.hdr"
    pixels = bytes([128, 64, 32, 129]) * 6
    path.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 3\n" + pixels)
    assert np.allclose(read_rgbe(path), [1.0, 0.5, 0.25])


@pytest.mark.slow
def test_the_grey_and_white_room(shared_scenes: Path, tmp_path: Path) -> None:
    source = shared_scenes / "mitsuba" / "grey-white-room" / "scene.xml"
    if not source.is_file():
        pytest.skip("the Grey & White Room is not on this machine")
    started = time.monotonic()
    scene = import_scene(source, tmp_path / "room")
    seconds = time.monotonic() - started
    print(f"import: {seconds:.1f} s")
    assert seconds < 60
    (found,) = scene.rooms
    floor = Polygon(found.floor)
    assert np.allclose(floor.bounds, (0, 0, 5.12, 3.63), atol=0.05)
    assert found.floor_z == pytest.approx(0, abs=0.02)
    assert found.ceiling_z == pytest.approx(2.88, abs=0.02)
    eye = np.array(scene.source["views"][0]["camera_to_world"])[:3, 3]
    assert floor.buffer(0.02).contains(Point(eye[:2])) and 0 < eye[2] < 2.88
    windows = [portal for portal in scene.portals if portal.kind == "window"]
    assert len(windows) == 4 and all(portal.clear for portal in scene.portals)
    # Its fireplace has no top: an enclosure closes it, and the gaps.
    assert len(scene.portals) == 4 and "shell" in {thing.id for thing in scene.objects}
    assert [light.kind for light in scene.lights] == ["environment"]
    categories = {thing.category for thing in scene.objects if not thing.is_structure}
    assert {"sofa", "table", "plant", "mirror", "picture"} <= categories
    assert scene.credits[0].author == "Wig42" and scene.credits[0].licence == "CC-BY-3.0"
    loaded = loads(scene)
    # The room's own shapes and the enclosure.
    assert len(loaded.shapes()) == 65 + 1  # type: ignore[attr-defined]
    # Every window's normal points away from the room.
    centre = np.array([*floor.centroid.coords[0], 1.4])
    for portal in windows:
        assert (np.array(portal.polygon).mean(axis=0) - centre) @ portal.normal > 0


CUT_PLY = (
    b"ply\nformat binary_little_endian 1.0\nelement vertex 900\nproperty float x\n"
    b"property float y\nproperty float z\nelement face 1\n"
    b"property list uchar int vertex_indices\nend_header\n" + bytes(100)
)
ONE_MESH = serialized([(np.eye(3), np.array([[0, 1, 2]]))])
CLAIM = struct.pack("<I", 0x1000) + b"\0" + struct.pack("<QQ", 1 << 40, 1 << 40)
BOMB = struct.pack("<HH", 0x041C, 4) + zlib.compress(CLAIM + bytes(10**6))
DAMAGED: dict[str, bytes | str] = {  # files beside a bad scene
    "a.xml": '<scene version="0.6.0"><include filename="b.xml"/></scene>',
    "b.xml": '<scene version="0.6.0"><include filename="a.xml"/></scene>',
    "nan.ply": TRIANGLE.replace("2.0 1.0", "nan 1.0"),
    "index.ply": TRIANGLE.replace("3 0 1 2", "3 0 1 7"),
    "huge.ply": TRIANGLE.replace("element vertex 3", "element vertex 4000000000"),
    "cut.ply": CUT_PLY,
    "png.ply": b"\x89PNG" + bytes(64),
    "cut.serialized": ONE_MESH[: len(ONE_MESH) // 2],
    "bomb.serialized": BOMB + struct.pack("<QI", 0, 1),
    "one.serialized": ONE_MESH,
}


def in_room(more: str) -> str:
    """The text of a scene: a room, and something bad in it."""
    return scene_text(usual(more))


def mesh_of(file: str, more: str = "", kind: str = "") -> str:
    kind = kind or file.rpartition(".")[2]
    return in_room(f'<shape type="{kind}"><string name="filename" value="{file}"/>{more}</shape>')


def with_entity(entity: str) -> str:
    return scene_text(usual("&a;"), head=f"<!DOCTYPE x [<!ENTITY a {entity}>]>\n")


BAD: dict[str, tuple[bytes | str, str]] = {  # the scene file, and what is said of it
    "broken xml": ("<scene version='0.6.0'>\n<shape type='cube'>\n</scene>",
                   "scene.xml:3: is not well-formed"),
    "binary garbage": (bytes(range(256)) * 16, "scene.xml"),
    "empty file": ("", "scene.xml"),
    "another root": ("<html/>", "<scene>"),
    "no version": ("<scene><shape type='cube'/></scene>", "version"),
    "unknown encoding": ("<?xml version='1.0' encoding='utL-8'?><scene version='3.0.0'/>",
                         "utL-8"),
    "entity bomb": (with_entity('"aaaa"><!ENTITY b "&a;&a;&a;"'), "entities"),
    "outside entity": (with_entity('SYSTEM "file:///etc/passwd"'), "entities"),
    "too deep": (scene_text("<bsdf type='twosided'>" * 80 + "</bsdf>" * 80), "nested more than"),
    "too many elements": (scene_text("<float/>" * 300_001), "limit of 300,000 elements"),
    "empty scene": (scene_text(""), "no shapes"),
    "missing mesh": (mesh_of("gone.obj"), "'gone.obj' is missing"),
    "mesh climbs out": (mesh_of("../../../etc/passwd", kind="obj"), "outside the scene's folder"),
    "texture climbs out": (scene_text(usual(bsdf=TEXTURED.format("../" * 20 + "etc/passwd"))),
                           "outside the scene's folder"),
    "link climbs out": (mesh_of("link.ply"), "outside the scene's folder"),
    "include cycle": (in_room('<include filename="a.xml"/>'), "includes itself"),
    "missing include": (in_room('<include filename="gone.xml"/>'), "'gone.xml' is missing"),
    "nan vertices": (mesh_of("nan.ply"), "vertex 1 is not a finite number"),
    "bad index": (mesh_of("index.ply"), "vertex that does not exist"),
    "huge ply": (mesh_of("huge.ply"), "claims 4,000,000,000"),
    "truncated ply": (mesh_of("cut.ply"), "truncated"),
    "not a ply": (mesh_of("png.ply"), "not a PLY"),
    "truncated serialized": (mesh_of("cut.serialized"), "truncated"),
    "serialized bomb": (mesh_of("bomb.serialized"), "claims"),
    "serialized index": (mesh_of("one.serialized", '<integer name="shapeIndex" value="5"/>'),
                         "mesh 5 does not exist"),
    "unknown shape": (in_room('<shape type="teapot"/>'), "'teapot'"),
    "unknown reference": (in_room('<shape type="cube"><ref id="nobody"/></shape>'), "'nobody'"),
    "circular material": (in_room('<bsdf type="twosided" id="m"><ref id="m"/></bsdf>'
                                  '<shape type="cube"><ref id="m"/></shape>'), "inside themselves"),
    "circular instance": (in_room('<shape type="shapegroup" id="g"><shape type="instance">'
                                  '<ref id="g"/></shape></shape>'
                                  '<shape type="instance"><ref id="g"/></shape>'),
                          "inside themselves"),
    "id used twice": (in_room('<bsdf type="diffuse" id="m"/><bsdf type="plastic" id="m"/>'),
                      "used twice"),
    "words for numbers": (in_room(SPHERE.format("big")), "'big' is not a number"),
    "infinite number": (in_room(SPHERE.format("inf")), "not a finite number"),
    "flat transform": (in_room(MOVED.format('<scale value="0"/>')), "determinant"),
    "impossible camera": (in_room("").replace('value="60"', 'value="400"'), "field of view"),
    "negative colour": (in_room('<shape type="cube"><bsdf type="diffuse">'
                                '<rgb name="reflectance" value="-1"/></bsdf></shape>'),
                        "cannot be negative"),
    "half a vector": (in_room(MOVED.format('<translate value="1,2"/>')), "1 or 3 values"),
}  # fmt: skip


def test_missing_meshes_are_counted(tmp_path: Path) -> None:
    shapes = "".join(
        f'<shape type="obj"><string name="filename" value="{name}.obj"/></shape>' for name in "abca"
    )
    path = write(tmp_path / "in", SENSOR_0_6 + room() + shapes)
    with pytest.raises(InputError, match=r"3 meshes are missing, 'a\.obj' first"):
        import_scene(path, tmp_path / "out")
    alone = write(tmp_path / "alone", SENSOR_0_6 + shapes)
    with pytest.raises(InputError, match=r"all meshes are missing, 'a\.obj' first of 3"):
        import_scene(alone, tmp_path / "out", skip_missing=True)


@pytest.mark.slow
@pytest.mark.parametrize("name", BAD)
def test_bad_files_are_refused_with_a_clear_message(tmp_path: Path, name: str) -> None:
    content, message = BAD[name]
    path = tmp_path / "in" / "scene.xml"
    path.parent.mkdir()
    (path.parent / "link.ply").symlink_to("/etc/passwd")
    for file, data in {**DAMAGED, path.name: content}.items():
        (path.parent / file).write_bytes(data.encode() if isinstance(data, str) else data)
    out = tmp_path / "scenes" / "out"
    started = time.process_time()
    result = CliRunner().invoke(cli, ["import", str(path), "--out", str(out)])
    assert time.process_time() - started < 10
    error = result.exception
    assert isinstance(error, InputError), result.exception
    assert error.exit_code == 3
    assert message in str(error)
    assert "scene.xml" in str(error) or str(tmp_path) in str(error)
    assert not out.exists()
    assert not list(out.parent.glob(".partial*")) if out.parent.exists() else True


def test_unknown_kinds_and_foreign_folders_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.room").write_text("x")
    with pytest.raises(InputError, match="unknown kind"):
        import_scene(tmp_path / "a.room", tmp_path / "out")
    with pytest.raises(InputError, match="no such file"):
        import_scene(tmp_path / "b.xml", tmp_path / "out")
    with pytest.raises(InputError, match=r"without scene\.json"):
        import_scene(tmp_path, tmp_path.parent / "elsewhere")
    path = write(tmp_path / "in", usual())
    (tmp_path / "precious").mkdir()
    (tmp_path / "precious" / "letter.txt").write_text("keep me")
    with pytest.raises(InputError, match="not a scene folder"):
        import_scene(path, tmp_path / "precious")
    assert (tmp_path / "precious" / "letter.txt").read_text() == "keep me"


@pytest.mark.slow
@pytest.mark.parametrize(
    "content",
    [b"\x89PNG\r\n\x1a\n" + bytes(30), empty_png(40_000, 40_000), empty_png(64, 64), b""],
    ids=["garbage", "1.6 billion pixels", "no pixels", "empty"],
)  # fmt: skip
def test_a_damaged_texture_is_named_and_replaced(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "t.png").write_bytes(content)
    scene = imported(tmp_path, usual(bsdf=TEXTURED.format("t.png")))
    assert said(scene, "damaged texture", "t.png")
    loads(scene)


def test_a_truncated_environment_map_is_named_and_replaced(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    sky = np.random.default_rng(0).random((64, 128, 3), dtype=np.float32)
    whole = exr(sky)
    (tmp_path / "in" / "sky.exr").write_bytes(whole[: len(whole) // 2])
    emitter = '<emitter type="envmap"><string name="filename" value="sky.exr"/></emitter>'
    scene = imported(tmp_path, SENSOR_0_6 + room(without=("north",)) + emitter)
    assert said(scene, "environment map", "sky.exr")
    assert render(loads(scene), 4).mean() > 0


def test_missing_meshes_can_be_left_out(tmp_path: Path) -> None:
    body = usual('<shape type="obj"><string name="filename" value="gone.obj"/></shape>')
    scene = imported(tmp_path, body, skip_missing=True)
    assert said(scene, "missing mesh", "'gone.obj'")


def test_the_command_lists_what_was_found_and_lost(tmp_path: Path) -> None:
    path = write(tmp_path / "in", usual())
    out = tmp_path / "out"
    said = printed("import", path, "--out", out, "--author", "Me")
    for word in ("4.00 x 3.00 m", "2.60 m high", "1 area", "portals  none", "triangles", "+Y axis"):
        assert word in said
    assert load_scene(out).scene_id == "out"
    assert json.loads((out / "scene.json").read_text())["source"]["kind"] == "mitsuba"


@pytest.mark.parametrize(("size", "is_doubted"), [(0.4, True), (0.1, False)])
def test_a_still_life_is_no_room_of_large_cups(
    tmp_path: Path, size: float, is_doubted: bool
) -> None:
    cups = "".join(
        f'<shape type="cube" id="cup{x}"><transform name="toWorld"><scale value="{size / 2}"/>'
        f'<translate x="{x}" y="0.9" z="-1"/></transform></shape>'
        for x in (1, 2)
    )
    scene = imported(tmp_path, usual(cups), scale=None)
    doubts = [change for change in scene.changes if change.startswith(UNSURE_SCALE)]
    assert len(doubts) == is_doubted and all("crockery by name: 0.4 m" in each for each in doubts)
