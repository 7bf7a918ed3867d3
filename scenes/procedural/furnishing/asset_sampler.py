"""Sampling of catalogue assets as furniture pieces.

A home draws from a few models of each kind, as real homes do. All choices use a random generator
of their own, so the rest of the home is the same with and without catalogues.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.assets.index import (
    INDEX,
    Asset,
    AssetIndex,
    AssetPart,
    IndexEntry,
    load_asset,
    load_index,
)
from pbrnet.scenes.formats.ply import read_ply
from pbrnet.scenes.looks import HomeSettings
from pbrnet.scenes.procedural.furnishing.asset_rules import (
    ASSET_RULES,
    AssetRule,
    rules_of_own,
)
from pbrnet.scenes.procedural.piece import (
    CatalogueCredit,
    CatalogueMaterial,
    FurniturePiece,
    PiecePart,
)
from pbrnet.scenes.seeds import Draw

_MODELS = 3  # of one kind in a home
_SMALL = 0.45  # metres; kinds below this size have more models
_SMALL_MODELS = 8
_HOME_TRIANGLES = 450_000  # of all catalogue pieces in a home
_WIDTH_TOLERANCE = 0.15  # relative difference from the requested width
_LOOSE_TOLERANCE = 0.35  # of rugs, and of own pieces in the middle of rooms
_LOWEST_MOUNT = 0.13  # metres: above any skirting
_EDGE = 0.01  # metres from the edge of a support surface that stay free


class AssetSampler:
    """Samples catalogue pieces for one home."""

    def __init__(self, rng: Draw, index: KindIndex, home: HomeSettings) -> None:
        self.rng, self._index = rng, index
        self._share, self._limit = home.share, home.triangles
        self._budget = _HOME_TRIANGLES
        self._models: dict[str, list[IndexEntry]] = {}

    def chance(self, probability: float = 1.0) -> bool:
        """Return True with `probability` times the share of catalogue pieces."""
        return self.rng.chance(probability * self._share)

    def substitute(self, kind: str, options: Mapping[str, float]) -> FurniturePiece | None:
        """Return a catalogue piece for a generated kind, or None to generate the piece."""
        if kind not in _RULE_BY_KIND or not self.chance():
            return None
        return self.sample(kind, options)

    def sample(
        self, kind: str, options: Mapping[str, float] | None = None
    ) -> FurniturePiece | None:
        """Return a piece of a kind with sizes near the `options` (metres), or None."""
        rule = _RULE_BY_KIND[kind]
        fitting = [
            entry
            for entry in self._models_of(rule)
            if _size_matches(rule, entry, options or {}, self._index.is_own(entry))
        ]
        if not fitting:
            return None
        chosen = self.rng.pick(fitting)
        if chosen.triangles > self._budget:
            return None
        return self._take(chosen, rule)

    def own_pieces(self, category: str, kinds: Collection[str]) -> list[tuple[IndexEntry, str]]:
        """Own pieces for one of `kinds`, and those of a category where there are none of either.

        Each with its kind or category. `catalogue_triangles` does not bound them; the triangles
        of the whole home do.
        """
        index, found = self._index, []
        for entry in index.own:
            taking = [kind for kind, entries in index.kinds.items() if entry in entries]
            usable = [kind for kind in kinds if kind in taking]
            if entry.category == category and not (taking and kinds):
                usable = [category.replace(" ", "_")]
            if usable and entry.triangles <= self._budget:
                found.append((entry, usable[0]))
        return found

    def take_own(self, entry: IndexEntry, kind: str) -> FurniturePiece:
        """Return an own piece of `own_pieces`."""
        plain = AssetRule(kind, (), entry.category, "free", lumens=(0.0, entry.lumens))
        return self._take(entry, _RULE_BY_KIND.get(kind, plain))

    def _take(self, entry: IndexEntry, rule: AssetRule) -> FurniturePiece:
        self._budget -= entry.triangles
        return from_catalogue(self._index.folder, entry, rule)

    def _models_of(self, rule: AssetRule) -> list[IndexEntry]:
        """Models of a kind that this home uses, drawn on first use."""
        if rule.kind not in self._models:
            candidates = [
                entry for entry in self._index.kinds[rule.kind] if entry.triangles <= self._limit
            ]
            order = self.rng.shuffled(candidates)
            small = rule.anchor == "on_top" or max(rule.width[1], rule.depth[1]) < _SMALL
            count = _SMALL_MODELS if small else _MODELS
            self._models[rule.kind] = order[:count]
        return self._models[rule.kind]


_RULE_BY_KIND = {rule.kind: rule for rule in ASSET_RULES}


@dataclass(frozen=True, eq=False)
class KindIndex:
    """Catalogue entries by furniture kind; `folder` holds the converted catalogues.

    `own` are the entries whose table states their category.
    """

    folder: Path
    kinds: Mapping[str, tuple[IndexEntry, ...]]
    own: tuple[IndexEntry, ...] = ()

    def is_own(self, entry: IndexEntry) -> bool:
        """Return True for an own piece."""
        return any(entry is one for one in self.own)


def load_kind_index(folder: Path) -> KindIndex:
    """Load the index of `data/assets` by kind; cached until `catalogue.json` changes."""
    path = Path(folder) / INDEX
    return _cached_index(Path(folder), path.stat().st_mtime_ns if path.is_file() else 0)


@lru_cache(maxsize=2)
def _cached_index(folder: Path, changed: int) -> KindIndex:
    return build_kind_index(load_index(folder))


def build_kind_index(index: AssetIndex) -> KindIndex:
    """Group the entries of an index by kind; an entry may belong to several kinds."""
    keys = index.own_keys
    stated = {entry.key: rules_of_own(entry) for entry in index.pieces if entry.key in keys}
    return KindIndex(
        index.folder,
        {
            rule.kind: tuple(
                entry
                for entry in index.pieces
                if (rule in stated[entry.key] if entry.key in stated else rule.matches(entry))
            )
            for rule in ASSET_RULES
        },
        tuple(entry for entry in index.pieces if entry.key in stated),
    )


def _size_matches(
    rule: AssetRule, entry: IndexEntry, options: Mapping[str, float], own: bool
) -> bool:
    width, depth, height = entry.size
    loose = rule.kind == "rug" or (own and rule.anchor == "centre")
    tolerance = _LOOSE_TOLERANCE if loose else _WIDTH_TOLERANCE
    if "width" in options and abs(width / options["width"] - 1) > tolerance:
        return False
    if "depth" in options and abs(depth / options["depth"] - 1) > tolerance:
        return False
    if "height" in options and height > options["height"]:
        return False
    return "drop" not in options or 0.35 * options["drop"] <= height <= options["drop"]


def from_catalogue(root: Path, entry: IndexEntry, rule: AssetRule) -> FurniturePiece:
    """Load a converted asset as a furniture piece with the anchor of its rule."""
    asset, parts = _load_parts(root / entry.key, entry.fingerprint)
    low = np.min([part.vertices.min(axis=0) for part in parts], axis=0)
    high = np.max([part.vertices.max(axis=0) for part in parts], axis=0)
    on_wall = rule.anchor == "on_wall"
    lifted = -high[2] if rule.anchor == "ceiling" else -low[2]
    shift = np.array([0.0, -high[1] if on_wall else 0.0, lifted])
    bounds = np.array(asset.boxes, dtype=np.float64).reshape(-1, 2, 3) + shift
    piece = asset.piece
    return FurniturePiece(
        name=piece.name.lower(),
        category=rule.category,
        parts=_with_rule_lumens(
            [replace(part, vertices=part.vertices + shift) for part in parts], rule
        ),
        anchor=rule.anchor,
        front_clearance=rule.front_clearance,
        surfaces=tuple(
            replace(
                level,
                x=level.x + shift[0],
                y=level.y + shift[1],
                z=level.z + shift[2],
                half_x=max(level.half_x - _EDGE, 0.0),
                half_y=max(level.half_y - _EDGE, 0.0),
            )
            for level in asset.levels
        ),
        mount_height=max(piece.elevation, _LOWEST_MOUNT) if on_wall else 0.0,
        boxes=bounds,
        credit=_credit(asset),
    )


def _credit(asset: Asset) -> CatalogueCredit:
    provenance = asset.provenance
    source = " ".join(word for word in (provenance.file, provenance.version) if word)
    if provenance.package:
        source += f", Debian package {provenance.package}"
    if provenance.provider:
        source += f", {provenance.provider}"
    return CatalogueCredit(asset.piece.creator, asset.piece.licence, provenance.library, source)


def _with_rule_lumens(parts: list[PiecePart], rule: AssetRule) -> tuple[PiecePart, ...]:
    """The parts, their total luminous flux clamped to the range of the rule."""
    total = sum(part.lumens for part in parts)
    if total <= 0 or rule.lumens[1] <= 0:
        return tuple(replace(part, lumens=0.0) for part in parts)
    factor = min(max(total, rule.lumens[0]), rule.lumens[1]) / total
    return tuple(replace(part, lumens=round(part.lumens * factor, 1)) for part in parts)


@lru_cache(maxsize=96)
def _load_parts(folder: Path, fingerprint: str) -> tuple[Asset, tuple[PiecePart, ...]]:
    """A converted asset and its meshes; cached by fingerprint for later homes of the process."""
    asset = load_asset(folder)
    parts = [_part(folder, number, part) for number, part in enumerate(asset.parts)]
    return asset, tuple(parts)


def _part(folder: Path, number: int, part: AssetPart) -> PiecePart:
    mesh = read_ply(folder / part.mesh)
    uvs: Float64Array = np.zeros((len(mesh.vertices), 2))
    return PiecePart(
        name=f"{part.kind}_{number}",
        vertices=mesh.vertices,
        faces=mesh.faces,
        uvs=uvs if mesh.uvs is None else mesh.uvs,
        material=CatalogueMaterial(
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
        given_normals=mesh.normals,
    )
