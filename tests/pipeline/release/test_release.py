"""Releases: recipes, records, equal sums."""

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from pbrnet.pipeline.channels import Kind
from pbrnet.pipeline.commands import release as command
from pbrnet.pipeline.dataset.pack import pack_dataset
from pbrnet.pipeline.dataset.shards import verify_sums
from pbrnet.pipeline.frames import frame_path
from pbrnet.pipeline.params import Params, load_params
from pbrnet.pipeline.release import verify
from pbrnet.pipeline.release.recipe import load_recipe, load_record, recipe_names
from pbrnet.pipeline.stages.runner import StageError
from pbrnet.pipeline.views import load_cameras
from pbrnet.scenes.errors import ParameterError, PbrnetError
from tests.fixtures.dataset import box_frames, make_data, write_view
from tests.fixtures.paths import ROOT

RECIPE = """
title: Two rooms
version: 1.0.0
parameters:
  image: {width: 32, height: 24}
  illumination: {width: 32}
"""


@pytest.fixture
def recipes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with one recipe, whose frames are synthetic: no renderer."""
    folder = tmp_path / "recipes"
    folder.mkdir()
    (folder / "rooms.yaml").write_text(RECIPE)

    def render(data: Path, params: Params, scheduler: str | None) -> str:
        make_data(data, params, scenes=2, views=2)
        return "rendered"

    monkeypatch.setattr(command, "_STAGES", (render,))
    return folder


def released(recipes: Path, *options: str, name: str = "rooms") -> Result:
    where = ["--recipes", str(recipes), "--out", str(recipes.parent / "out")]
    return CliRunner().invoke(command.release, [name, *where, *options])


def test_a_release_made_again_has_the_recorded_sums(recipes: Path) -> None:
    out = recipes.parent / "out"
    first = released(recipes, "--record")
    assert first.exit_code == 0, first.output
    assert "images: 32x24" in first.stderr and "samples: 16 per pixel" in first.stderr
    card = (out / "dataset" / "README.md").read_text()
    assert "Release `rooms`, version 1.0.0" in card and "core-seconds a row" in card
    files = verify_sums(out / "dataset")
    shutil.rmtree(out)
    again = released(recipes, "--workers", "2")
    assert again.exit_code == 0, again.output
    assert f"all {files} files have the recorded checksums" in again.output


def test_other_bytes_are_named(recipes: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    released(recipes, "--record")
    (recipes / "rooms.yaml").write_text(RECIPE.replace("1.0.0", "1.1.0") + "  seed: 5\n")
    changed = released(recipes)
    assert isinstance(changed.exception, PbrnetError)
    assert "the record is of version 1.0.0" in str(changed.exception)
    assert "README.md" in str(changed.exception)
    monkeypatch.setattr(command, "instruction_set", lambda: "another")
    assert "light frames depend on it" in str(released(recipes).exception)


def test_failed_views_fail_the_release_which_holds_the_others(
    recipes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (render,) = command._STAGES

    def lose(data: Path, params: Params, scheduler: Any) -> str:
        render(data, params, scheduler)
        view = load_cameras(data / "cameras" / "home-0000.json").views[0]
        frame_path(data, "color", view).unlink()
        raise StageError("groundtruth: 1 of 4 views failed")

    monkeypatch.setattr(command, "_STAGES", (lose,))
    done = released(recipes)
    assert isinstance(done.exception, StageError)
    assert "3 rows" in done.output and "nothing to compare with" in done.output


@pytest.mark.parametrize(
    ("kind", "band", "factor", "code", "expected"),
    [
        ("color", "R", 1.0, 0, r"3 of 3 rows equal to the bit"),
        ("color", "R", 1.004, 0, r"1 of 3 rows equal to the bit, 2 with light within 0\.00\d+ of"),
        ("color", "R", 1.1, 1, r"home-0000/000: other .*\bcolor"),
        ("inputs", "Z", 1.001, 1, r"home-0000/000: other depth"),
    ],
)
def test_rows_are_verified_by_rendering_them_anew(
    kind: Kind,
    band: str,
    factor: float,
    code: int,
    expected: str,
    recipes: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    released(recipes)

    def render(folder: Path, params: Params, rows: Any, *_: Any) -> None:
        make_data(folder, params, scenes=2, views=2)
        for view in load_cameras(folder / "cameras" / "home-0000.json").views:
            frame = box_frames(view, params)[kind]
            frame[band] = (frame[band] * factor).astype(frame[band].dtype)
            write_view(folder, kind, frame, view)
        pack_dataset(folder, params)

    monkeypatch.setattr(verify, "_render", render)
    done = released(recipes, "--verify", "3", "--seed", "1")
    assert any(re.match(expected, line) for line in done.output.splitlines()), done.output
    assert done.exit_code == code
    assert code == 0 or "2 rows unlike the recipe" in str(done.exception)


def test_recipes_are_listed_and_faults_named(recipes: Path) -> None:
    done = CliRunner().invoke(command.release, ["--recipes", str(recipes)])
    assert done.output.split() == ["rooms", "Two", "rooms"]
    with pytest.raises(ParameterError, match=r"no such recipe; available: rooms"):
        load_recipe("castle", recipes)
    with pytest.raises(ParameterError, match="a recipe's name"):
        load_recipe("../rooms", recipes)
    (recipes / "wrong.yaml").write_text(RECIPE.replace("width: 32}", "widht: 32}"))
    with pytest.raises(ParameterError, match=r"wrong\.yaml: illumination\.widht"):
        load_recipe("wrong", recipes)


def test_the_project_s_recipes_are_sound() -> None:
    names = recipe_names(ROOT / "recipes")
    assert {"tiny", "quick", "indoor-75k"} <= set(names)
    for name in names:
        recipe, record = load_recipe(name, ROOT / "recipes"), load_record(name, ROOT / "recipes")
        assert record is None or record.version == recipe.version, name
    assert load_recipe("quick").parameters == load_params(ROOT / "params.yaml") == Params()


def test_a_recipe_changes_a_preset(recipes: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(recipes.parent)  # presets are those of the project
    (recipes.parent / "params").mkdir()
    (recipes.parent / "params" / "small.yaml").write_text(
        "seed: 3\nimage: {width: 64, height: 48}\ngroundtruth: {spp: 16}\n"
    )
    (recipes / "larger.yaml").write_text(
        "title: Larger\nversion: 2.0.0\npreset: small\nparameters: {image: {width: 80}}\n"
    )
    found = load_recipe("larger", recipes).parameters
    assert (found.seed, found.image.width, found.image.height) == (3, 80, 48)
    assert found.groundtruth.spp == 16
    (recipes / "lost.yaml").write_text("title: Lost\nversion: 1.0.0\npreset: none\n")
    with pytest.raises(ParameterError, match=r"lost\.yaml: none: no such preset"):
        load_recipe("lost", recipes)


@pytest.mark.check
@pytest.mark.timeout(3600)
def test_a_rendered_release_made_again_has_the_recorded_sums(tmp_path: Path) -> None:
    recipes = tmp_path / "recipes"
    recipes.mkdir()
    shutil.copy(ROOT / "recipes" / "tiny.yaml", recipes)
    first = released(recipes, "--record", name="tiny")
    assert first.exit_code == 0, first.output
    shutil.rmtree(tmp_path / "out")
    again = released(recipes, "--workers", "2", name="tiny")
    assert again.exit_code == 0, again.output
    checked = released(recipes, "--verify", "1", name="tiny")
    assert "1 of 1 rows equal to the bit" in checked.output
    record = json.loads((recipes / "tiny.json").read_text())
    assert record["rows"] == 2 and record["core_seconds"]["color"] > 0


@pytest.mark.parametrize(
    ("name", "one", "two", "same"),
    [
        ("renderer", "mitsuba 3.8, llvm, AVX2", "mitsuba 3.8, llvm, AVX-512", True),
        ("renderer", "mitsuba 3.8, llvm, AVX2", "mitsuba 3.9, llvm, AVX2", False),
        ("noise_lights", [0.1, 0.2], [0.1000001, 0.2], True),
        ("noise_lights", [0.1, 0.2], [0.2, 0.2], False),
        ("K", [1.0, 2.0], [1.0, 2.0000001], False),
        ("noise_color", 0.1, 0.1000001, True),
    ],
)
def test_rows_may_come_from_another_processor(name: str, one: Any, two: Any, same: bool) -> None:
    assert verify._same(name, one, two) == same
