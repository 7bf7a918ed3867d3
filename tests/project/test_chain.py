"""The whole chain through DVC: what is redone, on one CPU, and after a kill."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
import yaml

from tests.fixtures.paths import ROOT

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

NETWORK = {"epochs": 1, "width": 4, "levels": 2}
CHANGES: dict[str, dict[str, Any]] = {
    "image": {"width": 64, "height": 48},
    "scenes": {"homes": 4, "rooms_max": 2, "texture_size": 64},
    "cameras": {"views_per_room": 1, "views_per_scene": 2, "candidates": 4},
    "illumination": {"width": 64},
    "groundtruth": {"spp": 4, "block_spp": 2, "max_depth": 4},
    "dataset": {"splits": {"validation": 0.25, "test": 0.25}, "checks": {"max_noise": 5.0}},
    "train": {"shading": NETWORK, "composition": NETWORK, "unet": NETWORK},
    "evaluate": {"timing_views": 1},
}


def _dvc(folder: Path, *words: str, before: tuple[str, ...] = ()) -> subprocess.Popen[str]:
    """A `dvc` command in a process group of its own."""
    tools = Path(sys.executable).parent
    return subprocess.Popen(
        [*before, str(tools / "dvc"), *words],
        cwd=folder,
        env={**os.environ, "PATH": f"{tools}{os.pathsep}{os.environ['PATH']}"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )


def _output(process: subprocess.Popen[str]) -> str:
    words = process.communicate(timeout=500)[0]
    assert process.returncode == 0, words
    return words


def _change(folder: Path, changes: dict[str, dict[str, Any]]) -> None:
    file = folder / "params.yaml"
    params = yaml.safe_load(file.read_text())
    for section, values in changes.items():
        for key, value in values.items():
            old = params[section][key]
            params[section][key] = {**old, **value} if isinstance(old, dict) else value
    file.write_text(yaml.safe_dump(params))


def _project(folder: Path) -> Path:
    """A copy of this project with parameters of its own, nothing made yet."""
    for package in ("scenes", "pipeline", "model"):
        ignore = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / package, folder / package, ignore=ignore)
    shutil.copy(ROOT / "dvc.yaml", folder)
    shutil.copy(ROOT / "params" / "quick.yaml", folder / "params.yaml")
    _change(folder, CHANGES)
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


def _would_run(folder: Path) -> list[str]:
    """Stages that are known to be out of date; those after them may follow."""
    return re.findall(r"Running stage '([\w@]+)'", _output(_dvc(folder, "repro", "--dry")))


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


def test_only_what_depends_on_a_change_is_redone(finished: Path) -> None:
    before = (finished / "params.yaml").read_text()
    assert _would_run(finished) == []
    try:
        _change(finished, {"train": {"composition": {"epochs": 2}}})
        assert _would_run(finished) == ["train_composition"]
        _change(finished, {"train": {"learning_rate": 1e-5}})
        assert _would_run(finished) == [
            "train_shading",
            "train_composition",
            "train_baselines@unet",
        ]
        (finished / "params.yaml").write_text(before)
        _change(finished, {"groundtruth": {"spp": 6}})
        assert _would_run(finished) == ["groundtruth", "dataset"]
    finally:
        (finished / "params.yaml").write_text(before)
    assert _would_run(finished) == []


def test_killed_repro_ends_with_the_same_dataset(finished: Path, tmp_path: Path) -> None:
    """And with all CPUs instead of one."""
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
