"""BSDFs of any Mitsuba version as those of Mitsuba 3: a function for each plugin.

Plugins that Mitsuba 3 has are translated property by property; the others are approximated and
noted in the list of changes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from pbrnet.scenes.arrays import as_triple
from pbrnet.scenes.color import REC709, Color
from pbrnet.scenes.importing.materials.surface import (
    Surface,
    clipped,
    invisible,
    principled_surface,
    rough_glass,
    thin_sheet,
    wrapped,
)
from pbrnet.scenes.importing.xml_elements import plugin, prop
from pbrnet.scenes.mitsuba.reader import Node
from pbrnet.scenes.mitsuba.textures import GREY, Textures
from pbrnet.scenes.mitsuba.values import Properties

# Conductors in Mitsuba 3's data folder; `_palik` names other measurements of the same metal.
_CONDUCTORS = frozenset(
    ("Ag", "Al", "AlAs", "AlSb", "Au", "Be", "Cr", "CsI", "Cu", "Cu2O", "CuO", "Hg", "HgTe", "Ir",
     "K", "Li", "MgO", "Mo", "Na_palik", "Nb", "Ni_palik", "Rh", "Se", "Se-e", "SiC", "SnTe", "Ta",
     "Te", "Te-e", "ThF4", "TiC", "TiN", "TiO2", "V", "VC", "VN", "W", "none")
)  # fmt: skip
_DIELECTRICS = frozenset(
    ("vacuum", "helium", "hydrogen", "air", "carbon dioxide", "water", "acetone", "ethanol",
     "carbon tetrachloride", "glycerol", "benzene", "silicone oil", "bromine", "water ice",
     "fused quartz", "pyrex", "acrylic glass", "polypropylene", "bk7", "sodium chloride", "amber",
     "pet", "diamond")
)  # fmt: skip
_PRINCIPLED = {
    "principled": "roughness anisotropic metallic spec_trans eta specular spec_tint sheen "
    "sheen_tint flatness clearcoat clearcoat_gloss",
    "principledthin": "roughness anisotropic spec_trans eta spec_tint sheen sheen_tint flatness "
    "diff_trans",
}


@dataclass(frozen=True)
class Bsdf:
    """One BSDF element: its properties, its nested BSDFs, and the textures of the scene."""

    properties: Properties
    textures: Textures
    translate: Callable[[Node], Surface]  # of a nested BSDF

    @property
    def type(self) -> str:
        """The plugin's name."""
        return self.properties.node.type

    def note(self, sentence: str, detail: str = "") -> None:
        """Record a change, see `Changes.note`."""
        self.textures.note(sentence, detail)

    def color(self, name: str, default: Color | None = None) -> Color | Element | None:
        """Translate a reflectance to RGB in [0, 1] or to a texture element."""
        return self.textures.color(self.properties, name, default)

    def scalar(self, name: str, default: float) -> float:
        """Read a number; a texture is replaced by its mean."""
        return self.textures.scalar(self.properties, name, default)

    def inner(self, count: int = 1) -> list[Surface]:
        """Translate the nested BSDFs, of which there must be `count` at least."""
        nodes = self.properties.nested("bsdf")
        if len(nodes) < count:
            raise self.properties.node.error(f"{self.type!r} needs {count} nested materials")
        return [self.translate(node) for node in nodes]

    def ior(self, name: str) -> float | str | None:
        """Read an index of refraction as number or material name; None for the default."""
        node = self.properties.child(name)
        if node is None:
            return None
        if node.tag != "string":
            return self.properties.number(name, 1.5)
        text = self.properties.text(name, "bk7")
        if text.lower() in _DIELECTRICS:
            return text.lower()
        self.note("an unknown dielectric was replaced by glass (bk7): {}", repr(text))
        return "bk7"

    def interface(self) -> dict[str, float | str | None]:
        """Read the properties of the boundary between two dielectrics."""
        return {"int_ior": self.ior("int_ior"), "ext_ior": self.ior("ext_ior")}

    def roughness(self, default: float = 0.1) -> dict[str, Any]:
        """Read `alpha` (or that of two axes) and `distribution` as properties for Mitsuba 3."""
        properties = self.properties
        kind = properties.text("distribution", "beckmann").lower()
        if kind not in ("beckmann", "ggx"):
            self.note("a microfacet distribution was replaced by beckmann: {}", repr(kind))
            kind = "beckmann"
        properties.boolean("sample_visible", True)
        is_anisotropic = "alpha_u" in properties or "alpha_v" in properties
        axes = ("alpha_u", "alpha_v") if is_anisotropic else ("alpha",)
        return {"distribution": kind, **{name: self.scalar(name, default) for name in axes}}


def _diffuse(bsdf: Bsdf) -> Surface:
    return Surface(plugin("bsdf", "diffuse", reflectance=_diffuse_color(bsdf)))


def _diffuse_color(bsdf: Bsdf) -> Color | Element | None:
    """`reflectance`, or `diffuseReflectance`, as Mitsuba 0.5 reads it as well."""
    color = bsdf.color("reflectance")
    other = bsdf.color("diffuse_reflectance")
    return color if color is not None else other


def _rough_diffuse(bsdf: Bsdf) -> Surface:
    """`roughdiffuse` (Oren-Nayar), approximated by `diffuse`."""
    bsdf.properties.ignore("alpha", "use_fast_approx")
    bsdf.note("roughdiffuse was replaced by diffuse")
    return _diffuse(bsdf)


def _dielectric(bsdf: Bsdf) -> Surface:
    """`dielectric`, `thindielectric` and `roughdielectric`."""
    rough = bsdf.roughness() if bsdf.type == "roughdielectric" else {}
    made = plugin(
        "bsdf",
        bsdf.type,
        **bsdf.interface(),
        specular_reflectance=bsdf.color("specular_reflectance"),
        specular_transmittance=bsdf.color("specular_transmittance"),
        **rough,
    )
    alphas = [value for name, value in rough.items() if name != "distribution"]
    return rough_glass(made, max(alphas, default=0.0))


def _conductor(bsdf: Bsdf) -> Surface:
    """`conductor` and `roughconductor`; `eta` and `k` are divided by `extEta`, as in 0.x."""
    properties = bsdf.properties
    rough = bsdf.roughness() if bsdf.type.startswith("rough") else {}
    color = bsdf.color("specular_reflectance")
    made = plugin("bsdf", bsdf.type, **rough, specular_reflectance=color)
    outside = _outside(bsdf)
    eta, k = (properties.color(name, measured=True) for name in ("eta", "k"))
    if eta is not None or k is not None:
        made.append(prop("eta", _relative(bsdf, eta, outside, 0.0)))
        made.append(prop("k", _relative(bsdf, k, outside, 1.0)))
        properties.ignore("material")
        return Surface(made)
    material = properties.text("material", "Cu" if properties.scope.is_old else "none")
    if material.removesuffix("_palik") not in _CONDUCTORS and material not in _CONDUCTORS:
        bsdf.note("an unknown metal was replaced by a perfect mirror: {}", repr(material))
        material = "none"
    if abs(outside - 1) > 0.01:
        bsdf.note("extEta of a named metal was left out")
    made.append(prop("material", material))
    return Surface(made)


def _outside(bsdf: Bsdf) -> float:
    """Refractive index of what surrounds a metal."""
    node = bsdf.properties.child("ext_eta")
    if node is None:
        return 1.0
    if node.tag == "string" and not _is_number(node.attributes.get("value", "")):
        text = bsdf.properties.text("ext_eta", "air")
        if text not in ("air", "vacuum"):
            bsdf.note("extEta was replaced by air: {}", repr(text))
        return 1.0
    return max(bsdf.properties.number("ext_eta", 1.0), 1e-3)


def _relative(bsdf: Bsdf, value: Color | Node | None, outside: float, default: float) -> Color:
    if isinstance(value, Node):
        bsdf.note("the texture of a metal's refractive index was left out")
        value = None
    return as_triple(np.array(value if value is not None else (default,) * 3) / outside)


def _plastic(bsdf: Bsdf) -> Surface:
    """`plastic` and `roughplastic`; `pplastic` without polarisation."""
    rough: dict[str, Any] = {}
    if bsdf.type == "roughplastic" or (bsdf.type == "pplastic" and "alpha" in bsdf.properties):
        rough = bsdf.roughness()
        if "alpha_u" in rough:
            rough["alpha"] = 0.5 * (rough.pop("alpha_u") + rough.pop("alpha_v"))
            bsdf.note("anisotropic plastic was made isotropic")
    made = plugin(
        "bsdf",
        "roughplastic" if rough else "plastic",
        **bsdf.interface(),
        diffuse_reflectance=bsdf.color("diffuse_reflectance"),
        specular_reflectance=bsdf.color("specular_reflectance"),
        nonlinear=True if bsdf.properties.boolean("nonlinear", False) else None,
        **rough,
    )
    return Surface(made)


def _coating(bsdf: Bsdf) -> Surface:
    """`coating` and `roughcoating`: plastic over a diffuse material, ignored over others."""
    tint = _tint(bsdf)
    interface = bsdf.interface()
    rough = bsdf.roughness() if bsdf.type == "roughcoating" else {}
    specular = bsdf.color("specular_reflectance")
    inner = bsdf.inner()[0]
    base = inner.element
    if base is not None and base.get("type") == "twosided" and len(base) == 1:
        base = base[0]
    if base is None or base.get("type") != "diffuse":
        bsdf.note("the clear coat over a material was left out")
        if min(tint) < 1:
            bsdf.note("the colour of a clear coat was left out")
        return inner
    bsdf.note("a coated diffuse material was replaced by plastic")
    return Surface(
        plugin(
            "bsdf",
            "roughplastic" if rough else "plastic",
            **interface,
            specular_reflectance=specular,
            nonlinear=True,
            **rough,
            diffuse_reflectance=_tinted(bsdf, base.find("*[@name='reflectance']"), tint),
        )
    )


def _tint(bsdf: Bsdf) -> Color:
    """Transmittance of a coat for light that passes it perpendicularly down and up again."""
    thickness = bsdf.properties.number("thickness", 1.0)
    found = bsdf.properties.color("sigma_a")
    if isinstance(found, Node):
        bsdf.note("the texture of a clear coat's colour was left out")
        found = None
    return clipped(np.exp(-2 * thickness * np.array(found if found is not None else (0.0,) * 3)))


def _tinted(bsdf: Bsdf, color: Element | None, tint: Color) -> Element | Color | None:
    """The reflectance of a diffuse material (0.5 if None) times `tint`."""
    if min(tint) < 1:
        if color is None or color.tag == "rgb":
            words = (color.get("value", "") if color is not None else "0.5").split()
            return clipped(np.broadcast_to([float(word) for word in words], 3) * np.array(tint))
        bsdf.note("the colour of a clear coat was left out")
    return color


def _phong(bsdf: Bsdf) -> Surface:
    """`phong` and `ward`: a blend of a diffuse and a microfacet material of equal roughness.

    For Phong's exponent n, alpha = sqrt(2 / (n + 2)) (Walter et al. 2007).
    """
    bsdf.properties.ignore("variant")
    if bsdf.type == "phong":
        alpha = math.sqrt(2 / (max(bsdf.scalar("exponent", 30.0), 0.0) + 2))
    else:
        alpha_u, alpha_v = bsdf.scalar("alpha_u", 0.1), bsdf.scalar("alpha_v", 0.1)
        alpha = math.sqrt(max(alpha_u * alpha_v, 1e-8))
    bsdf.note(f"{bsdf.type} was replaced by a diffuse and a microfacet material")
    diffuse = bsdf.color("diffuse_reflectance", GREY)
    specular = bsdf.color("specular_reflectance", (0.2, 0.2, 0.2))
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
        specular_reflectance=clipped(gloss / weight),
    )
    if weight > 0.999:
        return Surface(mirror)
    matt = plugin("bsdf", "diffuse", reflectance=clipped(base / (1 - weight)))
    return Surface(wrapped("blendbsdf", matt, mirror, weight=weight))


def _two_sided(bsdf: Bsdf) -> Surface:
    """`twosided`: its nested material, which `Materials.surface` makes two-sided again."""
    inner = bsdf.inner()
    if len(inner) == 1 or any(one.transmissive or one.element is None for one in inner):
        return inner[0]
    return Surface(wrapped("twosided", *(one.opaque_element for one in inner[:2])), double=True)


def _mask(bsdf: Bsdf) -> Surface:
    """`mask`: opacity from the image's alpha channel if it has one."""
    inner = bsdf.inner()[0]
    node = bsdf.properties.child("opacity")
    if node is None:
        found = bsdf.properties.nested("texture")
        node = found[0] if found else None
    if node is not None and node.tag == "texture":
        opacity = bsdf.textures.weight(node, "opacity")
    else:
        opacity = bsdf.scalar("opacity", 0.5)
    if isinstance(opacity, float):
        opacity = min(max(opacity, 0.0), 1.0)
        if opacity == 1:
            return inner
        if opacity == 0 or inner.invisible:
            return invisible()
    if inner.element is None:
        return inner
    made = wrapped("mask", inner.two_sided().element, opacity=opacity)
    clear = isinstance(opacity, float) and opacity <= 0.3
    return Surface(made, transmissive=True, see_through=clear)


def _blend(bsdf: Bsdf) -> Surface:
    """`blendbsdf`."""
    first, second = bsdf.inner(2)[:2]
    node = bsdf.properties.child("weight")
    weight: Element | float
    if node is not None and node.tag == "texture":
        weight = bsdf.textures.weight(node, "data")
    else:
        weight = min(max(bsdf.scalar("weight", 0.5), 0.0), 1.0)
    return first.blended(second, weight)


def _mixture(bsdf: Bsdf) -> Surface:
    """`mixturebsdf`: a chain of two-material blends with the same total weights."""
    inner, node = bsdf.inner(), bsdf.properties.node
    text = bsdf.properties.text("weights", "").replace(",", " ").split()
    if len(text) != len(inner) or not all(_is_number(word) for word in text):
        raise node.error("must have as many weights as nested materials")
    weights = np.array([float(word) for word in text])
    if (weights < 0).any() or weights.sum() <= 0:
        raise node.error("weights must not be negative and must not all be 0")
    if weights.sum() < 0.999:
        inner.append(Surface(plugin("bsdf", "diffuse", reflectance=(0.0, 0.0, 0.0))))
        weights = np.append(weights, 1 - weights.sum())
    elif weights.sum() > 1.001:
        bsdf.note("the weights of a mixture were normalised to the sum 1")
    bsdf.note("mixturebsdf was replaced by blendbsdf")
    made, total = inner[0], float(weights[0])
    for surface, weight in zip(inner[1:], weights[1:].tolist(), strict=True):
        total += weight
        made = made.blended(surface, weight / total if total > 0 else 0.0)
    return made


def _bump(bsdf: Bsdf) -> Surface:
    """`bumpmap` and `normalmap`."""
    inner = bsdf.inner()[0]
    textures = bsdf.properties.nested("texture")
    strength = bsdf.properties.number("scale", 1.0)
    bsdf.properties.ignore("normalmap", "flip_invert_tangents", "use_shading_frame")
    if not textures or inner.element is None:
        bsdf.note(f"a {bsdf.type} without a texture was left out")
        return inner
    image = bsdf.textures.texture(textures[0], "data")
    if isinstance(image, tuple):
        bsdf.note(f"a {bsdf.type} without an image was left out")
        return inner
    is_bump = bsdf.type == "bumpmap"
    values = {"bump": image, "scale": strength} if is_bump else {"normalmap": image}
    made = wrapped(bsdf.type, inner.opaque_element, **values)
    return Surface(made, transmissive=inner.transmissive, frosted=inner.see_through)


def _diffuse_transmitter(bsdf: Bsdf) -> Surface:
    """`difftrans`: a thin principled material that only transmits diffusely."""
    color = bsdf.color("transmittance", GREY)
    assert color is not None
    bsdf.note("difftrans was replaced by a thin principled material")
    return thin_sheet(color, 2.0)


def _principled(bsdf: Bsdf) -> Surface:
    """`principled` and `principledthin`, property by property."""
    made = plugin("bsdf", bsdf.type, base_color=bsdf.color("base_color"))
    transmission = 0.0
    for name in _PRINCIPLED[bsdf.type].split():
        node = bsdf.properties.child(name)
        if node is None:
            continue
        is_texture = node.tag == "texture"
        value = bsdf.textures.weight(node, "data") if is_texture else bsdf.scalar(name, 0.0)
        made.append(prop(name, value))
        if name == "spec_trans":
            transmission = 0.5 if is_texture or isinstance(value, Element) else value
    return principled_surface(made, transmission)


def _null(bsdf: Bsdf) -> Surface:
    """`null`, and filters that affect only polarised light."""
    if bsdf.type != "null":
        bsdf.properties.ignore("theta", "transmittance", "delta", "left_handed", "polarizing")
        bsdf.note("a filter of polarised light was left out: {}", bsdf.type)
    return invisible()


def _approximate(bsdf: Bsdf) -> Surface:
    """Materials without an equivalent: rough plastic of their colour, or grey."""
    color: Color | Element | None = None
    for name in ("albedo", "diffuse_reflectance", "reflectance", "kd", "base_color"):
        if color is None:
            color = bsdf.color(name)
    bsdf.properties.ignore(*(child.name for child in bsdf.properties.node.children))
    if color is None:
        color = (0.15, 0.09, 0.06) if bsdf.type == "hair" else GREY
    bsdf.note("a material was approximated by rough plastic: {}", repr(bsdf.type))
    return Surface(plugin("bsdf", "roughplastic", diffuse_reflectance=color, alpha=0.4))


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


# Plugin -> its translation.
BSDFS: dict[str, Callable[[Bsdf], Surface]] = {
    **dict.fromkeys(("diffuse", "lambertian"), _diffuse),
    "roughdiffuse": _rough_diffuse,
    **dict.fromkeys(("dielectric", "thindielectric", "roughdielectric"), _dielectric),
    **dict.fromkeys(("conductor", "roughconductor"), _conductor),
    **dict.fromkeys(("plastic", "roughplastic", "pplastic"), _plastic),
    **dict.fromkeys(("coating", "roughcoating"), _coating),
    **dict.fromkeys(("phong", "ward"), _phong),
    "twosided": _two_sided,
    "mask": _mask,
    "blendbsdf": _blend,
    "mixturebsdf": _mixture,
    **dict.fromkeys(("bumpmap", "normalmap"), _bump),
    "difftrans": _diffuse_transmitter,
    **dict.fromkeys(_PRINCIPLED, _principled),
    **dict.fromkeys(("null", "polarizer", "retarder", "circular"), _null),
    **dict.fromkeys(("hk", "irawan", "hair", "measured", "measured_polarized"), _approximate),
}
