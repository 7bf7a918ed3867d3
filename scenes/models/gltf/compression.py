"""Decoders of compressed glTF geometry: Draco (KHR_draco_mesh_compression) and meshopt.

Both take bytes and check what they decode; the libraries are DracoPy (Google's Draco) and meshopt
(meshoptimizer's decoder).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pbrnet.scenes.arrays import AnyArray, Int64Array
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.installation import optional

_MODES = ("ATTRIBUTES", "TRIANGLES", "INDICES")
_FILTERS = ("NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL", "COLOR")


@dataclass(frozen=True)
class DracoMesh:
    """A decoded primitive: indices of triangles (F, 3), and attributes (N, width) by unique id."""

    faces: Int64Array
    attributes: dict[int, AnyArray]


def decode_draco(data: bytes, where: str) -> DracoMesh:
    """Decode a Draco mesh; `InputError` begins with `where` if it is damaged or a point cloud."""
    draco = optional("DracoPy")
    try:
        decoded = draco.decode(data)
    except Exception as error:  # the decoder raises its own types, and MemoryError
        raise InputError(f"{where}: the Draco data is damaged ({error})") from None
    faces = getattr(decoded, "faces", None)
    if faces is None:
        raise InputError(f"{where}: the Draco data is a point cloud, not a mesh")
    attributes = {
        int(one["unique_id"]): _two_dimensional(np.asarray(one["data"]))
        for one in decoded.attributes
    }
    return DracoMesh(np.asarray(faces, dtype=np.int64).reshape(-1, 3), attributes)


def decode_meshopt(
    data: bytes, count: int, stride: int, mode: object, filtered: object, where: str
) -> bytes:
    """Decode a buffer view of EXT_meshopt_compression to `count` elements of `stride` bytes."""
    if mode not in _MODES:
        raise InputError(f"{where}.mode: expected one of {', '.join(_MODES)}, got {mode!r:.40}")
    if filtered not in _FILTERS:
        raise InputError(
            f"{where}.filter: expected one of {', '.join(_FILTERS)}, got {filtered!r:.40}"
        )
    meshopt = optional("meshopt")
    try:
        decoded = meshopt.decode_gltf_buffer(data, count, stride, mode, filtered)
    except (ValueError, RuntimeError, TypeError, MemoryError) as error:
        raise InputError(f"{where}: the compressed data is damaged ({error})") from None
    return np.ascontiguousarray(decoded).tobytes()


def _two_dimensional(values: AnyArray) -> AnyArray:
    return values.reshape(len(values), -1) if values.ndim != 2 else values
