"""Direct lighting of a view by the light sources that its panorama shows.

The positions and intensities of the sources come from `pbrnet.pipeline.panorama_lights`, the
shadows from `pbrnet.pipeline.passes.visibility` if the view has them. The result lacks indirect
light and the light of lamps that are not visible from the camera position.

Networks with `train.panorama: position` take it as an input, with `mean_bounces`, without shadows
and colours, and with `colour` without shadows; the study of illumination shows it beside the
others. What that input needs takes torch tensors, too, so that torch's exporter traces it.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from torch.nn import functional

from pbrnet.model.data.reader import Columns
from pbrnet.pipeline.panorama_lights import (
    CELLS,
    cell_sources,
    irradiance_per_intensity,
    sources,
    unshadowed_irradiance,
)
from pbrnet.scenes.arrays import AnyArray, ArrayOrTensor, array_namespace
from pbrnet.scenes.geometry.directions import pixel_directions


def direct_light(view: Columns, albedo: float) -> tuple[AnyArray, AnyArray]:
    """Reflected direct light, and the sources in view: linear radiance (H, W, 3) each.

    The second image is the radiance of the panorama in the direction of each pixel.
    """
    return reflected_light(view, albedo), panorama_lookup(panorama_radiance(view), pixel_rays(view))


def direct_shading(view: Columns, albedo: float) -> AnyArray:
    """Radiance (H, W, 3) of the view with matte surfaces in direct light: sum of `direct_light`."""
    reflected, sources_in_view = direct_light(view, albedo)
    return reflected + sources_in_view


def reflected_light(view: Columns, albedo: float) -> ArrayOrTensor:
    """Linear radiance (H, W, 3) of matte surfaces in the direct light of the panorama's sources.

    The view's `visibility` shadows them; without it they are unshadowed. 0 where there is no
    surface.
    """
    points = pixel_rays(view) * view["depth"][..., None]
    reflected = albedo / np.pi * panorama_irradiance(view, points, panorama_radiance(view))
    return reflected * view["visibility"][..., None] if "visibility" in view else reflected


def mean_bounces(reflected: torch.Tensor, valid: torch.Tensor, albedo: float) -> torch.Tensor:
    """Radiance (N, C, 1, 1) that all further reflections add to matte surfaces of one albedo.

    In a closed room each reflection leaves `albedo` of the light, spread over all surfaces as in an
    integrating sphere. The mean over the surfaces in view stands for that over all. `reflected`
    (N, C, H, W) is their light after one reflection, `valid` (N, 1, H, W) is 1 on surfaces.
    """
    surfaces = valid.sum((2, 3), keepdim=True).clamp(min=1)
    mean = (reflected * valid).sum((2, 3), keepdim=True) / surfaces
    return mean * (albedo / (1 - albedo))


def lamps_in_view(view: Columns) -> torch.Tensor:
    """Radiance (1, 3, H, W) of the panorama in the direction of each pixel, bilinear."""
    rays, radiance = (torch.as_tensor(each(view)) for each in (pixel_rays, panorama_radiance))
    directions = functional.normalize(rays, dim=-1).permute(2, 0, 1)[None]
    return look_up(radiance.permute(2, 0, 1)[None], directions)


def panorama_irradiance(
    view: Columns, points: ArrayOrTensor, radiance: ArrayOrTensor
) -> ArrayOrTensor:
    """Unshadowed irradiance float32 (H, W, 3) at points (H, W, 3) in camera axes; 0 off surfaces.

    The sum over all sources of cosine x intensity / squared distance. `radiance` (h, w, 3) is
    `panorama_radiance`.
    """
    if array_namespace(points) is not np:
        return _traced_irradiance(view, points, radiance)
    places, intensities = sources(radiance, view["distance"])
    valid = view["valid"]
    found = np.zeros((int(valid.sum()), 3), np.float32)
    for block, factor in unshadowed_irradiance(points[valid], view["normal"][valid], places):
        found[block] = factor @ intensities
    irradiance = np.zeros(points.shape, np.float32)
    irradiance[valid] = found
    return irradiance


def _traced_irradiance(
    view: Columns, points: ArrayOrTensor, radiance: ArrayOrTensor
) -> ArrayOrTensor:
    """`panorama_irradiance` of tensors, without a choice that depends on values.

    All cells are sources, a row of them at a time to bound memory.
    """
    places, intensities, _ = cell_sources(radiance, view["distance"])
    shape = (-1, 3)
    at, normals = points.reshape(shape), view["normal"].reshape(shape)
    found = points.new_zeros(at.shape)
    for row in range(CELLS[0]):
        cells = slice(row * CELLS[1], (row + 1) * CELLS[1])
        factor = irradiance_per_intensity(at, normals, places[cells].to(points.dtype))
        found = found + factor @ intensities[cells].to(points.dtype)
    irradiance: ArrayOrTensor = found.reshape(points.shape) * view["valid"][..., None]
    return irradiance


def panorama_radiance(view: Columns) -> ArrayOrTensor:
    """Linear RGB radiance float32 (h, w, 3) of the panorama's sources; grey without a `tint`."""
    xp = array_namespace(view["intensity"])
    intensity = xp.stack([view["intensity"]] * 3, -1)
    return xp.asarray(intensity * view["tint"] if "tint" in view else intensity, dtype=xp.float32)


def pixel_rays(view: Columns) -> ArrayOrTensor:
    """Rays float32 (H, W, 3) through the pixel centres, scaled to z = 1, in camera axes."""
    xp = array_namespace(view["depth"])
    height, width = view["depth"].shape
    return xp.asarray(pixel_directions(view["K"], width, height), dtype=xp.float32)


def panorama_lookup(panorama: AnyArray, rays: AnyArray) -> AnyArray:
    """Values float32 of the panorama's nearest pixel in the directions of rays (H, W, 3).

    Rays may have any length. `panorama` is (h, w) or (h, w, 3), the result (H, W) or (H, W, 3).
    """
    height, width = panorama.shape[:2]
    x, y, z = np.moveaxis(rays.astype(np.float64), -1, 0)
    azimuth = np.arctan2(x, z)
    polar = np.arctan2(np.sqrt(x * x + z * z), -y)
    row = np.minimum((polar / np.pi * height).astype(np.int64), height - 1)
    column = ((azimuth / (2 * np.pi) + 0.5) * width).astype(np.int64)
    column = np.where(column >= width, column - width, column)  # directly behind the camera
    found: AnyArray = panorama[row, column].astype(np.float32)
    return found


def look_up(panorama: torch.Tensor, direction: torch.Tensor) -> torch.Tensor:
    """Panorama values (N, C, H, W) in unit directions (N, 3, H, W), bilinear.

    `panorama` (N, C, h, w) is equirectangular in the camera's frame: the centre column is forward
    (+z), columns right of it are towards the camera's right (+x), the top row is up (-y).
    """
    width = panorama.shape[-1]
    x, y, z = direction.float().unbind(dim=1)
    azimuth = torch.atan2(x, z) / math.pi
    elevation = torch.asin(y.clamp(-1, 1)) * (2 / math.pi)
    wrapped = functional.pad(panorama.float(), (1, 1, 0, 0), mode="circular")
    grid = torch.stack([azimuth * width / (width + 2), elevation], dim=-1)
    found = functional.grid_sample(wrapped, grid, padding_mode="border", align_corners=False)
    return found.to(panorama.dtype)
