"""Materials asked for (`piece.Material`) into Mitsuba 3 BSDFs and PNG textures.

Matt surfaces are `diffuse`, coated ones `principled`, mirrors `conductor`, glass
`thindielectric`, shades and thin curtains `principledthin`. All opaque ones are two-sided.
Textures tile in real size: a part's uvs are metres, and the mesh that is written has them divided
by `tile`, the pattern's side. (A `to_uv` transform in the texture would do the same, but the
renderer bakes that into code, so that each size would be compiled by itself.)
"""

from __future__ import annotations

import shutil
import zlib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from PIL import Image

from scenes.arrays import Float32Array, UInt8Array
from scenes.color import Color, encode_srgb
from scenes.procedural.patterns import SEEDS, has_pattern, pattern, picture
from scenes.procedural.piece import BoughtMaterial, Material
from scenes.seeds import generator

WHITEST = 0.82  # no diffuse surface of a home reflects more
_MATT = ("plaster", "wallpaper", "fabric", "carpet", "paper", "soil", "picture", "brick", "grass")
# Patterns without fine detail are drawn smaller.
_SHARE = {
    "plaster": 2,
    "wallpaper": 1,
    "carpet": 2,
    "leaf": 4,
    "soil": 4,
    "leather": 2,
    "fabric": 2,
    "wood": 2,
}
_LAID = ("tiles", "brick")  # their joints start at uv 0, and the accent is what lies in them
_DEFAULT_ACCENT = 0.75


@dataclass
class MaterialLibrary:
    """Collects the BSDFs of one scene; equal materials share one, and write one texture."""

    folder: Path  # the scene's folder; textures go to its `textures/`
    texture_size: int
    prefix: str = ""  # of the names of BSDFs and textures, where there are others already
    _ids: dict[Material | BoughtMaterial, str] = field(default_factory=dict)
    _tiles: dict[Material, float] = field(default_factory=dict)
    _xml: list[str] = field(default_factory=list)

    def bsdf(self, material: Material | BoughtMaterial) -> str:
        """The id of the BSDF for `material`, made on first use."""
        if material not in self._ids:
            self._ids[material] = f"{self.prefix}{material.kind}-{len(self._ids)}"
            describe = self._bought if isinstance(material, BoughtMaterial) else self._describe
            self._xml.append(describe(material, self._ids[material]))  # type: ignore[arg-type]
        return self._ids[material]

    def tile(self, material: Material | BoughtMaterial) -> float:
        """Metres after which the texture of `material` repeats; 1 for one without a pattern."""
        if isinstance(material, BoughtMaterial):
            return 1.0  # its meshes count in images already
        if material not in self._tiles:
            self._tiles[material] = (
                pattern(material.kind, material.variant % SEEDS, self._side(material)).metres
                * material.scale
                if has_pattern(material.kind)
                else 1.0
            )
        return self._tiles[material]

    @property
    def xml(self) -> list[str]:
        """One `<bsdf>` element for each material, in order of first use."""
        return list(self._xml)

    def _describe(self, material: Material, name: str) -> str:
        rgb = _rgb("specular_reflectance", material.color)
        if material.kind == "mirror":
            inner = f'<bsdf type="conductor"><string name="material" value="none"/>{rgb}</bsdf>'
            return f'<bsdf type="twosided" id="{name}">{inner}</bsdf>'
        if material.kind == "glass":
            return f'<bsdf type="thindielectric" id="{name}"/>'
        if material.translucent:
            # diff_trans counts to 2: half of what is not absorbed goes through.
            return (
                f'<bsdf type="principledthin" id="{name}">'
                f"{self._color('base_color', material, name)}"
                f"{_float('roughness', 0.9)}{_float('diff_trans', 1.0)}{_float('eta', 1.2)}</bsdf>"
            )
        if material.kind in _MATT:
            color = self._color("reflectance", material, name)
            inner = f'<bsdf type="diffuse">{color}</bsdf>'
        else:
            metallic = _float("metallic", 1.0) if material.kind == "metal" else ""
            inner = (
                f'<bsdf type="principled">{self._color("base_color", material, name)}'
                f"{_float('roughness', max(material.roughness, 0.05))}{metallic}</bsdf>"
            )
        return f'<bsdf type="twosided" id="{name}">{inner}</bsdf>'

    def _bought(self, material: BoughtMaterial, name: str) -> str:
        """The BSDF of a catalogue piece's material; its images are copied into the scene."""
        if material.kind == "glass":
            return f'<bsdf type="thindielectric" id="{name}"/>'
        if material.kind == "mirror":
            rgb = _rgb("specular_reflectance", material.color)
            inner = f'<bsdf type="conductor"><string name="material" value="none"/>{rgb}</bsdf>'
            return f'<bsdf type="twosided" id="{name}">{inner}</bsdf>'
        matt = material.kind in ("matt", "sheer") or material.roughness >= 1
        prop = "reflectance" if matt else "base_color"
        color = _rgb(prop, _limited(material.color, WHITEST))
        if material.texture is not None:
            file = self._copied(material.texture, name)
            color = _image(prop, file)
        if matt:
            inner = f'<bsdf type="diffuse">{color}</bsdf>'
        else:
            metallic = _float("metallic", 1.0) if material.kind == "metal" else ""
            roughness = _float("roughness", max(material.roughness, 0.05))
            inner = f'<bsdf type="principled">{color}{roughness}{metallic}</bsdf>'
        if material.alpha is not None:
            opacity = _image("opacity", self._copied(material.alpha, f"{name}-alpha"), raw=True)
        elif material.kind == "sheer":
            opacity = _float("opacity", material.opacity)
        else:
            return f'<bsdf type="twosided" id="{name}">{inner}</bsdf>'
        return f'<bsdf type="mask" id="{name}">{opacity}<bsdf type="twosided">{inner}</bsdf></bsdf>'

    def _copied(self, image: str, name: str) -> str:
        file = f"textures/{name}{Path(image).suffix}"
        shutil.copyfile(image, self.folder / file)
        return file

    def _color(self, prop: str, material: Material, name: str) -> str:
        if material.kind == "picture":
            self._save(_picture_image(material, min(self.texture_size, 256)), name)
            return _bitmap(prop, name)
        if not has_pattern(material.kind):
            limit = 1.0 if material.kind == "metal" else WHITEST
            return _rgb(prop, _limited(material.color, limit))
        self._save(texture_image(material, self._side(material)), name)
        return _bitmap(prop, name)

    def _side(self, material: Material) -> int:
        return max(64, self.texture_size // _SHARE.get(material.kind, 1))

    def _save(self, image: UInt8Array, name: str) -> None:
        path = self.folder / "textures" / f"{name}.png"
        # Mitsuba puts v = 0 at the top row of an image, we at the bottom.
        # Grain hardly repeats: looking for matches would cost time and save nothing.
        Image.fromarray(image[::-1]).save(path, compress_type=zlib.Z_HUFFMAN_ONLY)


def texture_image(material: Material, size: int) -> UInt8Array:
    """sRGB texture (size, size, 3), row 0 at v = 0, whose linear mean is the material's colour.

    Where accent areas are structural (grout, mortar) the mean is that of the rest.
    """
    drawn = pattern(material.kind, material.variant % SEEDS, size)
    base = np.array(_limited(material.color, WHITEST), dtype=np.float32)[:, None, None]
    accent = (
        np.array(_limited(material.accent, WHITEST), dtype=np.float32)[:, None, None]
        if material.accent
        else base * _DEFAULT_ACCENT
    )
    linear = drawn.mix * (accent - base)  # (3, size, size)
    linear += base
    linear *= drawn.shade
    if material.kind not in _LAID:
        linear *= base / np.maximum(linear.mean(axis=(1, 2), keepdims=True), 1e-4)
        # Another start for each variant, so that few patterns serve many materials.
        shift = (material.variant // SEEDS) % (size * size)
        linear = np.roll(linear, (shift // size, shift % size), axis=(1, 2))
    return _encoded(linear)


def _picture_image(material: Material, size: int) -> UInt8Array:
    return _encoded(picture(generator(material.variant, "picture"), size))


def _encoded(linear: Float32Array) -> UInt8Array:
    """Planes of linear RGB (3, size, size) as an sRGB image (size, size, 3)."""
    steps = np.clip(linear * 4095 + 0.5, 0, 4095).astype(np.uint16)
    return np.ascontiguousarray(_SRGB[steps].transpose(1, 2, 0))


def _srgb_table() -> UInt8Array:
    """8-bit sRGB of linear values 0, 1/4095 ... 1 (IEC 61966-2-1)."""
    return np.rint(encode_srgb(np.arange(4096) / 4095) * 255).astype(np.uint8)


_SRGB = _srgb_table()


def _limited(color: Color, limit: float) -> Color:
    return (min(color[0], limit), min(color[1], limit), min(color[2], limit))


def _float(name: str, value: float) -> str:
    return f'<float name="{name}" value="{value:.6g}"/>'


def _rgb(name: str, color: Color) -> str:
    return f'<rgb name="{name}" value="{color[0]:.6g} {color[1]:.6g} {color[2]:.6g}"/>'


def _bitmap(name: str, texture: str) -> str:
    return (
        f'<texture type="bitmap" name="{name}">'
        f'<string name="filename" value="textures/{texture}.png"/></texture>'
    )


def _image(name: str, file: str, raw: bool = False) -> str:
    as_it_is = '<boolean name="raw" value="true"/>' if raw else ""
    return (
        f'<texture type="bitmap" name="{name}"><string name="filename" value="{file}"/>'
        f"{as_it_is}</texture>"
    )
