"""Image files of the exports: tone-mapped PNG, 16-bit depth PNG, OpenEXR; bytes are repeatable."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import OpenEXR
from PIL import Image

from pbrnet.pipeline.export.parts import ExportOptions
from pbrnet.pipeline.export.rows import ViewRow
from pbrnet.pipeline.images import png_bytes, tone_picture
from pbrnet.pipeline.tonemap import Exposure
from pbrnet.scenes.arrays import AnyArray, Float64Array

_DEEPEST = 65535  # of a 16-bit PNG


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
    """Write an OpenEXR file of these channels, each (H, W)."""
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    stored = {name: np.ascontiguousarray(values) for name, values in planes.items()}
    with OpenEXR.File(header, stored) as file:
        file.write(str(path))


def rgb_planes(image: AnyArray) -> dict[str, AnyArray]:
    """Return an image (H, W, 3) as channels R, G, B."""
    return {name: image[..., band] for band, name in enumerate("RGB")}


def opengl_pose(pose: Float64Array) -> Float64Array:
    """Return a pose of a camera with x right, y up, z backward, from x right, y down, z forward."""
    return pose @ np.diag([1.0, -1.0, -1.0, 1.0])


def camera_rays(intrinsics: Float64Array, width: int, height: int) -> Float64Array:
    """Return the point at depth 1 through each pixel's centre, (H, W, 3), camera axes."""
    columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    pixels = np.stack([columns, rows, np.ones_like(rows)], axis=-1)
    rays: Float64Array = pixels @ np.linalg.inv(intrinsics).T
    return rays
