"""Lens models: the ray of a pixel, and the pixel of a point, in the axes of the camera.

The axes are OpenCV's, x right, y down, z forward; the first pixel's centre is (0.5, 0.5).

* `perspective`: pixel = K (d(x / z, y / z), 1), where d is the distortion of Brown and Conrady.
* `fisheye`: pixel = K (d(angle from the axis, towards (x, y)), 1), where d is that of Kannala and
  Brandt; up to 110 degrees from the axis.
* `orthographic`: pixel = K (x, y, 1), where K has pixels per metre; rays are parallel to the axis
  and begin in the plane z = 0.
* `equirectangular`: all directions, see `scenes.geometry.directions.equirectangular_directions`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np
import numpy.typing as npt

from pbrnet.pipeline.lenses.distortion import Distortion
from pbrnet.scenes.arrays import BoolArray, Float64Array
from pbrnet.scenes.geometry.directions import (
    equirectangular_directions,
    pixel_directions,
    turned,
    unit,
)

Projection = Literal["perspective", "fisheye", "equirectangular", "orthographic"]
Matrix = tuple[tuple[float, ...], ...]

WIDEST = math.radians(110)  # radians from the axis, of a fisheye
MIN_DEPTH = 1e-5  # metres before a camera
_STEEPEST = math.tan(1.55)  # x / z of perspective views with distortion
MAX_COEFFICIENT = 1e4
_MOST_KEPT = 1 << 20  # pixels of a lens whose rays are kept between views: 32 MB
OUTSIDE = (0.0, 0.0, 1e7)  # world metres
# Numbers of coefficients: k1 k2 p1 p2 [k3 [k4 k5 k6]], and k1 k2 k3 k4.
COEFFICIENTS: dict[Projection, tuple[int, ...]] = {
    "perspective": (0, 4, 5, 8),
    "fisheye": (0, 4),
    "equirectangular": (0,),
    "orthographic": (0,),
}


@dataclass(frozen=True)
class Rays:
    """Rays of pixels (...): origin (..., 3), metres, and unit direction, in the camera's axes.

    Where `valid` is False the lens has no ray; the direction is then ahead. All origins are 0 but
    those of orthographic lenses.
    """

    origins: Float64Array
    directions: Float64Array
    valid: BoolArray


@dataclass(frozen=True)
class Lens:
    """Projection of an image: its size in pixels, `K` (3, 3) and distortion in OpenCV's order.

    `K` is () for equirectangular images.
    """

    projection: Projection
    width: int
    height: int
    K: Matrix
    distortion: tuple[float, ...] = ()

    def verify(self, where: str) -> None:
        """Raise ValueError for a distortion that the projection does not have."""
        allowed = COEFFICIENTS[self.projection]
        if len(self.distortion) not in allowed:
            counts = ", ".join(map(str, allowed))
            raise ValueError(
                f"{where}: {len(self.distortion)} coefficients of distortion; "
                f"{self.projection} images have one of {counts}"
            )
        if not all(abs(value) <= MAX_COEFFICIENT for value in self.distortion):
            raise ValueError(f"{where}: a coefficient beyond {MAX_COEFFICIENT:g}")

    @property
    def is_panorama(self) -> bool:
        """True for an equirectangular image, which has no `K`."""
        return self.projection == "equirectangular"

    @property
    def is_rectilinear(self) -> bool:
        """True for a perspective image without distortion: straight lines stay straight."""
        return self.projection == "perspective" and not any(self.distortion)

    @property
    def is_pinhole(self) -> bool:
        """True for such an image without skew whose pixels are square."""
        if not self.is_rectilinear:
            return False
        (focal, skew, _), (_, focal_y, _), _ = self.K
        return abs(focal_y - focal) <= 1e-6 * focal and abs(skew) <= 1e-9

    @property
    def is_central(self) -> bool:
        """True if all rays begin at the camera's position."""
        return self.projection != "orthographic"

    @property
    def depth_is_distance(self) -> bool:
        """True if depth is measured along the ray, and not along the camera's axis."""
        return self.projection in ("fisheye", "equirectangular")

    @cached_property
    def plane(self) -> Distortion:
        """Distortion of the image plane; that of lenses without one is the identity."""
        if self.projection == "fisheye":
            k1, k2, k3, k4 = self.distortion or (0.0,) * 4
            return Distortion((k1, k2, k3, k4), (0.0,) * 3, (0.0, 0.0), WIDEST)
        k1, k2, p1, p2, k3, *below = (*self.distortion, *(0.0,) * 8)[:8]
        b1, b2, b3 = below
        return Distortion((k1, k2, k3, 0.0), (b1, b2, b3), (p1, p2), _STEEPEST)

    def resized(self, width: int, height: int, square: bool = False) -> Lens:
        """Return the lens for an image of another size that shows the same.

        With `square` pixels keep their aspect, and the image shows more or less at top and bottom.
        """
        if self.is_panorama:
            return replace(self, width=width, height=height)
        across = width / self.width
        down = across if square else height / self.height
        (focal_x, skew, x), (_, focal_y, y), last = self.K
        matrix = (
            (focal_x * across, skew * across, x * width / self.width),
            (0.0, focal_y * down, y * height / self.height),
            last,
        )
        return replace(self, width=width, height=height, K=matrix)

    def rays(self, pixels: Float64Array | None = None) -> Rays:
        """Return the rays of pixel positions (..., 2), or of all pixel centres, (H, W)."""
        if pixels is not None:
            return self._rays(pixels)
        if self.is_panorama:
            return _central(equirectangular_directions(self.width))
        if self.is_rectilinear:
            return _central(unit(pixel_directions(np.array(self.K), self.width, self.height)))
        centre_rays = _kept_centre_rays if self.width * self.height <= _MOST_KEPT else _centre_rays
        return centre_rays(self)

    def scaled_rays(self) -> Float64Array:
        """Return the vectors (H, W, 3) of the pixel centres that times depth lead to the surface.

        z = 1 where depth is measured along the axis, and the length is 1 where it is measured along
        the ray. They begin at the rays' origins.
        """
        if self.is_rectilinear:
            return pixel_directions(np.array(self.K), self.width, self.height)
        directions = self.rays().directions
        if self.projection != "perspective":
            return directions
        return directions / directions[..., 2:]

    def points(self, depth: npt.NDArray[np.floating]) -> Float64Array:
        """Return the surface points (H, W, 3) of a depth image (H, W), metres, camera axes."""
        return self.rays().origins + self.scaled_rays() * depth[..., None].astype(np.float64)

    def project(self, points: Float64Array) -> tuple[Float64Array, BoolArray]:
        """Return the image points (..., 2), pixels, of points (..., 3) in the camera's axes.

        Also where the lens has one, within the image or not; elsewhere it is 0.
        """
        if self.is_panorama:
            return self._project_panorama(points)
        ideal, valid = self._ideal_of(points)
        if any(self.distortion):
            valid &= self.plane.is_valid(ideal)
            ideal = self.plane.distorted(ideal)
        x, y = ideal[..., 0], ideal[..., 1]
        (focal_x, skew, centre_x), (_, focal_y, centre_y), _ = self.K
        places = np.stack([focal_x * x + skew * y + centre_x, focal_y * y + centre_y], axis=-1)
        return np.where(valid[..., None], places, 0), valid

    def contains(self, places: Float64Array) -> BoolArray:
        """Test which image points (..., 2) lie within the image."""
        inside = (places >= 0) & (places < (self.width, self.height))
        return np.asarray(inside.all(axis=-1))

    def ideal(self, pixels: Float64Array) -> tuple[Float64Array, BoolArray]:
        """Return the points (..., 2) of the ideal plane of pixel positions, and where they exist.

        `pipeline.lenses.distortion` says what the plane is; that of orthographic lenses has metres.
        """
        (focal_x, skew, centre_x), (_, focal_y, centre_y), _ = self.K
        y = (pixels[..., 1] - centre_y) / focal_y
        x = (pixels[..., 0] - centre_x - skew * y) / focal_x
        plane = np.stack([x, y], axis=-1)
        if any(self.distortion) or self.projection == "fisheye":
            return self.plane.ideal(plane)
        return plane, np.ones(plane.shape[:-1], dtype=bool)

    def _rays(self, pixels: Float64Array) -> Rays:
        if self.is_panorama:
            return self._panorama_rays(pixels)
        ideal, valid = self.ideal(pixels)
        flat = np.concatenate([ideal, np.zeros((*ideal.shape[:-1], 1))], axis=-1)
        ahead = np.zeros_like(flat)
        ahead[..., 2] = 1
        if self.projection == "orthographic":
            return Rays(flat, ahead, valid)
        if self.projection == "perspective":
            return _central(unit(flat + ahead), valid)
        angle = np.sqrt((ideal**2).sum(axis=-1))
        around = ideal * (_sin(angle) / np.where(angle > 0, angle, 1))[..., None]
        directions = np.concatenate([around, _cos(angle)[..., None]], axis=-1)
        return _central(directions, valid)

    def _panorama_rays(self, pixels: Float64Array) -> Rays:
        pitch = 2 * math.pi / self.width
        azimuth, polar = pixels[..., 0] * pitch - math.pi, pixels[..., 1] * pitch
        flat = _sin(polar)
        directions = np.stack([flat * _sin(azimuth), -_cos(polar), flat * _cos(azimuth)], axis=-1)
        return _central(directions)

    def _project_panorama(self, points: Float64Array) -> tuple[Float64Array, BoolArray]:
        x, y, z = (points[..., axis] for axis in range(3))
        pitch = 2 * math.pi / self.width
        azimuth, polar = _atan2(x, z), _atan2(np.sqrt(x * x + z * z), -y)
        places = np.stack([(azimuth + math.pi) / pitch, polar / pitch], axis=-1)
        return places, (points != 0).any(axis=-1)

    def _ideal_of(self, points: Float64Array) -> tuple[Float64Array, BoolArray]:
        """Return the points (..., 2) of the ideal plane, and which the lens may see."""
        x, y, z = (points[..., axis] for axis in range(3))
        before = z > MIN_DEPTH
        if self.projection == "orthographic":
            return points[..., :2], before
        if self.projection == "perspective":
            z_or_one = np.where(before, z, 1)
            return np.stack([x / z_or_one, y / z_or_one], axis=-1), before
        across = np.sqrt(x * x + y * y)
        angle = _atan2(across, z)
        ideal = (
            points[..., :2]
            * np.where(across > 0, angle / np.where(across > 0, across, 1), 0)[..., None]
        )
        return ideal, (angle <= self.plane.limit) & (points != 0).any(axis=-1)


def world_rays(lens: Lens, pose: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return origins (P, 3) and unit directions (P, 3) of the pixel centres in the world, metres.

    `pose` is `camera_to_world` (4, 4). Where all rays begin at the eye, there is one origin, (3,).
    A pixel without a ray has one that begins far outside of any scene and leads away from it.
    """
    rays = lens.rays()
    directions = turned(rays.directions.reshape(-1, 3), pose[:3, :3])
    valid = rays.valid.ravel()
    if lens.is_central and valid.all():
        return pose[:3, 3], directions
    origins = pose[:3, 3] + turned(rays.origins.reshape(-1, 3), pose[:3, :3])
    return np.where(valid[:, None], origins, OUTSIDE), np.where(
        valid[:, None], directions, (0.0, 0.0, 1.0)
    )


def _central(directions: Float64Array, valid: BoolArray | None = None) -> Rays:
    """Return rays from the camera's position; without `valid` all are."""
    if valid is None:
        valid = np.ones(directions.shape[:-1], dtype=bool)
    return Rays(np.broadcast_to(0.0, directions.shape), directions, valid)


def _centre_rays(lens: Lens) -> Rays:
    """Return the rays of the pixel centres, (H, W); read-only."""
    columns, rows = np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5)
    rays = lens._rays(np.stack([columns, rows], axis=-1))
    for array in (rays.origins, rays.directions, rays.valid):
        array.setflags(write=False)
    return rays


_kept_centre_rays = lru_cache(maxsize=4)(_centre_rays)


# Python's functions: those of NumPy depend on the processor.
def _sin(angles: Float64Array) -> Float64Array:
    return np.asarray(np.frompyfunc(math.sin, 1, 1)(angles), dtype=np.float64)


def _cos(angles: Float64Array) -> Float64Array:
    return np.asarray(np.frompyfunc(math.cos, 1, 1)(angles), dtype=np.float64)


def _atan2(y: Float64Array, x: Float64Array) -> Float64Array:
    return np.asarray(np.frompyfunc(math.atan2, 2, 1)(y, x), dtype=np.float64)
