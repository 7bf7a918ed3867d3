"""The ledger drawn: every worker's time in its place, and nothing where nothing is known."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest

from model.figures.svg import Bar, scatter_plot, timeline
from model.report.cost_charts import cost_drawings

BEGIN = datetime(2026, 1, 1, tzinfo=UTC)


def _row(stage: str, view: int, ended: float, worker: str = "h:1", **more: Any) -> dict[str, Any]:
    facts = {"seconds": 10.0, "spp": None, "noise": None, "memory_mb": 500.0, "peak_mb": 600.0}
    key = {"stage": stage, "scene_id": "a", "view_id": f"{view:03}", "first": False}
    return {**key, **facts, "worker": worker, "ended": BEGIN + timedelta(seconds=ended), **more}


def _rects(svg: str) -> list[tuple[float, float, float, int]]:
    """x, y, width and colour of each bar."""
    pattern = r'<rect class="dot s(\d)" x="([\d.]+)" y="([\d.]+)" width="([\d.]+)"'
    return [(float(x), float(y), float(w), int(s)) for s, x, y, w in re.findall(pattern, svg)]


def test_bars_lie_where_their_time_is() -> None:
    svg = timeline([Bar(0, 0.0, 5.0, 0), Bar(1, 5.0, 10.0, 3)], 2, [5.0], "minutes")
    (x0, y0, w0, s0), (x1, y1, w1, s1) = _rects(svg)
    assert (s0, s1) == (0, 3) and y1 > y0
    assert x1 - x0 == pytest.approx(w0, abs=0.5) and w0 == pytest.approx(w1, abs=0.3)
    assert svg.count('class="cut"') == 1


def test_two_truths_of_one_trace_are_one_bar_and_idle_time_is_cut() -> None:
    rows = [_row("shading", 0, 20, seconds=5.0), _row("color", 0, 20, seconds=5.0)]
    rows += [_row("color", 1, 3600.0)]
    drawing = next(d for d in cost_drawings(rows) if d.title == "Who worked when")
    bars = _rects(drawing.svg)
    assert len(bars) == 2 and bars[0][2] == pytest.approx(bars[1][2], abs=0.3)
    assert 'class="cut"' in drawing.svg and "left out" in drawing.words
    assert drawing.legend == ((4, "shading and color"),)


def test_a_process_takes_the_row_of_one_that_has_ended() -> None:
    rows = [_row("inputs", 0, 10, "h:1"), _row("inputs", 1, 10, "h:2")]
    rows += [_row("inputs", 2, 25, "h:3"), _row("inputs", 3, 26, "h:4")]
    drawing = cost_drawings(rows)[0]
    assert len({y for _, y, _, _ in _rects(drawing.svg)}) == 2


def test_samples_are_shown_where_they_differ_else_noise() -> None:
    differ = [_row("color", view, 10 * view, spp=16 * (view + 1)) for view in range(4)]
    assert "What samples a pixel cost" in [drawing.title for drawing in cost_drawings(differ)]
    same = [_row("color", view, 10 * view, spp=16, noise=0.1 + view) for view in range(4)]
    assert "What noise cost" in [drawing.title for drawing in cost_drawings(same)]


def test_very_many_rows_make_a_small_drawing() -> None:
    rows = [
        _row("color", view, 11.0 * view, f"h:{view % 40}", spp=view + 1) for view in range(9999)
    ]
    drawings = cost_drawings(rows)
    assert len(drawings) == 3
    assert all(len(drawing.svg) < 300_000 for drawing in drawings)
    assert "every 7th bar" in drawings[0].words or "first 16 of 40 rows" in drawings[0].words


def test_an_old_ledger_without_times_draws_nothing_false() -> None:
    rows = [{**_row("color", view, 0), "ended": None, "memory_mb": None} for view in range(3)]
    assert cost_drawings(rows) == []
    assert scatter_plot([], "x", "y") == ""
