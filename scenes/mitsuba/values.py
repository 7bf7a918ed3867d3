"""Typed access to the properties of a plugin by their Mitsuba 3 names, for all versions."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from pbrnet.scenes.arrays import Float64Array, as_triple
from pbrnet.scenes.color import XYZ_TO_RGB, Color, decode_srgb
from pbrnet.scenes.geometry.transforms import look_at
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.materials.spectra import blackbody_radiance, spectrum_to_rgb
from pbrnet.scenes.importing.sandbox import Sandbox
from pbrnet.scenes.mitsuba.reader import Node, unresolved
from pbrnet.scenes.photometry import blackbody

T = TypeVar("T")
Matrix4 = Float64Array

_MAX_REFERENCES = 32
_MAX_NESTING = 16  # of materials and textures
_CAMEL = re.compile(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")
_TRUTH = {"true": True, "1": True, "false": False, "0": False}


@dataclass
class Scope:
    """Context in which properties are read: elements by id, files, version, list of changes."""

    sandbox: Sandbox
    changes: Changes
    version: tuple[int, ...]
    by_id: dict[str, Node] = field(default_factory=dict)
    _depth: int = field(default=0, init=False)  # of the materials and textures being read

    @property
    def is_old(self) -> bool:
        """Return whether the file is of version 0.x, which has other default values."""
        return self.version < (2,)

    def resolve(self, node: Node) -> Node:
        """Follow `<ref>`s to the element with that id; `InputError` for unknown ids and cycles."""
        seen = 0
        while node.tag == "ref":
            target = self.by_id.get(node.attributes.get("id", ""))
            if target is None:
                raise node.error(f"no element has the id {node.attributes.get('id', '')!r}")
            seen += 1
            if seen > _MAX_REFERENCES:
                raise node.error("references form a cycle")
            node = target
        return node

    @contextmanager
    def nested(self, node: Node, what: str) -> Iterator[None]:
        """Bound how deep materials and textures are nested; `InputError` names `what` they are."""
        if self._depth >= _MAX_NESTING:
            raise node.error(f"{what} are nested too deep or inside themselves")
        self._depth += 1
        try:
            yield
        finally:
            self._depth -= 1


def snake(name: str) -> str:
    """Convert a name such as `intIOR` or `alphaU` to Mitsuba 3's spelling, `int_ior`, `alpha_u`."""
    return _CAMEL.sub("_", name).lower()


class Properties:
    """The properties and nested plugins of one element.

    Accessors return a default for a property that is absent or has no value. They record what
    was read; `report_unused` notes all other properties as left out.
    """

    def __init__(self, node: Node, scope: Scope, aliases: dict[str, str] | None = None) -> None:
        self.node, self.scope = node, scope
        self._values: dict[str, Node] = {}
        self._nested: list[Node] = []
        self._used: set[str] = set()
        for child in node.children:
            name = snake(child.name)
            name = (aliases or {}).get(name, name)
            if child.name:
                self._values[name] = child
            if not child.is_value:
                self._nested.append(child)

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def ignore(self, *names: str) -> None:
        """Exclude properties from `report_unused`."""
        self._used.update(names)

    def child(self, name: str) -> Node | None:
        """Return the element that sets `name`, with references resolved, or None."""
        self._used.add(name)
        found = self._values.get(name)
        return None if found is None else self.scope.resolve(found)

    def number(self, name: str, default: float) -> float:
        """Return a finite float."""
        return self._read(name, default, _number)

    def whole(self, name: str, default: int) -> int:
        """Return an integer."""
        return self._read(name, default, lambda node, text: int(_number(node, text)))

    def boolean(self, name: str, default: bool) -> bool:
        """Return a boolean."""
        return self._read(name, default, _boolean)

    def text(self, name: str, default: str) -> str:
        """Return a string."""
        return self._read(name, default, lambda node, text: text)

    def vector(self, name: str) -> Float64Array | None:
        """Return a point or vector, float64 (3,), or None."""
        node = self.child(name)
        if node is None or self._missing(node):
            return None
        return _triple(node, 0.0)

    def transform(self, name: str = "to_world") -> Matrix4:
        """Return a matrix (4, 4) for column vectors; the identity if absent."""
        node = self.child(name)
        return np.eye(4) if node is None else read_transform(node, self.scope)

    def color(
        self, name: str, emission: bool = False, measured: bool = False
    ) -> Color | Node | None:
        """Return linear Rec. 709 RGB, the element of a texture, or None.

        `measured` as for `read_color`.
        """
        node = self.child(name)
        if node is None or self._missing(node):
            return None
        return read_color(node, self.scope, emission, measured)

    def nested(self, *tags: str) -> list[Node]:
        """Return nested plugins with these tags, references resolved, in document order."""
        found = []
        for child in self._nested:
            target = self.scope.resolve(child)
            if target.tag in tags:
                self._used.add(snake(child.name))
                found.append(target)
        return found

    def report_unused(self) -> None:
        """Note every property that was not read as left out."""
        for name in self._values:
            if name not in self._used:
                self.scope.changes.note(
                    f"{self.node.tag} {self.node.type!r}: property {name!r} has no equivalent and "
                    "was left out"
                )
            self._used.add(name)
        for child in self._nested:
            if not child.name and self.scope.resolve(child).tag in ("medium", "subsurface"):
                self.scope.changes.note(f"{self.node.tag}: {child.tag} was left out")

    def _read(self, name: str, default: T, convert: Callable[[Node, str], T]) -> T:
        node = self.child(name)
        if node is None or self._missing(node):
            return default
        return convert(node, node.attributes.get("value", ""))

    def _missing(self, node: Node) -> bool:
        names = [name for text in node.attributes.values() for name in unresolved(text)]
        for name in names:
            self.scope.changes.note(
                "a parameter without a value was replaced by the default (set it with "
                "--parameter): {}",
                f"${name}",
            )
        return bool(names)


def read_transform(node: Node, scope: Scope) -> Matrix4:
    """Return the product (4, 4) of a `<transform>`'s steps, the first one applied first."""
    if node.tag == "animation":
        scope.changes.note("an animation was replaced by its first keyframe")
        frames = [child for child in node.children if child.tag == "transform"]
        return read_transform(frames[0], scope) if frames else np.eye(4)
    if node.tag != "transform":
        raise node.error("must be a <transform>")
    matrix = np.eye(4)
    for step in node.children:
        kind = step.tag.lower()
        if kind == "matrix":
            values = _numbers(step, step.attributes.get("value", ""))
            if len(values) not in (9, 16):
                raise step.error(f"a matrix must have 16 or 9 values, not {len(values)}")
            move = np.eye(4)
            side = math.isqrt(len(values))
            move[:side, :side] = np.reshape(values, (side, side))
        elif kind == "translate":
            move = np.eye(4)
            move[:3, 3] = _triple(step, 0.0)
        elif kind == "scale":
            move = np.diag([*_triple(step, 1.0), 1.0])
        elif kind == "rotate":
            move = np.eye(4)
            angle = math.radians(_number(step, step.attributes.get("angle", "")))
            move[:3, :3] = rotation(_triple(step, 0.0), angle, step)
        elif kind == "lookat":
            move = _look_at(step)
        else:
            raise step.error(
                "is not a step of a transform; use matrix, translate, scale, rotate or lookat"
            )
        matrix = move @ matrix
    if not np.isfinite(matrix).all() or abs(np.linalg.det(matrix[:3, :3])) < 1e-18:
        raise node.error("the transform is not invertible (its determinant is 0)")
    return matrix


def rotation(axis: Float64Array, angle: float, node: Node) -> Float64Array:
    """Return the rotation (3, 3) by `angle` radians about `axis` (3,) (Rodrigues)."""
    length = float(np.linalg.norm(axis))
    if length == 0:
        raise node.error("a rotation needs an axis other than 0, 0, 0")
    x, y, z = axis / length
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def read_color(
    node: Node, scope: Scope, emission: bool = False, measured: bool = False
) -> Color | Node:
    """Return linear Rec. 709 RGB of a colour element of any type, or `node` if it is a texture.

    Negative values are refused, but for `measured` quantities, such as a metal's refractive
    index: their conversion from a spectrum may leave the gamut, so they are clamped at 0 and noted.
    """
    text = node.attributes.get("value", "").strip()
    if node.tag == "texture":
        return node
    if node.tag in ("rgb", "srgb"):
        rgb = _hex(node, text) if text.startswith("#") else np.array(_numbers(node, text))
        if rgb.size not in (1, 3):
            raise node.error(f"a colour must have 1 or 3 values, not {rgb.size}")
        rgb = np.broadcast_to(rgb, 3).astype(float)
        if node.tag == "srgb":
            rgb = decode_srgb(rgb)
    elif node.tag == "xyz":
        rgb = np.array(_numbers(node, text))
        if rgb.size != 3:
            raise node.error(f"a colour must have 3 values, not {rgb.size}")
        rgb = np.maximum(XYZ_TO_RGB @ rgb, 0)
    elif node.tag in ("float", "integer"):
        rgb = np.full(3, _number(node, text))
    elif node.tag == "blackbody":
        kelvin = _number(node, node.attributes.get("temperature", text).rstrip("Kk "))
        # Version 0.3 called the factor "multiplier".
        factor = node.attributes.get("scale", node.attributes.get("multiplier", "1"))
        rgb = _blackbody(node, kelvin, scope) * _number(node, factor)
    elif node.tag == "spectrum" and node.type:
        rgb = _spectrum_plugin(node, scope, emission)
    elif node.tag == "spectrum":
        rgb = _spectrum(node, text, scope, emission)
    else:
        raise node.error("is neither a colour nor a texture")
    if measured and rgb.min() < 0 < rgb.max():
        scope.changes.note("negative values of a measured metal became 0: {}", text)
        rgb = np.maximum(rgb, 0.0)
    if (rgb < 0).any():
        raise node.error(f"a colour cannot be negative: {text!r}")
    return as_triple(rgb)


def _spectrum(node: Node, text: str, scope: Scope, emission: bool) -> Float64Array:
    if "filename" in node.attributes:
        path = scope.sandbox.find(node.attributes["filename"], node.place)
        if path is None:
            scope.changes.note(
                "missing spectrum file, replaced by grey: {}",
                text or node.attributes["filename"],
            )
            return np.full(3, 1.0 if emission else 0.5)
        if path.stat().st_size > 2**20:
            raise node.error(f"{path}: a spectrum file may have at most 1 MiB")
        lines = path.read_text(encoding="latin-1").splitlines()
        rows = [line.split("#")[0].split() for line in lines]
        text = ", ".join(":".join(row[:2]) for row in rows if len(row) >= 2)
    if ":" not in text:
        values = np.array(_numbers(node, text))
        if values.size in (1, 3):
            return np.broadcast_to(values, 3).astype(float)
        raise node.error("a spectrum is one number, three, or 'wavelength:value' pairs")
    pairs = [part.split(":") for part in re.split(r"[,;\s]+", text) if part]
    if any(len(pair) != 2 for pair in pairs) or len(pairs) > 10_000:
        raise node.error("a spectrum is one number, three, or 'wavelength:value' pairs")
    wavelengths = np.array([_number(node, pair[0]) for pair in pairs])
    values = np.array([_number(node, pair[1].rstrip("f")) for pair in pairs])
    if (np.diff(wavelengths) <= 0).any():
        raise node.error("the wavelengths of a spectrum must increase")
    scope.changes.note("a measured spectrum was converted to linear RGB")
    return spectrum_to_rgb(wavelengths, values)


def _blackbody(node: Node, kelvin: float, scope: Scope) -> Float64Array:
    if not 100 <= kelvin <= 100_000:
        raise node.error(
            f"the temperature of the black body is {kelvin:g} K; it must be from 100 to 100000"
        )
    scope.changes.note("a blackbody spectrum was converted to linear RGB")
    return np.array(blackbody(kelvin)) * blackbody_radiance(kelvin)


def _spectrum_plugin(node: Node, scope: Scope, emission: bool) -> Float64Array:
    """Linear RGB (3,) of a spectrum plugin of Mitsuba 2 or 3, such as `<spectrum type="d65">`."""
    properties = Properties(node, scope)
    properties.ignore("id")
    scale = properties.number("scale", 1.0)
    if node.type in ("uniform", "rawconstant", "srgb", "rgb", "d65"):
        # D65 is the white of RGB; its `color` tints it.
        found = properties.color("color", emission) or properties.color("value", emission)
        if isinstance(found, Node):
            raise node.error("a spectrum cannot have a texture")
        rgb = np.array(found if found is not None else (1.0, 1.0, 1.0)) * scale
    elif node.type == "blackbody":
        rgb = _blackbody(node, properties.number("temperature", 5000.0), scope) * scale
    elif node.type in ("regular", "irregular"):
        values = np.array(_numbers(node, properties.text("values", "")))
        if node.type == "irregular":
            wavelengths = np.array(_numbers(node, properties.text("wavelengths", "")))
        else:
            low = properties.number("wavelength_min", 360.0)
            high = properties.number("wavelength_max", 830.0)
            wavelengths = np.linspace(low, high, len(values))
        if len(values) < 2 or len(values) != len(wavelengths) or (np.diff(wavelengths) <= 0).any():
            raise node.error("needs at least two increasing wavelengths and a value for each")
        scope.changes.note("a measured spectrum was converted to linear RGB")
        rgb = spectrum_to_rgb(wavelengths, values)
    else:
        scope.changes.note(
            "unknown spectrum, replaced by grey: {}", f"{node.type!r} ({node.place})"
        )
        properties.ignore(*(snake(child.name) for child in node.children))
        rgb = np.full(3, 1.0 if emission else 0.5)
    properties.report_unused()
    return rgb


def _look_at(node: Node) -> Matrix4:
    attributes = node.attributes
    if "ox" in attributes:  # spelling of version 0.2
        points = [
            np.array([_number(node, attributes.get(f"{point}{axis}", "0")) for axis in "xyz"])
            for point in "otu"
        ]
    else:
        points = []
        for name in ("origin", "target", "up"):
            text = attributes.get(name, "0, 1, 0" if name == "up" else "")
            values = _numbers(node, text)
            if len(values) != 3:
                raise node.error(f"{name} must have 3 values, got {text!r}")
            points.append(np.array(values))
        if "up" not in attributes or not points[2].any():
            points[2] = _some_up(points[1] - points[0])
    try:
        return look_at(points[0], points[1], points[2])
    except ValueError as error:
        raise node.error(str(error)) from error


def _some_up(forward: Float64Array) -> Float64Array:
    """The up direction (3,) of a look-at without one: +y, or +x for a view along y."""
    upright = np.linalg.norm(forward[[0, 2]]) > 1e-6 * np.linalg.norm(forward)
    return np.array([0.0, 1, 0] if upright else [1.0, 0, 0])


def _triple(node: Node, default: float) -> Float64Array:
    attributes = node.attributes
    if "value" in attributes:
        values = _numbers(node, attributes["value"])
        if len(values) not in (1, 3):
            raise node.error(f"must have 1 or 3 values, got {attributes['value']!r}")
        return np.broadcast_to(np.array(values, dtype=float), 3).copy()
    return np.array([_number(node, attributes.get(axis, str(default))) for axis in "xyz"])


def _number(node: Node, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise node.error(f"{text!r} is not a number") from None
    if not math.isfinite(value):
        raise node.error(f"{text!r} is not a finite number")
    return value


def _numbers(node: Node, text: str) -> list[float]:
    return [_number(node, part) for part in re.split(r"[,;\s]+", text.strip()) if part]


def _boolean(node: Node, text: str) -> bool:
    try:
        return _TRUTH[text.strip().lower()]
    except KeyError:
        raise node.error(f"{text!r} is neither true nor false") from None


def _hex(node: Node, text: str) -> Float64Array:
    if not re.fullmatch(r"#[0-9a-fA-F]{6}", text):
        raise node.error(f"{text!r} is not a colour such as #a0b0c0")
    return np.array([int(text[index : index + 2], 16) / 255 for index in (1, 3, 5)])
