"""Readers of glTF accessors and primitives as typed arrays.

Bounds are checked before memory is touched. The attributes of a primitive come from accessors, or
from Draco data that replaces them.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from pbrnet.scenes.arrays import AnyArray, Float64Array, Int64Array
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.models.gltf.compression import DracoMesh, decode_draco
from pbrnet.scenes.models.gltf.container import Asset, extensions, whole

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


class Primitive:
    """Attributes and indices of one mesh primitive; `where` names it in errors."""

    def __init__(self, asset: Asset, primitive: dict[str, Any], where: str) -> None:
        self.asset, self.where = asset, where
        self._primitive = primitive
        found = primitive.get("attributes")
        self._accessors: dict[str, Any] = found if isinstance(found, dict) else {}
        self._draco = extensions(primitive).get("KHR_draco_mesh_compression")

    def __contains__(self, attribute: str) -> bool:
        return attribute in self._accessors

    @property
    def uses_draco(self) -> bool:
        """Return whether the triangles are Draco data, to which the mode does not apply."""
        return self._draco is not None

    def floats(self, attribute: str, width: int) -> Float64Array:
        """Read an attribute as float64 (N, width); normalised integers in [0, 1] or [-1, 1]."""
        return _floats(*self._raw(attribute), width, self._place(attribute))

    def colors(self, attribute: str) -> Float64Array:
        """Read an attribute as vertex colours, linear RGB float64 (N, 3)."""
        raw, _ = self._raw(attribute)
        values = raw.astype(np.float64)
        if raw.dtype.kind in "iu":
            values /= np.iinfo(raw.dtype).max
        if raw.shape[1] not in (3, 4):
            raise InputError(f"{self._place(attribute)}: a colour must have 3 or 4 values")
        return np.nan_to_num(np.clip(values[:, :3], 0, 1))

    def corners(self, count: int) -> Int64Array:
        """Read the indices (M,) into `count` vertices; without indices, all of them in order."""
        if self._draco is not None:
            return self._decoded.faces.reshape(-1)
        if "indices" not in self._primitive:
            return np.arange(count)
        raw, _ = _read(self.asset, self._primitive["indices"], f"{self.where}.indices")
        if raw.dtype.kind != "u" or raw.shape[1] != 1:
            raise InputError(f"{self._place('indices')}: indices must be unsigned integers")
        return raw[:, 0].astype(np.int64)

    def _raw(self, attribute: str) -> tuple[AnyArray, bool]:
        """The values (N, width) as stored, and whether they are normalised."""
        index = self._accessors[attribute]
        ids = self._draco.get("attributes") if self._draco is not None else None
        if not isinstance(ids, dict) or attribute not in ids:
            return _read(self.asset, index, f"{self.where}.{attribute}")
        accessor = self.asset.item("accessors", index, f"{self.where}.{attribute}")
        unique = whole(ids[attribute], self._place(attribute), 0, 2**31)
        values = self._decoded.attributes.get(unique)
        if values is None:
            raise InputError(
                f"{self._place(attribute)}: the Draco data has no attribute number {unique}"
            )
        return values, accessor.get("normalized") is True

    @cached_property
    def _decoded(self) -> DracoMesh:
        assert self._draco is not None
        label = f"{self.where}.KHR_draco_mesh_compression"
        data, _ = self.asset.view(self._draco.get("bufferView"), label)
        return decode_draco(data, f"{self.asset.path}: {label}")

    def _place(self, attribute: str) -> str:
        return f"{self.asset.path}: {self.where}.{attribute}"


def read_floats(asset: Asset, index: Any, width: int, where: str) -> Float64Array:
    """Read accessor `index` as float64 (N, width); normalised integers in [0, 1] or [-1, 1]."""
    return _floats(*_read(asset, index, where), width, f"{asset.path}: {where}")


def _floats(raw: AnyArray, normalized: bool, width: int, place: str) -> Float64Array:
    if raw.shape[1] != width:
        raise InputError(f"{place}: elements have {raw.shape[1]} values, expected {width}")
    values = raw.astype(np.float64)
    if normalized and raw.dtype.kind in "iu":
        values /= np.iinfo(raw.dtype).max
        if raw.dtype.kind == "i":
            values = np.maximum(values, -1.0)
    return values


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
            f"{place}: has no data; it may be compressed by an extension that is not supported"
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
