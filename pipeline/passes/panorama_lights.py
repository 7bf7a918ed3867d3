"""A panorama's light sources as points, and what they would do to surfaces without shadows.

A panorama holds the intensity, the distance and the colour of each light source seen from the
camera. So it holds the sources' places, and from there their light can be sent to every surface:
by the cosine with its normal and the square of its distance from there, not of the camera's.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from scenes.arrays import AnyArray
from scenes.color import luminance

CELLS = (32, 64)  # sources are gathered into so many cells of the sphere, rows and columns
NEAREST = 0.15  # metres: nearer to a source nothing gets brighter; sources are no points
_CHUNK = 1 << 22  # points x sources held at once


def sources(radiance: AnyArray, distance: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Places (S, 3) in camera axes and radiant intensities (S, 3) of a panorama's sources.

    `radiance` is linear RGB (h, w, 3), `distance` metres (h, w). Pixels are gathered into `CELLS`;
    a cell stands where its light comes from on average. A pixel of radiance L, solid angle w and
    distance d has the intensity L w d^2: that of an emitter which shines towards the surfaces as
    it does towards the camera.
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


def panorama_directions(height: int, width: int) -> AnyArray:
    """Unit directions (height, width, 3) of a panorama's pixel centres in camera axes."""
    polar = (np.arange(height) + 0.5)[:, None] / height * np.pi  # from the top row, which is up
    azimuth = ((np.arange(width) + 0.5)[None] / width * 2 - 1) * np.pi  # from straight ahead
    x, z = np.sin(polar) * np.sin(azimuth), np.sin(polar) * np.cos(azimuth)
    return np.stack([x, np.broadcast_to(-np.cos(polar), x.shape), z], axis=-1)


def unshadowed(
    points: AnyArray, normals: AnyArray, places: AnyArray
) -> Iterator[tuple[slice, AnyArray]]:
    """Irradiance per radiant intensity (p, S) that each place (S, 3) brings each point, 1/m^2.

    `points` and unit `normals` are (P, 3), in the axes of `places`; handed out for some points at
    a time, with where they stand among all.
    """
    step = max(1, _CHUNK // max(1, len(places)))
    for start in range(0, len(points), step):
        some = slice(start, start + step)
        point, normal = points[some], normals[some]
        towards = (point**2).sum(axis=1)[:, None] + (places**2).sum(axis=1) - 2 * point @ places.T
        squared = np.maximum(towards, NEAREST**2)
        cosine = normal @ places.T - (normal * point).sum(axis=1)[:, None]
        np.maximum(cosine, 0, out=cosine)
        yield some, cosine / (squared * np.sqrt(squared))
