"""Rows of a pbrnet data set as NumPy arrays; needs NumPy and pyarrow, nothing else of pbrnet.

    from pbrnet_reader import read

    for row in read("FOLDER", columns=["color", "depth"]):
        print(row["color"].shape, row["depth"].dtype)

A source is a folder with the shards, a data set of the Hugging Face hub ("owner/name", needs
`huggingface_hub`), or a URL of another store that fsspec opens. A row maps columns to arrays
(images, matrices), numbers, texts and the bytes of pictures; the data set's card describes them.

`TorchDataset` and `TorchStream` are `Rows` and `Stream` as data sets of torch, which is imported
when they are first asked for. So that a `DataLoader` can batch any columns, their rows have no
None, which is "" in place of a text, -1 of a whole number, NaN of other numbers (a view outside
walks has `trajectory` "" and `frame` -1), and lists of names are JSON texts, as `instances` is.
"""

from __future__ import annotations

import io
import json
import os
import re
import sys
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import accumulate
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pyarrow import fs

__version__ = "1.1.0"
T = TypeVar("T")
Row = dict[str, Any]
Source = str | os.PathLike[str]
Columns = Iterable[str] | str | None

SHARD = re.compile(r"(train|validation|test)-(\d{5})-of-(\d{5})\.parquet")
_VIEW = "preview scene_id view_id K camera_to_world color exposure_color white_color radiance_scale"
# Columns by task; a data set without the first has nothing for the task.
TASKS = {
    "depth": f"depth normal valid {_VIEW}",
    "intrinsic": f"reflectance shading irradiance residual valid {_VIEW}",
    "segmentation": "nyu40 nyu13 category instance material instances material_names normal "
    f"{_VIEW}",
    "relighting": f"lights light_names light_sources instances {_VIEW}",
    "video": "flow_forward flow_backward occluded_forward occluded_backward outside_forward "
    f"outside_backward depth valid trajectory frame {_VIEW}",
}


class Rows:
    """Rows of a split by number: `Rows("FOLDER", "depth")[3]["depth"]`.

    `columns` are names or a task of `TASKS`, by default all; `split` is train, validation, test or
    all. With `renderer_units`, images of radiance are float32 in the renderer's unit and
    `radiance_scale` is 1; without, they have the type and the unit of their row as stored. An
    access reads a row group, unless it is that of the access before.

    Raises `FileNotFoundError` for missing shards, `KeyError` for a missing column.
    """

    _for_torch = False

    def __init__(
        self,
        source: Source,
        columns: Columns = None,
        split: str = "train",
        renderer_units: bool = False,
    ) -> None:
        self._store, self.shards = _shards(source, split)
        self._footers = [pq.read_metadata(one, filesystem=self._store) for one in self.shards]
        schema = self._footers[0].schema.to_arrow_schema()
        self.columns = chosen_columns(columns, schema.names)
        units = {field.name: (field.metadata or {}).get(b"unit", b"") for field in schema}
        scaled = [name for name in self.columns if units[name].startswith(b"radiance_scale")]
        if renderer_units and not any(units.values()):
            raise ValueError(f"{source}: says no units; multiply by radiance_scale yourself")
        self._fields = [schema.field(name) for name in self.columns]
        self._scaled = scaled if renderer_units else []
        self._ones = ["radiance_scale"] if renderer_units else []
        self._groups = [
            (shard, group)
            for shard, footer in enumerate(self._footers)
            for group in range(footer.num_row_groups)
        ]
        sizes = (self._footers[shard].row_group(group).num_rows for shard, group in self._groups)
        self._starts = list(accumulate(sizes, initial=0))
        self._last: tuple[int, pa.Table] | None = None

    def __len__(self) -> int:
        return self._starts[-1]

    def __getitem__(self, number: int) -> Row:
        number = range(len(self))[number]
        group = bisect_right(self._starts, number) - 1
        if self._last is None or self._last[0] != group:
            self._last = group, self._table(group)
        return self._row(self._last[1].slice(number - self._starts[group], 1))

    def __getstate__(self) -> Row:
        return self.__dict__ | {"_last": None}  # a worker reads row groups of its own

    def _table(self, number: int) -> pa.Table:
        """Stored cells of a row group, with the unit that images of radiance need."""
        shard, group = self._groups[number]
        names = dict.fromkeys([*self.columns, *self._ones])
        about = {"metadata": self._footers[shard], "filesystem": self._store, "pre_buffer": True}
        with pq.ParquetFile(self.shards[shard], **about) as file:
            return file.read_row_group(group, columns=list(names))

    def _row(self, stored: pa.Table) -> Row:
        """Row of a table with one row."""
        row = decode(stored.to_pylist()[0])
        for name in self._scaled:
            row[name] = row[name].astype(np.float32) * np.float32(row["radiance_scale"])
        row |= dict.fromkeys(self._ones, 1.0)
        if self._for_torch:
            return {one.name: _batchable(row[one.name], one) for one in self._fields}
        return {name: row[name] for name in self.columns}


class Stream(Rows):
    """Rows of a split one after the other, each once a pass; parameters as `Rows`.

    With a `seed`, row groups come in random order, and their rows through a buffer of `buffer`
    rows; each pass has an order of its own. The workers of a torch `DataLoader` share the row
    groups; tell workers that start anew with each pass its number by `set_epoch`.
    """

    def __init__(
        self,
        source: Source,
        columns: Columns = None,
        split: str = "train",
        renderer_units: bool = False,
        seed: int | None = None,
        buffer: int = 64,
    ) -> None:
        super().__init__(source, columns, split, renderer_units)
        self.seed, self.buffer, self.epoch = seed, buffer, 0

    def set_epoch(self, epoch: int) -> None:
        """Set the number of the next pass, which decides its order."""
        self.epoch = epoch

    def __iter__(self) -> Iterator[Row]:
        torch = sys.modules.get("torch.utils.data")
        worker = torch and torch.get_worker_info()
        share, shares = (worker.id, worker.num_workers) if worker else (0, 1)
        order, epoch = list(range(len(self._groups))), self.epoch
        self.epoch += 1
        if self.seed is None:
            return (self._row(row) for group in order[share::shares] for row in self._load(group))
        np.random.default_rng([self.seed, epoch]).shuffle(order)
        own = np.random.default_rng([self.seed, epoch, share])
        return map(self._row, shuffled(order[share::shares], own, self.buffer, self._load))

    def _load(self, group: int) -> list[pa.Table]:
        table = self._table(group)
        return [table.slice(row, 1) for row in range(len(table))]


def read(
    source: Source,
    columns: Columns = None,
    split: str = "train",
    renderer_units: bool = False,
    seed: int | None = None,
) -> Iterator[Row]:
    """Rows of a split, each once; parameters as `Rows` and `Stream`."""
    return iter(Stream(source, columns, split, renderer_units, seed))


def table(source: Source, columns: Columns = None, split: str = "train") -> pa.Table:
    """Arrow table of a split, for `.to_pandas()` or `polars.from_arrow`; cells as stored."""
    store, shards = _shards(source, split)
    names = chosen_columns(columns, pq.read_schema(shards[0], filesystem=store).names)
    tables = (pq.read_table(one, columns=list(names), filesystem=store) for one in shards)
    return pa.concat_tables(tables)


def decode(row: Mapping[str, Any]) -> Row:
    """Row, or batch of rows (lists by column), with arrays in place of stored cells.

    For rows that any program read; radiance stays in the unit of its row.
    """
    return {name: _value(cell) for name, cell in row.items()}


def image(cell: bytes) -> np.ndarray[Any, Any]:
    """Image (H, W), (H, W, C) or (n, H, W, C) of a cell, of the type in which it is stored.

    The cell is a `.npy` file of the bytes of its values, plane by plane, lowest bytes first, in a
    field with the name of the values' type. Raises `ValueError` or `TypeError` for others.
    """
    stream = io.BytesIO(cell)
    np.lib.format.read_magic(stream)
    shape, _, about = np.lib.format.read_array_header_1_0(stream)
    planes = np.frombuffer(cell, np.uint8, offset=stream.tell()).reshape(shape)
    (name,) = about.names or ()
    whole = np.empty(planes.shape[1:], name)
    if len(planes) != whole.itemsize:
        raise ValueError(f"{len(planes)} bytes for a value of {name}")
    join_planes(planes, whole)
    return whole


def join_planes(planes: np.ndarray[Any, Any], whole: np.ndarray[Any, Any]) -> None:
    """Write the values whose bytes are uint8 `planes` (B, ...) to `whole` (...)."""
    # Faster than np.stack by half: shifts run on whole registers, single bytes do not.
    bits = whole.view(f"<u{whole.itemsize}")
    bits[...] = planes[-1]
    for plane in planes[-2::-1]:
        np.left_shift(bits, 8, out=bits)
        np.bitwise_or(bits, plane, out=bits)


def reinhard(radiance: Any, exposure: float, white: float) -> Any:
    """Display values in [0, 1] of radiance (..., 3) in the renderer's unit, sRGB-encoded.

    `exposure` and `white` are the row's, for example `exposure_color` and `white_color`.
    """
    scaled = radiance * exposure
    light = scaled @ np.array([[0.2126], [0.7152], [0.0722]], scaled.dtype)
    linear = np.clip(scaled * (1 + light / white**2) / (1 + light), 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def chosen_columns(wanted: Columns, there: Sequence[str]) -> tuple[str, ...]:
    """Columns of a task, of a list, or all, of those that are `there`; raises `KeyError`."""
    if isinstance(wanted, str):
        if wanted not in TASKS:
            raise KeyError(f"{wanted} is no task ({', '.join(TASKS)}); give columns as a list")
        first, *others = TASKS[wanted].split()
        wanted = [first, *(name for name in others if name in there)]
    names = tuple(there if wanted is None else wanted)
    missing = [name for name in names if name not in there]
    if missing:
        raise KeyError(f"no column {', '.join(missing)}; there are {', '.join(there)}")
    return names


def shuffled(
    groups: Iterable[Any],
    rng: np.random.Generator,
    buffer: int,
    load: Callable[[Any], Iterable[T]],
) -> Iterator[T]:
    """Items of groups, each loaded in its turn, in random order out of at most `buffer` items."""
    held: list[T] = []
    for group in groups:
        held += load(group)
        while len(held) > buffer:
            yield held.pop(int(rng.integers(len(held))))
    while held:
        yield held.pop(int(rng.integers(len(held))))


def _value(cell: Any) -> Any:
    """Array, or list of arrays, of a cell, or of the cells of a batch."""
    if isinstance(cell, bytes):
        return image(cell) if cell.startswith(b"\x93NUMPY") else cell
    if isinstance(cell, dict):  # a picture and its name
        return cell["bytes"]
    first = cell
    while isinstance(first, list) and first:
        first = first[0]
    if isinstance(first, bytes | dict):
        return [_value(one) for one in cell]
    array = np.array(cell) if first is not cell and isinstance(first, int | float) else None
    return cell if array is None or array.dtype == object else array


def _batchable(value: Any, field: pa.Field) -> Any:
    """Value of a row that torch can batch with those of other rows."""
    if isinstance(value, list) and all(isinstance(one, str) for one in value):
        return json.dumps(value)
    if value is not None:
        return value
    if pa.types.is_string(field.type):
        return ""
    shape = json.loads((field.metadata or {}).get(b"shape", b"[]"))
    return -1 if pa.types.is_integer(field.type) else np.full(shape, np.nan)[()]


def _shards(source: Source, split: str) -> tuple[fs.FileSystem, list[str]]:
    """Store and paths of the shards of a split; raises `FileNotFoundError`."""
    store, root = _store(source)
    found = [
        (match, info.path)
        for folder in (root, f"{root}/data")  # the second is where `push_to_hub` puts them
        for info in store.get_file_info(fs.FileSelector(folder, allow_not_found=True))
        if (match := SHARD.fullmatch(info.base_name))
    ]
    kept = sorted((path, match) for match, path in found if split in (match[1], "all"))
    if not kept:
        splits = sorted({match[1] for match, _ in found})
        raise FileNotFoundError(
            f"{source}: no {split} shards; splits: {', '.join(splits) or 'none'}"
        )
    if len(kept) != sum(int(match[3]) for _, match in kept if match[2] == "00000"):
        raise FileNotFoundError(f"{source}: some shards are missing; there are {len(kept)}")
    return store, [path for path, _ in kept]


def _store(source: Source) -> tuple[fs.FileSystem, str]:
    """File system and folder of a source."""
    if Path(source).is_dir():
        return fs.LocalFileSystem(), str(Path(source).absolute())
    url = os.fspath(source)
    if re.fullmatch(r"[\w-][\w.-]*/[\w.-]+", url):
        url = f"hf://datasets/{url}"
    if "://" not in url:
        raise FileNotFoundError(f"{source}: no such folder")
    try:
        import fsspec
    except ImportError:
        raise FileNotFoundError(
            f"{source}: no such folder; to read from the hub: pip install huggingface_hub"
        ) from None
    store, root = fsspec.url_to_fs(url)
    return fs.PyFileSystem(_Remote(store)), root


class _Remote(fs.FSSpecHandler):  # type: ignore[misc]
    """Files of fsspec of which only what is asked for is fetched, not megabytes around it."""

    def open_input_file(self, path: str) -> pa.PythonFile:
        return pa.PythonFile(self.fs.open(path, cache_type="none"), mode="r")


def __getattr__(name: str) -> Any:
    """`TorchDataset` and `TorchStream`; torch is imported now."""
    bases = {"TorchDataset": (Rows, "Dataset"), "TorchStream": (Stream, "IterableDataset")}
    if name not in bases:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from torch.utils import data

    own, torch = bases[name]
    about = {"__module__": __name__, "__doc__": own.__doc__, "_for_torch": True}
    return globals().setdefault(name, type(name, (own, getattr(data, torch)), about))
