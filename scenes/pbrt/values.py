"""Typed access to the parameters of a pbrt directive, and conversion of its spectra to RGB."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.color import XYZ_TO_RGB, Color
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.materials.spectra import spectrum_to_rgb
from pbrnet.scenes.importing.sandbox import Sandbox
from pbrnet.scenes.pbrt.parser import Parameter
from pbrnet.scenes.photometry import blackbody

_MAX_SPECTRUM = 2**20  # bytes of a file
_COLOR_KINDS = ("rgb", "color", "xyz", "blackbody", "spectrum")

# Indices of refraction at 589 nm of the glasses that version 4 knows by name.
GLASSES = {
    "glass-bk7": 1.5168,
    "glass-baf10": 1.6700,
    "glass-fk51a": 1.4866,
    "glass-lasf9": 1.8503,
    "glass-f5": 1.6034,
    "glass-sf5": 1.6727,
    "glass-sf10": 1.7283,
    "glass-sf11": 1.7847,
}


@dataclass
class Context:
    """Files and list of changes while a scene is read."""

    sandbox: Sandbox
    changes: Changes


@dataclass
class Entity:
    """Something with a type and parameters: a shape, material, texture, light or camera.

    Accessors return a default for a parameter that is absent, and record what was read;
    `report_unused` notes all others as left out. Raises `InputError` for values of a wrong type.
    """

    directive: str  # as in the file, such as "Shape"
    type: str
    place: str
    context: Context
    find_texture: Callable[[str], Entity | None]  # by name, among those of its scope
    find_material: Callable[[str], Entity | None]
    label: str = ""  # name of a named material or texture
    _parameters: dict[str, Parameter] = field(default_factory=dict)
    _used: set[str] = field(default_factory=set)

    def add(self, parameters: Iterable[Parameter]) -> Entity:
        """Set parameters; later ones replace earlier ones of the same name."""
        self._parameters |= {parameter.name: parameter for parameter in parameters}
        return self

    def __contains__(self, name: str) -> bool:
        return name in self._parameters

    def names(self) -> tuple[str, ...]:
        """Return the names of all parameters."""
        return tuple(self._parameters)

    def error(self, text: str) -> InputError:
        """Return an error that begins with the place of the directive."""
        return InputError(f"{self.place}: {self.directive} {self.type!r:.60}: {text}")

    def ignore(self, *names: str) -> None:
        """Exclude parameters from `report_unused`."""
        self._used.update(names)

    def report_unused(self) -> None:
        """Note every parameter that was not read."""
        for name in self._parameters:
            if name not in self._used:
                self.context.changes.note(
                    f"{self.directive} {self.type!r:.60}: parameter {name!r:.60} has no "
                    "equivalent and was left out"
                )
            self._used.add(name)

    def numbers(self, name: str, width: int = 1) -> Float64Array | None:
        """Return numbers (N,), or vectors (N, width) if `width` is more than 1; None if absent."""
        parameter = self._get(name)
        if parameter is None:
            return None
        if not isinstance(parameter.values, np.ndarray):
            raise self._wrong(parameter, "numbers")
        if len(parameter.values) % width:
            raise self._wrong(parameter, f"a multiple of {width} numbers")
        return parameter.values.reshape(-1, width) if width > 1 else parameter.values

    def number(self, name: str, default: float) -> float:
        """Return one number; a spectrum's mean; a texture is replaced by its mean, with a note."""
        parameter = self._get(name)
        if parameter is None:
            return default
        if parameter.kind == "texture":
            texture = self.texture(name)
            return default if texture is None else _mean(texture, default)
        if parameter.kind == "spectrum" and isinstance(parameter.values, list):
            return GLASSES.get(str(parameter.values[0]).lower(), default)
        if not isinstance(parameter.values, np.ndarray) or not len(parameter.values):
            raise self._wrong(parameter, "a number")
        if parameter.kind == "spectrum":
            return float(parameter.values[1::2].mean()) if len(parameter.values) > 1 else default
        return float(parameter.values[0])

    def whole(self, name: str, default: int) -> int:
        """Return one integer."""
        return int(self.number(name, default))

    def boolean(self, name: str, default: bool) -> bool:
        """Return a truth value, with or without quotes."""
        parameter = self._get(name)
        if parameter is None or not len(parameter.values):
            return default
        if isinstance(parameter.values, np.ndarray):
            return bool(parameter.values[0])
        return str(parameter.values[0]).lower() == "true"

    def text(self, name: str, default: str = "") -> str:
        """Return a string."""
        found = self.strings(name)
        return found[0] if found else default

    def strings(self, name: str) -> list[str]:
        """Return a list of strings; empty if absent."""
        parameter = self._get(name)
        if parameter is None:
            return []
        if not isinstance(parameter.values, list):
            raise self._wrong(parameter, "a string")
        return [str(value) for value in parameter.values]

    def is_texture(self, name: str) -> bool:
        """Return whether a parameter names a texture."""
        found = self._parameters.get(name)
        return found is not None and found.kind == "texture"

    def texture(self, name: str) -> Entity | None:
        """Return the texture that a parameter names; None, with a note, if it is not defined."""
        label = self.text(name)
        found = self.find_texture(label)
        if found is None:
            self.context.changes.note(
                "a texture that is not defined was left out: {}", f"{label!r:.80} ({self.place})"
            )
        return found

    def spectrum_name(self, name: str) -> str:
        """Return the name of a named spectrum or its file, without folder; empty otherwise."""
        found = self._parameters.get(name)
        if found is None or found.kind != "spectrum" or not isinstance(found.values, list):
            return ""
        self._used.add(name)
        return str(found.values[0]).replace("\\", "/").rpartition("/")[2] if found.values else ""

    def color(self, name: str, default: Color | None = None) -> Color | None:
        """Return linear Rec. 709 RGB; of a black body scaled to luminance 1."""
        parameter = self._get(name)
        if parameter is None:
            return default
        values = parameter.values
        if isinstance(values, list):
            return self._named_spectrum(str(values[0]) if values else "", default)
        kind = parameter.kind
        if kind == "spectrum":
            return _sampled(values) if len(values) >= 2 else _grey(values, self, parameter)
        if kind == "blackbody" and len(values):
            scale = values[1] if len(values) > 1 else 1.0
            return _color(np.array(blackbody(float(values[0]))) * scale)
        if kind in _COLOR_KINDS and len(values) == 3:
            return _color(XYZ_TO_RGB @ values if kind == "xyz" else values)
        return _grey(values, self, parameter)

    def _named_spectrum(self, name: str, default: Color | None) -> Color | None:
        if name.lower().startswith(("stdillum", "illum")):
            return (1.0, 1.0, 1.0)
        path = self.context.sandbox.find(name, self.place) if name else None
        if path is None or path.stat().st_size > _MAX_SPECTRUM:
            self.context.changes.note("an unknown spectrum was left out: {}", repr(name)[:80])
            return default
        words = [
            word
            for line in path.read_bytes().decode("utf-8", "replace").splitlines()
            for word in line.partition("#")[0].split()
        ]
        try:
            values = np.array(words, dtype=np.float64)
        except ValueError:
            values = np.zeros(0)
        if len(values) < 2 or not np.isfinite(values).all():
            self.context.changes.note("a damaged spectrum was left out: {}", path.name)
            return default
        return _sampled(values)

    def _get(self, name: str) -> Parameter | None:
        self._used.add(name)
        return self._parameters.get(name)

    def _wrong(self, parameter: Parameter, expected: str) -> InputError:
        return InputError(
            f"{parameter.place}: {self.directive} {self.type!r:.60}: {parameter.name!r:.60} must "
            f"be {expected}"
        )


def without_excess(color: Color, changes: Changes) -> Color:
    """A reflectance clipped to [0, 1], with a note."""
    if max(color) > 1:
        changes.note("a reflectance above 1 was clipped to 1")
    return (min(color[0], 1.0), min(color[1], 1.0), min(color[2], 1.0))


def _mean(texture: Entity, default: float) -> float:
    texture.context.changes.note("a texture of a number was replaced by its mean value")
    if texture.type == "constant" and not texture.is_texture("value"):
        return texture.number("value", 1.0)
    return default


def _grey(values: Float64Array, entity: Entity, parameter: Parameter) -> Color:
    if len(values) != 1:
        raise entity._wrong(parameter, "a colour")
    return _color(np.full(3, values[0]))


def _sampled(values: Float64Array) -> Color:
    """RGB of wavelengths in nm and values in turn; constant beyond the first and last sample."""
    pairs = values[: len(values) // 2 * 2].reshape(-1, 2)
    pairs = pairs[np.argsort(pairs[:, 0], kind="stable")]
    wavelengths = np.concatenate([[min(pairs[0, 0], 300.0)], pairs[:, 0],
                                  [max(pairs[-1, 0], 900.0)]])  # fmt: skip
    amounts = np.concatenate([pairs[:1, 1], pairs[:, 1], pairs[-1:, 1]])
    return _color(spectrum_to_rgb(wavelengths, amounts))


def _color(values: Float64Array) -> Color:
    red, green, blue = np.maximum(values, 0.0).tolist()
    return (red, green, blue)
