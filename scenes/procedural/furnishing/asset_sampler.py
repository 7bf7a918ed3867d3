"""The furniture of the catalogues as pieces of the generator: which fit, and one of them, drawn.

A home keeps to few models of a kind, as people do. All choices descend from one generator of its
own, so that the rest of the home is drawn as without catalogues.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from scenes.arrays import Float64Array
from scenes.assets.index import INDEX, Asset, AssetPart, Index, Usable, load_asset, load_index
from scenes.formats.ply import read_ply
from scenes.params import SceneParams
from scenes.procedural.furnishing.asset_rules import WARES, Ware
from scenes.procedural.piece import BoughtMaterial, Credit, Part, Piece, Surface

_FAVOURITES = 3  # models of one kind that a home has
_SMALL = 0.45  # metres; smaller things come in more models
_SMALL_FAVOURITES = 8
_HOME_TRIANGLES = 450_000  # of all catalogue pieces of a home
_WIDTH_TOLERANCE = 0.15  # by which a model may differ from the width asked for
_RUG_TOLERANCE = 0.35
_LOWEST_MOUNT = 0.13  # metres: above any skirting
_EDGE = 0.01  # metres that small things keep from the rim of what carries them


class Shop:
    """Offers catalogue pieces to one home."""

    def __init__(self, rng: np.random.Generator, stock: Stock, params: SceneParams) -> None:
        self._rng, self._stock = rng, stock
        self._share = params.catalogue_share
        self._limit = params.catalogue_triangles
        self._budget = _HOME_TRIANGLES
        self._shelves: dict[str, list[Usable]] = {}

    def chance(self, probability: float = 1.0) -> bool:
        """True with that probability, times the share of catalogue pieces."""
        return bool(self._rng.random() < probability * self._share)

    def draw(self, low: float, high: float) -> float:
        """A uniform number in [low, high)."""
        return float(self._rng.uniform(low, high))

    def pick(self, count: int) -> int:
        """A number from 0 to `count` - 1."""
        return int(self._rng.integers(count))

    @property
    def rng(self) -> np.random.Generator:
        """The generator that all choices from the catalogues come from."""
        return self._rng

    def offer(self, kind: str, options: Mapping[str, float]) -> Piece | None:
        """A piece in place of one of the generator's own kind, or None: make your own."""
        ware = _BY_KIND.get(kind)
        if ware is None or not self.chance():
            return None
        return self.sell(kind, options)

    def sell(self, kind: str, options: Mapping[str, float] | None = None) -> Piece | None:
        """A piece of a kind, of sizes near the `options`, or None where there is none."""
        ware = _BY_KIND[kind]
        fitting = [piece for piece in self._shelf(ware) if _near(ware, piece, options or {})]
        if not fitting:
            return None
        chosen = fitting[int(self._rng.integers(len(fitting)))]
        if chosen.triangles > self._budget:
            return None
        self._budget -= chosen.triangles
        return bought(self._stock.folder, chosen, ware)

    def _shelf(self, ware: Ware) -> list[Usable]:
        """This home's models of a kind."""
        if ware.kind not in self._shelves:
            stock = [
                piece for piece in self._stock.kinds[ware.kind] if piece.triangles <= self._limit
            ]
            order = self._rng.permutation(len(stock))
            small = ware.anchor == "on_top" or max(ware.width[1], ware.depth[1]) < _SMALL
            count = _SMALL_FAVOURITES if small else _FAVOURITES
            self._shelves[ware.kind] = [stock[int(k)] for k in order[:count]]
        return self._shelves[ware.kind]


_BY_KIND = {ware.kind: ware for ware in WARES}


@dataclass(frozen=True, eq=False)
class Stock:
    """Converted catalogues below `folder`: for every kind, the pieces that can stand in for it."""

    folder: Path
    kinds: Mapping[str, tuple[Usable, ...]]


def open_stock(folder: Path) -> Stock:
    """The stock of `data/assets`, read once a process as long as its index does not change."""
    path = Path(folder) / INDEX
    return _stock(Path(folder), path.stat().st_mtime_ns if path.is_file() else 0)


@lru_cache(maxsize=2)
def _stock(folder: Path, changed: int) -> Stock:
    return stock_of(load_index(folder))


def stock_of(index: Index) -> Stock:
    """Sort the pieces of an index by kind; a piece may be of several."""
    return Stock(
        index.folder,
        {ware.kind: tuple(piece for piece in index.pieces if ware.fits(piece)) for ware in WARES},
    )


def _near(ware: Ware, piece: Usable, options: Mapping[str, float]) -> bool:
    width, depth, height = piece.size
    tolerance = _RUG_TOLERANCE if ware.kind == "rug" else _WIDTH_TOLERANCE
    if "width" in options and abs(width / options["width"] - 1) > tolerance:
        return False
    if "depth" in options and abs(depth / options["depth"] - 1) > tolerance:
        return False
    if "height" in options and height > options["height"]:
        return False
    return "drop" not in options or 0.35 * options["drop"] <= height <= options["drop"]


def bought(root: Path, chosen: Usable, ware: Ware) -> Piece:
    """A converted piece as one of the generator's, standing as its kind does."""
    asset, parts = _opened(root / chosen.key, chosen.fingerprint)
    low = np.min([part.vertices.min(axis=0) for part in parts], axis=0)
    high = np.max([part.vertices.max(axis=0) for part in parts], axis=0)
    shift = np.zeros(3)
    if ware.anchor == "on_wall":
        shift = np.array([0.0, -high[1], -low[2]])
    elif ware.anchor == "ceiling":
        shift = np.array([0.0, 0.0, -high[2]])
    else:
        shift = np.array([0.0, 0.0, -low[2]])
    bounds = np.array(asset.boxes, dtype=np.float64).reshape(-1, 2, 3) + shift
    piece = asset.piece
    return Piece(
        name=piece.name.lower(),
        category=ware.category,
        parts=_lit([replace(part, vertices=part.vertices + shift) for part in parts], ware),
        anchor=ware.anchor,
        front_clearance=ware.front,
        surfaces=tuple(
            Surface(
                level.x + shift[0],
                level.y + shift[1],
                level.z + shift[2],
                max(level.half_x - _EDGE, 0.0),
                max(level.half_y - _EDGE, 0.0),
                level.headroom,
            )
            for level in asset.levels
        ),
        mount_height=max(piece.elevation, _LOWEST_MOUNT) if ware.anchor == "on_wall" else 0.0,
        boxes=bounds,
        credit=_credit(asset),
    )


def _credit(asset: Asset) -> Credit:
    told = asset.provenance
    source = " ".join(word for word in (told.file, told.version) if word)
    if told.package:
        source += f", Debian package {told.package}"
    if told.provider:
        source += f", {told.provider}"
    return Credit(asset.piece.creator, asset.piece.licence, told.library, source)


def _lit(parts: list[Part], ware: Ware) -> tuple[Part, ...]:
    """The parts with the flux of their lamp within what its kind has."""
    total = sum(part.lumens for part in parts)
    if total <= 0 or ware.lumens[1] <= 0:
        return tuple(replace(part, lumens=0.0) for part in parts)
    factor = min(max(total, ware.lumens[0]), ware.lumens[1]) / total
    return tuple(replace(part, lumens=round(part.lumens * factor, 1)) for part in parts)


@lru_cache(maxsize=96)
def _opened(folder: Path, fingerprint: str) -> tuple[Asset, tuple[Part, ...]]:
    """A converted piece with its meshes, kept for the next home of this process."""
    asset = load_asset(folder)
    parts = [_part(folder, number, part) for number, part in enumerate(asset.parts)]
    return asset, tuple(parts)


def _part(folder: Path, number: int, part: AssetPart) -> Part:
    mesh = read_ply(folder / part.mesh)
    uvs: Float64Array = np.zeros((len(mesh.vertices), 2))
    return Part(
        name=f"{part.kind}_{number}",
        vertices=mesh.vertices,
        faces=mesh.faces,
        uvs=uvs if mesh.uvs is None else mesh.uvs,
        material=BoughtMaterial(
            kind=part.kind,
            color=part.color,
            roughness=part.roughness,
            opacity=part.opacity,
            texture=str(folder / part.texture) if part.texture else None,
            alpha=str(folder / part.alpha) if part.alpha else None,
        ),
        smooth=True,
        lumens=part.lumens,
        kelvin=part.kelvin or 2800.0,
        given=mesh.normals,
    )
