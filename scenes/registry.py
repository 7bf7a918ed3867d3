"""Table of scene sources, the entries of `scenes.imports`, and the import of a scene file.

A scene source is a folder with an importer and its options; a base class of `ImportEntry` is its
line here.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cache
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from pbrnet.scenes.checked import build, check_name
from pbrnet.scenes.contract import Scene, load_scene, save_scene, writing_scene
from pbrnet.scenes.errors import InputError, ParameterError
from pbrnet.scenes.files import copy_files, data_beside, regular_file, resolved, temporary_folder
from pbrnet.scenes.formats.archive import HomeArchive
from pbrnet.scenes.formats.scene_xml import check_scene_xml
from pbrnet.scenes.ifc.options import IfcOptions
from pbrnet.scenes.importing.options import SourceOptions
from pbrnet.scenes.layout.options import LayoutOptions
from pbrnet.scenes.mitsuba.options import MitsubaOptions
from pbrnet.scenes.models.options import ModelOptions
from pbrnet.scenes.opened_files import OpenedFiles
from pbrnet.scenes.pbrt.options import PbrtOptions
from pbrnet.scenes.sweethome.options import SweetHomeOptions

# (file, scene folder to write, scene id, options, files that it opens) -> the scene
Importer = Callable[[Path, Path, str, Any, OpenedFiles], Scene]

# Root elements of XML files that no source reads -> the suffix of their kind
_XML_ROOTS = {b"mujoco": ".mjcf", b"robot": ".urdf", b"sdf": ".sdf", b"gbXML": ".gbxml"}
_LONGEST_NAME = 100  # characters of a scene id; `-v12` and the like follow
_GENERAL_NAMES = ("scene", "main", "main_template_color", "index")  # the third: of a PBRS house
_LFS = b"version https://git-lfs.github.com/"  # start of a pointer


@dataclass(frozen=True, kw_only=True)
class ImportEntry(
    MitsubaOptions, SweetHomeOptions, ModelOptions, PbrtOptions, IfcOptions, LayoutOptions
):
    """A file of `scenes.imports` with options. The base classes are the table of sources."""

    file: str
    id: str | None = None  # of the scene; by default made from the name of the file

    def verify(self, where: str) -> None:
        """Check that the options suit the kind of file; raises ValueError."""
        suffix = Path(self.file).suffix.lower()
        known = option_names(suffix)
        for name in self.given():
            if name not in known:
                kind = f"{suffix} files" if known else "scene folders"
                allowed = f"; they take {', '.join(known)}" if known else ""
                raise ValueError(f"{where}.{name}: not for {kind}{allowed}")
        if suffix in SOURCES:  # with the rules of this source alone
            SOURCES[suffix](**{name: getattr(self, name) for name in known}).verify(where)
        if self.id is not None:
            check_name(self.id, "a scene's id", f"{where}.id", ValueError)

    def given(self) -> dict[str, Any]:
        """Return the options that differ from their defaults."""
        return {
            one.name: value
            for one in fields(self)
            if one.name not in ("file", "id")
            and (value := getattr(self, one.name)) not in (one.default, (), {})
        }

    def options(self) -> dict[str, Any]:
        """Return the given options as keyword arguments of `import_scene`; folders are absolute."""
        return {
            name: value.expanduser().resolve() if isinstance(value, Path) else value
            for name, value in self.given().items()
        }


def scene_name(path: Path) -> str:
    """Return a scene id made from the name of a file, or of its folder for general names."""
    stem = path.stem if path.suffix else path.name
    if stem.lower() in _GENERAL_NAMES and path.parent.name:
        stem = path.parent.name
    return re.sub(r"[^A-Za-z0-9]+", "-", stem).strip("-")[:_LONGEST_NAME].strip("-") or "scene"


_SOURCES: tuple[type[SourceOptions], ...] = ImportEntry.__bases__
# Suffix in lower case -> options of the source that reads such files.
SOURCES = {suffix: source for source in _SOURCES for suffix in source.suffixes}


def option_names(suffix: str) -> tuple[str, ...]:
    """Return the names of the options for files with `suffix`; none for unknown kinds."""
    source = SOURCES.get(suffix.lower())
    return tuple(one.name for one in fields(source)) if source is not None else ()


@cache
def refused() -> dict[str, tuple[str, str]]:
    """Return the kinds that no source reads: suffix -> name of the kind, the best way around."""
    return {suffix: (kind, remedy) for suffix, (kind, remedy) in data_beside(__file__).items()}


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
    fields of the source's options, see `ImportEntry`. Raises `InputError`, and
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
    if not path.is_dir():
        regular_file(path)
    if path.is_dir() or is_exported(path):
        if options:
            raise ParameterError(f"{min(options)}: not for scene folders and exported scenes")
        if path.is_dir():
            return _copy_folder(path, out, scene_id, opened or OpenedFiles(path))
        return _copy_archive(path, out, scene_id)
    source = SOURCES.get(path.suffix.lower())
    suffix = _told_suffix(path)
    if suffix in refused():
        kind, remedy = refused()[suffix]
        raise InputError(f"{path}: {suffix} files ({kind}) are not read; {remedy}")
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
    importer: Importer = resolve_name(source.importer)
    try:
        return importer(path, out, scene_id, made, opened)
    except InputError as error:
        if path.name in str(error):
            raise
        raise InputError(f"{path}: {error}") from None


def _told_suffix(path: Path) -> str:
    """The suffix of a file, in lower case; of XML, that of the kind that its root tells."""
    suffix = path.suffix.lower()
    if suffix != ".xml":
        return suffix
    with path.open("rb") as file:
        head = re.sub(rb"<!--.*?-->", b"", file.read(4096), flags=re.DOTALL)
    root = re.search(rb"<([A-Za-z]\w*)", head)
    return _XML_ROOTS.get(root[1], suffix) if root else suffix


def is_exported(path: Path) -> bool:
    """Test for a zip with one folder with `scene.json`, as `pbrnet export-scene` writes it."""
    if path.suffix.lower() != ".zip" or not path.is_file():
        return False
    try:
        with HomeArchive(path, "zip archive") as archive:
            names = archive.names()
    except InputError:
        return False
    tops = {name.partition("/")[0] for name in names}
    return len(tops) == 1 and f"{min(tops)}/scene.json" in names


def _copy_archive(path: Path, out: Path, scene_id: str) -> Scene:
    with temporary_folder() as place, HomeArchive(path, "zip archive") as archive:
        for name in archive.names():
            target = place / name
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(archive.read(name))
        folder = place / archive.names()[0].partition("/")[0]
        return _copy_folder(folder, out, scene_id, OpenedFiles(folder))


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
        raise InputError(f"{out}: is inside the scene to be copied there")
    opened.add_folder(path)
    with writing_scene(out) as folder:
        copy_files(path, folder)
        save_scene(folder, replace(scene, scene_id=scene_id, source=scene.origin))
    return load_scene(out)
