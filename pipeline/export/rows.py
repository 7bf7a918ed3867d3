"""Rows of a packed dataset for the exports: cameras of all rows at once, images a row at a time.

The only place where exports read Parquet. Images come as NumPy arrays (H, W) or (H, W, C), radiance
as float32 in the renderer's unit; all else about a row as Python values by column name.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pbrnet.pipeline.channels import RADIANCES, dataset_channels, is_scale, remedy
from pbrnet.pipeline.dataset.parquet import (
    check_filled,
    check_row,
    check_types,
    images_of,
    open_parquet,
    reading,
    shards_of,
)
from pbrnet.pipeline.lenses.model import Lens, Projection
from pbrnet.pipeline.tonemap import Exposure
from pbrnet.pipeline.views import as_matrix
from pbrnet.scenes.arrays import AnyArray, Float64Array
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import digest_bytes, digest_file

_CAMERA = ("scene_id", "view_id", "split", "camera_to_world")
_EXPOSURE = ("exposure_color", "white_color")  # of datasets with colour
_OPTIONAL = (
    *("radiance_scale", "room_type", "trajectory", "frame", "projection", "distortion"),
    *("f_number", "focus_distance", "exposure_time", "readout_time"),
)
LensKind = Literal["pinhole", "distorted", "fisheye", "equirectangular", "orthographic"]
ANY_LENS: tuple[LensKind, ...] = ("distorted", "fisheye", "equirectangular", "orthographic")
_RADIANCES = RADIANCES | {"lights"}


@dataclass(frozen=True, eq=False)
class ViewRow:
    """A row without its images, and where it lies.

    `intrinsics` (3, 3) in pixels, centres at +0.5, NaN for equirectangular views; `pose` (4, 4)
    camera to world, camera axes x right, y down, z forward, world in metres, Z up.
    `color_exposure` is that of `color` in the renderer's unit, None in a dataset without colour.
    """

    scene_id: str
    view_id: str
    split: str
    intrinsics: Float64Array
    pose: Float64Array
    color_exposure: Exposure | None
    radiance_scale: float
    values: Mapping[str, Any]  # trajectory, frame, room_type, where the dataset has them
    place: tuple[int, int, int]  # shard, row group, row in it

    @property
    def lens_kind(self) -> LensKind:
        """Kind of the view's lens."""
        projection: Projection = self.values.get("projection", "perspective")
        if projection != "perspective":
            return projection
        return "distorted" if any(self.values.get("distortion") or ()) else "pinhole"

    def lens(self, width: int, height: int) -> Lens:
        """Return the lens of the view's images of this size."""
        projection: Projection = self.values.get("projection", "perspective")
        matrix = () if projection == "equirectangular" else as_matrix(self.intrinsics)
        distortion = tuple(self.values.get("distortion") or ())
        return Lens(projection, width, height, matrix, distortion)

    @property
    def exposure(self) -> Exposure:
        """Exposure of `color`; raises `InputError` in a dataset without colour."""
        if self.color_exposure is None:
            raise InputError(f"{self.name}: the dataset has no color, so no exposure")
        return self.color_exposure

    @property
    def name(self) -> str:
        """Scene and view, for messages."""
        return f"{self.scene_id}/{self.view_id}"


@dataclass(frozen=True, eq=False)
class Content:
    """Cells of a row: images by column name, others as Python values."""

    images: dict[str, AnyArray]
    values: dict[str, Any]


class DatasetRows:
    """The rows of a dataset folder, or of some splits and scenes of it, in file order.

    Raises `InputError` for a folder without shards, for damaged or missing shards, and for splits
    and scenes that it does not have.
    """

    def __init__(
        self, folder: Path, splits: Sequence[str] = (), scenes: Sequence[str] = ()
    ) -> None:
        self.folder = Path(folder)
        self.shards = shards_of(self.folder)
        names: list[set[str]] = []
        rows: list[ViewRow] = []
        for number, path in enumerate(self.shards):
            with reading(path), open_parquet(path) as file:
                names.append(set(file.schema_arrow.names))
                rows += _cameras(path, number, file)
        self.columns = frozenset(set.intersection(*names))
        _check_known(self.folder, "split", splits, {row.split for row in rows})
        _check_known(self.folder, "scene", scenes, {row.scene_id for row in rows})
        self.rows = [
            row
            for row in rows
            if (not splits or row.split in splits) and (not scenes or row.scene_id in scenes)
        ]
        if not self.rows:
            raise InputError(f"{self.folder}: no rows in this selection")
        self._cached: tuple[Any, pa.Table] | None = None

    def scenes(self) -> dict[str, list[ViewRow]]:
        """Return the rows of each scene, scenes in file order."""
        found: dict[str, list[ViewRow]] = {}
        for row in self.rows:
            found.setdefault(row.scene_id, []).append(row)
        return found

    def require(self, columns: Iterable[str], purpose: str) -> None:
        """Raise `InputError` that names the channel set to add if one of `columns` is missing."""
        for name in columns:
            if name not in self.columns:
                raise InputError(f"{self.folder}: {purpose} needs {name!r}; {remedy(name)}")

    def require_lenses(self, purpose: str, known: Collection[LensKind]) -> None:
        """Raise `InputError` for views through other lenses than pinholes and those of `known`."""
        for row in self.rows:
            if row.lens_kind not in ("pinhole", *known):
                further = f", or: {', '.join(known)}" if known else ""
                raise InputError(
                    f"{self.folder}: {purpose} needs perspective views, undistorted{further}; "
                    f"these are {row.lens_kind}; set image.projection and image.lens"
                )

    def read(
        self, rows: Sequence[ViewRow], images: Sequence[str], values: Sequence[str] = ()
    ) -> Iterator[tuple[ViewRow, Content]]:
        """Yield these rows with their content; one row group is in memory at a time."""
        for row in rows:
            yield row, self._content(row, tuple(images), tuple(values))

    def fingerprint(self) -> str:
        """Return the SHA-256 over the bytes of all shards."""
        return digest_bytes(*(digest_file(path).encode() for path in self.shards))

    def image_names(self) -> tuple[str, ...]:
        """Return the names of all image columns, in the order of the schema."""
        path = self.shards[0]
        with reading(path), open_parquet(path) as file:
            schema = file.schema_arrow
        known = {channel.name for channel in dataset_channels()} | {"lights"}
        return tuple(name for name in schema.names if name in known & self.columns)

    def _content(self, row: ViewRow, images: tuple[str, ...], values: tuple[str, ...]) -> Content:
        shard, group, number = row.place
        key = (shard, group, images, values)
        if self._cached is None or self._cached[0] != key:
            self._cached = None  # frees the memory of the last group first
            path = self.shards[shard]
            with reading(path), open_parquet(path) as file:
                table = file.read_row_group(group, columns=[*images, *values])
            self._cached = (key, table)
        table = self._cached[1].slice(number, 1)
        path = self.shards[shard]
        found = {name: images_of(path, table, name)[0] for name in images}
        for name in _RADIANCES & found.keys():
            found[name] = found[name].astype(np.float32) * np.float32(row.radiance_scale)
        return Content(found, {name: table.column(name)[0].as_py() for name in values})


def _cameras(path: Path, shard: int, file: pq.ParquetFile) -> Iterator[ViewRow]:
    """Yield the rows of a shard without their images."""
    schema = file.schema_arrow
    missing = [name for name in (*_CAMERA, "K") if name not in schema.names]
    if missing:
        raise InputError(
            f"{path}: not a dataset of this project: the column {missing[0]!r} is missing"
        )
    optional = [name for name in _OPTIONAL if name in schema.names]
    flat = "projection" not in optional
    exposed = _EXPOSURE if set(_EXPOSURE) <= set(schema.names) else ()
    check_types(path, schema, (*_CAMERA, *exposed, "K", *optional))
    for group in range(file.num_row_groups):
        table = file.read_row_group(group, columns=[*_CAMERA, *exposed, "K", *optional])
        check_filled(path, table, (*_CAMERA, *exposed, *(("K",) if flat else ())))
        for number, cells in enumerate(table.to_pylist()):
            scale = cells.get("radiance_scale", 1.0)
            if not is_scale(scale):
                raise InputError(f"{path}: radiance_scale is not a power of two")
            check_row(path, cells)
            yield ViewRow(
                cells["scene_id"],
                cells["view_id"],
                cells["split"],
                np.full((3, 3), np.nan) if cells["K"] is None else _matrix(cells["K"], 3),
                _matrix(cells["camera_to_world"], 4),
                Exposure(cells["exposure_color"], cells["white_color"]) if exposed else None,
                scale,
                {name: cells[name] for name in optional},
                (shard, group, number),
            )


def _matrix(cell: Any, side: int) -> Float64Array:
    return np.array(cell, dtype=np.float64).reshape(side, side)


def _check_known(folder: Path, what: str, wanted: Sequence[str], known: set[str]) -> None:
    for name in wanted:
        if name not in known:
            raise InputError(
                f"{folder}: no {what} {name!r}; it has: {', '.join(sorted(known)[:20])}"
            )
