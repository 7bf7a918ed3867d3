"""Rows about formats of the dataset's images: size, reading all rows, reading single rows.

The same images, in the types of the dataset, in each format; the readers give NumPy arrays of these
types, with two threads, files in the page cache. Truth is denoised, as in datasets: noise does not
compress.
"""

from __future__ import annotations

import io
import os
import tarfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from benchmarks.bench import Bench
from benchmarks.rows import Row, at_least, at_most
from benchmarks.shards import KINDS, frames_of, keep_channels_of_rows, read_exr, views_of
from benchmarks.timing import by_turns, ratio, spread
from pbrnet.pipeline.channels import dataset_channels
from pbrnet.pipeline.dataset.checks import Frames
from pbrnet.pipeline.dataset.light import in_row_unit
from pbrnet.pipeline.dataset.parquet import image_cell, images_of
from pbrnet.pipeline.dataset.rows import image_cells
from pbrnet.pipeline.frames import frame_path, read_frame
from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import AnyArray

Images = dict[str, AnyArray]  # of one row, by column
_TURNS = 5
_GROUP = 4  # rows of a row group
_SINGLE = 8  # rows that are read singly in one turn
Encode = Callable[[AnyArray], bytes]
Decode = Callable[[pa.Table, str], Sequence[AnyArray]]


@dataclass(frozen=True)
class Format:
    """A format: writes rows to a path, reads all of them, reads the colour of one."""

    title: str
    write: Callable[[list[Images], Path], None]
    read: Callable[[Path, ThreadPoolExecutor], int]
    single: Callable[[Path, int], AnyArray]


def format_rows(bench: Bench) -> Iterator[Row]:
    """Yield rows of each format, at the paper's kind of image size."""
    data, _ = frames_of(bench, bench.sizes.large, "formats", denoise="oidn")
    yield from compared(data, views_of(data), bench.folder / "formats")


def compared(data: Path, views: Sequence[View], folder: Path) -> Iterator[Row]:
    """Yield size, speed of reading all rows and time of a single row, by format."""
    rows = [_images(data, view) for view in views]
    keep_channels_of_rows(data, views)
    folder.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(min(2, len(os.sched_getaffinity(0)))) as pool:
        exr = partial(_read_exr, data, views, pool)
        today = 0
        for number, form in enumerate(_formats()):
            path = folder / f"{number}"
            form.write(rows, path)
            size = path.stat().st_size
            today = today or size
            ways = {"exr": exr, "format": partial(form.read, path, pool)}
            spent = by_turns(ways, _TURNS)
            ours = form.title == OURS
            yield Row(
                f"{form.title}: rows per second over EXR",
                f"{size / len(rows) / 1e6:.2f} MB per row; all images of a row, stored types",
                ratio(spent["exr"], spent["format"], "wall"),
                clock="wall",
                goal=at_least(5) if ours else None,
            )
            yield Row(
                f"{form.title}: rows a processor second over EXR",
                f"{len(rows) / min(s.cpu for s in spent['format']):.0f} rows a processor second",
                ratio(spent["exr"], spent["format"], "cpu"),
                clock="cpu",
            )
            yield Row(
                f"{form.title}: size",
                "over typed lists, the form of format 1",
                spread([size / today]),
                goal=at_most(1.2) if ours else None,
            )
            chosen = cycle(np.random.default_rng(0).permutation(len(rows)).tolist())
            one = by_turns({"one": partial(_read_singly, form, path, chosen)}, _TURNS)["one"]
            yield Row(
                f"{form.title}: colour of a random row",
                "opening the file included",
                spread([1000 * s.cpu / _SINGLE for s in one]),
                "ms",
                "cpu",
            )


def _images(data: Path, view: View) -> Images:
    """Return the images of a row as the dataset stores them."""
    frames: Frames = {kind: read_frame(frame_path(data, kind, view)) for kind in KINDS}
    unit, _ = in_row_unit(frames)
    wanted = [channel.name for channel in dataset_channels()]
    cells = image_cells(unit)
    return {name: cells[name] for name in wanted}


def _read_exr(data: Path, views: Sequence[View], pool: ThreadPoolExecutor) -> int:
    """Read the frames of all views by OpenEXR alone."""
    return sum(pool.map(partial(read_exr, data), views))


def _read_singly(form: Format, path: Path, order: Iterator[int]) -> None:
    for _ in range(_SINGLE):
        form.single(path, next(order))


def _formats() -> Iterator[Format]:
    """Yield the formats; the first is format 1's."""
    yield Format(
        "typed lists, byte stream split, ZSTD",
        _write_lists,
        partial(_read_groups, decode=_from_list),
        partial(_single, decode=_from_list),
    )
    for title, encode, decode, options in (
        ("npy, ZSTD", _npy, _from_npy, {"compression": "zstd", "compression_level": 3}),
        ("npy, LZ4", _npy, _from_npy, {"compression": "lz4", "compression_level": 4}),
        ("byte planes, ZSTD", image_cell, _ours, {"compression": "zstd", "compression_level": 3}),
        ("byte planes, GZIP", image_cell, _ours, {"compression": "gzip", "compression_level": 4}),
        (OURS, image_cell, _ours, {"compression": "lz4", "compression_level": 4}),
    ):
        yield Format(
            title,
            partial(_write_cells, encode=encode, options=options),
            partial(_read_groups, decode=decode),
            partial(_single, decode=decode),
        )
    yield Format("WebDataset, npy in tar", _write_tar, _read_tar, _single_tar)


OURS = "byte planes, LZ4"


def _npy(image: AnyArray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, image)
    return stream.getvalue()


def _from_npy(table: pa.Table, name: str) -> list[AnyArray]:
    found = []
    for cell in table.column(name):
        content = cell.as_buffer()
        field = table.schema.field(name).metadata
        dtype, shape = np.dtype(field[b"dtype"].decode()), _shape(field[b"shape"])
        start = len(content) - dtype.itemsize * int(np.prod(shape))
        found.append(np.frombuffer(content, dtype, offset=start).reshape(shape))
    return found


def _shape(text: bytes) -> tuple[int, ...]:
    return tuple(int(side) for side in text.decode().strip("[]").split(","))


def _ours(table: pa.Table, name: str) -> AnyArray:
    return images_of(Path("benchmark"), table, name)


def _from_list(table: pa.Table, name: str) -> AnyArray:
    shape = _shape(table.schema.field(name).metadata[b"shape"])
    values = pa.concat_arrays(table.column(name).chunks).flatten().to_numpy()
    return values.reshape(-1, *shape)


def _field(name: str, image: AnyArray, kind: pa.DataType) -> pa.Field:
    about = {"shape": str(list(image.shape)), "dtype": image.dtype.name}
    return pa.field(name, kind, nullable=False, metadata=about)


def _write_lists(rows: list[Images], path: Path) -> None:
    fields, columns, floats = [], [], []
    for name, image in rows[0].items():
        item = pa.field("item", pa.from_numpy_dtype(image.dtype), nullable=False)
        kind = pa.list_(item, image.size)
        flat = np.concatenate([row[name].reshape(-1) for row in rows])
        columns.append(pa.FixedSizeListArray.from_arrays(pa.array(flat), type=kind))
        fields.append(_field(name, image, kind))
        if image.dtype.kind == "f":
            floats.append(f"{name}.list.element")
    table = pa.Table.from_arrays(columns, schema=pa.schema(fields))
    others = [f"{name}.list.element" for name in rows[0] if f"{name}.list.element" not in floats]
    pq.write_table(
        table, path, row_group_size=_GROUP, compression="zstd", compression_level=3,
        use_dictionary=others, use_byte_stream_split=floats,
    )  # fmt: skip


def _cells(rows: list[Images], encode: Encode) -> pa.Table:
    fields = [_field(name, image, pa.binary()) for name, image in rows[0].items()]
    columns = [pa.array([encode(row[name]) for row in rows], pa.binary()) for name in rows[0]]
    return pa.Table.from_arrays(columns, schema=pa.schema(fields))


def _write_cells(rows: list[Images], path: Path, encode: Encode, options: dict[str, Any]) -> None:
    table = _cells(rows, encode)
    pq.write_table(table, path, row_group_size=_GROUP, use_dictionary=False, **options)


def _read_groups(path: Path, pool: ThreadPoolExecutor, decode: Decode) -> int:
    groups = range(pq.read_metadata(path).num_row_groups)
    return sum(pool.map(partial(_read_group, path, decode), groups))


def _read_group(path: Path, decode: Decode, group: int) -> int:
    with pq.ParquetFile(path) as file:
        table = file.read_row_group(group, use_threads=False)
    return sum(image.size for name in table.column_names for image in decode(table, name))


def _single(path: Path, number: int, decode: Decode) -> AnyArray:
    with pq.ParquetFile(path) as file:
        group, row = divmod(number, _GROUP)
        table = file.read_row_group(group, columns=["color"], use_threads=False)
    return np.array(decode(table.slice(row, 1), "color")[0])


def _write_tar(rows: list[Images], path: Path) -> None:
    with tarfile.open(path, "w") as file:
        for number, row in enumerate(rows):
            for name, image in row.items():
                content = _npy(image)
                about = tarfile.TarInfo(f"{number:06d}.{name}.npy")
                about.size = len(content)
                file.addfile(about, io.BytesIO(content))


def _read_tar(path: Path, pool: ThreadPoolExecutor) -> int:
    with tarfile.open(path) as file:
        return sum(np.load(io.BytesIO(file.extractfile(one).read())).size for one in file)  # type: ignore[union-attr]


def _single_tar(path: Path, number: int) -> AnyArray:
    with tarfile.open(path) as file:
        found: AnyArray = np.load(io.BytesIO(file.extractfile(f"{number:06d}.color.npy").read()))  # type: ignore[union-attr]
    return found
