"""Planning of training studies: a study lists variants, a plan lists trials.

A trial is one training of one variant, for one seed and one set of training views. It has a folder
of its own below `metrics/studies/STUDY/`, where `trial.json` records the finished work and its
fingerprint. An interrupted study resumes: finished trials are kept, and the interrupted training
continues from its checkpoint with a bit-identical result.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from pbrnet.model.data.reader import Dataset
from pbrnet.model.settings import StageTrainParams, TrainParams
from pbrnet.model.training.train import Folders
from pbrnet.pipeline.params import Params
from pbrnet.scenes.checked import build, plain
from pbrnet.scenes.errors import ParameterError
from pbrnet.scenes.seeds import derive32, generator

T = TypeVar("T")
EPOCHS = 10  # at most; an epoch is a point of a learning curve
STAGES = ("shading", "composition")  # the two networks, in the order of training


@dataclass(frozen=True)
class Variant:
    """One of the trainings that a study compares."""

    name: str
    networks: tuple[str, ...]  # of `METHODS`, in the order of training
    methods: Mapping[str, str]  # evaluation method -> row label
    changes: Mapping[str, Any] = field(default_factory=dict)  # parameter path -> value
    group: str = ""  # only variants of one group are compared


@dataclass(frozen=True)
class TrialStudy:
    """Variants to compare, and how to show them."""

    name: str
    variants: tuple[Variant, ...]
    reference: str  # label that all others are compared with
    varies_views: bool = False  # by default 1/4, 1/2 and all training views
    crop: float = 1.0  # share of height and width that the picture shows
    regions: bool = False  # measure specular and matte pixels separately


@dataclass(frozen=True)
class TrialConfig:
    """Size of a study: number of seeds, steps and training views."""

    seeds: int = 1
    steps: int | None = None  # of each of the two networks; None: as in the parameters
    views: tuple[int, ...] = ()  # minimum sizes of the training set; empty: the study's default


@dataclass(frozen=True)
class TrainingSource:
    """Training split made for a study, written just before a trial needs it."""

    data: Path  # data folder; its `dataset` holds the split
    fingerprint: str  # of everything that determines the split
    make: Callable[[], None]  # does nothing if the split exists


@dataclass(frozen=True)
class Trial:
    """One training of one variant."""

    variant: Variant
    repeat: int
    params: Params  # with the variant's changes, its own seed and steps
    scenes: tuple[str, ...]  # training scenes
    views: int  # of these scenes
    requested_views: int | None = None  # minimum of views; None: all
    source: TrainingSource | None = None  # None: the dataset's training split
    start: Trial | None = None  # trial whose networks are fine-tuned; None: random weights

    @property
    def name(self) -> str:
        """Name of the trial and of its folder."""
        size = "" if self.requested_views is None else f"-{self.requested_views}"
        return f"{self.variant.name}{size}-{self.repeat}"

    @property
    def steps(self) -> dict[str, int]:
        """Training steps of every network."""
        stages: dict[str, StageTrainParams] = {
            name: getattr(self.params.train, name) for name in self.variant.networks
        }
        return {name: stage.epochs * stage.steps_per_epoch for name, stage in stages.items()}


def plan(study: TrialStudy, params: Params, folders: Folders, config: TrialConfig) -> list[Trial]:
    """Return all trials, repeat by repeat.

    Raises `ParameterError` for impossible sizes, `InputError` for an unreadable dataset.
    """
    dataset = Dataset(folders.data / "dataset", "train")
    counts = Counter(dataset.column("scene_id"))
    total = len(dataset)
    plans = dataset.plans()
    trials = []
    for repeat in range(config.seeds):
        seed = seed_of(params.seed, repeat)
        seen: set[tuple[str, ...]] = set()
        for requested in _sizes(study, config, total):
            scenes = subset(counts, plans, total if requested is None else requested, seed)
            if scenes in seen:  # two sizes need the same whole plans
                continue
            seen.add(scenes)
            views = sum(counts[scene] for scene in scenes)
            for variant in study.variants:
                own = changed(replace(params, seed=seed), variant.changes)
                train = scheduled(own.train, variant, config.steps, total)
                own = replace(own, train=train)
                trials.append(Trial(variant, repeat, own, scenes, views, requested))
    return trials


def seed_of(seed: int, repeat: int) -> int:
    """Return the seed of a repeat: the parameters' own for 0, derived from it for others."""
    return seed if repeat == 0 else derive32(seed, "study", "repeat", repeat)


def subset(
    counts: Mapping[str, int], plans: Mapping[str, str], minimum: int, seed: int
) -> tuple[str, ...]:
    """Return scenes of whole floor plans, taken in random order up to `minimum` views or more.

    A smaller subset of the same seed is contained in a larger one.
    """
    return draw_plans(counts, plans, minimum, generator(seed, "study", "subset"))


def draw_plans(
    counts: Mapping[str, int],
    plans: Mapping[str, str],
    wanted: int,
    rng: np.random.Generator,
    most: int | None = None,
) -> tuple[str, ...]:
    """Return the sorted scenes of floor plans drawn at random until they have `wanted` views.

    `counts`: scene -> number of views; `plans`: scene -> floor plan (a scene without one is its
    own plan); `most`: plans at most, all by default.
    """
    members: dict[str, list[str]] = {}
    for scene in sorted(counts):
        members.setdefault(plans.get(scene, scene), []).append(scene)
    names = sorted(members)
    chosen: list[str] = []
    for index in rng.permutation(len(names))[:most]:
        if sum(counts[scene] for scene in chosen) >= wanted:
            break
        chosen += members[names[index]]
    return tuple(sorted(chosen))


def _sizes(study: TrialStudy, config: TrialConfig, total: int) -> list[int | None]:
    if not study.varies_views and not config.views:
        return [None]
    sizes = config.views or (-(-total // 4), -(-total // 2), total)
    for size in sizes:
        if not 1 <= size <= total:
            raise ParameterError(
                f"--views: {size} is not allowed; the training split has {total} views"
            )
    return list(dict.fromkeys(sorted(sizes)))


def changed(params: T, changes: Mapping[str, Any]) -> T:
    """Return parameters with other values at these paths, such as `train.loss.kind`."""
    content = plain(params)
    for path, value in changes.items():
        *sections, name = path.split(".")
        inner = content
        for section in sections:
            inner = inner[section]
        inner[name] = value
    return build(type(params), content)


def scheduled(train: TrainParams, variant: Variant, steps: int | None, total: int) -> TrainParams:
    """Return the parameters with the steps of a trial, independent of its number of views.

    Each stage gets the steps of the parameters for `total` views, or `steps`; a network that
    replaces both stages gets as many as both together.
    """
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
    return replace(train, **changes)
