"""Method `radiosity`: pictures of views by light transport alone."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from model.evaluation.metrics import flip_map, measure
from model.evaluation.predict import known_truth, trace_truth
from pipeline.channels import RGB, TRANSPORT_DIRECT, TRANSPORT_INDIRECT
from pipeline.frames import Channels, write_pixels
from pipeline.images import Picture, contact_sheet, error_picture
from pipeline.params import Params
from pipeline.passes.transport import Transport, transport_of
from pipeline.photograph import meter, photograph
from pipeline.render.scene import RenderScene, open_scene, set_variant
from pipeline.tonemap import exposure_of, tonemap
from pipeline.views import View
from scenes.arrays import Float32Array
from scenes.contract import load_scene
from scenes.seeds import derive

METHOD = "radiosity"


@dataclass
class Preview:
    """Pictures of a scene's views; the scene is opened for the first of them."""

    scene_folder: Path
    params: Params
    data: Path  # where true images may be
    _opened: RenderScene | None = None

    def transport(self, view: View) -> Transport:
        """Compute the light transport of a view. Raises `InputError` in a scalar variant."""
        seed = derive(self.params.seed, "predict", view.scene_id, view.view_id, METHOD)
        return transport_of(self.scene, view, self.params.transport, seed)

    def truth(self, view: View) -> Float32Array:
        """Return the true colour of a view, (H, W, 3): that in `data`, or path traced now."""
        known = known_truth(self.data, view)
        if known is not None:
            return known[1].rgb
        color = trace_truth(self.scene, view, self.params)[1]
        return np.stack([color[band] for band in RGB], axis=-1)

    def compare(self, view: View, found: Transport) -> tuple[Picture, str]:
        """Return picture, truth, FLIP error and light side by side, and a line of metrics."""
        truth = self.truth(view)
        exposure = exposure_of(truth, self.params.tone)
        shown = [tonemap(image, exposure) for image in (truth, found.color)]
        values = measure(*shown)
        settings = meter(truth)
        light = meter(found.direct + found.indirect)
        pictures = {
            "radiosity": photograph(found.color, settings),
            "truth": photograph(truth, settings),
            f"FLIP error, mean {values['flip']:.3f}": error_picture(flip_map(*shown)),
            "direct light": photograph(found.direct, light),
            "indirect light": photograph(found.indirect, light),
            "gloss, lamps, sky": photograph(found.specular + found.emitted, settings),
        }
        sheet = contact_sheet(list(pictures.values()), columns=3, labels=tuple(pictures))
        words = f"SSIM {values['ssim']:.3f}, PSNR {values['psnr']:.1f} dB"
        return sheet, f"{words}, FLIP {values['flip']:.3f}"

    @property
    def scene(self) -> RenderScene:
        """The open scene."""
        if self._opened is None:
            set_variant(self.params.farm.variant)
            self._opened = open_scene(load_scene(self.scene_folder))
        return self._opened


def write_transport(path: Path, view: View, found: Transport, facts: dict[str, Any]) -> None:
    """Write linear radiance as OpenEXR by rename, float32.

    Channels: `R`, `G`, `B`, the picture; `direct.R` and so on and `indirect.R` and so on, the light
    on the surfaces without their reflectance. The unit is the scene's.
    """
    images = {RGB: found.color, TRANSPORT_DIRECT: found.direct, TRANSPORT_INDIRECT: found.indirect}
    pixels: Channels = {
        name: image[..., band].astype(np.float32)
        for names, image in images.items()
        for band, name in enumerate(names)
    }
    meta = {"kind": "prediction", "method": METHOD, "unit": "the scene's", **facts}
    write_pixels(path, pixels, view, meta)
