"""Lens and shutter of a view's colour: what the parameters mean for this camera in this scene."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pbrnet.pipeline.frames import EXPOSURE_TIME
from pbrnet.pipeline.passes.settings import OpticsParams
from pbrnet.pipeline.pathtrace.optics import Aperture, Optics, Shutter
from pbrnet.pipeline.render import raycast
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.pipeline.views import View
from pbrnet.scenes.geometry.directions import turned

_GRID = 24  # rays per axis that measure the distance of the focus
_SPOT = 0.1  # share of the image's width and height that a focus in the centre goes by
_INFINITY = 1e4  # metres, focus where no surface is seen


def optics_of(scene: RenderScene, view: View, params: OpticsParams) -> Optics:
    """Return the lens and the shutter of a view.

    The focal length is that of K on a sensor `params.sensor_width` wide, at every distance of the
    focus. A view without neighbours in a trajectory stands still.
    """
    aperture = shutter = None
    if params.f_number:
        pixels = view.K[0][0] if view.K else view.width / (2 * math.pi)  # at the axis, per radian
        focal = pixels / view.width * params.sensor_width / 1000
        depth = params.focus_distance or _autofocus(scene, view, params)
        aperture = Aperture(0.5 * focal / params.f_number, depth, params.blades)
    if params.moves:
        shutter = Shutter(params.exposure, params.readout)
    return Optics.of(view, aperture, shutter)


def _autofocus(scene: RenderScene, view: View, params: OpticsParams) -> float:
    """Return the median depth in the middle of the image, or of all of it, metres."""
    share = _SPOT if params.autofocus == "centre" else 1.0
    steps = 0.5 + share * ((np.arange(_GRID) + 0.5) / _GRID - 0.5)
    columns, rows = np.meshgrid(steps * view.width, steps * view.height)
    rays = view.lens.rays(np.stack([columns.ravel(), rows.ravel()], axis=-1))
    directions = turned(rays.directions[rays.valid], view.pose[:3, :3])
    _, distances = raycast.nearest(scene.geometry, view.eye, directions)
    along = 1.0 if view.lens.depth_is_distance else rays.directions[rays.valid][:, 2]
    return min(float(np.median(distances * along)), _INFINITY)


def facts_of(optics: Optics, params: OpticsParams) -> dict[str, Any]:
    """Return the entries of a frame's attribute, and cells of its row: EXIF's terms and units."""
    facts: dict[str, Any] = {}
    if optics.aperture:
        facts |= {"f_number": params.f_number, "focus_distance": optics.aperture.focus}
    if optics.shutter:
        facts[EXPOSURE_TIME] = params.exposure / params.frame_rate
        facts["readout_time"] = params.readout / params.frame_rate
    return facts
