"""Shared layers of the baselines: input stack, normalisation, padding, initialisation."""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional

from pbrnet.model.data.encoding import Tensors, input_named
from pbrnet.model.methods import JOINS, PAPER_INPUTS, Panorama
from pbrnet.model.networks.pbrnet import NormalPanorama, log_panorama

IMAGES = ("depth", "normal", "reflectance")
STACKED = sum(input_named(name).channels for name in PAPER_INPUTS)


def stack_channels(panorama: Panorama) -> int:
    """Channels of `stacked` with this join."""
    return STACKED + sum(input_named(name).channels for name in JOINS[panorama].inputs)


def stacked(inputs: Tensors) -> torch.Tensor:
    """All inputs as one image (N, `stack_channels`, H, W); the panorama is resized to its size."""
    panorama = torch.cat(log_panorama(inputs["intensity"], inputs["distance"]), dim=1)
    size = inputs["normal"].shape[-2:]
    resized = functional.interpolate(panorama, size, mode="bilinear", align_corners=False)
    direct = [inputs[join.direct] for join in JOINS.values() if join.direct in inputs]
    return torch.cat([*(inputs[name] for name in IMAGES), resized, *direct], dim=1)


class Stack(nn.Module):
    """Input image of a baseline; the panorama is joined to it as in our networks.

    With `panorama` `resize` it is `stacked`. With the other joins it has panorama features that are
    looked up in the direction of each pixel's normal instead of the resized panorama, and the
    further image of the join, if any. Baselines therefore get the same information as our networks.
    """

    def __init__(self, panorama: Panorama, width: int) -> None:
        super().__init__()
        branch = max(1, width // 2)
        self.inputs = stack_channels(panorama)
        self.images = (*IMAGES, *JOINS[panorama].inputs)
        images = sum(input_named(name).channels for name in self.images)
        self.join = None if JOINS[panorama].resized else NormalPanorama(branch)
        self.channels = STACKED if self.join is None else images + 2 * branch

    def forward(self, inputs: Tensors) -> torch.Tensor:
        """Tensors of `encode` to an image (N, channels, H, W)."""
        if self.join is None:
            return stacked(inputs)
        images = torch.cat([inputs[name] for name in self.images], dim=1)
        return torch.cat([images, self.join(inputs).to(images.dtype)], dim=1)


class BatchNorm(nn.Module):
    """Batch normalisation by the statistics of the current batch, in training and inference.

    The authors of the baselines train and predict with batch 1. Each image is then normalised by
    its own statistics, with a learned scale and shift for each channel.
    """

    def __init__(self, channels: int, epsilon: float = 1e-5, scaled: bool = True) -> None:
        super().__init__()
        self.epsilon = epsilon
        self.weight = nn.Parameter(torch.ones(channels)) if scaled else None
        self.bias = nn.Parameter(torch.zeros(channels))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(N, C, H, W) to the same shape; mean 0 and variance 1 before scale and shift."""
        # Not `functional.batch_norm`, which refuses an image of one pixel.
        statistics = (None, None, True, 0.0, self.epsilon)
        return torch.batch_norm(x, self.weight, self.bias, *statistics, cudnn_enabled=True)


class InstanceNorm(nn.Module):
    """Instance normalisation without learned parameters, computed in float32."""

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(N, C, H, W) to the same shape; mean 0 and variance 1 of each channel and image."""
        return functional.instance_norm(x.float()).to(x.dtype)


def padded(x: torch.Tensor, multiple: int, minimum: int = 1) -> torch.Tensor:
    """Pad (N, C, H, W) at the right and bottom by repeating the edge.

    The sides become multiples of `multiple` and at least `minimum`.
    """
    bottom, right = (
        max(side + -side % multiple, minimum + -minimum % multiple) - side for side in x.shape[-2:]
    )
    return functional.pad(x, (0, right, 0, bottom), mode="replicate")


def gaussian(module: nn.Module) -> None:
    """Initialise a layer as pix2pix and CycleGAN do: weights from N(0, 0.02^2), bias 0."""
    if isinstance(module, (nn.Conv2d, nn.ConvTranspose2d)):
        nn.init.normal_(module.weight, std=0.02)
        if module.bias is not None:
            nn.init.zeros_(module.bias)
    elif isinstance(module, BatchNorm) and module.weight is not None:
        nn.init.normal_(module.weight, mean=1.0, std=0.02)


def display(tanh: torch.Tensor) -> torch.Tensor:
    """Output of a tanh in [-1, 1] as display values in [0, 1]."""
    return (tanh + 1) / 2
