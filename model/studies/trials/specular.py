"""Where a view shows more than reflectance x shading: gloss, mirrors and glass, measured apart.

A dataset tells what was rendered, not what lobes a material has, and a glossy table that mirrors
nothing bright is matte in the picture. So the mask asks for the effect: a matte surface's colour
is its reflectance times shading over the shading's grey. Gloss breaks that, since what is mirrored
keeps its brightness however dark the surface is, and a mirror shows the colours of other things.
Pixels count whose colour is further than a factor `exp(LIMIT)` from the product, up or down, and
as far from what that factor is around them.

What else makes a difference is kept out as far as images allow. Light that has bounced off
coloured walls changes slowly over a view: hence the second condition, with the median over a window
of half the view. What the sun shines on outdoors has little of it: hence the first. Silhouettes,
where reflectance is a sample and colour a mean over the pixel, are thin: only patches of 3x3 pixels
count. Light sources are where the panorama has them. What remains in the mask beside gloss are
strong colour bleeding in corners, and noise of a truth that has few samples. What the mask misses
are glossy surfaces of the grey itself, for which the product is right in spite of the gloss.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import binary_opening, maximum_filter, median_filter

from model.data.direct_light import panorama_lookup, pixel_directions
from model.data.reader import Example
from model.evaluation.metrics import flip_map, psnr
from scenes.arrays import AnyArray, BoolArray
from scenes.color import luminance

LIMIT = 0.4  # of the natural logarithm
FLOOR = 0.03  # of the log-average shading: darker light makes no difference
LEAST = 0.005  # share of a view from which on a region is measured
REGIONS = ("specular", "matte")
_STRIDE = 4  # the wide median is taken of every fourth pixel


def specular_mask(example: Example, albedo: float) -> BoolArray:
    """Where colour is not reflectance x shading / `albedo`, bool (H, W); see the module."""
    product = example.reflectance * example.shading / np.float32(albedo)
    shading = luminance(example.shading)
    floor = FLOOR * float(np.exp(np.mean(np.log(np.maximum(shading, 1e-9)))))
    ratio = np.log((luminance(example.color) + floor) / (luminance(product) + floor))
    beyond = np.sign(ratio) * (ratio - _around(ratio))
    apart = (np.abs(ratio) > LIMIT) & (beyond > LIMIT)
    mask: BoolArray = binary_opening(
        apart & example.valid & ~_light_sources(example), np.ones((3, 3))
    )
    return mask


def measure_apart(truth: AnyArray, image: AnyArray, specular: BoolArray) -> dict[str, float | None]:
    """PSNR and FLIP within the mask and outside, by name; None for what is hardly there.

    `truth`, `image`: display values (H, W, 3). FLIP looks at the whole images first: it knows what
    surrounds a pixel.
    """
    errors = flip_map(truth, image)
    values: dict[str, float | None] = {}
    for region, mask in zip(REGIONS, (specular, ~specular), strict=True):
        known = mask.mean() >= LEAST
        values[f"{region}_psnr"] = psnr(truth[mask], image[mask]) if known else None
        values[f"{region}_flip"] = float(errors[mask].mean()) if known else None
    return values


def _light_sources(example: Example) -> BoolArray:
    """Pixels that look at a light source, or a pixel of the panorama past one, (H, W)."""
    directions = pixel_directions(example)
    nearby = maximum_filter(example.intensity, size=3, mode=("nearest", "wrap"))
    lit: BoolArray = panorama_lookup(nearby, directions) > 0
    return lit


def _around(ratio: AnyArray) -> AnyArray:
    """The median over a window of half the view, (H, W), in steps of a few pixels."""
    few = ratio[::_STRIDE, ::_STRIDE]
    height, width = few.shape
    wide = median_filter(few, size=(height // 2 | 1, width // 2 | 1), mode="nearest")
    around: AnyArray = wide.repeat(_STRIDE, axis=0).repeat(_STRIDE, axis=1)
    return around[: ratio.shape[0], : ratio.shape[1]]
