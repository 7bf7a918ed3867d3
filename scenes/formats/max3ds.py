"""Reader of 3D Studio models (`.3ds`): chunks of id, length and content, little-endian, Z up.

Format: "3D Studio File Format" (Autodesk, 1997). As in Sweet Home 3D, vertices are transformed by
the inverse of the mesh's frame and then by the first frame of the keyframer, if there is one.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from pbrnet.scenes.arrays import Float64Array, Int64Array
from pbrnet.scenes.formats.model_parts import (
    MAX_TRIANGLES,
    Model,
    ModelMaterial,
    ModelPart,
    UnreadableModel,
    check_points,
    make_part,
)
from pbrnet.scenes.geometry.mesh import Mesh, face_areas

_MAIN, _EDITOR, _KEYFRAMER = 0x4D4D, 0x3D3D, 0xB000
_CREASE = 89.0  # degrees, for faces without smoothing groups
_SHINE = 0.6  # of the application's largest exponent, at a shininess of 100 %
_DEPTH = 64  # of nested nodes
_MOST_PLACES = 10_000  # of all meshes together
_FLAGS = 18  # bytes of a track before the flags of its first key; the values follow
_DUMMY = "$$$DUMMY"  # name of nodes without a mesh
# From Z up to the application's axes, y up and z to the front.
_UPRIGHT = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


@dataclass
class _Object:
    """A mesh as in the file; `frame` (4, 4) is its local frame in the world."""

    name: str
    vertices: Float64Array = field(default_factory=lambda: np.zeros((0, 3)))
    uvs: Float64Array = field(default_factory=lambda: np.zeros((0, 2)))
    faces: Int64Array = field(default_factory=lambda: np.zeros((0, 3), dtype=np.int64))
    materials: list[tuple[str, Int64Array]] = field(default_factory=list)  # name -> faces
    smoothing: Int64Array | None = None  # (F,), one bit per group
    frame: Float64Array = field(default_factory=lambda: np.eye(4))


@dataclass
class _Node:
    """A keyframer node: the pose of the object `name` in the first frame."""

    name: str = ""
    parent: int = -1
    place: Float64Array = field(default_factory=lambda: np.eye(4))


def read_3ds(data: bytes, find: Callable[[str], str | None]) -> Model:
    """Read the model in a 3DS file; `find` returns the member for the name of an image, or None.

    Raises `UnreadableModel` for damaged, empty or too large files.
    """
    materials: dict[str, ModelMaterial] = {}
    objects: list[_Object] = []
    nodes: list[_Node] = []
    try:
        for top, content in _chunks(_first(data)):
            if top == _EDITOR:
                for kind, inner in _chunks(content):
                    if kind == 0xAFFF:
                        name, material = _material(inner, find)
                        materials[name] = material
                    elif kind == 0x4000:
                        objects += _objects(inner)
            elif top == _KEYFRAMER:
                nodes = [_node(inner) for kind, inner in _chunks(content) if kind == 0xB002]
    except (struct.error, ValueError, IndexError) as error:
        raise UnreadableModel(f"damaged 3DS file ({error})") from None
    parts: list[ModelPart] = []
    triangles = 0
    places = _places(nodes)
    for mesh_object in objects:
        for place in places.get(mesh_object.name, [np.eye(4)]):
            triangles += len(mesh_object.faces)
            if triangles > MAX_TRIANGLES or len(parts) > _MOST_PLACES:
                raise UnreadableModel(f"more than {MAX_TRIANGLES:,} triangles")
            parts += _parts(mesh_object, _UPRIGHT @ place, materials)
    if not parts:
        raise UnreadableModel("no faces in it")
    return Model(tuple(parts))


def _first(data: bytes) -> bytes:
    """Return the content of the main chunk; raises `UnreadableModel`."""
    kind, length = struct.unpack_from("<HI", data)
    if kind != _MAIN or not 6 <= length <= len(data):
        raise UnreadableModel(f"damaged 3DS file ({len(data):,} bytes of {length:,})")
    return data[6:length]


def _chunks(content: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield kind and content of each chunk; ValueError if one is longer than its parent."""
    start = 0
    while start + 6 <= len(content):
        kind, length = struct.unpack_from("<HI", content, start)
        if length < 6 or start + length > len(content):
            raise ValueError(f"a chunk {kind:#06x} of {length:,} bytes")
        yield kind, content[start + 6 : start + length]
        start += length


def _text(content: bytes) -> tuple[str, bytes]:
    """Split off a zero-terminated text; returns it and the rest."""
    text, zero, rest = content.partition(b"\0")
    if not zero:
        raise ValueError("a name without a terminating zero")
    return text.decode("latin-1"), rest


def _table(content: bytes, kind: str, columns: int) -> tuple[np.ndarray, bytes]:
    """Split off a table (N, columns) that begins with its count; returns it and the rest."""
    (count,) = struct.unpack_from("<H", content)
    end = 2 + np.dtype(kind).itemsize * columns * count
    if end > len(content):
        raise ValueError("a table longer than its chunk")
    table = np.frombuffer(content, kind, columns * count, 2).reshape(-1, columns)
    return table, content[end:]


def _material(content: bytes, find: Callable[[str], str | None]) -> tuple[str, ModelMaterial]:
    name, made, shine, highlight = "", ModelMaterial(), None, 0.0
    for kind, inner in _chunks(content):
        if kind == 0xA000:
            name, _ = _text(inner)
        elif kind == 0xA020:
            red, green, blue = _color(inner)
            made = replace(made, color=(red, green, blue))
        elif kind == 0xA030:
            highlight = sum(_color(inner)) / 3
        elif kind == 0xA040:
            shine = _share(inner)
        elif kind == 0xA050:
            made = replace(made, opacity=1 - _share(inner))
        elif kind == 0xA200:
            for one, text in _chunks(inner):
                if one == 0xA300 and text.strip(b"\0 "):
                    made = replace(made, image=find(_text(text)[0]))
    if shine:
        made = replace(made, highlight=highlight * shine, exponent=128 * _SHINE * shine)
    return name, made


def _color(content: bytes) -> tuple[float, ...]:
    """Return an sRGB colour in [0, 1] from bytes or floats."""
    for kind, inner in _chunks(content):
        values = None
        if kind in (0x0011, 0x0012):
            values = [value / 255 for value in struct.unpack_from("<3B", inner)]
        elif kind in (0x0010, 0x0013):
            values = list(struct.unpack_from("<3f", inner))
        if values is not None and np.isfinite(values).all():
            return tuple(min(max(value, 0.0), 1.0) for value in values)
    raise ValueError("a material's colour without values")


def _share(content: bytes) -> float:
    """Return a percentage as a fraction in [0, 1]."""
    for kind, inner in _chunks(content):
        if kind == 0x0030:
            return min(max(struct.unpack_from("<h", inner)[0] / 100, 0.0), 1.0)
        if kind == 0x0031:
            value = struct.unpack_from("<f", inner)[0]
            return min(max(value / 100, 0.0), 1.0) if np.isfinite(value) else 0.0
    return 0.0


def _objects(content: bytes) -> list[_Object]:
    """Return the meshes of a named object; none for lights and cameras."""
    name, rest = _text(content)
    return [_mesh(name, inner) for kind, inner in _chunks(rest) if kind == 0x4100]


def _mesh(name: str, content: bytes) -> _Object:
    made = _Object(name)
    for kind, inner in _chunks(content):
        if kind == 0x4110:
            made.vertices = _table(inner, "<f4", 3)[0].astype(np.float64)
            check_points(made.vertices)
        elif kind == 0x4140:
            made.uvs = _table(inner, "<f4", 2)[0].astype(np.float64)
        elif kind == 0x4160:
            axes = np.array(struct.unpack_from("<12f", inner), dtype=np.float64).reshape(4, 3)
            if np.isfinite(axes).all() and abs(np.linalg.det(axes[:3])) > 1e-12:
                made.frame[:3, :] = axes.T
        elif kind == 0x4120:
            table, rest = _table(inner, "<u2", 4)
            made.faces = table[:, :3].astype(np.int64)
            for one, more in _chunks(rest):
                if one == 0x4130:
                    material, list_of_faces = _text(more)
                    chosen = _table(list_of_faces, "<u2", 1)[0][:, 0].astype(np.int64)
                    made.materials.append((material, chosen[chosen < len(table)]))
                elif one == 0x4150 and len(more) >= 4 * len(table):
                    made.smoothing = np.frombuffer(more, "<u4", len(table)).astype(np.int64)
    return made


def _node(content: bytes) -> _Node:
    made = _Node()
    place, turn, size, pivot = np.eye(4), np.eye(4), np.ones(3), np.eye(4)
    for kind, inner in _chunks(content):
        if kind == 0xB010:
            made.name, rest = _text(inner)
            made.parent = struct.unpack_from("<2Hh", rest)[2]
        elif kind == 0xB013:
            pivot[:3, 3] = [-value for value in struct.unpack_from("<3f", inner)]
        elif kind == 0xB020:
            place[:3, 3] = _key(inner, 3)
        elif kind == 0xB021:
            angle, *axis = _key(inner, 4)
            turn[:3, :3] = _rotation(-angle, np.array(axis))
        elif kind == 0xB022:
            size = np.array(_key(inner, 3))
    if not all(np.isfinite(one).all() for one in (place, turn, size, pivot)):
        raise ValueError("a node with a pose that is not finite")
    made.place = place @ turn @ np.diag([*size, 1.0])
    if made.name != _DUMMY:
        made.place = made.place @ pivot
    return made


def _key(content: bytes, count: int) -> tuple[float, ...]:
    """Return the first values of a track; its flags tell how many spline values precede them."""
    (flags,) = struct.unpack_from("<H", content, _FLAGS)
    return struct.unpack_from(f"<{count}f", content, _FLAGS + 2 + 4 * (flags & 31).bit_count())


def _rotation(angle: float, axis: Float64Array) -> Float64Array:
    """Return the rotation (3, 3) about `axis` (Rodrigues); identity for a zero axis."""
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        return np.eye(3)
    x, y, z = axis / length
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross)


def _places(nodes: list[_Node]) -> dict[str, list[Float64Array]]:
    """Return the poses (4, 4) of each object, one for each keyframer node of its name."""
    made: dict[str, list[Float64Array]] = {}
    for node in nodes:
        matrix, parent = node.place, node.parent
        for _ in range(_DEPTH):
            if not 0 <= parent < len(nodes):
                break
            matrix, parent = nodes[parent].place @ matrix, nodes[parent].parent
        made.setdefault(node.name, []).append(matrix)
    return made


def _parts(
    mesh_object: _Object, place: Float64Array, materials: dict[str, ModelMaterial]
) -> Iterator[ModelPart]:
    """Yield the parts of a mesh by material, transformed by `place`."""
    corners = np.stack([mesh_object.faces] * 3, axis=-1)  # one index for positions, uvs, normals
    normals = np.zeros((0, 3))
    if mesh_object.smoothing is not None and len(mesh_object.faces):
        if mesh_object.faces.max() >= len(mesh_object.vertices):
            raise UnreadableModel("a face refers to a vertex that does not exist")
        normals = _smoothed(mesh_object)
        corners[:, :, 2] = np.arange(corners.shape[0] * 3).reshape(-1, 3)
    owner = np.full(len(mesh_object.faces), -1)
    for number, (_, faces) in enumerate(mesh_object.materials):
        owner[faces] = number
    matrix = place @ np.linalg.inv(mesh_object.frame)
    for number in range(-1, len(mesh_object.materials)):
        name = mesh_object.materials[number][0] if number >= 0 else "default"
        part = make_part(
            mesh_object.name,
            name,
            materials.get(name, ModelMaterial()),
            corners[owner == number],
            mesh_object.vertices,
            mesh_object.uvs,
            normals,
            _CREASE,
        )
        if part is not None and abs(np.linalg.det(matrix[:3, :3])) > 1e-15:
            mesh = part.mesh.transformed(matrix)
            check_points(mesh.vertices)
            yield replace(part, mesh=mesh)


def _smoothed(mesh_object: _Object) -> Float64Array:
    """Return normals (3 F, 3) of all corners: smooth among faces of one smoothing group."""
    assert mesh_object.smoothing is not None
    areas, normals = face_areas(Mesh(mesh_object.vertices, mesh_object.faces).corners)
    weighted = areas[:, None] * normals
    made = np.zeros((len(mesh_object.faces), 3, 3))
    for bit in range(32):
        members = (mesh_object.smoothing >> bit) & 1 == 1
        if not members.any():
            continue
        sums = np.zeros_like(mesh_object.vertices)
        for corner in range(3):
            np.add.at(sums, mesh_object.faces[members][:, corner], weighted[members])
        made[members] += sums[mesh_object.faces[members]]
    length = np.linalg.norm(made, axis=2, keepdims=True)
    return np.where(length > 1e-12, made, normals[:, None]).reshape(-1, 3)
