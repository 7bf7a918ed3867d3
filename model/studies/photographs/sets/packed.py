"""Packed data sets of this project as sets of pictures: colour, depth, normals and labels.

All splits serve, since photographs are the test. A data set needs no other columns than these:
`channels: [depth, normal, labels, color]` renders no panorama and no shading.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from pbrnet.model.studies.photographs.sets.contract import (
    Intrinsics,
    Key,
    Photograph,
    Purpose,
    checked,
    listing_digest,
)
from pbrnet.pipeline.channels import RADIANCE_SCALE, is_scale
from pbrnet.pipeline.dataset.parquet import (
    check_filled,
    check_row,
    check_types,
    images_of,
    open_parquet,
    reading,
    shards_of,
)
from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import digest_file

_IMAGES = ("color", "depth", "normal", "valid")
_LABELS = "nyu40"
_VALUES = ("scene_id", "view_id", "K")


def is_packed(path: Path) -> bool:
    """Return whether a path is a folder with shards, or a data folder with `dataset` in it."""
    return any(_folder(path).glob("*.parquet"))


class PackedViews:
    """Reader of a data set; raises `InputError` if it lacks columns or is damaged."""

    def __init__(self, path: Path, purpose: Purpose) -> None:
        self.path = _folder(path)
        self._shards = shards_of(self.path)
        self._groups: list[tuple[Path, int, int]] = []  # shard, row group, number of its first row
        self.keys: list[Key] = []
        for shard in self._shards:
            self._add(shard)

    def read(self, numbers: Iterable[int]) -> Iterator[Photograph]:
        """Read pictures as `PhotographSet.read` does, one row group at a time."""
        wanted = set(numbers)
        ends = [start for _, _, start in self._groups[1:]] + [len(self.keys)]
        for (shard, group, start), end in zip(self._groups, ends, strict=True):
            chosen = [number for number in range(start, end) if number in wanted]
            if chosen:
                yield from self._read(shard, group, [number - start for number in chosen])

    def fingerprint(self) -> str:
        """Return the digest of the shards' names and sizes, and of their checksums if stored."""
        sums = self.path / "SHA256SUMS"
        return listing_digest(self._shards, digest_file(sums) if sums.is_file() else "")

    def _add(self, shard: Path) -> None:
        """Note the row groups and rows of a shard."""
        with reading(shard), open_parquet(shard) as file:
            names = file.schema_arrow.names
            missing = [name for name in (*_IMAGES, *_VALUES) if name not in names]
            if missing or "projection" in names:
                what = f"no {', '.join(missing)}" if missing else "equirectangular views"
                raise InputError(
                    f"{shard}: {what}; the study takes perspective views with color, depth and "
                    "normal"
                )
            check_types(shard, file.schema_arrow, (*_VALUES, RADIANCE_SCALE))
            for group in range(file.num_row_groups):
                self._groups.append((shard, group, len(self.keys)))
                table = file.read_row_group(group, columns=["scene_id", "view_id"])
                self.keys += [
                    Key(f"{row['scene_id']}/{row['view_id']}", row["scene_id"])
                    for row in table.to_pylist()
                ]

    def _read(self, shard: Path, group: int, rows: list[int]) -> Iterator[Photograph]:
        with reading(shard), open_parquet(shard) as file:
            there = file.schema_arrow.names
            optional = [name for name in (_LABELS, RADIANCE_SCALE) if name in there]
            table = file.read_row_group(group, columns=[*_IMAGES, *_VALUES, *optional])
        table = table.take(pa.array(rows, pa.int64()))
        check_filled(shard, table, _VALUES)
        names = [*_IMAGES, *([_LABELS] if _LABELS in optional else [])]
        images = {name: images_of(shard, table, name) for name in names}
        scalars = table.select([*_VALUES, *(n for n in optional if n == RADIANCE_SCALE)])
        for place, row in enumerate(scalars.to_pylist()):
            yield _photograph(shard, row, {name: images[name][place] for name in images})


def _photograph(shard: Path, row: dict[str, Any], images: dict[str, AnyArray]) -> Photograph:
    check_row(shard, row)
    scale = row.get(RADIANCE_SCALE, 1.0)
    if not is_scale(scale):
        raise InputError(f"{shard}: a {RADIANCE_SCALE} that is not a power of two; pack it again")
    k = np.array(row["K"], np.float64).reshape(3, 3)
    seen = images["valid"].reshape(images["depth"].shape) > 0
    labels = images.get(_LABELS)
    return checked(
        Photograph(
            key=Key(f"{row['scene_id']}/{row['view_id']}", row["scene_id"]),
            image=images["color"].astype(np.float32) * np.float32(scale),
            depth=np.where(seen, images["depth"], 0).astype(np.float32),
            intrinsics=Intrinsics(float(k[0, 0]), float(k[1, 1]), float(k[0, 2]), float(k[1, 2])),
            normal=np.where(seen[..., None], images["normal"], 0).astype(np.float32),
            label40=None if labels is None else np.clip(labels, 0, 255).astype(np.uint8),
        )
    )


def _folder(path: Path) -> Path:
    """Return the folder of the shards: `path`, or `dataset` in it."""
    inner = path / "dataset"
    return inner if inner.is_dir() and not any(path.glob("*.parquet")) else path
