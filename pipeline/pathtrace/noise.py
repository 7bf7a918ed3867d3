"""The blocks of a path-traced image: their mean, and how far it may be from the truth.

Blocks are independent estimates of one image. Only sums are kept, in float64, so memory does not
grow with the number of samples.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter, median_filter

from pipeline.frames import HALF_MAX, RGB, Channels
from scenes.arrays import BoolArray, Float64Array
from scenes.color import luminance

_FIREFLY_RATIO = 8.0  # times the median of the 5 x 5 pixels around
_FIREFLY_DOUBT = 0.5  # relative error from which a bright pixel is chance, not a small lamp


class Tally:
    """The blocks of one image of so many rows and columns, as they come in."""

    def __init__(self, height: int, width: int) -> None:
        self.blocks = 0
        self.total = np.zeros((height, width, 3))
        self.finite = np.zeros((height, width))  # blocks in which the pixel was finite
        # Of their luminance, not below 0: the mean, and the sum of squares around it, updated
        # as Welford did (1962), for which equal blocks differ by exactly 0.
        self.mean = np.zeros((height, width))
        self.squares = np.zeros((height, width))

    def add(self, pixels: Float64Array) -> None:
        """Add a block's mean radiance, (H, W, 3)."""
        sound = np.asarray(np.isfinite(pixels).all(axis=-1))
        pixels = np.where(sound[..., None], pixels, 0)
        self.blocks += 1
        self.total += pixels
        self.finite += sound
        lum = np.maximum(luminance(pixels), 0)
        step = np.where(sound, lum - self.mean, 0)
        self.mean += step / np.maximum(self.finite, 1)
        self.squares += step * np.where(sound, lum - self.mean, 0)

    def relative_error(self) -> Float64Array:
        """Relative standard error of each pixel's mean luminance, (H, W).

        sqrt(s² / B) / (m + δ), where m and s² are mean and variance of the pixel's B finite
        blocks and δ is 1 % of the image's mean, so that darkness does not count as noise.
        Radiance is not negative, so a single block that holds all the light gives 1, the largest
        value possible: no firefly can dominate the view's noise. A pixel that no light has
        reached yet is as unsure as the least sure of the 5 x 5 around it: it is either black or
        in grain too coarse to have hit it. With one block, neighbouring pixels stand in.
        """
        if self.blocks == 1:
            beside = Tally(*self.mean.shape)
            for image in (self.mean, np.roll(self.mean, 1, axis=1)):
                beside.add(np.repeat(image[..., None], 3, axis=-1))
            return beside.relative_error() * np.sqrt(2)
        variance = self.squares / np.maximum(self.finite * (self.finite - 1), 1)
        safe = self.mean + 0.01 * self.mean.mean()
        error = np.where(safe > 0, np.sqrt(variance) / np.where(safe > 0, safe, 1), 0)
        return np.where(self.mean == 0, maximum_filter(error, size=5, mode="nearest"), error)

    def noise(self) -> float:
        """Root mean square of `relative_error` over the pixels."""
        return float(np.sqrt(np.mean(self.relative_error() ** 2)))

    def image(self) -> Channels:
        """The mean radiance, not below 0: `R`, `G`, `B`, float32 (H, W)."""
        mean = np.maximum(self._mean(), 0)
        return {name: mean[..., i].astype(np.float32) for i, name in enumerate(RGB)}

    def statistics(self) -> dict[str, Any]:
        """What is known of the image; see `pipeline.passes.groundtruth.render_truth`."""
        mean = self._mean()
        lum = luminance(np.maximum(mean, 0))
        fireflies = fireflies_in(lum, self.relative_error())
        return {
            "blocks": self.blocks,
            "noise": self.noise(),
            "nan_pixels": int((self.finite < self.blocks).sum()),
            "lost_pixels": int((self.finite == 0).sum()),
            "negative_pixels": int((mean < 0).any(axis=-1).sum()),
            "black": float((lum == 0).mean()),
            "blown": float((mean.max(axis=-1) >= HALF_MAX / 2).mean()),
            "fireflies": float(fireflies.mean()),
            "firefly_light": firefly_light(lum, fireflies),
        }

    def _mean(self) -> Float64Array:
        return np.asarray(self.total / np.maximum(self.finite, 1)[..., None])


def fireflies_in(lum: Float64Array, error: Float64Array) -> BoolArray:
    """Pixels far brighter than all around, (H, W), that are so by chance: their `error`, relative,
    is large."""
    around = median_filter(lum, size=5, mode="nearest")
    floor = 0.01 * lum.mean()
    bright: BoolArray = lum > _FIREFLY_RATIO * (around + floor)
    return bright & (error > _FIREFLY_DOUBT)


def firefly_light(lum: Float64Array, fireflies: BoolArray) -> float:
    """Share of all light in the brightest fireflies: little in grain, all of it where a material
    or a path goes wrong and outshines the room."""
    few = -(-lum.size // 1000)
    return float(np.sort(lum[fireflies])[-few:].sum() / max(lum.sum(), np.finfo(float).tiny))
