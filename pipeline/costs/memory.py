"""Memory of a process as columns of the ledger."""

from __future__ import annotations

import resource

import psutil


def memory_columns() -> dict[str, float]:
    """Return this process's ledger columns: its memory now and its peak so far, in MB."""
    now = psutil.Process().memory_info().rss / (1 << 20)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {"memory_mb": now, "peak_mb": max(now, peak)}
