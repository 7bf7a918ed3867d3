"""Distortion of the image plane: of Brown and Conrady, and of Kannala and Brandt, and its inverse.

Both map a point q of an ideal image plane, at radius r, to

    q (1 + a1 r^2 + a2 r^4 + a3 r^6 + a4 r^8) / (1 + b1 r^2 + b2 r^4 + b3 r^6) + tangential part,

with OpenCV's coefficients and signs (Brown, Close-range camera calibration, 1971; Kannala and
Brandt, A generic camera model, 2006). In perspective views q is (x / z, y / z); in fisheye ones its
length is the angle from the axis, in radians, and b and the tangential part are 0.

Only sums, products, quotients and roots occur, so that all processors give the same bits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pbrnet.scenes.arrays import BoolArray, Float64Array

_STEPS = 4096  # of the search for the radius at which the image folds back
_HALVINGS = 60
_NEWTON = 20
_TOLERANCE = 1e-10  # of the plane's unit, residual of an inversion


@dataclass(frozen=True)
class Distortion:
    """Coefficients of a lens; `reach` is the largest radius on the ideal plane that it may have."""

    numerator: tuple[float, float, float, float]
    denominator: tuple[float, float, float]
    tangential: tuple[float, float]
    reach: float

    @cached_property
    def limit(self) -> float:
        """Largest ideal radius up to which the distorted one increases, at most `reach`."""
        radii = [self.reach * step / _STEPS for step in range(_STEPS + 1)]
        slopes = self.radial(np.array(radii))[1]
        folds = np.flatnonzero(slopes <= 0)
        if not len(folds):
            return self.reach
        low, high = radii[folds[0] - 1], radii[folds[0]]
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            if self.radial(np.array([middle]))[1][0] > 0:
                low = middle
            else:
                high = middle
        return low

    def radial(self, radius: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Return the distorted radius of ideal ones (...), without tangential part, and its slope.

        Both are 0 where the denominator is not positive.
        """
        scale, rate = self._scale(radius * radius)
        return radius * scale, scale + 2 * radius * radius * rate

    def distorted(self, ideal: Float64Array) -> Float64Array:
        """Map ideal points (..., 2) to the image plane."""
        x, y = ideal[..., 0], ideal[..., 1]
        p1, p2 = self.tangential
        squared = x * x + y * y
        scale, _ = self._scale(squared)
        across = x * scale + 2 * p1 * x * y + p2 * (squared + 2 * x * x)
        down = y * scale + p1 * (squared + 2 * y * y) + 2 * p2 * x * y
        return np.stack([across, down], axis=-1)

    def jacobian(self, ideal: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Return the derivatives of `distorted`, (...) each: the matrix is (xx, xy), (xy, yy)."""
        x, y = ideal[..., 0], ideal[..., 1]
        p1, p2 = self.tangential
        scale, rate = self._scale(x * x + y * y)
        mixed = 2 * (x * y * rate + p1 * x + p2 * y)
        return (
            scale + 2 * x * x * rate + 2 * p1 * y + 6 * p2 * x,
            mixed,
            scale + 2 * y * y * rate + 6 * p1 * y + 2 * p2 * x,
        )

    def ideal(self, distorted: Float64Array) -> tuple[Float64Array, BoolArray]:
        """Invert `distorted`: return ideal points (..., 2) and where there is one.

        The radius is found by Newton's method between bounds, then the tangential part by Newton's
        method in the plane. Points of the image that no ideal point within `limit` maps to are 0.
        """
        target = np.sqrt(distorted[..., 0] ** 2 + distorted[..., 1] ** 2)
        most = float(self.radial(np.array([self.limit]))[0][0])
        sought = target <= most + 4 * math.hypot(*self.tangential) * self.limit**2
        start = np.minimum(target[sought], most if not any(self.tangential) else 0.99 * most)
        found, valid = self._inverse(distorted[sought], start)
        ideal, where = np.zeros(distorted.shape), np.zeros(target.shape, dtype=bool)
        ideal[sought], where[sought] = np.where(valid[:, None], found, 0), valid
        return ideal, where

    def _inverse(
        self, distorted: Float64Array, target: Float64Array
    ) -> tuple[Float64Array, BoolArray]:
        """Return the ideal points (N, 2) and which are valid, given the distorted radii (N,)."""
        ratio = self._radius(target) / np.where(target > 0, target, 1)
        ideal = distorted * ratio[:, None]
        error = self.distorted(ideal) - distorted
        for _ in range(_NEWTON if any(self.tangential) else 0):
            if not np.abs(error).max(initial=0) > 0.01 * _TOLERANCE:
                break
            xx, xy, yy = self.jacobian(ideal)
            determinant = xx * yy - xy * xy
            determinant = np.where(determinant > 0, determinant, np.inf)  # no step
            across = (yy * error[:, 0] - xy * error[:, 1]) / determinant
            down = (xx * error[:, 1] - xy * error[:, 0]) / determinant
            ideal = ideal - np.stack([across, down], axis=-1)
            error = self.distorted(ideal) - distorted
        return ideal, self.is_valid(ideal) & (np.abs(error).max(axis=-1) <= _TOLERANCE)

    def is_valid(self, ideal: Float64Array) -> BoolArray:
        """Test which ideal points (..., 2) lie where the distortion can be inverted."""
        squared = ideal[..., 0] ** 2 + ideal[..., 1] ** 2
        xx, xy, yy = self.jacobian(ideal)
        inside: BoolArray = (squared <= self.limit**2) & (xx * yy - xy * xy > 0)
        return inside

    def _radius(self, target: Float64Array) -> Float64Array:
        """Return the ideal radius within `limit` of each distorted one (N,) of that range."""
        low, high = np.zeros_like(target), np.full_like(target, self.limit)
        radius = np.minimum(target, high)
        for _ in range(_HALVINGS):
            reached, slope = self.radial(radius)
            error = reached - target
            if not np.abs(error).max(initial=0) > 0.01 * _TOLERANCE:
                break
            low = np.where(error <= 0, radius, low)
            high = np.where(error >= 0, radius, high)
            step = radius - error / np.where(slope > 0, slope, 1)
            radius = np.where((step > low) & (step < high), step, 0.5 * (low + high))
        return radius

    def _scale(self, squared: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Return the radial factor at squared radii (...), and its derivative by them."""
        a1, a2, a3, a4 = self.numerator
        b1, b2, b3 = self.denominator
        s = squared
        above = 1 + s * (a1 + s * (a2 + s * (a3 + s * a4)))
        above_rate = a1 + s * (2 * a2 + s * (3 * a3 + s * 4 * a4))
        below = 1 + s * (b1 + s * (b2 + s * b3))
        below_rate = b1 + s * (2 * b2 + s * 3 * b3)
        known = below > 0
        below = np.where(known, below, 1)
        rate = (above_rate * below - above * below_rate) / (below * below)
        return np.where(known, above / below, 0), np.where(known, rate, 0)
