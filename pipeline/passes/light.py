"""Light of a view taken apart: the channels of a `light` frame, from the trace that makes colour.

If colour is denoised, so is each part by itself, in the denoiser's fast mode. Direct and indirect
light are then scaled, pixel by pixel, to add up to colour as its frame stores it; so are diffuse
and specular light, and the light groups. As remainders of denoised images, indirect and specular
light would hold the errors of both. Stored are direct and diffuse light and irradiance; the rest
(indirect, specular, residual) is what these leave of colour.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from pbrnet.pipeline.channels import DIFFUSE, DIRECT, IRRADIANCE, RGB
from pbrnet.pipeline.frames import Channels, as_stored, banded, frame_scale, pixels_digest, stacked
from pbrnet.pipeline.passes.denoise import Image, denoise, denoiser_version, grey_guide
from pbrnet.pipeline.passes.groundtruth import REMAINDERS, Truths
from pbrnet.pipeline.pathtrace.light_parts import LightGroups, group_names
from pbrnet.scenes.arrays import Float32Array

_GREY = 0.5  # albedo guide of irradiance, which no texture marks
_STORED = {"direct": DIRECT, "diffuse": DIFFUSE, "irradiance": IRRADIANCE}


def light_of(
    truths: Truths,
    color: Channels,
    guides: tuple[Image, Image] | None,
    groups: LightGroups | None = None,
    around: bool = False,
) -> tuple[Channels, dict[str, Any]]:
    """Return the channels of a `light` frame, float32 (H, W), and entries of its attribute.

    `truths` holds parts; `color` is colour as its pass returns it; `guides` are the denoiser's,
    None if colour was not denoised, `around` is true for a panorama. The entries: `noise_PART`, the
    noise estimate of every part before denoising; `color_digest`, the digest of the colour frame
    that the parts belong to, and its `radiance_scale`; with `groups` also `light_names` and
    `noise_lights` of each.
    """
    scale = frame_scale("color", color)
    stored = as_stored("color", color, scale)
    limit = stacked(stored).astype(np.float32) * np.float32(scale)

    def cleaned(name: str) -> Float32Array:
        return _denoised(truths.parts[name][0], guides, around)

    channels: Channels = {}
    for name, rest in zip(("direct", "diffuse"), REMAINDERS, strict=True):
        part, _ = adding_up(np.stack([cleaned(name), cleaned(rest)]), limit, scale)
        channels |= banded(part, _STORED[name])
    grey = None if guides is None else (grey_guide(guides[1], _GREY), guides[1])
    channels |= banded(_denoised(truths.parts["irradiance"][0], grey, around), IRRADIANCE)
    statistics = truths.color[1]
    facts: dict[str, Any] = {name: statistics[name] for name in ("spp", "blocks")}
    facts |= {f"noise_{name}": truths.parts[name][1]["noise"] for name in (*_STORED, *REMAINDERS)}
    facts["lost_pixels"] = max(truths.parts[name][1]["lost_pixels"] for name in _STORED)
    facts |= {"color_digest": pixels_digest(stored), "radiance_scale": scale}
    if guides is not None:
        facts["denoiser"] = denoiser_version()
    if groups is not None:
        names = group_names(len(groups.names))
        images = adding_up(np.stack([cleaned(name) for name in names]), limit, scale)
        for name, image in zip(names, images, strict=True):
            channels |= banded(image, tuple(f"{name}.{band}" for band in RGB))
        facts["light_names"] = list(groups.names)
        facts["noise_lights"] = [truths.parts[name][1]["noise"] for name in names]
    return channels, facts


def adding_up(images: Float32Array, color: Float32Array, unit: float) -> Float32Array:
    """Scale images (N, H, W, 3) so that they add up to colour (H, W, 3) in half floats.

    They are stored in `unit`, a power of two. The sum differs from colour by at most the rounding
    of the brightest of them.
    """
    total = images.sum(axis=0)
    dark = total <= 0
    brightest = int(images.mean(axis=(1, 2, 3)).argmax())
    images, color, total = images / unit, color / unit, total / unit
    images = images * np.divide(color, total, out=np.zeros_like(total), where=~dark)
    images[brightest] = np.where(dark, color, images[brightest])
    halves: Float32Array = images.astype(np.float16).astype(np.float32)
    largest = halves.argmax(axis=0)[None]
    rest = color - halves.sum(axis=0)
    filled = np.maximum(np.take_along_axis(halves, largest, axis=0) + rest, 0)
    np.put_along_axis(halves, largest, filled, axis=0)
    return halves * np.float32(unit)


def _denoised(channels: Channels, guides: tuple[Image, Image] | None, around: bool) -> Float32Array:
    """Return an image as (H, W, 3), denoised if there are guides, and any light in it."""
    if guides is not None and any(channels[band].any() for band in RGB):
        channels = denoise(channels, *guides, "fast", around)
    return stacked(channels)
