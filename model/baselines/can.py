"""CAN: context aggregation network of dilated convolutions at full resolution.

Q. Chen, J. Xu, V. Koltun: *Fast Image Processing with Fully-Convolutional Networks*, ICCV 2017.
The network has d layers. Layer s, from 1 to d - 2, is a 3x3 convolution with dilation 2^(s-1),
adaptive normalisation and leaky ReLU 0.2. Layer d - 1 is the same without dilation, layer d a 1x1
convolution to three channels. CAN32+AN has d = 10 and 32 channels, CAN24 has d = 9 and 24. `width`
is the number of channels and `levels` is d. Its own loss is the mean squared error, with Adam at
1e-4.
"""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional

from pbrnet.model.baselines.layers import BatchNorm, Stack
from pbrnet.model.data.encoding import Tensors
from pbrnet.model.networks.objective import PairedLoss, Setting
from pbrnet.model.networks.pbrnet import Architecture

LEAK = 0.2


class CAN(nn.Module):
    """CAN of depth `levels` and constant width, without pooling; see the module."""

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
        """Tensors of `encode` to display values (N, 3, H, W), not clamped."""
        return self.out(self.layers(self.stack(inputs)))


class Layer(nn.Module):
    """3x3 dilated convolution without bias, adaptive normalisation, leaky ReLU.

    The initial convolution is the identity on the first min(`inputs`, `outputs`) channels.
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
    """Adaptive normalisation, lambda x + mu BN(x), with two learned scalars a layer.

    lambda starts at 1 and mu at 0. BN has a learned shift and no learned scale, which mu replaces.
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
    """Mean squared error, the loss of the CAN paper."""

    description = "mean squares"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        self.criterion = functional.mse_loss
