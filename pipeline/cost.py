"""What a run will cost, from what earlier views cost: a model fitted to the ledger.

The cost of a stage in core-seconds is linear in three things: how often a worker meets a scene
(it opens it and compiles its kernels), how many views there are, and how many samples (or pixels,
where nothing is sampled) those views have. Coefficients are not negative (Lawson and Hanson's
NNLS). Scenes differ, so the fit is tried on scenes that it has not seen, and the error is part of
the answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
from scipy.optimize import nnls

from pipeline.params import Params
from scenes.errors import InputError

SCENE_STAGES = ("scenes", "cameras")
VIEW_STAGES = ("inputs", "illumination", "truth")  # truth: shading and colour of a view together
_TRUTHS = ("shading", "color")
_SAME = 1.5  # views whose sizes differ by less say nothing of how cost grows with size

Rows = list[dict[str, Any]]
Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class StageCost:
    """Core-seconds of one stage: each scene, each view, each sample (or pixel) of a view."""

    stage: str
    scene: float
    view: float
    sample: float
    measured: int  # things that the fit has seen
    error: float  # of a total predicted for scenes that the fit has not seen; nan: cannot be told

    def total(self, scenes: int, views: int, samples: float) -> float:
        """Core-seconds of so many scenes and views, of `samples` samples a view."""
        return scenes * self.scene + views * (self.view + samples * self.sample)


def fit_costs(ledger: pa.Table) -> list[StageCost]:
    """The cost of every stage that the ledger has rows of, in the order of the chain.

    Raises `InputError` if it has none of ground truth, without which there is nothing to say.
    """
    rows = ledger.to_pylist()
    by_stage: dict[str, Rows] = {}
    for row in rows:
        by_stage.setdefault(row["stage"], []).append(row)
    by_stage["truth"] = _truths(by_stage)
    if not by_stage["truth"]:
        raise InputError(
            "the ledger has no ground truth yet: render a few views first (pbrnet groundtruth), "
            "their cost is what the estimate is made from"
        )
    costs = []
    for stage in (*SCENE_STAGES, *VIEW_STAGES):
        found = [row for row in by_stage.get(stage, []) if row["seconds"] is not None]
        if found and stage in SCENE_STAGES:
            mean = float(np.mean([_core_seconds(row) for row in found]))
            costs.append(StageCost(stage, mean, 0.0, 0.0, len(found), _held_out(found, stage)))
        elif found:
            scene, view, sample = _fit(found)
            error = _held_out(found, stage)
            costs.append(StageCost(stage, scene, view, sample, len(found), error))
    return costs


def samples_of(stage: str, params: Params) -> float:
    """What a view of this stage has of that which its cost grows with."""
    image, panorama = params.image, params.illumination
    if stage == "illumination":
        return panorama.width**2 / 2
    return image.width * image.height * (params.groundtruth.spp if stage == "truth" else 1)


def _truths(by_stage: dict[str, Rows]) -> Rows:
    """Shading and colour of each view as one: they come from one trace, or one after the other."""
    both: dict[tuple[str, str], dict[str, Any]] = {}
    for row in (row for stage in _TRUTHS for row in by_stage.get(stage, [])):
        key = (row["scene_id"], row["view_id"])
        if key not in both:
            both[key] = dict(row)
        else:
            both[key]["seconds"] += row["seconds"]
            both[key]["first"] = both[key]["first"] or row["first"]
    return [both[key] for key in sorted(both)]


def _core_seconds(row: dict[str, Any]) -> float:
    return float(row["seconds"]) * (row["threads"] or 1)


def _samples(row: dict[str, Any]) -> float:
    return float((row["width"] or 0) * (row["height"] or 0) * (row["spp"] or 1))


def _fit(rows: Rows) -> tuple[float, float, float]:
    """Core-seconds of each scene, each view and each sample."""
    samples = np.array([_samples(row) for row in rows])
    first = np.array([float(bool(row["first"])) for row in rows])
    seconds = np.array([_core_seconds(row) for row in rows])
    largest = float(samples.max())
    grows = largest > 0  # of older rows the size may not be known
    varies = not grows or largest > _SAME * samples.min()
    columns = [first]
    columns += [samples / largest] if grows else []
    columns += [np.ones_like(samples)] if varies else []
    found = [float(value) for value in nnls(np.stack(columns, axis=1), seconds)[0]]
    sample = found[1] / largest if grows else 0.0
    return found[0], found[-1] if varies else 0.0, sample


def _held_out(rows: Rows, stage: str) -> float:
    """Relative error of the total of one half of the scenes as the other half predicts it: the
    larger of both ways; nan with fewer than four scenes."""
    names = sorted({row["scene_id"] for row in rows})
    if len(names) < 4:
        return float("nan")
    errors = []
    for part in (set(names[::2]), set(names[1::2])):
        seen = [row for row in rows if row["scene_id"] in part]
        unseen = [row for row in rows if row["scene_id"] not in part]
        actual = sum(_core_seconds(row) for row in unseen)
        predicted = _predict(seen, unseen, stage)
        errors.append(abs(predicted - actual) / actual if actual > 0 else 0.0)
    return max(errors)


def _predict(seen: Rows, wanted: Rows, stage: str) -> float:
    if stage in SCENE_STAGES:
        return float(np.mean([_core_seconds(row) for row in seen])) * len(wanted)
    scene, view, sample = _fit(seen)
    return sum(scene * bool(row["first"]) + view + sample * _samples(row) for row in wanted)


def overall_error(costs: Sequence[StageCost], scenes: int, views: int, params: Params) -> float:
    """Error of the sum, if those of the stages do not cancel; nan if one cannot be told."""
    totals = [cost.total(scenes, views, samples_of(cost.stage, params)) for cost in costs]
    wrong = sum(total * cost.error for total, cost in zip(totals, costs, strict=True))
    return wrong / sum(totals) if sum(totals) > 0 else 0.0
