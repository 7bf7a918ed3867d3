"""Smoothing of light over pixels that see the same surface, led by its noise.

An a-trous filter (Dammertz et al. 2010): a few passes of a 5 x 5 kernel, whose taps move apart from
pass to pass. A neighbour counts if it lies in the pixel's tangent plane, has its normal, and if its
light differs by no more than noise explains (Schied et al. 2017). So shadows stay sharp where the
light is known well, and are smoothed where it is not.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

PASSES = 3
_KERNEL = (1 / 16, 1 / 4, 3 / 8, 1 / 4, 1 / 16)
_SHARPNESS = 32  # exponent of the cosine between two normals
_OFFSET = 0.01  # of the distance from the camera: scale of distances from the tangent plane
_DEVIATIONS = 4.0  # scale of differences in luminance, in standard deviations


def smooth(
    images: list[Any],
    noise: list[Any],
    normal: Any,
    position: Any,
    seen: Any,
    eye: Any,
    size: tuple[int, int],
) -> list[Any]:
    """Return smoothed images, `mi.Color3f` of W * H pixels each.

    `noise` is the variance of each image's luminance, `seen` the share of a pixel's samples that
    see a surface; `normal` and `position` are means over these.
    """
    share = dr.select(seen > 0, dr.rcp(seen), 0)
    normal, position = dr.normalize(normal * share), position * share
    normal = dr.select(seen > 0, normal, 0)
    scale = dr.rcp(_OFFSET * dr.norm(position - eye) + 1e-6)
    width, height = size
    index = dr.arange(mi.UInt32, width * height)
    column, row = mi.Int32(index % width), mi.Int32(index // width)
    for number in range(PASSES):
        step = 1 << number
        images, noise = _pass(
            images, noise, normal, position, seen, scale, (column, row), size, step
        )
        dr.eval(images, noise)
    return images


def without_fireflies(image: Any, size: tuple[int, int]) -> Any:
    """Return an image in which no pixel is brighter than the brightest of its eight neighbours.

    `image` is `mi.Color3f` of W * H pixels. A lone spike of gloss would decide on the exposure.
    """
    width, height = size
    index = dr.arange(mi.UInt32, width * height)
    column, row = mi.Int32(index % width), mi.Int32(index // width)
    own = mi.luminance(image)
    brightest = mi.Float(0)
    for across in (-1, 0, 1):
        for down in (-1, 0, 1):
            if (across, down) != (0, 0):
                x, y = column + across, row + down
                inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
                place = mi.UInt32(dr.select(inside, y * width + x, 0))
                brightest = dr.maximum(brightest, dr.gather(mi.Float, own, place, inside))
    return image * dr.select(own > brightest, brightest / own, 1)


def _pass(
    images: list[Any],
    noise: list[Any],
    normal: Any,
    position: Any,
    seen: Any,
    scale: Any,
    place: tuple[Any, Any],
    size: tuple[int, int],
    step: int,
) -> tuple[list[Any], list[Any]]:
    column, row = place
    width, height = size

    def neighbour(across: int, down: int) -> tuple[Any, Any]:
        x, y = column + across, row + down
        inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        return mi.UInt32(dr.select(inside, y * width + x, 0)), inside

    own = [mi.luminance(image) for image in images]
    limits = []
    for variance in noise:
        total, count = mi.Float(0), mi.Float(0)
        for across in (-1, 0, 1):
            for down in (-1, 0, 1):
                index, inside = neighbour(across, down)
                total += dr.gather(mi.Float, variance, index, inside)
                count += dr.select(inside, mi.Float(1), 0)
        limits.append(dr.rcp(_DEVIATIONS * dr.sqrt(total / count) + 1e-12))
    sums = [mi.Color3f(0) for _ in images]
    variances, weights = ([mi.Float(0) for _ in images] for _ in range(2))
    for down in range(5):
        for across in range(5):
            index, inside = neighbour((across - 2) * step, (down - 2) * step)
            other = dr.gather(mi.Vector3f, normal, index, inside)
            there = dr.gather(mi.Vector3f, position, index, inside)
            share = dr.gather(mi.Float, seen, index, inside)
            alike = dr.maximum(dr.dot(other, normal), 0)
            for _ in range(_SHARPNESS.bit_length() - 1):
                alike = dr.square(alike)
            apart = dr.abs(dr.dot(there - position, normal)) * scale
            kernel = _KERNEL[down] * _KERNEL[across]
            common = dr.select(inside, kernel * alike * share * dr.exp(-apart), 0)
            if (down, across) == (2, 2):
                common = mi.Float(kernel)
            for k, (image, variance) in enumerate(zip(images, noise, strict=True)):
                light = dr.gather(mi.Color3f, image, index, inside)
                differs = dr.abs(mi.luminance(light) - own[k]) * limits[k]
                weight = common * dr.exp(-differs)
                sums[k] += light * weight
                weights[k] += weight
                known = dr.gather(mi.Float, variance, index, inside)
                variances[k] += dr.square(weight) * known
    smoothed = [total / weight for total, weight in zip(sums, weights, strict=True)]
    left = [v / dr.square(weight) for v, weight in zip(variances, weights, strict=True)]
    return smoothed, left
