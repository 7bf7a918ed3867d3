"""Display images: linear radiance as an automatic camera would photograph it.

Metering, white balance and tone curve follow cameras, so that images have the contrast, the clipped
windows and the dark nights of photographs. Networks are trained and evaluated with Reinhard's
operator in `pbrnet.pipeline.tonemap` instead; nothing here changes a stored channel.

* **Exposure**: the log-average luminance becomes middle grey, except for a part of the difference
  from a room by day (`_ADAPTATION`), so that nights stay darker, as with the exposure program of a
  camera. Where much would clip, exposure is lowered by at most `_PROTECTION` stops.
* **White balance**: gains of the bands towards a grey illuminant, which is estimated as a
  Minkowski mean ("shades of grey", Finlayson and Trezzi 2004) and mostly corrected: an image
  by lamplight stays a little warm.
* **Sharpening**: an unsharp mask of the luminance with a radius of `SHARPENING_RADIUS` pixels, in
  display tones, with which cameras compensate for lenses and colour filters, and which here
  compensates for the box filter of a pixel. Halos are limited to `_HALO`.
* **Curve**: a separate sigmoid of each band (Naka and Rushton 1966) that keeps middle grey and
  reaches white, where a sensor clips, `WHITE_STOPS` above it, so bright colours turn pale.

`varied_photograph` adds random differences between cameras and shots, for networks that are trained
on rendered views and used on photographs. Call it when rows are read.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import ndimage

from pbrnet.pipeline.channels import RADIANCE, TINT, column_channel
from pbrnet.pipeline.images import (
    Picture,
    depth_picture,
    flow_picture,
    intensity_picture,
    jpeg_bytes,
    label_picture,
    normal_picture,
    read_picture,
    reflectance_picture,
    share_picture,
    tint_picture,
)
from pbrnet.pipeline.tonemap import block_means, to_bytes
from pbrnet.scenes.arrays import Float32Array, Float64Array, FloatingArray, UInt8Array
from pbrnet.scenes.color import encode_srgb, luminance
from pbrnet.scenes.photometry import LUMEN
from pbrnet.scenes.seeds import generator

GREY = 0.18  # linear display value of middle grey
WHITE_STOPS = 3.6  # from middle grey to the exposed radiance that clips
_KEY = 0.16  # exposed log-average luminance of a room by day; a mean of about `GREY`
_DAYLIT = 40.0 * LUMEN  # log-average luminance of a room by day: 40 candelas a square metre
_ADAPTATION = 0.75  # share of the difference to such a room that exposure makes up for
_DIMMEST, _BRIGHTEST = -1.6, 0.4  # stops, most that the rest of it may do
_CLIPPED = 0.05  # share of the pixels that may clip before exposure is lowered
_PROTECTION = 0.6  # stops, most that exposure is lowered for them
_MINKOWSKI = 2.0
_BALANCE = 0.75  # share of the illuminant's colour, in logarithms, that is corrected
_MOST_GAIN = 4.0  # of a band relative to luminance
_CONTRAST = 1.35  # exponent of the curve
SHARPENING = 1.0  # amount of the unsharp mask
SHARPENING_RADIUS = 0.8  # standard deviation of its blur, pixels
_HALO = 0.1  # of the range of display tones, most that it changes
_TONES = 2.2  # exponent of the display tones in which it works

# What `photograph` computes, for the dataset's card: of radiance r in the renderer's unit, with
# luminance L.
FORMULA = f"""\
white = {GREY} * 2^{WHITE_STOPS}
A     = exp(mean(log(L(B))))       B: means over blocks of 8 x 8 pixels, without black ones
gain  = {_KEY} / A * 2^clip({1 - _ADAPTATION:g} * log2(A / {_DAYLIT:.4g}), {_DIMMEST}, {_BRIGHTEST})
gain  = gain / clip(q, 1, 2^{_PROTECTION})   q: quantile {1 - _CLIPPED:g} of L(r) * gain / white
I     = sqrt(mean((gain * B)^2))   over the B with all bands of gain * B below white
g     = clip((L(I) / max(I, L(I) / 1000))^{_BALANCE}, {1 / _MOST_GAIN:g}, {_MOST_GAIN:g})
g     = g * L(I) / L(g * I)
t     = min(gain * L(r) / white, 1)^(1 / {_TONES})
r     = r * ((t + clip(t - blur(t), -{_HALO}, {_HALO})) / t)^{_TONES}   where 0 < t < 1
x     = min(gain * g * r, white)^{_CONTRAST}
m, k  = white^{_CONTRAST}, {GREY}^{_CONTRAST}
h     = {1 - GREY:g} * m * k / ({GREY} * m - k)
y     = (1 + h / m) * x / (x + h)"""


@dataclass(frozen=True)
class PhotoSettings:
    """Settings of an automatic camera for one picture."""

    gain: float  # exposed value of radiance 1
    balance: tuple[float, float, float] = (1.0, 1.0, 1.0)  # gains of the bands, luminance kept
    contrast: float = _CONTRAST  # exponent of the curve
    sharpening: float = SHARPENING  # amount of the unsharp mask; 0: none


def meter(image: FloatingArray) -> PhotoSettings:
    """Return the settings of an automatic camera for linear radiance (H, W, 3).

    Radiance is in the renderer's unit (`pbrnet.scenes.photometry`): it decides how dark a night is.
    An image of another unit is exposed within two stops of what it would be. An all-black image has
    gain 1.
    """
    pixels = _radiance(image).astype(np.float64)
    blocks = np.stack([block_means(pixels[..., band]) for band in range(3)], axis=-1)
    lit = blocks[luminance(blocks) > 0]
    if not len(lit):
        return PhotoSettings(1.0)
    average = math.exp(math.fsum(np.log(luminance(lit)).tolist()) / len(lit))
    stops = (1 - _ADAPTATION) * math.log2(average / _DAYLIT)
    gain = _KEY / average * 2 ** min(max(stops, _DIMMEST), _BRIGHTEST)
    white = GREY * 2**WHITE_STOPS
    bright = float(np.quantile(luminance(pixels), 1 - _CLIPPED)) * gain / white
    gain /= min(max(bright, 1.0), 2**_PROTECTION)
    unclipped = lit[lit.max(axis=1) * gain < white]
    return PhotoSettings(gain, _balance(unclipped * gain) if len(unclipped) else (1.0, 1.0, 1.0))


def develop(image: FloatingArray, settings: PhotoSettings) -> Float32Array:
    """Map linear radiance (..., 3) to display values: balanced, exposed, sRGB-encoded, [0, 1]."""
    gains = (settings.gain * np.array(settings.balance)).astype(np.float32)
    white = GREY * 2**WHITE_STOPS
    exposed = np.minimum(_radiance(image) * gains, np.float32(white))
    # y = a x^p / (x^p + c) with y(GREY) = GREY and y(white) = 1
    grey, most = GREY**settings.contrast, white**settings.contrast
    half = (1 - GREY) * most * grey / (GREY * most - grey)
    power = exposed ** np.float32(settings.contrast)
    curve = power / (power + np.float32(half)) * np.float32((most + half) / most)
    display: Float32Array = encode_srgb(np.clip(curve, 0, 1)).astype(np.float32)
    return display


def photograph(image: FloatingArray, settings: PhotoSettings | None = None) -> UInt8Array:
    """Photograph linear radiance (H, W, 3), by its own settings unless given; uint8 sRGB."""
    settings = meter(image) if settings is None else settings
    return to_bytes(develop(sharpened(image, settings), settings))


def channel_picture(name: str, row: Mapping[str, Any]) -> Picture:
    """Draw an image column of a row, as its channel says what it is; colours are photographed."""
    channel, image = column_channel(name), row[name]
    valid = None if channel.is_panorama else row["valid"]
    if channel.is_label:
        return label_picture(image)
    if channel.is_direction:
        return normal_picture(image, valid)
    if channel.unit == "metre":
        return depth_picture(image, valid)
    if channel.unit == RADIANCE:
        return photograph(image) if channel.shape else intensity_picture(image)
    if channel.bands == TINT:
        return tint_picture(image)
    if channel.shape == (2,):
        return flow_picture(image)
    return reflectance_picture(image) if channel.shape else share_picture(image)


def sharpened(image: FloatingArray, settings: PhotoSettings) -> Float32Array:
    """Return linear radiance (H, W, 3) whose luminance is sharpened as by a camera.

    Colours keep their ratios. What clips, and what is black, stays as it is.
    """
    light = _radiance(image)
    if not settings.sharpening:
        return light
    white = GREY * 2**WHITE_STOPS
    exposed = luminance(light.astype(np.float64)) * settings.gain
    tone = np.minimum(exposed / white, 1.0) ** (1 / _TONES)
    detail = tone - ndimage.gaussian_filter(tone, SHARPENING_RADIUS, mode="nearest")
    added = np.clip(settings.sharpening * detail, -_HALO, _HALO)
    ratio = np.maximum(tone + added, 0) / np.where(tone > 0, tone, 1.0)
    factor = np.where((tone > 0) & (tone < 1), ratio**_TONES, 1.0)
    return light * factor[..., None].astype(np.float32)


@dataclass(frozen=True)
class PhotoVariation:
    """Ranges of variation between photographs, drawn uniformly; (0, 0) switches one off.

    Exposure and contrast are such that brightness, contrast and chroma of the quick start's views
    are spread as those of NYU Depth v2's training photographs.
    """

    exposure: tuple[float, float] = (-0.6, 1.2)  # stops beside the meter
    warmth: tuple[float, float] = (-0.25, 0.25)  # logarithm of red over blue beside the balance
    contrast: tuple[float, float] = (1.3, 2.6)  # exponent of the curve
    vignetting: tuple[float, float] = (0.0, 0.35)  # share of the light that the corners lose
    noise: tuple[float, float] = (0.0, 0.03)  # standard deviation at middle grey, relative
    blur: tuple[float, float] = (0.0, 0.8)  # standard deviation, pixels
    quality: tuple[int, int] = (70, 98)  # of JPEG; (0, 0): none


def varied_photograph(
    image: FloatingArray, seed: int, variation: PhotoVariation | None = None
) -> UInt8Array:
    """Photograph linear radiance (H, W, 3) with variation drawn from `seed`; uint8 sRGB.

    Geometry does not change, so labels and depth still fit. Equal seeds give equal pictures.
    """
    ranges = variation or PhotoVariation()
    rng = generator(seed, "photograph")
    stops, warmth, contrast, vignetting, noise, blur = (
        float(rng.uniform(low, high))
        for low, high in (
            ranges.exposure,
            ranges.warmth,
            ranges.contrast,
            ranges.vignetting,
            ranges.noise,
            ranges.blur,
        )
    )
    radiance = _radiance(image)
    metered = meter(radiance)
    red, green, blue = metered.balance
    balance = (red * math.exp(warmth / 2), green, blue * math.exp(-warmth / 2))
    settings = replace(
        metered, gain=metered.gain * 2**stops, balance=balance, contrast=contrast or _CONTRAST
    )
    light = (
        sharpened(radiance, settings) * (1 - vignetting * _corners(*radiance.shape[:2]))[..., None]
    )
    if blur:
        light = ndimage.gaussian_filter(light, (blur, blur, 0), mode="nearest")
    # Shot noise: its variance grows with the light. Dark parts keep a tenth of middle grey's.
    deviation = noise * np.sqrt(np.maximum(light * settings.gain, 0.1 * GREY) * GREY)
    noisy = light + deviation / settings.gain * rng.standard_normal(light.shape)
    picture = photograph(noisy, replace(settings, sharpening=0.0))
    low, high = ranges.quality
    if not high:
        return picture
    return read_picture(jpeg_bytes(picture, int(rng.integers(low, high + 1))))


def _corners(height: int, width: int) -> Float64Array:
    """Return the squared distance from the middle of an image, 1 in its corners, (H, W)."""
    y = (np.arange(height) + 0.5) / height * 2 - 1
    x = (np.arange(width) + 0.5) / width * 2 - 1
    aspect = width / height
    squared: Float64Array = ((x * aspect) ** 2 + (y**2)[:, None]) / (aspect**2 + 1)
    return squared


def _radiance(image: FloatingArray) -> Float32Array:
    """Return finite values >= 0: a sky may be slightly negative, a damaged frame hold anything."""
    most = np.float32(1e30)
    values = np.asarray(image, dtype=np.float32)
    return np.clip(np.where(np.isnan(values), np.float32(0), values), 0, most)


def _balance(exposed: Float64Array) -> tuple[float, float, float]:
    """Return gains of the bands for exposed colours (N, 3), none of them clipped."""
    illuminant = np.mean(exposed**_MINKOWSKI, axis=0) ** (1 / _MINKOWSKI)
    level = float(luminance(illuminant))
    gains = (level / np.maximum(illuminant, 1e-3 * level)) ** _BALANCE
    gains = np.clip(gains, 1 / _MOST_GAIN, _MOST_GAIN)
    red, green, blue = gains * (level / float(luminance(illuminant * gains)))
    return float(red), float(green), float(blue)
