"""The cost ledger as a table by stage."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa

from pbrnet.pipeline.costs.charts import stages_first
from pbrnet.pipeline.costs.ledger import SCHEMA
from pbrnet.scenes.arrays import Float64Array


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


def _by_stage(ledger: pa.Table) -> list[tuple[str, pa.Table]]:
    names = stages_first(ledger["stage"].unique().to_pylist())
    stages = np.array(ledger["stage"].to_pylist())
    return [(name, ledger.filter(pa.array(stages == name))) for name in names]


def _column(rows: pa.Table, name: str) -> Float64Array:
    """Return the values that are not null, float64."""
    return np.array(rows[name].drop_null().to_pylist(), dtype=np.float64)


def _mean(values: Float64Array) -> float:
    return float(values.mean()) if len(values) else 0.0


def _quantile(values: Float64Array, share: float) -> float:
    return float(np.quantile(values, share)) if len(values) else 0.0
