"""Lamps beside daylight: lumens, colour temperatures and the units of Mitsuba's `sunsky`.

Daylight scenes take `sunsky`'s own radiance units. Outdoors at turbidity 3.5 with the sun 30
degrees up its horizontal irradiance is about 0.78 of them; taking that for about 50 klx, one
lumen per square metre is 1.6e-5 of them, so a lamp of so many lumens looks right beside daylight.
"""

from __future__ import annotations

import math

import numpy as np

Color = tuple[float, float, float]  # linear Rec. 709 RGB
REC709 = np.array([0.2126, 0.7152, 0.0722])  # luminance of linear RGB
LUMEN = 1.6e-5  # radiometric power, in `sunsky`'s units x m^2, of one lumen of white light


def lamp_radiance(lumens: float, area: float, kelvin: float) -> tuple[float, float, float]:
    """RGB radiance of a Lambertian emitter of `lumens` over `area` square metres (one side)."""
    if area <= 0:
        raise ValueError(f"a lamp needs an area, got {area}")
    luminance = lumens * LUMEN / (math.pi * area)
    red, green, blue = blackbody(kelvin)
    return (luminance * red, luminance * green, luminance * blue)


def blackbody(kelvin: float) -> tuple[float, float, float]:
    """Linear Rec. 709 RGB of a black body, scaled to luminance 1, clipped to be non-negative.

    Chromaticity by Kim et al.'s cubic fit of the Planckian locus, 1667 K to 25000 K.
    """
    t = 1e3 / min(max(kelvin, 1667.0), 25000.0)
    if kelvin <= 4000:
        x = -0.2661239 * t**3 - 0.2343589 * t**2 + 0.8776956 * t + 0.179910
    else:
        x = -3.0258469 * t**3 + 2.1070379 * t**2 + 0.2226347 * t + 0.240390
    if kelvin <= 2222:
        y = -1.1063814 * x**3 - 1.34811020 * x**2 + 2.18555832 * x - 0.20219683
    elif kelvin <= 4000:
        y = -0.9549476 * x**3 - 1.37418593 * x**2 + 2.09137015 * x - 0.16748867
    else:
        y = 3.0817580 * x**3 - 5.87338670 * x**2 + 3.75112997 * x - 0.37001483
    xyz = np.array([x / y, 1.0, (1 - x - y) / y])
    to_rgb = np.array(
        [
            [3.2404542, -1.5371385, -0.4985314],
            [-0.9692660, 1.8760108, 0.0415560],
            [0.0556434, -0.2040259, 1.0572252],
        ]
    )
    rgb = np.maximum(to_rgb @ xyz, 0)
    rgb /= rgb @ REC709
    return (float(rgb[0]), float(rgb[1]), float(rgb[2]))
