"""Directions: unit vectors, uniform points on the sphere, rays through pixels."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from scenes.arrays import Float64Array


def unit(vectors: npt.ArrayLike) -> Float64Array:
    """Normalise vectors (..., 3) to float64 unit vectors; zero vectors stay zero."""
    vectors = np.asarray(vectors, dtype=np.float64)
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0, length, 1)


def fibonacci_sphere(count: int) -> Float64Array:
    """Return unit vectors (count, 3) evenly on the sphere: a Fibonacci spiral about z."""
    index = np.arange(count)
    z = 1 - (2 * index + 1) / count
    angle = index * math.pi * (3 - math.sqrt(5))
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)


def horizontal_directions(count: int, offset: float = 0.0) -> Float64Array:
    """Unit vectors (count, 3) evenly around the horizon, `offset` steps on from +x towards +y."""
    angle = 2 * np.pi * (np.arange(count) + offset) / count
    return np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)])


def pixel_directions(intrinsics: npt.ArrayLike, width: int, height: int) -> Float64Array:
    """Return directions (H, W, 3) through the pixel centres, z = 1, in the OpenCV camera frame.

    `intrinsics` is K, (3, 3), in pixels.
    """
    inverse = np.linalg.inv(np.asarray(intrinsics, dtype=np.float64))
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    return np.stack([x, y, np.ones_like(x)], axis=-1) @ inverse.T
