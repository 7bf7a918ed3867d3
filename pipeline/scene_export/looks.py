"""BSDFs of `scene.xml` as the few parameters that interchange formats know.

A `Look` is the common part of glTF's metallic-roughness with its extensions and of
UsdPreviewSurface. It inverts what the importers of these formats write, so that a material they
made comes back as it was. What has no counterpart is noted.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Literal
from xml.etree.ElementTree import Element

import numpy as np

from pbrnet.pipeline.scene_export.measured import ior_in_air, metal
from pbrnet.scenes.arrays import Float64Array, as_triple
from pbrnet.scenes.checked import build
from pbrnet.scenes.color import REC709, Color
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.models.stated import Statement
from pbrnet.scenes.photometry import LUMEN

_NUMBERS = re.compile(r"[,\s]+")
_GREY: Color = (0.5, 0.5, 0.5)
_WHITE: Color = (1.0, 1.0, 1.0)
_COPPER: tuple[Color, Color] = ((0.2, 0.92, 1.1), (3.91, 2.45, 2.14))  # eta and k


@dataclass(frozen=True)
class Picture:
    """An image in the scene folder, and how it is looked up; v = 0 is its top row."""

    file: str  # relative to the scene folder
    nearest: bool = False
    wrap: str = "repeat"  # or "clamp", "mirror"
    to_uv: tuple[tuple[float, float, float], ...] = ()  # two rows of an affine map, () for none
    raw: bool = False  # its values are linear, not sRGB


@dataclass(frozen=True)
class Look:
    """A material; colours are linear, roughness is perceptual, shares are in [0, 1]."""

    base: Color | Picture = _GREY
    roughness: float | Picture = 0.5
    metallic: float | Picture = 0.0
    normal: Picture | None = None
    opacity: float | Picture = 1.0
    specular: float = 0.5  # reflectance at normal incidence, in units of 8 %
    clearcoat: float = 0.0
    clearcoat_roughness: float = 0.0
    sheen: float = 0.0
    transmission: float = 0.0  # specular: glass
    diffuse_transmission: float = 0.0  # of thin sheets: share of the diffuse light that passes
    ior: float = 1.5
    solid: bool = False  # glass that refracts, not a thin pane
    two_sided: bool = False
    stated: Statement | None = None  # what the values above do not say

    @property
    def is_plain(self) -> bool:
        """True of an opaque material without images."""
        images = (self.base, self.roughness, self.metallic, self.normal, self.opacity)
        passing = self.transmission > 0 or self.diffuse_transmission > 0 or self.opacity != 1
        return not passing and not any(isinstance(one, Picture) for one in images)


def _mean(first: Look, second: Look, weight: float) -> Look:
    """A plain look between two; of equal kinds it keeps the kind."""
    mixed = {
        one.name: (1 - weight) * np.array(getattr(first, one.name))
        + weight * np.array(getattr(second, one.name))
        for one in fields(Look)
        if one.type in ("float", "float | Picture", "Color | Picture")
    }
    values = {name: float(value) for name, value in mixed.items() if name != "base"}
    stated = first.stated if first.stated == second.stated else None
    made: Look = replace(first, base=as_triple(mixed["base"]), stated=stated, **values)  # type: ignore[arg-type]
    return made


_MATT = Look(roughness=1.0, specular=0.0, stated=Statement("diffuse"))


@dataclass(frozen=True)
class Glow:
    """Emission of a surface: luminance in cd/m^2, RGB; times an image of radiance if given."""

    color: Color
    image: Picture | None = None


class LookReader:
    """Reads the materials of a scene; `named` maps ids to elements of `scene.xml`."""

    def __init__(self, named: dict[str, Element], lost: Changes) -> None:
        self._named, self._lost = named, lost

    def look(self, bsdf: Element | None) -> Look:
        """Return the look of a BSDF element; None is Mitsuba's default, grey and matt."""
        if bsdf is None:
            return _MATT
        kind = bsdf.get("type", "")
        rule = _RULES.get(kind)
        if rule is None:
            self._lost.note("materials of a kind without counterpart became grey: {}", kind)
            return _MATT
        return rule(self, bsdf)

    def glow(self, emitter: Element) -> Glow:
        """Return the emission of an area emitter."""
        radiance = self.color(emitter, "radiance", _WHITE)
        if isinstance(radiance, Picture):
            return Glow((1 / LUMEN,) * 3, radiance)
        return Glow(as_triple(np.array(radiance) / LUMEN))

    def find(self, element: Element, name: str) -> Element | None:
        """Return a property's element; a reference is followed."""
        for child in element:
            if child.get("name") == name:
                return self._named.get(child.get("id", "")) if child.tag == "ref" else child
        return None

    def nested(self, element: Element, tag: str) -> list[Element]:
        """Return the children of a kind, those behind references included."""
        children = [self._named.get(c.get("id", ""), c) if c.tag == "ref" else c for c in element]
        return [child for child in children if child.tag == tag]

    def scalar(self, element: Element, name: str, default: float) -> float | Picture:
        """Return a number or a grey image; of a colour its luminance."""
        value = self.color(element, name, (default,) * 3)
        return value if isinstance(value, Picture) else _grey(value)

    def number(self, element: Element, name: str, default: float) -> float:
        """Return a number; an image, which the format cannot say here, is noted."""
        value = self.scalar(element, name, default)
        if isinstance(value, Picture):
            self._lost.note("images of {} were replaced by a plain value", name)
            return default
        return value

    def color(self, element: Element, name: str, default: Color) -> Color | Picture:
        """Return a linear colour or an image."""
        found = self.find(element, name)
        if found is None:
            return default
        if found.tag == "texture":
            return self._picture(found, default)
        values = numbers(found.get("value", ""))
        if len(values) not in (1, 3):
            self._lost.note("values of a form without counterpart became plain: {}", name)
            return default
        return as_triple(np.broadcast_to(np.array(values), 3))

    def _picture(self, texture: Element, default: Color) -> Color | Picture:
        file = self.find(texture, "filename")
        if texture.get("type") != "bitmap" or file is None:
            self._lost.note("textures that are no image became plain: {}", texture.get("type", ""))
            return default
        words = {
            name: found.get("value", "")
            for name in ("filter_type", "wrap_mode", "raw")
            if (found := self.find(texture, name)) is not None
        }
        return Picture(
            file.get("value", ""),
            words.get("filter_type") == "nearest",
            words.get("wrap_mode", "repeat"),
            _to_uv(self.find(texture, "to_uv")),
            words.get("raw") == "true",
        )

    def two_sided(self, bsdf: Element) -> Look:
        """Look of `twosided`: that of its front."""
        inner = self.nested(bsdf, "bsdf")
        if len(inner) > 1:
            self._lost.note("materials with another back have their front on both sides")
        return replace(self.look(inner[0] if inner else None), two_sided=True)

    def normal_map(self, bsdf: Element) -> Look:
        """Look of `normalmap`."""
        inner, maps = self.nested(bsdf, "bsdf"), self.nested(bsdf, "texture")
        picture = self._picture(maps[0], _WHITE) if maps else _WHITE
        look = self.look(inner[0] if inner else None)
        return replace(look, normal=picture) if isinstance(picture, Picture) else look

    def bump_map(self, bsdf: Element) -> Look:
        """Look of `bumpmap`, without bumps."""
        self._lost.note("bump maps were left out")
        inner = self.nested(bsdf, "bsdf")
        return self.look(inner[0] if inner else None)

    def mask(self, bsdf: Element) -> Look:
        """Look of `mask`."""
        inner = self.nested(bsdf, "bsdf")
        opacity = self.scalar(bsdf, "opacity", 0.5)
        return replace(self.look(inner[0] if inner else None), opacity=opacity, two_sided=True)

    def blend(self, bsdf: Element) -> Look:
        """Look of `blendbsdf`: the mean of two plain materials, else that of the greater share."""
        first, second = ([self.look(one) for one in self.nested(bsdf, "bsdf")] + [_MATT] * 2)[:2]
        self._lost.note("blends of two materials became one")
        weight = self.scalar(bsdf, "weight", 0.5)
        if isinstance(weight, Picture):
            return first
        if first.two_sided or second.two_sided:
            first, second = (replace(one, two_sided=True) for one in (first, second))
        if first.is_plain and second.is_plain:
            return _mean(first, second, min(max(weight, 0.0), 1.0))
        return second if weight > 0.5 else first

    def principled(self, bsdf: Element) -> Look:
        """Look of `principled`."""
        ior = self.number(bsdf, "eta", 1.5)
        f0 = ((ior - 1) / (ior + 1)) ** 2 / 0.08
        for name in ("spec_tint", "anisotropic", "flatness", "sheen_tint", "clearcoat_tint"):
            if self.find(bsdf, name) is not None:
                self._lost.note("properties of materials were left out: {}", name)
        return Look(
            base=self.color(bsdf, "base_color", _GREY),
            roughness=self.scalar(bsdf, "roughness", 0.5),
            metallic=self.scalar(bsdf, "metallic", 0.0),
            specular=self.number(bsdf, "specular", f0),
            clearcoat=self.number(bsdf, "clearcoat", 0.0),
            clearcoat_roughness=1 - self.number(bsdf, "clearcoat_gloss", 0.0),
            sheen=self.number(bsdf, "sheen", 0.0),
            transmission=self.number(bsdf, "spec_trans", 0.0),
            solid=True,
            ior=ior,
        )

    def thin(self, bsdf: Element) -> Look:
        """Look of `principledthin`; its `diff_trans` is 2 if all diffuse light passes."""
        return Look(
            base=self.color(bsdf, "base_color", _GREY),
            roughness=self.scalar(bsdf, "roughness", 0.5),
            specular=0.0,
            transmission=self.number(bsdf, "spec_trans", 0.0),
            diffuse_transmission=0.5 * self.number(bsdf, "diff_trans", 0.0),
            ior=self.number(bsdf, "eta", 1.5),
            two_sided=True,
        )

    def diffuse(self, bsdf: Element) -> Look:
        """Look of `diffuse`: rough, without a highlight."""
        if bsdf.get("type") == "roughdiffuse":
            self._lost.note("the roughness of diffuse surfaces was left out")
        return replace(_MATT, base=self.color(bsdf, "reflectance", _GREY))

    def plastic(self, bsdf: Element) -> Look:
        """Look of `plastic` and `roughplastic`."""
        rough = bsdf.get("type") == "roughplastic"
        nonlinear = getattr(self.find(bsdf, "nonlinear"), "attrib", {}).get("value") == "true"
        return Look(
            base=self.color(bsdf, "diffuse_reflectance", _GREY),
            roughness=self._roughness(bsdf) if rough else 0.0,
            specular=_f0(self._ior(bsdf, 1.49)) / 0.08,
            stated=Statement(
                "roughplastic" if rough else "plastic",
                distribution=self._distribution(bsdf),
                nonlinear=nonlinear,
            ),
        )

    def glass(self, bsdf: Element) -> Look:
        """Look of dielectrics."""
        kind = bsdf.get("type", "")
        stated = build(Statement, {"bsdf": kind, "distribution": self._distribution(bsdf)})
        thin = kind == "thindielectric"
        return Look(
            base=self.color(bsdf, "specular_transmittance", _WHITE),
            roughness=self._roughness(bsdf) if kind == "roughdielectric" else 0.0,
            transmission=1.0,
            ior=self._ior(bsdf, 1.5046),
            solid=not thin,
            two_sided=thin,
            stated=stated,
        )

    def conductor(self, bsdf: Element) -> Look:
        """Look of conductors: a metal of the colour that they reflect at normal incidence."""
        rough = bsdf.get("type") == "roughconductor"
        stated = self._conductor(bsdf, "roughconductor" if rough else "conductor")
        base = self.color(bsdf, "specular_reflectance", _WHITE)
        if not isinstance(base, Picture):
            base = as_triple(np.array(base) * stated.reflectance)
        roughness = self._roughness(bsdf) if rough else 0.0
        return Look(base=base, roughness=roughness, metallic=1.0, stated=stated)

    def _conductor(self, bsdf: Element, kind: Literal["conductor", "roughconductor"]) -> Statement:
        """Plugin and refraction of a conductor; of one named by its element, at three bands."""
        distribution = self._distribution(bsdf)
        named = getattr(self.find(bsdf, "material"), "attrib", {}).get("value", "")
        given = [self.find(bsdf, name) for name in ("eta", "k")]
        if named == "none":
            return Statement(kind, distribution=distribution)
        eta, k = self.color(bsdf, "eta", _WHITE), self.color(bsdf, "k", _WHITE)
        if None in given or isinstance(eta, Picture) or isinstance(k, Picture):
            eta, k = metal(named or "Cu") or _COPPER
        return Statement(kind, distribution=distribution, eta=eta, k=k)

    def _distribution(self, bsdf: Element) -> Literal["beckmann", "ggx"]:
        found = self.find(bsdf, "distribution")
        return "ggx" if found is not None and found.get("value") == "ggx" else "beckmann"

    def _ior(self, bsdf: Element, default: float) -> float:
        """Index of refraction in air; names are those of Mitsuba."""
        given = [
            values[0] if (values := numbers(text)) else text or usual
            for name, usual in (("int_ior", default), ("ext_ior", "air"))
            for text in [getattr(self.find(bsdf, name), "attrib", {}).get("value", "")]
        ]
        found = ior_in_air(*given)
        if found is None:
            self._lost.note("unknown indices of refraction became {}", f"{default:g}")
        return min(max(found or default, 1.0), 4.0)

    def nothing(self, bsdf: Element) -> Look:
        """Look of `null`."""
        return Look(opacity=0.0, two_sided=True)

    def _roughness(self, bsdf: Element) -> float:
        if self.find(bsdf, "alpha_u") is not None:
            self._lost.note("properties of materials were left out: {}", "anisotropic roughness")
            area = self.number(bsdf, "alpha_u", 0.1) * self.number(bsdf, "alpha_v", 0.1)
            return max(area, 0.0) ** 0.25
        return math.sqrt(max(self.number(bsdf, "alpha", 0.1), 0.0))


_RULES: dict[str, Callable[[LookReader, Element], Look]] = {
    "twosided": LookReader.two_sided,
    "normalmap": LookReader.normal_map,
    "bumpmap": LookReader.bump_map,
    "mask": LookReader.mask,
    "blendbsdf": LookReader.blend,
    "principled": LookReader.principled,
    "principledthin": LookReader.thin,
    "diffuse": LookReader.diffuse,
    "roughdiffuse": LookReader.diffuse,
    "plastic": LookReader.plastic,
    "roughplastic": LookReader.plastic,
    "dielectric": LookReader.glass,
    "thindielectric": LookReader.glass,
    "roughdielectric": LookReader.glass,
    "conductor": LookReader.conductor,
    "roughconductor": LookReader.conductor,
    "null": LookReader.nothing,
}


def numbers(text: str) -> list[float]:
    """Return the numbers of a value in `scene.xml`; none if it is no list of finite numbers."""
    try:
        found = [float(word) for word in _NUMBERS.split(text.strip()) if word]
    except ValueError:
        return []
    return found if all(map(math.isfinite, found)) else []


def triple(element: Element) -> list[float]:
    """Return a point or vector of `scene.xml`, stated at once or by x, y and z."""
    values = numbers(element.get("value", ""))
    if len(values) == 3:
        return values
    return [(numbers(element.get(axis, "0")) or [0.0])[0] for axis in "xyz"]


def _to_uv(element: Element | None) -> tuple[tuple[float, float, float], ...]:
    if element is None:
        return ()
    matrix = transform(element)
    return tuple((float(row[0]), float(row[1]), float(row[3])) for row in matrix[:2])


def transform(element: Element) -> Float64Array:
    """Return the matrix (4, 4) of a transform element: matrices and `lookat`s in order."""
    whole = np.eye(4)
    for step in element:
        whole = _step(step) @ whole
    return whole


def _step(step: Element) -> Float64Array:
    values = {key: numbers(text) for key, text in step.attrib.items()}
    if step.tag == "matrix" and len(values.get("value", [])) == 16:
        return np.reshape(values["value"], (4, 4)).astype(np.float64)
    matrix = np.eye(4)
    if step.tag == "lookat" and all(len(values.get(k, [])) == 3 for k in ("origin", "target")):
        eye, up = np.array(values["origin"]), np.array(values.get("up") or [0.0, 0, 1])
        forward = np.array(values["target"]) - eye
        forward /= np.linalg.norm(forward)
        left = np.cross(up, forward)
        left /= np.linalg.norm(left)
        matrix[:3, :3] = np.stack([left, np.cross(forward, left), forward], axis=1)
        matrix[:3, 3] = eye
        return matrix
    triple = values.get("value", [])
    if len(triple) == 1:
        triple = triple * 3
    if len(triple) != 3:
        default = 1.0 if step.tag == "scale" else 0.0
        triple = [(values.get(axis) or [default])[0] for axis in "xyz"]
    if step.tag == "scale":
        matrix[:3, :3] = np.diag(triple)
    elif step.tag == "translate":
        matrix[:3, 3] = triple
    elif step.tag == "rotate":
        angle = math.radians((values.get("angle") or [0.0])[0])
        axis = np.array(triple) / max(float(np.linalg.norm(triple)), 1e-12)
        cross = np.cross(np.eye(3), -axis)
        matrix[:3, :3] += math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    return matrix


def _grey(color: Color) -> float:
    """Luminance; of a grey exactly its value."""
    return color[0] if color[0] == color[1] == color[2] else float(np.array(color) @ REC709)


def _f0(ior: float) -> float:
    return ((ior - 1) / (ior + 1)) ** 2
