"""Every command explains itself; every failure is one message and an exit code."""

import json
import os
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import get_args

import click
import pytest
import yaml
from click.testing import CliRunner

from pbrnet.model.commands import doctor
from pbrnet.model.commands.doctor import examine
from pbrnet.model.settings import Baseline
from pbrnet.pipeline.cli import COMMANDS, cli, main
from pbrnet.pipeline.release.presets import find_preset
from pbrnet.pipeline.terminal import RENAMED
from pbrnet.scenes.errors import ParameterError
from tests.fixtures.command import exit_code
from tests.fixtures.paths import ROOT


def walk() -> list[tuple[str, click.Command]]:
    """Every command, those inside groups too, with its full name."""
    found = []
    for name in COMMANDS:
        command = cli.get_command(click.Context(cli), name)
        assert command is not None
        if isinstance(command, click.Group):
            found += [(f"{name} {inner}", item) for inner, item in command.commands.items()]
        else:
            found.append((name, command))
    return found


@pytest.mark.parametrize(("name", "command"), walk(), ids=[name for name, _ in walk()])
def test_every_command_has_help_an_example_and_a_seed(name: str, command: click.Command) -> None:
    result = CliRunner().invoke(cli, [*name.split(), "--help"])
    assert result.exit_code == 0
    assert f"pbrnet {name}" in result.output.split("Usage:")[1].split("\n", 1)[1]
    assert any("--seed" in option.opts for option in command.params)


def test_an_old_name_works_with_one_line_and_a_removed_one_says_what_to_use(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    old = {"pbrnet values": "pbrnet params", "pbrnet params --edited": "pbrnet params --changed"}
    old["cameras.per_room"] = "cameras.views_per_room"
    for name, new in old.items():
        monkeypatch.setitem(RENAMED, name, new)
    file = tmp_path / "params.yaml"
    file.write_text("cameras: {per_room: 7}")
    done = CliRunner().invoke(cli, ["values", "--edited", f"--params={file}"])
    assert done.exit_code == 0 and "7" in done.stdout
    lines = [f"{name} is deprecated; use {new}" for name, new in old.items()]
    assert done.stderr.splitlines() == lines
    with pytest.raises(ParameterError, match="removed; use --transport and --materials"):
        cli.main(["predict", "home", "--visibility=a"], standalone_mode=False)


def test_every_stage_of_dvc_is_a_command() -> None:
    stages = yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"]
    names = [name for name, _ in walk()]
    for stage in stages.values():
        items = get_args(Baseline) if "matrix" in stage else [""]
        for item in items:
            command = stage["cmd"].replace("${item.name}", item)
            assert command.removeprefix("pbrnet ") in names


def run(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "pbrnet.pipeline.cli", *arguments],
        cwd=cwd, capture_output=True, text=True, timeout=120,
    )  # fmt: skip


def test_bad_parameters_exit_with_2_before_any_work(tmp_path: Path) -> None:
    (tmp_path / "params.yaml").write_text("image: {width: 3}")
    done = run("scenes", cwd=tmp_path)
    assert done.returncode == 2
    assert "image.width: 3 is not allowed" in done.stderr
    assert "Traceback" not in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["params.yaml"]


def test_missing_parameters_say_how_to_get_them(tmp_path: Path) -> None:
    done = run("cameras", cwd=tmp_path)
    assert done.returncode == 2
    assert "pbrnet preset quick" in done.stderr


def test_an_unexpected_error_is_one_message_and_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    @click.command()
    def broken() -> None:
        raise ZeroDivisionError("first line\nsecond line")

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(cli, "get_command", lambda _context, _name: broken)
    with pytest.raises(SystemExit) as end:
        main(["broken"])
    message = capsys.readouterr().err
    assert end.value.code == 70
    assert message.startswith("Error: unexpected ZeroDivisionError: first line\n")
    assert "Traceback" not in message and "second line" not in message
    (file,) = tmp_path.iterdir()
    assert str(file) in message and "Traceback" in file.read_text()
    monkeypatch.setenv("PBRNET_DEBUG", "1")
    with pytest.raises(ZeroDivisionError):
        main(["broken"])


def test_an_unknown_command_exits_with_2(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["rendr"])
    assert stop.value.code == 2
    assert "rendr" in capsys.readouterr().err


def test_presets_replace_each_other_but_not_own_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    target = tmp_path / "params.yaml"
    for name in ("quick", "paper"):
        assert exit_code("preset", name) == 0
        assert target.read_text() == find_preset(name).text()
    target.write_text(target.read_text().replace("seed: 0", "seed: 5"))
    assert exit_code("preset", "quick") == 2
    assert "--force" in capsys.readouterr().err
    assert "seed: 5" in target.read_text()
    assert exit_code("preset", "quick", "--force") == 0
    assert exit_code("preset", "slow") == 2


def test_params_yaml_is_written_from_the_defaults() -> None:
    assert (ROOT / "params.yaml").read_text() == find_preset("quick").text(), (
        "write it with: pbrnet preset quick --force"
    )


def test_doctor_reports(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert exit_code("doctor", "--json") == 0
    topics = [finding["topic"] for finding in yaml.safe_load(capsys.readouterr().out)]
    assert {"LLVM", "GPU", "threads", "memory", "VGG-19", "catalogues"} <= set(topics)


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("preset", "quick", "--params", "pipe"), 2, "not a regular file"),
        (("preset", "quick", "--params", "folder"), 2, "a folder"),
        (("shading", "--data", "loop"), 3, "links in a circle"),
        (("cost", "--seed", "9" * 4000), 2, "from 0 to"),
        (("cost", "--params", "hex.yaml"), 2, "over 1,200 digits"),
        (("cost", "--params", "a" * 300), 2, "no such parameter file"),
        (("import", "a.glb", "--out", "x", "--max-seconds", "nan"), 2, "nan is not a number"),
        (("import", "a.glb", "--out", "."), 3, "cannot be a scene's id"),
        (("report", "--out", "loop/x.html"), 4, "a link is where a folder has to be"),
    ],
)
def test_strange_places_and_numbers_end_in_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: tuple[str, ...],
    code: int,
    words: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe")
    Path("folder").mkdir()
    Path("loop").symlink_to("loop")
    Path("hex.yaml").write_text("seed: 0x" + "f" * 6000)
    Path("params.yaml").write_text("seed: 0\n")
    assert exit_code(*arguments) == code
    said = capsys.readouterr().err
    assert words in said and said.count("Error: ") == 1


def test_doctor_lists_every_optional_extra_with_its_command(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pbrnet.model.commands.doctor.find_spec", lambda name: None)
    monkeypatch.setattr("pbrnet.model.commands.doctor.shutil.which", lambda name: None)
    assert exit_code("doctor", "--json") == 0
    found = {each["topic"]: each for each in json.loads(capsys.readouterr().out)}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    for extra in set(project["optional-dependencies"]) - {"all", "dev", "docs"}:
        assert found[extra]["state"].startswith("not installed")
        assert f"pip install 'pbrnet[{extra}]'" in found[extra]["advice"]
    assert "DracoPy" in found["formats"]["state"]


def test_doctor_names_the_pretrained_networks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(doctor, "PACKED", tmp_path / "weights")

    def said() -> str:
        return next(one.state for one in examine() if one.topic == "pretrained")

    assert said() == f"no networks in {tmp_path}/weights"
    (tmp_path / "weights").mkdir()
    for name in ("composition", "shading"):
        (tmp_path / "weights" / f"{name}.safetensors").touch()
    assert said() == f"shading, composition, in {tmp_path}/weights"
