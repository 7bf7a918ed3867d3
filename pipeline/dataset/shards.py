"""Parquet shards of bounded size, written one row group at a time, and checksums of files."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

import pyarrow as pa
import pyarrow.parquet as pq

from pbrnet.pipeline.dataset.columns import PREVIEW, Column, arrow_schema
from pbrnet.pipeline.dataset.parquet import image_cell
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import digest_file, read_text, write_text

# LZ4 is undone three times as fast as ZSTD and makes files 7 % larger: docs/dataset.md has figures.
LZ4_LEVEL = 4
# Most of the images in a row group, decoded, unless one row has more: viewers of data hubs refuse
# row groups of 286 MiB, and a random row costs the reading of a row group.
GROUP_BYTES = 64 << 20
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
SUMS = "SHA256SUMS"
SCENES = "scenes"  # folder of a release's scenes, beside the shards
_LINE = re.compile(rf"([0-9a-f]{{64}})  ((?:{SCENES}/)?[^/\0]+)")


class ShardWriter:
    """Writer of the rows of one split as row groups in files of bounded size.

    A row group holds `row_group` rows, fewer where their images exceed `GROUP_BYTES`.

    Keeps one row group in memory. `close` gives the shards their final names; after an exception
    the caller removes the folder.
    """

    def __init__(
        self, folder: Path, split: str, columns: tuple[Column, ...], row_group: int, cap: int
    ) -> None:
        self.folder, self.split, self.columns = folder, split, columns
        image_bytes = sum(each.image_bytes for each in columns)
        self.row_group = max(1, min(row_group, GROUP_BYTES // max(1, image_bytes)))
        self.cap = cap
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
        pictures = [column.name for column in self.columns if column.dtype == PREVIEW]
        plain = [name for name in self.schema.names if name not in (*images, *pictures)]
        tables = [name for name in TABLES if name in plain]
        leaves = set(_leaves(self.schema))
        pictured = {f"{name}.bytes" for name in pictures}
        self._writer = pq.ParquetWriter(
            self._stream,
            self.schema,
            compression={
                **dict.fromkeys(leaves, "zstd"),
                **dict.fromkeys(images, "lz4"),
                **dict.fromkeys(pictured, "none"),  # compressed already
            },
            compression_level={
                **dict.fromkeys(leaves - pictured, 3),
                **dict.fromkeys(images, LZ4_LEVEL),
            },
            use_dictionary=[*REPEATED, *tables],
            write_statistics=[name for name in plain if name not in TABLES],
            # Readers that use the index fetch single rows; hubs that store chunks by content keep
            # those that a new version of the dataset leaves as they are.
            write_page_index=True,
            use_content_defined_chunking=True,
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
        if column.is_image:
            dtype = column.numpy_dtype
            values = [image_cell(value.astype(dtype, copy=False)) for value in values]
        elif column.shape:
            values = [None if value is None else value.tolist() for value in values]
        arrays.append(pa.array(values, column.type))
    return pa.Table.from_arrays(arrays, schema=arrow_schema(columns))


def _leaves(schema: pa.Schema) -> list[str]:
    """Return the paths of all columns as Parquet stores them, those within lists too."""
    empty = pa.BufferOutputStream()
    pq.write_table(schema.empty_table(), empty)
    stored = pq.ParquetFile(empty.getvalue()).schema
    return [stored.column(index).path for index in range(len(stored))]


def write_sums(folder: Path) -> None:
    """Write the checksums of all files in `folder`, by name, as `sha256sum --check` reads them."""
    names = sorted(_names(folder))
    write_text(folder / SUMS, "".join(f"{digest_file(folder / name)}  {name}\n" for name in names))


def _names(folder: Path) -> set[str]:
    """The names of a dataset's files but `SUMS`, and of its scenes relative to `folder`."""
    paths = [*folder.iterdir(), *(folder / SCENES).glob("*")]
    return {path.relative_to(folder).as_posix() for path in paths if path.is_file()} - {SUMS}


def read_sums(path: Path) -> dict[str, str]:
    """Return the checksums that a `SHA256SUMS` file lists, by name; `InputError` for a bad file."""
    try:
        lines = read_text(path).splitlines()
    except InputError as error:
        raise InputError(f"{error}; make the checksums with: pbrnet dataset") from None
    listed = {}
    for line in lines:
        match = _LINE.fullmatch(line)
        if match is None:
            raise InputError(f"{path}: damaged, {line[:80]!r} is not a checksum of a file")
        listed[match[2]] = match[1]
    return listed


def verify_sums(folder: Path) -> int:
    """Compare all files with their checksums; return their number.

    Raises `InputError` that names every file that is missing, damaged or not listed.
    """
    path = Path(folder) / SUMS
    listed = read_sums(path)
    found = _names(path.parent)
    wrong = [f"{name} is missing" for name in sorted(set(listed) - found)]
    wrong += [f"{name} is not on the list" for name in sorted(found - set(listed))]
    for name in sorted(found & set(listed)):
        if digest_file(path.parent / name) != listed[name]:
            wrong.append(f"{name} is damaged")
    if wrong:
        raise InputError(f"{folder}: " + "; ".join(wrong) + "; make it again with: pbrnet dataset")
    return len(listed)
