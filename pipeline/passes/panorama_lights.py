"""Point lights of an illumination panorama, and their unshadowed irradiance at surfaces.

A panorama holds the intensity, the distance and the colour of each light source seen from the
camera, and therefore the sources' positions. Their irradiance at any surface follows from the
cosine at the surface and the squared distance between surface and source.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from scenes.arrays import AnyArray
from scenes.color import luminance

CELLS = (32, 64)  # rows and columns of the grid over the sphere that collects the sources
NEAREST = 0.15  # metres: lower bound of the distance, since real sources are no points
_CHUNK = 1 << 22  # points x sources held at once


def sources(radiance: AnyArray, distance: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Return positions (S, 3) in camera axes and radiant intensities (S, 3) of point lights.

    `radiance` is linear RGB (h, w, 3), `distance` metres (h, w). The pixels of a cell of `CELLS`
    form one point light at their mean position, weighted by intensity. A pixel of radiance L,
    solid angle w and distance d has the intensity L w d^2: that of an emitter with equal radiance
    towards the surfaces and towards the camera.
    """
    height, width = distance.shape
    edges = np.cos(np.linspace(0, np.pi, height + 1))
    angle = (edges[:-1] - edges[1:])[:, None] * (2 * np.pi / width)
    bright = luminance(radiance.astype(np.float64))
    lit = bright > 0
    share = (angle * distance.astype(np.float64) ** 2)[lit]
    power, bands = bright[lit] * share, radiance[lit] * share[:, None]
    positions = (panorama_directions(height, width) * distance[..., None])[lit]
    row, column = np.nonzero(lit)
    cell = row * CELLS[0] // height * CELLS[1] + column * CELLS[1] // width
    count = CELLS[0] * CELLS[1]
    total = np.bincount(cell, power, count)
    kept = total > 0
    summed = np.stack(
        [np.bincount(cell, power * positions[:, k], count) for k in range(3)], axis=-1
    )
    centre = summed[kept] / total[kept, None]
    light = np.stack([np.bincount(cell, bands[:, k], count) for k in range(3)], axis=-1)[kept]
    return centre.astype(np.float32), light.astype(np.float32)


def panorama_directions(height: int, width: int) -> AnyArray:
    """Return unit directions (height, width, 3) of a panorama's pixel centres, camera axes."""
    polar = (np.arange(height) + 0.5)[:, None] / height * np.pi  # from the top row, which is up
    azimuth = ((np.arange(width) + 0.5)[None] / width * 2 - 1) * np.pi  # from straight ahead
    x, z = np.sin(polar) * np.sin(azimuth), np.sin(polar) * np.cos(azimuth)
    return np.stack([x, np.broadcast_to(-np.cos(polar), x.shape), z], axis=-1)


def unshadowed_irradiance(
    points: AnyArray, normals: AnyArray, positions: AnyArray
) -> Iterator[tuple[slice, AnyArray]]:
    """Yield the irradiance per radiant intensity, 1/m^2, of each source at each point.

    `points` and unit `normals` are (P, 3), `positions` of the sources (S, 3), in the same axes.
    Yields (slice of the points, array (p, S)) for some points at a time.
    """
    step = max(1, _CHUNK // max(1, len(positions)))
    for start in range(0, len(points), step):
        some = slice(start, start + step)
        point, normal = points[some], normals[some]
        squared = (
            (point**2).sum(axis=1)[:, None] + (positions**2).sum(axis=1) - 2 * point @ positions.T
        )
        squared = np.maximum(squared, NEAREST**2)
        cosine = normal @ positions.T - (normal * point).sum(axis=1)[:, None]
        np.maximum(cosine, 0, out=cosine)
        yield some, cosine / (squared * np.sqrt(squared))
