"""The part-perceptual loss and its variants: equations 1 and 2 of the paper.

    loss = sum over l of  lambda_l w_l mean |phi_l(prediction) - phi_l(truth)|

over the image itself (l = 0) and five layers of a pretrained network. lambda are the balancing
weights of Chen and Koltun (2017), which bring all terms to a similar size. w are the weights of the
paper: they keep the image and the shallow layers, and drop the deep layers, which cause grid
patterns in the predicted images.
"""

from __future__ import annotations

from typing import Protocol

import torch
from torch import nn

from pbrnet.model.settings import LossParams

# Input, conv1_2, conv2_2, conv3_2, conv4_2, conv5_2.
LAMBDA = (1.0, 1 / 2.6, 1 / 4.8, 1 / 3.7, 1 / 5.6, 10 / 1.5)


class Features(Protocol):
    """Interface of a feature extractor."""

    def __call__(self, display: torch.Tensor, depth: int) -> list[torch.Tensor]:
        """The first `depth` feature maps of display values (N, 3, H, W) in [0, 1]."""


def layer_weights(params: LossParams) -> tuple[float, ...]:
    """Weights lambda_l w_l of a variant, l = 0 to 5.

    `part`: w of `params.part`. `full`: all w = 1. `fifth`: the fifth layer only. `l1`: the image
    only.
    """
    chosen: dict[str, tuple[float, ...]] = {
        "part": params.part,
        "full": (1.0,) * 6,
        "fifth": (0.0,) * 5 + (1.0,),
        "l1": (1.0,) + (0.0,) * 5,
    }
    return tuple(a * b for a, b in zip(LAMBDA, chosen[params.kind], strict=True))


class PerceptualLoss(nn.Module):
    """Weighted L1 distance over the 0-255 image and the layers of the backbone.

    Layers beyond the last with a non-zero weight are not computed.
    """

    def __init__(self, backbone: Features, params: LossParams) -> None:
        super().__init__()
        self.backbone, self.weights = backbone, layer_weights(params)
        self.depth = max((i for i, weight in enumerate(self.weights) if weight), default=0)

    def forward(self, prediction: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
        """Loss of display values (N, 3, H, W) in [0, 1]: a scalar on the scale of 0-255 images."""
        total = 255 * self.weights[0] * (prediction - truth).abs().mean()
        if self.depth == 0:
            return total
        with torch.no_grad():
            targets = self.backbone(truth, self.depth)
        features = self.backbone(prediction, self.depth)
        for weight, feature, target in zip(self.weights[1:], features, targets, strict=False):
            if weight:
                total = total + weight * (feature.float() - target.float()).abs().mean()
        return total
