"""Families of surfaces for each kind of material, and the surfaces of a family.

A family has `SEEDS` surfaces at each of `WEARS` states of wear. A material shows one of them at an
offset, scale, contrast and colour of its own, so that none is met twice. The families are in
`families.yaml`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from inspect import signature
from typing import Any

import numpy as np

from pbrnet.scenes.arrays import AnyArray, Float32Array, UInt8Array
from pbrnet.scenes.checked import build
from pbrnet.scenes.files import data_beside
from pbrnet.scenes.procedural.piece import Material
from pbrnet.scenes.procedural.textures import cloth, goods, masonry, woods
from pbrnet.scenes.procedural.textures.fields import (
    BLOTCH,
    CLOUD,
    CRUMB,
    Spectrum,
    Surface,
    noise,
    smoothstep,
)
from pbrnet.scenes.seeds import Draw, derive, generator

SEEDS = 6  # different draws of each family
WEARS = 3  # steps from new to old
_STEEPEST = 1.2
_DASH = Spectrum(0.5, 10, 30.0)
_GRID = 1024  # per millimetre and less; means are rounded before they decide anything


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


def _family(row: dict[str, Any], grains: dict[str, woods.Grain]) -> Family:
    """Read a row of `families.yaml`; keys that are none of `Family`'s are options of `make`."""
    options = dict(row)
    module, _, function = options.pop("make").partition(".")
    names = ("detail", "hard", "sheen", "wears")
    how: dict[str, Any] = {name: options.pop(name) for name in names if name in options}
    how.setdefault("wears", 1.0 if how.get("hard", True) else 0.7)
    if isinstance(options.get("grain"), str):
        options["grain"] = grains[options["grain"]]
    make = getattr(_MODULES[module], function)
    signature(make).bind(None, 64, **options)  # TypeError for an unknown option
    return Family(partial(make, **options), **how)


def _read() -> tuple[dict[str, dict[str, Family]], dict[str, tuple[str, ...]]]:
    """Families by kind of material, and those of each kind that are drawn where none is named."""
    tables = data_beside(__file__)
    grains = {name: build(woods.Grain, row, name) for name, row in tables["grains"].items()}
    families = {
        kind: {name: _family(row, grains) for name, row in rows.items()}
        for kind, rows in tables["families"].items()
    }
    return families, {kind: tuple(names) for kind, names in tables["common"].items()}


_MODULES = {"cloth": cloth, "goods": goods, "masonry": masonry, "woods": woods}
FAMILIES, _COMMON = _read()


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


def normal_map(made: Surface) -> UInt8Array:
    """Return a surface's normals as an image (size, size, 3); x along u, y along v.

    Slopes are those of the heights in metres, at most `_STEEPEST`.
    """
    size = made.height.shape[0]
    step = np.float32(2 * made.metres / size)
    slope_u, slope_v = _difference(made.height, 1), _difference(made.height, 0)
    for slope in (slope_u, slope_v):
        slope /= step
        np.clip(slope, -_STEEPEST, _STEEPEST, out=slope)
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


def worn(surface: Surface, rng: Draw, level: float, hard: bool) -> Surface:
    """Return a surface after use, from new (0) to old (1): scratches, smears, stains, dirt.

    `hard` ones are scratched and polished, soft ones stained."""
    if level <= 0:
        return surface
    size = surface.height.shape[0]
    patch = smoothstep(0.2, 1.8, noise(rng, size, CLOUD))  # where hands, feet and chairs go
    stain = smoothstep(1.3, 1.9, noise(rng, size, BLOTCH))
    ring = stain * (1 - smoothstep(0.6, 1.0, stain))
    shade: AnyArray = surface.shade * (1 - level * (0.03 * patch + 0.04 * stain + 0.06 * ring))
    shade = shade * (1 - level * 0.3 * _low(surface))
    rough: AnyArray = surface.rough
    height: AnyArray = surface.height
    if hard:
        dash = noise(rng, size, _DASH)
        other = noise(rng, size, _DASH._replace(along=1.0, across=30.0))
        scratch = smoothstep(2.3, 3.2, dash) + smoothstep(2.5, 3.3, other)
        nick = smoothstep(3.0, 3.5, noise(rng, size, CRUMB))
        rough = rough + level * (0.16 * scratch + 0.1 * patch + 0.12 * stain + 0.05)
        height = height - level * (0.00006 * scratch + 0.0004 * nick)
        shade = shade * (1 + level * (0.1 * scratch - 0.2 * nick))
    else:
        pills = smoothstep(2.0, 2.8, noise(rng, size, CRUMB))
        rough = rough - level * 0.08 * patch
        height = height + level * 0.0004 * pills
    return replace(
        surface,
        shade=shade.astype(np.float32),
        rough=rough.astype(np.float32),
        height=height.astype(np.float32),
    )


def _low(surface: Surface) -> Float32Array:
    """1 in the joints and hollows of a surface, 0 on it."""
    height = surface.height * np.float32(1000)
    middle = round(float(height.mean(dtype=np.float64)) * _GRID) / _GRID
    depth = round((middle - float(height.min())) * _GRID) / _GRID
    if depth < 0.05:  # millimetres: nothing gathers
        return np.zeros_like(height)
    return smoothstep(0.35, 0.9, (np.float32(middle) - height) / np.float32(depth))
