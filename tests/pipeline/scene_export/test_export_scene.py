"""Scenes exported as GLB and as archives: what comes back, and what the files hold."""

import json
import shutil
import struct
import subprocess
import zipfile
from collections import Counter
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mitsuba as mi
import numpy as np
import pytest

from pbrnet.pipeline.render import raycast
from pbrnet.pipeline.render.scene import open_scene, set_variant
from pbrnet.pipeline.scene_export.content import read_content
from pbrnet.pipeline.scene_export.export import export_scene
from pbrnet.pipeline.scene_export.glb import glb_bytes
from pbrnet.pipeline.scene_export.looks import LookReader
from pbrnet.pipeline.scene_export.outdoors import outdoors_of
from pbrnet.pipeline.views import CameraFile, View, as_matrix, save_cameras
from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.color import luminance
from pbrnet.scenes.contract import Joint, Scene, load_scene
from pbrnet.scenes.errors import InputError, MachineError, ParameterError
from pbrnet.scenes.geometry.directions import unit
from pbrnet.scenes.geometry.joints import world_axis
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.params import SceneParams
from pbrnet.scenes.photometry import LUMEN
from pbrnet.scenes.procedural.home import make_home
from pbrnet.scenes.registry import import_scene
from tests.fixtures.command import exit_code
from tests.fixtures.round_trips import equal

pytestmark = pytest.mark.slow  # round trips


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """A home of one or two rooms, in the sun."""
    folder = tmp_path_factory.mktemp("scenes") / "home"
    return load_scene(_made(folder, 7, "day"))


def _made(folder: Path, seed: int, light: str) -> Path:
    make_home(folder, folder.name, SceneParams(rooms_max=2, texture_size=64).home(seed, light))
    return folder


@pytest.fixture(scope="module")
def exported(home: Scene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The home as GLB."""
    path = tmp_path_factory.mktemp("exported") / "home.glb"
    export_scene(home.folder, "glb", path)
    return path


def _document(path: Path) -> dict:
    data = path.read_bytes()
    magic, version, length, size, kind = struct.unpack_from("<IIIII", data)
    assert (magic, version, kind) == (0x46546C67, 2, 0x4E4F534A)
    assert length == len(data)
    return json.loads(data[20 : 20 + size])


def _seen(scene: Scene) -> tuple[Float64Array, Float64Array]:
    """Reflectance and normal (N, 3) along rays to all sides from the middle of the first room."""
    set_variant("auto")
    room = scene.rooms[0]
    eye = np.array([*np.mean(room.floor, axis=0), 0.5 * (room.floor_z + room.ceiling_z)])
    directions = unit(np.random.default_rng(3).normal(size=(4000, 3)))
    hits = raycast.surfaces(open_scene(scene).geometry, eye, directions)
    return (
        np.asarray(hits.reflectance, np.float64),
        np.asarray(hits.shading_normal, np.float64),
    )


def test_a_home_comes_back_from_glb(home: Scene, exported: Path, tmp_path: Path) -> None:
    back = import_scene(exported, tmp_path / "back")
    assert all(equal(home, back).values())
    assert back.plan == home.plan  # so that both fall into the same split
    reflectance, normal = _seen(home)
    reflectance_back, normal_back = _seen(back)
    assert np.abs(reflectance - reflectance_back).mean() < 1e-3
    assert np.median(np.abs(normal - normal_back)) < 1e-4
    kinds = [Counter(one.get("type") for one in ElementTree.parse(s.xml).iter("bsdf"))
             for s in (home, back)]  # fmt: skip
    for kind in ("thindielectric", "principledthin", "normalmap"):
        assert kinds[0][kind] == kinds[1][kind]


def test_glb_holds_labels_lights_and_all_images(home: Scene, exported: Path) -> None:
    document = _document(exported)
    nodes = document["nodes"]
    root = nodes[document["scenes"][0]["nodes"][0]]
    up = np.reshape(root["matrix"], (4, 4)).T @ [0, 0, 1, 0]
    assert up.tolist() == [0, 1, 0, 0]
    labelled = {node["extras"]["id"]: node for node in nodes if "id" in node.get("extras", {})}
    assert {id_: node["extras"]["category"] for id_, node in labelled.items()} == {
        thing.id: thing.category for thing in home.objects
    }
    thing = home.objects[-1]
    children = [nodes[number] for number in labelled[thing.id]["children"]]
    assert tuple(child["name"] for child in children) == thing.shapes
    lows = []
    for child in children:
        primitive = document["meshes"][child["mesh"]]["primitives"][0]
        lows.append(document["accessors"][primitive["attributes"]["POSITION"]]["min"])
    low = np.min(lows, axis=0) + labelled[thing.id]["translation"]
    assert np.allclose(low, thing.bbox_min, atol=1e-3)
    assert all("bufferView" in image for image in document["images"])
    (sun,) = document["extensions"]["KHR_lights_punctual"]["lights"]
    assert sun["type"] == "directional" and 1e3 < sun["intensity"] < 2e5  # lux
    assert exported.with_name("home-sky.exr").is_file()
    held = json.loads(exported.with_name("home.glb.json").read_text())
    assert any("no sky" in line for line in held["not held"])
    kinds = [node["extras"].get("kind") for node in nodes if "extras" in node]
    assert kinds.count("window pane") == sum(portal.panes > 0 for portal in home.portals) > 0
    parents = {child: node for node in nodes for child in node.get("children", ())}
    leaves = [k for k, node in enumerate(nodes) if "joint" in node.get("extras", {})]
    for number, joint in zip(leaves, _in_order(home), strict=True):
        node, parent = nodes[number], parents[number]
        stated = node["extras"]["joint"]
        assert parent["name"] == joint.object
        place = np.add(parent["translation"], node["translation"])
        assert np.allclose(place, joint.pivot, atol=1e-6)
        assert "rotation" not in node and np.allclose(stated["axis"], world_axis(joint), atol=1e-9)
        assert stated["kind"] == ("prismatic" if joint.kind == "slide" else "revolute")
        assert (*stated["limits"], stated["current"]) == (*joint.limits, joint.value)
    assert (0, 90) in {joint.limits for joint in home.joints}


_VALIDATE = """const found = await require("gltf-validator").validateBytes(
new Uint8Array(require("fs").readFileSync(process.argv[1])), {maxIssues: 0});
console.log(JSON.stringify(found.issues.messages.filter(one => one.severity === 0)))"""


@pytest.mark.check
def test_khronos_validator_finds_no_error(exported: Path) -> None:
    """`npm install gltf-validator`, here or in NODE_PATH."""
    program = f"(async () => {{{_VALIDATE}}})()"
    try:
        done = subprocess.run(["node", "-e", program, exported], capture_output=True, text=True)
    except OSError:
        pytest.skip("there is no node")
    if "Cannot find module" in done.stderr:
        pytest.skip("there is no gltf-validator")
    assert json.loads(done.stdout) == []


def _in_order(scene: Scene) -> list[Joint]:
    """The joints of a scene, in the order of its objects."""
    return [joint for thing in scene.objects for joint in scene.joints if joint.object == thing.id]


def test_lamps_shine_in_candela_per_square_metre(tmp_path: Path) -> None:
    scene = load_scene(_made(tmp_path / "night", 3, "night"))
    content = read_content(scene.folder)
    path = tmp_path / "night.glb"
    path.write_bytes(glb_bytes(content, None))
    strengths = [
        one["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"]
        for one in _document(path)["materials"]
        if "emissiveFactor" in one
    ]
    glows = [glow for _, _, glow in content.materials if glow is not None]
    assert glows and len(strengths) == len(glows)
    plain = [max(glow.color) for glow in glows if glow.image is None]
    assert set(np.round(plain, 3)) <= set(np.round(strengths, 3))


def test_sky_and_sun_bring_the_light_of_the_scene(home: Scene) -> None:
    outdoors = outdoors_of(read_content(home.folder))
    assert outdoors is not None and outdoors.direction is not None
    height, width = outdoors.sky.shape[:2]
    polar = np.pi * (np.arange(height) + 0.5) / height
    weight = np.sin(polar) * np.maximum(np.cos(polar), 0) * 2 * np.pi**2 / (height * width)
    sky = float((luminance(outdoors.sky.astype(np.float64)) * weight[:, None]).sum())
    sun = float(luminance(np.array(outdoors.illuminance))) * max(-outdoors.direction[2], 0.0)
    sky_xml = next(
        one for one in ElementTree.parse(home.xml).getroot() if one.get("type") == "sunsky"
    )
    white = "<bsdf type='diffuse'><rgb name='reflectance' value='1'/></bsdf>"
    text = "<scene version='3.0.0'><integrator type='direct'/>"
    text += ElementTree.tostring(sky_xml, "unicode")
    text += f"<shape type='rectangle'>{white}</shape></scene>"
    scene = mi.load_string(text)
    camera = mi.load_dict(
        {
            "type": "orthographic",
            "to_world": mi.ScalarTransform4f().look_at([0, 0, 1], [0, 0, 0], [0, 1, 0]),
            "film": {"type": "hdrfilm", "width": 8, "height": 8, "rfilter": {"type": "box"}},
        }
    )
    seen = np.array(mi.render(scene, sensor=camera, spp=512), np.float64)[..., :3]
    expected = np.pi * float(luminance(seen).mean()) / LUMEN
    assert sky + sun == pytest.approx(expected, rel=0.04)


@pytest.mark.parametrize(("name", "suffix"), [("usd", ".usdc"), ("usdz", ".usdz")])
def test_a_home_comes_back_from_usd(name: str, suffix: str, home: Scene, tmp_path: Path) -> None:
    usd = pytest.importorskip("pxr.Usd")
    path = tmp_path / f"home{suffix}"
    done = export_scene(home.folder, name, path)
    assert any("sheets" in line for line in done.lost)
    back = import_scene(path, tmp_path / "back")
    assert all(equal(home, back).values())
    validation = pytest.importorskip("pxr.UsdValidation")  # since OpenUSD 24.11
    validators = validation.ValidationRegistry().GetOrLoadAllValidators()
    found = validation.ValidationContext(validators).Validate(usd.Stage.Open(str(path)))
    assert [error.GetErrorAsString() for error in found] == []


def test_usd_is_in_metres_with_labels_and_lights(home: Scene, tmp_path: Path) -> None:
    pytest.importorskip("pxr")
    from pxr import Usd, UsdGeom, UsdPhysics, UsdShade

    path = tmp_path / "home.usdc"
    export_scene(home.folder, "usd", path)
    stage = Usd.Stage.Open(str(path))
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    found = Counter(
        prim.GetAttribute("semantics:labels:category").Get()[0]
        for prim in stage.Traverse()
        if prim.HasAttribute("semantics:labels:category")
    )
    assert found == Counter(thing.category for thing in home.objects)
    meshes = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    names = {prim.GetDisplayName() for prim in meshes}
    names |= {name.partition(".leaf")[0] for name in names}
    assert names >= {shape for thing in home.objects for shape in thing.shapes}
    assert sum(name.startswith("pane-") for name in names) == len(home.portals) - 1  # the entrance
    assert all(UsdShade.MaterialBindingAPI(one).ComputeBoundMaterial()[0] for one in meshes)
    joints = [prim for prim in stage.Traverse() if prim.IsA(UsdPhysics.Joint)]
    values = [_joint_value(stage, joint) for joint in joints]
    assert sorted(values) == pytest.approx(sorted(one.value for one in home.joints), abs=1e-3)
    sun = stage.GetPrimAtPath("/World/Lights/sun")
    outdoors = outdoors_of(read_content(home.folder))
    assert outdoors is not None
    assert sun.GetAttribute("inputs:intensity").Get() == pytest.approx(max(outdoors.illuminance))
    for prim in stage.Traverse():
        file = prim.GetAttribute("inputs:file").Get() if prim.HasAttribute("inputs:file") else None
        assert file is None or (path.parent / file.path).is_file()


def _joint_value(stage: Any, joint: Any) -> float:
    """The position of a joint's second body against its first, as its frames and bodies state."""
    from pxr import Gf, UsdGeom, UsdPhysics

    frames = []
    for number in (0, 1):
        (body,) = joint.GetRelationship(f"physics:body{number}").GetTargets()
        turn = Gf.Rotation(Gf.Quatd(joint.GetAttribute(f"physics:localRot{number}").Get()))
        move = Gf.Vec3d(joint.GetAttribute(f"physics:localPos{number}").Get())
        world = UsdGeom.Xformable(stage.GetPrimAtPath(body)).ComputeLocalToWorldTransform(0)
        frames.append(Gf.Matrix4d(turn, move) * world)
    assert stage.GetPrimAtPath(body).HasAPI(UsdPhysics.RigidBodyAPI)
    between = frames[1] * frames[0].GetInverse()
    shift, turn = np.array(between.ExtractTranslation()), between.ExtractRotation()
    assert np.allclose(shift[:2], 0, atol=1e-5)
    if joint.IsA(UsdPhysics.PrismaticJoint):
        assert turn.GetAngle() == pytest.approx(0, abs=1e-4)
        return float(shift[2])
    assert shift[2] == pytest.approx(0, abs=1e-5)
    axis, angle = turn.GetAxis(), float(turn.GetAngle())
    assert angle < 1e-3 or abs(axis[2]) == pytest.approx(1, abs=1e-5)
    return angle if axis[2] > 0 or angle < 1e-3 else -angle


def test_light_is_a_variant_of_the_root(home: Scene, tmp_path: Path) -> None:
    usd = pytest.importorskip("pxr.Usd")
    for name in ("home", "home-v1"):
        shutil.copytree(home.folder, tmp_path / name)
    night = tmp_path / "home-v1"
    record = json.loads((night / "scene.json").read_text())
    (night / "scene.json").write_text(json.dumps({**record, "lighting": "night"}))
    lamp = next(thing for thing in home.objects if thing.category == "lamp")
    tree = ElementTree.parse(night / "scene.xml")
    for element in list(tree.getroot()):
        if element.get("type") == "sunsky":
            tree.getroot().remove(element)
        elif element.get("id") == lamp.shapes[0]:
            ElementTree.SubElement(element, "emitter", type="area")
    tree.write(night / "scene.xml")
    export_scene(tmp_path / "home", "usd", tmp_path / "home.usdc")
    stage = usd.Stage.Open(str(tmp_path / "home.usdc"))
    variants = stage.GetDefaultPrim().GetVariantSets().GetVariantSet("light")
    assert variants.GetVariantNames() == ["day", "night"]
    assert variants.GetVariantSelection() == "day"
    shining = {}
    for name in ("night", "day"):
        variants.SetVariantSelection(name)
        shining[name] = [prim for prim in stage.Traverse() if prim.GetAttribute(
            "inputs:emissiveColor").HasAuthoredValue()]  # fmt: skip
        assert stage.GetPrimAtPath("/World/Lights/sun").IsValid() == (name == "day")
        assert len(stage.GetPrimAtPath("/World/Objects").GetChildren()) >= len(home.objects)
    assert (len(shining["day"]), len(shining["night"])) == (0, 1)


def test_an_archive_comes_back_byte_by_byte(home: Scene, tmp_path: Path) -> None:
    for name in ("one", "two"):
        export_scene(home.folder, "mitsuba", tmp_path / f"{name}.zip")
    assert (tmp_path / "one.zip").read_bytes() == (tmp_path / "two.zip").read_bytes()
    names = zipfile.ZipFile(tmp_path / "one.zip").namelist()
    assert "home/scene.xml" in names and all(name.startswith("home/") for name in names)
    back = import_scene(tmp_path / "one.zip", tmp_path / "back", "home")
    assert back == home
    for path in home.folder.rglob("*.*"):
        assert (back.folder / path.relative_to(home.folder)).read_bytes() == path.read_bytes()


_MATERIALS = """<scene>
<bsdf type='twosided' id='coat'><bsdf type='principled'><rgb name='base_color' value='.2 .3 .4'/>
<float name='roughness' value='.3'/><float name='specular' value='.7'/>
<float name='clearcoat' value='.6'/><float name='clearcoat_gloss' value='.9'/></bsdf></bsdf>
<bsdf type='roughplastic' id='plastic'><float name='alpha' value='.09'/>
<float name='int_ior' value='1.5'/></bsdf>
<bsdf type='conductor' id='mirror'><string name='material' value='none'/>
<rgb name='specular_reflectance' value='.8'/></bsdf>
<bsdf type='roughdielectric' id='frosted'><float name='alpha' value='.25'/>
<float name='int_ior' value='1.4'/></bsdf>
<bsdf type='mask' id='net'><float name='opacity' value='.4'/><bsdf type='diffuse'/></bsdf>
<bsdf type='hair' id='hair'/>
</scene>"""


def test_materials_become_the_looks_that_formats_know() -> None:
    named = {one.get("id", ""): one for one in ElementTree.fromstring(_MATERIALS)}
    lost = Changes()
    looks = {name: LookReader(named, lost).look(one) for name, one in named.items()}
    coat = looks["coat"]
    assert coat.base == (0.2, 0.3, 0.4) and coat.two_sided
    assert (coat.roughness, coat.specular, coat.clearcoat) == (0.3, 0.7, 0.6)
    assert coat.clearcoat_roughness == pytest.approx(0.1)
    assert looks["plastic"].roughness == pytest.approx(0.3)  # the root of alpha
    assert looks["plastic"].specular == pytest.approx(0.5)  # 4 % at normal incidence
    assert looks["mirror"].base == pytest.approx((0.8, 0.8, 0.8))
    assert (looks["mirror"].metallic, looks["mirror"].roughness) == (1, 0)
    frosted = looks["frosted"]
    assert frosted.transmission == 1 and frosted.solid
    assert frosted.ior == pytest.approx(1.4)
    assert frosted.roughness == pytest.approx(0.5)
    assert looks["net"].opacity == 0.4
    assert any("hair" in line for line in lost.sentences())


def test_spheres_keep_their_place(home: Scene, tmp_path: Path) -> None:
    folder = tmp_path / "ball"
    shutil.copytree(home.folder, folder)
    shape = next(name for thing in home.objects if not thing.is_structure for name in thing.shapes)
    tree = ElementTree.parse(folder / "scene.xml")
    for element in tree.getroot().iter("shape"):
        if element.get("id") == shape:
            element.clear()
            element.attrib = {"type": "sphere", "id": shape}
            ElementTree.SubElement(element, "float", name="radius", value="0.25")
            ElementTree.SubElement(element, "point", name="center", x="1", y="2", z="3")
    tree.write(folder / "scene.xml")
    mesh = read_content(folder).pieces[shape].mesh
    assert np.allclose(mesh.bounds, [[0.75, 1.75, 2.75], [1.25, 2.25, 3.25]], atol=1e-3)


def test_a_damaged_description_is_refused_by_its_key(exported: Path, tmp_path: Path) -> None:
    data = exported.read_bytes()
    size = struct.unpack_from("<I", data, 12)[0]
    damaged = data[20 : 20 + size].replace(b'"max_depth":', b'"max_dept":')
    damaged = damaged.ljust(size)
    path = tmp_path / "damaged.glb"
    path.write_bytes(data[:20] + damaged + data[20 + size :])
    with pytest.raises(InputError, match="max_dept"):
        import_scene(path, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_wrong_places_and_scenes_are_refused(home: Scene, tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=r"\.glb"):
        export_scene(home.folder, "glb", tmp_path / "home.obj")
    (tmp_path / "pipe.zip").symlink_to("/dev/null")
    with pytest.raises(MachineError, match="not replaced"):
        export_scene(home.folder, "mitsuba", tmp_path / "pipe.zip")
    with pytest.raises(ParameterError, match="lies in the scene folder"):
        export_scene(home.folder, "mitsuba", home.folder / "home.zip")
    for options in ({"cameras": tmp_path / "views.json"}, {"panes": False}):
        with pytest.raises(ParameterError, match="leave out --cameras and --no-panes"):
            export_scene(home.folder, "mitsuba", tmp_path / "home.zip", **options)
    (tmp_path / "home.glb.json").write_text("{}")
    with pytest.raises(MachineError, match=r"home\.glb\.json: not replaced"):
        export_scene(home.folder, "glb", tmp_path / "home.glb")
    (tmp_path / "kitchen-sky.exr").write_bytes(b"mine")
    with pytest.raises(MachineError, match=r"kitchen-sky\.exr: not replaced"):
        export_scene(home.folder, "glb", tmp_path / "kitchen.glb")
    assert (tmp_path / "kitchen-sky.exr").read_bytes() == b"mine"
    (tmp_path / "own-textures").mkdir()
    with pytest.raises(MachineError, match="own-textures: not replaced"):
        export_scene(home.folder, "usd", tmp_path / "own.usdc")
    broken = tmp_path / "broken"
    broken.mkdir()
    (broken / "scene.json").write_bytes((home.folder / "scene.json").read_bytes())
    with pytest.raises(InputError, match=r"scene\.xml"):
        export_scene(broken, "glb", tmp_path / "broken.glb")
    (broken / "scene.xml").write_text("<scene version='3.0.0'><shape")
    with pytest.raises(InputError, match="XML"):
        export_scene(broken, "glb", tmp_path / "broken.glb")
    assert not (tmp_path / "broken.glb").exists()


def test_the_command_reports_what_the_format_does_not_hold(
    home: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "home.glb"
    assert exit_code("export-scene", home.folder, "--to", "glb", "--out", out) == 0
    assert "not held" in capsys.readouterr().out
    assert exit_code("export-scene", tmp_path / "none", "--to", "glb", "--out", out) == 3
    assert exit_code("export-scene", home.folder, "--to", "obj") == 2


@pytest.mark.check
def test_the_image_of_a_sky_comes_back_from_a_package(home: Scene, tmp_path: Path) -> None:
    pytest.importorskip("pxr")
    folder = tmp_path / "turned"
    shutil.copytree(home.folder, folder)
    tree = ElementTree.parse(folder / "scene.xml")
    (sky,) = [one for one in tree.getroot() if one.get("type") == "sunsky"]
    turn = ElementTree.SubElement(sky, "transform", name="to_world")
    ElementTree.SubElement(turn, "rotate", z="1", angle="20")
    tree.write(folder / "scene.xml")
    export_scene(folder, "usdz", tmp_path / "turned.usdz", panes=False)
    back = import_scene(tmp_path / "turned.usdz", tmp_path / "back")
    assert all(equal(load_scene(folder), back).values())
    assert ElementTree.parse(back.xml).find("emitter[@type='envmap']") is not None


def test_cameras_that_a_file_cannot_say_are_left_out_and_named(home: Scene, tmp_path: Path) -> None:
    plain = ((100.0, 0.0, 40.0), (0.0, 100.0, 30.0), (0.0, 0.0, 1.0))
    aside = ((100.0, 0.0, 35.0), *plain[1:])
    oblong = (plain[0], (0.0, 50.0, 30.0), plain[2])
    pose = as_matrix(np.eye(4))
    views = tuple(
        View(home.scene_id, name, 80, 60, K, pose)
        for name, K in {"plain": plain, "aside": aside, "oblong": oblong}.items()
    )
    save_cameras(tmp_path / "cameras.json", CameraFile(home.scene_id, views))
    content = read_content(home.folder, tmp_path / "cameras.json")
    assert [eye.name for eye in content.eyes] == ["sensor", "plain"]  # the scene's own first
    assert any("not plain perspective" in sentence for sentence in content.lost.sentences())
