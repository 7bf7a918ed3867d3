"""The part-perceptual loss and its variants: equations 1 and 2 of the paper.

    loss = sum over l of  lambda_l w_l mean |phi_l(prediction) - phi_l(truth)|

over the image itself (l = 0) and five layers of a pretrained network. lambda are Chen and Koltun's
(2017) balancing weights, which make every term of a similar size; w are the paper's, which keep
the image and the shallow layers and leave the deep ones, whose grid patterns show in the pictures.
"""

from __future__ import annotations

from typing import Protocol

import torch
from torch import nn

from pipeline.params import LossParams

# Input, conv1_2, conv2_2, conv3_2, conv4_2, conv5_2.
LAMBDA = (1.0, 1 / 2.6, 1 / 4.8, 1 / 3.7, 1 / 5.6, 10 / 1.5)


class Features(Protocol):
    """Interface of a backbone."""

    def __call__(self, display: torch.Tensor, depth: int) -> list[torch.Tensor]:
        """The first `depth` feature maps of display values in [0, 1]."""


def layer_weights(params: LossParams) -> tuple[float, ...]:
    """lambda_l w_l of the variant: `part`, `full` (all w = 1), `fifth` layer only, or `l1`."""
    chosen: dict[str, tuple[float, ...]] = {
        "part": params.part,
        "full": (1.0,) * 6,
        "fifth": (0.0,) * 5 + (1.0,),
        "l1": (1.0,) + (0.0,) * 5,
    }
    return tuple(a * b for a, b in zip(LAMBDA, chosen[params.kind], strict=True))


class PerceptualLoss(nn.Module):
    """Weighted L1 over the 0-255 image and the backbone's layers; 0 for equal images.

    Layers deeper than the last with a weight are not computed.
    """

    def __init__(self, backbone: Features, params: LossParams) -> None:
        super().__init__()
        self.backbone, self.weights = backbone, layer_weights(params)
        self.depth = max((i for i, weight in enumerate(self.weights) if weight), default=0)

    def forward(self, prediction: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
        """Loss of display values (N, 3, H, W), a scalar, on the scale of 0-255 images."""
        total = 255 * self.weights[0] * (prediction - truth).abs().mean()
        if self.depth == 0:
            return total
        with torch.no_grad():
            wanted = self.backbone(truth, self.depth)
        found = self.backbone(prediction, self.depth)
        for weight, ours, theirs in zip(self.weights[1:], found, wanted, strict=False):
            if weight:
                total = total + weight * (ours.float() - theirs.float()).abs().mean()
        return total
