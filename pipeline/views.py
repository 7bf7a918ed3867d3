"""Views (cameras in a scene, OpenCV convention) and camera files."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from pbrnet.pipeline.lenses.model import WIDEST, Lens, Matrix, Projection, world_rays
from pbrnet.pipeline.lenses.settings import LensParams, check_lens, lens_of
from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.checked import OPTIONAL, build, check_name, param, plain, within
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import read_json, write_json
from pbrnet.scenes.geometry.directions import turned, unit

MAX_SIDE = 16_384  # pixels
MAX_NUMBER = 1e7  # metres in a pose, pixels in K
MIN_FOCAL = 1e-3  # pixels, or pixels per metre


@dataclass(frozen=True)
class ImageParams:
    """Projection and size of every frame.

    The field of view follows PBRS at 4:3 (half-angle in x is fixed), up to 1.4 in perspective
    images. `half_fov_x` is not used by equirectangular images, which show all directions, by
    orthographic ones, and where `lens` has a focal length.
    """

    width: int = param(160, "pixels", within(16, 8192))
    height: int = param(120, "pixels", within(16, 8192))
    half_fov_x: float = param(0.5534, "radians, PBRS", within(0.05, WIDEST))
    projection: Projection = param(
        "perspective",
        "perspective, fisheye, equirectangular or orthographic, see docs/cameras.md",
        OPTIONAL,
    )
    lens: LensParams = param(LensParams(), "focal length, centre and distortion", OPTIONAL)

    @property
    def is_panorama(self) -> bool:
        """True if images show all directions."""
        return self.projection == "equirectangular"

    @property
    def is_pinhole(self) -> bool:
        """True if all views are perspective without distortion, their pixels square."""
        options = self.lens
        plain = not any(options.distortion) and len(options.focal) < 2
        return self.projection == "perspective" and plain

    @property
    def coefficients(self) -> int:
        """Number of coefficients of distortion in the rows of a dataset; 0: none."""
        if self.projection == "fisheye":
            return 4
        return len(self.lens.distortion) if any(self.lens.distortion) else 0

    def verify(self, where: str) -> None:
        """Raise ValueError for an equirectangular image that is not twice as wide as high.

        Also for a lens that does not fit the projection.
        """
        check_lens(self, where)
        if self.is_panorama and self.width != 2 * self.height:
            raise ValueError(
                f"{where}: {self.width} x {self.height} pixels; with projection: equirectangular "
                "the width is twice the height"
            )


@dataclass(frozen=True)
class View:
    """A camera in a scene.

    `camera_to_world` is 4x4 and rigid, metres; the camera frame is OpenCV's: x right, y down,
    z forward. `K` is 3x3 in pixels with pixel centres at +0.5:
    pixel = K @ (x/z, y/z, 1), so the first pixel's centre is (0.5, 0.5).

    `projection` and `distortion` are those of `pbrnet.pipeline.lenses.model`; the formula of pixels
    is for perspective views without distortion. An equirectangular view shows all directions and
    has no `K`, (): its middle column is straight ahead, right of it is the camera's right, the top
    row is its up.
    """

    scene_id: str
    view_id: str
    width: int
    height: int
    K: Matrix
    camera_to_world: Matrix
    room: str | None = None
    room_type: str = "other"
    sector: int = -1
    score: float = 0.0
    seen: dict[str, int] = field(default_factory=dict)  # object id -> pixels in the id render
    # Of a frame of a trajectory: its name, the frame's number from 0, and `camera_to_world` of the
    # frames before and after it, empty for the first and the last.
    trajectory: str = field(default="", metadata=OPTIONAL)
    frame: int = field(default=-1, metadata=OPTIONAL)
    pose_before: Matrix = field(default=(), metadata=OPTIONAL)
    pose_after: Matrix = field(default=(), metadata=OPTIONAL)
    # Of a view of a stereo pair: the other view's id, and how far that lies to the right, metres.
    stereo_partner: str = field(default="", metadata=OPTIONAL)
    stereo_offset: float = field(default=0.0, metadata=OPTIONAL)
    # Of a view of an overlapping set: its name, and the median overlap of its pairs, in [0, 1].
    view_set: str = field(default="", metadata=OPTIONAL)
    set_overlap: float = field(default=0.0, metadata=OPTIONAL)
    projection: Projection = field(default="perspective", metadata=OPTIONAL)
    distortion: tuple[float, ...] = field(default=(), metadata=OPTIONAL)  # in OpenCV's order

    def verify(self, where: str) -> None:
        """Raise ValueError for wrong names, shapes, poses or focal lengths."""
        check_name(self.scene_id, "a scene's id", where, ValueError)
        check_name(self.view_id, "a view's id", where, ValueError)
        if not (1 <= self.width <= MAX_SIDE and 1 <= self.height <= MAX_SIDE):
            raise ValueError(
                f"{where}: {self.width:,} x {self.height:,} pixels; from 1 to {MAX_SIDE:,} a side"
            )
        if self.is_panorama:
            if self.K or self.width != 2 * self.height:
                raise ValueError(
                    f"{where}: an equirectangular view is twice as wide as high and has no K"
                )
        else:
            check_intrinsics(self.K, f"{where}.K")
        self.lens.verify(f"{where}.distortion")
        check_pose(self.camera_to_world, f"{where}.camera_to_world")
        for name in ("pose_before", "pose_after"):
            if getattr(self, name):
                check_pose(getattr(self, name), f"{where}.{name}")

    @property
    def name(self) -> tuple[str, str]:
        """Scene and view id, which together name the view."""
        return self.scene_id, self.view_id

    @property
    def walk(self) -> tuple[str, str]:
        """Scene and trajectory."""
        return self.scene_id, self.trajectory

    @property
    def is_panorama(self) -> bool:
        """True for an equirectangular view, which has no `K`."""
        return self.projection == "equirectangular"

    @property
    def pose(self) -> Float64Array:
        """`camera_to_world` as float64 (4, 4)."""
        return np.array(self.camera_to_world, dtype=np.float64)

    @property
    def intrinsics(self) -> Float64Array:
        """`K` as float64 (3, 3); raises `InputError` for a view that it does not describe."""
        if not self.lens.is_rectilinear:
            kind = self.projection if self.projection != "perspective" else "distorted"
            raise InputError(
                f"view {self.view_id} of {self.scene_id} is {kind}; "
                "this needs a perspective view without distortion"
            )
        return np.array(self.K, dtype=np.float64)

    @cached_property
    def lens(self) -> Lens:
        """Projection of the image, in the axes of the camera."""
        return Lens(self.projection, self.width, self.height, self.K, self.distortion)

    def resized(self, width: int, height: int) -> View:
        """Return the view with an image of another size that shows the same."""
        return replace(self, width=width, height=height, K=self.lens.resized(width, height).K)

    @property
    def half_fov_x(self) -> float:
        """Angle between the axis and the middle of the image's right edge, radians.

        It is pi in equirectangular views, and 0 in orthographic ones.
        """
        if self.is_panorama:
            return math.pi
        if self.lens.is_pinhole:
            return math.atan(0.5 * self.width / self.K[0][0])
        edge = np.array([self.width, 0.5 * self.height])
        x, _, z = self.lens.rays(edge).directions.tolist()
        return abs(math.atan2(x, z))

    def rays(self) -> Float64Array:
        """Return vectors (H, W, 3) of the pixel centres that times depth lead to the surface.

        They are in the camera's axes: z = 1 in perspective and orthographic views, and length 1 in
        fisheye and equirectangular ones, whose depth is the distance along the ray.
        """
        return self.lens.scaled_rays()

    def world_rays(self) -> tuple[Float64Array, Float64Array]:
        """Return origins, (3,) or (P, 3), and directions (P, 3) of the pixels' rays, world.

        See `pbrnet.pipeline.lenses.model.world_rays`.
        """
        return world_rays(self.lens, self.pose)

    @property
    def eye(self) -> Float64Array:
        """Camera position in the world, metres, float64 (3,)."""
        return self.pose[:3, 3]


@dataclass(frozen=True)
class CameraFile:
    """Content of `data/cameras/<scene_id>.json`: the views, and rejected candidates by reason."""

    scene_id: str
    views: tuple[View, ...]
    candidates: int = 0
    rejected: dict[str, int] = field(default_factory=dict)  # reason -> candidates
    fingerprint: str = ""
    unfurnished: bool = False  # parts of the building counted, since no view saw enough furniture
    stored_left_out: dict[str, str] = field(default_factory=dict)  # view id -> reason
    # trajectory from a file -> number of a frame that has no room -> reason
    collisions: dict[str, dict[str, str]] = field(default_factory=dict, metadata=OPTIONAL)
    relaxed: dict[str, str] | None = field(default=None, metadata=OPTIONAL)  # room -> its rules


def check_intrinsics(intrinsics: Matrix, where: str) -> None:
    """Raise ValueError unless `intrinsics` is 3x3, upper triangular, its focal lengths possible."""
    values = _bounded(intrinsics, 3, where)
    if min(values[0, 0], values[1, 1]) < MIN_FOCAL:
        raise ValueError(f"{where}: focal lengths must be {MIN_FOCAL:g} pixels or more")
    if np.tril(values, -1).any() or values[2, 2] != 1:
        raise ValueError(f"{where}: the last row must be 0, 0, 1, and the second begin with 0")


def check_pose(pose: Matrix, where: str) -> None:
    """Raise ValueError unless `pose` is 4x4, a rotation and a translation within bounds."""
    values = _bounded(pose, 4, where)
    rotation = values[:3, :3]
    orthonormal = np.allclose(turned(rotation, rotation).T, np.eye(3), atol=1e-4)
    if not orthonormal or np.linalg.det(rotation) < 0 or values[3].tolist() != [0, 0, 0, 1]:
        raise ValueError(f"{where}: not a rotation and a translation")


def _bounded(matrix: Matrix, side: int, where: str) -> Float64Array:
    """Return a square matrix as an array; raises ValueError for other sides, NaN, huge numbers."""
    if [len(row) for row in matrix] != [side] * side:
        raise ValueError(f"{where}: must be {side}x{side}")
    values = np.array(matrix, dtype=np.float64)
    if not np.abs(values).max() <= MAX_NUMBER:
        raise ValueError(f"{where}: holds NaN or numbers beyond {MAX_NUMBER:g}")
    return values


def look(eye: Any, towards: Any, up: Any = (0.0, 0.0, 1.0)) -> Float64Array:
    """Return `camera_to_world` (4, 4) of a camera at `eye` that looks along `towards`."""
    forward = unit(np.asarray(towards, dtype=np.float64))
    right = unit(np.cross(forward, np.asarray(up, dtype=np.float64)))
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2] = right, np.cross(forward, right), forward
    pose[:3, 3] = eye
    return pose


def rolled(pose: Float64Array, angle: float) -> Float64Array:
    """Return `camera_to_world` turned clockwise about its own axis by `angle`, radians.

    Clockwise as seen from behind the camera: the picture turns the other way.
    """
    if not angle:
        return pose
    turned = pose.copy()
    right, down = pose[:3, 0], pose[:3, 1]
    turned[:3, 0] = math.cos(angle) * right + math.sin(angle) * down
    turned[:3, 1] = math.cos(angle) * down - math.sin(angle) * right
    return turned


def opengl_pose(pose: Float64Array) -> Float64Array:
    """Return a pose (4, 4) with the camera's axes x right, y up, z backward, from OpenCV's."""
    turned: Float64Array = pose @ np.diag([1.0, -1.0, -1.0, 1.0])
    return turned


def camera_model(lens: Lens) -> dict[str, Any]:
    """Return the fields of views that a lens decides."""
    return {
        "K": lens.K,
        "projection": lens.projection,
        "width": lens.width,
        "height": lens.height,
        "distortion": lens.distortion,
    }


def intrinsics_of(image: ImageParams) -> Float64Array:
    """Return `K` (3, 3) of images; with ranges that of their middle."""
    return np.array(lens_of(image).K)


def as_matrix(array: Float64Array) -> Matrix:
    """Return a 2-D array as nested tuples of Python floats."""
    return tuple(tuple(float(value) for value in row) for row in array)


def save_cameras(path: Path, cameras: CameraFile) -> None:
    """Write a camera file by rename."""
    write_json(path, plain(cameras, brief=True))


def load_cameras(path: Path) -> CameraFile:
    """Read and check a camera file; raises `InputError` that names the fault."""
    cameras = build(CameraFile, read_json(path), str(path), InputError)
    check_name(cameras.scene_id, "a scene's id", str(path), InputError)
    names = [view.view_id for view in cameras.views]
    if len(set(names)) != len(names):
        raise InputError(f"{path}: two views have the same view_id")
    return cameras
