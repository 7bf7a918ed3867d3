"""Direct lighting of a view by the light sources that its panorama shows.

The positions and intensities of the sources come from `pipeline.passes.panorama_lights`, the
shadows from `pipeline.passes.visibility` if the view has them. The result lacks indirect light and
the light of lamps that are not visible from the camera position.

Functions take NumPy arrays, and tensors while a network is exported (`model.release.onnx_export`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch._higher_order_ops.scan import scan

from model.data.reader import ViewInputs
from pipeline.passes.panorama_lights import (
    CELLS,
    cell_sources,
    irradiance_per_intensity,
    sources,
    unshadowed_irradiance,
)
from scenes.arrays import ArrayOrTensor, array_namespace
from scenes.geometry import directions


def direct_light(view: ViewInputs, albedo: float) -> tuple[ArrayOrTensor, ArrayOrTensor]:
    """Reflected direct light, and the sources in view: linear radiance (H, W, 3) each.

    Surfaces are matte with the reflectance `albedo`. The view's `visibility` shadows them; without
    it they are unshadowed. Reflected light is 0 where there is no surface. The second image is the
    radiance of the panorama in the direction of each pixel.
    """
    rays, radiance = pixel_directions(view), panorama_radiance(view)
    irradiance = panorama_irradiance(view, rays * view.depth[..., None], radiance)
    reflected = albedo / np.pi * irradiance
    if view.visibility is not None:
        reflected = reflected * view.visibility[..., None]
    return reflected, panorama_lookup(radiance, rays)


def direct_shading(view: ViewInputs, albedo: float) -> ArrayOrTensor:
    """Radiance (H, W, 3) of the view with matte surfaces in direct light: sum of `direct_light`."""
    reflected, sources_in_view = direct_light(view, albedo)
    return reflected + sources_in_view


def panorama_irradiance(
    view: ViewInputs, points: ArrayOrTensor, radiance: ArrayOrTensor
) -> ArrayOrTensor:
    """Unshadowed irradiance float32 (H, W, 3) at points (H, W, 3) in camera axes; 0 off surfaces.

    The sum over all sources of cosine x intensity / squared distance. `radiance` (h, w, 3) is
    `panorama_radiance`.
    """
    if array_namespace(points) is torch:
        return _traced_irradiance(view, points, radiance)
    places, intensities = sources(radiance, view.distance)
    found = np.zeros((int(view.valid.sum()), 3), np.float32)
    for block, factor in unshadowed_irradiance(points[view.valid], view.normal[view.valid], places):
        found[block] = factor @ intensities
    irradiance = np.zeros(points.shape, np.float32)
    irradiance[view.valid] = found
    return irradiance


def _traced_irradiance(
    view: ViewInputs, points: torch.Tensor, radiance: torch.Tensor
) -> torch.Tensor:
    """`panorama_irradiance` as a graph: a loop over the rows of `CELLS`, whose number is fixed.

    The array version skips dark cells and pixels without a surface. A graph cannot: their numbers
    depend on the data.
    """
    places, intensities, _ = cell_sources(radiance, view.distance)
    rows = [each.reshape(*CELLS, 3).float() for each in (places, intensities)]
    flat, normals = points.reshape(-1, 3), view.normal.reshape(-1, 3)

    def add_row(
        total: torch.Tensor, row: Sequence[torch.Tensor]
    ) -> tuple[torch.Tensor, torch.Tensor]:
        place, intensity = row
        total = total + irradiance_per_intensity(flat, normals, place) @ intensity
        return total, intensity.sum()

    total = torch.zeros_like(flat)
    if torch.compiler.is_exporting():
        total, _ = scan(add_row, total, rows)
    else:  # outside an export `scan` would first compile the loop's body, which takes seconds
        for row in zip(*rows, strict=True):
            total, _ = add_row(total, row)
    return total.reshape(points.shape) * view.valid[..., None]


def panorama_radiance(view: ViewInputs) -> ArrayOrTensor:
    """Linear RGB radiance float32 (h, w, 3) of the panorama's sources; grey without a `tint`."""
    xp = array_namespace(view.intensity)
    tint = xp.ones(3, dtype=xp.float32) if view.tint is None else view.tint
    return xp.asarray(view.intensity[..., None] * tint, dtype=xp.float32)


def pixel_directions(view: ViewInputs) -> ArrayOrTensor:
    """Rays float32 (H, W, 3) through the pixel centres, scaled to z = 1, in camera axes."""
    height, width = view.depth.shape
    if array_namespace(view.depth) is np:
        return directions.pixel_directions(view.intrinsics, width, height).astype(np.float32)
    # ONNX has no matrix inverse, and K is upper triangular.
    K = view.intrinsics
    y = (torch.arange(height)[:, None] + 0.5 - K[1, 2]) / K[1, 1]
    x = (torch.arange(width) + 0.5 - K[0, 2] - K[0, 1] * y) / K[0, 0]
    return torch.stack([x, y.expand(x.shape), torch.ones_like(x)], dim=-1)


def panorama_lookup(panorama: ArrayOrTensor, rays: ArrayOrTensor) -> ArrayOrTensor:
    """Values float32 of the panorama's nearest pixel in the directions of rays (H, W, 3).

    Rays may have any length. `panorama` is (h, w) or (h, w, 3), the result (H, W) or (H, W, 3).
    """
    xp = array_namespace(panorama)
    height, width = panorama.shape[:2]
    precision = xp.float64 if xp is np else xp.float32  # ONNX Runtime's arctangent is float32
    x, y, z = xp.moveaxis(xp.asarray(rays, dtype=precision), -1, 0)
    azimuth = xp.arctan2(x, z)
    polar = xp.arctan2(xp.sqrt(x * x + z * z), -y)
    row = xp.clip(xp.asarray(polar / np.pi * height, dtype=xp.int64), None, height - 1)
    column = xp.asarray((azimuth / (2 * np.pi) + 0.5) * width, dtype=xp.int64)
    column = xp.where(column >= width, column - width, column)  # directly behind the camera
    return xp.asarray(panorama[row, column], dtype=xp.float32)
