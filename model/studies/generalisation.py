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

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import get_args

import click

from pbrnet.model.data.reader import Dataset, Split
from pbrnet.model.settings import TrainParams
from pbrnet.model.studies.trials.command import TrialRequest, trial_command
from pbrnet.model.studies.trials.derived_splits import write_derived_split
from pbrnet.model.studies.trials.plan import (
    STAGES,
    TrainingSource,
    Trial,
    TrialStudy,
    Variant,
    draw_plans,
    scheduled,
    seed_of,
)
from pbrnet.model.training.train import Folders
from pbrnet.pipeline.commands.options import FOLDER
from pbrnet.pipeline.splits import kept_back
from pbrnet.pipeline.terminal import counted, views_of
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
        regions=True,
    )


def divide(
    views: Mapping[str, int], plans: Mapping[str, str], wanted: int, seed: int, where: str
) -> Division:
    """Divide floor plans at random: tuning plans up to `wanted` views, at most half of the plans.

    `views`: scene -> number of views. Raises `InputError` if there are fewer than two plans.
    """
    names = sorted({plans.get(scene, scene) for scene in views})
    if len(names) < 2:
        raise InputError(
            f"{where}: only one floor plan, {names[0]!r}; fine-tuning and testing require two"
        )
    rng = generator(seed, "study", "division")
    tuning = draw_plans(views, plans, wanted, rng, most=len(names) // 2)
    testing = tuple(sorted(set(views) - set(tuning)))
    return Division(
        tuning,
        testing,
        sum(views[scene] for scene in tuning),
        sum(views[scene] for scene in testing),
    )


def prepare(
    request: TrialRequest, other: OtherSource, tuning_views: int, tuning_steps: int | None
) -> PreparedStudy:
    """Plan the trials and pack the test scenes below DATA/studies/generalisation.

    Raises `InputError` if the source and the training scenes overlap.
    """
    folders, config = request.folders, request.config
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
    division = divide(views, plans, tuning_views, request.params.seed, where)
    trained = sum(own_views[scene] for scene in scenes)
    if not trained:
        raise InputError(f"{where}: every training scene belongs to the source {other.pattern!r}")

    fingerprint = digest_bytes(*(part.fingerprint().encode() for part in parts))
    packs = folders.data / "studies" / "generalisation"
    tuning = _source(parts, division.tuning, "train", fingerprint, packs)
    testing = _source(parts, division.testing, "test", fingerprint, packs)
    testing.make()
    own = TrainingSource(folders.data, home.fingerprint(), lambda: None)
    params = request.params
    params = replace(params, evaluate=replace(params.evaluate, split="test"))
    before, tuned, alone = generalisation_study().variants
    given = (division.tuning, division.tuning_views)
    trials = []
    for repeat in range(config.seeds):
        seeded = replace(params, seed=seed_of(params.seed, repeat))
        own_train = scheduled(seeded.train, before, config.steps, len(home))
        first = replace(seeded, train=own_train)
        start = Trial(before, repeat, first, tuple(sorted(scenes)), trained, source=own)
        more = {name: tuning_steps or max(1, count // 4) for name, count in start.steps.items()}
        all_steps = {name: start.steps[name] + more[name] for name in more}
        second, third = (
            replace(first, train=_with_steps(own_train, variant, counts))
            for variant, counts in ((tuned, more), (alone, all_steps))
        )
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
        f"{views_of(division.tuning_views, len(division.tuning))}, tested on "
        f"{counted(division.testing_views, 'view')} of {len(division.testing)} others"
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


def _views(parts: Sequence[Dataset]) -> Counter[str]:
    """Return the number of views of every scene."""
    return Counter(scene for part in parts for scene in part.column("scene_id"))


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


def _with_steps(train: TrainParams, variant: Variant, counts: Mapping[str, int]) -> TrainParams:
    """Return the parameters with this number of steps for each network."""
    stages = {
        name: getattr(scheduled(train, variant, count, 1), name) for name, count in counts.items()
    }
    return replace(train, **stages)


@trial_command(
    "generalisation",
    """
  pbrnet study generalisation --other better/data --dry-run
  pbrnet study generalisation --other better/data --views 128 --steps 4000
  pbrnet study generalisation --source 'villa-*' --seeds 3
""",
    click.option(
        "--other",
        type=FOLDER,
        help="Data folder of the other source.  [default: DATA, with --source]",
    ),
    click.option(
        "--source",
        "pattern",
        help="Floor plans or scenes of the source, such as 'villa-*'; not trained on.",
    ),
    click.option(
        "--views",
        "tuning_views",
        type=click.IntRange(1),
        default=TUNING_VIEWS,
        help="Views of the source to fine-tune on.",
    ),
    click.option(
        "--tuning-steps",
        type=click.IntRange(1),
        help="Fine-tuning steps of each network.  [default: a quarter of the training steps]",
    ),
    notes="Fine-tuning uses whole floor plans of the source, chosen at random, at most half of "
    "them; the others are the test set. The source's views are packed below "
    "DATA/studies/generalisation, also in a dry run.",
)
def command(
    request: TrialRequest,
    other: Path | None,
    pattern: str | None,
    tuning_views: int,
    tuning_steps: int | None,
) -> None:
    """Test on another source, then fine-tune on it (Figures 14, 15).

    Also measures specular and matte pixels separately.
    """
    data = request.folders.data
    if other is None and pattern is None:
        raise click.UsageError("name the other source: --other FOLDER, --source PATTERN, or both")
    if other is not None and pattern is None and other.resolve() == data.resolve():
        raise click.UsageError(f"--other {other} is DATA itself; select floor plans with --source")
    made = prepare(request, OtherSource(other or data, pattern or "*"), tuning_views, tuning_steps)
    elsewhere = replace(request, folders=made.folders)
    elsewhere.run(generalisation_study(), made.trials, notes=made.notes)
