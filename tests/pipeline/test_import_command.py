"""`pbrnet import` on a terminal: the help, the options of each kind of file, what is printed."""

from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner, Result

from pbrnet.pipeline.cli import cli
from pbrnet.pipeline.commands import import_scene
from pbrnet.scenes.errors import ParameterError
from pbrnet.scenes.registry import SOURCES
from tests.fixtures.rooms import Block, write_obj


def run(*arguments: object) -> Result:
    return CliRunner().invoke(cli, ["import", *map(str, arguments)])


def test_help_knows_every_kind_and_sorts_the_options() -> None:
    text = run("--help").output
    for suffix in SOURCES:
        assert suffix.removeprefix(".") in text.lower()
    shared, mitsuba, homes, every = (
        text.index(title)
        for title in (
            "Mitsuba, models, ",  # and whatever other sources have free axes
            "Mitsuba only:",
            "Sweet Home 3D only:",
            "All file types, but not scene folders:",
        )
    )
    assert shared < text.index("--scale") < text.index("--sky") < mitsuba
    assert mitsuba < text.index("--parameter") < homes < text.index("--level") < every
    assert every < text.index("--licence")


@pytest.mark.parametrize(
    "name, options",
    [
        ("a.glb", ["--time", "12:00"]),
        ("a.gltf", ["--parameter", "a=b"]),
        ("a.obj", ["--skip-missing"]),
        ("a.sh3d", ["--up", "z"]),
        ("a.xml", ["--level", "x"]),
    ],
)
def test_options_of_other_kinds_are_refused(tmp_path: Path, name: str, options: list[str]) -> None:
    path = tmp_path / name
    path.write_text("")
    ran = run(path, "--out", tmp_path / "out", *options)
    assert ran.exit_code != 0
    assert f"{options[0]}: not for {path.suffix} files" in f"{ran.output} {ran.exception}"
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("hint", "kind"), [(float, click.FLOAT), (float | None, click.FLOAT), (int, click.INT)]
)
def test_numbers_among_the_options_of_a_source_are_read_as_numbers(
    hint: Any, kind: click.ParamType
) -> None:
    assert import_scene._click_type(hint, None, False)["type"] is kind


@pytest.mark.parametrize("value", ["nan", "inf", "0", "-1"])
@pytest.mark.parametrize("name", ["a.obj", "a.xml", "a.pbrt"])
def test_a_scale_is_a_positive_number(tmp_path: Path, name: str, value: str) -> None:
    (tmp_path / name).write_text("v 0 0 0\n")
    done = run(tmp_path / name, "--out", tmp_path / "out", "--scale", value)
    assert "scale" in f"{done.output}{done.exception}"
    assert done.exit_code and not (tmp_path / "out").exists()
    assert isinstance(done.exception, SystemExit | ParameterError | click.ClickException)


def test_a_scene_without_a_room_warns_and_ends_with_exit_code_1(tmp_path: Path) -> None:
    posts = [Block(f"post{x}", (x, x, 0), (x + 0.2, x + 0.2, 2.5)) for x in (1, 7)]
    path = write_obj(tmp_path / "yard.obj", [Block("slab", (0, 0, -0.1), (9, 8, 0)), *posts])
    made = run(path, "--out", tmp_path / "yard", "--up", "z", "--scale", 1)
    assert made.exit_code == 1
    assert "Warning" in made.stderr and "NO ROOM WAS FOUND" in made.stderr
    assert (tmp_path / "yard" / "scene.json").is_file()
