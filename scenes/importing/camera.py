"""Cameras of a source: pinhole cameras that become stored views."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field, replace
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.geometry.transforms import look_at
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.writer import sensor_element
from pbrnet.scenes.reconstruction.rooms import FoundRoom


@dataclass(frozen=True)
class Camera:
    """A pinhole camera of the source, before it is written as a stored view."""

    name: str
    to_world: Float64Array  # (4, 4), Mitsuba's axes: x left, y up, z forward
    half_fov_x: float  # radians
    width: int  # pixels
    height: int
    room: str = ""  # name of the room that contains it, in the source
    more: dict[str, Any] = field(default_factory=dict)  # further keys of the stored view


def transformed_camera(camera: Camera, frame: Float64Array, changes: Changes) -> Camera:
    """Transform a camera by `frame` (4, 4) and make its axes orthonormal and right-handed."""
    matrix = frame @ camera.to_world
    axes = matrix[:3, :3] / np.linalg.norm(matrix[:3, :3], axis=0)
    if np.linalg.det(axes) < 0:
        axes[:, 0] = -axes[:, 0]
        changes.note("a mirrored camera was made right-handed: {}", camera.name)
    forward = axes[:, 2]
    left = np.cross(axes[:, 1], forward)
    left /= np.linalg.norm(left)
    rigid = np.eye(4)
    rigid[:3, :3] = np.stack([left, np.cross(forward, left), forward], axis=1)
    rigid[:3, 3] = matrix[:3, 3]
    return replace(camera, to_world=rigid)


def default_camera(room: FoundRoom) -> Camera:
    """A view across the room, for files without a usable camera."""
    points = np.array(room.floor.exterior.coords)
    centre = room.centre
    far = points[int(np.argmax(np.linalg.norm(points - centre[:2], axis=1)))]
    eye = centre.copy()
    eye[2] = min(room.floor_z + 1.55, room.ceiling_z - 0.2)
    target = np.array([*far, room.floor_z + 0.6])
    matrix = look_at(eye, target, np.array([0.0, 0, 1]))
    return Camera("centre", matrix, 0.5534, 480, 360)


def sensor_of(camera: Camera) -> Element:
    return sensor_element(
        camera.to_world, math.degrees(2 * camera.half_fov_x), camera.width, camera.height
    )


def view_of(camera: Camera, room_names: dict[str, str]) -> dict[str, Any]:
    """The camera as a stored view: OpenCV axes are Mitsuba's with x and y negated.

    `room_names` maps the source's names of rooms to ids.
    """
    pose = camera.to_world @ np.diag([-1.0, -1, 1, 1])
    room = {"room": room_names[camera.room]} if camera.room in room_names else {}
    return {
        **camera.more,
        **room,
        "name": re.sub(r"[^A-Za-z0-9_-]+", "_", camera.name),
        "camera_to_world": pose.tolist(),
        "half_fov_x": camera.half_fov_x,
        "width": camera.width,
        "height": camera.height,
    }
