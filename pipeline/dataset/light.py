"""Light in the dataset: a row's unit of radiance, parts that follow from stored ones, their check.

A `light` frame stores direct and diffuse light and irradiance. The others are what these leave of
colour, computed from the values as they are stored: half floats for parts of colour, whose
difference a half float holds to 0.05 %, and floats for irradiance and residual, whose product and
sum have no such bound.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pbrnet.pipeline.channels import (
    RADIANCE,
    Channel,
    Kind,
    channels_of,
    column_channel,
    dataset_channels,
    fitting_scale,
    light_bands,
    radiance_halves,
)
from pbrnet.pipeline.frames import Frame
from pbrnet.scenes.arrays import AnyArray, Float32Array

_TOLERANCE = 1e-3  # of colour
_DARK = 0.01  # of colour's mean: a darker pixel is compared with that


def in_row_unit(frames: Mapping[Kind, Frame]) -> tuple[dict[Kind, Frame], float]:
    """Return a view's frames with all radiance divided by the row's unit, and that unit.

    It is that of the colour frame (else of shading, else 1); larger, if half floats of other frames
    would overflow.
    """
    main = frames.get("color") or frames.get("shading")
    scale = main.radiance_scale if main else 1.0
    for kind, frame in frames.items():
        for band in radiance_halves(kind, _groups(frame)):
            scale = fitting_scale(scale, float(frame.channels[band].max()))
    divided = {}
    for kind, frame in frames.items():
        bands = {
            band
            for channel in channels_of(kind)
            if channel.unit == RADIANCE
            for band in channel.bands
        } | set(radiance_halves(kind, _groups(frame)))
        channels = {
            name: values.astype(np.float32) / np.float32(scale) if name in bands else values
            for name, values in frame.channels.items()
        }
        divided[kind] = replace(frame, channels=channels)
    return divided, scale


def remainder(channel: Channel, frames: Mapping[Kind, Frame]) -> AnyArray:
    """Return a remainder of a view with a `light` frame, (H, W, 3), of its column's type.

    It is color less the product of the channels that it names. `frames` are in the row's unit.
    """
    image: AnyArray = frames["color"].rgb - product(channel.remainder, frames)
    return image.astype(channel.dtype)


def product(names: Sequence[str], frames: Mapping[Kind, Frame]) -> Float32Array:
    """Return the product of channels, float32 (H, W, 3)."""
    factors = (column_channel(name) for name in names)
    images = [frames[factor.kind].stack(*factor.bands) for factor in factors]
    return images[0] if len(images) == 1 else images[0] * images[1]


def light_groups(light: Frame, count: int) -> AnyArray:
    """Return the images of `count` light groups of a `light` frame, float16 (count, H, W, 3)."""
    bands = [[light.channels[band] for band in light_bands(number)] for number in range(count)]
    return np.moveaxis(np.array(bands, dtype=np.float16), 1, -1)


def light_fault(frames: Mapping[Kind, Frame], lights: int) -> str | None:
    """Say what is wrong with a `light` frame, or return None.

    It is of the trace that made the colour frame, direct and diffuse light are at most colour, and
    with the remainders they add up to it within 0.1 %, as reflectance x irradiance + residual do.
    In pixels darker than 1 % of the mean, within 0.1 % of that; all as a row stores them. It has
    `lights` light groups, which are not negative and add up to colour within 0.1 %, too.
    """
    light, frame = frames["light"], frames["color"]
    if light.meta.get("color_digest") != frame.meta.get("digest"):
        return "it belongs to another image of color"
    frames, _ = in_row_unit(frames)
    light = frames["light"]
    color = frames["color"].rgb
    tolerance = _TOLERANCE * np.maximum(color, _DARK * color.mean())
    for channel in (one for one in dataset_channels(("light",)) if one.remainder):
        part, other = product(channel.remainder, frames), remainder(channel, frames)
        name = f"{' x '.join(channel.remainder)} + {channel.name}"
        if len(channel.remainder) == 1 and (part > color).any():
            brighter = int((part > color).any(axis=-1).sum())
            return f"{channel.remainder[0]}: {brighter} pixels brighter than color"
        gap = np.abs(part + other.astype(np.float32) - color)
        wrong = int((~(gap <= tolerance)).any(axis=-1).sum())
        if wrong:
            return f"{name}: {wrong} pixels differ from color by more than {_TOLERANCE:.1%}"
    names = light.meta.get("light_names", [])
    if not isinstance(names, list) or len(names) != lights:
        return "the number of light groups differs from light.groups"
    if lights:
        groups = light_groups(light, lights).astype(np.float32)
        wrong = int((~(np.abs(groups.sum(axis=0) - color) <= tolerance)).any(axis=-1).sum())
        if wrong or groups.min() < 0:
            return f"light groups: {wrong} pixels differ from color by more than {_TOLERANCE:.1%}"
    return None


def _groups(frame: Frame) -> int:
    names = frame.meta.get("light_names")
    return len(names) if isinstance(names, list) else 0
