"""PBR-Net hybrid: a few path-traced samples a pixel, denoised, then corrected by a network.

Two pictures of the view err independently: the denoised samples, by noise that the denoiser takes
for light, and light transport (`pipeline.passes.transport`), which has little noise but leaves
things out. The network starts from a mixture of them that is nearer to the truth than either. It
also knows the difference of two halves of the samples, and their number: one set of weights serves
for 1 to 8.

For each pixel and band it predicts the share of light transport in the mixture, how far the picture
moves towards the raw samples, and the logarithm of a factor. At first the share is `START_SHARE`
and the others are 0. Its inputs are logarithms of light without reflectance
(Zhang et al., *Beyond a Gaussian denoiser*, 2017, learn residuals likewise), relative to one level
for the view. It does not use the panorama or samples of neighbouring views.
"""

from __future__ import annotations

import math

import torch
from torch import nn

from model.data.display import log_average
from model.data.encoding import Tensors
from model.networks.bands import BandNet, bounded, geometry_of, log_light
from model.networks.pbrnet import Architecture
from scenes.color import decode_srgb

# A band's samples, denoised samples, transport's picture, difference of the samples' halves, direct
# and indirect light, reflectance
SIGNALS = 7
REFLECTANCE_OFFSET = 0.03  # added to reflectance before the division by it
START_SHARE = 0.8  # of light transport in the mixture
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
        geometry = torch.cat([geometry_of(inputs), samples], dim=1)
        found = self.bands(geometry, torch.stack(signals, dim=2))
        factor = bounded(found[:, :, 0], MAX_LOG_FACTOR).exp()
        start = math.atanh(2 * START_SHARE - 1)
        share, back = (1 + torch.tanh(found[:, :, 1] + start)) / 2, torch.tanh(found[:, :, 2])
        mixed = denoised + share * (color - denoised) + back * (noisy - denoised)
        return factor * mixed.clamp(min=0)
