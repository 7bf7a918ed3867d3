"""The illumination study: its file's contract, and its part of the report."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from model.figures.records import Records
from model.figures.results import METHODS, known_first
from scenes.checked import within

CHANGES = {
    "added": "A lamp added at the left rear",
    "lamps": "All lamps brighter",
    "outdoors": "Sky and sun darker",
    "without": "The brightest lamp put out",
    "all": "All changes",
    "exchanged": "Another view's panorama",
}
SHOWN = {
    "direct": "The panorama's direct light, no network",
    "shading": "Predicted shading",
    **METHODS,
}


@dataclass(frozen=True)
class Figure:
    """A measure over all views, and its 95 % interval over scenes; None: one scene has none."""

    value: float
    low: float | None
    high: float | None


@dataclass(frozen=True)
class Agreement:
    """Predicted against rendered changes, ln of luminance after / before, over blocks of pixels.

    None where a measure does not exist: a change that is even everywhere has no pattern.
    """

    views: int = field(metadata=within(1))
    scenes: int = field(metadata=within(1))
    blocks: int = field(metadata=within(1))
    correlation: Figure | None  # Pearson's, over the blocks of all views
    pattern: Figure | None  # the same with every view's mean change taken off
    sign: Figure | None  # share of clear rendered changes whose sign is predicted
    gain: Figure | None  # predicted change per rendered change; 1: of the right size
    true: Figure | None  # mean rendered change
    predicted: Figure | None  # mean predicted change


@dataclass(frozen=True)
class Change:
    """One kind of change."""

    views: int = field(metadata=within(0))
    skipped: dict[str, int]  # reason -> views
    methods: dict[str, Agreement]
    reference: str = (
        "rendered"  # or "direct light": of the panorama alone, where nothing is rendered
    )


@dataclass(frozen=True)
class LightResult:
    """`metrics/studies/illumination.json`."""

    seed: int
    split: str
    views: int = field(metadata=within(1))
    scenes: int = field(metadata=within(1))
    size: tuple[int, int]  # width, height
    spp: int = field(metadata=within(1))
    denoiser: str
    renderer: str
    factor: float = field(metadata=within(above=1))  # lamps times it, outdoors divided by it
    strength: float = field(metadata=within(above=0))  # of the added lamp
    block: int = field(metadata=within(1))  # pixels a side
    least: float = field(metadata=within(0))  # rendered changes below it have no sign
    models: dict[str, str]  # name -> SHA-256 of the weights
    changes: dict[str, Change]


def light_study(records: Records) -> dict[str, Any] | None:
    """What the report shows of the study; None, and a note if damaged, without a result."""
    result = records.study("illumination", LightResult)
    if result is None:
        return None
    return {
        "result": result,
        "groups": [
            {
                "title": CHANGES.get(name, name),
                "views": change.views,
                "rendered": change.reference == "rendered",
                "skipped": sorted(change.skipped.items()),
                "rows": [
                    _row(method, change.methods[method])
                    for method in known_first(change.methods, SHOWN)
                ],
            }
            for name in known_first(result.changes, CHANGES)
            for change in (result.changes[name],)
        ],
        "picture": records.study_picture("illumination"),
    }


def _row(method: str, found: Agreement) -> dict[str, Any]:
    cells = [found.pattern, found.correlation, found.sign, found.gain]
    return {
        "name": method,
        "words": SHOWN.get(method, method),
        "cells": [in_words(figure) for figure in cells],
        "true": "–" if found.true is None else f"{found.true.value:+.2f}",
        "predicted": "–" if found.predicted is None else f"{found.predicted.value:+.2f}",
    }


def in_words(figure: Figure | None) -> tuple[str, str]:
    """A figure and its interval; a dash where there is none."""
    if figure is None:
        return "–", ""
    if figure.low is None or figure.high is None:
        return f"{figure.value:.2f}", ""
    return f"{figure.value:.2f}", f"{figure.low:.2f} to {figure.high:.2f}"
