"""Light of a view taken apart: the channels of a `light` frame, from the trace that makes colour.

Stored are direct light, diffuse light and irradiance; each is denoised by itself if colour is, and
direct and diffuse light are at most colour as its frame stores it. The rest (indirect, specular,
residual) is what these leave of it, so that the parts add up to the colour that is stored.

Light groups are denoised likewise, scaled to add up to colour, and rounded to half floats. What
rounding leaves of colour is added to the brightest group of each pixel.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.channels import DIFFUSE, DIRECT, IRRADIANCE, RGB
from pipeline.frames import Channels, as_stored, pixels_digest
from pipeline.passes.denoise import Image, denoise, denoiser_version, grey_guide
from pipeline.passes.groundtruth import REMAINDERS, Truths
from pipeline.pathtrace.light_groups import LightGroups
from pipeline.pathtrace.light_parts import group_names
from scenes.arrays import Float32Array

REVISION = 1  # raise it when a channel is added, or a change of code changes pixels
_GREY = 0.5  # albedo guide of irradiance, which no texture marks
_STORED = {"direct": DIRECT, "diffuse": DIFFUSE, "irradiance": IRRADIANCE}


def light_of(
    truths: Truths,
    color: Channels,
    guides: tuple[Image, Image] | None,
    groups: LightGroups | None = None,
) -> tuple[Channels, dict[str, Any]]:
    """Return the channels of a `light` frame, float32 (H, W), and entries of its attribute.

    `truths` holds parts; `color` is colour as its pass returns it; `guides` are the denoiser's,
    None if colour was not denoised. The entries: `noise_PART`, the noise estimate of every part
    before denoising; `color_digest`, the digest of the colour frame that the parts belong to; with
    `groups` also `light_names` and `noise_lights` of each.
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
    facts |= {f"noise_{name}": truths.parts[name][1]["noise"] for name in (*_STORED, *REMAINDERS)}
    facts["lost_pixels"] = max(truths.parts[name][1]["lost_pixels"] for name in _STORED)
    facts["color_digest"] = pixels_digest(stored)
    if guides is not None:
        facts["denoiser"] = denoiser_version()
    if groups is not None:
        names = group_names(len(groups.names))
        images = [_group(truths.parts[name][0], guides) for name in names]
        limit = np.stack([stored[band] for band in RGB], axis=-1).astype(np.float32)
        for name, image in zip(names, adding_up(np.stack(images), limit), strict=True):
            channels |= {f"{name}.{band}": image[..., i] for i, band in enumerate(RGB)}
        facts["light_names"] = list(groups.names)
        facts["noise_lights"] = [truths.parts[name][1]["noise"] for name in names]
    return channels, facts


def adding_up(images: Float32Array, color: Float32Array) -> Float32Array:
    """Scale images (N, H, W, 3) so that they add up to colour (H, W, 3) in half floats.

    The sum differs from colour by at most the rounding of the brightest of them.
    """
    total = images.sum(axis=0)
    dark = total <= 0
    brightest = int(images.mean(axis=(1, 2, 3)).argmax())
    images = images * np.divide(color, total, out=np.zeros_like(total), where=~dark)
    images[brightest] = np.where(dark, color, images[brightest])
    halves: Float32Array = images.astype(np.float16).astype(np.float32)
    largest = halves.argmax(axis=0)[None]
    rest = color - halves.sum(axis=0)
    filled = np.maximum(np.take_along_axis(halves, largest, axis=0) + rest, 0)
    np.put_along_axis(halves, largest, filled, axis=0)
    return halves


def _group(channels: Channels, guides: tuple[Image, Image] | None) -> Float32Array:
    """Return a light group as (H, W, 3), denoised if there is any light in it."""
    if guides is not None and any(channels[band].any() for band in RGB):
        channels = denoise(channels, *guides)
    return np.stack([channels[band] for band in RGB], axis=-1)
