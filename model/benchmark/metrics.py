"""Metrics of albedo and normals that were estimated from a picture."""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.arrays import AnyArray, BoolArray, Float64Array

WITHIN = (11.25, 22.5, 30.0)  # degrees


def scale_invariant_rmse(truth: AnyArray, estimate: AnyArray, mask: BoolArray) -> float:
    """Root mean squared error of albedo (H, W, 3) after the best single scale, over `mask`.

    The scale minimises the squared error (Grosse et al. 2009, without windows). An estimate of
    zeros has the truth's own root mean square.
    """
    there, found = truth[mask].astype(np.float64), estimate[mask].astype(np.float64)
    energy = float((found * found).sum())
    scale = float((there * found).sum()) / energy if energy > 0 else 0.0
    return float(np.sqrt(np.mean((there - scale * found) ** 2)))


def local_rmse(truth: AnyArray, estimate: AnyArray, mask: BoolArray, side: int = 20) -> float:
    """Root mean squared error of albedo with a best scale in each window, over `mask`.

    Windows of `side` pixels overlap by half (LMSE of Grosse et al. 2009), so that slow shading left
    in the albedo weighs little and edges weigh much.
    """
    height, width = mask.shape
    errors = count = 0.0
    step = side // 2
    for top in range(0, max(height - step, 1), step):
        for left in range(0, max(width - step, 1), step):
            window = np.s_[top : top + side, left : left + side]
            inside = mask[window]
            if inside.any():
                error = scale_invariant_rmse(truth[window], estimate[window], inside)
                errors += error**2 * inside.sum()
                count += inside.sum()
    return float(np.sqrt(errors / count)) if count else 0.0


def angles(truth: AnyArray, estimate: AnyArray, mask: BoolArray) -> Float64Array:
    """Angles in degrees between normals (H, W, 3) where `mask` is true, (N,).

    Lengths do not matter; an estimate of length 0 is 90 degrees off.
    """
    there, found = truth[mask].astype(np.float64), estimate[mask].astype(np.float64)
    lengths = np.linalg.norm(there, axis=1) * np.linalg.norm(found, axis=1)
    across = np.linalg.norm(np.cross(there, found), axis=1)  # exact for small angles, too
    away = np.degrees(np.arctan2(across, (there * found).sum(axis=1)))
    return np.where(lengths > 0, away, 90.0)


def normal_errors(truth: AnyArray, estimate: AnyArray, mask: BoolArray) -> dict[str, float]:
    """Mean and median angle of a view, degrees, and shares of its pixels within 11.25, 22.5, 30."""
    found = angles(truth, estimate, mask)
    if not len(found):
        return {}
    shares = {f"within_{limit:g}": float((found <= limit).mean()) for limit in WITHIN}
    return {"mean_angle": float(found.mean()), "median_angle": float(np.median(found)), **shares}
