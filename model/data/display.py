"""Display values and radiance as tensors: `pipeline.tonemap` for networks and what leaves torch.

Images are (N, 3, H, W); everything has a gradient everywhere, and uses nothing that ONNX lacks.
"""

from __future__ import annotations

import torch
from torch.nn import functional

from pipeline.params import ToneParams
from scenes.color import REC709

BLOCK = 8  # pixels a side over which the log average takes means, as `pipeline.tonemap` has it


def luminance(image: torch.Tensor) -> torch.Tensor:
    """Rec. 709 luminance (N, 1, H, W) of linear RGB (N, 3, H, W)."""
    return sum(float(weight) * image[:, k : k + 1] for k, weight in enumerate(REC709))  # type: ignore[return-value]


def decoded(display: torch.Tensor) -> torch.Tensor:
    """sRGB to linear."""
    high = ((display.clamp(min=0.04045) + 0.055) / 1.055) ** 2.4
    return torch.where(display <= 0.04045, display / 12.92, high)


def encoded(linear: torch.Tensor) -> torch.Tensor:
    """Linear to sRGB."""
    high = 1.055 * linear.clamp(min=0.0031308) ** (1 / 2.4) - 0.055
    return torch.where(linear <= 0.0031308, 12.92 * linear, high)


def recoloured(display: torch.Tensor, tint: torch.Tensor) -> torch.Tensor:
    """What display values (N, 3, H, W) show, in light of the colour `tint` (N, 3, 1, 1).

    Reinhard's operator keeps hues, so the light's colour multiplies what it leaves.
    """
    return encoded(decoded(display) * tint)


def displayed(scaled: torch.Tensor, white: torch.Tensor | float) -> torch.Tensor:
    """`pipeline.tonemap.tonemap` of exposed radiance; `white` a number or (N, 1, 1, 1)."""
    lum = luminance(scaled)
    return encoded((scaled * (1 + lum / white**2) / (1 + lum)).clamp(0, 1))


def log_average(lum: torch.Tensor) -> torch.Tensor:
    """exp of the mean logarithm of block means above 0, of luminance (N, 1, H, W): (N, 1, 1, 1).

    As `exposure_of` has it: the key where all is dark.
    """
    height, width = lum.shape[-2:]
    pad = (0, -width % BLOCK, 0, -height % BLOCK)
    sums, counts = (
        functional.avg_pool2d(functional.pad(image, pad), BLOCK)
        for image in (lum, torch.ones_like(lum))
    )
    means = sums / counts  # blocks at the right and bottom may be cut
    lit = (means > 0).to(lum.dtype)
    logs = torch.log(torch.where(means > 0, means, torch.ones_like(means)))
    number = lit.sum(dim=(1, 2, 3), keepdim=True)
    average = torch.exp((logs * lit).sum(dim=(1, 2, 3), keepdim=True) / number.clamp(min=1))
    return torch.where(number > 0, average, torch.full_like(average, ToneParams().key))
