"""Tileable texture patterns without colours.

A `Pattern` mixes the base and accent colour of a material. Rows run along v, columns along u;
both repeat after `metres`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from scenes.arrays import Float64Array
from scenes.seeds import generator

SEEDS = 12  # different draws of each pattern


@dataclass(frozen=True)
class Pattern:
    """Mixing weights and shading of a texture.

    `mix`: float64 (size, size) in [0, 1], 0 for the base colour and 1 for the accent; `shade`:
    float64 (size, size), a factor on the reflectance around 1; `metres`: period in u and v.
    """

    mix: Float64Array
    shade: Float64Array
    metres: float


@lru_cache(maxsize=192)
def pattern(kind: str, seed: int, size: int) -> Pattern:
    """Return the pattern `kind` for `seed` (0 to SEEDS - 1) at `size` pixels a side."""
    rng = generator(seed, "pattern", kind)
    return _MAKERS[kind](rng, size)


def has_pattern(kind: str) -> bool:
    """Return True if materials of this kind have a texture."""
    return kind in _MAKERS


def noise(
    rng: np.random.Generator,
    size: int,
    falloff: float,
    stretch: tuple[float, float] = (1.0, 1.0),
    low: float = 1.0,
) -> Float64Array:
    """Return tileable noise, float64 (size, size), mean 0, standard deviation 1.

    Its amplitude spectrum is frequency ** -falloff, without frequencies below `low` periods per
    tile; `stretch` lengthens the features along (u, v). Frequencies above 256 are 0: from 512
    pixels on, one seed gives the same features at every size.
    """
    cutoff = min(size // 2, 256)
    amplitude = _amplitude(cutoff, falloff, stretch, low)
    phase = rng.standard_normal((2, *amplitude.shape)).astype(np.float64)
    spectrum = amplitude * (phase[0] + 1j * phase[1])
    if size > 2 * cutoff:
        full = np.zeros((size, size // 2 + 1), dtype=np.complex128)
        full[:cutoff, : cutoff + 1] = spectrum[:cutoff]
        full[-cutoff:, : cutoff + 1] = spectrum[cutoff:]
        spectrum = full
    field = np.fft.irfft2(spectrum, s=(size, size))
    return (field / max(float(field.std()), 1e-12)).astype(np.float64)


@lru_cache(maxsize=48)
def _amplitude(
    cutoff: int, falloff: float, stretch: tuple[float, float], low: float
) -> Float64Array:
    """Amplitudes of the frequencies along v (2 * cutoff rows, in FFT order) and u (cutoff + 1)."""
    frequency_v = np.fft.fftfreq(2 * cutoff, 1 / (2 * cutoff)).astype(np.float64)[:, None]
    frequency_u = np.arange(cutoff + 1, dtype=np.float64)[None, :]
    radius = np.hypot(frequency_u * stretch[0], frequency_v * stretch[1])
    return np.where(radius >= low, 1 / np.maximum(radius, 1e-6) ** falloff, 0)


def _axes(size: int) -> tuple[Float64Array, Float64Array]:
    """u and v of the pixel centres in [0, 1), each (size, size)."""
    ramp = (np.arange(size, dtype=np.float64) + 0.5) / size
    u, v = np.meshgrid(ramp, ramp)
    return u.astype(np.float64), v.astype(np.float64)


def _smoothstep(low: float, high: float, x: Float64Array) -> Float64Array:
    t = np.clip((x - low) / (high - low), 0, 1)
    return (t * t * (3 - 2 * t)).astype(np.float64)


def _grain(rng: np.random.Generator, size: int) -> tuple[Float64Array, Float64Array]:
    """Wood grain along u: growth rings in [0, 1] and fine pores around 0."""
    _, v = _axes(size)
    bend = noise(rng, size, 2.2, (5.0, 1.0))
    rings = 0.5 + 0.5 * np.sin(2 * np.pi * (9 * v + 0.9 * bend))
    pores = noise(rng, size, 0.35, (24.0, 1.0), low=20)
    return rings.astype(np.float64), pores


def _wood(rng: np.random.Generator, size: int) -> Pattern:
    rings, pores = _grain(rng, size)
    broad = noise(rng, size, 1.6, (8.0, 1.0))
    mix = np.clip(0.12 + 0.3 * rings**2 + 0.1 * broad + 0.06 * pores, 0, 1)
    return Pattern(mix, 1 + 0.03 * pores, 0.8)


def _planks(rng: np.random.Generator, size: int) -> Pattern:
    """Boards of 0.15 m x 1.2 m, each with grain of its own."""
    metres, rows = 2.4, 16
    u, v = _axes(size)
    row = np.floor(v * rows).astype(int)
    offset = rng.permutation(rows) / rows  # staggers the joints
    length = u * 2 + offset[row]
    board = np.floor(length).astype(int) % 2
    rings, pores = _grain(rng, size)
    broad = noise(rng, size, 1.5, (10.0, 1.0))
    shift_u = rng.integers(0, size, (rows, 2))
    shift_v = rng.integers(0, size, (rows, 2))
    columns = (np.arange(size)[None, :] + shift_u[row, board]) % size
    lines = (np.arange(size)[:, None] + shift_v[row, board]) % size
    variation = rng.normal(0, 1, (rows, 2)).astype(np.float64)[row, board]
    mix = 0.18 + 0.28 * rings[lines, columns] ** 2 + 0.1 * broad[lines, columns]
    mix += 0.07 * pores[lines, columns] + 0.09 * variation
    across = np.minimum(v * rows % 1, 1 - v * rows % 1) * metres / rows
    ends = np.minimum(length % 1, 1 - length % 1) * metres / 2
    pixel = metres / size
    joint = 1 - _smoothstep(
        0.0006, 0.0006 + max(0.0016, 0.8 * pixel), np.minimum(across, ends).astype(np.float64)
    )
    shade = (1 + 0.05 * variation) * (1 - 0.5 * joint * min(1.0, 0.003 / pixel))
    return Pattern(np.clip(mix, 0, 1).astype(np.float64), shade.astype(np.float64), metres)


def _tiles(rng: np.random.Generator, size: int) -> Pattern:
    """4 x 4 tiles of 0.3 m with 4 mm of grout in the accent colour."""
    metres, count = 1.2, 4
    u, v = _axes(size)
    column, row = (u * count).astype(int), (v * count).astype(int)
    edge = np.minimum(
        np.minimum(u * count % 1, 1 - u * count % 1), np.minimum(v * count % 1, 1 - v * count % 1)
    ) * np.float64(metres / count)
    pixel = metres / size
    grout = 1 - _smoothstep(0.002 - 0.5 * pixel, 0.002 + 0.5 * pixel, edge)
    variation = rng.normal(0, 1, (count, count)).astype(np.float64)[row, column]
    cloud = noise(rng, size, 1.4)
    shade = (1 + 0.025 * variation + 0.02 * cloud) * (1 - grout) + grout * (
        1 + 0.04 * noise(rng, size, 0.5)
    )
    return Pattern(grout, shade.astype(np.float64), metres)


def _brick(rng: np.random.Generator, size: int) -> Pattern:
    """Running bond of 0.25 m x 0.075 m bricks with 10 mm of mortar in the accent colour."""
    metres, columns, rows = 1.5, 6, 20
    u, v = _axes(size)
    row = (v * rows).astype(int)
    across = u * columns + 0.5 * (row % 2)
    column = np.floor(across).astype(int) % columns
    edge = np.minimum(
        np.minimum(across % 1, 1 - across % 1) * metres / columns,
        np.minimum(v * rows % 1, 1 - v * rows % 1) * metres / rows,
    )
    mortar = 1 - _smoothstep(0.004, 0.007, edge + 0.001 * noise(rng, size, 0.8))
    variation = rng.normal(0, 1, (rows, columns)).astype(np.float64)[row, column]
    shade = 1 + 0.13 * variation + 0.06 * noise(rng, size, 0.9)
    return Pattern(mortar, np.clip(shade, 0.4, 1.6).astype(np.float64), metres)


def _fabric(rng: np.random.Generator, size: int) -> Pattern:
    """Plain weave; the second yarn has the accent colour."""
    metres, threads = 0.4, 64
    u, v = _axes(size)
    warp, weft = (np.abs(np.sin(np.pi * threads * axis)).astype(np.float64) for axis in (u, v))
    over = ((u * threads).astype(int) + (v * threads).astype(int)) % 2
    yarn = np.where(over == 1, warp, weft)
    slub = noise(rng, size, 0.7, (12.0, 1.0)) + noise(rng, size, 0.7, (1.0, 12.0))
    mix = np.clip(0.35 * over + 0.12 * slub, 0, 1)
    shade = 0.88 + 0.16 * yarn + 0.035 * slub + 0.03 * noise(rng, size, 1.5)
    return Pattern(mix.astype(np.float64), shade.astype(np.float64), metres)


def _carpet(rng: np.random.Generator, size: int) -> Pattern:
    tufts = noise(rng, size, 0.25, low=24)
    worn = noise(rng, size, 1.7)
    mix = np.clip(0.25 + 0.14 * tufts + 0.1 * worn, 0, 1)
    return Pattern(mix.astype(np.float64), (1 + 0.08 * tufts + 0.03 * worn).astype(np.float64), 1.0)


def _leather(rng: np.random.Generator, size: int) -> Pattern:
    cells = np.abs(noise(rng, size, 1.0, low=14))
    folds = noise(rng, size, 1.8)
    mix = np.clip(0.35 - 0.25 * cells, 0, 1)
    return Pattern(
        mix.astype(np.float64), (1 + 0.05 * cells + 0.04 * folds).astype(np.float64), 0.4
    )


def _plaster(rng: np.random.Generator, size: int) -> Pattern:
    """Rolled paint: faint low-frequency and fine high-frequency noise."""
    shade = 1 + 0.012 * noise(rng, size, 1.6) + 0.008 * noise(rng, size, 0.3, low=30)
    return Pattern(np.zeros((size, size), np.float64), shade.astype(np.float64), 1.6)


def _wallpaper(rng: np.random.Generator, size: int) -> Pattern:
    """Stripes, diamonds, sprigs or grasscloth, chosen by the seed."""
    metres = 1.06  # width of two rolls
    u, v = _axes(size)
    kind = int(rng.integers(4))
    soft = 1.5 / size
    if kind == 0:  # stripes of two widths
        count = int(rng.choice([8, 12, 20]))
        wave = np.abs((u * count) % 1 - 0.5)
        mix = _smoothstep(-count * soft, count * soft, wave - float(rng.uniform(0.2, 0.35)))
    elif kind == 1:  # diamonds, drawn by thin lines
        count = int(rng.choice([6, 9]))
        a, b = (u + v) * count % 1, (u - v) * count % 1
        line = np.minimum(np.minimum(a, 1 - a), np.minimum(b, 1 - b))
        mix = 0.8 * (1 - _smoothstep(0.03, 0.03 + 2 * count * soft, line))
    elif kind == 2:  # sprigs of five leaves in a half drop
        mix = np.zeros((size, size), np.float64)
        count = int(rng.choice([5, 7]))
        shift = 0.5 * (np.floor(u * count) % 2) if count % 2 == 0 else 0.0
        x, y = (u * count) % 1 - 0.5, (v * count + shift) % 1 - 0.5
        angle, radius = np.arctan2(y, x), np.hypot(x, y)
        petals = 0.12 + 0.14 * np.abs(np.cos(2.5 * angle + float(rng.uniform(0, 3))))
        mix = _smoothstep(-count * soft, count * soft, petals - radius)
    else:  # grasscloth
        mix = np.clip(0.4 + 0.18 * noise(rng, size, 0.3, (30.0, 1.0), low=8), 0, 1)
    shade = 1 + 0.01 * noise(rng, size, 0.4, low=20)
    return Pattern(mix.astype(np.float64), shade.astype(np.float64), metres)


def _stone(rng: np.random.Generator, size: int) -> Pattern:
    """Granite speckles or marble veins, chosen by the seed."""
    if rng.random() < 0.5:
        specks = noise(rng, size, 0.4, low=20)
        large = noise(rng, size, 0.7, low=12)
        mix = 0.45 * _smoothstep(0.6, 1.5, specks) + 0.35 * _smoothstep(0.8, 1.6, large)
        return Pattern(mix.astype(np.float64), (1 + 0.05 * specks).astype(np.float64), 0.8)
    bend = noise(rng, size, 1.9)
    veins = np.exp(-(((noise(rng, size, 1.7) + 0.4 * bend) / 0.07) ** 2))
    cloud = _smoothstep(-1.5, 2.5, noise(rng, size, 1.6))
    mix = np.clip(0.55 * veins + 0.25 * cloud, 0, 1)
    return Pattern(mix.astype(np.float64), (1 + 0.02 * bend).astype(np.float64), 1.4)


def _leaf(rng: np.random.Generator, size: int) -> Pattern:
    mottle = noise(rng, size, 1.0)
    return Pattern(
        np.clip(0.3 + 0.25 * mottle, 0, 1).astype(np.float64),
        np.clip(1 + 0.12 * noise(rng, size, 0.7), 0.5, 1.5).astype(np.float64),
        0.3,
    )


def _soil(rng: np.random.Generator, size: int) -> Pattern:
    crumbs = noise(rng, size, 0.6, low=6)
    return Pattern(
        np.clip(0.3 + 0.3 * crumbs, 0, 1).astype(np.float64),
        np.clip(1 + 0.25 * crumbs, 0.3, 1.8).astype(np.float64),
        0.3,
    )


def _grass(rng: np.random.Generator, size: int) -> Pattern:
    blades = noise(rng, size, 0.3, low=20)
    patches = noise(rng, size, 1.5)
    return Pattern(
        np.clip(0.35 + 0.2 * patches + 0.15 * blades, 0, 1).astype(np.float64),
        np.clip(1 + 0.2 * blades + 0.1 * patches, 0.3, 1.8).astype(np.float64),
        4.0,
    )


_MAKERS: dict[str, Callable[[np.random.Generator, int], Pattern]] = {
    "wood": _wood,
    "planks": _planks,
    "tiles": _tiles,
    "brick": _brick,
    "fabric": _fabric,
    "carpet": _carpet,
    "leather": _leather,
    "plaster": _plaster,
    "wallpaper": _wallpaper,
    "stone": _stone,
    "leaf": _leaf,
    "soil": _soil,
    "grass": _grass,
}


def picture(rng: np.random.Generator, size: int) -> Float64Array:
    """Return an abstract painting, linear RGB float64 (3, size, size); row 0 is its bottom."""
    u, v = _axes(size)
    palette = rng.uniform(0.02, 0.75, (6, 3)).astype(np.float64)
    palette[0] = rng.uniform(0.45, 0.78)  # ground
    palette[1] *= 0.3
    image = np.empty((3, size, size), np.float64)
    image[:] = palette[0][:, None, None]
    kind = int(rng.integers(4))

    def lay(mask: Float64Array, color: Float64Array) -> None:
        low, high = np.flatnonzero(mask.any(axis=1))[[0, -1]] if mask.any() else (0, -1)
        rows = slice(low, high + 1)  # most shapes cover few rows
        image[:, rows] *= 1 - mask[rows]
        image[:, rows] += color[:, None, None] * mask[rows]

    ragged = 0.02 * noise(rng, size, 1.8)
    soft = 2.0 / size
    if kind == 0:  # a landscape of layered hills
        for layer in range(5):
            crest = (
                0.75
                - 0.14 * layer
                + 0.05 * np.sin(2 * np.pi * (rng.uniform(0.5, 2) * u + rng.random()))
            )
            lay(
                _smoothstep(-soft, soft, crest + ragged - v),
                palette[layer + 1] * (0.5 + 0.1 * layer),
            )
    elif kind == 1:  # discs and half discs
        for _ in range(int(rng.integers(4, 9))):
            x, y, r = rng.random(), rng.random(), rng.uniform(0.06, 0.3)
            disc = _smoothstep(-soft, soft, r - np.hypot(u - x, v - y) + 0.3 * ragged)
            if rng.random() < 0.5:
                disc *= _smoothstep(-soft, soft, v - y)
            lay(disc, palette[int(rng.integers(1, 6))])
    elif kind == 2:  # fields of colour
        for band in np.sort(rng.random(int(rng.integers(3, 7)))):
            lay(_smoothstep(-0.01, 0.01, band + ragged - v), palette[int(rng.integers(1, 6))])
        lay(_smoothstep(-soft, soft, 0.02 - np.abs(u - rng.uniform(0.2, 0.8)) + ragged), palette[1])
    else:  # brush strokes
        for _ in range(int(rng.integers(12, 30))):
            x, y, angle = rng.random(), rng.random(), rng.uniform(0, np.pi)
            along = (u - x) * np.cos(angle) + (v - y) * np.sin(angle)
            across = (v - y) * np.cos(angle) - (u - x) * np.sin(angle)
            width = rng.uniform(0.008, 0.05)
            stroke = _smoothstep(-soft, 0.01, width - np.abs(across) + 0.5 * ragged)
            stroke *= _smoothstep(-soft, 0.02, rng.uniform(0.1, 0.4) - np.abs(along) + ragged)
            lay(stroke, palette[int(rng.integers(1, 6))])
    canvas = 1 + 0.03 * noise(rng, size, 0.4, low=size // 8)
    return np.clip(image * canvas, 0.005, 0.85).astype(np.float64)
