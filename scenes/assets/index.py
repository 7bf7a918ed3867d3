"""What a converted piece looks like on disk, and the index of them: `piece.json`, `catalogue.json`.

data/assets/catalogue.json                  libraries, usable pieces, refused ones with reasons
data/assets/<library>/<piece>/piece.json    the `Asset` below
data/assets/<library>/<piece>/meshes/*.ply  one for each part: metres, Z up, back towards +Y,
                                            the footprint's centre at the origin, foot at z = 0
data/assets/<library>/<piece>/textures/*    PNG or JPEG, colour; alpha as grey PNG of its own
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from scenes.assets.free_space import Level
from scenes.assets.piece import CataloguePiece
from scenes.checked import build, plain
from scenes.color import Color
from scenes.errors import InputError
from scenes.files import read_json, write_json

SCHEMA = 1
INDEX = "catalogue.json"
PREVIEW = "preview.png"
Point3 = tuple[float, float, float]


@dataclass(frozen=True)
class AssetPart:
    """A mesh of one finish. `color` is linear Rec. 709; files are relative to the piece's folder.

    `kind` "sheer" lets the share 1 - `opacity` of the light straight through, "glass" all of it.
    `lumens` above 0: the part emits when its lamp is lit, at `kelvin`.
    """

    mesh: str
    kind: Literal["matt", "gloss", "metal", "mirror", "glass", "sheer"]
    color: Color
    roughness: float
    opacity: float
    texture: str | None = None
    alpha: str | None = None
    lumens: float = 0.0
    kelvin: float = 0.0
    triangles: int = 0


@dataclass(frozen=True)
class Checks:
    """What was measured when the piece was converted."""

    triangles: int
    dropped: int  # triangles without area that the model had
    size_error: float  # greatest difference from the size the catalogue gives, metres
    textures: int
    notes: tuple[str, ...] = ()  # what was changed or lost, a sentence each


@dataclass(frozen=True)
class Provenance:
    """Where a piece came from and on whose terms."""

    file: str  # the catalogue file
    sha256: str
    library: str
    version: str
    provider: str
    package: str  # the Debian package and version it was fetched in; "" where a file was given


@dataclass(frozen=True)
class Asset:
    """`piece.json`."""

    piece: CataloguePiece
    parts: tuple[AssetPart, ...]
    boxes: tuple[tuple[Point3, Point3], ...]  # hold all of its geometry
    levels: tuple[Level, ...]
    checks: Checks
    provenance: Provenance
    fingerprint: str  # of the catalogue file, the piece's description and the converter
    schema: int = SCHEMA

    @property
    def lumens(self) -> float:
        """Of all its light sources together."""
        return sum(part.lumens for part in self.parts)


@dataclass(frozen=True)
class Refused:
    """A piece that is not used, and why."""

    key: str
    name: str
    reason: str


@dataclass(frozen=True)
class Usable:
    """A piece in the index: what choosing one needs."""

    key: str
    name: str
    category: str
    group: str
    words: str
    size: Point3
    elevation: float
    triangles: int
    lumens: float
    opening: bool
    movable: bool
    levels: int
    creator: str
    licence: str
    fingerprint: str


@dataclass(frozen=True)
class LibraryEntry:
    """A catalogue file in the index."""

    key: str
    file: str
    sha256: str
    name: str
    version: str
    licence: str
    provider: str
    package: str
    pieces: int
    usable: int


@dataclass(frozen=True)
class Index:
    """`catalogue.json`; empty where catalogues are off."""

    libraries: tuple[LibraryEntry, ...] = ()
    pieces: tuple[Usable, ...] = ()
    refused: tuple[Refused, ...] = ()
    schema: int = SCHEMA
    folder: Path = field(default=Path(), init=False, compare=False)

    def verify(self, where: str) -> None:
        """Refuse another version's index; raises ValueError."""
        if self.schema != SCHEMA:
            raise ValueError(
                f"{where}: schema {self.schema}, this version reads {SCHEMA}; run: pbrnet assets"
            )


def entry(asset: Asset) -> Usable:
    """An asset's line in the index."""
    piece = asset.piece
    return Usable(
        key=piece.key,
        name=piece.name,
        category=piece.category,
        group=piece.group,
        words=piece.words,
        size=piece.size,
        elevation=piece.elevation,
        triangles=asset.checks.triangles,
        lumens=round(asset.lumens, 1),
        opening=piece.opening is not None,
        movable=piece.movable,
        levels=len(asset.levels),
        creator=piece.creator,
        licence=piece.licence,
        fingerprint=asset.fingerprint,
    )


def load_asset(folder: Path) -> Asset:
    """Read a converted piece; `InputError` names what is missing or wrong."""
    path = Path(folder) / "piece.json"
    asset = build(Asset, read_json(path), str(path), InputError)
    if asset.schema != SCHEMA:
        raise InputError(f"{path}: schema {asset.schema}, this version reads {SCHEMA}")
    return asset


def save_asset(folder: Path, asset: Asset) -> None:
    """Write `piece.json`."""
    write_json(Path(folder) / "piece.json", plain(asset))


def load_index(root: Path) -> Index:
    """Read `catalogue.json` below `data/assets`; an absent one is an empty one."""
    path = Path(root) / INDEX
    index = build(Index, read_json(path), str(path), InputError) if path.is_file() else Index()
    object.__setattr__(index, "folder", Path(root))
    return index


def save_index(root: Path, index: Index) -> None:
    """Write `catalogue.json`."""
    write_json(Path(root) / INDEX, plain(index))
