"""Direct light, as far as a panorama tells: what the sources it shows do to every pixel.

`pipeline.passes.panorama_lights` says where they stand. What is missing is what only rays would
tell: bounces, lamps hidden from the camera, and shadows, but for those that the rays of
`pipeline.passes.visibility` found.
"""

from __future__ import annotations

import numpy as np

from model.data.reader import Example
from pipeline.passes.panorama_lights import sources, unshadowed_irradiance
from scenes.arrays import AnyArray, Float32Array


def direct_shading(example: Example, albedo: float) -> Float32Array:
    """Radiance of a grey matte copy of the view under its panorama's sources, (H, W, 3).

    What `surface_light` says, and added to it what a pixel sees of the sources themselves, which
    is all there is where no surface is.
    """
    directions = pixel_directions(example.intrinsics, example.depth.shape)
    return surface_light(example, albedo) + seen_sources(panorama_radiance(example), directions)


def surface_light(example: Example, albedo: float) -> Float32Array:
    """Radiance (H, W, 3) that surfaces of the reflectance `albedo` return.

    With the shadows of the view's `visibility`, without any where it is not known.
    """
    directions = pixel_directions(example.intrinsics, example.depth.shape)
    places, power = sources(panorama_radiance(example), example.distance)
    points = (directions * example.depth[..., None])[example.valid]
    lit = np.zeros((*example.depth.shape, 3), np.float32)
    lit[example.valid] = (
        albedo / np.pi * _irradiance(points, example.normal[example.valid], places, power)
    )
    return lit if example.visibility is None else lit * example.visibility[..., None]


def panorama_radiance(example: Example) -> Float32Array:
    """Linear RGB (h, w, 3) of a panorama's sources; grey where their colour is not known."""
    tint = np.ones(3, np.float32) if example.tint is None else example.tint
    return np.asarray(example.intensity[..., None] * tint, dtype=np.float32)


def pixel_directions(intrinsics: AnyArray, shape: tuple[int, ...]) -> Float32Array:
    """Camera rays (H, W, 3) through the pixel centres, scaled to z = 1."""
    y, x = np.mgrid[: shape[0], : shape[1]] + 0.5
    pixels = np.stack([x, y, np.ones_like(x)], axis=-1)
    return np.asarray(pixels @ np.linalg.inv(intrinsics).T, dtype=np.float32)


def seen_sources(panorama: AnyArray, directions: AnyArray) -> Float32Array:
    """What the panorama's nearest pixel holds, along directions (H, W, 3) of any length.

    `panorama` is (h, w) or (h, w, 3), and so is the result, (H, W) or (H, W, 3).
    """
    height, width = panorama.shape[:2]
    x, y, z = np.moveaxis(np.asarray(directions, dtype=np.float64), -1, 0)
    azimuth = np.arctan2(x, z)
    polar = np.arctan2(np.hypot(x, z), -y)
    row = np.minimum((polar / np.pi * height).astype(int), height - 1)
    column = ((azimuth / (2 * np.pi) + 0.5) * width).astype(int) % width
    return np.asarray(panorama[row, column], dtype=np.float32)


def _irradiance(points: AnyArray, normals: AnyArray, places: AnyArray, power: AnyArray) -> AnyArray:
    """Irradiance (P, 3) at points (P, 3) with unit normals from point sources, unshadowed."""
    irradiance = np.zeros((len(points), 3), np.float32)
    for some, brought in unshadowed_irradiance(points, normals, places):
        irradiance[some] = brought @ power
    return irradiance
