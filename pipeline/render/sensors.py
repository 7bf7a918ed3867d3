"""Mitsuba sensors for views."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.errors import InputError

_NEAR, _FAR = 1e-3, 1e5  # metres


def make_sensor(view: View, copies: int = 1) -> Any:
    """Return a Mitsuba sensor for a view; `copies` > 1 gives that many images side by side.

    Samples are stratified within a pixel and independent between pixels, so each copy is an
    independent estimate. Raises `InputError` for a view whose pixels are not square.
    """
    intrinsics = view.intrinsics
    focal = intrinsics[0, 0]
    if abs(intrinsics[1, 1] - focal) > 1e-6 * focal or abs(intrinsics[0, 1]) > 1e-9:
        raise InputError(
            f"view {view.view_id} of {view.scene_id}: K has pixels that are not square "
            f"(fx {focal:g}, fy {intrinsics[1, 1]:g}, skew {intrinsics[0, 1]:g}), "
            "which the path tracer's camera does not support"
        )
    film = {
        "type": "hdrfilm",
        "height": view.height,
        "rfilter": {"type": "box"},  # bit-exact for any number of threads
        "pixel_format": "rgb",
        "component_format": "float32",
    }
    camera = {
        "type": "perspective",
        "to_world": mi.ScalarTransform4f(_to_world(view)),
        "fov": float(np.degrees(2 * np.arctan(0.5 * view.width / focal))),
        "fov_axis": "x",
        "principal_point_offset_x": float(0.5 - intrinsics[0, 2] / view.width),
        "principal_point_offset_y": float(0.5 - intrinsics[1, 2] / view.height),
        "near_clip": _NEAR,
        "far_clip": _FAR,
        "film": {**film, "width": view.width},
    }
    sampler = {"type": "multijitter"}
    if copies == 1:
        return mi.load_dict({**camera, "sampler": sampler})
    cameras = {f"copy{index}": camera for index in range(copies)}
    wide = {**film, "width": copies * view.width}
    return mi.load_dict({"type": "batch", **cameras, "film": wide, "sampler": sampler})


def move_sensor(sensor: Any, view: View) -> None:
    """Move a sensor of `make_sensor` to the pose of `view`; its size and intrinsics stay.

    Not for the scalar variant, whose sensors hold plain numbers.
    """
    params = mi.traverse(sensor)
    keys = [key for key, _ in params.items() if key.split(".")[-1] == "to_world"]
    for key in keys:
        to_world = mi.AffineTransform4f(_to_world(view))
        dr.make_opaque(to_world)
        params[key] = to_world
    params.update()


def _to_world(view: View) -> Float64Array:
    """Return the pose in the axes of Mitsuba's cameras: x left, y up, z forward."""
    return np.asarray(view.pose @ np.diag([-1.0, -1.0, 1.0, 1.0]))
