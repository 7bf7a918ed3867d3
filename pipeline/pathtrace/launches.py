"""Sensors and frozen launches of the joint path tracer: recorded once per scene, then replayed.

Before the first sample, Python and Dr.Jit need half a second of one core to trace the path tracer
of a furnished scene through every material. In a small view that is more than its samples need.
`dr.freeze` records the launches and replays them with new inputs. It does not detect that a virtual
call meets another instance than at recording, so no instance is created between views: the sensor
is moved instead.

Mitsuba has no equirectangular sensor, so the rays of panoramas are made here and given to the joint
path tracer, or in scalar variants to Mitsuba's `path`. A pixel is the mean radiance over its solid
angle: directions are stratified (multi-jittered) and uniform over it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from pbrnet.pipeline.pathtrace.integrator import JointPath
from pbrnet.pipeline.render.drjit_arrays import column
from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.errors import InputError

_MAX_RECORDINGS = 32  # per kernel and size: sample counts and kinds of light plans
_FAR = 1e5  # metres
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


class FrozenTracer:
    """Sensors and recorded launches of one open scene, kept between its views.

    There is one sensor and one frozen function per film size and intrinsics: a recording holds the
    film that it was made with.
    """

    def __init__(self) -> None:
        self.recordings = Recordings()
        self._sensors: dict[Hashable, mi.Sensor] = {}

    def launch(
        self,
        scene: mi.Scene,
        version: int,
        view: View,
        copies: int,
        path: JointPath,
        spp: int,
        seed: int,
    ) -> mi.TensorXf:
        """Render `copies` independent images of a view, side by side, by `path.integrator()`.

        `version` is that of the scene's `MaterialSets`.
        """
        self.recordings.renew(version)
        names = path.integrator().aov_names()
        key = (view.width, view.height, copies, view.intrinsics.tobytes(), *names)
        if key not in self._sensors:
            sensor = make_sensor(view, copies)
            # In the state after a launch: otherwise the second launch would be recorded again.
            sensor.film().prepare(names)
            dr.eval(sensor.film().develop())
            self._sensors[key] = sensor
            if len(self._sensors) > _MAX_RECORDINGS:
                oldest = next(iter(self._sensors))
                del self._sensors[oldest]
                self.recordings.discard(_launch, oldest)
        sensor = self._sensors[key]
        move_sensor(sensor, view)
        # Without emitters of its own, calls to those of other open scenes could not be recorded.
        launch = self.recordings.of(_launch, key) if scene.emitters() else _launch
        return launch(scene, sensor, path, spp, dr.opaque(mi.UInt32, seed))


def _launch(
    scene: mi.Scene, sensor: mi.Sensor, path: JointPath, spp: int, seed: mi.UInt32
) -> mi.TensorXf:
    integrator = path.integrator()
    return mi.render(scene, sensor=sensor, integrator=integrator, spp=spp, seed=seed)


class SphereTracer:
    """Sampler and recorded launches of one open scene, kept between its views."""

    def __init__(self) -> None:
        self._recordings = Recordings()
        self._sampler: mi.Sampler = mi.load_dict({"type": "multijitter"})

    def launch(
        self,
        scene: mi.Scene,
        version: int,
        view: View,
        width: int,
        copies: int,
        path: JointPath,
        spp: int,
        seed: int,
        images: int = 1,
    ) -> Float64Array:
        """Return radiance, (width / 2, copies, width, 3 images), of independent panoramas.

        `images` is the number of images of `path` that are wanted, linear RGB each. They are in the
        axes of `view`'s camera: the centre column is straight ahead, right of it is the camera's
        right, the top row is its up. `spp` is a power of two. `version` is that of the scene's
        `MaterialSets`.
        """
        self._recordings.renew(version)
        size = (width, copies, spp)
        # Without emitters of its own, calls to those of other open scenes could not be recorded.
        key = (*size, images, *path.parts.names)
        trace = self._recordings.of(_sphere_launch, key) if scene.emitters() else _sphere_launch
        eye, axes = (column(mi.Float, part.ravel()) for part in (view.eye, view.pose[:3, :3]))
        seeds = dr.opaque(mi.UInt32, seed)
        found = trace(scene, self._sampler, path, eye, axes, *size, images, seeds)
        bands = []
        for image in found:
            samples = np.array(image).reshape(3, copies, width // 2, width, spp)
            bands.append(samples.mean(axis=-1, dtype=np.float64))
        return np.ascontiguousarray(np.concatenate(bands).transpose(2, 1, 3, 0))


def trace_scalar(
    scene: mi.Scene,
    integrator: mi.Integrator,
    view: View,
    width: int,
    copies: int,
    spp: int,
    seed: int,
) -> Float64Array:
    """Return what `SphereTracer.launch` does, in a scalar variant and by Mitsuba's `path`."""
    sampler = mi.load_dict({"type": "multijitter", "sample_count": spp})
    height, pitch = width // 2, 2 * math.pi / width
    rotation, eye = view.pose[:3, :3], mi.ScalarPoint3f(view.eye.tolist())
    pixels = np.zeros((height, copies, width, 3))
    for number, (row, copy, across) in enumerate(np.ndindex(height, copies, width)):
        sampler.seed((seed + number) % 2**32, 1)
        top, bottom = math.cos(row * pitch), math.cos((row + 1) * pitch)
        for _ in range(spp):
            x, y = sampler.next_2d()
            sine, azimuth = top + (bottom - top) * y, (across + x) * pitch - math.pi
            flat = math.sqrt(max(1 - sine * sine, 0))
            local = [flat * math.sin(azimuth), -sine, flat * math.cos(azimuth)]
            direction = mi.ScalarVector3f((rotation @ local).tolist())
            ray = mi.RayDifferential3f(mi.Ray3f(eye, direction))
            pixels[row, copy, across] += integrator.sample(scene, sampler, ray)[0]
            sampler.advance()
    return pixels / spp


def _sphere_launch(
    scene: mi.Scene,
    sampler: mi.Sampler,
    path: JointPath,
    eye: mi.Float,
    axes: mi.Float,
    width: int,
    copies: int,
    spp: int,
    images: int,
    seed: mi.UInt32,
) -> list[mi.Color3f]:
    """Return the radiance of each sample in the first images of `path`, `mi.Color3f` each.

    Samples are in the order copy, row, column, sample.
    """
    height, pitch = width // 2, 2 * math.pi / width
    count = copies * height * width * spp
    sampler = sampler.clone()
    sampler.set_sample_count(spp)
    sampler.set_samples_per_wavefront(spp)
    sampler.seed(seed, count)
    pixel = dr.arange(mi.UInt32, count) >> (spp.bit_length() - 1)
    across = mi.Float(pixel % width)
    row = mi.Float((pixel // width) % height)
    offset = sampler.next_2d()
    top, bottom = dr.cos(row * pitch), dr.cos((row + 1) * pitch)
    sine = dr.lerp(top, bottom, offset.y)
    azimuth = (across + offset.x) * pitch - math.pi
    flat = dr.safe_sqrt(1 - dr.square(sine))
    local = mi.Vector3f(flat * dr.sin(azimuth), -sine, flat * dr.cos(azimuth))
    x, y, z = (
        sum((_entry(axes, 3 * line + i) * local[i] for i in range(3)), mi.Float(0))
        for line in range(3)
    )
    direction = dr.normalize(mi.Vector3f(x, y, z))
    origin = mi.Point3f(*(_entry(eye, i) for i in range(3)))
    ray = mi.Ray3f(origin, direction, _FAR, 0.0, mi.Color0f())
    return path.trace(scene, sampler, ray, mi.Bool(True))[:images]


def _entry(values: mi.Float, index: int) -> mi.Float:
    return dr.gather(mi.Float, values, mi.UInt32(index))


def make_sensor(view: View, copies: int = 1) -> Any:
    """Return a Mitsuba sensor for a view; `copies` > 1 gives that many images side by side.

    Samples are stratified within a pixel and independent between pixels, so each copy is an
    independent estimate. Raises `InputError` for a view whose pixels are not square.
    """
    intrinsics = view.intrinsics
    focal = intrinsics[0, 0]
    if abs(intrinsics[1, 1] - focal) > 1e-6 * focal or abs(intrinsics[0, 1]) > 1e-9:
        raise InputError(
            f"view {view.view_id} of {view.scene_id}: K has pixels that are not square "
            f"(fx {focal:g}, fy {intrinsics[1, 1]:g}, skew {intrinsics[0, 1]:g}), "
            "which the path tracer's camera does not support"
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


def move_sensor(sensor: Any, view: View) -> None:
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
