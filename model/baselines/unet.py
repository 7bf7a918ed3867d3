"""The direct U-Net: our own layers, straight from all inputs to colour.

O. Ronneberger, P. Fischer, T. Brox: *U-Net: Convolutional Networks for Biomedical Image
Segmentation*, MICCAI 2015. The trunk, with its skips, is `model.networks.pbrnet.UNet`; it is what
tells whether two networks with shading in between are better than one. Its own loss is a
classifier's, so it is trained with ours only.
"""

from __future__ import annotations

from model.networks.pbrnet import Architecture, GuidedNet

INPUTS = ("depth", "normal", "reflectance")


def build(architecture: Architecture) -> GuidedNet:
    """`levels` resolutions; a convolution of its own for each input, as the shading network has."""
    return GuidedNet(INPUTS, architecture.width, architecture.levels, architecture.panorama)
