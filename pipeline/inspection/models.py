"""Description of a trained network: layers, parameters and model card."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path
from typing import Any

from safetensors import SafetensorError, safe_open

from pbrnet.pipeline.inspection.drawings import counted, draw_layers
from pbrnet.pipeline.inspection.sections import Inspection, Table
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import read_json


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
        f"Model {path.name}: {sum(counts.values()):,} parameters in {counted(tensors, 'tensor')}",
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
