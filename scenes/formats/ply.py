"""Reader and writer of PLY meshes; reads ASCII and binary files, writes little-endian ones."""

from __future__ import annotations

import gzip
import zlib
from pathlib import Path

import numpy as np

from pbrnet.scenes.errors import InputError
from pbrnet.scenes.geometry.mesh import MAX_TRIANGLES, Mesh

MAX_BYTES = 512 * 2**20
_PER_UNIT = 2.0**20  # steps that numbers are rounded to when they are written

_PLY_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1",
    "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip

PlyProperty = tuple[str, str, str | None]  # name, value type, type of the count for lists
PlyElement = tuple[str, int, list[PlyProperty]]


def read_ply(path: Path) -> Mesh:
    """Read a triangle or polygon mesh, ASCII or binary of either byte order, or a `.gz` of it.

    Polygons become fans. Raises `InputError`.
    """
    data = _bytes(path)
    end = data.find(b"end_header")
    if not data.startswith(b"ply") or end < 0 or end > 2**20:
        raise InputError(f"{path}: not a PLY file")
    try:
        header = data[:end].decode("ascii").splitlines()
    except UnicodeDecodeError:
        raise InputError(f"{path}: a damaged PLY header") from None
    body = data.index(b"\n", end) + 1 if b"\n" in data[end:] else len(data)
    form, elements = _ply_header(path, header)
    if form == "ascii":
        tables = _ply_ascii(path, data[body:], elements)
    else:
        order = {"binary_little_endian": "<", "binary_big_endian": ">"}.get(form)
        if order is None:
            raise InputError(f"{path}: unknown PLY format {form!r}")
        tables = _ply_binary(path, data, body, elements, order)
    vertex, faces = tables.get("vertex", {}), tables.get("face", {})
    if not all(axis in vertex for axis in "xyz"):
        raise InputError(f"{path}: a PLY without vertex positions")
    indices = faces.get("vertex_indices", faces.get("vertex_index"))
    if indices is None or not len(indices) or np.shape(indices)[1:] != (3,):
        raise InputError(f"{path}: a PLY without faces")
    if any(np.ndim(vertex[axis]) != 1 for axis in vertex):
        raise InputError(f"{path}: a PLY whose vertices hold lists")
    uvs = normals = None
    for u, v in (("u", "v"), ("s", "t"), ("texture_u", "texture_v")):
        if u in vertex and v in vertex:
            uvs = np.stack([vertex[u], vertex[v]], axis=1).astype(np.float64)
    if all(axis in vertex for axis in ("nx", "ny", "nz")):
        normals = np.stack([vertex["nx"], vertex["ny"], vertex["nz"]], axis=1).astype(np.float64)
    vertices = np.stack([vertex["x"], vertex["y"], vertex["z"]], axis=1).astype(np.float64)
    return Mesh(vertices, np.asarray(indices, dtype=np.int64), normals, uvs)


def write_ply(path: Path, mesh: Mesh) -> None:
    """Write a mesh as little-endian binary PLY, float32, with normals and uv where it has them.

    Numbers are rounded to multiples of 2**-20, a micrometre: the last bit of a sine or a matrix
    product depends on the processor, and would be kept where a number is nearly zero.
    """
    columns = [("x", mesh.vertices[:, 0]), ("y", mesh.vertices[:, 1]), ("z", mesh.vertices[:, 2])]
    if mesh.normals is not None:
        columns += [(f"n{axis}", mesh.normals[:, i]) for i, axis in enumerate("xyz")]
    if mesh.uvs is not None:
        columns += [("u", mesh.uvs[:, 0]), ("v", mesh.uvs[:, 1])]
    values = np.stack([values for _, values in columns], axis=1).astype(np.float64)
    rows = (np.rint(values * _PER_UNIT) / _PER_UNIT + 0.0).astype("<f4")  # + 0.0: no -0.0
    faces = np.empty(len(mesh.faces), dtype=[("count", "u1"), ("corners", "<i4", (3,))])
    faces["count"] = 3
    faces["corners"] = mesh.faces
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(rows)}",
        *(f"property float {name}" for name, _ in columns),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    path.write_bytes("\n".join(header).encode("ascii") + rows.tobytes() + faces.tobytes())


def _bytes(path: Path) -> bytes:
    size = path.stat().st_size
    if size > MAX_BYTES:
        raise InputError(f"{path}: {size / 2**20:.0f} MiB; at most {MAX_BYTES >> 20} MiB")
    if path.suffix.lower() != ".gz":
        return path.read_bytes()
    try:
        with gzip.open(path) as stream:
            data = stream.read(MAX_BYTES + 1)
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(f"{path}: damaged ({error})") from None
    if len(data) > MAX_BYTES:
        raise InputError(f"{path}: decompressed, it has more than {MAX_BYTES >> 20} MiB")
    return data


def _ply_header(path: Path, lines: list[str]) -> tuple[str, list[PlyElement]]:
    form = ""
    elements: list[PlyElement] = []
    for line in lines[1:]:
        words = line.split()
        try:
            if not words or words[0] in ("comment", "obj_info"):
                continue
            if words[0] == "format":
                form = words[1]
            elif words[0] == "element":
                count = int(words[2])
                if not 0 <= count <= 3 * MAX_TRIANGLES:
                    raise InputError(f"{path}: claims {count:,} of {words[1]!r}; refused")
                elements.append((words[1], count, []))
            elif words[0] == "property" and words[1] == "list":
                elements[-1][2].append((words[4], _PLY_TYPES[words[3]], _PLY_TYPES[words[2]]))
            elif words[0] == "property":
                elements[-1][2].append((words[2], _PLY_TYPES[words[1]], None))
        except (IndexError, KeyError, ValueError):
            raise InputError(f"{path}: a damaged PLY header line: {line[:200]!r}") from None
    for element, _, properties in elements:
        names = [one[0] for one in properties]
        if len(set(names)) < len(names):
            raise InputError(f"{path}: a damaged PLY header: {element!r} repeats a property")
    return form, elements


def _ply_ascii(path: Path, body: bytes, elements: list[PlyElement]) -> dict[str, dict]:
    words = body.split()
    tables: dict[str, dict] = {}
    at = 0
    try:
        for name, count, properties in elements:
            if all(kind is None for _, _, kind in properties):
                width = len(properties)
                if len(words) < at + count * width:
                    raise InputError(f"{path}: truncated")
                flat = np.array(words[at : at + count * width], dtype=np.float64)
                rows = flat.reshape(count, width)
                tables[name] = {column[0]: rows[:, i] for i, column in enumerate(properties)}
                at += count * width
                continue
            triangles: dict[str, list] = {column[0]: [] for column in properties}
            for _ in range(count):
                for column, _, kind in properties:
                    length = int(words[at]) if kind else 1
                    at += bool(kind)
                    if length < 0 or at + length > len(words):
                        raise InputError(f"{path}: truncated")
                    if kind:
                        polygon = [int(word) for word in words[at : at + length]]
                        triangles[column] += _fan(polygon)
                    at += length
            tables[name] = {key: np.array(value) for key, value in triangles.items() if value}
    except (ValueError, IndexError, OverflowError):
        raise InputError(f"{path}: truncated or damaged") from None
    return tables


def _ply_binary(
    path: Path, data: bytes, at: int, elements: list[PlyElement], order: str
) -> dict[str, dict]:
    tables: dict[str, dict] = {}
    for name, count, properties in elements:
        if all(kind is None for _, _, kind in properties):
            row = np.dtype([(column, order + kind) for column, kind, _ in properties])
            if len(data) - at < count * row.itemsize:
                raise InputError(f"{path}: truncated; {count:,} of {name!r} do not fit in the file")
            rows = np.frombuffer(data, row, count, at)
            tables[name] = {column: rows[column] for column, _, _ in properties}
            at += count * row.itemsize
            continue
        # Common case: every list holds three indices, so that all rows have one size.
        row = np.dtype(
            [
                field
                for column, kind, counter in properties
                for field in (
                    [(f"{column}#", order + counter), (column, order + kind, (3,))]
                    if counter
                    else [(column, order + kind)]
                )
            ]
        )
        lists = [column for column, _, counter in properties if counter]
        rows = (
            np.frombuffer(data, row, count, at)
            if len(data) - at >= count * row.itemsize
            else np.zeros(0, row)
        )
        if len(rows) == count and all((rows[f"{column}#"] == 3).all() for column in lists):
            tables[name] = {column: rows[column] for column in lists}
            at += count * row.itemsize
            continue
        tables[name], at = _ply_polygons(path, data, at, count, properties, order)
    return tables


def _ply_polygons(
    path: Path, data: bytes, at: int, count: int, properties: list[PlyProperty], order: str
) -> tuple[dict, int]:
    """Read faces with any number of corners, one by one; returns tables and the end offset."""
    triangles: dict[str, list] = {column: [] for column, _, counter in properties if counter}
    try:
        for _ in range(count):
            for column, kind, counter in properties:
                length = 1
                if counter:
                    counted = float(np.frombuffer(data, order + counter, 1, at)[0])
                    if not 0 <= counted <= len(data):  # NaN is neither
                        raise ValueError(f"a list of {counted:g}")
                    length = int(counted)
                    at += np.dtype(counter).itemsize
                values = np.frombuffer(data, order + kind, length, at)
                at += values.nbytes
                if counter:
                    triangles[column] += _fan(values.tolist())
    except ValueError:
        raise InputError(f"{path}: truncated or damaged faces") from None
    return {column: np.array(value) for column, value in triangles.items() if value}, at


def _fan(polygon: list) -> list:
    return [[polygon[0], polygon[i], polygon[i + 1]] for i in range(1, len(polygon) - 1)]
