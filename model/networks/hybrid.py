"""PBR-Net hybrid: a few path-traced samples a pixel, denoised, then corrected by a network.

Intel's denoiser has seen far more pictures than any training here could show a network, so the
network starts from its result and learns only where that is wrong: it predicts the logarithm of a
factor for every pixel and band, from the guides, the samples as they were traced, and the denoised
images. A factor keeps the unit of the light, the sharpness of textures, and black black.

After residual learning (Zhang et al., *Beyond a Gaussian denoiser*, 2017), on logarithms as path
tracing's errors are relative. Left out: the panorama, and with it the direct light that `plus` is
given; how sure each sample is (its variance); samples of neighbouring views.
"""

from __future__ import annotations

import torch
from torch import nn

from model.data.display import log_average, luminance, tonemap_exposed
from model.data.encoding import CHANNELS, NOISY_SAMPLES_CHANNELS, Tensors
from model.networks.objective import Batch, SingleLoss
from model.networks.pbrnet import Architecture, UNet
from scenes.color import decode_srgb

GUIDES = ("depth", "normal", "reflectance")
LEAST = 0.03  # reflectance that every surface is taken to have beside its own
FAINT = 0.01  # of the log-average shading: darker samples look alike to the network
REACH = 3.0  # of the logarithm: the network may change light up to twentyfold
LOG_WEIGHT, LOG_FLOOR = 25.0, 0.05  # of the loss's logarithms, and the exposed value below them


class HybridNet(nn.Module):
    """Guides, samples and denoised images to radiance; see the module."""

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        guides = sum(CHANNELS[name] for name in GUIDES)
        self.unet = UNet(
            guides + 2 * NOISY_SAMPLES_CHANNELS,
            architecture.width,
            architecture.levels,
            NOISY_SAMPLES_CHANNELS,
        )
        nn.init.zeros_(self.unet.out.bias)  # type: ignore[arg-type]

    def forward(self, inputs: Tensors) -> torch.Tensor:
        """`encode`'s tensors, samples among them, to linear colour in their unit."""
        return self.parts(inputs)[1]

    def parts(self, inputs: Tensors) -> tuple[torch.Tensor, torch.Tensor]:
        """Shading and colour, linear radiance, float32 (N, 3, H, W), not negative."""
        reflectance = decode_srgb((inputs["reflectance"].float() + 1) / 2) + LEAST
        noisy, denoised = inputs["noisy"].float(), inputs["denoised"].float()
        known = [inputs[name] for name in GUIDES]
        average = log_average(luminance(denoised[:, 3:]))
        for images in (noisy, denoised):
            light = torch.cat([images[:, :3] / reflectance, images[:, 3:]], dim=1)
            known.append((light / average + FAINT).log() / 3)
        logarithm = self.unet(torch.cat(known, dim=1)).float()
        factor = (REACH * torch.tanh(logarithm / REACH)).exp()
        color, shading = (factor * denoised).split(3, dim=1)
        return shading, color


class ExposedLoss(SingleLoss):
    """The criterion on the exposed colour, and logarithms of colour and shading.

    The criterion sees what a viewer sees; where that is white or nearly black, its gradient is
    nothing, and the logarithm still tells how wrong the light is.
    """

    def loss(self, batch: Batch) -> torch.Tensor:
        """The sum of all, a scalar with gradient."""
        assert isinstance(self.network, HybridNet) and batch.radiance is not None
        truth = batch.radiance
        with self.half():
            shading, color = self.network.parts(batch.inputs)
            scale, white = truth["exposure_color"].split(1, dim=1)
            loss = self.criterion(tonemap_exposed(color * scale, white), batch.truth)
        for image, name in ((color, "color"), (shading, "shading")):
            scale = truth[f"exposure_{name}"][:, :1]
            logs = [(scale * each + LOG_FLOOR).log() for each in (image, truth[name])]
            loss = loss + LOG_WEIGHT * (logs[0] - logs[1]).abs().mean()
        return loss
