"""The whole chain through DVC: on one CPU, after a change of parameters, after a kill."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from tests.fixtures.chain import SMALLEST, Changes, change_params
from tests.fixtures.paths import ROOT

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


def _dvc(folder: Path, *words: str, before: tuple[str, ...] = ()) -> subprocess.Popen[str]:
    """A `dvc` command in a process group of its own; its stages run this project's code."""
    tools = Path(sys.executable).parent
    path = f"{tools}{os.pathsep}{os.environ['PATH']}"
    return subprocess.Popen(
        [*before, str(tools / "dvc"), *words],
        cwd=folder,
        env={**os.environ, "PATH": path, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )


def _output(process: subprocess.Popen[str]) -> str:
    words = process.communicate(timeout=500)[0]
    assert process.returncode == 0, words
    return words


def _project(folder: Path) -> Path:
    """A copy of this project with parameters of its own, nothing made yet."""
    for package in ("scenes", "pipeline", "model"):
        ignore = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / package, folder / package, ignore=ignore)
    for name in ("dvc.yaml", "keys.yaml"):
        shutil.copy(ROOT / name, folder)
    shutil.copy(ROOT / "params.yaml", folder / "params.yaml")
    change_params(folder, SMALLEST)
    _output(_dvc(folder, "init", "--no-scm", "--quiet"))
    _output(_dvc(folder, "config", "core.analytics", "false"))
    return folder


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project after `dvc repro` on one CPU."""
    folder = _project(tmp_path_factory.mktemp("finished"))
    one = ("taskset", "-c", str(min(os.sched_getaffinity(0))))
    _output(_dvc(folder, "repro", before=one))
    return folder


def _runs(folder: Path, *words: str) -> list[str]:
    """Stages that `dvc repro` runs, or with `--dry` would run.

    A dry run lists the stages known to be out of date; those after them may follow.
    """
    return re.findall(r"Running stage '([\w@]+)'", _output(_dvc(folder, "repro", *words)))


@pytest.fixture
def changeable(finished: Path) -> Iterator[Path]:
    """The finished project; its parameters are restored after the test."""
    params = finished / "params.yaml"
    before = params.read_text()
    yield finished
    params.write_text(before)


def test_one_cpu_makes_everything(finished: Path) -> None:
    shards = sorted((finished / "data" / "dataset").glob("*.parquet"))
    assert {shard.name.split("-")[0] for shard in shards} == {"train", "validation", "test"}
    views = sum(pq.read_metadata(shard).num_rows for shard in shards)
    rejected = (finished / "data" / "dataset" / "rejected.csv").read_text().splitlines()
    cameras = (finished / "data" / "cameras").glob("*.json")
    sampled = sum(len(json.loads(path.read_text())["views"]) for path in cameras)
    assert views + len(rejected) - 1 == sampled >= 4
    figures = json.loads((finished / "metrics" / "evaluation.json").read_text())
    assert {"pbrnet", "product", "unet", "ceiling"} <= figures["methods"].keys()
    assert "data:image/" in (finished / "report" / "index.html").read_text()
    assert _runs(finished, "--dry") == []


@pytest.mark.parametrize(
    ("changes", "stages"),
    [
        pytest.param(
            {"train": {"composition": {"epochs": 2}}},
            ["train_composition"],
            id="epochs",
            marks=pytest.mark.check,
        ),
        pytest.param(
            {"train": {"learning_rate": 1e-5, "baselines": []}},
            ["train_shading", "train_composition", "evaluate"],
            id="learning rate, no baselines",
        ),
        pytest.param({"groundtruth": {"spp": 6}}, ["groundtruth", "dataset"], id="samples"),
        pytest.param(
            {"train": {"unet": {"epochs": 2}}},
            ["train_baselines@unet"],
            id="epochs of a baseline",
            marks=pytest.mark.check,
        ),
    ],
)
def test_only_stages_that_depend_on_a_change_run_again(
    changeable: Path, changes: Changes, stages: list[str]
) -> None:
    change_params(changeable, changes)
    assert _runs(changeable, "--dry") == stages


@pytest.mark.check
def test_a_longer_list_of_baselines_trains_only_the_new_one(changeable: Path) -> None:
    change_params(changeable, {"train": {"baselines": ["unet", "can"]}})
    assert _runs(changeable, "train_baselines") == ["train_baselines@can"]
    assert _runs(changeable, "evaluate") == ["evaluate"]
    figures = json.loads((changeable / "metrics" / "evaluation.json").read_text())
    assert {"pbrnet", "product", "product_linear", "unet", "can"} < figures["methods"].keys()
    assert _runs(changeable, "--dry") == ["report"]


@pytest.mark.check
def test_killed_repro_ends_with_the_same_dataset(finished: Path, tmp_path: Path) -> None:
    """The killed run used all CPUs, the finished one a single CPU."""
    folder = _project(tmp_path / "killed")
    victim = _dvc(folder, "repro", "dataset")
    deadline = time.monotonic() + 300
    while not list(folder.glob("data/shading/*/*.exr")):
        assert victim.poll() is None and time.monotonic() < deadline, victim.stdout
        time.sleep(0.02)
    os.killpg(victim.pid, signal.SIGKILL)
    victim.communicate()
    assert not (folder / "data" / "dataset").exists()
    _output(_dvc(folder, "repro", "dataset"))

    def files(root: Path) -> dict[str, bytes]:
        data = root / "data" / "dataset"
        return {path.name: path.read_bytes() for path in sorted(data.iterdir())}

    assert files(folder) == files(finished)
