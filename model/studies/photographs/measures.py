"""Measures of a prediction against the truth of a picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pbrnet.model.studies.photographs.samples import Sample
from pbrnet.scenes.arrays import AnyArray, Float32Array, Float64Array, FloatingArray, UInt8Array

DEPTHS = ("absrel", "delta1")
ALIGNED = ("", "_scaled", "_affine")
NORMALS = ("normal_mean", "normal_median", "normal_11", "normal_22", "normal_30")
LABELS = {"pixels13": 13, "miou13": 13, "pixels40": 40, "miou40": 40}
# All measures of a row, in the order of tables; with True the higher the better.
MEASURES = {
    **{f"{name}{how}": name == "delta1" for how in ALIGNED for name in DEPTHS},
    **{name: name[-1].isdigit() for name in NORMALS},
    "floor_angle": False,
    "normal_known": True,
    **dict.fromkeys(LABELS, True),
}
_ANGLES = {"normal_11": 11.25, "normal_22": 22.5, "normal_30": 30.0}
_NEAREST = 0.1  # metres, least depth of an aligned prediction
_FLOOR, _FLOOR_PIXELS = 5, 100  # class of NYU13; least number of its pixels with a normal


@dataclass(frozen=True)
class Prediction:
    """Predictions for a picture: z-depth in metres (H, W), unit normals (H, W, 3), classes."""

    depth: Float32Array
    normal: FloatingArray
    label40: UInt8Array
    label13: UInt8Array


def measured(sample: Sample, found: Prediction) -> dict[str, float]:
    """Return the measures of one picture but for those of classes; absent without truth."""
    values: dict[str, float] = {}
    known = sample.depth > 0
    if known.any():
        truth, depth = sample.depth[known].astype(float), found.depth[known].astype(float)
        for how, aligned in zip(
            ALIGNED, (depth, scaled(truth, depth), affine(truth, depth)), strict=True
        ):
            ratio = aligned / truth
            values[f"absrel{how}"] = float(np.abs(ratio - 1).mean())
            values[f"delta1{how}"] = float((np.maximum(ratio, 1 / ratio) < 1.25).mean())
    there = (sample.normal != 0).any(-1)
    values["normal_known"] = there.mean()
    if there.any():
        angles = angle(sample.normal[there], found.normal[there])
        values["normal_mean"], values["normal_median"] = angles.mean(), np.median(angles)
        values |= {name: (angles < most).mean() for name, most in _ANGLES.items()}
    floor = there & (sample.label13 == _FLOOR)
    if floor.sum() >= _FLOOR_PIXELS:
        up = [normal[floor].astype(float).mean(0)[None] for normal in (sample.normal, found.normal)]
        values["floor_angle"] = angle(*up)[0]
    return {name: float(value) for name, value in values.items()}


def confusion(truth: UInt8Array, found: UInt8Array, classes: int) -> AnyArray:
    """Return the numbers of pixels by true and predicted class, (classes, classes)."""
    known = truth > 0
    pairs = (truth[known].astype(int) - 1) * classes + found[known] - 1
    return np.bincount(pairs, minlength=classes**2).reshape(classes, classes)


def scaled(truth: Float64Array, depth: Float64Array) -> Float64Array:
    """Return depths multiplied so that their median is that of the truth."""
    return depth * (np.median(truth) / np.median(depth))


def affine(truth: Float64Array, depth: Float64Array) -> Float64Array:
    """Return depths whose inverse is fitted to the true one by scale and offset.

    Least squares, as for networks of relative depth (Ranftl et al. 2020); clipped at the depth of
    the farthest true point.
    """
    columns = np.stack([1 / depth, np.ones_like(depth)], 1)
    factors = np.linalg.lstsq(columns, 1 / truth, rcond=None)[0]
    return 1 / np.clip(columns @ factors, 1 / truth.max(), 1 / _NEAREST)


def angle(one: AnyArray, other: AnyArray) -> Float64Array:
    """Angles between vectors (N, 3), degrees."""
    one, other = one.astype(np.float64), other.astype(np.float64)
    lengths = np.linalg.norm(one, axis=-1) * np.linalg.norm(other, axis=-1)
    cosine = (one * other).sum(-1) / np.maximum(lengths, 1e-12)
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))
