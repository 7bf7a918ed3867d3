"""Camera rays of any lens for the path tracer, in Dr.Jit arrays.

A ray passes a position of the image that lies anywhere in its pixel. Distortion is inverted there
by Newton's method, from the point of the ideal plane at the pixel's centre, which NumPy finds in
double precision (`pbrnet.pipeline.lenses.model`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from pbrnet.pipeline.lenses.model import Lens, Projection
from pbrnet.pipeline.render.drjit_arrays import column

_ITERATIONS = 4  # from half a pixel away; each squares the error


class LensKind(NamedTuple):
    """Properties of a lens that a recorded kernel is compiled for."""

    projection: Projection
    width: int
    height: int
    bends: bool  # has distortion


class LensArrays(NamedTuple):
    """Arrays of a lens that a recorded kernel reads; they differ between lenses of one kind.

    `numbers` are those of `K`, row by row without its last one, and of the distortion; `ideal` are
    the points of the ideal plane at the pixel centres, x and y in turn; `valid` is 1 where a pixel
    has a ray.
    """

    numbers: mi.Float
    ideal: mi.Float
    valid: mi.Float


def kind_of(lens: Lens) -> LensKind:
    """Return the kind of a lens."""
    return LensKind(lens.projection, lens.width, lens.height, any(lens.distortion))


def lens_arrays(lens: Lens) -> LensArrays:
    """Return the arrays of a lens; those of an equirectangular one are empty but for an entry."""
    if lens.is_panorama:
        return LensArrays(*(column(mi.Float, np.zeros(1)) for _ in range(3)))
    columns, rows = np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5)
    ideal, valid = lens.ideal(np.stack([columns, rows], axis=-1))
    plane = lens.plane
    (focal_x, skew, x), (_, focal_y, y), _ = lens.K
    numbers = (focal_x, skew, x, focal_y, y, *plane.numerator, *plane.denominator)
    return LensArrays(
        column(mi.Float, np.array([*numbers, *plane.tangential])),
        column(mi.Float, ideal.ravel()),
        column(mi.Float, valid.ravel().astype(np.float64)),
    )


def camera_rays(
    kind: LensKind, arrays: LensArrays, pixel: mi.UInt32, offset: mi.Point2f
) -> tuple[mi.Vector3f, mi.Vector3f, mi.Bool]:
    """Return origins, unit directions and validity of rays, in the camera's axes.

    `pixel` is the number of the pixel in row-major order, `offset` in [0, 1)^2 the place in it:
    even on the image, or on the sphere in equirectangular images.
    """
    across, row = mi.Float(pixel % kind.width), mi.Float((pixel // kind.width) % kind.height)
    if kind.projection == "equirectangular":
        return mi.Vector3f(0), _sphere_direction(kind, across, row, offset), mi.Bool(True)
    index = pixel % (kind.width * kind.height)
    focal_x, skew, x, focal_y, y, *distortion = (
        entry(arrays.numbers, number) for number in range(14)
    )
    down = (row + offset.y - y) / focal_y
    plane = mi.Point2f((across + offset.x - x - skew * down) / focal_x, down)
    if kind.bends:
        plane = _undistorted(plane, dr.gather(mi.Point2f, arrays.ideal, index), distortion)
    valid = dr.gather(mi.Float, arrays.valid, index) > 0
    ahead = mi.Vector3f(0, 0, 1)
    if kind.projection == "orthographic":
        return mi.Vector3f(plane.x, plane.y, 0), ahead, valid
    if kind.projection == "perspective":
        return mi.Vector3f(0), dr.normalize(mi.Vector3f(plane.x, plane.y, 1)), valid
    angle = dr.norm(plane)
    sine, cosine = dr.sincos(angle)
    around = plane * dr.select(angle > 0, sine / angle, 1)
    return mi.Vector3f(0), dr.normalize(mi.Vector3f(around.x, around.y, cosine)), valid


def _sphere_direction(
    kind: LensKind, across: mi.Float, row: mi.Float, offset: mi.Point2f
) -> mi.Vector3f:
    pitch = 2 * math.pi / kind.width
    top, bottom = dr.cos(row * pitch), dr.cos((row + 1) * pitch)
    sine = dr.lerp(top, bottom, offset.y)
    azimuth = (across + offset.x) * pitch - math.pi
    flat = dr.safe_sqrt(1 - dr.square(sine))
    return mi.Vector3f(flat * dr.sin(azimuth), -sine, flat * dr.cos(azimuth))


def _undistorted(plane: mi.Point2f, start: mi.Point2f, distortion: list[mi.Float]) -> mi.Point2f:
    """Invert the distortion of `pbrnet.pipeline.lenses.distortion` near points `start`."""
    a1, a2, a3, a4, b1, b2, b3, p1, p2 = distortion
    found = start
    for _ in range(_ITERATIONS):
        x, y = found.x, found.y
        s = dr.squared_norm(found)
        above = 1 + s * (a1 + s * (a2 + s * (a3 + s * a4)))
        above_rate = a1 + s * (2 * a2 + s * (3 * a3 + s * 4 * a4))
        below = 1 + s * (b1 + s * (b2 + s * b3))
        below_rate = b1 + s * (2 * b2 + s * 3 * b3)
        scale = above / below
        rate = (above_rate - scale * below_rate) / below
        error_x = x * scale + 2 * p1 * x * y + p2 * (s + 2 * x * x) - plane.x
        error_y = y * scale + p1 * (s + 2 * y * y) + 2 * p2 * x * y - plane.y
        xx = scale + 2 * x * x * rate + 2 * p1 * y + 6 * p2 * x
        xy = 2 * (x * y * rate + p1 * x + p2 * y)
        yy = scale + 2 * y * y * rate + 6 * p1 * y + 2 * p2 * x
        determinant = xx * yy - xy * xy
        usable = determinant > 0
        step = mi.Point2f(yy * error_x - xy * error_y, xx * error_y - xy * error_x) / determinant
        found = dr.select(usable, found - step, found)
    return found


def entry(values: mi.Float, index: int) -> mi.Float:
    """Return one number of an array, as an input of a recorded kernel."""
    return dr.gather(mi.Float, values, mi.UInt32(index))
