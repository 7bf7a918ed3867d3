"""Features of Mitsuba 0.4 to 0.6 scenes: groups, includes, spectra, emitters, cameras."""

import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from pbrnet.scenes.contract import Scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.formats.ply import read_ply
from pbrnet.scenes.importing.materials.spectra import blackbody_radiance
from pbrnet.scenes.registry import import_scene
from tests.fixtures.mitsuba_files import LAMP_0_6, SENSOR_0_6, room, usual, write
from tests.fixtures.xml import bsdf, emitter, plugin, prop, texture

pytestmark = pytest.mark.usefixtures("few_walks")


def imported(folder: Path, body: str, version: str = "0.6.0", **options: object) -> Scene:
    """Write a scene and import it with its lengths as they are."""
    path = write(folder / "in", body, version)
    return import_scene(path, folder / "out", **{"scale": 1.0, **options})


def colours(scene: Scene, name: str) -> list[list[float]]:
    """All values called `name` in `scene.xml`."""
    text = scene.xml.read_text()
    parts = text.split(f'name="{name}" value="')[1:]
    return [[float(word) for word in part.split('"')[0].split()] for part in parts]


CUBE = (
    '<shape type="cube" id="{}"><transform name="toWorld"><scale value="0.1"/></transform>'
    "{}</shape>"
)


def test_a_group_in_a_group_multiplies_its_places(tmp_path: Path) -> None:
    inner = f'<shape type="shapegroup" id="leg">{CUBE.format("foot", "")}</shape>'
    outer = (
        '<shape type="shapegroup" id="table"><shape type="instance" id="a"><ref id="leg"/>'
        '<transform name="toWorld"><translate x="0.5"/></transform></shape></shape>'
    )
    place = (
        '<shape type="instance" id="t"><ref id="table"/><transform name="toWorld">'
        '<rotate y="1" angle="90"/><translate x="2" y="0.1" z="-1"/></transform></shape>'
    )
    # The instances stand before the groups that they show.
    scene = imported(tmp_path, usual(place + outer + inner))
    (shape,) = [s for thing in scene.objects for s in thing.shapes if "foot" in s]
    centre = read_ply(scene.folder / "meshes" / f"{shape}.ply").vertices.mean(axis=0)
    # (0.5, 0, 0) turned by 90 degrees about +Y is (0, 0, -0.5); moved (2, 0.1, -1.5); Z up.
    assert np.allclose(centre, [2, 1.5, 0.1], atol=1e-6)


def test_members_of_a_group_are_called_after_what_it_is(tmp_path: Path) -> None:
    group = f'<shape type="shapegroup" id="oak chair">{CUBE.format("mesh_7", "")}</shape>'
    use = '<shape type="instance"><ref id="oak chair"/></shape>'
    scene = imported(tmp_path, usual(group + use), "3.0.0")
    assert "chair" in {item.category for item in scene.objects}


def test_a_lamp_in_a_group_shines_at_every_instance(tmp_path: Path) -> None:
    light = '<emitter type="area"><spectrum name="radiance" value="5"/></emitter>'
    group = f'<shape type="shapegroup" id="g">{CUBE.format("bulb", light)}</shape>'
    places = "".join(
        f'<shape type="instance"><ref id="g"/><transform name="toWorld">'
        f'<translate x="{1 + n}" y="1" z="-1"/></transform></shape>'
        for n in range(3)
    )
    scene = imported(tmp_path, SENSOR_0_6 + room() + group + places)
    assert len([light for light in scene.lights if light.kind == "area"]) == 3


def test_includes_reach_into_folders_below_and_share_ids(tmp_path: Path) -> None:
    write(tmp_path / "in" / "parts", '<bsdf type="diffuse" id="paint"/>', name="paint.xml")
    write(tmp_path / "in" / "parts", '<include filename="parts/paint.xml"/>', name="all.xml")
    body = '<include filename="parts/all.xml"/>' + usual(CUBE.format("thing", '<ref id="paint"/>'))
    assert "thing" in {thing.id for thing in imported(tmp_path, body).objects}


@pytest.mark.parametrize("doubling", [1, 2])
def test_endless_includes_are_refused_soon(tmp_path: Path, doubling: int) -> None:
    for level in range(400):
        again = f'<include filename="i{level + 1}.xml"/>' * doubling
        write(tmp_path / "in", again, name=f"i{level}.xml")
    started = time.monotonic()
    with pytest.raises(InputError, match="limit of 256 includes"):
        imported(tmp_path, '<include filename="i0.xml"/>' + usual())
    assert time.monotonic() - started < 10
    assert not (tmp_path / "out").exists()


def test_groups_that_double_at_every_level_are_refused_soon(tmp_path: Path) -> None:
    groups = f'<shape type="shapegroup" id="g0">{CUBE.format("atom", "")}</shape>'
    for level in range(1, 9):
        inner = f'<shape type="instance"><ref id="g{level - 1}"/></shape>' * 10
        groups += f'<shape type="shapegroup" id="g{level}">{inner}</shape>'
    started = time.monotonic()
    with pytest.raises(InputError, match=r"refused|too deep|more than"):
        imported(tmp_path, usual(groups + '<shape type="instance"><ref id="g7"/></shape>'))
    assert time.monotonic() - started < 10


def test_a_spectrum_file_becomes_its_colour(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "grey.spd").write_text("# flat\n300 0.25\n900 0.25\n")
    paint = '<bsdf type="diffuse"><spectrum name="reflectance" filename="grey.spd"/></bsdf>'
    scene = imported(tmp_path, usual(CUBE.format("thing", paint)))
    assert any(np.allclose(value, 0.25, atol=1e-6) for value in colours(scene, "reflectance"))


@pytest.mark.parametrize("word", ["scale", "multiplier"])
def test_a_black_body_has_the_radiance_of_planck(tmp_path: Path, word: str) -> None:
    light = LAMP_0_6.replace(
        '<spectrum name="radiance" value="30"/>',
        f'<blackbody name="radiance" temperature="4000k" {word}="2"/>',
    )
    scene = imported(tmp_path, SENSOR_0_6 + room() + light)
    (rgb,) = colours(scene, "radiance")
    wanted = 2 * blackbody_radiance(4000.0)
    assert np.dot(rgb, [0.2126, 0.7152, 0.0722]) == pytest.approx(wanted, rel=1e-3)


luminaire = partial(plugin, "luminaire")
STRENGTH = '<spectrum name="intensity" value="{}"/>'
DOWN = '<vector name="direction" x="0" y="-1" z="0"/>'
OLD_LIGHTS = {  # a light, and the property of today that holds its strength
    "luminaire": (luminaire("constant", STRENGTH.format(2)), "radiance", [2, 2, 2]),
    "scaled envmap": (luminaire("envmap", filename="gone.exr", intensityScale=3.0), "radiance",
                      [3, 3, 3]),
    "directional": (luminaire("directional", DOWN, STRENGTH.format(7)), "irradiance", [7, 7, 7]),
}  # fmt: skip


@pytest.mark.parametrize("name", OLD_LIGHTS)
def test_lights_of_0_3_keep_their_strength(tmp_path: Path, name: str) -> None:
    light, key, value = OLD_LIGHTS[name]
    camera = SENSOR_0_6.replace("sensor", "camera")
    scene = imported(tmp_path, camera + room(without=("north",)) + light, "0.3.0")
    assert value in colours(scene, key)
    assert len(scene.source["views"]) == 1


SHORTER = prop("mapSmallerSide", True)


def test_the_camera_of_0_3_measures_its_angle_along_the_shorter_side(tmp_path: Path) -> None:
    body = usual().replace("sensor", "camera")
    body = body.replace('name="fov" value="60"/>', 'name="fov" value="60"/>' + SHORTER)
    (view,) = imported(tmp_path, body, "0.3.0").source["views"]
    half = np.arctan(np.tan(np.radians(30)) * 64 / 48)
    assert view["half_fov_x"] == pytest.approx(half)


def test_an_obj_without_a_material_takes_those_of_its_library(tmp_path: Path) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    (folder / "m.mtl").write_text("newmtl red\nKd 0.8 0.1 0.1\nnewmtl blue\nKd 0.1 0.1 0.7\n")
    (folder / "two.obj").write_text(
        "mtllib m.mtl\nv 1 1 -1\nv 2 1 -1\nv 1 2 -1\nv 1 1 -2\nv 2 1 -2\nv 1 2 -2\n"
        "usemtl red\nf 1 2 3\nusemtl blue\nf 4 5 6\n"
    )
    shape = '<shape type="obj" id="two"><string name="filename" value="two.obj"/></shape>'
    scene = imported(tmp_path, usual(shape))
    found = colours(scene, "reflectance") + colours(scene, "base_color")
    assert [0.8, 0.1, 0.1] in found and [0.1, 0.1, 0.7] in found


def test_parts_of_an_obj_take_the_materials_named_after_theirs(tmp_path: Path) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    (folder / "two.obj").write_text(
        "v 1 1 -1\nv 2 1 -1\nv 1 2 -1\nv 1 1 -2\nv 2 1 -2\nv 1 2 -2\n"
        "usemtl red\nf 1 2 3\nusemtl blue\nf 4 5 6\n"
    )
    paints = "".join(
        f'<bsdf type="diffuse" name="{name}"><rgb name="reflectance" value="{value}"/></bsdf>'
        for name, value in (("red", ".8,.1,.1"), ("blue", ".1,.1,.7"))
    )
    shape = f'<shape type="obj"><string name="filename" value="two.obj"/>{paints}</shape>'
    scene = imported(tmp_path, usual(shape))
    found = colours(scene, "reflectance")
    assert [0.8, 0.1, 0.1] in found and [0.1, 0.1, 0.7] in found
    assert not any("first was kept" in change for change in scene.changes)


def test_a_coloured_coat_darkens_what_is_below_twice(tmp_path: Path) -> None:
    below = bsdf("diffuse", reflectance=(0.5,))
    coat = bsdf("coating", below, thickness=2.0, sigmaA=(0, 0.1, 1))
    scene = imported(tmp_path, usual(CUBE.format("thing", coat)))
    expected = 0.5 * np.exp(-2 * 2 * np.array([0, 0.1, 1]))
    assert any(np.allclose(v, expected, rtol=1e-5) for v in colours(scene, "diffuse_reflectance"))


radiance = partial(plugin, "spectrum", name="radiance")
SPECTRA = {
    "d65": (radiance("d65"), [1, 1, 1]),
    "tinted d65": (radiance("d65", color=(1, 0.5, 0)), [1, 0.5, 0]),
    "uniform": (radiance("uniform", value=3.0), [3, 3, 3]),
    "regular": (radiance("regular", values="2, 2, 2", wavelength_min=300.0, wavelength_max=900.0),
                [2, 2, 2]),
    "irregular": (radiance("irregular", wavelengths="300, 900", values="4, 4"), [4, 4, 4]),
    "black body": (radiance("blackbody", temperature=6500.0, scale=0.01), None),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", SPECTRA)
def test_spectra_that_are_plugins_become_colours(tmp_path: Path, name: str) -> None:
    spectrum, value = SPECTRA[name]
    scene = imported(tmp_path, usual(emitter("constant", spectrum)), "3.0.0")
    found = colours(scene, "radiance")
    if value is None:
        luminance = 0.01 * blackbody_radiance(6500.0)
        assert any(np.dot(v, [0.2126, 0.7152, 0.0722]) == pytest.approx(luminance, rel=1e-3)
                   for v in found)  # fmt: skip
    else:
        assert any(np.allclose(v, value, atol=1e-6) for v in found), found


SQUARES = '<spectrum name="brightColor" value="0.875"/>'
OLD_WORDS = {
    "mirror": (bsdf("mirror"), 'type="conductor"'),
    "roughmetal": (bsdf("roughmetal", alphaB=0.25), 'name="alpha" value="0.25"'),
    "microfacet": (bsdf("microfacet", alphaB=0.25), 'type="roughplastic"'),
    "bright squares": (bsdf("lambertian", texture("checkerboard", SQUARES, name="reflectance")),
                       'name="color0" value="0.875 0.875 0.875"'),
    "bump": (bsdf("bump", bsdf("diffuse"), texture("checkerboard")), 'type="bumpmap"'),
    "diffuse reflectance": (bsdf("diffuse", diffuseReflectance=(0.125, 0.25, 0.5)),
                            'name="reflectance" value="0.125 0.25 0.5"'),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", OLD_WORDS)
def test_words_of_before_0_5_are_understood(tmp_path: Path, name: str) -> None:
    material, written = OLD_WORDS[name]
    body = usual(CUBE.format("thing", material)).replace("sensor", "camera")
    scene = imported(tmp_path, body, "0.2.1")
    assert written in scene.xml.read_text()
