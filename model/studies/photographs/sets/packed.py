"""Packed data sets of this project as sets of pictures: colour, depth, normals and labels.

All splits serve, since photographs are the test. A data set needs no other columns than these:
`channels: [depth, normal, labels, color]` renders no panorama and no shading.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from pbrnet.model.studies.photographs.sets.contract import (
    Intrinsics,
    Key,
    Photograph,
    Purpose,
    checked,
    listing_digest,
)
from pbrnet.pipeline.export.rows import Content, DatasetRows, ViewRow
from pbrnet.scenes.files import digest_file

_IMAGES = ("color", "depth", "normal", "valid")
_LABELS = "nyu40"


def is_packed(path: Path) -> bool:
    """Return whether a path is a folder with shards, or a data folder with `dataset` in it."""
    return any(_folder(path).glob("*.parquet"))


class PackedViews:
    """Reader of a data set; raises `InputError` if it lacks columns or is damaged."""

    def __init__(self, path: Path, purpose: Purpose) -> None:
        self.path = _folder(path)
        self._rows = DatasetRows(self.path)
        self._rows.require(_IMAGES, "the study of photographs")
        self._rows.require_lenses("the study of photographs", ())
        self.keys = [_key(row) for row in self._rows.rows]

    def read(self, numbers: Iterable[int]) -> Iterator[Photograph]:
        """Read pictures as `PhotographSet.read` does, one row group at a time."""
        images = [*_IMAGES, *([_LABELS] if _LABELS in self._rows.columns else [])]
        rows = [self._rows.rows[number] for number in sorted(set(numbers))]
        for row, content in self._rows.read(rows, images):
            yield _photograph(row, content)

    def fingerprint(self) -> str:
        """Return the digest of the shards' names and sizes, and of their checksums if stored."""
        sums = self.path / "SHA256SUMS"
        return listing_digest(self._rows.shards, digest_file(sums) if sums.is_file() else "")


def _key(row: ViewRow) -> Key:
    return Key(row.name, row.scene_id)


def _photograph(row: ViewRow, content: Content) -> Photograph:
    images, k = content.images, row.intrinsics
    seen = images["valid"].reshape(images["depth"].shape) > 0
    labels = images.get(_LABELS)
    return checked(
        Photograph(
            key=_key(row),
            image=images["color"],
            depth=np.where(seen, images["depth"], 0).astype(np.float32),
            intrinsics=Intrinsics(float(k[0, 0]), float(k[1, 1]), float(k[0, 2]), float(k[1, 2])),
            normal=np.where(seen[..., None], images["normal"], 0).astype(np.float32),
            label40=None if labels is None else np.clip(labels, 0, 255).astype(np.uint8),
        )
    )


def _folder(path: Path) -> Path:
    """Return the folder of the shards: `dataset` in a data folder, else `path`."""
    inner = path / "dataset"
    return inner if inner.is_dir() else path
