"""What a scene file to import consists of: its name as a scene, and a digest of all it names."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from pathlib import Path
from urllib.parse import unquote

from defusedxml import ElementTree

from pipeline.frames import fingerprint
from scenes.files import digest_file, digest_folder
from scenes.import_options import ImportEntry

_MAX_TEXT = 256 * 2**20  # bytes of a file that is searched for names of others
_NAMELESS = ("scene", "main", "main_template_color", "index")  # the third: of a PBRS house
_LONGEST = 1000  # characters of a path
_RELEASE = ("light_geometry_compact.txt", "ModelCategoryMappingNewActive.csv", "room_camera.txt",
            "room_camera_name.txt", "room_camera_node.txt")  # fmt: skip


def scene_name(path: Path) -> str:
    """A scene id from a file's name, or its folder's where the file is just called "scene"."""
    stem = path.stem if path.suffix else path.name
    if stem.lower() in _NAMELESS and path.parent.name:
        stem = path.parent.name
    return re.sub(r"[^A-Za-z0-9]+", "-", stem).strip("-") or "scene"


def digest_import(path: Path, entry: ImportEntry) -> str:
    """A digest of a scene file and of every file that it, or a parameter, names."""
    if path.is_dir():
        return digest_folder(path)
    parts = {path.name: digest_file(path)}
    named = {*_named(path), *entry.parameter.values()}
    for name in list(named):
        if name.lower().endswith((".mtl", ".xml")):
            named |= set(_named(path.parent / name))
    if path.suffix.lower() == ".xml":
        folders = (path.parent, *list(path.parents)[1:3])
        named |= {str(folder / name) for folder in folders for name in _RELEASE}
    for name in sorted(named):
        if len(name) < _LONGEST and "\0" not in name and (path.parent / name).is_file():
            parts[name] = digest_file(path.parent / name)
    return fingerprint(files=parts)


def _named(path: Path) -> Iterable[str]:
    """Texts in a file that may be names of files; none where it cannot be read, as the importer
    says what is wrong."""
    readers = {".xml": _in_xml, ".gltf": _in_gltf, ".obj": _in_lines, ".mtl": _in_lines}
    reader = readers.get(path.suffix.lower())
    try:
        if reader is None or path.stat().st_size > _MAX_TEXT:
            return ()
        return reader(path)
    except (OSError, ElementTree.ParseError, ValueError, RecursionError):
        return ()


def _in_xml(path: Path) -> set[str]:
    tree = ElementTree.parse(path)
    return {value for element in tree.iter() for value in element.attrib.values()}


def _in_gltf(path: Path) -> set[str]:
    content = json.loads(path.read_text(encoding="utf-8"))
    held = [*content.get("buffers", ()), *content.get("images", ())]
    return {unquote(one["uri"]) for one in held if not one.get("uri", "data:").startswith("data:")}


def _in_lines(path: Path) -> set[str]:
    words = re.compile(r"^\s*(?:mtllib|map_\w+|bump|norm|disp|decal|refl)\s+(.*\S)", re.IGNORECASE)
    made = set()
    with path.open(encoding="utf-8", errors="replace") as stream:
        for line in stream:
            found = words.match(line)
            if found is not None:
                made |= {found[1], found[1].split()[-1]}
    return made
