"""Checks that frames of a view agree with its geometry: labels, panoramas, optical flow.

Flow is computed again from the stored depth, by other code than the pass. Occlusion is compared
with the neighbour's depth where that is beyond doubt: where the four pixels around a point's place
show one plane.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from pbrnet.pipeline.channels import BUMPED, NORMAL, SPECULAR, VIDEO_BANDS
from pbrnet.pipeline.dataset.settings import CheckParams
from pbrnet.pipeline.frames import Channels, Frame
from pbrnet.pipeline.views import Matrix, View
from pbrnet.scenes.arrays import AnyArray, BoolArray, Float64Array, FloatingArray
from pbrnet.scenes.importing.semantics import NYU13_OF_NYU40, NYU40_OF_CATEGORY

_BOX_SLACK = 1e-4  # metres, and of the distance: rounding of depth, and of the hit point
_SLACK = 0.05  # of the distance, beyond those of the panorama's pixels around a direction
_COSINE = 0.7  # of the angle between the normals
_MOST_APART = 0.2  # share of the pixels: objects narrower than a pixel of the panorama
_ROUNDING = 1e-6  # of the flow's length: float32
_PLANE = 2e-3  # relative: inverse depths of four pixels in one plane fit a plane so well
_SAME = 2e-3  # relative difference of depth that is none
_NEARER = 0.98  # of a point's depth: a surface nearer than that hides it
_FEW = 24  # pixels that tell nothing


def material_fault(materials: Frame, inputs: Channels) -> str | None:
    """Say what is wrong with a `materials` frame, or return None.

    Every surface has a material that the table names, and nothing else has; the values are shares
    and the bumped normals are of unit length.
    """
    channels, valid = materials.channels, inputs["valid"] > 0
    number, known = channels["material"], channels["material_known"] > 0
    names = materials.meta.get("material_names")
    if not isinstance(names, list) or number.max(initial=0) > len(names):
        return "a material without a name"
    if ((number > 0) != valid).any():
        return f"{int(((number > 0) != valid).sum())} pixels: surfaces and materials do not agree"
    for band in ("roughness", "metalness", *SPECULAR):
        values = channels[band]
        if values.max(initial=0) > 1:
            return f"{band}: up to {values.max():.4g}"
        if values[~known].any():
            return f"{band}: not 0 where it is unknown"
    lengths = np.sqrt(sum(channels[band][valid].astype(np.float32) ** 2 for band in BUMPED))
    crooked = int((np.abs(lengths - 1) > 0.01).sum())
    return f"{crooked} bumped normals are not of unit length" if crooked else None


def label_fault(labels: Frame, materials: Frame | None, inputs: Channels, view: View) -> str | None:
    """Say what is wrong with a `labels` frame, or return None.

    Instances are those of the inputs; of each, the described pixels are counted, the pixels' 3D
    points (from depth and camera) lie in its box, and its classes are the image's.
    `materials` is the view's frame of materials, if there is one.
    """
    channels = labels.channels
    image = channels["instance"]
    if (image != inputs["object"]).any():
        return f"{int((image != inputs['object']).sum())} pixels of another object than the inputs"
    nyu40, nyu13 = (np.array(table) for table in (NYU40_OF_CATEGORY, NYU13_OF_NYU40))
    if materials is not None and (channels["material"] != materials.channels["material"]).any():
        return "other materials than in the frame of materials"
    if channels["category"].max(initial=0) >= len(nyu40):
        return "a category without a name"
    if (nyu40[channels["category"]] != channels["nyu40"]).any():
        return "the NYU40 class is not that of the category"
    if (nyu13[channels["nyu40"]] != channels["nyu13"]).any():
        return "the class of 13 is not that of NYU40"
    names = labels.meta.get("material_names")
    if not isinstance(names, list) or channels["material"].max(initial=0) > len(names):
        return "a material without a name"
    if not isinstance(labels.meta.get("light_sources"), list):
        return "no table of lights"
    try:
        described = {int(entry["instance"]): entry for entry in labels.meta["instances"]}
        if described.keys() != set(np.unique(image[image > 0]).tolist()):
            return "the described instances are not those of the image"
        points = world_points(inputs["Z"], view)
        for number, entry in described.items():
            here = image == number
            fault = _instance_fault(entry, channels["category"][here], points[here], view)
            if fault:
                return f"instance {number}: {fault}"
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError):
        return "its table of instances cannot be read"
    return None


def world_points(depth: FloatingArray, view: View) -> Float64Array:
    """Return the 3D point of each pixel in world metres, (H, W, 3), from `depth` (H, W)."""
    local = view.lens.points(depth)
    return local @ view.pose[:3, :3].T + view.eye


def _instance_fault(
    entry: dict[str, Any], category: AnyArray, points: Float64Array, view: View
) -> str | None:
    if entry["pixels"] != len(points):
        return f"{entry['pixels']} pixels are described, {len(points)} are there"
    if not entry["pixels"] <= entry["pixels_alone"] <= view.width * view.height:
        return f"{entry['pixels_alone']} pixels alone, {len(points)} in the view"
    if abs(entry["pixels"] / entry["pixels_alone"] - entry["visible_fraction"]) > 1e-5:
        return "the visible fraction is not the ratio of pixels"
    if (category != entry["category"]).any():
        return "another category than in the image"
    centre, axes, half = (np.array(entry[key]) for key in ("centre", "axes", "half_sizes"))
    outside = (np.abs((points - centre) @ axes.T) - half).max(axis=1)
    slack = _BOX_SLACK * (1 + np.linalg.norm(points - view.eye, axis=1))
    worst = float((outside - slack).max())
    return f"a pixel lies {float(outside.max()):.4g} m outside its box" if worst > 0 else None


def environment_fault(environment: Channels, inputs: Channels, view: View) -> str | None:
    """Say what is wrong with the channels of an `environment` frame, or return None.

    Normals are of unit length where there is a surface, and the panorama shows most surfaces of
    the view in their directions.
    """
    there = environment["distance.Z"] > 0
    lengths = np.sqrt(sum(environment[band].astype(np.float32) ** 2 for band in NORMAL))
    crooked = int((np.abs(lengths - there) > 0.01).sum())
    if crooked:
        return f"{crooked} normals are not of unit length, or without a surface"
    apart = disagreement(environment, inputs, view)
    if apart > _MOST_APART:
        return f"{apart:.1%} of the view's surfaces are not where the panorama sees them"
    return None


def disagreement(environment: Channels, inputs: Channels, view: View) -> float:
    """Return the share of the view's surfaces that its panorama does not show.

    Of the nine pixels of the panorama around a surface's direction, the distances enclose the
    surface's (with 5 % to spare), and one of the normals is at most 45 degrees from it.
    """
    valid = inputs["valid"] > 0
    rays = view.lens.points(np.where(valid, inputs["Z"], 1))[valid]
    metres = np.sqrt((rays * rays).sum(axis=-1))
    lengths = metres
    normals = [inputs[band][valid].astype(np.float32) for band in NORMAL]
    height, width = environment["distance.Z"].shape
    azimuth = np.arctan2(rays[:, 0], rays[:, 2]) / (2 * math.pi) + 0.5
    polar = np.arccos(np.clip(-rays[:, 1] / lengths, -1, 1)) / math.pi
    across, down = (azimuth * width).astype(int), (polar * height).astype(int)
    least, most = np.full(len(metres), np.inf), np.zeros(len(metres))
    alike = np.zeros(len(metres), dtype=bool)
    for offset in np.ndindex(3, 3):
        row = np.clip(down + offset[0] - 1, 0, height - 1)
        column = (across + offset[1] - 1) % width
        distance = environment["distance.Z"][row, column].astype(np.float64)
        distance[distance == 0] = np.inf  # no surface: beyond all of them
        least, most = np.minimum(least, distance), np.maximum(most, distance)
        found = (environment[band][row, column] for band in NORMAL)
        alike |= sum(a * b for a, b in zip(found, normals, strict=True)) >= _COSINE
    shown = alike & (metres >= least * (1 - _SLACK)) & (metres <= most * (1 + _SLACK))
    return float(1 - shown.mean()) if len(shown) else 0.0


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
    """Return place (H, W, 2), pixels, and depth (H, W) of a view's points in another camera.

    The points come from the inputs' depth; without a surface they are at infinity, and depth is
    that of a point at 1 metre in the same direction from the other camera. It is 0 where the other
    camera's lens has no place for a point.
    """
    lens = view.lens
    there = np.linalg.inv(np.array(pose, dtype=np.float64)) @ view.pose
    depth = inputs["Z"].astype(np.float64)[..., None]
    points = lens.points(np.where(depth > 0, depth, 1)[..., 0])
    local = points @ there[:3, :3].T + np.where(depth > 0, there[:3, 3], 0)
    along = np.sqrt((local**2).sum(axis=-1)) if lens.depth_is_distance else local[..., 2]
    if lens.is_rectilinear:
        image = local @ np.array(lens.K).T
        places: Float64Array = image[..., :2] / np.where(np.abs(along) > 1e-9, along, 1)[..., None]
        return places, along
    places, known = lens.project(local)
    known &= lens.rays().valid & (lens.is_central | (depth[..., 0] > 0))
    return places, np.where(known, along, 0)


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
