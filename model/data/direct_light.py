"""Direct lighting of a view by the light sources that its panorama shows.

The positions and intensities of the sources come from `pbrnet.pipeline.passes.panorama_lights`, the
shadows from `pbrnet.pipeline.passes.visibility` if the view has them. The result lacks indirect
light and the light of lamps that are not visible from the camera position.

The study of illumination shows it beside the networks, which do not take it.
"""

from __future__ import annotations

import numpy as np

from pbrnet.model.data.reader import Example
from pbrnet.pipeline.passes.panorama_lights import sources, unshadowed_irradiance
from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.geometry.directions import pixel_directions


def direct_light(view: Example, albedo: float) -> tuple[AnyArray, AnyArray]:
    """Reflected direct light, and the sources in view: linear radiance (H, W, 3) each.

    Surfaces are matte with the reflectance `albedo`. The view's `visibility` shadows them; without
    it they are unshadowed. Reflected light is 0 where there is no surface. The second image is the
    radiance of the panorama in the direction of each pixel.
    """
    rays, radiance = pixel_rays(view), panorama_radiance(view)
    irradiance = panorama_irradiance(view, rays * view["depth"][..., None], radiance)
    reflected = albedo / np.pi * irradiance
    if "visibility" in view:
        reflected = reflected * view["visibility"][..., None]
    return reflected, panorama_lookup(radiance, rays)


def direct_shading(view: Example, albedo: float) -> AnyArray:
    """Radiance (H, W, 3) of the view with matte surfaces in direct light: sum of `direct_light`."""
    reflected, sources_in_view = direct_light(view, albedo)
    return reflected + sources_in_view


def panorama_irradiance(view: Example, points: AnyArray, radiance: AnyArray) -> AnyArray:
    """Unshadowed irradiance float32 (H, W, 3) at points (H, W, 3) in camera axes; 0 off surfaces.

    The sum over all sources of cosine x intensity / squared distance. `radiance` (h, w, 3) is
    `panorama_radiance`.
    """
    places, intensities = sources(radiance, view["distance"])
    valid = view["valid"]
    found = np.zeros((int(valid.sum()), 3), np.float32)
    for block, factor in unshadowed_irradiance(points[valid], view["normal"][valid], places):
        found[block] = factor @ intensities
    irradiance = np.zeros(points.shape, np.float32)
    irradiance[valid] = found
    return irradiance


def panorama_radiance(view: Example) -> AnyArray:
    """Linear RGB radiance float32 (h, w, 3) of the panorama's sources; grey without a `tint`."""
    tint = view["tint"] if "tint" in view else np.ones(3, np.float32)
    radiance: AnyArray = (view["intensity"][..., None] * tint).astype(np.float32)
    return radiance


def pixel_rays(view: Example) -> AnyArray:
    """Rays float32 (H, W, 3) through the pixel centres, scaled to z = 1, in camera axes."""
    height, width = view["depth"].shape
    return pixel_directions(view.intrinsics, width, height).astype(np.float32)


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
