"""PBR-Net hybrid: a few path-traced samples a pixel, denoised, then corrected by a network.

Two pictures of the view err independently: the denoised samples, by noise that the denoiser takes
for light, and light transport (`pbrnet.pipeline.passes.transport`), which has little noise but
leaves things out. The network starts from a mixture of them that is nearer to the truth than
either. The more samples there are, of a pixel and of the image, the less of it is light transport.
The network also knows the difference of two halves of the samples, and their number: one set of
weights serves for 1 to 8.

For each pixel and band it predicts the share of light transport in the mixture, how far the picture
moves towards the raw samples, and the logarithm of a factor. At first the share is that of
`start_logit` and the others are 0. Its inputs are logarithms of light without reflectance
(Zhang et al., *Beyond a Gaussian denoiser*, 2017, learn residuals likewise), relative to one level
for the view. It does not use the panorama or samples of neighbouring views.
"""

from __future__ import annotations

import math

import torch
from torch import nn

from pbrnet.model.data.display import log_average
from pbrnet.model.data.encoding import Tensors
from pbrnet.model.methods import MAX_SAMPLES
from pbrnet.model.networks.bands import BandNet, bounded, geometry_of, log_light
from pbrnet.model.networks.pbrnet import Architecture
from pbrnet.scenes.color import decode_srgb

# A band's samples, denoised samples, transport's picture, difference of the samples' halves, direct
# and indirect light, reflectance
SIGNALS = 7
REFLECTANCE_OFFSET = 0.03  # added to reflectance before the division by it
# Samples per pixel that light transport is worth in an image of 160x120. In larger ones it is worth
# fewer, by a power of the number of pixels: the denoiser sees more of them around each. Fitted to
# views of training homes (docs/tried.md).
EQUAL_SAMPLES, EQUAL_PIXELS, EQUAL_POWER = 16.0, 160 * 120, 0.3
MAX_LOG_FACTOR = 3.0  # bound of the predicted logarithm: the factor is at most exp(3), about 20


class HybridNet(nn.Module):
    """Network from guides, noisy samples, denoised image and transport to radiance."""

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        width, levels = architecture.width, architecture.levels
        self.bands = BandNet(SIGNALS, width, levels, outputs=3, constants=1)

    def forward(self, inputs: Tensors) -> torch.Tensor:
        """Tensors of `encode` with transport and samples to linear colour (N, 3, H, W), >= 0."""
        noisy, half, denoised = inputs["noisy"].float().split(3, dim=1)
        direct, indirect, color = inputs["transport"].float().split(3, dim=1)
        reflectance = decode_srgb((inputs["reflectance"].float() + 1) / 2) + REFLECTANCE_OFFSET
        level = log_average((denoised / reflectance).mean(1, keepdim=True))
        images = (noisy, denoised, color, (half - noisy).abs())
        light = [image / reflectance for image in images]
        signals = [log_light(image, level) for image in (*light, direct, indirect)]
        signals.append(inputs["reflectance"].float())
        samples = inputs["samples"].expand(-1, -1, *noisy.shape[-2:])
        pixels = torch.ones_like(noisy[:, :1]).sum((1, 2, 3), keepdim=True)
        start = start_logit(inputs["samples"] * math.log(MAX_SAMPLES), pixels.log())
        geometry = torch.cat([geometry_of(inputs), samples], dim=1)
        found = self.bands(geometry, torch.stack(signals, dim=2))
        factor = bounded(found[:, :, 0], MAX_LOG_FACTOR).exp()
        share = torch.sigmoid(2 * found[:, :, 1] + start)
        back = torch.tanh(found[:, :, 2])
        mixed = denoised + share * (color - denoised) + back * (noisy - denoised)
        return factor * mixed.clamp(min=0)


def start_logit(log_samples: torch.Tensor, log_pixels: torch.Tensor) -> torch.Tensor:
    """Return the logit of the share of light transport before anything is learned.

    Of the logarithms of samples per pixel and of the image's pixels, tensors of one shape. The
    share is E / (E + n) for n samples if transport is worth E: weights by inverse variance.
    """
    worth = math.log(EQUAL_SAMPLES) - EQUAL_POWER * (log_pixels - math.log(EQUAL_PIXELS))
    return worth - log_samples
