"""Text of strangers cannot steer the terminal, forge a line or stand beside our own line."""

import ast
import os
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import click
import pytest

from pbrnet.pipeline import cli
from pbrnet.pipeline.terminal import say, visible
from pbrnet.scenes.errors import InputError
from tests.fixtures.paths import ROOT

HOSTILE = {
    "a\nError: all is lost": r"a\nError: all is lost",
    "\x1b[2J\x1b]0;title\x07": r"\x1b[2J\x1b]0;title\x07",
    "a\rb\tc\x9bd": r"a\rb\tc\x9bd",
    "\u202egpj.exe": r"\u202egpj.exe",
    "a\u2028b\udcff": r"a\u2028b\udcff",
    "caf\u00e9 \u4e2d \U0001f600": "caf\u00e9 \u4e2d \U0001f600",
}


@pytest.mark.parametrize("text", HOSTILE)
def test_control_characters_are_shown_and_other_text_is_kept(text: str) -> None:
    assert visible(text) == HOSTILE[text]
    assert visible(visible(text)) == visible(text)


@pytest.mark.parametrize("text", list(HOSTILE)[:-1])
def test_a_line_stays_one(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    say(text, "own")
    say(text, err=True)
    shown = capsys.readouterr()
    assert shown.out == f"{HOSTILE[text]}\nown\n" and shown.err == f"{HOSTILE[text]}\n"


def run(monkeypatch: pytest.MonkeyPatch, command: Any) -> int:
    """The exit code of the command line if every command is `command`."""
    monkeypatch.setattr(cli.LazyGroup, "get_command", lambda *_: click.command()(command))
    with pytest.raises(SystemExit) as ended:
        cli.main(["inspect"])
    return int(str(ended.value.code))


def test_an_error_is_one_line_unless_it_has_several(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def command() -> None:
        raise InputError("a\n\x1b[31mb: damaged", "second")

    assert run(monkeypatch, command) == 3
    assert capsys.readouterr().err == "Error: a\\n\\x1b[31mb: damaged\nsecond\n"
    assert str(InputError("a", "b")) == "a\nb"


def test_warnings_of_libraries_do_not_stand_beside_the_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def command() -> None:
        warnings.warn("duplicate name", stacklevel=1)
        raise InputError("damaged")

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert run(monkeypatch, command) == 3
    assert capsys.readouterr().err == "Error: damaged\n"


def _prints(file: Path) -> list[str]:
    """Places of a module that print: `print(...)`, `click.echo(...)`, `sys.stderr.write(...)`."""
    return [
        f"{file.relative_to(ROOT)}:{node.lineno}"
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call)
        and ast.unparse(node.func)
        in ("print", "click.echo", "click.secho", "sys.stderr.write", "sys.stdout.write")
    ]


def test_one_place_prints() -> None:
    files = [file for part in ("pipeline", "model") for file in (ROOT / part).rglob("*.py")]
    allowed = ("pipeline/terminal.py", "pipeline/render/variants.py")  # a child process's answer
    places = [place for file in files for place in _prints(file)]
    assert not [place for place in places if not place.startswith(allowed)]


NOISY = """
import ctypes, os, sys, warnings
import click
from pbrnet.pipeline import cli
from pbrnet.scenes.errors import InputError

@click.command()
def command():
    os.write(1, b"native "); os.write(2, b"native "); ctypes.CDLL(None).printf(b"buffered ")
    warnings.warn("library")
    print("own")
    os.system("echo child")
    raise InputError("damaged")

cli.LazyGroup.get_command = lambda *_: command
cli.main(["inspect"])
"""


def test_what_libraries_write_natively_does_not_stand_beside_the_line() -> None:
    done = subprocess.run([sys.executable, "-c", NOISY], capture_output=True, text=True, cwd=ROOT)
    assert (done.returncode, done.stdout, done.stderr) == (3, "own\n", "Error: damaged\n")
    debugging = {**os.environ, "PBRNET_DEBUG": "1"}
    done = subprocess.run(
        [sys.executable, "-c", NOISY], capture_output=True, text=True, cwd=ROOT, env=debugging
    )
    assert "native " in done.stdout and "native " in done.stderr
