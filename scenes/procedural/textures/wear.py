"""Wear of surfaces, from new (0) to old (1): scratches, smears, stains, dirt in what lies low."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pbrnet.scenes.arrays import AnyArray, Float32Array
from pbrnet.scenes.procedural.textures.fields import (
    BLOTCH,
    CLOUD,
    CRUMB,
    Spectrum,
    Surface,
    noise,
    smoothstep,
)
from pbrnet.scenes.seeds import Draw

_DASH = Spectrum(0.5, 10, 30.0)
_GRID = 1024  # per millimetre and less; means are rounded before they decide anything


def worn(surface: Surface, rng: Draw, level: float, hard: bool) -> Surface:
    """Return a surface after use; `hard` ones are scratched and polished, soft ones stained."""
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
