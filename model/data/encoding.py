"""From a view to what the networks take and give.

Inputs are scale-free where the target is: shading is tone-mapped by its own log average, so
brightening every light changes nothing, and panoramic intensity is taken relative to its mean
over the sphere. Logarithms tame the ranges: a bare bulb is 10^5 times a dim wall. Images are
centred about 0: without that a short training finds brightness but not colour.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, TypeVar

import numpy as np
import torch

from model.data.direct_light import panorama_radiance, pixel_directions, seen_sources, surface_light
from model.data.reader import Example
from pipeline.params import ToneParams
from pipeline.tonemap import Exposure, exposure_of, tonemap
from scenes.arrays import AnyArray
from scenes.color import encode_srgb, luminance
from scenes.errors import InputError

Value = TypeVar("Value", AnyArray, torch.Tensor)
Policy = Literal["own", "shared"]
Tensors = dict[str, torch.Tensor]

# Channels of every encoded input, and of what only some networks are given beside them.
DIRECT = 8
SAMPLES = 6
CHANNELS = {"depth": 2, "normal": 3, "intensity": 1, "distance": 1, "reflectance": 3}
RETURNED = 0.9  # of the light that surfaces pass on, what meets another: windows take the rest
FAINTEST = 0.02  # band of a light's colour, beside a luminance of 1
GREY = 0.5  # reflectance the networks are given where there is no surface
WHITE = 20.0  # scaled luminance that maps to white, as usual indoors, where it is not known
NEAR, MIDDLE, FAR = 0.05, 2.5, 100.0  # metres: depths and distances are clamped to the range


def encode(examples: Sequence[Example], direct: bool = False, noisy: bool = False) -> Tensors:
    """Network inputs, float32 (N, C, H, W), `CHANNELS` each; all views must be of one size.

    * `depth`: ln(depth / `MIDDLE`), 0 where there is no surface; and the validity mask
    * `normal`: camera frame, unit
    * `intensity`: relative to its mean over the sphere by solid angle; all 0 where no light shows
    * `distance`: metres, at most `FAR`; both are made logarithmic by the network, which may have
      to average them first
    * `reflectance`: `see_through`, sRGB-encoded and `centred`, like the display values it meets
    * `direct`, if asked for: `direct_shading` divided by the light's colour, tone-mapped by its own
      log average and `WHITE` and `centred`; ln of its luminance, relative to that average; ln of
      that colour, the same everywhere; and the share of the light that arrives. With it `tint`,
      (N, 3, 1, 1): the colour, see `light_color`; `gain`, (N, 3, 1, 1), see `interreflection`; and
      `brightness`, (N, 1, 1, 1): the log average of reflectance times tint and gain, as much as
      colour is brighter than shading of `GREY`
    * `noisy` and `denoised`, if asked for: colour and shading of few samples, linear radiance, as
      they were traced and denoised. `InputError` for a view without
    """
    given = {
        "depth": _stack([_depth(example) for example in examples]),
        "normal": _stack([example.normal for example in examples]),
        "intensity": _stack([_intensity(example.intensity) for example in examples]),
        "distance": _stack([np.minimum(example.distance, FAR)[..., None] for example in examples]),
        "reflectance": reflectances(examples),
    }
    if direct:
        known = [_direct(example) for example in examples]
        given |= {name: _stack([each[name] for each in known]) for name in known[0]}
    if noisy:
        given["noisy"] = _stack([_both(e, e.noisy_color, e.noisy_shading) for e in examples])
        given["denoised"] = _stack(
            [_both(e, e.denoised_color, e.denoised_shading) for e in examples]
        )
    return given


def reflectances(examples: Sequence[Example]) -> torch.Tensor:
    """`encode`'s `reflectance` alone, which is all that the composition network sees of a view."""
    return _stack([centred(encode_srgb(see_through(e, GREY))) for e in examples])


def targets(examples: Sequence[Example], policy: Policy) -> Tensors:
    """Display values in [0, 1], float32 (N, 3, H, W): `shading` and `color`."""
    return {
        "shading": _stack([tonemap(e.shading, e.exposure_shading) for e in examples]),
        "color": _stack([tonemap(e.color, color_exposure(e, policy)) for e in examples]),
    }


def radiances(examples: Sequence[Example], policy: Policy) -> Tensors:
    """Linear truth for networks that predict it: `color` and `shading`, float32 (N, 3, H, W), and
    `exposure_color`, `exposure_shading`, float32 (N, 2, 1, 1): scale and white of their display."""
    exposures = {
        "exposure_color": [color_exposure(example, policy) for example in examples],
        "exposure_shading": [example.exposure_shading for example in examples],
    }
    return {
        "color": _stack([example.color for example in examples]),
        "shading": _stack([example.shading for example in examples]),
        **{
            name: _stack([np.array([[[e.scale, e.white]]]) for e in each])
            for name, each in exposures.items()
        },
    }


def color_exposure(example: Example, policy: Policy) -> Exposure:
    """`own`: the colour image's own exposure (the paper); `shared`: shading's for both."""
    return example.exposure_shading if policy == "shared" else example.exposure_color


def see_through(example: Example, grey: float) -> AnyArray:
    """Reflectance with `grey` where there is no surface, float32 (H, W, 3).

    What is seen through a window looks alike in shading and in colour, as a surface does whose
    reflectance is the grey of the shading frames. With the 0 of the dataset windows would be black.
    """
    return np.where(example.valid[..., None], example.reflectance, np.float32(grey))


def interreflection(example: Example) -> AnyArray:
    """How much more light than a room of `GREY` this one holds by its bounces, (1, 1, 3).

    Light that a surface passes on meets the next: of reflectance m each time, with `RETURNED` of
    it, that makes 1 + r m + (r m)^2 + ... = 1 / (1 - r m), as in an integrating sphere. m is the
    mean of what the view shows, band by band: it is this that makes a beige room orange.
    """
    if not example.valid.any():
        return np.ones((1, 1, 3), dtype=np.float32)
    mean = example.reflectance[example.valid].mean(axis=0, dtype=np.float64)
    gain = (1 - RETURNED * GREY) / (1 - RETURNED * mean)
    return gain.astype(np.float32).reshape(1, 1, 3)


def light_color(lit: AnyArray) -> AnyArray:
    """The mean colour of direct light (H, W, 3) on surfaces: linear RGB of luminance 1, (1, 1, 3).

    White in the dark. No band is below `FAINTEST`, so that light can be divided by it.
    """
    total = lit.sum(axis=(0, 1), dtype=np.float64)
    seen = float(luminance(total))
    color = np.maximum(total / seen, FAINTEST) if seen > 0 else np.ones(3)
    return (color / luminance(color)).astype(np.float32).reshape(1, 1, 3)


def centred(display: Value) -> Value:
    """Display values in [0, 1] to [-1, 1], as the networks take them."""
    return 2 * display - 1


def to_image(batch: torch.Tensor) -> AnyArray:
    """The first of (N, 3, H, W) network outputs as display values float32 (H, W, 3), [0, 1]."""
    return batch[0].detach().float().clamp(0, 1).permute(1, 2, 0).cpu().numpy()


def to_batch(image: AnyArray) -> torch.Tensor:
    """An image (H, W, 3) as (1, 3, H, W): `to_image` backwards."""
    return _stack([image])


def solid_angles(height: int, width: int) -> AnyArray:
    """Steradians of each pixel of an equirectangular image, float32 (height, 1)."""
    edges = np.cos(np.linspace(0, np.pi, height + 1))
    return ((edges[:-1] - edges[1:]) * (2 * np.pi / width)).astype(np.float32)[:, None]


def _depth(example: Example) -> AnyArray:
    log = np.log(np.clip(example.depth, NEAR, FAR) / MIDDLE)
    valid = example.valid.astype(np.float32)
    return np.stack([log * valid, valid], axis=-1)


def _direct(example: Example) -> dict[str, AnyArray]:
    """`encode`'s inputs of networks that are given the direct light, images (H, W, C)."""
    lit = surface_light(example, GREY)
    tint, gain = light_color(lit), interreflection(example)
    directions = pixel_directions(example.intrinsics, example.depth.shape)
    light = (lit + seen_sources(panorama_radiance(example), directions)) / tint
    scale = exposure_of(light, ToneParams()).scale
    display = tonemap(light, Exposure(scale, WHITE))
    log = np.log(np.maximum(luminance(light)[..., None] * scale / ToneParams().key, 1e-3)) / 4
    everywhere = np.broadcast_to(np.log(tint), display.shape)
    arrives = np.ones_like(log) if example.visibility is None else example.visibility[..., None]
    return {
        "direct": np.concatenate([centred(display), log, everywhere, arrives], axis=-1),
        "tint": tint,
        "gain": gain,
        "brightness": _brightness(example, tint * gain),
    }


def _brightness(example: Example, gain: AnyArray) -> AnyArray:
    held = see_through(example, GREY) * np.where(example.valid[..., None], gain, np.float32(1))
    return np.array([[[ToneParams().key / exposure_of(held, ToneParams()).scale / GREY]]])


def _both(example: Example, color: AnyArray | None, shading: AnyArray | None) -> AnyArray:
    if color is None or shading is None:
        raise InputError(f"{example.name}: comes without the noisy samples that the network takes")
    return np.concatenate([color, shading], axis=-1)


def _intensity(intensity: AnyArray) -> AnyArray:
    mean = float((intensity * solid_angles(*intensity.shape)).sum() / (4 * np.pi))
    return (intensity / mean if mean > 0 else np.zeros_like(intensity))[..., None]


def _stack(images: Sequence[AnyArray]) -> torch.Tensor:
    batch = np.stack(images).astype(np.float32).transpose(0, 3, 1, 2)
    return torch.from_numpy(np.ascontiguousarray(batch))
