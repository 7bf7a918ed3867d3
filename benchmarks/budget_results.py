"""Results of the time budgets: points, the best picture of each budget, and the plot."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import mean
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from pbrnet.model.evaluation.metrics import bootstrap
from pbrnet.scenes.arrays import Float32Array
from pbrnet.scenes.files import atomic_file

OURS, PATH, CYCLES = "ours", "path", "cycles"
GROUPS = {OURS: "this project", PATH: "Mitsuba's path", CYCLES: "Blender Cycles"}
WITHIN = 1.05  # a picture may exceed its budget by the noise of the clock
_LINES = {OURS: ("#d62728", "o"), PATH: ("#1f77b4", "s"), CYCLES: ("#555555", "D")}


@dataclass(frozen=True)
class Point:
    """Time and quality of one picture: of a renderer, with so many samples."""

    group: str  # of `GROUPS`
    method: str
    spp: int
    seconds: float
    flip: float
    ssim: float


@dataclass(frozen=True)
class Measured:
    """Pictures of a scene's view at one image size."""

    kind: str
    name: str
    lighting: str
    size: str  # WIDTHxHEIGHT
    spp: int  # of the long renders
    between: float  # FLIP of the two long renders
    limit: float  # that of infinitely many samples
    apart: float  # largest difference of their means, relative
    ours: Mapping[str, Point]  # by budget, in the order of their method's choice
    rivals: tuple[Point, ...]
    sheet: tuple[tuple[str, Float32Array], ...]  # labels and pictures, display values
    blender: str
    others: float  # processors that other programs used

    @property
    def title(self) -> str:
        """Kind and name of the scene."""
        return f"{self.kind} {self.name}"

    def agrees(self, apart: float, between: float) -> bool:
        """Return whether both renderers show the same scene."""
        return self.apart <= apart and self.limit <= between

    def chosen(self, budget: float) -> Point | None:
        """Return this project's picture for a budget: that chosen for it, if it kept to it.

        Else that chosen for the next smaller budget. The truth has no part in it.
        """
        due = sorted((float(name) for name in self.ours if float(name) <= budget), reverse=True)
        points = (self.ours[f"{one:g}"] for one in due)
        return next((one for one in points if one.seconds <= WITHIN * budget), None)

    def save(self, path: Path) -> None:
        """Write to an .npz file."""
        about = asdict(replace(self, sheet=()))
        about["labels"] = [label for label, _ in self.sheet]
        pictures = {f"picture-{n}": image for n, (_, image) in enumerate(self.sheet)}
        with atomic_file(path) as partial_file, partial_file.open("wb") as file:
            np.savez(file, about=np.array(json.dumps(about)), **pictures)  # type: ignore[arg-type]

    @classmethod
    def load(cls, path: Path) -> Measured:
        """Read a file that `save` wrote."""
        with np.load(path, allow_pickle=False) as file:
            about = json.loads(str(file["about"]))
            labels = about.pop("labels")
            about["sheet"] = tuple((label, file[f"picture-{n}"]) for n, label in enumerate(labels))
        about["ours"] = {name: Point(**point) for name, point in about["ours"].items()}
        about["rivals"] = tuple(Point(**point) for point in about["rivals"])
        return cls(**about)


def best_options(
    tried: Sequence[Mapping[str, float]], names: Sequence[str], most: int
) -> list[str]:
    """Return the names that are among the best in any budget, in their order.

    `tried` has for each budget the FLIP of each name; `most` of them count in each.
    """
    best = {
        name
        for flips in tried
        for name in sorted((n for n in names if n in flips), key=lambda n: flips[n])[:most]
    }
    return [name for name in names if name in best]


def cells(scenes: Sequence[Sequence[Measured]], budgets: Sequence[float]) -> list[dict[str, Any]]:
    """Return the best picture of each renderer, by kind of scene, image size and budget.

    `scenes` holds each scene's sizes. A renderer has no entry where a scene has no picture in time.
    Rivals have the method with the lowest mean FLIP. `first` is the renderer of the lowest mean,
    `ahead` the mean FLIP of the best rival minus ours, with its interval over the scenes.
    """
    rows: list[dict[str, Any]] = []
    every = [one for scene in scenes for one in scene]
    for kind, size in dict.fromkeys((one.kind, one.size) for one in every):
        here = [one for one in every if (one.kind, one.size) == (kind, size)]
        for budget in budgets:
            found = {group: _best(here, group, budget) for group in GROUPS}
            known = {group: points for group, points in found.items() if points}
            row: dict[str, Any] = {"kind": kind, "size": size, "budget": budget}
            row |= {"scenes": len(here), "first": None, "ahead": None}
            row |= {group: _summary(points) for group, points in found.items()}
            if known:
                row["first"] = min(known, key=lambda group: _mean(known[group], "flip"))
            rivals = [points for group, points in known.items() if group != OURS]
            if OURS in known and rivals:
                rival = min(rivals, key=lambda points: _mean(points, "flip"))
                pairs = zip(here, rival, known[OURS], strict=True)
                gains = {one.name: [theirs.flip - mine.flip] for one, theirs, mine in pairs}
                row["ahead"] = asdict(bootstrap(gains, 0))
            rows.append(row)
    return rows


def _best(scenes: Sequence[Measured], group: str, budget: float) -> list[Point] | None:
    """Return a renderer's picture of each scene in time; None where a scene has none."""
    if group == OURS:
        mine = [one.chosen(budget) for one in scenes]
        return [one for one in mine if one] if all(mine) else None
    methods = dict.fromkeys(p.method for one in scenes for p in one.rivals if p.group == group)
    best: list[Point] | None = None
    for method in methods:
        found: list[Point] = []
        for one in scenes:
            inside = [
                point
                for point in one.rivals
                if (point.group, point.method) == (group, method)
                and point.seconds <= WITHIN * budget
            ]
            found += [min(inside, key=lambda point: point.flip)] if inside else []
        complete = len(found) == len(scenes)
        if complete and (best is None or _mean(found, "flip") < _mean(best, "flip")):
            best = found
    return best


def _mean(points: Sequence[Point], name: str) -> float:
    return mean(getattr(point, name) for point in points)


def _summary(points: Sequence[Point] | None) -> dict[str, Any] | None:
    """Return methods, samples and means of a renderer's pictures, one of each scene."""
    if not points:
        return None
    return {
        "methods": sorted({point.method for point in points}),
        "spp": [point.spp for point in points],
        **{name: _mean(points, name) for name in ("seconds", "flip", "ssim")},
    }


def budget_plot(found: Sequence[Mapping[str, Any]]) -> bytes:
    """Return a PNG with a panel for each kind of scene and image size: FLIP by budget.

    Both axes are logarithmic; a line begins where the renderer has a picture of each scene.
    """
    kinds = list(dict.fromkeys(cell["kind"] for cell in found))
    sizes = list(dict.fromkeys(cell["size"] for cell in found))
    rows, columns = max(len(kinds), 1), max(len(sizes), 1)
    figure = Figure(figsize=(max(3.6 * columns, 7), 3.4 * rows), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(rows, columns, sharey=True, squeeze=False)
    handles: dict[str, Any] = {}
    for row, kind in enumerate(kinds):
        for column, size in enumerate(sizes):
            here = [cell for cell in found if (cell["kind"], cell["size"]) == (kind, size)]
            axes = panels[row][column]
            for group, title in GROUPS.items():
                line = [(cell["budget"], cell[group]["flip"]) for cell in here if cell[group]]
                if line:
                    colour, mark = _LINES[group]
                    (handles[title],) = axes.plot(
                        *zip(*line, strict=True), mark + "-", color=colour
                    )
            budgets = [cell["budget"] for cell in here]
            axes.set_xscale("log")
            axes.set_yscale("log")
            axes.set_xticks(budgets, [f"{budget:g}" for budget in budgets])
            axes.xaxis.set_minor_formatter(NullFormatter())
            for set_formatter in (axes.yaxis.set_major_formatter, axes.yaxis.set_minor_formatter):
                set_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axes.tick_params(which="both", labelsize=8)
            axes.set_title(f"{kind}, {size}", fontsize=10)
            axes.grid(True, which="both", axis="y", alpha=0.25)
    for axes in panels[-1]:
        axes.set_xlabel("seconds per image")
    for axes in panels[:, 0]:
        axes.set_ylabel("ꟻLIP (lower is better)")
    figure.legend(handles.values(), handles, loc="outside lower center", ncols=len(GROUPS))
    stream = io.BytesIO()
    figure.savefig(stream, format="png", metadata={"Software": None})
    return stream.getvalue()
