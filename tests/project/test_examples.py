"""The example scripts run as they are, without this package."""

import ast
import base64
import importlib
import itertools
import json
import os
import re
import runpy
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from pbrnet.pipeline.dataset.columns import dataset_columns
from pbrnet.pipeline.dataset.pack import pack_dataset
from pbrnet.pipeline.dataset.shards import verify_sums
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.passes.settings import NoisyParams
from tests.fixtures.browser import open_browser
from tests.fixtures.dataset import make_data, small_params
from tests.fixtures.paths import ROOT

EXAMPLES = ROOT / "examples" / "consume"
TASKS = ROOT / "examples" / "tasks"
SAMPLE = ROOT / "examples" / "sample"
HELPERS = ("pbrnet_reader", "network", "command")  # modules that tasks share
SCRIPTS = sorted(path.name for path in TASKS.glob("*.py") if path.stem not in HELPERS)
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
    assert not re.search(r"(import|from) pbrnet\b", source)
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
    assert sum(rows.values()) == 32
    assert sum(path.stat().st_size for path in SAMPLE.iterdir()) <= 25e6
    params = Params(channels=("all",), noisy=NoisyParams(1))
    columns = {column.name for column in dataset_columns(params)}
    assert columns <= set(pq.read_schema(shards[0]).names), "make it again by its recipe"
    verify_sums(SAMPLE)
    reader = (ROOT / "reader" / "pbrnet_reader.py").read_bytes()
    assert (SAMPLE / "pbrnet_reader.py").read_bytes() == reader, "pack it again"


@pytest.fixture
def task(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Iterator[Callable[..., list[float]]]:
    """A function that runs a task on the sample and returns the numbers that it prints."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(TASKS)

    def run(script: str, *arguments: object) -> list[float]:
        monkeypatch.setattr(sys, "argv", [script, str(SAMPLE), *map(str, arguments)])
        runpy.run_path(str(TASKS / script), run_name="__main__")
        return [float(number) for number in re.findall(r"\d+\.\d+", capsys.readouterr().out)]

    yield run
    for name in HELPERS:
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
        assert not names & {"pbrnet", "pipeline", "scenes", "model", "weights"}
        lines = (ast.get_docstring(tree) or "").splitlines()
        assert path.stem in HELPERS or f"python {path.name} FOLDER" in lines[0]


@pytest.mark.usefixtures("task")
@pytest.mark.parametrize("script", SCRIPTS)
def test_a_task_without_a_folder_says_how_to_call_it(
    script: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", [script])
    with pytest.raises(SystemExit, match="2"):
        runpy.run_path(str(TASKS / script), run_name="__main__")
    assert f"usage: {script} [-h] FOLDER" in capsys.readouterr().err


@pytest.mark.usefixtures("task")
def test_a_task_says_every_three_seconds_how_far_it_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    counted = importlib.import_module("command").counted
    monkeypatch.setattr(time, "monotonic", itertools.count(0, 2).__next__)
    assert list(counted("abc", "of 3 steps")) == list("abc")
    assert capsys.readouterr().err == "2 of 3 steps in 6 s\n"


@pytest.mark.slow
@pytest.mark.parametrize("script", ["depth.py", "intrinsic.py", "segmentation.py", "denoise.py"])
def test_a_network_learns_its_task(script: str, task: Callable[..., list[float]]) -> None:
    before, after, *_ = task(script, 80)
    assert after > before if script == "segmentation.py" else after < before


@pytest.mark.parametrize("page", ["index.md", "tasks.md"])
def test_the_first_example_shows_an_improvement_on_other_homes(page: str) -> None:
    """Depth needs more views than the sample has, as docs/tasks.md says."""
    first = re.search(r"examples/tasks/(\w+)\.py", (ROOT / "docs" / page).read_text())
    assert first and first[1] == "denoise"


def test_all_lights_at_one_are_the_colour(task: Callable[..., list[float]], tmp_path: Path) -> None:
    (percent,) = task("relight.py")
    assert percent <= 0.1
    page = (tmp_path / "relight.html").read_text()
    assert "http" not in page, "needs no network"
    data = json.loads(page.partition("const data = ")[2].partition(";\n")[0])
    halves = np.frombuffer(base64.b64decode(data["lights"]), "<f2")
    images = halves.astype(float).reshape(len(data["labels"]), -1)
    assert images.shape[1] == 3 * data["width"] * data["height"]
    assert images.sum(1).min() > 0.009 * images.sum(), "each light reaches the view"
    assert any("lamp" in label for label in data["labels"])


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
    assert len(moved) > 7
    assert statistics.median(moved) < 0.5 * statistics.median(unmoved)


@pytest.fixture
def identities(
    monkeypatch: pytest.MonkeyPatch,
) -> Iterator[tuple[Any, dict[str, Any], dict[str, Any]]]:
    """The task `identities`, a row of the sample with its tables, and the names of classes."""
    monkeypatch.syspath_prepend(TASKS)
    module = importlib.import_module("identities")
    row = next(module.read(SAMPLE, split="test"))
    row |= {name: json.loads(row[name]) for name in module.TABLES}
    yield module, row, json.loads((SAMPLE / "classes.json").read_text())
    for name in ("identities", *HELPERS):
        sys.modules.pop(name, None)


def test_the_sample_keeps_all_promises(
    identities: tuple[Any, dict[str, Any], dict[str, Any]], capsys: pytest.CaptureFixture[str]
) -> None:
    assert identities[0].main(SAMPLE) == 0
    assert capsys.readouterr().out.count("    32  ") > 20, "each is checked in each row"


def _more(name: str, factor: float) -> Callable[[dict[str, Any]], None]:
    return lambda row: row.update({name: row[name] * np.asarray(factor, row[name].dtype)})


def _one_more(name: str) -> Callable[[dict[str, Any]], None]:
    return lambda row: row[name].__setitem__((40, 50), row[name][40, 50] + 1)


def _set(table: str, name: str, value: Any) -> Callable[[dict[str, Any]], None]:
    return lambda row: row[table][0].update({name: value})


@pytest.mark.parametrize(
    ("change", "title"),
    [
        (_more("direct", 1.01), "direct + indirect"),
        (_more("specular", 0.9), "diffuse + specular"),
        (_more("irradiance", 1.01), "reflectance x irradiance"),
        (_more("lights", 1.01), "sum of lights"),
        (lambda row: row.update(radiance_scale=0.3), "log2 of radiance_scale"),
        (_more("color", 1e-6), "subnormal halves"),
        (lambda row: row.update(material_known=0 * row["valid"]), "values where there is none"),
        (_more("roughness", 1.1), "materials beyond"),
        (_one_more("nyu13"), "classes that disagree"),
        (_one_more("instance"), "pixel counts"),
        (_set("instances", "instance", 9999), "instances without an entry"),
        (_set("instances", "occlusion", 0.5), "pixel counts"),
        (_set("instances", "half_sizes", [0.1, 0.1, 0.1]), "points outside"),
        (_set("instances", "centre_camera", [0, 0, 1]), "boxes in camera axes"),
        (_more("depth", 1.5), "points outside"),
        (lambda row: row["normal"].__imul__(np.float16([-1, 1, 1])), "normal off that of depth"),
        (lambda row: row["layout"]["rooms"][0].update(ceiling_z=0.5), "camera outside its room"),
        (_set("light_sources", "centre", [9, 9, 9]), "lamps outside"),
        (_more("environment", 4), "panorama's light"),
        (_more("environment_depth", 1.2), "panorama's distances"),
    ],
)
def test_a_broken_promise_is_found(
    change: Callable[[dict[str, Any]], None],
    title: str,
    identities: tuple[Any, dict[str, Any], dict[str, Any]],
) -> None:
    module, row, classes = identities
    change(row)
    found = [name for name, error, limit in module.checks(row, None, classes) if not error <= limit]
    assert any(name.startswith(title) for name in found), found


def test_samples_without_a_denoiser_may_be_dark(
    identities: tuple[Any, dict[str, Any], dict[str, Any]],
) -> None:
    module, row, _ = identities
    dark = row | {"color": row["color"] * np.float16(1e-6), "denoiser": None}
    assert not [name for name, *_ in module.light(dark) if name.startswith("subnormal")]


def test_broken_flow_is_found(identities: tuple[Any, dict[str, Any], dict[str, Any]]) -> None:
    """A video of two frames from one camera: nothing moves, nothing is hidden or outside."""
    module, row, classes = identities
    masks = (f"{kind}_{way}" for kind in ("occluded", "outside") for way in ("forward", "backward"))
    still = {"trajectory": "walk", "frame": 1, **dict.fromkeys(masks, 0 * row["valid"])}
    still |= {"flow_forward": 0 * row["normal"][..., :2], "flow_backward": np.zeros((72, 96, 2))}

    def wrong(frame: dict[str, Any], before: dict[str, Any]) -> list[str]:
        checks = module.checks(frame, before | {"frame": 0}, classes)
        return [name for name, error, limit in checks if not error <= limit]

    frame = row | still
    assert wrong(frame, frame) == []
    moved = np.array(row["camera_to_world"])
    moved[:3, 3] += 0.1 * moved[:3, 0]
    found = wrong(frame, frame | {"camera_to_world": moved})
    assert {"flow_forward off, pixels", "outside_forward wrong, pixels"} <= set(found)
    assert wrong(frame | {"frame": 2}, frame | {"camera_to_world": moved}) == [], "no neighbours"
    (hidden,) = wrong(frame | {"occluded_backward": row["valid"]}, frame)
    assert hidden.startswith("visible points")
    assert wrong(frame | {"outside_backward": row["valid"]}, frame) == [
        "outside_backward wrong, pixels"
    ]
    far = frame | {"depth": 0.5 * row["depth"]}  # a surface between the camera and what it saw
    assert any(name.startswith("hidden points") for name in wrong(far, frame))
