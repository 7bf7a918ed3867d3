"""Reinhard's photographic tone mapping with the parameters key and burn of PBRS.

Networks are trained and evaluated with it; `pbrnet.pipeline.photograph` makes display images.

Reinhard et al., *Photographic Tone Reproduction for Digital Images* (2002), equations 1, 2 and 4,
with `burn` as in the renderer of PBRS: 0 compresses all luminance, 1 clips all luminance above the
key. The operator maps luminance and keeps chromaticity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pbrnet.scenes.arrays import (
    ArrayOrTensor,
    Float32Array,
    FloatingArray,
    UInt8Array,
    array_namespace,
)
from pbrnet.scenes.checked import param, within
from pbrnet.scenes.color import decode_srgb, encode_srgb, luminance

Image = FloatingArray


@dataclass(frozen=True)
class ToneParams:
    """Reinhard's photographic operator as in PBRS."""

    key: float = param(0.8, "display luminance of the average", within(above=0))
    burn: float = param(0.2, "0 compresses everything, 1 clips above the key", within(above=0))


@dataclass(frozen=True)
class Exposure:
    """Parameters of the operator for one image.

    `scale` multiplies radiance before compression; `white` is the scaled luminance that maps to 1
    (infinite if nothing is clipped).
    """

    scale: float
    white: float


def exposure_of(image: Image, tone: ToneParams) -> Exposure:
    """Return the exposure of linear HDR `image` (H, W, 3) from its log-average luminance.

    Luminance is averaged over blocks of 8x8 pixels before the logarithm: the logarithm of a noisy
    pixel is too low on average, so an average over pixels would brighten noisy images (2.5 times
    at 16 samples per pixel of a room at night). Blocks that are exactly zero are left out; an
    all-black image has scale 1. White comes from the brightest pixel.
    """
    lum = luminance(np.asarray(image, dtype=np.float64))
    means = block_means(lum)
    lit = means[means > 0]
    if lit.size == 0:
        return Exposure(1.0, 1.0)
    scale = tone.key / float(np.exp(np.mean(np.log(lit))))
    burn = min(1.0, max(1e-8, 1.0 - tone.burn))
    return Exposure(scale, float(lum.max()) * scale * burn**2)


def block_means(values: Image, side: int = 8) -> Image:
    """Return means over blocks of `side` x `side` pixels; the last ones may be smaller."""
    corners = [np.arange(0, size, side) for size in values.shape]
    sums = np.add.reduceat(np.add.reduceat(values, corners[0], axis=0), corners[1], axis=1)
    heights, widths = (
        np.diff(np.append(corner, size)) for corner, size in zip(corners, values.shape, strict=True)
    )
    return sums / np.outer(heights, widths)


def tonemap(image: ArrayOrTensor, exposure: Exposure) -> ArrayOrTensor:
    """Map linear HDR (..., 3) to display values: compressed, sRGB-encoded, float32 in [0, 1]."""
    xp = array_namespace(image)
    scale = xp.asarray(exposure.scale, dtype=xp.float32)
    white2 = xp.asarray(exposure.white**2, dtype=xp.float32)
    scaled = xp.clip(xp.asarray(image, dtype=xp.float32), 0, None) * scale
    lum = luminance(scaled)[..., None]
    factor = (1 + lum / white2) / (1 + lum)
    return encode_srgb(xp.clip(scaled * factor, 0, 1))


def untonemap(display: Image, exposure: Exposure) -> Float32Array:
    """Invert `tonemap`, except for its clipping: display values (..., 3) to linear HDR, float32."""
    compressed = decode_srgb(np.clip(np.asarray(display, dtype=np.float32), 0, 1))
    lum = luminance(compressed)[..., None].astype(np.float64)
    # mapped = L (1 + L / w^2) / (1 + L)  <=>  L^2 / w^2 + L (1 - mapped) - mapped = 0
    inverse_white2 = 1.0 / exposure.white**2
    half = 0.5 * (1 - lum)
    scaled = lum / np.maximum(half + np.sqrt(half**2 + inverse_white2 * lum), 1e-12)
    ratio = np.where(lum > 0, scaled / np.maximum(lum, 1e-12), 1.0)
    return (compressed * ratio / exposure.scale).astype(np.float32)


def to_bytes(display: Image) -> UInt8Array:
    """Round display values in [0, 1] to uint8."""
    return np.clip(np.rint(np.asarray(display) * 255), 0, 255).astype(np.uint8)
