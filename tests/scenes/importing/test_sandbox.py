"""Files of a scene: where images are looked for, and what stays out of reach."""

from pathlib import Path

import pytest

from pbrnet.scenes.errors import InputError
from pbrnet.scenes.importing.sandbox import Sandbox, model_root
from pbrnet.scenes.opened_files import OpenedFiles

PLACES = ("materials/textures", "textures", "Textures", "maps")


def model(folder: Path, image: str) -> OpenedFiles:
    """A model in `meshes`, with an image in another folder of its package."""
    (folder / "X" / "meshes").mkdir(parents=True)
    path = folder / "X" / image
    path.parent.mkdir(parents=True)
    path.write_bytes(b"")
    return OpenedFiles(folder / "X" / "meshes")


@pytest.mark.parametrize("place", PLACES)
def test_textures_beside_the_folder_of_meshes_are_found_within_the_root(
    tmp_path: Path, place: str
) -> None:
    opened = model(tmp_path, f"{place}/wood.png")
    sandbox = Sandbox(opened, tmp_path / "X")
    assert sandbox.find("wood.png", "x.dae") == tmp_path / "X" / place / "wood.png"
    assert sandbox.find("C:\\work\\wood.png", "x.dae") == tmp_path / "X" / place / "wood.png"
    assert sandbox.relocated[0] == ("wood.png", f"{place}/wood.png")
    assert Sandbox(opened).find("wood.png", "x.dae") is None


@pytest.mark.parametrize("place", PLACES)
def test_textures_beside_the_model_are_found_without_a_root(tmp_path: Path, place: str) -> None:
    (tmp_path / place).mkdir(parents=True)
    (tmp_path / place / "Wood.png").write_bytes(b"")
    found = Sandbox(OpenedFiles(tmp_path)).find("wood.png", "x.dae")
    assert found == tmp_path / place / "Wood.png"


def test_a_gazebo_model_may_read_its_whole_package_and_no_more(tmp_path: Path) -> None:
    opened = model(tmp_path, "materials/textures/wood.png")
    assert model_root(opened) is None
    (tmp_path / "X" / "model.config").write_text("<model/>")
    assert model_root(OpenedFiles(opened.folder)) == tmp_path / "X"
    (tmp_path / "X" / "materials" / "textures" / "out.png").symlink_to(tmp_path / "secret.png")
    (tmp_path / "secret.png").write_bytes(b"")
    sandbox = Sandbox(opened, tmp_path / "X")
    assert sandbox.find("out.png", "x.dae") is None
    assert sandbox.find("secret.png", "x.dae") is None


def test_a_path_out_of_the_folder_to_a_missing_image_counts_by_its_name(tmp_path: Path) -> None:
    folder = tmp_path / "scene"
    (folder / "maps").mkdir(parents=True)
    (folder / "maps" / "oak.png").write_bytes(b"")
    (tmp_path / "secret.png").write_bytes(b"")
    sandbox = Sandbox(OpenedFiles(folder))
    assert sandbox.find("../../Wood/oak.png", "a.mtl", is_image=True) == folder / "maps" / "oak.png"
    assert sandbox.find("../../Wood/pine.png", "a.mtl", is_image=True) is None
    for name, is_image in (("../secret.png", True), ("../gone.obj", False)):
        with pytest.raises(InputError, match="outside the scene's folder"):
            sandbox.find(name, "a.mtl", is_image=is_image)
