"""Trajectories from files: camera poses in the world of a scene, metres, Z up.

Two formats, by suffix:

* `.json`: `{"camera_to_world": [4x4, ...], "half_fov_x": 0.55}`, rigid matrices by rows, the
  camera's axes OpenCV's (x right, y down, z forward); `half_fov_x`, radians, may be left out;
* `.txt`, `.tum`: the format of the TUM RGB-D benchmark, a frame a line: `timestamp tx ty tz qx qy
  qz qw`, place and unit quaternion of the same `camera_to_world`; `#` begins a comment. Frames
  follow in the order of the lines, and the times are not used.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pbrnet.pipeline.cameras.settings import CameraParams
from pbrnet.pipeline.views import Matrix, check_pose
from pbrnet.scenes.checked import build
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import exists, read_json, regular_file

_MAX_BYTES = 1 << 24
_MAX_FRAMES = 10_000


@dataclass(frozen=True)
class Trajectory:
    """Poses of the frames of a trajectory, `camera_to_world` each.

    `half_fov_x` is in radians; None: that of the images.
    """

    name: str
    camera_to_world: tuple[Matrix, ...]
    half_fov_x: float | None = None


@dataclass(frozen=True)
class _Content:
    """Content of a JSON file."""

    camera_to_world: tuple[Matrix, ...]
    half_fov_x: float | None = None


def read_trajectory(path: Path, name: str) -> Trajectory:
    """Read a file; raises `InputError` that names file and place of the fault."""
    readers: dict[str, Callable[[Path], _Content]] = {
        ".json": lambda file: build(_Content, read_json(file), str(file), InputError),
        ".txt": _read_tum,
        ".tum": _read_tum,
    }
    if not exists(path):
        raise InputError(f"{path}: no such file; cameras.trajectories names it")
    if path.suffix.lower() not in readers:
        raise InputError(f"{path}: a trajectory is a .json file, or a .txt or .tum file")
    regular_file(path, _MAX_BYTES)
    content = readers[path.suffix.lower()](path)
    if not 2 <= len(content.camera_to_world) <= _MAX_FRAMES:
        count = len(content.camera_to_world)
        raise InputError(f"{path}: {count:,} frames; from 2 to {_MAX_FRAMES:,} are allowed")
    if content.half_fov_x is not None and not 0.05 <= content.half_fov_x <= 1.4:
        raise InputError(f"{path}: half_fov_x must be from 0.05 to 1.4 radians")
    for number, pose in enumerate(content.camera_to_world):
        try:
            check_pose(pose, f"{path}: frame {number}")
        except ValueError as error:
            raise InputError(str(error)) from None
    return Trajectory(name, content.camera_to_world, content.half_fov_x)


def trajectories_of(scene_id: str, options: CameraParams) -> list[Path]:
    """Return the files of the trajectories of a scene, in the order of the parameters."""
    return [Path(one.file) for one in options.trajectories if one.scene == scene_id]


def _read_tum(path: Path) -> _Content:
    poses = []
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise InputError(f"{path}: not a text file") from None
    for number, line in enumerate(lines, 1):
        words = line.split("#")[0].replace(",", " ").split()
        if not words:
            continue
        try:
            values = [float(word) for word in words]
        except ValueError:
            values = []
        if len(values) != 8 or not all(map(math.isfinite, values)):
            raise InputError(
                f"{path}, line {number}: expected timestamp tx ty tz qx qy qz qw, 8 numbers"
            )
        poses.append(_pose(values[1:4], values[4:], f"{path}, line {number}"))
    return _Content(tuple(poses))


def _pose(place: list[float], quaternion: list[float], where: str) -> Matrix:
    """Return `camera_to_world` of a place (3,) and a quaternion x, y, z, w."""
    length = math.sqrt(math.fsum(value * value for value in quaternion))
    if abs(length - 1) > 0.01:
        raise InputError(f"{where}: the quaternion's length is {length:.4g}, not 1")
    x, y, z, w = (value / length for value in quaternion)
    a, b, c = place
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), a),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), b),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), c),
        (0.0, 0.0, 0.0, 1.0),
    )
