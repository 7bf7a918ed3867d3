"""Pinned lists of views: which views a benchmark has, and the digest of each one's truth.

A list is a JSON file with `name`, `version` and `views`, each with `scene_id`, `view_id` and the
SHA-256 `digest` of its truth. With the digests, scores on another rendering of the same views are
refused instead of compared.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pbrnet.pipeline.export.rows import Content, DatasetRows, ViewRow
from pbrnet.scenes.checked import build, plain
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import digest_bytes, read_json, write_json

TRUTH = ("color", "reflectance", "normal", "valid")


@dataclass(frozen=True)
class PinnedView:
    """A view of the list and the digest of its truth."""

    scene_id: str
    view_id: str
    digest: str


@dataclass(frozen=True)
class ViewList:
    """A benchmark's views."""

    name: str
    version: str
    views: tuple[PinnedView, ...]

    def verify(self, where: str) -> None:
        """Raise ValueError for an empty list or a view that is listed twice."""
        if not self.views:
            raise ValueError(f"{where}: no views")
        names = [(view.scene_id, view.view_id) for view in self.views]
        if len(set(names)) < len(names):
            raise ValueError(f"{where}: a view is listed twice")


def load_views(path: Path) -> ViewList:
    """Read a list of views; `InputError` names the fault."""
    return build(ViewList, read_json(path), str(path), InputError)


def pin_views(rows: DatasetRows, count: int, name: str, version: str) -> ViewList:
    """Return a list of `count` views spread evenly over the rows, or of all if 0."""
    chosen = rows.rows
    if 0 < count < len(chosen):
        chosen = [chosen[number] for number in np.linspace(0, len(chosen) - 1, count).astype(int)]
    pinned = [
        PinnedView(row.scene_id, row.view_id, truth_digest(content))
        for row, content in rows.read(chosen, TRUTH)
    ]
    return ViewList(name, version, tuple(pinned))


def save_views(path: Path, views: ViewList) -> None:
    """Write a list of views by rename."""
    write_json(path, plain(views))


def truth_digest(content: Content) -> str:
    """Return the SHA-256 of a view's truth: names, types, shapes and values of its images.

    Colour is in the renderer's unit, so that the unit in which a row stores it does not matter.
    """
    parts = []
    for name in TRUTH:
        values = np.ascontiguousarray(content.images[name])
        parts += [f"{name} {values.dtype.str} {values.shape}".encode(), values.tobytes()]
    return digest_bytes(*parts)


def truths(rows: DatasetRows, views: ViewList | None) -> Iterator[tuple[ViewRow, Content]]:
    """Yield rows and truth of the listed views, or of all rows without a list.

    Raises `InputError` for a view that the dataset lacks, or whose truth is another.
    """
    if views is None:
        yield from rows.read(rows.rows, TRUTH)
        return
    known = {(row.scene_id, row.view_id): row for row in rows.rows}
    for view in views.views:
        row = known.get((view.scene_id, view.view_id))
        if row is None:
            raise InputError(
                f"{rows.folder}: the view {view.scene_id}/{view.view_id} of the list "
                f"{views.name} is not in this dataset"
            )
        for _, content in rows.read([row], TRUTH):
            if truth_digest(content) != view.digest:
                raise InputError(
                    f"{rows.folder}: the ground truth of {row.name} differs from the list "
                    f"{views.name} {views.version}; make the benchmark's own dataset again, or "
                    "pin a new list"
                )
            yield row, content
