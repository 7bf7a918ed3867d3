"""Execution of a training study and its results: scores of every label, and a sheet of pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import mean

from pbrnet.model.data.reader import Dataset
from pbrnet.model.evaluation.evaluate import Score
from pbrnet.model.studies.files import result_path, write_result
from pbrnet.model.studies.trials.learning_curve import extrapolations
from pbrnet.model.studies.trials.plan import Trial, TrialStudy
from pbrnet.model.studies.trials.results import TrialsResult, TrialsRow
from pbrnet.model.studies.trials.runs import SHEET_VIEWS, Log, TrialRecord, folder_of, run
from pbrnet.model.studies.trials.scores import figures, picture_views, sheet
from pbrnet.model.training.train import Folders
from pbrnet.scenes.files import read_json

UNTRAINED = ("truth", "ceiling", "denoised")  # methods without a network


@dataclass(frozen=True)
class _Measured:
    """Trials of a label within a group, one a repeat, and the scores of its method in each."""

    label: str
    method: str
    group: str
    trials: list[Trial]
    scores: list[list[Score]]


def run_and_summarise(
    study: TrialStudy,
    seed: int,
    folders: Folders,
    trials: Sequence[Trial],
    log: Log,
    notes: Sequence[str] = (),
) -> tuple[TrialsResult, Path]:
    """Run the trials, write `metrics/studies/NAME.json` and `.png`; return result and JSON path.

    `notes`: sentences for the result. Raises as `run`; finished trials are kept then, and no result
    is written.
    """
    records = run(study, trials, folders, log)
    result = summarise(study, seed, folders, trials, records, notes)
    target = result_path(folders.metrics, study.name)
    write_result(target, result, _sheet(study, folders, trials))
    return result, target


def summarise(
    study: TrialStudy,
    seed: int,
    folders: Folders,
    trials: Sequence[Trial],
    records: Sequence[TrialRecord],
    notes: Sequence[str] = (),
) -> TrialsResult:
    """Return means and intervals of every label in every group."""
    measured = _gather(trials, records)
    references = {one.group: one.scores for one in measured if one.label == study.reference}
    rows = []
    for one in measured:
        other = None if one.label in (study.reference, "truth") else references[one.group]
        trained = one.method not in UNTRAINED
        rows.append(
            TrialsRow(
                label=one.label,
                group=one.group,
                views=mean(trial.views for trial in one.trials) if trained else None,
                steps=_steps(one.trials[0], one.method) if trained else None,
                metrics=figures(one.scores, other, seed, study.name),
            )
        )
    views = {(row.scene_id, row.view_id) for row in measured[0].scores[0]}
    return TrialsResult(
        study=study.name,
        seed=seed,
        repeats=len({trial.repeat for trial in trials}),
        split=trials[0].params.evaluate.split,
        views=len(views),
        scenes=len({scene for scene, _ in views}),
        backbone=read_json(folders.backbone / "backbone.json")["network"],
        reference=study.reference,
        rows=tuple(rows),
        notes=(*notes, *(extrapolations(rows) if study.varies_views else ())),
    )


def _gather(trials: Sequence[Trial], records: Sequence[TrialRecord]) -> list[_Measured]:
    """Collect scores by group and label, in the order of the trials; `truth` last in a group."""
    found: dict[tuple[str, str], _Measured] = {}
    truths: dict[str, _Measured] = {}
    for trial, record in zip(trials, records, strict=True):
        group = _group(trial)
        for method, label in trial.variant.methods.items():
            one = found.setdefault((group, label), _Measured(label, method, group, [], []))
            one.trials.append(trial)
            one.scores.append([row for row in record.scores if row.method == method])
        own = [row for row in record.scores if row.method == "truth"]
        truths.setdefault(group, _Measured("truth", "truth", group, [trial], [own]))
    groups = dict.fromkeys(group for group, _ in found)
    return [
        one
        for group in groups
        for one in (*(m for (of, _), m in found.items() if of == group), truths[group])
    ]


def _group(trial: Trial) -> str:
    if trial.variant.group or trial.requested_views is None:
        return trial.variant.group
    return f"at least {trial.requested_views} views"


def _steps(trial: Trial, method: str) -> int:
    """Return the steps of all networks that a method uses."""
    if method.startswith("product"):
        return trial.steps["shading"]
    return sum(trial.steps.values())


def _sheet(study: TrialStudy, folders: Folders, trials: Sequence[Trial]) -> bytes:
    """Draw the first repeat, trained on most views: the truth, then every label."""
    split = trials[0].params.evaluate.split
    wanted = picture_views(Dataset(folders.data / "dataset", split), SHEET_VIEWS)
    most = max(trial.requested_views or 0 for trial in trials)
    columns: dict[str, tuple[Path, str]] = {}
    for trial in trials:
        if trial.repeat or (trial.requested_views or 0) != most:
            continue
        folder = folder_of(study, trial, folders) / "views"
        policy = f" ({trial.variant.name})" if trial.variant.group else ""
        named: Mapping[str, str] = {"truth": "truth", **trial.variant.methods}
        for method, label in named.items():
            columns.setdefault(label + policy, (folder, method))
    return sheet(columns, wanted, study.crop)
