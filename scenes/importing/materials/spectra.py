"""Conversion of measured and blackbody spectra to linear RGB."""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.color import XYZ_TO_RGB

_GRID = np.arange(380.0, 781.0, 2.0)  # wavelengths, nm


def color_matching(wavelengths: Float64Array) -> Float64Array:
    """CIE 1931 colour matching functions at `wavelengths` (N,) in nm, XYZ (N, 3).

    Multi-lobe fit of Wyman, Sloan and Shirley, *Simple Analytic Approximations to the CIE XYZ
    Color Matching Functions* (2013).
    """

    def lobe(mean: float, below: float, above: float) -> Float64Array:
        offset = wavelengths - mean
        width = np.where(offset < 0, below, above)
        return np.asarray(np.exp(-0.5 * (offset / width) ** 2))

    x = 1.056 * lobe(599.8, 37.9, 31.0) + 0.362 * lobe(442.0, 16.0, 26.7)
    x -= 0.065 * lobe(501.1, 20.4, 26.2)
    y = 0.821 * lobe(568.8, 46.9, 40.5) + 0.286 * lobe(530.9, 16.3, 31.1)
    z = 1.217 * lobe(437.0, 11.8, 36.0) + 0.681 * lobe(459.0, 26.0, 13.8)
    return np.stack([x, y, z], axis=1)


def spectrum_to_rgb(wavelengths: Float64Array, values: Float64Array) -> Float64Array:
    """Linear Rec. 709 RGB (3,) of a spectrum `values` (N,) at increasing `wavelengths` (N,), nm.

    A constant spectrum becomes grey of the same value. A spectrum is zero outside its samples,
    and colours out of gamut are clipped at zero.
    """
    sampled = np.interp(_GRID, wavelengths, values, left=0.0, right=0.0)
    observer = color_matching(_GRID)
    rgb = XYZ_TO_RGB @ (sampled @ observer)
    white = XYZ_TO_RGB @ observer.sum(axis=0)
    return np.maximum(rgb / white, 0.0)


def blackbody_radiance(kelvin: float) -> float:
    """Luminance-weighted mean spectral radiance of a black body, W / (m^2 sr nm).

    Planck's law averaged with the CIE Y curve, as Mitsuba 0.x converts `<blackbody>`.
    """
    metres = _GRID * 1e-9
    c1, c2 = 1.191042972e-16, 1.438776877e-2
    planck = c1 / metres**5 / np.expm1(c2 / (metres * kelvin)) * 1e-9
    response = color_matching(_GRID)[:, 1]
    return float((planck * response).sum() / response.sum())
