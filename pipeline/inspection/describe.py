"""What a file of ours holds, in words and as a picture: `pbrnet inspect`.

Understands a scene folder, a camera file, a frame, a shard, a dataset folder, a model and
furniture catalogues.
Whatever else, or damaged, is refused with an `InputError` that says what it looks like.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from safetensors import SafetensorError, safe_open

from pipeline.costs.table import draw_ledger, is_ledger, ledger_table
from pipeline.dataset.diversity import dataset_figures, draw_figures, summary_table
from pipeline.frames import read_frame
from pipeline.images import Picture
from pipeline.inspection.asset_sheet import describe_asset, describe_index, draw_asset, draw_index
from pipeline.inspection.drawings import (
    counted,
    draw_cameras,
    draw_frame,
    draw_layers,
    draw_plan,
    draw_previews,
    draw_scene,
    floor_area,
    picture_of,
)
from pipeline.inspection.sizes import scene_sizes
from pipeline.render.leaks import find_leaks
from pipeline.render.scene import open_scene, set_variant
from pipeline.views import View, load_cameras
from scenes.assets.index import INDEX, load_asset, load_index
from scenes.checked import build
from scenes.contract import load_scene
from scenes.errors import InputError
from scenes.files import read_json

Table = list[dict[str, Any]]
# A section is a mapping of names to values, a table, or a list of sentences.
Section = dict[str, Any] | Table | list[str]

KNOWN = (
    "a scene folder, a camera file (.json), a frame (.exr), a shard (.parquet), "
    "a dataset folder, a ledger of costs, a model (.safetensors), or furniture catalogues "
    "(data/assets)"
)


@dataclass(frozen=True)
class Inspection:
    """`sections` hold what there is to say, as plain data; `draw` makes the picture."""

    kind: str
    title: str
    sections: dict[str, Section]
    draw: Callable[[], Picture]

    @property
    def text(self) -> str:
        """The sections as aligned text."""
        parts = [self.title]
        for name, section in self.sections.items():
            if section:
                parts.append(f"\n{name}\n" + "\n".join(_section_lines(section)))
        return "\n".join(parts)

    @property
    def json(self) -> str:
        """The same, machine-readable."""
        content = {"kind": self.kind, "title": self.title, **self.sections}
        return json.dumps(content, indent=1, default=str)


def inspect_path(path: Path, renders: bool = True) -> Inspection:
    """Find out what `path` is and describe it; `InputError` if it is none of ours or damaged.

    With `renders` the picture of a scene holds more than its plan: see `inspect_scene`.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(f"{path}: there is nothing here")
    if path.is_dir():
        if (path / "scene.json").is_file():
            return inspect_scene(path, renders)
        if any(path.glob("*.parquet")):
            return inspect_shards(sorted(path.glob("*.parquet")), str(path))
        if (path / INDEX).is_file():
            return inspect_assets(path)
        if (path / "piece.json").is_file():
            return inspect_piece(path)
        raise InputError(f"{path}: nothing of ours in this folder; can inspect {KNOWN}")
    readers: dict[str, Callable[[Path], Inspection]] = {
        ".exr": inspect_frame,
        ".parquet": _inspect_parquet,
        ".safetensors": inspect_model,
        ".json": lambda file: _inspect_json(file, renders),
    }
    if path.name == "scene.xml":
        return inspect_scene(path.parent, renders)
    if path.suffix.lower() not in readers:
        raise InputError(f"{path}: do not know this kind of file; can inspect {KNOWN}")
    return readers[path.suffix.lower()](path)


def inspect_scene(folder: Path, renders: bool = True) -> Inspection:
    """Rooms, objects, sizes, lights, portals, credits; drawn as a plan, with cameras if there are.

    With `renders` a dollhouse view and two quick renders stand below the plan.
    """
    scene = load_scene(folder)
    camera_path = folder.resolve().parent.parent / "cameras" / f"{scene.scene_id}.json"
    views = load_cameras(camera_path).views if camera_path.is_file() else ()
    rooms: Table = [
        {
            "room": room.id,
            "name": room.name,
            "type": room.type,
            "m2": round(floor_area(room.floor), 1),
            "height m": round(room.ceiling_z - room.floor_z, 2),
            "light": "yes" if room.has_light else "no",
            "objects": sum(thing.room == room.id for thing in scene.objects),
            "views": sum(view.room == room.id for view in views),
        }
        for room in scene.rooms
    ]
    categories = Counter(thing.category for thing in scene.objects if not thing.is_structure)
    lumens = [light.lumens for light in scene.lights if light.lumens is not None]
    return Inspection(
        "scene",
        f"Scene {scene.scene_id}: {counted(scene.rooms, 'room')}, "
        f"{counted(scene.objects, 'object')}, {counted(scene.lights, 'light')}, "
        f"{counted(scene.portals, 'portal')}",
        {
            "General": {
                **{f"source {key}": value for key, value in scene.source.items()},
                "lighting": scene.lighting,
                "plan": scene.plan or scene.scene_id,
                "units": scene.units,
                "shapes": sum(len(thing.shapes) for thing in scene.objects),
                "views sampled": len(views),
            },
            "Size": scene_sizes(scene),
            "Rooms": rooms,
            "Furniture": dict(categories.most_common()),
            "Lights": {
                **Counter(light.kind for light in scene.lights),
                **({"lumens together": round(sum(lumens))} if lumens else {}),
            },
            "Portals": [
                {
                    "portal": portal.id,
                    "kind": portal.kind,
                    "clear": "yes" if portal.clear else "no",
                    "room": portal.room or "",
                }
                for portal in scene.portals
            ],
            "Credits": [
                {
                    "part": credit.part,
                    "title": credit.title,
                    "author": credit.author,
                    "licence": credit.licence,
                    "source": credit.source,
                }
                for credit in scene.credits
            ],
            "Changed or lost in import": list(scene.changes),
        },
        lambda: draw_scene(scene, views) if renders else draw_plan(scene, views),
    )


def inspect_assets(folder: Path) -> Inspection:
    """Libraries, categories, licences and refusals; drawn as a sheet of pieces by category."""
    index = load_index(folder)
    total = len(index.pieces) + len(index.refused)
    return Inspection(
        "assets",
        f"Furniture catalogues: {len(index.pieces)} of {total} pieces usable, "
        f"from {len(index.libraries)} libraries",
        describe_index(index),
        lambda: draw_index(index),
    )


def inspect_piece(folder: Path) -> Inspection:
    """One converted catalogue piece; drawn as its picture."""
    asset = load_asset(folder)
    return Inspection(
        "piece",
        f"Catalogue piece {asset.piece.key}: {asset.piece.name}, {counted(asset.parts, 'part')}",
        describe_asset(asset),
        lambda: draw_asset(folder),
    )


def inspect_cameras(path: Path) -> Inspection:
    """Views with score and what they see, and why candidates were dropped; drawn on the plan."""
    cameras = load_cameras(path)
    folder = path.resolve().parent.parent / "scenes" / cameras.scene_id
    scene = load_scene(folder) if (folder / "scene.json").is_file() else None
    views: Table = [
        {
            "view": view.view_id,
            "room": view.room or "",
            "type": view.room_type,
            "sector": view.sector,
            "score": round(view.score, 2),
            "objects": len(view.seen),
            "size": f"{view.width}x{view.height}",
            "eye": " ".join(f"{value:.2f}" for value in view.eye),
            "sees most": ", ".join(sorted(view.seen, key=lambda name: -view.seen[name])[:3]),
        }
        for view in cameras.views
    ]
    return Inspection(
        "cameras",
        f"Cameras of scene {cameras.scene_id}: {counted(cameras.views, 'view')} "
        f"from {cameras.candidates} candidates",
        {"Candidates dropped": dict(cameras.rejected), "Views": views},
        lambda: draw_plan(scene, cameras.views) if scene else draw_cameras(cameras),
    )


def inspect_frame(path: Path) -> Inspection:
    """Figures of every channel and the frame's own description; drawn as pictures."""
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
        seen_from = build(View, view, str(path), InputError)
        half = math.atan(0.5 * seen_from.width / seen_from.intrinsics[0, 0])
        forward = seen_from.pose[:3, 2]
        camera = {
            "room": f"{seen_from.room or 'unknown'} ({seen_from.room_type})",
            "eye": " ".join(f"{value:.3f}" for value in seen_from.eye) + " m",
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


def inspect_shards(paths: Sequence[Path], name: str) -> Inspection:
    """Rows, columns and sizes of one shard or a whole dataset; drawn as a sheet of previews."""
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
    """What everything cost, by stage; drawn as seconds, hours and memory."""
    ledger = pq.read_table(path)
    return Inspection(
        "ledger",
        f"Ledger {path}: {counted(range(ledger.num_rows), 'thing')} made",
        {"Stages": ledger_table(ledger)},
        lambda: picture_of(draw_ledger(ledger)),
    )


def inspect_diversity(folder: Path) -> Inspection:
    """How varied a dataset's views are, source by source; reads all its images."""
    shards = sorted(folder.glob("*.parquet"))
    if not shards:
        raise InputError(f"{folder}: no dataset folder, and only a dataset has a diversity")
    figures = dataset_figures(shards)
    views = sum(len(values["depth"]) for values in figures.values())
    return Inspection(
        "diversity",
        f"{folder}: {counted(range(views), 'view')} from {counted(figures, 'kind')} of scenes",
        {"Figures": summary_table(figures)},
        lambda: picture_of(draw_figures(figures)),
    )


def with_leaks(inspection: Inspection, path: Path) -> Inspection:
    """A scene's inspection with one section more: where its rooms leak light."""
    if inspection.kind != "scene":
        raise InputError(f"{path}: no scene, and only a scene has leaks")
    set_variant()
    leaks = find_leaks(open_scene(load_scene(path if path.is_dir() else path.parent)))
    words = [str(leak) for leak in leaks] or ["none: with all portals closed no light gets in"]
    return replace(inspection, sections={**inspection.sections, "Leaks": words})


def inspect_model(path: Path) -> Inspection:
    """Layers, parameter counts and the JSON card beside it; drawn as bars of layer sizes."""
    tensors: Table = []
    counts: Counter[str] = Counter()
    try:
        with safe_open(str(path), framework="numpy") as file:
            notes = dict(file.metadata() or {})
            for name in file.keys():  # noqa: SIM118  (not a mapping)
                part = file.get_slice(name)
                shape = part.get_shape()
                tensors.append(
                    {"tensor": name, "type": part.get_dtype(), "shape": " x ".join(map(str, shape))}
                )
                counts[name.rpartition(".")[0] or name] += math.prod(shape)
    except (SafetensorError, OSError, ValueError) as error:
        raise InputError(f"{path}: not a readable safetensors file ({error})") from None
    card_path = path.with_suffix(".json")
    card = read_json(card_path) if card_path.is_file() else {}
    if not isinstance(card, dict):
        raise InputError(f"{card_path}: expected a JSON object")
    return Inspection(
        "model",
        f"Model {path.name}: {sum(counts.values()):,} parameters in {counted(tensors, 'tensor')}",
        {
            "Card": _flatten(card) or ["There is no JSON card beside it."],
            "Notes in the file": notes,
            "Tensors": tensors,
        },
        lambda: draw_layers(path.name, counts),
    )


def _inspect_parquet(path: Path) -> Inspection:
    if is_ledger(_open_parquet(path).schema_arrow):
        return inspect_ledger(path)
    return inspect_shards([path], path.name)


def _inspect_json(path: Path, renders: bool) -> Inspection:
    content = read_json(path)
    if path.name == "scene.json":
        return inspect_scene(path.parent, renders)
    if isinstance(content, dict) and "views" in content:
        return inspect_cameras(path)
    if path.with_suffix(".safetensors").is_file():
        return inspect_model(path.with_suffix(".safetensors"))
    raise InputError(f"{path}: JSON, but neither cameras nor a model's card; can inspect {KNOWN}")


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
        raise InputError(f"{path}: Parquet, but not ours: no column {', '.join(sorted(missing))}")
    return file


def _encoding(names: Sequence[str]) -> str:
    """The one that matters of the encodings in a column chunk."""
    if "BYTE_STREAM_SPLIT" in names:
        return "byte stream split"
    return "dictionary" if "RLE_DICTIONARY" in names else "plain"


def _flatten(value: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, item in value.items():
        if isinstance(item, dict):
            flat.update(_flatten(item, f"{prefix}{key}."))
        else:
            flat[f"{prefix}{key}"] = item
    return flat


def _section_lines(section: Section) -> list[str]:
    if isinstance(section, dict):
        width = max(len(key) for key in section)
        return [f"  {key:{width}}  {_shorten(value)}" for key, value in section.items()]
    if isinstance(section[0], str):
        return [f"  - {sentence}" for sentence in section]
    rows = [row for row in section if isinstance(row, dict)]
    names = list(rows[0])
    widths = {name: max(len(name), *(len(str(row[name])) for row in rows)) for name in names}
    numeric = {name: all(isinstance(row[name], (int, float)) for row in rows) for name in names}
    lines = ["  " + "  ".join(_pad(name, widths[name], numeric[name]) for name in names).rstrip()]
    lines += [
        "  " + "  ".join(_pad(row[name], widths[name], numeric[name]) for name in names).rstrip()
        for row in rows
    ]
    return lines


def _shorten(value: Any, most: int = 120) -> str:
    text = str(value)
    return text if len(text) <= most else f"{text[: most - 1]}…"


def _pad(value: Any, width: int, right: bool) -> str:
    return f"{value!s:>{width}}" if right else f"{value!s:<{width}}"
