"""Encoding of views for the networks: inputs and targets as tensors.

Inputs do not depend on the unit of radiance because the target does not: shading is tone-mapped by
its own log average, and panoramic intensity is relative to its mean over the sphere. Logarithms
compress the ranges: a bare bulb is 10^5 times as bright as a dim wall. Images are centred about 0:
otherwise a short training learns brightness but not colour.

The encoder takes NumPy arrays. While a network is exported (`model.release.onnx_export`) it takes
tensors, and torch's exporter traces it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, TypeVar

import numpy as np
import torch

from model.data.direct_light import direct_light as direct_light_of
from model.data.display import log_average
from model.data.reader import Example, ViewInputs
from pipeline.params import ToneParams
from pipeline.tonemap import Exposure, exposure_of, tonemap
from scenes.arrays import AnyArray, ArrayOrTensor, array_namespace
from scenes.color import encode_srgb, luminance
from scenes.errors import InputError

Value = TypeVar("Value", AnyArray, torch.Tensor)
Policy = Literal["own", "shared"]
Tensors = dict[str, torch.Tensor]

# Channels of every encoded input, then of the inputs that only some networks take.
CHANNELS = {"depth": 2, "normal": 3, "intensity": 1, "distance": 1, "reflectance": 3}
DIRECT_LIGHT_CHANNELS = 8
NOISY_SAMPLES_CHANNELS = 6
# Closed fraction of a room as an integrating sphere: the share of reflected light that reaches
# another surface. The rest leaves through windows.
CLOSED_FRACTION = 0.9
MIN_LIGHT_BAND = 0.02  # lower bound of each band of a light's colour, whose luminance is 1
NEUTRAL = 0.5  # reflectance input where there is no surface; albedo of the shading frames
DEFAULT_WHITE = 20.0  # exposed luminance that maps to white if it is unknown; typical indoors
# Metres: depths and distances are clamped to [MIN, MAX], and depth is relative to REFERENCE.
MIN_DEPTH, REFERENCE_DEPTH, MAX_DEPTH = 0.05, 2.5, 100.0


def encode(
    examples: Sequence[Example], direct_light: bool = False, noisy_samples: bool = False
) -> Tensors:
    """Network inputs, float32 (N, C, H, W), `CHANNELS` each; all views must be of one size.

    The tensors of `encode_inputs`. With `noisy_samples` also `noisy` and `denoised`: colour and
    shading of a few samples a pixel, before and after denoising, as linear radiance. Raises
    `InputError` for a view without noisy samples.
    """
    encoded = encode_inputs(examples, direct_light)
    if noisy_samples:
        encoded["noisy"] = _stack([_pair(e, e.noisy_color, e.noisy_shading) for e in examples])
        encoded["denoised"] = _stack(
            [_pair(e, e.denoised_color, e.denoised_shading) for e in examples]
        )
    return encoded


def encode_inputs(views: Sequence[ViewInputs], direct_light: bool = False) -> Tensors:
    """Encode the inputs as float32 (N, C, H, W), `CHANNELS` each; traceable, see the module.

    * `depth`: ln(depth / `REFERENCE_DEPTH`), 0 where there is no surface; and the validity mask
    * `normal`: camera frame, unit
    * `intensity`: relative to its mean over the sphere; all 0 if no light is visible
    * `distance`: metres, at most `MAX_DEPTH`. The network takes the logarithms of intensity and
      distance itself, because it may average them first.
    * `reflectance`: `neutral_background`, sRGB-encoded and `centred` like display values

    With `direct_light` also:

    * `direct`, 8 channels: `direct_shading` divided by the light's colour, tone-mapped by its own
      log average and `DEFAULT_WHITE`, and `centred` (3); ln(luminance / log average) / 4 (1); ln of
      the light's colour, constant over the image (3); the visibility of the sources (1)
    * `tint`, (N, 3, 1, 1): the light's colour, see `light_color`
    * `gain`, (N, 3, 1, 1): see `interreflection`
    * `brightness`, (N, 1, 1, 1): log average of reflectance x tint x gain, divided by `NEUTRAL`;
      the ratio of colour's brightness to shading's
    """
    encoded = {
        "depth": _stack([_depth(view) for view in views]),
        "normal": _stack([view.normal for view in views]),
        "intensity": _stack([_relative_intensity(view.intensity) for view in views]),
        "distance": _stack([_clamped_distance(view.distance) for view in views]),
        "reflectance": encode_reflectance(views),
    }
    if direct_light:
        known = [_direct_light(view) for view in views]
        encoded |= {name: _stack([each[name] for each in known]) for name in known[0]}
    return encoded


def encode_reflectance(views: Sequence[ViewInputs]) -> torch.Tensor:
    """`reflectance` of `encode_inputs` alone, for the composition network."""
    return _stack([centred(encode_srgb(neutral_background(view, NEUTRAL))) for view in views])


def targets(examples: Sequence[Example], policy: Policy) -> Tensors:
    """Display values in [0, 1], float32 (N, 3, H, W): `shading` and `color`."""
    return {
        "shading": _stack([tonemap(e.shading, e.exposure_shading) for e in examples]),
        "color": _stack([tonemap(e.color, color_exposure(e, policy)) for e in examples]),
    }


def radiances(examples: Sequence[Example], policy: Policy) -> Tensors:
    """Linear targets for networks that predict radiance.

    `color` and `shading`: float32 (N, 3, H, W). `exposure_color` and `exposure_shading`: float32
    (N, 2, 1, 1), the scale and the white point that display them.
    """
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
    """Exposure of colour: its own under the policy `own` (the paper), shading's under `shared`."""
    return example.exposure_shading if policy == "shared" else example.exposure_color


def neutral_background(view: ViewInputs, neutral: float) -> ArrayOrTensor:
    """Reflectance with `neutral` where there is no surface, float32 (H, W, 3).

    The view through a window is the same in shading and in colour. The same holds for a surface
    with the neutral grey of the shading frames, so `neutral` makes reflectance x shading right
    there. The dataset stores 0, which would make windows black.
    """
    xp = array_namespace(view.reflectance)
    return xp.where(view.valid[..., None], view.reflectance, neutral)


def interreflection(view: ViewInputs) -> ArrayOrTensor:
    """Gain by interreflection in this room relative to a room of `NEUTRAL`, (1, 1, 3).

    The room is taken as an integrating sphere. With the mean reflectance m and the closed fraction
    f, all bounces add up to 1 + f m + (f m)^2 + ... = 1 / (1 - f m). m is the mean over the visible
    surfaces in each band, so a beige room gets orange light.
    """
    xp = array_namespace(view.reflectance)
    surfaces = view.valid.sum()
    total = (view.reflectance * view.valid[..., None]).sum(axis=(0, 1), dtype=xp.float64)
    mean = total / xp.clip(surfaces, 1, None)
    gain = (1 - CLOSED_FRACTION * NEUTRAL) / (1 - CLOSED_FRACTION * mean)
    gain = xp.where(surfaces > 0, gain, 1.0)
    return xp.asarray(gain, dtype=xp.float32).reshape(1, 1, 3)


def light_color(reflected: ArrayOrTensor) -> ArrayOrTensor:
    """Mean colour (1, 1, 3) of the direct light (H, W, 3) on surfaces: linear RGB of luminance 1.

    White if there is no light. Bands are clipped at `MIN_LIGHT_BAND` before the normalisation, so
    that light can be divided by the colour.
    """
    xp = array_namespace(reflected)
    total = reflected.sum(axis=(0, 1), dtype=xp.float64)
    brightness = luminance(total)
    color = xp.clip(total / xp.where(brightness > 0, brightness, 1.0), MIN_LIGHT_BAND, None)
    color = xp.where(brightness > 0, color, 1.0)
    return xp.asarray(color / luminance(color), dtype=xp.float32).reshape(1, 1, 3)


def centred(display: Value) -> Value:
    """Map display values from [0, 1] to [-1, 1], the range of the networks' inputs."""
    return 2 * display - 1


def to_image(batch: torch.Tensor) -> AnyArray:
    """The first image of a batch (N, 3, H, W) as display values float32 (H, W, 3), [0, 1]."""
    return batch[0].detach().float().clamp(0, 1).permute(1, 2, 0).cpu().numpy()


def to_batch(image: AnyArray) -> torch.Tensor:
    """An image (H, W, 3) as a batch (1, 3, H, W); the inverse of `to_image`."""
    return _stack([image])


def solid_angles(panorama: ArrayOrTensor) -> ArrayOrTensor:
    """Solid angle in steradians of each row's pixels of a panorama (h, w), float32 (h, 1)."""
    xp = array_namespace(panorama)
    height, width = panorama.shape
    edges = xp.cos(xp.arange(height + 1, dtype=xp.float64) * (np.pi / height))
    strips = (edges[:-1] - edges[1:]) * (2 * np.pi / width)
    return xp.asarray(strips, dtype=xp.float32)[:, None]


def _depth(view: ViewInputs) -> ArrayOrTensor:
    xp = array_namespace(view.depth)
    log = xp.log(xp.clip(view.depth, MIN_DEPTH, MAX_DEPTH) / REFERENCE_DEPTH)
    valid = xp.asarray(view.valid, dtype=xp.float32)
    return xp.stack([log * valid, valid], axis=-1)


def _relative_intensity(intensity: ArrayOrTensor) -> ArrayOrTensor:
    xp = array_namespace(intensity)
    mean = (intensity * solid_angles(intensity)).sum() / (4 * np.pi)
    relative = intensity / xp.where(mean > 0, mean, xp.ones_like(mean))
    return xp.where(mean > 0, relative, 0.0)[..., None]


def _clamped_distance(distance: ArrayOrTensor) -> ArrayOrTensor:
    return array_namespace(distance).clip(distance, None, MAX_DEPTH)[..., None]


def _direct_light(view: ViewInputs) -> dict[str, ArrayOrTensor]:
    """Inputs that `direct_light=True` adds to `encode_inputs`, images (H, W, C)."""
    xp = array_namespace(view.depth)
    key = ToneParams().key
    reflected, sources_in_view = direct_light_of(view, NEUTRAL)
    tint, gain = light_color(reflected), interreflection(view)
    light = (reflected + sources_in_view) / tint
    scale = _exposure_scale(light)
    display = tonemap(light, Exposure(scale, DEFAULT_WHITE))
    log = xp.log(xp.clip(luminance(light)[..., None] * scale / key, 1e-3, None)) / 4
    everywhere = xp.broadcast_to(xp.log(tint), display.shape)
    arrives = xp.ones_like(log) if view.visibility is None else view.visibility[..., None]
    lit = neutral_background(view, NEUTRAL) * xp.where(view.valid[..., None], tint * gain, 1.0)
    brightness = key / _exposure_scale(lit) / NEUTRAL
    return {
        "direct": xp.concatenate([centred(display), log, everywhere, arrives], axis=-1),
        "tint": tint,
        "gain": gain,
        "brightness": xp.asarray(brightness).reshape(1, 1, 1),
    }


def _exposure_scale(image: ArrayOrTensor) -> ArrayOrTensor:
    """`Exposure.scale` of linear radiance (H, W, 3) by its own log average, a number."""
    if array_namespace(image) is np:
        return exposure_of(image, ToneParams()).scale
    return ToneParams().key / log_average(luminance(image)[None, None])[0, 0, 0, 0]


def _pair(example: Example, color: AnyArray | None, shading: AnyArray | None) -> AnyArray:
    if color is None or shading is None:
        raise InputError(
            f"{example.name}: has no noisy samples, which the network takes as input; set "
            "noisy.spp to 1 to 4, then run: pbrnet groundtruth, pbrnet dataset"
        )
    return np.concatenate([color, shading], axis=-1)


def _stack(images: Sequence[ArrayOrTensor]) -> torch.Tensor:
    """Images (H, W, C) as one batch, float32 (N, C, H, W)."""
    if array_namespace(images[0]) is torch:
        return torch.stack(list(images)).float().permute(0, 3, 1, 2)
    batch = np.stack(images).astype(np.float32).transpose(0, 3, 1, 2)
    return torch.from_numpy(np.ascontiguousarray(batch))
