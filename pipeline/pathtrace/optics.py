"""Aperture and shutter of a camera: depth of field, motion blur, rolling shutter.

A sample is a position in its pixel, a point of the aperture and a time, each stratified over the
pixel's samples; the mean over all of them is the pixel, so every path tracer stays unbiased.

* Thin lens (Potmesil and Chakravarty 1981): rays of a position leave all points of the aperture,
  which lies in the plane of the eye, and meet where the chief ray meets the plane in focus. A point
  at depth z is spread over a disc f_x * D * |1/s - 1/z| pixels wide, for an aperture of diameter D
  that is focused at depth s. Where depth is measured along the ray, focus is on a sphere, and the
  aperture is seen from the front in all directions.
* Shutter: the camera moves evenly to the next frame, from the previous one, about and along
  one axis each: linear positions, spherically interpolated rotations. Exposure is centred at the
  frame's own pose, as a whole or, with a rolling shutter, that of the middle row.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from scipy.spatial.transform import Rotation

from pbrnet.pipeline.frames import EXPOSURE_TIME
from pbrnet.pipeline.lenses.model import Lens
from pbrnet.pipeline.lenses.settings import OpticsParams
from pbrnet.pipeline.pathtrace.camera_rays import entry
from pbrnet.pipeline.render.drjit_arrays import column
from pbrnet.pipeline.render.scene import RenderScene, cast
from pbrnet.pipeline.views import Matrix, View, as_matrix
from pbrnet.scenes.arrays import BoolArray, Float64Array, Int32Array
from pbrnet.scenes.geometry.directions import turned

_GRID = 24  # rays per axis that measure the distance of the focus
_SPOT = 0.1  # share of the image's width and height that a focus in the centre goes by
_SUBJECT = 0.2  # standard deviation of the weight of a subject's places, share of the image
_INFINITY = 1e4  # metres, focus where no surface is seen


class Aperture(NamedTuple):
    """Aperture of a thin lens; the area is that of a disc, whatever the number of blades."""

    radius: float  # metres
    focus: float  # metres, depth of what is in focus
    blades: int = 0  # 0: a disc


class Shutter(NamedTuple):
    """Times of an exposure, in intervals between frames."""

    exposure: float  # of each row
    readout: float = 0.0  # from the first row to the last; 0: global


@dataclass(frozen=True)
class Optics:
    """Aperture and shutter of a view; None is a pinhole, and a camera that stands still.

    `after` and `before` are the motion to the next frame and from the previous one, see `motions`.
    """

    aperture: Aperture | None = None
    shutter: Shutter | None = None
    after: Matrix = ((0.0,) * 3, (0.0,) * 3)
    before: Matrix = ((0.0,) * 3, (0.0,) * 3)

    @staticmethod
    def of(view: View, aperture: Aperture | None, shutter: Shutter | None) -> Optics:
        """Return aperture and shutter of a view, with the motion between its neighbours."""
        return Optics(aperture, shutter, *map(as_matrix, motions(view)))


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
    """Return the median depth in the middle, in all of the image or of the subject, metres."""
    share = _SPOT if params.autofocus == "centre" else 1.0
    steps = 0.5 + share * ((np.arange(_GRID) + 0.5) / _GRID - 0.5)
    columns, rows = np.meshgrid(steps * view.width, steps * view.height)
    rays = view.lens.rays(np.stack([columns.ravel(), rows.ravel()], axis=-1))
    directions = turned(rays.directions[rays.valid], view.pose[:3, :3])
    distances, objects = cast(scene, view.eye, directions)
    along = 1.0 if view.lens.depth_is_distance else rays.directions[rays.valid][:, 2]
    chosen = np.ones(len(objects), bool)
    if params.autofocus == "subject":
        places = np.stack([columns.ravel() / view.width, rows.ravel() / view.height], axis=-1)
        chosen = _subject(scene, objects, places[rays.valid] - 0.5)
    return min(float(np.median((distances * along)[chosen])), _INFINITY)


def _subject(scene: RenderScene, objects: Int32Array, places: Float64Array) -> BoolArray:
    """Rays (N,) of the piece of furniture that covers most of the image, more so in the middle.

    `objects` (N,) are what they hit, `places` (N, 2) shares of the image from its middle. All rays
    where no furniture is seen.
    """
    fixed = np.array([*(thing.is_structure for thing in scene.scene.objects), True])
    weight = np.exp(-0.5 * (places**2).sum(axis=1) / _SUBJECT**2) * ~fixed[objects]
    if not weight.any():
        return np.ones(len(objects), bool)
    return np.asarray(objects == np.bincount(np.maximum(objects, 0), weight).argmax())


def facts_of(optics: Optics, params: OpticsParams) -> dict[str, Any]:
    """Return the entries of a frame's attribute, and cells of its row: EXIF's terms and units."""
    facts: dict[str, Any] = {}
    if optics.aperture:
        facts |= {"f_number": params.f_number, "focus_distance": optics.aperture.focus}
    if optics.shutter:
        facts[EXPOSURE_TIME] = params.exposure / params.frame_rate
        facts["readout_time"] = params.readout / params.frame_rate
    return facts


class OpticsKind(NamedTuple):
    """Everything about aperture and shutter that is compiled into a kernel."""

    blades: int | None  # None: no aperture
    planar: bool  # focus in a plane, not on a sphere
    moves: bool


def optics_kind(optics: Optics | None, lens: Lens) -> OpticsKind | None:
    """Return the kind of aperture and shutter of a lens, None for a pinhole that stands still."""
    if optics is None:
        return None
    blades = optics.aperture.blades if optics.aperture else None
    return OpticsKind(blades, not lens.depth_is_distance, optics.shutter is not None)


def optics_values(optics: Optics | None) -> mi.Float:
    """Return the numbers of aperture and shutter that are not compiled into a kernel."""
    optics = optics or Optics()
    aperture, shutter = optics.aperture or Aperture(0, 1), optics.shutter or Shutter(0)
    motions = np.ravel([optics.after, optics.before])
    return column(mi.Float, np.array([aperture.radius, aperture.focus, *shutter, *motions]))


_RADIUS, _FOCUS, _EXPOSURE, _READOUT, _AFTER, _BEFORE = 0, 1, 2, 3, 4, 10


def motions(view: View) -> tuple[Float64Array, Float64Array]:
    """Return the motions of a camera to the next frame and from the previous one, (2, 3) each.

    The first row is the translation in the world, metres; the second the axis of rotation in the
    camera's axes times the angle, radians. Where one frame is missing, the camera goes on evenly;
    it stands still where both are.
    """
    found = [
        sign * _motion_to(pose, view)
        for sign, pose in ((1, view.pose_after), (-1, view.pose_before))
        if pose
    ]
    found = found or [np.zeros((2, 3))]
    return found[0], found[-1]


def _motion_to(pose: Matrix, view: View) -> Float64Array:
    """Return the motion of a camera to another pose, (2, 3)."""
    other = np.array(pose, dtype=np.float64)
    turn = Rotation.from_matrix(view.pose[:3, :3].T @ other[:3, :3])
    return np.array([other[:3, 3] - view.eye, turn.as_rotvec()])


def expose(
    sampler: mi.Sampler,
    kind: OpticsKind,
    values: mi.Float,
    row: mi.Float,
    origin: mi.Vector3f,
    direction: mi.Vector3f,
) -> tuple[mi.Vector3f, mi.Vector3f, mi.Vector3f]:
    """Return rays at points of the aperture and at times of the exposure.

    `origin` and `direction`, of length 1, are those of chief rays in the camera's axes; `row` is
    the time of their row in a readout, from -1/2 to 1/2. Returns origins and directions in the
    axes of the frame's own pose, and the translation in the world.
    """
    if kind.blades is not None:
        point = _aperture_point(sampler.next_2d(), kind.blades) * entry(values, _RADIUS)
        along, across = entry(values, _FOCUS), mi.Vector3f(point.x, point.y, 0)
        if kind.planar:
            along = along / direction.z
        else:
            across = mi.Frame3f(direction).to_world(across)
        origin, direction = origin + across, direction * along - across
    if not kind.moves:
        return origin, direction, mi.Vector3f(0)
    time = (sampler.next_1d() - 0.5) * entry(values, _EXPOSURE) + row * entry(values, _READOUT)
    shift, turn = (
        dr.select(time > 0, _vector(values, _AFTER + part), _vector(values, _BEFORE + part)) * time
        for part in (0, 3)
    )
    return _rotated(origin, turn), _rotated(direction, turn), shift


def _aperture_point(sample: mi.Point2f, blades: int) -> mi.Point2f:
    """Return points evenly in a disc of radius 1, or a regular polygon of its area, tip up."""
    if not blades:
        return mi.warp.square_to_uniform_disk_concentric(sample)
    side = 2 * math.pi / blades
    circumradius = math.sqrt(math.pi / (0.5 * blades * math.sin(side)))
    along = sample.x * blades
    blade = dr.minimum(dr.floor(along), blades - 1)
    inside = dr.sqrt(along - blade)  # evenly in a triangle from the centre to an edge
    first, second = blade * side, (blade + 1) * side
    weight = inside * sample.y
    return circumradius * mi.Point2f(
        (inside - weight) * dr.sin(first) + weight * dr.sin(second),
        -(inside - weight) * dr.cos(first) - weight * dr.cos(second),
    )


def _rotated(vector: mi.Vector3f, turn: mi.Vector3f) -> mi.Vector3f:
    """Rotate vectors about axes by angles, the length of `turn` (Rodrigues' formula)."""
    angle = dr.norm(turn)
    axis = turn * dr.select(angle > 0, dr.rcp(angle), 0)
    sine, cosine = dr.sincos(angle)
    along = axis * dr.dot(axis, vector) * (1 - cosine)
    return vector * cosine + dr.cross(axis, vector) * sine + along


def _vector(values: mi.Float, place: int) -> mi.Vector3f:
    return mi.Vector3f(*(entry(values, place + axis) for axis in range(3)))
