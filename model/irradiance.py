"""Direct light, as far as a panorama tells: what the sources it shows do to every pixel.

A panorama holds the intensity and the distance of each light source seen from the camera, and
its colour where there is a tint. So it holds the sources' places, and from there their light can
be sent to every surface of the image: by the cosine with its normal and the square of its distance
from there, not of the camera's.
What is missing is what only rays would tell: shadows, bounces, and lamps hidden from the camera.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from model.data import Array, Example
from pipeline.tonemap import luminance

CELLS = (32, 64)  # sources are gathered into so many cells of the sphere, rows and columns
NEAREST = 0.15  # metres: nearer to a source nothing gets brighter; sources are no points
_CHUNK = 1 << 22  # pixels x sources held at once


def direct_shading(example: Example, albedo: float) -> npt.NDArray[np.float32]:
    """Radiance of a grey matte copy of the view under its panorama's sources, (H, W, 3).

    What `surface_light` says, and added to it what a pixel sees of the sources themselves, which
    is all there is where no surface is.
    """
    directions = pixel_directions(example.intrinsics, example.depth.shape)
    return surface_light(example, albedo) + seen_sources(panorama_radiance(example), directions)


def surface_light(example: Example, albedo: float) -> npt.NDArray[np.float32]:
    """Radiance (H, W, 3) that surfaces of the reflectance `albedo`, lit without shadows, return."""
    directions = pixel_directions(example.intrinsics, example.depth.shape)
    places, power = sources(panorama_radiance(example), example.distance)
    points = (directions * example.depth[..., None])[example.valid]
    lit = np.zeros((*example.depth.shape, 3), np.float32)
    lit[example.valid] = (
        albedo / np.pi * _irradiance(points, example.normal[example.valid], places, power)
    )
    return lit


def panorama_radiance(example: Example) -> npt.NDArray[np.float32]:
    """Linear RGB (h, w, 3) of a panorama's sources; grey where their colour is not known."""
    tint = np.ones(3, np.float32) if example.tint is None else example.tint
    return np.asarray(example.intensity[..., None] * tint, dtype=np.float32)


def pixel_directions(intrinsics: Array, shape: tuple[int, ...]) -> npt.NDArray[np.float32]:
    """Camera rays (H, W, 3) through the pixel centres, scaled to z = 1."""
    y, x = np.mgrid[: shape[0], : shape[1]] + 0.5
    pixels = np.stack([x, y, np.ones_like(x)], axis=-1)
    return np.asarray(pixels @ np.linalg.inv(intrinsics).T, dtype=np.float32)


def sources(radiance: Array, distance: Array) -> tuple[Array, Array]:
    """Places (S, 3) in camera axes and radiant intensities (S, 3) of a panorama's sources.

    `radiance` is linear RGB (h, w, 3), `distance` metres (h, w).

    Pixels are gathered into `CELLS`; a cell stands where its light comes from on average. A
    pixel of radiance L, solid angle w and distance d has the intensity L w d^2: that of an
    emitter which shines towards the surfaces as it does towards the camera.
    """
    height, width = distance.shape
    edges = np.cos(np.linspace(0, np.pi, height + 1))
    angle = (edges[:-1] - edges[1:])[:, None] * (2 * np.pi / width)
    bright = luminance(radiance.astype(np.float64))
    lit = bright > 0
    share = (angle * distance.astype(np.float64) ** 2)[lit]
    power, bands = bright[lit] * share, radiance[lit] * share[:, None]
    places = (panorama_directions(height, width) * distance[..., None])[lit]
    row, column = np.nonzero(lit)
    cell = row * CELLS[0] // height * CELLS[1] + column * CELLS[1] // width
    count = CELLS[0] * CELLS[1]
    total = np.bincount(cell, power, count)
    kept = total > 0
    summed = np.stack([np.bincount(cell, power * places[:, k], count) for k in range(3)], axis=-1)
    centre = summed[kept] / total[kept, None]
    light = np.stack([np.bincount(cell, bands[:, k], count) for k in range(3)], axis=-1)[kept]
    return centre.astype(np.float32), light.astype(np.float32)


def panorama_directions(height: int, width: int) -> Array:
    """Unit directions (height, width, 3) of a panorama's pixel centres in camera axes."""
    polar = (np.arange(height) + 0.5)[:, None] / height * np.pi  # from the top row, which is up
    azimuth = ((np.arange(width) + 0.5)[None] / width * 2 - 1) * np.pi  # from straight ahead
    x, z = np.sin(polar) * np.sin(azimuth), np.sin(polar) * np.cos(azimuth)
    return np.stack([x, np.broadcast_to(-np.cos(polar), x.shape), z], axis=-1)


def seen_sources(panorama: Array, directions: Array) -> npt.NDArray[np.float32]:
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


def _irradiance(points: Array, normals: Array, places: Array, power: Array) -> Array:
    """Irradiance (P, 3) at points (P, 3) with unit normals from point sources, unshadowed."""
    irradiance = np.zeros((len(points), 3), np.float32)
    if not len(places):
        return irradiance
    step = max(1, _CHUNK // len(places))
    for start in range(0, len(points), step):
        point, normal = points[start : start + step], normals[start : start + step]
        towards = (point**2).sum(axis=1)[:, None] + (places**2).sum(axis=1) - 2 * point @ places.T
        squared = np.maximum(towards, NEAREST**2)
        cosine = normal @ places.T - (normal * point).sum(axis=1)[:, None]
        np.maximum(cosine, 0, out=cosine)
        irradiance[start : start + step] = (cosine / (squared * np.sqrt(squared))) @ power
    return irradiance
