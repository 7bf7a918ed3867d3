"""Masks of specular pixels, and metrics inside and outside of them.

A dataset stores pictures, not material lobes, and a glossy surface that reflects nothing bright
looks matte. So the mask marks the effect in the picture: the colour of a matte surface is
reflectance x shading / grey of the shading. Specular reflection breaks this, because its brightness
does not depend on the reflectance. A pixel is specular if its colour differs from the product by
more than a factor `exp(LIMIT)`, up or down, and by as much from the typical factor around it.

Other causes of a difference are excluded as far as possible:

- colour bleeding varies slowly over a view: the factor is compared with its median over a window
  of half the view;
- silhouettes, where reflectance is a sample and colour a mean over the pixel, are thin: only
  patches of 3x3 pixels count;
- light sources are known from the panorama.

The mask still includes strong colour bleeding in corners and the noise of a ground truth with few
samples. It misses glossy surfaces whose reflectance is the grey itself.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import binary_opening, maximum_filter, median_filter

from pbrnet.model.data.direct_light import panorama_lookup, pixel_rays
from pbrnet.model.data.reader import Example
from pbrnet.model.evaluation.metrics import flip_map, psnr
from pbrnet.scenes.arrays import AnyArray, BoolArray
from pbrnet.scenes.color import luminance

LIMIT = 0.4  # of the natural logarithm
FLOOR = 0.03  # of the log-average shading, added to both sides of the ratio
LEAST = 0.005  # share of a view below which a region is not measured
REGIONS = ("specular", "matte")
_STRIDE = 4  # pixels between samples of the median


def specular_mask(example: Example, albedo: float) -> BoolArray:
    """Return where colour is not reflectance x shading / `albedo`, bool (H, W)."""
    product = example["reflectance"] * example["shading"] / np.float32(albedo)
    shading = luminance(example["shading"])
    floor = FLOOR * float(np.exp(np.mean(np.log(np.maximum(shading, 1e-9)))))
    ratio = np.log((luminance(example["color"]) + floor) / (luminance(product) + floor))
    beyond = np.sign(ratio) * (ratio - _around(ratio))
    apart = (np.abs(ratio) > LIMIT) & (beyond > LIMIT)
    mask: BoolArray = binary_opening(
        apart & example["valid"] & ~_light_sources(example), np.ones((3, 3))
    )
    return mask


def measure_apart(truth: AnyArray, image: AnyArray, specular: BoolArray) -> dict[str, float | None]:
    """Return PSNR and FLIP inside and outside of the mask; None below `LEAST` of the pixels.

    `truth`, `image`: display values (H, W, 3). FLIP is computed on the whole images, then averaged
    over the region.
    """
    errors = flip_map(truth, image)
    values: dict[str, float | None] = {}
    for region, mask in zip(REGIONS, (specular, ~specular), strict=True):
        known = mask.mean() >= LEAST
        values[f"{region}_psnr"] = psnr(truth[mask], image[mask]) if known else None
        values[f"{region}_flip"] = float(errors[mask].mean()) if known else None
    return values


def _light_sources(example: Example) -> BoolArray:
    """Return pixels that show a light source or its surrounding pixel of the panorama, (H, W)."""
    directions = pixel_rays(example)
    nearby = maximum_filter(example["intensity"], size=3, mode=("nearest", "wrap"))
    lit: BoolArray = panorama_lookup(nearby, directions) > 0
    return lit


def _around(ratio: AnyArray) -> AnyArray:
    """Return the median over a window of half the view, (H, W), in steps of `_STRIDE` pixels."""
    few = ratio[::_STRIDE, ::_STRIDE]
    height, width = few.shape
    wide = median_filter(few, size=(height // 2 | 1, width // 2 | 1), mode="nearest")
    around: AnyArray = wide.repeat(_STRIDE, axis=0).repeat(_STRIDE, axis=1)
    return around[: ratio.shape[0], : ratio.shape[1]]
