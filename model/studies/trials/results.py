"""Results of the studies that compare trainings: the JSON contract and the report section."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from pbrnet.model.figures.charts import line_chart
from pbrnet.model.figures.estimates import interval, with_interval
from pbrnet.model.figures.records import METRICS, Records
from pbrnet.model.figures.section import Section, render_section
from pbrnet.model.studies.trials.words import COMPARISONS
from pbrnet.scenes.checked import within

# Every metric of these studies: label, preferred direction, digits.
MEASURES: dict[str, tuple[str, str, int]] = {
    name: (label, "higher is better" if higher else "lower is better", digits)
    for name, (label, higher, digits) in METRICS.items()
}
MEASURES |= {
    "detail": ("Fine detail (dB)", "0 is the ground truth's", 2),
    "grid": ("Grid (grey levels)", "best as the ground truth's", 3),
}
MEASURES |= {
    f"{region}_{name}": (f"{MEASURES[name][0]}, {words}", *MEASURES[name][1:])
    for region, words in (("specular", "specular"), ("matte", "matte"))
    for name in ("psnr", "flip")
}


@dataclass(frozen=True)
class MetricEstimate:
    """A metric of one row; intervals are 95 % bootstrap intervals over scenes.

    Those of photographs are over runs of pictures.
    """

    mean: float  # over views and repeats
    low: float | None = None  # None with a single scene
    high: float | None = None
    spread: float | None = None  # standard deviation of the repeats' means; None for one repeat
    gain: float | None = None  # mean minus that of the group's reference; None for the reference
    gain_low: float | None = None
    gain_high: float | None = None


@dataclass(frozen=True)
class TrialsRow:
    """Scores of one label: a way to train, or a method of evaluation."""

    label: str
    group: str  # rows of one group share their ground truth and their training views
    views: float | None = field(metadata=within(0))  # training views, mean over repeats
    steps: int | None = field(metadata=within(0))  # in all; None, as views: not trained
    metrics: dict[str, MetricEstimate | None]  # None: not measurable


@dataclass(frozen=True)
class TrialsResult:
    """Contract of `metrics/studies/NAME.json` of a study that compares trainings."""

    study: str
    seed: int
    repeats: int = field(metadata=within(1))
    split: str
    views: int = field(metadata=within(1))  # measured
    scenes: int = field(metadata=within(1))
    backbone: str
    reference: str  # label that the others of a group are compared with
    rows: tuple[TrialsRow, ...]
    notes: tuple[str, ...] = ()  # sentences about what was compared

    @property
    def measured(self) -> list[str]:
        """Metrics that any row has, in the order of `MEASURES`."""
        return [name for name in MEASURES if any(row.metrics.get(name) for row in self.rows)]

    def verify(self, where: str) -> None:
        """Raise ValueError unless every group has the reference and each label once."""
        for group in {row.group for row in self.rows}:
            labels = [row.label for row in self.rows if row.group == group]
            if self.reference not in labels or len(set(labels)) < len(labels):
                raise ValueError(
                    f"{where}.rows: group {group!r} lacks {self.reference!r}, or has a label twice"
                )


def trials_section(records: Records, study: str) -> Section | None:
    """Return the report section of a study; None, and a note if damaged, without a result."""
    result = records.study(study, TrialsResult)
    if result is None:
        return None
    words = COMPARISONS[study]
    titles = words.titles
    groups: dict[str, list[dict[str, Any]]] = {}
    for row in result.rows:
        groups.setdefault(row.group, []).append(_row(row, result.measured, titles))
    return render_section(
        "pbrnet.model.studies.trials",
        f"study-{study}",
        words.title,
        result=result,
        reference=titles.get(result.reference, result.reference),
        metrics=[MEASURES[name][:2] for name in result.measured],
        groups=list(groups.items()),
        curves=_curves(result, titles),
        picture=records.study_picture(study, width=None, png=True),
    )


def _row(row: TrialsRow, measured: list[str], titles: Mapping[str, str]) -> dict[str, Any]:
    return {
        "label": row.label,
        "title": titles.get(row.label, row.label),
        "views": "–" if row.views is None else f"{row.views:g}",
        "steps": row.steps,
        "cells": [_cell(row.metrics.get(name), MEASURES[name][2]) for name in measured],
    }


def _cell(figure: MetricEstimate | None, digits: int) -> dict[str, str] | None:
    if figure is None:
        return None
    gain = ""
    if figure.gain is not None:
        gain = with_interval(figure.gain, figure.gain_low, figure.gain_high, digits, "+")
    return {
        "mean": f"{figure.mean:.{digits}f}",
        "interval": interval(figure.low, figure.high, digits),
        "spread": "" if figure.spread is None else f"± {figure.spread:.{digits}f}",
        "gain": gain,
    }


def _curves(result: TrialsResult, titles: Mapping[str, str]) -> list[dict[str, Any]]:
    """Error against training views, if a label was trained with several numbers of views."""
    labels = list(dict.fromkeys(row.label for row in result.rows))
    curves = []
    for name in ("flip", "ssim"):
        series = {
            titles.get(label, label): [
                (row.views, figure.mean)
                for row in result.rows
                if row.label == label and row.views and (figure := row.metrics.get(name))
            ]
            for label in labels
        }
        series = {label: sorted(points) for label, points in series.items() if points}
        if any(len({views for views, _ in points}) > 1 for points in series.values()):
            svg = line_chart(series, "training views", MEASURES[name][0])
            curves.append({"svg": svg, "metric": MEASURES[name][0]})
    return curves
