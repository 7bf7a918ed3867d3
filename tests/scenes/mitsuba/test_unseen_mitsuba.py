"""Mitsuba scenes in the spelling of each version: all of them are imported completely."""

import re
from pathlib import Path
from xml.etree import ElementTree

import mitsuba as mi
import numpy as np
import pytest
from PIL import Image

from pbrnet.pipeline.render.leaks import find_leaks
from pbrnet.pipeline.render.scene import open_scene, set_variant
from pbrnet.scenes.contract import Scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.registry import import_scene
from tests.fixtures import mitsuba_files as files
from tests.fixtures.encoded import exr
from tests.fixtures.xml import bitmap, bsdf, emitter

PICTURE = "textures/a.png"
MATT = bsdf("diffuse")
# The materials of the scenes on Benedikt Bitterli's page and of Mitsuba's documentation.
MATERIALS = {
    "floor": bsdf("twosided", bsdf(
        "roughplastic", bitmap("diffuseReflectance", PICTURE, filterType="trilinear", uscale=4.0,
                               gamma="srgb"),
        alpha=0.1, distribution="ggx", intIOR=1.5, nonlinear=True)),
    "leaf": bsdf("mask", bitmap("opacity", PICTURE), bsdf("twosided", MATT)),
    "veil": bsdf("twosided", bsdf("mask", MATT, opacity=0.4)),
    "tap": bsdf("roughconductor", material="Cu"),
    "pan": bsdf("twosided", bsdf("conductor", material="none", specularReflectance=(0.9,))),
    "steel": bsdf("roughconductor", extEta=1.0, eta=(1.65746, 0.880369, 0.521229),
                  k=(9.22387, 6.26952, 4.837)),
    "glass": bsdf("dielectric", intIOR="bk7"),
    "paint": bsdf("plastic", '<spectrum name="diffuseReflectance" '
                  'value="400:0.1, 550:0.4, 700:0.8"/>'),
    "bump": bsdf("bumpmap", bitmap("map", PICTURE), bsdf("twosided", MATT), scale=3.0),
    "old gloss": bsdf("phong", exponent=50.0),
    "brushed": bsdf("ward", alphaU=0.1, alphaV=0.2),
    "curtain": bsdf("difftrans", transmittance=(0.5,)),
    "mixed": bsdf("blendbsdf", MATT, bsdf("roughconductor"), weight=0.3),
    "xyz": bsdf("diffuse", '<xyz name="reflectance" value="0.3 0.4 0.2"/>'),
}  # fmt: skip
LIGHTS = {
    "sky": emitter("sunsky", '<vector name="sunDirection" x="0.3" y="0.7" z="0.2"/>',
                   turbidity=3.0),
    "map": emitter("envmap", filename="textures/sky.exr"),
    "lamp that hangs": emitter("spot", '<transform name="toWorld">'
                               '<lookat origin="2,2,-1" target="2,0,-1"/></transform>'
                               '<spectrum name="intensity" value="400:2, 700:4"/>'),
    "even": emitter("constant", '<blackbody name="radiance" temperature="5000K"/>'),
}  # fmt: skip
KINDS = {"sky": {"sun", "sky"}, "map": {"environment"}, "lamp that hangs": {"spot"},
         "even": {"environment"}}  # fmt: skip
FRAME = (
    '<default name="spp" value="64"/><integrator type="volpath">'
    '<integer name="maxDepth" value="65"/></integrator><sensor type="thinlens">'
    '<float name="fov" value="60"/><float name="apertureRadius" value="0.01"/>'
    '<float name="focusDistance" value="2"/><transform name="toWorld">'
    '<lookat origin="3.5, 1.5, -0.5" target="1, 1, -2.5" up="0, 1, 0"/></transform>'
    '<sampler type="ldsampler"><integer name="sampleCount" value="$spp"/></sampler>'
    '<film type="ldrfilm"><integer name="width" value="64"/><integer name="height" value="48"/>'
    '<string name="fileFormat" value="png"/><float name="gamma" value="2.2"/>'
    '<rfilter type="tent"/></film></sensor>'
)


def modern(text: str) -> str:
    """`text` with names in the spelling of versions 2 and 3."""
    return re.sub(
        r'(?:name|value)="([a-z]+(?:[A-Z]\w*)+)"',
        lambda found: re.sub("([A-Z])", lambda one: "_" + one[1].lower(), found[0]),
        text,
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("mitsuba")
    (made / "textures").mkdir()
    noise = np.random.default_rng(0).integers(0, 255, (8, 8, 3), dtype=np.uint8)
    Image.fromarray(noise).save(made / "textures" / "a.png")
    (made / "textures" / "sky.exr").write_bytes(exr(np.full((8, 16, 3), 0.5, np.float32)))
    return made


def import_room(folder: Path, body: str, version: str, name: str) -> Scene:
    """Import a room of 4 x 3 m with `body` in it, given in the spelling of version 0.6."""
    inside = f"{FRAME}{files.room()}{body}"
    text = inside if version.startswith("0") else modern(inside)
    path = folder / f"{name}.xml"
    path.write_text(f'<scene version="{version}">{text}</scene>')
    return import_scene(path, folder / name, lamps="home")


@pytest.mark.slow
@pytest.mark.parametrize("version", ["0.4.0", "0.6.0", "3.0.0"])
def test_materials_of_every_version(folder: Path, version: str) -> None:
    """All of them in one room, each on a card of its own, and it renders."""
    set_variant("auto")
    cards = "".join(
        f'<shape type="rectangle" id="card_{place}"><transform name="toWorld"><scale value="0.2"/>'
        f'<translate x="{0.3 + 0.25 * place}" y="1" z="-1"/></transform>{bsdf}</shape>'
        for place, bsdf in enumerate(MATERIALS.values())
    )
    scene = import_room(folder, cards + LIGHTS["even"], version, f"all-{version}")
    assert len(scene.rooms) == 1
    shown = {name for thing in scene.objects for name in thing.shapes}
    assert len([name for name in shown if name.startswith("card")]) == len(MATERIALS)
    loaded = mi.load_file(str(scene.xml), optimize=False, parallel=False)
    image = np.asarray(mi.render(loaded, spp=1))
    assert np.isfinite(image).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", LIGHTS)
@pytest.mark.parametrize("version", ["0.5.0", "3.0.0"])
def test_lights_of_every_version(folder: Path, name: str, version: str) -> None:
    light = LIGHTS[name]
    scene = import_room(folder, light, version, f"light-{version}")
    assert {light.kind for light in scene.lights} == KINDS[name]
    assert len(scene.rooms) == 1


def test_a_lamp_that_looks_down_needs_no_up(folder: Path) -> None:
    scene = import_room(folder, LIGHTS["lamp that hangs"], "0.6.0", "down")
    root = ElementTree.parse(scene.xml).getroot()
    (matrix,) = root.iterfind("emitter[@type='spot']/transform/matrix")
    values = np.array(matrix.get("value", "").split(), dtype=float).reshape(4, 4)
    assert values[:3, 2] == pytest.approx([0, 0, -1], abs=1e-6)
    assert values[:3, 3] == pytest.approx([2, 1, 2], abs=1e-6)


def test_an_up_along_the_view_is_still_refused(folder: Path) -> None:
    light = LIGHTS["lamp that hangs"].replace('target="2,0,-1"', 'target="2,0,-1" up="0,1,0"')
    with pytest.raises(InputError, match="span no camera frame"):
        import_room(folder, light, "0.6.0", "bad")


def test_the_room_is_dark(folder: Path) -> None:
    set_variant("auto")
    assert (
        find_leaks(open_scene(import_room(folder, LIGHTS["even"], "0.6.0", "dark")), walks=500)
        == []
    )
