"""Checks that materials and labels of a view agree with its geometry."""

from __future__ import annotations

from typing import Any

import numpy as np

from pbrnet.pipeline.channels import BUMPED, SPECULAR
from pbrnet.pipeline.frames import Channels, Frame
from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import AnyArray, Float64Array, FloatingArray
from pbrnet.scenes.importing.semantics import NYU13_OF_NYU40, NYU40_OF_CATEGORY

_BOX_SLACK = 1e-4  # metres, and of the distance: rounding of depth, and of the hit point


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
    local = view.rays() * depth[..., None].astype(np.float64)
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
