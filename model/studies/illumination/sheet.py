"""The illumination study's picture: rows of a view before and after, rendered and predicted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from model.studies.illumination.agreement import BLOCK
from model.studies.illumination.compare import Compared
from pipeline.images import (
    NOTHING,
    Picture,
    color_map,
    contact_sheet,
    fit,
    intensity_picture,
    tone_picture,
)
from scenes.arrays import AnyArray

_WIDTH = 240  # pixels of a picture, at most
_SPAN = np.log(2.0)  # change at the ends of the colours
SHORT = {
    "added": "lamp added",
    "lamps": "lamps brighter",
    "outdoors": "outdoors darker",
    "without": "lamp put out",
    "exchanged": "other panorama",
}
METHOD = "pbrnet"


def light_sheet(rows: Sequence[Compared]) -> Picture:
    """A row for each: rendered before and after, predicted before and after, both changes.

    Everything under the exposure of the view as it was. Changes have their mean taken off, which
    stands below them. Where nothing was rendered, the panoramas stand in its place, and the change
    of their direct light in that of the rendered one.
    """
    pictures: list[Picture] = []
    labels: list[str] = []
    for found in rows:
        true, predicted = found.true["color"], found.predicted[METHOD]
        pictures += [fit(picture, _WIDTH) for picture in _row(found)]
        labels += [SHORT[found.name], found.original.name, "predicted", "predicted, changed"]
        what = "rendered" if found.reference == "rendered" else "direct light"
        labels += [f"{what} {_mean(true)}", f"predicted {_mean(predicted)}"]
    return contact_sheet(pictures, 6, labels)


def _row(found: Compared) -> list[Picture]:
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
    """Logarithmic changes (rows, columns) beside their mean: red brighter, blue darker, 2 times
    either way at the ends."""
    known = np.isfinite(change)
    centred = np.where(known, change, 0) - (change[known].mean() if known.any() else 0)
    picture = color_map(centred, -_SPAN, _SPAN, "RdBu_r")
    picture[~known] = NOTHING
    return picture.repeat(BLOCK, axis=0).repeat(BLOCK, axis=1)


def _mean(change: AnyArray) -> str:
    known = change[np.isfinite(change)]
    return f"{known.mean():+.2f}" if known.size else "unknown"
