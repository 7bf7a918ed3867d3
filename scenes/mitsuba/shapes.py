"""Shape elements of a Mitsuba scene as shapes in the file's world space.

Mesh files are read, instances are expanded to shapes of their own, and ids are made unique.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.formats.obj import distinct_rows, read_obj
from pbrnet.scenes.formats.ply import read_ply
from pbrnet.scenes.formats.serialized import read_serialized
from pbrnet.scenes.geometry import primitives
from pbrnet.scenes.geometry.mesh import Mesh, cleaned, creased, smooth_normals
from pbrnet.scenes.importing.categories import category_of, has_structural_name
from pbrnet.scenes.importing.materials.mtl import MtlLibrary
from pbrnet.scenes.importing.materials.surface import Surface
from pbrnet.scenes.importing.names import Names
from pbrnet.scenes.importing.sandbox import missing_meshes
from pbrnet.scenes.importing.shape import MAX_SCENE_TRIANGLES, MAX_SHAPES, Shape
from pbrnet.scenes.mitsuba.materials import Materials
from pbrnet.scenes.mitsuba.reader import Node
from pbrnet.scenes.mitsuba.values import Properties, Scope

_MAX_GROUP_DEPTH = 8
_FILES = ("obj", "ply", "serialized")
_DROPPED = ("hair", "heightfield", "bsplinecurve", "linearcurve", "sdfgrid", "ellipsoids",
            "ellipsoidsmesh", "deformable", "blender")  # fmt: skip


@dataclass
class ShapeReader:
    """Reads the shapes of a scene; every mesh file is read once."""

    scope: Scope
    materials: Materials
    skip_missing: bool = False
    shapes: list[Shape] = field(default_factory=list)
    _names: Names = field(default_factory=Names)
    _cache: dict[tuple, Mesh] = field(default_factory=dict)
    _missing: dict[str, Node] = field(default_factory=dict)  # name of a mesh -> its first shape
    _triangles: int = 0

    def read(self, nodes: list[Node]) -> list[Shape]:
        """Read all shapes of `nodes`; shape groups are read through their instances."""
        shown = [node for node in nodes if node.tag == "shape" and node.type != "shapegroup"]
        # Counted first, because nested groups multiply the number of shapes.
        sizes: dict[int, int] = {}
        if sum(self._expanded_count(node, 0, sizes) for node in shown) > MAX_SHAPES:
            raise nodes[0].error(
                f"instances expand to more than the limit of {MAX_SHAPES:,} shapes"
            )
        for node in shown:
            self._add(node, np.eye(4), 0, None)
        if self._missing and not (self.skip_missing and self.shapes):
            first = next(iter(self._missing.values()))
            raise first.error(missing_meshes(list(self._missing), self.skip_missing))
        return self.shapes

    def _expanded_count(self, node: Node, depth: int, sizes: dict[int, int]) -> int:
        """The number of shapes that `node` expands to; `sizes` caches it by element."""
        if depth > _MAX_GROUP_DEPTH:
            raise node.error("instances are nested too deep or inside themselves")
        if node.type not in ("instance", "merge", "shapegroup"):
            return 1
        if id(node) not in sizes:
            members = [self.scope.resolve(child) for child in node.children if child.tag in
                       ("ref", "shape")]  # fmt: skip
            deeper = depth + (node.type == "instance")
            sizes[id(node)] = sum(
                self._expanded_count(member, deeper, sizes)
                for member in members
                if member.tag == "shape"
            )
        return sizes[id(node)]

    def _add(self, node: Node, above: Float64Array, depth: int, prefix: str | None) -> None:
        """Add the shapes of an element, transformed by `above` (4, 4).

        `prefix` is the label of the instance that contains it.
        """
        if depth > _MAX_GROUP_DEPTH:
            raise node.error("instances are nested too deep or inside themselves")
        properties = Properties(node, self.scope)
        properties.ignore("id")
        to_world = above @ properties.transform()
        if node.type == "instance":
            groups = properties.nested("shape")
            if not groups:
                raise node.error("an instance needs a shape group")
            label = node.attributes.get("id", "instance")
            for group in groups:
                first = len(self.shapes)
                for member in group.children:
                    target = self.scope.resolve(member)
                    if target.tag == "shape":
                        self._add(target, to_world, depth + 1, label)
                names = (node.attributes.get("id", ""), group.attributes.get("id", ""))
                self.shapes[first:] = [_named(shape, names) for shape in self.shapes[first:]]
            self.scope.changes.note("an instance was expanded to shapes of its own")
            properties.report_unused()
            return
        if node.type == "merge":
            for member in properties.nested("shape"):
                self._add(member, to_world, depth + 1, prefix)
            return
        if node.type in _DROPPED:
            self.scope.changes.note("a shape of unsupported type was left out: {}", repr(node.type))
            return
        self._add_one(node, properties, to_world, prefix)

    def _add_one(
        self, node: Node, properties: Properties, to_world: Float64Array, prefix: str | None
    ) -> None:
        meshes = self._obj_parts(node, properties)
        if meshes is None:
            made = self._geometry(node, properties)
            if made is None:
                return
            meshes = [(*made, None)]
        for mesh, label, surface in meshes:
            self._add_mesh(node, properties, to_world, prefix, mesh, label, surface)

    def _add_mesh(
        self,
        node: Node,
        properties: Properties,
        to_world: Float64Array,
        prefix: str | None,
        mesh: Mesh,
        label: str,
        surface: Surface | None,
    ) -> None:
        changes = self.scope.changes
        flip = properties.boolean("flip_normals", False)
        sphere = self._sphere(node, properties, to_world) if node.type == "sphere" else None
        mesh = mesh.transformed(to_world)
        mesh, dropped = cleaned(mesh, f"{node.place}: {label}")
        if dropped:
            changes.note("triangles without area were left out of {}", label)
        if not len(mesh.faces):
            changes.note("a shape without area was left out: {}", label)
            return
        self._triangles += len(mesh.faces)
        if self._triangles > MAX_SCENE_TRIANGLES or len(self.shapes) >= MAX_SHAPES:
            raise InputError(
                f"{node.place}: the scene has more than the limit of {MAX_SCENE_TRIANGLES:,} "
                f"triangles or {MAX_SHAPES:,} shapes"
            )
        if flip:
            mesh = mesh.flipped()
        bsdfs, emitters = properties.nested("bsdf"), properties.nested("emitter", "luminaire")
        if surface is None:
            if len(bsdfs) > 1:
                changes.note("a shape has several materials; only the first was kept")
            surface = self.materials.surface(bsdfs[0] if bsdfs else None)
        name = node.attributes.get("id") or label
        for tag in ("interior", "exterior"):
            if tag in properties:
                properties.ignore(tag)
                changes.note("participating media were left out")
        properties.report_unused()
        self.shapes.append(
            Shape(
                self._names.unique(f"{prefix}_{name}" if prefix else name),
                name,
                mesh,
                surface,
                emitters[0] if emitters else None,
                sphere,
                flip,
            )
        )

    def _obj_parts(
        self, node: Node, properties: Properties
    ) -> list[tuple[Mesh, str, Surface | None]] | None:
        """Split an OBJ by material, as Mitsuba 0.x does: mesh, label and surface of each part.

        Materials are those of the OBJ's libraries; nested BSDFs with a name replace them. None
        if the OBJ is one shape.
        """
        named = {
            child.name: self.scope.resolve(child)
            for child in node.children
            if child.name and self.scope.resolve(child).tag == "bsdf"
        }
        plain = [found for found in properties.nested("bsdf") if found not in named.values()]
        if node.type != "obj" or not self.scope.is_old or (plain and not named):
            return None
        path = self.scope.sandbox.find(properties.text("filename", ""), node.place)
        if path is None:
            return None
        try:
            found = read_obj(path)
        except InputError as error:
            raise InputError(f"{node.place}: {error}") from None
        materials = [run.material for run in found.runs]
        wanted = properties.boolean("load_materials", True) and found.libraries
        if not any(materials) or not (wanted or named):
            return None
        library = MtlLibrary(
            path, self.scope.sandbox, self.materials.textures.store, self.scope.changes
        )
        if wanted:
            library.load(found.libraries)
        distinct = list(dict.fromkeys(materials))
        part_of = np.array([distinct.index(material) for material in materials])
        try:
            parts = {
                part: found.mesh(faces) for part, faces in distinct_rows(part_of[found.run_of_face])
            }
        except InputError as error:
            raise InputError(f"{node.place}: {error}") from None
        meshes: list[tuple[Mesh, str, Surface | None]] = []
        for part, mesh in parts.items():
            name = distinct[part]
            if name in named:
                surface: Surface | None = self.materials.surface(named[name])
            elif plain or name not in library.materials:
                surface = self.materials.surface(plain[0] if plain else None)
            else:
                surface = library.material(name).surface
            shaped = self._with_normals(node, properties, mesh)
            meshes.append((shaped, f"{path.stem}_{name}" if name else path.stem, surface))
        return meshes

    def _geometry(self, node: Node, properties: Properties) -> tuple[Mesh, str] | None:
        """The mesh in the shape's local frame and a label; None if the shape is left out."""
        kind = node.type
        if kind in _FILES:
            return self._file(node, properties)
        label = f"{kind}_{len(self.shapes)}"
        if kind == "rectangle":
            return primitives.rectangle(), label
        if kind == "cube":
            return primitives.cube(), label
        if kind == "disk":
            self.scope.changes.note(f"a disk was replaced by a mesh with {primitives.SIDES} sides")
            return primitives.disk(), label
        if kind == "sphere":
            return primitives.sphere().transformed(_sphere_frame(properties)), label
        if kind == "cylinder":
            start, end = properties.vector("p0"), properties.vector("p1")
            start = np.zeros(3) if start is None else start
            end = np.array([0.0, 0, 1]) if end is None else end
            radius = properties.number("radius", 1.0)
            if radius <= 0 or np.array_equal(start, end):
                raise node.error("a cylinder needs a length and a positive radius")
            self.scope.changes.note(
                f"a cylinder was replaced by a mesh with {primitives.SIDES} sides"
            )
            return primitives.cylinder(start, end, radius), label
        raise node.error(f"unknown type of shape {kind!r}")

    def _file(self, node: Node, properties: Properties) -> tuple[Mesh, str] | None:
        name = properties.text("filename", "")
        index = properties.whole("shape_index", 0)
        path = self.scope.sandbox.find(name, node.place)
        if path is None:
            self._missing.setdefault(name, node)
            self.scope.changes.note("missing mesh, its shape was left out: {}", repr(name))
            return None
        properties.ignore("collapse", "srgb")
        flip_v = properties.boolean("flip_tex_coords", node.type == "obj")
        mesh = self._read(node, path, index, flip_v)
        mesh = self._with_normals(node, properties, mesh)
        stem = path.stem if node.type != "serialized" else f"{path.stem}_{index}"
        return mesh, stem

    def _with_normals(self, node: Node, properties: Properties, mesh: Mesh) -> Mesh:
        """The mesh with shading normals as its element defines them."""
        facets = properties.boolean("face_normals", False)
        crease = properties.number("max_smooth_angle", 180.0)
        if facets:
            mesh = replace(mesh, normals=None)
        elif "max_smooth_angle" in properties and crease < 180:
            mesh = creased(mesh, crease)
        elif mesh.normals is None and node.type != "serialized":
            mesh = replace(mesh, normals=smooth_normals(mesh.vertices, mesh.faces))
        return mesh

    def _read(self, node: Node, path: Path, index: int, flip_v: bool) -> Mesh:
        key = (path, index, flip_v, node.type)
        if key not in self._cache:
            try:
                if node.type == "obj":
                    mesh = read_obj(path).mesh(flip_v=flip_v)
                elif node.type == "ply":
                    mesh = read_ply(path)
                else:
                    mesh = read_serialized(path, index)
            except OSError as error:
                raise node.error(f"{path} cannot be read ({error})") from None
            except InputError as error:
                raise InputError(f"{node.place}: {error}") from None
            if node.type != "obj" and flip_v and mesh.uvs is not None:
                mesh = replace(mesh, uvs=np.column_stack([mesh.uvs[:, 0], 1 - mesh.uvs[:, 1]]))
            # Checked in the file's own coordinates, before any arithmetic on them.
            self._cache[key], dropped = cleaned(mesh, f"{node.place}: {path.name}")
            if dropped:
                self.scope.changes.note("triangles without area were left out of {}", path.name)
        return self._cache[key]

    def _sphere(
        self, node: Node, properties: Properties, to_world: Float64Array
    ) -> Float64Array | None:
        """The map (4, 4) of the unit sphere; None if the transform stretches the sphere."""
        matrix = to_world @ _sphere_frame(properties)
        gram = matrix[:3, :3].T @ matrix[:3, :3]
        if np.allclose(gram, gram[0, 0] * np.eye(3), rtol=1e-4, atol=1e-4 * gram[0, 0]):
            return matrix
        self.scope.changes.note("a stretched sphere was replaced by a mesh")
        return None


def _named(shape: Shape, names: tuple[str, ...]) -> Shape:
    """A shape of an instance; if its own name tells nothing, one of `names` that tells what it is.

    `names` are those of the instance and of its group.
    """
    if category_of(shape.name) != "other" or has_structural_name(shape.name):
        return shape
    return replace(shape, name=next((n for n in names if category_of(n) != "other"), shape.name))


def _sphere_frame(properties: Properties) -> Float64Array:
    centre, radius = properties.vector("center"), properties.number("radius", 1.0)
    if radius <= 0:
        raise properties.node.error("a sphere needs a positive radius")
    frame = np.diag([radius, radius, radius, 1.0])
    if centre is not None:
        frame[:3, 3] = centre
    return frame
