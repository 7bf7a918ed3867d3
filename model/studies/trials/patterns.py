"""What a loss does to the texture of a picture: how blurred it is, and whether it shows a grid.

Both are read off one power spectrum, averaged over tiles of 32x32 pixels that overlap by half
(Welch 1967), each without its mean and under a Hann window. A pattern that repeats every 2, 4 or
8 pixels, which is what doubling layers and strided features leave behind, has all its power at
the frequencies that are multiples of 1/8 cycle a pixel: every fourth bin of 32. Under this window
such a peak reaches one bin to either side and no farther, so the bins halfway between the multiples
hold the picture alone. What tiles this small cannot tell from 8 pixels are 7 and 9.
"""

from __future__ import annotations

import numpy as np
from scipy.signal.windows import hann

from scenes.arrays import AnyArray

TILE = 32
PERIOD = 8  # pixels; a pattern of 4 or 2 repeats after 8 too
FINE = 0.25  # cycles a pixel: waves shorter than four pixels are fine detail
_SPACING = TILE // PERIOD  # bins between two multiples of 1 / PERIOD
_ROUNDING = 1 / 255 / np.sqrt(12)  # what storing a picture in 8 bits adds to it, RMS


def detail(truth: AnyArray, image: AnyArray) -> float | None:
    """Power of the fine detail of `image` relative to that of `truth`, in decibels.

    0: as much as the truth has; below: blurred; above: noise or sharpening. Counted are waves
    shorter than four pixels, without those of a grid. Detail finer than the steps of 8 bits does
    not count. Both are display images (H, W, 3); None for pictures smaller than a tile.
    """
    if min(truth.shape[:2]) < TILE:
        return None
    chosen = _between() & (_frequency() >= FINE)
    window = _window()
    floor = _ROUNDING**2 * float((window**2).sum() / window.sum() ** 2)
    ours, theirs = (float(spectrum(picture)[chosen].mean()) + floor for picture in (image, truth))
    return 10 * float(np.log10(ours / theirs))


def grid(image: AnyArray) -> float | None:
    """Strength of a pattern that repeats every 2, 4 or 8 pixels: its RMS in grey levels of 255.

    The power at the multiples of 1/8 cycle a pixel, as far as it stands out from the bins halfway
    to the next multiples in each direction. Edges and textures of a good picture leave a little
    too: compare with the truth's. `image` is a display image (H, W, 3); None if it is smaller
    than a tile.
    """
    if min(image.shape[:2]) < TILE:
        return None
    power = spectrum(image)
    half = _SPACING // 2
    around = [(np.roll(power, half, axis) + np.roll(power, -half, axis)) / 2 for axis in (0, 1)]
    # The stronger direction: a straight edge fills a line of the spectrum, and is no grid.
    standing_out = np.maximum(power - np.maximum(*around), 0)
    multiples = standing_out[::_SPACING, ::_SPACING].copy()
    multiples[0, 0] = 0
    return 255 * float(np.sqrt(multiples.sum()))


def spectrum(image: AnyArray) -> AnyArray:
    """Power (TILE, TILE), mean over tiles and channels; bins as NumPy's FFT orders them.

    Normalised so that a wave in the centre of a bin has there its share of the picture's variance.
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
    """Cycles a pixel of every bin, along its direction."""
    line = np.fft.fftfreq(TILE)
    return np.hypot(line[:, None], line[None])


def _between() -> AnyArray:
    """The bins that no grid reaches: halfway between two multiples in one direction or both."""
    line = np.arange(TILE) % _SPACING == _SPACING // 2
    return line[:, None] | line[None]
