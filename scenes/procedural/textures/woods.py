"""Woods: grain, pores and lacquer, as solid pieces, veneers and floors."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pbrnet.scenes.arrays import Float32Array
from pbrnet.scenes.procedural.textures.fields import (
    BEND,
    CLOUD,
    CRUMB,
    FIBRE,
    GRIT,
    STREAK,
    Modules,
    Surface,
    axes,
    basket,
    courses,
    drawn,
    herringbone,
    noise,
    smoothstep,
    tile,
    wave,
)
from pbrnet.scenes.seeds import Draw


@dataclass(frozen=True)
class Grain:
    """Figure of a kind of wood.

    `rings`: growth rings per tile; `bend`: how far they wander; `contrast` of early and late wood;
    `pores`: strength of open pores; `flakes`: of rays and figure across the grain; `knots`.
    """

    rings: float
    bend: float
    contrast: float
    pores: float
    flakes: float = 0.0
    knots: float = 0.0


def _figure(rng: Draw, size: int, grain: Grain) -> tuple[Float32Array, ...]:
    """Mixing weight and pores (0 to 1) of plain-sawn wood with its grain along u."""
    _, v = axes(size)
    bend = noise(rng, size, BEND)
    bands = grain.rings * v + grain.bend * bend
    if grain.knots:
        near = smoothstep(2.1, 3.4, noise(rng, size, CRUMB._replace(falloff=1.6)))
        bands = bands + 1.6 * near
    turn = bands - np.floor(bands)
    late = turn * turn * (1 - smoothstep(0.86, 1.0, turn))  # slow rise, sharp end of a year
    streaks = noise(rng, size, STREAK)
    pores = smoothstep(0.9, 2.2, streaks) * np.float32(grain.pores) * (1 - late)
    mix = 0.12 + grain.contrast * late + 0.09 * noise(rng, size, FIBRE) + 0.03 * streaks
    mix = mix + 0.35 * pores
    if grain.flakes:
        flakes = smoothstep(1.3, 2.4, noise(rng, size, STREAK._replace(along=8.0, low=14)))
        mix = mix - 0.16 * grain.flakes * flakes
    if grain.knots:
        mix = mix + 0.8 * grain.knots * near
    return mix.astype(np.float32), pores.astype(np.float32)


def solid(rng: Draw, size: int, grain: Grain) -> Surface:
    """Lacquered wood of 0.8 m: open pores are duller and deeper."""
    mix, pores = _figure(rng, size, grain)
    height = -0.00012 * pores + 0.00002 * noise(rng, size, CLOUD)
    rough = 0.16 * pores + 0.025 * noise(rng, size, CLOUD)
    shade = 1 - 0.1 * pores + 0.02 * noise(rng, size, CLOUD)
    return tile(0.8, mix, shade, rough, height)


def end_grain(rng: Draw, size: int, grain: Grain) -> Surface:
    """Butcher's block: staves of 4 cm, glued, each with rings of its own."""
    metres = 0.64
    at = courses(size, metres, 2, 16, (rng.integers(0, 8, 16) / 8).astype(np.float32))
    board = replace(grain, rings=8.0)
    mix, pores = _boarded(rng, size, board, at, metres)
    joint = 1 - smoothstep(0.0, 0.0012, at.edge)
    shade = 1 - 0.25 * joint * min(1.0, 0.0012 * size / metres)
    rough = 0.14 * pores + 0.02 * noise(rng, size, CLOUD)
    return tile(metres, mix, shade, rough, -0.0001 * pores - 0.00008 * joint)


def plywood(rng: Draw, size: int, grain: Grain) -> Surface:
    """Birch veneer with the odd patch."""
    base = solid(rng, size, grain)
    return replace(base, shade=base.shade + 0.02 * noise(rng, size, FIBRE))


def chipboard(rng: Draw, size: int) -> Surface:
    """Pressed chips, as of boards' backs and pin boards."""
    chips = noise(rng, size, CRUMB._replace(along=2.5))
    grit = noise(rng, size, GRIT)
    mix = 0.35 + 0.2 * chips + 0.1 * grit
    return tile(0.5, mix, 1 + 0.06 * chips, 0.04 * grit, 0.00008 * chips + 0.00004 * grit)


def cork(rng: Draw, size: int) -> Surface:
    """Agglomerated cork granules."""
    crumbs = noise(rng, size, CRUMB)
    dark = smoothstep(1.1, 1.9, noise(rng, size, GRIT))
    mix = 0.25 + 0.2 * crumbs + 0.6 * dark
    return tile(0.4, mix, 1 + 0.1 * crumbs, 0.05 * crumbs, 0.0002 * crumbs - 0.0004 * dark)


def _boarded(
    rng: Draw, size: int, grain: Grain, at: Modules, metres: float
) -> tuple[Float32Array, Float32Array]:
    """Grain of boards, each cut from another place; boards along v have theirs along v."""
    mix, pores = _figure(rng, size, grain)
    texel = metres / size
    shift_u = rng.integers(0, size, at.count)
    shift_v = rng.integers(0, size, at.count)
    columns = (np.rint(at.x / np.float32(texel)).astype(np.int64) + shift_u[at.number]) % size
    lines = (np.rint(at.y / np.float32(texel)).astype(np.int64) + shift_v[at.number]) % size
    tone = drawn(rng, (at.count,))[at.number]
    return mix[lines, columns] + np.float32(0.085) * tone, pores[lines, columns]


def floor(
    rng: Draw,
    size: int,
    grain: Grain,
    layout: str = "boards",
    width: float = 0.15,
    bevel: float = 0.0015,
    gloss: float = 0.03,
) -> Surface:
    """Floor boards, parquet or laminate along u, with bevelled joints and boards slightly askew."""
    modules: tuple[int, int] | None = None
    if layout == "herringbone":
        ratio, blocks = 5, 3
        metres = width * 2 * ratio * blocks
        at = herringbone(size, metres, blocks, ratio)
        modules = (1, 1)
    elif layout == "basket":
        squares, strips = 4, 5
        metres = width * squares * strips
        at = basket(size, metres, squares, strips)
        modules = (2, 2)
    else:
        rows, length = 16, 2 if layout == "boards" else 4
        metres = width * rows
        stagger = (rng.permutation(rows) / rows).astype(np.float32)
        if layout == "strips":
            stagger = (rng.integers(0, 16, rows) / 16).astype(np.float32)
        at = courses(size, metres, length, rows, stagger)
    # Figures are laid out at 0.8 m a tile for solid wood; here they are as large as the tile.
    mix, pores = _boarded(rng, size, replace(grain, rings=grain.rings * metres / 0.9), at, metres)
    texel = metres / size
    seam = 1 - smoothstep(0.0003, max(bevel, 0.7 * texel), at.edge)
    seen = min(1.0, 2 * bevel / texel)
    tilt = drawn(rng, (3, at.count))
    lean = 0.0012 * (tilt[0][at.number] * at.y / np.float32(width))
    tone = np.float32(0.045) * tilt[1][at.number]
    cloud = noise(rng, size, CLOUD)
    shade = (1 + tone) * (1 - 0.55 * seen * seam)
    rough = 0.14 * pores + 0.2 * seam + gloss * cloud + 0.02 * tilt[2][at.number]
    height = lean - bevel * 0.4 * seam - 0.0001 * pores
    return tile(metres, mix, shade, rough, height, modules=modules)


def wicker(rng: Draw, size: int) -> Surface:
    """Willow or rattan woven around stakes 4 cm apart."""
    metres, stakes, rods = 0.48, 12, 48
    u, v = axes(size)
    row = np.floor(v * rods).astype(np.int64)
    round_rod = (v * rods - row) * 2 - 1
    along = wave(u * (stakes / 2) + np.float32(0.5) * (row % 2))
    body = (1 - round_rod * round_rod).astype(np.float32)
    tone = drawn(rng, (rods,))[row]
    mix = 0.35 + 0.18 * tone + 0.1 * noise(rng, size, STREAK)
    height = 0.0025 * body + 0.003 * along
    shade = 0.7 + 0.25 * body + 0.15 * along + 0.04 * tone
    return tile(metres, mix, shade, 0.05 * tone, height)


def bark(rng: Draw, size: int) -> Surface:
    """Furrowed bark with its ridges along v."""
    ridges = noise(rng, size, CRUMB._replace(across=5.0))
    fine = noise(rng, size, GRIT)
    mix = 0.4 - 0.25 * ridges
    return tile(0.6, mix, 1 + 0.12 * ridges + 0.06 * fine, height=0.004 * ridges + 0.0006 * fine)
