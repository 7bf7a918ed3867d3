"""Every kind of scene that can be imported: one line each, picked by the file's suffix."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from scenes.checked import check_name
from scenes.contract import Scene, load_scene, save_scene, writing_scene
from scenes.errors import InputError
from scenes.files import copy_files
from scenes.mitsuba.importer import MitsubaOptions, import_mitsuba
from scenes.models.importer import import_model, options_of
from scenes.sweethome.importer import SweetHomeOptions, import_sweethome


def import_scene(path: Path, out: Path, scene_id: str | None = None, **options: Any) -> Scene:
    """Bring the scene at `path` into the scene folder `out`, whatever kind it is.

    `path` is a file of a kind in `SOURCES`, or a scene folder (with `scene.json`), which is
    checked and copied. `scene_id` defaults to the name of `out`. `options` are those of the
    source, see `MitsubaOptions`. Raises `InputError`; `out` is complete or absent.
    """
    path, out = Path(path), Path(out)
    scene_id = scene_id or out.name
    check_name(scene_id, "a scene's id", error=InputError)
    if (
        out.exists()
        and not (out / "scene.json").is_file()
        and (out.is_file() or any(out.iterdir()))
    ):
        raise InputError(f"{out}: exists and is no scene folder; choose another place")
    if path.is_dir():
        return _copy_folder(path, out, scene_id)
    if not path.exists():
        raise InputError(f"{path}: no such file or folder")
    source = SOURCES.get(path.suffix.lower())
    if source is None:
        raise InputError(
            f"{path}: unknown kind of scene {path.suffix!r}; known: {', '.join(sorted(SOURCES))}, "
            "or a folder with scene.json"
        )
    return source(path, out, scene_id, options)


def _mitsuba(path: Path, out: Path, scene_id: str, options: dict[str, Any]) -> Scene:
    return import_mitsuba(path, out, scene_id, MitsubaOptions(**options))


def _sweethome(path: Path, out: Path, scene_id: str, options: dict[str, Any]) -> Scene:
    return import_sweethome(path, out, scene_id, SweetHomeOptions(**options))


def _model(path: Path, out: Path, scene_id: str, options: dict[str, Any]) -> Scene:
    return import_model(path, out, scene_id, options_of(path, options))


def _copy_folder(path: Path, out: Path, scene_id: str) -> Scene:
    if not (path / "scene.json").is_file():
        raise InputError(
            f"{path}: a folder without scene.json; name the scene's own file, such as scene.xml"
        )
    scene = load_scene(path)
    if out.resolve() == path.resolve():
        return scene
    if out.resolve().is_relative_to(path.resolve()):
        raise InputError(f"{out}: lies inside the scene that is to be copied there")
    with writing_scene(out) as folder:
        copy_files(path, folder)
        save_scene(folder, replace(scene, scene_id=scene_id))
    return load_scene(out)


# Suffix -> importer(path, out, scene_id, options).
SOURCES: dict[str, Callable[[Path, Path, str, dict[str, Any]], Scene]] = {
    ".sh3d": _sweethome,
    ".xml": _mitsuba,
    ".gltf": _model,
    ".glb": _model,
    ".obj": _model,
}
