"""Abstract pictures, as they hang on walls."""

from __future__ import annotations

import numpy as np

from scenes.arrays import Float32Array, Float64Array
from scenes.procedural.textures.fields import GRIT, Spectrum, axes, noise, smoothstep

_EDGE = Spectrum(1.8)  # of ragged outlines


def picture(rng: np.random.Generator, size: int) -> Float64Array:
    """Return an abstract painting, linear RGB float64 (3, size, size); row 0 is its bottom."""
    u, v = axes(size)
    palette = rng.uniform(0.02, 0.75, (6, 3)).astype(np.float64)
    palette[0] = rng.uniform(0.45, 0.78)  # ground
    palette[1] *= 0.3
    image = np.empty((3, size, size), np.float64)
    image[:] = palette[0][:, None, None]
    kind = int(rng.integers(4))

    def lay(mask: Float32Array, color: Float64Array) -> None:
        low, high = np.flatnonzero(mask.any(axis=1))[[0, -1]] if mask.any() else (0, -1)
        rows = slice(low, high + 1)  # most shapes cover few rows
        image[:, rows] *= 1 - mask[rows]
        image[:, rows] += color[:, None, None] * mask[rows]

    ragged = 0.02 * noise(rng, size, _EDGE)
    soft = 2.0 / size
    if kind == 0:  # a landscape of layered hills
        for layer in range(5):
            crest = (
                0.75
                - 0.14 * layer
                + 0.05 * np.sin(2 * np.pi * (rng.uniform(0.5, 2) * u + rng.random()))
            )
            lay(
                smoothstep(-soft, soft, crest + ragged - v),
                palette[layer + 1] * (0.5 + 0.1 * layer),
            )
    elif kind == 1:  # discs and half discs
        for _ in range(int(rng.integers(4, 9))):
            x, y, r = rng.random(), rng.random(), rng.uniform(0.06, 0.3)
            disc = smoothstep(-soft, soft, r - np.hypot(u - x, v - y) + 0.3 * ragged)
            if rng.random() < 0.5:
                disc *= smoothstep(-soft, soft, v - y)
            lay(disc, palette[int(rng.integers(1, 6))])
    elif kind == 2:  # fields of colour
        for band in np.sort(rng.random(int(rng.integers(3, 7)))):
            lay(smoothstep(-0.01, 0.01, band + ragged - v), palette[int(rng.integers(1, 6))])
        lay(smoothstep(-soft, soft, 0.02 - np.abs(u - rng.uniform(0.2, 0.8)) + ragged), palette[1])
    else:  # brush strokes
        for _ in range(int(rng.integers(12, 30))):
            x, y, angle = rng.random(), rng.random(), rng.uniform(0, np.pi)
            along = (u - x) * np.cos(angle) + (v - y) * np.sin(angle)
            across = (v - y) * np.cos(angle) - (u - x) * np.sin(angle)
            width = rng.uniform(0.008, 0.05)
            stroke = smoothstep(-soft, 0.01, width - np.abs(across) + 0.5 * ragged)
            stroke *= smoothstep(-soft, 0.02, rng.uniform(0.1, 0.4) - np.abs(along) + ragged)
            lay(stroke, palette[int(rng.integers(1, 6))])
    canvas = 1 + 0.03 * noise(rng, size, GRIT)
    return np.clip(image * canvas, 0.005, 0.85).astype(np.float64)
