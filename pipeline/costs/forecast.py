"""Forecast of a run's core-seconds from the ledger, and estimates for the farm's scheduling.

The cost of a stage is linear in three counts: scenes that a worker opens (with the compilation of
their kernels), views, and samples of those views (pixels for a stage that does not sample). The
coefficients are not negative (NNLS of Lawson and Hanson). The error of the forecast is measured by
cross-validation: random halves of the scenes predict the other halves.

Where there is no ledger yet, costs are those of a typical core, in `forecast.yaml`.

The farm orders its work by estimates of single views. No pixel depends on these figures.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import mean
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
from scipy.optimize import nnls

from pbrnet.pipeline.channels import SURFACES, TRACED
from pbrnet.pipeline.params import Params
from pbrnet.scenes.arrays import BoolArray, Float64Array
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import data_beside
from pbrnet.scenes.seeds import generator

SCENE_STAGES = ("scenes", "cameras")
# "truth" is all that one trace of paths makes of a view: shading, colour, light
VIEW_STAGES = (
    *SURFACES,
    *("illumination", "visibility", "truth", "noisy", "environment", "transport"),
)
TOGETHER = "together"
_SAME = 1.5  # ratio of sizes below which the cost per sample cannot be separated
_HALVES = 100  # draws of half of the scenes
_MIN_SCENES = 4  # for a cross-validation

Rows = list[dict[str, Any]]
Estimate = Callable[[str, str, str], float]  # stage, scene, view -> seconds


@dataclass(frozen=True)
class HeldOut:
    """Relative errors of the cross-validation; all nan with fewer than four scenes."""

    usual: float  # of the total, median over all draws
    worst: float  # of the total, 95th percentile over all draws
    scene: float  # of a single scene, median


@dataclass(frozen=True)
class StageCost:
    """Core-seconds of a stage per scene, per view, and per sample (or pixel) of a view."""

    stage: str
    scene: float
    view: float
    sample: float
    measured: int  # rows of the ledger that the fit used

    def total(self, scenes: int, views: int, samples: float) -> float:
        """Return core-seconds for these numbers of scenes, views and samples per view."""
        return scenes * self.scene + views * (self.view + samples * self.sample)


@dataclass(frozen=True)
class ViewSize:
    """Size of a view's work: pixels of its images, and samples per pixel by stage, else one."""

    image: int
    illumination: float
    environment: float
    spp: dict[str, float]

    def pixels(self, kind: str) -> float:
        """Return the pixels of a frame of this kind."""
        around = {"illumination": self.illumination, "environment": self.environment}
        return around.get(kind, self.image)

    def samples(self, stage: str) -> float:
        """Return the samples (or pixels) of a view in this stage."""
        return self.pixels(stage) * self.spp.get("truth" if stage in TRACED else stage, 1)


@dataclass(frozen=True)
class Measured:
    """Rows of a stage, (N,) each: index of the scene, 1 if first use, samples, core-seconds."""

    scene: npt.NDArray[np.intp]
    first: Float64Array
    samples: Float64Array
    seconds: Float64Array

    def part(self, of: BoolArray) -> Measured:
        """Return the rows of the scenes for which `of` is true."""
        chosen = of[self.scene]
        return Measured(
            self.scene[chosen], self.first[chosen], self.samples[chosen], self.seconds[chosen]
        )


def joined(ledgers: Sequence[pa.Table]) -> pa.Table:
    """Return several folders' ledgers as one; scenes of the same name stay apart."""
    apart = []
    for number, ledger in enumerate(ledgers):
        place = ledger.schema.get_field_index("scene_id")
        names = [f"{number}/{name}" for name in ledger["scene_id"].to_pylist()]
        column = pa.array(names, pa.string())
        apart.append(ledger.set_column(place, ledger.schema.field(place), column))
    return pa.concat_tables(apart)


def fit_costs(ledger: pa.Table) -> tuple[list[StageCost], dict[str, HeldOut]]:
    """Fit the cost of every stage in the ledger, in the order of the pipeline.

    Returns the costs and, by stage and for all `TOGETHER`, the errors of the cross-validation.
    Raises `InputError` if the ledger has no rows of the ground truth.
    """
    stages, scenes = _measured(ledger)
    if "truth" not in stages:
        raise InputError(
            "the ledger has no ground truth yet; the forecast needs the cost of a few views, "
            "render some first: pbrnet run"
        )
    return _costs(stages), _held_out(stages, scenes)


def costs_of(ledger: pa.Table) -> list[StageCost]:
    """Fit the cost of every stage in the ledger, whatever there is."""
    return _costs(_measured(ledger)[0])


def typical_costs() -> list[StageCost]:
    """Return the costs of every stage on a typical core, for runs without a ledger."""
    return [
        StageCost(stage, scene, view, sample, 0)
        for stage, (scene, view, sample) in data_beside(__file__).items()
    ]


def seconds_of(
    known: Iterable[StageCost], made: Iterable[tuple[str, str, str]], size: ViewSize
) -> float | None:
    """Return the core-seconds of files to make, each a stage, scene and view.

    None if the cost of one of their stages is not known.
    """
    costs = {cost.stage: cost for cost in known}
    by_stage: dict[str, set[tuple[str, str]]] = {}
    for stage, scene, view in made:
        by_stage.setdefault("truth" if stage in TRACED else stage, set()).add((scene, view))
    if not by_stage.keys() <= costs.keys():
        return None
    return sum(
        costs[stage].total(len({scene for scene, _ in views}), len(views), size.samples(stage))
        for stage, views in by_stage.items()
    )


def _costs(stages: Mapping[str, Measured]) -> list[StageCost]:
    return [
        StageCost(stage, *_fit(stage, rows), len(rows.seconds)) for stage, rows in stages.items()
    ]


def view_size(params: Params) -> ViewSize:
    """Return the size of a view's work; samples are the mean over the splits."""
    image, lights, around = params.image, params.illumination, params.environment
    truth, noisy, tested = params.groundtruth, params.noisy, params.dataset.splits.test
    drawn = float(noisy.spp)
    if noisy.train:  # see `split_sampling`
        numbers = np.arange(noisy.train[0], noisy.train[1] + 1)
        drawn = float(np.average(numbers, weights=np.log((numbers + 1) / numbers)))
    spp = {
        "truth": tested * truth.spp + (1 - tested) * (truth.train_spp or truth.spp),
        "noisy": tested * noisy.spp + (1 - tested) * drawn,
        "environment": around.spp,
    }
    return ViewSize(image.width * image.height, lights.width**2 / 2, around.width**2 / 2, spp)


def frame_bytes(ledger: pa.Table, size: ViewSize) -> dict[str, float]:
    """Return the bytes of a view's frame of each kind at this size.

    Files grow with their pixels: bytes per pixel are the mean of the ledger's frames.
    """
    sizes: dict[str, list[float]] = {}
    for row in ledger.select(["stage", "view_id", "width", "height", "bytes"]).to_pylist():
        pixels = (row["width"] or 0) * (row["height"] or 0)
        if row["view_id"] and pixels and row["bytes"]:
            sizes.setdefault(row["stage"], []).append(row["bytes"] / pixels)
    return {
        stage: float(np.mean(values)) * size.pixels(stage)
        for stage, values in sizes.items()
        if stage not in SCENE_STAGES
    }


def _measured(ledger: pa.Table) -> tuple[dict[str, Measured], int]:
    """Return the rows of every stage in the order of the pipeline, and the number of scenes."""
    by_stage: dict[str, Rows] = {}
    for row in ledger.to_pylist():
        if row["seconds"] is not None:
            by_stage.setdefault(row["stage"], []).append(row)
    by_stage["truth"] = _truths(by_stage)
    names = sorted({row["scene_id"] for rows in by_stage.values() for row in rows})
    numbers = {name: number for number, name in enumerate(names)}
    stages = {}
    for stage in (*SCENE_STAGES, *VIEW_STAGES):
        if rows := by_stage.get(stage):
            stages[stage] = Measured(
                np.array([numbers[row["scene_id"]] for row in rows]),
                np.array([float(bool(row["first"])) for row in rows]),
                np.array([_samples(row) for row in rows]),
                np.array([float(row["seconds"]) * (row["threads"] or 1) for row in rows]),
            )
    return stages, len(names)


def _truths(by_stage: Mapping[str, Rows]) -> Rows:
    """Merge the rows of shading, colour and light of each view.

    Views with fewer of them than others are left out as unfinished.
    """
    both: dict[tuple[str, str], Rows] = {}
    for row in (row for stage in TRACED for row in by_stage.get(stage, [])):
        both.setdefault((row["scene_id"], row["view_id"]), []).append(row)
    most = max((len(rows) for rows in both.values()), default=0)
    return [
        {
            **rows[0],
            "seconds": sum(row["seconds"] for row in rows),
            "first": any(row["first"] for row in rows),
        }
        for _, rows in sorted(both.items())
        if len(rows) == most
    ]


def _samples(row: dict[str, Any]) -> float:
    return float((row["width"] or 0) * (row["height"] or 0) * (row["spp"] or 1))


def _fit(stage: str, rows: Measured) -> tuple[float, float, float]:
    """Return core-seconds per scene, per view and per sample."""
    if stage in SCENE_STAGES:
        return float(rows.seconds.mean()), 0.0, 0.0
    largest = float(rows.samples.max())
    grows = largest > 0  # older rows may have no size
    varies = not grows or largest > _SAME * rows.samples.min()
    columns = [rows.first]
    columns += [rows.samples / largest] if grows else []
    columns += [np.ones_like(rows.samples)] if varies else []
    found = [float(value) for value in nnls(np.stack(columns, axis=1), rows.seconds)[0]]
    sample = found[1] / largest if grows else 0.0
    return found[0], found[-1] if varies else 0.0, sample


def _predict(stage: str, seen: Measured, wanted: Measured) -> Float64Array:
    """Return the predicted core-seconds of each wanted row, (N,)."""
    scene, view, sample = _fit(stage, seen)
    if stage in SCENE_STAGES:
        return np.full(len(wanted.seconds), scene)
    return scene * wanted.first + view + sample * wanted.samples


def _held_out(stages: Mapping[str, Measured], scenes: int) -> dict[str, HeldOut]:
    """Return the errors of each stage and of their sum over many random halves of the scenes."""
    names = [*stages, TOGETHER]
    if scenes < _MIN_SCENES:
        return dict.fromkeys(names, HeldOut(np.nan, np.nan, np.nan))
    totals: dict[str, list[float]] = {name: [] for name in names}
    singles: dict[str, list[float]] = {name: [] for name in names}
    draw = generator(0, "cost", scenes)
    for _ in range(_HALVES):
        half = np.zeros(scenes, dtype=bool)
        half[draw.permutation(scenes)[: scenes // 2]] = True
        actual = {name: np.zeros(scenes) for name in names}
        predicted = {name: np.zeros(scenes) for name in names}
        for stage, rows in stages.items():
            seen, unseen = rows.part(half), rows.part(~half)
            if not len(seen.seconds):
                continue
            guess = _predict(stage, seen, unseen)
            for name in (stage, TOGETHER):
                actual[name] += np.bincount(unseen.scene, unseen.seconds, scenes)
                predicted[name] += np.bincount(unseen.scene, guess, scenes)
        for name in names:
            there = actual[name] > 0
            if there.any():
                spent = actual[name][there]
                apart = predicted[name][there] - spent
                totals[name].append(abs(float(apart.sum())) / float(spent.sum()))
                singles[name] += list(abs(apart) / spent)
    return {name: _summary(totals[name], singles[name]) for name in names}


def _summary(totals: Sequence[float], singles: Sequence[float]) -> HeldOut:
    if not totals:
        return HeldOut(np.nan, np.nan, np.nan)
    worst = float(np.quantile(totals, 0.95))
    return HeldOut(float(np.median(totals)), worst, float(np.median(singles)))


def estimator(ledger: pa.Table) -> Estimate:
    """Return a function that estimates the seconds of a stage, scene and view.

    A view that was made before has its recorded seconds. Another one has the mean of its stage,
    times the mean ratio of its scene to other scenes over the stages recorded for it. Stages that
    the ledger does not contain count as 1 s.
    """
    known: dict[tuple[str, str, str], float] = {}
    stages: dict[str, list[float]] = defaultdict(list)
    columns = ledger.select(["stage", "scene_id", "view_id", "seconds"]).to_pydict().values()
    for stage, scene, view, seconds in zip(*columns, strict=True):
        known[stage, scene, view] = seconds
        stages[stage].append(seconds)
    usual = {stage: mean(values) or 1.0 for stage, values in stages.items()}
    scenes: dict[str, dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for (stage, scene, _), seconds in known.items():
        scenes[scene][stage].append(seconds / usual[stage])
    slower = {
        scene: mean(mean(values) for values in by_stage.values())
        for scene, by_stage in scenes.items()
    }

    def estimate(stage: str, scene: str, view: str) -> float:
        if (stage, scene, view) in known:
            return known[stage, scene, view]
        return usual.get(stage, 1.0) * slower.get(scene, 1.0)

    return estimate
