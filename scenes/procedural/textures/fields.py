"""Tileable fields that textures are made of: noise, waves, cells and courses.

Fields are float32 (size, size), rows along v and columns along u. Functions whose last bit depends
on the processor (sines, Fourier transforms) are rounded to a grid here; what textures do with
fields is exact arithmetic, so equal seeds give equal bits everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from pbrnet.scenes.arrays import (
    AnyArray,
    Float32Array,
    Float64Array,
    Int16Array,
    Int64Array,
    UInt8Array,
)
from pbrnet.scenes.color import encode_srgb
from pbrnet.scenes.seeds import Draw, generator

DRAWS = 2  # different fields of each spectrum; shifts and turns make many of them
_CUTOFF = 384  # periods per tile; finer noise is white to the eye and costs memory
_GRID = 256  # steps per standard deviation to which noise is rounded
_WAVE = 4096  # entries of the table of a sine


class Spectrum(NamedTuple):
    """Amplitude spectrum of noise: frequency ** -falloff above `low` periods per tile.

    `along` and `across` lengthen the features along u and along v.
    """

    falloff: float
    low: int = 1
    along: float = 1.0
    across: float = 1.0


CLOUD = Spectrum(1.7)  # broad variation of tone
BLOTCH = Spectrum(1.15, 3)
CRUMB = Spectrum(0.8, 8)
GRIT = Spectrum(0.4, 24)
STREAK = Spectrum(0.35, 20, 24.0)  # fine lines along u
FIBRE = Spectrum(1.6, 1, 8.0)  # broad bands along u
BEND = Spectrum(2.2, 1, 5.0)  # of growth rings
SLUB = Spectrum(0.7, 4, 12.0)  # thick places of yarn along u


@dataclass(frozen=True)
class Surface:
    """Maps of one tile of a surface, float32 (size, size).

    `mix`: 0 for the base colour, 1 for the accent; `shade`: factor on the reflectance, around 1;
    `rough`: added to the perceptual roughness; `height`: metres; `metres`: the tile's side.
    `modules`: how many equal modules a tile has along u and v; joints lie between them.
    """

    mix: Float32Array
    shade: Float32Array
    rough: Float32Array
    height: Float32Array
    metres: float
    modules: tuple[int, int] | None = None


def tile(
    metres: float,
    mix: AnyArray | float = 0.0,
    shade: AnyArray | float = 1.0,
    rough: AnyArray | float = 0.0,
    height: AnyArray | float = 0.0,
    modules: tuple[int, int] | None = None,
) -> Surface:
    """Return a surface of `metres` from maps (size, size) or single numbers, not all of them.

    `mix` is cut to [0, 1].
    """
    maps = np.broadcast_arrays(np.clip(mix, 0, 1), shade, rough, height)
    first, second, third, fourth = (each.astype(np.float32) for each in maps)
    return Surface(first, second, third, fourth, metres, modules)


def noise(rng: Draw, size: int, spectrum: Spectrum = CLOUD) -> Float32Array:
    """Return noise of a spectrum with mean 0 and standard deviation 1, at a random shift."""
    field = _field(size, spectrum, rng.whole(DRAWS))
    shift = rng.integers(0, size, 2)
    field = np.roll(field, (int(shift[0]), int(shift[1])), axis=(0, 1))
    return field * np.float32(1 / _GRID)


@lru_cache(maxsize=80)
def _field(size: int, spectrum: Spectrum, draw: int) -> Int16Array:
    """Noise in steps of the grid."""
    cutoff = min(size // 2, _CUTOFF)
    rng = generator(draw, "noise", *(str(part) for part in spectrum))
    along_v = np.fft.fftfreq(2 * cutoff, 1 / (2 * cutoff))[:, None]
    along_u = np.arange(cutoff + 1, dtype=np.float64)[None, :]
    radius = np.sqrt((along_u * spectrum.along) ** 2 + (along_v * spectrum.across) ** 2)
    low = min(spectrum.low, cutoff // 4)  # coarse tiles keep some of their finest noise
    amplitude = np.where(radius >= low, np.maximum(radius, 1e-6) ** -spectrum.falloff, 0)
    phase = rng.standard_normal((2, *amplitude.shape))
    part = amplitude * (phase[0] + 1j * phase[1])
    whole = np.zeros((size, size // 2 + 1), dtype=np.complex128)
    whole[:cutoff, : cutoff + 1] = part[:cutoff]
    whole[-cutoff:, : cutoff + 1] = part[cutoff:]
    made = np.fft.irfft2(whole, s=(size, size))
    return np.rint(made * (_GRID / max(float(made.std()), 1e-12))).astype(np.int16)


@lru_cache(maxsize=8)
def axes(size: int) -> tuple[Float32Array, Float32Array]:
    """u and v of the texels' centres in (0, 1), each (size, size)."""
    ramp = ((np.arange(size) + 0.5) / size).astype(np.float32)
    u, v = np.meshgrid(ramp, ramp)
    return u, v


def wave(turns: Float32Array) -> Float32Array:
    """Sine of a number of turns, rounded to 2**-12."""
    return np.asarray(_sine()[np.floor(turns * _WAVE).astype(np.int64) & (_WAVE - 1)])


@lru_cache(maxsize=1)
def _sine() -> Float32Array:
    angle: Float64Array = 2 * np.pi * (np.arange(_WAVE) + 0.5) / _WAVE
    return (np.rint(np.sin(angle) * 4096) / 4096).astype(np.float32)


def smoothstep(low: float, high: float, x: Float32Array) -> Float32Array:
    """Cubic step from 0 at `low` to 1 at `high`."""
    t = np.asarray(x - np.float32(low))
    t /= np.float32(high - low)
    np.clip(t, 0, 1, out=t)
    steep = 2 * t
    np.subtract(3, steep, out=steep)
    t *= t
    t *= steep
    return np.asarray(t, dtype=np.float32)


def constant(size: int, value: float) -> Float32Array:
    """A field of one value."""
    return np.full((size, size), value, dtype=np.float32)


def drawn(rng: Draw, shape: tuple[int, ...]) -> Float32Array:
    """Standard normal numbers of a shape, rounded to the grid of noise."""
    return (np.rint(rng.standard_normal(shape) * _GRID) / _GRID).astype(np.float32)


@dataclass(frozen=True)
class Modules:
    """Division of a tile into modules: bricks, tiles, boards.

    `number` (size, size) counts modules from 0; `x`, `y`: metres from the module's centre, along
    its own axes; `edge`: metres to its nearest side.
    """

    number: Int64Array
    x: Float32Array
    y: Float32Array
    edge: Float32Array
    count: int


def courses(
    size: int, metres: float, columns: int, rows: int, shifts: Float32Array | None = None
) -> Modules:
    """Rows of `columns` modules each; row k is shifted along u by `shifts[k]` modules."""
    u, v = axes(size)
    row = np.floor(v * rows).astype(np.int64)
    across = u * columns
    if shifts is not None:
        across = across + shifts[row]
    column = np.floor(across).astype(np.int64)
    x = (across - column - np.float32(0.5)) * np.float32(metres / columns)
    y = (v * rows - row - np.float32(0.5)) * np.float32(metres / rows)
    edge = np.minimum(metres / columns / 2 - np.abs(x), metres / rows / 2 - np.abs(y))
    number = row * columns + column % columns
    return Modules(number, x, y, edge.astype(np.float32), rows * columns)


def herringbone(size: int, metres: float, blocks: int, ratio: int) -> Modules:
    """Blocks of `ratio` x 1 units in a herringbone; a tile has 2 * ratio * `blocks` units."""
    units = 2 * ratio * blocks
    unit = np.float32(metres / units)
    u, v = axes(size)
    a, b = u * units, v * units
    i, j = np.floor(a).astype(np.int64), np.floor(b).astype(np.int64)
    step = (i - j) % (2 * ratio)  # < ratio: a block along u, else one along v
    lying = step < ratio
    start_u = np.where(lying, i - step, i)
    start_v = np.where(lying, j, j - (2 * ratio - 1 - step))
    along = np.where(lying, a - start_u, b - start_v) - np.float32(ratio / 2)
    across = np.where(lying, b - j, a - i) - np.float32(0.5)
    x, y = (along * unit).astype(np.float32), (across * unit).astype(np.float32)
    edge = np.minimum(ratio * unit / 2 - np.abs(x), unit / 2 - np.abs(y)).astype(np.float32)
    number = (start_u % units) * units + start_v % units
    return Modules(number, x, y, edge, units * units)


def basket(size: int, metres: float, squares: int, strips: int) -> Modules:
    """Squares of parallel strips, turned by 90 degrees from square to square."""
    u, v = axes(size)
    a, b = u * squares, v * squares
    i, j = np.floor(a).astype(np.int64), np.floor(b).astype(np.int64)
    lying = (i + j) % 2 == 0
    along = np.where(lying, a - i, b - j)
    across = np.where(lying, b - j, a - i) * strips
    strip = np.floor(across).astype(np.int64)
    side = np.float32(metres / squares)
    x = ((along - np.float32(0.5)) * side).astype(np.float32)
    y = ((across - strip - np.float32(0.5)) * (side / strips)).astype(np.float32)
    edge = np.minimum(side / 2 - np.abs(x), side / strips / 2 - np.abs(y)).astype(np.float32)
    number = (i * squares + j) * strips + strip
    return Modules(number, x, y, edge, squares * squares * strips)


def hexagons(size: int, metres: float, columns: int) -> Modules:
    """Hexagons, slightly squeezed so that an even number of rows fits the tile."""
    rows = max(2, 2 * round(columns / 1.732))
    u, v = axes(size)
    wide, tall = np.float32(metres / columns), np.float32(metres / rows)
    found: list[tuple[Float32Array, ...]] = []
    for odd in (0, 1):  # two rectangular lattices; each point belongs to the nearer centre
        a = u * columns - np.float32(0.5 * odd)
        b = v * (rows / 2) - np.float32(0.5 * odd)
        i, j = np.rint(a), np.rint(b)
        x, y = (a - i) * wide, (b - j) * (2 * tall)
        number = (i.astype(np.int64) % columns) * rows + 2 * (j.astype(np.int64) % (rows // 2))
        found.append((x, y, x * x + y * y, (number + odd).astype(np.float32)))
    first = found[0][2] <= found[1][2]
    x, y = (np.where(first, found[0][k], found[1][k]).astype(np.float32) for k in (0, 1))
    number = np.where(first, found[0][3], found[1][3]).astype(np.int64)
    slant = np.float32(0.5) * np.abs(x) + np.float32(0.866) * np.abs(y)
    edge = (wide / 2 - np.maximum(np.abs(x), slant)).astype(np.float32)
    return Modules(number, x, y, edge, columns * rows)


def cells(rng: Draw, size: int, count: int) -> tuple[Float32Array, ...]:
    """Voronoi cells of `count` x `count` jittered points.

    Distances to the nearest and to the second nearest point in units of the mean spacing, and a
    number in [0, 1) of the nearest one's own.
    """
    points = (rng.integers(0, 1024, (2, count, count)) / 1024).astype(np.float32)
    own = (rng.integers(0, 1024, (count, count)) / 1024).astype(np.float32)
    ramp = ((np.arange(size) + 0.5) / size).astype(np.float32) * count
    step = np.floor(ramp).astype(np.int64)
    near = constant(size, 9.0)
    second = constant(size, 9.0)
    name = constant(size, 0.0)
    for step_i in (-1, 0, 1):
        for step_j in (-1, 0, 1):
            i, j = step + step_i, step + step_j
            lattice = np.ix_(j % count, i % count)
            x = points[0][lattice] + (i - ramp).astype(np.float32)
            y = points[1][lattice] + (j - ramp).astype(np.float32)[:, None]
            far = x * x + y * y
            np.copyto(name, own[lattice], where=far < near)
            np.minimum(second, np.maximum(near, far), out=second)
            np.minimum(near, far, out=near)
    return np.sqrt(near), np.sqrt(second), name


def encoded(linear: AnyArray) -> UInt8Array:
    """Encode linear values as 8-bit sRGB (IEC 61966-2-1), in steps of 1/4095."""
    steps = np.asarray(linear * np.float32(4095))
    steps += np.float32(0.5)
    np.clip(steps, 0, 4095, out=steps)
    return np.asarray(np.take(_srgb(), steps.astype(np.uint16)))


@lru_cache(maxsize=1)
def _srgb() -> UInt8Array:
    return np.rint(encode_srgb(np.arange(4096) / 4095) * 255).astype(np.uint8)
