"""Mitsuba 3 BSDFs and PNG textures for the materials of furniture and buildings.

Matt surfaces are `diffuse`, coated ones `principled`, mirrors `conductor`, glass
`thindielectric`, lampshades and thin curtains `principledthin`. All opaque BSDFs are two-sided.
Textures repeat at true size: the uvs of a part are metres, and the written mesh has them divided
by `tile`, the side of the pattern. (A `to_uv` transform would do the same, but the renderer
compiles it into the kernel, so every tile size would need a kernel of its own.)
"""

from __future__ import annotations

import shutil
import zlib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from PIL import Image

from scenes.arrays import Float64Array, UInt8Array
from scenes.color import Color, encode_srgb
from scenes.procedural.patterns import SEEDS, has_pattern, pattern, picture
from scenes.procedural.piece import CatalogueMaterial, Material
from scenes.seeds import generator

MAX_REFLECTANCE = 0.82  # of diffuse surfaces, each channel
_MATT = ("plaster", "wallpaper", "fabric", "carpet", "paper", "soil", "picture", "brick", "grass")
# Divisor of the texture size for patterns without fine detail.
_SIZE_DIVISOR = {
    "plaster": 2,
    "wallpaper": 1,
    "carpet": 2,
    "leaf": 4,
    "soil": 4,
    "leather": 2,
    "fabric": 2,
    "wood": 2,
}
_JOINTED = ("tiles", "brick")  # joints start at uv 0 and have the accent colour
_DEFAULT_ACCENT = 0.75


@dataclass
class MaterialLibrary:
    """BSDFs and textures of one scene; equal materials share one BSDF and one texture."""

    folder: Path  # of the scene; textures go to its `textures/`
    texture_size: int
    prefix: str = ""  # of BSDF and texture names, to keep them apart from existing ones
    _ids: dict[Material | CatalogueMaterial, str] = field(default_factory=dict)
    _tiles: dict[Material, float] = field(default_factory=dict)
    _xml: list[str] = field(default_factory=list)

    def bsdf(self, material: Material | CatalogueMaterial) -> str:
        """Return the id of the BSDF for `material`; made on first use."""
        if material not in self._ids:
            self._ids[material] = f"{self.prefix}{material.kind}-{len(self._ids)}"
            describe = (
                self._describe_catalogue
                if isinstance(material, CatalogueMaterial)
                else self._describe
            )
            self._xml.append(describe(material, self._ids[material]))  # type: ignore[arg-type]
        return self._ids[material]

    def tile(self, material: Material | CatalogueMaterial) -> float:
        """Return the period of the texture of `material` in metres; 1 without a pattern."""
        if isinstance(material, CatalogueMaterial):
            return 1.0  # the uvs of its meshes are in units of the image already
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
        """One `<bsdf>` element per material, in order of first use."""
        return list(self._xml)

    def _describe(self, material: Material, name: str) -> str:
        rgb = _rgb("specular_reflectance", material.color)
        if material.kind == "mirror":
            inner = f'<bsdf type="conductor"><string name="material" value="none"/>{rgb}</bsdf>'
            return f'<bsdf type="twosided" id="{name}">{inner}</bsdf>'
        if material.kind == "glass":
            return f'<bsdf type="thindielectric" id="{name}"/>'
        if material.translucent:
            # diff_trans is in [0, 2]: at 1, half of the light that is not absorbed is transmitted.
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

    def _describe_catalogue(self, material: CatalogueMaterial, name: str) -> str:
        """BSDF of a catalogue material; its images are copied into the scene."""
        if material.kind == "glass":
            return f'<bsdf type="thindielectric" id="{name}"/>'
        if material.kind == "mirror":
            rgb = _rgb("specular_reflectance", material.color)
            inner = f'<bsdf type="conductor"><string name="material" value="none"/>{rgb}</bsdf>'
            return f'<bsdf type="twosided" id="{name}">{inner}</bsdf>'
        matt = material.kind in ("matt", "sheer") or material.roughness >= 1
        prop = "reflectance" if matt else "base_color"
        color = _rgb(prop, _clamped(material.color, MAX_REFLECTANCE))
        if material.texture is not None:
            file = self._copy_image(material.texture, name)
            color = _image(prop, file)
        if matt:
            inner = f'<bsdf type="diffuse">{color}</bsdf>'
        else:
            metallic = _float("metallic", 1.0) if material.kind == "metal" else ""
            roughness = _float("roughness", max(material.roughness, 0.05))
            inner = f'<bsdf type="principled">{color}{roughness}{metallic}</bsdf>'
        if material.alpha is not None:
            opacity = _image("opacity", self._copy_image(material.alpha, f"{name}-alpha"), raw=True)
        elif material.kind == "sheer":
            opacity = _float("opacity", material.opacity)
        else:
            return f'<bsdf type="twosided" id="{name}">{inner}</bsdf>'
        return f'<bsdf type="mask" id="{name}">{opacity}<bsdf type="twosided">{inner}</bsdf></bsdf>'

    def _copy_image(self, image: str, name: str) -> str:
        file = f"textures/{name}{Path(image).suffix}"
        shutil.copyfile(image, self.folder / file)
        return file

    def _color(self, prop: str, material: Material, name: str) -> str:
        if material.kind == "picture":
            self._save(_picture_image(material, min(self.texture_size, 256)), name)
            return _bitmap(prop, name)
        if not has_pattern(material.kind):
            limit = 1.0 if material.kind == "metal" else MAX_REFLECTANCE
            return _rgb(prop, _clamped(material.color, limit))
        self._save(texture_image(material, self._side(material)), name)
        return _bitmap(prop, name)

    def _side(self, material: Material) -> int:
        return max(64, self.texture_size // _SIZE_DIVISOR.get(material.kind, 1))

    def _save(self, image: UInt8Array, name: str) -> None:
        path = self.folder / "textures" / f"{name}.png"
        # Rows are written from last to first. Mitsuba shows the file's top row at v = 0, so
        # patterns appear mirrored in v.
        # Noise hardly repeats: Huffman coding alone is faster and as small.
        Image.fromarray(image[::-1]).save(path, compress_type=zlib.Z_HUFFMAN_ONLY)


def texture_image(material: Material, size: int) -> UInt8Array:
    """Return an sRGB texture, uint8 (size, size, 3), columns along u and rows along v.

    Its linear mean is the material's colour; for tiles and bricks this excludes the joints.
    """
    drawn = pattern(material.kind, material.variant % SEEDS, size)
    base = np.array(_clamped(material.color, MAX_REFLECTANCE), dtype=np.float64)[:, None, None]
    accent = (
        np.array(_clamped(material.accent, MAX_REFLECTANCE), dtype=np.float64)[:, None, None]
        if material.accent
        else base * _DEFAULT_ACCENT
    )
    linear = drawn.mix * (accent - base)  # (3, size, size)
    linear += base
    linear *= drawn.shade
    if material.kind not in _JOINTED:
        linear *= base / np.maximum(linear.mean(axis=(1, 2), keepdims=True), 1e-4)
        # Shift by variant, so that few cached patterns serve many materials.
        shift = (material.variant // SEEDS) % (size * size)
        linear = np.roll(linear, (shift // size, shift % size), axis=(1, 2))
    return _encode(linear)


def _picture_image(material: Material, size: int) -> UInt8Array:
    return _encode(picture(generator(material.variant, "picture"), size))


def _encode(linear: Float64Array) -> UInt8Array:
    """Encode planes of linear RGB (3, size, size) as an sRGB image, uint8 (size, size, 3)."""
    steps = np.clip(linear * 4095 + 0.5, 0, 4095).astype(np.uint16)
    return np.ascontiguousarray(_SRGB[steps].transpose(1, 2, 0))


def _srgb_table() -> UInt8Array:
    """8-bit sRGB (IEC 61966-2-1) of the linear values 0, 1/4095, ..., 1."""
    return np.rint(encode_srgb(np.arange(4096) / 4095) * 255).astype(np.uint8)


_SRGB = _srgb_table()


def _clamped(color: Color, limit: float) -> Color:
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
    raw_flag = '<boolean name="raw" value="true"/>' if raw else ""
    return (
        f'<texture type="bitmap" name="{name}"><string name="filename" value="{file}"/>'
        f"{raw_flag}</texture>"
    )
