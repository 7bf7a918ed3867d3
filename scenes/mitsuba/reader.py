"""Reader of Mitsuba XML files: one tree of nodes, with includes and parameters resolved.

Files are not trusted. They are parsed by defusedxml (no entities, no external DTDs), nothing
outside the scene's own folder is opened, and size, depth, element count and includes are bounded.
"""

from __future__ import annotations

import re
import xml.sax
import xml.sax.handler
import xml.sax.xmlreader
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import defusedxml.sax
from defusedxml import DefusedXmlException

from pbrnet.scenes.errors import InputError
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.sandbox import Sandbox

MAX_BYTES = 64 * 2**20  # of one file
MAX_ELEMENTS = 300_000  # of all files together
MAX_DEPTH = 64  # of nested elements
MAX_INCLUDES = 256

_PARAMETER = re.compile(r"\$(\w+)")
_VALUE_TAGS = frozenset(
    (
        "integer",
        "float",
        "boolean",
        "string",
        "rgb",
        "srgb",
        "xyz",
        "spectrum",
        "blackbody",
        "vector",
        "point",
        "transform",
        "animation",
    )
)


@dataclass
class Node:
    """One XML element with its position, attributes and children, in document order."""

    tag: str
    attributes: dict[str, str]
    file: Path
    line: int
    children: list[Node] = field(default_factory=list)

    @property
    def place(self) -> str:
        """File and line, for error messages."""
        return f"{self.file}:{self.line}"

    @property
    def type(self) -> str:
        """The plugin's name."""
        return self.attributes.get("type", "")

    @property
    def name(self) -> str:
        """The name of the property that this element sets, or ""."""
        return self.attributes.get("name", "")

    @property
    def is_value(self) -> bool:
        """Return whether this is a plain value rather than a plugin or a reference."""
        return self.tag in _VALUE_TAGS

    def error(self, text: str) -> InputError:
        """An `InputError` with file, line and tag of this element."""
        return InputError(f"{self.place}: <{self.tag}>: {text}")

    def walk(self) -> Iterator[Node]:
        """Iterate over this element and all its descendants, in document order."""
        yield self
        for child in self.children:
            yield from child.walk()


def read_tree(
    path: Path,
    sandbox: Sandbox,
    parameters: dict[str, str],
    changes: Changes,
    defaults: dict[str, str] | None = None,
) -> tuple[Node, str]:
    """Read a scene file; returns its `<scene>` element and its version, such as "0.6.0".

    A `$name` gets its value from `parameters`, else from the file's `<default>`s, else from
    `defaults`; without a value it stays in the text. Raises `InputError` for files that are
    damaged, too large, unsafe or not a Mitsuba scene.
    """
    reader = _Reader(sandbox, dict(parameters), changes, defaults or {})
    root = reader.read(path)
    if root.tag != "scene":
        raise root.error("is not a Mitsuba scene; the outermost element must be <scene>")
    version = root.attributes.get("version", "")
    if not re.fullmatch(r"\d+(\.\d+){0,2}", version):
        raise root.error(f"needs a version such as version='3.0.0', got {version!r}")
    unused = sorted(set(parameters) - reader.used)
    if unused:
        changes.note("parameters were given that the file does not use: {}", ", ".join(unused))
    return root, version


def unresolved(text: str) -> list[str]:
    """Return the names of the parameters in `text` that have no value."""
    return _PARAMETER.findall(text)


class _Reader:
    def __init__(
        self, sandbox: Sandbox, given: dict[str, str], changes: Changes, defaults: dict[str, str]
    ) -> None:
        self.sandbox, self.given, self.changes = sandbox, given, changes
        self.values, self.defaults = dict(given), defaults
        self.used: set[str] = set()
        self.elements = self.includes = 0

    def read(self, path: Path, above: tuple[Path, ...] = ()) -> Node:
        root = _parse(path, self)
        self._resolve(root, (*above, path.resolve()))
        return root

    def count(self, path: Path) -> None:
        self.elements += 1
        if self.elements > MAX_ELEMENTS:
            raise InputError(
                f"{path}: the scene has more than the limit of {MAX_ELEMENTS:,} elements"
            )

    def _resolve(self, node: Node, files: tuple[Path, ...]) -> None:
        kept: list[Node] = []
        for child in node.children:
            if child.tag == "default":
                self.values.setdefault(child.name, self._fill(child.attributes.get("value", "")))
                if child.name in self.given:
                    self.used.add(child.name)
                continue
            child.attributes = {key: self._fill(text) for key, text in child.attributes.items()}
            if child.tag == "include":
                kept += self._include(child, files)
            elif child.tag == "path":
                self.sandbox.add_folder(child.attributes.get("value", ""), child.place)
            else:
                self._resolve(child, files)
                kept.append(child)
        node.children = kept

    def _include(self, node: Node, files: tuple[Path, ...]) -> list[Node]:
        name = node.attributes.get("filename", "")
        path = self.sandbox.find(name, node.place)
        if path is None:
            raise node.error(f"the included file {name!r} is missing")
        if path.resolve() in files:
            raise node.error(f"{name!r} includes itself, directly or through others")
        self.includes += 1
        if self.includes > MAX_INCLUDES:
            raise node.error(f"the scene has more than the limit of {MAX_INCLUDES} includes")
        return self.read(path, files).children

    def _fill(self, text: str) -> str:
        def value(match: re.Match[str]) -> str:
            self.used.add(match[1])
            return self.values.get(match[1], self.defaults.get(match[1], match[0]))

        # A greedy \w+ replaces the longest name first, as Mitsuba does.
        return _PARAMETER.sub(value, text) if "$" in text else text


class _Handler(xml.sax.handler.ContentHandler):
    def __init__(self, path: Path, reader: _Reader) -> None:
        super().__init__()
        self.path, self.reader = path, reader
        self.stack: list[Node] = []
        self.root: Node | None = None
        self.locator: xml.sax.xmlreader.Locator | None = None

    def setDocumentLocator(self, locator: xml.sax.xmlreader.Locator) -> None:
        self.locator = locator

    def startElement(self, tag: str, attrs: xml.sax.xmlreader.AttributesImpl) -> None:
        self.reader.count(self.path)
        line = (self.locator.getLineNumber() or 0) if self.locator else 0
        node = Node(tag, dict(attrs.items()), self.path, line)
        if self.stack:
            self.stack[-1].children.append(node)
        else:
            self.root = node
        self.stack.append(node)
        if len(self.stack) > MAX_DEPTH:
            raise node.error(f"elements are nested more than {MAX_DEPTH} deep")

    def endElement(self, name: str) -> None:
        self.stack.pop()


def _parse(path: Path, reader: _Reader) -> Node:
    try:
        size = path.stat().st_size
    except OSError:
        raise InputError(f"{path}: the file does not exist") from None
    if size > MAX_BYTES:
        raise InputError(
            f"{path}: the file has {size / 2**20:.0f} MiB; the limit is {MAX_BYTES >> 20} MiB"
        )
    handler = _Handler(path, reader)
    parser = defusedxml.sax.make_parser()
    parser.setContentHandler(handler)
    try:
        with path.open("rb") as stream:
            parser.parse(stream)
    except DefusedXmlException as error:
        raise InputError(
            f"{path}: entities and external references are not allowed ({error})"
        ) from None
    except xml.sax.SAXParseException as error:
        raise InputError(
            f"{path}:{error.getLineNumber()}: is not well-formed XML ({error.getMessage()})"
        ) from None
    except (LookupError, ValueError, OSError) as error:
        raise InputError(f"{path}: cannot be read as XML ({error})") from None
    if handler.root is None:
        raise InputError(f"{path}: the file is empty, not a Mitsuba scene")
    return handler.root
