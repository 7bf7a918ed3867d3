"""CAN: a context aggregation network, dilated convolutions at full resolution.

Q. Chen, J. Xu, V. Koltun: *Fast Image Processing with Fully-Convolutional Networks*, ICCV 2017.
Layer s of d, from 1 to d - 2: 3x3 with dilation 2^(s-1), adaptive normalisation, leaky ReLU 0.2;
then one more such layer without dilation; then 1x1 to three channels. CAN32+AN has d = 10 and 32
channels, CAN24 d = 9 and 24. `width` is the channels, `levels` is d. The own loss is the mean
square of the difference; Adam at 1e-4.
"""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional

from model.baselines.layers import BatchNorm, Stack
from model.data.encoding import Tensors
from model.networks.objective import PairedLoss, Setting
from model.networks.pbrnet import Architecture

LEAK = 0.2


class CAN(nn.Module):
    """Depth d, equal width throughout, no pooling: each layer keeps the image's size."""

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        width, depth = architecture.width, architecture.levels
        self.stack = Stack(architecture.panorama, width)
        dilations = [2**layer for layer in range(depth - 2)] + [1]
        inputs = [self.stack.channels] + [width] * (depth - 2)
        self.layers = nn.Sequential(
            *(Layer(n, width, dilation) for n, dilation in zip(inputs, dilations, strict=True))
        )
        self.out = nn.Conv2d(width, 3, 1)
        nn.init.xavier_uniform_(self.out.weight)
        nn.init.zeros_(self.out.bias)  # type: ignore[arg-type]

    def forward(self, inputs: Tensors) -> torch.Tensor:
        """`encode`'s tensors to display values (N, 3, H, W), not clamped."""
        return self.out(self.layers(self.stack(inputs)))


class Layer(nn.Module):
    """3x3 dilated convolution without bias, adaptive normalisation, leaky ReLU.

    It starts as the identity on the channels that it has in common with what it is given, as
    far as its width goes.
    """

    def __init__(self, inputs: int, outputs: int, dilation: int) -> None:
        super().__init__()
        self.conv = nn.Conv2d(inputs, outputs, 3, padding=dilation, dilation=dilation, bias=False)
        nn.init.dirac_(self.conv.weight)
        self.norm = AdaptiveNorm(outputs)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(N, inputs, H, W) to (N, outputs, H, W)."""
        return functional.leaky_relu(self.norm(self.conv(x)), LEAK)


class AdaptiveNorm(nn.Module):
    """lambda x + mu BN(x): whether to normalise is learned, one pair of numbers a layer.

    lambda starts at 1 and mu at 0. BN shifts but does not scale, mu does.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.keep = nn.Parameter(torch.ones(()))  # lambda
        self.mix = nn.Parameter(torch.zeros(()))  # mu
        self.norm = BatchNorm(channels, epsilon=1e-3, scaled=False)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(N, C, H, W)."""
        return self.keep * x + self.mix * self.norm(x)


class MeanSquares(PairedLoss):
    """CAN's own loss."""

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        self.criterion = functional.mse_loss
