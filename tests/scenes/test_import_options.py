"""`scenes.imports`: files by name, or with options, and what is made again when they change."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from pipeline.params import Params, load_params
from pipeline.stages.import_files import digest_import, scene_name
from pipeline.stages.runner import StageError
from pipeline.stages.scenes import run_scenes
from scenes.contract import load_scene
from scenes.errors import ParameterError
from scenes.import_options import ImportEntry
from tests.fixtures import sweethome as draw
from tests.fixtures.paths import ROOT


def params(folder: Path, *imports: Any) -> Params:
    values = yaml.safe_load((ROOT / "params.yaml").read_text())
    values["scenes"] |= {"homes": 0, "imports": list(imports)}
    values["farm"]["workers"] = 1
    (folder / "params.yaml").write_text(yaml.safe_dump(values))
    return load_params(folder / "params.yaml")


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
        ({"file": "a.glb", "lamps": "on"}, r"imports\[0\]\.lamps: not for \.glb files"),
        ({"file": "folder", "sky": True}, r"sky: not for scene folders"),
        ({"file": "a.xml", "levels": ["x"]}, "unknown key; did you mean 'level'"),
        ({"file": "a.sh3d", "level": "Above"}, r"level: expected a list"),
        ({"file": "a.sh3d", "time": 1245}, r"time: expected .*in quotes, such as '19:30'"),
        ({"file": "a.sh3d", "time": "25:00"}, "no time of day"),
        ({"file": "a.sh3d", "lamps": True}, r"lamps: True is not one of 'home', 'on', 'off'"),
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


def test_digests_see_every_file_that_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("mtllib my stuff.mtl\nv 0 0 0\n")
    (tmp_path / "my stuff.mtl").write_text("newmtl x\nmap_Kd -s 1 1 1 wood.png\n")
    (tmp_path / "b.gltf").write_text('{"images": [{"uri": "my%20wood.png"}], "buffers": [{}]}')
    (tmp_path / "c.xml").write_text(
        "<scene><string value='$map'/><include filename='d.xml'/></scene>"
    )
    (tmp_path / "d.xml").write_text("<scene><string value='wood.png'/></scene>")
    for name, inner, entry in (
        ("a.obj", "my stuff.mtl", {}),
        ("a.obj", "wood.png", {}),
        ("b.gltf", "my wood.png", {}),
        ("c.xml", "wood.png", {}),
        ("c.xml", "sky.exr", {"parameter": {"map": "sky.exr"}}),
        ("c.xml", "light_geometry_compact.txt", {}),
    ):
        path = tmp_path / name
        before = digest_import(path, ImportEntry(name, **entry))
        old = (tmp_path / inner).read_bytes() if (tmp_path / inner).exists() else b""
        (tmp_path / inner).write_bytes(old + b"# more\n")
        assert digest_import(path, ImportEntry(name, **entry)) != before, (name, inner)


def test_names_of_scenes() -> None:
    assert scene_name(Path("/a/My house.sh3d")) == "My-house"
    assert scene_name(Path("/release/0004d52d/main_template_color.xml")) == "0004d52d"
    assert scene_name(Path("/a/Grey & White/scene.xml")) == "Grey-White"
