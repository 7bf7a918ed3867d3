"""Trainings side by side: what every study that compares them has in common.

A study is a list of variants; planned for so many repeats and sizes of the training set it becomes
a list of trials. Every trial trains in a folder of its own below `metrics/studies/STUDY/`, where
`trial.json` says what has been done under which fingerprint. A study that was stopped goes on:
finished trials are kept, the one in the middle resumes from its checkpoint to the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from model.data.reader import Dataset
from model.training.train import Folders
from pipeline.params import Params, StageTrainParams
from scenes.checked import build, plain
from scenes.errors import ParameterError
from scenes.seeds import derive32, generator

EPOCHS = 10  # at most: points of a learning curve


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
    regions: bool = False  # whether specular regions are measured apart


@dataclass(frozen=True)
class Wish:
    """How much of it."""

    seeds: int = 1
    steps: int | None = None  # of each of the two networks; None: the parameters'
    views: tuple[int, ...] = ()  # training-set sizes; empty: all, in a sized study 1/4, 1/2, all


@dataclass(frozen=True)
class Source:
    """A training split that is made for a study, when a trial is about to learn from it."""

    data: Path  # folder whose `dataset` holds it once it is made
    mark: str  # of all that determines it
    make: Callable[[], None]  # does nothing if it is there


@dataclass(frozen=True)
class Trial:
    """One training of one variant; everything that determines its weights but the pixels."""

    variant: Variant
    repeat: int
    params: Params  # with the variant's changes, its own seed and steps
    scenes: tuple[str, ...]  # of the training split, that it learns from
    views: int  # that those have
    wanted: int | None = None  # views that were asked for; None: all
    source: Source | None = None  # of what it learns from; None: the dataset's training split
    start: Trial | None = None  # whose networks it goes on from; None: from random weights

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
        seed = seed_of(params, repeat)
        seen: set[tuple[str, ...]] = set()
        for wanted in _sizes(study, wish, total):
            scenes = subset(counts, plans, total if wanted is None else wanted, seed)
            if scenes in seen:  # too few plans to tell two sizes apart
                continue
            seen.add(scenes)
            views = sum(counts[scene] for scene in scenes)
            for variant in study.variants:
                own = changed(replace(params, seed=seed), variant.changes)
                own = scheduled(own, variant, wish.steps, total)
                trials.append(Trial(variant, repeat, own, scenes, views, wanted))
    return trials


def seed_of(params: Params, repeat: int) -> int:
    """The seed of a repeat: the parameters' own, then others derived from it."""
    return params.seed if repeat == 0 else derive32(params.seed, "study", "repeat", repeat)


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


def _sizes(study: Study, wish: Wish, total: int) -> list[int | None]:
    if not study.sized and not wish.views:
        return [None]
    sizes = wish.views or (-(-total // 4), -(-total // 2), total)
    for size in sizes:
        if not 1 <= size <= total:
            raise ParameterError(
                f"--views: {size} is not allowed; the training split has {total} views"
            )
    return list(dict.fromkeys(sorted(sizes)))


def changed(params: Params, changes: Mapping[str, Any]) -> Params:
    """The parameters with other values at these paths, such as `train.loss.kind`."""
    content = plain(params)
    for path, value in changes.items():
        *sections, name = path.split(".")
        inner = content
        for section in sections:
            inner = inner[section]
        inner[name] = value
    return build(Params, content)


def scheduled(params: Params, variant: Variant, steps: int | None, total: int) -> Params:
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


STAGES = ("shading", "composition")
