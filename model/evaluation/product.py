"""Reflectance x shading: no network at all after the shading network.

A matte surface shows its reflectance times the light it gets, so this is the composition that
needs no learning; what it lacks is interreflection, gloss and glass. Shading comes as display
values and is made linear first. Two projections of the linear product back onto the display:
Reinhard's operator, as for every other image, and a linear one, to show what the operator does.
"""

from __future__ import annotations

import numpy as np

from model.training.store import ModelCard
from pipeline.params import ToneParams
from pipeline.tonemap import Exposure, exposure_of, tonemap, untonemap
from scenes.arrays import AnyArray
from scenes.color import encode_srgb


def product(
    reflectance: AnyArray, shading: AnyArray, exposure: Exposure, card: ModelCard
) -> AnyArray:
    """Reflectance x shading under Reinhard's operator, display values float32 (H, W, 3).

    `reflectance` is linear; `shading` holds display values of exposure `exposure`. A surface of
    reflectance `card.albedo` would look just so, hence the division. Under the policy `own` the
    product, like any image then, is exposed by its own log average.
    """
    linear = linear_product(reflectance, shading, exposure, card)
    return tonemap(linear, product_exposure(linear, exposure, card))


def product_linear(
    reflectance: AnyArray, shading: AnyArray, exposure: Exposure, card: ModelCard
) -> AnyArray:
    """The same product, projected linearly: 0 to black, Reinhard's white point to white.

    What is brighter is clipped; display values float32 (H, W, 3).
    """
    linear = linear_product(reflectance, shading, exposure, card)
    chosen = product_exposure(linear, exposure, card)
    return encode_srgb(np.clip(linear * np.float32(chosen.scale / chosen.white), 0, 1))


def linear_product(
    reflectance: AnyArray, shading: AnyArray, exposure: Exposure, card: ModelCard
) -> AnyArray:
    """Linear radiance float32 (H, W, 3), in shading's own unit."""
    return untonemap(shading, exposure) * (reflectance / card.albedo)


def product_exposure(linear: AnyArray, shading: Exposure, card: ModelCard) -> Exposure:
    """The exposure of a linear product under the card's policy."""
    if card.exposure == "shared":
        return shading
    return exposure_of(np.asarray(linear), ToneParams(**card.tone))
