"""Check of a scene folder's `scene.xml` before a renderer reads it.

A scene folder may come from elsewhere. Mitsuba's parser follows includes and reads any file that a
plugin names, so everything that leads out of the folder is refused first.
"""

from __future__ import annotations

from pathlib import Path, PureWindowsPath
from xml.etree.ElementTree import Element, ParseError

import defusedxml.ElementTree
from defusedxml import DefusedXmlException

from pbrnet.scenes.checked import check_name, shown
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import MAX_BYTES, regular_file, resolved

MAX_XML = 2**28  # bytes
_DEEPEST = 100  # elements in elements
_READING = ("include", "path")  # elements that read other places


def check_scene_xml(xml: Path) -> None:
    """Raise `InputError` if a scene file is broken, or reads what is outside of its folder.

    Refused: entities, `<include>` and `<path>`, absolute paths and those with `..` or variables,
    links that lead out, devices and pipes, and ids of shapes that cannot be names of files. Missing
    files are counted.
    """
    try:
        root = defusedxml.ElementTree.parse(regular_file(xml, MAX_XML), forbid_dtd=True).getroot()
    except ParseError as error:
        raise InputError(f"{xml}: not valid XML ({error})") from None
    except (DefusedXmlException, LookupError, ValueError) as error:
        raise InputError(f"{xml}: entities or an unknown encoding; refused ({error})") from None
    inside = _Inside(xml)
    missing = [name for name in _names(xml, root) if not inside.has(name)]
    if missing:
        more = f", and {len(missing) - 1} more files" if len(missing) > 1 else ""
        raise InputError(f"{xml}: the file {missing[0]} is missing{more}; import the scene again")


def _names(xml: Path, root: Element) -> list[str]:
    """Return the names of all files that elements name, once each."""
    names: dict[str, None] = {}
    level = [root]
    for _ in range(_DEEPEST):
        for one in level:
            if one.tag in _READING:
                raise InputError(f"{xml}: <{one.tag}> reads files from elsewhere; refused")
            if one.tag == "shape" and "id" in one.attrib:  # meshes are named by it
                check_name(one.attrib["id"], "a shape's id", str(xml), InputError)
            name = one.get("filename")
            if one.tag == "string":
                value = one.get("value", "")
                _check_local(xml, value)
                if one.get("name", "").endswith("filename"):
                    name = value
            if name is not None:
                _check_local(xml, name)
                names[name] = None
        level = [child for one in level for child in one]
        if not level:
            return list(names)
    raise InputError(f"{xml}: more than {_DEEPEST} elements in one another")


def _check_local(xml: Path, name: str) -> None:
    """Raise `InputError` for a text that as a path leads out of the folder, or that varies."""
    written = name.replace("\\", "/")
    drive = PureWindowsPath(name).drive if ":" in name else ""
    foreign = written.startswith(("/", "~")) or drive
    if foreign or ".." in written.split("/") or "$" in name or "\0" in name:
        raise InputError(f"{xml}: {shown(name)} leads out of the scene's folder; refused")


class _Inside:
    """Files in a scene's folder, whose folders are resolved once each: scenes have many files."""

    def __init__(self, xml: Path) -> None:
        self._xml, self._root = xml, resolved(xml.parent)
        self._folders: dict[str, Path] = {}  # without links, by their names in the scene

    def has(self, name: str) -> bool:
        """Return whether a file is there; raises `InputError` for one that a link has elsewhere."""
        folder, _, last = name.rpartition("/")
        if folder not in self._folders:
            self._folders[folder] = resolved(self._xml.parent / folder)
        path = self._folders[folder] / last
        if not path.exists():
            return False
        place = resolved(path) if path.is_symlink() else self._folders[folder]
        if not place.is_relative_to(self._root):
            where = f"{self._xml}: {shown(name)}"
            raise InputError(f"{where} is a link out of the scene's folder; refused")
        regular_file(path, MAX_BYTES)
        return True
