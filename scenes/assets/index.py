"""Files of converted catalogue pieces: `piece.json` and the index `catalogue.json`.

data/assets/catalogue.json                  libraries, usable pieces, refused pieces with reasons
data/assets/<library>/<piece>/piece.json    the `Asset` below
data/assets/<library>/<piece>/meshes/*.ply  one per part: metres, Z up, back towards +Y, centre of
                                            the footprint at the origin, lower end at z = 0
data/assets/<library>/<piece>/textures/*    colour as PNG or JPEG; alpha as a separate grey PNG
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from pbrnet.scenes.assets.free_space import SupportSurface
from pbrnet.scenes.assets.piece import CataloguePiece
from pbrnet.scenes.checked import build, plain
from pbrnet.scenes.color import Color
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import read_json, write_json

SCHEMA = 1
INDEX = "catalogue.json"
OWN_TABLE = "pieces.csv"  # in a folder of own pieces
PREVIEW = "preview.png"
Point3 = tuple[float, float, float]


@dataclass(frozen=True)
class AssetPart:
    """A mesh with one material; file names are relative to the piece's folder.

    `color` is linear Rec. 709 RGB. `kind` "sheer" transmits the share 1 - `opacity` of the light
    straight through, "glass" all of it. `lumens` above 0: the part emits at `kelvin` when its
    lamp is on.
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
    """Measurements and notes of a piece's conversion."""

    triangles: int
    dropped: int  # degenerate triangles that were removed
    size_error: float  # greatest difference from the size in the catalogue, metres
    textures: int
    notes: tuple[str, ...] = ()  # changes and losses, one sentence each


@dataclass(frozen=True)
class Provenance:
    """Origin of a piece: catalogue file, library, provider, package."""

    file: str  # the catalogue file
    sha256: str
    library: str
    version: str
    provider: str
    package: str  # Debian package and version; "" for a file from a folder


@dataclass(frozen=True)
class Asset:
    """`piece.json`."""

    piece: CataloguePiece
    parts: tuple[AssetPart, ...]
    boxes: tuple[tuple[Point3, Point3], ...]  # together cover its geometry
    levels: tuple[SupportSurface, ...]
    checks: Checks
    provenance: Provenance
    fingerprint: str  # of the catalogue file, the piece's description and the converter
    schema: int = SCHEMA

    @property
    def lumens(self) -> float:
        """Luminous flux of all light sources together."""
        return sum(part.lumens for part in self.parts)


@dataclass(frozen=True)
class RefusedPiece:
    """A piece that is not used, with the reason."""

    key: str
    name: str
    reason: str


@dataclass(frozen=True)
class IndexEntry:
    """Entry of a usable piece in the index: the attributes that asset rules test."""

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
    """Entry of a catalogue file in the index."""

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
class AssetIndex:
    """Contents of `catalogue.json`; empty if catalogues are disabled."""

    libraries: tuple[LibraryEntry, ...] = ()
    pieces: tuple[IndexEntry, ...] = ()
    refused: tuple[RefusedPiece, ...] = ()
    schema: int = SCHEMA
    folder: Path = field(default=Path(), init=False, compare=False)

    @property
    def own_keys(self) -> frozenset[str]:
        """Keys of the own pieces, whose table states their categories."""
        own = {library.key for library in self.libraries if library.file == OWN_TABLE}
        return frozenset(one.key for one in self.pieces if one.key.partition("/")[0] in own)

    def verify(self, where: str) -> None:
        """Check the schema version; raises ValueError."""
        if self.schema != SCHEMA:
            raise ValueError(
                f"{where}: schema {self.schema}, this version reads {SCHEMA}; run: pbrnet assets"
            )


def index_entry(asset: Asset) -> IndexEntry:
    """Return the index entry of an asset."""
    piece = asset.piece
    return IndexEntry(
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
    """Read `piece.json`; raises `InputError` if it is missing or invalid."""
    path = Path(folder) / "piece.json"
    asset = build(Asset, read_json(path), str(path), InputError)
    if asset.schema != SCHEMA:
        raise InputError(f"{path}: schema {asset.schema}, this version reads {SCHEMA}")
    return asset


def save_asset(folder: Path, asset: Asset) -> None:
    """Write `piece.json`."""
    write_json(Path(folder) / "piece.json", plain(asset))


def load_index(root: Path) -> AssetIndex:
    """Read `catalogue.json` in `data/assets`; returns an empty index if there is none."""
    path = Path(root) / INDEX
    index = (
        build(AssetIndex, read_json(path), str(path), InputError)
        if path.is_file()
        else AssetIndex()
    )
    object.__setattr__(index, "folder", Path(root))
    return index


def save_index(root: Path, index: AssetIndex) -> None:
    """Write `catalogue.json`."""
    write_json(Path(root) / INDEX, plain(index))
