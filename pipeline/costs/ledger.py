"""Ledger of costs: `data/ledger.parquet`, one row per scene, camera file and frame.

Costs describe the machines that did the work; no output depends on them. Frames of one trace share
its seconds evenly.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from pbrnet.scenes.errors import InputError, in_one_line
from pbrnet.scenes.files import atomic_file, regular_file

KEY = ("stage", "scene_id", "view_id")
# Largest credible values; a ledger may come from elsewhere.
_MOST = {
    "seconds": 1e9, "opening": 1e9, "threads": 1e6, "width": 1e6, "height": 1e6, "spp": 1e9,
    "bytes": 1e15, "peak_mb": 1e9, "memory_mb": 1e9, "times": 1e9, "attempt": 1e6,
}  # fmt: skip
SCHEMA = pa.schema(
    [
        pa.field("stage", pa.string(), metadata={"meaning": "stage or pass: scenes, ... color"}),
        pa.field("scene_id", pa.string()),
        pa.field("view_id", pa.string(), metadata={"meaning": "empty: the whole scene"}),
        pa.field("seconds", pa.float64(), metadata={"unit": "s"}),
        pa.field(
            "opening",
            pa.float64(),
            metadata={"unit": "s", "meaning": "part of seconds for opening the scene"},
        ),
        pa.field(
            "first", pa.bool_(), metadata={"meaning": "first item of this scene on its worker"}
        ),
        pa.field("threads", pa.int32(), metadata={"meaning": "threads of the worker"}),
        pa.field("width", pa.int32(), metadata={"unit": "px"}),
        pa.field("height", pa.int32(), metadata={"unit": "px"}),
        pa.field("spp", pa.int32(), metadata={"meaning": "samples per pixel; null: not sampled"}),
        pa.field("noise", pa.float64(), metadata={"meaning": "estimated relative error"}),
        pa.field("bytes", pa.int64(), metadata={"meaning": "size of the file"}),
        pa.field("peak_mb", pa.float64(), metadata={"meaning": "worker's peak memory, MB"}),
        pa.field("memory_mb", pa.float64(), metadata={"meaning": "worker's memory at the end, MB"}),
        pa.field("worker", pa.string(), metadata={"meaning": "host:process"}),
        pa.field("ended", pa.timestamp("ms", "UTC"), metadata={"meaning": "by the worker's clock"}),
        pa.field("attempt", pa.int32(), metadata={"meaning": "attempt of this run that succeeded"}),
        pa.field("times", pa.int32(), metadata={"meaning": "number of times made, over all runs"}),
        pa.field("renderer", pa.string()),
    ]
)


def ledger_path(data: Path) -> Path:
    """Return the path of a data folder's ledger."""
    return Path(data) / "ledger.parquet"


def read_ledger(data: Path) -> pa.Table:
    """Return all rows, sorted by `KEY`; an empty table if there is no ledger yet.

    Raises `InputError` if the file is damaged.
    """
    path = ledger_path(data)
    return read_ledger_file(path) if path.exists() else SCHEMA.empty_table()


def read_ledger_file(path: Path) -> pa.Table:
    """Return all rows of a ledger; raises `InputError` for damage and for impossible costs."""
    try:
        table = pq.read_table(regular_file(path), schema=SCHEMA)
    except (OSError, pa.ArrowException) as error:
        reason = in_one_line(error, 300)
        raise InputError(
            f"{path}: not a ledger of costs ({reason}); remove it and run the command again"
        ) from None
    for name in (*KEY, "seconds"):
        if table[name].null_count:
            raise InputError(f"{path}: a row without {name}; remove it and run the command again")
    for name, most in _MOST.items():
        values = table[name].drop_null().to_numpy()
        if not np.isfinite(values).all() or ((values < 0) | (values > most)).any():
            raise InputError(
                f"{path}: impossible values of {name}; remove it and run the command again"
            )
    return table


class Ledger:
    """Writer of a data folder's ledger: every `every` seconds and by `save`, by rename.

    A scene, camera file or frame that is made again replaces its row, and `times` increases.
    """

    def __init__(self, data: Path, every: float = 30.0) -> None:
        self.path, self.every = ledger_path(data), every
        self._table = read_ledger(data)
        self._new: dict[tuple[str, ...], dict[str, Any]] = {}
        self._saved = time.monotonic()

    def add(self, key: tuple[str, str, str], **costs: Any) -> None:
        """Add the row of a stage, scene and view; `costs` are columns, missing ones are null."""
        unknown = set(costs) - set(SCHEMA.names)
        if unknown:
            raise ValueError(f"no column {sorted(unknown)} in the ledger")
        before = self._new.get(key, {}).get("times", 0)
        self._new[key] = {**dict(zip(KEY, key, strict=True)), **costs, "times": before + 1}
        if time.monotonic() - self._saved >= self.every:
            self.save()

    def save(self) -> None:
        """Write the rows that were added since the last save."""
        if not self._new:
            return
        started = time.monotonic()
        old = pc.binary_join_element_wise(*(self._table[name] for name in KEY), "/")
        known = pc.is_in(old, value_set=pa.array(["/".join(key) for key in self._new]))
        for row in self._table.filter(known).select([*KEY, "times"]).to_pylist():
            self._new[tuple(row[name] for name in KEY)]["times"] += row["times"]
        fresh = pa.Table.from_pylist(list(self._new.values()), schema=SCHEMA)
        table = pa.concat_tables([self._table.filter(pc.invert(known)), fresh])
        self._table = table.sort_by([(name, "ascending") for name in KEY])
        with atomic_file(self.path) as partial:
            pq.write_table(self._table, partial, compression="zstd")
        self._new.clear()
        self._saved = time.monotonic()
        # Writing takes longer as the table grows: spend at most a twentieth of the time on it.
        self.every = max(self.every, 20 * (self._saved - started))
