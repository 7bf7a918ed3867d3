"""Stages name the code that they depend on: a module that is moved or added is not forgotten."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
STAGES = yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"]
# What a stage runs but need not run again for: no byte of what it makes depends on it, other than
# by parameters and files that it names; or it is of another method than the stage trains.
PLUMBING = {
    "groundtruth": ("frames", "params", "views"),
    "dataset": ("frames", "params", "progress", "records", "sums", "templating", "views"),
    "train_shading": ("backbone", "baselines", "hybrid", "plus", "store"),
    "train_composition": ("backbone", "baselines", "hybrid", "plus", "store"),
    "train_baselines": ("backbone", "store"),
}
ENTRY = dict.fromkeys(PLUMBING, "model/training/train.py") | {
    "groundtruth": "pipeline/passes/groundtruth.py",
    "dataset": "pipeline/dataset/pack.py",
}


def imported(path: Path) -> Iterator[Path]:
    """Modules of the project that a module imports, relative to the project."""
    for node in ast.walk(ast.parse((ROOT / path).read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            folder = Path(*node.module.split("."))
            for name in node.names:
                within = folder / f"{name.name}.py"
                yield within if (ROOT / within).is_file() else folder.with_suffix(".py")


def reached(entry: Path) -> set[Path]:
    """The modules of the entry's package that it imports, and those that they do, and so on."""
    found: set[Path] = set()
    waiting = [entry]
    while waiting:
        path = waiting.pop()
        if path not in found and (ROOT / path).is_file() and path.parts[0] == entry.parts[0]:
            found.add(path)
            waiting += imported(path)
    return found


@pytest.mark.parametrize("stage", PLUMBING)
def test_a_stage_depends_on_all_code_that_it_runs(stage: str) -> None:
    entry = Path(ENTRY[stage])
    parts = {Path(one) for one in STAGES[stage]["deps"]}
    for name in PLUMBING[stage]:
        parts |= {entry.parent / name, entry.parent / f"{name}.py"}
    missing = {path for path in reached(entry) if not parts & {path, *path.parents}}
    assert not missing, f"neither in dvc.yaml nor known to change nothing: {sorted(missing)}"
    assert len(reached(entry)) > 10


def test_the_code_that_stages_depend_on_is_there() -> None:
    code = [dep for one in STAGES.values() for dep in one["deps"] if dep.endswith(".py")]
    assert len(code) > 50
    assert [dep for dep in code if not (ROOT / dep).is_file()] == []
