"""Encoding of views for the networks: inputs and targets as tensors.

The paper's inputs do not depend on the unit of radiance because the target does not: shading is
tone-mapped by its own log average, and panoramic intensity is relative to its mean over the sphere.
Light transport and noisy samples keep the unit, and so do the networks that take them. Logarithms
compress the ranges: a bare bulb is 10^5 times as bright as a dim wall. Images are centred about 0:
otherwise a short training learns brightness but not colour.

The encoder takes NumPy arrays. While a network is exported (`pbrnet.model.release.onnx_export`) it
takes tensors, and torch's exporter traces it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, TypeVar

import numpy as np
import torch

from pbrnet.model.data.display import log_average
from pbrnet.model.data.reader import Example, ViewInputs
from pbrnet.pipeline.tonemap import Exposure, tonemap
from pbrnet.scenes.arrays import AnyArray, ArrayOrTensor, array_namespace
from pbrnet.scenes.color import encode_srgb
from pbrnet.scenes.errors import InputError

Value = TypeVar("Value", AnyArray, torch.Tensor)
Policy = Literal["own", "shared"]
Tensors = dict[str, torch.Tensor]

# Channels of every encoded input, then of the inputs that only some networks take.
CHANNELS = {"depth": 2, "normal": 3, "intensity": 1, "distance": 1, "reflectance": 3}
TRANSPORT_CHANNELS = {"transport": 9, "materials": 3}
NOISY_SAMPLES_CHANNELS = {"noisy": 9}
MAX_SAMPLES = 8  # per pixel, of noisy samples
NEUTRAL = 0.5  # reflectance input where there is no surface; albedo of the shading frames
DEFAULT_WHITE = 20.0  # exposed luminance that maps to white if it is unknown; typical indoors
# Metres: depths and distances are clamped to [MIN, MAX], and depth is relative to REFERENCE.
MIN_DEPTH, REFERENCE_DEPTH, MAX_DEPTH = 0.05, 2.5, 100.0


def encode(
    examples: Sequence[ViewInputs],
    panorama: bool = True,
    transport: bool = False,
    noisy_samples: bool = False,
) -> Tensors:
    """Network inputs, float32 (N, C, H, W), `CHANNELS` each; all views must be of one size.

    * `depth`: ln(depth / `REFERENCE_DEPTH`), 0 where there is no surface; and the validity mask
    * `normal`: camera frame, unit
    * `reflectance`: `neutral_background`, sRGB-encoded and `centred` like display values

    With `panorama`:

    * `intensity`: relative to its mean over the sphere; all 0 if no light is visible
    * `distance`: metres, at most `MAX_DEPTH`. The network takes the logarithms of intensity and
      distance itself, because it may average them first.

    With `transport`:

    * `transport`, 9 channels: direct light, indirect light, picture; linear, in the view's unit
    * `level`, (N, 1, 1, 1): log average of direct + indirect light, bands alike
    * `materials`, 3 channels: roughness, metalness, and 1 where they are known; 0 without them

    With `noisy_samples`:

    * `noisy`, 9 channels: colour of a few samples a pixel, of half of them, and denoised; linear
    * `samples`, (N, 1, 1, 1): ln(samples per pixel) / ln(`MAX_SAMPLES`)

    Traceable, see the module. Raises `InputError` for a view without transport or samples.
    """
    encoded = {
        "depth": _stack([_depth(view) for view in examples]),
        "normal": _stack([view.normal for view in examples]),
        "reflectance": encode_reflectance(examples),
    }
    if panorama:
        encoded["intensity"] = _stack([_relative_intensity(view.intensity) for view in examples])
        encoded["distance"] = _stack([_clamped_distance(view.distance) for view in examples])
    if transport:
        encoded["transport"] = _stack([_transport(view) for view in examples])
        encoded["level"] = log_average(
            (encoded["transport"][:, :3] + encoded["transport"][:, 3:6]).mean(1, keepdim=True)
        )
        encoded["materials"] = _stack([_materials(view) for view in examples])
    if noisy_samples:
        encoded["noisy"] = _stack([_noisy(view) for view in examples])
        encoded["samples"] = torch.stack([_samples(view) for view in examples])
    return encoded


def encode_reflectance(views: Sequence[ViewInputs]) -> torch.Tensor:
    """`reflectance` of `encode` alone, for the composition network."""
    return _stack([centred(encode_srgb(neutral_background(view, NEUTRAL))) for view in views])


def targets(examples: Sequence[Example], policy: Policy) -> Tensors:
    """Display values in [0, 1], float32 (N, 3, H, W): `shading` and `color`."""
    return {
        "shading": _stack([tonemap(e.shading, e.exposure_shading) for e in examples]),
        "color": _stack([tonemap(e.color, color_exposure(e, policy)) for e in examples]),
    }


def radiances(examples: Sequence[Example], policy: Policy) -> Tensors:
    """Linear targets for networks that predict radiance.

    `color`: float32 (N, 3, H, W). `exposure`: float32 (N, 2, 1, 1), the scale and the white point
    that display it.
    """
    exposures = [color_exposure(example, policy) for example in examples]
    return {
        "color": _stack([example.color for example in examples]),
        "exposure": _stack([np.array([[[e.scale, e.white]]]) for e in exposures]),
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


def _transport(view: ViewInputs) -> ArrayOrTensor:
    images = (view.transport_direct, view.transport_indirect, view.transport_color)
    return _side_by_side(view, images, "light transport", "channels: [transport]")


def _materials(view: ViewInputs) -> ArrayOrTensor:
    xp = array_namespace(view.depth)
    images = (view.roughness, view.metalness, view.material_known)
    if any(image is None for image in images):
        images = (xp.zeros_like(view.depth),) * 3
    return xp.stack(images, axis=-1)


def _noisy(view: ViewInputs) -> ArrayOrTensor:
    images = (view.noisy_color, view.noisy_half, view.denoised_color)
    return _side_by_side(view, images, "noisy samples", "noisy.spp to 1 to 8")


def _side_by_side(
    view: ViewInputs, images: Sequence[ArrayOrTensor | None], what: str, parameter: str
) -> ArrayOrTensor:
    """Images side by side as channels; raises `InputError` if one is missing."""
    known = [image for image in images if image is not None]
    if len(known) < len(images):
        raise InputError(
            f"{_name(view)}: has no {what}, which the network takes as input; set {parameter}, "
            "then run: pbrnet groundtruth, pbrnet dataset"
        )
    return array_namespace(view.depth).concatenate(known, axis=-1)


def _samples(view: ViewInputs) -> torch.Tensor:
    number = torch.as_tensor(view.noisy_spp).float().clamp(1, MAX_SAMPLES)
    return (number.log() / math.log(MAX_SAMPLES)).reshape(1, 1, 1)


def _name(view: ViewInputs) -> str:
    return view.name if isinstance(view, Example) else "the view"


def _stack(images: Sequence[ArrayOrTensor]) -> torch.Tensor:
    """Images (H, W, C) as one batch, float32 (N, C, H, W)."""
    if array_namespace(images[0]) is torch:
        return torch.stack(list(images)).float().permute(0, 3, 1, 2)
    batch = np.stack(images).astype(np.float32).transpose(0, 3, 1, 2)
    return torch.from_numpy(np.ascontiguousarray(batch))
