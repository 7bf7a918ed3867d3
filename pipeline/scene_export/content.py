"""Content of a scene folder for export: meshes, looks, lights and cameras.

Positions are metres, Z up. Nothing here needs the renderer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element

import defusedxml.ElementTree
import numpy as np

from pbrnet.pipeline.scene_export.looks import (
    Glow,
    Look,
    LookReader,
    Picture,
    numbers,
    transform,
    triple,
)
from pbrnet.pipeline.views import load_cameras, opengl_pose
from pbrnet.scenes.arrays import Float64Array, as_triple
from pbrnet.scenes.color import Color
from pbrnet.scenes.contract import Joint, Portal, Scene, SceneObject, load_scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import exists
from pbrnet.scenes.formats.ply import read_ply
from pbrnet.scenes.formats.scene_xml import check_scene_xml
from pbrnet.scenes.geometry import primitives
from pbrnet.scenes.geometry.mesh import FARTHEST, Mesh
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.photometry import LUMEN

ENVIRONMENTS = ("sunsky", "sky", "sun", "constant", "envmap")
_PRIMITIVES = {
    "sphere": primitives.sphere,
    "rectangle": primitives.rectangle,
    "cube": primitives.cube,
    "disk": primitives.disk,
}
_TURNED = np.diag([-1.0, 1, -1, 1])  # Mitsuba's camera axes to OpenGL's: x right, y up, z back


@dataclass(frozen=True)
class Piece:
    """A shape: its mesh in world space and the number of its material."""

    id: str
    mesh: Mesh
    material: int


@dataclass(frozen=True)
class Lamp:
    """A light without extent; intensity in candela, of a directional one in lux, RGB."""

    kind: str  # "point", "spot" or "directional"
    name: str
    intensity: Color
    position: Float64Array  # (3,)
    direction: Float64Array  # (3,), unit, in which it shines
    inner: float = 0.0  # radians from the axis
    outer: float = 0.25 * math.pi


@dataclass(frozen=True)
class Eye:
    """A pinhole camera; `pose` (4, 4) has OpenGL's axes: x right, y up, z backward."""

    name: str
    pose: Float64Array
    half_fov_x: float  # radians
    aspect: float


@dataclass(frozen=True)
class Leaf:
    """The part of an object that a joint moves: a door, a drawer."""

    joint: Joint
    axis: Float64Array  # (3,), of the joint in the world
    moving: tuple[str, ...]  # names of pieces


@dataclass
class Content:
    """All of a scene that formats hold, and what was lost on the way."""

    scene: Scene
    pieces: dict[str, Piece] = field(default_factory=dict)
    leaves: dict[str, tuple[Leaf, ...]] = field(default_factory=dict)  # by object
    panes: dict[str, Portal] = field(default_factory=dict)  # by piece: sheets of glass
    materials: list[tuple[str, Look, Glow | None]] = field(default_factory=list)
    lamps: list[Lamp] = field(default_factory=list)
    environments: list[Element] = field(default_factory=list)
    eyes: list[Eye] = field(default_factory=list)
    max_depth: int = 17
    lost: Changes = field(default_factory=Changes)

    def fixed(self, thing: SceneObject) -> list[Piece]:
        """Return the pieces of an object that no joint moves."""
        moving = {name for leaf in self.leaves.get(thing.id, ()) for name in leaf.moving}
        names = (name for name in thing.shapes if name in self.pieces and name not in moving)
        return [self.pieces[name] for name in names]

    def whole(self, thing: SceneObject) -> list[Piece]:
        """Return all pieces of an object."""
        leaves = self.leaves.get(thing.id, ())
        return [*self.fixed(thing), *(self.pieces[name] for leaf in leaves for name in leaf.moving)]

    def unowned(self) -> list[Piece]:
        """Return the pieces that belong to no object."""
        owned = {shape for one in self.scene.objects for shape in one.shapes}
        owned |= {
            name for leaves in self.leaves.values() for leaf in leaves for name in leaf.moving
        }
        return [piece for name, piece in self.pieces.items() if name not in owned]


def read_content(folder: Path, cameras: Path | None = None) -> Content:
    """Read the scene folder; `cameras` is a camera file, by default the one of its project.

    Raises `InputError` that names the file and what is wrong with it.
    """
    scene = load_scene(folder)
    check_scene_xml(scene.xml)
    root = defusedxml.ElementTree.parse(scene.xml).getroot()
    content = Content(scene)
    _Reader(root, content).read()
    missing = sorted({s for one in scene.objects for s in one.shapes} - content.pieces.keys())
    if missing:
        raise InputError(f"{scene.xml}: the shape {missing[0]!r} of scene.json is missing")
    _stored_views(content)
    beside = folder.resolve().parent.parent / "cameras" / f"{scene.scene_id}.json"
    if cameras is None and folder.resolve().parent.name == "scenes" and exists(beside):
        cameras = beside
    if cameras is not None:
        _camera_file(content, cameras)
    return content


class _Reader:
    def __init__(self, root: Element, content: Content) -> None:
        self._root, self._content = root, content
        named = {
            one.get("id", ""): one for one in root.iter() if one.get("id") and one.tag != "ref"
        }
        self._looks = LookReader(named, content.lost)
        self._numbers: dict[tuple[int, Glow | None], int] = {}

    def read(self) -> None:
        for element in self._root:
            if element.tag == "shape":
                self._shape(element)
            elif element.tag == "emitter":
                self._emitter(element)
            elif element.tag == "sensor":
                self._sensor(element)
            elif element.tag == "integrator":
                depth = numbers(getattr(self._looks.find(element, "max_depth"), "attrib", {})
                                .get("value", ""))  # fmt: skip
                self._content.max_depth = int(depth[0]) if depth else self._content.max_depth

    def _shape(self, element: Element) -> None:
        name = element.get("id", "")
        mesh = self._mesh(element, name)
        if mesh is None or not len(mesh.faces):
            return
        bsdfs = self._looks.nested(element, "bsdf")
        glows = [self._looks.glow(one) for one in self._looks.nested(element, "emitter")]
        number = self._material(bsdfs[0] if bsdfs else None, glows[0] if glows else None, name)
        self._content.pieces[name] = Piece(name, mesh, number)

    def _mesh(self, element: Element, name: str) -> Mesh | None:
        kind = element.get("type", "")
        if kind == "ply":
            file = self._looks.find(element, "filename")
            mesh = read_ply(self._content.scene.folder / str(getattr(file, "attrib", {})["value"]))
        elif kind in _PRIMITIVES:
            mesh = _PRIMITIVES[kind]()
            if kind == "sphere":
                mesh = mesh.transformed(self._ball(element))
            self._content.lost.note("spheres and other analytic shapes became triangles")
        else:
            self._content.lost.note("shapes of a kind without counterpart were left out: {}", kind)
            return None
        place = self._looks.find(element, "to_world")
        if place is not None:
            mesh = mesh.transformed(transform(place))
        if _is_true(self._looks.find(element, "flip_normals")):
            mesh = mesh.flipped()
        if _is_true(self._looks.find(element, "face_normals")):
            mesh = Mesh(mesh.vertices, mesh.faces, None, mesh.uvs)
        if not (np.abs(mesh.vertices) <= FARTHEST).all():  # nor NaN
            raise InputError(
                f"{self._content.scene.xml}: shape {name!r:.100}: vertices lie at no finite place"
            )
        if len(mesh.faces) and len(np.unique(mesh.faces)) < len(mesh.vertices):
            mesh = mesh.subset(np.ones(len(mesh.faces), bool))  # without stray vertices
        return mesh

    def _ball(self, element: Element) -> Float64Array:
        """The map (4, 4) of the unit sphere to the sphere's `radius` and `center`."""
        made = np.diag([*[self._looks.number(element, "radius", 1.0)] * 3, 1.0])
        made[:3, 3] = _vector(self._looks.find(element, "center"), np.zeros(3))
        return made

    def _material(self, bsdf: Element | None, glow: Glow | None, shape: str) -> int:
        key = (id(bsdf), glow)
        if key not in self._numbers:
            name = (bsdf.get("id") if bsdf is not None else "") or f"material-{shape}"
            self._numbers[key] = len(self._content.materials)
            self._content.materials.append((name, self._looks.look(bsdf), glow))
        return self._numbers[key]

    def _emitter(self, element: Element) -> None:
        kind = element.get("type", "")
        if kind in ENVIRONMENTS:
            self._content.environments.append(element)
        elif kind in ("point", "spot", "directional"):
            self._content.lamps.append(self._lamp(element, kind))
        else:
            self._content.lost.note("lights of a kind without counterpart were left out: {}", kind)

    def _lamp(self, element: Element, kind: str) -> Lamp:
        place = self._looks.find(element, "to_world")
        pose = np.eye(4) if place is None else transform(place)
        property_ = "irradiance" if kind == "directional" else "intensity"
        color = self._looks.color(element, property_, (1.0, 1.0, 1.0))
        if isinstance(color, Picture):
            color = (1.0, 1.0, 1.0)
        position = _vector(self._looks.find(element, "position"), pose[:3, 3])
        direction = _vector(self._looks.find(element, "direction"), pose[:3, 2])
        outer = math.radians(self._looks.number(element, "cutoff_angle", 20.0))
        inner = math.radians(self._looks.number(element, "beam_width", math.degrees(0.75 * outer)))
        if kind == "spot" and self._looks.nested(element, "texture"):
            self._content.lost.note("images in the beam of spot lights were left out")
        return Lamp(
            kind,
            element.get("id") or f"light_{len(self._content.lamps)}",
            as_triple(np.array(color) / LUMEN),
            position,
            direction / max(float(np.linalg.norm(direction)), 1e-12),
            min(inner, 0.999 * outer),
            outer,
        )

    def _sensor(self, element: Element) -> None:
        place = self._looks.find(element, "to_world")
        if element.get("type") != "perspective" or place is None:
            return
        sizes = {}
        for film in self._looks.nested(element, "film"):
            sizes = {name: self._looks.number(film, name, 1.0) for name in ("width", "height")}
        half = math.radians(0.5 * self._looks.number(element, "fov", 60.0))
        aspect = sizes.get("width", 4.0) / max(sizes.get("height", 3.0), 1.0)
        pose = transform(place) @ _TURNED
        self._content.eyes.append(Eye("sensor", pose, half, aspect))


def _stored_views(content: Content) -> None:
    """Add the views that the importer stored in `scene.json`."""
    for number, view in enumerate(content.scene.source.get("views", [])):
        try:
            pose = np.array(view["camera_to_world"], np.float64).reshape(4, 4)
            half = float(view["half_fov_x"])
            aspect = float(view["width"]) / float(view["height"])
        except (TypeError, ValueError, KeyError, ZeroDivisionError):
            raise InputError(
                f"{content.scene.folder}: scene.json: view {number} is damaged"
            ) from None
        name = str(view.get("name") or f"view_{number}")[:100]
        content.eyes.append(Eye(name, opengl_pose(pose), half, aspect))


def _camera_file(content: Content, path: Path) -> None:
    """Add the views of a camera file; those that are not plain perspective are left out."""
    found = load_cameras(path)
    if found.scene_id != content.scene.scene_id:
        raise InputError(
            f"{path}: cameras of {found.scene_id!r}, not of {content.scene.scene_id!r}"
        )
    for view in found.views:
        middle = (0.5 * view.width, 0.5 * view.height)
        if not (view.lens.is_pinhole and np.allclose((view.K[0][2], view.K[1][2]), middle)):
            content.lost.note("cameras that are not plain perspective were left out")
            continue
        half = math.atan(0.5 * view.width / view.K[0][0])
        pose = opengl_pose(np.array(view.camera_to_world))
        content.eyes.append(Eye(view.view_id, pose, half, view.width / view.height))


def _vector(element: Element | None, default: Float64Array) -> Float64Array:
    return np.array(default if element is None else triple(element), dtype=np.float64)


def _is_true(element: Element | None) -> bool:
    return element is not None and element.get("value") == "true"
