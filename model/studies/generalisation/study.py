"""Networks before scenes of another source: as they are, and fine-tuned on a few views of it.

After the paper's Fig. 14 and 15. The networks train on the dataset's training split without the
source; then they go on from there on some views of it, and both are measured on scenes of the
source that neither has seen. Beside them stand networks that train on those few views alone, for
as many steps as the others had in all: what the first training was good for.

The source's scenes are divided by floor plan, by lot: some to be tuned on, the others to be tested
on, whatever split of their dataset they were in, as no network of this study has seen them. The
division is the same in every repeat.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import get_args

from model.data.reader import Dataset, Split
from model.studies.trials.packs import pack
from model.studies.trials.plan import (
    STAGES,
    Source,
    Study,
    Trial,
    Variant,
    Wish,
    scheduled,
    seed_of,
)
from model.training.train import Folders
from pipeline.dataset.held_out import kept_back
from pipeline.params import Params
from scenes.errors import InputError
from scenes.files import digest_bytes
from scenes.seeds import generator

TUNING_VIEWS = 128
BEFORE, TUNED, ALONE = "before", "tuned", "alone"


@dataclass(frozen=True)
class Other:
    """Another source: a data folder, and which of its plans count."""

    data: Path
    pattern: str  # of floor plans or scenes, as in `dataset.splits.test_only`

    def parts(self) -> list[Dataset]:
        """The source's rows, split by split: whole plans.

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
        """Those of these scenes that are of this source, with all others of their plans."""
        known = {scene: plans.get(scene, scene) for scene in scenes}
        meant = kept_back((self.pattern,), known)
        return {scene for scene, plan in known.items() if plan in meant}


@dataclass(frozen=True)
class Division:
    """The source's scenes, and the views that those have."""

    tuning: tuple[str, ...]
    testing: tuple[str, ...]
    tuning_views: int
    testing_views: int


@dataclass(frozen=True)
class Prepared:
    """What is to be run: `folders` has the scenes to be tested on as its test split."""

    trials: list[Trial]
    folders: Folders
    notes: tuple[str, ...]


def generalisation_study() -> Study:
    """Before and after tuning, and tuned on alone; products beside them, as they know no gloss."""
    return Study(
        name="generalisation",
        variants=tuple(Variant(name, STAGES, _methods(name)) for name in (BEFORE, TUNED, ALONE)),
        reference=BEFORE,
        regions=True,
    )


def divide(
    views: Mapping[str, int], plans: Mapping[str, str], wanted: int, seed: int, where: str
) -> Division:
    """Whole plans by lot until they have `wanted` views, but at most half of the plans, to tune on.

    `views`: scene -> its views. Raises `InputError` if there are fewer than two plans.
    """
    members: dict[str, list[str]] = {}
    for scene in sorted(views):
        members.setdefault(plans.get(scene, scene), []).append(scene)
    names = sorted(members)
    if len(names) < 2:
        raise InputError(
            f"{where}: one floor plan only, {names[0]!r}; two are needed, to tune on and to test on"
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
    other: Other,
    wish: Wish,
    tuning_views: int,
    tuning_steps: int | None,
    packs: Path,
) -> Prepared:
    """Plan the trials and pack the scenes to be tested on below `packs`.

    Raises `InputError` if the source and the training scenes are not apart.
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

    mark = digest_bytes(*(part.fingerprint().encode() for part in parts))
    tuning = _source(parts, division.tuning, "train", mark, packs)
    testing = _source(parts, division.testing, "test", mark, packs)
    testing.make()
    own = Source(folders.data, home.fingerprint(), lambda: None)
    params = replace(params, evaluate=replace(params.evaluate, split="test"))
    trials = []
    for repeat in range(wish.seeds):
        seeded = replace(params, seed=seed_of(params, repeat))
        before, tuned, alone = generalisation_study().variants
        first = scheduled(seeded, before, wish.steps, len(home))
        start = Trial(before, repeat, first, tuple(sorted(scenes)), trained, source=own)
        counts = _steps(first)
        more = {name: tuning_steps or max(1, count // 4) for name, count in counts.items()}
        whole = {name: counts[name] + more[name] for name in counts}
        given = (division.tuning, division.tuning_views)
        second, third = _timed(first, tuned, more), _timed(first, alone, whole)
        trials += [
            start,
            Trial(tuned, repeat, second, *given, source=tuning, start=start),
            Trial(alone, repeat, third, *given, source=tuning),
        ]
    notes = _notes(other, division, tuning_views, len({plans.get(name, name) for name in views}))
    return Prepared(trials, replace(folders, data=testing.data), notes)


def _notes(other: Other, division: Division, wanted: int, plans: int) -> tuple[str, ...]:
    source = (
        f"source: {other.pattern} in {other.data}, {plans} floor plans; tuned on "
        f"{division.tuning_views} views of {len(division.tuning)} scenes, tested on "
        f"{division.testing_views} views of {len(division.testing)} others"
    )
    if division.tuning_views >= wanted:
        return (source,)
    return source, f"{wanted} views to tune on were asked for, but half of the plans are tested on"


def _methods(name: str) -> dict[str, str]:
    methods = {"pbrnet": name, "product": f"{name}, product"}
    return methods | ({"ceiling": "ceiling"} if name == BEFORE else {})


def _views(parts: Sequence[Dataset]) -> dict[str, int]:
    """Scene -> its views."""
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
                f"name of one that is trained on in {home}/dataset; a source must be other scenes. "
                "If it is, give its plans other names when making it"
            )


def _source(
    parts: Sequence[Dataset], scenes: Sequence[str], split: Split, mark: str, packs: Path
) -> Source:
    """These scenes of the source as a split of their own."""
    own = digest_bytes(mark.encode(), split.encode(), *(scene.encode() for scene in scenes))

    def few() -> Iterator[Dataset]:
        for part in parts:
            yield Dataset(part.folder, part.split, only=set(scenes) & (part.only or set()))

    data = packs / split
    return Source(data, own, lambda: pack(data, own, few, split))


def _timed(params: Params, variant: Variant, counts: Mapping[str, int]) -> Params:
    """So many steps of each of the two networks."""
    stages = {
        name: getattr(scheduled(params, variant, count, 1).train, name)
        for name, count in counts.items()
    }
    return replace(params, train=replace(params.train, **stages))


def _steps(params: Params) -> dict[str, int]:
    stages = {name: getattr(params.train, name) for name in STAGES}
    return {name: stage.epochs * stage.steps_per_epoch for name, stage in stages.items()}
