"""Tone mapping of batches (N, 3, H, W), differentiable, for networks and losses.

`pbrnet.pipeline.tonemap` does the same for single images (H, W, 3). All functions have finite
gradients everywhere and use only operators that ONNX has.
"""

from __future__ import annotations

import torch
from torch.nn import functional

from pbrnet.pipeline.tonemap import ToneParams
from pbrnet.scenes.color import REC709, decode_srgb, encode_srgb

DEFAULT_WHITE = 20.0  # exposed luminance that maps to white if it is unknown; typical indoors
BLOCK = 8  # side in pixels of the blocks whose means the log average takes, see `exposure_of`


def luminance(image: torch.Tensor) -> torch.Tensor:
    """Rec. 709 luminance (N, 1, H, W) of linear RGB (N, 3, H, W)."""
    return sum(float(weight) * image[:, k : k + 1] for k, weight in enumerate(REC709))  # type: ignore[return-value]


def tonemap_exposed(scaled: torch.Tensor, white: torch.Tensor | float) -> torch.Tensor:
    """Exposed radiance (N, 3, H, W) to display values in [0, 1], see
    `pbrnet.pipeline.tonemap.tonemap`.

    `white` is a number or (N, 1, 1, 1).
    """
    lum = luminance(scaled)
    return encode_srgb((scaled * (1 + lum / white**2) / (1 + lum)).clamp(0, 1))


def exposed(display: torch.Tensor, white: torch.Tensor | float) -> torch.Tensor:
    """Display values (N, 3, H, W) in [0, 1] to exposed radiance: the inverse of `tonemap_exposed`.

    `white`, a number or (N, 1, 1, 1), is the luminance that the display shows as white.
    """
    compressed = decode_srgb(display)
    lum = luminance(compressed)
    half = 0.5 * (1 - lum)
    return compressed / (half + (half**2 + lum / white**2).sqrt()).clamp(min=1e-6)


def log_average(lum: torch.Tensor) -> torch.Tensor:
    """Log-average luminance (N, 1, 1, 1) of luminance (N, 1, H, W).

    exp of the mean logarithm of all block means above 0, as in
    `pbrnet.pipeline.tonemap.exposure_of`. For an image that is black everywhere it is the key of
    the tone mapping.
    """
    height, width = lum.shape[-2:]
    pad = (0, -width % BLOCK, 0, -height % BLOCK)
    sums, counts = (
        functional.avg_pool2d(functional.pad(image, pad), BLOCK)
        for image in (lum, torch.ones_like(lum))
    )
    means = sums / counts  # blocks at the right and bottom edges may be smaller
    lit = (means > 0).to(lum.dtype)
    logs = torch.log(torch.where(means > 0, means, torch.ones_like(means)))
    number = lit.sum(dim=(1, 2, 3), keepdim=True)
    average = torch.exp((logs * lit).sum(dim=(1, 2, 3), keepdim=True) / number.clamp(min=1))
    return torch.where(number > 0, average, torch.full_like(average, ToneParams().key))


def displayed_product(
    shading: torch.Tensor, reflectance: torch.Tensor, albedo: float
) -> torch.Tensor:
    """Reflectance x shading in its own exposure, display values (N, 3, H, W).

    Of display values of shading with the white point `DEFAULT_WHITE`, of surfaces with one albedo,
    and the reflectance of `encode`. In a closed room of albedo a, bounces are the share a of all
    light, a / (1 - a) times the direct light, as in an integrating sphere. The product has the
    bounces of the image's mean reflectance in each band in place of the grey ones: a room gets its
    brightness and its cast.
    """
    tone = ToneParams()
    light = exposed(shading.float().clamp(0, 1), DEFAULT_WHITE)
    light = light * (tone.key / log_average(luminance(light)))
    bounces = light.clamp(max=albedo * tone.key)
    surfaces = decode_srgb((reflectance.float() + 1) / 2)
    mean = surfaces.mean((2, 3), keepdim=True).clamp(max=0.95)
    gain = mean / (1 - mean) * ((1 - albedo) / albedo)
    linear = surfaces * (light + (gain - 1) * bounces)
    level = luminance(linear)
    scale = tone.key / log_average(level)
    white = (scale * level).amax(dim=(1, 2, 3), keepdim=True) * (1 - tone.burn) ** 2
    return tonemap_exposed(scale * linear, white.clamp(min=1e-6))
