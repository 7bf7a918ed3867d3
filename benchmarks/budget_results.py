"""Results of the time budgets: points, the best picture of each budget, and the plot."""

from __future__ import annotations

import io
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import mean
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

# Methods by whose they are; each group's best counts.
GROUPS = {
    "ours": ("radiosity", "plus", "hybrid", "planned_denoised"),
    "path": ("mitsuba_denoised",),
    "cycles": ("cycles", "cycles_fast", "cycles_portals", "cycles_portals_fast"),
}
TITLES = {
    "radiosity": "Ours: light transport (radiosity)",
    "plus": "Ours: PBR-Net plus",
    "hybrid": "Ours: PBR-Net hybrid",
    "planned_denoised": "Ours: light sampling by a pilot, denoised",
    "mitsuba_denoised": "Mitsuba's path, denoised",
    "cycles": "Blender Cycles, denoised",
    "cycles_fast": "Blender Cycles, guides prefiltered fast",
    "cycles_portals": "Blender Cycles with portals, denoised",
    "cycles_portals_fast": "Blender Cycles with portals, guides fast",
}
WITHIN = 1.05  # a picture may exceed its budget by the noise of the clock
_LINES = {
    "radiosity": ("#2ca02c", "-", "D"),
    "plus": ("#ff7f0e", "-", "s"),
    "hybrid": ("#d62728", "-", "o"),
    "planned_denoised": ("#9467bd", "-", "."),
    "mitsuba_denoised": ("#1f77b4", "--", "."),
    "cycles": ("#555555", "--", "."),
    "cycles_fast": ("#555555", ":", "x"),
    "cycles_portals": ("#8c564b", "--", "."),
    "cycles_portals_fast": ("#8c564b", ":", "x"),
}


@dataclass(frozen=True)
class Point:
    """Time and quality of one method at one image size, of one view or the mean of several."""

    size: str  # WIDTHxHEIGHT
    method: str  # of `TITLES`
    spp: int  # 0: without samples
    seconds: float
    flip: float
    ssim: float


def means(views: Sequence[Sequence[Point]]) -> list[Point]:
    """Return means over the views, of the sizes, methods and samples that all of them have."""
    found: dict[tuple[str, str, int], list[Point]] = defaultdict(list)
    for point in (point for view in views for point in view):
        found[point.size, point.method, point.spp].append(point)
    return [
        Point(
            *key, *(mean(getattr(p, name) for p in points) for name in ("seconds", "flip", "ssim"))
        )
        for key, points in found.items()
        if len(points) == len(views)
    ]


def cells(points: Sequence[Point], budgets: Sequence[float]) -> list[dict[str, Any]]:
    """Return the best picture of each group by image size and budget; None where none is in time.

    `first` is the group of the lowest FLIP; None where no picture is in time.
    """
    rows: list[dict[str, Any]] = []
    for size in dict.fromkeys(point.size for point in points):
        for budget in budgets:
            row: dict[str, Any] = {"size": size, "budget": budget, "first": None}
            lowest = float("inf")
            for group, methods in GROUPS.items():
                inside = [
                    point
                    for point in points
                    if point.size == size
                    and point.method in methods
                    and point.seconds <= WITHIN * budget
                ]
                best = min(inside, key=lambda point: point.flip, default=None)
                row[group] = best
                if best is not None and best.flip < lowest:
                    lowest, row["first"] = best.flip, group
            rows.append(row)
    return rows


def budget_plot(points: Sequence[Point], budgets: Sequence[float], words: str) -> bytes:
    """Return a PNG with a panel for each image size: FLIP over seconds, both logarithmic."""
    sizes = list(dict.fromkeys(point.size for point in points))
    figure = Figure(figsize=(max(4.6 * len(sizes), 9.2), 5.2), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, len(sizes), sharey=True, squeeze=False)[0]
    for axes, size in zip(panels, sizes, strict=True):
        for method, (colour, dashes, mark) in _LINES.items():
            line = [point for point in points if (point.size, point.method) == (size, method)]
            line.sort(key=lambda point: point.spp)
            axes.plot(
                [point.seconds for point in line],
                [point.flip for point in line],
                dashes,
                color=colour,
                marker=mark,
                label=TITLES[method],
            )
            for point in line:
                if point.spp:
                    axes.annotate(
                        str(point.spp),
                        (point.seconds, point.flip),
                        (3, 4),
                        textcoords="offset points",
                        fontsize=7,
                        color=colour,
                    )
        for budget in budgets:
            axes.axvline(budget, color="#dddddd", zorder=0)
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xticks(list(budgets), [f"{budget:g}" for budget in budgets])
        axes.xaxis.set_minor_formatter(NullFormatter())
        for set_formatter in (axes.yaxis.set_major_formatter, axes.yaxis.set_minor_formatter):
            set_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.tick_params(which="both", labelsize=8)
        axes.set_title(size, fontsize=11)
        axes.set_xlabel("seconds for a further picture")
        axes.grid(True, which="both", axis="y", alpha=0.25)
    panels[0].set_ylabel("ꟻLIP: lower is nearer to the reference")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(sizes) + 1, fontsize=9)
    figure.suptitle(words, fontsize=10)
    stream = io.BytesIO()
    figure.savefig(stream, format="png", metadata={"Software": None})
    return stream.getvalue()
