"""Generalisation to scenes of another source, before and after fine-tuning (Figures 14, 15).

The networks train on the dataset's training split without the source (`before`), then they are
fine-tuned on some views of the source (`tuned`). Both are tested on scenes of the source that
neither has seen. Networks trained on the tuning views only, for as many steps as both trainings
together (`alone`), show the benefit of the first training.

Floor plans of the source are divided at random into tuning and test scenes, whatever split of their
dataset they are in, because no network of this study has seen them. The division is the same in
every repeat.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import get_args

from pbrnet.model.data.reader import Dataset, Split
from pbrnet.model.studies.generalisation.results import LABELS
from pbrnet.model.studies.trials.derived_splits import write_derived_split
from pbrnet.model.studies.trials.plan import (
    STAGES,
    TrainingSource,
    Trial,
    TrialConfig,
    TrialStudy,
    Variant,
    scheduled,
    seed_of,
)
from pbrnet.model.training.train import Folders
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.splits import kept_back
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import digest_bytes
from pbrnet.scenes.seeds import generator

TUNING_VIEWS = 128
BEFORE, TUNED, ALONE = "before", "tuned", "alone"


@dataclass(frozen=True)
class OtherSource:
    """Another source of scenes: a data folder, and a pattern that selects its floor plans."""

    data: Path
    pattern: str  # floor plans or scenes, as in `dataset.splits.test_only`

    def parts(self) -> list[Dataset]:
        """Return the source's rows of each split, whole floor plans.

        Raises `InputError` if there are none.
        """
        folder = self.data / "dataset"
        if not list(folder.glob("*.parquet")):
            raise InputError(f"{folder}: no dataset shards here; make them with: pbrnet dataset")
        found = []
        for split in get_args(Split):
            if not list(folder.glob(f"{split}-*.parquet")):
                continue
            whole = Dataset(folder, split)
            chosen = self.scenes(set(whole.column("scene_id")), whole.plans())
            if chosen:
                found.append(Dataset(folder, split, only=chosen))
        if not found:
            raise InputError(
                f"{folder}: no floor plan or scene is called {self.pattern!r}; see its scenes.csv"
            )
        return found

    def scenes(self, scenes: Collection[str], plans: Mapping[str, str]) -> set[str]:
        """Return the scenes that belong to the source, with all scenes of the same floor plans."""
        known = {scene: plans.get(scene, scene) for scene in scenes}
        selected = kept_back((self.pattern,), known)
        return {scene for scene, plan in known.items() if plan in selected}


@dataclass(frozen=True)
class Division:
    """Tuning and test scenes of the source, and their numbers of views."""

    tuning: tuple[str, ...]
    testing: tuple[str, ...]
    tuning_views: int
    testing_views: int


@dataclass(frozen=True)
class PreparedStudy:
    """Trials of the study; the test split of `folders` holds the source's test scenes."""

    trials: list[Trial]
    folders: Folders
    notes: tuple[str, ...]


def generalisation_study() -> TrialStudy:
    """Return the study: before and after fine-tuning, and trained on the tuning views only.

    The product is measured, too, because it cannot represent specular reflection.
    """
    return TrialStudy(
        name="generalisation",
        variants=tuple(Variant(name, STAGES, _methods(name)) for name in (BEFORE, TUNED, ALONE)),
        reference=BEFORE,
        labels=LABELS,
        regions=True,
    )


def divide(
    views: Mapping[str, int], plans: Mapping[str, str], wanted: int, seed: int, where: str
) -> Division:
    """Divide floor plans at random: tuning plans up to `wanted` views, at most half of the plans.

    `views`: scene -> number of views. Raises `InputError` if there are fewer than two plans.
    """
    members: dict[str, list[str]] = {}
    for scene in sorted(views):
        members.setdefault(plans.get(scene, scene), []).append(scene)
    names = sorted(members)
    if len(names) < 2:
        raise InputError(
            f"{where}: one floor plan only, {names[0]!r}; fine-tuning and testing need at least two"
        )
    tuning: list[str] = []
    for index in generator(seed, "study", "division").permutation(len(names))[: len(names) // 2]:
        if sum(views[scene] for scene in tuning) >= wanted:
            break
        tuning += members[names[index]]
    testing = tuple(sorted(set(views) - set(tuning)))
    return Division(
        tuple(sorted(tuning)),
        testing,
        sum(views[scene] for scene in tuning),
        sum(views[scene] for scene in testing),
    )


def prepare(
    params: Params,
    folders: Folders,
    other: OtherSource,
    config: TrialConfig,
    tuning_views: int,
    tuning_steps: int | None,
    packs: Path,
) -> PreparedStudy:
    """Plan the trials and pack the test scenes below `packs`.

    Raises `InputError` if the source and the training scenes overlap.
    """
    home = Dataset(folders.data / "dataset", "train")
    home_plans = home.plans()
    same = other.data.resolve() == folders.data.resolve()
    own_views = _views([home])
    left_out = other.scenes(own_views, home_plans) if same else set()
    scenes = [scene for scene in own_views if scene not in left_out]
    parts = other.parts()
    plans = parts[0].plans()
    views = _views(parts)
    _refuse_overlap(scenes, home_plans, views, plans, folders.data, other.data)
    where = f"{other.data}/dataset"
    division = divide(views, plans, tuning_views, params.seed, where)
    trained = sum(own_views[scene] for scene in scenes)
    if not trained:
        raise InputError(f"{where}: every training scene is of the source {other.pattern!r}")

    fingerprint = digest_bytes(*(part.fingerprint().encode() for part in parts))
    tuning = _source(parts, division.tuning, "train", fingerprint, packs)
    testing = _source(parts, division.testing, "test", fingerprint, packs)
    testing.make()
    own = TrainingSource(folders.data, home.fingerprint(), lambda: None)
    params = replace(params, evaluate=replace(params.evaluate, split="test"))
    trials = []
    for repeat in range(config.seeds):
        seeded = replace(params, seed=seed_of(params, repeat))
        before, tuned, alone = generalisation_study().variants
        first = scheduled(seeded, before, config.steps, len(home))
        start = Trial(before, repeat, first, tuple(sorted(scenes)), trained, source=own)
        counts = _steps(first)
        more = {name: tuning_steps or max(1, count // 4) for name, count in counts.items()}
        all_steps = {name: counts[name] + more[name] for name in counts}
        given = (division.tuning, division.tuning_views)
        second, third = _with_steps(first, tuned, more), _with_steps(first, alone, all_steps)
        trials += [
            start,
            Trial(tuned, repeat, second, *given, source=tuning, start=start),
            Trial(alone, repeat, third, *given, source=tuning),
        ]
    notes = _notes(other, division, tuning_views, len({plans.get(name, name) for name in views}))
    return PreparedStudy(trials, replace(folders, data=testing.data), notes)


def _notes(other: OtherSource, division: Division, wanted: int, plans: int) -> tuple[str, ...]:
    source = (
        f"source: {other.pattern} in {other.data}, {plans} floor plans; tuned on "
        f"{division.tuning_views} views of {len(division.tuning)} scenes, tested on "
        f"{division.testing_views} views of {len(division.testing)} others"
    )
    if division.tuning_views >= wanted:
        return (source,)
    return (
        source,
        f"{wanted} tuning views were requested, but half of the floor plans are for testing",
    )


def _methods(name: str) -> dict[str, str]:
    methods = {"pbrnet": name, "product": f"{name}, product"}
    return methods | ({"ceiling": "ceiling"} if name == BEFORE else {})


def _views(parts: Sequence[Dataset]) -> dict[str, int]:
    """Return the number of views of every scene."""
    counts: dict[str, int] = {}
    for part in parts:
        for scene in part.column("scene_id"):
            counts[scene] = counts.get(scene, 0) + 1
    return counts


def _refuse_overlap(
    scenes: Sequence[str],
    home_plans: Mapping[str, str],
    views: Mapping[str, int],
    plans: Mapping[str, str],
    home: Path,
    other: Path,
) -> None:
    known = {home_plans.get(scene, scene) for scene in scenes} | set(scenes)
    for scene in sorted(views):
        if scene in known or plans.get(scene, scene) in known:
            raise InputError(
                f"{other}/dataset: the scene {scene!r} (plan {plans.get(scene, scene)!r}) has the "
                f"name of a training scene in {home}/dataset; a source must consist of other "
                "scenes. If it does, make it again with other names of scenes and plans"
            )


def _source(
    parts: Sequence[Dataset], scenes: Sequence[str], split: Split, fingerprint: str, packs: Path
) -> TrainingSource:
    """Return these scenes of the source as a split of their own."""
    own = digest_bytes(fingerprint.encode(), split.encode(), *(scene.encode() for scene in scenes))

    def selected() -> Iterator[Dataset]:
        for part in parts:
            yield Dataset(part.folder, part.split, only=set(scenes) & (part.only or set()))

    data = packs / split
    return TrainingSource(data, own, lambda: write_derived_split(data, own, selected, split))


def _with_steps(params: Params, variant: Variant, counts: Mapping[str, int]) -> Params:
    """Return the parameters with this number of steps for each network."""
    stages = {
        name: getattr(scheduled(params, variant, count, 1).train, name)
        for name, count in counts.items()
    }
    return replace(params, train=replace(params.train, **stages))


def _steps(params: Params) -> dict[str, int]:
    stages = {name: getattr(params.train, name) for name in STAGES}
    return {name: stage.epochs * stage.steps_per_epoch for name, stage in stages.items()}
