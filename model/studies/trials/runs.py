"""Training and scoring of trials, with records that let an interrupted study resume.

`trial.json` of a trial records the finished work and its fingerprint. The fingerprint covers the
parameters that determine the weights, the seed, the bytes of the training split (for a split made
for the study: everything that determines them), the scenes, the backbone, the trial whose
networks are fine-tuned, and raised keys.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from pbrnet.model.data.reader import Dataset, subset_fingerprint
from pbrnet.model.evaluation.evaluate import Score, refuse_leaks
from pbrnet.model.evaluation.metrics import find_lpips
from pbrnet.model.methods import METHODS, columns_of
from pbrnet.model.networks.build import revision_of
from pbrnet.model.settings import StageTrainParams, TrainParams
from pbrnet.model.studies.files import exclusive
from pbrnet.model.studies.trials.plan import Trial, TrialStudy
from pbrnet.model.studies.trials.scores import (
    load_predictors,
    picture_views,
    score_views,
)
from pbrnet.model.training.backbone import BackboneCard
from pbrnet.model.training.store import ModelCard, load_model
from pbrnet.model.training.train import Folders, train_network
from pbrnet.pipeline.keys import raised
from pbrnet.scenes.checked import build, plain
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import atomic_file, digest_bytes, read_json, sweep, write_json

Log = Callable[[str], None]
SHEET_VIEWS = 4


@dataclass
class TrialRecord:
    """Contract of `trial.json`: the finished work of a trial."""

    fingerprint: str  # of everything that determines the weights
    trained: tuple[str, ...] = ()  # finished networks
    weights: dict[str, str] = field(default_factory=dict)  # network -> its own fingerprint
    measured: str = ""  # fingerprint of everything that determines the scores
    scores: tuple[Score, ...] = ()


def run(
    study: TrialStudy, trials: Sequence[Trial], folders: Folders, log: Log
) -> list[TrialRecord]:
    """Train and score every unfinished trial; return the records of all, in the same order.

    Processes that run a study at the same time share its trials: each takes those that no other one
    has taken, then waits for the rest. Raises as `train_network`; finished work is kept then.
    """
    sweep(folders.metrics / "studies")
    fingerprints = _Fingerprints(folders, trials[0].params.evaluate.split)
    records: dict[str, TrialRecord] = {}
    for wait in (False, True):
        for number, trial in enumerate(trials, start=1):
            name, start = trial.name, trial.start
            if name in records or (start is not None and start.name not in records):
                continue
            heading = f"study {study.name}: trial {number} of {len(trials)}, {name}"
            with exclusive(_lock_of(study, trial, folders), wait) as held:
                if held:
                    records[name] = _finished(study, trial, folders, fingerprints, heading, log)
                else:
                    log(f"{heading}: taken by another process")
    return [records[trial.name] for trial in trials]


def _lock_of(study: TrialStudy, trial: Trial, folders: Folders) -> Path:
    """Lock file of a trial; one for all trials whose training split is written before them."""
    name = f".{trial.name}.lock" if trial.source is None else ".lock"
    return folder_of(study, trial, folders).with_name(name)


def _finished(
    study: TrialStudy,
    trial: Trial,
    folders: Folders,
    fingerprints: _Fingerprints,
    heading: str,
    log: Log,
) -> TrialRecord:
    """Train and score a trial, unless its record is current; return the record."""
    folder = folder_of(study, trial, folders)
    record = fingerprints.kept(trial, folder) or TrialRecord(fingerprints.training(trial))
    if record.measured == fingerprints.scoring(trial):
        log(f"{heading}: kept")
        return record
    log(f"{heading}: {trial.views} views, {sum(trial.steps.values())} steps")
    _train(study, trial, record, folder, folders, fingerprints, log)
    _measure(study, trial, record, folder, folders)
    record.measured = fingerprints.scoring(trial)
    write_json(folder / "trial.json", plain(record))
    return record


def states(study: TrialStudy, trials: Sequence[Trial], folders: Folders) -> list[str]:
    """Return the state of every trial: `train`, `copy`, `resume`, `measure` or `kept`."""
    fingerprints = _Fingerprints(folders, trials[0].params.evaluate.split)
    found = []
    for trial in trials:
        folder = folder_of(study, trial, folders)
        record = fingerprints.kept(trial, folder)
        if record is None:
            last = trial.variant.networks[-1]
            twin = _twin(folders.metrics / "studies", last, fingerprints.training(trial, last))
            found.append("copy" if twin else "train")
        elif record.measured == fingerprints.scoring(trial):
            found.append("kept")
        else:
            done = set(record.trained) == set(trial.variant.networks)
            found.append("measure" if done else "resume")
    return found


def expected_seconds(trial: Trial, study: TrialStudy, folders: Folders) -> float | None:
    """Return the expected training time, by finished trainings of this study or of the project.

    None if there is none of a network's kind. An end-to-end step counts as a step of each network.
    """
    total = 0.0
    for name, steps in trial.steps.items():
        parts = ("shading", "composition") if name == "end_to_end" else (name,)
        paces = [_pace(part, study, folders) for part in parts]
        own = _pace(name, study, folders)
        if own is None and None in paces:
            return None
        total += steps * (own if own is not None else sum(pace or 0.0 for pace in paces))
    return total


def folder_of(study: TrialStudy, trial: Trial, folders: Folders) -> Path:
    """Return the folder of a trial's models, curves, pictures and record."""
    return folders.metrics / "studies" / study.name / trial.name


class _Fingerprints:
    """Fingerprints of trainings and scores; reads every shard once."""

    def __init__(self, folders: Folders, split: Any) -> None:
        self.dataset = folders.data / "dataset"
        self.split = f"{split} {Dataset(self.dataset, split).fingerprint()}"
        card = folders.backbone / "backbone.json"
        self.backbone = build(BackboneCard, read_json(card), str(card), InputError).sha256
        self.lpips = find_lpips() is not None

    @cached_property
    def train(self) -> str:
        """Fingerprint of the dataset's training split."""
        return Dataset(self.dataset, "train").fingerprint()

    def training(self, trial: Trial, last: str = "") -> str:
        """Fingerprint of everything that determines a trial's weights, up to the network `last`."""
        names = trial.variant.networks
        names = names[: names.index(last) + 1] if last else names
        params = trial.params
        unused = {"checkpoint_steps", "device", "baselines"}
        shared = {
            name: value
            for name, value in plain(params.train).items()
            if name not in unused and not _is_stage(params.train, name)
        }
        stages = {name: plain(getattr(params.train, name)) for name in names}
        # Networks of their first form have none: trials made before revisions counted stay valid.
        forms = {name: revision_of(METHODS[name].kind) for name in stages}
        revised = {name: number for name, number in forms.items() if number > 1} | raised("train")
        given = (params.seed, shared, stages, plain(params.tone), params.shading.albedo)
        parts = (*given, revised) if revised else given
        whole = self.train if trial.source is None else trial.source.fingerprint
        subset = subset_fingerprint(whole, trial.scenes)
        own = digest_bytes(*(repr(part).encode() for part in (parts, subset, self.backbone)))
        if trial.start is None:
            return own
        return digest_bytes(own.encode(), self.training(trial.start, last).encode())

    def scoring(self, trial: Trial) -> str:
        """Fingerprint of everything that determines a trial's scores."""
        newer = raised("evaluate", "studies.trials")
        given = (self.training(trial), self.split, sorted(trial.variant.methods), self.lpips)
        parts = (*given, newer) if newer else given
        return digest_bytes(*(repr(part).encode() for part in parts))

    def kept(self, trial: Trial, folder: Path) -> TrialRecord | None:
        """Return a trial's record if its fingerprint is current, else None.

        Raises `InputError` for an unreadable record, which may stand for hours of training.
        """
        path = folder / "trial.json"
        if not path.is_file():
            return None
        try:
            record = build(TrialRecord, read_json(path), str(path), InputError)
        except InputError as error:
            raise InputError(f"{error}; delete {folder} to train this trial again") from None
        return record if record.fingerprint == self.training(trial) else None


def _train(
    study: TrialStudy,
    trial: Trial,
    record: TrialRecord,
    folder: Path,
    folders: Folders,
    fingerprints: _Fingerprints,
    log: Log,
) -> None:
    """Train the missing networks in order; first delete a folder with another fingerprint.

    A network that another trial trained alike, of this study or another one, is copied.
    """
    record_file = folder / "trial.json"
    if record_file.is_file() and read_json(record_file).get("fingerprint") != record.fingerprint:
        shutil.rmtree(folder)
    write_json(record_file, plain(record))
    if trial.source is not None:
        trial.source.make()
    data = folders.data if trial.source is None else trial.source.data
    trial_folders = Folders(data, folder, folder, folder, folders.backbone)
    for name in trial.variant.networks:
        finished = name in record.trained and (folder / f"{name}.safetensors").is_file()
        if finished:
            continue
        start = None
        if trial.start is not None:
            start = folder_of(study, trial.start, folders) / f"{name}.safetensors"
            if not start.is_file():
                raise InputError(
                    f"{start}: no such model, but {trial.name} fine-tunes it; delete "
                    f"{start.parent} to train it again"
                )
        weights = fingerprints.training(trial, name)
        twin = _twin(folders.metrics / "studies", name, weights)
        if twin is None:
            train_network(name, trial.params, trial_folders, start, trial.scenes)
        else:
            log(f"{name}: as in {twin.parent.name}/{twin.name}")
            for file in _files_of(name):
                with atomic_file(folder / file) as partial:
                    shutil.copyfile(twin / file, partial)
        record.trained = (*(one for one in record.trained if one != name), name)
        record.weights = {**record.weights, name: weights}
        write_json(record_file, plain(record))


def _twin(studies: Path, network: str, weights: str) -> Path | None:
    """Return the folder of a trial that has this network with this fingerprint, if there is one."""
    for record in sorted(studies.glob("*/*/trial.json")):
        with suppress(InputError):
            alike = read_json(record).get("weights", {}).get(network) == weights
            if alike and all((record.parent / file).is_file() for file in _files_of(network)):
                return record.parent
    return None


def _files_of(network: str) -> tuple[str, ...]:
    """Names of the files of a trained network in a trial's folder."""
    curve = f"train_{network}"
    return f"{network}.safetensors", f"{network}.json", f"{curve}.csv", f"{curve}.json"


def _measure(
    study: TrialStudy, trial: Trial, record: TrialRecord, folder: Path, folders: Folders
) -> None:
    """Score the variant's methods on the evaluation split and draw a few views."""
    columns = columns_of(trial.variant.networks)
    dataset = Dataset(folders.data / "dataset", trial.params.evaluate.split, columns)
    exposure = trial.params.train.exposure
    predictors, cards = load_predictors(trial.variant.methods, folder)
    refuse_leaks(dataset, cards)
    earlier = trial.start
    while earlier is not None:
        refuse_leaks(dataset, _cards(earlier, folder_of(study, earlier, folders)))
        earlier = earlier.start
    wanted = picture_views(dataset, SHEET_VIEWS)
    label = f"study {study.name}: measure {trial.name}"
    albedo = trial.params.shading.albedo if study.regions else None
    record.scores = tuple(
        score_views(dataset, predictors, exposure, folder / "views", wanted, label, albedo)
    )


def _cards(trial: Trial, folder: Path) -> dict[str, ModelCard]:
    return {name: load_model(folder / f"{name}.safetensors")[1] for name in trial.variant.networks}


def _is_stage(params: TrainParams, name: str) -> bool:
    return isinstance(getattr(params, name), StageTrainParams)


def _pace(network: str, study: TrialStudy, folders: Folders) -> float | None:
    """Return seconds per step, of a trial of the study or of the project's own training."""
    own = (folders.metrics / "studies" / study.name).glob(f"*/train_{network}.json")
    paths: Collection[Path] = [*sorted(own), folders.metrics / f"train_{network}.json"]
    for path in paths:
        if path.is_file():
            pace = read_json(path).get("seconds_per_step")
            if isinstance(pace, (int, float)):
                return float(pace)
    return None
