"""Ray casting in a loaded scene: NumPy arrays in, NumPy arrays out, in every Mitsuba variant.

Rays pass clear glass (smooth dielectrics, thin panes, null surfaces) undeviated, and masks where
their opacity is below one half, up to `MAX_LAYERS` of them. Wavefront variants trace all rays in
one kernel (`wavefront`); `scalar_rgb` loops over the rays (`scalar`) with equal
results.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from functools import partial
from types import ModuleType
from typing import Any

import mitsuba as mi
import numpy as np
import numpy.typing as npt

from pbrnet.pipeline.render.raycast import scalar, wavefront
from pbrnet.pipeline.render.scene_geometry import Hits, SceneGeometry, TextureSlot
from pbrnet.scenes.arrays import AnyArray, BoolArray, Float32Array, Float64Array, Int32Array
from pbrnet.scenes.geometry.directions import unit

CHUNK = 1 << 21  # rays in flight; bounds memory


def nearest(
    geometry: SceneGeometry, origins: npt.ArrayLike, directions: npt.ArrayLike, through: bool = True
) -> tuple[Int32Array, Float32Array]:
    """Return the index of the first shape along each ray (-1: none) and the distance in metres.

    The distance is infinite where nothing is hit. `origins` is (N, 3) or (3,), `directions`
    (N, 3) of length 1. With `through=False` clear surfaces and masks stop a ray like any other.
    """
    trace = partial(_backend().nearest, geometry, through)
    shape, distance = _in_chunks(trace, origins, directions)
    return shape, distance


def surfaces(
    geometry: SceneGeometry, origins: npt.ArrayLike, directions: npt.ArrayLike, colors: bool = True
) -> Hits:
    """Return the first surface along each ray, with normals and reflectance.

    Arguments as in `nearest`. Without `colors` the reflectance is 0, and no material needs to be
    compiled.
    """
    trace = partial(_backend().surfaces, geometry, colors, None)
    return Hits(*_in_chunks(trace, origins, directions))


def oriented(geometry: SceneGeometry, origins: npt.ArrayLike, directions: npt.ArrayLike) -> Hits:
    """Return the first surface along each ray with its geometric normal alone, at less cost.

    Arguments as in `nearest`. The shading normal is the geometric one, the reflectance is 0.
    """
    trace = partial(_backend().oriented, geometry)
    return Hits(*_in_chunks(trace, origins, directions))


def textured_surfaces(
    geometry: SceneGeometry,
    slots: tuple[TextureSlot, ...],
    origins: npt.ArrayLike,
    directions: npt.ArrayLike,
) -> tuple[Hits, list[AnyArray]]:
    """Return what `surfaces` does, and the values of each slot, then s, dp_du and dp_dv, (N, 3).

    A slot with one band gives (N,), others (N, bands); 0 where a shape has no such texture. `s` is
    the first tangent of the shading frame, `dp_du` and `dp_dv` are the derivatives of the position;
    0 where nothing is hit.
    """
    trace = partial(_backend().surfaces, geometry, True, slots)
    found = _in_chunks(trace, origins, directions)
    count = len(fields(Hits))
    return Hits(*found[:count]), found[count:]


def objects_along(
    geometry: SceneGeometry, numbers: Int32Array, origins: npt.ArrayLike, directions: npt.ArrayLike
) -> npt.NDArray[np.uint32]:
    """Return which objects each ray meets on its whole way, as if each object were alone.

    `numbers[i]` is the object, 0 to M - 1, of shape i, or -1; other arguments as in `nearest`. The
    result is packed, uint32 (N, ceil(M / 32)): object m is bit m % 32 of column m // 32. A ray
    goes on behind every surface, up to `MAX_SURFACES` of them; clear surfaces and what a mask
    leaves out are not met.
    """
    words = int(numbers.max(initial=-1)) // 32 + 1
    trace = partial(_backend().objects_along, geometry, numbers, words)
    return _in_chunks(trace, origins, directions)[0]


def unoccluded(
    geometry: SceneGeometry,
    origin: npt.ArrayLike,
    directions: npt.ArrayLike,
    distances: npt.ArrayLike,
) -> BoolArray:
    """Test whether only clear surfaces lie within `distances` (N,) metres of `origin`.

    `origin` is (3,) or (N, 3).
    """
    _, free = nearest(geometry, origin, directions)
    limit = np.asarray(distances, dtype=np.float64)
    # Float32 hit points on either side of a surface differ by about 1e-6 of the coordinates;
    # this tolerance is far above that and far below the thickness of a lampshade.
    result: BoolArray = free >= limit - np.maximum(2e-4 * limit, 2e-4)
    return result


def object_ids(
    geometry: SceneGeometry, poses: npt.ArrayLike, rays: npt.ArrayLike
) -> npt.NDArray[np.uint32]:
    """Return object index + 1 along every ray, 0 for none: uint32 (N, H, W).

    `poses` (N, 4, 4) are camera_to_world, OpenCV; all cameras share `rays` (H, W, 3) in their axes.
    Rays pass clear glass.
    """
    poses = np.asarray(poses, dtype=np.float64).reshape(-1, 4, 4)
    rays = np.asarray(rays, dtype=np.float64)
    local = unit(rays.reshape(-1, 3))
    shapes = np.zeros(0, dtype=np.int32)
    if len(poses):
        step = max(1, CHUNK // len(local))
        starts = range(0, len(poses), step)
        trace = _backend().nearest_from_cameras
        shapes = np.concatenate([trace(geometry, poses[i : i + step], local) for i in starts])
    numbers = np.append(geometry.objects, -1).astype(np.int64) + 1  # shape -1 reads the last entry
    return numbers[shapes].astype(np.uint32).reshape(len(poses), *rays.shape[:2])


def emitted_radiance(
    geometry: SceneGeometry, origin: npt.ArrayLike, directions: AnyArray, emitting: AnyArray
) -> tuple[Int32Array, Float32Array, Float64Array]:
    """Return the first shape along each ray, its distance and its emitted radiance (N, 3).

    The radiance is evaluated for the shapes that `emitting` (bool by shape index) marks; it is 0
    for all others.
    """
    trace = partial(_backend().emitted_radiance, geometry, emitting)
    shape, distance, light = _in_chunks(trace, origin, directions)
    return shape, distance, _linear_rgb(light)


def environment_radiance(emitter: Any, directions: AnyArray) -> Float64Array:
    """Return linear RGB (N, 3) of an environment emitter seen along `directions` (N, 3)."""
    return _linear_rgb(_backend().environment_radiance(emitter, directions))


def sample_emitters(
    emitters: tuple[Any, ...], indices: AnyArray, origin: npt.ArrayLike, samples: AnyArray
) -> tuple[Float64Array, Float32Array, Float64Array, Float64Array]:
    """Sample points on emitters as seen from `origin`, (3,) or (N, 3), without a visibility test.

    Sample i lies on `emitters[indices[i]]`, at the point chosen by `samples[i]` in [0, 1)^2.
    Returns direction (N, 3), distance (N,) in metres, radiance over density (N, 3), and density
    per steradian (N,). The mean of radiance over density over an emitter's samples is its
    irradiance on a surface that faces it. The density is 0 for emitters without extent and for
    points that face away.
    """
    direction, distance, weight, density = _backend().sample_emitters(
        emitters, indices, np.asarray(origin, dtype=np.float64), samples
    )
    return direction, distance, _linear_rgb(weight), density


def _backend() -> ModuleType:
    return scalar if str(mi.variant()).startswith("scalar") else wavefront


def _linear_rgb(spectra: AnyArray) -> Float64Array:
    """Convert the renderer's spectra to linear RGB, float64, clamped to 0 from below."""
    return np.maximum(spectra.astype(np.float64), 0)


def _in_chunks(
    trace: Callable[[AnyArray, AnyArray], tuple[AnyArray, ...]],
    origins: npt.ArrayLike,
    directions: npt.ArrayLike,
) -> list[AnyArray]:
    """Apply `trace` to `CHUNK` rays at a time and join its arrays."""
    d = np.asarray(directions, dtype=np.float64).reshape(-1, 3)
    o = np.broadcast_to(np.asarray(origins, dtype=np.float64), d.shape)
    if not len(d):  # kernels cannot be of size 0
        return [column[:0] for column in trace(np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]))]
    starts = range(0, len(d), CHUNK)
    parts = [trace(o[start : start + CHUNK], d[start : start + CHUNK]) for start in starts]
    return [np.concatenate(column) for column in zip(*parts, strict=True)]
