"""Reader of `pieces.csv`, the table of a folder of own pieces, and their jobs of conversion."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, cast, get_args

from pbrnet.scenes.assets.piece import CataloguePiece
from pbrnet.scenes.checked import shown
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import read_csv, resolved
from pbrnet.scenes.importing.categories import CATEGORIES, category_of
from pbrnet.scenes.models.options import READERS
from pbrnet.scenes.sweethome.catalogue.library import MAX_PIECES, Library, UnusablePiece, slug

Front = Literal["", "x", "-x", "y", "-y", "z", "-z"]
Up = Literal["", "x", "y", "z"]
_REQUIRED = ("file", "category", "width", "depth")
_OPTIONAL = ("height", "elevation", "up", "front", "licence", "author", "name", "lumens")
_LARGEST, _SMALLEST = 20.0, 0.005  # metres, of any side
_BRIGHTEST = 20_000.0  # lumens


@dataclass(frozen=True)
class OwnPiece(CataloguePiece):
    """A row of the table; a height of 0 is that of the model, scaled as width and depth are."""

    up: Up  # axis of the model that points up; "": what the file states, else y
    front: Front  # axis of the model that the front faces; "": that of its format
    lumens: float


def read_table(path: Path) -> Library:
    """Read `pieces.csv`; raises `InputError` if it is no such table.

    Rows that make no sense are listed in `refused`.
    """
    rows = read_csv(path)
    columns = set(rows[0]) if rows else set()
    for name in _REQUIRED:
        if name not in columns:
            raise InputError(
                f"{path}: no column {name!r}; it has {', '.join(_REQUIRED)}, and may have "
                f"{', '.join(_OPTIONAL)}"
            )
    if unknown := sorted(columns - {*_REQUIRED, *_OPTIONAL}):
        raise InputError(f"{path}: unknown column {shown(unknown[0])}")
    if len(rows) > MAX_PIECES:
        raise InputError(f"{path}: {len(rows):,} rows; at most {MAX_PIECES:,}")
    library = slug(path.resolve().parent.name)
    pieces, refused, taken = [], [], set[str]()
    for number, row in enumerate(rows, 1):
        name = slug(Path(row["file"].replace("\\", "/")).stem)
        key = f"{library}/{name}"
        key = key if key.lower() not in taken else f"{key}-row{number}"
        taken.add(key.lower())
        try:
            pieces.append(_piece({k: v.strip() for k, v in row.items()}, key, path.parent))
        except UnusablePiece as reason:
            refused.append((key, row.get("name") or row["file"], f"row {number}: {reason}"))
    licences = sorted({piece.licence for piece in pieces})
    return Library(
        key=library,
        name=path.resolve().parent.name,
        version="",
        licence=licences[0] if len(licences) == 1 else ", ".join(licences) or "unknown",
        provider="",
        pieces=tuple(pieces),
        refused=tuple(refused),
    )


def _piece(row: dict[str, str], key: str, folder: Path) -> OwnPiece:
    file, category = row["file"], row["category"].lower()
    if Path(file).suffix.lower() not in READERS:
        raise UnusablePiece(f"{shown(file)} is none of {', '.join(READERS)}")
    path = resolved(folder / file)
    if not path.is_relative_to(resolved(folder)) or not path.is_file():
        raise UnusablePiece(f"{shown(file)} is no file in the table's folder")
    if category not in CATEGORIES:
        meant = category_of(category)
        hint = f"; is {meant!r} meant?" if meant != "other" else ""
        raise UnusablePiece(f"{shown(row['category'])} is no category of furniture{hint}")
    up, front = (row.get(name, "").lower() for name in ("up", "front"))
    for name, value, known in (("up", up, get_args(Up)), ("front", front, get_args(Front))):
        if value not in known:
            raise UnusablePiece(f"{name} {shown(value)} is not one of {', '.join(known[1:])}")
    sides = [_number(row, name) for name in ("width", "depth", "height")]
    if not all(_SMALLEST <= side <= _LARGEST for side in sides[:2]) or sides[2] > _LARGEST:
        raise UnusablePiece("its sides are not from 0.005 to 20 m")
    return OwnPiece(
        key=key,
        id=file,
        name=row.get("name") or Path(file).stem.replace("_", " ").replace("-", " "),
        group="Own",
        category=category,
        tags=(category,),
        creator=row.get("author") or "unknown",
        licence=row.get("licence") or "unknown",
        model=file,
        size=(sides[0], sides[1], sides[2]),
        elevation=_number(row, "elevation"),
        drop=sides[2],
        movable=True,
        opening=None,
        rotation=None,
        lights=(),
        up=cast(Up, up),
        front=cast(Front, front),
        lumens=min(_number(row, "lumens"), _BRIGHTEST),
    )


def _number(row: dict[str, str], name: str) -> float:
    """The number of a column; 0 where it is empty."""
    text = row.get(name) or "0"
    try:
        value = float(text)
    except ValueError:
        raise UnusablePiece(f"{name} {shown(text)} is not a number") from None
    if not math.isfinite(value) or value < 0:
        raise UnusablePiece(f"{name} {shown(text)} is not a positive number")
    return value
