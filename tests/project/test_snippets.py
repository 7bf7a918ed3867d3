"""Snippets of the guides to the dataset run on the sample as they stand."""

import importlib
import io
import json
import re
from typing import Any

import click
import numpy as np
import pyarrow.parquet as pq
import pytest

from pbrnet.pipeline.cli import COMMANDS
from pbrnet.pipeline.dataset.parquet import image_type, images_of
from tests.fixtures.paths import ROOT

PAGES = ("tasks", "dataset", "use")
SAMPLE = ROOT / "examples" / "sample"


def snippets(language: str) -> list[Any]:
    """Snippets of a language on all pages."""
    return [
        pytest.param(code, id=f"{page}-{number}")
        for page in PAGES
        for number, code in enumerate(
            re.findall(
                rf"^```{language}\n(.*?)^```", (ROOT / f"docs/{page}.md").read_text(), re.M | re.S
            )
        )
    ]


@pytest.fixture(scope="module")
def names() -> dict[str, Any]:
    """Names that snippets take as given: a row of the sample that shows a chair, and one cell."""
    path = SAMPLE / "train-00000-of-00001.parquet"
    table = pq.read_table(path)
    texts = table.column("instances").to_pylist()
    number = next(k for k, text in enumerate(texts) if '"category_name":"chair"' in text)
    one = table.slice(number, 1)
    row = one.to_pylist()[0]
    cell = row["depth"]
    for field in table.schema:
        if b"dtype" in (field.metadata or {}):
            image_type(path, field)
            row[field.name] = images_of(path, one, field.name)[0]
    return {"np": np, "io": io, "json": json, "row": row, "view": row, "cell": cell, "epoch": 3}


@pytest.mark.parametrize("code", snippets("python"))
def test_python_runs_on_the_sample(
    code: str, names: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(ROOT / "reader")
    monkeypatch.chdir(ROOT)
    known = dict(names)
    exec(compile(code, "<snippet>", "exec"), known)
    made = [known[name] for name in known.keys() - names.keys() if name != "__builtins__"]
    images = [value for value in made if isinstance(value, np.ndarray) and value.ndim > 1]
    assert any(image.any() for image in images), "a picture or mask that is not empty"


def test_the_two_lines_restore_what_the_reader_reads(names: dict[str, Any]) -> None:
    known = dict(names)
    code = next(p.values[0] for p in snippets("python") if "np.load" in str(p.values[0]))
    exec(compile(str(code), "<snippet>", "exec"), known)
    assert np.array_equal(known["image"], names["row"]["depth"])


@pytest.mark.parametrize("code", snippets("sh"))
def test_commands_and_options_exist(code: str) -> None:
    for line in code.splitlines():
        words = line.split("#")[0].split()
        if words[:1] == ["python"]:
            assert (ROOT / words[1]).is_file() or words[1].startswith("-"), line
        if words[:1] != ["pbrnet"]:
            continue
        module, _, name = COMMANDS[words[1]][0].partition(":")
        command: click.Command = getattr(importlib.import_module(module), name)
        known = {option for parameter in command.params for option in parameter.opts}
        given = {word.partition("=")[0] for word in words[2:] if word.startswith("--")}
        if not isinstance(command, click.Group):
            assert given <= known, line
