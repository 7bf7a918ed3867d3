"""Interpreter of pbrt directives: graphics state, named things, shapes, lights and camera.

Input: directives of `parser`. Output: a `PbrtScene`, whose shapes and lights have their transforms
in a right-handed world. pbrt's world is left-handed unless the camera's transform mirrors it; a
left-handed one is mirrored in X.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.geometry.transforms import look_at
from pbrnet.scenes.importing.shape import MAX_SHAPES
from pbrnet.scenes.pbrt.parser import Directive, Parser
from pbrnet.scenes.pbrt.values import Context, Entity

MAX_NESTING = 1000  # of attributes and transforms
_MIRROR = np.diag([-1.0, 1.0, 1.0, 1.0])
_DROPPED = {
    "MakeNamedMedium": "participating media were left out",
    "MediumInterface": "participating media were left out",
    "Volume": "participating media were left out",
    "TransformTimes": "",
    "Accelerator": "",
    "PixelFilter": "",
    "Sampler": "",
    "Renderer": "",
    "VolumeIntegrator": "",
    "Option": "",
    "WorldEnd": "",
}
_SPACES = ("srgb", "rec709")


@dataclass(frozen=True)
class PlacedShape:
    """A shape with its state: transform, material, emission, orientation."""

    shape: Entity
    to_world: Float64Array  # (4, 4)
    material: Entity | None  # None: pbrt's default, matt grey
    area: Entity | None
    reversed: bool  # whether ReverseOrientation exchanges front and back
    instance: str = ""  # name of the object of which it is an instance


@dataclass
class PbrtScene:
    """Everything of a pbrt scene that is imported, in a right-handed world."""

    shapes: list[PlacedShape] = field(default_factory=list)
    lights: list[tuple[Entity, Float64Array]] = field(default_factory=list)
    camera: Entity | None = None
    camera_to_world: Float64Array = field(default_factory=lambda: np.eye(4))  # x right, z forward
    film: Entity | None = None
    integrator: Entity | None = None


@dataclass
class _State:
    """Graphics state, saved by AttributeBegin."""

    transform: Float64Array
    material: Entity | str | None = None  # a string is the name of a named material
    area: Entity | None = None
    reversed: bool = False
    textures: dict[str, Entity] = field(default_factory=dict)
    materials: dict[str, Entity] = field(default_factory=dict)
    defaults: dict[str, list[Directive]] = field(default_factory=dict)  # by target of Attribute
    shared: bool = False  # whether the dictionaries belong to an outer state too


def read_scene(path: Path, context: Context) -> PbrtScene:
    """Read a scene file and all that it includes; `InputError` names file and line."""
    return _Interpreter(context).read(path)


class _Interpreter:
    def __init__(self, context: Context) -> None:
        self.context = context
        self.scene = PbrtScene()
        self.state = _State(np.eye(4))
        self.world = np.eye(4)  # transform of the world block, or a mirror image
        self.stack: list[tuple[str, _State]] = []
        self.systems: dict[str, Float64Array] = {}
        self.objects: dict[str, list[PlacedShape]] = {}
        self.object: str | None = None  # being defined
        self.in_world = False
        self.active = True  # whether transforms apply to the start of the shutter time
        # Materials and textures of all scopes: version 4 has no scopes for names.
        self.all_textures: dict[str, Entity] = {}
        self.all_materials: dict[str, Entity] = {}

    def read(self, path: Path) -> PbrtScene:
        for directive in Parser(self.context.sandbox).directives(path):
            if directive.name in _DROPPED:
                if _DROPPED[directive.name]:
                    self.context.changes.note(_DROPPED[directive.name])
                continue
            handle = _HANDLERS.get(directive.name)
            if handle is None:
                handle = _TRANSFORMS.get(directive.name)
                assert handle is not None, directive.name
                if not self.active:
                    continue
            handle(self, directive)
        if self.stack:
            self.context.changes.note("the file ends within an attribute block; it may be cut")
        return self.scene

    def entity(self, directive: Directive, kind: str, target: str = "", label: str = "") -> Entity:
        """The entity that a directive describes, with the defaults set by Attribute."""
        textures, materials = self.state.textures, self.state.materials
        made = Entity(
            directive.name,
            kind,
            directive.place,
            self.context,
            lambda name: textures.get(name) or self.all_textures.get(name),
            lambda name: materials.get(name) or self.all_materials.get(name),
            label,
        )
        for default in self.state.defaults.get(target, []):
            made.add(default.parameters)
        return made.add(directive.parameters)

    # Blocks

    def world_begin(self, directive: Directive) -> None:
        if self.in_world:
            raise InputError(f"{directive.place}: WorldBegin stands twice")
        self.in_world = True
        self.stack.clear()
        if np.linalg.det(self.scene.camera_to_world[:3, :3]) > 0:
            self.world = _MIRROR
            self.scene.camera_to_world = _MIRROR @ self.scene.camera_to_world
            self.systems = {name: _MIRROR @ matrix for name, matrix in self.systems.items()}
        self.state.transform = self.world
        self.state.reversed = False
        self.systems["world"] = self.world

    def push(self, directive: Directive) -> None:
        if len(self.stack) >= MAX_NESTING:
            raise InputError(f"{directive.place}: blocks are nested more than {MAX_NESTING} deep")
        self.stack.append((directive.name.removesuffix("Begin"), replace(self.state)))
        self.state = replace(self.state, shared=True)

    def pop(self, directive: Directive) -> None:
        kind = directive.name.removesuffix("End")
        if not self.stack or self.stack[-1][0] != kind:
            raise InputError(f"{directive.place}: {directive.name} without {kind}Begin")
        saved = self.stack.pop()[1]
        self.state = (
            replace(self.state, transform=saved.transform) if kind == "Transform" else saved
        )

    def object_begin(self, directive: Directive) -> None:
        if self.object is not None:
            raise InputError(f"{directive.place}: objects cannot be nested")
        self.push(directive)
        self.object = directive.text
        self.objects[self.object] = []

    def object_end(self, directive: Directive) -> None:
        self.pop(directive)
        self.object = None

    def instance(self, directive: Directive) -> None:
        members = self.objects.get(directive.text)
        if members is None:
            raise InputError(f"{directive.place}: no object is called {directive.text!r:.80}")
        if self.object is not None:
            raise InputError(f"{directive.place}: an instance cannot be part of an object")
        # Both transforms begin with that of the world block, which must apply once.
        move = self.state.transform @ np.linalg.inv(self.world)
        for member in members:
            if member.area is not None:
                self.context.changes.note("instances do not emit light in pbrt; nor do they here")
            self._add(
                replace(
                    member, to_world=move @ member.to_world, area=None, instance=directive.text
                ),
                directive,
            )

    # State

    def material(self, directive: Directive) -> None:
        self.state.material = self.entity(directive, directive.text, "material")

    def named_material(self, directive: Directive) -> None:
        self.state.material = directive.text

    def make_named_material(self, directive: Directive) -> None:
        made = self.entity(directive, "", "material", directive.text)
        made.type = made.text("type")
        self._unshare()
        self.state.materials[directive.text] = self.all_materials[directive.text] = made

    def texture(self, directive: Directive) -> None:
        name, kind, type_ = directive.strings
        made = self.entity(directive, type_, "texture", name)
        made.directive = f"Texture of {kind}"
        self._unshare()
        self.state.textures[name] = self.all_textures[name] = made

    def area_light(self, directive: Directive) -> None:
        self.state.area = self.entity(directive, directive.text, "light")

    def reverse(self, directive: Directive) -> None:
        self.state.reversed = not self.state.reversed

    def attribute(self, directive: Directive) -> None:
        defaults = dict(self.state.defaults)
        defaults[directive.text] = [*defaults.get(directive.text, []), directive]
        self.state.defaults = defaults

    def color_space(self, directive: Directive) -> None:
        if directive.text.lower() not in _SPACES:
            self.context.changes.note("a colour space was read as sRGB: {}", directive.text[:40])

    def active_transform(self, directive: Directive) -> None:
        self.active = directive.text != "EndTime"
        if not self.active:
            self.context.changes.note("motion was left out; the first moment of the shutter counts")

    # Things

    def shape(self, directive: Directive) -> None:
        material = self.state.material
        if isinstance(material, str):
            material = self._named(material, directive)
        placed = PlacedShape(
            self.entity(directive, directive.text, "shape"),
            self.state.transform,
            material,
            self.state.area,
            self.state.reversed,
        )
        if self.object is None:
            self._add(placed, directive)
        else:
            self.objects[self.object].append(placed)

    def light(self, directive: Directive) -> None:
        self.scene.lights.append(
            (self.entity(directive, directive.text, "light"), self.state.transform)
        )

    def camera(self, directive: Directive) -> None:
        self.scene.camera = self.entity(directive, directive.text)
        self.scene.camera_to_world = _inverse(self.state.transform, directive)
        self.systems["camera"] = self.scene.camera_to_world

    def film(self, directive: Directive) -> None:
        self.scene.film = self.entity(directive, directive.text)

    def integrator(self, directive: Directive) -> None:
        self.scene.integrator = self.entity(directive, directive.text)

    def _add(self, placed: PlacedShape, directive: Directive) -> None:
        if len(self.scene.shapes) >= MAX_SHAPES:
            raise InputError(
                f"{directive.place}: the scene has more than the limit of {MAX_SHAPES:,} shapes"
            )
        self.scene.shapes.append(placed)

    def _named(self, name: str, directive: Directive) -> Entity | None:
        found = self.state.materials.get(name) or self.all_materials.get(name)
        if found is None:
            self.context.changes.note(
                "a material that is not defined became grey: {}",
                f"{name!r:.80} ({directive.place})",
            )
        return found

    def _unshare(self) -> None:
        """Copy the names of an outer block before the first change in this one."""
        if self.state.shared:
            self.state.textures = dict(self.state.textures)
            self.state.materials = dict(self.state.materials)
            self.state.shared = False

    # Transforms

    def concatenate(self, directive: Directive) -> None:
        self.state.transform = self._checked(self.state.transform @ _matrix(directive), directive)

    def set_transform(self, directive: Directive) -> None:
        self.state.transform = self._checked(self.world @ _matrix(directive), directive)

    def identity(self, directive: Directive) -> None:
        self.state.transform = self.world

    def coordinate_system(self, directive: Directive) -> None:
        self.systems[directive.text] = self.state.transform

    def to_coordinate_system(self, directive: Directive) -> None:
        found = self.systems.get(directive.text)
        if found is None:
            self.context.changes.note(
                "a coordinate system that is not defined was left out: {}", directive.text[:80]
            )
        else:
            self.state.transform = found

    def _checked(self, matrix: Float64Array, directive: Directive) -> Float64Array:
        if not np.isfinite(matrix).all() or abs(np.linalg.det(matrix[:3, :3])) < 1e-30:
            raise InputError(f"{directive.place}: the transform is not invertible")
        return matrix


def _inverse(matrix: Float64Array, directive: Directive) -> Float64Array:
    if abs(np.linalg.det(matrix)) < 1e-30:
        raise InputError(f"{directive.place}: the camera's transform is not invertible")
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)


def _matrix(directive: Directive) -> Float64Array:
    """The matrix (4, 4) of a transform directive."""
    values = directive.numbers
    made = np.eye(4)
    if directive.name == "Translate":
        made[:3, 3] = values
    elif directive.name == "Scale":
        made[:3, :3] = np.diag(values)
    elif directive.name == "Rotate":
        made[:3, :3] = _rotation(math.radians(values[0]), values[1:], directive)
    elif directive.name == "LookAt":
        try:
            made = np.asarray(np.linalg.inv(look_at(values[:3], values[3:6], values[6:])))
        except ValueError:
            reason = "LookAt's points and up vector span no frame"
            raise InputError(f"{directive.place}: {reason}") from None
    else:
        made = values.reshape(4, 4).T
        if not np.allclose(made[3], [0, 0, 0, made[3, 3]]) or abs(made[3, 3]) < 1e-12:
            raise InputError(f"{directive.place}: the transform is not affine")
        made = made / made[3, 3]
    return made


def _rotation(angle: float, axis: Float64Array, directive: Directive) -> Float64Array:
    """Rotation (3, 3) about an axis, by Rodrigues' formula."""
    length = float(np.linalg.norm(axis))
    if length == 0:
        raise InputError(f"{directive.place}: Rotate needs an axis")
    x, y, z = axis / length
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * (cross @ cross)


_Handler = Callable[[_Interpreter, Directive], None]
_HANDLERS: dict[str, _Handler] = {
    "WorldBegin": _Interpreter.world_begin,
    **dict.fromkeys(("AttributeBegin", "TransformBegin", "ImportBegin"), _Interpreter.push),
    **dict.fromkeys(("AttributeEnd", "TransformEnd", "ImportEnd"), _Interpreter.pop),
    "ObjectBegin": _Interpreter.object_begin,
    "ObjectEnd": _Interpreter.object_end,
    "ObjectInstance": _Interpreter.instance,
    "Material": _Interpreter.material,
    "NamedMaterial": _Interpreter.named_material,
    "MakeNamedMaterial": _Interpreter.make_named_material,
    "Texture": _Interpreter.texture,
    "AreaLightSource": _Interpreter.area_light,
    "ReverseOrientation": _Interpreter.reverse,
    "Attribute": _Interpreter.attribute,
    "ColorSpace": _Interpreter.color_space,
    "ActiveTransform": _Interpreter.active_transform,
    "Shape": _Interpreter.shape,
    "LightSource": _Interpreter.light,
    "Camera": _Interpreter.camera,
    "Film": _Interpreter.film,
    "Integrator": _Interpreter.integrator,
    "SurfaceIntegrator": _Interpreter.integrator,
    "CoordinateSystem": _Interpreter.coordinate_system,
}
_TRANSFORMS: dict[str, _Handler] = {
    **dict.fromkeys(("Translate", "Scale", "Rotate", "LookAt", "ConcatTransform"),
                    _Interpreter.concatenate),
    "Transform": _Interpreter.set_transform,
    "Identity": _Interpreter.identity,
    "CoordSysTransform": _Interpreter.to_coordinate_system,
}  # fmt: skip
