"""Reader of glTF 2.0 files: node tree, meshes, lights and cameras, in metres, Y up.

Khronos, *glTF 2.0 Specification*. Containers, accessors, images and materials have modules of
their own.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pbrnet.scenes.arrays import Float64Array, Int64Array
from pbrnet.scenes.color import Color
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.geometry.mesh import Mesh, cleaned
from pbrnet.scenes.importing.camera import Camera
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.credits import licence_in
from pbrnet.scenes.importing.materials.textures import TextureStore
from pbrnet.scenes.importing.names import Names
from pbrnet.scenes.importing.sandbox import Sandbox
from pbrnet.scenes.importing.shape import MAX_SCENE_TRIANGLES, MAX_SHAPES, Shape
from pbrnet.scenes.models.gltf.accessors import Primitive, read_floats
from pbrnet.scenes.models.gltf.container import (
    Asset,
    extensions,
    number,
    numbers,
    objects,
    open_asset,
    whole,
)
from pbrnet.scenes.models.gltf.images import Images
from pbrnet.scenes.models.gltf.materials import GltfMaterials
from pbrnet.scenes.models.model import Model, PunctualLight

MAX_DEPTH = 256  # of nested nodes
_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_BLACK = 1e-3  # least mean of vertex colours that are meant; some programs store 1 of 65,535
_LIGHTS = "KHR_lights_punctual"
_INSTANCES = "EXT_mesh_gpu_instancing"


@dataclass(frozen=True)
class _Node:
    index: int
    node: dict[str, Any]
    matrix: Float64Array  # (4, 4), to the file's world
    names: tuple[str, ...]  # labels of the nodes from the root to this one


def read_model(
    path: Path, sandbox: Sandbox, textures: TextureStore, unpacked: Path, changes: Changes
) -> Model:
    """Read a `.gltf` or `.glb` file; see `importer.ModelReader`."""
    asset = open_asset(path, sandbox)
    return read_gltf(asset, Images(asset, unpacked, changes), textures, changes)


def read_gltf(asset: Asset, images: Images, textures: TextureStore, changes: Changes) -> Model:
    """Read everything in the file's scene.

    Raises `InputError` that names the element which cannot be used.
    """
    info = asset.data["asset"]
    extras = info.get("extras")
    extras = extras if isinstance(extras, dict) else {}  # author and licence, as Sketchfab has them
    licence = str(extras.get("license") or "")[:200]
    model = Model(
        up="y",
        unit=1.0,
        kind="gltf",
        version=str(info.get("version", "")),
        author=str(info.get("copyright") or extras.get("author") or "")[:200],
        licence=licence_in(licence) or licence,
        described=_description(asset),
    )
    _Reader(asset, GltfMaterials(asset, images, textures, changes), changes, model).read()
    return model


@dataclass
class _Reader:
    asset: Asset
    materials: GltfMaterials
    changes: Changes
    model: Model
    names: Names = field(default_factory=Names)
    triangles: int = 0
    _meshes: dict[tuple[int, int, int], Mesh] = field(default_factory=dict)

    def read(self) -> None:
        for name in ("animations", "skins"):
            if self.asset.items(name):
                self.changes.note(f"{name} were left out; nodes keep their initial pose")
        # The whole tree is read first, so that a damaged one is refused before any mesh is read.
        for node in list(self._walk()):
            if "mesh" in node.node:
                for instance in self._instances(node):
                    self._mesh(instance)
            if "camera" in node.node:
                self._camera(node)
            if _LIGHTS in extensions(node.node):
                self._light(node)

    def _walk(self) -> Iterator[_Node]:
        """Iterate over the nodes of the scene, parents first; refuse cycles and shared children."""
        nodes = self.asset.items("nodes")
        seen: set[int] = set()
        stack: list[tuple[int, Float64Array, tuple[str, ...]]] = [
            (root, np.eye(4), ()) for root in reversed(self._roots(nodes))
        ]
        while stack:
            index, above, names = stack.pop()
            place = f"{self.asset.path}: nodes[{index}]"
            if index in seen:
                raise InputError(f"{place}: is referenced twice; nodes must form a tree")
            seen.add(index)
            if len(names) >= MAX_DEPTH:
                raise InputError(f"{place}: nodes are nested more than {MAX_DEPTH} deep")
            node = nodes[index]
            here = (*names, f"{index}:{node.get('name') or ''}")
            if extensions(node).get("KHR_node_visibility", {}).get("visible", True) is False:
                self.changes.note("a hidden node was left out: {}", here[-1])
                continue
            matrix = above @ local_matrix(node, place)
            if abs(np.linalg.det(matrix[:3, :3])) < 1e-18 or not np.isfinite(matrix).all():
                self.changes.note("a node scaled to zero size was left out: {}", here[-1])
                continue
            yield _Node(index, node, matrix, here)
            children = self._indices(node.get("children", []), f"{place}.children")
            stack.extend((child, matrix, here) for child in reversed(children))

    def _roots(self, nodes: list[dict[str, Any]]) -> list[int]:
        scenes = self.asset.items("scenes")
        if scenes:
            if len(scenes) > 1:
                self.changes.note("the file has several scenes; only the default scene was read")
            scene = self.asset.item("scenes", self.asset.data.get("scene", 0), "scene")
            return self._indices(scene.get("nodes", []), f"{self.asset.path}: scene.nodes")
        children = {
            child
            for index, node in enumerate(nodes)
            for child in self._indices(
                node.get("children", []), f"{self.asset.path}: nodes[{index}].children"
            )
        }
        return [index for index in range(len(nodes)) if index not in children]

    def _indices(self, value: Any, place: str) -> list[int]:
        if not isinstance(value, list):
            raise InputError(f"{place}: expected a list of node numbers")
        last = len(self.asset.items("nodes")) - 1
        return [whole(item, place, 0, last) for item in value]

    def _instances(self, node: _Node) -> list[_Node]:
        """The node itself, or a copy for each instance of EXT_mesh_gpu_instancing."""
        extension = extensions(node.node).get(_INSTANCES)
        if extension is None:
            return [node]
        where = f"nodes[{node.index}].{_INSTANCES}"
        attributes = extension.get("attributes")
        if not isinstance(attributes, dict):
            raise InputError(f"{self.asset.path}: {where}: attributes are missing")
        columns = {
            name.lower(): read_floats(self.asset, attributes[name], width, f"{where}.{name}")
            for name, width in (("TRANSLATION", 3), ("ROTATION", 4), ("SCALE", 3))
            if name in attributes
        }
        counts = {len(values) for values in columns.values()}
        if len(counts) != 1 or max(counts) > MAX_SHAPES:
            raise InputError(
                f"{self.asset.path}: {where}: needs columns of one length, at most {MAX_SHAPES:,}"
            )
        instances = []
        for order in range(counts.pop()):
            pose = {name: values[order].tolist() for name, values in columns.items()}
            matrix = node.matrix @ local_matrix(pose, f"{self.asset.path}: {where}[{order}]")
            label = f"{node.names[-1].partition(':')[2]}"
            names = (*node.names, f"{node.index}.{order}:{label}")
            instances.append(_Node(node.index, node.node, matrix, names))
        return instances

    def _mesh(self, node: _Node) -> None:
        number_ = node.node["mesh"]
        mesh = self.asset.item("meshes", number_, f"nodes[{node.index}].mesh")
        label = str(node.node.get("name") or mesh.get("name") or f"mesh_{number_}")
        where = f"{self.asset.path}: meshes[{number_}]"
        for order, primitive in enumerate(objects(mesh, "primitives", where)):
            if primitive.get("targets"):
                self.changes.note("morph targets were left out: {}", label)
            self._primitive(node, int(number_), order, primitive, label)

    def _primitive(
        self, node: _Node, mesh: int, order: int, primitive: dict[str, Any], label: str
    ) -> None:
        where = f"meshes[{mesh}].primitives[{order}]"
        data = Primitive(self.asset, primitive, where)
        if "POSITION" not in data:
            self.changes.note("a primitive without positions was left out: {}", label)
            return
        mode = _TRIANGLES if data.uses_draco else primitive.get("mode", _TRIANGLES)
        if mode not in (_TRIANGLES, _STRIP, _FAN):
            self.changes.note("points and lines were left out: {}", label)
            return
        tint: Color = (1.0, 1.0, 1.0)
        if "COLOR_0" in data:
            mean = data.colors("COLOR_0").mean(axis=0)
            if mean.max() < _BLACK:
                self.changes.note(
                    "vertex colours that are black everywhere were left out: {}", label
                )
            elif mean.min() < 0.999:
                self.changes.note("vertex colours were replaced by their mean: {}", label)
                tint = (
                    round(float(mean[0]), 4),
                    round(float(mean[1]), 4),
                    round(float(mean[2]), 4),
                )
        material = self.materials.material(primitive.get("material"), tint)
        key = (mesh, order, material.texcoord)
        if key not in self._meshes:
            self._meshes[key] = self._geometry(data, mode, material.texcoord, where)
        local = self._meshes[key]
        if not len(local.faces):
            self.changes.note("a primitive without area was left out: {}", label)
            return
        self.triangles += len(local.faces)
        if self.triangles > MAX_SCENE_TRIANGLES or len(self.model.shapes) >= MAX_SHAPES:
            raise InputError(
                f"{self.asset.path}: the file has more than the limit of "
                f"{MAX_SCENE_TRIANGLES:,} triangles or {MAX_SHAPES:,} shapes"
            )
        shape = Shape(
            self.names.unique(label), label, local.transformed(node.matrix), material.surface
        )
        self.model.shapes.append(shape)
        self.model.node_paths[shape.id] = node.names
        if material.emission is not None:
            self.model.emissions[shape.id] = material.emission

    def _geometry(self, data: Primitive, mode: int, uv: int, where: str) -> Mesh:
        asset = self.asset
        points = data.floats("POSITION", 3)
        faces = _triangles(data.corners(len(points)), mode)
        optional: dict[str, Float64Array | None] = {}
        for name, width in (("NORMAL", 3), (f"TEXCOORD_{uv}", 2)):
            optional[name] = None
            if name in data:
                values = data.floats(name, width)
                if len(values) != len(points):
                    raise InputError(
                        f"{asset.path}: {where}: has {len(points)} positions but {len(values)} "
                        f"elements of {name}"
                    )
                optional[name] = values
        mesh = Mesh(points, faces, optional["NORMAL"], optional[f"TEXCOORD_{uv}"])
        mesh, dropped = cleaned(mesh, f"{asset.path}: {where}")
        if dropped:
            self.changes.note("triangles without area were left out of {}", where)
        return mesh

    def _camera(self, node: _Node) -> None:
        index = node.node["camera"]
        camera = self.asset.item("cameras", index, f"nodes[{node.index}].camera")
        lens = camera.get("perspective")
        if camera.get("type") != "perspective" or not isinstance(lens, dict):
            self.changes.note("a camera without perspective projection was left out")
            return
        place = f"{self.asset.path}: cameras[{index}]"
        half = 0.5 * number(lens.get("yfov"), f"{place}.yfov", 0.01, 3.0)
        aspect = number(lens.get("aspectRatio", 4 / 3), f"{place}.aspectRatio", 0.1, 10)
        # glTF cameras look along -Z with +X to the right, Mitsuba's along +Z with +X to the left.
        pose = node.matrix @ np.diag([-1.0, 1, -1, 1])
        name = str(node.node.get("name") or camera.get("name") or f"camera_{index}")
        size = (round(480 * aspect), 480)
        across = math.atan(math.tan(half) * aspect)
        self.model.cameras.append(Camera(name, pose, across, *size))

    def _light(self, node: _Node) -> None:
        index = extensions(node.node)[_LIGHTS].get("light")
        where = f"{self.asset.path}: {_LIGHTS}"
        listed = objects(extensions(self.asset.data).get(_LIGHTS, {}), "lights", where)
        place = f"{self.asset.path}: lights[{index}]"
        light = listed[whole(index, place, 0, len(listed) - 1)]
        kind = light.get("type")
        if kind not in ("point", "spot", "directional"):
            self.changes.note("a light of unknown type was left out: {}", repr(kind)[:40])
            return
        color = numbers(light.get("color", [1, 1, 1]), 3, f"{place}.color")
        cone = light.get("spot")
        cone = cone if isinstance(cone, dict) else {}
        if "range" in light:
            self.changes.note("the range of a light was ignored; its light has no limit")
        self.model.lights.append(
            PunctualLight(
                kind,
                (max(color[0], 0.0), max(color[1], 0.0), max(color[2], 0.0)),
                number(light.get("intensity", 1), f"{place}.intensity", 0, 1e12),
                node.matrix,
                number(cone.get("innerConeAngle", 0), f"{place}.innerConeAngle", 0, 1.57),
                number(cone.get("outerConeAngle", math.pi / 4), f"{place}.outer", 0.01, 1.57),
                str(node.node.get("name") or ""),
            )
        )


def _description(asset: Asset) -> dict[str, Any] | None:
    """Description that `pbrnet export-scene` wrote into the scene's `extras`, unchecked."""
    if not asset.items("scenes"):
        return None
    extras = asset.item("scenes", asset.data.get("scene", 0), "scene").get("extras")
    found = extras.get("pbrnet") if isinstance(extras, dict) else None
    return found if isinstance(found, dict) else None


def local_matrix(node: dict[str, Any], place: str) -> Float64Array:
    """The transform of a node to its parent, float64 (4, 4): its matrix, or T R S."""
    if "matrix" in node:
        values = numbers(node["matrix"], 16, f"{place}.matrix")
        matrix = np.reshape(values, (4, 4)).T
        if not np.allclose(matrix[3], [0, 0, 0, 1], atol=1e-5):
            raise InputError(f"{place}.matrix: is not an affine transform")
        return np.array(matrix)
    x, y, z, w = numbers(node.get("rotation", [0, 0, 0, 1]), 4, f"{place}.rotation")
    length = math.sqrt(x * x + y * y + z * z + w * w)
    if length < 1e-9:
        raise InputError(f"{place}.rotation: is a quaternion of length 0")
    x, y, z, w = x / length, y / length, z / length, w / length
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = turn * numbers(node.get("scale", [1, 1, 1]), 3, f"{place}.scale")
    matrix[:3, 3] = numbers(node.get("translation", [0, 0, 0]), 3, f"{place}.translation")
    return matrix


def _triangles(corners: Int64Array, mode: int) -> Int64Array:
    """Faces (F, 3) of a primitive's indices (N,): a list, strip or fan of triangles."""
    if mode == _TRIANGLES:
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)
    if len(corners) < 3:
        return np.zeros((0, 3), dtype=np.int64)
    step = np.arange(len(corners) - 2)
    if mode == _FAN:
        return corners[np.stack([np.zeros_like(step), step + 1, step + 2], axis=1)]
    odd = step % 2
    return corners[np.stack([step, step + 1 + odd, step + 2 - odd], axis=1)]
