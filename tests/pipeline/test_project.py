"""`pbrnet init` and `pbrnet params`: a project's folder, and what its parameters are."""

import json
from functools import reduce
from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner, Result

from pbrnet.pipeline.cli import cli
from pbrnet.pipeline.commands import project
from pbrnet.scenes.errors import MachineError, ParameterError
from tests.fixtures.paths import ROOT


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def pbrnet(*words: str) -> Result:
    """Run a command in this process."""
    return CliRunner().invoke(cli, words, catch_exceptions=True)


def test_init_writes_a_project_and_overwrites_nothing() -> None:
    Path(".dvc").mkdir()  # as if DVC were there: starting it takes a second
    Path("dvc.yaml").write_text("mine")
    assert isinstance(pbrnet("init").exception, ParameterError)
    assert [path.name for path in Path().iterdir() if path.is_file()] == ["dvc.yaml"]
    Path("dvc.yaml").unlink()
    assert pbrnet("init").exit_code == 0
    for name in ("params.yaml", "dvc.yaml", "keys.yaml"):
        assert Path(name).read_text() == (ROOT / name).read_text()
    ignored = Path(".gitignore").read_text().splitlines()
    assert {"/data/", "/exports/", "/inspect-*.png"} <= {*ignored}


def test_init_adds_to_the_gitignore_that_there_is() -> None:
    Path(".dvc").mkdir()
    Path(".gitignore").write_text("*.pyc\n/data/")
    assert pbrnet("init").exit_code == 0
    lines = Path(".gitignore").read_text().splitlines()
    assert lines[:2] == ["*.pyc", "/data/"] and "/models/" in lines
    assert lines.count("/data/") == 1


def test_init_can_be_repeated_after_it_failed(monkeypatch: pytest.MonkeyPatch) -> None:
    Path(".dvc").mkdir()
    write = project.write_text

    def full(path: Path, text: str) -> None:
        if path.name == "params.yaml":
            raise MachineError("the disk is full")
        write(path, text)

    with monkeypatch.context() as patch:
        patch.setattr(project, "write_text", full)
        assert isinstance(pbrnet("init").exception, MachineError)
    assert [path.name for path in Path().iterdir()] == [".dvc"]
    assert pbrnet("init").exit_code == 0


def test_keys_of_another_version_are_noticed_and_renewed() -> None:
    Path(".dvc").mkdir()
    pbrnet("init")
    assert pbrnet("params", "seed").stderr == ""
    known = Path("keys.yaml").read_text()
    Path("keys.yaml").write_text(known.replace("assets: 1 ", "assets: 9 "))
    said = pbrnet("params", "seed").stderr
    assert "assets is 9, but 1 in this version" in said and "pbrnet init --update" in said
    Path("params.yaml").write_text("seed: 7")
    assert pbrnet("init", "--update").exit_code == 0
    assert Path("keys.yaml").read_text() == known
    assert Path("params.yaml").read_text() == "seed: 7"


def test_params_says_value_origin_and_meaning() -> None:
    Path("params.yaml").write_text("seed: 7\nimage: {width: 64}\ntrain: {can: {epochs: 3}}\n")
    rows = json.loads(pbrnet("params", "--json", "--workers", "3").stdout)
    found = {row["key"]: row for row in rows}
    assert (found["seed"]["value"], found["seed"]["from"]) == (7, "params.yaml")
    assert (found["farm.workers"]["value"], found["farm.workers"]["from"]) == (3, "--workers")
    assert (found["image.height"]["value"], found["image.height"]["from"]) == (120, "default")
    assert found["train.can.epochs"]["default"] == 10 and found["train.can.levels"]["value"] == 10
    assert found["scenes.texture_size"]["value"] == "auto"
    assert found["cameras.grid"]["meaning"].startswith("metres")
    changed = pbrnet("params", "--changed").stdout.splitlines()
    assert [line.split()[0] for line in changed] == ["seed", "image.width", "train.can.epochs"]
    assert {line.split()[0] for line in pbrnet("params", "image").stdout.splitlines()} == {
        "image.width", "image.height", "image.half_fov_x", "image.projection",
        "image.lens.distortion", "image.lens.focal", "image.lens.centre",
        "image.lens.half_width", "image.lens.calibration", "image.lens.camera",
    }  # fmt: skip
    assert isinstance(pbrnet("params", "imag").exception, ParameterError)


def test_a_short_file_is_completed_for_dvc() -> None:
    """DVC refuses a file without a section or key that a stage of dvc.yaml names."""
    Path("params.yaml").write_text("seed: 3\nscenes: {homes: 2}\n")
    before = json.loads(pbrnet("params", "--json").stdout)
    assert pbrnet("params", "--complete").exit_code == 0
    content = yaml.safe_load(Path("params.yaml").read_text())
    stages = yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"].values()
    named = [name for one in stages for name in one.get("params", []) if isinstance(name, str)]
    for key in (name for name in named if "$" not in name):  # baselines: ${item.key}
        assert reduce(dict.__getitem__, key.split("."), content) is not None
    assert (content["seed"], content["scenes"]["homes"]) == (3, 2)
    after = json.loads(pbrnet("params", "--json").stdout)
    assert [(one["key"], one["value"]) for one in after] == [
        (one["key"], one["value"]) for one in before
    ]
