"""Contract of `metrics/photographs.json`, its printed table, and the section of the report."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from pbrnet.model.figures.charts import inline_svg, line_figure
from pbrnet.model.figures.estimates import interval
from pbrnet.model.figures.records import Records
from pbrnet.model.figures.section import Section
from pbrnet.model.studies.files import study_section
from pbrnet.model.studies.trials.results import MetricEstimate
from pbrnet.pipeline.plotting import INK, SERIES, style_axes
from pbrnet.scenes.checked import within

FILE = "photographs.json"  # in the folder of the metrics
PLOTS = ("photographs.png", "photographs-views.png")  # beside it
# Measures as tables and plots show them.
HEADINGS = {
    "absrel": "AbsRel",
    "delta1": "δ1",
    "absrel_scaled": "AbsRel, scaled",
    "absrel_affine": "AbsRel, affine",
    "normal_mean": "normals, degrees",
    "miou13": "IoU, 13 classes",
}


@dataclass(frozen=True)
class RowResult:
    """Figures of a row, None where the truth has nothing to measure; `stages`: names of its sets.

    `views`: pictures it was trained on.
    """

    stages: tuple[tuple[str, ...], ...]
    views: int
    seeds: int  # trainings
    varied: bool
    seconds_per_step: float
    absrel: MetricEstimate | None = None
    delta1: MetricEstimate | None = None
    absrel_scaled: MetricEstimate | None = None
    delta1_scaled: MetricEstimate | None = None
    absrel_affine: MetricEstimate | None = None
    delta1_affine: MetricEstimate | None = None
    normal_mean: MetricEstimate | None = None
    normal_median: MetricEstimate | None = None
    normal_11: MetricEstimate | None = None
    normal_22: MetricEstimate | None = None
    normal_30: MetricEstimate | None = None
    floor_angle: MetricEstimate | None = None
    normal_known: MetricEstimate | None = None
    pixels13: MetricEstimate | None = None
    miou13: MetricEstimate | None = None
    pixels40: MetricEstimate | None = None
    miou40: MetricEstimate | None = None


@dataclass(frozen=True)
class PhotographsResult:
    """Contract of `metrics/photographs.json`; `rows` by name, all tested on the same pictures."""

    test: str  # name of the set
    pictures: int = field(metadata=within(1))
    runs: int = field(metadata=within(1))
    normal_coverage: float = field(metadata=within(0, 1))  # share of the pixels with a true normal
    steps: int = field(metadata=within(1))
    batch: int = field(metadata=within(1))
    focal: float  # pixels
    seed: int
    reference: str
    order: tuple[str, ...]  # names of the rows as asked for
    rows: dict[str, RowResult]

    def verify(self, where: str) -> None:
        """Check the order of the rows; raises ValueError."""
        if not self.order or sorted(self.order) != sorted(self.rows):
            raise ValueError(f"{where}: order does not list the rows")


def lines(result: PhotographsResult) -> list[str]:
    """Return the table of the results, a line each."""
    width = max(len(name) for name in (*result.rows, "trained on"))
    heads = "  ".join(f"{HEADINGS[name]:>14}" for name in HEADINGS)
    found = [
        f"{result.pictures} pictures of {result.runs} runs; normals known in "
        f"{result.normal_coverage:.0%} of the pixels; {result.steps} steps",
        f"{'trained on':<{width}}   views  {heads}",
    ]
    for name in result.order:
        row = result.rows[name]
        cells = "  ".join(f"{cell(row, measure):>14}" for measure in HEADINGS)
        found.append(f"{name:<{width}}  {row.views:>6}  {cells}")
    return found


def cell(row: RowResult, measure: str) -> str:
    """Return the mean of a measure as text, a dash where there is none."""
    figure = getattr(row, measure)
    if figure is None:
        return "-"
    return f"{figure.mean:.{digits(measure)}f}"


def digits(measure: str) -> int:
    """Return the decimals of a measure: angles have one."""
    return 1 if measure == "normal_mean" else 3


def figures(result: PhotographsResult) -> list[Figure]:
    """Draw the bars of all rows and, if rows differ in their views alone, error against views."""
    return [bars(result), *([curve] if (curve := views_curve(result)) else [])]


def bars(result: PhotographsResult) -> Figure:
    """Draw scaled depth error, angle of normals and IoU of every row, with their intervals."""
    measures = ("absrel_scaled", "normal_mean", "miou13")
    figure = Figure(figsize=(9, 1.2 + 0.32 * len(result.order)), dpi=100, layout="constrained")
    panels = figure.subplots(1, len(measures), sharey=True)
    for axes, measure in zip(panels, measures, strict=True):
        style_axes(axes)
        for place, name in enumerate(result.order):
            found = getattr(result.rows[name], measure)
            if found is not None:
                axes.barh(place, found.mean, color=SERIES[0], height=0.6)
                if found.low is not None:
                    axes.plot([found.low, found.high], [place, place], color=INK, linewidth=1.5)
        axes.set_yticks(range(len(result.order)), result.order)
        axes.set_xlabel(HEADINGS[measure])
        axes.xaxis.set_major_locator(MaxNLocator(5))
    panels[0].invert_yaxis()
    return figure


def views_curve(result: PhotographsResult) -> Figure | None:
    """Draw the scaled depth error over the number of views; None without two such rows.

    A line joins the rows that are trained on the same sets in one stage.
    """
    series: dict[str, list[tuple[float, float]]] = {}
    for name in result.order:
        row = result.rows[name]
        if len(row.stages) == 1 and row.varied and row.absrel_scaled is not None:
            series.setdefault(" + ".join(row.stages[0]), []).append(
                (row.views, row.absrel_scaled.mean)
            )
    lined = {name: sorted(points) for name, points in series.items() if len(points) > 1}
    if not lined:
        return None
    alone = {name: points for name, points in series.items() if len(points) == 1}
    figure = line_figure({**lined, **alone}, "pictures trained on", HEADINGS["absrel_scaled"])
    if figure is not None:
        counts = sorted({views for points in series.values() for views, _ in points})
        figure.axes[0].set_xscale("log")
        figure.axes[0].minorticks_off()
        figure.axes[0].set_xticks(counts, [f"{count:,g}" for count in counts])
    return figure


def report_section(records: Records) -> Section | None:
    """Return the report section; None, and a note if damaged, without a result."""
    path = records.places.metrics / FILE
    result = records.result(path, PhotographsResult, "pbrnet study photographs")
    if result is None:
        return None
    return study_section(
        "photographs",
        "Photographs",
        result=result,
        headings=list(HEADINGS.values()),
        rows=[_shown(name, result.rows[name]) for name in result.order],
        charts=[inline_svg(figure) for figure in figures(result)],
    )


def _shown(name: str, row: RowResult) -> dict[str, Any]:
    """Return a row of the report's table."""
    cells = []
    for measure in HEADINGS:
        figure = getattr(row, measure)
        limits = "" if figure is None else interval(figure.low, figure.high, digits(measure))
        cells.append({"mean": cell(row, measure), "limits": limits})
    return {"name": name, "views": row.views, "seeds": row.seeds, "cells": cells}
