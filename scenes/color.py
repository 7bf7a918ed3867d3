"""Colour: sRGB encoding, Rec. 709 luminance and conversion from CIE XYZ."""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.arrays import AnyArray, ArrayOrTensor, array_namespace

Color = tuple[float, float, float]  # linear Rec. 709 RGB
REC709 = np.array([0.2126, 0.7152, 0.0722])  # luminance of linear RGB
XYZ_TO_RGB = np.array(  # CIE XYZ to linear Rec. 709 RGB (ITU-R BT.709, D65)
    [
        [3.2404542, -1.5371385, -0.4985314],
        [-0.9692660, 1.8760108, 0.0415560],
        [0.0556434, -0.2040259, 1.0572252],
    ]
)
Image = AnyArray  # any floating dtype


def luminance(image: ArrayOrTensor) -> ArrayOrTensor:
    """Rec. 709 luminance (...) of linear RGB (..., 3), in the image's dtype."""
    xp = array_namespace(image)
    return image @ xp.asarray(REC709, dtype=image.dtype)


def encode_srgb(linear: ArrayOrTensor) -> ArrayOrTensor:
    """Linear values in [0, 1] to sRGB in [0, 1] (IEC 61966-2-1), in the array's floating dtype."""
    xp = array_namespace(linear)
    high = 1.055 * xp.clip(linear, 0.0031308, None) ** (1 / 2.4) - 0.055
    return xp.where(linear <= 0.0031308, 12.92 * linear, high)


def decode_srgb(encoded: ArrayOrTensor) -> ArrayOrTensor:
    """sRGB values in [0, 1] to linear ones (IEC 61966-2-1), in the array's floating dtype."""
    xp = array_namespace(encoded)
    high = ((xp.clip(encoded, 0.04045, None) + 0.055) / 1.055) ** 2.4
    return xp.where(encoded <= 0.04045, encoded / 12.92, high)


def decode_srgb_value(encoded: float) -> float:
    """One sRGB value in [0, 1] to its linear one, the same bits on every processor.

    Arrays take the processor's vector instructions, whose powers may differ in the last bit.
    """
    return encoded / 12.92 if encoded <= 0.04045 else ((encoded + 0.055) / 1.055) ** 2.4
