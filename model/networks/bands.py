"""Network on single bands: red, green and blue pass through the same weights, as a batch of three.

Light of one band knows nothing of the others: what a wall does to red light it does to green light
of the same reflectance. A network that sees one band at a time learns transport once, not in each
colour, and a coloured lamp is nothing new to it. Swapped bands of the inputs swap those of the
outputs.
"""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional

from pbrnet.model.data.encoding import Tensors, input_named
from pbrnet.model.methods import GEOMETRY
from pbrnet.model.networks.pbrnet import UNet, convolution

GEOMETRY_CHANNELS = sum(input_named(name).channels for name in GEOMETRY)
FOLD = 2  # side of the blocks of pixels that become channels
INPUT_LOG_OFFSET = 0.01  # added before the logarithm, relative to the level of the light


class BandNet(nn.Module):
    """U-Net at half resolution from geometry and a band's images to `outputs` values a pixel.

    Blocks of 2x2 pixels become channels (Shi et al., *Real-time single image and video
    super-resolution*, 2016): no pixel is lost, and a layer costs a quarter. The layer that sees the
    geometry is computed once for all bands. The last layer starts near 0.
    """

    def __init__(
        self, signals: int, width: int, levels: int, outputs: int, constants: int = 0
    ) -> None:
        super().__init__()
        block = FOLD**2
        self.geometry = convolution(block * (GEOMETRY_CHANNELS + constants), width, padding=1)
        self.signals = convolution(block * signals, width, padding=1)
        self.unet = UNet(width, width, levels, block * outputs)
        nn.init.zeros_(self.unet.out.bias)  # type: ignore[arg-type]

    def forward(self, geometry: torch.Tensor, signals: torch.Tensor) -> torch.Tensor:
        """Values float32 (N, 3, outputs, H, W), from (N, C, H, W) and (N, 3, signals, H, W)."""
        bands, (height, width) = signals.shape[1], signals.shape[-2:]
        shared = self.geometry(_folded(geometry)).repeat_interleave(bands, dim=0)
        features = functional.relu(shared + self.signals(_folded(signals.flatten(0, 1))))
        found = functional.pixel_shuffle(self.unet(features).float(), FOLD)
        return found[..., :height, :width].unflatten(0, (-1, bands))


def geometry_of(inputs: Tensors) -> torch.Tensor:
    """The images of `GEOMETRY`, (N, `GEOMETRY_CHANNELS`, H, W)."""
    return torch.cat([inputs[name] for name in GEOMETRY], dim=1)


def log_light(light: torch.Tensor, level: torch.Tensor) -> torch.Tensor:
    """Logarithm of light (N, 3, H, W) relative to a level (N, 1, 1, 1), of the size of 1."""
    return (light / level + INPUT_LOG_OFFSET).log() / 3


def bounded(value: torch.Tensor, most: float) -> torch.Tensor:
    """The value, smoothly kept within [-most, most]; 0 stays 0."""
    return most * torch.tanh(value / most)


def _folded(image: torch.Tensor) -> torch.Tensor:
    """Blocks of 2x2 pixels as channels; an odd row or column is repeated."""
    height, width = image.shape[-2:]
    image = functional.pad(image, (0, -width % FOLD, 0, -height % FOLD), mode="replicate")
    return functional.pixel_unshuffle(image, FOLD)
