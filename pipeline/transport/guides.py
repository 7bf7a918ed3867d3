"""Guides for denoising noisy samples: albedo and normal of sub-pixels, in one kernel.

The same rays as `pbrnet.pipeline.passes.denoise.guides`, in a small part of its time: hits are
Embree's own, and averages are formed before anything leaves the kernel. Where faces of several
shapes lie in one plane, another of them may be seen; else both differ by rounding.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from pbrnet.pipeline.pathtrace.launches import Recordings
from pbrnet.pipeline.render.drjit_arrays import column, to_numpy
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.pipeline.transport.radiosity import camera_ray
from pbrnet.pipeline.transport.rays import ShapeTables, facing_normal, first_surface
from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import Float32Array

SUBPIXELS = 3  # per axis


def fast_guides(render_scene: RenderScene, view: View) -> tuple[Float32Array, Float32Array]:
    """Return the sub-pixel means of albedo in [0, 1] and camera-frame normal, float32 (H, W, 3).

    For perspective views, in variants other than the scalar ones.
    """
    materials = render_scene.materials
    return materials.kept(_GuideTracer, render_scene, version=materials.version).guides(view)


class _GuideTracer:
    """Recorded launches of an open scene, kept between its views."""

    def __init__(self, render_scene: RenderScene) -> None:
        self._tables = ShapeTables(render_scene.geometry)
        self._scene = render_scene.geometry.scene
        self._recorded = Recordings().of

    def guides(self, view: View) -> tuple[Float32Array, Float32Array]:
        """Return the guides of a view."""
        size = (view.width, view.height)
        rotation = view.pose[:3, :3]
        matrix = rotation @ np.linalg.inv(view.intrinsics)
        rows = (view.eye, matrix.ravel(), rotation.ravel())
        eye, pixels, axes = (column(mi.Float, values) for values in rows)
        bands = to_numpy(
            *self._recorded(_trace, size)(self._scene, self._tables, (eye, pixels), axes, size)
        )
        image = np.stack(bands, axis=-1).reshape(view.height, view.width, 6)
        return np.ascontiguousarray(image[..., :3]), np.ascontiguousarray(image[..., 3:])


def _trace(
    scene: mi.Scene,
    tables: ShapeTables,
    camera: tuple[mi.Float, mi.Float],
    axes: mi.Float,
    size: tuple[int, int],
) -> list[mi.Float]:
    """Return bands of albedo and of the normal in camera axes, `mi.Float` (H * W,) each."""
    width, height = size
    rays = SUBPIXELS * SUBPIXELS
    lane = dr.arange(mi.UInt32, width * height * rays)
    pixel, part = lane // rays, lane % rays
    x = mi.Float(pixel % width) + (mi.Float(part % SUBPIXELS) + 0.5) / SUBPIXELS
    y = mi.Float(pixel // width) + (mi.Float(part // SUBPIXELS) + 0.5) / SUBPIXELS
    ray = camera_ray(camera, x, y)
    si, _ = first_surface(scene, tables, ray, mi.Bool(True), coherent=True)
    seen = si.is_valid()
    normal = facing_normal(si, ray.d)
    turn = [dr.gather(mi.Float, axes, mi.UInt32(place)) for place in range(9)]
    local = [
        sum((turn[3 * k + axis] * normal[k] for k in range(3)), mi.Float(0)) for axis in range(3)
    ]
    bands = [*tables.reflectance_at(si, seen), *local]
    bands = [dr.select(seen & dr.isfinite(band), band, 0) for band in bands]
    dr.eval(bands)
    return [dr.block_sum(band, rays) / rays for band in bands]
