"""Stored cameras of a home as views, and a default camera."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.contract import Room
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.sweethome.home import Home, StoredCamera

_MAX_CAMERAS = 64
_HALF_FOV = 0.5534
_EYE = 1.55


@dataclass(frozen=True)
class Camera:
    """A pinhole camera; `camera_to_world` (4, 4) in OpenCV axes: x right, y down, z forward."""

    name: str
    camera_to_world: Float64Array
    half_fov_x: float
    width: int
    height: int
    is_observer: bool = False  # the virtual visitor's, not a stored view

    @property
    def eye(self) -> Float64Array:
        """Position (3,), metres."""
        return self.camera_to_world[:3, 3]

    def as_view(self) -> dict[str, Any]:
        """Return the entry of `scene.source["views"]`."""
        return {
            "name": re.sub(r"[^A-Za-z0-9_-]+", "_", self.name).strip("_") or "view",
            "camera_to_world": self.camera_to_world.tolist(),
            "half_fov_x": self.half_fov_x,
            "width": self.width,
            "height": self.height,
        }

    @property
    def mitsuba_pose(self) -> Float64Array:
        """Camera to world (4, 4) in Mitsuba's axes: x left, y up, z forward."""
        return self.camera_to_world @ np.diag([-1.0, -1, 1, 1])


def stored_cameras(home: Home, changes: Changes) -> list[Camera]:
    """Return the stored cameras, then the virtual visitor's; without the aerial camera."""
    made: list[Camera] = []
    seen: set[tuple] = set()
    order = {"storedCamera": 0, "observerCamera": 1}
    for camera in sorted(
        (one for one in home.cameras if one.attribute in order),
        key=lambda one: order[one.attribute],
    ):
        key = (camera.x, camera.y, camera.z, camera.yaw, camera.pitch)
        if key in seen:
            continue
        seen.add(key)
        if len(made) >= _MAX_CAMERAS:
            changes.note(f"of the cameras only the first {_MAX_CAMERAS} were kept")
            break
        if camera.lens not in ("PINHOLE", "NORMAL"):
            changes.note("a wide lens became a pinhole: {}", f"{camera.name} ({camera.lens})")
        made.append(_camera(camera, home.environment.photo_width, home.environment.photo_height))
    others = sum(camera.attribute == "cameraPath" for camera in home.cameras)
    if others:
        changes.note(f"the cameras of a video's path were left out ({others})")
    return made


def _camera(camera: StoredCamera, width: int, height: int) -> Camera:
    """Convert a camera; yaw is clockwise from the lower side of the plan, pitch is downwards."""
    pitch = min(max(camera.pitch, -0.499 * math.pi), 0.499 * math.pi)
    flat = math.cos(pitch)
    forward = np.array(
        [-math.sin(camera.yaw) * flat, -math.cos(camera.yaw) * flat, -math.sin(pitch)]
    )
    eye = np.array([0.01 * camera.x, -0.01 * camera.y, 0.01 * camera.z])
    half = min(max(0.5 * camera.field_of_view, 0.05), 1.3)
    return Camera(
        camera.name,
        _pose(eye, forward),
        half,
        width,
        height,
        is_observer=camera.attribute == "observerCamera",
    )


def default_camera(rooms: list[Room], middle: Float64Array) -> Camera:
    """Return a view across the largest room, or over the home, for files without a camera."""
    if rooms:
        room = max(rooms, key=_area)
        corners = np.array(room.floor)
        centre = corners.mean(axis=0)
        far = corners[int(np.argmax(np.linalg.norm(corners - centre, axis=1)))]
        eye = np.array([*(centre + 0.8 * (far - centre)), room.floor_z + _EYE])
        forward = np.array([*(centre - eye[:2]), -0.2 * np.linalg.norm(centre - eye[:2])])
    else:
        eye, forward = middle + np.array([0.0, -6.0, 3.0]), np.array([0.0, 1.0, -0.4])
    return Camera("own", _pose(eye, forward), _HALF_FOV, 480, 360)


def _pose(eye: Float64Array, forward: Float64Array) -> Float64Array:
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0, 1])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = eye
    return pose


def _area(room: Room) -> float:
    x, y = np.array(room.floor).T
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))
