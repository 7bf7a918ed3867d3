"""Light transport of a view: direct and indirect light on what each pixel sees, and the picture.

Direct light by shadow rays to all lamps, through windows and to the sun, light of one reflection by
the same on what the pixels' rays meet, all further reflections by radiosity among surfels around
the view (`pbrnet.pipeline.transport`). Left out: where mirrors, metals and glass throw light
(between surfaces it is exchanged as if all reflected diffusely, as much as they do), and light
behind rough glass. Cloth that transmits light diffusely is lit from both sides.

The picture is denoised as path-traced samples are (`pbrnet.pipeline.passes.denoise`); light without
reflectance has a filter of its own (`pbrnet.pipeline.transport.smoothing`), which costs less.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pbrnet.pipeline.channels import RGB, TRANSPORT_DIRECT, TRANSPORT_INDIRECT, Kind
from pbrnet.pipeline.frames import Channels, Result, banded, stacked
from pbrnet.pipeline.passes.denoise import Quality, denoise, denoiser_version
from pbrnet.pipeline.passes.truth import Preparation, prepare, render_samples
from pbrnet.pipeline.pathtrace import integrator
from pbrnet.pipeline.pathtrace.light_sampling import PlannedLights
from pbrnet.pipeline.render.drjit_arrays import to_numpy
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.pipeline.transport.cells import LightTable
from pbrnet.pipeline.transport.launches import TransportLauncher
from pbrnet.pipeline.transport.pixels import LOST, LightSamples, Samples
from pbrnet.pipeline.transport.radiosity import Rays, Surfels, cells_of, grid_size, solve
from pbrnet.pipeline.transport.settings import USUAL_SURFELS, TransportParams
from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import Float32Array
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.seeds import derive

# By size of the image: up to so many pixels, so many samples each; twice the surfels from there on.
_SMALL = 40_000
_SAMPLES = ((_SMALL, 16), (100_000, 8))
_FEWEST = 4


@dataclass(frozen=True)
class Transport:
    """Images of a view, linear RGB float32 (H, W, 3).

    `direct` and `indirect` are irradiance / pi: the radiance of a white diffuse surface, 0 where
    no surface is seen. Where a mirror is seen they are those of what it shows, and through cloth
    comes light of its other side. `albedo` is that of the diffuse lobes, averaged over the pixel,
    dimmed by mirrors and window panes before them, `specular` the radiance by other lobes and by
    panes, `emitted` that of lamps and sky. In a pixel of several surfaces light counts as much as
    each of them reflects it. `color` is the picture, denoised from single samples: near `parts`,
    which is made of smoothed light, with sharper gloss and less noise.

    `nan_pixels` counts pixels with samples that are not finite, and `nan_surfels` such surfels;
    both count as 0. `lost_pixels` counts pixels without any other samples.
    """

    direct: Float32Array
    indirect: Float32Array
    specular: Float32Array
    emitted: Float32Array
    albedo: Float32Array
    color: Float32Array
    nan_pixels: int = 0
    nan_surfels: int = 0
    lost_pixels: int = 0

    @property
    def statistics(self) -> dict[str, int]:
        """Numbers of values that are not finite, for the frame's attribute."""
        return {name: getattr(self, name) for name in ("nan_pixels", "nan_surfels", "lost_pixels")}

    @property
    def parts(self) -> Float32Array:
        """Sum of the parts: albedo x (direct + indirect) + specular + emitted."""
        return self.albedo * (self.direct + self.indirect) + self.specular + self.emitted


@dataclass(frozen=True)
class TransportSettings:
    """Settings of the trace, and the denoiser's version."""

    transport: TransportParams
    denoiser: str


def settings(params: TransportParams) -> dict[Kind, TransportSettings]:
    """Return the settings of a `transport` frame."""
    return {"transport": TransportSettings(params, denoiser_version())}


def render_transport(
    render_scene: RenderScene,
    view: View,
    params: TransportParams,
    seed: int,
    prepared: Preparation | None = None,
) -> tuple[Channels, dict[str, int]]:
    """Return the channels of a `transport` frame, float32 (H, W): light and picture.

    And the statistics of `Transport`. `seed` is the view's own seed, `prepared` as in
    `transport_of`. Raises `InputError` in a scalar variant, and for a panorama.
    """
    found = transport_of(render_scene, view, params, seed, prepared)
    bands = {TRANSPORT_DIRECT: found.direct, TRANSPORT_INDIRECT: found.indirect, RGB: found.color}
    channels = {
        name: np.ascontiguousarray(image[..., band])
        for names, image in bands.items()
        for band, name in enumerate(names)
    }
    return channels, found.statistics


def render_quick(
    scene: RenderScene,
    view: View,
    settings: Mapping[Kind, Any],
    seed: int,
    prepared: Preparation | None = None,
) -> dict[Kind, Result]:
    """Render light transport, and `noisy` samples of colour alone, for a picture.

    `settings`: `TransportParams`, and `GroundTruthParams` of the samples. Both use `prepared`, what
    `prepare_quick` returns for this view. `seed` is the root seed.
    """
    prepared = prepared or prepare_quick(scene, view, seed)
    made: dict[Kind, Result] = {}
    if "transport" in settings:
        own = _quick_seed(view, seed, "transport")
        made["transport"] = render_transport(scene, view, settings["transport"], own, prepared)
    if "noisy" in settings:
        own = _quick_seed(view, seed, "noisy")
        made["noisy"] = render_samples(scene, view, settings["noisy"], own, prepared), {}
    return made


def prepare_quick(scene: RenderScene, view: View, seed: int) -> Preparation:
    """Return guides and light plan of `render_quick`."""
    return prepare(scene, view, _quick_seed(view, seed, "transport"))


def _quick_seed(view: View, seed: int, kind: Kind) -> int:
    return derive(seed, "predict", view.scene_id, view.view_id, kind)


def transport_of(
    render_scene: RenderScene,
    view: View,
    params: TransportParams,
    seed: int,
    prepared: Preparation | None = None,
    quality: Quality = "high",
) -> Transport:
    """Compute the light transport of a view; as `render_transport`.

    `prepared`: what `prepare` returns for this view, if it is known already; its light plan has a
    seed of its own. `quality`: the denoiser's, of the picture.
    """
    if not integrator.available():
        raise InputError("transport needs a variant other than scalar_rgb; see pbrnet doctor")
    if not view.lens.is_pinhole:
        raise InputError(
            f"{view.view_id}: transport needs a perspective view without distortion, its pixels "
            "square"
        )
    launcher = _launcher(render_scene)
    prepared = prepared or prepare(render_scene, view, seed)
    lights = prepared.lights
    if lights is None:
        dark = np.zeros((view.height, view.width, 3), dtype=np.float32)
        return Transport(dark, dark, dark, dark, dark, dark)
    pixels = view.width * view.height
    size = grid_size(params.surfels or surfels_for(pixels), view.width, view.height)
    surfels = launcher.surfels(lights, view, size, seed)
    samples = Samples.of(params.samples or samples_for(pixels))
    images = gathered(launcher, lights, view, surfels, samples, params.bounces, seed)
    lost = np.max([images[name] for name in LOST], axis=0)
    clean = denoise(banded(images["color"]), *prepared.guides, quality)
    return Transport(
        images["direct"],
        images["indirect"],
        images["specular"] + images["panes"],
        images["emitted"],
        images["albedo"],
        stacked(clean),
        nan_pixels=int((lost > 0).sum()),
        nan_surfels=surfels.lost,
        lost_pixels=int((lost >= 1).sum()),
    )


def gathered(
    launcher: TransportLauncher,
    lights: PlannedLights,
    view: View,
    surfels: Surfels,
    samples: Samples,
    bounces: int,
    seed: int,
) -> dict[str, Float32Array]:
    """Return the images of `pbrnet.pipeline.transport.pixels` by the light of these surfels.

    As `TransportLauncher.pixels`.
    """
    cells = cells_of(surfels, view.eye)
    cache = LightTable(cells)
    light = launcher.light(lights, cache, view, samples, seed)
    entry, share, once = to_numpy(*LightSamples(*light)[-3:])
    rays = Rays.of(entry, share, once, cells)
    cache.fill(*solve(surfels, cells, rays, bounces))
    return launcher.pixels(lights, cache, view, samples, seed, light)


def samples_for(pixels: int) -> int:
    """Return the samples per pixel for images of this many pixels."""
    return next((samples for most, samples in _SAMPLES if pixels <= most), _FEWEST)


def surfels_for(pixels: int) -> int:
    """Return the number of surfels around a view for images of this many pixels."""
    return USUAL_SURFELS if pixels <= _SMALL else 2 * USUAL_SURFELS


def _launcher(render_scene: RenderScene) -> TransportLauncher:
    """Return the launcher of an open scene; a new one if its materials were made anew."""
    materials = render_scene.materials
    materials.lobes()
    return materials.kept(TransportLauncher, render_scene, version=materials.version)
