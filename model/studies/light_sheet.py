"""The illumination study's picture: rows of a view before and after, rendered and predicted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from model.data import Array
from model.studies.agreement import BLOCK
from model.studies.light_compare import Compared
from pipeline.pictures import (
    NOTHING,
    Picture,
    color_map,
    contact_sheet,
    fit,
    intensity_picture,
    tone_picture,
)
from pipeline.report_light import CHANGES

_WIDTH = 240  # pixels of a picture, at most
_SPAN = np.log(4.0)  # change at the ends of the colours
METHOD = "pbrnet"


def light_sheet(rows: Sequence[Compared]) -> Picture:
    """A row for each: rendered before and after, predicted before and after, both changes.

    Everything under the exposure of the view as it was. Where nothing was rendered, the panoramas
    stand in its place, and the change of their direct light in that of the rendered one.
    """
    pictures: list[Picture] = []
    labels: list[str] = []
    for found in rows:
        pictures += [fit(picture, _WIDTH) for picture in _row(found)]
        title = f"{CHANGES[found.name]}: {found.original.name}"
        if found.reference == "rendered":
            labels += [title, "rendered, changed"]
        else:
            labels += [f"{title}; its panorama", "the other panorama"]
        labels += ["predicted", "predicted, changed"]
        labels += [f"change {found.reference}: red brighter, blue darker", "change predicted"]
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


def change_picture(change: Array) -> Picture:
    """Logarithmic changes (rows, columns): red is brighter, blue darker, to 4 times either way."""
    picture = color_map(np.nan_to_num(change), -_SPAN, _SPAN, "RdBu_r")
    picture[~np.isfinite(change)] = NOTHING
    return picture.repeat(BLOCK, axis=0).repeat(BLOCK, axis=1)
