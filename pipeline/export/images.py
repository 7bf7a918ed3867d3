"""Image files, cameras and point clouds of the exports; bytes are repeatable."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenEXR
from PIL import Image

from pbrnet.pipeline.export.parts import ExportOptions
from pbrnet.pipeline.export.rows import ViewRow
from pbrnet.pipeline.frames import write_error
from pbrnet.pipeline.images import png_bytes, tone_picture
from pbrnet.pipeline.tonemap import Exposure
from pbrnet.scenes.arrays import AnyArray, BoolArray, Float64Array, Int64Array, UInt8Array

_DEEPEST = 65535  # of a 16-bit PNG
_AGREES = 0.01  # relative difference of depth up to which two views see one point


def exposures(rows: Sequence[ViewRow], options: ExportOptions) -> list[Exposure]:
    """Return the exposure of each view: its own, or one for all.

    The shared one has the geometric mean of their scales, and the brightest white. Reconstruction
    from several views needs it, because a surface must keep its brightness from view to view.
    """
    own = [row.exposure for row in rows]
    if options.exposure == "view":
        return own
    scale = float(np.exp(np.mean([np.log(one.scale) for one in own])))
    white = max(one.white / one.scale for one in own) * scale
    return [Exposure(scale, white)] * len(own)


def write_picture(path: Path, color: AnyArray, exposure: Exposure) -> None:
    """Write radiance (H, W, 3) as a tone-mapped sRGB PNG."""
    path.write_bytes(png_bytes(tone_picture(color, exposure)))


def write_depth(path: Path, depth: AnyArray, units_a_metre: float) -> None:
    """Write depth (H, W), metres, as a 16-bit PNG; 0: no surface, or too far for 16 bits."""
    values = np.rint(depth.astype(np.float64) * units_a_metre)
    values[values > _DEEPEST] = 0
    Image.fromarray(values.astype(np.uint16)).save(path, "PNG", compress_level=4)


def write_exr(path: Path, planes: Mapping[str, AnyArray]) -> None:
    """Write an OpenEXR file of these channels, each (H, W).

    Raises `MachineError` for a full disk.
    """
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    stored = {name: np.ascontiguousarray(values) for name, values in planes.items()}
    try:
        with OpenEXR.File(header, stored) as file:
            file.write(str(path))
    except (RuntimeError, ValueError) as error:
        raise write_error(path, error) from error


def camera_rays(intrinsics: Float64Array, width: int, height: int) -> Float64Array:
    """Return the point at depth 1 through each pixel's centre, (H, W, 3), camera axes."""
    columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    pixels = np.stack([columns, rows, np.ones_like(rows)], axis=-1)
    rays: Float64Array = pixels @ np.linalg.inv(intrinsics).T
    return rays


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
        local = row.lens(width, height).points(depth)[grid]
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
    lens = row.lens(width, height)
    local = (world - row.pose[:3, 3]) @ row.pose[:3, :3]
    where, ahead = lens.project(local)
    away = np.sqrt((local**2).sum(axis=-1)) if lens.depth_is_distance else local[:, 2]
    inside = ahead & lens.contains(where)
    cells = np.where(inside[:, None], where, 0).astype(np.int64)
    found = depth[cells[:, 1], cells[:, 0]].astype(np.float64)
    return inside & (np.abs(found - away) <= _AGREES * away), where
