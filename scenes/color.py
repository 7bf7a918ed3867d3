"""Colour: sRGB encoding, Rec. 709 luminance and conversion from CIE XYZ."""

from __future__ import annotations

import numpy as np

from scenes.arrays import AnyArray

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


def luminance(image: Image) -> Image:
    """Rec. 709 luminance (...) of linear RGB (..., 3), in the image's dtype."""
    return image @ REC709.astype(image.dtype)


def encode_srgb(linear: Image) -> Image:
    """Linear values in [0, 1] to sRGB in [0, 1] (IEC 61966-2-1), in the array's floating dtype."""
    exponent = linear.dtype.type(1 / 2.4)
    high = 1.055 * np.maximum(linear, 0.0031308) ** exponent - 0.055
    return np.where(linear <= 0.0031308, 12.92 * linear, high)


def decode_srgb(encoded: Image) -> Image:
    """sRGB values in [0, 1] to linear ones (IEC 61966-2-1), in the array's floating dtype."""
    exponent = encoded.dtype.type(2.4)
    high = ((np.maximum(encoded, 0.04045) + 0.055) / 1.055) ** exponent
    return np.where(encoded <= 0.04045, encoded / 12.92, high)


def decode_srgb_value(encoded: float) -> float:
    """One sRGB value in [0, 1] to its linear one, the same bits on every processor.

    Arrays take the processor's vector instructions, whose powers may differ in the last bit.
    """
    return encoded / 12.92 if encoded <= 0.04045 else ((encoded + 0.055) / 1.055) ** 2.4
