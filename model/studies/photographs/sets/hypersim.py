"""Sets in Hypersim's layout (Roberts et al. 2021): HDF5 images, cameras in CSV files.

Distances along rays become z-depth by the rays of `metadata_camera_parameters.csv`. Pictures are
linear radiance. With `metadata_images_split_scene_v1.csv` only frames of the public release count,
those of the partition `train` to train on and of `test` to test on.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np

from pbrnet.model.studies.photographs.sets.contract import (
    MAX_SIDE,
    Intrinsics,
    Key,
    Photograph,
    Purpose,
    checked,
    listing_digest,
)
from pbrnet.model.studies.photographs.sets.hdf5 import open_hdf5, whole
from pbrnet.scenes.arrays import AnyArray, Float64Array
from pbrnet.scenes.checked import check_name
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import digest_file, exists, read_csv

_CAMERAS = "metadata_camera_parameters.csv"
_PARTS = (  # kinds and files of a frame
    *(("geometry", part) for part in ("depth_meters", "normal_cam", "semantic")),
    ("final", "color"),
)
_FRAMES = "metadata_images_split_scene_v1.csv"
_TO_OURS = np.array([1.0, -1.0, -1.0])  # camera axes: theirs are x right, y up, z backward


def is_hypersim(path: Path) -> bool:
    """Return whether a path is a folder of this layout."""
    return (path / _CAMERAS).is_file()


class Hypersim:
    """Reader of this layout; raises `InputError` for a set without usable frames."""

    def __init__(self, path: Path, purpose: Purpose) -> None:
        self.path = path
        self._rays = {
            line.get("scene_name", ""): _ray_matrix(path / _CAMERAS, line)
            for line in read_csv(path / _CAMERAS)
        }
        places = _listed(path, purpose) if exists(path / _FRAMES) else _found(path)
        self._places = [
            one for one in places if exists(self._file(one, "geometry", "depth_meters"))
        ]
        if not self._places:
            raise InputError(f"{path}: no frames with depth_meters to {purpose} on")
        self.keys = [Key("/".join(place), place[0]) for place in self._places]

    def read(self, numbers: Iterable[int]) -> Iterator[Photograph]:
        """Read pictures as `PhotographSet.read` does."""
        for number in numbers:
            yield self._read(self.keys[number], self._places[number])

    def fingerprint(self) -> str:
        """Return the digest of the files' sizes, of the cameras and of the frames' names."""
        files = [self._file(one, *part) for one in self._places for part in _PARTS]
        names = (key.name for key in self.keys)
        return listing_digest([*filter(exists, files)], digest_file(self.path / _CAMERAS), *names)

    def _read(self, key: Key, place: tuple[str, str, str]) -> Photograph:
        away = self._array(place, "geometry", "depth_meters", 2).astype(np.float64)
        height, width = away.shape
        if max(height, width) > MAX_SIDE:
            raise InputError(f"{key.name}: {width}x{height} pixels; at most {MAX_SIDE} a side")
        if place[0] not in self._rays:
            raise InputError(f"{self.path / _CAMERAS}: no camera of {place[0]}")
        rays, intrinsics = _rays(self._rays[place[0]], width, height)
        normal = self._array(place, "geometry", "normal_cam", 3).astype(np.float64) * _TO_OURS
        labels = self._array(place, "geometry", "semantic", 2)
        image = self._array(place, "final", "color", 3).astype(np.float32)
        return checked(
            Photograph(
                key=key,
                image=np.maximum(np.nan_to_num(image, posinf=65504), 0),
                depth=(away / np.linalg.norm(rays, axis=-1)).astype(np.float32),
                intrinsics=intrinsics,
                normal=_facing(normal, rays).astype(np.float32),
                label40=np.where((labels > 0) & (labels <= 40), labels, 0).astype(np.uint8),
            )
        )

    def _array(self, place: tuple[str, str, str], kind: str, part: str, axes: int) -> AnyArray:
        with open_hdf5(self._file(place, kind, part)) as file:
            return whole(file, "dataset", (None, None, 3)[:axes])

    def _file(self, place: tuple[str, str, str], kind: str, part: str) -> Path:
        scene, camera, frame = place
        folder = self.path / scene / "images" / f"scene_{camera}_{kind}_hdf5"
        return folder / f"frame.{frame}.{part}.hdf5"


def _listed(path: Path, purpose: Purpose) -> list[tuple[str, str, str]]:
    """Return scene, camera and frame of the frames of a partition."""
    places = []
    for line in read_csv(path / _FRAMES):
        public = line.get("included_in_public_release", "") == "True"
        if public and line.get("split_partition_name") == purpose:
            for name in ("scene_name", "camera_name"):
                check_name(line.get(name, ""), name, str(path / _FRAMES), InputError)
            frame = line.get("frame_id", "")
            if not (frame.isascii() and frame.isdigit()):
                raise InputError(f"{path / _FRAMES}: {frame[:50]!r} is no frame_id")
            places.append((line["scene_name"], line["camera_name"], f"{int(frame):04d}"))
    return places


def _found(path: Path) -> list[tuple[str, str, str]]:
    """Return scene, camera and frame of all frames with a depth file."""
    files = path.glob("*/images/scene_*_geometry_hdf5/frame.*.depth_meters.hdf5")
    return sorted(
        (
            file.parents[2].name,
            file.parent.name.removeprefix("scene_").removesuffix("_geometry_hdf5"),
            file.name.split(".")[1],
        )
        for file in files
    )


def _ray_matrix(path: Path, line: Mapping[str, str]) -> Float64Array:
    """Return the matrix (3, 3) from (u, v, 1), in [-1, 1], to a ray, of a line of the cameras."""
    try:
        values = [[float(line[f"M_cam_from_uv_{i}{j}"]) for j in range(3)] for i in range(3)]
    except (KeyError, ValueError):
        raise InputError(f"{path}: a line without the numbers M_cam_from_uv_00 to _22") from None
    matrix = np.array(values)
    forward = -matrix[2, 2]
    if not np.isfinite(matrix).all() or forward <= 0 or min(matrix[0, 0], matrix[1, 1]) <= 0:
        raise InputError(f"{path}: M_cam_from_uv of {line.get('scene_name')!r} is no camera")
    return matrix


def _rays(matrix: Float64Array, width: int, height: int) -> tuple[Float64Array, Intrinsics]:
    """Return rays with z = 1 in our axes (H, W, 3), and the pinhole camera nearest to them."""
    u = 2 * (np.arange(width) + 0.5) / width - 1
    v = 1 - 2 * (np.arange(height) + 0.5) / height
    grid = np.stack([*np.meshgrid(u, v), np.ones((height, width))], -1)
    rays = grid @ matrix.T * _TO_OURS
    rays /= np.maximum(rays[..., 2:], 1e-6)
    x, y = rays[height // 2, :, 0], rays[:, width // 2, 1]
    fx, fy = (width - 1) / (x[-1] - x[0]), (height - 1) / (y[-1] - y[0])
    camera = Intrinsics(float(fx), float(fy), float(0.5 - x[0] * fx), float(0.5 - y[0] * fy))
    return rays, camera


def _facing(normal: Float64Array, rays: Float64Array) -> Float64Array:
    """Return unit normals turned towards the camera, 0 where there is none."""
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    known = np.isfinite(length) & (length > 0.5)
    unit = np.where(known, normal / np.where(known, length, 1), 0)
    away = (unit * rays).sum(-1, keepdims=True) > 0
    return np.where(away, -unit, unit)
