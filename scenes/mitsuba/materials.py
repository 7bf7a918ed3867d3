"""Surface materials (BSDFs) and textures of any Mitsuba version as Mitsuba 3 plugins.

Plugins that Mitsuba 3 has are translated property by property; all others are approximated and
noted in the list of changes. Opaque materials become two-sided, so that no surface is black from
behind.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.color import REC709, Color
from pbrnet.scenes.importing.materials.textures import TextureStore, UnreadableImage
from pbrnet.scenes.importing.shape import Surface
from pbrnet.scenes.importing.xml_elements import plugin, prop
from pbrnet.scenes.mitsuba.reader import Node, unresolved
from pbrnet.scenes.mitsuba.values import Properties, Scope

GREY: Color = (0.5, 0.5, 0.5)
_MAX_NESTING = 16
_CLEAR_ROUGHNESS = 0.05  # alpha up to which rough glass counts as clear

# Conductors in Mitsuba 3's data folder; `_palik` names other measurements of the same metal.
_CONDUCTORS = frozenset(
    ("Ag", "Al", "AlAs", "AlSb", "Au", "Be", "Cr", "CsI", "Cu", "Cu2O", "CuO", "Hg", "HgTe", "Ir",
     "K", "Li", "MgO", "Mo", "Na_palik", "Nb", "Ni_palik", "Rh", "Se", "Se-e", "SiC", "SnTe", "Ta",
     "Te", "Te-e", "ThF4", "TiC", "TiN", "TiO2", "V", "VC", "VN", "W", "none")
)  # fmt: skip
_DIELECTRICS = frozenset(
    (
        "vacuum",
        "helium",
        "hydrogen",
        "air",
        "carbon dioxide",
        "water",
        "acetone",
        "ethanol",
        "carbon tetrachloride",
        "glycerol",
        "benzene",
        "silicone oil",
        "bromine",
        "water ice",
        "fused quartz",
        "pyrex",
        "acrylic glass",
        "polypropylene",
        "bk7",
        "sodium chloride",
        "amber",
        "pet",
        "diamond",
    )
)


class Materials:
    """Translates BSDF elements, each once."""

    def __init__(self, scope: Scope, textures: TextureStore) -> None:
        self.scope, self.textures = scope, textures
        self._surfaces: dict[int, Surface] = {}
        self._depth = 0

    def surface(self, node: Node | None) -> Surface:
        """Translate the material of a shape; without one, a shape is grey and diffuse."""
        if node is None:
            return Surface(plugin("bsdf", "twosided", bsdf=plugin("bsdf", "diffuse")))
        if id(node) not in self._surfaces:
            surface = self._two_sided(self._translate(node))
            surface.name = node.attributes.get("id", "")
            self._surfaces[id(node)] = surface
        return self._surfaces[id(node)]

    def _two_sided(self, surface: Surface) -> Surface:
        if surface.element is None or surface.transmissive or surface.double:
            return surface
        wrapped = plugin("bsdf", "twosided")
        wrapped.append(surface.element)
        return Surface(wrapped, double=True)

    def _translate(self, node: Node) -> Surface:
        known = _BSDFS.get(node.type)
        if known is None:
            self.scope.changes.note(
                "unknown material, replaced by a grey diffuse one: {}",
                f"{node.type!r} ({node.place})",
            )
            return Surface(plugin("bsdf", "diffuse"))
        if self._depth >= _MAX_NESTING:
            raise node.error("materials are nested too deep or inside themselves")
        self._depth += 1
        try:
            properties = Properties(node, self.scope)
            properties.ignore("id")
            surface = known(self, properties)
            properties.report_unused()
        finally:
            self._depth -= 1
        return surface

    def _inner(self, properties: Properties, count: int = 1) -> list[Surface]:
        nodes = properties.nested("bsdf")
        if len(nodes) < count:
            raise properties.node.error(f"{properties.node.type!r} needs {count} nested materials")
        return [self._translate(node) for node in nodes]

    def color(
        self, properties: Properties, name: str, default: Color | None = None, bounded: bool = True
    ) -> Color | Element | None:
        """Translate a colour property to RGB or a texture element.

        `bounded` ones, such as reflectances, are clipped to [0, 1].
        """
        found = properties.color(name)
        if found is None:
            return default
        if isinstance(found, Node):
            return self.texture(found)
        if bounded and max(found) > 1:
            self.scope.changes.note("a reflectance above 1 was clipped to 1")
            found = (min(found[0], 1.0), min(found[1], 1.0), min(found[2], 1.0))
        return found

    def scalar(self, properties: Properties, name: str, default: float) -> float:
        """Read a number; a texture is replaced by its mean."""
        found = properties.color(name)
        if found is None:
            return default
        if isinstance(found, Node):
            self.scope.changes.note(f"a texture of {name!r} was replaced by its mean value")
            return float(np.mean(self._mean(found)))
        return float(np.mean(found))

    def texture(self, node: Node, use: str = "color") -> Color | Element:
        """Translate a texture element to Mitsuba 3's, or to RGB if it is constant.

        `use` is "color", "opacity" (linear, from the alpha channel if there is one) or "data"
        (linear).
        """
        known = _TEXTURES.get(node.type)
        if known is None:
            self.scope.changes.note(
                "unknown texture, replaced by grey: {}",
                f"{node.type!r} ({node.place})",
            )
            return GREY
        if self._depth >= _MAX_NESTING:
            raise node.error("textures are nested too deep or inside themselves")
        self._depth += 1
        try:
            properties = Properties(node, self.scope)
            properties.ignore("id", "cache", "max_anisotropy", "format", "accel")
            made = known(self, properties, use)
            properties.report_unused()
        finally:
            self._depth -= 1
        return made

    def image_path(self, properties: Properties) -> Path | None:
        """Find the image of a texture; None, with a note, if it is missing."""
        name = properties.text("filename", "")
        node = properties.node
        if not name or unresolved(name):
            self.scope.changes.note(
                "a texture without an image was replaced by grey: {}", node.place
            )
            return None
        path = self.scope.sandbox.find(name, node.place)
        if path is None:
            self.scope.changes.note(
                "missing texture, replaced by grey: {}", f"{name!r} ({node.place})"
            )
        return path

    def bitmap(self, properties: Properties, use: str) -> Color | Element:
        """`bitmap` of all versions, and its predecessors `ldrtexture` and `exrtexture`."""
        changes = self.scope.changes
        properties.ignore("filename")
        path = self.image_path(properties)
        to_uv = _to_uv(properties)
        filtering = properties.text("filter_type", "bilinear").lower()
        if filtering not in ("nearest", "bilinear"):
            changes.note("a texture filter was replaced by bilinear: {}", repr(filtering))
            filtering = "bilinear"
        wrap = properties.text("wrap_mode", properties.text("wrap_mode_u", "repeat")).lower()
        if properties.text("wrap_mode_v", wrap).lower() != wrap:
            changes.note("a texture has two wrap modes; the mode in u was used for both directions")
        if wrap not in ("repeat", "mirror", "clamp"):
            changes.note("a texture wrap mode was replaced by clamp: {}", repr(wrap))
            wrap = "clamp"
        is_named = properties.text("gamma", "").lower() == "srgb"
        gamma = -1.0 if is_named else properties.number("gamma", -1.0)
        raw = properties.boolean("raw", False) or gamma == 1.0 or use == "data"
        if gamma > 0 and gamma != 1 and abs(gamma - 2.2) > 0.25:
            changes.note("a texture gamma was replaced by sRGB: {}", f"{gamma:g}")
        channel = properties.text("channel", "").lower()
        if path is None:
            return GREY
        try:
            if channel in ("r", "g", "b", "a", "x", "y", "z"):
                stored: str | None = self.textures.channel(
                    path, {"x": 0, "y": 1, "z": 2}.get(channel, "rgba".find(channel))
                )
                raw = raw or channel == "a"
            else:
                stored = self.textures.alpha(path) if use == "opacity" else None
                if stored is not None:
                    raw = True
                    changes.note("opacity was read from the image's alpha channel: {}", path.name)
                else:
                    stored = self.textures.color(path)
        except UnreadableImage as error:
            changes.note("damaged texture, replaced by grey: {}", f"{path.name} ({error})")
            return GREY
        return plugin(
            "texture",
            "bitmap",
            filename=stored,
            filter_type=filtering if filtering != "bilinear" else None,
            wrap_mode=wrap if wrap != "repeat" else None,
            raw=True if raw else None,
            to_uv=to_uv,
        )

    def checkerboard(self, properties: Properties, use: str) -> Color | Element:
        """`checkerboard`, which all versions repeat once per unit."""
        light: Color = (0.4, 0.4, 0.4)
        dark: Color = (0.2, 0.2, 0.2)
        return plugin(
            "texture",
            "checkerboard",
            color0=self.color(properties, "color0", light),
            color1=self.color(properties, "color1", dark),
            to_uv=_to_uv(properties),
        )

    def grid(self, properties: Properties, use: str) -> Color | Element:
        """`gridtexture`, which Mitsuba 3 lacks: the mean of its two colours by area."""
        lines = self.color(properties, "color0", (0.2, 0.2, 0.2))
        field = self.color(properties, "color1", (0.4, 0.4, 0.4))
        width = properties.number("line_width", 0.01)
        _to_uv(properties)
        self.scope.changes.note("a grid texture was replaced by its mean colour")
        if not isinstance(lines, tuple) or not isinstance(field, tuple):
            return GREY
        share = 1 - max(0.0, 1 - 2 * width) ** 2
        mean = share * np.array(lines) + (1 - share) * np.array(field)
        return (float(mean[0]), float(mean[1]), float(mean[2]))

    def scaled(self, properties: Properties, use: str) -> Color | Element:
        """`scale`: a texture times a colour, as one texture or colour."""
        factor = properties.color("scale")
        if factor is None:
            factor = properties.color("value")
        inner = [node for node in properties.nested("texture") if node is not factor]
        if isinstance(factor, Node) or not inner:
            self.scope.changes.note("a scaled texture was replaced by grey")
            return GREY
        times = np.array(factor if factor is not None else (1.0, 1.0, 1.0))
        made = self.texture(inner[0], use)
        if isinstance(made, tuple):
            product = np.array(made) * times
            return (float(product[0]), float(product[1]), float(product[2]))
        if made.get("type") == "bitmap" and use == "color" and inner[0].type in _BITMAPS:
            path = self.image_path(Properties(inner[0], self.scope))
            name = made.find("string[@name='filename']")
            if path is not None and name is not None:
                name.set("value", self.textures.scaled(path, times))
                return made
        self.scope.changes.note("the factor of a scaled texture was left out")
        return made

    def vertex_colors(self, properties: Properties, use: str) -> Color | Element:
        """Colours stored with mesh vertices, which are not imported: grey."""
        properties.ignore("name", "scale")
        self.scope.changes.note("colours stored with mesh vertices were replaced by grey")
        return GREY

    def uniform(self, properties: Properties, use: str) -> Color | Element:
        """`uniform`, `srgb` and `rgb` as texture plugins: their colour."""
        for name in ("value", "color"):
            found = properties.color(name)
            if isinstance(found, tuple):
                return found
        return GREY

    def _mean(self, node: Node) -> Float64Array:
        made = self.texture(node, "data")
        if isinstance(made, tuple):
            return np.array(made)
        return np.array(GREY)

    def ior(self, properties: Properties, name: str) -> float | str | None:
        """Read an index of refraction as number or material name; None for the default."""
        node = properties.child(name)
        if node is None:
            return None
        if node.tag != "string":
            return properties.number(name, 1.5)
        text = properties.text(name, "bk7")
        if text.lower() in _DIELECTRICS:
            return text.lower()
        self.scope.changes.note("an unknown dielectric was replaced by glass (bk7): {}", repr(text))
        return "bk7"

    def roughness(self, properties: Properties, default: float = 0.1) -> dict[str, Any]:
        """Read `alpha` (or that of two axes) and `distribution` as properties for Mitsuba 3."""
        kind = properties.text("distribution", "beckmann").lower()
        if kind not in ("beckmann", "ggx"):
            self.scope.changes.note(
                "a microfacet distribution was replaced by beckmann: {}", repr(kind)
            )
            kind = "beckmann"
        visible = properties.boolean("sample_visible", True)
        found: dict[str, Any] = {"distribution": kind}
        if not visible:
            properties.ignore("sample_visible")
        if "alpha_u" in properties or "alpha_v" in properties:
            found["alpha_u"] = self.scalar(properties, "alpha_u", default)
            found["alpha_v"] = self.scalar(properties, "alpha_v", default)
        else:
            found["alpha"] = self.scalar(properties, "alpha", default)
        return found

    def diffuse(self, properties: Properties) -> Surface:
        """`diffuse`."""
        return Surface(plugin("bsdf", "diffuse", reflectance=self.color(properties, "reflectance")))

    def rough_diffuse(self, properties: Properties) -> Surface:
        """`roughdiffuse` (Oren-Nayar), approximated by `diffuse`."""
        properties.ignore("alpha", "use_fast_approx")
        color = self.color(properties, "reflectance")
        if color is None:
            color = self.color(properties, "diffuse_reflectance")
        self.scope.changes.note("roughdiffuse was replaced by diffuse")
        return Surface(plugin("bsdf", "diffuse", reflectance=color))

    def dielectric(self, properties: Properties) -> Surface:
        """`dielectric` and `thindielectric`."""
        made = plugin(
            "bsdf",
            properties.node.type,
            int_ior=self.ior(properties, "int_ior"),
            ext_ior=self.ior(properties, "ext_ior"),
            specular_reflectance=self.color(properties, "specular_reflectance"),
            specular_transmittance=self.color(properties, "specular_transmittance"),
        )
        return Surface(made, transmissive=True, see_through=True)

    def rough_dielectric(self, properties: Properties) -> Surface:
        """`roughdielectric`."""
        rough = self.roughness(properties)
        made = plugin(
            "bsdf",
            "roughdielectric",
            int_ior=self.ior(properties, "int_ior"),
            ext_ior=self.ior(properties, "ext_ior"),
            specular_reflectance=self.color(properties, "specular_reflectance"),
            specular_transmittance=self.color(properties, "specular_transmittance"),
            **rough,
        )
        alpha = max(float(value) for key, value in rough.items() if key != "distribution")
        clear = alpha <= _CLEAR_ROUGHNESS
        return Surface(made, transmissive=True, see_through=clear, frosted=not clear)

    def conductor(self, properties: Properties) -> Surface:
        """`conductor` and `roughconductor`; `eta` and `k` are divided by `extEta`, as in 0.x."""
        rough = self.roughness(properties) if properties.node.type.startswith("rough") else {}
        made = plugin("bsdf", properties.node.type, **rough)
        color = self.color(properties, "specular_reflectance")
        if color is not None:
            made.append(prop("specular_reflectance", color))
        outside = self._outside(properties)
        eta, k = (properties.color(name, measured=True) for name in ("eta", "k"))
        if eta is not None or k is not None:
            made.append(prop("eta", self._relative(eta, outside, 0.0)))
            made.append(prop("k", self._relative(k, outside, 1.0)))
            properties.ignore("material")
        else:
            material = properties.text("material", "Cu" if self.scope.is_old else "none")
            if material.removesuffix("_palik") not in _CONDUCTORS and material not in _CONDUCTORS:
                self.scope.changes.note(
                    "an unknown metal was replaced by a perfect mirror: {}", repr(material)
                )
                material = "none"
            if abs(outside - 1) > 0.01:
                self.scope.changes.note("extEta of a named metal was left out")
            made.append(prop("material", material))
        return Surface(made)

    def _outside(self, properties: Properties) -> float:
        node = properties.child("ext_eta")
        if node is None:
            return 1.0
        if node.tag == "string" and not _is_number(node.attributes.get("value", "")):
            text = properties.text("ext_eta", "air")
            if text not in ("air", "vacuum"):
                self.scope.changes.note("extEta was replaced by air: {}", repr(text))
            return 1.0
        return max(properties.number("ext_eta", 1.0), 1e-3)

    def _relative(self, value: Color | Node | None, outside: float, default: float) -> Color:
        if isinstance(value, Node):
            self.scope.changes.note("the texture of a metal's refractive index was left out")
            value = None
        rgb = np.array(value if value is not None else (default,) * 3) / outside
        return (float(rgb[0]), float(rgb[1]), float(rgb[2]))

    def plastic(self, properties: Properties) -> Surface:
        """`plastic` and `roughplastic`; `pplastic` without polarisation."""
        kind = properties.node.type
        rough: dict[str, Any] = {}
        if kind == "roughplastic" or (kind == "pplastic" and "alpha" in properties):
            rough = self.roughness(properties)
            if "alpha_u" in rough:
                rough["alpha"] = 0.5 * (float(rough.pop("alpha_u")) + float(rough.pop("alpha_v")))
                self.scope.changes.note("anisotropic plastic was made isotropic")
        made = plugin(
            "bsdf",
            "roughplastic" if rough else "plastic",
            int_ior=self.ior(properties, "int_ior"),
            ext_ior=self.ior(properties, "ext_ior"),
            diffuse_reflectance=self.color(properties, "diffuse_reflectance"),
            specular_reflectance=self.color(properties, "specular_reflectance"),
            nonlinear=True if properties.boolean("nonlinear", False) else None,
            **rough,
        )
        return Surface(made)

    def coating(self, properties: Properties) -> Surface:
        """`coating` and `roughcoating`: plastic over a diffuse material, ignored over others."""
        tint = self._tint(properties)
        int_ior, ext_ior = self.ior(properties, "int_ior"), self.ior(properties, "ext_ior")
        rough = self.roughness(properties) if properties.node.type == "roughcoating" else {}
        specular = self.color(properties, "specular_reflectance")
        inner = self._inner(properties)[0]
        base = inner.element
        if base is not None and base.get("type") == "twosided" and len(base) == 1:
            base = base[0]
        if base is None or base.get("type") != "diffuse":
            self.scope.changes.note("the clear coat over a material was left out")
            if min(tint) < 1:
                self.scope.changes.note("the colour of a clear coat was left out")
            return inner
        self.scope.changes.note("a coated diffuse material was replaced by plastic")
        color = base.find("*[@name='reflectance']")
        made = plugin(
            "bsdf",
            "roughplastic" if rough else "plastic",
            int_ior=int_ior,
            ext_ior=ext_ior,
            specular_reflectance=specular,
            nonlinear=True,
            **rough,
        )
        if min(tint) < 1 and (color is None or color.tag == "rgb"):
            words = (color.get("value", "") if color is not None else "0.5").split()
            base_color = np.broadcast_to([float(word) for word in words], 3)
            color = prop("reflectance", _rgb(base_color * tint))
        elif min(tint) < 1:
            self.scope.changes.note("the colour of a clear coat was left out")
        if color is not None:
            made.append(prop("diffuse_reflectance", copy.deepcopy(color)))
        return Surface(made)

    def _tint(self, properties: Properties) -> Color:
        """Transmittance of a coat for light that passes it perpendicularly down and up again."""
        thickness = properties.number("thickness", 1.0)
        found = properties.color("sigma_a")
        if isinstance(found, Node):
            self.scope.changes.note("the texture of a clear coat's colour was left out")
            found = None
        return _rgb(np.exp(-2 * thickness * np.array(found if found is not None else (0.0,) * 3)))

    def phong(self, properties: Properties) -> Surface:
        """`phong` and `ward`: a blend of a diffuse and a microfacet material of equal roughness.

        For Phong's exponent n, alpha = sqrt(2 / (n + 2)) (Walter et al. 2007).
        """
        kind = properties.node.type
        properties.ignore("variant")
        if kind == "phong":
            exponent = max(self.scalar(properties, "exponent", 30.0), 0.0)
            alpha = math.sqrt(2 / (exponent + 2))
        else:
            alpha_u = self.scalar(properties, "alpha_u", 0.1)
            alpha_v = self.scalar(properties, "alpha_v", 0.1)
            alpha = math.sqrt(max(alpha_u * alpha_v, 1e-8))
        self.scope.changes.note(f"{kind} was replaced by a diffuse and a microfacet material")
        diffuse = self.color(properties, "diffuse_reflectance", GREY)
        specular = self.color(properties, "specular_reflectance", (0.2, 0.2, 0.2))
        alpha = min(max(alpha, 0.001), 1.0)
        if not isinstance(diffuse, tuple) or not isinstance(specular, tuple):
            return Surface(plugin("bsdf", "roughplastic", diffuse_reflectance=diffuse, alpha=alpha))
        base, gloss = np.array(diffuse), np.array(specular)
        total = float((base + gloss) @ REC709)
        weight = float(gloss @ REC709) / total if total > 0 else 0.0
        if weight < 1e-3:
            return Surface(plugin("bsdf", "diffuse", reflectance=diffuse))
        mirror = plugin(
            "bsdf",
            "roughconductor",
            material="none",
            alpha=alpha,
            specular_reflectance=_rgb(gloss / weight),
        )
        if weight > 0.999:
            return Surface(mirror)
        made = plugin("bsdf", "blendbsdf", weight=weight)
        made.append(plugin("bsdf", "diffuse", reflectance=_rgb(base / (1 - weight))))
        made.append(mirror)
        return Surface(made)

    def two_sided(self, properties: Properties) -> Surface:
        """`twosided`: its nested material, which `surface` makes two-sided again."""
        inner = self._inner(properties)
        if len(inner) == 1:
            return inner[0]
        if any(surface.transmissive or surface.element is None for surface in inner):
            return inner[0]
        made = plugin("bsdf", "twosided")
        for surface in inner[:2]:
            made.append(_front(surface))
        return Surface(made, double=True)

    def mask(self, properties: Properties) -> Surface:
        """`mask`: opacity from the image's alpha channel if it has one."""
        inner = self._inner(properties)[0]
        node = properties.child("opacity")
        if node is None:
            found = properties.nested("texture")
            node = found[0] if found else None
        opacity: Color | Element | float
        if node is not None and node.tag == "texture":
            made = self.texture(node, "opacity")
            opacity = float(np.mean(made)) if isinstance(made, tuple) else made
        else:
            opacity = self.scalar(properties, "opacity", 0.5)
        if isinstance(opacity, float):
            opacity = min(max(opacity, 0.0), 1.0)
            if opacity == 1:
                return inner
            if opacity == 0 or inner.invisible:
                return Surface(None, transmissive=True, see_through=True, invisible=True)
        if inner.element is None:
            return inner
        made_mask = plugin("bsdf", "mask", opacity=opacity)
        wrapped = self._two_sided(inner).element
        assert wrapped is not None
        made_mask.append(wrapped)
        clear = isinstance(opacity, float) and opacity <= 0.3
        return Surface(made_mask, transmissive=True, see_through=clear)

    def blend(self, properties: Properties) -> Surface:
        """`blendbsdf`."""
        first, second = self._inner(properties, 2)[:2]
        node = properties.child("weight")
        weight: Color | Element | float
        if node is not None and node.tag == "texture":
            made = self.texture(node, "data")
            weight = float(np.mean(made)) if isinstance(made, tuple) else made
        else:
            weight = min(max(self.scalar(properties, "weight", 0.5), 0.0), 1.0)
        return self._blended(first, second, weight)

    def mixture(self, properties: Properties) -> Surface:
        """`mixturebsdf`: a chain of two-material blends with the same total weights."""
        inner = self._inner(properties)
        text = properties.text("weights", "").replace(",", " ").split()
        if len(text) != len(inner) or not all(_is_number(word) for word in text):
            raise properties.node.error("must have as many weights as nested materials")
        weights = np.array([float(word) for word in text])
        if (weights < 0).any() or weights.sum() <= 0:
            raise properties.node.error("weights must not be negative and must not all be 0")
        if weights.sum() < 0.999:
            inner.append(Surface(plugin("bsdf", "diffuse", reflectance=(0.0, 0.0, 0.0))))
            weights = np.append(weights, 1 - weights.sum())
        elif weights.sum() > 1.001:
            self.scope.changes.note("the weights of a mixture were normalised to the sum 1")
        self.scope.changes.note("mixturebsdf was replaced by blendbsdf")
        made, total = inner[0], float(weights[0])
        for surface, weight in zip(inner[1:], weights[1:], strict=True):
            total += float(weight)
            made = self._blended(made, surface, float(weight) / total if total > 0 else 0.0)
        return made

    def _blended(self, first: Surface, second: Surface, weight: float | Element | Color) -> Surface:
        """`blendbsdf` with `weight` of the second material."""
        made = plugin("bsdf", "blendbsdf", weight=weight)
        transmissive = first.transmissive or second.transmissive
        for surface in (first, second):
            if surface.element is None:
                made.append(plugin("bsdf", "null"))
            elif transmissive:
                wrapped = self._two_sided(
                    Surface(copy.deepcopy(surface.element), surface.transmissive, surface.double)
                ).element
                assert wrapped is not None
                made.append(wrapped)
            else:
                made.append(copy.deepcopy(_front(surface)))
        return Surface(made, transmissive=transmissive)

    def bump(self, properties: Properties) -> Surface:
        """`bumpmap` and `normalmap`."""
        kind = properties.node.type
        inner = self._inner(properties)[0]
        textures = properties.nested("texture")
        strength = properties.number("scale", 1.0)
        properties.ignore("normalmap", "flip_invert_tangents", "use_shading_frame")
        if not textures or inner.element is None:
            self.scope.changes.note(f"a {kind} without a texture was left out")
            return inner
        made = self.texture(textures[0], "data")
        if isinstance(made, tuple):
            self.scope.changes.note(f"a {kind} without an image was left out")
            return inner
        wrapped = plugin("bsdf", kind)
        wrapped.append(prop("normalmap" if kind == "normalmap" else "bump", made))
        if kind == "bumpmap":
            wrapped.append(prop("scale", strength))
        wrapped.append(_front(inner))
        return Surface(
            wrapped, transmissive=inner.transmissive, see_through=False, frosted=inner.see_through
        )

    def diffuse_transmitter(self, properties: Properties) -> Surface:
        """`difftrans`: a thin principled material that only transmits diffusely."""
        color = self.color(properties, "transmittance", GREY)
        self.scope.changes.note("difftrans was replaced by a thin principled material")
        made = plugin(
            "bsdf", "principledthin", base_color=color, roughness=1.0, diff_trans=2.0, eta=1.001
        )
        return Surface(made, transmissive=True, frosted=True)

    def principled(self, properties: Properties) -> Surface:
        """`principled` and `principledthin`, property by property."""
        made = plugin("bsdf", properties.node.type)
        color = self.color(properties, "base_color")
        if color is not None:
            made.append(prop("base_color", color))
        transmission = 0.0
        for name in _PRINCIPLED[properties.node.type]:
            node = properties.child(name)
            if node is None:
                continue
            if node.tag == "texture":
                texture = self.texture(node, "data")
                made.append(
                    prop(name, texture if isinstance(texture, Element) else float(np.mean(texture)))
                )
                value = 0.5
            else:
                value = self.scalar(properties, name, 0.0)
                made.append(prop(name, value))
            if name == "spec_trans":
                transmission = value
        thin = properties.node.type == "principledthin"
        return Surface(
            made,
            transmissive=thin or transmission > 0,
            see_through=transmission > 0.5,
            frosted=thin and transmission <= 0.5,
        )

    def null(self, properties: Properties) -> Surface:
        """`null`, and filters that affect only polarised light."""
        if properties.node.type != "null":
            properties.ignore("theta", "transmittance", "delta", "left_handed", "polarizing")
            self.scope.changes.note(
                "a filter of polarised light was left out: {}", properties.node.type
            )
        return Surface(None, transmissive=True, see_through=True, invisible=True)

    def approximate(self, properties: Properties) -> Surface:
        """Materials without an equivalent: rough plastic of their colour, or grey."""
        kind = properties.node.type
        color: Color | Element | None = None
        for name in ("albedo", "diffuse_reflectance", "reflectance", "kd", "base_color"):
            if color is None:
                color = self.color(properties, name)
        properties.ignore(*(child.name for child in properties.node.children))
        properties.ignore(*_names(properties))
        if color is None:
            color = (0.15, 0.09, 0.06) if kind == "hair" else GREY
        self.scope.changes.note("a material was approximated by rough plastic: {}", repr(kind))
        return Surface(plugin("bsdf", "roughplastic", diffuse_reflectance=color, alpha=0.4))


def _front(surface: Surface) -> Element:
    """The element of a material without its `twosided` wrapper."""
    element = surface.element
    assert element is not None
    return element[0] if element.get("type") == "twosided" else element


def _names(properties: Properties) -> list[str]:
    return [child.name for child in properties.node.children if child.name]


def _rgb(values: Float64Array) -> Color:
    clipped = np.clip(values, 0, 1)
    return (float(clipped[0]), float(clipped[1]), float(clipped[2]))


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def _to_uv(properties: Properties) -> Float64Array | None:
    """Transform (4, 4) of texture coordinates, from version 0.x's numbers or Mitsuba 3's matrix.

    None for the identity.
    """
    matrix = properties.transform("to_uv")
    scale = np.array([properties.number("uscale", 1.0), properties.number("vscale", 1.0)])
    both = properties.number("uvscale", 1.0)
    offset = np.array([properties.number("uoffset", 0.0), properties.number("voffset", 0.0)])
    old = np.eye(4)
    old[0, 0], old[1, 1] = scale * both
    old[:2, 3] = offset
    matrix = matrix @ old
    return None if np.allclose(matrix, np.eye(4)) else matrix


_PRINCIPLED = {
    "principled": (
        "roughness",
        "anisotropic",
        "metallic",
        "spec_trans",
        "eta",
        "specular",
        "spec_tint",
        "sheen",
        "sheen_tint",
        "flatness",
        "clearcoat",
        "clearcoat_gloss",
    ),
    "principledthin": (
        "roughness",
        "anisotropic",
        "spec_trans",
        "eta",
        "spec_tint",
        "sheen",
        "sheen_tint",
        "flatness",
        "diff_trans",
    ),
}
_BSDFS: dict[str, Callable[[Materials, Properties], Surface]] = {
    "diffuse": Materials.diffuse,
    "lambertian": Materials.diffuse,
    "roughdiffuse": Materials.rough_diffuse,
    "dielectric": Materials.dielectric,
    "thindielectric": Materials.dielectric,
    "roughdielectric": Materials.rough_dielectric,
    "conductor": Materials.conductor,
    "roughconductor": Materials.conductor,
    "plastic": Materials.plastic,
    "roughplastic": Materials.plastic,
    "pplastic": Materials.plastic,
    "coating": Materials.coating,
    "roughcoating": Materials.coating,
    "phong": Materials.phong,
    "ward": Materials.phong,
    "twosided": Materials.two_sided,
    "mask": Materials.mask,
    "blendbsdf": Materials.blend,
    "mixturebsdf": Materials.mixture,
    "bumpmap": Materials.bump,
    "normalmap": Materials.bump,
    "difftrans": Materials.diffuse_transmitter,
    "principled": Materials.principled,
    "principledthin": Materials.principled,
    "null": Materials.null,
    "polarizer": Materials.null,
    "retarder": Materials.null,
    "circular": Materials.null,
    "hk": Materials.approximate,
    "irawan": Materials.approximate,
    "hair": Materials.approximate,
    "measured": Materials.approximate,
    "measured_polarized": Materials.approximate,
}
_BITMAPS = ("bitmap", "ldrtexture", "exrtexture")
_TEXTURES: dict[str, Callable[[Materials, Properties, str], Color | Element]] = {
    **dict.fromkeys(_BITMAPS, Materials.bitmap),
    "checkerboard": Materials.checkerboard,
    "gridtexture": Materials.grid,
    "scale": Materials.scaled,
    "vertexcolors": Materials.vertex_colors,
    "mesh_attribute": Materials.vertex_colors,
    "uniform": Materials.uniform,
    "srgb": Materials.uniform,
    "rgb": Materials.uniform,
}
