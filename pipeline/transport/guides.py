"""Guides for denoising noisy samples: albedo and normal of sub-pixels, in one kernel.

The same rays as `pbrnet.pipeline.passes.denoise.guides`, in a small part of its time: hits are
Embree's own, and averages are formed before anything leaves the kernel. Where faces of several
shapes lie in one plane, another of them may be seen; else both differ by rounding.
"""

from __future__ import annotations

from collections.abc import Iterable

import drjit as dr
import mitsuba as mi
import numpy as np

from pbrnet.pipeline.pathtrace.launches import (
    RayArrays,
    RayKind,
    Recordings,
    ray_arrays,
    ray_kind,
    sample_rays,
)
from pbrnet.pipeline.pathtrace.optics import Optics
from pbrnet.pipeline.pathtrace.samples import PathSampler
from pbrnet.pipeline.render.drjit_arrays import column, to_numpy
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.pipeline.transport.radiosity import camera_ray
from pbrnet.pipeline.transport.rays import ShapeTables, facing_normal, first_surface
from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import AnyArray, Float32Array
from pbrnet.scenes.seeds import derive32

SUBPIXELS = 3  # per axis
# Rays per pixel through a lens and a shutter: as many, in launches of the most that fit.
_LENS_RAYS = (1, 4, 16, 64)
_LAUNCH_RAYS = 1 << 22  # most rays through a lens of one launch


def fast_guides(render_scene: RenderScene, view: View) -> tuple[Float32Array, Float32Array]:
    """Return the sub-pixel means of albedo in [0, 1] and camera-frame normal, float32 (H, W, 3).

    For perspective views, in variants other than the scalar ones.
    """
    materials = render_scene.materials
    return materials.kept(_GuideTracer, render_scene, version=materials.version).guides(view)


def optics_guides(
    render_scene: RenderScene, view: View, optics: Optics, seed: int
) -> tuple[Float32Array, Float32Array]:
    """Return guides seen through a lens and a shutter, like those of `fast_guides`.

    Rays are those of `seed`, as many that the guides have little noise.
    """
    materials = render_scene.materials
    tracer = materials.kept(_GuideTracer, render_scene, version=materials.version)
    return tracer.guides_through(view, optics, seed)


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
        return _images(bands, view)

    def guides_through(
        self, view: View, optics: Optics, seed: int
    ) -> tuple[Float32Array, Float32Array]:
        """Return the guides of a view through its lens and shutter."""
        most = max(1, _LAUNCH_RAYS // (view.width * view.height))
        rays = max(number for number in _LENS_RAYS if number <= most)
        kind = ray_kind(view.lens, optics, 1, rays)
        arrays = ray_arrays(view.pose, view.lens, optics)
        trace = self._recorded(_trace_through, kind)
        launches = []
        for number in range(max(_LENS_RAYS) // rays):
            seeds = dr.opaque(mi.UInt32, derive32(seed, "guides", number))
            bands = trace(self._scene, self._tables, arrays, kind, seeds)
            launches.append(to_numpy(*bands))
        mean = np.array(launches, dtype=np.float64).mean(axis=0)
        return _images(mean.astype(np.float32), view)


def _images(bands: Iterable[AnyArray], view: View) -> tuple[Float32Array, Float32Array]:
    """Return albedo and normal, (H, W, 3) each, from six bands (H * W,)."""
    image = np.stack(list(bands), axis=-1).reshape(view.height, view.width, 6)
    return np.ascontiguousarray(image[..., :3]), np.ascontiguousarray(image[..., 3:])


def _trace_through(
    scene: mi.Scene,
    tables: ShapeTables,
    arrays: RayArrays,
    kind: RayKind,
    seed: mi.UInt32,
) -> list[mi.Float]:
    """Return what `_trace` does, for rays through a lens and a shutter."""
    sampler = PathSampler.of(dr.arange(mi.UInt32, kind.rays), kind.spp, seed)
    ray, active = sample_rays(sampler, arrays, kind)
    return _means(scene, tables, ray, active, arrays[1], kind.spp)


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
    return _means(scene, tables, camera_ray(camera, x, y), mi.Bool(True), axes, rays)


def _means(
    scene: mi.Scene, tables: ShapeTables, ray: mi.Ray3f, active: mi.Bool, axes: mi.Float, rays: int
) -> list[mi.Float]:
    """Return the bands of the guides, means over `rays` successive rays of each pixel."""
    si, _ = first_surface(scene, tables, ray, active, coherent=True)
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
