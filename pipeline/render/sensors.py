"""Mitsuba sensors for views."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from pipeline.views import View
from scenes.arrays import Float64Array
from scenes.errors import InputError

_NEAR, _FAR = 1e-3, 1e5  # metres


def make_sensor(view: View, copies: int = 1) -> Any:
    """A Mitsuba sensor for exactly this camera; with `copies`, so many images side by side.

    Samples are stratified within a pixel and independent between pixels, so each copy is an
    independent estimate. Raises `InputError` for a view whose pixels are not square.
    """
    intrinsics = view.intrinsics
    focal = intrinsics[0, 0]
    if abs(intrinsics[1, 1] - focal) > 1e-6 * focal or abs(intrinsics[0, 1]) > 1e-9:
        raise InputError(
            f"view {view.view_id} of {view.scene_id}: K has pixels that are not square "
            f"(fx {focal:g}, fy {intrinsics[1, 1]:g}, skew {intrinsics[0, 1]:g}), "
            "which the path tracer's camera cannot do"
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
    """Put a sensor of `make_sensor` where `view` is; size and intrinsics stay its own.

    Not in the scalar variant, whose sensors are numbers.
    """
    params = mi.traverse(sensor)
    places = [key for key, _ in params.items() if key.split(".")[-1] == "to_world"]
    for key in places:
        place = mi.AffineTransform4f(_to_world(view))
        dr.make_opaque(place)
        params[key] = place
    params.update()


def _to_world(view: View) -> Float64Array:
    """Mitsuba's camera has x to the left and y up."""
    return np.asarray(view.pose @ np.diag([-1.0, -1.0, 1.0, 1.0]))
