"""Triangle meshes from OBJ, PLY and Mitsuba's `.serialized` files, with the checks strangers need.

Coordinates are the file's own. Texture coordinates are Mitsuba's: v = 0 is an image's top row,
which is why an OBJ's v is turned round and the others' is not.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from scenes.errors import InputError

MAX_BYTES = 512 * 2**20
FARTHEST = 1e12  # units from the origin that a vertex may lie
FARTHEST_UV = 1e5  # beyond, float32 has no texels left and textures return nonsense, even 1e9
MAX_TRIANGLES = 10_000_000  # of one mesh; the whole scene has a limit of its own

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh.

    `vertices` float64 (V, 3); `faces` int64 (F, 3), counter-clockwise seen from its front;
    `normals` unit float64 (V, 3), or None for flat facets; `uvs` float64 (V, 2) or None.
    """

    vertices: Floats
    faces: Ints
    normals: Floats | None = None
    uvs: Floats | None = None

    @property
    def corners(self) -> Floats:
        """The triangles' corner positions, (F, 3, 3)."""
        return self.vertices[self.faces]

    @property
    def bounds(self) -> Floats:
        """Axis-aligned bounds, (2, 3)."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    def transformed(self, matrix: Floats) -> Mesh:
        """The mesh under an affine map; a mirroring one keeps the front at the front."""
        linear = matrix[:3, :3]
        vertices = self.vertices @ linear.T + matrix[:3, 3]
        normals, faces = self.normals, self.faces
        if normals is not None:
            normals = _unit(normals @ np.linalg.inv(linear))
        if np.linalg.det(linear) < 0:
            faces = faces[:, ::-1]
        return Mesh(vertices, faces, normals, self.uvs)

    def flipped(self) -> Mesh:
        """Front and back exchanged."""
        normals = None if self.normals is None else -self.normals
        return replace(self, faces=self.faces[:, ::-1], normals=normals)

    def subset(self, keep: npt.NDArray[np.bool_]) -> Mesh:
        """Only the faces where `keep` (F,) holds, and the vertices they use."""
        faces = self.faces[keep]
        used, inverse = np.unique(faces, return_inverse=True)
        return Mesh(
            self.vertices[used],
            inverse.reshape(-1, 3),
            None if self.normals is None else self.normals[used],
            None if self.uvs is None else self.uvs[used],
        )


def face_areas(corners: Floats) -> tuple[Floats, Floats]:
    """Areas (F,) and unit normals (F, 3; zero where degenerate) of triangles (F, 3, 3)."""
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(cross, axis=1)
    return 0.5 * length, cross / np.maximum(length, 1e-300)[:, None]


def cleaned(mesh: Mesh, where: str) -> tuple[Mesh, int]:
    """The mesh without zero-area triangles, and how many those were.

    Raises `InputError` for NaN or infinite vertices and for indices beyond the vertex list.
    """
    if len(mesh.faces) > MAX_TRIANGLES:
        raise InputError(f"{where}: {len(mesh.faces):,} triangles; at most {MAX_TRIANGLES:,}")
    if mesh.faces.size and (mesh.faces.min() < 0 or mesh.faces.max() >= len(mesh.vertices)):
        raise InputError(f"{where}: a face refers to a vertex that does not exist")
    bad = ~np.isfinite(mesh.vertices).all(axis=1)
    if bad.any():
        raise InputError(
            f"{where}: vertex {int(np.argmax(bad))} is not a finite number "
            f"({int(bad.sum())} such vertices); repair the mesh"
        )
    farthest = float(np.abs(mesh.vertices).max(initial=0.0))
    if farthest > FARTHEST:
        raise InputError(f"{where}: a vertex lies {farthest:.3g} units away; repair the mesh")
    areas, _ = face_areas(mesh.corners)
    keep = areas > 0
    normals, uvs = mesh.normals, mesh.uvs
    if normals is not None:
        length = np.linalg.norm(normals, axis=1)
        if not np.isfinite(normals).all() or (length < 1e-12).any():
            normals = smooth_normals(mesh.vertices, mesh.faces)
        else:
            normals = normals / length[:, None]
    if uvs is not None:
        uvs = np.where(np.abs(uvs) < FARTHEST_UV, uvs, 0.0)  # NaN compares false
    dropped = int((~keep).sum())
    mesh = Mesh(mesh.vertices, mesh.faces, normals, uvs)
    return (mesh.subset(keep) if dropped else mesh), dropped


def smooth_normals(vertices: Floats, faces: Ints) -> Floats:
    """Vertex normals weighted by the angle at each corner (Thürmer and Wüthrich 1998)."""
    corners = vertices[faces]
    _, face = face_areas(corners)
    normals = np.zeros_like(vertices)
    for corner in range(3):
        weighted = face * _corner_angle(corners, corner)[:, None]
        for axis in range(3):
            normals[:, axis] += np.bincount(
                faces[:, corner], weighted[:, axis], minlength=len(vertices)
            )
    return _unit(normals)


def creased(mesh: Mesh, degrees: float) -> Mesh:
    """Smooth normals across edges up to `degrees` apart, creases elsewhere (`maxSmoothAngle`)."""
    corners = mesh.corners
    _, face = face_areas(corners)
    weights = np.stack([_corner_angle(corners, corner) for corner in range(3)], axis=1).ravel()
    keys = mesh.vertices if mesh.uvs is None else np.hstack([mesh.vertices, mesh.uvs])
    _, group = np.unique(keys, axis=0, return_inverse=True)
    corner_group = group.reshape(-1)[mesh.faces].ravel()
    owner = np.repeat(np.arange(len(mesh.faces)), 3)
    order = np.argsort(corner_group, kind="stable")
    sizes = np.bincount(corner_group)
    sizes = sizes[sizes > 0]
    if int((sizes.astype(np.int64) ** 2).sum()) > 200_000_000:
        return replace(mesh, normals=smooth_normals(mesh.vertices, mesh.faces))
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    # Every pair (a, b) of corners that meet in one point, a's normal gathering b's.
    size_of = np.repeat(sizes, sizes)
    first = np.repeat(np.arange(len(order)), size_of)
    offset = np.arange(len(first)) - np.repeat(np.cumsum(size_of) - size_of, size_of)
    second = np.repeat(np.repeat(starts, sizes), size_of) + offset
    a, b = order[first], order[second]
    near = (face[owner[a]] * face[owner[b]]).sum(axis=1) >= np.cos(np.radians(degrees)) - 1e-9
    a, b = a[near], b[near]
    normals = np.zeros((len(owner), 3))
    for axis in range(3):
        normals[:, axis] = np.bincount(a, (face[owner[b]][:, axis] * weights[b]), len(owner))
    flat = mesh.faces.ravel()
    return Mesh(
        mesh.vertices[flat],
        np.arange(len(flat)).reshape(-1, 3),
        _unit(normals),
        None if mesh.uvs is None else mesh.uvs[flat],
    )


def read_obj(path: Path, flip_v: bool = True) -> Mesh:
    """A Wavefront OBJ: polygons as fans, one mesh whatever its groups. Normals where all faces
    have them, else None; `flip_v` turns v round, as Mitsuba does unless told otherwise."""
    lines = obj_lines(path)
    corners, sizes = _obj_corners(path, lines)
    if not len(sizes):
        raise InputError(f"{path}: an OBJ without faces")
    return _obj_mesh(path, _obj_tables(path, lines), corners, sizes, flip_v)


def read_obj_parts(path: Path, lines: list[bytes], part_of_face: Ints) -> dict[int, Mesh]:
    """The meshes of an OBJ's parts, by part number; `part_of_face` (F,) tells each face's part.

    `lines` are those of `obj_lines`; v is turned round, polygons become fans.
    """
    tables = _obj_tables(path, lines)
    corners, sizes = _obj_corners(path, lines)
    ends = np.cumsum(sizes)
    order = np.argsort(part_of_face, kind="stable")
    numbers, first = np.unique(part_of_face[order], return_index=True)
    parts = {}
    for part, mine in zip(numbers.tolist(), np.split(order, first[1:]), strict=True):
        starts = ends[mine] - sizes[mine]
        rows = np.repeat(starts - np.cumsum(sizes[mine]) + sizes[mine], sizes[mine])
        rows += np.arange(len(rows))
        parts[part] = _obj_mesh(path, tables, corners[rows], sizes[mine], True)
    return parts


def obj_lines(path: Path) -> list[bytes]:
    """The lines of an OBJ file, continued ones joined."""
    return _bytes(path).replace(b"\\\n", b" ").replace(b"\r", b"\n").split(b"\n")


ObjTables = tuple[Floats, Floats, Floats]  # positions, texture coordinates, normals


def _obj_tables(path: Path, lines: list[bytes]) -> ObjTables:
    return (
        _table(path, [line[2:] for line in lines if line[:2] in (b"v ", b"v\t")], 3),
        _table(path, [line[3:] for line in lines if line.startswith(b"vt ")], 2),
        _table(path, [line[3:] for line in lines if line.startswith(b"vn ")], 3),
    )


def _obj_mesh(path: Path, tables: ObjTables, corners: Ints, sizes: Ints, flip_v: bool) -> Mesh:
    positions, texture, normals = tables
    for column, table, kind in ((0, positions, "vertex"), (1, texture, "vt"), (2, normals, "vn")):
        values = corners[:, column]
        if (values > len(table)).any() or (column == 0 and (values < 1).any()):
            raise InputError(f"{path}: a face refers to a {kind} that does not exist")
    has_uv, has_normals = bool((corners[:, 1] > 0).all()), bool((corners[:, 2] > 0).all())
    corners[:, 1] *= has_uv
    corners[:, 2] *= has_normals
    # One 64-bit key per corner sorts far faster than rows.
    key = (corners[:, 0] * (len(texture) + 1) + corners[:, 1]) * (len(normals) + 1) + corners[:, 2]
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    used = corners[first] - 1
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    fans = sizes - 2
    if (fans < 1).any():
        raise InputError(f"{path}: a face with fewer than three corners")
    base = np.repeat(starts, fans)
    step = np.arange(int(fans.sum())) - np.repeat(np.cumsum(fans) - fans, fans)
    faces = inverse.reshape(-1)[np.stack([base, base + step + 1, base + step + 2], axis=1)]
    uvs = None
    if has_uv:
        uvs = texture[used[:, 1]].copy()
        if flip_v:
            uvs[:, 1] = 1 - uvs[:, 1]
    return Mesh(positions[used[:, 0]], faces, normals[used[:, 2]] if has_normals else None, uvs)


def read_ply(path: Path) -> Mesh:
    """A PLY, ASCII or binary of either byte order."""
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
    if indices is None or not len(indices):
        raise InputError(f"{path}: a PLY without faces")
    uvs = normals = None
    for u, v in (("u", "v"), ("s", "t"), ("texture_u", "texture_v")):
        if u in vertex and v in vertex:
            uvs = np.stack([vertex[u], vertex[v]], axis=1).astype(np.float64)
    if all(axis in vertex for axis in ("nx", "ny", "nz")):
        normals = np.stack([vertex["nx"], vertex["ny"], vertex["nz"]], axis=1).astype(np.float64)
    vertices = np.stack([vertex["x"], vertex["y"], vertex["z"]], axis=1).astype(np.float64)
    return Mesh(vertices, np.asarray(indices, dtype=np.int64), normals, uvs)


def read_serialized(path: Path, index: int) -> Mesh:
    """Mesh number `index` of a Mitsuba `.serialized` file (versions 3 and 4)."""
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
            raise InputError(f"{path}: has {count} meshes, number {index} was asked for")
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

    def take(width: int, dtype: np.dtype, rows: int) -> npt.NDArray[np.float64]:
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


def _bytes(path: Path) -> bytes:
    size = path.stat().st_size
    if size > MAX_BYTES:
        raise InputError(f"{path}: {size / 2**20:.0f} MiB; at most {MAX_BYTES >> 20} MiB")
    return path.read_bytes()


def _table(path: Path, rows: list[bytes], columns: int) -> Floats:
    if not rows:
        return np.zeros((0, columns))
    try:
        flat = np.array(b" ".join(rows).split(), dtype=np.float64)
        if flat.size % len(rows) == 0 and flat.size // len(rows) >= columns:
            wide = flat.reshape(len(rows), -1)
            if all(len(row.split()) == wide.shape[1] for row in rows[:: max(1, len(rows) // 64)]):
                return wide[:, :columns].copy()
        return np.array([[float(word) for word in row.split()[:columns]] for row in rows])
    except ValueError as error:
        raise InputError(f"{path}: a damaged line of numbers ({error})") from None


def _obj_corners(path: Path, lines: list[bytes]) -> tuple[Ints, Ints]:
    """Corners as one-based (v, vt, vn) rows, 0 where absent, and each face's corner count."""
    rows = [line for line in lines if line[:2] in (b"f ", b"f\t")]
    words = [line[2:].split() for line in rows]
    sizes = np.array([len(word) for word in words], dtype=np.int64)
    flat = [token for word in words for token in word]
    if len(flat) > 4 * MAX_TRIANGLES:
        raise InputError(f"{path}: too many faces")
    try:
        corners = _like_corners(b" ".join(flat), len(flat))
        if corners is None:
            corners = np.array(_any_corners(lines), dtype=np.int64).reshape(-1, 3)
        return corners, sizes
    except (ValueError, OverflowError) as error:
        raise InputError(f"{path}: a damaged face ({error})") from None


def _like_corners(text: bytes, count: int) -> Ints | None:
    """`count` corners, words in `text`, if all are written alike and none is negative."""
    if not count or b"-" in text:
        return None
    slash, space = b"/ "
    letters = np.frombuffer(text + b" ", np.uint8)
    marks = letters[(letters == slash) | (letters == space)]
    slashes = np.diff(np.cumsum(marks == slash)[marks == space], prepend=0)
    form = (int(slashes.min()), int(slashes.max()), text.count(b"//"))
    present = {(0, 0, 0): [0], (1, 1, 0): [0, 1], (2, 2, 0): [0, 1, 2], (2, 2, count): [0, 2]}
    if form not in present:
        return None
    columns = present[form]
    values = np.array(text.replace(b"/", b" ").split(), dtype=np.int64)
    if values.size != count * len(columns):
        return None
    corners = np.zeros((count, 3), dtype=np.int64)
    corners[:, columns] = values.reshape(count, -1)
    return corners


def _any_corners(lines: list[bytes]) -> list[list[int]]:
    """The general case: absent indices and negative ones, which count back from the last."""
    counts = {b"v": 0, b"vt": 0, b"vn": 0}
    corners = []
    for line in lines:
        words = line.split()
        if not words:
            continue
        if words[0] in counts:
            counts[words[0]] += 1
        elif words[0] == b"f":
            for token in words[1:]:
                parts = [int(part) if part else 0 for part in token.split(b"/")][:3]
                parts += [0] * (3 - len(parts))
                corners.append(
                    [
                        part + 1 + total if part < 0 else part
                        for part, total in zip(parts, counts.values(), strict=True)
                    ]
                )
    return corners


_PLY_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1",
    "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip

PlyProperty = tuple[str, str, str | None]  # name, value type, type of the count for lists
PlyElement = tuple[str, int, list[PlyProperty]]


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
            raise InputError(f"{path}: a damaged PLY header line: {line!r}") from None
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
    except (ValueError, IndexError):
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
        # The usual case: every list holds three indices, so that rows have one size.
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
    """Faces with any number of corners, one by one."""
    triangles: dict[str, list] = {column: [] for column, _, counter in properties if counter}
    try:
        for _ in range(count):
            for column, kind, counter in properties:
                length = 1
                if counter:
                    length = int(np.frombuffer(data, order + counter, 1, at)[0])
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


def _corner_angle(corners: Floats, corner: int) -> Floats:
    here = corners[:, corner]
    one = _unit(corners[:, (corner + 1) % 3] - here)
    two = _unit(corners[:, (corner + 2) % 3] - here)
    return np.arccos(np.clip((one * two).sum(axis=1), -1, 1))


def _unit(vectors: Floats) -> Floats:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    fallback = np.zeros_like(vectors)
    fallback[..., 2] = 1.0
    return np.where(length > 1e-20, vectors / np.maximum(length, 1e-20), fallback)
