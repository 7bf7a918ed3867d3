"""Sheet of photographs with truth and prediction side by side."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pbrnet.model.studies.photographs.measures import Prediction
from pbrnet.model.studies.photographs.samples import Sample, display
from pbrnet.pipeline.images import (
    Picture,
    color_map,
    contact_sheet,
    label_picture,
    normal_picture,
    png_bytes,
)
from pbrnet.scenes.arrays import FloatingArray

_SIDES = ("truth", "prediction")


def sheet(samples: Sequence[Sample], predictions: Sequence[Prediction]) -> bytes:
    """Draw depth, normals and classes of pictures as PNG, a picture a row.

    Predicted depth is multiplied by the ratio of medians, so that its shape shows.
    """
    pictures: list[Picture] = []
    labels: list[str] = []
    for sample, found in zip(samples, predictions, strict=True):
        known = sample.depth > 0
        depths = sample.depth[known] if known.any() else np.array([1.0, 8.0])
        limits = np.log(np.quantile(depths, [0.01, 0.99])).tolist()
        scaled = found.depth * (np.median(depths) / np.median(found.depth))
        pictures.append(display(sample))
        pictures += [_depth(depth, limits) for depth in (sample.depth, scaled)]
        pictures += [normal_picture(normal) for normal in (sample.normal, found.normal)]
        pictures += [label_picture(one.label13.astype(np.int32)) for one in (sample, found)]
        labels.append(sample.key.name)
        labels += [f"{what}, {s}" for what in ("depth", "normals", "classes") for s in _SIDES]
    return png_bytes(contact_sheet(pictures, 7, labels))


def _depth(depth: FloatingArray, limits: Sequence[float]) -> Picture:
    """Draw depth between two limits, logarithms of metres: near is bright; black is unknown."""
    picture = color_map(-np.log(np.maximum(depth, 1e-3)), -limits[1], -limits[0], "magma")
    picture[depth <= 0] = 0
    return picture
