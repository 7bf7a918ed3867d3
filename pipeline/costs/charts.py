"""Charts of the cost ledger, and its table by stage.

`ledger_charts` selects the charts for which a ledger has data. The report draws each on a figure of
its own, `pbrnet inspect` all on one page (`draw_ledger`).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pbrnet.pipeline.channels import TRACED
from pbrnet.pipeline.plotting import SERIES, add_legend, style_axes
from pbrnet.scenes.arrays import Float64Array

STAGES = ("scenes", "cameras", "inputs", "illumination", "visibility", "shading", "color")
_TIMELINE = ("scenes", "cameras", "inputs", "illumination", "shading and color")
_ROWS = 16  # of the timeline
_BARS = 1500  # of the timeline; more would be thinner than a line
_DOTS = 1000  # of a scatter plot
_MAX_IDLE = 20.0  # idle seconds that the timeline still shows
_CUT = 5.0  # width of a longer idle time on the timeline, seconds

Row = Mapping[str, Any]


@dataclass(frozen=True)
class LedgerChart:
    """A chart with its title and caption; `draw` draws it on axes."""

    title: str
    caption: str
    draw: Callable[[Axes], None]


def ledger_charts(rows: Sequence[Row]) -> list[LedgerChart]:
    """Return the charts for which the rows of a ledger have data."""
    found = (
        _timeline_chart(rows),
        _seconds_chart(rows),
        _totals_chart(rows),
        _samples_chart(rows),
        _memory_chart(rows),
    )
    return [chart for chart in found if chart]


def draw_ledger(ledger: pa.Table) -> Figure:
    """Draw all charts of a ledger on one page, two in a row."""
    charts = ledger_charts(ledger.to_pylist())
    height = max(1, -(-len(charts) // 2))
    page = Figure(figsize=(12, 3.6 * height), dpi=100, layout="constrained")
    parts = page.subfigures(height, 2, squeeze=False)
    for part, chart in zip(parts.flat, charts, strict=False):
        part.suptitle(chart.title, fontsize=10)
        axes = part.subplots()
        style_axes(axes)
        chart.draw(axes)
    return page


def stages_first(names: Iterable[str]) -> list[str]:
    """Sort names of stages: in the order of the pipeline, unknown ones last."""
    return sorted(names, key=lambda name: (STAGES.index(name) if name in STAGES else 99, name))


def _group(row: Row) -> str:
    """Return the name of a row's series; frames of one trace share one."""
    return "shading and color" if row["stage"] in TRACED else str(row["stage"])


def _color(group: str) -> str:
    return SERIES[_TIMELINE.index(group) if group in _TIMELINE else len(_TIMELINE)]


def _spans(rows: Iterable[Row]) -> list[tuple[str, str, float, float]]:
    """Return (worker, group, begin, end) of all work with known times, by begin.

    Frames of one trace end at the same time and share its seconds: they are one span.
    """
    seconds: dict[tuple[str, str, float], float] = defaultdict(float)
    for row in rows:
        if row.get("ended") is not None and row["worker"] and _group(row) in _TIMELINE:
            seconds[row["worker"], _group(row), row["ended"].timestamp()] += row["seconds"]
    spans = [(worker, group, end - spent, end) for (worker, group, end), spent in seconds.items()]
    return sorted(spans, key=lambda span: span[2])


def _timeline_chart(rows: Sequence[Row]) -> LedgerChart | None:
    spans = _spans(rows)
    if not spans:
        return None
    lanes = _lanes(spans)
    count = max(lanes.values()) + 1
    bars: list[tuple[str, int, float, float]] = []  # group, lane, begin and end in minutes
    cuts, shift, until = [], spans[0][2], spans[0][2]
    for worker, group, begin, end in spans:
        if begin - until > _MAX_IDLE:
            cuts.append((until - shift + _CUT / 2) / 60)
            shift += begin - until - _CUT
        until = max(until, end)
        if lanes[worker] < _ROWS:
            bars.append((group, lanes[worker], (begin - shift) / 60, (end - shift) / 60))
    caption = (
        "Each row is a worker process and its replacements; each bar is a view or a scene"
        f"{_selection(count, len(bars))}."
    )
    if cuts:
        caption += " Dashed lines show idle times."
    bars = bars[:: -(-len(bars) // _BARS)]

    def draw(axes: Axes) -> None:
        height = min(count, _ROWS)
        for group in [name for name in _TIMELINE if any(bar[0] == name for bar in bars)]:
            mine = [bar for bar in bars if bar[0] == group]
            ends = np.array([(begin, end, np.nan) for _, _, begin, end in mine]).ravel()
            lane = np.array([(lane + 1.0,) * 3 for _, lane, _, _ in mine]).ravel()
            axes.plot(
                ends,
                lane,
                color=_color(group),
                linewidth=min(9.0, 110 / height),
                solid_capstyle="butt",
                label=group,
            )
        for cut in cuts:
            axes.axvline(cut, color=SERIES[-1], linestyle="--", linewidth=1)
        axes.set_ylim(height + 0.6, 0.4)
        axes.set_yticks(range(1, height + 1, 1 if height <= 8 else 4))
        axes.set_xlabel("minutes of work")
        add_legend(axes)

    return LedgerChart("Worker timeline", caption, draw)


def _lanes(spans: Sequence[tuple[str, str, float, float]]) -> dict[str, int]:
    """Assign a row to each worker; a worker may reuse the row of one that has ended."""
    lives: dict[str, tuple[float, float]] = {}
    for worker, _, begin, end in spans:
        first, last = lives.get(worker, (begin, end))
        lives[worker] = min(first, begin), max(last, end)
    free: list[float] = []  # end of the last worker of each row
    lanes = {}
    for worker, (begin, end) in sorted(lives.items(), key=lambda life: life[1]):
        lane = next((row for row, until in enumerate(free) if until <= begin), len(free))
        free[lane : lane + 1] = [end]
        lanes[worker] = lane
    return lanes


def _selection(rows: int, bars: int) -> str:
    parts = []
    if rows > _ROWS:
        parts.append(f"the first {_ROWS} of {rows} rows")
    if bars > _BARS:
        parts.append(f"every {-(-bars // _BARS)}th bar")
    return f" (shown: {' and '.join(parts)})" if parts else ""


def _seconds_chart(rows: Sequence[Row]) -> LedgerChart | None:
    seconds = _by_stage(rows)
    if not seconds:
        return None

    def draw(axes: Axes) -> None:
        axes.boxplot(
            list(seconds.values()), whis=(5, 95), sym=".", flierprops={"markersize": 2},
            medianprops={"color": SERIES[1]},
        )  # fmt: skip
        axes.set_xticks(range(1, len(seconds) + 1), list(seconds), rotation=30)
        axes.set_yscale("log")
        axes.set_ylabel("seconds")

    return LedgerChart("Seconds per item", "Boxes: quartiles; whiskers: 5 % to 95 %.", draw)


def _totals_chart(rows: Sequence[Row]) -> LedgerChart | None:
    totals = {stage: sum(values) for stage, values in _by_stage(rows).items()}
    if not totals:
        return None
    unit, name = (3600, "hours") if max(totals.values()) > 7200 else (60, "minutes")

    def draw(axes: Axes) -> None:
        axes.bar(list(totals), [value / unit for value in totals.values()], color=SERIES[0])
        axes.tick_params(axis="x", rotation=30)
        axes.set_ylabel(f"worker {name}")

    return LedgerChart("Total time by stage", "Sum over all workers.", draw)


def _by_stage(rows: Sequence[Row]) -> dict[str, list[float]]:
    """Return positive seconds of all items, by stage."""
    seconds: dict[str, list[float]] = defaultdict(list)
    for row in rows:
        if row["seconds"] > 0:
            seconds[row["stage"]].append(row["seconds"])
    return {stage: seconds[stage] for stage in stages_first(seconds)}


def _samples_chart(rows: Sequence[Row]) -> LedgerChart | None:
    """Return seconds of a view's ground truth over its samples if they differ, else its noise."""
    spent: dict[tuple[str, str], float] = defaultdict(float)
    facts: dict[tuple[str, str], Row] = {}
    for row in rows:
        if row["stage"] in TRACED and not row.get("first"):  # without opening and compiling
            key = (row["scene_id"], row["view_id"])
            spent[key] += row["seconds"]
            if row["stage"] != "light":
                facts[key] = row
    for column, name in (("spp", "samples per pixel"), ("noise", "relative noise")):
        points = [(facts[key][column], spent[key]) for key in facts if facts[key].get(column)]
        if len({x for x, _ in points}) > 1:
            return LedgerChart(
                f"Cost by {name}",
                "Shading and colour of a view, excluding each worker's first view of a scene.",
                _scatter(points[:: -(-len(points) // _DOTS)], name),
            )
    return None


def _scatter(points: Sequence[tuple[float, float]], label: str) -> Callable[[Axes], None]:
    def draw(axes: Axes) -> None:
        axes.plot(*np.transpose(points), ".", color=SERIES[0], alpha=0.6)
        axes.set_ylim(bottom=0)
        axes.set_xlabel(label)
        axes.set_ylabel("seconds")

    return draw


def _memory_chart(rows: Sequence[Row]) -> LedgerChart | None:
    known = [r for r in rows if r.get("ended") is not None and r.get("memory_mb") is not None]
    known.sort(key=lambda row: row["ended"])
    if len(known) < 2:
        return None
    peak = max(row["peak_mb"] or 0 for row in known)
    known = known[:: -(-len(known) // _DOTS)]
    groups = [_group(row) for row in known]

    def draw(axes: Axes) -> None:
        for group in stages_first(set(groups)):
            mine = [index for index, name in enumerate(groups) if name == group]
            memory = [known[index]["memory_mb"] for index in mine]
            axes.plot(
                [index + 1 for index in mine], memory, ".", color=_color(group), alpha=0.6,
                label=group,
            )  # fmt: skip
        axes.set_ylim(bottom=0)
        axes.set_xlabel("items, in order")
        axes.set_ylabel("MB")
        add_legend(axes)

    caption = f"Memory of the worker after each item. Peak of all workers: {peak:.0f} MB."
    return LedgerChart("Memory of the workers", caption, draw)


def ledger_table(ledger: pa.Table) -> list[dict[str, Any]]:
    """Return a row per stage: numbers of items, seconds, noise, file sizes and memory."""
    lines = []
    for stage in stages_first(ledger["stage"].unique().to_pylist()):
        rows = ledger.filter(pc.field("stage") == stage)
        seconds = _column(rows, "seconds")
        lines.append(
            {
                "stage": stage,
                "made": rows.num_rows,
                "again": int((_column(rows, "times") > 1).sum()),
                "retried": int((_column(rows, "attempt") > 1).sum()),
                "hours": round(float(seconds.sum()) / 3600, 3),
                "mean s": round(_mean(seconds), 3),
                "95 % below s": round(_quantile(seconds, 0.95), 3),
                "opening": f"{_mean(_column(rows, 'opening')) / max(_mean(seconds), 1e-9):.0%}",
                "noise": round(_mean(_column(rows, "noise")), 4),
                "MB": round(float(_column(rows, "bytes").sum()) / 1e6, 1),
                "peak MB": round(_quantile(_column(rows, "peak_mb"), 1.0)),
                "workers": len(rows["worker"].unique()),
            }
        )
    return lines


def _column(rows: pa.Table, name: str) -> Float64Array:
    """Return the values that are not null, float64."""
    return np.array(rows[name].drop_null().to_pylist(), dtype=np.float64)


def _mean(values: Float64Array) -> float:
    return float(values.mean()) if len(values) else 0.0


def _quantile(values: Float64Array, share: float) -> float:
    return float(np.quantile(values, share)) if len(values) else 0.0
