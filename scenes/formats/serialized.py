"""Reader of Mitsuba's `.serialized` meshes."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.geometry.mesh import MAX_TRIANGLES, Mesh, smooth_normals

MAX_BYTES = 512 * 2**20


def read_serialized(path: Path, index: int) -> Mesh:
    """Read mesh number `index` of a `.serialized` file (versions 3 and 4); raises `InputError`."""
    size = path.stat().st_size
    if size > MAX_BYTES:
        raise InputError(f"{path}: {size / 2**20:.0f} MiB; at most {MAX_BYTES >> 20} MiB")
    with path.open("rb") as stream:
        magic = stream.read(4)
        if len(magic) < 4 or magic[:2] != b"\x1c\x04" or magic[2:] not in (b"\3\0", b"\4\0"):
            raise InputError(f"{path}: not a Mitsuba .serialized file of version 3 or 4")
        width = 8 if magic[2] == 4 else 4
        stream.seek(-4, 2)
        (count,) = struct.unpack("<I", stream.read(4))
        table = size - 4 - width * count
        if count == 0 or table < 4:
            raise InputError(f"{path}: truncated; its table of meshes is damaged")
        if not 0 <= index < count:
            raise InputError(f"{path}: has {count} meshes; mesh {index} does not exist")
        stream.seek(table + width * index)
        (offset,) = struct.unpack("<Q" if width == 8 else "<I", stream.read(width))
        end = table
        if index + 1 < count:
            (end,) = struct.unpack("<Q" if width == 8 else "<I", stream.read(width))
        if not 0 <= offset < end <= table:
            raise InputError(f"{path}: truncated; its table of meshes is damaged")
        stream.seek(offset + 4)
        packed = stream.read(end - offset - 4)
    return _unpack_serialized(f"{path}, mesh {index}", packed, named=width == 8)


def _unpack_serialized(where: str, packed: bytes, named: bool) -> Mesh:
    inflater = zlib.decompressobj()
    try:
        head = inflater.decompress(packed, 64 * 1024)
    except zlib.error as error:
        raise InputError(f"{where}: damaged data ({error})") from None
    at = 4
    if named:
        at = head.find(b"\0", 4) + 1
    if len(head) < at + 16 or at < 4:
        raise InputError(f"{where}: truncated")
    (flags,) = struct.unpack_from("<I", head)
    vertices, triangles = struct.unpack_from("<QQ", head, at)
    at += 16
    if vertices > 3 * MAX_TRIANGLES or triangles > MAX_TRIANGLES:
        raise InputError(f"{where}: claims {triangles:,} triangles; at most {MAX_TRIANGLES:,}")
    real = np.dtype("<f8" if flags & 0x2000 else "<f4")
    columns = 3 + 3 * bool(flags & 1) + 2 * bool(flags & 2) + 3 * bool(flags & 8)
    needed = at + vertices * columns * real.itemsize + triangles * 12
    try:
        data = head + inflater.decompress(inflater.unconsumed_tail, max(needed - len(head), 1))
    except zlib.error as error:
        raise InputError(f"{where}: damaged data ({error})") from None
    if len(data) < needed:
        raise InputError(f"{where}: truncated; {needed:,} bytes expected, {len(data):,} found")

    def take(width: int, dtype: np.dtype, rows: int) -> Float64Array:
        nonlocal at
        found = np.frombuffer(data, dtype, rows * width, at).reshape(rows, width)
        at += found.nbytes
        return found.astype(np.float64)

    points = take(3, real, vertices)
    normals = take(3, real, vertices) if flags & 1 else None
    uvs = take(2, real, vertices) if flags & 2 else None
    if flags & 8:
        take(3, real, vertices)
    faces = take(3, np.dtype("<u4"), triangles).astype(np.int64)
    if not triangles:
        raise InputError(f"{where}: a mesh without triangles")
    if faces.max() >= vertices:
        raise InputError(f"{where}: a face refers to a vertex that does not exist")
    if flags & 0x10:
        normals = None
    elif normals is None:
        normals = smooth_normals(points, faces)
    return Mesh(points, faces, normals, uvs)
