"""The baselines as stages of DVC: a changed list trains what is new, and only that."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.fixtures.model import box_dataset
from tests.fixtures.paths import ROOT

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

STAGES = ("backbone", "train_shading", "train_composition", "train_baselines", "evaluate")
TINY = {"epochs": 1, "steps_per_epoch": 2, "width": 4, "levels": 3}


def dvc(folder: Path, *words: str) -> str:
    """A `dvc` command's output; the packages are this project's."""
    tools = Path(sys.executable).parent
    path = f"{tools}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        [str(tools / "dvc"), *words],
        cwd=folder,
        env={**os.environ, "PATH": path, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=500,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def ran(folder: Path, *words: str) -> list[str]:
    """The stages that `dvc repro` runs, or would run."""
    return re.findall(r"Running stage '([\w@]+)'", dvc(folder, "repro", *words))


def write_params(folder: Path, baselines: list[str], **train: Any) -> None:
    """Parameters of a tiny training of these baselines."""
    params = yaml.safe_load((ROOT / "params" / "quick.yaml").read_text())
    for name, value in params["train"].items():
        if isinstance(value, dict) and "epochs" in value:
            params["train"][name] = TINY
    params["train"] |= {"baselines": baselines, **train}
    params["evaluate"]["timing_views"] = 1
    (folder / "params.yaml").write_text(yaml.safe_dump(params))


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The stages from the backbone on, over a dataset that is simply there; all up to date."""
    folder = tmp_path_factory.mktemp("baselines")
    stages = yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"]
    chosen = {name: stages[name] for name in STAGES}
    (folder / "dvc.yaml").write_text(yaml.safe_dump({"stages": chosen}, sort_keys=False))
    for part in ("model", "pipeline", "scenes"):
        shutil.copytree(ROOT / part, folder / part, ignore=lambda *_: ["__pycache__"])
    box_dataset(folder / "data", 4, 2, 2, width=24, height=18, panorama=16)
    write_params(folder, ["unet"])
    dvc(folder, "init", "--no-scm", "--quiet")
    dvc(folder, "config", "core.analytics", "false")
    ran(folder)
    return folder


def test_a_longer_list_trains_only_what_is_new(project: Path) -> None:
    try:
        assert ran(project, "--dry") == []
        write_params(project, ["unet", "can"])
        assert ran(project, "train_baselines") == ["train_baselines@can"]
        assert ran(project) == ["evaluate"]
        figures = json.loads((project / "metrics" / "evaluation.json").read_text())
        assert {"pbrnet", "product", "product_linear", "unet", "can"} < figures["methods"].keys()
        assert ran(project, "--dry") == []
    finally:
        write_params(project, ["unet"])


def test_a_changed_section_trains_its_baseline_only(project: Path) -> None:
    try:
        write_params(project, ["unet"], unet={**TINY, "epochs": 2})
        assert ran(project, "--dry", "train_baselines") == ["train_baselines@unet"]
    finally:
        write_params(project, ["unet"])


def test_without_baselines_there_is_nothing_to_train(project: Path) -> None:
    try:
        write_params(project, [])
        assert "train_baselines" not in " ".join(ran(project, "--dry"))
    finally:
        write_params(project, ["unet"])
