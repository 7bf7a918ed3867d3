"""Environment of a view: an HDR panorama of all that the camera position sees.

Equirectangular in the camera's own tilted frame, as the illumination panorama: the centre column
is straight ahead, right of it is the camera's right, the top row is its up. Colour is path traced
with the ground truth's emitter sampling, planned for all directions, and denoised if that is. A
pixel is the mean radiance over its solid angle, so that the sum of radiance x solid angle is what
arrives at the camera position. Distance and normal are those of the ray through the pixel's
centre, noise-free and past clear glass as in the inputs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from pbrnet.pipeline.channels import NORMAL, RGB, Kind
from pbrnet.pipeline.frames import Channels, Result, banded
from pbrnet.pipeline.lenses.model import Lens
from pbrnet.pipeline.passes.denoise import SUBPIXELS, Image, denoise, denoiser_version
from pbrnet.pipeline.passes.groundtruth import lens_launch, render_blocks
from pbrnet.pipeline.passes.illumination import Panorama
from pbrnet.pipeline.passes.inputs import VisibleSurfaces, normal, reflectance
from pbrnet.pipeline.passes.settings import EnvironmentParams, GroundTruthParams
from pbrnet.pipeline.render import raycast
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import AnyArray, Float32Array, Float64Array
from pbrnet.scenes.geometry.directions import equirectangular_directions, turned

_MANTISSA = 10  # bits of a stored radiance, as in half floats; the exponent is that of float32


@dataclass(frozen=True)
class EnvironmentSettings:
    """Settings of the trace; `denoiser` is the denoiser's version, None without one."""

    panorama: EnvironmentParams
    trace: GroundTruthParams
    denoiser: str | None


def settings(
    truth: GroundTruthParams, panorama: EnvironmentParams
) -> dict[Kind, EnvironmentSettings]:
    """Return the panorama's settings and those of the ground truth that its paths share."""
    denoiser = None if truth.denoise == "none" else denoiser_version()
    trace = replace(truth, spp=panorama.spp, noise=0.0, min_spp=1, train_spp=0, joint=True)
    return {"environment": EnvironmentSettings(panorama, trace, denoiser)}


def render_environment(
    render_scene: RenderScene, view: View, settings: Mapping[Kind, EnvironmentSettings], seed: int
) -> dict[Kind, Result]:
    """Render the channels of an `environment` frame, (width / 2, width), and their statistics.

    `R`, `G`, `B`: linear radiance >= 0, float32 rounded to the precision of half floats, whose
    range a bare bulb or the sun exceeds. `distance.Z`: distance along the ray in metres, float32,
    not z-depth; `N.X/N.Y/N.Z`: unit normal that faces the camera, in its axes (x right, y down, z
    forward). They are 0 where no surface is. The statistics are those of `render_truth`.

    `seed` is the view's own seed.
    """
    own = settings["environment"]
    width, height = own.panorama.width, own.panorama.width // 2
    lens = Lens("equirectangular", width, height, ())
    launch = lens_launch(render_scene.neutral(None), view, lens, own.trace, seed)
    canvas = replace(view, width=width, height=height)
    image, stats = render_blocks(launch, canvas, own.trace, seed)
    if own.denoiser:
        image = denoise(image, *_guides(render_scene, view, width), around=True)
        stats = {**stats, "denoiser": own.denoiser}
    colour = {band: rounded(image[band]) for band in RGB}
    return {"environment": ({**colour, **_geometry(render_scene, view, width)}, stats)}


def rounded(values: AnyArray) -> Float32Array:
    """Round float32 values to the precision of half floats, in the range of float32.

    The lower mantissa bits are then 0, so that files compress as if the values were half floats.
    """
    lost = np.uint32(23 - _MANTISSA)
    bits = np.ascontiguousarray(values, dtype=np.float32).view(np.uint32)
    half = np.uint32(1) << (lost - np.uint32(1))
    return ((bits + half) >> lost << lost).view(np.float32)


def _geometry(render_scene: RenderScene, view: View, width: int) -> Channels:
    """Return distance and normal along the rays through the pixel centres."""
    directions = turned(equirectangular_directions(width).reshape(-1, 3), view.pose[:3, :3])
    surfaces = _surfaces(render_scene, view, directions, colors=False)
    offset = surfaces.hits.position.astype(np.float64) - view.eye
    metres = np.where(surfaces.valid, np.sqrt((offset * offset).sum(axis=-1)), 0)
    normals = normal(surfaces)
    shape = (width // 2, width)
    return {
        "distance.Z": metres.astype(np.float32).reshape(shape),
        **banded(normals.reshape(*shape, 3), NORMAL),
    }


def _guides(render_scene: RenderScene, view: View, width: int) -> tuple[Image, Image]:
    """Return the means of albedo and camera-frame normal over parts of pixels, (H, W, 3)."""
    panorama = Panorama(width, view.pose[:3, :3])
    directions = panorama.directions(np.arange(panorama.size), SUBPIXELS)
    surfaces = _surfaces(render_scene, view, directions.reshape(-1, 3), colors=True)
    shape = (panorama.height, panorama.width, SUBPIXELS**2, 3)
    albedo, normals = (
        values.astype(np.float32).reshape(shape).mean(axis=2)
        for values in (reflectance(surfaces), normal(surfaces))
    )
    return albedo, normals


def _surfaces(
    render_scene: RenderScene, view: View, directions: Float64Array, colors: bool
) -> VisibleSurfaces:
    hits = raycast.surfaces(render_scene.geometry, view.eye, directions, colors)
    return VisibleSurfaces(render_scene, view, view.eye, directions, hits, hits.shape >= 0)
