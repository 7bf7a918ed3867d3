"""Materials of pbrt, versions 3 and 4, as Mitsuba 3 BSDFs.

What Mitsuba has is translated parameter by parameter; the others are approximated and noted.
Opaque materials are two-sided, as all of pbrt's are.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from xml.etree.ElementTree import Element

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.color import REC709, Color
from pbrnet.scenes.importing.materials.surface import (
    Surface,
    clipped,
    invisible,
    principled_surface,
    thin_sheet,
    wrapped,
)
from pbrnet.scenes.importing.xml_elements import plugin, prop
from pbrnet.scenes.pbrt.bsdfs import (
    WHITE,
    Alpha,
    glass,
    mirror,
    plastic,
    remapped,
    roughness,
)
from pbrnet.scenes.pbrt.textures import Textures
from pbrnet.scenes.pbrt.values import Context, Entity

_MAX_NESTING = 8
_HALF: Color = (0.5, 0.5, 0.5)
_QUARTER: Color = (0.25, 0.25, 0.25)
_BLACK: Color = (0.0, 0.0, 0.0)
# Metals whose spectra version 4 knows by name, or version 3 has as files, in Mitsuba's data.
_METALS = ("Ag", "Al", "Au", "Cu", "MgO", "TiO2", "Cr", "W", "Ir", "V", "K", "Li", "Mo", "Rh")
_NEAR_ONE, _NEAR_ZERO = 0.999, 0.001


class Materials:
    """Translates materials, each once for each opacity of a shape."""

    def __init__(self, context: Context, textures: Textures) -> None:
        self.context, self.textures = context, textures
        self._surfaces: dict[tuple[int, str], Surface] = {}
        self._kept: list[Entity] = []  # so that ids stay unique
        self._depth = 0

    def surface(self, material: Entity | None, shape: Entity) -> Surface:
        """Translate the material of a shape, cut out by the shape's `alpha`."""
        alpha = self.textures.number(shape, "alpha", 1.0)
        name = alpha.findtext("string", "") if isinstance(alpha, Element) else str(alpha)
        if isinstance(alpha, Element):
            name = str([(one.get("name"), one.get("value")) for one in alpha])
        key = (id(material), name)
        if key not in self._surfaces:
            if material is not None:
                self._kept.append(material)
            self._surfaces[key] = self._cut_out(self._translate(material).two_sided(), alpha)
            if material is not None:
                self._surfaces[key].name = material.label
        return self._surfaces[key]

    def _translate(self, material: Entity | None) -> Surface:
        if material is None:
            return Surface(plugin("bsdf", "diffuse", reflectance=_HALF))
        known = _MATERIALS.get(material.type)
        if known is None:
            self.context.changes.note(
                "unknown material, replaced by a grey diffuse one: {}",
                f"{material.type!r:.60} ({material.place})",
            )
            return Surface(plugin("bsdf", "diffuse", reflectance=_HALF))
        if self._depth >= _MAX_NESTING:
            raise material.error("materials are nested too deep or inside themselves")
        self._depth += 1
        try:
            surface = known(self, material)
        finally:
            self._depth -= 1
        surface = self._normal_map(material, surface)
        material.ignore("type")
        for name in ("displacement", "bumpmap"):
            if name in material:
                material.ignore(name)
                self.context.changes.note("a bump map was left out: {}", material.label)
        material.report_unused()
        return surface

    def _cut_out(self, surface: Surface, alpha: float | Element | Color) -> Surface:
        """`surface` with an opacity."""
        if surface.element is None:
            return surface
        if isinstance(alpha, float):
            if alpha >= _NEAR_ONE:
                return surface
            if alpha <= _NEAR_ZERO:
                return invisible()
        made = wrapped("mask", surface.element, opacity=alpha)
        clear = isinstance(alpha, float) and alpha <= 0.3
        return Surface(made, transmissive=True, see_through=surface.see_through or clear)

    def _normal_map(self, material: Entity, surface: Surface) -> Surface:
        if "normalmap" not in material or surface.element is None:
            return surface
        path = self.textures.image(material, "normalmap")
        image = None
        if path is not None:
            image = self.textures.bitmap(path, np.ones(3), True, None, "repeat")
        if image is None:
            return surface
        made = wrapped("normalmap", surface.element, normalmap=image)
        return Surface(made, surface.transmissive, frosted=surface.see_through or surface.frosted)

    # Parameters

    def _alpha(self, material: Entity, default: float, version: int, prefix: str = "") -> Alpha:
        """GGX roughness of the microfacets, one or two values; 0 if the surface is smooth."""
        both = material.number(f"{prefix}roughness", default)
        u = material.number(f"{prefix}uroughness", both)
        v = material.number(f"{prefix}vroughness", both if u == both else u)
        if material.boolean(f"{prefix}remaproughness", True):
            u, v = (remapped(value, version) for value in (u, v))
        if max(u, v) < 1e-3:
            return 0.0
        return u if u == v else (max(u, 1e-3), max(v, 1e-3))

    def _ior(self, material: Entity, *names: str) -> float:
        for name in names or ("eta",):
            if name in material:
                value = material.number(name, 1.5)
                return value if 1.0 < value < 4.0 else 1.5
        return 1.5

    # Materials of version 3

    def matte(self, material: Entity) -> Surface:
        """`matte`; Oren and Nayar's roughness is left out."""
        if material.number("sigma", 0.0) > 0:
            self.context.changes.note("the roughness of a matte material was left out")
        return Surface(
            plugin("bsdf", "diffuse", reflectance=self.textures.color(material, "Kd", _HALF))
        )

    def plastic(self, material: Entity) -> Surface:
        """`plastic`."""
        diffuse = self.textures.color(material, "Kd", _QUARTER)
        specular = self.textures.color(material, "Ks", _QUARTER)
        return plastic(diffuse, self._alpha(material, 0.1, 3), 1.5, specular)

    def substrate(self, material: Entity) -> Surface:
        """`substrate`: plastic whose reflectance at normal incidence is that of `Ks`."""
        diffuse = self.textures.color(material, "Kd", _HALF)
        specular = self.textures.color(material, "Ks", _HALF)
        level = float(np.array(specular) @ REC709) if isinstance(specular, tuple) else 0.04
        root = math.sqrt(min(max(level, 0.001), 0.25))
        return plastic(diffuse, self._alpha(material, 0.1, 3), (1 + root) / (1 - root), WHITE)

    def uber(self, material: Entity) -> Surface:
        """`uber`: plastic, with a mirror's or a pane's share, and an opacity."""
        diffuse = self.textures.color(material, "Kd", _QUARTER)
        specular = self.textures.color(material, "Ks", _QUARTER)
        mirrored = material.color("Kr", _BLACK) or _BLACK
        through = material.color("Kt", _BLACK) or _BLACK
        ior = self._ior(material, "eta", "index")
        alpha = self._alpha(material, 0.1, 3)
        if max(through) > 0.5:
            return Surface(
                plugin("bsdf", "thindielectric", int_ior=ior, specular_transmittance=through),
                transmissive=True,
                see_through=True,
            )
        if max(through) > 0:
            self.context.changes.note("the slight transmission of an uber material was left out")
        surface = plastic(diffuse, alpha, ior, specular)
        if max(mirrored) > 0:
            base = float(np.array(diffuse) @ REC709) if isinstance(diffuse, tuple) else 0.5
            share = float(np.array(mirrored) @ REC709)
            weight = share / max(share + base, 1e-6)
            scaled = clipped(np.array(mirrored) / max(weight, 1e-6))
            surface = surface.blended(mirror(scaled), weight)
        return self._cut_out(surface, self.textures.number(material, "opacity", 1.0))

    def mirror(self, material: Entity) -> Surface:
        """`mirror`."""
        return mirror(self.textures.color(material, "Kr", (0.9, 0.9, 0.9)))

    def glass(self, material: Entity) -> Surface:
        """`glass`."""
        reflected = material.color("Kr", WHITE) or WHITE
        through = material.color("Kt", WHITE) or WHITE
        ior = self._ior(material, "eta", "index")
        return glass("dielectric", ior, self._alpha(material, 0.0, 3), reflected, through)

    def metal(self, material: Entity) -> Surface:
        """`metal`, by default copper."""
        return self._metal(material, self._alpha(material, 0.01, 3))

    def translucent(self, material: Entity) -> Surface:
        """`translucent`: a thin sheet that scatters light to both sides."""
        color = material.color("Kd", _QUARTER) or _QUARTER
        back = np.array(material.color("reflect", _HALF)) * color
        through = np.array(material.color("transmit", _HALF)) * color
        material.ignore("Ks", "roughness", "remaproughness")
        return _sheet(back, through)

    def disney(self, material: Entity) -> Surface:
        """`disney`: Mitsuba's `principled`, or `principledthin`."""
        color = self.textures.color(material, "color", _HALF)
        thin = material.boolean("thin", False)
        made = plugin("bsdf", "principledthin" if thin else "principled", base_color=color)
        for name, theirs, default in (
            ("roughness", "roughness", 0.5), ("metallic", "metallic", 0.0),
            ("anisotropic", "anisotropic", 0.0), ("sheen", "sheen", 0.0),
            ("sheentint", "sheen_tint", 0.5), ("speculartint", "spec_tint", 0.0),
            ("clearcoat", "clearcoat", 0.0), ("clearcoatgloss", "clearcoat_gloss", 1.0),
            ("spectrans", "spec_trans", 0.0), ("flatness", "flatness", 0.0),
            ("difftrans", "diff_trans", 1.0),
        ):  # fmt: skip
            fits = name not in (("metallic", "clearcoat", "clearcoatgloss") if thin else
                                ("flatness", "difftrans"))  # fmt: skip
            if name in material and fits:
                made.append(prop(theirs, self.textures.number(material, name, default)))
        made.append(prop("eta", self._ior(material)))
        transmission = material.number("spectrans", 0.0)
        material.ignore("scatterdistance", "flatness", "difftrans", "metallic", "clearcoat",
                        "clearcoatgloss")  # fmt: skip
        return principled_surface(made, transmission)

    # Materials of version 4

    def diffuse(self, material: Entity) -> Surface:
        """`diffuse`."""
        color = self.textures.color(material, "reflectance", _HALF)
        return Surface(plugin("bsdf", "diffuse", reflectance=color))

    def coated_diffuse(self, material: Entity) -> Surface:
        """`coateddiffuse`: plastic with the non-linear colour shift of its coat."""
        color = self.textures.color(material, "reflectance", _HALF)
        self._ignore_layers(material)
        surface = plastic(color, self._alpha(material, 0.0, 4), self._ior(material), WHITE)
        assert surface.element is not None
        surface.element.append(prop("nonlinear", True))
        return surface

    def conductor(self, material: Entity) -> Surface:
        """`conductor`: a measured metal, or one of a reflectance."""
        return self._metal(material, self._alpha(material, 0.0, 4))

    def coated_conductor(self, material: Entity) -> Surface:
        """`coatedconductor`: the conductor without its coat."""
        self._ignore_layers(material)
        material.ignore("interface.roughness", "interface.uroughness", "interface.vroughness",
                        "interface.eta", "remaproughness")  # fmt: skip
        self.context.changes.note("the clear coat over a metal was left out")
        alpha = self._alpha(material, 0.0, 4, "conductor.")
        return self._metal(material, alpha, "conductor.")

    def dielectric(self, material: Entity) -> Surface:
        """`dielectric`."""
        ior = self._ior(material)
        return glass("dielectric", ior, self._alpha(material, 0.0, 4), WHITE, WHITE)

    def thin_dielectric(self, material: Entity) -> Surface:
        """`thindielectric`."""
        return glass("thindielectric", self._ior(material), 0.0, WHITE, WHITE)

    def diffuse_transmission(self, material: Entity) -> Surface:
        """`diffusetransmission`: a thin sheet that scatters light to both sides."""
        scale = material.number("scale", 1.0)
        if material.is_texture("reflectance") or material.is_texture("transmittance"):
            name = "reflectance" if material.is_texture("reflectance") else "transmittance"
            material.ignore("reflectance", "transmittance")
            self.context.changes.note("a textured sheet reflects and transmits in equal parts")
            return thin_sheet(self.textures.color(material, name, _QUARTER, 2 * scale), 1.0)
        back, through = (
            np.array(material.color(name, _QUARTER)) * scale
            for name in ("reflectance", "transmittance")
        )
        return _sheet(back, through)

    def mix(self, material: Entity) -> Surface:
        """`mix` of two materials; the amount is the first one's in version 3, else the second's."""
        names = material.strings("materials")
        is_old = not names
        if is_old:
            names = [material.text(f"namedmaterial{number}") for number in (1, 2)]
        amount = self.textures.number(material, "amount", 0.5)
        material.ignore("namedmaterial1", "namedmaterial2")
        found = [material.find_material(name) for name in names[:2]]
        if len(found) != 2:
            raise material.error("needs two materials")
        first, second = (self._translate(one) for one in found)
        if is_old:
            first, second = second, first
        if isinstance(amount, float):
            amount = min(max(amount, 0.0), 1.0)
        return first.blended(second, amount)

    def interface(self, material: Entity) -> Surface:
        """`interface`, `none` and "": no effect on light."""
        return invisible()

    def approximate(self, material: Entity) -> Surface:
        """Materials without an equivalent: rough plastic of their colour, or grey."""
        color: Color | Element = _HALF
        for name in ("Kd", "reflectance", "color"):
            if name in material:
                color = self.textures.color(material, name, _HALF)
                break
        else:
            if material.type == "hair":
                color = (0.15, 0.09, 0.06)
        self.context.changes.note(
            "a material was approximated by rough plastic: {}", repr(material.type)
        )
        material.ignore(*material.names())
        return plastic(color, 0.4, 1.5, WHITE)

    # Parts

    def _metal(self, material: Entity, alpha: Alpha, prefix: str = "") -> Surface:
        made = plugin("bsdf", "roughconductor" if alpha else "conductor")
        for one in roughness(alpha):
            made.append(one)
        if f"{prefix}reflectance" in material:
            color = self.textures.color(material, f"{prefix}reflectance", _HALF)
            made.append(prop("material", "none"))
            made.append(prop("specular_reflectance", color))
            return Surface(made)
        name = material.spectrum_name(f"{prefix}eta")
        metal = name.removeprefix("metal-").replace(".", "-").split("-")[0]
        if metal in _METALS or f"{prefix}eta" not in material:
            made.append(prop("material", metal if metal in _METALS else "Cu"))
            material.ignore(f"{prefix}k")
            return Surface(made)
        eta, k = material.color(f"{prefix}eta"), material.color(f"{prefix}k")
        if eta is None:
            self.context.changes.note("an unknown metal was replaced by a mirror: {}", repr(name))
            made.append(prop("material", "none"))
            return Surface(made)
        made.append(prop("eta", eta))
        made.append(prop("k", k or WHITE))
        return Surface(made)

    def _ignore_layers(self, material: Entity) -> None:
        material.ignore("thickness", "maxdepth", "nsamples", "g", "albedo", "interface.thickness",
                        "layers.maxdepth", "layers.nsamples")  # fmt: skip


def _sheet(back: Float64Array, through: Float64Array) -> Surface:
    """A thin diffuse sheet that reflects `back` and transmits `through`, each (3,)."""
    total = np.maximum(back + through, 1e-6)
    share = float((through @ REC709) / max(float(total @ REC709), 1e-6))
    return thin_sheet(clipped(total), 2 * share)


_MATERIALS: dict[str, Callable[[Materials, Entity], Surface]] = {
    "matte": Materials.matte,
    "plastic": Materials.plastic,
    "substrate": Materials.substrate,
    "uber": Materials.uber,
    "mirror": Materials.mirror,
    "glass": Materials.glass,
    "metal": Materials.metal,
    "translucent": Materials.translucent,
    "disney": Materials.disney,
    "diffuse": Materials.diffuse,
    "coateddiffuse": Materials.coated_diffuse,
    "conductor": Materials.conductor,
    "coatedconductor": Materials.coated_conductor,
    "dielectric": Materials.dielectric,
    "thindielectric": Materials.thin_dielectric,
    "diffusetransmission": Materials.diffuse_transmission,
    "mix": Materials.mix,
    **dict.fromkeys(("interface", "none", ""), Materials.interface),
    **dict.fromkeys(
        ("hair", "fourier", "subsurface", "kdsubsurface", "measured"), Materials.approximate
    ),
}
