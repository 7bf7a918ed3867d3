"""Directions: unit vectors, uniform points on the sphere, rays through pixels."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from pbrnet.scenes.arrays import ArrayOrTensor, Float64Array, array_namespace


def unit(vectors: npt.ArrayLike) -> Float64Array:
    """Normalise vectors (..., 3) to float64 unit vectors; zero vectors stay zero."""
    vectors = np.asarray(vectors, dtype=np.float64)
    # Written out: the order in which a library's norm adds depends on the processor.
    x, y, z = vectors[..., :1], vectors[..., 1:2], vectors[..., 2:]
    length = np.sqrt(x * x + y * y + z * z)
    return vectors / np.where(length > 0, length, 1)


def cross(first: Float64Array, second: Float64Array) -> Float64Array:
    """Cross product of two vectors (3,); `np.cross` takes twenty times as long for single ones."""
    a, b, c = first.tolist()
    x, y, z = second.tolist()
    return np.array([b * z - c * y, c * x - a * z, a * y - b * x])


def turned(vectors: npt.ArrayLike, matrix: npt.ArrayLike) -> Float64Array:
    """Multiply vectors (..., 3) by a matrix (3, 3) from the left, with the same bits everywhere.

    Matrix products of NumPy leave the order of additions to a library that chooses by processor.
    """
    vectors, matrix = np.asarray(vectors, dtype=np.float64), np.asarray(matrix, dtype=np.float64)
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    return np.stack([row[0] * x + row[1] * y + row[2] * z for row in matrix], axis=-1)


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


def equirectangular_directions(width: int) -> Float64Array:
    """Return unit directions (width / 2, width, 3) through the pixel centres of a panorama.

    In camera axes: the azimuth from the forward to the right axis is
    2 pi (column + 1/2) / width - pi, the elevation towards the camera's up is
    pi / 2 - pi (row + 1/2) / height.
    """
    pitch = 2 * math.pi / width
    azimuths = [(column + 0.5) * pitch - math.pi for column in range(width)]
    polar = [(row + 0.5) * pitch for row in range(width // 2)]
    # Python's functions: those of NumPy depend on the processor.
    around = np.array([(math.sin(angle), math.cos(angle)) for angle in azimuths])
    down = np.array([(math.sin(angle), -math.cos(angle)) for angle in polar])
    directions = np.empty((width // 2, width, 3))
    directions[..., 0] = down[:, :1] * around[:, 0]
    directions[..., 1] = down[:, 1:]
    directions[..., 2] = down[:, :1] * around[:, 1]
    return directions


def pixel_directions(intrinsics: ArrayOrTensor, width: int, height: int) -> ArrayOrTensor:
    """Return directions (H, W, 3) through the pixel centres, z = 1, in the OpenCV camera frame.

    `intrinsics` is K, (3, 3), in pixels; the result is float64.
    """
    xp = array_namespace(intrinsics)
    (focal_x, skew, centre_x), (_, focal_y, centre_y), _ = xp.asarray(intrinsics, dtype=xp.float64)
    across, down = (xp.arange(size, dtype=xp.float64) + 0.5 for size in (width, height))
    x, y = xp.meshgrid(across, down, indexing="xy")
    y = (y - centre_y) / focal_y  # in closed form: a library's inverse differs by processor
    return xp.stack([(x - centre_x - skew * y) / focal_x, y, xp.ones_like(x)], axis=-1)
