"""Sensors and frozen launches of the joint path tracer: recorded once per scene, then replayed.

Before the first sample, Python and Dr.Jit need half a second of one core to trace the path tracer
of a furnished scene through every material. In a small view that is more than its samples need.
`dr.freeze` records the launches and replays them with new inputs. It does not detect that a virtual
call meets another instance than at recording, so no instance is created between views: the sensor
is moved instead.

Mitsuba has no sensor for lenses other than pinholes, nor for cameras that move, so their rays are
made by `camera_rays` and `optics` and given to the joint path tracer, or in scalar variants to
Mitsuba's `path`. A pixel is the mean radiance over its area on the image, in panoramas over its
solid angle: places in it are stratified and uniform.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable
from typing import Any, NamedTuple, TypeAlias

import drjit as dr
import mitsuba as mi
import numpy as np

from pbrnet.pipeline.lenses.model import Lens
from pbrnet.pipeline.pathtrace.camera_rays import (
    LensArrays,
    LensKind,
    camera_rays,
    entry,
    kind_of,
    lens_arrays,
)
from pbrnet.pipeline.pathtrace.integrator import JointPath, Sampler
from pbrnet.pipeline.pathtrace.optics import Optics, OpticsKind, expose, optics_kind, optics_values
from pbrnet.pipeline.pathtrace.samples import PathSampler
from pbrnet.pipeline.render.drjit_arrays import column
from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.errors import InputError

_MAX_RECORDINGS = 32  # per kernel and size: sample counts and kinds of light plans
_FAR = 1e5  # metres
_LANES = 1 << 12  # fewest paths that are traced side by side
_PER_LANE = 16  # samples that each traces, one after the other
RayArrays: TypeAlias = "tuple[mi.Float, ...]"  # of `ray_arrays`
_NEAR_CLIP, _FAR_CLIP = 1e-3, 1e5  # metres


class Recordings:
    """Recorded launches of the kernels of one open scene, by kernel and a key such as its size."""

    def __init__(self) -> None:
        self._launches: dict[tuple[Hashable, ...], Any] = {}
        self._version: int | None = None

    def __len__(self) -> int:
        return sum(int(launch.n_recordings) for launch in self._launches.values())

    def of(self, kernel: Callable[..., Any], key: Hashable) -> Any:
        """Return the recorded form of a kernel."""
        if (kernel, key) not in self._launches:
            self._launches[kernel, key] = dr.freeze(
                kernel, limit=_MAX_RECORDINGS, warn_after=_MAX_RECORDINGS
            )
        return self._launches[kernel, key]

    def discard(self, kernel: Callable[..., Any], key: Hashable) -> None:
        """Forget the recordings of a kernel."""
        self._launches.pop((kernel, key), None)

    def renew(self, version: int) -> None:
        """Forget all unless `version`, that of the scene's `MaterialSets`, is the one before.

        With another one some materials are other instances.
        """
        if version != self._version:
            self._launches.clear()
        self._version = version


class PathTracer:
    """Recorded launches of the joint path tracer in one open scene, kept between its views."""

    def __init__(self) -> None:
        self.recordings = Recordings()

    def launch(
        self,
        scene: mi.Scene,
        version: int,
        camera: tuple[Float64Array, Lens, Optics | None],
        copies: int,
        path: JointPath,
        spp: int,
        seed: int,
    ) -> Float64Array:
        """Return radiance, (H, copies, W, 3 images), of independent images of one view.

        `camera` is `camera_to_world`, projection, and aperture and shutter. Images are those of
        `path`, linear RGB each. Pixels without a ray are 0. `spp` is a power of two. `version` is
        that of the scene's `MaterialSets`.
        """
        self.recordings.renew(version)
        lens, kind = camera[1], ray_kind(*camera[1:], copies, spp)
        # Without emitters of its own, calls to those of other open scenes could not be recorded.
        key = (kind, *path.image_names, *path.parts.names)
        trace = self.recordings.of(_launch, key) if scene.emitters() else _launch
        found = trace(scene, path, ray_arrays(*camera), kind, dr.opaque(mi.UInt32, seed))
        bands = []
        for image in found:
            samples = np.array(image).reshape(3, copies, lens.height, lens.width, spp)
            bands.append(samples.mean(axis=-1, dtype=np.float64))
        return np.ascontiguousarray(np.concatenate(bands).transpose(2, 1, 3, 0))


def trace_scalar(
    scene: mi.Scene,
    integrator: mi.Integrator,
    pose: Float64Array,
    lens: Lens,
    copies: int,
    spp: int,
    seed: int,
) -> Float64Array:
    """Return what `PathTracer.launch` does, in a scalar variant and by Mitsuba's `path`."""
    sampler = mi.load_dict({"type": "multijitter", "sample_count": spp})
    height, width = lens.height, lens.width
    valid = lens.rays().valid
    pixels = np.zeros((height, copies, width, 3))
    for number, (row, copy, across) in enumerate(np.ndindex(height, copies, width)):
        sampler.seed((seed + number) % 2**32, 1)
        for _ in range(spp if valid[row, across] else 0):
            origin, local = _scalar_ray(lens, row, across, *sampler.next_2d())
            start = mi.ScalarPoint3f((pose[:3, 3] + pose[:3, :3] @ origin).tolist())
            direction = mi.ScalarVector3f((pose[:3, :3] @ local).tolist())
            ray = mi.RayDifferential3f(mi.Ray3f(start, direction))
            pixels[row, copy, across] += integrator.sample(scene, sampler, ray)[0]
            sampler.advance()
    return pixels / spp


def _scalar_ray(
    lens: Lens, row: int, across: int, x: float, y: float
) -> tuple[Float64Array, Float64Array]:
    """Return origin and direction (3,) of the place `x`, `y` in a pixel, in the camera's axes."""
    if not lens.is_panorama:
        rays = lens.rays(np.array([across + x, row + y]))
        return rays.origins, rays.directions
    pitch = 2 * math.pi / lens.width
    top, bottom = math.cos(row * pitch), math.cos((row + 1) * pitch)
    sine, azimuth = top + (bottom - top) * y, (across + x) * pitch - math.pi
    flat = math.sqrt(max(1 - sine * sine, 0))
    return np.zeros(3), np.array([flat * math.sin(azimuth), -sine, flat * math.cos(azimuth)])


def _launch(
    scene: mi.Scene, path: JointPath, arrays: RayArrays, kind: RayKind, seed: mi.UInt32
) -> list[mi.Color3f]:
    """Return the radiance of each sample in the images of `path`, `mi.Color3f` each."""
    sampler = PathSampler.of(dr.arange(mi.UInt32, kind.rays), kind.spp, seed)
    ray, active = sample_rays(sampler, arrays, kind)
    starts = path.starts(scene, sampler, ray, active, kind.rays)
    lanes = min(kind.rays, max(_LANES, kind.rays // _PER_LANE))
    along = PathSampler.of(dr.arange(mi.UInt32, lanes), kind.spp, ~seed)
    return path.trace(scene, along, starts, lanes)


class RayKind(NamedTuple):
    """Everything about the rays of a view that is compiled into a kernel."""

    lens: LensKind
    optics: OpticsKind | None
    copies: int  # independent images
    spp: int  # a power of two

    @property
    def rays(self) -> int:
        """Number of rays."""
        return self.copies * self.lens.height * self.lens.width * self.spp


def ray_kind(lens: Lens, optics: Optics | None, copies: int, spp: int) -> RayKind:
    """Return the kind of the rays of a view."""
    return RayKind(kind_of(lens), optics_kind(optics, lens), copies, spp)


def ray_arrays(pose: Float64Array, lens: Lens, optics: Optics | None) -> RayArrays:
    """Return everything about the rays of a view that is not compiled into a kernel.

    Its position and axes, the arrays of its projection, and those of its aperture and shutter.
    """
    eye, axes = (column(mi.Float, part.ravel()) for part in (pose[:3, 3], pose[:3, :3]))
    return (eye, axes, *lens_arrays(lens), optics_values(optics))


def sample_rays(sampler: Sampler, arrays: RayArrays, kind: RayKind) -> tuple[mi.Ray3f, mi.Bool]:
    """Return the ray of each sample, world, and whether there is one.

    Samples are in the order copy, row, column, sample.
    """
    eye, axes, numbers, ideal, valid, values = arrays
    pixel = dr.arange(mi.UInt32, kind.rays) >> (kind.spp.bit_length() - 1)
    places = LensArrays(numbers, ideal, valid)
    start, local, active = camera_rays(kind.lens, places, pixel, sampler.next_2d())
    origin = mi.Point3f(*(entry(eye, i) for i in range(3)))
    if kind.optics:
        row = mi.Float((pixel // kind.lens.width) % kind.lens.height)
        time = (row + 0.5) / kind.lens.height - 0.5  # of the row in a readout
        start, local, shift = expose(sampler, kind.optics, values, time, start, local)
        origin += shift
    if kind.optics or kind.lens.projection == "orthographic":
        origin += _turned(axes, start)
    direction = dr.normalize(_turned(axes, local))
    return mi.Ray3f(origin, direction, _FAR, 0.0, mi.Color0f()), active


def _turned(axes: mi.Float, local: mi.Vector3f) -> mi.Vector3f:
    """Turn vectors from the camera's axes, (9,) by rows, into the world."""
    return mi.Vector3f(
        *(
            sum((entry(axes, 3 * line + i) * local[i] for i in range(3)), mi.Float(0))
            for line in range(3)
        )
    )


def make_sensor(view: View, copies: int = 1) -> mi.Sensor:
    """Return a Mitsuba sensor for a view; `copies` > 1 gives that many images side by side.

    Samples are stratified within a pixel and independent between pixels, so each copy is an
    independent estimate. Raises `InputError` for a view that is no pinhole with square pixels.
    """
    intrinsics = view.intrinsics
    focal = intrinsics[0, 0]
    if not view.lens.is_pinhole:
        raise InputError(
            f"view {view.view_id} of {view.scene_id}: this needs square pixels "
            f"(fx {focal:g}, fy {intrinsics[1, 1]:g}, skew {intrinsics[0, 1]:g})"
        )
    film = {
        "type": "hdrfilm",
        "height": view.height,
        "rfilter": {"type": "box"},  # bit-exact for any number of threads
        "pixel_format": "rgb",
        "component_format": "float32",
    }
    camera = {
        "type": "perspective",
        "to_world": mi.ScalarTransform4f(_to_world(view)),
        "fov": float(np.degrees(2 * np.arctan(0.5 * view.width / focal))),
        "fov_axis": "x",
        "principal_point_offset_x": float(0.5 - intrinsics[0, 2] / view.width),
        "principal_point_offset_y": float(0.5 - intrinsics[1, 2] / view.height),
        "near_clip": _NEAR_CLIP,
        "far_clip": _FAR_CLIP,
        "film": {**film, "width": view.width},
    }
    sampler = {"type": "multijitter"}
    if copies == 1:
        return mi.load_dict({**camera, "sampler": sampler})
    cameras = {f"copy{index}": camera for index in range(copies)}
    wide = {**film, "width": copies * view.width}
    return mi.load_dict({"type": "batch", **cameras, "film": wide, "sampler": sampler})


def move_sensor(sensor: mi.Sensor, view: View) -> None:
    """Move a sensor of `make_sensor` to the pose of `view`; its size and intrinsics stay.

    Not for the scalar variant, whose sensors hold plain numbers.
    """
    params = mi.traverse(sensor)
    keys = [key for key, _ in params.items() if key.split(".")[-1] == "to_world"]
    for key in keys:
        to_world = mi.AffineTransform4f(_to_world(view))
        dr.make_opaque(to_world)
        params[key] = to_world
    params.update()


def _to_world(view: View) -> Float64Array:
    """Return the pose in the axes of Mitsuba's cameras: x left, y up, z forward."""
    return np.asarray(view.pose @ np.diag([-1.0, -1.0, 1.0, 1.0]))
