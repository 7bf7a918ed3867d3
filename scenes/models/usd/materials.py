"""Materials of `shading.py` as Mitsuba 3 BSDFs: `principled`, clear glass, and masks.

Pixar, "UsdPreviewSurface Specification": its metalness and roughness are those of `principled`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar
from xml.etree.ElementTree import Element

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.color import Color
from pbrnet.scenes.files import parse_json
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.materials.surface import Surface, clear_glass, invisible, wrapped
from pbrnet.scenes.importing.materials.textures import TextureStore, UnreadableImage
from pbrnet.scenes.importing.xml_elements import plugin, prop
from pbrnet.scenes.models.model import Emission
from pbrnet.scenes.models.stated import Statement, opaque_bsdf, passing_surface, statement

GREY: Color = (0.18, 0.18, 0.18)  # the default of UsdPreviewSurface
_MAX_GLASS_OPACITY = 0.6  # up to which a material without opacity map is read as clear glass
_WRAPS = {"clamp": "clamp", "black": "clamp", "mirror": "mirror"}
_CHANNELS = {"r": 0, "g": 1, "b": 2, "a": 3}
_FLIP = np.array([[1.0, 0, 0, 0], [0, -1, 0, 1], [0, 0, 1, 0], [0, 0, 0, 1]])  # v to 1 - v
_Kept = TypeVar("_Kept")


@dataclass(frozen=True)
class UsdMaterial:
    """A translated material."""

    surface: Surface
    emission: Emission | None = None


@dataclass
class UsdMaterials:
    """Translates the materials of a stage, each once; `find` returns the path of an image."""

    given: list[dict[str, Any]]
    find: Callable[[str], Path | None]
    textures: TextureStore
    changes: Changes
    _made: dict[tuple[int, Color], UsdMaterial] = field(default_factory=dict)

    def material(self, number: int, color: Color | None) -> UsdMaterial:
        """Return material `number`; for -1 a matt one of `color`, else grey."""
        key = (number, (color or GREY) if number < 0 else GREY)
        if key not in self._made:
            self._made[key] = (
                self._plain(key[1], "") if number < 0 else self._translate(self.given[number])
            )
        return self._made[key]

    def _plain(self, color: Color, name: str) -> UsdMaterial:
        made = wrapped("twosided", plugin("bsdf", "diffuse", reflectance=color))
        return UsdMaterial(Surface(made, double=True, name=name))

    def _translate(self, material: dict[str, Any]) -> UsdMaterial:
        name, kind, inputs = material["name"], material["kind"], material["inputs"]
        if not kind or (not inputs and kind != "UsdPreviewSurface"):
            self.changes.note("materials without a known shader became grey: {}", name)
            return self._plain(GREY, name)
        if kind != "UsdPreviewSurface":
            self.changes.note(f"materials of {kind} were read as far as they resemble others: {{}}",
                              name)  # fmt: skip
        if _scalar(inputs.get("useSpecularWorkflow"), 0) > 0:
            self.changes.note("the specular colour of a material was left out: {}", name)
        stated = _statement(material.get("stated"), name)
        surface = self._surface(inputs, name, stated)
        surface.name = name
        return UsdMaterial(surface, self._emission(inputs.get("emissiveColor")))

    def _surface(self, inputs: dict[str, Any], name: str, stated: Statement | None) -> Surface:
        opacity = inputs.get("opacity")
        alpha = _scalar(opacity, 1.0)
        ior = min(max(_scalar(inputs.get("ior"), 1.5), 1.0), 4.0)
        if stated is not None and stated.is_passing:
            color = self._color(inputs.get("diffuseColor"), GREY)
            return passing_surface(stated, color, _scalar(inputs.get("roughness"), 0.5), ior)
        cutoff = _scalar(inputs.get("opacityThreshold"), 0.0)
        textured = self._image(opacity) is not None
        if stated is None and not textured and alpha <= _MAX_GLASS_OPACITY and cutoff <= 0:
            self.changes.note("a transparent material became clear glass: {}", name)
            return clear_glass(max(ior, 1.05))
        if not textured and alpha < cutoff:
            return invisible()
        made = self._opaque(inputs, ior, stated)
        made = self._with_normals(made, inputs.get("normal"))
        if not textured and (alpha >= 0.999 or cutoff > 0):
            return Surface(wrapped("twosided", made), double=True)
        opacity_found = self._opacity(opacity, alpha, cutoff)
        masked = wrapped("mask", wrapped("twosided", made), opacity=opacity_found)
        return Surface(masked, transmissive=True)

    def _opaque(self, inputs: dict[str, Any], ior: float, stated: Statement | None) -> Element:
        color = self._color(inputs.get("diffuseColor"), GREY)
        if stated is not None and stated.is_opaque:
            return opaque_bsdf(stated, color, _scalar(inputs.get("roughness"), 0.5), ior)
        made = plugin(
            "bsdf",
            "principled",
            base_color=color,
            roughness=self._value(inputs.get("roughness"), 0.5),
            metallic=self._value(inputs.get("metallic"), 0.0),
            # Mitsuba's `specular` is the reflectance at normal incidence divided by 8 %.
            specular=min(((ior - 1) / (ior + 1)) ** 2 / 0.08, 1.0),
        )
        coat = _scalar(inputs.get("clearcoat"), 0.0)
        if coat > 0:
            made.append(prop("clearcoat", min(coat, 1.0)))
            softness = min(max(_scalar(inputs.get("clearcoatRoughness"), 0.01), 0.0), 1.0)
            made.append(prop("clearcoat_gloss", 1 - softness))
        if stated is not None and stated.sheen > 0:
            made.append(prop("sheen", stated.sheen))
        return made

    def _emission(self, given: dict[str, Any] | None) -> Emission | None:
        if given is None:
            return None
        strength = float(given.get("strength", 1.0))
        image = self._image(given)
        values = given.get("value", given.get("scale", 1.0) if image else 0.0)
        color = _triple(values, 0.0, 1e9)
        if not math.isfinite(strength) or max(color) * strength <= 0:
            return None
        red, green, blue = (min(value * strength, 1e12) for value in color)
        return Emission((red, green, blue), image, None if image is None else _to_uv(given))

    def _color(self, given: dict[str, Any] | None, default: Color) -> Color | Element:
        if given is None:
            return default
        path = self._image(given)
        if path is None:
            return _triple(given.get("value", given.get("fallback", default)), 0.0, 1.0)
        factor = _triple(given.get("scale", 1.0), 0.0, 1.0)
        try:
            stored = (
                self.textures.scaled(path, np.array(factor))
                if min(factor) < 1
                else self.textures.color(path)
            )
        except UnreadableImage as error:
            return self._damaged(path, error, factor)
        return _bitmap(stored, given, raw=True if given.get("space") == "raw" else None)

    def _value(self, given: dict[str, Any] | None, default: float) -> float | Element:
        """A number of [0, 1], or the channel of an image."""
        path = self._image(given)
        if given is None or path is None:
            return min(max(_scalar(given, default), 0.0), 1.0)
        channel = _CHANNELS.get(given["channel"], 0)
        scale = _triple(given.get("scale", 1.0), 0.0, 1.0)[min(channel, 2)]
        try:
            stored = self.textures.channel_scaled(path, channel, scale)
        except UnreadableImage as error:
            return self._damaged(path, error, default)
        return _bitmap(stored, given, raw=True)

    def _opacity(
        self, given: dict[str, Any] | None, alpha: float, cutoff: float
    ) -> float | Element:
        path = self._image(given)
        if given is None or path is None:
            return alpha
        try:
            if given["channel"] == "a" and cutoff > 0:
                return _bitmap(self.textures.cutout(path, 1.0, cutoff), given, raw=True)
        except UnreadableImage as error:
            return self._damaged(path, error, 1.0)
        return self._value(given, 1.0)

    def _with_normals(self, bsdf: Element, given: dict[str, Any] | None) -> Element:
        path = self._image(given)
        if given is None or path is None:
            return bsdf
        try:
            made = _bitmap(self.textures.color(path), given, raw=True)
        except UnreadableImage as error:
            return self._damaged(path, error, bsdf)
        return wrapped("normalmap", bsdf, normalmap=made)

    def _image(self, given: dict[str, Any] | None) -> Path | None:
        return self.find(given["file"]) if given is not None and given.get("file") else None

    def _damaged(self, path: Path, error: UnreadableImage, kept: _Kept) -> _Kept:
        self.changes.note(
            "damaged texture, replaced by the plain value: {}", f"{path.name} ({error})"
        )
        return kept


def _statement(text: Any, name: str) -> Statement | None:
    """Statement of `pbrnet export-scene` on a material, where UsdPreviewSurface says less."""
    where = f"material {name!r:.100}: pbrnet"
    return statement(parse_json(text, where), where) if isinstance(text, str) else None


def _bitmap(stored: str, given: dict[str, Any], raw: bool | None) -> Element:
    wrap = _WRAPS.get(str(given.get("wrap")))
    filter_type = "nearest" if given.get("nearest") else None
    return plugin("texture", "bitmap", filename=stored, wrap_mode=wrap, raw=raw,
                  filter_type=filter_type, to_uv=_to_uv(given))  # fmt: skip


def _to_uv(given: dict[str, Any]) -> Float64Array | None:
    """The matrix (4, 4) of a UsdTransform2d (scale, rotate, translate), for v from the top."""
    transform = given.get("transform")
    if not transform:
        return None
    angle = math.radians(_scalar({"value": transform.get("rotation", 0.0)}, 0.0))
    scale = _triple([*_list(transform.get("scale", 1.0)), 1.0], -1e6, 1e6)
    shift = _triple([*_list(transform.get("translation", 0.0)), 0.0], -1e6, 1e6)
    cos, sin = math.cos(angle), math.sin(angle)
    matrix = np.eye(4)
    matrix[:2, :2] = np.array([[cos, -sin], [sin, cos]]) @ np.diag(scale[:2])
    matrix[:2, 3] = shift[:2]
    return _FLIP @ matrix @ _FLIP


def _scalar(given: dict[str, Any] | None, default: float) -> float:
    """A number of an input; `default` if it is absent, an image or not finite."""
    value = None if given is None else given.get("value")
    if isinstance(value, list) and value:
        value = sum(value[:3]) / len(value[:3])
    if isinstance(value, bool | int | float) and math.isfinite(value):
        return float(value)
    return default


def _list(value: Any) -> list[Any]:
    return list(value[:2]) if isinstance(value, list) else [value, value]


def _triple(value: Any, low: float, high: float) -> Color:
    values = value[:3] if isinstance(value, list | tuple) else [value] * 3
    if len(values) < 3 or not all(isinstance(one, int | float) for one in values):
        return GREY
    red, green, blue = (float(one) for one in np.clip(np.nan_to_num(values), low, high))
    return (red, green, blue)
