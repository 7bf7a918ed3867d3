"""Streaming reader of the packed dataset: bounded memory, seeded order, exact positions.

The order of a shuffled pass depends on the row counts alone and is computed before pixels are read.
A checkpoint therefore needs only the number of rows read so far to resume with the same rows.
"""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from itertools import accumulate
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import torch

from pbrnet.model.methods import JOINS
from pbrnet.pipeline.channels import RADIANCE_SCALE, RADIANCES, column_channel, is_scale, remedy
from pbrnet.pipeline.dataset.parquet import (
    check_filled,
    check_row,
    check_types,
    fill_image,
    image_type,
    open_parquet,
    reading,
    shards_of,
)
from pbrnet.pipeline.tonemap import Exposure
from pbrnet.reader import shuffled
from pbrnet.scenes.arrays import AnyArray, ArrayOrTensor, UInt8Array
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import digest_bytes, digest_file, read_csv
from pbrnet.scenes.seeds import generator

Split = Literal["train", "validation", "test"]
ImageType = tuple[np.dtype[Any], tuple[int, ...]]  # of a column: NumPy type and shape

# Images of the paper, which every dataset has.
PAPER = ("depth", "normal", "reflectance", "valid", "intensity", "distance", "shading", "color")
# Images that are read where a dataset has them, and only if asked for must be there.
OPTIONAL = (
    *dict.fromkeys(column for join in JOINS.values() for column in join.columns),
    *("transport_direct", "transport_indirect", "transport_color"),
    *("roughness", "metalness", "material_known"),
)
SCALARS = (
    "scene_id",
    "view_id",
    "split",
    "exposure_shading",
    "white_shading",
    "exposure_color",
    "white_color",
    "K",
)
NOISY_SPP = "noisy_spp"  # samples per pixel of noisy images, a number
_PIECE = 32704  # values; PyTorch starts threads from 32768 on


class Columns(Protocol):
    """Columns of a view by name: an `Example`, or a mapping of tensors."""

    def __getitem__(self, name: str, /) -> ArrayOrTensor: ...

    def __contains__(self, name: object, /) -> bool: ...


@dataclass(frozen=True, kw_only=True)
class Example:
    """One view of the dataset: its images by column name, which `example["depth"]` returns.

    Images are float32 (H, W) or (H, W, C), panoramas (h, w = 2h) and (h, w, 3); radiance is in the
    renderer's unit; `valid` is boolean. `pbrnet.pipeline.channels` describes them. `noisy_spp` is a
    number (). `intrinsics`, also `example["K"]`, is float64 (3, 3), pixel centres at +0.5; camera
    axes are OpenCV's: x right, y down, z forward.
    """

    scene_id: str
    view_id: str
    images: Mapping[str, AnyArray]
    intrinsics: AnyArray
    exposure_shading: Exposure  # by the log-average luminance of shading
    exposure_color: Exposure  # by the log-average luminance of color

    @property
    def name(self) -> str:
        """Scene and view, for messages and file names."""
        return f"{self.scene_id}/{self.view_id}"

    def __getitem__(self, column: str) -> AnyArray:
        if column == "K":
            return self.intrinsics
        try:
            return self.images[column]
        except KeyError:
            raise InputError(f"{self.name}: no {column}; {remedy(column)}") from None

    def __contains__(self, column: object) -> bool:
        return column == "K" or column in self.images

    def having(self, **images: AnyArray) -> Example:
        """The view with these images besides or instead of its own."""
        return replace(self, images={**self.images, **images})

    def without(self, *columns: str) -> Example:
        """The view without these images."""
        left = {name: image for name, image in self.images.items() if name not in columns}
        return replace(self, images=left)


@dataclass(frozen=True)
class Row:
    """Position of a row: index of the shard, row group in the shard, row in the group."""

    shard: int
    group: int
    row: int


class Dataset:
    """Reader of the shards of one split, or of the scenes `only` in them.

    Raises `InputError` if the folder does not contain the split, or if a shard is missing,
    truncated or lacks columns, among them `columns` beyond the paper's. One file is open at a time,
    and only during a read.
    """

    def __init__(
        self,
        folder: Path,
        split: Split,
        columns: Collection[str] = (),
        only: Collection[str] | None = None,
    ) -> None:
        self.folder, self.split = Path(folder), split
        self.only = None if only is None else frozenset(only)
        self.shards = shards_of(self.folder, split)
        there = image_columns(self.folder, split)
        optional = [name for name in OPTIONAL if name in there]
        wanted = dict.fromkeys((*PAPER, *columns, *optional))
        self.images = tuple(name for name in wanted if name != NOISY_SPP)
        self.numbers = tuple(name for name in wanted if name == NOISY_SPP)
        # By shard and row group: numbers of the selected rows.
        self.groups: list[list[Sequence[int]]] = [
            [range(size) for size in _group_sizes(path, (*self.images, *self.numbers))]
            for path in self.shards
        ]
        if self.only is not None:
            self._keep(self.only)
        self.held = 0  # decoded rows in memory during a pass
        self._spare: list[UInt8Array] = []  # memory of used rows, at most of one row group

    def __len__(self) -> int:
        return sum(len(rows) for groups in self.groups for rows in groups)

    def ordered(self) -> Iterator[Example]:
        """Every row once, in file order."""
        yield from self._read(self._places())

    def at(self, numbers: Sequence[int]) -> Iterator[Example]:
        """The rows with these numbers (from 0 in file order), in the order of `numbers`.

        Reads only the row groups that contain them, each once.
        """
        places = self._places()
        yield from self._read([places[number] for number in numbers])

    def shuffled(self, seed: int, buffer: int = 64, start: int = 0) -> Iterator[Example]:
        """Endless passes over all rows from position `start` on, each in its own random order.

        `start` counts rows over all passes: `shuffled(seed, start=k)` continues exactly the
        sequence of `shuffled(seed)` after k rows. At most `buffer` rows and two row groups are in
        memory.
        """
        rows_per_pass = len(self)
        if rows_per_pass == 0:
            raise InputError(f"{self.folder}: the {self.split} split has no rows")
        number, skip = divmod(start, rows_per_pass)
        while True:
            order = self.order(seed, number, buffer)
            yield from self._read(order[skip:])
            number, skip = number + 1, 0

    def order(self, seed: int, number: int, buffer: int) -> list[Row]:
        """The rows of pass `number`: row groups shuffled, then rows through a shuffle buffer."""
        rng = generator(seed, "order", number)
        groups = [(s, g) for s, sizes in enumerate(self.groups) for g in range(len(sizes))]

        def rows(index: int) -> list[Row]:
            shard, group = groups[index]
            return [Row(shard, group, row) for row in self.groups[shard][group]]

        return list(shuffled(rng.permutation(len(groups)), rng, buffer, rows))

    def column(self, name: str) -> list[Any]:
        """Python values of a scalar column of the split; empty if the column does not exist."""
        values: list[Any] = []
        for path, groups in zip(self.shards, self.groups, strict=True):
            with reading(path), open_parquet(path) as file:
                if name not in file.schema_arrow.names:
                    continue
                for group, rows in enumerate(groups):
                    column = file.read_row_group(group, columns=[name]).column(0)
                    values += column.take(pa.array(rows, pa.int64())).to_pylist()
        return values

    def plans(self) -> dict[str, str]:
        """Floor plan of each scene, from `scenes.csv` beside the shards; empty without the file."""
        path = self.folder / "scenes.csv"
        if not path.is_file():
            return {}
        return {
            row["scene_id"]: row["plan"]
            for row in read_csv(path)
            if row.get("scene_id") and row.get("plan")
        }

    def fingerprint(self) -> str:
        """SHA-256 over the bytes of all shards, and over the scene names `only` if given."""
        shards = digest_bytes(*(digest_file(path).encode() for path in self.shards))
        return shards if self.only is None else subset_fingerprint(shards, self.only)

    def _keep(self, only: frozenset[str]) -> None:
        """Restrict the rows to these scenes."""
        for path, groups in zip(self.shards, self.groups, strict=True):
            with reading(path), open_parquet(path) as file:
                for group, rows in enumerate(groups):
                    names = file.read_row_group(group, columns=["scene_id"]).column(0).to_pylist()
                    groups[group] = [row for row in rows if names[row] in only]

    def _places(self) -> list[Row]:
        """Positions of all rows, in file order."""
        return [
            Row(shard, group, row)
            for shard, sizes in enumerate(self.groups)
            for group, rows in enumerate(sizes)
            for row in rows
        ]

    def _read(self, order: Sequence[Row]) -> Iterator[Example]:
        """The rows in this order; decodes a row group while those of the one before are used."""
        due: dict[tuple[int, int], set[int]] = {}
        for row in order:
            due.setdefault((row.shard, row.group), set()).add(row.row)
        loaded: dict[tuple[int, int], dict[int, Any]] = {}
        try:
            with ThreadPoolExecutor(1) as ahead:
                groups = iter(due.items())
                coming = self._begin(ahead, groups)
                for row in order:
                    key = (row.shard, row.group)
                    if key not in loaded:
                        assert coming is not None
                        loaded[key] = coming.result()
                        coming = self._begin(ahead, groups)
                        self.held += len(loaded[key])
                    record = loaded[key].pop(row.row)
                    self.held -= 1
                    example = _example(record, self.images, self.numbers)
                    if len(self._spare) < len(self.groups[row.shard][row.group]):
                        self._spare.append(record["memory"])
                    yield example
        finally:
            self.held = 0

    def _begin(
        self, ahead: Executor, groups: Iterator[tuple[tuple[int, int], set[int]]]
    ) -> Future[dict[int, Any]] | None:
        """Begin to decode the next of the row groups, if there is one."""
        for (shard, group), wanted in groups:
            return ahead.submit(self._load, shard, group, wanted)
        return None

    def _load(self, shard: int, group: int, wanted: set[int]) -> dict[int, dict[str, Any]]:
        path = self.shards[shard]
        with reading(path), open_parquet(path) as file:
            scalar_names = [*SCALARS, *_scale_columns(file), *self.numbers]
            table = file.read_row_group(group, columns=[*scalar_names, *self.images])
            check_filled(path, table, scalar_names)
        types = {name: _image_type(path, table, name) for name in self.images}
        scalars = {name: table.column(name).to_pylist() for name in scalar_names}
        if not all(map(is_scale, scalars.get(RADIANCE_SCALE, ()))):
            raise InputError(
                f"{path}: a {RADIANCE_SCALE} that is not a power of two; pack it again with: "
                "pbrnet dataset"
            )
        foreign = sorted(set(scalars["split"]) - {self.split})
        if foreign:
            raise InputError(f"{path}: contains rows of the split {foreign[0]!r}; pack it again")
        rows = sorted(wanted)
        memory = [self._memory() for _ in rows]
        with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
            images = list(pool.map(partial(_decoded, path, table, types), rows, memory))
        return {
            row: {**{name: values[row] for name, values in scalars.items()}, **images[place]}
            for place, row in enumerate(rows)
        }

    def _memory(self) -> UInt8Array:
        """Memory that a used row left, or none."""
        try:
            return self._spare.pop()
        except IndexError:
            return np.empty(0, np.uint8)


def subset_fingerprint(whole: str, only: Collection[str]) -> str:
    """Fingerprint of the scenes `only` of a split whose own fingerprint is `whole`."""
    return digest_bytes(whole.encode(), *(scene.encode() for scene in sorted(only)))


def mirrored(example: Example) -> Example:
    """The view mirrored left to right: images, panorama, x of directions, intrinsics."""
    flipped = {name: image[:, ::-1].copy() for name, image in example.images.items() if image.ndim}
    for name in flipped:
        if column_channel(name).is_direction:
            flipped[name] = flipped[name] * np.array([-1, 1, 1], np.float32)
    turned = np.array([[-1, 0, example["depth"].shape[1]], [0, 1, 0], [0, 0, 1]])
    intrinsics = turned @ example.intrinsics @ np.diag([-1, 1, 1])
    return replace(example.having(**flipped), intrinsics=intrinsics)


def coin_flips(seed: int, start: int, rows_per_pass: int) -> Iterator[bool]:
    """For each row of the endless stream from `start` on: True if it is to be mirrored."""
    number, skip = divmod(start, rows_per_pass)
    while True:
        flips = generator(seed, "flip", number).integers(2, size=rows_per_pass)
        yield from (bool(flip) for flip in flips[skip:])
        number, skip = number + 1, 0


def image_columns(folder: Path, split: Split) -> set[str]:
    """Return the names of the columns that all shards of a split have."""
    names = []
    for path in shards_of(Path(folder), split):
        with reading(path), open_parquet(path) as file:
            names.append(set(file.schema_arrow.names))
    return set.intersection(*names)


def _scale_columns(file: pq.ParquetFile) -> tuple[str, ...]:
    """`RADIANCE_SCALE`, if the shard has that column."""
    return (RADIANCE_SCALE,) if RADIANCE_SCALE in file.schema_arrow.names else ()


def _group_sizes(path: Path, columns: Iterable[str]) -> list[int]:
    with reading(path), open_parquet(path) as file:
        names = file.schema_arrow.names
        missing = [name for name in (*SCALARS, *columns) if name not in names]
        if missing and missing[0] not in (*SCALARS, *PAPER):
            raise InputError(
                f"{path}: no {', '.join(missing)}, which a network requires; "
                + "; ".join(dict.fromkeys(map(remedy, missing)))
            )
        if missing:
            raise InputError(
                f"{path}: not a dataset of this project: the column {missing[0]!r} is missing"
            )
        if "projection" in names:
            raise InputError(
                f"{path}: views through another lens than a pinhole; the networks take perspective "
                "ones without distortion, image.projection: perspective"
            )
        check_types(path, file.schema_arrow, (*SCALARS, *columns, *_scale_columns(file)))
        return [file.metadata.row_group(i).num_rows for i in range(file.num_row_groups)]


def _image_type(path: Path, table: pa.Table, name: str) -> ImageType:
    """Type and shape of a column's images; raises `InputError` for another number of channels."""
    dtype, shape = image_type(path, table.schema.field(name))
    wanted = column_channel(name).shape
    if shape[2:] not in (wanted, wanted or (1,)):
        raise InputError(f"{path}: the column {name!r} has the impossible shape {list(shape)}")
    return dtype, shape


def _decoded(
    path: Path, table: pa.Table, types: Mapping[str, ImageType], row: int, memory: UInt8Array
) -> dict[str, AnyArray]:
    """Images of a row, of the stored types, and the `memory` that they share.

    The given memory is used if it is large enough: new pages take as long as decoding.
    """
    memory, images = _together(types, memory)
    for name, image in images.items():
        fill_image(path, name, table.column(name)[row], image)
    return {**images, "memory": memory}


def _together(
    types: Mapping[str, ImageType], memory: UInt8Array | None = None
) -> tuple[UInt8Array, dict[str, AnyArray]]:
    """Uninitialised images in one piece of memory: large ones come in large pages."""
    sizes = [dtype.itemsize * math.prod(shape) for dtype, shape in types.values()]
    starts = [0, *accumulate(-(-size // 64) * 64 for size in sizes)]
    if memory is None or len(memory) < starts[-1]:
        memory = np.empty(starts[-1], np.uint8)
    images = {
        name: memory[start : start + size].view(dtype).reshape(shape)
        for (name, (dtype, shape)), start, size in zip(types.items(), starts, sizes, strict=False)
    }
    return memory, images


def _example(record: dict[str, Any], names: Sequence[str], numbers: Sequence[str]) -> Example:
    shapes = {name: record[name].shape[: 2 + len(column_channel(name).shape)] for name in names}
    check_row(Path("dataset"), record)
    floats = {name: (np.dtype(np.float32), shapes[name]) for name in names if name != "valid"}
    _, images = _together(floats)
    for name, image in images.items():
        scale = record.get(RADIANCE_SCALE, 1) if name in RADIANCES else 1
        _convert(record[name], image, scale)
    images["valid"] = record["valid"].reshape(shapes["valid"]) > 0
    images |= {name: np.array(record[name], np.float32) for name in numbers}
    return Example(
        scene_id=record["scene_id"],
        view_id=record["view_id"],
        images=images,
        intrinsics=np.array(record["K"], dtype=np.float64).reshape(3, 3),
        exposure_shading=Exposure(record["exposure_shading"], record["white_shading"]),
        exposure_color=Exposure(record["exposure_color"], record["white_color"]),
    )


def _convert(stored: AnyArray, image: AnyArray, scale: float) -> None:
    """Write stored values, scaled, to a float32 image.

    By PyTorch, since NumPy takes twenty times as long with half floats; in pieces too small for
    its threads, which wait for each other where other programs run.
    """
    pairs = (torch.from_numpy(array).view(-1).split(_PIECE) for array in (stored, image))
    for values, floats in zip(*pairs, strict=True):
        floats.copy_(values)
        if scale != 1:
            floats.mul_(scale)
