"""Parser of the pbrt file format: directives with their arguments and parameters.

Pharr, Jakob and Humphreys, *pbrt-v4 Input File Format* and *pbrt-v3 Input File Format*. Files are
not trusted: included files must lie inside the sandbox, and their number, depth and total size
are bounded.
"""

from __future__ import annotations

import gzip
import re
import warnings
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.importing.sandbox import Sandbox

MAX_BYTES = 512 * 2**20  # of all files together, each as often as it is included
MAX_INCLUDES = 10_000
MAX_DEPTH = 16  # of included files
MAX_VALUE = 1e30  # of a number

# Strings, brackets and words; comments and white space between them are skipped.
# Possessive quantifiers keep the time linear.
_TOKEN = re.compile(r'\s*+(?:#[^\n]*+\s*+)*+("(?:[^"\\\n]|\\.)*+"|[\[\]]|[^\s"\[\]#]++)')
_END = re.compile(r"\s*+(?:#[^\n]*+\s*+)*+\Z")
_ESCAPES = {"n": "\n", "t": "\t", "r": "\r", "b": "\b", "f": "\f"}

# Number of arguments before the parameters: "n" numbers or "s" strings.
_ARGUMENTS: dict[str, tuple[str, int]] = {
    **dict.fromkeys(
        ("WorldBegin", "WorldEnd", "AttributeBegin", "AttributeEnd", "TransformBegin",
         "TransformEnd", "ObjectEnd", "ReverseOrientation", "Identity"), ("s", 0)
    ),
    **dict.fromkeys(("Translate", "Scale"), ("n", 3)),
    "Rotate": ("n", 4),
    "LookAt": ("n", 9),
    **dict.fromkeys(("Transform", "ConcatTransform"), ("n", 16)),
    "TransformTimes": ("n", 2),
    **dict.fromkeys(
        ("CoordinateSystem", "CoordSysTransform", "NamedMaterial", "Include", "Import",
         "ObjectBegin", "ObjectInstance", "ActiveTransform", "ColorSpace"), ("s", 1)
    ),
}  # fmt: skip
_WITH_PARAMETERS: dict[str, int] = {  # directives with typed parameters: strings before them
    **dict.fromkeys(
        ("Accelerator", "AreaLightSource", "Attribute", "Camera", "Film", "Integrator",
         "LightSource", "MakeNamedMaterial", "MakeNamedMedium", "Material", "PixelFilter",
         "Renderer", "Sampler", "Shape", "SurfaceIntegrator", "Volume", "VolumeIntegrator"), 1
    ),
    "Option": 0,
    "Texture": 3,
}  # fmt: skip


@dataclass(frozen=True)
class Parameter:
    """One typed parameter; `values` are numbers (N,), or strings, or truth values."""

    kind: str  # as in the file, such as "rgb", "float" or "texture"
    name: str
    values: Float64Array | list[str] | list[bool]
    place: str  # file and line


@dataclass(frozen=True)
class Directive:
    """One directive of a scene file, such as `Shape "sphere" "float radius" 2`."""

    name: str
    place: str  # file and line
    numbers: Float64Array
    strings: tuple[str, ...]
    parameters: tuple[Parameter, ...]

    @property
    def text(self) -> str:
        """The first string argument."""
        return self.strings[0]


class Parser:
    """Iterates over the directives of a scene file and of the files that it includes.

    `Include` is expanded. The directives of `Import` (version 4) are enclosed in those named
    "ImportBegin" and "ImportEnd".
    """

    def __init__(self, sandbox: Sandbox) -> None:
        self.sandbox = sandbox
        self._bytes = 0
        self._files = 0

    def directives(self, path: Path, depth: int = 0) -> Iterator[Directive]:
        """Iterate over all directives; `InputError` names file and line of what is wrong."""
        if depth > MAX_DEPTH:
            raise InputError(f"{path}: files include each other more than {MAX_DEPTH} deep")
        self._files += 1
        if self._files > MAX_INCLUDES:
            raise InputError(f"{path}: more than {MAX_INCLUDES:,} files are included")
        for directive in _Reader(path, self._text(path)):
            if directive.name not in ("Include", "Import"):
                yield directive
                continue
            found = self.sandbox.find(directive.text, directive.place)
            if found is None:
                raise InputError(
                    f"{directive.place}: the included file {directive.text!r:.200} is missing"
                )
            if directive.name == "Import":
                yield _marker("ImportBegin", directive.place)
            yield from self.directives(found, depth + 1)
            if directive.name == "Import":
                yield _marker("ImportEnd", directive.place)

    def _text(self, path: Path) -> str:
        left = MAX_BYTES - self._bytes
        try:
            with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as stream:
                data = stream.read(left + 1)
        except (OSError, EOFError, zlib.error) as error:
            raise InputError(f"{path}: cannot be read ({error})") from None
        if len(data) > left:
            raise InputError(f"{path}: the scene is larger than the limit of {MAX_BYTES >> 20} MiB")
        self._bytes += len(data)
        return data.decode("utf-8", "replace")


def _marker(name: str, place: str) -> Directive:
    return Directive(name, place, np.zeros(0), (), ())


class _Reader:
    """Directives of one text; parses numbers in brackets as a whole."""

    def __init__(self, path: Path, text: str) -> None:
        self.path, self.text = path, text
        self.at = 0
        self._line, self._counted = 1, 0

    def __iter__(self) -> Iterator[Directive]:
        while (name := self._next()) is not None:
            yield self._directive(name)

    def place(self) -> str:
        """File and line of the position reached."""
        self._line += self.text.count("\n", self._counted, self.at)
        self._counted = self.at
        return f"{self.path}:{self._line}"

    def _next(self) -> str | None:
        """The next token; None at the end of the file."""
        match = _TOKEN.match(self.text, self.at)
        if match is None:
            if _END.match(self.text, self.at):
                return None
            raise InputError(f"{self.place()}: not a pbrt file, or a string without an end")
        self.at = match.end()
        return match[1]

    def _peek(self) -> str | None:
        at = self.at
        token = self._next()
        self.at = at
        return token

    def _directive(self, name: str) -> Directive:
        place = self.place()
        if name not in _ARGUMENTS and name not in _WITH_PARAMETERS:
            if name == "MediumInterface":
                return Directive(name, place, np.zeros(0), self._strings_ahead(), ())
            raise InputError(f"{place}: unknown directive {name!r:.60}")
        kind, count = _ARGUMENTS.get(name, ("s", _WITH_PARAMETERS.get(name, 0)))
        numbers = self._numbers(count, place) if kind == "n" else np.zeros(0)
        strings = tuple(self._string(place, name) for _ in range(count if kind == "s" else 0))
        parameters: tuple[Parameter, ...] = ()
        if name in _WITH_PARAMETERS:
            parameters = tuple(self._parameters())
        return Directive(name, place, numbers, strings, parameters)

    def _string(self, place: str, name: str) -> str:
        token = self._next()
        if token is None or token in "[]":
            raise InputError(f"{place}: {name} needs a name in quotes")
        if not token.startswith('"') and name not in ("ActiveTransform", "ColorSpace"):
            raise InputError(f"{place}: {name} needs a name in quotes, got {token!r:.60}")
        return _unquoted(token)

    def _strings_ahead(self) -> tuple[str, ...]:
        found = []
        while (token := self._peek()) is not None and token.startswith('"'):
            found.append(_unquoted(token))
            self._next()
        return tuple(found)

    def _numbers(self, count: int, place: str) -> Float64Array:
        if self._peek() == "[":
            self._next()
            values = self._bracketed(place)
            if not isinstance(values, np.ndarray) or len(values) != count:
                raise InputError(f"{place}: expected {count} numbers in brackets")
            return values
        words = [self._next() or "" for _ in range(count)]
        return _as_numbers(words, place)

    def _parameters(self) -> Iterator[Parameter]:
        while (token := self._peek()) is not None and token.startswith('"'):
            self._next()
            place = self.place()
            words = _unquoted(token).split()
            if len(words) != 2:
                raise InputError(
                    f'{place}: expected a parameter such as "float radius", got {token!r:.60}'
                )
            opening = self._next()
            if opening == "[":
                values = self._bracketed(place)
            elif opening is None or opening == "]":
                raise InputError(f"{place}: the parameter {words[1]!r:.60} has no value")
            else:
                values = _as_values([opening], place)
            yield Parameter(words[0], words[1], values, place)

    def _bracketed(self, place: str) -> Float64Array | list[str] | list[bool]:
        """Values up to the closing bracket; the opening one has been read."""
        end = self.text.find("]", self.at)
        if end < 0:
            raise InputError(f"{place}: a bracket is not closed")
        inside = self.text[self.at : end]
        if '"' not in inside and "#" not in inside:
            self.at = end + 1
            numbers = _fast_numbers(inside)
            return _as_values(inside.split(), place) if numbers is None else numbers
        words = []
        while (token := self._next()) != "]":
            if token is None or token == "[":
                raise InputError(f"{place}: a bracket is not closed")
            words.append(token)
        return _as_values(words, place)


def _unquoted(token: str) -> str:
    if not token.startswith('"'):
        return token
    return re.sub(r"\\(.)", lambda match: _ESCAPES.get(match[1], match[1]), token[1:-1])


def _as_values(words: list[str], place: str) -> Float64Array | list[str] | list[bool]:
    """Values by their form: strings in quotes, `true` and `false`, otherwise numbers."""
    if words and words[0].startswith('"'):
        if not all(word.startswith('"') for word in words):
            raise InputError(f"{place}: strings and numbers in one list")
        return [_unquoted(word) for word in words]
    if words and words[0] in ("true", "false"):
        if not all(word in ("true", "false") for word in words):
            raise InputError(f"{place}: truth values and numbers in one list")
        return [word == "true" for word in words]
    return _as_numbers(words, place)


def _fast_numbers(text: str) -> Float64Array | None:
    """The numbers of a text that holds nothing else, all usual ones; None for any other."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)
        try:
            values = np.fromstring(text, dtype=np.float64, sep=" ")
        except (ValueError, DeprecationWarning):
            return None
    return values if len(values) and (np.abs(values) < MAX_VALUE).all() else None


def _as_numbers(words: list[str], place: str) -> Float64Array:
    try:
        values = np.array(words, dtype=np.float64)
    except ValueError as error:
        raise InputError(f"{place}: expected numbers ({error})") from None
    if len(values) and not (np.abs(values) < MAX_VALUE).all():
        raise InputError(f"{place}: a number is not finite or too large")
    return values
