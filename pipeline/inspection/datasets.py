"""Descriptions of frames, shards, datasets and ledgers."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.costs.charts import draw_ledger
from pipeline.costs.table import is_ledger, ledger_table
from pipeline.dataset.diversity import dataset_figures, draw_figures, summary_table
from pipeline.frames import read_frame
from pipeline.inspection.drawings import counted, draw_frame, draw_previews, picture_of
from pipeline.inspection.sections import Inspection, Table
from pipeline.views import View
from scenes.checked import build
from scenes.errors import InputError


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
        half = math.atan(0.5 * camera_view.width / camera_view.intrinsics[0, 0])
        forward = camera_view.pose[:3, 2]
        camera = {
            "room": f"{camera_view.room or 'unknown'} ({camera_view.room_type})",
            "eye": " ".join(f"{value:.3f}" for value in camera_view.eye) + " m",
            "towards": " ".join(f"{value:.3f}" for value in forward),
            "field of view": f"{2 * math.degrees(half):.1f} degrees wide",
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
    if is_ledger(_open_parquet(path).schema_arrow):
        return inspect_ledger(path)
    return inspect_shards([path], path.name)


def inspect_shards(paths: Sequence[Path], name: str) -> Inspection:
    """Describe rows, columns and sizes of shards; draw a contact sheet of previews."""
    files = [_open_shard(path) for path in paths]
    schema = files[0].schema_arrow
    sizes: Counter[str] = Counter()
    raw: Counter[str] = Counter()
    encodings: dict[str, str] = {}
    for file in files:
        for group in range(file.metadata.num_row_groups):
            row_group = file.metadata.row_group(group)
            for index in range(row_group.num_columns):
                chunk = row_group.column(index)
                column = chunk.path_in_schema.split(".")[0]
                sizes[column] += chunk.total_compressed_size
                raw[column] += chunk.total_uncompressed_size
                encodings[column] = _encoding(chunk.encodings)
    columns: Table = []
    for field in schema:
        metadata = field.metadata or {}
        listed = pa.types.is_fixed_size_list(field.type)
        columns.append(
            {
                "column": field.name,
                "type": str(field.type.value_type if listed else field.type).split("<")[0],
                "shape": " x ".join(map(str, json.loads(metadata.get(b"shape", b"[]")))),
                "unit": metadata.get(b"unit", b"").decode(),
                "kB": round(sizes[field.name] / 1e3, 1),
                "of raw": f"{sizes[field.name] / max(1, raw[field.name]):.0%}",
                "encoding": encodings.get(field.name, ""),
            }
        )
    rows: Table = []
    scenes: dict[str, set[str]] = {}
    for path, file in zip(paths, files, strict=True):
        ids = file.read(columns=["scene_id", "split"])
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
        f"{name}: {counted(range(total), 'view')} in {counted(paths, 'file')}",
        {
            "Scenes by split": {split: len(names) for split, names in sorted(scenes.items())},
            "Files": rows,
            "Columns": columns,
        },
        lambda: draw_previews(files),
    )


def inspect_ledger(path: Path) -> Inspection:
    """Describe costs by stage; draw seconds, hours and memory."""
    ledger = pq.read_table(path)
    return Inspection(
        "ledger",
        f"Ledger {path}: {counted(range(ledger.num_rows), 'row')}",
        {"Stages": ledger_table(ledger)},
        lambda: picture_of(draw_ledger(ledger)),
    )


def inspect_diversity(folder: Path) -> Inspection:
    """Describe the distributions of view statistics by source; draw histograms.

    Reads all images. Raises `InputError` if `folder` is no dataset.
    """
    shards = sorted(folder.glob("*.parquet"))
    if not shards:
        raise InputError(f"{folder}: not a dataset folder; --diversity needs one")
    figures = dataset_figures(shards)
    views = sum(len(values["depth"]) for values in figures.values())
    return Inspection(
        "diversity",
        f"{folder}: {counted(range(views), 'view')} from {counted(figures, 'source')}",
        {"Figures": summary_table(figures)},
        lambda: picture_of(draw_figures(figures)),
    )


def _open_parquet(path: Path) -> pq.ParquetFile:
    try:
        return pq.ParquetFile(path)
    except (pa.ArrowInvalid, OSError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{path}: damaged, truncated or not Parquet ({reason})") from None


def _open_shard(path: Path) -> pq.ParquetFile:
    file = _open_parquet(path)
    needed = {"scene_id", "view_id", "split", "preview"}
    missing = needed - set(file.schema_arrow.names)
    if missing:
        raise InputError(
            f"{path}: Parquet, but not a shard of pbrnet: no column {', '.join(sorted(missing))}"
        )
    return file


def _encoding(names: Sequence[str]) -> str:
    """Return the name of a column chunk's main encoding."""
    if "BYTE_STREAM_SPLIT" in names:
        return "byte stream split"
    return "dictionary" if "RLE_DICTIONARY" in names else "plain"
