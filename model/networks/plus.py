"""PBR-Net plus: light transport, corrected by a network.

Light transport (`pbrnet.pipeline.passes.transport`) gives each pixel's direct and indirect light
without the reflectance of what is seen, and the picture that follows from both. It knows lamps out
of sight, shadows and bounces. The network corrects what the computation leaves out: gloss in the
exchange of light, light behind rough glass, places between its samples, loss of energy.

For each pixel and band the network predicts logarithms of three factors, of direct light, of
indirect light and of the rest of the picture (gloss, lamps, sky), and the share of the light that
gloss adds, of light far above the view's level less: on metal in the sun a small error of the share
would else be brighter than the metal. All are 0 at first: then the output is the picture of light
transport. Light enters the network without reflectance and relative to one level for the view, so
that all lamps k times as bright give a picture k times as bright.
"""

from __future__ import annotations

import torch
from torch import nn

from pbrnet.model.data.encoding import Tensors
from pbrnet.model.networks.bands import BandNet, bounded, geometry_of, log_light
from pbrnet.model.networks.pbrnet import Architecture
from pbrnet.scenes.color import decode_srgb

SIGNALS = 4  # a band's direct light, indirect light, rest of the picture, and reflectance
MAX_LOG_FACTOR = 2.0  # bound of the predicted logarithms: a factor is at most exp(2), about 7
MAX_GLOSS = 1.0  # bound of the share of the light that gloss adds


class PlusNet(nn.Module):
    """Network from light transport to radiance; see the module."""

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        self.bands = BandNet(SIGNALS, architecture.width, architecture.levels, outputs=4)

    def forward(self, inputs: Tensors) -> torch.Tensor:
        """Tensors of `encode` with transport to linear colour float32 (N, 3, H, W), at least 0."""
        direct, indirect, color = inputs["transport"].float().split(3, dim=1)
        level = inputs["level"].float()
        reflectance = decode_srgb((inputs["reflectance"].float() + 1) / 2)
        rest = color - reflectance * (direct + indirect)
        signals = (
            log_light(direct, level),
            log_light(indirect, level),
            torch.asinh(10 * rest / level) / 3,  # may be negative at the edges of textures
            inputs["reflectance"].float(),
        )
        found = self.bands(geometry_of(inputs), torch.stack(signals, dim=2))
        more = [torch.expm1(bounded(found[:, :, k], MAX_LOG_FACTOR)) for k in range(3)]
        gloss = bounded(found[:, :, 3], MAX_GLOSS)
        added = more[0] * direct + more[1] * indirect
        light = level * (1 + (direct + indirect + added).clamp(min=0) / level).log()
        return (color + reflectance * added + more[2] * rest + gloss * light).clamp(min=0)
