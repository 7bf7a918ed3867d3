"""What a run will cost, from what earlier views cost: a model fitted to the ledger.

The cost of a stage in core-seconds is linear in three things: how often a worker meets a scene
(it opens it and compiles its kernels), how many views there are, and how many samples (or pixels,
where nothing is sampled) those views have. Coefficients are not negative (Lawson and Hanson's
NNLS). Scenes differ, so the fit is tried on scenes that it has not seen: half of them, drawn at
random again and again, predict the other half, and the error is part of the answer.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
from scipy.optimize import nnls

from pipeline.params import Params
from scenes.arrays import BoolArray, Float64Array
from scenes.errors import InputError
from scenes.seeds import generator

SCENE_STAGES = ("scenes", "cameras")
# truth: shading and colour of a view together
VIEW_STAGES = ("inputs", "illumination", "visibility", "truth", "noisy")
TOGETHER = "together"
_TRUTHS = ("shading", "color")
_SAME = 1.5  # views whose sizes differ by less say nothing of how cost grows with size
_HALVES = 100  # draws of half of the scenes
_FEWEST = 4  # scenes that can be halved to any purpose

Rows = list[dict[str, Any]]


@dataclass(frozen=True)
class HeldOut:
    """How well half of the scenes predict the others, as shares of what those cost.

    All nan with fewer than four scenes.
    """

    usual: float  # error of the total: the median of all draws
    worst: float  # what 95 % of the draws stay within
    scene: float  # error of a single scene, the median


@dataclass(frozen=True)
class StageCost:
    """Core-seconds of one stage: each scene, each view, each sample (or pixel) of a view."""

    stage: str
    scene: float
    view: float
    sample: float
    measured: int  # things that the fit has seen

    def total(self, scenes: int, views: int, samples: float) -> float:
        """Core-seconds of so many scenes and views, of `samples` samples a view."""
        return scenes * self.scene + views * (self.view + samples * self.sample)


@dataclass(frozen=True)
class Measured:
    """The rows of a stage: which scene, whether its first, how many samples, core-seconds."""

    scene: npt.NDArray[np.intp]
    first: Float64Array
    samples: Float64Array
    seconds: Float64Array

    def part(self, of: BoolArray) -> Measured:
        """Rows of the scenes for which `of` is true."""
        chosen = of[self.scene]
        return Measured(
            self.scene[chosen], self.first[chosen], self.samples[chosen], self.seconds[chosen]
        )


def fit_costs(ledger: pa.Table) -> tuple[list[StageCost], dict[str, HeldOut]]:
    """The cost of every stage that the ledger has rows of, in the order of the chain, and how well
    each of them, and all `TOGETHER`, are predicted for scenes that the fit has not seen.

    Raises `InputError` if it has none of ground truth, without which there is nothing to say.
    """
    stages, scenes = _measured(ledger)
    costs = [
        StageCost(stage, *_fit(stage, rows), len(rows.seconds)) for stage, rows in stages.items()
    ]
    return costs, _held_out(stages, scenes)


def samples_of(stage: str, params: Params) -> float:
    """What a view of this stage has of that which its cost grows with."""
    image, panorama = params.image, params.illumination
    if stage == "illumination":
        return panorama.width**2 / 2
    spp = {"truth": params.groundtruth.spp, "noisy": params.noisy.spp}.get(stage, 1)
    return image.width * image.height * spp


def _measured(ledger: pa.Table) -> tuple[dict[str, Measured], int]:
    """The rows of every stage in the order of the chain, and how many scenes there are."""
    by_stage: dict[str, Rows] = {}
    for row in ledger.to_pylist():
        if row["seconds"] is not None:
            by_stage.setdefault(row["stage"], []).append(row)
    by_stage["truth"] = _truths(by_stage)
    if not by_stage["truth"]:
        raise InputError(
            "the ledger has no ground truth yet: render a few views first (pbrnet groundtruth), "
            "their cost is what the estimate is made from"
        )
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
    """Shading and colour of each view as one: they come from one trace, or one after the other.

    Views that have one of them only are left out (their other half was not done yet), unless all
    are like that.
    """
    both: dict[tuple[str, str], Rows] = {}
    for row in (row for stage in _TRUTHS for row in by_stage.get(stage, [])):
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
    """Core-seconds of each scene, each view and each sample."""
    if stage in SCENE_STAGES:
        return float(rows.seconds.mean()), 0.0, 0.0
    largest = float(rows.samples.max())
    grows = largest > 0  # of older rows the size may not be known
    varies = not grows or largest > _SAME * rows.samples.min()
    columns = [rows.first]
    columns += [rows.samples / largest] if grows else []
    columns += [np.ones_like(rows.samples)] if varies else []
    found = [float(value) for value in nnls(np.stack(columns, axis=1), rows.seconds)[0]]
    sample = found[1] / largest if grows else 0.0
    return found[0], found[-1] if varies else 0.0, sample


def _predict(stage: str, seen: Measured, wanted: Measured) -> Float64Array:
    """Core-seconds of each wanted row."""
    scene, view, sample = _fit(stage, seen)
    if stage in SCENE_STAGES:
        return np.full(len(wanted.seconds), scene)
    return scene * wanted.first + view + sample * wanted.samples


def _held_out(stages: Mapping[str, Measured], scenes: int) -> dict[str, HeldOut]:
    """The errors of each stage, and of their sum, over many draws of half of the scenes."""
    names = [*stages, TOGETHER]
    if scenes < _FEWEST:
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
