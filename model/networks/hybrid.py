"""PBR-Net hybrid: a few path-traced samples a pixel, denoised, then corrected by a network.

Intel's denoiser was trained on far more images than any training here. The network therefore
starts from the denoised images and learns to correct them: it predicts the logarithm of a factor
for every pixel and band. Its inputs are the guides, the noisy samples and the denoised images. A
factor preserves the unit of radiance, the sharpness of textures, and black.

The method follows residual learning (Zhang et al., *Beyond a Gaussian denoiser*, 2017). It works on
logarithms because the errors of path tracing are relative. It does not use the panorama, the direct
light that `plus` takes, the variance of the samples, or samples of neighbouring views.
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
REFLECTANCE_OFFSET = 0.03  # added to reflectance before the division by it
INPUT_LOG_OFFSET = 0.01  # added before the logarithm, relative to the log-average shading
MAX_LOG_FACTOR = 3.0  # bound of the predicted logarithm: the factor is at most exp(3), about 20
# Weight of the logarithmic loss, and the value added to exposed radiance before the logarithm.
LOG_WEIGHT, LOSS_LOG_OFFSET = 25.0, 0.05


class HybridNet(nn.Module):
    """Network from guides, noisy samples and denoised images to radiance; see the module."""

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
        """Tensors of `encode` with noisy samples to linear colour in the unit of the samples."""
        return self.parts(inputs)[1]

    def parts(self, inputs: Tensors) -> tuple[torch.Tensor, torch.Tensor]:
        """Shading and colour: linear radiance, float32 (N, 3, H, W), at least 0."""
        reflectance = decode_srgb((inputs["reflectance"].float() + 1) / 2) + REFLECTANCE_OFFSET
        noisy, denoised = inputs["noisy"].float(), inputs["denoised"].float()
        known = [inputs[name] for name in GUIDES]
        average = log_average(luminance(denoised[:, 3:]))
        for images in (noisy, denoised):
            light = torch.cat([images[:, :3] / reflectance, images[:, 3:]], dim=1)
            known.append((light / average + INPUT_LOG_OFFSET).log() / 3)
        logarithm = self.unet(torch.cat(known, dim=1)).float()
        factor = (MAX_LOG_FACTOR * torch.tanh(logarithm / MAX_LOG_FACTOR)).exp()
        color, shading = (factor * denoised).split(3, dim=1)
        return shading, color


class ExposedLoss(SingleLoss):
    """The criterion on the displayed colour, plus L1 on logarithms of colour and shading.

    The criterion measures the displayed image. Its gradient vanishes where the display is white or
    nearly black; there the logarithms still measure the error.
    """

    def loss(self, batch: Batch) -> torch.Tensor:
        """The sum of the three terms, a scalar with gradient."""
        assert isinstance(self.network, HybridNet) and batch.radiance is not None
        truth = batch.radiance
        with self.autocast():
            shading, color = self.network.parts(batch.inputs)
            scale, white = truth["exposure_color"].split(1, dim=1)
            loss = self.criterion(tonemap_exposed(color * scale, white), batch.truth)
        for image, name in ((color, "color"), (shading, "shading")):
            scale = truth[f"exposure_{name}"][:, :1]
            logs = [(scale * each + LOSS_LOG_OFFSET).log() for each in (image, truth[name])]
            loss = loss + LOG_WEIGHT * (logs[0] - logs[1]).abs().mean()
        return loss
