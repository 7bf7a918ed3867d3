"""Results of the illumination study: the JSON contract and the report section."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from pbrnet.model.figures.estimates import interval
from pbrnet.model.figures.records import Records
from pbrnet.model.figures.results import known_first
from pbrnet.model.figures.section import Section
from pbrnet.model.studies.files import study_section
from pbrnet.model.titles import METHOD_TITLES
from pbrnet.scenes.checked import within

CHANGES = {
    "added": "A lamp added at the left rear",
    "lamps": "All lamps brighter",
    "outdoors": "Sky and sun darker",
    "without": "The brightest lamp removed",
    "all": "All changes",
    "exchanged": "Another view's panorama",
}
TITLES = {
    "direct": "Direct light of the panorama, without a network",
    "shading": "Predicted shading",
    **METHOD_TITLES,
}


@dataclass(frozen=True)
class Estimate:
    """Measure over all views, with its 95 % interval over scenes; None with one scene."""

    value: float
    low: float | None
    high: float | None


@dataclass(frozen=True)
class Agreement:
    """Agreement of predicted and rendered changes, ln(luminance after / before) of pixel blocks.

    None where a measure is undefined: a uniform change has no pattern.
    """

    views: int = field(metadata=within(1))
    scenes: int = field(metadata=within(1))
    blocks: int = field(metadata=within(1))
    correlation: Estimate | None  # Pearson, over the blocks of all views
    pattern: Estimate | None  # the same after subtraction of every view's mean change
    sign: Estimate | None  # share of rendered changes with a sign that is predicted
    gain: Estimate | None  # predicted per rendered change; 1 is the correct size
    true: Estimate | None  # mean rendered change
    predicted: Estimate | None  # mean predicted change


@dataclass(frozen=True)
class Change:
    """Results of one kind of change."""

    views: int = field(metadata=within(0))
    skipped: dict[str, int]  # reason -> views
    methods: dict[str, Agreement]
    reference: str = "rendered"  # or "direct light" of the panorama, without a rendering


@dataclass(frozen=True)
class IlluminationResult:
    """Contract of `metrics/studies/illumination.json`."""

    seed: int
    split: str
    views: int = field(metadata=within(1))
    scenes: int = field(metadata=within(1))
    size: tuple[int, int]  # width, height
    spp: int = field(metadata=within(1))
    denoiser: str
    renderer: str
    factor: float = field(metadata=within(above=1))  # of lamps; outdoors its inverse
    strength: float = field(metadata=within(above=0))  # of the added lamp
    block: int = field(metadata=within(1))  # pixels a side
    least: float = field(metadata=within(0))  # smaller rendered changes have no sign
    models: dict[str, str]  # name -> SHA-256 of the weights
    changes: dict[str, Change]


def report_section(records: Records) -> Section | None:
    """Return the report section; None, and a note if damaged, without a result."""
    result = records.study("illumination", IlluminationResult)
    if result is None:
        return None
    return study_section(
        "illumination",
        "Response to changes of light",
        result=result,
        groups=[
            {
                "title": CHANGES.get(name, name),
                "views": change.views,
                "rendered": change.reference == "rendered",
                "skipped": sorted(change.skipped.items()),
                "rows": [
                    _row(method, change.methods[method])
                    for method in known_first(change.methods, TITLES)
                ],
            }
            for name in known_first(result.changes, CHANGES)
            for change in (result.changes[name],)
        ],
        picture=records.study_picture("illumination"),
    )


def _row(method: str, found: Agreement) -> dict[str, Any]:
    cells = [found.pattern, found.correlation, found.sign, found.gain]
    return {
        "name": method,
        "title": TITLES.get(method, method),
        "cells": [format_estimate(figure) for figure in cells],
        "true": "–" if found.true is None else f"{found.true.value:+.2f}",
        "predicted": "–" if found.predicted is None else f"{found.predicted.value:+.2f}",
    }


def format_estimate(figure: Estimate | None) -> tuple[str, str]:
    """Format value and interval; a dash and an empty string for None."""
    if figure is None:
        return "–", ""
    return f"{figure.value:.2f}", interval(figure.low, figure.high, 2)
