"""Optical flow between a frame of a trajectory and its neighbours, with occlusion.

The scene stands still, so flow follows from depth and the two cameras: each pixel's surface point
is reprojected to the neighbour's image. Whether it is visible there is decided by a ray from the
neighbour's eye to the point, which passes clear glass as camera rays do, and by the side of the
surface that the eye is on; images are not compared. Where no surface is seen, the point is at
infinity: its flow is that of the camera's turn, and it is hidden if the ray meets anything.
"""

from __future__ import annotations

import numpy as np

from pbrnet.pipeline.cameras.reprojection import reproject
from pbrnet.pipeline.channels import VIDEO_BANDS
from pbrnet.pipeline.frames import Channels
from pbrnet.pipeline.passes.inputs import VisibleSurfaces, depth
from pbrnet.pipeline.render import raycast
from pbrnet.pipeline.views import Matrix
from pbrnet.scenes.arrays import BoolArray, Float64Array
from pbrnet.scenes.geometry.directions import unit

# Of the distance: above the rounding of float32 hit points, below the thickness of any board.
_TOLERANCE = 2e-4
_GRID = 1024  # parts of a pixel to which flow is rounded, so that it compresses


def video_of(surfaces: VisibleSurfaces) -> Channels:
    """Return the channels of a `video` frame, each (H, W).

    A view that has no neighbour on one side has no flow there, and `outside` is 1.
    """
    view = surfaces.view
    bands: Channels = {}
    for way, pose in (("forward", view.pose_after), ("backward", view.pose_before)):
        flow, occluded, outside = _motion(surfaces, pose)
        planes = (flow[:, 0], flow[:, 1], occluded, outside)
        for band, values in zip(VIDEO_BANDS[way], planes, strict=True):
            bands[band] = values.reshape(view.height, view.width).astype(np.float32)
    return bands


def _motion(surfaces: VisibleSurfaces, pose: Matrix) -> tuple[Float64Array, BoolArray, BoolArray]:
    """Return flow (P, 2), pixels, and occluded and outside flags (P,) towards a neighbour."""
    view, count = surfaces.view, len(surfaces.valid)
    if not pose:
        none = np.zeros(count, dtype=bool)
        return np.zeros((count, 2)), none, ~none
    there = np.array(pose, dtype=np.float64)
    found = reproject(depth(surfaces), view, there)
    rows, columns = np.divmod(np.arange(count), view.width)
    here = np.stack([columns, rows], axis=1) + 0.5
    flow = np.where(found.before[:, None], found.places - here, 0)
    flow = np.round(flow * _GRID) / _GRID
    occluded = np.zeros(count, dtype=bool)
    some = found.inside
    occluded[some] = ~_visible(surfaces, found.offsets, there[:3, 3], some)
    return flow, occluded, ~found.inside


def _visible(
    surfaces: VisibleSurfaces, offsets: Float64Array, eye: Float64Array, some: BoolArray
) -> BoolArray:
    """Test which of `some` points (P,), `offsets` (P, 3) from `eye`, can be seen from there."""
    directions, seen = unit(offsets[some]), surfaces.valid[some]
    _, free = raycast.nearest(surfaces.scene.geometry, eye, directions)
    metres = np.sqrt((offsets[some] ** 2).sum(axis=1))
    arrives = free >= metres - _TOLERANCE * np.maximum(metres, 1)
    normals = surfaces.hits.geometric_normal[some].astype(np.float64)
    one, other = (
        (normals * rays).sum(axis=1) > 0 for rays in (surfaces.directions[some], directions)
    )
    result: BoolArray = np.where(seen, arrives & (one == other), np.isinf(free))
    return result
