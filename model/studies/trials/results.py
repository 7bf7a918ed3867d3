"""Studies that compare trainings: the contract of their results, and their part of the report."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from model.figures.records import METRICS, Records
from model.figures.results import METHODS
from model.figures.row_pictures import uri
from model.figures.svg import line_chart
from pipeline.images import read_picture
from scenes.checked import build, within
from scenes.errors import InputError

# Every metric of the studies: label, what is good, digits.
MEASURES: dict[str, tuple[str, str, int]] = {
    name: (label, "higher is better" if higher else "lower is better", digits)
    for name, (label, higher, digits) in METRICS.items()
}
MEASURES |= {
    "detail": ("Fine detail (dB)", "0 is the truth's", 2),
    "grid": ("Grid (grey levels)", "best as the truth's", 3),
}
MEASURES |= {
    f"{region}_{name}": (f"{MEASURES[name][0]}, {words}", *MEASURES[name][1:])
    for region, words in (("specular", "gloss"), ("matte", "the rest"))
    for name in ("psnr", "flip")
}
TITLES = {
    "loss": "Loss functions",
    "decomposition": "Two stages or one",
    "composition": "Composition network or multiplication",
    "table": "All methods",
    "noise": "Noisy truth",
    "generalisation": "Another source",
}
WORDS = {
    **METHODS,
    "truth": "The renderer's own picture",
    "l1": "L1: the image alone",
    "fifth": "The deepest of the five layers alone",
    "full": "Image and all five layers",
    "part": "Part-perceptual: image and three layers",
    "two_stage": "Shading supervised: two stages",
    "end_to_end": "The same networks on colour alone",
    "network": "Composition network",
    "product_linear": "The same, projected linearly",
    "ceiling": "Reflectance × true shading",
    "clean": "The dataset's own truth",
    "before": "Trained without the source",
    "before, product": "The same, reflectance × predicted shading",
    "tuned": "Then fine-tuned on it",
    "tuned, product": "The same, reflectance × predicted shading",
    "alone": "Trained on the tuning views alone",
    "alone, product": "The same, reflectance × predicted shading",
}


@dataclass(frozen=True)
class TrialsFigure:
    """A metric of one row; intervals are 95 % bootstrap intervals over scenes."""

    mean: float  # over views and repeats
    low: float | None  # None with a single scene
    high: float | None
    spread: float | None  # standard deviation of the repeats' means; None for one repeat
    gain: float | None  # mean minus that of the group's reference; None for the reference
    gain_low: float | None
    gain_high: float | None


@dataclass(frozen=True)
class TrialsRow:
    """One way to train or to compose, measured."""

    label: str
    group: str  # only rows of one group have the same truth and the same training views
    views: float | None = field(metadata=within(0))  # trained on, mean over repeats; None: nothing
    steps: int | None = field(metadata=within(0))  # in all
    metrics: dict[str, TrialsFigure | None]  # None: could not be measured


@dataclass(frozen=True)
class TrialsResult:
    """`metrics/studies/NAME.json` of a study that compares trainings."""

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

    def verify(self, where: str) -> None:
        """Every group has a reference; raises ValueError."""
        for group in {row.group for row in self.rows}:
            labels = [row.label for row in self.rows if row.group == group]
            if self.reference not in labels or len(set(labels)) < len(labels):
                raise ValueError(
                    f"{where}.rows: group {group!r} lacks {self.reference!r}, or has a label twice"
                )


def trials_tables(records: Records) -> list[dict[str, Any]]:
    """What the report shows of every such study that has a result; notes what is damaged."""
    tables = []
    for study in TITLES:
        path = records.places.metrics / "studies" / f"{study}.json"
        content = records.json(path, "")
        if not content:
            continue
        try:
            result = build(TrialsResult, content, str(path), InputError)
        except InputError as error:
            records.missing.append(f"{error}; make it again with: pbrnet study {study}")
            continue
        tables.append(_table(result) | {"picture": _picture(records, study)})
    return tables


def _table(result: TrialsResult) -> dict[str, Any]:
    measured = [name for name in MEASURES if any(row.metrics.get(name) for row in result.rows)]
    groups: dict[str, list[TrialsRow]] = {}
    for row in result.rows:
        groups.setdefault(row.group, []).append(row)
    return {
        "study": result.study,
        "title": TITLES.get(result.study, result.study),
        "repeats": result.repeats,
        "split": result.split,
        "views": result.views,
        "scenes": result.scenes,
        "backbone": result.backbone,
        "reference": WORDS.get(result.reference, result.reference),
        "metrics": [{"label": MEASURES[name][0], "better": MEASURES[name][1]} for name in measured],
        "groups": [
            {"name": group, "rows": [_row(row, measured) for row in rows]}
            for group, rows in groups.items()
        ],
        "notes": result.notes,
        "curves": _curves(result),
    }


def _row(row: TrialsRow, measured: list[str]) -> dict[str, Any]:
    return {
        "label": row.label,
        "words": WORDS.get(row.label, row.label),
        "views": "–" if row.views is None else f"{row.views:g}",
        "steps": row.steps,
        "cells": [_cell(row.metrics.get(name), MEASURES[name][2]) for name in measured],
    }


def _cell(figure: TrialsFigure | None, digits: int) -> dict[str, str] | None:
    if figure is None:
        return None
    lines = {"mean": f"{figure.mean:.{digits}f}", "interval": "", "spread": "", "gain": ""}
    if figure.spread is not None:
        lines["spread"] = f"± {figure.spread:.{digits}f}"
    if figure.low is not None and figure.high is not None:
        lines["interval"] = f"{figure.low:.{digits}f} to {figure.high:.{digits}f}"
    if figure.gain is not None:
        lines["gain"] = f"{figure.gain:+.{digits}f}"
        if figure.gain_low is not None and figure.gain_high is not None:
            lines["gain"] += f" ({figure.gain_low:+.{digits}f} to {figure.gain_high:+.{digits}f})"
    return lines


def _curves(result: TrialsResult) -> list[dict[str, Any]]:
    """Error against training views, where rows of one label differ in them."""
    labels = list(dict.fromkeys(row.label for row in result.rows))
    curves = []
    for name in ("flip", "ssim"):
        series = {
            WORDS.get(label, label): [
                (row.views, figure.mean)
                for row in result.rows
                if row.label == label and row.views and (figure := row.metrics.get(name))
            ]
            for label in labels
        }
        series = {label: sorted(points) for label, points in series.items() if points}
        if any(len({views for views, _ in points}) > 1 for points in series.values()):
            svg = line_chart(series, "training views", MEASURES[name][0])
            curves.append({"svg": svg, "series": list(series), "metric": MEASURES[name][0]})
    return curves


def _picture(records: Records, study: str) -> str:
    path = records.places.metrics / "studies" / f"{study}.png"
    if not path.is_file():
        return ""
    try:
        return uri(read_picture(path.read_bytes()), png=True)
    except (OSError, ValueError):
        records.missing.append(f"{path} is damaged; make it again with: pbrnet study {study}")
        return ""
