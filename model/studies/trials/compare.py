"""Results of a study: figures of every label, pictures side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import mean

from model.data.reader import Dataset
from model.studies.trials.curve import promises
from model.studies.trials.plan import Study, Trial, Wish, plan
from model.studies.trials.results import TrialsResult, TrialsRow
from model.studies.trials.runs import PICTURED, Record, Say, folder_of, run
from model.studies.trials.scores import Scored, figures, picture_views, sheet
from model.training.train import Folders
from pipeline.params import Params
from scenes.checked import plain
from scenes.files import atomic_file, read_json, write_json

UNTRAINED = ("truth", "ceiling", "denoised")  # methods that no network has a part in


@dataclass(frozen=True)
class _Measured:
    """A label's trials within a group, one a repeat, and its method's scores in each."""

    label: str
    method: str
    group: str
    trials: list[Trial]
    scores: list[list[Scored]]


def compare(
    study: Study, params: Params, folders: Folders, wish: Wish, say: Say
) -> tuple[TrialsResult, Path]:
    """`plan`, then `compare_trials`."""
    return compare_trials(study, params, folders, plan(study, params, folders, wish), say)


def compare_trials(
    study: Study,
    params: Params,
    folders: Folders,
    trials: Sequence[Trial],
    say: Say,
    notes: Sequence[str] = (),
) -> tuple[TrialsResult, Path]:
    """Run the study; write `metrics/studies/NAME.json` and `.png`, and return the result.

    Raises as `plan` and `run` do; finished trials are kept then, and no result is written.
    """
    records = run(study, trials, folders, say)
    result = summarise(study, params, folders, trials, records, notes)
    target = folders.metrics / "studies" / f"{study.name}.json"
    picture = _sheet(study, folders, trials)
    with atomic_file(target.with_suffix(".png")) as partial:
        partial.write_bytes(picture)
    write_json(target, plain(result))
    return result, target


def summarise(
    study: Study,
    params: Params,
    folders: Folders,
    trials: Sequence[Trial],
    records: Sequence[Record],
    notes: Sequence[str] = (),
) -> TrialsResult:
    """Means and intervals of every label of every group; `notes` are sentences to be shown."""
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
                metrics=figures(one.scores, other, params.seed, study.name),
            )
        )
    views = {(row.scene_id, row.view_id) for row in measured[0].scores[0]}
    return TrialsResult(
        study=study.name,
        seed=params.seed,
        repeats=len({trial.repeat for trial in trials}),
        split=trials[0].params.evaluate.split,
        views=len(views),
        scenes=len({scene for scene, _ in views}),
        backbone=read_json(folders.backbone / "backbone.json")["network"],
        reference=study.reference,
        rows=tuple(rows),
        notes=(*notes, *(promises(rows) if study.sized else ())),
    )


def _gather(trials: Sequence[Trial], records: Sequence[Record]) -> list[_Measured]:
    """Scores by group and label, in the order of the trials; the truth once a group, last."""
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
    return trial.variant.group or ("" if trial.wanted is None else f"at least {trial.wanted} views")


def _steps(trial: Trial, method: str) -> int:
    """Of the networks that a picture by this method goes through."""
    if method.startswith("product"):
        return trial.steps["shading"]
    return sum(trial.steps.values())


def _sheet(study: Study, folders: Folders, trials: Sequence[Trial]) -> bytes:
    """The pictures of the first repeat, trained on most views: the truth, then every label."""
    split = trials[0].params.evaluate.split
    wanted = picture_views(Dataset(folders.data / "dataset", split), PICTURED)
    most = max(trial.wanted or 0 for trial in trials)
    columns: dict[str, tuple[Path, str]] = {}
    for trial in trials:
        if trial.repeat or (trial.wanted or 0) != most:
            continue
        folder = folder_of(study, trial, folders) / "views"
        policy = f" ({trial.variant.name})" if trial.variant.group else ""
        named: Mapping[str, str] = {"truth": "truth", **trial.variant.methods}
        for method, label in named.items():
            columns.setdefault(label + policy, (folder, method))
    return sheet(columns, wanted, study.crop)
