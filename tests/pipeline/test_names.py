"""Names from files and the command line: none leads out of its folder, each fault is one line."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from pbrnet.pipeline.cli import main
from pbrnet.scenes.checked import check_name
from pbrnet.scenes.contract import load_scene, save_scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.formats.scene_xml import check_scene_xml
from tests.fixtures.dataset import box_scene

NAMES = ("../../x", "/tmp/x", "a/b", "a\\b", "a\0b", "x" * 300, "CON", "nul.exr", "", ".", "..",
         "-x", "a b", "a\n", "\udcff")  # fmt: skip
WORDS = ("../../x", "CON", "", "a\n")  # of NAMES, whose check all commands share


def write(path: Path, value: object) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(value))
    return path


def an_import(name: str) -> list[str]:
    write(Path("a.glb"), {})
    return ["import", "a.glb", "--out", "out/scene", "--id", name]


def import_of_the_parameters(name: str) -> list[str]:
    entry = {"file": "a.glb", "id": name}
    return ["scenes", "--params", str(write(Path("p.yaml"), {"scenes": {"imports": [entry]}}))]


def camera_file(name: str) -> list[str]:
    return ["inspect", str(write(Path("a.json"), {"scene_id": name, "views": []}))]


def scene_folder(name: str) -> list[str]:
    scene = Path("a")
    scene.mkdir()
    (scene / "scene.xml").write_text("<scene version='3.0.0'/>")
    save_scene(scene, box_scene("a"))
    write(scene / "scene.json", {**json.loads((scene / "scene.json").read_text()),
                                 "scene_id": name})  # fmt: skip
    return ["import", "a", "--out", "out/scene"]


def preset(name: str) -> list[str]:
    return ["preset", "--", name]


def network(name: str) -> list[str]:
    return ["train", "--", name]


COMMANDS = (an_import, import_of_the_parameters, camera_file, scene_folder, preset, network)


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("name", WORDS, ids=range(len(WORDS)))
def test_a_command_refuses_the_name_and_writes_nothing(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    command: Callable[[str], list[str]],
    name: str,
) -> None:
    (tmp_path / "in" / "work").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "in" / "work")
    arguments = command(name)
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code in (2, 3)
    assert capsys.readouterr().err.count("Error: ") == 1
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("name", NAMES, ids=range(len(NAMES)))
def test_the_check_refuses_every_name_that_is_no_file_name(name: str) -> None:
    with pytest.raises(InputError, match="cannot be a thing"):
        check_name(name, "a thing", error=InputError)


def test_usual_names_pass() -> None:
    for name in ("home-0000", "a.b_c-1", "console", "com", "x" * 128):
        assert check_name(name, "a thing") == name


def test_ids_of_shapes_in_a_scene_file_are_checked(tmp_path: Path) -> None:
    xml = tmp_path / "scene.xml"
    xml.write_text('<scene version="3.0.0"><shape type="cube" id="../../x"/></scene>')
    with pytest.raises(InputError, match="a shape's id"):
        check_scene_xml(xml)


def test_a_scene_with_another_id_than_its_folder_loads(tmp_path: Path) -> None:
    (tmp_path / "scene.xml").write_text("<scene/>")
    save_scene(tmp_path, box_scene("other"))
    assert load_scene(tmp_path).scene_id == "other"
