"""Trash: what is no longer asked for is kept for a while, and comes back."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from pbrnet.pipeline.records import Trash

FRAME, SCENE = "color/one/a.exr", "scenes/one"


@pytest.fixture
def data(tmp_path: Path) -> Path:
    for name in (FRAME, f"{SCENE}/scene.json", f"{SCENE}/meshes/x.ply"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(name)
    return tmp_path


@pytest.mark.parametrize("name", [FRAME, SCENE])
def test_what_goes_comes_back_as_it_was(data: Path, name: str) -> None:
    before = {path: path.read_text() for path in data.rglob("*") if path.is_file()}
    trash = Trash(data, 30)
    trash.add([data / name])
    assert not (data / name).exists() and trash.place(data / name).exists()
    trash.sweep()
    assert "trash: 1 item, 0.0 MB" in trash.described()
    trash.put_back([data / name])
    trash.sweep()
    assert {path: path.read_text() for path in data.rglob("*") if path.is_file()} == before
    assert trash.described() == "" and not trash.folder.exists()


@pytest.mark.parametrize("name", [FRAME, SCENE])
def test_what_comes_back_changes_places_with_what_lies_there(data: Path, name: str) -> None:
    trash, first = Trash(data, 30), data / name
    trash.add([first])
    second = first if name == FRAME else first / "scene.json"
    second.parent.mkdir(parents=True, exist_ok=True)
    second.write_text("other")
    trash.put_back([first])
    assert second.read_text() != "other"
    trash.put_back([first])
    assert second.read_text() == "other"
    assert "1 item," in trash.described()


@pytest.mark.parametrize("name", [FRAME, SCENE])
def test_its_time_counts_from_when_it_went(data: Path, name: str) -> None:
    old = time.time() - 100 * 86_400
    for path in data.rglob("*"):
        os.utime(path, (old, old))
    trash = Trash(data, 30)
    trash.add([data / name])
    trash.sweep()
    place = trash.place(data / name)
    assert place.exists()
    os.utime(place, (old, old))
    Trash(data, 101).sweep()
    assert place.exists()
    trash.sweep()
    assert not place.exists()


def test_without_days_nothing_is_kept(data: Path) -> None:
    Trash(data, 30).add([data / FRAME])
    trash = Trash(data, 0)
    trash.add([data / SCENE])
    trash.sweep()
    assert not (data / SCENE).exists() and not trash.folder.exists()
