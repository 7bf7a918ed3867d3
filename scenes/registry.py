"""Import of scene files by the source that reads files of their suffix.

The registry of sources is the list of base classes of `pbrnet.scenes.import_options.ImportEntry`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from pbrnet.scenes.checked import build, check_name
from pbrnet.scenes.contract import Scene, load_scene, save_scene, writing_scene
from pbrnet.scenes.errors import InputError, ParameterError
from pbrnet.scenes.files import copy_files, regular_file, resolved
from pbrnet.scenes.formats.scene_xml import check_scene_xml
from pbrnet.scenes.import_options import SOURCES as ALL_SOURCES
from pbrnet.scenes.import_options import option_names
from pbrnet.scenes.opened_files import OpenedFiles
from pbrnet.scenes.source_options import load

# (file, scene folder to write, scene id, options, files that it opens) -> the scene
Importer = Callable[[Path, Path, str, Any, OpenedFiles], Scene]

# Suffix -> options of the source that reads such files.
SOURCES = {suffix: options for options in ALL_SOURCES for suffix in options.suffixes}

_LFS = b"version https://git-lfs.github.com/"  # start of a pointer
_BLENDER = "open it in Blender and export it as .glb"
_CAD = "open it in FreeCAD and export it as .ifc or .glb"
_SCAN = "a scan is no scene of surfaces: make a mesh of it first, and save that as .glb"
_UNPACK = "unpack it and import the scene file inside"

# Kinds that no source reads: suffix in lower case -> (name of the kind, the best way around).
REFUSED: dict[str, tuple[str, str]] = {
    ".3dm": ("Rhino", "export it from Rhino as .obj or .glb"),
    ".7z": ("archive", _UNPACK),
    ".abc": ("Alembic", _BLENDER),
    ".c4d": ("Cinema 4D", "export it from Cinema 4D as .glb or .usdz"),
    ".dwg": ("AutoCAD", "export the building as .ifc; a drawing of lines alone is no scene"),
    ".dxf": ("AutoCAD", "export the building as .ifc; a drawing of lines alone is no scene"),
    ".e57": ("point cloud", _SCAN),
    ".hip": ("Houdini", "export it from Houdini as .usd or .glb"),
    ".ifcxml": ("IFC as XML", "save it as .ifc in the program that wrote it"),
    ".ifczip": ("IFC in a zip", _UNPACK),
    ".iges": ("IGES", _CAD),
    ".igs": ("IGES", _CAD),
    ".kmz": ("Google Earth", "unpack it (it is a zip) and import the .dae inside"),
    ".las": ("point cloud", _SCAN),
    ".laz": ("point cloud", _SCAN),
    ".ma": ("Maya", "export it from Maya as .usd or .obj"),
    ".max": ("3ds Max", "export it from 3ds Max as .glb, .usd or .obj"),
    ".mb": ("Maya", "export it from Maya as .usd or .obj"),
    ".pln": ("Archicad", "save it in Archicad as .ifc"),
    ".ply": ("PLY", f"it has no materials by part: {_BLENDER}"),
    ".rar": ("archive", _UNPACK),
    ".rfa": ("Revit family", "place it in a Revit project and export that as .ifc"),
    ".rvt": ("Revit", "export it from Revit as .ifc"),
    ".sh3f": ("furniture catalogue of Sweet Home 3D", "name its folder in assets.folder"),
    ".skp": ("SketchUp", "export it from SketchUp as .dae (COLLADA) or .glb"),
    ".step": ("STEP", _CAD),
    ".stl": ("STL", f"it has no materials: {_BLENDER}"),
    ".stp": ("STEP", _CAD),
    ".uasset": ("Unreal Engine", "export the level from Unreal as .glb or .usd"),
    ".umap": ("Unreal Engine", "export the level from Unreal as .glb or .usd"),
    ".unity": ("Unity", "export the scene from Unity as .glb"),
    ".vwx": ("Vectorworks", "export it from Vectorworks as .ifc"),
    ".wrl": ("VRML", _BLENDER),
    ".x3d": ("X3D", _BLENDER),
    ".zip": ("archive", _UNPACK),
}


def import_scene(
    path: Path,
    out: Path,
    scene_id: str | None = None,
    opened: OpenedFiles | None = None,
    **options: Any,
) -> Scene:
    """Import the scene at `path` into the scene folder `out`, whatever its kind.

    `path` is a file with a suffix in `SOURCES`, or a scene folder (with `scene.json`), which is
    checked and copied. `scene_id` defaults to the name of `out`. `opened` (of `path`'s folder, or
    of `path` if that is a folder) records the files that the import looked for. `options` are
    fields of the source's options, see `pbrnet.scenes.import_options`. Raises `InputError`, and
    `ParameterError` for options that the source does not take; `out` is complete or absent.
    """
    path, out = Path(path), Path(out)
    scene_id = scene_id or out.name
    check_name(scene_id, "a scene's id", error=InputError)
    if (
        out.exists()
        and not (out / "scene.json").is_file()
        and (out.is_file() or any(out.iterdir()))
    ):
        raise InputError(f"{out}: exists and is not a scene folder; choose another place")
    if path.is_dir():
        return _copy_folder(path, out, scene_id, opened or OpenedFiles(path))
    regular_file(path)
    source = SOURCES.get(path.suffix.lower())
    if source is None and path.suffix.lower() in REFUSED:
        kind, remedy = REFUSED[path.suffix.lower()]
        raise InputError(f"{path}: {path.suffix} files ({kind}) are not read; {remedy}")
    if source is None:
        raise InputError(
            f"{path}: unknown kind of scene {path.suffix!r}; known: {', '.join(sorted(SOURCES))}, "
            "or a folder with scene.json"
        )
    with path.open("rb") as file:
        if file.read(len(_LFS)) == _LFS:
            raise InputError(f"{path}: a pointer of Git LFS, not the file; run git lfs pull")
    known = option_names(path.suffix)
    for name in options:
        if name not in known:
            raise ParameterError(
                f"{name}: not for {path.suffix} files; they take {', '.join(known)}"
            )
    opened = opened or OpenedFiles(path.parent)
    made = build(source, options, path.name)
    importer: Importer = load(source.importer)
    try:
        return importer(path, out, scene_id, made, opened)
    except InputError as error:
        if path.name in str(error):
            raise
        raise InputError(f"{path}: {error}") from None


def _copy_folder(path: Path, out: Path, scene_id: str, opened: OpenedFiles) -> Scene:
    if not (path / "scene.json").is_file():
        raise InputError(
            f"{path}: a folder without scene.json; name the scene's own file, such as scene.xml"
        )
    scene = load_scene(path)
    check_scene_xml(scene.xml)
    if resolved(out) == resolved(path):
        return scene
    if resolved(out).is_relative_to(resolved(path)):
        raise InputError(f"{out}: lies inside the scene that is to be copied there")
    opened.add_folder(path)
    with writing_scene(out) as folder:
        copy_files(path, folder)
        save_scene(folder, replace(scene, scene_id=scene_id))
    return load_scene(out)
