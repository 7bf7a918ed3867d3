"""Picture of the illumination study: views before and after, rendered and predicted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pbrnet.model.studies.illumination.agreement import BLOCK
from pbrnet.model.studies.illumination.compare import Comparison
from pbrnet.pipeline.images import (
    NOTHING,
    Picture,
    color_map,
    contact_sheet,
    fit,
    intensity_picture,
    tone_picture,
)
from pbrnet.scenes.arrays import AnyArray

_WIDTH = 240  # maximum width of a picture, pixels
_SPAN = np.log(2.0)  # change at the ends of the colour map
LABELS = {
    "added": "lamp added",
    "lamps": "lamps brighter",
    "outdoors": "outdoors darker",
    "without": "lamp removed",
    "exchanged": "other panorama",
}
METHOD = "pbrnet"


def comparison_sheet(rows: Sequence[Comparison]) -> Picture:
    """Draw a row per comparison: rendered before and after, predicted before and after, changes.

    All images have the exposure of the original view. Changes are drawn without their mean, which
    is in the label. Without a rendering, the panoramas and the change of their direct light replace
    the rendered images.
    """
    pictures: list[Picture] = []
    labels: list[str] = []
    for found in rows:
        true, predicted = found.true["color"], found.predicted[METHOD]
        pictures += [fit(picture, _WIDTH) for picture in _row(found)]
        labels += [LABELS[found.name], found.original.name, "predicted", "predicted, changed"]
        labels += [f"{found.reference} {_mean(true)}", f"predicted {_mean(predicted)}"]
    return contact_sheet(pictures, 6, labels)


def _row(found: Comparison) -> list[Picture]:
    exposure = found.original.exposure_shading
    before, after = found.before, found.after
    if before.color is not None and after.color is not None:
        truths = [tone_picture(image, exposure) for image in (before.color, after.color)]
    else:
        truths = [intensity_picture(image) for image in (before.intensity, after.intensity)]
    predicted = [tone_picture(images[METHOD], exposure) for images in found.images]
    return [
        *truths,
        *predicted,
        change_picture(found.true["color"]),
        change_picture(found.predicted[METHOD]),
    ]


def change_picture(change: AnyArray) -> Picture:
    """Draw logarithmic changes (rows, columns) without their mean: red brighter, blue darker.

    The colour map ends at a factor of 2.
    """
    known = np.isfinite(change)
    centred = np.where(known, change, 0) - (change[known].mean() if known.any() else 0)
    picture = color_map(centred, -_SPAN, _SPAN, "RdBu_r")
    picture[~known] = NOTHING
    return picture.repeat(BLOCK, axis=0).repeat(BLOCK, axis=1)


def _mean(change: AnyArray) -> str:
    known = change[np.isfinite(change)]
    return f"{known.mean():+.2f}" if known.size else "unknown"
