"""Descriptions of frames, shards, datasets and ledgers."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pbrnet.pipeline.costs.charts import draw_ledger, ledger_table
from pbrnet.pipeline.costs.ledger import SCHEMA, read_ledger_file
from pbrnet.pipeline.dataset.diversity import dataset_figures, draw_figures, summary_table
from pbrnet.pipeline.dataset.parquet import (
    check_filled,
    check_rows,
    check_types,
    open_parquet,
    reading,
)
from pbrnet.pipeline.frames import read_frame
from pbrnet.pipeline.images import Picture
from pbrnet.pipeline.inspection.drawings import draw_frame, draw_previews, picture_of
from pbrnet.pipeline.inspection.realism import draw_realism, measure
from pbrnet.pipeline.inspection.sections import Inspection, Table
from pbrnet.pipeline.terminal import counted
from pbrnet.pipeline.views import View
from pbrnet.scenes.checked import build
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import parse_json


def inspect_frame(path: Path) -> Inspection:
    """Describe a frame's attribute, camera and channels; draw every channel."""
    frame = read_frame(path)
    meta = frame.meta
    view = meta.get("view") or {}
    figures: Table = []
    for name, values in sorted(frame.channels.items()):
        wide = values.astype(np.float64)
        figures.append(
            {
                "channel": name,
                "type": str(values.dtype),
                "size": f"{values.shape[1]}x{values.shape[0]}",
                "min": f"{wide.min():.5g}",
                "mean": f"{wide.mean():.5g}",
                "max": f"{wide.max():.5g}",
                "not zero": f"{(wide != 0).mean():.1%}",
            }
        )
    hidden = ("view", "digest")
    camera: dict[str, Any] = {}
    if view:
        camera_view = build(View, view, str(path), InputError)
        forward = camera_view.pose[:3, 2]
        camera = {
            "room": f"{camera_view.room or 'unknown'} ({camera_view.room_type})",
            "eye": " ".join(f"{value:.3f}" for value in camera_view.eye) + " m",
            "towards": " ".join(f"{value:.3f}" for value in forward),
            "field of view": f"{2 * math.degrees(camera_view.half_fov_x):.1f} degrees wide",
        }
    return Inspection(
        "frame",
        f"Frame {path.name} of kind {meta.get('kind', 'unknown')}, scene "
        f"{view.get('scene_id', 'unknown')}, view {view.get('view_id', 'unknown')}",
        {
            "Description": {key: value for key, value in meta.items() if key not in hidden},
            "Camera": camera,
            "Channels": figures,
        },
        lambda: draw_frame(frame),
    )


def inspect_parquet(path: Path) -> Inspection:
    """Describe a ledger or a shard, by its columns."""
    if {*SCHEMA.names} <= {*open_parquet(path).schema_arrow.names}:
        return inspect_ledger(path)
    return inspect_shards([path], path.name)


def inspect_shards(paths: Sequence[Path], name: str) -> Inspection:
    """Describe rows, columns and sizes of shards; draw a contact sheet of previews."""
    files = [_open_shard(path) for path in paths]
    schema = files[0].schema_arrow
    sizes: Counter[str] = Counter()
    raw: Counter[str] = Counter()
    stored: dict[str, str] = {}
    for file in files:
        for group in range(file.metadata.num_row_groups):
            row_group = file.metadata.row_group(group)
            for index in range(row_group.num_columns):
                chunk = row_group.column(index)
                column = chunk.path_in_schema.split(".")[0]
                sizes[column] += chunk.total_compressed_size
                raw[column] += chunk.total_uncompressed_size
                stored[column] = f"{_encoding(chunk.encodings)}, {chunk.compression.lower()}"
    columns: Table = []
    for field in schema:
        metadata = field.metadata or {}
        columns.append(
            {
                "column": field.name,
                "type": metadata.get(b"dtype", b"").decode("utf-8", "replace") or _type(field.type),
                "shape": _shape(name, field),
                "unit": metadata.get(b"unit", b"").decode("utf-8", "replace"),
                "kB": round(sizes[field.name] / 1e3, 1),
                "of raw": f"{sizes[field.name] / max(1, raw[field.name]):.0%}",
                "stored": stored.get(field.name, ""),
            }
        )
    rows: Table = []
    scenes: dict[str, set[str]] = {}
    for path, file in zip(paths, files, strict=True):
        with reading(path):
            ids = file.read(columns=["scene_id", "split"])
        check_filled(path, ids, ids.column_names)
        split = ids["split"][0].as_py() if file.metadata.num_rows else "?"
        scenes.setdefault(split, set()).update(ids["scene_id"].to_pylist())
        rows.append(
            {
                "file": path.name,
                "rows": file.metadata.num_rows,
                "row groups": file.metadata.num_row_groups,
                "MB": round(path.stat().st_size / 1e6, 2),
            }
        )
    total = sum(file.metadata.num_rows for file in files)
    return Inspection(
        "dataset" if len(paths) > 1 else "shard",
        f"{name}: {counted(total, 'view')} in {counted(len(paths), 'file')}",
        {
            "Scenes by split": {split: len(names) for split, names in sorted(scenes.items())},
            "Files": rows,
            "Columns": columns,
        },
        lambda: _previews(paths, files),
    )


def inspect_ledger(path: Path) -> Inspection:
    """Describe costs by stage; draw seconds, hours and memory."""
    ledger = read_ledger_file(path)
    return Inspection(
        "ledger",
        f"Ledger {path}: {counted(ledger.num_rows, 'row')}",
        {"Stages": ledger_table(ledger)},
        lambda: picture_of(draw_ledger(ledger)),
    )


def inspect_diversity(folder: Path) -> Inspection:
    """Describe the distributions of view statistics by source; draw histograms.

    Reads all images. Raises `InputError` if `folder` is no dataset.
    """
    shards = sorted(folder.glob("*.parquet"))
    if not shards:
        raise InputError(f"{folder}: not a dataset folder; --diversity requires one")
    figures = dataset_figures(shards)
    views = sum(len(values["depth"]) for values in figures.values())
    return Inspection(
        "diversity",
        f"{folder}: {counted(views, 'view')} from {counted(len(figures), 'source')}",
        {"Figures": summary_table(figures)},
        lambda: picture_of(draw_figures(figures)),
    )


def inspect_realism(data: Path) -> Inspection:
    """Describe figures of the pictures of a data folder, beside those of photographs.

    Reads all frames of colour. Raises `InputError` if `data` has none.
    """
    found = measure(data)
    views = len(next(iter(found.views.values())))
    classes = [{"class": name, "share": f"{share:.1%}"} for name, share in found.classes.items()]
    return Inspection(
        "realism",
        f"{data}: {counted(views, 'view')}",
        {"Figures": found.table(), "Pixels by NYU40 class": classes, "Repeats": found.repeats},
        lambda: picture_of(draw_realism(found)),
    )


def _open_shard(path: Path) -> pq.ParquetFile:
    file = open_parquet(path)
    needed = {"scene_id", "view_id", "split", "preview"}
    missing = needed - set(file.schema_arrow.names)
    if missing:
        raise InputError(
            f"{path}: Parquet, but not a shard of pbrnet: no column {', '.join(sorted(missing))}"
        )
    check_types(path, file.schema_arrow, needed)
    check_rows(path, file)
    return file


def _type(kind: pa.DataType) -> str:
    """Return the type of the values of a column; of numbers, for lists of lists."""
    while pa.types.is_fixed_size_list(kind):
        kind = kind.value_type
    return str(kind).split("<")[0]


def _shape(name: str, field: pa.Field) -> str:
    text = (field.metadata or {}).get(b"shape")
    if text is None:
        return ""
    shape = parse_json(text, f"{name}: shape of {field.name!r}")
    if not isinstance(shape, list) or not all(isinstance(one, int) for one in shape):
        raise InputError(f"{name}: the column {field.name!r} has no readable shape metadata")
    return " x ".join(map(str, shape))


def _previews(paths: Sequence[Path], files: Sequence[pq.ParquetFile]) -> Picture:
    with reading(paths[0].parent if len(paths) > 1 else paths[0]):
        return draw_previews(files)


def _encoding(names: Sequence[str]) -> str:
    """Return the name of a column chunk's main encoding."""
    if "BYTE_STREAM_SPLIT" in names:
        return "byte stream split"
    return "dictionary" if "RLE_DICTIONARY" in names else "plain"
