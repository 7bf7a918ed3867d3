"""Unit of stored radiance: a power of two per image, so that half floats hold it well.

A half float has 11 bits between 6e-5 and 65504 and loses them below. Rooms at night lie there, in
the unit of the renderer. Stored is radiance / scale; one multiplication by `radiance_scale` undoes
it. A power of two changes no bit of a mantissa.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import cache
from typing import Any

import numpy as np

from pbrnet.pipeline.channels import RADIANCE, channels_of, dataset_channels, layout
from pbrnet.scenes.arrays import AnyArray

HALF_MAX = float(np.finfo(np.float16).max)
_HEADROOM = 6  # stops that an image may lie below its typical exposure to save its highlights
_LARGEST = 100  # exponent of a scale, so that scales and products fit float32
# Column of the unit of a row's images of radiance; absent from older datasets, where it is 1.
RADIANCE_SCALE = "radiance_scale"
RADIANCES = frozenset(c.name for c in dataset_channels() if c.unit == RADIANCE)


@cache
def radiance_halves(kind: str, lights: int = 0) -> tuple[str, ...]:
    """Return the bands of a kind of frame that hold radiance as half floats.

    `lights` is the number of light groups of a `light` frame.
    """
    other = {
        band for channel in channels_of(kind) if channel.unit != RADIANCE for band in channel.bands
    }
    types = layout(kind, lights)
    return tuple(band for band, dtype in types.items() if dtype is np.float16 and band not in other)


def scale_for(images: Iterable[AnyArray]) -> float:
    """Return the unit of an image, a power of two, from its bands, any shape, radiance.

    The geometric mean of the values above 0 becomes about 0.2, the largest value at most 2^15. An
    image whose highlights would need more than 64 times that mean is clamped at 65504, but never
    below 65504 in the renderer's unit. Black: 1. From exponents alone, in integers: the logarithm
    differs between processors.
    """
    lit = [values[values > 0] for values in map(np.asarray, images)]
    exponents = np.frexp(np.concatenate([values.ravel() for values in lit]))[1].astype(np.int64)
    if not exponents.size:
        return 1.0
    # A value is 2^(exponent - 1/2) on average, and 0.2 is about 2^(-9/4).
    count = exponents.size
    typical = (4 * int(exponents.sum()) + 9 * count) // (4 * count)
    fitting = int(exponents.max()) - 15
    exponent = max(typical, min(fitting, max(0, typical + _HEADROOM)))
    return 2.0 ** max(-_LARGEST, min(_LARGEST, exponent))


def fitting_scale(scale: float, largest: float) -> float:
    """Return the smallest unit from `scale` on in which `largest` fits a half float."""
    while largest > HALF_MAX * scale:
        scale *= 2
    return scale


def is_scale(value: Any) -> bool:
    """Test whether a value can be the unit of an image: a power of two within its bounds."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    if not 2.0**-_LARGEST <= value <= 2.0**_LARGEST:
        return False
    return math.frexp(value)[0] == 0.5
