"""Description of any file or folder of the pipeline, for `pbrnet inspect`."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from safetensors import SafetensorError, safe_open

from pbrnet.pipeline.inspection.datasets import inspect_frame, inspect_parquet, inspect_shards
from pbrnet.pipeline.inspection.drawings import draw_layers
from pbrnet.pipeline.inspection.scenes import (
    inspect_assets,
    inspect_cameras,
    inspect_piece,
    inspect_scene,
)
from pbrnet.pipeline.inspection.sections import Inspection, Table
from pbrnet.pipeline.terminal import counted
from pbrnet.scenes.assets.index import INDEX
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import read_json

KNOWN = (
    "a scene folder, a camera file (.json), a frame (.exr), a shard (.parquet), "
    "a dataset folder, a ledger of costs, a model (.safetensors), or furniture catalogues "
    "(data/assets)"
)


def inspect_path(path: Path, renders: bool = True) -> Inspection:
    """Return the description of `path`, whose kind is detected.

    With `renders` the picture of a scene contains renders, see `inspect_scene`. Raises `InputError`
    for a damaged file or one of another kind.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(f"{path}: no such file or folder")
    if path.is_dir():
        if (path / "scene.json").is_file():
            return inspect_scene(path, renders)
        if any(path.glob("*.parquet")):
            return inspect_shards(sorted(path.glob("*.parquet")), str(path))
        if (path / INDEX).is_file():
            return inspect_assets(path)
        if (path / "piece.json").is_file():
            return inspect_piece(path)
        raise InputError(f"{path}: not a folder that pbrnet writes; can inspect {KNOWN}")
    readers: dict[str, Callable[[Path], Inspection]] = {
        ".exr": inspect_frame,
        ".parquet": inspect_parquet,
        ".safetensors": inspect_model,
        ".json": lambda file: _inspect_json(file, renders),
    }
    if path.name == "scene.xml":
        return inspect_scene(path.parent, renders)
    if path.suffix.lower() not in readers:
        raise InputError(f"{path}: unknown kind of file; can inspect {KNOWN}")
    return readers[path.suffix.lower()](path)


def _inspect_json(path: Path, renders: bool) -> Inspection:
    content = read_json(path)
    if path.name == "scene.json":
        return inspect_scene(path.parent, renders)
    if isinstance(content, dict) and isinstance(content.get("views"), list):
        return inspect_cameras(path)
    if path.with_suffix(".safetensors").is_file():
        return inspect_model(path.with_suffix(".safetensors"))
    raise InputError(
        f"{path}: JSON, but neither a camera file nor a model card; can inspect {KNOWN}"
    )


def inspect_model(path: Path) -> Inspection:
    """Describe tensors, parameter counts and the model card; draw the sizes of layers as bars."""
    tensors: Table = []
    counts: Counter[str] = Counter()
    try:
        with safe_open(str(path), framework="numpy") as file:
            metadata = dict(file.metadata() or {})
            for name in file.keys():  # noqa: SIM118  (not a mapping)
                tensor = file.get_slice(name)
                shape = tensor.get_shape()
                tensors.append(
                    {
                        "tensor": name,
                        "type": tensor.get_dtype(),
                        "shape": " x ".join(map(str, shape)),
                    }
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
        f"Model {path.name}: {counted(sum(counts.values()), 'parameter')} in "
        f"{counted(len(tensors), 'tensor')}",
        {
            "Card": _flatten(card) or ["There is no model card beside the file."],
            "Metadata of the file": metadata,
            "Tensors": tensors,
        },
        lambda: draw_layers(path.name, counts),
    )


def _flatten(value: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, item in value.items():
        if isinstance(item, dict):
            flat.update(_flatten(item, f"{prefix}{key}."))
        else:
            flat[f"{prefix}{key}"] = item
    return flat
