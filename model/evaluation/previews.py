"""Pictures without a network: by light transport, or by a few path-traced samples, denoised."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pbrnet.model.evaluation.predict import ViewRenderer
from pbrnet.pipeline.channels import RGB, TRANSPORT_DIRECT, TRANSPORT_INDIRECT
from pbrnet.pipeline.frames import Channels, stacked, write_pixels
from pbrnet.pipeline.images import Picture, contact_sheet, error_picture
from pbrnet.pipeline.passes.denoise import Quality
from pbrnet.pipeline.passes.settings import GroundTruthParams
from pbrnet.pipeline.passes.transport import Transport, transport_of
from pbrnet.pipeline.passes.truth import trace_denoised
from pbrnet.pipeline.photograph import meter, photograph
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.pipeline.tonemap import exposure_of, tonemap
from pbrnet.pipeline.transport.settings import TRANSPORT_SAMPLES, TransportParams
from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import Float32Array
from pbrnet.scenes.errors import ParameterError
from pbrnet.scenes.seeds import derive

RADIOSITY, DENOISED = "radiosity", "denoised"
PREVIEWS: tuple[str, ...] = (RADIOSITY, DENOISED)  # methods without a network
DENOISED_SPP = 16  # by default
MOST_DENOISED = 4096  # samples per pixel


@dataclass(frozen=True)
class Rendering:
    """A picture of a view, linear (H, W, 3), and the light transport that it is of, if it is."""

    color: Float32Array
    transport: Transport | None = None


@dataclass(frozen=True)
class Preview:
    """Pictures of a scene's views.

    `spp`: samples per pixel; 0: by the image's size for `radiosity`, `DENOISED_SPP` for `denoised`.
    `quality` is the denoiser's. Raises `ParameterError` for a number of samples that the method
    does not have.
    """

    renderer: ViewRenderer
    method: str = RADIOSITY
    spp: int = 0
    quality: Quality = "high"

    def __post_init__(self) -> None:
        check_samples(self.method, self.spp)

    def render(self, view: View) -> Rendering:
        """Render a view. Raises `InputError` for light transport in a scalar variant."""
        scene, given = self.renderer.scene, self.renderer.params
        if self.method == RADIOSITY:
            return radiosity(scene, view, given.transport, given.seed, self.spp, self.quality)
        spp = self.spp or DENOISED_SPP
        return denoised(scene, view, given.groundtruth, given.seed, spp, self.quality)

    def compare(self, view: View, found: Rendering) -> tuple[Picture, str]:
        """Return picture, truth, FLIP error and light side by side, and a line of metrics."""
        from pbrnet.model.evaluation.metrics import flip_map, measure

        truth = _stacked(self.renderer.truth(view)[1])
        exposure = exposure_of(truth, self.renderer.params.tone)
        shown = [tonemap(image, exposure) for image in (truth, found.color)]
        values = measure(*shown)
        settings = meter(truth)
        pictures = {
            self.method: photograph(found.color, settings),
            "truth": photograph(truth, settings),
            f"FLIP error, mean {values['flip']:.3f}": error_picture(flip_map(*shown)),
        }
        if found.transport is not None:
            parts = found.transport
            light = meter(parts.direct + parts.indirect)
            pictures |= {
                "direct light": photograph(parts.direct, light),
                "indirect light": photograph(parts.indirect, light),
                "gloss, lamps, sky": photograph(parts.specular + parts.emitted, settings),
            }
        sheet = contact_sheet(list(pictures.values()), columns=3, labels=tuple(pictures))
        words = f"SSIM {values['ssim']:.3f}, PSNR {values['psnr']:.1f} dB"
        return sheet, f"{words}, FLIP {values['flip']:.3f}"


def check_samples(method: str, spp: int) -> None:
    """Raise `ParameterError` unless 0, the default, or a number of samples that the method has."""
    if method == RADIOSITY and spp and spp not in TRANSPORT_SAMPLES:
        allowed = ", ".join(map(str, TRANSPORT_SAMPLES))
        raise ParameterError(f"--spp: {spp} is not allowed; {RADIOSITY} takes {allowed}")
    if method == DENOISED and spp > MOST_DENOISED:
        raise ParameterError(f"--spp: {spp} is not allowed; at most {MOST_DENOISED}")


def radiosity(
    scene: RenderScene,
    view: View,
    params: TransportParams,
    root_seed: int,
    spp: int = 0,
    quality: Quality = "high",
) -> Rendering:
    """Compute the picture of light transport; with `spp`, few samples take few surfels too."""
    seed = derive(root_seed, "predict", view.scene_id, view.view_id, RADIOSITY)
    settings = params.reduced(spp) if spp else params
    found = transport_of(scene, view, settings, seed, quality=quality)
    return Rendering(found.color, found)


def denoised(
    scene: RenderScene,
    view: View,
    params: GroundTruthParams,
    root_seed: int,
    spp: int,
    quality: Quality = "high",
) -> Rendering:
    """Path-trace a view with `spp` samples per pixel and denoise it; colour alone."""
    seed = derive(root_seed, "predict", view.scene_id, view.view_id, "noisy")
    settings = params.sampled(spp)
    _, _, clean = trace_denoised(scene, view, settings, seed, quality=quality)
    return Rendering(_stacked(clean))


def write_rendering(
    path: Path, facts: dict[str, Any], view: View, found: Rendering, method: str
) -> str:
    """Write linear radiance as OpenEXR by rename, float32, in the scene's unit.

    Channels: `R`, `G`, `B`, the picture; of light transport also `direct.R` and so on and
    `indirect.R` and so on, the light on the surfaces without their reflectance.
    """
    images = {RGB: found.color}
    if found.transport is not None:
        images |= {
            TRANSPORT_DIRECT: found.transport.direct,
            TRANSPORT_INDIRECT: found.transport.indirect,
        }
    pixels: Channels = {
        name: image[..., band].astype(np.float32)
        for names, image in images.items()
        for band, name in enumerate(names)
    }
    meta = {"kind": "prediction", "method": method, "unit": "the scene's", **facts}
    write_pixels(path, pixels, view, meta)
    return "unit: the scene's"


def _stacked(channels: Channels) -> Float32Array:
    return stacked(channels)
