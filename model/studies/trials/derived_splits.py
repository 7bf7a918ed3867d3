"""Splits derived from a dataset for a study: some of its rows, optionally with other ground truth.

Rows keep their order and their row groups (without the rows that are left out), so that two splits
with the same rows are read in the same order whatever their ground truth.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pbrnet.model.data.reader import PAPER, SCALARS, Dataset, Split
from pbrnet.model.methods import JOINS
from pbrnet.pipeline.channels import HALF_MAX, RADIANCE_SCALE, TRUTHS
from pbrnet.pipeline.dataset.parquet import image_cell
from pbrnet.pipeline.tonemap import ToneParams, exposure_of
from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.files import atomic_directory, sweep, write_text

TruthImages = dict[str, AnyArray]  # `shading` and `color`, linear (H, W, 3)
TruthLookup = Callable[[str, str], TruthImages]  # (scene_id, view_id) -> images
_JOINED = {column for join in JOINS.values() for column in join.columns}
_KEPT = (*SCALARS, *PAPER, *sorted(_JOINED - {*SCALARS, *PAPER}), "licence", "attribution")


def write_derived_split(
    data: Path,
    fingerprint: str,
    parts: Callable[[], Iterable[Dataset]],
    split: Split,
    tone: ToneParams | None = None,
    lookup: TruthLookup | None = None,
) -> None:
    """Write the rows of `parts` (of one image size) as `split` into `data/dataset`, by rename.

    `fingerprint` identifies everything that determines the rows; a split with the same one is
    kept. `lookup` replaces shading and colour; their exposures are computed with `tone`. The
    folder's `scenes.csv` has the floor plans of these scenes.
    """
    folder = data / "dataset"
    stamp = folder / "mark"
    if stamp.is_file() and stamp.read_text(encoding="utf-8") == fingerprint:
        return
    sweep(data)
    plans: dict[str, str] = {}
    with atomic_directory(folder) as partial:
        write_text(partial / stamp.name, fingerprint)
        path = partial / f"{split}-00000-of-00001.parquet"
        writer: pq.ParquetWriter | None = None
        try:
            for part in parts():
                known = part.plans()
                for table in _tables(part):
                    scenes = table.column("scene_id").to_pylist()
                    plans |= {scene: known.get(scene, scene) for scene in scenes}
                    table = _put(table, "split", pa.array([split] * len(table)))
                    if lookup is not None:
                        table = _with_truth(table, tone or ToneParams(), lookup)
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
    """Read the selected rows of every row group that has any."""
    for path, groups in zip(part.shards, part.groups, strict=True):
        with pq.ParquetFile(path) as file:
            for group, rows in enumerate(groups):
                if rows:
                    names = [*_KEPT, RADIANCE_SCALE]
                    table = file.read_row_group(group, columns=names)
                    yield table.take(pa.array(rows, pa.int64()))


def _with_truth(table: pa.Table, tone: ToneParams, lookup: TruthLookup) -> pa.Table:
    """Replace shading and colour, in each row's unit, and compute their exposures.

    As the dataset stage does, but for values beyond half floats in that unit, which are clamped.
    """
    keys = zip(*(table.column(name).to_pylist() for name in ("scene_id", "view_id")), strict=True)
    truths = [lookup(scene, view) for scene, view in keys]
    if RADIANCE_SCALE in table.column_names:
        units = np.array(table.column(RADIANCE_SCALE), dtype=np.float32)
    else:
        units = np.ones(len(table), np.float32)
    for name in TRUTHS:
        images = [
            np.clip(truth[name] / unit, -HALF_MAX, HALF_MAX).astype(np.float16)
            for truth, unit in zip(truths, units, strict=True)
        ]
        shape = tuple(json.loads(table.schema.field(name).metadata[b"shape"]))
        for image in images:
            if image.shape != shape:
                raise ValueError(f"{name}: {image.shape}, expected {shape}")
        table = _put(table, name, pa.array([image_cell(image) for image in images], pa.binary()))
        exposures = [
            exposure_of(image.astype(np.float32) * unit, tone)
            for image, unit in zip(images, units, strict=True)
        ]
        scales, whites = ([getattr(e, part) for e in exposures] for part in ("scale", "white"))
        table = _put(table, f"exposure_{name}", pa.array(scales, pa.float64()))
        table = _put(table, f"white_{name}", pa.array(whites, pa.float64()))
    return table


def _put(table: pa.Table, name: str, values: pa.Array) -> pa.Table:
    """Replace a column, keeping the field's name and metadata."""
    index = table.schema.get_field_index(name)
    field = table.schema.field(index)
    return table.set_column(index, field, values.cast(field.type))
