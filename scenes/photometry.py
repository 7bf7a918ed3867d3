"""Photometry: lumens, colour temperatures and their conversion to the units of `sunsky`.

Daylight scenes take `sunsky`'s own radiance units. Outdoors at turbidity 3.5 with the sun 30
degrees up its horizontal irradiance is about 0.78 of them; taking that for about 50 klx, one
lumen per square metre is 1.6e-5 of them, so a lamp of so many lumens looks right beside daylight.

PBRS (Zhang et al., *Physically-Based Rendering for Indoor Scene Understanding Using Convolutional
Neural Networks*, CVPR 2017) has units of its own. Its release scales an environment map by 75 when
it renders (`mitsuba_render.py`) and gives bulbs the radiance 400 (`modifyLightSource.m`). With a
map of mean 1, a thousandth of both is a sky of 15 klx in `sunsky`'s units: that of a dull day.
"""

from __future__ import annotations

import math

import numpy as np

from pbrnet.scenes.arrays import as_triple
from pbrnet.scenes.color import REC709, XYZ_TO_RGB, Color

LUMEN = 1.6e-5  # radiometric power, in `sunsky`'s units x m^2, of one lumen of white light
PBRS_ENVIRONMENT, PBRS_BULB = 75.0, 400.0  # radiance, in PBRS' units
PBRS_UNIT = 1e-3  # of radiance, in `sunsky`'s units


def lamp_radiance(lumens: float, area: float, kelvin: float | None) -> Color:
    """RGB radiance of a Lambertian emitter of `lumens` over `area` square metres (one side).

    Without a colour temperature the light is white: R = G = B.
    """
    if area <= 0:
        raise ValueError(f"a lamp needs an area, got {area}")
    luminance = lumens * LUMEN / (math.pi * area)
    red, green, blue = (1.0, 1.0, 1.0) if kelvin is None else blackbody(kelvin)
    return (luminance * red, luminance * green, luminance * blue)


def blackbody(kelvin: float) -> Color:
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
    rgb = np.maximum(XYZ_TO_RGB @ xyz, 0)
    rgb /= rgb @ REC709
    return as_triple(rgb)


def color_temperature(rgb: Color) -> float:
    """Correlated colour temperature in kelvins, from 2000 to 8000, of linear Rec. 709 RGB.

    McCamy, "Correlated color temperature as an explicit function of chromaticity coordinates"
    (1992).
    """
    red, green, blue = rgb
    x = 0.4124 * red + 0.3576 * green + 0.1805 * blue
    y = 0.2126 * red + 0.7152 * green + 0.0722 * blue
    z = 0.0193 * red + 0.1192 * green + 0.9505 * blue
    total = max(x + y + z, 1e-12)
    n = (x / total - 0.3320) / (0.1858 - y / total)
    kelvin = 449 * n**3 + 3525 * n**2 + 6823.3 * n + 5520.33
    return float(np.clip(kelvin, 2000, 8000))
