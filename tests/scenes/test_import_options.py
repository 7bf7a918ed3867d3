"""`scenes.imports`: files with and without options, and the imports that a change repeats."""

import base64
import json
import os
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, get_type_hints

import pytest
import yaml

from pbrnet.pipeline.farm.versions import scene_digest
from pbrnet.pipeline.params import Params, load_params
from pbrnet.pipeline.scene_export.export import export_scene
from pbrnet.pipeline.stages.runner import StageError
from pbrnet.pipeline.stages.scenes import run_scenes
from pbrnet.scenes.contract import STAGE_FILES_KEY, STAGE_KEY, load_scene, save_scene
from pbrnet.scenes.errors import ParameterError
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.mitsuba.pbrs import find_release
from pbrnet.scenes.opened_files import OpenedFiles, unchanged
from pbrnet.scenes.registry import SOURCES, import_scene, scene_name
from tests.fixtures import mitsuba_files as mitsuba
from tests.fixtures import sweethome as draw
from tests.fixtures.gltf import square
from tests.fixtures.paths import ROOT
from tests.fixtures.stages import write_room

RED_BOX = draw.BOX.replace("usemtl amber", "usemtl red")


def params(folder: Path, *imports: Any, **more: Any) -> Params:
    values = yaml.safe_load((ROOT / "params.yaml").read_text())
    values["scenes"] |= {"homes": 0, "imports": list(imports), **more}
    values["farm"]["workers"] = 1
    (folder / "params.yaml").write_text(yaml.safe_dump(values))
    return load_params(folder / "params.yaml")


def test_an_option_that_sources_share_has_one_type_default_and_help() -> None:
    found: dict[str, set[tuple[Any, ...]]] = {}
    for source in set(SOURCES.values()):
        hints = get_type_hints(source)
        for one in fields(source):
            told = (str(hints[one.name]), one.default, one.metadata["help"])
            found.setdefault(one.name, set()).add(told)
    assert {name: told for name, told in found.items() if len(told) > 1} == {}


@pytest.fixture
def house(tmp_path: Path) -> str:
    levels = (
        "<level id='a' name='Below' elevation='0' floorThickness='12' height='250'/>"
        "<level id='b' name='Above' elevation='262' floorThickness='12' height='250'/>"
    )
    rooms = "".join(
        draw.box_walls(0, 0, 420, 320, tag=level, level=level)
        + draw.room(10, 10, 400, 300, name=f"Room {level}", level=level)
        for level in "ab"
    )
    lamp = draw.lamp(x=200, y=150, elevation=180, level="a")
    return str(draw.pack(tmp_path / "house.sh3d", draw.home(levels + rooms + lamp)))


@pytest.mark.slow
def test_names_and_mappings_side_by_side(tmp_path: Path, house: str) -> None:
    upstairs = {"file": house, "id": "upstairs", "level": ["Above"], "author": "A. Maker"}
    dark = {"file": house, "id": "dark", "time": "23:00", "lamps": "off"}
    wanted = params(tmp_path, house, upstairs, dark)
    assert run_scenes(tmp_path / "data", wanted).made == 3
    made = {name: load_scene(tmp_path / "data" / "scenes" / name)
            for name in ("house", "upstairs", "dark")}  # fmt: skip
    assert [len(made[name].rooms) for name in ("house", "upstairs", "dark")] == [2, 1, 2]
    assert {credit.author for credit in made["upstairs"].credits} == {"A. Maker"}
    assert not [light for light in made["dark"].lights if light.kind == "area"]


@pytest.mark.slow
def test_changed_options_make_a_scene_again(tmp_path: Path, house: str) -> None:
    entry = {"file": house, "level": ["Above"]}
    assert run_scenes(tmp_path / "data", params(tmp_path, entry)).made == 1
    assert run_scenes(tmp_path / "data", params(tmp_path, entry)).kept == 1
    assert run_scenes(tmp_path / "data", params(tmp_path, entry | {"lamps": "on"})).made == 1
    # A mapping without options is the same as the name.
    assert run_scenes(tmp_path / "data", params(tmp_path, {"file": house})).made == 1
    assert run_scenes(tmp_path / "data", params(tmp_path, house)).kept == 1


def test_one_file_needs_two_names_to_come_in_twice(tmp_path: Path, house: str) -> None:
    with pytest.raises(Exception, match="two scenes have the id 'house'"):
        run_scenes(tmp_path / "data", params(tmp_path, house, {"file": house, "lamps": "off"}))


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({"file": "a.sh3d", "scale": 2.0}, r"imports\[0\]\.scale: not for \.sh3d files; they take"),
        (
            {"file": "a.glb", "lamps": "on"},
            r"imports\[0\]\.lamps: 'on' is for Sweet Home 3D homes; others take",
        ),
        ({"file": "folder", "sky": True}, r"sky: not for scene folders"),
        ({"file": "a.xml", "levels": ["x"]}, "unknown key; did you mean 'level'"),
        ({"file": "a.sh3d", "level": "Above"}, r"level: expected a list"),
        ({"file": "a.sh3d", "time": 1245}, r"time: expected .*in quotes, such as '19:30'"),
        ({"file": "a.sh3d", "time": "25:00"}, "not a time of day"),
        ({"file": "a.sh3d", "lamps": True}, r"lamps: True is not one of 'auto', 'home', 'on'"),
        ({"file": "a.xml", "parameter": ["x=y"]}, r"parameter: expected a mapping"),
        ({"file": "a.xml", "scale": 0}, r"scale: 0\.0 is not allowed"),
        ({"file": "a.xml", "up": "w"}, r"up: 'w' is not one of"),
        ({"file": "a.xml", "id": "../x"}, r"id: '\.\./x'"),
        ({"scale": 1.0}, r"file: missing"),
        (7, r"imports\[0\]: expected text, got 7|expected"),
    ],
)
def test_what_is_refused_at_load(tmp_path: Path, entry: Any, words: str) -> None:
    with pytest.raises(ParameterError, match=words):
        params(tmp_path, entry)


def test_missing_files_and_roots_are_named(tmp_path: Path, house: str) -> None:
    xml = tmp_path / "a.xml"
    xml.write_text("<scene version='3.0.0'/>")
    wanted = params(tmp_path, "gone.sh3d", {"file": str(xml), "root": str(tmp_path / "nowhere")})
    with pytest.raises(StageError, match=r"gone\.sh3d: no such file") as raised:
        run_scenes(tmp_path / "data", wanted)
    assert "nowhere: no such folder" in str(raised.value)


def an_obj(folder: Path) -> Path:
    (folder / "my stuff.mtl").write_text("newmtl red\nmap_Kd -s 1 1 1 wood.png\n")
    (folder / "wood.png").write_bytes(draw.quadrants())
    (folder / "a.obj").write_text("mtllib my stuff.mtl\n" + RED_BOX)
    return folder / "a.obj"


def a_gltf(folder: Path) -> Path:
    """A square whose buffer is a file beside it."""
    path = square().save(folder / "b.gltf")
    content = json.loads(path.read_text())
    data = content["buffers"][0]["uri"].partition("base64,")[2]
    (folder / "my data.bin").write_bytes(base64.b64decode(data))
    content["buffers"][0]["uri"] = "my%20data.bin"
    path.write_text(json.dumps(content))
    return path


def an_xml(folder: Path) -> Path:
    """A scene with an included file, a texture of that, and a mesh under an old path."""
    (folder / "meshes").mkdir()
    (folder / "meshes" / "box.obj").write_text(draw.BOX)
    (folder / "wood.png").write_bytes(draw.quadrants())
    texture = '<texture type="bitmap"><string name="filename" value="wood.png"/></texture>'
    shape = '<shape type="rectangle" id="inner"><bsdf type="diffuse">{}</bsdf></shape>'
    inner = shape.format(texture.replace("<texture", '<texture name="reflectance"'))
    (folder / "d.xml").write_text(f'<scene version="0.6.0">{inner}</scene>')
    mesh = '<shape type="obj" id="m"><string name="filename" value="C:/old/box.obj"/></shape>'
    return mitsuba.write(folder, mitsuba.usual('<include filename="d.xml"/>' + mesh))


IMPORTS = {"obj": an_obj, "gltf": a_gltf, "xml": an_xml}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "names"),
    [
        ("obj", ("a.obj", "my stuff.mtl", "wood.png", "LICENSE.txt")),  # the last absent so far
        ("gltf", ("b.gltf", "my data.bin")),
        (
            "xml",
            (
                *("scene.xml", "d.xml", "wood.png", "meshes/box.obj", "another/BOX.OBJ"),
                *("light_geometry_compact.txt", "../light_geometry_compact.txt"),
            ),
        ),
    ],
)
def test_an_import_holds_until_a_file_that_it_looked_for_changes(
    tmp_path: Path, kind: str, names: tuple[str, ...]
) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    path, opened = IMPORTS[kind](folder), OpenedFiles(folder)
    import_scene(path, tmp_path / "out", opened=opened)
    record = json.loads(json.dumps(opened.record()))
    (folder / "notes.doc").write_text("not of the scene")
    assert unchanged(record, folder)
    moved = folder.rename(tmp_path / "moved")
    for name in names:
        assert unchanged(record, moved), name
        changed = Path(os.path.normpath(moved / name))
        before = changed.read_bytes() if changed.exists() else None
        if before is not None:
            changed.unlink()
            assert not unchanged(record, moved), name
        changed.parent.mkdir(exist_ok=True)
        changed.write_bytes((before or b"") + b"# more\n")
        assert not unchanged(record, moved), name
        changed.unlink() if before is None else changed.write_bytes(before)
    assert unchanged(record, moved)


def test_every_table_of_a_pbrs_house_is_in_the_record(tmp_path: Path) -> None:
    (tmp_path / "room_camera.txt").write_text(
        "2 1.5 -1  0 -0.196116 0.980581  0 0.980581 0.196116  0.5534 0.433896  7.25\n"
    )
    opened = OpenedFiles(tmp_path)
    find_release(tmp_path / "a.xml", opened, Changes())
    for name in ("name", "good"):
        path = tmp_path / f"room_camera_{name}.txt"
        assert unchanged(opened.record(), tmp_path)
        path.write_text("1\n")
        assert not unchanged(opened.record(), tmp_path)
        path.unlink()


def test_a_scene_folder_holds_until_anything_in_it_changes(tmp_path: Path) -> None:
    scene = import_scene(square().save(tmp_path / "a.glb"), tmp_path / "scene")
    opened = OpenedFiles(scene.folder)
    import_scene(scene.folder, tmp_path / "copy", opened=opened)
    assert unchanged(opened.record(), scene.folder)
    (scene.folder / "textures" / "more.png").write_bytes(b"")
    assert not unchanged(opened.record(), scene.folder)


@pytest.mark.parametrize("record", [None, {}, [], {"files": {}}, {"names": 3}])
def test_a_damaged_record_makes_the_import_again(tmp_path: Path, record: Any) -> None:
    assert not unchanged(record, tmp_path)


@pytest.mark.slow
def test_a_changed_file_makes_a_scene_and_its_variants_again(tmp_path: Path) -> None:
    path = an_obj(tmp_path)
    wanted = params(tmp_path, str(path), variants=2)
    assert run_scenes(tmp_path / "data", wanted).made == 2
    assert run_scenes(tmp_path / "data", wanted).kept == 2
    before = scene_digest(tmp_path / "data" / "scenes" / "a")
    with (tmp_path / "my stuff.mtl").open("a") as stream:
        stream.write("# a comment\n")
    assert run_scenes(tmp_path / "data", wanted).made == 2
    assert scene_digest(tmp_path / "data" / "scenes" / "a") == before  # the record is not counted


def test_names_of_scenes() -> None:
    assert scene_name(Path("/a/My house.sh3d")) == "My-house"
    assert scene_name(Path("/release/0004d52d/main_template_color.xml")) == "0004d52d"
    assert scene_name(Path("/a/Grey & White/scene.xml")) == "Grey-White"


def test_a_copy_is_not_the_stage_s_own_scene(tmp_path: Path) -> None:
    """Else the next run would take it for a scene that nobody wants, and move it to the trash."""
    write_room(tmp_path / "data" / "scenes" / "alpha")
    first = load_scene(tmp_path / "data" / "scenes" / "alpha")
    marked = {**first.source, STAGE_KEY: "0" * 64, STAGE_FILES_KEY: {"a": "b"}}
    save_scene(first.folder, replace(first, source=marked))
    for number, path in enumerate([first.folder, zipped(first.folder, tmp_path)]):
        copy = import_scene(path, tmp_path / "data" / "scenes" / f"copy-{number}")
        assert copy.source == first.source
        with pytest.raises(ParameterError, match="not for scene folders and exported scenes"):
            import_scene(path, tmp_path / "refused", outdoors="none")


def zipped(folder: Path, place: Path) -> Path:
    export_scene(folder, "mitsuba", place / "exported.zip")
    return place / "exported.zip"
