"""Position of an added lamp: left of and behind the camera, visible, in free space."""

from __future__ import annotations

import math

import numpy as np
import shapely

from pbrnet.pipeline.render.scene import RenderScene, cast
from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import BoolArray, Float64Array
from pbrnet.scenes.contract import Point3
from pbrnet.scenes.geometry.directions import fibonacci_sphere

RADIUS = 0.1  # metres
_CLEARANCE = 0.05  # free space around the lamp, metres
_AZIMUTHS = np.radians(np.arange(105.0, 170.0, 7.5))  # to the left, from the view direction
_DISTANCES = np.arange(0.4, 3.01, 0.2)  # horizontal, metres from the eye
_HEIGHTS = np.array([0.5, 0.35, 0.2, 0.05, -0.1])  # metres above the eye
_PREFERRED = (math.radians(135.0), 1.5, 0.35)  # azimuth, distance, height
_MAX_TRIED = 64  # visible positions that are tested for clearance
_RAYS = 96  # per position


def left_rear_position(render_scene: RenderScene, view: View) -> Point3 | None:
    """Return the centre of a sphere of `RADIUS` at the left rear of the camera, world metres.

    The sphere is left of the camera and behind it, in the view's room (if the scene has it), fully
    visible from the camera, and at least `_CLEARANCE` away from all surfaces. Of such positions it
    is the one nearest to 135 degrees left, 1.5 m away and 35 cm above the eye; None if there is
    none.
    """
    places = _places(view)
    local = (places - view.eye) @ view.pose[:3, :3]
    places = places[(local[:, 0] < -RADIUS) & (local[:, 2] < -RADIUS)]
    places = places[_in_room(render_scene, view, places)]
    if not len(places):
        return None
    places = places[_visible(render_scene, view.eye, places)][:_MAX_TRIED]
    if not len(places):
        return None
    around = fibonacci_sphere(_RAYS)
    origins = np.repeat(places, _RAYS, axis=0)
    distance, _ = cast(render_scene, origins, np.tile(around, (len(places), 1)))
    free = (distance.reshape(-1, _RAYS) > RADIUS + _CLEARANCE).all(axis=1)
    chosen = places[free]
    return (float(chosen[0, 0]), float(chosen[0, 1]), float(chosen[0, 2])) if len(chosen) else None


def _places(view: View) -> Float64Array:
    """Return candidate positions (N, 3), the preferred first."""
    right = view.pose[:3, 0] * [1, 1, 0]
    right /= np.linalg.norm(right)
    forward = np.array([-right[1], right[0], 0.0])
    grids = np.meshgrid(_AZIMUTHS, _DISTANCES, _HEIGHTS, indexing="ij")
    azimuth, distance, height = (grid.ravel() for grid in grids)
    deviation = sum(
        np.abs(values - preferred)
        for values, preferred in zip((azimuth, distance, height), _PREFERRED, strict=True)
    )
    horizontal = np.cos(azimuth)[:, None] * forward - np.sin(azimuth)[:, None] * right
    offset = distance[:, None] * horizontal + height[:, None] * [0, 0, 1]
    places: Float64Array = view.eye + offset[np.argsort(deviation, kind="stable")]
    return places


def _in_room(render_scene: RenderScene, view: View, places: Float64Array) -> BoolArray:
    room = next((room for room in render_scene.scene.rooms if room.id == view.room), None)
    if room is None:
        return np.ones(len(places), dtype=bool)
    margin = RADIUS + _CLEARANCE
    floor = shapely.Polygon(room.floor).buffer(-margin)
    inside: BoolArray = shapely.contains_xy(floor, places[:, 0], places[:, 1])
    return (
        inside & (places[:, 2] > room.floor_z + margin) & (places[:, 2] < room.ceiling_z - margin)
    )


def _visible(render_scene: RenderScene, eye: Float64Array, places: Float64Array) -> BoolArray:
    """Test whether centre and rim of the sphere at each position are visible from `eye`."""
    axis = (places - eye) / np.linalg.norm(places - eye, axis=1, keepdims=True)
    side = np.cross(axis, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(side, axis)
    rim = [places + RADIUS * offset for offset in (0 * axis, side, -side, up, -up)]
    targets = np.stack(rim, axis=1) - eye
    distance, _ = cast(render_scene, eye, targets.reshape(-1, 3))
    free = distance.reshape(-1, len(rim)) > np.linalg.norm(targets, axis=2)
    seen: BoolArray = free.all(axis=1)
    return seen
