"""Reader of COLLADA models (`.dae`, also inside `.kmz`), based on pycollada.

Colours and transparency are interpreted like in Sweet Home 3D.
"""

from __future__ import annotations

import io
import re
import urllib.parse
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, Literal
from xml.etree.ElementTree import Element, ParseError, tostring

import collada
import numpy as np
from collada.common import DaeError
from collada.material import DaeMissingSampler2D, Effect, Map
from collada.scene import (
    DaeInstanceNotLoadedError,
    GeometryNode,
    Node,
)
from collada.triangleset import TriangleSet
from defusedxml import DefusedXmlException
from defusedxml import ElementTree as SafeElementTree

from pbrnet.scenes.arrays import Float64Array, Int64Array
from pbrnet.scenes.formats.model_parts import (
    MAX_TRIANGLES,
    Model,
    ModelMaterial,
    ModelPart,
    UnreadableModel,
    check_points,
    make_part,
    triangulated,
)

_CREASE = 90.0  # degrees, for meshes without normals
_DEPTH = 64  # of nested nodes
_MOST_NODES = 20_000  # of a piece of furniture
_MOST_NODES_OF_FILES = 100_000  # of a file that is a scene of its own
_LUMINANCE = (0.212671, 0.715160, 0.072169)
# Elements without effect on an image: removed before parsing, so that errors in them do not matter.
_UNUSED = (
    "extra", "lines", "linestrips", "library_animations", "library_animation_clips",
    "library_cameras", "library_lights", "library_controllers", "library_physics_models",
    "library_physics_scenes", "library_force_fields", "instance_camera", "instance_light",
    "instance_physics_scene",
)  # fmt: skip
_LOST = {
    "instance_controller": "skinned meshes of models were left out",
    "ph": "polygons with holes were left out of models",
}
_LOST_OF_FILES = {
    "instance_light": "lights, whose strength COLLADA does not define, were left out",
    "instance_camera": "cameras were left out",
}
_UP: dict[str, Literal["x", "z"]] = {"X_UP": "x", "Z_UP": "z"}  # else y
_TURNS = {  # from the up axis of the file to y up
    "Z_UP": np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]]),
    "X_UP": np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]),
}


def read_dae(
    data: bytes,
    find: Callable[[str], str | None],
    lost: Callable[[str], None],
    *,
    as_stored: bool = False,
    most_triangles: int = MAX_TRIANGLES,
) -> Model:
    """Read the model in a COLLADA file: y up and in centimetres as Sweet Home 3D does.

    With `as_stored` it keeps the axes and the unit of the file. `find` returns the member for the
    name of an image, or None; `lost` is called with a sentence for each loss. Raises
    `UnreadableModel` for damaged, hostile, empty or too large files.
    """
    root = _parsed(data)
    losses = _LOST | _LOST_OF_FILES if as_stored else _LOST
    for tag in sorted({_bare(element) for element in root.iter()} & set(losses)):
        lost(losses[tag])
    _strip(root)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of numbers that end early; checked below
            document = collada.Collada(
                io.BytesIO(tostring(root)), ignore=[DaeError], aux_file_loader=lambda _: None
            )
            most_nodes = _MOST_NODES_OF_FILES if as_stored else _MOST_NODES
            up = document.assetInfo.upaxis
            unit = _unit(document)
            base = np.eye(4)
            if not as_stored:
                centimetres = 100 * (unit or 1.0)
                base = _TURNS.get(up, np.eye(4)) @ np.diag([*[centimetres] * 3, 1.0])
            parts = list(_parts(document, find, base, most_triangles, most_nodes))
    except (DaeError, DaeMissingSampler2D, DaeInstanceNotLoadedError, ArithmeticError,
            AssertionError, AttributeError, LookupError, RecursionError, TypeError,
            ValueError) as error:  # fmt: skip
        # pycollada fails in many ways on incomplete files.
        raise UnreadableModel(f"damaged COLLADA file ({type(error).__name__}: {error})") from None
    for fault in document.errors[:8]:
        lost(f"faulty parts of models were left out ({fault.msg[:100]})")
    if not parts:
        raise UnreadableModel("no faces in it")
    model = Model(tuple(_visible(parts)), _header(document), "y", 0.01)
    return replace(model, up=_UP.get(up, "y"), unit=unit) if as_stored else model


def _parsed(data: bytes) -> Element:
    """Parse the XML and return its root element; raises `UnreadableModel`."""
    try:
        root = SafeElementTree.fromstring(data)
    except DefusedXmlException as error:
        raise UnreadableModel(f"its XML is refused: {error}") from None
    except (ParseError, ValueError, LookupError) as error:
        raise UnreadableModel(f"its XML is damaged: {error}") from None
    if _bare(root) != "COLLADA":
        raise UnreadableModel(f"XML with the root <{_bare(root)[:40]}>, which is no COLLADA")
    return root


def _bare(element: Element) -> str:
    return str(element.tag).rpartition("}")[2]


def _strip(root: Element) -> None:
    """Remove unused elements; without recursion, as files may be deeply nested."""
    stack = [root]
    while stack:
        element = stack.pop()
        for child in list(element):
            if _bare(child) in _UNUSED:
                element.remove(child)
            else:
                stack.append(child)


def _header(document: Any) -> str:
    """Return title, authors, copyright and comments of the file."""
    words = [document.assetInfo.title, document.assetInfo.subject]
    for one in document.assetInfo.contributors:
        words += [one.author, one.copyright, one.comments]
    return "\n".join(str(word) for word in words if word)[:4000]


def _unit(document: Any) -> float | None:
    """Return the unit in metres; None if the file states none, or an impossible one."""
    unit = document.assetInfo.unitmeter
    return float(unit) if unit and np.isfinite(unit) and 1e-9 < unit < 1e9 else None


def _parts(
    document: Any,
    find: Callable[[str], str | None],
    base: Float64Array,
    most_triangles: int,
    most_nodes: int,
) -> Iterator[ModelPart]:
    # Without a default scene all scenes are shown.
    scenes = [document.scene] if document.scene is not None else document.scenes
    roots = [node for scene in scenes for node in scene.nodes]
    materials: dict[str, tuple[str, ModelMaterial]] = {}
    made: dict[tuple[int, str, str], ModelPart | None] = {}
    triangles = 0
    for path, matrix, node in _instances(roots, base, most_nodes):
        group = path[-1].partition(":")[2]
        targets = {one.symbol: one.target for one in node.materials}
        for primitive in node.geometry.primitives:
            # Some exporters bind no materials: then the symbol of the faces is the material.
            target = targets.get(primitive.material) or document.materials.get(primitive.material)
            name, material = "default", ModelMaterial()
            if target is not None:
                if target.id not in materials:
                    materials[target.id] = (
                        target.name or target.id,
                        _material(target.effect, document, find),
                    )
                name, material = materials[target.id]
            key = (id(primitive), group or node.geometry.name or "default", name)
            if key not in made:  # nodes may share geometries, and each other, thousands of times
                made[key] = _part(key[1], name, material, primitive)
            part = made[key]
            if part is not None and abs(np.linalg.det(matrix[:3, :3])) > 1e-15:
                triangles += len(part.mesh.faces)
                if triangles > most_triangles:
                    raise UnreadableModel(f"more than {most_triangles:,} triangles")
                mesh = part.mesh.transformed(matrix)
                check_points(mesh.vertices)
                yield ModelPart(part.group, name, material, mesh, path)


def _instances(
    roots: list[Any], base: Float64Array, most_nodes: int
) -> Iterator[tuple[tuple[str, ...], Float64Array, GeometryNode]]:
    """Yield each geometry instance: path of its node (`ModelPart.path`), matrix, geometry node."""
    stack: list[tuple[Any, Float64Array, tuple[str, ...]]] = [
        (node, base, ()) for node in reversed(roots)
    ]
    seen = 0
    while stack:
        node, matrix, above = stack.pop()
        seen += 1
        if len(above) > _DEPTH or seen > most_nodes:
            raise UnreadableModel(
                f"more than {most_nodes:,} nodes, or deeper than {_DEPTH} in each other"
            )
        if not isinstance(node, Node):
            continue
        placed = matrix @ np.asarray(node.matrix, dtype=np.float64)
        if not np.isfinite(placed).all():
            raise UnreadableModel("the matrix of a node is not finite or too large")
        named = getattr(node, "node", node)  # an instance has the name of its node in the library
        name = str(getattr(named, "name", None) or named.xmlnode.get("name") or "")
        path = (*above, f"{seen}:{name}")
        for child in node.children:
            if isinstance(child, GeometryNode):
                yield path, placed, child
        stack += [(child, placed, path) for child in reversed(node.children)]


def _part(group: str, name: str, material: ModelMaterial, primitive: Any) -> ModelPart | None:
    """Return a set of triangles or polygons as a part in the axes of its geometry, or None."""
    indices = primitive.vertex_index
    if indices is None or not len(indices):
        return None
    positions = np.asarray(primitive.vertex, dtype=np.float64)
    check_points(positions)
    if indices.min() < 0 or indices.max() >= len(positions):
        raise UnreadableModel("a face refers to a vertex that does not exist")
    absent = np.full_like(indices, -1)
    has_normals = primitive.normal is not None and primitive.normal_index is not None
    normals = primitive.normal if has_normals else np.zeros((0, 3))
    has_uvs = len(primitive.texcoordset) > 0
    uvs = primitive.texcoordset[0][:, :2] if has_uvs else np.zeros((0, 2))
    corners = np.stack(
        [
            indices,
            primitive.texcoord_indexset[0] if has_uvs else absent,
            primitive.normal_index if has_normals else absent,
        ],
        axis=-1,
    ).astype(np.int64)
    if not isinstance(primitive, TriangleSet):
        corners = triangulated(_by_size(primitive, corners), positions)
    return make_part(
        group,
        name,
        material,
        corners,
        positions,
        np.asarray(uvs, dtype=np.float64),
        np.asarray(normals, dtype=np.float64),
        _CREASE,
    )


def _by_size(primitive: Any, corners: Int64Array) -> Iterator[Int64Array]:
    """Yield the polygons (P, size, 3) of a list, grouped by size."""
    counts = np.asarray(primitive.vcounts, dtype=np.int64)
    starts = np.cumsum(counts) - counts
    if (counts < 0).any() or counts.sum() > len(corners):
        raise UnreadableModel("more corners of polygons than there are indices")
    for size in np.unique(counts[counts >= 3]):
        yield corners[starts[counts == size][:, None] + np.arange(size)]


def _material(
    effect: Effect | None, document: Any, find: Callable[[str], str | None]
) -> ModelMaterial:
    if effect is None:
        return ModelMaterial()
    shown = effect.emission if effect.shadingtype == "constant" else effect.diffuse
    image = None
    color = (1.0, 1.0, 1.0)
    if isinstance(shown, Map):
        path = urllib.parse.unquote(shown.sampler.surface.image.path or "")
        image = find(path.strip().removeprefix("file://"))
    elif shown is not None:
        color = _rgb(shown) or color
    emission = (0.0, 0.0, 0.0)
    if effect.shadingtype != "constant" and isinstance(effect.emission, tuple | list):
        emission = _rgb(effect.emission) or emission
    highlight, exponent = 0.0, 0.0
    if isinstance(effect.specular, tuple | list) and isinstance(effect.shininess, float):
        highlight = float(np.mean(effect.specular[:3]))
        exponent = min(max(effect.shininess, 0.0), 128.0)
        if not np.isfinite([highlight, exponent]).all():
            highlight, exponent = 0.0, 0.0
    return ModelMaterial(color, highlight, exponent, _opacity(effect, document), image, emission)


def _rgb(values: Any) -> tuple[float, float, float] | None:
    """Return a colour of the file, clipped to [0, 1]; None if it is not finite."""
    if not np.isfinite(values[:3]).all():
        return None
    red, green, blue = (min(max(float(value), 0.0), 1.0) for value in values[:3])
    return red, green, blue


def _opacity(effect: Effect, document: Any) -> float:
    """Return the opacity in [0, 1] of an effect: A_ONE by alpha, RGB_ZERO by luminance."""
    transparent = effect.transparent
    if not isinstance(transparent, tuple | list):
        return 1.0  # none, or an image, whose alpha is applied with the image
    given = [one for one in effect.xmlnode.iter() if _bare(one) == "transparency"]
    factor = effect.transparency if given and isinstance(effect.transparency, float) else 1.0
    if effect.opaque_mode == "RGB_ZERO":
        opacity = 1 - factor * float(np.dot(_LUMINANCE, transparent[:3]))
    else:
        opacity = factor * float(transparent[3])
        if _is_reversed(document):
            opacity = 1 - opacity
    return min(max(opacity, 0.0), 1.0) if np.isfinite(opacity) else 1.0


def _is_reversed(document: Any) -> bool:
    """Return whether SketchUp before 7.1 wrote the file: its transparency is an opacity."""
    for one in document.assetInfo.contributors:
        version = re.match(r"Google SketchUp\s+(\d+)(?:\.(\d+))?", one.authoring_tool or "")
        if version is not None and (int(version[1]), int(version[2] or 0)) < (7, 1):
            return True
    return False


def _visible(parts: list[ModelPart]) -> list[ModelPart]:
    """Return the parts, made opaque if all are invisible: some exporters invert opacity."""
    if any(part.material.opacity > 0 or part.material.image for part in parts):
        return parts
    return [replace(part, material=replace(part.material, opacity=1.0)) for part in parts]
