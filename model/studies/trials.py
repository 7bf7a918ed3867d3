"""Trainings side by side: what every study that compares them has in common.

A study is a list of variants; planned for so many repeats and sizes of the training set it becomes
a list of trials. Every trial trains in a folder of its own below `metrics/studies/STUDY/`, where
`trial.json` says what has been done under which fingerprint. A study that was stopped goes on:
finished trials are kept, the one in the middle resumes from its checkpoint to the same bits.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from model.backbone import BackboneCard
from model.data import Dataset, subset_fingerprint
from model.evaluation import refuse_leaks
from model.metrics import find_lpips
from model.studies.trial_scores import Scored, load_painters, picture_views, score_views
from model.training import Folders, train_network
from pipeline.params import Params, StageTrainParams
from scenes.checked import build, plain
from scenes.errors import InputError, ParameterError
from scenes.files import digest_bytes, read_json, sweep, write_json
from scenes.seeds import derive32, generator

Say = Callable[[str], None]
EPOCHS = 10  # at most: points of a learning curve
PICTURED = 4  # views on the sheet


@dataclass(frozen=True)
class Variant:
    """One of the things that a study compares."""

    name: str
    networks: tuple[str, ...]  # of the registry, in the order of training
    methods: Mapping[str, str]  # method of the evaluation -> label in the results
    changes: Mapping[str, Any] = field(default_factory=dict)  # parameters: path -> value
    group: str = ""  # variants with another truth are not compared with one another


@dataclass(frozen=True)
class Study:
    """What is compared, and with what."""

    name: str
    variants: tuple[Variant, ...]
    reference: str  # label
    sized: bool = False  # whether the number of training views varies
    crop: float = 1.0  # share of height and width that the sheet of pictures shows


@dataclass(frozen=True)
class Wish:
    """How much of it."""

    seeds: int = 1
    steps: int | None = None  # of each of the two networks; None: the parameters'
    views: tuple[int, ...] = ()  # training-set sizes of a sized study; empty: 1/4, 1/2, all


@dataclass(frozen=True)
class Trial:
    """One training of one variant; everything that determines its weights but the pixels."""

    variant: Variant
    repeat: int
    params: Params  # with the variant's changes, its own seed and steps
    scenes: tuple[str, ...]  # of the training split, that it learns from
    views: int  # that those have
    wanted: int | None  # of a sized study; None: all

    @property
    def name(self) -> str:
        """Also its folder's."""
        size = "" if self.wanted is None else f"-{self.wanted}"
        return f"{self.variant.name}{size}-{self.repeat}"

    @property
    def steps(self) -> dict[str, int]:
        """Of every network it trains."""
        stages: dict[str, StageTrainParams] = {
            name: getattr(self.params.train, name) for name in self.variant.networks
        }
        return {name: stage.epochs * stage.steps_per_epoch for name, stage in stages.items()}


@dataclass
class Record:
    """`trial.json`: how far a trial has come."""

    fingerprint: str  # of all that determines the weights
    trained: tuple[str, ...] = ()  # networks that are finished
    measured: str = ""  # fingerprint of all that determines the scores
    scores: tuple[Scored, ...] = ()


def plan(study: Study, params: Params, folders: Folders, wish: Wish) -> list[Trial]:
    """All trials, a repeat after the other.

    Raises `ParameterError` for impossible sizes, `InputError` for an unreadable dataset.
    """
    dataset = Dataset(folders.data / "dataset", "train")
    counts: dict[str, int] = {}
    for scene in dataset.column("scene_id"):
        counts[scene] = counts.get(scene, 0) + 1
    total = len(dataset)
    plans = dataset.plans()
    trials = []
    for repeat in range(wish.seeds):
        seed = params.seed if repeat == 0 else derive32(params.seed, "study", "repeat", repeat)
        seen: set[tuple[str, ...]] = set()
        for wanted in _sizes(study, wish, total):
            scenes = subset(counts, plans, total if wanted is None else wanted, seed)
            if scenes in seen:  # too few plans to tell two sizes apart
                continue
            seen.add(scenes)
            views = sum(counts[scene] for scene in scenes)
            for variant in study.variants:
                own = _changed(replace(params, seed=seed), variant.changes)
                own = _scheduled(own, variant, wish.steps, total)
                trials.append(Trial(variant, repeat, own, scenes, views, wanted))
    return trials


def subset(
    counts: Mapping[str, int], plans: Mapping[str, str], wanted: int, seed: int
) -> tuple[str, ...]:
    """Scenes of whole floor plans, drawn by lot until they have at least `wanted` views.

    `counts`: scene -> its views; `plans`: scene -> floor plan (a scene without is its own).
    A smaller subset of the same seed lies within a larger one.
    """
    members: dict[str, list[str]] = {}
    for scene in sorted(counts):
        members.setdefault(plans.get(scene, scene), []).append(scene)
    names = sorted(members)
    chosen: list[str] = []
    for index in generator(seed, "study", "subset").permutation(len(names)):
        if sum(counts[scene] for scene in chosen) >= wanted:
            break
        chosen += members[names[index]]
    return tuple(sorted(chosen))


def run(study: Study, trials: Sequence[Trial], folders: Folders, say: Say) -> list[Record]:
    """Train and measure every trial that is not done; their records in the same order.

    Raises as `train_network` does; what was finished until then is kept.
    """
    sweep(folders.metrics / "studies")
    fingerprints = _Fingerprints(folders, trials[0].params.evaluate.split)
    records = []
    for number, trial in enumerate(trials, start=1):
        place = folder_of(study, trial, folders)
        record = fingerprints.kept(trial, place) or Record(fingerprints.training(trial))
        heading = f"study {study.name}: trial {number} of {len(trials)}, {trial.name}"
        if record.measured == fingerprints.scoring(trial):
            say(f"{heading}: kept")
        else:
            say(f"{heading}: {trial.views} views, {sum(trial.steps.values())} steps")
            _train(trial, record, place, folders)
            _measure(study, trial, record, place, folders)
            record.measured = fingerprints.scoring(trial)
            write_json(place / "trial.json", plain(record))
        records.append(record)
    return records


def states(study: Study, trials: Sequence[Trial], folders: Folders) -> list[str]:
    """Of every trial what is left to do: `train`, `go on`, `measure`, or `kept`."""
    fingerprints = _Fingerprints(folders, trials[0].params.evaluate.split)
    words = []
    for trial in trials:
        place = folder_of(study, trial, folders)
        record = fingerprints.kept(trial, place)
        if record is None:
            words.append("train")
        elif record.measured == fingerprints.scoring(trial):
            words.append("kept")
        else:
            done = set(record.trained) == set(trial.variant.networks)
            words.append("measure" if done else "go on")
    return words


def expected_seconds(trial: Trial, study: Study, folders: Folders) -> float | None:
    """Of training, by the pace of finished trainings: of this study, else of the project's own.

    None if a network's pace is not known. An end-to-end step counts as one of each network.
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


def folder_of(study: Study, trial: Trial, folders: Folders) -> Path:
    """Where a trial's models, curves, pictures and record lie."""
    return folders.metrics / "studies" / study.name / trial.name


class _Fingerprints:
    """What tells whether a trial's work still holds; reads every shard once."""

    def __init__(self, folders: Folders, split: Any) -> None:
        dataset = folders.data / "dataset"
        self.train = Dataset(dataset, "train").fingerprint()
        self.split = f"{split} {Dataset(dataset, split).fingerprint()}"
        card = folders.backbone / "backbone.json"
        self.backbone = build(BackboneCard, read_json(card), str(card), InputError).sha256
        self.lpips = find_lpips() is not None

    def training(self, trial: Trial) -> str:
        """Of all that determines the weights."""
        params = trial.params
        unused = {"checkpoint_steps", "device", "baselines"}
        shared = {
            name: value
            for name, value in plain(params.train).items()
            if name not in unused and not _is_stage(params, name)
        }
        stages = {name: plain(getattr(params.train, name)) for name in trial.variant.networks}
        parts = (params.seed, shared, stages, plain(params.tone), params.shading.albedo)
        subset = subset_fingerprint(self.train, trial.scenes)
        return digest_bytes(*(repr(part).encode() for part in (parts, subset, self.backbone)))

    def scoring(self, trial: Trial) -> str:
        """Of what it is measured on, and how."""
        parts = (self.training(trial), self.split, sorted(trial.variant.methods), self.lpips)
        return digest_bytes(*(repr(part).encode() for part in parts))

    def kept(self, trial: Trial, place: Path) -> Record | None:
        """What is done of a trial and still holds; None for nothing.

        Raises `InputError` for a record that cannot be read: hours may hang on it.
        """
        path = place / "trial.json"
        if not path.is_file():
            return None
        try:
            record = build(Record, read_json(path), str(path), InputError)
        except InputError as error:
            raise InputError(f"{error}; delete {place} to train this trial again") from None
        return record if record.fingerprint == self.training(trial) else None


def _train(trial: Trial, record: Record, place: Path, folders: Folders) -> None:
    """Train what is not yet trained, in order; a stranger's leavings go first."""
    left = place / "trial.json"
    if left.is_file() and read_json(left).get("fingerprint") != record.fingerprint:
        shutil.rmtree(place)
    write_json(left, plain(record))
    inner = Folders(folders.data, place, place, place, folders.backbone)
    for name in trial.variant.networks:
        finished = name in record.trained and (place / f"{name}.safetensors").is_file()
        if finished:
            continue
        train_network(name, trial.params, inner, only=trial.scenes)
        record.trained = (*(one for one in record.trained if one != name), name)
        write_json(left, plain(record))


def _measure(study: Study, trial: Trial, record: Record, place: Path, folders: Folders) -> None:
    """Score the variant's methods on the split, and draw a few views."""
    dataset = Dataset(folders.data / "dataset", trial.params.evaluate.split)
    painters, cards = load_painters(trial.variant.methods, place)
    refuse_leaks(dataset, cards)
    wanted = picture_views(dataset, PICTURED)
    exposure = trial.params.train.exposure
    label = f"study {study.name}: measure {trial.name}"
    record.scores = tuple(score_views(dataset, painters, exposure, place / "views", wanted, label))


def _sizes(study: Study, wish: Wish, total: int) -> list[int | None]:
    if not study.sized:
        return [None]
    sizes = wish.views or (-(-total // 4), -(-total // 2), total)
    for size in sizes:
        if not 1 <= size <= total:
            raise ParameterError(
                f"--views: {size} is not allowed; the training split has {total} views"
            )
    return list(dict.fromkeys(sorted(sizes)))


def _changed(params: Params, changes: Mapping[str, Any]) -> Params:
    content = plain(params)
    for path, value in changes.items():
        *sections, name = path.split(".")
        inner = content
        for section in sections:
            inner = inner[section]
        inner[name] = value
    return build(Params, content)


def _scheduled(params: Params, variant: Variant, steps: int | None, total: int) -> Params:
    """Steps that do not depend on how many views a trial has.

    Both stages as the parameters say, or `steps` each; a network that replaces both stages gets as
    many as both have together.
    """
    train = params.train
    per_pass = math.ceil(total / train.batch)
    both = {
        name: steps or stage.epochs * (stage.steps_per_epoch or per_pass)
        for name, stage in (("shading", train.shading), ("composition", train.composition))
    }
    changes = {}
    for name in variant.networks:
        count = both.get(name, sum(both.values()))
        epochs = max(number for number in range(1, EPOCHS + 1) if count % number == 0)
        stage = getattr(train, name)
        changes[name] = replace(stage, epochs=epochs, steps_per_epoch=count // epochs)
    return replace(params, train=replace(train, **changes))


def _is_stage(params: Params, name: str) -> bool:
    return isinstance(getattr(params.train, name), StageTrainParams)


def _pace(network: str, study: Study, folders: Folders) -> float | None:
    """Seconds a step, from the newest record that has them."""
    own = (folders.metrics / "studies" / study.name).glob(f"*/train_{network}.json")
    paths: Collection[Path] = [*sorted(own), folders.metrics / f"train_{network}.json"]
    for path in paths:
        if path.is_file():
            pace = read_json(path).get("seconds_per_step")
            if isinstance(pace, (int, float)):
                return float(pace)
    return None
