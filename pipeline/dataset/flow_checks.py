"""Checks that flow and occlusion of a frame agree with depth and camera of it and its neighbours.

Flow is computed again from the stored depth, by other code than the pass. Occlusion is compared
with the neighbour's depth where that is beyond doubt: where the four pixels around a point's place
show one plane.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pbrnet.pipeline.channels import VIDEO_BANDS
from pbrnet.pipeline.dataset.settings import CheckParams
from pbrnet.pipeline.frames import Channels
from pbrnet.pipeline.views import Matrix, View
from pbrnet.scenes.arrays import BoolArray, Float64Array
from pbrnet.scenes.geometry.directions import pixel_directions

_ROUNDING = 1e-6  # of the flow's length: float32
_PLANE = 2e-3  # relative: inverse depths of four pixels in one plane fit a plane so well
_SAME = 2e-3  # relative difference of depth that is none
_NEARER = 0.98  # of a point's depth: a surface nearer than that hides it
_FEW = 24  # pixels that tell nothing


@dataclass(frozen=True)
class Agreement:
    """Numbers of pixels on the neighbour's surface and behind it, and of those called otherwise."""

    visible: int
    called_hidden: int
    hidden: int
    called_visible: int


def flow_fault(
    video: Channels,
    inputs: Channels,
    view: View,
    neighbours: dict[str, Channels],
    limits: CheckParams,
) -> str | None:
    """Say what is wrong with a `video` frame, or return None.

    `neighbours` holds the inputs of the frames `forward` and `backward`, where they are known.
    """
    for way, pose in (("forward", view.pose_after), ("backward", view.pose_before)):
        columns, rows, hidden, outside = (video[band] for band in VIDEO_BANDS[way])
        hidden, outside = hidden > 0, outside > 0
        if not pose:
            if columns.any() or rows.any() or hidden.any() or not outside.all():
                return f"{way}: flow to a frame that is not there"
            continue
        places, depth = reprojected(inputs, view, pose)
        error, inside = flow_error(columns, rows, places, depth, view)
        worst = float(error.max())
        if worst > limits.max_flow_error:
            share = float((error > limits.max_flow_error).mean())
            return f"{way}: {share:.1%} of the flow is wrong, by up to {worst:.4g} pixels"
        # A point on the border may be on either side of it.
        border = np.abs(places[..., :2] / (view.width, view.height) - 0.5).max(axis=-1) - 0.5
        if ((outside == inside) & (np.abs(border) > 1e-6) & (np.abs(depth) > 1e-4)).any():
            return f"{way}: places outside the image are not those of the flow"
        if (hidden & outside).any():
            return f"{way}: a point is both hidden and outside the image"
        if way in neighbours:
            found = agreement(hidden, outside, places, depth, inputs, neighbours[way])
            if (
                found.visible >= _FEW
                and found.called_hidden > limits.max_called_hidden * found.visible
            ):
                return (
                    f"{way}: {found.called_hidden} of {found.visible} points on the surface "
                    "that is seen are called hidden"
                )
            if (
                found.hidden >= _FEW
                and found.called_visible > limits.max_called_visible * found.hidden
            ):
                return (
                    f"{way}: {found.called_visible} of {found.hidden} points behind the surface "
                    "that is seen are called visible"
                )
    return None


def reprojected(inputs: Channels, view: View, pose: Matrix) -> tuple[Float64Array, Float64Array]:
    """Return place (H, W, 2), pixels, and z-depth (H, W) of a view's points in another camera.

    The points come from the inputs' depth; without a surface they are at infinity, and depth is
    that of a point at 1 metre in the same direction from the other camera.
    """
    there = np.linalg.inv(np.array(pose, dtype=np.float64)) @ view.pose
    depth = inputs["Z"].astype(np.float64)[..., None]
    rays = pixel_directions(view.intrinsics, view.width, view.height)
    local = np.where(depth > 0, rays * depth, rays) @ there[:3, :3].T
    local += np.where(depth > 0, there[:3, 3], 0)
    z = local[..., 2]
    image = local @ view.intrinsics.T
    places: Float64Array = image[..., :2] / np.where(np.abs(z) > 1e-9, z, 1)[..., None]
    return places, z


def flow_error(
    columns: Float64Array, rows: Float64Array, places: Float64Array, depth: Float64Array, view: View
) -> tuple[Float64Array, BoolArray]:
    """Return the error (H, W) of a flow in pixels, and which points are inside the other image.

    What float32 rounds off very long flow does not count.
    """
    y, x = np.mgrid[: view.height, : view.width] + 0.5
    expected = np.where((depth > 1e-5)[..., None], places - np.stack([x, y], axis=-1), 0)
    stored = np.stack([columns, rows], axis=-1).astype(np.float64)
    length = np.sqrt((expected**2).sum(axis=-1))
    error = np.sqrt(((stored - expected) ** 2).sum(axis=-1)) - _ROUNDING * length
    error[np.abs(depth - 1e-5) < 1e-4] = 0  # at the neighbour's eye flow has no bound
    inside = (depth > 1e-5) & (places >= 0).all(-1) & (places < (view.width, view.height)).all(-1)
    return error, inside


def agreement(
    hidden: BoolArray,
    outside: BoolArray,
    places: Float64Array,
    depth: Float64Array,
    inputs: Channels,
    neighbour: Channels,
) -> Agreement:
    """Compare occlusion with the neighbour's depth, where that leaves no doubt."""
    height, width = hidden.shape
    corner = np.floor(places - 0.5).astype(np.int64)
    column, row = corner[..., 0], corner[..., 1]
    some = ~outside & (inputs["Z"] > 0) & (column >= 0) & (row >= 0)
    some &= (column < width - 1) & (row < height - 1)
    column, row, depth = column[some], row[some], depth[some]
    pixels = [(row + down, column + across) for down in (0, 1) for across in (0, 1)]
    things = np.stack([neighbour["object"][at] for at in pixels])
    near = np.stack([neighbour["Z"][at].astype(np.float64) for at in pixels])
    inverse = 1 / np.maximum(near, 1e-6)
    twist = np.abs(inverse[0] + inverse[3] - inverse[1] - inverse[2])
    plane = (twist < _PLANE * inverse.mean(axis=0)) & (near.min(axis=0) > 0)
    plane &= (things == things[0]).all(axis=0)
    u, v = np.moveaxis(places[some] - 0.5 - corner[some], -1, 0)
    weights = np.stack([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v])
    surface = 1 / np.maximum((weights * inverse).sum(axis=0), 1e-9)
    own = things[0] == inputs["object"][some]
    on_it = plane & own & (np.abs(surface - depth) < _SAME * depth)
    behind = plane & (near.max(axis=0) < _NEARER * depth)
    called = hidden[some]
    return Agreement(
        int(on_it.sum()),
        int((on_it & called).sum()),
        int(behind.sum()),
        int((behind & ~called).sum()),
    )
