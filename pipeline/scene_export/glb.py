"""GLB: a scene as one binary glTF 2.0 file.

Khronos, *glTF 2.0 Specification*, and the KHR extensions for lights (candela, lux) and materials.
+Y is up by a rotation of the root node; below it, everything is in the scene's own axes. Each
object is a node at the middle of its lower bounds, with a child for each shape. The `extras` of
the glTF scene hold `scene.json`, from which `pbrnet import` restores rooms, portals and objects.
"""

from __future__ import annotations

import json
import math
import struct
from dataclasses import replace
from typing import Any

import numpy as np

from pbrnet.pipeline.scene_export import pictures
from pbrnet.pipeline.scene_export.content import Content, Eye, Lamp, Leaf, Piece
from pbrnet.pipeline.scene_export.description import (
    SUN,
    description,
    labels_of,
    pane_labels,
)
from pbrnet.pipeline.scene_export.looks import Glow, Look, Picture
from pbrnet.pipeline.scene_export.outdoors import Outdoors
from pbrnet.scenes.arrays import AnyArray, Float64Array, as_triple
from pbrnet.scenes.checked import plain
from pbrnet.scenes.contract import SceneObject
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.geometry.transforms import frame_along
from pbrnet.scenes.models.stated import Statement

_ROOT = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])  # Z up to Y up
_FLOAT, _UINT = 5126, 5125
_ARRAY, _ELEMENTS = 34962, 34963
_STEP = 1024.0  # positions of nodes are multiples of 1 / 1024 m, so that vertices stay exact
_THICKNESS = 0.01  # metres, of solid glass; only whether it is 0 counts for most renderers
_WRAPS = {"clamp": 33071, "mirror": 33648}


def glb_bytes(content: Content, outdoors: Outdoors | None) -> bytes:
    """Return the scene as GLB; what it cannot say is noted in `content.lost`."""
    return _Writer(content, outdoors).write()


class _Writer:
    def __init__(self, content: Content, outdoors: Outdoors | None) -> None:
        self._content, self._outdoors = content, outdoors
        self._folder = content.scene.folder
        self._binary = bytearray()
        self._lists: dict[str, list[dict[str, Any]]] = {}
        self._extensions: set[str] = set()
        self._textures: dict[Any, int] = {}
        self._lifts: dict[tuple[Picture, float], float] = {}
        self._lights: list[dict[str, Any]] = []

    def write(self) -> bytes:
        for name, look, glow in self._content.materials:
            self._add("materials", self._material(name, look, glow))
        children = [self._object(one) for one in self._content.scene.objects]
        others = self._content.unowned()
        children += [self._shape(piece, np.zeros(3)) for piece in others]
        children += [self._lamp(lamp) for lamp in self._content.lamps]
        if self._outdoors is not None and self._outdoors.direction is not None:
            light = ("directional", SUN, self._outdoors.illuminance)
            children.append(self._lamp(Lamp(*light, np.zeros(3), self._outdoors.direction)))
        children += [self._camera(eye) for eye in self._content.eyes]
        root = self._add(
            "nodes",
            {
                "name": self._content.scene.scene_id,
                "matrix": _ROOT.T.ravel().tolist(),
                "children": children,
            },
        )
        return self._packed(root)

    def _packed(self, root: int) -> bytes:
        asset = {"version": "2.0", "generator": "pbrnet export-scene"}
        credits = "; ".join(dict.fromkeys(
            f"{one.title} by {one.author}, {one.licence}" for one in self._content.scene.credits
        ))  # fmt: skip
        if credits:
            asset["copyright"] = credits[:2000]
        extras = {"pbrnet": description(self._content, self._outdoors)}
        scene = {"name": self._content.scene.scene_id, "nodes": [root], "extras": extras}
        document: dict[str, Any] = {"asset": asset, "scene": 0, "scenes": [scene], **self._lists}
        if self._lights:
            self._extensions.add("KHR_lights_punctual")
            document["extensions"] = {"KHR_lights_punctual": {"lights": self._lights}}
        if self._extensions:
            document["extensionsUsed"] = sorted(self._extensions)
        if self._binary:
            document["buffers"] = [{"byteLength": len(self._binary)}]
        try:
            text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
        except ValueError:
            raise InputError(
                f"{self._content.scene.xml}: a light, camera or material has a value out of range"
            ) from None
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
        if self._binary:
            chunks += struct.pack("<II", len(self._binary), 0x004E4942) + bytes(self._binary)
        return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks

    # Nodes

    def _object(self, thing: SceneObject) -> int:
        low, high = np.array(thing.bbox_min), np.array(thing.bbox_max)
        pivot = np.round([*(0.5 * (low + high))[:2], low[2]] * np.array(_STEP)) / _STEP
        node: dict[str, Any] = {
            "name": thing.id,
            "translation": pivot.tolist(),
            "extras": labels_of(thing),
        }
        pieces = self._content.fixed(thing)
        children = [self._shape(piece, pivot) for piece in pieces]
        leaves = self._content.leaves.get(thing.id, ())
        children += [
            self._leaf(f"{thing.id}.leaf{k}", leaf, pivot) for k, leaf in enumerate(leaves, 1)
        ]
        if children:
            node["children"] = children
        return self._add("nodes", node)

    def _leaf(self, name: str, leaf: Leaf, pivot: Float64Array) -> int:
        """The node of what a joint moves, with the joint as its origin."""
        joint, at = leaf.joint, np.array(leaf.joint.pivot)
        slides = joint.kind == "slide"
        stated = {
            "kind": "prismatic" if slides else "revolute",
            "axis": leaf.axis.tolist(),
            "limits": list(joint.limits),
            "current": joint.value,
            "unit": "metres" if slides else "degrees",
        }
        pieces = [self._content.pieces[name] for name in leaf.moving]
        node = {
            "name": name,
            "translation": (at - pivot).tolist(),
            "extras": {"joint": stated},
            "children": [self._shape(piece, at) for piece in pieces],
        }
        return self._add("nodes", node)

    def _shape(self, piece: Piece, pivot: Float64Array) -> int:
        mesh = piece.mesh
        attributes = {"POSITION": self._floats(mesh.vertices - pivot, bounds=True)}
        if mesh.normals is not None:
            length = np.linalg.norm(mesh.normals, axis=1, keepdims=True)
            up = np.where(length > 1e-9, mesh.normals / np.maximum(length, 1e-9), [0.0, 0, 1])
            attributes["NORMAL"] = self._floats(up)
        if '"index":' in json.dumps(self._lists["materials"][piece.material]):  # it has images
            uvs = mesh.uvs if mesh.uvs is not None else np.zeros((len(mesh.vertices), 2))
            attributes["TEXCOORD_0"] = self._floats(uvs)
        faces = np.ascontiguousarray(mesh.faces, "<u4").reshape(-1)
        view = self._view(faces.tobytes(), _ELEMENTS)
        accessor = {"bufferView": view, "componentType": _UINT, "count": len(faces)}
        indices = self._add("accessors", {**accessor, "type": "SCALAR"})
        primitive = {"attributes": attributes, "indices": indices, "material": piece.material}
        number = self._add("meshes", {"name": piece.id, "primitives": [primitive]})
        node: dict[str, Any] = {"name": piece.id, "mesh": number}
        if piece.id in self._content.panes:
            node["extras"] = pane_labels(self._content.panes[piece.id])
        return self._add("nodes", node)

    def _lamp(self, lamp: Lamp) -> int:
        strength = max(lamp.intensity)
        color = [value / strength for value in lamp.intensity] if strength > 0 else [1.0] * 3
        light: dict[str, Any] = {
            "type": lamp.kind,
            "name": lamp.name,
            "color": color,
            "intensity": strength,
        }
        if lamp.kind == "spot":
            light["spot"] = {"innerConeAngle": lamp.inner, "outerConeAngle": lamp.outer}
        self._lights.append(light)
        pose = frame_along(lamp.position, -lamp.direction)
        extension = {"KHR_lights_punctual": {"light": len(self._lights) - 1}}
        node = {"name": lamp.name, "matrix": pose.T.ravel().tolist(), "extensions": extension}
        return self._add("nodes", node)

    def _camera(self, eye: Eye) -> int:
        lens = {
            "yfov": 2 * math.atan(math.tan(eye.half_fov_x) / eye.aspect),
            "aspectRatio": eye.aspect,
            "znear": 0.01,
        }
        camera = {"name": eye.name, "type": "perspective", "perspective": lens}
        number = self._add("cameras", camera)
        matrix = eye.pose.T.ravel().tolist()
        return self._add("nodes", {"name": eye.name, "camera": number, "matrix": matrix})

    # Materials

    def _material(self, name: str, look: Look, glow: Glow | None) -> dict[str, Any]:
        metal: dict[str, Any] = {}
        made: dict[str, Any] = {"name": name, "pbrMetallicRoughness": metal}
        if look.two_sided:
            made["doubleSided"] = True
        lift = self._base(look, metal, made)
        self._roughness(look, metal)
        if look.normal is not None:
            made["normalTexture"] = self._normals(look.normal)
        if glow is not None:
            self._emission(glow, made)
        stated = look.stated
        if lift > 1:
            stated = replace(stated or Statement("principled"), lift=lift)
        if stated is not None:
            made["extras"] = {"pbrnet": plain(stated, brief=True)}
        extensions = self._look_extensions(look, metal)
        if extensions:
            self._extensions |= extensions.keys()
            made["extensions"] = {**made.get("extensions", {}), **extensions}
        return made

    def _base(self, look: Look, metal: dict[str, Any], made: dict[str, Any]) -> float:
        """Write base colour and opacity; return the factor by which the colour is greater."""
        base, lift = look.base, 1.0
        alpha = 1.0 if isinstance(look.opacity, Picture) else look.opacity
        if isinstance(look.opacity, Picture):
            placed = base if isinstance(base, Picture) else look.opacity
            data, cut = pictures.opacity_bytes(self._folder, look)
            metal["baseColorTexture"] = self._texture(placed, data, ("opacity", look))
            made["alphaMode"] = "MASK" if cut else "BLEND"
        elif isinstance(base, Picture):
            metal["baseColorTexture"], lift = self._lifted(base, _lift(look))
        else:
            lift = max(min(_lift(look), 1 / max(*base, 1e-3)), 1.0)
        color = (1.0, 1.0, 1.0)
        if not isinstance(base, Picture) and not isinstance(look.opacity, Picture):
            color = as_triple(lift * np.array(base))
        metal["baseColorFactor"] = [*_clipped(color), min(max(alpha, 0.0), 1.0)]
        if alpha < 1:
            made["alphaMode"] = "BLEND"
        return lift

    def _lifted(self, picture: Picture, most: float) -> tuple[dict[str, Any], float]:
        """A reference to a colour image times `most`, or less; and the factor."""
        key = (picture, most)
        if most == 1:
            return self._image(picture), 1.0
        data = None
        if key not in self._lifts:
            data, self._lifts[key] = pictures.lifted_bytes(self._folder, picture, most)
        return self._texture(picture, data, ("lifted", most)), self._lifts[key]

    def _roughness(self, look: Look, metal: dict[str, Any]) -> None:
        images = [one for one in (look.roughness, look.metallic) if isinstance(one, Picture)]
        for name, value in (("roughnessFactor", look.roughness), ("metallicFactor", look.metallic)):
            metal[name] = 1.0 if isinstance(value, Picture) else min(max(value, 0.0), 1.0)
        if images:
            key = ("roughness", look.roughness, look.metallic)
            data = None
            if (key, images[0]) not in self._textures:
                data = pictures.roughness_bytes(self._folder, look)
            metal["metallicRoughnessTexture"] = self._texture(images[0], data, key)

    def _emission(self, glow: Glow, made: dict[str, Any]) -> None:
        strength = max(glow.color)
        if glow.image is not None:
            data, brightest = pictures.glow_bytes(self._folder, glow.image)
            made["emissiveTexture"] = self._texture(glow.image, data, ("glow",))
            strength *= brightest
            self._content.lost.note(
                "images that shine have 8 bits: what is darker than a thousandth of their "
                "brightest texel is black"
            )
        if strength <= 0:
            return
        color = np.array(glow.color) / max(glow.color)
        made["emissiveFactor"] = _clipped(tuple(color.tolist()))
        self._extensions.add("KHR_materials_emissive_strength")
        made["extensions"] = {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}

    def _look_extensions(self, look: Look, metal: dict[str, Any]) -> dict[str, Any]:
        made: dict[str, Any] = {}
        ior = look.ior
        if look.transmission > 0:
            made["KHR_materials_transmission"] = {"transmissionFactor": look.transmission}
            if look.solid:
                made["KHR_materials_volume"] = {"thicknessFactor": _THICKNESS}
        elif look.specular > 0:
            root = math.sqrt(min(0.08 * look.specular, 0.99))
            ior = (1 + root) / (1 - root)
        else:
            made["KHR_materials_specular"] = {"specularFactor": 0.0}
        if abs(ior - 1.5) > 1e-6:
            made["KHR_materials_ior"] = {"ior": max(ior, 1.0)}
        if look.clearcoat > 0:
            made["KHR_materials_clearcoat"] = {
                "clearcoatFactor": min(look.clearcoat, 1.0),
                "clearcoatRoughnessFactor": min(max(look.clearcoat_roughness, 0.0), 1.0),
            }
        if look.sheen > 0:
            sheen = {"sheenColorFactor": [min(look.sheen, 1.0)] * 3, "sheenRoughnessFactor": 0.5}
            made["KHR_materials_sheen"] = sheen
            self._content.lost.note("the sheen of cloth has the lobe of KHR_materials_sheen")
        if look.diffuse_transmission > 0:
            passed = {"diffuseTransmissionFactor": min(look.diffuse_transmission, 1.0)}
            color = {"diffuseTransmissionColorFactor": metal["baseColorFactor"][:3]}
            if "baseColorTexture" in metal:
                color["diffuseTransmissionColorTexture"] = metal["baseColorTexture"]
            made["KHR_materials_diffuse_transmission"] = {**passed, **color}
        return made

    def _normals(self, picture: Picture) -> dict[str, Any]:
        data = None
        if (("stored",), picture) not in self._textures:
            data = pictures.stored_bytes(self._folder, picture)
        return self._texture(picture, data, ("stored",))

    def _image(self, picture: Picture) -> dict[str, Any]:
        data = None
        if (("as is",), picture) not in self._textures:
            data = pictures.color_bytes(self._folder, picture)
        return self._texture(picture, data, ("as is",))

    def _texture(
        self, picture: Picture, data: bytes | None, use: tuple[Any, ...]
    ) -> dict[str, Any]:
        """A reference to the texture of `data`, which is stored once; None if it is known."""
        key = (use, picture)
        if key not in self._textures:
            assert data is not None
            self._textures[key] = self._add(
                "textures",
                {"source": self._source(data, picture), "sampler": self._sampler(picture)},
            )
        made: dict[str, Any] = {"index": self._textures[key]}
        if picture.to_uv:
            self._extensions.add("KHR_texture_transform")
            made["extensions"] = {"KHR_texture_transform": self._uv_transform(picture)}
        return made

    def _source(self, data: bytes, picture: Picture) -> int:
        if data not in self._textures:
            kind = "image/png" if data.startswith(b"\x89PNG") else "image/jpeg"
            name = picture.file.rpartition("/")[2].rpartition(".")[0]
            image = {"bufferView": self._view(data), "mimeType": kind, "name": name}
            self._textures[data] = self._add("images", image)
        return self._textures[data]

    def _sampler(self, picture: Picture) -> int:
        wrap = _WRAPS.get(picture.wrap, 10497)
        key = ("sampler", picture.nearest, wrap)
        if key not in self._textures:
            filters = (9728, 9728) if picture.nearest else (9729, 9987)
            made = {"magFilter": filters[0], "minFilter": filters[1], "wrapS": wrap, "wrapT": wrap}
            self._textures[key] = self._add("samplers", made)
        return self._textures[key]

    def _uv_transform(self, picture: Picture) -> dict[str, Any]:
        """KHR_texture_transform of an affine map: rotation times scale, then offset."""
        (a, b, x), (c, d, y) = picture.to_uv
        scale = [math.hypot(a, c), math.hypot(b, d)]
        angle = math.atan2(-c, a)
        if a * d - b * c < 0:
            scale[1] = -scale[1]
        if abs(a * b + c * d) > 1e-6 * max(scale[0] * abs(scale[1]), 1e-12):
            self._content.lost.note("the shear of texture coordinates was left out")
        return {"offset": [x, y], "scale": scale, "rotation": angle}

    # Binary data

    def _floats(self, values: AnyArray, bounds: bool = False) -> int:
        packed = np.ascontiguousarray(values, "<f4")
        accessor: dict[str, Any] = {
            "bufferView": self._view(packed.tobytes(), _ARRAY),
            "componentType": _FLOAT,
            "count": len(packed),
            "type": f"VEC{packed.shape[1]}",
        }
        if bounds:
            accessor["min"] = packed.min(axis=0).astype(float).tolist()
            accessor["max"] = packed.max(axis=0).astype(float).tolist()
        return self._add("accessors", accessor)

    def _view(self, data: bytes, target: int | None = None) -> int:
        view: dict[str, Any] = {"buffer": 0, "byteOffset": len(self._binary)}
        self._binary += data
        self._binary += bytes(-len(self._binary) % 4)
        view["byteLength"] = len(data)
        if target is not None:
            view["target"] = target
        return self._add("bufferViews", view)

    def _add(self, name: str, item: dict[str, Any]) -> int:
        self._lists.setdefault(name, []).append(item)
        return len(self._lists[name]) - 1


def _lift(look: Look) -> float:
    """The base colour of glTF over that of Mitsuba's `principled` of the same albedo.

    Mitsuba adds the specular reflection to the diffuse one; glTF puts it above, so that the diffuse
    one gets what it leaves. Within 1 % at any roughness, for the usual `specular` of 0.5.
    """
    own = look.stated is not None or look.metallic != 0
    if own or look.transmission > 0 or look.diffuse_transmission > 0:
        return 1.0
    return 1.02 + 0.1 * min(max(look.specular, 0.0), 1.0)


def _clipped(color: tuple[float, ...]) -> list[float]:
    return [min(max(float(value), 0.0), 1.0) for value in color]
