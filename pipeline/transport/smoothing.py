"""Smoothing of light over pixels that see the same surface, led by its noise.

An a-trous filter (Dammertz et al. 2010): a few passes of a 5 x 5 kernel, whose taps move apart from
pass to pass. A neighbour counts if it lies in the pixel's tangent plane, has its normal, and if its
light differs by no more than noise explains (Schied et al. 2017). So shadows stay sharp where the
light is known well, and are smoothed where it is not.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

PASSES = 3
_KERNEL = (1 / 16, 1 / 4, 3 / 8, 1 / 4, 1 / 16)
_SHARPNESS = 8  # exponent of the cosine between two normals
_OFFSET = 0.03  # of the distance from the camera: scale of distances from the tangent plane
_DEVIATIONS = 4.0  # scale of differences in luminance, in standard deviations


def smooth(
    images: list[mi.Color3f],
    noise: list[mi.Float],
    surfaces: tuple[mi.Vector3f, mi.Vector3f, mi.Float],
    lit: mi.Float,
    eye: mi.Vector3f,
    size: tuple[int, int],
) -> list[mi.Color3f]:
    """Return smoothed images, `mi.Color3f` of W * H pixels each.

    `noise` is the variance of each image's luminance. `surfaces` are means of normal and position
    over a pixel's camera rays, and the share of these that see a surface; `lit` is that share of
    the rays that found the light.
    """
    normal, position, seen = surfaces
    share = dr.select(seen > 0, dr.rcp(seen), 0)
    # Normals of a thin edge may cancel: such a pixel has no neighbour but itself.
    normal = dr.select(dr.squared_norm(normal) > 0, dr.normalize(normal * share), 0)
    position = position * share
    scale = dr.rcp(_OFFSET * dr.norm(position - eye) + 1e-6)
    taps = _Taps(normal, position, scale, lit, size)
    # Guided by single pixels' noisy light, the filter would follow the noise: few samples are
    # bright, and pixels without one would keep to themselves. So the first pass compares means.
    own, variance = _guides(taps, [mi.luminance(image) for image in images], noise)
    for number in range(PASSES):
        images, noise = _pass(taps, images, noise, own, variance, 1 << number)
        dr.eval(images, noise)
        own, variance = [mi.luminance(image) for image in images], noise
    return images


def spread_fireflies(
    image: mi.Color3f, size: tuple[int, int], noise: mi.Float = 0
) -> tuple[mi.Color3f, mi.Float]:
    """Return an image whose lone bright pixels share their excess with their eight neighbours.

    `image` is `mi.Color3f` of W * H pixels, `noise` the variance of its luminance. What a pixel has
    more than the brightest of its neighbours is divided among it and them: a lone spike of gloss
    would decide on the exposure, and cutting it off would lose its energy. Where the spike is noise
    its neighbours get their share of that, too, so that the filter spreads it further.
    """
    own = mi.luminance(image)
    around = _neighbours(size)
    noise = mi.Float(noise) + dr.zeros(mi.Float, dr.width(own))
    brightest = mi.Float(0)
    for index, inside in around:
        same = index == dr.arange(mi.UInt32, dr.width(own))
        other = dr.gather(mi.Float, own, index, inside & ~same)
        brightest = dr.maximum(brightest, other)
    kept = dr.select(own > brightest, brightest / own, 1)
    pixels = mi.Float(0)  # that share the excess: fewer at the border
    for _, inside in around:
        pixels += dr.select(inside, 1, 0)
    excess = image * ((1 - kept) / pixels)
    uncertain = noise * dr.square((1 - kept) / pixels)
    image, noise = image * kept, noise * dr.square(kept)
    dr.eval(excess, uncertain)
    for index, inside in around:
        image += dr.gather(mi.Color3f, excess, index, inside)
        noise += dr.gather(mi.Float, uncertain, index, inside)
    return image, noise


def _neighbours(size: tuple[int, int]) -> list[tuple[mi.UInt32, mi.Bool]]:
    """Return indices of the 3 x 3 pixels around each, and which of them lie in the image."""
    steps = (-1, 0, 1)
    return [_shifted(size, across, down) for down in steps for across in steps]


def _shifted(size: tuple[int, int], across: int, down: int) -> tuple[mi.UInt32, mi.Bool]:
    """Return indices of the pixels so far from each, and which of them lie in the image."""
    width, height = size
    index = dr.arange(mi.UInt32, width * height)
    x, y = mi.Int32(index % width) + across, mi.Int32(index // width) + down
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    return mi.UInt32(dr.select(inside, y * width + x, 0)), inside


class _Taps:
    """Neighbours of all pixels, and how alike their surfaces are."""

    def __init__(
        self,
        normal: mi.Vector3f,
        position: mi.Vector3f,
        scale: mi.Float,
        lit: mi.Float,
        size: tuple[int, int],
    ) -> None:
        self.normal, self.position, self.scale, self.lit = normal, position, scale, lit
        self.size = size

    def at(self, across: int, down: int, step: int) -> tuple[mi.UInt32, mi.Bool, mi.Float]:
        """Return index, validity and weight of the neighbour so many steps away."""
        index, inside = _shifted(self.size, across * step, down * step)
        kernel = _KERNEL[down + 2] * _KERNEL[across + 2]
        if (across, down) == (0, 0):
            return index, inside, kernel * dr.maximum(self.lit, 1e-4)
        other = dr.gather(mi.Vector3f, self.normal, index, inside)
        there = dr.gather(mi.Vector3f, self.position, index, inside)
        lit = dr.gather(mi.Float, self.lit, index, inside)
        alike = dr.maximum(dr.dot(other, self.normal), 0)
        for _ in range(_SHARPNESS.bit_length() - 1):
            alike = dr.square(alike)
        apart = dr.abs(dr.dot(there - self.position, self.normal)) * self.scale
        return index, inside, dr.select(inside, kernel * alike * lit * dr.exp(-apart), 0)


def _guides(
    taps: _Taps, light: list[mi.Float], noise: list[mi.Float]
) -> tuple[list[mi.Float], list[mi.Float]]:
    """Return means of luminance over 5 x 5 pixels of one surface, and of its variance."""
    dr.eval(light)
    means, variances = ([mi.Float(0) for _ in light] for _ in range(2))
    total = mi.Float(0)
    for down in range(-2, 3):
        for across in range(-2, 3):
            index, inside, weight = taps.at(across, down, 1)
            total += weight
            for k in range(len(light)):
                means[k] += weight * dr.gather(mi.Float, light[k], index, inside)
                variances[k] += weight * dr.gather(mi.Float, noise[k], index, inside)
    guides = [mean / total for mean in means], [variance / total for variance in variances]
    dr.eval(guides)
    return guides


def _pass(
    taps: _Taps,
    images: list[mi.Color3f],
    noise: list[mi.Float],
    own: list[mi.Float],
    variance: list[mi.Float],
    step: int,
) -> tuple[list[mi.Color3f], list[mi.Float]]:
    """Return images and noise after one pass; differences are those of `own`."""
    limits = [dr.rcp(_DEVIATIONS * dr.sqrt(each) + 1e-12) for each in variance]
    sums = [mi.Color3f(0) for _ in images]
    variances, weights = ([mi.Float(0) for _ in images] for _ in range(2))
    for down in range(-2, 3):
        for across in range(-2, 3):
            index, inside, common = taps.at(across, down, step)
            for k, (image, known) in enumerate(zip(images, noise, strict=True)):
                other = dr.gather(mi.Float, own[k], index, inside)
                weight = common * dr.exp(-dr.abs(other - own[k]) * limits[k])
                sums[k] += dr.gather(mi.Color3f, image, index, inside) * weight
                weights[k] += weight
                variances[k] += dr.square(weight) * dr.gather(mi.Float, known, index, inside)
    smoothed = [total / weight for total, weight in zip(sums, weights, strict=True)]
    left = [v / dr.square(weight) for v, weight in zip(variances, weights, strict=True)]
    return smoothed, left
