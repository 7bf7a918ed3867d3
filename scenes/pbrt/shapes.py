"""Shapes of a pbrt scene as triangle meshes with materials, in the world of `reader`.

Texture coordinates are turned over: pbrt's v = 0 is the bottom row of an image, the mesh's the top.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from pbrnet.scenes.arrays import Float64Array, Int64Array
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.formats.ply import read_ply
from pbrnet.scenes.geometry import primitives
from pbrnet.scenes.geometry.mesh import Mesh, cleaned, face_areas, smooth_normals
from pbrnet.scenes.importing.materials.surface import Surface
from pbrnet.scenes.importing.names import Names
from pbrnet.scenes.importing.sandbox import missing_meshes
from pbrnet.scenes.importing.shape import MAX_SCENE_TRIANGLES, Shape
from pbrnet.scenes.importing.xml_elements import plugin
from pbrnet.scenes.pbrt.materials import Materials
from pbrnet.scenes.pbrt.reader import PlacedShape
from pbrnet.scenes.pbrt.values import Context, Entity

_BLACK = (0.0, 0.0, 0.0)
_DROPPED = (
    "curve", "cone", "paraboloid", "hyperboloid", "heightfield", "heightfield2", "nurbs"
)  # fmt: skip


@dataclass
class ShapeReader:
    """Reads shapes; every PLY file is read once."""

    context: Context
    materials: Materials
    skip_missing: bool = False
    _names: Names = field(default_factory=Names)
    _missing: dict[str, Entity] = field(default_factory=dict)  # name of a mesh -> first shape
    _files: dict[Path, Mesh] = field(default_factory=dict)
    _meshes: dict[int, Mesh | None] = field(default_factory=dict)  # by `id` of the shape's entity

    def read(self, placed: list[PlacedShape]) -> list[Shape]:
        """Translate shapes in file order; what cannot be kept is noted.

        All are counted first, as instances take no memory before they are placed.
        """
        triangles = 0
        for one in placed:
            mesh = self._shared(one.shape)
            triangles += 0 if mesh is None else len(mesh.faces)
            if triangles > MAX_SCENE_TRIANGLES:
                raise InputError(
                    f"{one.shape.place}: the scene has more than the limit of "
                    f"{MAX_SCENE_TRIANGLES:,} triangles"
                )
        shapes: list[Shape] = []
        if self.skip_missing or not self._missing:
            shapes = [shape for one in placed if (shape := self._shape(one)) is not None]
        if self._missing and not shapes:
            first = next(iter(self._missing.values()))
            raise first.error(missing_meshes(list(self._missing), self.skip_missing))
        return shapes

    def _shape(self, placed: PlacedShape) -> Shape | None:
        entity = placed.shape
        local = self._shared(entity)
        if local is None:
            return None
        label = self._label(placed)
        mesh, _ = cleaned(local.transformed(placed.to_world), f"{entity.place}: {label}")
        if not len(mesh.faces):
            self.context.changes.note("a shape without area was left out: {}", label)
            return None
        if placed.reversed:
            mesh = mesh.flipped()
        surface, area = self.materials.surface(placed.material, entity), placed.area
        if surface.invisible and area is not None:
            self.context.changes.note("an emitting shape without material became matt black")
            black = plugin("bsdf", "twosided", bsdf=plugin("bsdf", "diffuse", reflectance=_BLACK))
            surface = Surface(black, double=True)
        name = f"{placed.instance}_{label}" if placed.instance else label
        shape = Shape(self._names.unique(name), label, mesh, surface, area)
        if entity.type == "sphere" and area is not None:
            return replace(
                shape,
                sphere=self._sphere(entity, placed.to_world),
                inside_out=placed.reversed,
            )
        return shape

    def _shared(self, entity: Entity) -> Mesh | None:
        """The mesh of a shape in its own frame, read once for all its instances."""
        if id(entity) not in self._meshes:
            self._meshes[id(entity)] = self._local(entity)
        return self._meshes[id(entity)]

    def _label(self, placed: PlacedShape) -> str:
        """Name of the mesh file, else of the material, else the type of shape."""
        name = placed.shape.text("filename").replace("\\", "/").rpartition("/")[2]
        stem = name.partition(".")[0]
        if stem:
            return stem
        if placed.material is not None and placed.material.label:
            return placed.material.label
        return placed.shape.type

    def _local(self, entity: Entity) -> Mesh | None:
        """The mesh in the shape's own frame; None, with a note, if it is left out."""
        if entity.type in _DROPPED:
            self.context.changes.note(
                "a shape of unsupported type was left out: {}", repr(entity.type)
            )
            return None
        known = {
            "trianglemesh": self._triangle_mesh,
            "loopsubdiv": self._subdivision_cage,
            "bilinearmesh": self._bilinear_mesh,
            "plymesh": self._ply,
            "sphere": self._sphere_mesh,
            "disk": self._disk,
            "cylinder": self._cylinder,
        }.get(entity.type)
        if known is None:
            raise entity.error("unknown type of shape")
        mesh = known(entity)
        entity.ignore("alpha", "shadowalpha", "discarddegenerateUVs", "edgelength", "displacement")
        entity.report_unused()
        if mesh is None:
            return None
        mesh, dropped = cleaned(mesh, entity.place)
        if dropped:
            self.context.changes.note("triangles without area were left out of {}", entity.place)
        return _facing_normals(mesh)

    def _triangle_mesh(self, entity: Entity) -> Mesh:
        points = _points(entity)
        indices = entity.numbers("indices")
        if indices is None:
            if len(points) != 3:
                raise entity.error("indices are missing")
            indices = np.arange(3.0)
        faces = _faces(entity, indices, 3, len(points))
        entity.ignore("S", "faceIndices")
        return Mesh(points, faces, _per_vertex(entity, ("N",), 3, points), _uvs(entity, points))

    def _subdivision_cage(self, entity: Entity) -> Mesh:
        points, indices = _points(entity), entity.numbers("indices")
        faces = _faces(entity, np.zeros(0) if indices is None else indices, 3, len(points))
        entity.ignore("levels", "nlevels", "scheme")
        self.context.changes.note(
            "a subdivision surface was replaced by its control mesh, smoothed"
        )
        return Mesh(points, faces, smooth_normals(points, faces))

    def _bilinear_mesh(self, entity: Entity) -> Mesh:
        """Bilinear patches as two triangles each; the corners of a patch are in rows."""
        points, indices = _points(entity), entity.numbers("indices")
        quads = _faces(entity, np.arange(4.0) if indices is None else indices, 4, len(points))
        faces = quads[:, [0, 1, 3, 0, 3, 2]].reshape(-1, 3)
        entity.ignore("faceIndices", "emissionfilename")
        return Mesh(points, faces, _per_vertex(entity, ("N",), 3, points), _uvs(entity, points))

    def _ply(self, entity: Entity) -> Mesh | None:
        name = entity.text("filename")
        path = self.context.sandbox.find(name, entity.place) if name else None
        if path is None:
            self._missing.setdefault(name, entity)
            self.context.changes.note("missing mesh, its shape was left out: {}", repr(name)[:200])
            return None
        if path not in self._files:
            try:
                mesh = read_ply(path)
            except InputError as error:
                raise InputError(f"{entity.place}: {error}") from None
            self._files[path] = replace(mesh, uvs=_turned_over(mesh.uvs))
        return self._files[path]

    def _sphere_mesh(self, entity: Entity) -> Mesh:
        radius = _radius(entity)
        if entity.number("zmin", -radius) > -radius or entity.number("zmax", radius) < radius:
            self.context.changes.note("a part of a sphere was replaced by the whole sphere")
        entity.ignore("phimax")
        return primitives.sphere().transformed(np.diag([radius, radius, radius, 1.0]))

    def _sphere(self, entity: Entity, to_world: Float64Array) -> Float64Array | None:
        """The map (4, 4) of the unit sphere; None if the transform stretches the sphere."""
        radius = _radius(entity)
        matrix = to_world @ np.diag([radius, radius, radius, 1.0])
        if np.linalg.det(matrix[:3, :3]) < 0:
            matrix = matrix @ np.diag([-1.0, 1, 1, 1])
        gram = matrix[:3, :3].T @ matrix[:3, :3]
        if np.allclose(gram, gram[0, 0] * np.eye(3), rtol=1e-4, atol=1e-4 * gram[0, 0]):
            return matrix
        return None

    def _disk(self, entity: Entity) -> Mesh:
        radius = _radius(entity)
        if entity.number("innerradius", 0.0) > 0:
            self.context.changes.note("the hole of a disk was left out")
        entity.ignore("phimax")
        place = np.diag([radius, radius, 1.0, 1.0])
        place[2, 3] = entity.number("height", 0.0)
        mesh = primitives.disk().transformed(place)
        assert mesh.uvs is not None
        return replace(mesh, uvs=mesh.uvs[:, ::-1])  # u is the angle

    def _cylinder(self, entity: Entity) -> Mesh:
        low, high = entity.number("zmin", -1.0), entity.number("zmax", 1.0)
        if low == high:
            raise entity.error("zmin and zmax are equal")
        entity.ignore("phimax")
        axis = np.array([0.0, 0.0, 1.0])
        mesh = primitives.cylinder(min(low, high) * axis, max(low, high) * axis, _radius(entity))
        return replace(mesh, uvs=_turned_over(mesh.uvs))


def _radius(entity: Entity) -> float:
    radius = entity.number("radius", 1.0)
    if radius <= 0:
        raise entity.error("the radius must be positive")
    return radius


def _points(entity: Entity) -> Float64Array:
    points = entity.numbers("P", 3)
    if points is None or len(points) < 3:
        raise entity.error("points P are missing")
    return points


def _faces(entity: Entity, indices: Float64Array, corners: int, count: int) -> Int64Array:
    """Faces (F, corners) of indices into `count` points."""
    if not len(indices) or len(indices) % corners:
        raise entity.error(f"needs a multiple of {corners} indices")
    if indices.min() < 0 or indices.max() >= count:
        raise entity.error("a face refers to a vertex that does not exist")
    return indices.astype(np.int64).reshape(-1, corners)


def _per_vertex(
    entity: Entity, names: tuple[str, ...], width: int, points: Float64Array
) -> Float64Array | None:
    """Values (V, width) of the first of these parameters that is there."""
    for name in names:
        values = entity.numbers(name, width)
        if values is not None:
            if len(values) != len(points):
                raise entity.error(f"has {len(points)} points but {len(values)} values of {name}")
            return values
    return None


def _uvs(entity: Entity, points: Float64Array) -> Float64Array | None:
    return _turned_over(_per_vertex(entity, ("uv", "st"), 2, points))


def _turned_over(uvs: Float64Array | None) -> Float64Array | None:
    return None if uvs is None else np.column_stack([uvs[:, 0], 1 - uvs[:, 1]])


def _facing_normals(mesh: Mesh) -> Mesh:
    """The mesh with each face on the side of its vertices' normals, as pbrt takes them."""
    if mesh.normals is None:
        return mesh
    _, facing = face_areas(mesh.corners)
    behind = (facing * mesh.normals[mesh.faces].sum(axis=1)).sum(axis=1) < 0
    if not behind.any():
        return mesh
    return replace(mesh, faces=np.where(behind[:, None], mesh.faces[:, ::-1], mesh.faces))
