"""Reader of a furniture catalogue (`.sh3f`): properties of all pieces, converted to metres."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

from pbrnet.scenes.assets.piece import CataloguePiece, LightSource, OpeningRule
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.formats.archive import HomeArchive
from pbrnet.scenes.importing.categories import category_of_piece
from pbrnet.scenes.importing.names import numbered
from pbrnet.scenes.sweethome.catalogue.properties import parse_properties
from pbrnet.scenes.sweethome.credits import licence_in

PROPERTIES = "PluginFurnitureCatalog.properties"
MAX_PIECES = 20_000
_MAX_PROPERTIES = 16 * 2**20  # bytes
_MAX_TEXT = 2**16
_LARGEST = 100.0  # metres, of any side
_MAX_LIGHTS = 64
_LICENCE_FILE = re.compile(r"licen[cs]e|copying|readme|credits", re.IGNORECASE)


class UnusablePiece(Exception):
    """A piece cannot be used; the text gives the reason."""


@dataclass(frozen=True)
class Library:
    """A catalogue file: its pieces, and the pieces that cannot be read."""

    key: str
    name: str
    version: str
    licence: str
    provider: str
    pieces: tuple[CataloguePiece, ...]
    refused: tuple[tuple[str, str, str], ...]  # key, name, reason


def read_library(path: Path) -> Library:
    """Read a `.sh3f`; raises `InputError` if the file is damaged or not a catalogue.

    Pieces with unusable properties are listed in `refused`.
    """
    with HomeArchive(path) as archive:
        if PROPERTIES not in archive:
            raise InputError(f"{path}: no {PROPERTIES} inside; not a furniture catalogue")
        entries = parse_properties(archive.read(PROPERTIES, _MAX_PROPERTIES))
        numbers = sorted(
            {int(m[1]) for key in entries if (m := re.fullmatch(r"name#(\d{1,9})", key))}
        )
        if len(numbers) > MAX_PIECES:
            raise InputError(f"{path}: {len(numbers):,} pieces; at most {MAX_PIECES:,}")
        if not numbers:
            raise InputError(f"{path}: {PROPERTIES} describes no piece")
        library = slug(path.stem)
        licence = _library_licence(archive, entries)
        pieces, refused, taken = [], [], dict[str, int]()
        for number in numbers:
            row = _Row(entries, number)
            name = slug(row.text("id").rpartition("#")[2] or str(number))
            key = f"{library}/{numbered(name, '-', taken)}"
            try:
                pieces.append(_piece(row, key, archive, licence))
            except UnusablePiece as error:
                refused.append((key, row.text("name"), str(error)))
    return Library(
        key=library,
        name=entries.get("name", path.stem),
        version=entries.get("version", ""),
        licence=licence,
        provider=entries.get("provider", ""),
        pieces=tuple(pieces),
        refused=tuple(refused),
    )


def slug(text: str) -> str:
    """Return a folder name of ASCII letters, digits, '.', '_' and '-'; not hidden, not empty."""
    return re.sub(r"[^A-Za-z0-9._-]+", "-", text).strip("-.")[:100] or "piece"


class _Row:
    """Properties of one piece: `name#7`, `width#7` and so on."""

    def __init__(self, entries: dict[str, str], number: int) -> None:
        self._entries, self._number = entries, number

    def text(self, name: str) -> str:
        return self._entries.get(f"{name}#{self._number}", "").strip()

    def flag(self, name: str, default: bool) -> bool:
        text = self.text(name).lower()
        return default if not text else text == "true"

    def numbers(self, name: str) -> tuple[float, ...]:
        values = []
        for word in self.text(name).split():
            try:
                value = float(word)
            except ValueError:
                raise UnusablePiece(f"{name} {word[:40]!r} is not a number") from None
            if not math.isfinite(value) or abs(value) > 1e6:
                raise UnusablePiece(f"{name} {word[:40]!r} is not a sensible number")
            values.append(value)
        return tuple(values)

    def number(self, name: str, default: float | None = None) -> float:
        values = self.numbers(name)
        if len(values) > 1 or (not values and default is None):
            raise UnusablePiece(f"{name} is {self.text(name)[:40]!r}; one number is needed")
        return values[0] if values else float(default or 0.0)


def _piece(row: _Row, key: str, archive: HomeArchive, licence: str) -> CataloguePiece:
    width, depth, height = (0.01 * row.number(name) for name in ("width", "depth", "height"))
    if not all(0 < side <= _LARGEST for side in (width, depth, height)):
        raise UnusablePiece(f"its size is {width:g} x {depth:g} x {height:g} m")
    model = row.text("model").lstrip("/")
    if not model:
        raise UnusablePiece("it names no model")
    name, identifier = row.text("name"), row.text("id")
    kind = "pieceOfFurniture"
    if row.flag("doorOrWindow", False):
        kind = "doorOrWindow"
    elif row.text("lightSourceX"):
        kind = "light"
    drop = row.number("dropOnTopElevation", 100 * height)
    return CataloguePiece(
        key=key,
        id=identifier,
        name=name,
        group=row.text("category"),
        category=category_of_piece(kind, name, identifier, model.rpartition("/")[2])[0],
        tags=tuple(tag for part in row.text("tags").split(",") if (tag := part.strip())),
        creator=row.text("creator") or "unknown",
        licence=_licence(_own_licence(archive, model), licence),
        model=model,
        size=(width, depth, height),
        elevation=0.01 * row.number("elevation", 0.0),
        drop=0.01 * drop if drop >= 0 else None,
        movable=row.flag("movable", True),
        opening=_opening(row) if kind == "doorOrWindow" else None,
        rotation=_rotation(row),
        lights=_lights(row, (width, depth, height)),
    )


def _opening(row: _Row) -> OpeningRule:
    names = ("XAxis", "YAxis", "Width", "StartAngle", "EndAngle")
    columns = [row.numbers(f"doorOrWindowSash{name}") for name in names]
    if len({len(column) for column in columns}) > 1:
        raise UnusablePiece("its sashes are not described alike")
    depth, width = row.number("depth"), row.number("width")
    shares = (width, depth, width, 1.0, 1.0)
    return OpeningRule(
        cut_out=row.text("doorOrWindowCutOutShape") or None,
        wall_thickness=row.number("doorOrWindowWallThickness", depth) / depth,
        wall_distance=row.number("doorOrWindowWallDistance", 0.0) / depth,
        sashes=tuple(
            (values[0] / shares[0], values[1] / shares[1], values[2] / shares[2], *values[3:])
            for values in zip(*columns, strict=True)
        ),
    )


def _rotation(row: _Row) -> tuple[tuple[float, ...], ...] | None:
    values = row.numbers("modelRotation")
    if not values:
        return None
    if len(values) != 9:
        raise UnusablePiece(f"modelRotation has {len(values)} numbers; nine are needed")
    return (values[:3], values[3:6], values[6:])


def _lights(row: _Row, size: tuple[float, float, float]) -> tuple[LightSource, ...]:
    x, y, z = (row.numbers(f"lightSource{axis}") for axis in "XYZ")
    colors = row.text("lightSourceColor").split()
    diameters = row.numbers("lightSourceDiameter")
    if not len(x) == len(y) == len(z) == len(colors) or len(diameters) not in (0, len(x)):
        raise UnusablePiece("its light sources are not described alike")
    if len(x) > _MAX_LIGHTS:
        raise UnusablePiece(f"{len(x)} light sources; at most {_MAX_LIGHTS}")
    made = []
    for number, color in enumerate(colors):
        if not re.fullmatch(r"#[0-9A-Fa-f]{6}", color):
            raise UnusablePiece(f"lightSourceColor {color[:40]!r} is not a colour")
        made.append(
            LightSource(
                x=0.01 * x[number] / size[0],
                y=0.01 * y[number] / size[1],
                z=0.01 * z[number] / size[2],
                color=int(color[1:], 16),
                diameter=0.01 * diameters[number] / size[0] if diameters else None,
            )
        )
    return tuple(made)


def _library_licence(archive: HomeArchive, entries: dict[str, str]) -> str:
    for member in archive.top():
        if _LICENCE_FILE.search(member):
            found = _licence_of(archive, member)
            if found:
                return found
    return licence_in(entries.get("license", "")) or "unknown"


def _licence(own: str, library: str) -> str:
    """Return the licence of a piece: its own, or the library's if that only adds the version."""
    return library if not own or library.startswith(f"{own}-") else own


def _own_licence(archive: HomeArchive, model: str) -> str:
    """Return the licence in a file beside the model; "" if there is none or it is unknown."""
    for member in archive.folder(model):
        if _LICENCE_FILE.search(member.rpartition("/")[2]):
            found = _licence_of(archive, member)
            if found:
                return found
    return ""


def _licence_of(archive: HomeArchive, member: str) -> str:
    try:
        return licence_in(archive.read(member)[:_MAX_TEXT].decode("utf-8", "replace"))
    except InputError:
        return ""
