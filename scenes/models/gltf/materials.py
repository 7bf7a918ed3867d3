"""glTF materials as Mitsuba 3 BSDFs: metallic-roughness as `principled`, transmission as glass.

Khronos, *glTF 2.0 Specification*, section 3.9 and appendix B; the KHR_materials_* extensions.
glTF and `principled` both define alpha = roughness squared, so roughness and metalness are used
unchanged.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from pbrnet.scenes.arrays import Float64Array, as_triple
from pbrnet.scenes.color import Color
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.materials.surface import (
    Surface,
    invisible,
    thin_sheet,
    wrapped,
)
from pbrnet.scenes.importing.materials.textures import TextureStore, UnreadableImage
from pbrnet.scenes.importing.xml_elements import plugin, prop
from pbrnet.scenes.models.gltf.container import UNDERSTOOD, Asset, extensions, number, numbers
from pbrnet.scenes.models.gltf.images import Images, ImageTexture
from pbrnet.scenes.models.model import Emission
from pbrnet.scenes.models.stated import Statement, opaque_bsdf, passing_surface, statement

CLEAR_ROUGHNESS = 0.1  # up to which glass counts as clear
_WHITE: Color = (1.0, 1.0, 1.0)


# The specification's default is a white, rough metal, which modelling programs do not show either.
_NO_MATERIAL: dict[str, Any] = {
    "pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.8, 0.8, 1.0], "metallicFactor": 0.0}
}


@dataclass(frozen=True)
class GltfMaterial:
    """A translated material."""

    surface: Surface
    emission: Emission | None = None
    texcoord: int = 0  # number of the set of texture coordinates


@dataclass
class GltfMaterials:
    """Translates the materials of `asset`, each combination with a tint once."""

    asset: Asset
    images: Images
    textures: TextureStore
    changes: Changes
    _translated: dict[tuple[int | None, Color], GltfMaterial] = field(default_factory=dict)

    def material(self, index: Any, tint: Color = _WHITE) -> GltfMaterial:
        """Return material `index` (None: the default one), its base colour times `tint`."""
        if index is not None:
            self.asset.item("materials", index, "primitive.material")
        key = (index, tint)
        if key not in self._translated:
            self._translated[key] = self._translate(index, tint)
        return self._translated[key]

    def _translate(self, index: int | None, tint: Color) -> GltfMaterial:
        material = _NO_MATERIAL if index is None else self.asset.items("materials")[index]
        where = f"materials[{index}]"
        name = str(material.get("name") or where)
        more = extensions(material)
        for extension in sorted(set(more) - UNDERSTOOD):
            self.changes.note(f"material extension {extension} was left out: {{}}", name)
        if "occlusionTexture" in material:
            self.changes.note("baked ambient occlusion was left out")
        stated = self._statement(material, f"{self.asset.path}: {where}")
        if stated is not None:
            tint = as_triple(np.array(tint) / stated.lift)
        parameters = self._pbr_parameters(material, more, tint, where)
        emission, emission_image = self._emission(material, more, where)
        surface = self._surface(material, more, parameters, where)
        surface.name, surface.unstated = name, index is None
        used = [image for image in (*parameters.images, emission_image) if image is not None]
        texcoord = used[0].texcoord if used else 0
        if any(image.texcoord != texcoord for image in used):
            self.changes.note("a second set of texture coordinates was left out: {}", name)
        return GltfMaterial(surface, emission, texcoord)

    def _pbr_parameters(
        self, material: dict[str, Any], more: dict[str, Any], tint: Color, where: str
    ) -> _PbrParameters:
        """Base colour, roughness and metalness, from either of glTF's two parametrisations."""
        place = f"{self.asset.path}: {where}"
        spec_gloss = more.get("KHR_materials_pbrSpecularGlossiness")
        if spec_gloss is not None and "pbrMetallicRoughness" not in material:
            self.changes.note("a specular-glossiness material became metallic-roughness")
            factor = _clipped(spec_gloss.get("diffuseFactor", [1, 1, 1, 1]), 4, place)
            glossiness = number(spec_gloss.get("glossinessFactor", 1), place, 0, 1)
            base = self.images.texture(spec_gloss.get("diffuseTexture"), where)
            return _PbrParameters(factor * [*tint, 1.0], base, 1 - glossiness, 0.0, None)
        pbr = material.get("pbrMetallicRoughness")
        pbr = pbr if isinstance(pbr, dict) else {}
        factor = _clipped(pbr.get("baseColorFactor", [1, 1, 1, 1]), 4, place)
        return _PbrParameters(
            factor * [*tint, 1.0],
            self.images.texture(pbr.get("baseColorTexture"), where),
            number(pbr.get("roughnessFactor", 1), place, 0, 1),
            number(pbr.get("metallicFactor", 1), place, 0, 1),
            self.images.texture(pbr.get("metallicRoughnessTexture"), where),
        )

    def _surface(
        self, material: dict[str, Any], more: dict[str, Any], parameters: _PbrParameters, where: str
    ) -> Surface:
        place = f"{self.asset.path}: {where}"
        stated = self._statement(material, place)
        if stated is not None and stated.is_passing:
            values = (self._color(parameters), parameters.roughness, _ior(more, place))
            return passing_surface(stated, *values)
        transmission = more.get("KHR_materials_transmission", {})
        transmission_share = number(transmission.get("transmissionFactor", 0), place, 0, 1)
        if transmission_share >= 0.5:
            if transmission_share < 0.99 or "transmissionTexture" in transmission:
                self.changes.note("a partly transmitting material became clear glass")
            return self._glass(more, parameters, place)
        if transmission_share > 0:
            self.changes.note("a slightly transmitting material became opaque")
        color = self._color(parameters)
        if "KHR_materials_unlit" in more:
            self.changes.note("an unlit material became matt")
            bsdf = plugin("bsdf", "diffuse", reflectance=color)
        elif (passed := self._diffuse_transmission(more, place)) > 0:
            return thin_sheet(color, 2 * passed)
        elif stated is not None and stated.is_opaque:
            bsdf = opaque_bsdf(stated, color, parameters.roughness, _ior(more, place))
        else:
            bsdf = self._principled(more, parameters, color, place)
        bsdf = self._normals(material, bsdf, where)
        return self._alpha(material, parameters, wrapped("twosided", bsdf), place)

    def _statement(self, material: dict[str, Any], place: str) -> Statement | None:
        """Statement that `pbrnet export-scene` wrote of the material, where glTF says less."""
        extras = material.get("extras")
        given = extras.get("pbrnet") if isinstance(extras, dict) else None
        return statement(given, f"{place}.extras.pbrnet")

    def _principled(
        self, more: dict[str, Any], parameters: _PbrParameters, color: Color | Element, place: str
    ) -> Element:
        rough, metal = self._channels(parameters)
        ior = _ior(more, place)
        specular_extension = more.get("KHR_materials_specular", {})
        strength = number(specular_extension.get("specularFactor", 1), place, 0, 1)
        # Mitsuba's `specular` is the reflectance at normal incidence divided by 8 %.
        specular = min(((ior - 1) / (ior + 1)) ** 2 * strength / 0.08, 1.0)
        made = plugin("bsdf", "principled", base_color=color, roughness=rough, metallic=metal)
        made.append(prop("specular", float(specular)))
        coat = more.get("KHR_materials_clearcoat", {})
        amount = number(coat.get("clearcoatFactor", 0), place, 0, 1)
        if amount > 0:
            softness = number(coat.get("clearcoatRoughnessFactor", 0), place, 0, 1)
            made.append(prop("clearcoat", amount))
            made.append(prop("clearcoat_gloss", 1 - softness))
        sheen = more.get("KHR_materials_sheen", {})
        cloth = max(numbers(sheen.get("sheenColorFactor", [0, 0, 0]), 3, place))
        if cloth > 0:
            made.append(prop("sheen", min(cloth, 1.0)))
        return made

    def _diffuse_transmission(self, more: dict[str, Any], place: str) -> float:
        """The share of diffuse light that a thin sheet lets pass, tinted like what it reflects."""
        sheet = more.get("KHR_materials_diffuse_transmission", {})
        return number(sheet.get("diffuseTransmissionFactor", 0), place, 0, 1)

    def _glass(self, more: dict[str, Any], parameters: _PbrParameters, place: str) -> Surface:
        """Glass: thin unless KHR_materials_volume gives it thickness, frosted if it is rough."""
        ior = number(more.get("KHR_materials_ior", {}).get("ior", 1.5), place, 1.01, 4)
        volume = more.get("KHR_materials_volume", {})
        solid = number(volume.get("thicknessFactor", 0), place, 0) > 0
        if "attenuationColor" in volume:
            self.changes.note("the absorption of light inside glass was left out")
        if parameters.base is not None:
            self.changes.note("a texture on glass was left out: {}", parameters.base.path.name)
        tint = parameters.color
        clear = parameters.roughness <= CLEAR_ROUGHNESS
        if clear or solid:
            kind = "dielectric" if solid else "thindielectric"
            made = plugin("bsdf", kind if clear else "roughdielectric", int_ior=ior)
            if not clear:
                made.append(prop("alpha", max(parameters.roughness**2, 0.001)))
                made.append(prop("distribution", "ggx"))
            if min(tint) < 1:
                made.append(prop("specular_transmittance", tint))
        else:
            made = plugin("bsdf", "principledthin", base_color=tint, roughness=parameters.roughness)
            made.append(prop("spec_trans", 1.0))
            made.append(prop("eta", ior))
        return Surface(made, transmissive=True, see_through=clear, frosted=not clear)

    def _alpha(
        self, material: dict[str, Any], parameters: _PbrParameters, bsdf: Element, place: str
    ) -> Surface:
        """`bsdf` with the material's alpha mode: opaque, cut out or blended."""
        mode = material.get("alphaMode", "OPAQUE")
        whole = Surface(bsdf, double=True)
        alpha = float(parameters.factor[3])
        opacity: float | Element
        if mode == "MASK":
            cutoff = number(material.get("alphaCutoff", 0.5), place, 0)
            if parameters.base is None:
                opacity = 1.0 if alpha >= cutoff else 0.0
            else:
                opacity = self._bitmap(parameters.base, "cutout", alpha, cutoff)
        elif mode == "BLEND":
            opacity = alpha
            if parameters.base is not None and self._has_alpha(parameters.base):
                opacity = self._bitmap(parameters.base, "alpha", alpha, 0)
        else:
            return whole
        if isinstance(opacity, float):
            if opacity >= 1:
                return whole
            if opacity <= 0:
                return invisible()
        made = wrapped("mask", bsdf, opacity=opacity)
        clear = isinstance(opacity, float) and opacity <= 0.3
        return Surface(made, transmissive=True, see_through=clear)

    def _emission(
        self, material: dict[str, Any], more: dict[str, Any], where: str
    ) -> tuple[Emission | None, ImageTexture | None]:
        place = f"{self.asset.path}: {where}"
        factor = _clipped(material.get("emissiveFactor", [0, 0, 0]), 3, place)
        extension = more.get("KHR_materials_emissive_strength", {})
        strength = number(extension.get("emissiveStrength", 1), place, 0, 1e9)
        if factor.max() * strength <= 0:
            return None, None
        image = self.images.texture(material.get("emissiveTexture"), where)
        color = as_triple(factor * strength)
        if image is None:
            return Emission(color), None
        return Emission(color, image.path, image.to_uv), image

    def _color(self, parameters: _PbrParameters) -> Color | Element:
        if parameters.base is None:
            return parameters.color
        return self._bitmap(parameters.base, "color", parameters.color, 0)

    def _channels(self, parameters: _PbrParameters) -> tuple[float | Element, float | Element]:
        if parameters.metallic_roughness is None:
            return parameters.roughness, parameters.metalness
        return (
            self._bitmap(parameters.metallic_roughness, "green", parameters.roughness, 0),
            self._bitmap(parameters.metallic_roughness, "blue", parameters.metalness, 0),
        )

    def _normals(self, material: dict[str, Any], bsdf: Element, where: str) -> Element:
        info = material.get("normalTexture")
        image = self.images.texture(info, where)
        if image is None:
            return bsdf
        if isinstance(info, dict) and info.get("scale", 1) != 1:
            self.changes.note("the scale of a normal map was left out")
        made = self._bitmap(image, "data", _WHITE, 0)
        if not isinstance(made, Element):
            return bsdf
        return wrapped("normalmap", bsdf, normalmap=made)

    def _has_alpha(self, image: ImageTexture) -> bool:
        try:
            return self.textures.alpha(image.path) is not None
        except UnreadableImage:
            return False

    def _bitmap(self, image: ImageTexture, use: str, factor: Any, cutoff: float) -> Any:
        """A bitmap texture times `factor`; `factor` alone if the image is damaged.

        `use` is "color", "data", "cutout" or the channel "green", "blue" or "alpha".
        """
        store, path = self.textures, image.path
        try:
            if use == "color":
                scaled = min(factor) < 1
                stored = store.scaled(path, np.array(factor)) if scaled else store.color(path)
            elif use == "data":
                stored = store.color(path)
            elif use == "cutout":
                stored = store.cutout(path, factor, cutoff)
            else:
                channel = {"green": 1, "blue": 2, "alpha": 3}[use]
                stored = store.channel_scaled(path, channel, factor)
        except UnreadableImage as error:
            self.changes.note(
                "damaged texture, replaced by the plain value: {}", f"{path.name} ({error})"
            )
            return factor
        return plugin(
            "texture",
            "bitmap",
            filename=stored,
            filter_type="nearest" if image.nearest else None,
            wrap_mode=image.wrap if image.wrap != "repeat" else None,
            raw=None if use == "color" else True,
            to_uv=image.to_uv,
        )


@dataclass(frozen=True)
class _PbrParameters:
    factor: Float64Array  # base colour and alpha (4,), linear
    base: ImageTexture | None
    roughness: float
    metalness: float
    metallic_roughness: ImageTexture | None  # roughness in green, metalness in blue

    @property
    def color(self) -> Color:
        return as_triple(self.factor)

    @property
    def images(self) -> tuple[ImageTexture | None, ...]:
        return (self.base, self.metallic_roughness)


def _ior(more: dict[str, Any], place: str) -> float:
    return number(more.get("KHR_materials_ior", {}).get("ior", 1.5), place, 1, 4)


def _clipped(value: Any, count: int, place: str) -> Float64Array:
    """`count` numbers of the JSON, clipped to [0, 1]."""
    return np.clip(np.array(numbers(value, count, place)), 0.0, 1.0)
