"""The paper's two networks in series, trained end to end on the loss of colour alone.

The comparison with two-stage training shows the value of the decomposition. The layers are the
same, but the image between the networks is not supervised and need not be shading. The composition
network has two levels less than the shading network, as in the presets.
"""

from __future__ import annotations

import torch
from torch import nn

from pbrnet.model.data.encoding import Tensors
from pbrnet.model.networks.pbrnet import Architecture, composition_network, shading_network


class EndToEnd(nn.Module):
    """Shading network and composition network in series, with a gradient through both."""

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        self.shading = shading_network(architecture)
        self.composition = composition_network(composition_of(architecture))

    def forward(self, inputs: Tensors) -> torch.Tensor:
        """Tensors of `encode` to colour in display values (N, 3, H, W), not clamped."""
        hidden = self.shading(inputs)
        # Straight-through clamp: the second network gets values in [0, 1] as in two stages, and
        # pixels outside of the range still get a gradient.
        hidden = hidden + (hidden.clamp(0, 1) - hidden).detach()
        return self.composition(self.composition.images(hidden, inputs["reflectance"]))


def composition_of(architecture: Architecture) -> Architecture:
    """Architecture of the composition network for that of a shading network."""
    levels = max(1, architecture.levels - 2)
    return Architecture("composition", architecture.width, levels, exposure=architecture.exposure)
