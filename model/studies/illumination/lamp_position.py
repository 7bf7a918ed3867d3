"""Where a lamp can hang at the left rear of a camera: in its room, in sight of it, in free air."""

from __future__ import annotations

import math

import numpy as np
import shapely

from pipeline.render.scene import RenderScene, cast
from pipeline.views import View
from scenes.arrays import BoolArray, Float64Array
from scenes.contract import Point3
from scenes.geometry.directions import fibonacci_sphere

RADIUS = 0.1  # metres
_AIR = 0.05  # metres of free air around it
_AZIMUTHS = np.radians(np.arange(105.0, 170.0, 7.5))  # to the left from straight ahead
_REACHES = np.arange(0.4, 3.01, 0.2)  # metres from the eye, level
_RISES = np.array([0.5, 0.35, 0.2, 0.05, -0.1])  # metres above the eye
_BEST = (math.radians(135.0), 1.5, 0.35)
_TRIED = 64  # spots in sight whose air is looked at
_RAYS = 96


def left_rear(render_scene: RenderScene, view: View) -> Point3 | None:
    """The centre of a sphere of `RADIUS` at the left rear of the camera, world metres.

    Left of the camera and behind it, in the room of the view (if the scene knows it), all in sight
    of the camera, and with nothing within `_AIR` of its surface, so not inside furniture. Of such
    places it is the one nearest to 135 degrees left, 1.5 m away and a little above the eye; None if
    there is none.
    """
    places = _places(view)
    local = (places - view.eye) @ view.pose[:3, :3]
    places = places[(local[:, 0] < -RADIUS) & (local[:, 2] < -RADIUS)]
    places = places[_in_room(render_scene, view, places)]
    if not len(places):
        return None
    places = places[_in_sight(render_scene, view.eye, places)][:_TRIED]
    if not len(places):
        return None
    around = fibonacci_sphere(_RAYS)
    origins = np.repeat(places, _RAYS, axis=0)
    distance, _ = cast(render_scene, origins, np.tile(around, (len(places), 1)))
    free = (distance.reshape(-1, _RAYS) > RADIUS + _AIR).all(axis=1)
    chosen = places[free]
    return (float(chosen[0, 0]), float(chosen[0, 1]), float(chosen[0, 2])) if len(chosen) else None


def _places(view: View) -> Float64Array:
    """Candidates (N, 3), the best first."""
    right = view.pose[:3, 0] * [1, 1, 0]
    right /= np.linalg.norm(right)
    ahead = np.array([-right[1], right[0], 0.0])
    azimuth, reach, rise = (
        grid.ravel() for grid in np.meshgrid(_AZIMUTHS, _REACHES, _RISES, indexing="ij")
    )
    away = np.abs(azimuth - _BEST[0]) + np.abs(reach - _BEST[1]) + np.abs(rise - _BEST[2])
    flat = np.cos(azimuth)[:, None] * ahead - np.sin(azimuth)[:, None] * right
    offset = reach[:, None] * flat + rise[:, None] * [0, 0, 1]
    places: Float64Array = view.eye + offset[np.argsort(away, kind="stable")]
    return places


def _in_room(render_scene: RenderScene, view: View, places: Float64Array) -> BoolArray:
    room = next((room for room in render_scene.scene.rooms if room.id == view.room), None)
    if room is None:
        return np.ones(len(places), dtype=bool)
    margin = RADIUS + _AIR
    floor = shapely.Polygon(room.floor).buffer(-margin)
    inside: BoolArray = shapely.contains_xy(floor, places[:, 0], places[:, 1])
    return (
        inside & (places[:, 2] > room.floor_z + margin) & (places[:, 2] < room.ceiling_z - margin)
    )


def _in_sight(render_scene: RenderScene, eye: Float64Array, places: Float64Array) -> BoolArray:
    """Whether the middle and the rim of the sphere at each place are seen from `eye`."""
    offset = places - eye
    axis = offset / np.linalg.norm(offset, axis=1, keepdims=True)
    side = np.cross(axis, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(side, axis)
    rim = [places + RADIUS * away for away in (0 * axis, side, -side, up, -up)]
    targets = np.stack(rim, axis=1) - eye
    distance, _ = cast(render_scene, eye, targets.reshape(-1, 3))
    free = distance.reshape(-1, len(rim)) > np.linalg.norm(targets, axis=2)
    seen: BoolArray = free.all(axis=1)
    return seen
