"""Scenes beside a released dataset: files, checksums, card, resumption."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from pbrnet.pipeline.commands import release as command
from pbrnet.pipeline.dataset.shards import read_sums, verify_sums
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.release import scenes as release_scenes
from pbrnet.pipeline.scene_export.export import Exported
from pbrnet.scenes.contract import Credit, load_scene, save_scene
from pbrnet.scenes.errors import InputError
from tests.fixtures.dataset import make_data
from tests.pipeline.release.test_release import RECIPE

MINE = Credit("everything", "Two | rooms", "A. Nybody", "CC-BY-4.0")


@pytest.fixture
def out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a release of two scenes; the second has no stated licence."""
    (tmp_path / "rooms.yaml").write_text(RECIPE)

    def render(data: Path, params: Params, scheduler: str | None) -> str:
        if not (data / "scenes").exists():
            make_data(data, params, scenes=2, views=2)
            credits = [(MINE,), (replace(MINE, licence="unknown"),)]
            for number, credit in enumerate(credits):
                folder = data / "scenes" / f"home-{number:04d}"
                save_scene(folder, replace(load_scene(folder), credits=credit))
        return "rendered"

    monkeypatch.setattr(command, "_STAGES", (render,))
    return tmp_path / "out"


def _released(out: Path, *options: str) -> Result:
    where = ["--recipes", str(out.parent), "--out", str(out)]
    return CliRunner().invoke(command.release, ["rooms", *where, *options])


def test_scenes_are_listed_with_licence_and_author(out: Path) -> None:
    plain = _released(out, "--record")
    assert plain.exit_code == 0, plain.output
    done = _released(out, "--scenes", "mitsuba")
    assert done.exit_code == 0, done.output
    assert "have the recorded checksums" in done.output  # those of the dataset itself
    assert "left out, licence or author unknown: home-0001" in done.output
    dataset = out / "dataset"
    assert [path.name for path in (dataset / "scenes").iterdir()] == ["home-0000.zip"]
    assert "scenes/home-0000.zip" in read_sums(dataset / "SHA256SUMS")
    verify_sums(dataset)
    card = (dataset / "README.md").read_text()
    assert "| `home-0000.zip` | CC-BY-4.0 | Two \\| rooms by A. Nybody (CC-BY-4.0) |" in card
    (dataset / "scenes" / "home-0000.zip").unlink()
    with pytest.raises(InputError, match=r"scenes/home-0000\.zip is missing"):
        verify_sums(dataset)


def test_only_what_is_missing_or_changed_is_exported_again(
    out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    exported = []
    real = release_scenes.export_scene

    def export(folder: Path, *rest: Any) -> Exported:
        exported.append(folder.name)
        return real(folder, *rest)

    monkeypatch.setattr(release_scenes, "export_scene", export)
    assert _released(out, "--scenes", "mitsuba").exit_code == 0
    before = (out / "dataset" / "SHA256SUMS").read_bytes()
    shutil.rmtree(out / "dataset")
    assert _released(out, "--scenes", "mitsuba").exit_code == 0
    assert (out / "dataset" / "SHA256SUMS").read_bytes() == before
    assert exported == ["home-0000"]
    (out / "exports" / "scenes-mitsuba" / "home-0000.zip").write_bytes(b"damaged")
    assert _released(out, "--scenes", "mitsuba").exit_code == 0
    assert (out / "dataset" / "SHA256SUMS").read_bytes() == before
    (out / "exports" / "scenes-mitsuba" / "made.json").write_text('{"home-0000": [1]}')
    assert _released(out, "--scenes", "mitsuba").exit_code == 0
    other = out / "scenes" / "home-0001"
    save_scene(other, replace(load_scene(other), credits=(MINE,)))
    assert _released(out, "--scenes", "mitsuba").exit_code == 0
    assert exported == [*["home-0000"] * 3, "home-0001"]


def test_a_release_without_scenes_has_none_left(out: Path) -> None:
    assert _released(out, "--scenes", "mitsuba").exit_code == 0
    assert _released(out).exit_code == 0
    assert not (out / "dataset" / "scenes").exists()
    verify_sums(out / "dataset")
