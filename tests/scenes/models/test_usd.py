"""USD and USDZ: unit, up axis, instances, visibility, materials, lights, packages, damage."""

import math
import os
from pathlib import Path

import numpy as np
import pytest

from pbrnet.scenes import child_process
from pbrnet.scenes.contract import Scene
from pbrnet.scenes.errors import InputError, MachineError
from pbrnet.scenes.photometry import LUMEN
from pbrnet.scenes.registry import import_scene
from tests.fixtures import usd
from tests.fixtures.encoded import picture, zipped
from tests.fixtures.imported import CORNERS, RULED, look_down, ruler, values

pytestmark = pytest.mark.usefixtures("few_walks")

INSTALLED = pytest.mark.skipif(
    child_process.find_spec("pxr") is None, reason="the extra pbrnet[usd] is not installed"
)


def imported(
    folder: Path, content: str | bytes, name: str = "room.usda", **options: object
) -> Scene:
    path = folder / "in" / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return import_scene(path, folder / "out", **options)


def sizes(scene: Scene, name: str) -> list[list[float]]:
    """Sizes of all objects of this name, rounded to millimetres."""
    return [
        [round(b - a, 3) for a, b in zip(each.bbox_min, each.bbox_max, strict=True)]
        for each in scene.objects
        if each.name == name
    ]


def places(scene: Scene, name: str) -> list[list[float]]:
    """Lowest corners of all objects of this name, rounded to millimetres, sorted."""
    return sorted(
        [round(x, 3) for x in each.bbox_min] for each in scene.objects if each.name == name
    )


FURNISHED = usd.stage(
    usd.SHELL
    + f"""
def Xform "Chair_1" (instanceable = true; prepend references = </World/Store/Chair>)
{{
    double3 xformOp:translate = (100, 100, 1)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}}
def Xform "Chair_2" (instanceable = true; prepend references = </World/Store/Chair>)
{{
    double3 xformOp:translate = (300, 100, 1)
    float xformOp:rotateZ = 90
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateZ"]
}}
def PointInstancer "Vases"
{{
    rel prototypes = [</World/Vases/Vase>]
    int[] protoIndices = [0, 0, 0]
    point3f[] positions = [(200, 300, 1), (250, 300, 1), (400, 300, 1)]
    float3[] scales = [(1, 1, 1), (1, 1, 2), (1, 1, 1)]
    int64[] invisibleIds = [2]
    def Xform "Vase"
    {{
        {usd.box("body", [0, 0, 0], [10, 10, 30])}
    }}
}}
def Xform "Ghosts"
{{
    token visibility = "invisible"
    {usd.box("ghost", [10, 10, 10], [60, 60, 60])}
}}
{usd.box("stand_in", [10, 10, 10], [60, 60, 60], 'uniform token purpose = "proxy"')}
def Cylinder "Stool"
{{
    double radius = 20
    double height = 45
    double3 xformOp:translate = (400, 200, 23.5)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}}
def Camera "Eye"
{{
    float horizontalAperture = 20
    float verticalAperture = 15
    float focalLength = 10
    double3 xformOp:translate = (250, 50, 150)
    float xformOp:rotateX = 90
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateX"]
}}
def BasisCurves "hair"
{{
}}
class "Store"
{{
    def Xform "Chair"
    {{
        {usd.box("seat", [0, 0, 0], [40, 50, 45])}
    }}
}}
""",
    usd.PAINT,
)


@INSTALLED
def test_a_furnished_room(tmp_path: Path) -> None:
    scene = imported(tmp_path, FURNISHED)
    (room,) = scene.rooms
    assert room.ceiling_z - room.floor_z == pytest.approx(2.6, abs=0.01)
    assert np.ptp(room.floor, axis=0) == pytest.approx([5, 4], abs=0.05)
    # Instances of a class, the second turned by a right angle.
    assert sizes(scene, "Chair_1") == [[0.4, 0.5, 0.45]] and sizes(scene, "Chair_2") == [
        [0.5, 0.4, 0.45]
    ]
    assert places(scene, "Chair_2") == [[2.5, 1.0, 0.01]]
    # The third instance is invisible, the second twice as high.
    assert places(scene, "Vase") == [[2.0, 3.0, 0.01], [2.5, 3.0, 0.01]]
    assert sorted(size[2] for size in sizes(scene, "Vase")) == [0.3, 0.6]
    assert sizes(scene, "Stool") == [[0.4, 0.4, 0.45]]
    (view,) = scene.source["views"]
    pose = np.array(view["camera_to_world"])
    assert np.allclose(pose[:3, 3], [2.5, 0.5, 1.5])
    assert np.allclose(pose[:3, :3].T, [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-6)
    assert view["half_fov_x"] == pytest.approx(math.atan(1.0))
    assert not {"ghost", "stand_in", "hair"} & {each.name for each in scene.objects}
    text = "\n".join(scene.changes)
    assert "invisible prims were left out: Ghosts" in text and "purpose 'proxy'" in text
    assert "BasisCurves" in text
    assert [0.2, 0.4, 0.6] in values(scene, "principled", "base_color")


@INSTALLED
def test_y_up_and_the_default_unit(tmp_path: Path) -> None:
    shell = usd.box("shell", [0, 0, 0], [500, 260, 400])
    scene = imported(tmp_path, usd.stage(shell, unit=None, up="Y"))
    assert scene.rooms[0].ceiling_z - scene.rooms[0].floor_z == pytest.approx(2.6, abs=0.01)
    assert any("states no unit" in change for change in scene.changes)


GROUND = f"""
def Mesh "ground" (prepend apiSchemas = ["MaterialBindingAPI"])
{{
    uniform token subdivisionScheme = "none"
    uniform token orientation = "leftHanded"
    point3f[] points = {usd.points([[0, -8, 0], [0, 0, 0], [8, 0, 0], [8, -8, 0]])}
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    texCoord2f[] primvars:map = [(0, 0), (0, 1), (1, 1), (1, 0)] (interpolation = "faceVarying")
    {usd.bound("tiles")}
}}
"""


def tiles(file: str, transform: str = "") -> str:
    shown = "color3f inputs:diffuseColor.connect = </World/Looks/tiles/Image.outputs:rgb>"
    return usd.stage(
        GROUND, usd.material("tiles", shown, usd.image("tiles", file, transform)), unit=1
    )


def png() -> bytes:
    return picture(np.kron(ruler(), np.ones((16, 16, 1), np.uint8)))


@INSTALLED
@pytest.mark.parametrize("packed", [False, True])
def test_an_image_lies_the_right_way_round(tmp_path: Path, packed: bool) -> None:
    (tmp_path / "in").mkdir()
    if packed:
        members = {"room.usda": tiles("textures/ruler.png"), "textures/ruler.png": png()}
        scene = imported(tmp_path, zipped(members), "room.usdz")
        expected = RULED
    else:
        (tmp_path / "in" / "ruler.png").write_bytes(png())
        # A shift by half an image to the right shows the right half on the left.
        scene = imported(tmp_path, tiles("./ruler.png", "float2 inputs:translation = (0.5, 0)"))
        expected = [RULED[1], RULED[0], RULED[3], RULED[2]]
    assert np.allclose(look_down(scene, CORNERS), expected, atol=0.01)
    assert len(list((scene.folder / "textures").iterdir())) == 1


@INSTALLED
def test_materials(tmp_path: Path) -> None:
    looks = (
        usd.material("metal", "float inputs:roughness = 0.3\nfloat inputs:metallic = 1")
        + usd.material("glass", "float inputs:opacity = 0.1\nfloat inputs:ior = 1.4")
        + usd.material("screen", "color3f inputs:emissiveColor = (1, 2, 0)")
        + usd.material(
            "omni",
            "color3f inputs:diffuse_color_constant = (0.1, 0.2, 0.3)\n"
            "color3f inputs:emissive_color = (1, 1, 1)",
            kind="OmniPBR",
        )
    )
    subset = f"""
    def GeomSubset "top" (prepend apiSchemas = ["MaterialBindingAPI"])
    {{
        uniform token elementType = "face"
        uniform token familyName = "materialBind"
        int[] indices = [1]
        {usd.bound("omni")}
    }}
    color3f[] primvars:displayColor = [(0.7, 0.6, 0.5)]
"""
    world = (
        usd.box("a", [0, 0, 0], [1, 1, 1], usd.bound("metal"))
        + usd.box("b", [2, 0, 0], [3, 1, 1], usd.bound("glass"))
        + usd.box("c", [4, 0, 0], [5, 1, 1], usd.bound("screen"))
        + usd.box("d", [0, 2, 0], [1, 3, 1], subset)
    )
    scene = imported(tmp_path, usd.stage(world, looks, unit=1), sky=True)
    assert 0.3 in [round(each[0], 6) for each in values(scene, "principled", "roughness")]
    assert [1.0] in values(scene, "principled", "metallic")
    assert values(scene, "thindielectric", "int_ior") == [[pytest.approx(1.4)]]
    assert [0.1, 0.2, 0.3] in values(scene, "principled", "base_color")
    assert [0.7, 0.6, 0.5] in values(scene, "diffuse", "reflectance")
    # Emission of OmniPBR is off by default; the screen's is relative, 1 = 1000 cd/m^2.
    (radiance,) = [each for each in values(scene, "area", "radiance") if each[2] == 0]
    assert radiance == pytest.approx([1000 * LUMEN, 2000 * LUMEN, 0])
    assert any("OmniPBR" in change for change in scene.changes)


@INSTALLED
def test_lights(tmp_path: Path) -> None:
    def light(kind: str, name: str, inputs: str) -> str:
        place = (
            "double3 xformOp:translate = (250, 200, 240)\n"
            'uniform token[] xformOpOrder = ["xformOp:translate"]'
        )
        return f'def {kind} "{name}"\n{{\n{inputs}\n{place}\n}}\n'

    world = (
        usd.SHELL
        + light("RectLight", "panel", "float inputs:intensity = 1000\nfloat inputs:exposure = 1\n"
                "float inputs:width = 100\nfloat inputs:height = 50")
        + light("SphereLight", "spot", "float inputs:intensity = 5000\nfloat inputs:radius = 10\n"
                "float inputs:shaping:cone:angle = 30")
        + light("DistantLight", "sun", "float inputs:intensity = 700")
        + light("SphereLight", "off", "float inputs:intensity = 0")
        + light("DomeLight", "sky", "")
    )  # fmt: skip
    scene = imported(tmp_path, usd.stage(world, usd.PAINT))
    assert sorted({each.kind for each in scene.lights}) == [
        "area", "directional", "sky", "spot", "sun",
    ]  # fmt: skip
    assert values(scene, "area", "radiance") == [pytest.approx([2000 * LUMEN] * 3)]
    # A ball of radius 0.1 m shows a disc: I = L pi r^2.
    assert values(scene, "spot", "intensity") == [pytest.approx([50 * math.pi * LUMEN] * 3)]
    assert values(scene, "spot", "cutoff_angle") == [[pytest.approx(30)]]
    assert values(scene, "directional", "irradiance") == [pytest.approx([700 * LUMEN] * 3)]
    assert sizes(scene, "lamp panel") == [[1.0, 0.5, 0.0]]
    assert any("dome light: sky" in each for each in scene.changes)


@INSTALLED
def test_layers_beside_the_file_are_read_and_recorded(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "shell.usda").write_text(usd.stage(usd.SHELL, usd.PAINT))
    (tmp_path / "in" / "look.mtlx").write_text("<materialx version='1.38'/>")
    world = 'def "all" (references = [@./shell.usda@, @gone.usd@, @look.mtlx@])\n{\n}'
    scene = imported(tmp_path, usd.stage(world))
    assert len(scene.rooms) == 1
    (said,) = [each for each in scene.changes if each.startswith("layers that are missing")]
    assert "gone.usd" in said and "look.mtlx" in said


@INSTALLED
def test_a_stage_whose_references_are_all_missing_names_them(tmp_path: Path) -> None:
    names = [f"assets/chair_{number}/chair.usd" for number in range(7)]
    references = ", ".join(f"@./{name}@" for name in names)
    world = f'def "all" (references = [{references}])\n{{\n}}'
    with pytest.raises(InputError) as caught:
        imported(tmp_path, usd.stage(world))
    said = str(caught.value)
    assert "7 of the files that it references are missing" in said
    assert ", ".join(names[:5]) + " and 2 more" in said


WHOLE = usd.stage(usd.SHELL, usd.PAINT)
REFUSED: dict[str, tuple[str, bytes, str]] = {
    "half a file": ("a.usda", WHOLE[: len(WHOLE) // 2].encode(), r"a\.usda: damaged USD file"),
    "a crate cut short": ("a.usdc", b"PXR-USDC" + bytes(80), r"a\.usdc: damaged USD file"),
    "no zip": ("a.usdz", b"PK\3\4 and no more", "not a USDZ package"),
    "outside": ("a.usda", usd.stage('def "x" (references = @../../b.usd@)\n{\n}').encode(),
                r"lies outside the scene's folder .* --root"),
    "a vertex that is not there": ("a.usda", WHOLE.replace("[0, 3,", "[99, 3,").encode(),
                                   "does not exist"),
}  # fmt: skip


@INSTALLED
@pytest.mark.parametrize("name", REFUSED)
def test_files_are_refused_with_a_reason(tmp_path: Path, name: str) -> None:
    file, content, message = REFUSED[name]
    with pytest.raises(InputError, match=message):
        imported(tmp_path, content, file)
    assert not (tmp_path / "out").exists()


@INSTALLED
def test_a_package_that_leads_out_is_refused(tmp_path: Path) -> None:
    package = zipped({"room.usda": WHOLE, "../evil.png": b""})
    with pytest.raises(InputError, match="a path that leads out"):
        imported(tmp_path, package, "a.usdz")


def test_without_the_library_the_error_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(child_process, "find_spec", lambda _: None)
    with pytest.raises(MachineError, match=r"room\.usda: .* install pbrnet\[usd\]"):
        imported(tmp_path, WHOLE)


def leave_by(how: str) -> None:
    """The ways in which a child process may end."""
    if how == "abort":
        os.abort()
    if how == "memory":
        np.ones(2**31)
    if how == "spin":
        while True:
            pass


@pytest.mark.check
@pytest.mark.parametrize(
    ("how", "message"),
    [("abort", "failed on it"), ("memory", "failed on it"), ("spin", "more than 2 s")],
)
def test_a_child_that_ends_badly_is_an_input_error(tmp_path: Path, how: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        child_process.run_child(
            "tests.scenes.models.test_usd:leave_by", (how,), tmp_path / "a.usd", 2, 2**33
        )
