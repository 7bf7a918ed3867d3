"""Point cloud of a scene from the depth of its views, with the views that see each point."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pbrnet.pipeline.export.images import camera_rays
from pbrnet.pipeline.export.rows import ViewRow
from pbrnet.scenes.arrays import AnyArray, BoolArray, Float64Array, Int64Array, UInt8Array

_AGREES = 0.01  # relative difference of depth up to which two views see one point


@dataclass(frozen=True)
class Points:
    """N points: `positions` (N, 3) in world metres, `colors` (N, 3) sRGB bytes.

    Sightings, M of them: point, view (index into the views), and pixel (M, 2), centres at +0.5.
    """

    positions: Float64Array
    colors: UInt8Array
    point: Int64Array
    view: Int64Array
    pixel: Float64Array


def scene_points(
    rows: Sequence[ViewRow], depths: Sequence[AnyArray], pictures: Sequence[AnyArray], most: int
) -> Points:
    """Return at most `most` points on a regular grid of each view's pixels.

    `depths` are (H, W) in metres, 0 where there is no surface; `pictures` (H, W, 3) bytes. A view
    sees a point if its own depth there differs by at most 1 %.
    """
    each = max(1, most // len(rows))
    positions, colors, sources, homes = [], [], [], []
    for index, (row, depth, picture) in enumerate(zip(rows, depths, pictures, strict=True)):
        height, width = depth.shape
        step = max(1, math.ceil(math.sqrt(width * height / each)))
        grid = np.zeros(depth.shape, dtype=bool)
        grid[step // 2 :: step, step // 2 :: step] = True
        grid &= depth > 0
        rays = camera_rays(row.intrinsics, width, height)[grid]
        local = rays * depth[grid].astype(np.float64)[:, None]
        positions.append(local @ row.pose[:3, :3].T + row.pose[:3, 3])
        colors.append(picture[grid])
        lines, columns = np.nonzero(grid)
        homes.append(np.stack([columns + 0.5, lines + 0.5], axis=-1))
        sources.append(np.full(len(local), index))
    world = np.concatenate(positions)
    source, home = np.concatenate(sources), np.concatenate(homes)
    point, view, pixel = [], [], []
    for index, (row, depth) in enumerate(zip(rows, depths, strict=True)):
        seen, where = _sightings(world, row, depth)
        own = source == index
        seen |= own
        where[own] = home[own]
        point.append(np.flatnonzero(seen))
        view.append(np.full(int(seen.sum()), index))
        pixel.append(where[seen])
    return Points(
        world,
        np.concatenate(colors),
        np.concatenate(point),
        np.concatenate(view),
        np.concatenate(pixel),
    )


def _sightings(
    world: Float64Array, row: ViewRow, depth: AnyArray
) -> tuple[BoolArray, Float64Array]:
    """Return which points a view sees, (N,), and where, (N, 2)."""
    height, width = depth.shape
    local = (world - row.pose[:3, 3]) @ row.pose[:3, :3]
    ahead = local[:, 2] > 1e-6
    away = np.where(ahead, local[:, 2], 1.0)
    where = (local @ row.intrinsics.T)[:, :2] / away[:, None]
    inside = ahead & (where >= 0).all(axis=1) & (where[:, 0] < width) & (where[:, 1] < height)
    cells = np.where(inside[:, None], where, 0).astype(np.int64)
    found = depth[cells[:, 1], cells[:, 0]].astype(np.float64)
    return inside & (np.abs(found - away) <= _AGREES * away), where
