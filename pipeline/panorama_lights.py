"""Point lights of an illumination panorama, and their unshadowed irradiance at surfaces.

A panorama holds the intensity, the distance and the colour of each light source seen from the
camera, and therefore the sources' positions. Their irradiance at any surface follows from the
cosine at the surface and the squared distance between surface and source.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pbrnet.scenes.arrays import AnyArray, ArrayOrTensor, array_namespace
from pbrnet.scenes.color import luminance

CELLS = (32, 64)  # rows and columns of the grid over the sphere that collects the sources
NEAREST = 0.15  # metres: lower bound of the distance, since real sources are no points
_CHUNK = 1 << 22  # points x sources held at once


def sources(radiance: AnyArray, distance: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Return positions (S, 3) in camera axes and radiant intensities (S, 3) of point lights.

    `radiance` is linear RGB (h, w, 3), `distance` metres (h, w); the result is float32, one point
    light for each cell with light, see `cell_sources`.
    """
    positions, intensities, power = cell_sources(radiance, distance)
    lit = power > 0
    return positions[lit].astype(np.float32), intensities[lit].astype(np.float32)


def cell_sources(
    radiance: ArrayOrTensor, distance: ArrayOrTensor
) -> tuple[ArrayOrTensor, ArrayOrTensor, ArrayOrTensor]:
    """Return the point lights of all cells of `CELLS`, row by row and dark ones too, in float64.

    Positions (C, 3) in camera axes: the mean of the cell's pixels, weighted by intensity; radiant
    intensities (C, 3); and their luminances (C,). A pixel of radiance L, solid angle w and
    distance d has the intensity L w d^2: that of an emitter with equal radiance towards the
    surfaces and towards the camera.
    """
    xp = array_namespace(distance)
    radiance, distance = (xp.asarray(each, dtype=xp.float64) for each in (radiance, distance))
    height, width = distance.shape
    edges = xp.cos(xp.arange(height + 1, dtype=xp.float64) * (np.pi / height))
    solid_angle = (edges[:-1] - edges[1:])[:, None] * (2 * np.pi / width)
    share = solid_angle * distance**2
    power, bands = (luminance(radiance) * share)[..., None], radiance * share[..., None]
    places = panorama_directions(distance) * distance[..., None]
    row, column = xp.arange(height) * CELLS[0] // height, xp.arange(width) * CELLS[1] // width
    cell = row[:, None] * CELLS[1] + column
    sums = _sum_by_cell(cell, xp.concatenate([power, power * places, bands], axis=-1))
    total = sums[:, 0]
    positions = sums[:, 1:4] / xp.where(total > 0, total, 1.0)[:, None]
    return positions, sums[:, 4:], total


def _sum_by_cell(cell: ArrayOrTensor, values: ArrayOrTensor) -> ArrayOrTensor:
    """Sums (C, K) of the values (h, w, K) over each cell's pixels; `cell` (h, w) numbers them."""
    count, bands = CELLS[0] * CELLS[1], values.shape[-1]
    cell, values = cell.reshape(-1), values.reshape(-1, bands)
    xp = array_namespace(values)
    if xp is np:
        columns = [np.bincount(cell, values[:, k], count) for k in range(bands)]
        return np.stack(columns, axis=-1)
    return xp.zeros((count, bands), dtype=values.dtype).index_add(0, cell, values)


def panorama_directions(panorama: ArrayOrTensor) -> ArrayOrTensor:
    """Unit directions (h, w, 3) of the pixel centres of a panorama (h, w) in camera axes."""
    xp = array_namespace(panorama)
    height, width = panorama.shape
    row, column = (xp.arange(size, dtype=xp.float64) + 0.5 for size in (height, width))
    polar = row[:, None] / height * np.pi  # from the top row, which is up
    azimuth = (column[None] / width * 2 - 1) * np.pi  # from straight ahead
    x, z = xp.sin(polar) * xp.sin(azimuth), xp.sin(polar) * xp.cos(azimuth)
    return xp.stack([x, xp.broadcast_to(-xp.cos(polar), x.shape), z], axis=-1)


def unshadowed_irradiance(
    points: AnyArray, normals: AnyArray, positions: AnyArray
) -> Iterator[tuple[slice, AnyArray]]:
    """`irradiance_per_intensity` (p, S), for a block of the points at a time to bound memory.

    Yields the block's slice of the points, and its values.
    """
    step = max(1, _CHUNK // max(1, len(positions)))
    for start in range(0, len(points), step):
        block = slice(start, start + step)
        yield block, irradiance_per_intensity(points[block], normals[block], positions)


def irradiance_per_intensity(
    points: ArrayOrTensor, normals: ArrayOrTensor, positions: ArrayOrTensor
) -> ArrayOrTensor:
    """Irradiance (P, S) at points (P, 3) from unit point sources at positions (S, 3), in 1/m^2.

    Cosine over squared distance, unshadowed. `normals` (P, 3) are unit; all in the same axes.
    """
    xp = array_namespace(points)
    squared = (
        (points**2).sum(axis=1)[:, None] + (positions**2).sum(axis=1) - 2 * points @ positions.T
    )
    squared = xp.clip(squared, NEAREST**2, None)
    cosine = normals @ positions.T - (normals * points).sum(axis=1)[:, None]
    return xp.clip(cosine, 0, None) / (squared * xp.sqrt(squared))
