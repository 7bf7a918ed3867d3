"""Conversion between NumPy and Dr.Jit arrays, and tables over Dr.Jit's instance registry.

Dr.Jit compiles some properties of an array into each kernel that uses it. The conversions here
avoid that, so that one kernel serves arrays of every length.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from pbrnet.pipeline.render.scene_geometry import SceneGeometry
from pbrnet.scenes.arrays import AnyArray, Float64Array


def vector(kind: Any, rows: AnyArray) -> Any:
    """Convert rows (N, D) to a Dr.Jit vector of type `kind`, component by component.

    Dr.Jit's own conversion of a matrix compiles N into every kernel that uses the result.
    """
    return kind(*(column(mi.Float, rows[:, axis]) for axis in range(rows.shape[1])))


def column(kind: Any, values: AnyArray) -> Any:
    """Convert values (N,) to a Dr.Jit array of type `kind`.

    The memory is aligned to 16 entries: Dr.Jit compiles other kernels for unaligned memory.
    """
    dtype = np.dtype(np.float32 if kind is mi.Float else np.uint32)
    buffer = np.empty(len(values) + 16, dtype=dtype)
    start = (-buffer.ctypes.data // dtype.itemsize) % 16
    aligned = buffer[start : start + len(values)]
    aligned[:] = values
    return kind(aligned)


def to_numpy(*values: Any) -> tuple[AnyArray, ...]:
    """Evaluate Dr.Jit arrays and vectors in one kernel; return arrays (N,) and (N, D)."""
    dr.eval(*values)
    return tuple(
        value.numpy()
        if dr.depth_v(value) == 1
        else np.stack([component.numpy() for component in value], axis=-1)
        for value in values
    )


def bounds_of(thing: Any) -> Float64Array:
    """Return the lowest and the highest corner of a scene's or a shape's bounds, (2, 3)."""
    box = thing.bbox()
    return np.array([np.array(box.min).ravel(), np.array(box.max).ravel()], dtype=np.float64)


def shape_table(
    shapes: Sequence[mi.Shape], values: Iterable[int], fill: int = 0, dtype: Any = None
) -> Any:
    """Return a Dr.Jit array with `table[registry id of a shape] = value`, `fill` elsewhere.

    `dtype` is `mi.UInt32` unless given.
    """
    ids = [registry_id(shape, mi.ShapePtr) for shape in shapes]
    table = np.full(max(ids, default=0) + 1, fill, dtype=np.int64)
    table[ids] = list(values)
    dtype = dtype or mi.UInt32
    return dtype(table.astype(np.int32 if dtype is mi.Int32 else np.uint32))


def registry_id(instance: Any, pointer: Any) -> int:
    """Return the number under which Dr.Jit's vectorised calls know an instance."""
    return int(dr.reinterpret_array(mi.UInt32, pointer(instance))[0])


def environment_pointer(scene: mi.Scene) -> mi.EmitterPtr:
    """Return a pointer to a scene's environment, null without one, which no kernel compiles in."""
    found = scene.environment()
    number = 0 if found is None else registry_id(found, mi.EmitterPtr)
    return dr.reinterpret_array(mi.EmitterPtr, dr.opaque(mi.UInt32, number))


def met_emitter(si: mi.SurfaceInteraction3f, environment: mi.EmitterPtr) -> mi.EmitterPtr:
    """Return the emitter that a ray met; as `si.emitter(scene)`, with `environment_pointer`."""
    return dr.select(si.is_valid(), si.shape.emitter(), environment)


def partner_table(pairs: Sequence[tuple[mi.BSDF, mi.BSDF | None]]) -> mi.BSDFPtr:
    """Return a table with each BSDF's partner at its registry id, null for none.

    `pairs` are (BSDF, partner).
    """
    own = _indices([pair[0] for pair in pairs])
    partners = _indices([pair[1] or pair[0] for pair in pairs])
    partners[[pair[1] is None for pair in pairs]] = 0
    table = np.zeros(own.max() + 1, dtype=np.uint32)
    table[own] = partners
    return dr.reinterpret_array(mi.BSDFPtr, column(mi.UInt32, table))


def reflectance_table(geometry: SceneGeometry) -> mi.BSDFPtr:
    """Return the reflectance twin of each shape's BSDF, by registry id of the shape."""
    twins = geometry.reflectances
    numbers = (0 if twin is None else registry_id(twin, mi.BSDFPtr) for twin in twins)
    return dr.reinterpret_array(mi.BSDFPtr, shape_table(geometry.shapes, numbers))


def partner(table: mi.BSDFPtr, bsdfs: mi.BSDFPtr, active: mi.Bool) -> mi.BSDFPtr:
    """Return the partners of BSDFs."""
    return dr.gather(mi.BSDFPtr, table, dr.reinterpret_array(mi.UInt32, bsdfs), active)


def _indices(bsdfs: list[mi.BSDF]) -> AnyArray:
    """Return the registry ids of BSDFs, (N,)."""
    return np.array(dr.reinterpret_array(mi.UInt32, mi.BSDFPtr(bsdfs)))
