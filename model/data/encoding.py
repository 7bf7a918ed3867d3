"""Encoding of views for the networks: inputs and targets as tensors.

`INPUTS` is the table of the networks' inputs. The paper's inputs do not depend on the unit of
radiance because the target does not: shading is tone-mapped by its own log average, and panoramic
intensity is relative to its mean over the sphere. Light transport and noisy samples keep the unit,
and so do the networks that take them. Logarithms compress the ranges: a bare bulb is 10^5 times as
bright as a dim wall. Images are centred about 0: otherwise a short training learns brightness but
not colour.

The encoder takes NumPy arrays. While a network is exported (`pbrnet.model.release.onnx_export`) it
takes tensors, and torch's exporter traces it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal, TypeVar

import numpy as np
import torch

from pbrnet.model.data.direct_light import lamps_in_view, mean_bounces, reflected_light
from pbrnet.model.data.display import (
    DEFAULT_WHITE,
    displayed_product,
    log_average,
    luminance,
    tonemap_exposed,
)
from pbrnet.model.data.reader import PAPER, Columns, Example
from pbrnet.model.methods import JOINS, MAX_SAMPLES, PAPER_INPUTS, Join
from pbrnet.pipeline.channels import column_channel
from pbrnet.pipeline.tonemap import Exposure, ToneParams, tonemap
from pbrnet.scenes.arrays import AnyArray, ArrayOrTensor, array_namespace
from pbrnet.scenes.color import encode_srgb

Value = TypeVar("Value", AnyArray, torch.Tensor)
Policy = Literal["own", "shared"]
Tensors = dict[str, torch.Tensor]

NEUTRAL = 0.5  # reflectance input where there is no surface; albedo of the shading frames
# Metres: depths and distances are clamped to [MIN, MAX], and depth is relative to REFERENCE.
MIN_DEPTH, REFERENCE_DEPTH, MAX_DEPTH = 0.05, 2.5, 100.0
_DIRECT = ("depth", "valid", "normal", "intensity", "distance", "K")  # columns of direct light
DIRECT_RANGE = (1e-3, 1e3)  # of exposed direct light before its logarithm


@dataclass(frozen=True)
class Input:
    """An input of networks: the columns it is made of, its channels and its encoding.

    `encode` returns an image (H, W, channels). An `optional` input is 0 for views without its
    columns. One that is `whole` is no image of the view: a panorama, or a number (1, 1, 1).
    """

    columns: tuple[str, ...]
    channels: int
    encode: Callable[[Columns], ArrayOrTensor]
    optional: bool = False
    whole: bool = False

    def of(self, view: Columns) -> ArrayOrTensor:
        """The encoded input of a view."""
        if self.optional and not all(name in view for name in self.columns):
            xp = array_namespace(view["depth"])
            return xp.stack([xp.zeros_like(view["depth"])] * self.channels, axis=-1)
        return self.encode(view)


def encode(views: Sequence[Columns], inputs: Iterable[str] = PAPER_INPUTS) -> Tensors:
    """Inputs of networks by name, float32 (N, C, H, W); all views must be of one size.

    Traceable, see the module. Raises `InputError` for a view without a column that an input needs.
    """
    return {name: _stack([input_named(name).of(view) for view in views]) for name in inputs}


def input_named(name: str) -> Input:
    """The input of this name: of `INPUTS`, else an image column as it is.

    Raises `KeyError` if it is neither.
    """
    return INPUTS.get(name) or _images(name)


def input_columns(inputs: Iterable[str]) -> tuple[str, ...]:
    """Columns beyond the paper's that a view must have for these inputs."""
    needed = [
        column
        for name in inputs
        if not input_named(name).optional
        for column in input_named(name).columns
    ]
    return tuple(dict.fromkeys(column for column in needed if column not in (*PAPER, "K")))


def targets(examples: Sequence[Example], policy: Policy) -> Tensors:
    """Display values in [0, 1], float32 (N, 3, H, W): `shading` and `color`."""
    return {
        "shading": _stack([tonemap(e["shading"], shading_exposure(e, policy)) for e in examples]),
        "color": _stack([tonemap(e["color"], color_exposure(e, policy)) for e in examples]),
    }


def radiances(examples: Sequence[Example], policy: Policy) -> Tensors:
    """Linear targets for networks that predict radiance.

    `color`: float32 (N, 3, H, W). `exposure`: float32 (N, 2, 1, 1), the scale and the white point
    that display it.
    """
    exposures = [color_exposure(example, policy) for example in examples]
    return {
        "color": _stack([example["color"] for example in examples]),
        "exposure": _stack([np.array([[[e.scale, e.white]]]) for e in exposures]),
    }


def shading_exposure(example: Example, policy: Policy) -> Exposure:
    """Exposure of shading: its own; under the policy `own` with the white point `DEFAULT_WHITE`.

    The white point of an image depends on its brightest pixel, which a network cannot know well.
    Only under the policy `shared` does it determine colour.
    """
    exposure = example.exposure_shading
    return exposure if policy == "shared" else Exposure(exposure.scale, DEFAULT_WHITE)


def color_exposure(example: Example, policy: Policy) -> Exposure:
    """Exposure of colour: its own under the policy `own` (the paper), shading's under `shared`."""
    return example.exposure_shading if policy == "shared" else example.exposure_color


def neutral_background(view: Columns, neutral: float) -> ArrayOrTensor:
    """Reflectance with `neutral` where there is no surface, float32 (H, W, 3).

    The view through a window is the same in shading and in colour. The same holds for a surface
    with the neutral grey of the shading frames, so `neutral` makes reflectance x shading right
    there. The dataset stores 0, which would make windows black.
    """
    xp = array_namespace(view["reflectance"])
    return xp.where(view["valid"][..., None], view["reflectance"], neutral)


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


def _depth(view: Columns) -> ArrayOrTensor:
    xp = array_namespace(view["depth"])
    log = xp.log(xp.clip(view["depth"], MIN_DEPTH, MAX_DEPTH) / REFERENCE_DEPTH)
    valid = xp.asarray(view["valid"], dtype=xp.float32)
    return xp.stack([log * valid, valid], axis=-1)


def _reflectance(view: Columns) -> ArrayOrTensor:
    return centred(encode_srgb(neutral_background(view, NEUTRAL)))


def _relative_intensity(view: Columns) -> ArrayOrTensor:
    intensity = view["intensity"]
    xp = array_namespace(intensity)
    mean = (intensity * solid_angles(intensity)).sum() / (4 * np.pi)
    relative = intensity / xp.where(mean > 0, mean, xp.ones_like(mean))
    return xp.where(mean > 0, relative, 0.0)[..., None]


def _clamped_distance(view: Columns) -> ArrayOrTensor:
    return array_namespace(view["distance"]).clip(view["distance"], None, MAX_DEPTH)[..., None]


def _direct(view: Columns, columns: Sequence[str], bands: int) -> ArrayOrTensor:
    """Light of matte grey surfaces, its log average exposed: display, logarithm; of `columns`.

    It is direct light with the mean of its bounces. (H, W, 2 bands), of one band where the panorama
    is grey: without `tint`. `visibility` shadows the direct light.
    """
    view = {name: view[name] for name in columns}
    reflected = _stack([reflected_light(view, NEUTRAL)])
    valid = _stack([view["valid"][..., None]])
    reflected = reflected + valid * mean_bounces(reflected, valid, NEUTRAL)
    light = reflected + lamps_in_view(view)
    level = light[:, :1] if bands == 1 else luminance(light)
    scale = ToneParams().key / log_average(level)
    exposed = scale * light
    display = tonemap_exposed(exposed, DEFAULT_WHITE)[:, :bands]
    logarithm = exposed[:, :bands].clamp(*DIRECT_RANGE).log() / 4
    image = torch.cat([centred(display), logarithm], 1)[0].permute(1, 2, 0)
    return image if array_namespace(view["depth"]) is torch else image.numpy()


def _direct_product(view: Columns) -> ArrayOrTensor:
    """Shadowed `_direct`, then its product with reflectance, (H, W, 5)."""
    direct = input_named("direct_shadows").of(view)
    shading, reflectance = _stack([direct[..., :1]]), _stack([_reflectance(view)])
    product = displayed_product((shading + 1).expand_as(reflectance) / 2, reflectance, NEUTRAL)
    image = torch.cat([_stack([direct]), centred(product)], 1)[0].permute(1, 2, 0)
    return image if array_namespace(view["depth"]) is torch else image.numpy()


def _level(view: Columns) -> ArrayOrTensor:
    light = torch.cat([_stack([view[f"transport_{part}"]]) for part in ("direct", "indirect")], 1)
    level = log_average((light[:, :3] + light[:, 3:]).mean(1, keepdim=True))[0]
    return level if array_namespace(view["depth"]) is torch else level.numpy()


def _samples(view: Columns) -> ArrayOrTensor:
    number = torch.as_tensor(view["noisy_spp"]).float().clamp(1, MAX_SAMPLES)
    logarithm = (number.log() / math.log(MAX_SAMPLES)).reshape(1, 1, 1)
    return logarithm if array_namespace(view["depth"]) is torch else logarithm.numpy()


def _side_by_side(view: Columns, columns: Sequence[str]) -> ArrayOrTensor:
    """Images side by side as channels."""
    images = [view[name] for name in columns]
    images = [image[..., None] if image.ndim == 2 else image for image in images]
    return array_namespace(images[0]).concatenate(images, axis=-1)


def _images(*columns: str, optional: bool = False) -> Input:
    channels = sum(math.prod(column_channel(name).shape) for name in columns)
    return Input(columns, channels, lambda view: _side_by_side(view, columns), optional)


def _direct_input(join: Join) -> Input:
    columns = (*_DIRECT, *join.columns)
    return Input(columns, 2 * join.bands, partial(_direct, columns=columns, bands=join.bands))


# Inputs that are not a column as it is.
#   depth: ln(depth / `REFERENCE_DEPTH`), 0 where there is no surface; and the validity mask
#   reflectance: `neutral_background`, sRGB-encoded and `centred` like display values
#   intensity: relative to its mean over the sphere; all 0 if no light is visible
#   distance: metres, at most `MAX_DEPTH`; the network takes the logarithms of intensity and
#     distance itself, because it may average them first
#   those of `JOINS`: direct light of the panorama and the mean of its bounces, in its own exposure:
#     display, logarithm; `direct_product` also its `displayed_product` with reflectance
#   transport: direct light, indirect light, picture; linear, in the view's unit
#   level: log average of direct + indirect light, bands alike
#   materials: roughness, metalness, and 1 where they are known
#   noisy: colour of a few samples a pixel, of half of them, and denoised; linear
#   samples: ln(samples per pixel) / ln(`MAX_SAMPLES`)
INPUTS = {
    **{join.direct: _direct_input(join) for join in JOINS.values() if join.direct},
    "direct_product": Input((*_DIRECT, "reflectance", "visibility"), 5, _direct_product),
    "depth": Input(("depth", "valid"), 2, _depth),
    "reflectance": Input(("reflectance", "valid"), 3, _reflectance),
    "intensity": Input(("intensity",), 1, _relative_intensity, whole=True),
    "distance": Input(("distance",), 1, _clamped_distance, whole=True),
    "transport": _images("transport_direct", "transport_indirect", "transport_color"),
    "level": Input(("transport_direct", "transport_indirect"), 1, _level, whole=True),
    "materials": _images("roughness", "metalness", "material_known", optional=True),
    "noisy": _images("noisy_color", "noisy_half", "denoised_color"),
    "samples": Input(("noisy_spp",), 1, _samples, whole=True),
}


def _stack(images: Sequence[ArrayOrTensor]) -> torch.Tensor:
    """Images (H, W, C) as one batch, float32 (N, C, H, W)."""
    if array_namespace(images[0]) is torch:
        return torch.stack(list(images)).float().permute(0, 3, 1, 2)
    batch = np.stack(images).astype(np.float32).transpose(0, 3, 1, 2)
    return torch.from_numpy(np.ascontiguousarray(batch))
