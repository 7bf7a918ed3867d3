"""Abstract pictures, as they hang on walls, and what screens show."""

from __future__ import annotations

import colorsys

import numpy as np

from pbrnet.scenes.arrays import Float32Array, Float64Array
from pbrnet.scenes.color import decode_srgb_value
from pbrnet.scenes.procedural.textures.fields import GRIT, Spectrum, axes, noise, smoothstep
from pbrnet.scenes.seeds import Draw

SCREEN_SIZE = (90, 160)  # rows and columns of pixels of what a screen shows
_EDGE = Spectrum(1.8)  # of ragged outlines


def picture(rng: Draw, size: int) -> Float64Array:
    """Return an abstract painting, linear RGB float64 (3, size, size); row 0 is its bottom."""
    u, v = axes(size)
    palette = _palette(rng)
    image = np.empty((3, size, size), np.float64)
    image[:] = palette[0][:, None, None]
    kind = rng.whole(4)

    def lay(mask: Float32Array, color: Float64Array) -> None:
        low, high = np.flatnonzero(mask.any(axis=1))[[0, -1]] if mask.any() else (0, -1)
        rows = slice(low, high + 1)  # most shapes cover few rows
        image[:, rows] *= 1 - mask[rows]
        image[:, rows] += color[:, None, None] * mask[rows]

    ragged = 0.02 * noise(rng, size, _EDGE)
    soft = 2.0 / size
    if kind == 0:  # a landscape of layered hills
        for layer in range(5):
            waves = np.sin(2 * np.pi * (rng.uniform(0.5, 2) * u + rng.random()))
            crest = 0.75 - 0.14 * layer + 0.05 * waves
            color = palette[layer + 1] * (0.5 + 0.1 * layer)
            lay(smoothstep(-soft, soft, crest + ragged - v), color)
    elif kind == 1:  # discs and half discs
        for _ in range(rng.whole(4, 9)):
            x, y, r = rng.random(), rng.random(), rng.uniform(0.06, 0.3)
            disc = smoothstep(-soft, soft, r - np.hypot(u - x, v - y) + 0.3 * ragged)
            if rng.chance(0.5):
                disc *= smoothstep(-soft, soft, v - y)
            lay(disc, palette[rng.whole(1, 6)])
    elif kind == 2:  # fields of colour
        for band in np.sort(rng.random(rng.whole(3, 7))):
            lay(smoothstep(-0.01, 0.01, band + ragged - v), palette[rng.whole(1, 6)])
        lay(smoothstep(-soft, soft, 0.02 - np.abs(u - rng.uniform(0.2, 0.8)) + ragged), palette[1])
    else:  # brush strokes
        for _ in range(rng.whole(12, 30)):
            x, y, angle = rng.random(), rng.random(), rng.uniform(0, np.pi)
            along = (u - x) * np.cos(angle) + (v - y) * np.sin(angle)
            across = (v - y) * np.cos(angle) - (u - x) * np.sin(angle)
            width = rng.uniform(0.008, 0.05)
            stroke = smoothstep(-soft, 0.01, width - np.abs(across) + 0.5 * ragged)
            stroke *= smoothstep(-soft, 0.02, rng.uniform(0.1, 0.4) - np.abs(along) + ragged)
            lay(stroke, palette[rng.whole(1, 6)])
    canvas = 1 + 0.03 * noise(rng, size, GRIT)
    return np.clip(image * canvas, 0.005, 0.85).astype(np.float64)


def _palette(rng: Draw) -> Float64Array:
    """Draw the colours of a picture, linear RGB (6, 3): a pale ground, a dark one, four more.

    Most lie beside one hue and are muted, one in four pictures is grey, one colour may stand out.
    """
    hue = rng.random()
    chroma = 0.0 if rng.chance(0.25) else rng.between(0.15, 0.7)
    colors = []
    for tone in (0.9, 0.25, *rng.uniform(0.3, 0.85, 4)):
        beside = hue + rng.normal(0.0, 0.07)
        strength = chroma * rng.between(0.4, 1.0) * (0.25 if tone == 0.9 else 1.0)
        colors.append(colorsys.hsv_to_rgb(round(beside, 4) % 1.0, round(strength, 4), float(tone)))
    if chroma and rng.chance(0.5):
        colors[-1] = colorsys.hsv_to_rgb((hue + 0.5) % 1.0, min(1.2 * chroma, 0.8), 0.6)
    return np.array([[decode_srgb_value(band) for band in color] for color in colors])


def screen_picture(rng: Draw, is_film: bool) -> Float32Array:
    """Return the image on a screen, linear RGB float32 (rows, columns, 3), its first row the top.

    A film is a painting's scene, sometimes with a band of captions; else there are windows with
    lines of text.
    """
    rows, columns = SCREEN_SIZE
    if is_film:
        drawn = picture(rng, columns)[:, :rows][:, ::-1].transpose(1, 2, 0)
        shown = 1.15 * drawn**1.3
        if rng.chance(0.3):
            shown[int(0.78 * rows) : int(0.9 * rows), int(0.06 * columns) : int(0.7 * columns)] = (
                rng.uniform(0.05, 0.5, 3)
            )
        return shown.astype(np.float32)
    dark = rng.chance(0.35)
    paper, ink = (0.015, 0.55) if dark else (0.85, 0.06)
    shown = np.empty((rows, columns, 3))
    shown[:] = rng.uniform(0.02, 0.35, 3)  # desktop
    for _ in range(rng.whole(1, 4)):
        top, left = rng.whole(2, 30), rng.whole(2, 60)
        low, right = rng.whole(top + 35, rows - 3), rng.whole(left + 50, columns - 2)
        shown[top:low, left:right] = paper
        shown[top : top + 4, left:right] = rng.uniform(0.05, 0.6, 3)
        if rng.chance(0.4):
            shown[top + 4 : low, left : left + 14] = rng.uniform(0.05, 0.5, 3)
            left += 14
        for row in range(top + 8, low - 3, 4):
            end = left + 4 + int((right - left - 8) * rng.uniform(0.15, 1.0))
            words = rng.random(columns) < 0.82
            line = np.zeros(columns, dtype=bool)
            line[left + 4 : end] = words[left + 4 : end]
            shown[row : row + 2, line] = ink
    return shown.astype(np.float32)
