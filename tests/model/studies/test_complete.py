"""`pbrnet study all`: every part is a command that exists; what is up to date is kept."""

import json
from pathlib import Path

import click
import numpy as np
import pytest
from click.testing import CliRunner, Result
from PIL import Image

from pbrnet.model.studies import complete
from pbrnet.model.studies.complete import PARTS, Part
from pbrnet.pipeline.cli import cli
from pbrnet.pipeline.keys import table
from tests.fixtures.model import box_dataset

SIZE = {"width": 16, "height": 12, "panorama": 8}


@pytest.fixture(autouse=True)
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A dataset and two parts, of which one takes networks."""
    monkeypatch.chdir(tmp_path)
    Path("params.yaml").write_text("seed: 3\n")
    Path("models").mkdir()
    Path("models/plus.json").write_text("{}")
    box_dataset(Path("data"), 0, 0, 2, **SIZE)
    monkeypatch.setattr(complete, "flicker_parts", lambda params, data: [])
    folder = complete.STUDIES_FOLDER
    made = (
        Part("one", ("write", "1"), folder / "any.json", folder / "any.png"),
        Part("two", ("write", "2"), folder / "any.json", takes_models=False),
    )
    monkeypatch.setattr(complete, "PARTS", made)
    code = (
        "import sys, json, pathlib; from PIL import Image; n = sys.argv[2]; "
        "folder = pathlib.Path('metrics/studies'); folder.mkdir(parents=True, exist_ok=True); "
        "pathlib.Path('log').open('a').write(n); "
        "(folder / 'any.json').write_text(json.dumps({'n': n, 'words': sys.argv[3:]})); "
        "Image.new('RGB', (8, 6), (int(n), 0, 0)).save(folder / 'any.png'); "
        "sys.exit(pathlib.Path('fail' + n).exists())"
    )
    monkeypatch.setattr(complete, "_RUN", code)
    return tmp_path


def run(*words: str) -> Result:
    return CliRunner().invoke(cli, ["study", "all", *words], standalone_mode=False)


def runs() -> str:
    """The parts that have run, in order."""
    return Path("log").read_text() if Path("log").is_file() else ""


def test_every_part_is_a_command_with_its_options() -> None:
    for part in PARTS:
        group: click.Command = cli
        words = list(part.arguments)
        context = click.Context(cli)
        while isinstance(group, click.Group):
            found = group.get_command(context, words.pop(0))
            assert found is not None, part.name
            group = found
        group.make_context(part.name, words)
        assert part.result.suffix == ".json" and {*part.keys} <= table().keys()
    assert len({part.name for part in PARTS}) == len(PARTS)


def test_parts_are_made_once_and_again_when_something_changed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert run("--dry-run").output == "one: pbrnet write 1\ntwo: pbrnet write 2\n"
    assert not runs()
    assert run("--docs", "docs").return_value == 0
    assert runs() == "12"
    told = json.loads(Path("docs/data/one.json").read_text())
    assert told["n"] == "1", "kept under its own name before the next part wrote the same file"
    assert told["words"] == ["--data", "data", "--seed", "3", "--params", "params.yaml"]
    with Image.open("docs/images/study-one.jpg") as image:
        assert image.size == (8, 6) and np.asarray(image).max() <= 3
    assert not Path("docs/images/study-two.jpg").exists()
    assert run().output == "one: up to date\ntwo: up to date\n" and runs() == "12"
    for name in ("one", "two"):  # written by hand, or by the same command with other options
        part = next(each for each in complete.PARTS if each.name == name)
        complete._saved(part, ".json").write_text("{}")
    assert run().return_value == 0 and runs() == "1212"
    Path("log").write_text("12")
    Path("models/plus.json").write_text('{"another": 1}')
    assert run().return_value == 0 and runs() == "121", "only the first takes networks"
    Path("params.yaml").write_text("seed: 3\ntrain: {batch: 2}\n")
    assert run("--only", "two").return_value == 0 and runs() == "1212"
    monkeypatch.setattr(complete, "keys", lambda *names: dict.fromkeys(names, 99))
    assert run("--only", "two").return_value == 0 and runs() == "12122", "code of another key"


def test_a_part_that_fails_does_not_stop_the_others() -> None:
    Path("fail1").touch()
    done = run()
    assert done.return_value == 1 and "failed: one" in done.output and runs() == "12"
    Path("fail1").unlink()
    assert run().return_value == 0 and runs() == "121"
    wrong = run("--only", "three")
    assert "no part 'three' (there are: one, two)" in str(wrong.exception)
