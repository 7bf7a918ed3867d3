"""Stages in dvc.yaml depend on all the code that they run."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from pbrnet.model.studies.registry import STUDIES
from pbrnet.pipeline.imports import import_closure
from tests.fixtures.paths import ROOT

STAGES = yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"]
_TRAINING = ("model/training/train.py",)
# Imported by name, through the registry of the studies.
REPORT_SECTIONS = tuple(f"model/studies/{name}/results.py" for name in STUDIES)
ENTRIES: dict[str, tuple[str, ...]] = {
    "assets": ("pipeline/stages/assets.py",),
    "scenes": ("pipeline/stages/scene_jobs.py", "pipeline/stages/scene_work.py"),
    "cameras": ("pipeline/stages/camera_files.py", "pipeline/stages/shared_cameras.py"),
    "inputs": (
        "pipeline/passes/inputs.py",
        "pipeline/passes/labels.py",
        "pipeline/passes/materials.py",
        "pipeline/passes/video.py",
    ),
    "illumination": ("pipeline/passes/illumination.py", "pipeline/passes/visibility.py"),
    "groundtruth": (
        "pipeline/passes/groundtruth.py",
        "pipeline/passes/denoise.py",
        "pipeline/passes/light.py",
        "pipeline/passes/transport.py",
    ),
    "dataset": ("pipeline/dataset/pack.py",),
    "backbone": ("model/training/backbone.py",),
    "train_shading": _TRAINING,
    "train_composition": _TRAINING,
    "train_baselines": _TRAINING,
    "evaluate": ("model/evaluation/evaluate.py",),
    "report": ("model/report/page.py", *REPORT_SECTIONS),
}
# Modules that call the passes of all rendering stages: each of these stages depends on the modules
# themselves, and through its own entries on its own passes.
DISPATCHERS: dict[str, tuple[str, ...]] = {
    "cameras": ("pipeline/stages/render_jobs.py", "pipeline/stages/cameras.py"),
    **dict.fromkeys(
        ("inputs", "illumination", "groundtruth"),
        (
            "pipeline/passes/registry.py",
            "pipeline/stages/frame_stage.py",
            "pipeline/stages/render_jobs.py",
        ),
    ),
}
# Code that decides no byte of a stage's output, or only through parameters that the stage names
# (presets name every parameter, so that defaults decide nothing): parameters and their checks,
# errors, progress, the farm, limits of time and memory.
PLUMBING = (
    "pipeline/costs/memory.py",
    "pipeline/farm",
    "pipeline/limits.py",
    "pipeline/params.py",
    "pipeline/progress.py",
    "pipeline/records.py",
    "pipeline/versions.py",
    "scenes/arrays.py",  # types for annotations
    "scenes/errors.py",
    "scenes/formats/scene_xml.py",  # refuses, and changes nothing
    "scenes/import_options.py",
    "scenes/params.py",
)
# Code of other methods than the stage trains.
OTHER_METHODS = (
    "model/baselines",
    "model/networks/bands.py",
    "model/networks/hybrid.py",
    "model/networks/plus.py",
)
# Features are a dependency as files: models/backbone.safetensors.
FEATURES = ("model/training/backbone.py",)
# Formats of files and their checks: weights and scores do not depend on them, and training takes
# long.
FORMATS = (
    "model/training/weights.py",
    "pipeline/dataset/parquet.py",
    "scenes/checked.py",
    "scenes/files.py",
)
# The farm's jobs: pieces and homes are made by functions of other modules.
JOBS = ("pipeline/stages/render_jobs.py",)
LEFT_OUT = {
    "assets": JOBS,
    "scenes": JOBS,
    "backbone": FORMATS,
    "train_shading": OTHER_METHODS + FEATURES + FORMATS,
    "train_composition": OTHER_METHODS + FEATURES + FORMATS,
    "train_baselines": FEATURES + FORMATS,
    "evaluate": FEATURES + FORMATS,
    "report": FORMATS,
}


def reached(entries: tuple[str, ...], left_out: tuple[str, ...]) -> set[Path]:
    """Modules that the entries import, directly or indirectly, without packages' `__init__`."""
    code = ROOT / "pbrnet"
    closure = import_closure(
        [code / one for one in entries], ROOT, [code / one for one in left_out]
    )
    return {path.relative_to(code) for path in closure if path.name != "__init__.py"}


def test_every_stage_has_an_entry() -> None:
    assert set(ENTRIES) == set(STAGES)


@pytest.mark.parametrize("stage", ENTRIES)
def test_a_stage_depends_on_all_code_that_it_runs(stage: str) -> None:
    closure = reached(ENTRIES[stage], PLUMBING + LEFT_OUT.get(stage, ()))
    parts = {Path(one) for one in STAGES[stage]["deps"]}
    missing = {path for path in closure if not parts & {path, *path.parents}}
    assert not missing, f"not in dvc.yaml: {sorted(map(str, missing))}"
    assert closure > {Path(entry) for entry in ENTRIES[stage]}


@pytest.mark.parametrize("stage", DISPATCHERS)
def test_a_rendering_stage_depends_on_the_code_that_calls_its_passes(stage: str) -> None:
    assert set(DISPATCHERS[stage]) <= set(STAGES[stage]["deps"])


def test_the_code_that_stages_depend_on_is_there() -> None:
    code = [
        dep
        for one in STAGES.values()
        for dep in one["deps"]
        if dep.startswith(("scenes/", "pipeline/", "model/"))
    ]
    assert len(code) > 50
    assert [dep for dep in code if not (ROOT / dep).exists()] == []
