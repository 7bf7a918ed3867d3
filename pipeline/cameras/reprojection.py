"""Reprojection: where the surface points of one view lie in the image of another camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import BoolArray, Float64Array, FloatingArray
from pbrnet.scenes.geometry.directions import pixel_directions, turned

_MIN_DEPTH = 1e-5  # metres before a camera


@dataclass(frozen=True)
class Reprojection:
    """P pixels of a view, in row-major order, as another camera with the same K and size sees them.

    `offsets` (P, 3) lead from that camera's eye to the pixels' surface points, world metres; where
    a pixel has no surface its point is at infinity, and the offset is a direction. `places` (P, 2)
    are their image points in pixels (column, row), `depth` (P,) the distance along the other
    camera's axis, `before` (P,) flags points before that camera; `places` of others are 0.
    """

    offsets: Float64Array
    places: Float64Array
    depth: Float64Array
    before: BoolArray
    inside: BoolArray  # before the camera and within its image


def reproject(depth: FloatingArray, view: View, pose: Float64Array) -> Reprojection:
    """Reproject z-depth (P,) or (H, W) of a view (0: no surface) to `camera_to_world` (4, 4)."""
    local = pixel_directions(view.intrinsics, view.width, view.height).reshape(-1, 3)
    along = depth.reshape(-1, 1).astype(np.float64)
    seen = along > 0
    offsets = turned(local * np.where(seen, along, 1), view.pose[:3, :3])
    offsets += np.where(seen, view.eye - pose[:3, 3], 0)
    x, y, z = np.moveaxis(turned(offsets, pose[:3, :3].T), -1, 0)
    before = z > _MIN_DEPTH
    (focal_x, skew, centre_x), (_, focal_y, centre_y), _ = view.intrinsics
    z_or_one = np.where(before, z, 1)
    x, y = x / z_or_one, y / z_or_one
    places = np.stack([focal_x * x + skew * y + centre_x, focal_y * y + centre_y], axis=-1)
    places = np.where(before[:, None], places, 0)
    inside = before & (places >= 0).all(axis=1) & (places < (view.width, view.height)).all(axis=1)
    return Reprojection(offsets, places, z, before, inside)
