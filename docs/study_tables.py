"""Tables of the studies for docs/results.md, from the files of `pbrnet study all --docs docs`."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from statistics import mean
from typing import Any

from pbrnet.model.figures.estimates import with_interval
from pbrnet.model.studies.illumination.results import CHANGES
from pbrnet.model.studies.photographs.results import HEADINGS, digits
from pbrnet.model.studies.trials.words import COMPARISONS

BUDGETS = (0.1, 0.2, 0.5, 1, 2, 5)  # seconds
OURS = ("pbrnet", "product", "plus", "hybrid", "radiosity", "planned_denoised")
RAW = ("mitsuba", "planned")  # renderers without a denoiser
SIZES = ("160x120", "480x360", "960x720")
MEASURES = {"ssim": ("SSIM", 3), "psnr": ("PSNR, dB", 1), "flip": ("FLIP", 3)}
FURTHER = {"detail": ("detail, dB", 1), "grid": ("grid", 2), "specular_flip": ("FLIP, glossy", 3)}
Rows = list[list[str]]


def study_tables(folder: Path, prefix: str = "study") -> dict[str, Rows]:
    """Rows of each table by its name in the text; without those whose file is missing."""
    sources: dict[str, Callable[[Any], Rows]] = dict.fromkeys(COMPARISONS, trials_table)
    sources["illumination"] = illumination_table
    sources |= {f"time-{size}": time_table for size in SIZES}
    tables = {
        f"{prefix}-{name}": table(json.loads(path.read_text()))
        for name, table in sources.items()
        if (path := folder / f"{name}.json").is_file()
    }
    times = {
        size: json.loads(path.read_text())
        for size in SIZES
        if (path := folder / f"time-{size}.json").is_file()
    }
    if times:
        tables[f"{prefix}-budgets"] = budget_table(times)
        tables[f"{prefix}-equal-time"] = equal_time_table(times)
    moves = [json.loads(path.read_text()) for path in sorted(folder.glob("flicker-*.json"))]
    if moves:
        tables[f"{prefix}-flicker"] = flicker_table(moves)
    return tables


def photographs_table(found: dict[str, Any], measures: Sequence[str] = tuple(HEADINGS)) -> Rows:
    """Rows of the study of photographs, with intervals over runs of photographs."""
    rows = [["trained on", "pictures", "trainings", *(HEADINGS[name] for name in measures)]]
    for name in found["order"]:
        row = found["rows"][name]
        cells = [
            "–"
            if (one := row[measure]) is None
            else with_interval(one["mean"], one["low"], one["high"], digits(measure))
            for measure in measures
        ]
        rows.append([name, str(row["views"]), str(row["seeds"]), *cells])
    return rows


def trials_table(found: dict[str, Any]) -> Rows:
    """Rows of a study that compares trainings; the last column is relative to its reference."""
    labels = COMPARISONS[found["study"]].titles
    reference = found["reference"]
    rows = [row for row in found["rows"] if row["label"] != "truth"]
    further = {
        name: words
        for name, words in FURTHER.items()
        if any(row["metrics"].get(name) for row in rows)
    }
    measures = {**MEASURES, **further}
    groups = len({row["group"] for row in rows}) > 1
    head = [
        *(["group"] if groups else []),
        *("method", "training views", *(title for title, _ in measures.values())),
        f"FLIP relative to `{reference}`",
    ]
    table = [head]
    for row in rows:
        gain = row["metrics"]["flip"]
        table.append(
            [
                *([row["group"]] if groups else []),
                f"{labels.get(row['label'], row['label'])}, `{row['label']}`",
                "" if row["views"] is None else f"{row['views']:g}",
                *(_estimate(row["metrics"].get(name), d) for name, (_, d) in measures.items()),
                _signed(gain["gain"], gain["gain_low"], gain["gain_high"]) if gain else "",
            ]
        )
    return table


def illumination_table(found: dict[str, Any]) -> Rows:
    """Rows of pattern, gain and correct sign by kind of change and method."""
    table = [["change", "views", "method", "pattern", "gain", "correct sign"]]
    for name, title in CHANGES.items():
        change = found["changes"].get(name)
        if change is None or change["reference"] != "rendered":
            continue
        for method, figures in change["methods"].items():
            gain, sign = figures["gain"], figures["sign"]
            table.append(
                [
                    *(title, str(change["views"]), f"`{method}`"),
                    _interval(figures["pattern"], 2),
                    "" if gain is None else f"{gain['value']:.2f}",
                    "" if sign is None else f"{100 * sign['value']:.0f} %",
                ]
            )
    return table


def time_table(found: dict[str, Any]) -> Rows:
    """Rows of methods, the fastest first, without raw samples; the best so far in bold."""
    table = [["method", "samples", "seconds", "FLIP", "SSIM"]]
    best = 1.0
    points = [point for point in found["points"] if point["method"] not in RAW]
    for point in sorted(points, key=lambda point: point["seconds"]):
        flip = f"{point['flip']:.3f}"
        if point["flip"] < best:
            best, flip = point["flip"], f"**{flip}**"
        samples = "" if point["spp"] is None else str(point["spp"])
        row = [f"`{point['method']}`", samples, f"{point['seconds']:.2f}", flip]
        table.append([*row, f"{point['ssim']:.3f}"])
    return table


def budget_table(times: dict[str, dict[str, Any]]) -> Rows:
    """Rows of time budgets: at each size the best of this project, then of Mitsuba's `path`."""
    table = [["seconds", *(f"{size}: {who}" for size in times for who in ("ours", "`path`"))]]
    for budget in BUDGETS:
        row = [f"{budget:g}"]
        for found in times.values():
            within = [p for p in found["points"] if p["seconds"] <= budget]
            for theirs in (False, True):
                methods = ("mitsuba_denoised",) if theirs else OURS
                points = [p for p in within if p["method"] in methods]
                best = min(points, key=lambda point: point["flip"], default=None)
                row.append("–" if best is None else _point(best))
        table.append(row)
    return table


def equal_time_table(times: dict[str, dict[str, Any]]) -> Rows:
    """Rows of methods with light transport: their FLIP, and the path tracers' in as many seconds.

    The path tracers' errors are interpolated between numbers of samples, logarithms of error and
    seconds; none where a method takes less or more time than any of them.
    """
    rivals = {"planned_denoised": "joint trace, denoised", "mitsuba_denoised": "`path`, denoised"}
    head = ["size", "method", "samples", "seconds", "FLIP", *rivals.values()]
    table = [[*head, "views ahead of the joint trace with the same samples"]]
    for size, found in times.items():
        for point in found["points"]:
            if point["method"] not in ("radiosity", "plus", "hybrid"):
                continue
            others = [_in_time(found["points"], name, point["seconds"]) for name in rivals]
            samples = "" if point["spp"] is None else str(point["spp"])
            ahead = found["better"].get(f"{point['method']} {samples}".strip())
            table.append(
                [
                    *(size, f"`{point['method']}`", samples, f"{point['seconds']:.2f}"),
                    f"{point['flip']:.3f}",
                    *("–" if flip is None else f"{flip:.3f}" for flip in others),
                    "" if ahead is None else f"{ahead} of {found['views']}",
                ]
            )
    return table


def _in_time(points: list[dict[str, Any]], method: str, seconds: float) -> float | None:
    """Return the interpolated FLIP of a method in so many seconds; None outside of its times."""
    known = sorted((p["seconds"], p["flip"]) for p in points if p["method"] == method)
    for (short, worse), (long, better) in pairwise(known):
        if short <= seconds <= long:
            share = math.log(seconds / short) / math.log(long / short)
            return float(worse ** (1 - share) * better**share)
    return None


def _point(point: dict[str, Any]) -> str:
    samples = "" if point["spp"] is None else f" {point['spp']}"
    return f"{point['flip']:.3f} (`{point['method']}{samples}`)"


RENDERERS = {"ours": "ours", "path": "`path`, denoised", "cycles": "Blender Cycles, denoised"}


def rival_table(found: dict[str, Any]) -> Rows:
    """Rows of kinds of scenes, sizes and budgets: FLIP of the best pictures of each renderer."""
    table = [["scenes", "size", "seconds", *RENDERERS.values(), "best other - ours"]]
    for cell in found["cells"]:
        row = [f"{cell['scenes']} {cell['kind']}", cell["size"], f"{cell['budget']:g}"]
        for group in RENDERERS:
            picture = cell[group]
            if picture is None:
                row.append("–")
                continue
            flip = f"{picture['flip']:.3f}"
            flip = f"**{flip}**" if group == cell["first"] else flip
            row.append(f"{flip} ({', '.join(picture['methods'])}; {_range(picture['spp'])})")
        ahead = cell["ahead"]
        row.append(
            with_interval(ahead["mean"], ahead["low"], ahead["high"], 3, "+") if ahead else ""
        )
        table.append(row)
    return table


def _range(numbers: list[int]) -> str:
    few, many = min(numbers), max(numbers)
    return f"{few}" if few == many else f"{few} to {many}"


def rival_words(found: dict[str, Any]) -> str:
    """Sentences on conditions, and on the cells in which this project's picture is not first."""
    every = found["measured"]
    sizes = dict.fromkeys(one["size"] for one in every)
    references = (
        f"at {size} {max(one['spp'] for one in every if one['size'] == size)} samples, FLIP "
        f"{mean(one['between'] for one in every if one['size'] == size):.3f}"
        for size in sizes
    )
    clock = "elapsed" if found["clock"] == "wall" else "processor"
    left_out = ", ".join(found["left_out"]) or "none"
    trained = found["trained_views"]
    sentences = [
        "" if found["sizes"] == "full" else "**A trial run; its figures mean nothing.**",
        f"One view of each scene; {clock} seconds of {found['processors']} processors "
        f"({found['processor']}), of which other programs used {found['others_busy']:.1f}; Blender "
        f"{found['blender']}.",
        f"Samples of each long render, and FLIP between the two: {'; '.join(references)}.",
        f"Scenes left out because the renderers disagree: {left_out}.",
        f"`hybrid` was trained on other homes, on {trained} views." if trained else "",
        _not_first(found["cells"]),
    ]
    return " ".join(filter(None, sentences))


def tried_table(found: dict[str, Any]) -> Rows:
    """Rows of what the rivals' settings were chosen from: FLIP by kind of scene and budget."""
    tried: dict[str, dict[str, float]] = found["tried"]
    names = dict.fromkeys(name for flips in tried.values() for name in flips)
    return [["setting", *tried]] + [
        [name, *(f"{flips[name]:.3f}" if name in flips else "–" for flips in tried.values())]
        for name in names
    ]


def first_picture_table(found: dict[str, Any]) -> Rows:
    """Rows of the seconds until a renderer's first picture."""
    return [["renderer", "elapsed seconds", "processor seconds"]] + [
        [one["renderer"], f"{one['wall']:.1f}", f"{one['cpu']:.1f}"]
        for one in found["first_pictures"]
    ]


def _not_first(cells: list[dict[str, Any]]) -> str:
    ours = [cell for cell in cells if cell["first"] == "ours"]
    lost = [cell for cell in cells if cell["first"] not in ("ours", None)]
    nobody = [cell for cell in cells if cell["first"] is None]
    tried = len(cells) - len(nobody)
    text = f"**Ours is first in {len(ours)} of {tried} cells in which any renderer finishes.**"
    if lost:
        words = (f"{_place(cell)} in {cell['budget']:g} s ({cell['first']})" for cell in lost)
        text += f" It is not first at {', '.join(words)}."
    budgets: dict[str, list[str]] = {}
    for cell in nobody:
        budgets.setdefault(_place(cell), []).append(f"{cell['budget']:g}")
    if nobody:
        words = (f"{place} in {', '.join(times)} s" for place, times in budgets.items())
        text += f" No renderer finishes an image of every scene at {'; '.join(words)}."
    return text


def _place(cell: dict[str, Any]) -> str:
    return f"{cell['kind']} {cell['size']}"


def flicker_table(moves: list[dict[str, Any]]) -> Rows:
    """Rows of the mean difference of neighbouring frames over several moves."""
    methods = dict.fromkeys(name for move in moves for name in move["methods"])
    table = [["method", "mean", "relative to the renderer", f"range over {len(moves)} scenes"]]
    for name in methods:
        known = [move["methods"] for move in moves if name in move["methods"]]
        values = [each[name]["mean"] for each in known]
        times = [each[name]["mean"] / each["renderer"]["mean"] for each in known]
        mine = [f"`{name}`", f"{mean(values):.4f}", f"{mean(times):.2f}"]
        table.append([*mine, f"{min(times):.2f}, {max(times):.2f}"])
    return table


def _estimate(figure: dict[str, Any] | None, digits: int) -> str:
    if figure is None:
        return ""
    text = with_interval(figure["mean"], figure["low"], figure["high"], digits)
    return text + ("" if figure["spread"] is None else f" ±{figure['spread']:.{digits}f}")


def _signed(value: float | None, low: float | None, high: float | None) -> str:
    return "" if value is None else with_interval(value, low, high, 3, "+")


def _interval(figure: dict[str, Any] | None, digits: int) -> str:
    if figure is None:
        return ""
    return with_interval(figure["value"], figure["low"], figure["high"], digits)
