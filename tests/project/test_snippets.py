"""Snippets of all pages: commands parse, parameters are read, Python and cheap commands run."""

import importlib
import io
import json
import random
import re
import shlex
import shutil
import tomllib
from collections.abc import Iterator
from itertools import dropwhile, groupby
from pathlib import Path
from typing import Any

import click
import numpy as np
import pyarrow.parquet as pq
import pytest

from pbrnet.model.studies.photographs.rows import read_rows
from pbrnet.pipeline.cli import cli
from pbrnet.pipeline.dataset.parquet import image_type, images_of
from pbrnet.pipeline.params import load_params
from pbrnet.scenes.own_assets.table import read_table
from tests.costs import seed
from tests.fixtures.buildings import one_room
from tests.fixtures.command import printed
from tests.fixtures.paths import ROOT
from tests.fixtures.report import make_ledger

NAMES = ("docs/*.md", "examples/**/README.md", "weights/README.md", "[A-Z]*.md")
PAGES = {path.relative_to(ROOT).as_posix(): path for name in NAMES for path in ROOT.glob(name)}
FENCE = re.compile(r"^( *)```(\S*)\n(.*?)^\1```", re.M | re.S)
SHELL = re.compile(r"^ {4}(?:[A-Z_]+=\S+ )?(?:pbrnet|pip|python) .*", re.M)
INLINE = re.compile(r"`pbrnet\s+([a-z][^`]*)`")
DATA = ("yaml", "json", "csv")
SAMPLE = ROOT / "examples" / "sample"
# Commands that take about a second or less in a project whose dataset is the sample, and snippets
# that take longer, of which each commit runs a quarter.
CHEAP = re.compile("init|preset|params|cost (?!.*--also)|export-data|release$|study all --dry-run")
COSTLY = re.compile("DataLoader|load_dataset|render_view|import examples/")


def chosen(snippet: str) -> bool:
    """Choice of a snippet: always, or, if it is costly, at every fourth commit."""
    return not COSTLY.search(snippet) or random.Random(seed() + snippet).random() < 0.25


def blocks(*languages: str) -> list[Any]:
    """Fenced blocks of these languages on all pages."""
    return [
        pytest.param(code, id=f"{page}-{number}")
        for page, path in PAGES.items()
        for number, (_, language, code) in enumerate(FENCE.findall(path.read_text()))
        if language in languages
    ]


def commands(page: Path) -> Iterator[list[str]]:
    """Words of the commands in the fenced and indented blocks of a page."""
    text = page.read_text().replace("\\\n", "")
    fenced = [code for _, language, code in FENCE.findall(text) if language in ("", "sh")]
    for line in "\n".join([*fenced, *SHELL.findall(FENCE.sub("", text))]).splitlines():
        for between, words in groupby(shlex.split(line, comments=True), "&&".__eq__):
            words = [*dropwhile(re.compile(r"[A-Z_]+=").match, words)]
            if words and not between:
                yield words


def parse(words: list[str], root: click.Command = cli) -> None:
    """Parse the arguments of a command as when it runs; raises `click.UsageError`."""
    command: click.Command | None = root
    while words and isinstance(command, click.Group):
        _, command, words = command.resolve_command(click.Context(command), words)
    assert command is not None
    command.make_context(command.name, [*words])


def check(program: str, *words: str) -> None:
    """Raise an error unless a program of the documents takes these words."""
    if program == "pbrnet":
        parse([*words])
    elif program == "dask":
        parse([*words[1:]], importlib.import_module(f"distributed.cli.dask_{words[0]}").main)
    elif program == "make":
        assert {*words} <= {*re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.M)}
    elif program == "python":
        name = words[1].replace(".", "/") + ".py" if words[0] == "-m" else words[0]
        assert (ROOT / name).is_file()
    elif program == "pip":
        extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
        named = re.findall(r"pbrnet\[(\w+)\]", " ".join(words))
        assert {*named} <= extras["optional-dependencies"].keys()
    else:
        assert program in ("cd", "dvc", "eval", "export"), "an unknown program"


@pytest.mark.parametrize("page", PAGES)
def test_commands_parse(page: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of blocks with their arguments; in running text, commands and options exist."""
    # Files that are named need not exist.
    monkeypatch.setattr(click.Path, "convert", lambda self, value, *_: Path(value))
    for words in commands(PAGES[page]):
        try:
            check(*words)
        except (AssertionError, click.UsageError) as error:
            pytest.fail(f"{shlex.join(words)}: {error}")
    running = FENCE.sub("", PAGES[page].read_text())
    for targets in re.findall(r"`make ([a-z ]+)", running):
        check("make", *targets.split())
    for code in INLINE.findall(running):
        try:
            parse(code.partition("--help")[0].split())
        except click.UsageError as error:  # most are placeholders, or parts of commands
            unknown = re.match("No such (option|command '[a-z])", error.message)
            assert not unknown, f"{code}: {error.message}"


def test_every_block_has_a_language_that_is_tested() -> None:
    tested = {"", "sh", "python", *DATA, "{commands}", "{eval-rst}", "{toctree}", "bibtex"}
    for page, path in PAGES.items():
        assert {language for _, language, _ in FENCE.findall(path.read_text())} <= tested, page


@pytest.mark.parametrize("code", blocks(*DATA))
def test_files_are_read(code: str, tmp_path: Path) -> None:
    """Parameters, rows of a study, own pieces; alternatives in one block begin with one key."""
    file = tmp_path / "file"
    key = re.match(r"\w+:", code)
    for part in re.split(f"^(?={key[0]})", code, flags=re.M)[1:] if key else [code]:
        file.write_text(part)
        if code.startswith("{"):
            assert json.loads(code)
        elif code.startswith("- "):
            assert read_rows(file)
        elif code.startswith("file,"):
            for line in code.splitlines()[1:]:
                model = tmp_path / line.split(",")[0]
                model.parent.mkdir(exist_ok=True)
                model.touch()
            assert not read_table(file).refused
        else:
            load_params(file)


@pytest.fixture(scope="module")
def names() -> dict[str, Any]:
    """Names that snippets take as given: a row of the sample that shows a chair, and one cell."""
    path = SAMPLE / "train-00000-of-00001.parquet"
    table = pq.read_table(path)
    texts = table.column("instances").to_pylist()
    number = next(k for k, text in enumerate(texts) if '"category_name":"chair"' in text)
    one = table.slice(number, 1)
    row = one.to_pylist()[0]
    known = {"np": np, "io": io, "json": json, "cell": row["depth"], "epoch": 3}
    known |= {"K": ((300, 0, 320), (0, 300, 240), (0, 0, 1)), "depth": np.ones((480, 640))}
    for field in table.schema:
        if b"dtype" in (field.metadata or {}):
            image_type(path, field)
            row[field.name] = images_of(path, one, field.name)[0]
    return known | {"row": row, "view": row}


@pytest.mark.parametrize("page", [page for page in PAGES if "```python" in PAGES[page].read_text()])
def test_python_runs_on_the_sample(
    page: str, names: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Snippet by snippet, as on the page; of the costly ones, a sample."""
    one_room().save(tmp_path).rename(tmp_path / "room.obj")
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.setenv("HF_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    monkeypatch.syspath_prepend(ROOT / "reader")
    monkeypatch.chdir(tmp_path)
    known = dict(names)
    for _, language, code in FENCE.findall(PAGES[page].read_text()):
        if language != "python" or not chosen(code):
            continue
        for words in (("room.glb", "room.obj"), ("FOLDER", str(SAMPLE))):
            code = code.replace(*words)
        try:
            exec(compile(code, f"<{page}>", "exec"), known := known | names)
        except ModuleNotFoundError as error:  # of a library that this project does not install
            assert error.name in ("duckdb", "polars")
    made = [known[name] for name in known.keys() - names.keys() if name != "__builtins__"]
    images = [
        value for value in made if isinstance(value, np.ndarray) and value.dtype.kind in "bfu"
    ]
    assert all(np.isfinite(image).all() and image.any() for image in images), "nothing in an image"
    if page == "docs/dataset.md":
        assert np.array_equal(known["image"], names["row"]["depth"])


def test_cheap_commands_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In one project, whose dataset is the sample."""
    for folder in (".dvc", "data", "my-data/.dvc"):
        (tmp_path / folder).mkdir(parents=True)
    for folder in ("examples", "params"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    shutil.copytree(SAMPLE, tmp_path / "data" / "dataset")
    make_ledger(tmp_path / "data", [(f"home-{number}", "room-0-s0") for number in range(8)])
    monkeypatch.chdir(tmp_path)
    printed("init")
    for program, *words in (words for page in PAGES.values() for words in commands(page)):
        line = shlex.join(words)
        if program == "pbrnet" and (CHEAP.match(line) or COSTLY.match(line)) and chosen(line):
            printed(*(word.replace("/mnt/big/", "") for word in words))
