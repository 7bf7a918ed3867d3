"""The paper's two networks as one, which nobody tells what shading is.

What the decomposition is worth: the same layers as both stages, but colour's loss alone reaches
them, so what passes between them is whatever helps. The composition network has two levels less
than the shading network, as in the presets.
"""

from __future__ import annotations

import torch
from torch import nn

from model.data.encoding import Tensors
from model.networks.pbrnet import Architecture, composition_network, shading_network


class EndToEnd(nn.Module):
    """Shading network, then composition network, with a gradient through both."""

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        self.shading = shading_network(architecture)
        self.composition = composition_network(composition_of(architecture))

    def forward(self, inputs: Tensors) -> torch.Tensor:
        """`encode`'s tensors to colour in display values (N, 3, H, W), not clamped."""
        between = self.shading(inputs)
        # The second network is given [0, 1], as in two stages; the gradient does not stop there,
        # lest pixels that once leave the range never come back.
        between = between + (between.clamp(0, 1) - between).detach()
        return self.composition(between, inputs["reflectance"])


def composition_of(architecture: Architecture) -> Architecture:
    """The composition network that goes with a shading network of this width and depth."""
    return Architecture("composition", architecture.width, max(1, architecture.levels - 2))
