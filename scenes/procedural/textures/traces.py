"""Traces of use by place: walked paths, hands, rings of glasses, spills, scuffs, dust, bleaching.

A surface with traces has images of its own instead of repeating ones. They show the same pattern at
the same place, with the traces over it; bumps stay as they are.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from PIL import Image

from pbrnet.scenes.arrays import AnyArray, Float32Array, UInt8Array
from pbrnet.scenes.color import decode_srgb
from pbrnet.scenes.procedural.piece import Trace, Use
from pbrnet.scenes.procedural.textures.fields import (
    BLOTCH,
    CLOUD,
    Spectrum,
    encoded,
    noise,
    smoothstep,
)
from pbrnet.scenes.seeds import Draw, generator

_SOIL = np.array([0.075, 0.062, 0.05], dtype=np.float32)  # reflectance of grime and grease
_DUST = np.array([0.42, 0.40, 0.37], dtype=np.float32)  # of dust and scale
_BRIGHTEST = 0.8  # bleached surfaces stay below it
_NOISE = 256  # pixels a side of the noise that breaks traces up
_NOISE_METRES = 0.8
_SCRATCH = Spectrum(0.5, 10, 30.0)
_LINEAR = decode_srgb(np.arange(256) / 255).astype(np.float32)
_ROWS = 64  # of an image that are coloured at a time, in the processor's cache
_RIM = 0.004  # metres; half the width of the ring that a glass leaves


class Look(NamedTuple):
    """Change of an old surface by a trace of strength 1.

    Shares of grime and dust over it, factor on its reflectance less 1, change of its perceptual
    roughness if it is hard and if it is soft; `broken` by clouds, blotches or scratches.
    """

    soil: float = 0.0
    dust: float = 0.0
    shade: float = 0.0
    hard: float = 0.0
    soft: float = 0.0
    broken: str = "cloud"


LOOKS: dict[str, Look] = {
    "walk": Look(soil=0.22, shade=-0.12, hard=0.24, soft=-0.08),
    "seat": Look(soil=0.1, shade=-0.12, hard=0.1, soft=-0.15),
    "touch": Look(soil=0.22, shade=-0.04, hard=0.12, soft=-0.08),
    "ring": Look(soil=0.36, hard=0.2),
    "spill": Look(soil=0.36, hard=0.14, soft=0.02, broken="blotch"),
    "scale": Look(dust=0.35, hard=0.25, broken="blotch"),
    "scuff": Look(soil=0.08, shade=0.36, hard=0.3, soft=-0.03, broken="scratch"),
    "dust": Look(dust=0.3, hard=0.25),
    "soot": Look(soil=0.16),
    "bleach": Look(shade=0.24, broken="none"),
}


class Layout(NamedTuple):
    """Texels of a surface's own images, and where in the repeating ones they come from."""

    size: tuple[float, float]  # metres that the images cover, from `Use.low` on
    shape: tuple[int, int]  # rows, columns
    texel: float  # metres
    side: int  # of the repeating image that is taken from, pixels
    panels: tuple[tuple[slice, slice, int, int], ...]  # rows, columns, first row and column there


def laid_out(use: Use, tile: float, offset: AnyArray, side: int, most: int) -> Layout:
    """Lay a pattern of `tile` metres and `side` pixels out over a surface, at most `most` texels.

    `offset` (2,): of the pattern, in tiles.
    """
    extent = (use.high[0] - use.low[0], use.high[1] - use.low[1])
    coarser = math.sqrt(max(1.0, extent[0] * extent[1] * (side / tile) ** 2 / most))
    side = max(16, math.floor(side / coarser))
    texel = tile / side
    columns, rows = (max(1, math.ceil(length / texel)) for length in extent)
    panels = []
    for s0, t0, s1, t1, du, dv in use.panels:
        across = _between(s0 - use.low[0], s1 - use.low[0], texel, columns)
        up = _between(t0 - use.low[1], t1 - use.low[1], texel, rows)
        first = (
            round((use.low[k] + shift) / texel + offset[k] * side) + span.start
            for k, shift, span in ((1, dv, up), (0, du, across))
        )
        row, column = (int(number) % side for number in first)
        panels.append((up, across, row, column))
    return Layout((columns * texel, rows * texel), (rows, columns), texel, side, tuple(panels))


def _between(low: float, high: float, texel: float, count: int) -> slice:
    return slice(max(0, math.floor(low / texel)), min(count, math.ceil(high / texel)))


def spread(image: UInt8Array, layout: Layout) -> UInt8Array:
    """Repeat an image (side, side) or (side, side, 3) over a layout."""
    if layout.side < len(image):
        small = Image.fromarray(image).resize((layout.side,) * 2, Image.Resampling.BOX)
        image = np.asarray(small)
    out = np.zeros((*layout.shape, *image.shape[2:]), dtype=np.uint8)
    for up, across, row, column in layout.panels:
        out[up, across] = _repeated(_repeated(image, 0, row, up), 1, column, across)
    return out


def _repeated(image: UInt8Array, axis: int, first: int, span: slice) -> UInt8Array:
    count = span.stop - span.start
    rolled = np.roll(image, -first, axis)
    whole = np.concatenate([rolled] * -(-count // image.shape[axis]), axis)
    return whole[:count] if axis == 0 else whole[:, :count]


def traced(
    color: UInt8Array, rough: UInt8Array, use: Use, layout: Layout, level: float, hard: bool
) -> tuple[UInt8Array, UInt8Array]:
    """Return an sRGB image (H, W, 3) and perceptual roughness (H, W) with a surface's traces.

    `level` is the surface's wear, from new (0) to old (1).
    """
    soil, dust, gloss = (np.zeros(layout.shape, dtype=np.float32) for _ in range(3))
    shade = np.ones(layout.shape, dtype=np.float32)
    rng = generator(use.seed, "traces")
    for kind, look in LOOKS.items():
        own = [trace for trace in use.traces if trace.kind == kind]
        if not own:
            continue
        window, amount = _amount(own, use, layout)
        amount *= np.float32(level)
        if look.broken != "none":
            amount *= _broken(look.broken, rng, amount, layout, window)
        for field, share in (
            (soil, look.soil),
            (dust, look.dust),
            (shade, look.shade),
            (gloss, 255 * (look.hard if hard else look.soft)),
        ):
            if share:
                field[window] += np.float32(share) * amount
    shade *= 1 - soil - dust
    made = np.empty_like(color)
    for start in range(0, len(color), _ROWS):
        rows = slice(start, start + _ROWS)
        linear = _LINEAR[color[rows]]
        brightest = np.maximum(linear, np.float32(_BRIGHTEST))
        linear *= shade[rows, :, None]
        linear += soil[rows, :, None] * _SOIL
        linear += dust[rows, :, None] * _DUST
        made[rows] = encoded(np.minimum(linear, brightest))
    gloss += rough
    return made, (np.clip(gloss, 13, 255) + np.float32(0.5)).astype(np.uint8)


def _amount(
    traces: list[Trace], use: Use, layout: Layout
) -> tuple[tuple[slice, slice], Float32Array]:
    """Strongest of the traces at each texel of a window that holds them all."""
    rows, columns = layout.shape
    texel = layout.texel
    low, high = np.array(layout.shape), np.zeros(2, dtype=np.int64)
    windows = []
    for trace in traces:
        ends = np.array([trace.start, trace.end]) - use.low
        first = np.floor((ends.min(axis=0) - trace.radius) / texel - 2).astype(np.int64)
        last = np.ceil((ends.max(axis=0) + trace.radius) / texel + 2).astype(np.int64)
        first, last = np.clip(first[::-1], 0, (rows, columns)), np.clip(last[::-1], 0, layout.shape)
        windows.append((trace, ends, first, last))
        low, high = np.minimum(low, first), np.maximum(high, last)
    high = np.maximum(high, low)
    found = np.zeros(high - low, dtype=np.float32)
    for trace, ends, first, last in windows:
        if (last <= first).any():
            continue
        t = ((np.arange(first[0], last[0]) + 0.5) * texel).astype(np.float32)[:, None]
        s = ((np.arange(first[1], last[1]) + 0.5) * texel).astype(np.float32)[None, :]
        along = (ends[1] - ends[0]).astype(np.float32)
        x, y = s - np.float32(ends[0, 0]), t - np.float32(ends[0, 1])
        square = float(along[0]) ** 2 + float(along[1]) ** 2
        if square > 0:
            way = (x * along[0] + y * along[1]) * np.float32(1 / square)
            way = np.clip(way, 0, 1)
            x, y = x - way * along[0], y - way * along[1]
        away = np.sqrt(x * x + y * y)
        if trace.kind == "ring":
            rim = max(_RIM, 0.8 * texel)
            shape = 1 - smoothstep(0.4 * rim, rim, np.abs(away - np.float32(trace.radius - rim)))
        else:
            shape = 1 - smoothstep(0.15 * trace.radius, trace.radius, away)
        a, b = first - low, last - low
        region = found[a[0] : b[0], a[1] : b[1]]
        np.maximum(region, np.float32(trace.strength) * shape, out=region)
    return (slice(int(low[0]), int(high[0])), slice(int(low[1]), int(high[1]))), found


def _broken(
    how: str, rng: Draw, amount: Float32Array, layout: Layout, window: tuple[slice, slice]
) -> AnyArray:
    """Factor that breaks traces up, of the shape of `amount`."""
    spectrum = {"cloud": BLOTCH, "blotch": CLOUD, "scratch": _SCRATCH}[how]
    field = noise(rng, _NOISE, spectrum)
    step = layout.texel * _NOISE / _NOISE_METRES
    row, column = (
        np.floor(np.arange(span.start, span.stop) * step).astype(np.int64) % _NOISE
        for span in window
    )
    if how == "cloud":
        field = np.clip(0.8 + 0.35 * field, 0, 1.4)
    elif how == "scratch":
        other = noise(rng, _NOISE, spectrum._replace(along=1.0, across=30.0))
        field = smoothstep(1.3, 2.4, field) + smoothstep(1.3, 2.4, other)
    else:
        field = np.float32(0.3) * (field[np.ix_(row, column)] - 1)
        return smoothstep(0.0, 0.5, (amount + field).astype(np.float32))
    return field.astype(np.float32)[np.ix_(row, column)]
