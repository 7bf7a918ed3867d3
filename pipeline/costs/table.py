"""Summary of the ledger by stage, as a table and as a figure."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
from matplotlib.figure import Figure

from pipeline.costs.ledger import SCHEMA
from scenes.arrays import Float64Array

_ORDER = ("scenes", "cameras", "inputs", "illumination", "visibility", "shading", "color")
_COLOR = "#3b76af"


def is_ledger(schema: pa.Schema) -> bool:
    """Return whether a Parquet schema is that of a ledger."""
    return set(SCHEMA.names) <= set(schema.names)


def ledger_table(ledger: pa.Table) -> list[dict[str, Any]]:
    """Return a row per stage: numbers of items, seconds, noise, file sizes and memory."""
    lines = []
    for stage, rows in _by_stage(ledger):
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


def draw_ledger(ledger: pa.Table) -> Figure:
    """Draw the seconds per item and stage, the hours per stage, and the workers' peak memory."""
    stages = _by_stage(ledger)
    names = [stage for stage, _ in stages]
    page = Figure(figsize=(12, 4), dpi=100, layout="constrained")
    spread, total, memory = page.subplots(1, 3)
    spread.boxplot([_column(rows, "seconds") for _, rows in stages], whis=(5, 95), sym=".")
    spread.set_xticks(range(1, len(names) + 1), names, rotation=30)
    spread.set_yscale("log")
    spread.set_title("seconds per item (box: 50 %, whiskers: 90 %)", fontsize=10)
    total.bar(names, [_column(rows, "seconds").sum() / 3600 for _, rows in stages], color=_COLOR)
    total.tick_params(axis="x", rotation=30)
    total.set_title("worker-hours", fontsize=10)
    peaks = _column(ledger, "peak_mb")
    memory.hist(peaks, bins=30, color=_COLOR)
    memory.set_xlabel("MB")
    memory.set_title("peak memory of the worker, by item", fontsize=10)
    return page


def _by_stage(ledger: pa.Table) -> list[tuple[str, pa.Table]]:
    found = ledger["stage"].unique().to_pylist()
    known = [stage for stage in _ORDER if stage in found]
    names = known + sorted(set(found) - set(known))
    stages = np.array(ledger["stage"].to_pylist())
    return [(name, ledger.filter(pa.array(stages == name))) for name in names]


def _column(rows: pa.Table, name: str) -> Float64Array:
    """Return the values that are not null, float64."""
    return np.array(rows[name].drop_null().to_pylist(), dtype=np.float64)


def _mean(values: Float64Array) -> float:
    return float(values.mean()) if len(values) else 0.0


def _quantile(values: Float64Array, share: float) -> float:
    return float(np.quantile(values, share)) if len(values) else 0.0
