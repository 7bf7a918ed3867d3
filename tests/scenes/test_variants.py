"""Variants of imported scenes: same rooms, new finishes in true size, new lighting."""

from pathlib import Path
from xml.etree import ElementTree

import mitsuba as mi
import numpy as np
import pytest
import yaml

from pbrnet.pipeline.params import load_params
from pbrnet.pipeline.render.scene import set_variant
from pbrnet.pipeline.stages.scenes import run_scenes
from pbrnet.scenes.color import REC709
from pbrnet.scenes.contract import Scene, load_scene
from pbrnet.scenes.files import digest_folder
from pbrnet.scenes.formats.ply import read_ply
from pbrnet.scenes.geometry.mesh import Mesh, face_areas
from pbrnet.scenes.params import SceneParams
from pbrnet.scenes.photometry import blackbody
from pbrnet.scenes.procedural.textures.families import has_surface
from pbrnet.scenes.registry import import_scene
from pbrnet.scenes.variants.refinish import with_metric_uvs
from pbrnet.scenes.variants.vary import VariantSettings, vary_scene
from tests.fixtures import sweethome as draw
from tests.fixtures.command import printed
from tests.fixtures.paths import ROOT

PARAMS = SceneParams(texture_size=64)


def furnished(extra: str = "") -> str:
    """A bedroom of 4 x 3 m with a bed, a window, a cube and two lamps."""
    return draw.usual(
        draw.window(x=200, y=0)
        + draw.piece(name="Bed", model="box", x=300, y=200, width=200, depth=150, height=50)
        + draw.piece(name="Cube", model="box", x=100, y=250)
        + draw.lamp(x=210, y=160, elevation=190)
        + draw.lamp(x=100, y=60, elevation=100)
        + extra
    )


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    folder = tmp_path_factory.mktemp("variants")
    file = draw.pack(folder / "flat.sh3d", furnished(), {"box": draw.BOX})
    return import_scene(file, folder / "flat", lamps="on")


def varied(base: Scene, number: int = 1, seed: int = 5, params: SceneParams = PARAMS) -> Scene:
    out = base.folder.with_name(f"flat-v{number}-{seed}")
    return vary_scene(base.folder, out, f"flat-v{number}", VariantSettings.of(params, seed, number))


def materials(scene: Scene) -> dict[str, str]:
    """Shape id -> id of its material."""
    root = ElementTree.parse(scene.xml).getroot()
    return {
        shape.get("id", ""): ref.get("id", "")
        for shape in root.findall("shape")
        for ref in shape.findall("ref")
    }


def test_the_plan_stays_and_the_finishes_change(base: Scene) -> None:
    made = varied(base)
    assert made.scene_id == "flat-v1" and made.plan == base.scene_id
    assert made.rooms == base.rooms and made.objects == base.objects
    assert made.portals == base.portals and made.credits == base.credits
    assert made.source["of"] == base.scene_id and made.source["variant"] == 1
    assert made.source["varied"] == ["finishes", "light"]
    before, after = materials(base), materials(made)
    changed = {name for name in before if before[name] != after[name]}
    kinds = {item.category for item in made.objects if changed & set(item.shapes)}
    assert {"floor", "wall", "ceiling", "bed"} <= kinds
    assert kinds <= {"floor", "wall", "ceiling", "bed", "skirting"}
    assert changed == set(made.source["finishes"]["shapes"])


def test_finishes_have_true_size(base: Scene) -> None:
    made = varied(base)
    root = ElementTree.parse(made.xml).getroot()
    tiles: dict[str, set[float]] = {}
    for name in made.source["finishes"]["shapes"]:
        mesh = read_ply(made.folder / "meshes" / f"{name}.ply")
        assert mesh.uvs is not None
        flat = mesh.uvs[mesh.faces]
        along, aside = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
        cross = along[:, 0] * aside[:, 1] - along[:, 1] * aside[:, 0]
        area = face_areas(mesh.corners)[0]
        whole = area > 1e-6
        flat_area = np.abs(0.5 * cross)[whole]
        tile = np.sqrt(area[whole].sum() / flat_area.sum())  # metres per texture period
        assert flat_area * tile**2 == pytest.approx(area[whole], rel=1e-3, abs=1e-6)
        kind = made.source["finishes"]["shapes"][name]
        tiles.setdefault(kind, set()).add(round(float(tile), 3))
    for kind, sizes in tiles.items():
        assert all(0.2 <= size <= 3.0 or not has_surface(kind) for size in sizes), (kind, sizes)
    assert "to_uv" not in made.xml.read_text()
    for bitmap in root.iter("texture"):
        file = next(item for item in bitmap if item.get("name") == "filename")
        assert (made.folder / file.get("value", "")).is_file()


def test_uvs_of_oblique_walls_are_metric() -> None:
    # A wall that runs at 30 degrees: 2 m long, 1 m high.
    run = 2 * np.array([np.cos(0.5), np.sin(0.5), 0])
    up = np.array([0.0, 0, 1])
    points = np.stack([0 * run, run, run + up, up])
    made = with_metric_uvs(Mesh(points, np.array([[0, 1, 2], [0, 2, 3]])))
    assert made.uvs is not None
    assert np.ptp(made.uvs, axis=0) == pytest.approx([2, 1])


def test_variants_differ_and_are_reproducible_to_the_bit(base: Scene) -> None:
    first, other = varied(base, 1), varied(base, 2)
    assert first.source["finishes"] != other.source["finishes"] or (
        first.source["light"] != other.source["light"]
    )
    text = first.xml.read_bytes()
    assert text != other.xml.read_bytes() and text != varied(base, 1, seed=6).xml.read_bytes()
    digest = digest_folder(first.folder)
    assert digest_folder(varied(base, 1).folder) == digest


def test_lamps_go_out_by_day_and_change_colour_at_night(base: Scene) -> None:
    assert [light.kind for light in base.lights].count("area") == 2
    night = varied(base, params=SceneParams(lighting=("night",), vary=("light",), texture_size=64))
    assert night.lighting == "night"
    lit = [light for light in night.lights if light.kind == "area"]
    assert lit and {light.kind for light in night.lights} == {"area", "environment"}
    tint = np.array(blackbody(night.source["light"]["lamps_kelvin"]))
    before, after = radiances(base), radiances(night)
    assert set(after) == {name for light in lit for name in light.shapes}
    for name, radiance in after.items():
        assert radiance @ REC709 == pytest.approx(before[name] @ REC709, rel=1e-5)
        assert radiance / (radiance @ REC709) == pytest.approx(tint, rel=1e-4)
    day = varied(base, 2, params=SceneParams(lighting=("day",), vary=("light",), texture_size=64))
    assert day.lighting == "day" and not radiances(day)
    assert "sky" in {light.kind for light in day.lights}
    assert "finishes" not in day.source and materials(day) == materials(base)


def test_light_of_pbrs_is_white_and_shows_nothing_outside(base: Scene) -> None:
    made = varied(base, params=SceneParams(lighting=("pbrs",), vary=("light",), texture_size=64))
    assert made.lighting == "pbrs"
    before, after = radiances(base), radiances(made)
    assert len(after) == len(before) == 2  # every lamp of the file
    sky = ElementTree.parse(made.xml).getroot().find("emitter[@type='constant']/rgb")
    assert sky is not None
    white = [float(word) for word in sky.get("value", "").split()]
    assert white == [white[0]] * 3
    for radiance in after.values():
        assert radiance == pytest.approx(np.array(white) * 400 / 75)
    gone = {item.id for item in base.objects} - {item.id for item in made.objects}
    assert {item.category for item in base.objects if item.id in gone} == {"ground"}
    text = made.xml.read_text()
    assert all(f'"meshes/{path.name}"' in text for path in (made.folder / "meshes").iterdir())


def radiances(scene: Scene) -> dict[str, np.ndarray]:
    root = ElementTree.parse(scene.xml).getroot()
    return {
        shape.get("id", ""): np.array([float(word) for word in item.get("value", "").split()])
        for shape in root.findall("shape")
        for item in shape.iterfind("emitter/rgb")
    }


def test_a_scene_without_lamps_has_no_night(tmp_path: Path) -> None:
    file = draw.pack(tmp_path / "flat.sh3d", draw.usual(draw.window(x=200, y=0)))
    base = import_scene(file, tmp_path / "flat")
    made = varied(base, params=SceneParams(lighting=("night", "evening"), texture_size=64))
    assert made.lighting == "evening"
    kept = varied(base, 2, params=SceneParams(lighting=("night",), texture_size=64))
    assert kept.lights == base.lights and kept.lighting == base.lighting


def test_points_and_spots_are_lamps_too(tmp_path: Path) -> None:
    """By day they are off in rooms with a window; at night they have the variant's colour."""
    emitters = (
        '<emitter type="point"><point name="position" x="1" y="1" z="2"/>'
        '<rgb name="intensity" value="4, 4, 4"/></emitter>'
        '<emitter type="spot"><transform name="to_world"><lookat origin="2,2,2.4" '
        'target="2,2,0" up="0,1,0"/></transform><rgb name="intensity" value="2,6,2"/></emitter>'
        '<emitter type="constant"><rgb name="radiance" value="1"/></emitter>'
    )
    base = import_scene(
        windowed_room(tmp_path / "room.xml", emitters), tmp_path / "flat", up="z", scale=1.0
    )
    assert [light.kind for light in base.lights][:2] == ["point", "spot"]
    assert len(base.rooms) == 1 and base.portals
    only = {"vary": ("light",), "texture_size": 64}
    day = varied(base, params=SceneParams(lighting=("day",), **only))
    assert {light.kind for light in day.lights} <= {"sun", "sky"}
    assert "intensity" not in day.xml.read_text()
    night = varied(base, 2, params=SceneParams(lighting=("night",), **only))
    lit = [light.kind for light in night.lights if light.kind != "environment"]
    found = ElementTree.parse(night.xml).getroot().findall("emitter")
    kept = {item.get("type"): item for item in found}
    assert lit and set(kept) == {*lit, "constant"}
    tint = np.array(blackbody(night.source["light"]["lamps_kelvin"]))
    before = {"point": 4.0, "spot": np.array([2, 6, 2]) @ REC709}
    for kind in lit:
        rgb = kept[kind].find("rgb")
        assert rgb is not None
        value = np.array([float(word) for word in rgb.get("value", "").split()])
        assert value / tint == pytest.approx([before[kind]] * 3, rel=1e-4)


def windowed_room(path: Path, emitters: str) -> Path:
    """A closed room of 4 x 3 x 2.5 m with a hole of 1 x 1 m in its north wall."""
    corners = [(x, y, z) for x in (0, 4) for y in (0, 3) for z in (0, 2.5)]
    hole = [(1, 3, 1), (2, 3, 1), (2, 3, 2), (1, 3, 2)]
    faces = [(0, 2, 6, 4), (1, 5, 7, 3), (0, 4, 5, 1), (0, 1, 3, 2), (4, 6, 7, 5),
             (2, 8, 9, 6), (6, 9, 10, 7), (7, 10, 11, 3), (3, 11, 8, 2)]  # fmt: skip
    text = "".join(f"v {x} {y} {z}\n" for x, y, z in corners + hole)
    text += "".join("f " + " ".join(str(k + 1) for k in face) + "\n" for face in faces)
    path.with_suffix(".obj").write_text(text)
    shape = f'<shape type="obj"><string name="filename" value="{path.stem}.obj"/>'
    shape += '<bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>'
    path.write_text(f'<scene version="3.0.0">{emitters}{shape}</scene>')
    return path


@pytest.mark.slow
def test_the_stage_makes_variants_of_imports(tmp_path: Path) -> None:
    file = draw.pack(tmp_path / "flat.sh3d", furnished(), {"box": draw.BOX})
    values = yaml.safe_load((ROOT / "params.yaml").read_text())
    values["scenes"] |= {"homes": 0, "imports": [str(file)], "variants": 3, "texture_size": 64}
    values["farm"]["workers"] = 1
    (tmp_path / "params.yaml").write_text(yaml.safe_dump(values))
    params = load_params(tmp_path / "params.yaml", None)
    assert run_scenes(tmp_path / "data", params).made == 3
    folders = [tmp_path / "data" / "scenes" / name for name in ("flat", "flat-v1", "flat-v2")]
    assert {load_scene(folder).plan for folder in folders} == {"flat"}
    again = run_scenes(tmp_path / "data", params)
    assert (again.made, again.kept) == (0, 3)
    values["scenes"]["variants"] = 2
    (tmp_path / "params.yaml").write_text(yaml.safe_dump(values))
    less = run_scenes(tmp_path / "data", load_params(tmp_path / "params.yaml", None))
    assert (less.made, less.kept, less.removed) == (0, 2, 1)


def test_the_command_makes_variants_beside_the_scene(tmp_path: Path) -> None:
    file = draw.pack(tmp_path / "flat.sh3d", furnished(), {"box": draw.BOX})
    out = tmp_path / "scenes" / "flat"
    printed("import", file, "--out", out, "--variants", 1)
    assert load_scene(out.with_name("flat-v1")).source["of"] == "flat"


def test_a_variant_renders(base: Scene) -> None:
    set_variant("auto")
    made = varied(base, params=SceneParams(lighting=("day",), texture_size=64))
    loaded = mi.load_file(str(made.xml), optimize=False, parallel=False)
    image = np.asarray(mi.render(loaded, spp=1))
    assert np.isfinite(image).all() and image.mean() > 0
