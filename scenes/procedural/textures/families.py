"""Families of surfaces for each kind of material, and the surfaces of a family.

A family has `SEEDS` surfaces at each of `WEARS` states of wear. A material shows one of them at an
offset, scale, contrast and colour of its own, so that none is met twice.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np

from pbrnet.scenes.arrays import Float32Array, UInt8Array
from pbrnet.scenes.procedural.piece import Material
from pbrnet.scenes.procedural.textures import cloth, goods, masonry, woods
from pbrnet.scenes.procedural.textures.fields import Surface
from pbrnet.scenes.procedural.textures.wear import worn
from pbrnet.scenes.seeds import Draw, derive, generator

SEEDS = 6  # different draws of each family
WEARS = 3  # steps from new to old


@dataclass(frozen=True)
class Family:
    """A way to make surfaces.

    `detail`: divisor of the side of its textures, 2 at least for what stands outdoors; `hard`:
    scratched rather than stained; `sheen` of the fibres; `wears`: how much age shows.
    """

    make: Callable[[Draw, int], Surface]
    detail: int = 2
    hard: bool = True
    sheen: float = 0.0
    wears: float = 1.0


def _soft(
    make: Callable[..., Surface], detail: int = 2, sheen: float = 0.15, **options: object
) -> Family:
    return Family(partial(make, **options), detail, hard=False, sheen=sheen, wears=0.7)


def _hard(
    make: Callable[..., Surface], detail: int = 2, wears: float = 1.0, **options: object
) -> Family:
    return Family(partial(make, **options), detail, wears=wears)


# Kind of material -> family -> how it is made. The first family is that of `variant` 0.
FAMILIES: dict[str, dict[str, Family]] = {
    "wood": {
        "oak": _hard(woods.solid, grain=woods.OAK),
        "ash": _hard(woods.solid, grain=woods.ASH),
        "walnut": _hard(woods.solid, grain=woods.WALNUT),
        "beech": _hard(woods.solid, grain=woods.BEECH),
        "pine": _hard(woods.solid, grain=woods.PINE),
        "birch": _hard(woods.solid, grain=woods.BIRCH),
        "teak": _hard(woods.solid, grain=woods.TEAK),
        "cherry": _hard(woods.solid, grain=woods.CHERRY),
        "wenge": _hard(woods.solid, grain=woods.WENGE),
        "bamboo": _hard(woods.solid, grain=woods.BAMBOO),
        "butcher": _hard(woods.end_grain),
        "plywood": _hard(woods.plywood),
        "chipboard": _hard(woods.chipboard),
        "cork": _hard(woods.cork),
        "wicker": _hard(woods.wicker),
    },
    "planks": {
        "oak": _hard(woods.floor, 1, grain=woods.OAK, width=0.16),
        "ash": _hard(woods.floor, 1, grain=woods.ASH, width=0.14),
        "walnut": _hard(woods.floor, 1, grain=woods.WALNUT, width=0.12),
        "pine": _hard(woods.floor, 1, grain=woods.PINE, width=0.13, bevel=0.0025),
        "laminate": _hard(woods.floor, 1, grain=woods.BEECH, width=0.19, bevel=0.0008, gloss=0.015),
        "strips": _hard(woods.floor, 1, grain=woods.BEECH, width=0.07, layout="strips"),
        "herringbone": _hard(woods.floor, 1, grain=woods.OAK, width=0.08, layout="herringbone"),
        "basket": _hard(woods.floor, 1, grain=woods.TEAK, width=0.05, layout="basket"),
    },
    "tiles": {
        "square": _hard(masonry.tiled, 1),
        "stoneware": _hard(masonry.tiled, 1, body="matt", columns=2, rows=4, joint=0.003),
        "subway": _hard(masonry.tiled, 1, columns=4, rows=8, shift=0.5, joint=0.003),
        "stacked": _hard(masonry.tiled, 1, columns=3, rows=12, joint=0.003),
        "third": _hard(masonry.tiled, 1, columns=2, rows=6, shift=1 / 3, body="matt"),
        "hexagon": _hard(masonry.tiled, 1, columns=7, hexagon=True, body="matt"),
        "mosaic": _hard(masonry.tiled, 2, columns=24, rows=24, metres=0.6, joint=0.003),
        "penny": _hard(masonry.tiled, 2, columns=20, metres=0.6, hexagon=True, joint=0.004),
        "handmade": _hard(masonry.tiled, 1, columns=10, rows=10, body="handmade", joint=0.003),
        "terracotta": _hard(masonry.tiled, 1, body="handmade", joint=0.009),
        "marble": _hard(masonry.tiled, 1, columns=2, rows=2, body="stone", joint=0.002),
        "flagstone": _hard(masonry.tiled, 1, columns=3, rows=3, body="stone", joint=0.008),
        "cement": _hard(masonry.tiled, 1, columns=6, rows=6, body="inlaid", joint=0.002),
    },
    "brick": {
        "running": _hard(masonry.brickwork),
        "third": _hard(masonry.brickwork, bond="third", worn=1.6),
        "stack": _hard(masonry.brickwork, bond="stack", worn=0.5),
    },
    "fabric": {
        "plain": _soft(cloth.woven),
        "linen": _soft(cloth.woven, pitch=0.003, slub=2.2, threads="melange", sheen=0.1),
        "basket": _soft(cloth.woven, draft="basket", pitch=0.005),
        "twill": _soft(cloth.woven, draft="twill", pitch=0.003),
        "herringbone": _soft(cloth.woven, draft="herringbone", pitch=0.004),
        "birdseye": _soft(cloth.woven, draft="birdseye", pitch=0.004),
        "melange": _soft(cloth.woven, pitch=0.004, threads="melange"),
        "boucle": _soft(cloth.looped, sheen=0.2),
        "velvet": _soft(cloth.pile, sheen=0.45),
        "chenille": _soft(cloth.pile, nap=2.0, sheen=0.35),
        "corduroy": _soft(cloth.corduroy, sheen=0.3),
        "felt": _soft(cloth.felt),
        "striped": _soft(cloth.woven, pitch=0.0025, threads="striped"),
        "checked": _soft(cloth.woven, draft="twill", pitch=0.003, threads="checked"),
        "denim": _soft(cloth.woven, draft="denim", pitch=0.002, slub=1.4, sheen=0.05),
        "satin": _soft(cloth.woven, draft="satin", pitch=0.002, slub=0.3, threads="one", sheen=0.1),
        "cotton": _soft(cloth.woven, pitch=0.0016, slub=0.5, threads="one", sheen=0.1),
        "knit": _soft(cloth.knitted, sheen=0.2),
        "cable": _soft(cloth.cabled, sheen=0.2),
        "terry": _soft(cloth.looped, across=72, sheen=0.25),
    },
    "carpet": {
        "cut": _soft(cloth.carpet, sheen=0.2),
        "shag": _soft(cloth.carpet, tuft=2.4, sheen=0.25),
        "loop": _soft(cloth.looped, across=64, curl=1.2, metres=0.6),
        "sisal": _soft(cloth.sisal, sheen=0.05),
        "rag": _soft(cloth.rag),
        "kilim": _soft(cloth.kilim, 1),
    },
    "leather": {
        "full": _soft(cloth.leather, sheen=0.0),
        "nappa": _soft(cloth.leather, grain=0.5, count=90, sheen=0.0),
        "pebbled": _soft(cloth.leather, grain=1.6, count=44, sheen=0.0),
        "suede": _soft(cloth.suede, sheen=0.3),
    },
    "plaster": {
        "rolled": _hard(masonry.painted, 1, wears=0.6),
        "smooth": _hard(masonry.painted, 1, wears=0.6, nap=0.35),
        "coarse": _hard(masonry.painted, 1, wears=0.6, nap=1.8),
        "trowelled": _hard(masonry.trowelled, wears=0.6),
        "woodchip": _hard(masonry.woodchip, 1, wears=0.6),
        "brushed": _hard(masonry.brushed, wears=0.6),
        "render": _hard(masonry.rendered, 2),
        "roughcast": _hard(masonry.rendered, 2, grain=2.2),
    },
    "wallpaper": {
        name: Family(partial(masonry.papered, print_of=name), 1, hard=False)
        for name in (
            "stripes", "diamonds", "hexagons", "scales", "sprigs", "damask", "grasscloth",
        )
    },
    "stone": {
        "granite": _hard(goods.granite, wears=0.5),
        "marble": _hard(goods.marble, wears=0.5),
        "composite": _hard(goods.composite, wears=0.5),
        "travertine": _hard(goods.travertine),
        "slate": _hard(goods.slate),
        "terrazzo": _hard(goods.terrazzo, wears=0.5),
        "concrete": _hard(masonry.concrete),
    },
    "paint": {
        "lacquer": _hard(goods.lacquer, 4, wears=0.3),
        "satin": _hard(goods.lacquer, 4, wears=0.3, peel=2.0),
        "brushed": _hard(masonry.brushed, 2),
        "powder": _hard(goods.lacquer, 4, wears=0.3, peel=4.0),
        "panelled": _hard(masonry.planked, 2),
        "roof": _hard(masonry.roof_tiles, 2),
    },
    "plastic": {
        "smooth": _hard(goods.plastic, 8, wears=0.3),
        "spark": _hard(goods.plastic, 4, wears=0.3, spark=1.0),
        "soft": _hard(goods.plastic, 4, wears=0.3, spark=0.4),
    },
    "metal": {
        "brushed": _hard(goods.brushed, 4),
        "polished": _hard(goods.polished, 8),
        "cast": _hard(goods.cast, 4),
        "hammered": _hard(goods.hammered, 4),
        "patinated": _hard(goods.patinated, 4),
    },
    "ceramic": {
        "glazed": _hard(goods.glazed, 8, wears=0.4),
        "reactive": _hard(goods.glazed, 8, wears=0.4, wavy=2.5),
        "crazed": _hard(masonry.crazed, 4, wears=0.4),
        "speckled": _hard(goods.speckled, 4, wears=0.4),
        "earthenware": _hard(goods.earthenware, 4),
    },
    "paper": {
        "card": _soft(goods.paper, 8, sheen=0.0),
        "creased": _soft(goods.paper, 4, fold=3.0, sheen=0.0),
        "corrugated": _soft(goods.corrugated, 4, sheen=0.0),
    },
    "picture": {"canvas": _soft(goods.canvas, 4, sheen=0.0)},
    "leaf": {"leaf": _soft(goods.leaf, 4, sheen=0.0)},
    "grass": {
        "lawn": _soft(goods.lawn, sheen=0.0),
        "meadow": _soft(goods.lawn, sheen=0.0, long=2.0),
    },
    "soil": {
        "crumbs": _soft(goods.soil, 4, sheen=0.0),
        "mulch": _soft(goods.soil, 4, sheen=0.0, crumbs=1.8),
        "gravel": _soft(goods.gravel, 2, sheen=0.0),
        "asphalt": _soft(goods.asphalt, sheen=0.0),
        "bark": _soft(woods.bark, 4, sheen=0.0),
    },
}  # fmt: skip
# Families that are drawn where a material names none; other families are named by their users.
_COMMON: dict[str, tuple[str, ...]] = {
    "wood": ("oak", "ash", "walnut", "beech", "birch", "teak", "cherry"),
    "planks": ("oak", "ash", "walnut", "pine", "laminate", "strips", "herringbone", "basket"),
    "tiles": ("square", "stoneware", "subway", "third", "hexagon", "handmade", "marble"),
    "fabric": ("plain", "linen", "basket", "twill", "herringbone", "birdseye", "melange", "boucle",
               "chenille", "felt"),
    "carpet": ("cut", "shag", "loop"),
    "plaster": ("rolled", "smooth", "coarse"),
    "paint": ("lacquer", "satin"),
    "stone": ("granite", "marble", "composite", "terrazzo"),
    "leather": ("full", "nappa", "pebbled"),
    "ceramic": ("glazed", "reactive"),
    "paper": ("card",),
    "grass": ("lawn",),
    "soil": ("crumbs", "mulch"),
}  # fmt: skip


def has_surface(kind: str) -> bool:
    """Return True if materials of this kind have textures; mirrors and glass have none."""
    return kind in FAMILIES


def family_of(material: Material) -> str:
    """Return the family of a material: the one it names, else one that its numbers choose."""
    if material.family:
        return material.family
    if material.kind == "metal":
        if material.roughness < 0.2:
            return "polished"
        return "brushed" if material.roughness < 0.45 else "cast"
    names = _COMMON.get(material.kind) or tuple(FAMILIES[material.kind])
    if material.variant == 0:
        return names[0]
    return names[derive(material.variant, "family", material.kind) % len(names)]


@dataclass(frozen=True)
class PackedSurface:
    """A surface in few bytes: `mix` of 255, `shade` of 128 for 1, `rough` of 200 around 100."""

    mix: UInt8Array
    shade: UInt8Array
    rough: UInt8Array
    normal: UInt8Array  # (size, size, 3): x, y, z from -1 to 1 as 0 to 255
    metres: float
    modules: tuple[int, int] | None


@lru_cache(maxsize=64)
def packed_surface(kind: str, family: str, seed: int, size: int, wear: int) -> PackedSurface:
    """Return a surface of a family: `seed` below SEEDS, `wear` from 0 to WEARS - 1."""
    made = surface(kind, family, seed, size, wear)
    return PackedSurface(
        _byte(made.mix * 255),
        _byte(made.shade * 128),
        _byte(made.rough * 200 + 100),
        normal_map(made),
        made.metres,
        made.modules,
    )


def surface(kind: str, family: str, seed: int, size: int, wear: int = 0) -> Surface:
    """Return the maps of a surface; equal arguments give equal bits."""
    how = FAMILIES[kind][family]
    made = how.make(generator(seed, "surface", kind, family), size)
    level = wear / (WEARS - 1) * how.wears
    return worn(made, generator(seed, "wear", kind, family), level, how.hard)


def normal_map(made: Surface, steepest: float = 1.2) -> UInt8Array:
    """Return a surface's normals as an image (size, size, 3); x along u, y along v.

    Slopes are those of the heights in metres, at most `steepest`.
    """
    size = made.height.shape[0]
    step = np.float32(2 * made.metres / size)
    slope_u, slope_v = _difference(made.height, 1), _difference(made.height, 0)
    for slope in (slope_u, slope_v):
        slope /= step
        np.clip(slope, -steepest, steepest, out=slope)
    length = 1 + slope_u * slope_u
    length += slope_v * slope_v
    np.sqrt(length, out=length)
    packed = np.empty((size, size, 3), dtype=np.uint8)
    for band, part in enumerate((-slope_u / length, -slope_v / length, 1 / length)):
        part *= np.float32(127.5)
        part += np.float32(127.5)
        packed[..., band] = _byte(part)
    return packed


def _difference(height: Float32Array, axis: int) -> Float32Array:
    """Next minus previous texel along an axis, around the tile's border."""
    out = np.empty_like(height)
    moved, source = np.moveaxis(out, axis, 0), np.moveaxis(height, axis, 0)
    np.subtract(source[2:], source[:-2], out=moved[1:-1])
    np.subtract(source[1], source[-1], out=moved[0])
    np.subtract(source[0], source[-2], out=moved[-1])
    return out


def _byte(values: np.ndarray) -> UInt8Array:
    rounded = np.asarray(values + np.float32(0.5))
    return np.clip(rounded, 0, 255, out=rounded).astype(np.uint8)
