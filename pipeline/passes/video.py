"""Optical flow between a frame of a trajectory and its neighbours, with occlusion.

The scene stands still, so flow follows from depth and the two cameras: each pixel's surface point
is reprojected to the neighbour's image. Whether it is visible there is decided by a ray from the
neighbour's eye to the point, which passes clear glass as camera rays do, and by the side of the
surface that the eye is on. Where no surface is seen, the point is at infinity: its flow is that of
the camera's turn, and it is hidden if the ray meets anything. A ray may also reach a point through
a gap that falls between the neighbour's pixels, as among leaves: where all four pixels around the
point's place show something nearer, the neighbour's image does not show the point, and it is
hidden.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pbrnet.pipeline.channels import VIDEO_BANDS
from pbrnet.pipeline.frames import Channels
from pbrnet.pipeline.lenses.model import world_rays
from pbrnet.pipeline.passes.inputs import VisibleSurfaces, depth
from pbrnet.pipeline.render import raycast
from pbrnet.pipeline.views import Matrix, View
from pbrnet.scenes.arrays import BoolArray, Float64Array, FloatingArray
from pbrnet.scenes.geometry.directions import turned, unit

# Of the distance: above the rounding of float32 hit points, below the thickness of any board.
_TOLERANCE = 2e-4
_NEARER = 0.98  # of a point's depth: what is nearer than that is another surface
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
    occluded[some] = ~_visible(surfaces, found.offsets, there, some)
    occluded |= some & _between_pixels(surfaces, found, there)
    return flow, occluded, ~found.inside


def _visible(
    surfaces: VisibleSurfaces, offsets: Float64Array, pose: Float64Array, some: BoolArray
) -> BoolArray:
    """Test which of `some` points (P,), `offsets` (P, 3) from the eye of `pose`, are seen there."""
    eye, offsets, seen = pose[:3, 3], offsets[some], surfaces.valid[some]
    origins, directions = eye, unit(offsets)
    metres = np.sqrt((offsets**2).sum(axis=1))
    if not surfaces.view.lens.is_central:
        directions = np.broadcast_to(pose[:3, 2], offsets.shape)
        metres = (offsets * directions).sum(axis=1)
        origins = eye + offsets - metres[:, None] * directions
    _, free = raycast.nearest(surfaces.scene.geometry, origins, directions)
    arrives = free >= metres - _TOLERANCE * np.maximum(metres, 1)
    normals = surfaces.hits.geometric_normal[some].astype(np.float64)
    one, other = (
        (normals * rays).sum(axis=1) > 0 for rays in (surfaces.directions[some], directions)
    )
    result: BoolArray = np.where(seen, arrives & (one == other), np.isinf(free))
    return result


def _between_pixels(
    surfaces: VisibleSurfaces, found: Reprojection, there: Float64Array
) -> BoolArray:
    """Test where all four pixels of `there` around a point's place (P,) show nearer things."""
    view = surfaces.view
    _, metres = raycast.nearest(surfaces.scene.geometry, *world_rays(view.lens, there))
    lengths = np.sqrt((view.rays() ** 2).sum(axis=-1))
    shown = metres.reshape(view.height, view.width) / lengths
    corner = np.floor(found.places - 0.5).astype(np.int64)
    column, row = np.clip(corner, 0, (view.width - 2, view.height - 2)).T
    farthest = np.max(
        [shown[row + down, column + across] for down in (0, 1) for across in (0, 1)], axis=0
    )
    surrounded = (corner >= 0).all(axis=1) & (corner < (view.width - 1, view.height - 1)).all(
        axis=1
    )
    depth = np.where(surfaces.valid, found.depth, np.inf)
    result: BoolArray = found.inside & surrounded & (farthest < _NEARER * depth)
    return result


@dataclass(frozen=True)
class Reprojection:
    """P pixels of a view, in row-major order, as another camera with the same lens sees them.

    `offsets` (P, 3) lead from that camera's eye to the pixels' surface points, world metres; where
    a pixel has no surface its point is at infinity, and the offset is a direction. `places` (P, 2)
    are their image points in pixels (column, row), `depth` (P,) the depth from the other camera,
    `before` (P,) flags points for which its lens has a ray; `places` of others are 0.
    """

    offsets: Float64Array
    places: Float64Array
    depth: Float64Array
    before: BoolArray
    inside: BoolArray  # before the camera and within its image


def reproject(depth: FloatingArray, view: View, pose: Float64Array) -> Reprojection:
    """Reproject depth (P,) or (H, W) of a view (0: no surface) to `camera_to_world` (4, 4).

    Parallel rays that meet nothing have no point at infinity in another image.
    """
    lens = view.lens
    rays = lens.rays()
    along = depth.reshape(-1, 1).astype(np.float64)
    seen = along > 0
    offsets = turned(view.rays().reshape(-1, 3) * np.where(seen, along, 1), view.pose[:3, :3])
    offsets += np.where(seen, view.eye - pose[:3, 3], 0)
    has_point = rays.valid.ravel()
    if not lens.is_central:
        offsets += turned(rays.origins.reshape(-1, 3), view.pose[:3, :3])
        has_point = seen[:, 0]
    local = turned(offsets, pose[:3, :3].T)
    places, before = lens.project(local)
    before &= has_point
    places = np.where(before[:, None], places, 0)
    measured = np.sqrt((local**2).sum(axis=-1)) if lens.depth_is_distance else local[:, 2]
    return Reprojection(offsets, places, measured, before, before & lens.contains(places))
