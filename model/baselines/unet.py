"""Direct U-Net: a single network from all inputs to colour.

O. Ronneberger, P. Fischer, T. Brox: *U-Net: Convolutional Networks for Biomedical Image
Segmentation*, MICCAI 2015. It has the layers of our networks (`pbrnet.model.networks.pbrnet.UNet`).
The comparison shows whether two networks with shading between them are better than one. The loss of
its paper is for classification, so it is only trained with ours.
"""

from __future__ import annotations

from pbrnet.model.data.encoding import input_named
from pbrnet.model.methods import METHODS
from pbrnet.model.networks.pbrnet import Architecture, GuidedNet


def build(architecture: Architecture) -> GuidedNet:
    """U-Net of `levels` resolutions with one convolution for each input, as in our networks."""
    images = tuple(name for name in METHODS["unet"].inputs if not input_named(name).whole)
    return GuidedNet(images, architecture.width, architecture.levels, architecture.panorama)
