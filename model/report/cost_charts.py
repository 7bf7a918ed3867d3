"""What the ledger shows when it is drawn: who worked when, what samples cost, how memory went."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from model.figures.svg import Bar, scatter_plot, timeline

_STAGES = ("scenes", "cameras", "inputs", "illumination", "truth")
_TRUTHS = ("shading", "color")
_WORKERS = 16  # rows of the timeline
_BARS = 1500  # on the timeline; the rest would be thinner than a line
_DOTS = 2000
_IDLE = 20.0  # seconds without any work that the timeline still shows
_CUT = 5.0  # seconds that stand for longer ones

Row = Mapping[str, Any]


@dataclass(frozen=True)
class Drawing:
    """A chart with its title, a sentence and the stages it tells apart (place of colour, name)."""

    title: str
    svg: Markup
    words: str
    legend: tuple[tuple[int, str], ...] = ()


def cost_drawings(rows: Sequence[Row]) -> list[Drawing]:
    """The charts for which a ledger's rows hold figures."""
    found = (_workers_drawing(rows), _samples_drawing(rows), _memory_drawing(rows))
    return [drawing for drawing in found if drawing]


def _stage(row: Row) -> str:
    return "truth" if row["stage"] in _TRUTHS else str(row["stage"])


def _legend(stages: Iterable[str]) -> tuple[tuple[int, str], ...]:
    present = set(stages)
    names = {"truth": "shading and color"}
    known = [(place, stage) for place, stage in enumerate(_STAGES) if stage in present]
    return tuple((place, names.get(stage, stage)) for place, stage in known)


def _spans(rows: Iterable[Row]) -> list[tuple[str, str, float, float]]:
    """(worker, stage, begin, end) of everything whose time is known, by begin.

    Frames of one trace were made at one time and share its seconds: they are one span.
    """
    seconds: dict[tuple[str, str, float], float] = defaultdict(float)
    for row in rows:
        if row.get("ended") is not None and row["worker"] and _stage(row) in _STAGES:
            seconds[row["worker"], _stage(row), row["ended"].timestamp()] += row["seconds"]
    spans = [(worker, stage, end - spent, end) for (worker, stage, end), spent in seconds.items()]
    return sorted(spans, key=lambda span: span[2])


def _workers_drawing(rows: Sequence[Row]) -> Drawing | None:
    spans = _spans(rows)
    if not spans:
        return None
    lanes = _lanes(spans)
    count = max(lanes.values()) + 1
    bars, cuts, shift, until = [], [], spans[0][2], spans[0][2]
    for worker, stage, begin, end in spans:
        if begin - until > _IDLE:
            cuts.append((until - shift + _CUT / 2) / 60)
            shift += begin - until - _CUT
        until = max(until, end)
        if lanes[worker] < _WORKERS:
            left, right = (begin - shift) / 60, (end - shift) / 60
            bars.append(Bar(lanes[worker], left, right, _STAGES.index(stage)))
    words = "Each row is a worker process, and those that came after it; each bar is a view or a "
    words += f"scene{_left_out(count, bars)}."
    if cuts:
        words += " Dashed: nobody worked for a while, and that time is left out."
    bars = bars[:: -(-len(bars) // _BARS)]
    svg = timeline(bars, min(count, _WORKERS), cuts, "minutes of work")
    return Drawing("Who worked when", svg, words, _legend(stage for _, stage, *_ in spans))


def _lanes(spans: Sequence[tuple[str, str, float, float]]) -> dict[str, int]:
    """A row for each worker; one that begins after another's end may take its row."""
    lives: dict[str, tuple[float, float]] = {}
    for worker, _, begin, end in spans:
        first, last = lives.get(worker, (begin, end))
        lives[worker] = min(first, begin), max(last, end)
    free: list[float] = []  # when the last worker of each row was done
    lanes = {}
    for worker, (begin, end) in sorted(lives.items(), key=lambda life: life[1]):
        lane = next((row for row, until in enumerate(free) if until <= begin), len(free))
        free[lane : lane + 1] = [end]
        lanes[worker] = lane
    return lanes


def _left_out(rows: int, bars: Sequence[Bar]) -> str:
    parts = []
    if rows > _WORKERS:
        parts.append(f"the first {_WORKERS} of {rows} rows")
    if len(bars) > _BARS:
        parts.append(f"every {-(-len(bars) // _BARS)}th bar")
    return f" ({' and '.join(parts)} only)" if parts else ""


def _samples_drawing(rows: Sequence[Row]) -> Drawing | None:
    """Seconds of a view's truth against its samples if they differ, else against its noise."""
    spent: dict[tuple[str, str], float] = defaultdict(float)
    facts: dict[tuple[str, str], Row] = {}
    for row in rows:
        if row["stage"] in _TRUTHS and not row.get("first"):  # without opening and compiling
            key = (row["scene_id"], row["view_id"])
            spent[key] += row["seconds"]
            facts[key] = row
    for column, label in (("spp", "samples a pixel"), ("noise", "noise, relative")):
        points = [(facts[key][column], spent[key]) for key in spent if facts[key].get(column)]
        if len({x for x, _ in points}) > 1:
            points = points[:: -(-len(points) // _DOTS)]
            words = "Shading and color of a view together, but for each worker's first of a scene."
            return Drawing(
                f"What {label.partition(',')[0]} cost",
                scatter_plot(points, label, "seconds"),
                words,
            )
    return None


def _memory_drawing(rows: Sequence[Row]) -> Drawing | None:
    known = [r for r in rows if r.get("ended") is not None and r.get("memory_mb") is not None]
    known.sort(key=lambda row: row["ended"])
    if len(known) < 2:
        return None
    known = known[:: -(-len(known) // _DOTS)]
    points = [(place + 1.0, row["memory_mb"]) for place, row in enumerate(known)]
    groups = [_STAGES.index(_stage(row)) if _stage(row) in _STAGES else 5 for row in known]
    peak = max(row["peak_mb"] or 0 for row in known)
    words = (
        f"Of the worker, after each thing it made, in order. The most at any time: {peak:.0f} MB."
    )
    svg = scatter_plot(points, "things made", "MB", groups, zero=True)
    return Drawing("Memory of the workers", svg, words, _legend(_stage(row) for row in known))
