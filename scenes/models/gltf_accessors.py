"""Reader of glTF accessors as typed arrays; bounds are checked before memory is touched."""

from __future__ import annotations

from typing import Any

import numpy as np

from scenes.arrays import AnyArray, Float64Array, Int64Array
from scenes.errors import InputError
from scenes.models.gltf_container import Asset, whole

MAX_COUNT = 60_000_000  # elements of an accessor
_COMPONENTS: dict[Any, np.dtype[Any]] = {
    5120: np.dtype("<i1"),
    5121: np.dtype("<u1"),
    5122: np.dtype("<i2"),
    5123: np.dtype("<u2"),
    5125: np.dtype("<u4"),
    5126: np.dtype("<f4"),
}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


def read_floats(asset: Asset, index: Any, width: int, where: str) -> Float64Array:
    """Read accessor `index` as float64 (N, width); normalised integers in [0, 1] or [-1, 1]."""
    raw, normalized = _read(asset, index, where)
    if raw.shape[1] != width:
        raise InputError(
            f"{asset.path}: {where}: elements have {raw.shape[1]} values, expected {width}"
        )
    values = raw.astype(np.float64)
    if normalized and raw.dtype.kind in "iu":
        values /= np.iinfo(raw.dtype).max
        if raw.dtype.kind == "i":
            values = np.maximum(values, -1.0)
    return values


def read_colors(asset: Asset, index: Any, where: str) -> Float64Array:
    """Read accessor `index` as vertex colours, linear RGB float64 (N, 3)."""
    raw, _ = _read(asset, index, where)
    values = raw.astype(np.float64)
    if raw.dtype.kind in "iu":
        values /= np.iinfo(raw.dtype).max
    if raw.shape[1] not in (3, 4):
        raise InputError(f"{asset.path}: {where}: a colour must have 3 or 4 values")
    return np.nan_to_num(np.clip(values[:, :3], 0, 1))


def read_indices(asset: Asset, index: Any, where: str) -> Int64Array:
    """Read accessor `index` of unsigned integers as int64 (N,)."""
    raw, _ = _read(asset, index, where)
    if raw.dtype.kind != "u" or raw.shape[1] != 1:
        raise InputError(f"{asset.path}: {where}: indices must be unsigned integers")
    return raw[:, 0].astype(np.int64)


def _read(asset: Asset, index: Any, where: str) -> tuple[AnyArray, bool]:
    """The values (N, width) of an accessor as stored, and whether they are normalised."""
    accessor = asset.item("accessors", index, where)
    label = f"accessors[{index}]"
    place = f"{asset.path}: {label}"
    dtype = _COMPONENTS.get(accessor.get("componentType", 0))
    width = _WIDTHS.get(str(accessor.get("type")))
    if dtype is None or width is None:
        raise InputError(
            f"{place}: component type {accessor.get('componentType')!r:.20} of "
            f"{accessor.get('type')!r:.20} is not supported for geometry"
        )
    count = whole(accessor.get("count"), f"{place}.count", 1, MAX_COUNT)
    if "bufferView" in accessor:
        data, stride = asset.view(accessor["bufferView"], f"{label}.bufferView")
        offset = whole(accessor.get("byteOffset", 0), f"{place}.byteOffset", 0, len(data))
        values = _strided(data, offset, stride, count, width, dtype, place)
    elif "sparse" in accessor:
        values = np.zeros((count, width), dtype)
    else:
        raise InputError(
            f"{place}: has no data; it may be compressed by an extension that is not supported, "
            "such as Draco"
        )
    sparse = accessor.get("sparse")
    if isinstance(sparse, dict):
        values = _patched(asset, values, sparse, label)
    return values, accessor.get("normalized") is True


def _strided(
    data: bytes, offset: int, stride: int, count: int, width: int, dtype: np.dtype[Any], place: str
) -> AnyArray:
    """A copy of `count` elements (count, width) at `offset`, `stride` bytes apart (0: packed)."""
    size = width * dtype.itemsize
    stride = stride or size
    if stride < size:
        raise InputError(f"{place}: the stride is {stride} bytes for elements of {size} bytes")
    end = offset + stride * (count - 1) + size
    if end > len(data):
        raise InputError(
            f"{place}: {count:,} elements end at byte {end:,}, but the buffer view has "
            f"{len(data):,} bytes"
        )
    return np.ndarray((count, width), dtype, data, offset, (stride, dtype.itemsize)).copy()


def _patched(asset: Asset, values: AnyArray, sparse: dict[str, Any], label: str) -> AnyArray:
    """`values` with the replacements of a sparse accessor."""
    place = f"{asset.path}: {label}.sparse"
    count = whole(sparse.get("count"), f"{place}.count", 1, len(values))
    parts = []
    for name, width in (("indices", 1), ("values", values.shape[1])):
        part = sparse.get(name)
        if not isinstance(part, dict):
            raise InputError(f"{place}: {name} are missing")
        dtype = values.dtype if name == "values" else _COMPONENTS.get(part.get("componentType", 0))
        if dtype is None or (name == "indices" and dtype.kind != "u"):
            raise InputError(f"{place}.{name}: must be unsigned integers")
        data, stride = asset.view(part.get("bufferView"), f"{label}.sparse.{name}")
        offset = whole(part.get("byteOffset", 0), f"{place}.{name}.byteOffset", 0, len(data))
        parts.append(_strided(data, offset, stride, count, width, dtype, f"{place}.{name}"))
    rows = parts[0][:, 0].astype(np.int64)
    if rows.max() >= len(values):
        raise InputError(f"{place}: an index lies beyond the accessor's {len(values):,} elements")
    values[rows] = parts[1]
    return values
