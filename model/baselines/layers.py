"""Shared layers of the baselines: stack of input images, normalisation, padding."""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional

from model.data.encoding import CHANNELS, Tensors
from model.networks.pbrnet import NormalPanorama, Panorama, log_panorama

IMAGES = ("depth", "normal", "reflectance")
STACKED = sum(CHANNELS.values())  # channels of `stacked`


def stacked(inputs: Tensors) -> torch.Tensor:
    """All inputs as one image (N, `STACKED`, H, W); the panorama is stretched over it."""
    panorama = torch.cat(log_panorama(inputs["intensity"], inputs["distance"]), dim=1)
    size = inputs["normal"].shape[-2:]
    stretched = functional.interpolate(panorama, size, mode="bilinear", align_corners=False)
    return torch.cat([*(inputs[name] for name in IMAGES), stretched], dim=1)


class Stack(nn.Module):
    """The image that a baseline's first layer sees, its panorama joined as in our networks.

    `resize`: `stacked`. `normal`: features of the panorama, read in each pixel's normal, take
    the place of the stretched panorama, so that no baseline is at a disadvantage.
    """

    def __init__(self, panorama: Panorama, width: int) -> None:
        super().__init__()
        branch = max(1, width // 2)
        images = sum(CHANNELS[name] for name in IMAGES)
        self.join = NormalPanorama(branch) if panorama == "normal" else None
        self.channels = STACKED if self.join is None else images + 2 * branch

    def forward(self, inputs: Tensors) -> torch.Tensor:
        """(N, channels, H, W) of `encode`'s tensors."""
        if self.join is None:
            return stacked(inputs)
        images = torch.cat([inputs[name] for name in IMAGES], dim=1)
        return torch.cat([images, self.join(inputs).to(images.dtype)], dim=1)


class BatchNorm(nn.Module):
    """Batch normalisation by the statistics of the batch at hand, in training and in use.

    The baselines' authors train with batch 1 and use it so too: each image is then normalised by
    its own statistics, with learned scale and shift per channel. Computed in float32.
    """

    def __init__(self, channels: int, epsilon: float = 1e-5, scaled: bool = True) -> None:
        super().__init__()
        self.epsilon = epsilon
        self.weight = nn.Parameter(torch.ones(channels)) if scaled else None
        self.bias = nn.Parameter(torch.zeros(channels))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(N, C, H, W), every channel with mean 0 and variance 1 before scale and shift."""
        wide = x.float()
        variance, mean = torch.var_mean(wide, dim=(0, 2, 3), correction=0, keepdim=True)
        normal = (wide - mean) * torch.rsqrt(variance + self.epsilon)
        if self.weight is not None:
            normal = normal * self.weight[:, None, None]
        return (normal + self.bias[:, None, None]).to(x.dtype)


class InstanceNorm(nn.Module):
    """Each channel of each image to mean 0 and variance 1; nothing is learned. In float32."""

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(N, C, H, W)."""
        return functional.instance_norm(x.float()).to(x.dtype)


def padded(x: torch.Tensor, multiple: int, least: int = 1) -> torch.Tensor:
    """(N, C, H, W) padded right and below by its edge: sides multiples, and at least `least`."""
    bottom, right = (
        max(side + -side % multiple, least + -least % multiple) - side for side in x.shape[-2:]
    )
    return functional.pad(x, (0, right, 0, bottom), mode="replicate")


def gaussian(module: nn.Module) -> None:
    """Weights of convolutions from N(0, 0.02), no bias: how pix2pix and CycleGAN start."""
    if isinstance(module, (nn.Conv2d, nn.ConvTranspose2d)):
        nn.init.normal_(module.weight, std=0.02)
        if module.bias is not None:
            nn.init.zeros_(module.bias)
    elif isinstance(module, BatchNorm) and module.weight is not None:
        nn.init.normal_(module.weight, mean=1.0, std=0.02)


def display(tanh: torch.Tensor) -> torch.Tensor:
    """Output of a last tanh, [-1, 1], as display values in [0, 1]."""
    return (tanh + 1) / 2
