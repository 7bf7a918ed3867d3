"""Results of the time budgets: points, the best picture of each budget, and the plot."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import mean
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

# Methods by whose they are; each group's best counts.
GROUPS = {
    "ours": ("radiosity", "plus", "hybrid", "planned_denoised", "radiosity_quick", "planned_quick"),
    "path": ("mitsuba_denoised", "mitsuba_quick"),
    "cycles": (
        *("cycles", "cycles_fast", "cycles_quick"),
        *("cycles_portals", "cycles_portals_fast", "cycles_portals_quick"),
    ),
}
# Methods with the denoiser's quality `fast`, for budgets in which these have no picture.
QUICK = {
    "radiosity_quick": "radiosity",
    "planned_quick": "planned_denoised",
    "mitsuba_quick": "mitsuba_denoised",
    "cycles_quick": "cycles_fast",
    "cycles_portals_quick": "cycles_portals_fast",
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
    "radiosity_quick": "Ours: light transport, denoiser of quality fast",
    "planned_quick": "Ours: light sampling by a pilot, denoiser of quality fast",
    "mitsuba_quick": "Mitsuba's path, denoiser of quality fast",
    "cycles_quick": "Blender Cycles, denoiser of quality fast",
    "cycles_portals_quick": "Blender Cycles with portals, denoiser of quality fast",
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
    "radiosity_quick": ("#2ca02c", ":", "x"),
    "planned_quick": ("#9467bd", ":", "x"),
    "mitsuba_quick": ("#1f77b4", ":", "x"),
    "cycles_quick": ("#555555", ":", "+"),
    "cycles_portals_quick": ("#8c564b", ":", "+"),
}


@dataclass(frozen=True)
class Point:
    """Time and quality of one method at one image size, of a view of one home."""

    size: str  # WIDTHxHEIGHT
    method: str  # of `TITLES`
    spp: int  # 0: without samples
    seconds: float
    flip: float
    ssim: float


@dataclass(frozen=True)
class Best:
    """The best pictures of a method in some time, one of each home; means over the homes."""

    method: str
    spp: tuple[int, ...]  # of each home; 0: without samples
    seconds: float
    flip: float
    ssim: float


def best_within(homes: Sequence[Sequence[Point]], method: str, seconds: float) -> Best | None:
    """Return the pictures of the lowest FLIP in this time, or None where a home has none.

    `homes` are the points of each home at one image size. Each home may have another number of
    samples, because as many fit as its rooms allow.
    """
    found: list[Point] = []
    for points in homes:
        inside = [one for one in points if one.method == method and one.seconds <= seconds]
        if not inside:
            return None
        found.append(min(inside, key=lambda one: one.flip))
    means = (mean(getattr(one, name) for one in found) for name in ("seconds", "flip", "ssim"))
    return Best(method, tuple(one.spp for one in found), *means)


def by_size(homes: Sequence[Sequence[Point]]) -> dict[str, list[list[Point]]]:
    """Return the points of each home by image size."""
    sizes = dict.fromkeys(point.size for points in homes for point in points)
    return {
        size: [[one for one in points if one.size == size] for points in homes] for size in sizes
    }


def cells(homes: Sequence[Sequence[Point]], budgets: Sequence[float]) -> list[dict[str, Any]]:
    """Return the best of each group by image size and budget; None where none is in time.

    `first` is the group of the lowest FLIP; None where no picture is in time.
    """
    rows: list[dict[str, Any]] = []
    for size, points in by_size(homes).items():
        for budget in budgets:
            row: dict[str, Any] = {"size": size, "budget": budget, "first": None}
            lowest = float("inf")
            for group, methods in GROUPS.items():
                found = (best_within(points, method, WITHIN * budget) for method in methods)
                best = min(filter(None, found), key=lambda one: one.flip, default=None)
                row[group] = best
                if best is not None and best.flip < lowest:
                    lowest, row["first"] = best.flip, group
            rows.append(row)
    return rows


def budget_plot(homes: Sequence[Sequence[Point]], budgets: Sequence[float], words: str) -> bytes:
    """Return a PNG with a panel for each image size: lowest FLIP in so many seconds.

    Both axes are logarithmic; a line begins where the method has a picture of each home.
    """
    sizes = by_size(homes)
    figure = Figure(figsize=(max(4.6 * len(sizes), 9.2), 5.2), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, len(sizes), sharey=True, squeeze=False)[0]
    last = WITHIN * max(budgets)
    handles: dict[str, Any] = {}
    for axes, (size, points) in zip(panels, sizes.items(), strict=True):
        for method, (colour, dashes, mark) in _LINES.items():
            line = _steps(points, method, last)
            if not line:
                continue
            (handles[TITLES[method]],) = axes.step(
                [*(seconds for seconds, _ in line), last],
                [*(flip for _, flip in line), line[-1][1]],
                dashes,
                where="post",
                color=colour,
                marker=mark,
                markevery=range(len(line)),
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
        axes.set_xlabel("seconds that a further picture may take")
        axes.grid(True, which="both", axis="y", alpha=0.25)
    panels[0].set_ylabel("ꟻLIP: lower is nearer to the reference")
    known = [title for title in TITLES.values() if title in handles]
    lines = [handles[title] for title in known]
    figure.legend(lines, known, loc="outside lower center", ncols=len(sizes), fontsize=9)
    figure.suptitle(words, fontsize=10)
    stream = io.BytesIO()
    figure.savefig(stream, format="png", metadata={"Software": None})
    return stream.getvalue()


def _steps(homes: Sequence[Sequence[Point]], method: str, last: float) -> list[tuple[float, float]]:
    """Return seconds, at most `last`, from which on a method has a lower FLIP, and that FLIP."""
    times = sorted(one.seconds for points in homes for one in points if one.method == method)
    steps: list[tuple[float, float]] = []
    for seconds in times:
        found = best_within(homes, method, seconds)
        if found and seconds <= last and (not steps or found.flip < steps[-1][1]):
            steps.append((seconds, found.flip))
    return steps
