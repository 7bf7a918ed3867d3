"""Rays against a loaded scene: arrays in, arrays out, in wavefront and scalar variants alike.

Sight passes clear glass (smooth dielectrics, thin panes, null surfaces) undeviated and masks
where their opacity is below one half, up to `LAYERS` of them. A wavefront variant traces all
rays in one kernel; `scalar_rgb` has no arrays and loops over the rays, with equal results.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import numpy.typing as npt

from scenes.arrays import AnyArray, BoolArray, Float32Array, Float64Array, Int32Array
from scenes.geometry.directions import pixel_directions, unit

LAYERS = 16  # clear surfaces that one ray may pass: a glass cabinet before a glass door and so on
CHUNK = 1 << 21  # rays in flight, which bounds memory


@dataclass(frozen=True)
class Target:
    """What rays are traced against.

    `objects[i]` is the object index of shape i (-1: belongs to none), `clear[i]` says that
    sight passes shape i, `masked[i]` that its BSDF has an alpha mask.
    """

    scene: Any  # mi.Scene
    shapes: tuple[Any, ...]
    objects: Int32Array
    clear: BoolArray
    masked: BoolArray
    reflectances: tuple[Any, ...]  # reflectance twin of each shape's BSDF


@dataclass(frozen=True)
class Hits:
    """First surface each of N rays sees; where `shape` is -1 there is none and the rest is 0.

    `distance` is metres along the ray (infinite for none), `position` (N, 3) world metres,
    `geometric` and `shading` are unit normals (N, 3) as modelled, not flipped,
    `reflectance` (N, 3) is linear RGB in [0, 1].
    """

    shape: Int32Array
    distance: Float32Array
    position: Float32Array
    geometric: Float32Array
    shading: Float32Array
    reflectance: Float32Array


def is_scalar() -> bool:
    """Whether the current variant has no wavefront arrays."""
    return str(mi.variant()).startswith("scalar")


def nearest(
    target: Target, origins: npt.ArrayLike, directions: npt.ArrayLike, through: bool = True
) -> tuple[Int32Array, Float32Array]:
    """Index of the first shape each ray sees (-1: none) and the distance to it (infinite: none).

    `origins` (N, 3) or (3,), `directions` (N, 3) of length 1. With `through=False` clear
    surfaces and masks stop a ray like any other.
    """
    trace = _scalar_nearest if is_scalar() else _wave_nearest
    shape, distance = _in_chunks(partial(trace, target, through), origins, directions)
    return shape, distance


def surfaces(
    target: Target, origins: npt.ArrayLike, directions: npt.ArrayLike, colors: bool = True
) -> Hits:
    """What each ray sees, with normals and reflectance; arguments as in `nearest`.

    Without `colors` reflectance is 0, and no material needs to be compiled.
    """
    trace = _scalar_surfaces if is_scalar() else _wave_surfaces
    return Hits(*_in_chunks(partial(trace, target, colors), origins, directions))


def reached(
    target: Target, origin: npt.ArrayLike, directions: npt.ArrayLike, distances: npt.ArrayLike
) -> BoolArray:
    """Whether nothing but clear surfaces lies within `distances` (N,) of `origin` (3,)."""
    _, free = nearest(target, origin, directions)
    limit = np.asarray(distances, dtype=np.float64)
    # Float32 hit points on either side of a surface differ by about 1e-6 of the coordinates;
    # this tolerance is far above that and far below the thickness of a lampshade.
    reach: BoolArray = free >= limit - np.maximum(2e-4 * limit, 2e-4)
    return reach


def ids(
    target: Target, poses: npt.ArrayLike, intrinsics: npt.ArrayLike, width: int, height: int
) -> npt.NDArray[np.uint32]:
    """Object index + 1 at every pixel centre, 0 for none: uint32 (N, height, width).

    `poses` (N, 4, 4) are camera_to_world, OpenCV; all cameras share `intrinsics` (3, 3).
    """
    poses = np.asarray(poses, dtype=np.float64).reshape(-1, 4, 4)
    local = unit(pixel_directions(intrinsics, width, height).reshape(-1, 3))
    found = []
    per_chunk = max(1, CHUNK // len(local))
    for start in range(0, len(poses), per_chunk):
        some = poses[start : start + per_chunk]
        if is_scalar():
            found += [nearest(target, pose[:3, 3], local @ pose[:3, :3].T)[0] for pose in some]
        else:
            ray = _wave_camera_rays(some, local)
            found += _arrays(_wave_first(target, ray, True)[0])
    shapes = np.concatenate(found) if found else np.zeros(0, dtype=np.int32)
    numbers = np.append(target.objects, -1).astype(np.int64) + 1  # shape -1 reads the last entry
    return numbers[shapes].astype(np.uint32).reshape(len(poses), height, width)


def emitted(
    target: Target, origin: npt.ArrayLike, directions: AnyArray, glowing: AnyArray
) -> tuple[Int32Array, Float32Array, Float64Array]:
    """First shape each ray sees, the distance to it and the light (N, 3) it emits to `origin`.

    Only shapes marked in `glowing`, bool by shape index, are asked for light; others give 0.
    """
    trace = _scalar_emitted if is_scalar() else _wave_emitted
    shape, distance, light = _in_chunks(partial(trace, target, glowing), origin, directions)
    return shape, distance, _light(light)


def sky(emitter: Any, directions: AnyArray) -> Float64Array:
    """Linear RGB of an environment emitter seen along `directions` (N, 3), float64 (N, 3)."""
    if is_scalar():
        light = np.zeros((len(directions), 3))
        si = mi.SurfaceInteraction3f()
        for i, direction in enumerate(directions):
            si.wi = mi.ScalarVector3f(-direction)
            light[i] = emitter.eval(si)
        return _light(light)
    si = dr.zeros(mi.SurfaceInteraction3f, len(directions))
    si.wi = vector(mi.Vector3f, -directions)
    (light,) = _arrays(mi.Color3f(emitter.eval(si)))
    return _light(light)


def towards_lights(
    emitters: tuple[Any, ...],
    which: AnyArray,
    eye: npt.ArrayLike,
    samples: AnyArray,
) -> tuple[Float64Array, Float32Array, Float64Array, Float64Array]:
    """Points on lights as seen from `eye` (3,), ignoring what is in between.

    Sample i lies on `emitters[which[i]]`, chosen there by `samples[i]` in [0, 1)^2. Returns
    direction (N, 3), distance (N,), light per probability (N, 3), whose mean over a light's
    samples is its irradiance on a surface that faces it, and probability density per
    steradian (N,), 0 for lights without size and for points that face away.
    """
    if is_scalar():
        return _scalar_towards_lights(emitters, which, eye, samples)
    count = len(which)
    table = mi.UInt32([registry_id(emitter, mi.EmitterPtr) for emitter in emitters])
    number = dr.gather(mi.UInt32, table, column(mi.UInt32, which))
    pointer = dr.reinterpret_array(mi.EmitterPtr, number)
    si = dr.zeros(mi.SurfaceInteraction3f, count)
    # Opaque, or the position would be compiled into the kernel, one kernel per view.
    si.p = mi.Point3f(*(dr.opaque(mi.Float, float(value)) for value in np.asarray(eye)))
    ds, weight = pointer.sample_direction(si, vector(mi.Point2f, samples))
    direction, distance, light, density = _arrays(
        ds.d, ds.dist, mi.Color3f(weight), dr.select(ds.delta, 0, ds.pdf)
    )
    return direction.astype(np.float64), distance, _light(light), density.astype(np.float64)


def registry_table(pairs: list[tuple[Any, Any]], pointer: Any, fill: int, dtype: Any) -> Any:
    """A Dr.Jit array over registry ids: `table[id of object] = value`, `fill` elsewhere."""
    numbers = [registry_id(thing, pointer) for thing, _ in pairs]
    table = np.full(max(numbers, default=0) + 1, fill, dtype=np.int64)
    for number, (_, value) in zip(numbers, pairs, strict=True):
        table[number] = value
    return dtype(table.astype(np.int32 if dtype is mi.Int32 else np.uint32))


def registry_id(thing: Any, pointer: Any) -> int:
    """The number under which Dr.Jit's vectorised calls know an object."""
    return int(dr.reinterpret_array(mi.UInt32, pointer(thing))[0])


def _light(rgb: AnyArray) -> Float64Array:
    """Spectra of a renderer as linear RGB, float64, none of it negative."""
    return np.maximum(rgb.astype(np.float64), 0)


def _in_chunks(
    trace: Callable[[AnyArray, AnyArray], tuple[AnyArray, ...]],
    origins: npt.ArrayLike,
    directions: npt.ArrayLike,
) -> list[AnyArray]:
    """`trace` over rays, `CHUNK` at a time; its arrays joined."""
    d = np.asarray(directions, dtype=np.float64).reshape(-1, 3)
    o = np.broadcast_to(np.asarray(origins, dtype=np.float64), d.shape)
    if not len(d):  # kernels cannot be of size 0
        return [column[:0] for column in trace(np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]))]
    starts = range(0, len(d), CHUNK)
    parts = [trace(o[start : start + CHUNK], d[start : start + CHUNK]) for start in starts]
    return [np.concatenate(column) for column in zip(*parts, strict=True)]


# Wavefront variants


def _wave_ray(origins: AnyArray, directions: AnyArray) -> Any:
    return mi.Ray3f(vector(mi.Point3f, origins), vector(mi.Vector3f, directions))


def vector(kind: Any, rows: AnyArray) -> Any:
    """Rows (N, D) as a Dr.Jit vector, component by component.

    Dr.Jit's own conversion of a matrix would compile N into every kernel that uses it.
    """
    return kind(*(column(mi.Float, rows[:, axis]) for axis in range(rows.shape[1])))


def column(kind: Any, values: AnyArray) -> Any:
    """Values (N,) as a Dr.Jit array, in memory so aligned that one kernel serves all."""
    dtype = np.dtype(np.float32 if kind is mi.Float else np.uint32)
    room = np.empty(len(values) + 16, dtype=dtype)
    start = (-room.ctypes.data // dtype.itemsize) % 16
    aligned = room[start : start + len(values)]
    aligned[:] = values
    return kind(aligned)


def _arrays(*values: Any) -> tuple[AnyArray, ...]:
    """Dr.Jit arrays and vectors, computed together, as arrays (N,) and (N, D)."""
    dr.eval(*values)
    return tuple(
        value.numpy()
        if dr.depth_v(value) == 1
        else np.stack([component.numpy() for component in value], axis=-1)
        for value in values
    )


def _wave_camera_rays(poses: AnyArray, local: AnyArray) -> Any:
    """Rays of every pose (N, 4, 4) through every local direction (P, 3), pose by pose."""
    count = len(local)
    index = dr.arange(mi.UInt32, len(poses) * count)
    pose, pixel = index // dr.opaque(mi.UInt32, count), index % dr.opaque(mi.UInt32, count)
    table = column(mi.Float, poses[:, :3, :].ravel())
    columns = [column(mi.Float, local[:, axis]) for axis in range(3)]
    row = [[dr.gather(mi.Float, table, pose * 12 + 4 * i + j) for j in range(4)] for i in range(3)]
    x, y, z = (dr.gather(mi.Float, column, pixel) for column in columns)
    return mi.Ray3f(
        mi.Point3f(row[0][3], row[1][3], row[2][3]),
        mi.Vector3f(*(row[i][0] * x + row[i][1] * y + row[i][2] * z for i in range(3))),
    )


def _wave_first(target: Target, ray: Any, through: bool) -> tuple[Any, Any, Any, Any]:
    """Shape index, distance from the ray's origin, the preliminary hit and the ray it belongs to.

    A ray goes on behind each clear surface from a slightly later start, on the same line.
    """
    tables = _wave_tables(target)
    any_mask, any_clear = bool(target.masked.any()), bool(target.clear.any())
    hit = target.scene.ray_intersect_preliminary(ray, coherent=True)
    start = mi.Point3f(ray.o)
    if through and (any_mask or any_clear):
        passing = _wave_passes(target, tables, hit, ray, any_mask)
        layer = mi.UInt32(0)
        passing, hit, ray, layer = dr.while_loop(
            state=(passing, hit, ray, layer),
            cond=lambda passing, hit, ray, layer: passing & (layer < LAYERS),
            body=lambda passing, hit, ray, layer: _wave_step(
                target, tables, any_mask, hit, ray, layer
            ),
            labels=("passing", "hit", "ray", "layer"),
        )
        hit.t = dr.select(passing, dr.inf, hit.t)
    valid = hit.is_valid()
    number = dr.reinterpret_array(mi.UInt32, hit.shape)
    shape = dr.select(valid, dr.gather(mi.Int32, tables["shape"], number, valid), -1)
    distance = dr.select(valid, hit.t + dr.dot(ray.o - start, ray.d), dr.inf)
    return shape, distance, hit, ray


def _wave_step(
    target: Target, tables: dict[str, Any], any_mask: bool, hit: Any, ray: Any, layer: Any
) -> tuple[Any, Any, Any, Any]:
    # Past the surface by a little more than the rounding of the hit point.
    onward = hit.t + 1e-5 * (1 + dr.max(dr.abs(ray(hit.t))))
    ray = mi.Ray3f(ray)
    ray.o = ray(onward)
    hit = target.scene.ray_intersect_preliminary(ray, coherent=True)
    return _wave_passes(target, tables, hit, ray, any_mask), hit, ray, layer + 1


def _wave_passes(target: Target, tables: dict[str, Any], hit: Any, ray: Any, any_mask: bool) -> Any:
    valid = hit.is_valid()
    number = dr.reinterpret_array(mi.UInt32, hit.shape)
    passes = dr.gather(mi.UInt32, tables["clear"], number, valid) == 1
    if any_mask:
        masked = dr.gather(mi.UInt32, tables["masked"], number, valid) == 1
        # By a list of the masked alone: a virtual call would trace every shape there is.
        which = dr.gather(mi.UInt32, tables["mask"], number, masked)
        passes |= masked & (dr.switch(which, tables["masks"], ray, hit, masked) > 0.5)
    return passes & valid


def _wave_surfaces(
    target: Target, colors: bool, origins: AnyArray, directions: AnyArray
) -> tuple[AnyArray, ...]:
    shape, distance, hit, ray = _wave_first(target, _wave_ray(origins, directions), True)
    valid = shape >= 0
    si = hit.compute_surface_interaction(ray, mi.RayFlags.All, valid)
    reflectance = mi.Color3f(0)
    if colors:
        tables = _wave_tables(target)
        twin = dr.gather(
            mi.UInt32, tables["reflectance"], dr.reinterpret_array(mi.UInt32, si.shape), valid
        )
        bsdf = dr.reinterpret_array(mi.BSDFPtr, twin)
        reflectance = mi.unpolarized_spectrum(bsdf.eval_diffuse_reflectance(si, valid))
    number, metres, position, geometric, shading, colour = _arrays(
        shape,
        distance,
        *(dr.select(valid, v, 0) for v in (si.p, si.n, si.sh_frame.n, mi.Color3f(reflectance))),
    )
    return number, metres, position, geometric, shading, np.clip(colour, 0, 1)


def _wave_nearest(
    target: Target, through: bool, origins: AnyArray, directions: AnyArray
) -> tuple[AnyArray, ...]:
    return _arrays(*_wave_first(target, _wave_ray(origins, directions), through)[:2])


def _wave_emitted(
    target: Target, glowing: AnyArray, origins: AnyArray, directions: AnyArray
) -> tuple[AnyArray, ...]:
    shape, distance, hit, ray = _wave_first(target, _wave_ray(origins, directions), True)
    if not glowing.any():
        return (*_arrays(shape, distance), np.zeros((len(directions), 3)))
    lamps = np.flatnonzero(glowing)
    numbers = np.full(len(glowing), len(lamps), dtype=np.int64)
    numbers[lamps] = np.arange(len(lamps))
    which = dr.gather(
        mi.UInt32, column(mi.UInt32, numbers), mi.UInt32(dr.maximum(shape, 0)), shape >= 0
    )
    lit = (shape >= 0) & (which < len(lamps))
    # By a list of the lamps alone, as in `_wave_passes`.
    shining = [partial(_shining, target.shapes[lamp]) for lamp in lamps]
    light = dr.select(lit, dr.switch(which, shining, ray, hit, lit), mi.Color3f(0))
    return _arrays(shape, distance, light)


def _shining(shape: Any, ray: Any, hit: Any, active: Any) -> Any:
    """The light that a shape that was hit sends back along the ray."""
    si = shape.compute_surface_interaction(ray, hit, mi.RayFlags.All, active)
    si.wi = mi.Vector3f(0, 0, -dr.dot(si.sh_frame.n, ray.d))  # of it only the side is asked for
    return mi.Color3f(shape.emitter().eval(si, active))


def _wave_tables(target: Target) -> dict[str, Any]:
    """Properties of shapes by registry id, kept with the target."""
    tables = target.__dict__.get("tables")
    if tables is None:
        numbers = list(enumerate(target.shapes))
        tables = {
            "shape": registry_table([(s, i) for i, s in numbers], mi.ShapePtr, -1, mi.Int32),
            "clear": registry_table(
                [(s, int(target.clear[i])) for i, s in numbers], mi.ShapePtr, 0, mi.UInt32
            ),
            "masked": registry_table(
                [(s, int(target.masked[i])) for i, s in numbers], mi.ShapePtr, 0, mi.UInt32
            ),
            **_mask_tables(target),
            "reflectance": registry_table(
                [
                    (s, registry_id(twin, mi.BSDFPtr))
                    for s, twin in zip(target.shapes, target.reflectances, strict=True)
                    if twin is not None
                ],
                mi.ShapePtr,
                0,
                mi.UInt32,
            ),
        }
        object.__setattr__(target, "tables", tables)
    return tables


def _mask_tables(target: Target) -> dict[str, Any]:
    """`mask`, the number of each masked shape, and `masks`, what light passes each of them."""
    shapes = [shape for shape, has in zip(target.shapes, target.masked, strict=True) if has]
    numbers = [(shape, number) for number, shape in enumerate(shapes)]
    return {
        "mask": registry_table(numbers, mi.ShapePtr, 0, mi.UInt32),
        "masks": [partial(_passing, shape) for shape in shapes],
    }


def _passing(shape: Any, ray: Any, hit: Any, active: Any) -> Any:
    """The share of light that the material of a shape that was hit lets pass."""
    si = shape.compute_surface_interaction(ray, hit, mi.RayFlags.All, active)
    own = shape.bsdf()  # none of an instance's: its group has it
    share = (si.bsdf() if own is None else own).eval_null_transmission(si, active)
    return dr.mean(mi.unpolarized_spectrum(share))


# The scalar variant


def _scalar_ray(origin: AnyArray, direction: AnyArray) -> Any:
    return mi.Ray3f(mi.ScalarPoint3f(origin), mi.ScalarVector3f(direction))


def _scalar_first(target: Target, ray: Any, through: bool) -> tuple[int, float, Any, Any]:
    """As `_wave_first`, for one ray."""
    numbers = _scalar_numbers(target)
    travelled = 0.0
    for _ in range(LAYERS + 1):
        hit = target.scene.ray_intersect_preliminary(ray)
        if not hit.is_valid():
            break
        shape = numbers[hit.shape.ptr]
        if not (through and _scalar_passes(target, shape, hit, ray)):
            return shape, travelled + hit.t, hit, ray
        onward = hit.t + 1e-5 * (1 + max(abs(value) for value in ray(hit.t)))
        travelled += onward
        ray = mi.Ray3f(ray(onward), ray.d)
    return -1, float("inf"), None, ray


def _scalar_passes(target: Target, shape: int, hit: Any, ray: Any) -> bool:
    if target.clear[shape] or not target.masked[shape]:
        return bool(target.clear[shape])
    si = hit.compute_surface_interaction(ray)
    return float(np.mean(si.bsdf().eval_null_transmission(si))) > 0.5


def _scalar_numbers(target: Target) -> dict[int, int]:
    numbers: dict[int, int] | None = target.__dict__.get("numbers")
    if numbers is None:
        numbers = {shape.ptr: index for index, shape in enumerate(target.shapes)}
        object.__setattr__(target, "numbers", numbers)
    return numbers


def _scalar_nearest(
    target: Target, through: bool, origins: AnyArray, directions: AnyArray
) -> tuple[AnyArray, ...]:
    count = len(directions)
    shapes, distances = np.full(count, -1, np.int32), np.full(count, np.inf, np.float32)
    for i, (o, d) in enumerate(zip(origins, directions, strict=True)):
        shapes[i], distances[i], _, _ = _scalar_first(target, _scalar_ray(o, d), through)
    return shapes, distances


def _scalar_surfaces(
    target: Target, colors: bool, origins: AnyArray, directions: AnyArray
) -> tuple[AnyArray, ...]:
    count = len(directions)
    hits = Hits(
        np.full(count, -1, np.int32),
        np.full(count, np.inf, np.float32),
        *(np.zeros((count, 3), np.float32) for _ in range(4)),
    )
    numbers = _scalar_numbers(target)
    for i, (o, d) in enumerate(zip(origins, directions, strict=True)):
        shape, distance, hit, ray = _scalar_first(target, _scalar_ray(o, d), True)
        if shape < 0:
            continue
        si = hit.compute_surface_interaction(ray)
        hits.shape[i], hits.distance[i] = shape, distance
        hits.position[i], hits.geometric[i], hits.shading[i] = si.p, si.n, si.sh_frame.n
        if colors:
            twin = target.reflectances[numbers[si.shape.ptr]]
            hits.reflectance[i] = np.clip(twin.eval_diffuse_reflectance(si), 0, 1)
    return tuple(vars(hits).values())


def _scalar_emitted(
    target: Target, glowing: AnyArray, origins: AnyArray, directions: AnyArray
) -> tuple[AnyArray, ...]:
    count = len(directions)
    shapes, distances = np.full(count, -1, np.int32), np.full(count, np.inf, np.float32)
    light = np.zeros((count, 3))
    for i, (o, d) in enumerate(zip(origins, directions, strict=True)):
        shapes[i], distances[i], hit, ray = _scalar_first(target, _scalar_ray(o, d), True)
        if hit is not None and glowing[shapes[i]]:
            si = hit.compute_surface_interaction(ray)
            light[i] = si.shape.emitter().eval(si)
    return shapes, distances, light


def _scalar_towards_lights(
    emitters: tuple[Any, ...],
    which: AnyArray,
    eye: npt.ArrayLike,
    samples: AnyArray,
) -> tuple[Float64Array, Float32Array, Float64Array, Float64Array]:
    count = len(which)
    directions, light = np.zeros((count, 3)), np.zeros((count, 3))
    distances, density = np.zeros(count, np.float32), np.zeros(count)
    si = mi.SurfaceInteraction3f()
    si.p = mi.ScalarPoint3f(np.asarray(eye, dtype=np.float64))
    for i in range(count):
        ds, weight = emitters[which[i]].sample_direction(si, mi.ScalarPoint2f(samples[i]))
        directions[i], distances[i], light[i] = ds.d, ds.dist, weight
        density[i] = 0 if ds.delta else ds.pdf
    return directions, distances, _light(light), density
