"""Exports that are stopped, whose scene changes meanwhile, and two of them at once."""

import shutil
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pbrnet.pipeline.scene_export import export
from pbrnet.pipeline.scene_export.export import TARGETS, export_scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import atomic_directory
from tests.fixtures.many_scenes import IMPORTS

# What a format calls last, before its files appear.
_LAST = {"glb": "save_sky", "usd": "temporary_folder", "mitsuba": "write_archive"}


@pytest.fixture(scope="module")
def scene(few_walks: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of an imported room with sun and sky."""
    return IMPORTS["obj-two-rooms"](tmp_path_factory.mktemp("in") / "scene").folder


def _meanwhile(monkeypatch: pytest.MonkeyPatch, name: str, act: Callable[[], None]) -> None:
    real = getattr(export, name)

    def acting(*given: Any) -> Any:
        act()
        return real(*given)

    monkeypatch.setattr(export, name, acting)


@pytest.mark.parametrize("name", list(_LAST))
def test_a_stopped_export_leaves_nothing(
    name: str, scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if name == "usd":
        pytest.importorskip("pxr")

    def stop() -> None:
        raise KeyboardInterrupt

    _meanwhile(monkeypatch, _LAST[name], stop)
    with pytest.raises(KeyboardInterrupt):
        export_scene(scene, name, tmp_path / f"out{TARGETS[name].suffixes[0]}")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", list(_LAST))
def test_a_scene_that_changes_is_not_exported(
    name: str, scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if name == "usd":
        pytest.importorskip("pxr")
    folder = tmp_path / "in" / "scene"
    shutil.copytree(scene, folder)
    mesh = next(folder.glob("meshes/*.ply"))
    _meanwhile(monkeypatch, _LAST[name], lambda: mesh.write_bytes(mesh.read_bytes() + b"\n"))
    (tmp_path / "out").mkdir()
    with pytest.raises(InputError, match=rf"{mesh.name}: changed during the export"):
        export_scene(folder, name, tmp_path / "out" / f"out{TARGETS[name].suffixes[0]}")
    assert list((tmp_path / "out").iterdir()) == []


def test_writers_of_one_folder_leave_one_whole(tmp_path: Path) -> None:
    faults: list[BaseException] = []

    def write(number: int) -> None:
        try:
            for _ in range(40):
                with atomic_directory(tmp_path / "images") as partial:
                    (partial / "a").write_text(f"{number}")
                    (partial / "b").write_text(f"{number}")
        except BaseException as error:
            faults.append(error)

    threads = [threading.Thread(target=write, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert faults == []
    assert [path.name for path in tmp_path.iterdir()] == ["images"]
    texts = [path.read_text() for path in (tmp_path / "images").iterdir()]
    assert len(texts) == 2 and len(set(texts)) == 1
