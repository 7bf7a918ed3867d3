"""Texture metrics: power of fine detail, and strength of grid artefacts.

Both use one power spectrum: the mean over tiles of 32x32 pixels that overlap by half (Welch 1967),
each without its mean and under a Hann window. Upsampling layers and strided features leave
patterns of period 2, 4 or 8 pixels. Such a pattern has all its power at multiples of 1/8 cycle per
pixel, every fourth bin of 32. The window spreads a peak by one bin to either side, so the bins
halfway between the multiples are free of grid artefacts. Tiles of this size cannot distinguish the
periods 7, 8 and 9.
"""

from __future__ import annotations

import numpy as np
from scipy.signal.windows import hann

from pbrnet.scenes.arrays import AnyArray

TILE = 32
PERIOD = 8  # pixels; includes patterns of period 2 and 4
FINE = 0.25  # cycles per pixel; higher frequencies are fine detail
_SPACING = TILE // PERIOD  # bins between multiples of 1 / PERIOD
_ROUNDING = 1 / 255 / np.sqrt(12)  # RMS of quantisation to 8 bits


def detail(truth: AnyArray, image: AnyArray) -> float | None:
    """Return the power of fine detail in `image` relative to `truth`, in decibels.

    0 is the detail of the truth, below is blurred, above is noisy or sharpened. Fine detail is
    what repeats within less than four pixels, except grid patterns; detail below quantisation to
    8 bits is ignored. Both are display images (H, W, 3); None for images smaller than a tile.
    """
    if min(truth.shape[:2]) < TILE:
        return None
    chosen = _between() & (_frequency() >= FINE)
    window = _window()
    floor = _ROUNDING**2 * float((window**2).sum() / window.sum() ** 2)
    ours, theirs = (float(spectrum(picture)[chosen].mean()) + floor for picture in (image, truth))
    return 10 * float(np.log10(ours / theirs))


def grid(image: AnyArray) -> float | None:
    """Return the RMS of patterns of period 2, 4 or 8 pixels, in grey levels of 255.

    Measured is the power at multiples of 1/8 cycle per pixel, above that of the bins halfway to
    the next multiples in each direction. Edges and textures contribute a little, so compare with
    the value of the truth. `image` is a display image (H, W, 3); None if smaller than a tile.
    """
    if min(image.shape[:2]) < TILE:
        return None
    power = spectrum(image)
    half = _SPACING // 2
    around = [(np.roll(power, half, axis) + np.roll(power, -half, axis)) / 2 for axis in (0, 1)]
    # The maximum of both directions: a straight edge fills a line of the spectrum.
    standing_out = np.maximum(power - np.maximum(*around), 0)
    multiples = standing_out[::_SPACING, ::_SPACING].copy()
    multiples[0, 0] = 0
    return 255 * float(np.sqrt(multiples.sum()))


def spectrum(image: AnyArray) -> AnyArray:
    """Return the power spectrum (TILE, TILE), mean over tiles and channels, in NumPy's FFT order.

    Normalised: a wave in the centre of a bin contributes its share of the picture's variance.
    """
    tiles = np.lib.stride_tricks.sliding_window_view(
        image.astype(np.float64), (TILE, TILE), axis=(0, 1)
    )[:: TILE // 2, :: TILE // 2]
    tiles = tiles - tiles.mean(axis=(-2, -1), keepdims=True)
    window = _window()
    found = np.fft.fft2(tiles * window) / window.sum()
    return np.asarray((np.abs(found) ** 2).mean(axis=(0, 1, 2)))


def _window() -> AnyArray:
    line = hann(TILE, sym=False)
    return np.outer(line, line)


def _frequency() -> AnyArray:
    """Return the frequency of every bin, cycles per pixel, (TILE, TILE)."""
    line = np.fft.fftfreq(TILE)
    return np.hypot(line[:, None], line[None])


def _between() -> AnyArray:
    """Return the bins free of grid patterns: halfway between multiples in a direction or both."""
    line = np.arange(TILE) % _SPACING == _SPACING // 2
    return line[:, None] | line[None]
