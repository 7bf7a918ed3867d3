"""Light of a view taken apart: the channels of a `light` frame, from the trace that makes colour.

Stored are direct light, diffuse light and irradiance; each is denoised by itself if colour is, and
direct and diffuse light are at most colour as its frame stores it. The rest (indirect, specular,
residual) is what these leave of it, so that the parts add up to the colour that is stored.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.channels import DIFFUSE, DIRECT, IRRADIANCE, RGB
from pipeline.frames import Channels, as_stored, pixels_digest
from pipeline.passes.denoise import Image, denoise, denoiser_version, grey_guide
from pipeline.passes.groundtruth import PARTS, Truths

REVISION = 1  # raise it when a channel is added, or a change of code changes pixels
_GREY = 0.5  # albedo guide of irradiance, which no texture marks
_STORED = {"direct": DIRECT, "diffuse": DIFFUSE, "irradiance": IRRADIANCE}


def light_of(
    truths: Truths, color: Channels, guides: tuple[Image, Image] | None
) -> tuple[Channels, dict[str, Any]]:
    """Return the channels of a `light` frame, float32 (H, W), and entries of its attribute.

    `truths` holds parts; `color` is colour as its pass returns it; `guides` are the denoiser's,
    None if colour was not denoised. The entries: `noise_PART`, the noise estimate of every part
    before denoising; `color_digest`, the digest of the colour frame that the parts belong to.
    """
    stored = as_stored("color", color)
    channels: Channels = {}
    for name, bands in _STORED.items():
        part = truths.parts[name][0]
        if guides is not None:
            albedo, normal = guides
            if name == "irradiance":
                albedo = grey_guide(normal, _GREY)
            part = denoise(part, albedo, normal)
        for band, own in zip(RGB, bands, strict=True):
            values = part[band]
            if name != "irradiance":
                values = np.minimum(values, stored[band].astype(np.float32))
            channels[own] = values
    statistics = truths.color[1]
    facts: dict[str, Any] = {name: statistics[name] for name in ("spp", "blocks")}
    facts |= {f"noise_{name}": truths.parts[name][1]["noise"] for name in PARTS}
    facts["lost_pixels"] = max(truths.parts[name][1]["lost_pixels"] for name in _STORED)
    facts["color_digest"] = pixels_digest(stored)
    if guides is not None:
        facts["denoiser"] = denoiser_version()
    return channels, facts
