"""Frames of cameras and lights as 4x4 matrices."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from pbrnet.scenes.arrays import Float64Array


def look_at(
    origin: Float64Array,
    target: Float64Array,
    up: Float64Array,
) -> Float64Array:
    """Return camera to world (4, 4) in Mitsuba's axes: x left, y up, z towards the target.

    Raises `ValueError` if the three vectors span no frame.
    """
    forward = target - origin
    left = np.cross(up, forward)
    if np.linalg.norm(forward) == 0 or np.linalg.norm(left) == 0:
        raise ValueError("origin, target and up span no camera frame")
    forward = forward / np.linalg.norm(forward)
    left = left / np.linalg.norm(left)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([left, np.cross(forward, left), forward], axis=1)
    matrix[:3, 3] = origin
    return matrix


def frame_along(origin: npt.ArrayLike, axis: Float64Array) -> Float64Array:
    """Return a frame (4, 4) at `origin` whose z is the unit vector `axis`, and whose x is level.

    x is at right angles to the world's x where `axis` is nearly upright.
    """
    side = np.cross([0.0, 0, 1] if abs(axis[2]) < 0.9 else [1.0, 0, 0], axis)
    side /= np.linalg.norm(side)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([side, np.cross(axis, side), axis], axis=1)
    matrix[:3, 3] = origin
    return matrix
