"""The hybrid: a few noisy path-traced samples a pixel, gathered by a network that knows the guides.

The network predicts no light. It predicts how the noisy samples are to be averaged: kernels on
every level of a pyramid, how much each level counts, and how far each pixel is to be trusted.
After Bako et al., *Kernel-predicting convolutional networks for denoising Monte Carlo renderings*
(2017), and for the pyramid Vogels et al. (2018). Colour is averaged without its reflectance, as
irradiance is, and gets it back afterwards; so textures stay sharp under the widest kernel. All
weights are positive and sum to one: the result has the unit of the samples, and a pixel's light
lies between the least and the most that was traced around it.

Left out: the panorama, and with it the direct light that `plus` is given; how sure each sample is
(its variance); samples of neighbouring views.
"""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional

from model.encoding import NOISY, Tensors
from model.networks import Architecture, UNet
from model.objective import Alone, Batch
from model.plus import decoded, encoded, luminance

GUIDES = ("depth", "normal", "reflectance")
KERNEL, COARSE = 5, 3  # pixels a side: of the kernels of a level, of those between levels
LEAST = 0.03  # reflectance that every surface is taken to have beside its own
FAINT = 0.01  # of the log-average shading: darker samples look alike to the network
LOG_WEIGHT, LOG_FLOOR = 25.0, 0.05  # of the loss's logarithms, and the exposed value below them


class HybridNet(nn.Module):
    """Guides and noisy radiance to radiance; see the module."""

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        width, levels = architecture.width, architecture.levels
        self.trunk = UNet(2 + 3 + 3 + NOISY, width, levels, outputs=0)
        self.heads = nn.ModuleList(
            _head(wide, level, levels) for level, wide in enumerate(self.trunk.widths)
        )

    def forward(self, inputs: Tensors) -> torch.Tensor:
        """`encode`'s tensors, noisy samples among them, to linear colour in their unit."""
        return self.parts(inputs)[1]

    def parts(self, inputs: Tensors) -> tuple[torch.Tensor, torch.Tensor]:
        """Shading and colour, linear radiance, float32 (N, 3, H, W), not negative."""
        color, shading = inputs["noisy"].float().split(3, dim=1)
        height, width = color.shape[-2:]
        reflectance = decoded((inputs["reflectance"].float() + 1) / 2) + LEAST
        light = torch.cat([color / reflectance, shading], dim=1)
        known = [inputs[name] for name in GUIDES]
        features = self.trunk.features(torch.cat([*known, _logarithms(light)], dim=1))
        predicted = [head(level) for head, level in zip(self.heads, features, strict=True)]
        gathered = gather(self.trunk.padded(light), [each.float() for each in predicted])
        light = gathered[..., :height, :width]
        return light[:, 3:], light[:, :3] * reflectance


def _head(width: int, level: int, levels: int) -> nn.Conv2d:
    """1x1 convolution to a level's weights; to begin with, equal in a kernel."""
    between = (COARSE**2 + 1) if level < levels - 1 else 0  # the kernel from below, the mixture
    trust = 1 if level == 0 else 0
    head = nn.Conv2d(width, KERNEL**2 + between + trust, 1)
    nn.init.normal_(head.weight, std=0.01)
    nn.init.zeros_(head.bias)  # type: ignore[arg-type]
    return head


def gather(light: torch.Tensor, predicted: list[torch.Tensor]) -> torch.Tensor:
    """Average `light` (N, C, H, W) over the pyramid by the weights of each level, fine to coarse.

    Level k holds `predicted[k]` (N, ., H / 2^k, W / 2^k): `KERNEL`^2 logits of the kernel; but for
    the coarsest, `COARSE`^2 logits of the kernel that takes up the level below, and the logit of
    this level's own share; for the finest, the logit of each pixel's trust.
    """
    finest = predicted[0]
    trust = torch.sigmoid(finest[:, -1:]) + 1e-3
    # Samples times trust, and trust: what is averaged is the first, divided by the second.
    weighed = torch.cat([light * trust, trust], dim=1)
    levels = [weighed]
    for _ in predicted[1:]:
        levels.append(functional.avg_pool2d(levels[-1], 2))
    result = light
    for level in reversed(range(len(predicted))):
        logits = predicted[level]
        kernel = torch.softmax(logits[:, : KERNEL**2], dim=1)
        sums = _convolved(levels[level], kernel)
        own = sums[:, :-1] / sums[:, -1:]
        if level == len(predicted) - 1:
            result = own
            continue
        below = torch.softmax(logits[:, KERNEL**2 : KERNEL**2 + COARSE**2], dim=1)
        share = torch.sigmoid(logits[:, KERNEL**2 + COARSE**2 :][:, :1])
        result = share * own + (1 - share) * _taken_up(result, below)
    return result


def _convolved(image: torch.Tensor, kernel: torch.Tensor) -> torch.Tensor:
    """`image` (N, C, H, W) by each pixel's own `kernel` (N, k * k, H, W); edges are repeated."""
    count, channels, height, width = image.shape
    taps = _neighbours(image, int(kernel.shape[1] ** 0.5))
    taps = taps.view(count, channels, kernel.shape[1], height, width)
    return (taps * kernel[:, None]).sum(dim=2)


def _taken_up(coarse: torch.Tensor, kernel: torch.Tensor) -> torch.Tensor:
    """The coarser image at twice its size: each pixel averages cells around the one it lies in."""
    count, channels, height, width = coarse.shape
    taps = functional.interpolate(_neighbours(coarse, COARSE), scale_factor=2, mode="nearest")
    taps = taps.view(count, channels, COARSE**2, 2 * height, 2 * width)
    return (taps * kernel[:, None]).sum(dim=2)


def _neighbours(image: torch.Tensor, side: int) -> torch.Tensor:
    """(N, C, H, W) to (N, C * side * side, H, W), rows first; edges are repeated."""
    edge = side // 2
    padded = functional.pad(image, (edge, edge, edge, edge), mode="replicate")
    return functional.unfold(padded, side).view(image.shape[0], -1, *image.shape[-2:])


def _logarithms(light: torch.Tensor) -> torch.Tensor:
    """ln of light (N, 6, H, W) relative to the log-average of its shading, about -1.5 to 3.

    The log average is that of 8x8 means, which noise hardly moves, as in `exposure_of`.
    """
    means = functional.avg_pool2d(
        luminance(light[:, 3:]), 8, ceil_mode=True, count_include_pad=False
    )
    lit = (means > 0).float()
    logs = (means.clamp(min=1e-20).log() * lit).sum(dim=(1, 2, 3), keepdim=True)
    average = (logs / lit.sum(dim=(1, 2, 3), keepdim=True).clamp(min=1)).exp()
    return (light / average + FAINT).log() / 3


class Exposed(Alone):
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
            loss = self.criterion(displayed(color * scale, white), batch.truth)
        for image, name in ((color, "color"), (shading, "shading")):
            scale = truth[f"exposure_{name}"][:, :1]
            logs = [(scale * each + LOG_FLOOR).log() for each in (image, truth[name])]
            loss = loss + LOG_WEIGHT * (logs[0] - logs[1]).abs().mean()
        return loss


def displayed(scaled: torch.Tensor, white: torch.Tensor) -> torch.Tensor:
    """`pipeline.tonemap.tonemap` of exposed radiance (N, 3, H, W), `white` (N, 1, 1, 1)."""
    lum = luminance(scaled)
    return encoded((scaled * (1 + lum / white**2) / (1 + lum)).clamp(0, 1))
