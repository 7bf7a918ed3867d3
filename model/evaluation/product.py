"""Composition without a network: reflectance x shading.

The radiance of a matte surface is the product of its reflectance and the light it receives, so this
composition needs no learning. It lacks interreflection, gloss and glass. The shading is given as
display values and is first converted to linear radiance. The product is tone-mapped in two ways: by
Reinhard's operator like all other images, and linearly, to show the effect of the operator.
"""

from __future__ import annotations

import numpy as np

from pbrnet.model.training.store import ModelCard
from pbrnet.pipeline.tonemap import Exposure, ToneParams, exposure_of, tonemap, untonemap
from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.color import encode_srgb


def product(
    reflectance: AnyArray, shading: AnyArray, exposure: Exposure, card: ModelCard
) -> AnyArray:
    """Reflectance x shading under Reinhard's operator, display values float32 (H, W, 3).

    `reflectance` is linear and `shading` holds display values of the exposure `exposure`. The
    shading frames show surfaces of reflectance `card.albedo`, so the product is divided by it.
    Under the policy `own` the product is exposed by its own log average.
    """
    linear = linear_product(reflectance, shading, exposure, card)
    return tonemap(linear, product_exposure(linear, exposure, card))


def product_linear(
    reflectance: AnyArray, shading: AnyArray, exposure: Exposure, card: ModelCard
) -> AnyArray:
    """Reflectance x shading under a linear tone mapping, display values float32 (H, W, 3).

    Maps 0 to black and Reinhard's white point to white. Brighter values are clipped.
    """
    linear = linear_product(reflectance, shading, exposure, card)
    chosen = product_exposure(linear, exposure, card)
    return encode_srgb(np.clip(linear * np.float32(chosen.scale / chosen.white), 0, 1))


def linear_product(
    reflectance: AnyArray, shading: AnyArray, exposure: Exposure, card: ModelCard
) -> AnyArray:
    """Reflectance x shading as linear radiance, float32 (H, W, 3), in the unit of shading."""
    return untonemap(shading, exposure) * (reflectance / card.albedo)


def product_exposure(linear: AnyArray, shading: Exposure, card: ModelCard) -> Exposure:
    """Exposure of a linear product under the policy of the model card."""
    if card.exposure == "shared":
        return shading
    return exposure_of(np.asarray(linear), ToneParams(**card.tone))
