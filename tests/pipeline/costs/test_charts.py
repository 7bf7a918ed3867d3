"""Charts of the cost ledger: positions of bars, selection of charts, size."""

from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from matplotlib.axes import Axes

from pbrnet.pipeline.costs.charts import LedgerChart, draw_ledger, ledger_charts
from pbrnet.pipeline.costs.ledger import SCHEMA
from pbrnet.pipeline.plotting import SERIES, new_chart

BEGIN = datetime(2026, 1, 1, tzinfo=UTC)
Bar = tuple[float, float, float, str]  # begin and end in minutes, row, colour


def _row(stage: str, view: int, ended: float, worker: str = "h:1", **more: Any) -> dict[str, Any]:
    facts = {"seconds": 10.0, "spp": None, "noise": None, "memory_mb": 500.0, "peak_mb": 600.0}
    key = {"stage": stage, "scene_id": "a", "view_id": f"{view:03}", "first": False}
    return {**key, **facts, "worker": worker, "ended": BEGIN + timedelta(seconds=ended), **more}


def _chart(rows: list[dict[str, Any]], title: str) -> LedgerChart:
    return next(chart for chart in ledger_charts(rows) if chart.title == title)


def _drawn(chart: LedgerChart) -> Axes:
    _, axes = new_chart()
    chart.draw(axes)
    return axes


def _bars(axes: Axes) -> list[Bar]:
    """All bars of a timeline."""
    bars = []
    for line in axes.lines:
        points = np.asarray(line.get_xydata())
        if line.get_linestyle() == "-":
            for (begin, lane), (end, _) in zip(points[::3], points[1::3], strict=True):
                bars.append((float(begin), float(end), float(lane), str(line.get_color())))
    return bars


def test_bars_are_at_their_times_in_the_rows_of_their_workers() -> None:
    rows = [_row("inputs", 0, 10, seconds=10.0), _row("illumination", 1, 25, "h:2", seconds=15.0)]
    first, second = _bars(_drawn(_chart(rows, "Worker timeline")))
    assert first == pytest.approx((0, 10 / 60, 1, SERIES[2]))
    assert second[:2] == pytest.approx((10 / 60, 25 / 60)) and second[3] == SERIES[3]


def test_two_truths_of_one_trace_are_one_bar_and_idle_time_is_cut() -> None:
    rows = [_row("shading", 0, 20, seconds=5.0), _row("color", 0, 20, seconds=5.0)]
    rows += [_row("color", 1, 3600.0)]
    chart = _chart(rows, "Worker timeline")
    axes = _drawn(chart)
    bars = _bars(axes)
    assert len(bars) == 2
    assert bars[0][1] - bars[0][0] == pytest.approx(bars[1][1] - bars[1][0])
    assert [line.get_linestyle() for line in axes.lines].count("--") == 1
    assert "idle" in chart.caption
    assert axes.get_legend_handles_labels()[1] == ["shading and color"]


def test_a_process_takes_the_row_of_one_that_has_ended() -> None:
    rows = [_row("inputs", 0, 10, "h:1"), _row("inputs", 1, 10, "h:2")]
    rows += [_row("inputs", 2, 25, "h:3"), _row("inputs", 3, 26, "h:4")]
    assert {lane for _, _, lane, _ in _bars(_drawn(_chart(rows, "Worker timeline")))} == {1, 2}


def test_samples_are_shown_where_they_differ_else_noise() -> None:
    differ = [_row("color", view, 10 * view, spp=16 * (view + 1)) for view in range(4)]
    axes = _drawn(_chart(differ, "Cost by samples per pixel"))
    assert np.allclose(axes.lines[0].get_xydata(), [(16 * (n + 1), 10.0) for n in range(4)])
    same = [_row("color", view, 10 * view, spp=16, noise=0.1 + view) for view in range(4)]
    assert "Cost by relative noise" in [chart.title for chart in ledger_charts(same)]


def test_totals_are_sums_over_items_in_the_order_of_the_stages() -> None:
    rows = [_row("color", n, 10.0 * n, seconds=60.0) for n in range(3)] + [_row("inputs", 9, 99)]
    axes = _drawn(_chart(rows, "Total time by stage"))
    assert [patch.get_height() for patch in axes.patches] == pytest.approx([10 / 60, 3])  # type: ignore[attr-defined]
    assert [label.get_text() for label in axes.get_xticklabels()] == ["inputs", "color"]


def test_large_ledgers_are_thinned() -> None:
    rows = [
        _row("color", view, 11.0 * view, f"h:{view % 40}", spp=view + 1) for view in range(9999)
    ]
    timeline = _chart(rows, "Worker timeline")
    assert "the first 16 of 40 rows" in timeline.caption and "th bar" in timeline.caption
    assert 500 < len(_bars(_drawn(timeline))) <= 1500
    for title in ("Cost by samples per pixel", "Memory of the workers"):
        assert 500 < len(np.asarray(_drawn(_chart(rows, title)).lines[0].get_xydata())) <= 1000


def test_an_old_ledger_without_times_has_neither_timeline_nor_memory() -> None:
    rows = [{**_row("color", view, 0), "ended": None, "memory_mb": None} for view in range(3)]
    assert [chart.title for chart in ledger_charts(rows)] == [
        "Seconds per item", "Total time by stage"
    ]  # fmt: skip
    assert ledger_charts([]) == []


def test_all_charts_are_on_one_page() -> None:
    rows = [_row("inputs", view, 10.0 * view) for view in range(4)]
    columns = {name: [row.get(name) for row in rows] for name in SCHEMA.names}
    page = draw_ledger(pa.table(columns, schema=SCHEMA))
    page.draw_without_rendering()
    titles = [part.get_suptitle() for part in page.subfigs if part.axes]
    assert titles == [chart.title for chart in ledger_charts(rows)] and len(titles) == 4
    draw_ledger(SCHEMA.empty_table()).draw_without_rendering()
