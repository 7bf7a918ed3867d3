"""Splits made for a study: rows of a dataset, some with another truth, under another split's name.

Rows keep their order and, but for those that are left out, their row groups, so that two packs of
the same rows are read in the same order whatever their truth.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from model.data.reader import IMAGES, SCALARS, Dataset, Split
from pipeline.channels import Kind
from pipeline.params import ToneParams
from pipeline.tonemap import exposure_of
from scenes.arrays import AnyArray
from scenes.files import atomic_directory, sweep, write_text

TRUTHS: tuple[Kind, ...] = ("shading", "color")
Truth = dict[str, AnyArray]  # `shading` and `color`, linear, (H, W, 3)
Find = Callable[[str, str], Truth]  # by scene and view
_KEPT = (*SCALARS, *IMAGES, "licence", "attribution")


def pack(
    data: Path,
    mark: str,
    parts: Callable[[], Iterable[Dataset]],
    split: Split,
    tone: ToneParams | None = None,
    find: Find | None = None,
) -> None:
    """Write the rows of `parts` (of one image size) as `split` into `data/dataset`.

    `mark` is of all that determines them: nothing is done if it is that of what is there.
    With `find`, shading and colour come from it, and so do their exposures, under `tone`.
    `scenes.csv` comes along, with the plans of these scenes. The folder appears by rename.
    """
    folder = data / "dataset"
    known_by = folder / "mark"
    if known_by.is_file() and known_by.read_text(encoding="utf-8") == mark:
        return
    sweep(data)
    plans: dict[str, str] = {}
    with atomic_directory(folder) as partial:
        write_text(partial / known_by.name, mark)
        path = partial / f"{split}-00000-of-00001.parquet"
        writer: pq.ParquetWriter | None = None
        try:
            for part in parts():
                known = part.plans()
                for table in _tables(part):
                    scenes = table.column("scene_id").to_pylist()
                    plans |= {scene: known.get(scene, scene) for scene in scenes}
                    table = _put(table, "split", pa.array([split] * len(table)))
                    if find is not None:
                        table = _with_truth(table, tone or ToneParams(), find)
                    writer = writer or pq.ParquetWriter(path, table.schema, compression="zstd")
                    writer.write_table(table)
        finally:
            if writer is not None:
                writer.close()
        text = io.StringIO()
        lines = csv.writer(text, lineterminator="\n")
        lines.writerow(("scene_id", "plan"))
        lines.writerows(sorted(plans.items()))
        write_text(partial / "scenes.csv", text.getvalue())


def _tables(part: Dataset) -> Iterator[pa.Table]:
    """The rows that count of every row group that has any."""
    for path, groups in zip(part.shards, part.groups, strict=True):
        with pq.ParquetFile(path) as file:
            for group, rows in enumerate(groups):
                if rows:
                    table = file.read_row_group(group, columns=list(_KEPT))
                    yield table.take(pa.array(rows, pa.int64()))


def _with_truth(table: pa.Table, tone: ToneParams, find: Find) -> pa.Table:
    """Other shading and colour, each with its own exposure, as the dataset stage finds them."""
    keys = zip(*(table.column(name).to_pylist() for name in ("scene_id", "view_id")), strict=True)
    truths = [find(scene, view) for scene, view in keys]
    for name in TRUTHS:
        images = [truth[name].astype(np.float16) for truth in truths]
        kind = table.schema.field(name).type
        for image in images:
            if image.size != kind.list_size:
                raise ValueError(f"{name}: {image.shape}, not {kind.list_size} values")
        flat = pa.array(np.concatenate([image.ravel() for image in images]), kind.value_type)
        table = _put(table, name, pa.FixedSizeListArray.from_arrays(flat, type=kind))
        exposures = [exposure_of(image.astype(np.float32), tone) for image in images]
        scales, whites = ([getattr(e, part) for e in exposures] for part in ("scale", "white"))
        table = _put(table, f"exposure_{name}", pa.array(scales, pa.float64()))
        table = _put(table, f"white_{name}", pa.array(whites, pa.float64()))
    return table


def _put(table: pa.Table, name: str, values: pa.Array) -> pa.Table:
    """The table with another column under a field's name and metadata."""
    index = table.schema.get_field_index(name)
    field = table.schema.field(index)
    return table.set_column(index, field, values.cast(field.type))
