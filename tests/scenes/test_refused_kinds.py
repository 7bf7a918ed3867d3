"""Kinds of files that are refused say what to do instead."""

from pathlib import Path

import pytest

from pbrnet.scenes.errors import InputError
from pbrnet.scenes.registry import SOURCES, import_scene, refused


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("Flat.SKP", r"SketchUp.*\.dae"),
        ("a.rvt", r"Revit.*\.ifc"),
        ("a.max", r"3ds Max.*\.glb"),
        ("a.zip", "unpack it"),
        ("office.world", r"Gazebo.*meshes"),
        ("office.rad", r"Radiance.*\.obj"),
    ],
)
def test_a_known_kind_is_refused_with_a_way_around(tmp_path: Path, name: str, message: str) -> None:
    (tmp_path / name).write_bytes(b"{}")
    with pytest.raises(InputError, match=message):
        import_scene(tmp_path / name, tmp_path / "out")


@pytest.mark.parametrize("suffix", [".glb", ".obj", ".sh3d", ".xml"])
def test_a_pointer_of_git_lfs_says_how_to_get_the_file(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    digest = "0" * 64
    path.write_text(f"version https://git-lfs.github.com/spec/v1\noid sha256:{digest}\nsize 9\n")
    with pytest.raises(InputError, match=r"Git LFS.*git lfs pull"):
        import_scene(path, tmp_path / "out")


@pytest.mark.parametrize(("root", "kind"), [("mujoco model='room'", "MuJoCo"), ("robot", "URDF")])
def test_xml_of_others_is_told_by_its_root(tmp_path: Path, root: str, kind: str) -> None:
    path = tmp_path / "room.xml"
    path.write_text(f'<?xml version="1.0"?>\n<!-- no <scene> -->\n<{root}/>')
    with pytest.raises(InputError, match=kind):
        import_scene(path, tmp_path / "out")


def test_every_way_around_leads_to_a_kind_that_is_read() -> None:
    for suffix, (_, remedy) in refused().items():
        assert suffix == suffix.lower()
        words = {word.strip(".,;:()") for word in remedy.split() if word.startswith((".", "(."))}
        assert all(f".{word}" in SOURCES for word in words), (suffix, words)
