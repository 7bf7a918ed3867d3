"""Direct U-Net: a single network from all inputs to colour.

O. Ronneberger, P. Fischer, T. Brox: *U-Net: Convolutional Networks for Biomedical Image
Segmentation*, MICCAI 2015. It has the layers of our networks (`pbrnet.model.networks.pbrnet.UNet`).
The comparison shows whether two networks with shading between them are better than one. The loss of
its paper is for classification, so it is only trained with ours.
"""

from __future__ import annotations

from pbrnet.model.networks.pbrnet import Architecture, GuidedNet

INPUTS = ("depth", "normal", "reflectance")


def build(architecture: Architecture) -> GuidedNet:
    """U-Net of `levels` resolutions with one convolution for each input, as in our networks."""
    return GuidedNet(INPUTS, architecture.width, architecture.levels, architecture.panorama)
