"""Scores of trained networks over the pictures of a test, and their means and intervals."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import mean, stdev
from typing import Any

import numpy as np

from pbrnet.model.evaluation.metrics import RESAMPLES
from pbrnet.model.studies.photographs.measures import LABELS, MEASURES
from pbrnet.model.studies.photographs.results import PhotographsResult, RowResult
from pbrnet.model.studies.photographs.rows import Row
from pbrnet.model.studies.trials.results import MetricEstimate
from pbrnet.scenes.arrays import AnyArray, Float64Array
from pbrnet.scenes.seeds import generator


@dataclass(frozen=True)
class Scores:
    """Scores of one network, by pictures in the order of the set.

    `values`: the measures but for those of classes, (pictures,), NaN where there is no truth.
    `tables`: numbers of pixels by true and predicted class, (pictures, C, C), for C of 13 and 40.
    """

    values: Mapping[str, Float64Array]
    tables: Mapping[int, AnyArray]

    def examples(self, count: int) -> list[int]:
        """Return the numbers of the best, median and worst pictures, `count` of each."""
        order = np.argsort(self.values["absrel_scaled"]).tolist()
        middle = len(order) // 2
        places = [*order[:count], *order[middle : middle + count], *order[-count:]]
        return list(dict.fromkeys(places))

    def to_bytes(self, digest: str) -> bytes:
        """Return the content of `scores.npz`; `digest` says what the scores are of."""
        stream = io.BytesIO()
        arrays: dict[str, Any] = {"digest": digest, **self.values}
        arrays |= {f"table{count}": table for count, table in self.tables.items()}
        np.savez_compressed(stream, **arrays)
        return stream.getvalue()

    @classmethod
    def read(cls, content: bytes, digest: str) -> Scores | None:
        """Return the scores in `scores.npz`; None if they are of something else, or damaged."""
        try:
            with np.load(io.BytesIO(content), allow_pickle=False) as file:
                if str(file["digest"]) != digest:
                    return None
                values = {name: file[name] for name in MEASURES if name not in LABELS}
                tables = {count: file[f"table{count}"] for count in set(LABELS.values())}
                return cls(values, tables)
        except (KeyError, ValueError, OSError, EOFError, zipfile.BadZipFile):
            return None

    def measure(self, name: str, weights: Float64Array) -> Float64Array:
        """Return a measure for each weighting of the pictures, `weights` (R, pictures); (R,).

        NaN where the truth has nothing to measure.
        """
        with np.errstate(invalid="ignore", divide="ignore"):
            if name not in LABELS:
                values = self.values[name]
                known = ~np.isnan(values)
                return np.asarray(weights[:, known] @ values[known] / weights[:, known].sum(1))
            tables = np.tensordot(weights, self.tables[LABELS[name]].astype(float), 1)
            right = np.diagonal(tables, axis1=1, axis2=2)
            truth, found = tables.sum(2), tables.sum(1)
            if name.startswith("pixels"):
                return np.asarray(right.sum(1) / truth.sum(1))
            present = truth > 0
            overlap = np.where(present, right / (truth + found - right), 0)
            return np.asarray(overlap.sum(1) / present.sum(1))


@dataclass(frozen=True)
class Tested:
    """A row that is trained and tested, with the scores of each of its seeds."""

    row: Row
    pictures: int  # it was trained on
    seconds_per_step: float
    scores: tuple[Scores, ...]


def summary(
    tested: Sequence[Tested], runs: Sequence[str], facts: Mapping[str, Any]
) -> PhotographsResult:
    """Return the figures of rows; `runs` of the pictures, `facts` of the study for the result."""
    weights = resampled_runs(runs, facts["seed"])
    references = [one for one in tested if one.row.name == facts["reference"]]
    rows = {}
    for one in tested:
        other = references[0] if references and references[0] is not one else None
        rows[one.row.name] = RowResult(
            stages=tuple(tuple(source.name for source in stage) for stage in one.row.stages),
            views=one.pictures,
            seeds=len(one.scores),
            varied=one.row.varied,
            seconds_per_step=one.seconds_per_step,
            **{name: _figure(name, one, other, weights) for name in MEASURES},
        )
    coverage = tested[0].scores[0].values["normal_known"]
    return PhotographsResult(
        pictures=len(runs),
        runs=len(set(runs)),
        normal_coverage=float(coverage.mean()),
        order=tuple(rows),
        rows=rows,
        **facts,
    )


def resampled_runs(runs: Sequence[str], seed: int) -> Float64Array:
    """Return how often a picture is drawn in each resampling of whole runs, (R, pictures)."""
    names = sorted(set(runs))
    rng = generator(seed, "photographs", "bootstrap")
    drawn = rng.integers(len(names), size=(RESAMPLES, len(names)))
    counts = np.stack([np.bincount(one, minlength=len(names)) for one in drawn])
    return counts[:, [names.index(run) for run in runs]].astype(float)


def _figure(
    name: str, own: Tested, other: Tested | None, weights: Float64Array
) -> MetricEstimate | None:
    """Return a measure over seeds with its interval; None where there is no truth for it."""
    means, drawn = _means(name, own, weights)
    if not np.isfinite(means).all():
        return None
    low, high = _limits(drawn)
    spread = stdev(means) if len(means) > 1 else None
    figure = MetricEstimate(mean(means), low, high, spread)
    if other is None:
        return figure
    usual, usually_drawn = _means(name, other, weights)
    gain_low, gain_high = _limits(drawn - usually_drawn)
    gain = mean(means) - mean(usual)
    return replace(figure, gain=gain, gain_low=gain_low, gain_high=gain_high)


def _means(name: str, own: Tested, weights: Float64Array) -> tuple[list[float], Float64Array]:
    """Return a measure of each seed, and its mean over seeds for each resampling."""
    every = np.ones((1, weights.shape[1]))
    means = [float(scores.measure(name, every)[0]) for scores in own.scores]
    return means, np.mean([scores.measure(name, weights) for scores in own.scores], 0)


def _limits(drawn: Float64Array) -> tuple[float | None, float | None]:
    """Return the 95 % interval of resampled values; None if they do not vary, as with one run."""
    known = drawn[np.isfinite(drawn)]
    if not known.size or known.min() == known.max():
        return None, None
    low, high = np.quantile(known, [0.025, 0.975])
    return float(low), float(high)
