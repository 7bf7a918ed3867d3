"""The example scripts run as they are, without this package."""

from __future__ import annotations

import ast
import base64
import json
import os
import re
import runpy
import statistics
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from pipeline.dataset.checksums import verify_sums
from pipeline.dataset.columns import dataset_columns
from pipeline.dataset.pack import pack_dataset
from tests.fixtures.browser import open_browser
from tests.fixtures.dataset import make_data, small_params
from tests.fixtures.paths import ROOT

EXAMPLES = ROOT / "examples" / "consume"
TASKS = ROOT / "examples" / "tasks"
SAMPLE = ROOT / "examples" / "sample"
FOREIGN = pytest.mark.check  # libraries that this project does not install


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A packed dataset."""
    params = small_params(row_group=2)
    data = make_data(tmp_path_factory.mktemp("examples"), params)
    pack_dataset(data, params)
    return data / "dataset"


@pytest.mark.parametrize(
    ("script", "expected"),
    [
        ("with_pyarrow.py", ["(24, 32) (24, 32, 3) float16 float64"] * 6),
        ("with_datasets.py", ["home-0000 00"] * 3 + ["home-0001 00"] * 3),
        ("with_torch.py", ["shading (2, 24, 32, 3) color torch.float32"] * 3),
        pytest.param("with_polars.py", ["home-0002 (24, 32, 3) (3, 3)"] * 3, marks=FOREIGN),
        pytest.param("with_duckdb.py", ["home-0002 (24, 32, 3) (3, 3)"] * 3, marks=FOREIGN),
    ],
)
def test_the_script_reads_the_dataset(
    script: str, expected: list[str], folder: Path, tmp_path: Path
) -> None:
    pytest.importorskip(script.removeprefix("with_").removesuffix(".py"))
    source = (EXAMPLES / script).read_text()
    for package in ("pipeline", "scenes", "model"):
        assert f"import {package}" not in source and f"from {package}" not in source
    environment = {**os.environ, "HF_HUB_OFFLINE": "1", "HF_HOME": str(tmp_path / "cache")}
    ran = subprocess.run(
        [sys.executable, EXAMPLES / script, folder],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert ran.returncode == 0, ran.stderr
    lines = [line for line in ran.stdout.splitlines() if line.strip()]
    assert len(lines) == len(expected), "each row once, also with two workers"
    assert all(line.startswith(words) for line, words in zip(lines, expected, strict=True)), lines


@pytest.mark.check
def test_rows_a_second_of_every_reader_that_is_installed(folder: Path, tmp_path: Path) -> None:
    ran = subprocess.run(
        [sys.executable, EXAMPLES / "rows_a_second.py", folder],
        env={**os.environ, "HF_HUB_OFFLINE": "1", "HF_HOME": str(tmp_path / "cache")},
        capture_output=True,
        text=True,
    )
    assert ran.returncode == 0, ran.stderr
    head, *lines = ran.stdout.splitlines()
    assert head.startswith("12 rows, ") and "color" in head
    speeds = {line.split()[0]: line.split()[1] for line in lines}
    assert {"pyarrow", "pyarrow_threads", "datasets", "torch"} <= speeds.keys()
    assert all(int(speeds[name]) > 0 for name in ("pyarrow", "pyarrow_threads", "torch"))


def test_the_sample_is_a_small_dataset_of_all_splits() -> None:
    shards = sorted(SAMPLE.glob("*.parquet"))
    rows = {shard.name.partition("-")[0]: pq.read_metadata(shard).num_rows for shard in shards}
    assert min(rows.get(split, 0) for split in ("train", "validation", "test")) > 0
    assert sum(rows.values()) == 24
    assert sum(path.stat().st_size for path in SAMPLE.iterdir()) <= 20e6
    columns = {column.name for column in dataset_columns((96, 72), (64, 32), True, True, ("all",))}
    assert columns <= set(pq.read_schema(shards[0]).names), "make it again by its recipe"
    verify_sums(SAMPLE)


@pytest.fixture
def task(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Iterator[Callable[..., list[float]]]:
    """A function that runs a task on the sample and returns the numbers that it prints."""
    own = {path.stem for path in TASKS.glob("*.py")} & {"rows", "network"}
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(TASKS)

    def run(script: str, *arguments: object) -> list[float]:
        monkeypatch.setattr(sys, "argv", [script, str(SAMPLE), *map(str, arguments)])
        runpy.run_path(str(TASKS / script), run_name="__main__")
        return [float(number) for number in re.findall(r"\d+\.\d+", capsys.readouterr().out)]

    yield run
    for name in own:
        sys.modules.pop(name, None)


def test_the_tasks_import_nothing_of_this_project() -> None:
    for path in TASKS.glob("*.py"):
        tree = ast.parse(path.read_text())
        names = {
            name.partition(".")[0]
            for node in ast.walk(tree)
            for name in (
                [node.module or ""]
                if isinstance(node, ast.ImportFrom)
                else [alias.name for alias in node.names]
                if isinstance(node, ast.Import)
                else []
            )
        }
        assert not names & {"pipeline", "scenes", "model", "weights"}
        lines = (ast.get_docstring(tree) or "").splitlines()
        assert path.stem in ("rows", "network") or f"python {path.name} FOLDER" in lines[0]


@pytest.mark.slow
@pytest.mark.parametrize("script", ["depth.py", "intrinsic.py", "segmentation.py", "denoise.py"])
def test_a_network_learns_its_task(script: str, task: Callable[..., list[float]]) -> None:
    before, after, *_ = task(script, 40)
    assert after > before if script == "segmentation.py" else after < before


def test_all_lights_at_one_are_the_colour(task: Callable[..., list[float]], tmp_path: Path) -> None:
    (percent,) = task("relight.py")
    assert percent <= 0.1
    page = (tmp_path / "relight.html").read_text()
    assert "http" not in page, "needs no network"
    data = json.loads(page.partition("const data = ")[2].partition(";\n")[0])
    halves = np.frombuffer(base64.b64decode(data["lights"]), "<f2")
    assert halves.size == 3 * data["width"] * data["height"] * len(data["labels"])


def test_lights_are_switched_off_and_on_again_in_a_browser(
    task: Callable[..., list[float]], tmp_path: Path
) -> None:
    task("relight.py")
    sum_of_pixels = (
        "(() => { const c = document.querySelector('canvas'); return c.getContext('2d')"
        ".getImageData(0, 0, c.width, c.height).data.reduce((a, b) => a + b, 0); })()"
    )
    switch = (
        "document.querySelectorAll('input[type=range]').forEach((r, i) => { if (i) { r.value = 0;"
        " r.dispatchEvent(new Event('input', {bubbles: true})); } })"
    )
    with open_browser(tmp_path / "profile") as browser:
        browser.open(tmp_path / "relight.html")
        rendered = browser.script(sum_of_pixels)
        opaque = browser.script("255 * canvas.width * canvas.height")
        browser.script(switch)
        browser.until(f"{sum_of_pixels} === {opaque}")
        browser.script("document.querySelector('button').click()")
        browser.until(f"{sum_of_pixels} === {rendered}")
    assert rendered > 1.2 * opaque


def test_a_novel_view_has_the_colours_of_the_true_one(task: Callable[..., list[float]]) -> None:
    off = task("novel_view.py")
    moved, unmoved = off[::2], off[1::2]
    assert len(moved) > 8
    assert statistics.median(moved) < 0.4 * statistics.median(unmoved)
