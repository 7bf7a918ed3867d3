"""Scene folders from elsewhere: nothing outside of them is read."""

import os
from pathlib import Path

import pytest

from pbrnet.scenes.errors import InputError
from pbrnet.scenes.formats.scene_xml import check_scene_xml

MESH = '<shape type="ply"><string name="filename" value="{}"/></shape>'


def scene(folder: Path, body: str, head: str = "") -> Path:
    (folder / "meshes").mkdir(exist_ok=True)
    (folder / "meshes" / "a.ply").write_text("ply\n")
    path = folder / "scene.xml"
    path.write_text(f'{head}<scene version="3.0.0">{body}</scene>')
    return path


def test_files_inside_are_allowed(tmp_path: Path) -> None:
    check_scene_xml(scene(tmp_path, MESH.format("meshes/a.ply")))


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (MESH.format("/etc/passwd"), "leads out"),
        (MESH.format("../other/a.ply"), "leads out"),
        (MESH.format("meshes/../../a.ply"), "leads out"),
        (MESH.format("C:\\\\a.ply"), "leads out"),
        (MESH.format("$home/a.ply"), "leads out"),
        ('<spectrum name="x" filename="/etc/passwd"/>', "leads out"),
        ('<include filename="other.xml"/>', "<include>"),
        ('<path value="/"/>', "<path>"),
        ("<bsdf>" * 200 + "</bsdf>" * 200, "in one another"),
        ("<bsdf>", "not valid XML"),
    ],
)
def test_what_leads_out_is_refused(tmp_path: Path, body: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        check_scene_xml(scene(tmp_path, body))


def test_entities_are_refused(tmp_path: Path) -> None:
    head = "<!DOCTYPE x [<!ENTITY i SYSTEM '/etc/passwd'>]>"
    with pytest.raises(InputError, match="entities"):
        check_scene_xml(scene(tmp_path, "&i;", head))


def test_links_out_and_pipes_are_refused(tmp_path: Path) -> None:
    (tmp_path / "outside.ply").write_text("ply\n")
    folder = tmp_path / "room"
    folder.mkdir()
    path = scene(folder, MESH.format("meshes/b.ply"))
    (folder / "meshes" / "b.ply").symlink_to(tmp_path / "outside.ply")
    with pytest.raises(InputError, match="link out"):
        check_scene_xml(path)
    (folder / "meshes" / "b.ply").unlink()
    os.mkfifo(folder / "meshes" / "b.ply")
    with pytest.raises(InputError, match="not a regular file"):
        check_scene_xml(path)


def test_missing_files_are_counted(tmp_path: Path) -> None:
    body = "".join(MESH.format(f"meshes/{name}.ply") for name in "abc")
    with pytest.raises(InputError, match=r"meshes/b\.ply is missing, and 1 more"):
        check_scene_xml(scene(tmp_path, body))
