"""Description of any file or folder of the pipeline, for `pbrnet inspect`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from pbrnet.pipeline.inspection.datasets import inspect_frame, inspect_parquet, inspect_shards
from pbrnet.pipeline.inspection.models import inspect_model
from pbrnet.pipeline.inspection.scenes import (
    inspect_assets,
    inspect_cameras,
    inspect_piece,
    inspect_scene,
)
from pbrnet.pipeline.inspection.sections import Inspection
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
