"""Block statistics of a path-traced image: mean, noise estimate, fireflies.

Blocks are independent estimates of one image. Only running sums are kept, in float64, so memory
does not grow with the number of samples.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter, median_filter

from pbrnet.pipeline.channels import HALF_MAX, RGB
from pbrnet.pipeline.frames import Channels
from pbrnet.scenes.arrays import BoolArray, Float64Array
from pbrnet.scenes.color import luminance

_FIREFLY_RATIO = 8.0  # times the median of the 5 x 5 pixels around
_FIREFLY_ERROR = 0.5  # least relative error of a firefly; below, it is a small lamp


class BlockStatistics:
    """Running statistics over the blocks of one image, (height, width)."""

    def __init__(self, height: int, width: int) -> None:
        self.blocks = 0
        self.total = np.zeros((height, width, 3))
        self.finite = np.zeros((height, width))  # blocks in which the pixel was finite
        # Mean of the luminance, clamped to 0 from below, and sum of squares around it, by Welford's
        # update (1962): equal blocks then have a variance of exactly 0.
        self.mean = np.zeros((height, width))
        self.squares = np.zeros((height, width))
        # Of every second block, from the first: an image of half of the samples.
        self.half_total = np.zeros((height, width, 3))
        self.half_finite = np.zeros((height, width))

    def add(self, pixels: Float64Array) -> None:
        """Add a block's mean radiance, linear RGB (H, W, 3)."""
        sound = np.asarray(np.isfinite(pixels).all(axis=-1))
        pixels = np.where(sound[..., None], pixels, 0)
        self.blocks += 1
        self.total += pixels
        self.finite += sound
        if self.blocks % 2:
            self.half_total += pixels
            self.half_finite += sound
        lum = np.maximum(luminance(pixels), 0)
        step = np.where(sound, lum - self.mean, 0)
        self.mean += step / np.maximum(self.finite, 1)
        self.squares += step * np.where(sound, lum - self.mean, 0)

    def relative_error(self) -> Float64Array:
        """Return the relative standard error of each pixel's mean luminance, (H, W).

        sqrt(s² / B) / (m + δ), where m and s² are mean and variance of the pixel's B finite
        blocks and δ is 1 % of the image's mean, so that darkness does not count as noise.
        Radiance is not negative, so a single block that holds all the light gives 1, the largest
        possible value: no firefly can dominate the view's noise. A pixel without any light gets
        the largest error of the 5 x 5 pixels around it: it is either black or undersampled. With
        one block, differences between neighbouring pixels replace those between blocks.
        """
        if self.blocks == 1:
            neighbours = BlockStatistics(*self.mean.shape)
            for image in (self.mean, np.roll(self.mean, 1, axis=1)):
                neighbours.add(np.repeat(image[..., None], 3, axis=-1))
            return neighbours.relative_error() * np.sqrt(2)
        variance = self.squares / np.maximum(self.finite * (self.finite - 1), 1)
        safe = self.mean + 0.01 * self.mean.mean()
        error = np.where(safe > 0, np.sqrt(variance) / np.where(safe > 0, safe, 1), 0)
        return np.where(self.mean == 0, maximum_filter(error, size=5, mode="nearest"), error)

    def noise(self) -> float:
        """Return the root mean square of `relative_error` over the pixels."""
        return _root_mean_square(self.relative_error())

    def image(self) -> Channels:
        """Return the mean radiance, clamped to 0 from below: `R`, `G`, `B`, float32 (H, W)."""
        return _clamped(self._mean())

    def half_image(self) -> Channels | None:
        """Return `image` of every second block, or None if there is only one block."""
        if self.blocks < 2:
            return None
        return _clamped(self.half_total / np.maximum(self.half_finite, 1)[..., None])

    def statistics(self) -> dict[str, float]:
        """Return the statistics that `passes.groundtruth.render_truth` documents."""
        mean = self._mean()
        lum = luminance(np.maximum(mean, 0))
        error = self.relative_error()
        fireflies = fireflies_in(lum, error)
        return {
            "blocks": self.blocks,
            "noise": _root_mean_square(error),
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


def _root_mean_square(values: Float64Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _clamped(mean: Float64Array) -> Channels:
    mean = np.maximum(mean, 0)
    return {name: mean[..., i].astype(np.float32) for i, name in enumerate(RGB)}


def residual_noise(whole: Channels, half: Channels, blocks: int) -> float:
    """Return the noise that a filter leaves in an image of so many blocks, 2 or more.

    `whole` and `half` are the filtered images of all blocks and of every second one. For a linear
    filter the difference of the two has the variance of the filtered whole, times the other blocks
    over the half's. Relative, as `BlockStatistics.noise`: root mean square over the pixels, where
    darkness below 1 % of the mean does not count. What the filter does to both, its bias, is not
    in it.
    """
    first, second = (
        luminance(np.stack([image[name] for name in RGB], axis=-1).astype(np.float64))
        for image in (whole, half)
    )
    used = -(-blocks // 2)
    safe = first + 0.01 * first.mean()
    error = np.where(safe > 0, (first - second) / np.where(safe > 0, safe, 1), 0)
    return float(np.sqrt(np.mean(error**2) * used / (blocks - used)))


def fireflies_in(lum: Float64Array, error: Float64Array) -> BoolArray:
    """Return the mask (H, W) of pixels far brighter than their surroundings by chance.

    By chance means that their relative error `error` (H, W) is large.
    """
    around = median_filter(lum, size=5, mode="nearest")
    floor = 0.01 * lum.mean()
    bright: BoolArray = lum > _FIREFLY_RATIO * (around + floor)
    return bright & (error > _FIREFLY_ERROR)


def firefly_light(lum: Float64Array, fireflies: BoolArray) -> float:
    """Return the share of all light that lies in the brightest fireflies.

    It is small in evenly noisy images, and near 1 where a faulty material or path outshines the
    room. The brightest are at most a thousandth of the pixels.
    """
    few = -(-lum.size // 1000)
    return float(np.sort(lum[fireflies])[-few:].sum() / max(lum.sum(), np.finfo(float).tiny))
