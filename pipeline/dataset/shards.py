"""Parquet shards of bounded size, written one row group at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.dataset.columns import Column, arrow_schema

# Text columns whose values recur from row to row.
REPEATED = (
    "scene_id",
    "split",
    "room_type",
    "lighting",
    "renderer",
    "source",
    "licence",
    "attribution",
)
# Text columns that are long: JSON, and lists of names.
TABLES = ("instances", "layout", "light_sources", "material_names")


class ShardWriter:
    """Writer of the rows of one split as row groups in files of bounded size.

    Keeps one row group in memory. `close` gives the shards their final names; after an exception
    the caller removes the folder.
    """

    def __init__(
        self, folder: Path, split: str, columns: tuple[Column, ...], row_group: int, cap: int
    ) -> None:
        self.folder, self.split, self.columns = folder, split, columns
        self.row_group, self.cap = row_group, cap
        self.schema = arrow_schema(columns)
        self._rows: list[dict[str, Any]] = []
        self._parts: list[Path] = []
        self._last_group = 0
        self._stream: BinaryIO | None = None
        self._writer: pq.ParquetWriter | None = None

    def add(self, row: Mapping[str, Any]) -> None:
        """Add a row; write a row group once there are enough rows."""
        self._rows.append(dict(row))
        if len(self._rows) >= self.row_group:
            self._flush()

    def close(self) -> list[str]:
        """Write the remaining rows and name the files `<split>-00000-of-0000N.parquet`."""
        if self._rows:
            self._flush()
        self._finish()
        names = []
        for index, part in enumerate(self._parts):
            name = f"{self.split}-{index:05d}-of-{len(self._parts):05d}.parquet"
            part.replace(self.folder / name)
            names.append(name)
        return names

    def abandon(self) -> None:
        """Close the open file, whether or not it can be completed."""
        if self._writer is not None:
            # On a full disk the footer fails as the rows before it did.
            with suppress(OSError, pa.ArrowException):
                self._writer.close()
            self._writer = None
        if self._stream is not None:
            self._stream.close()
            self._stream = None

    def _flush(self) -> None:
        if self._stream is not None and self._stream.tell() + self._last_group > self.cap:
            self._finish()
        if self._stream is None:
            self._open()
        assert self._stream is not None and self._writer is not None
        before = self._stream.tell()
        self._writer.write_table(to_table(self._rows, self.columns), row_group_size=self.row_group)
        self._last_group = self._stream.tell() - before
        self._rows.clear()

    def _open(self) -> None:
        part = self.folder / f"{self.split}-{len(self._parts):05d}.part"
        self._parts.append(part)
        self._stream = part.open("wb")
        images = [column.name for column in self.columns if column.is_image]
        # Exact floats rarely repeat, but their exponent bytes do: split the bytes, skip the
        # dictionary. `valid` is all runs of 0 and 1, which a dictionary packs to bits.
        floats = [column.name for column in self.columns if column.is_image and _is_float(column)]
        plain = [name for name in self.schema.names if name not in images]
        counted = [column for column in self.columns if column.is_image and not _is_float(column)]
        labels = [f"{column.name}.list.element" for column in counted if column.name != "valid"]
        tables = [name for name in TABLES if name in plain]
        self._writer = pq.ParquetWriter(
            self._stream,
            self.schema,
            compression="zstd",
            compression_level=3,
            use_dictionary=[*REPEATED, *tables, "valid.list.element", *labels],
            use_byte_stream_split=[f"{name}.list.element" for name in floats],
            write_statistics=[name for name in plain if name not in ("preview", *TABLES)],
        )

    def _finish(self) -> None:
        if self._writer is not None:
            self._writer.close()
            self._writer = None
        if self._stream is not None:
            self._stream.close()
            self._stream = None


def to_table(rows: Sequence[Mapping[str, Any]], columns: tuple[Column, ...]) -> pa.Table:
    """Return rows as an Arrow table of `arrow_schema(columns)`."""
    arrays = []
    for column in columns:
        values = [row[column.name] for row in rows]
        if column.shape:
            for value in values:
                if value is not None and value.shape != column.shape:
                    raise ValueError(f"{column.name}: shape {value.shape}, not {column.shape}")
            missing = [value is None for value in values]
            cells = [np.zeros(column.shape) if value is None else value for value in values]
            flat = np.concatenate([np.ascontiguousarray(value).reshape(-1) for value in cells])
            arrays.append(
                pa.FixedSizeListArray.from_arrays(
                    pa.array(flat, column.dtype),
                    type=column.type,
                    mask=pa.array(missing) if any(missing) else None,
                )
            )
        else:
            arrays.append(pa.array(values, column.type))
    return pa.Table.from_arrays(arrays, schema=arrow_schema(columns))


def _is_float(column: Column) -> bool:
    return bool(pa.types.is_floating(column.dtype))
