"""Mitsuba 3 BSDFs and PNG textures for the materials of furniture and buildings.

Opaque surfaces are `principled` below a `normalmap`, with textures of colour, roughness and normal;
mirrors are `conductor`, glass is `thindielectric`, lampshades and thin curtains `principledthin`.
All opaque BSDFs are two-sided, and all have one form: every further form of BSDF is compiled into
each kernel and costs time at every vertex of a path. Roughness and normals are shared by the
materials that show the same surface.

Textures repeat at true size: the uvs of a part are metres, and `placed` divides them by the side of
the pattern. (A `to_uv` transform would do the same, but the renderer compiles it into the kernel,
so every tile size would need a kernel of its own.)
"""

from __future__ import annotations

import math
import shutil
import zlib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeGuard

import numpy as np
import OpenEXR
from PIL import Image

from pbrnet.scenes.arrays import AnyArray, Float64Array, Int64Array, UInt8Array
from pbrnet.scenes.color import REC709, Color
from pbrnet.scenes.procedural.piece import CatalogueMaterial, Material, Use
from pbrnet.scenes.procedural.textures.families import (
    FAMILIES,
    SEEDS,
    WEARS,
    PackedSurface,
    family_of,
    has_surface,
    packed_surface,
)
from pbrnet.scenes.procedural.textures.fields import encoded
from pbrnet.scenes.procedural.textures.pictures import picture, screen_picture
from pbrnet.scenes.procedural.textures.traces import Layout, laid_out, spread, traced
from pbrnet.scenes.seeds import derive, generator

MAX_REFLECTANCE = 0.82  # of diffuse surfaces, each channel
_MAX_TEXTILE = 0.79  # likewise; their sheen adds to it
_SMALLEST = 64  # pixels a side
_PICTURE = 256  # pixels a side of pictures, at most
_DRAWS = {"plaster": 1, "paint": 1, "plastic": 1}  # of a family in one home, where not 2
_ROUGHNESS_STEP = 0.05  # materials of one surface whose roughness rounds alike share its texture
_SMOOTHEST = 0.05
_TRACED = 0.33  # texels a metre of a surface with traces of use, relative to `texture_size`
_MOST_TRACED = 1.1  # its texels, relative to the square of `texture_size`
_JOINTED = ("tiles", "brick")  # the accent is the joints' colour, and not part of the mean
_DEFAULT_ACCENT = 0.75
_SCALES = (0.88, 1.14)  # least and most of a pattern without modules, relative to its true size


@dataclass
class MaterialLibrary:
    """BSDFs and textures of one scene; equal materials share one BSDF and one texture.

    `seed` decides offsets, scales and contrasts of the textures, `wear` the state of materials that
    state none, from new (0) to old (1).
    """

    folder: Path  # of the scene; textures go to its `textures/`
    texture_size: int
    prefix: str = ""  # of BSDF and texture names, to keep them apart from existing ones
    seed: int = 0
    wear: float = 0.0
    _ids: dict[Material | CatalogueMaterial, str] = field(default_factory=dict)
    _layouts: dict[Material, Layout] = field(default_factory=dict)
    _tiles: dict[Material, UInt8Array] = field(default_factory=dict)
    _shared: dict[tuple[object, ...], str] = field(default_factory=dict)
    _names: dict[Material, tuple[str, str, int, int, int]] = field(default_factory=dict)
    _places: dict[Material, tuple[float, Float64Array]] = field(default_factory=dict)
    _xml: list[str] = field(default_factory=list)
    _displays: list[str] = field(default_factory=list)

    def bsdf(self, material: Material | CatalogueMaterial) -> str:
        """Return the id of the BSDF for `material`; made on first use."""
        if material not in self._ids:
            number = len(self._ids)
            if isinstance(material, CatalogueMaterial):
                name = f"{self.prefix}{material.kind}-{number}"
                self._xml.append(self._describe_catalogue(material, name))
            else:
                family = f"{family_of(material)}-" if has_surface(material.kind) else ""
                name = f"{self.prefix}{material.kind}-{family}{number}"
                self._xml.append(self._describe(material, name))
            self._ids[material] = name
        return self._ids[material]

    def tile(self, material: Material | CatalogueMaterial) -> float:
        """Return the period of the texture of `material` in metres; 1 without a pattern."""
        if not _repeats(material):
            return 1.0
        drawn = self._surface(material)
        scale = material.scale
        if drawn.modules is None:
            rng = generator(self.seed, "scale", *_key(material))
            scale *= _SCALES[0] + (_SCALES[1] - _SCALES[0]) * rng.random()
        return drawn.metres * scale

    def placed(
        self,
        material: Material | CatalogueMaterial,
        vertices: Float64Array,
        faces: Int64Array,
        normals: Float64Array | None,
        uvs: Float64Array,
    ) -> Float64Array:
        """Return the uvs (V, 2) of a mesh in periods of the texture, from those in metres.

        They are shifted by the material's own offset, by whole modules where there are joints, and
        mirrored where (u, v, normal) is left-handed, so that bumps are not hollows.
        """
        if not _repeats(material):
            return uvs
        if material.use is not None:
            return (uvs - material.use.low) / self._layout(material).size
        if material not in self._places:
            self._places[material] = self.tile(material), self._offset(material)
        tile, offset = self._places[material]
        right = np.where(_is_left_handed(vertices, faces, normals, uvs)[:, None], [-1, 1], [1, 1])
        return uvs * right / tile + offset

    def _offset(self, material: Material) -> Float64Array:
        """Offset (2,) of a material's pattern, in tiles: whole modules where there are joints."""
        modules = self._surface(material).modules
        offset = generator(self.seed, "offset", *_key(material)).random(2)
        return offset if modules is None else np.floor(offset * modules) / modules

    def _layout(self, material: Material) -> Layout:
        """The layout of a surface with traces of use."""
        if material not in self._layouts:
            assert material.use is not None
            side = len(self._surface(material).shade)
            tile = self.tile(material)
            finest = min(side, math.floor(_TRACED * self.texture_size * tile))
            most = int(_MOST_TRACED * self.texture_size**2)
            offset = self._offset(material)
            self._layouts[material] = laid_out(material.use, tile, offset, finest, most)
        return self._layouts[material]

    def display(self, seed: int, radiance: Color) -> str:
        """Write the radiance of a screen that shows picture `seed`; returns the image's file.

        `radiance` is its mean, linear RGB.
        """
        shown = screen_picture(generator(seed, "screen"), is_film=seed % 2 == 0)
        mean = shown.mean(axis=(0, 1), dtype=np.float64)
        level = float(np.dot(radiance, REC709) / np.dot(mean, REC709))
        name = f"textures/{self.prefix}display-{len(self._displays)}.exr"
        self._displays.append(name)
        pixels = (shown[::-1] * level).astype(np.float16)  # Mitsuba shows the first row at v = 0
        header = {"compression": OpenEXR.NO_COMPRESSION, "type": OpenEXR.scanlineimage}
        with OpenEXR.File(header, {"RGB": np.ascontiguousarray(pixels)}) as file:
            file.write(str(self.folder / name))
        return name

    @property
    def xml(self) -> list[str]:
        """One element per shared texture and per material, in order of first use."""
        return list(self._xml)

    def _describe(self, material: Material, name: str) -> str:
        if material.kind in ("mirror", "glass"):
            return _smooth(material, name)
        if material.use is not None:
            color, rough, normal = self._traced(material, material.use, name)
            return self._principled(material, name, color, rough, normal)
        color = self._color(material, name)
        if material.translucent:
            # diff_trans is in [0, 2]: at 1, half of the light that is not absorbed is transmitted.
            return (
                f'<bsdf type="principledthin" id="{name}">{color}'
                f"{_float('roughness', 0.9)}{_float('diff_trans', 1.0)}{_float('eta', 1.2)}</bsdf>"
            )
        drawn = self._surface(material)
        steps = round(material.roughness / _ROUGHNESS_STEP)
        coarse = _roughness(self._coarse(material), steps)
        rough = self._share(("rough", *self._named(material), steps), coarse)
        normal = self._share(("normal", *self._named(material)), drawn.normal)
        return self._principled(
            material, name, color, _reference("roughness", rough), _reference("normalmap", normal)
        )

    def _principled(
        self, material: Material, name: str, color: str, rough: str, normal: str
    ) -> str:
        """BSDF of an opaque surface from its three textures."""
        lobe = _float("metallic", 1.0) if material.kind == "metal" else ""
        if sheen := FAMILIES[material.kind][family_of(material)].sheen:
            lobe = _float("sheen", sheen)
        inner = f'<bsdf type="principled">{color}{rough}{lobe}</bsdf>'
        mapped = f'<bsdf type="normalmap">{normal}{inner}</bsdf>'
        return f'<bsdf type="twosided" id="{name}">{mapped}</bsdf>'

    def _traced(self, material: Material, use: Use, name: str) -> tuple[str, str, str]:
        """Textures of colour, roughness and normal of a surface with traces of use."""
        layout, drawn = self._layout(material), self._surface(material)
        plain = replace(material, use=None)
        if plain not in self._tiles:
            self._tiles[plain] = colored(plain, drawn, self._contrast(plain))
        steps = round(material.roughness / _ROUGHNESS_STEP)
        family = FAMILIES[material.kind][family_of(material)]
        color, rough = traced(
            spread(self._tiles[plain], layout),
            spread(_roughness(drawn, steps), layout),
            use,
            layout,
            (self.wear if material.wear is None else material.wear) * (1 + family.wears) / 2,
            family.hard,
        )
        self._save(color, name)
        self._save(rough, f"{name}-rough")
        self._save(spread(drawn.normal, layout), f"{name}-normal")
        return (
            _image("base_color", f"textures/{name}.png"),
            _image("roughness", f"textures/{name}-rough.png", raw=True, nearest=True),
            _image("normalmap", f"textures/{name}-normal.png", raw=True),
        )

    def _describe_catalogue(self, material: CatalogueMaterial, name: str) -> str:
        """BSDF of a catalogue material; its images are copied into the scene."""
        if material.kind in ("mirror", "glass"):
            return _smooth(material, name)
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

    def _color(self, material: Material, name: str) -> str:
        if material.kind == "picture":
            image = _picture_image(material, min(self.texture_size, _PICTURE))
        else:
            image = colored(material, self._coarse(material), self._contrast(material))
        self._save(image, name)
        return _image("base_color", f"textures/{name}.png")

    def _contrast(self, material: Material) -> float:
        return 0.75 + 0.5 * float(generator(self.seed, "contrast", *_key(material)).random())

    def _named(self, material: Material) -> tuple[str, str, int, int, int]:
        """Arguments of `packed_surface` for a material."""
        if material not in self._names:
            self._names[material] = self._choose(material)
        return self._names[material]

    def _choose(self, material: Material) -> tuple[str, str, int, int, int]:
        family = family_of(material)
        side = max(_SMALLEST, self.texture_size // FAMILIES[material.kind][family].detail)
        wear = self.wear if material.wear is None else material.wear
        # A home has few draws of a family: offset, scale and contrast tell its materials apart.
        which = derive(self.seed, "surface", *_key(material)) % _DRAWS.get(material.kind, 2)
        draw = derive(self.seed, "draw", material.kind, family, str(which)) % SEEDS
        return material.kind, family, draw, side, min(WEARS - 1, int(wear * WEARS))

    def _surface(self, material: Material) -> PackedSurface:
        return packed_surface(*self._named(material))

    def _coarse(self, material: Material) -> PackedSurface:
        """The surface with as much detail as its colour needs: of plaster, a half."""
        drawn = self._surface(material)
        if material.kind != "plaster" or len(drawn.shade) < 2 * _SMALLEST:
            return drawn
        mix, shade, rough = (each[::2, ::2] for each in (drawn.mix, drawn.shade, drawn.rough))
        return replace(drawn, mix=mix, shade=shade, rough=rough)

    def _share(self, key: tuple[object, ...], image: UInt8Array) -> str:
        """Return the id of a texture of raw numbers, which is written on first use."""
        if key not in self._shared:
            name = f"{self.prefix}{key[0]}-{key[2]}-{len(self._shared)}"
            self._shared[key] = name
            self._save(image, name)
            near = image.ndim == 2
            self._xml.append(_image("", f"textures/{name}.png", raw=True, id=name, nearest=near))
        return self._shared[key]

    def _save(self, image: UInt8Array, name: str) -> None:
        """Write an image; Mitsuba shows its first row at v = 0."""
        # Grain hardly repeats: Huffman coding alone is as small and takes half of the time.
        Image.fromarray(image).save(
            self.folder / "textures" / f"{name}.png",
            compress_level=1,
            compress_type=zlib.Z_HUFFMAN_ONLY,
        )


def _smooth(material: Material | CatalogueMaterial, name: str) -> str:
    """BSDF of a mirror or of clear glass."""
    if material.kind == "glass":
        return f'<bsdf type="thindielectric" id="{name}"/>'
    rgb = _rgb("specular_reflectance", material.color)
    inner = f'<bsdf type="conductor"><string name="material" value="none"/>{rgb}</bsdf>'
    return f'<bsdf type="twosided" id="{name}">{inner}</bsdf>'


def colored(material: Material, drawn: PackedSurface, contrast: float = 1.0) -> UInt8Array:
    """Return an sRGB texture, uint8 (size, size, 3), columns along u and rows along v.

    Its linear mean is the material's colour; for tiles and bricks this excludes the joints.
    `contrast` scales how far it departs from the mean.
    """
    limit = {"metal": 1.0, "fabric": _MAX_TEXTILE, "carpet": _MAX_TEXTILE}.get(
        material.kind, MAX_REFLECTANCE
    )
    base = np.array(_clamped(material.color, limit), dtype=np.float32)[:, None, None]
    accent = base * np.float32(_DEFAULT_ACCENT)
    if material.accent:
        accent = np.array(_clamped(material.accent, limit), dtype=np.float32)[:, None, None]
    mix = drawn.mix * np.float32(1 / 255)
    shade = drawn.shade * np.float32(1 / 128)
    jointed = material.kind in _JOINTED
    if not jointed:
        mix = mix * np.float32(contrast)
        shade = 1 + (shade - 1) * np.float32(contrast)
    linear = mix * (accent - base)  # (3, size, size)
    linear += base
    linear *= shade
    if not jointed:
        # Rounded: sums may differ in their last digits between processors.
        mean = np.rint(linear.mean(axis=(1, 2), keepdims=True, dtype=np.float64) * 65536) / 65536
        linear *= (base / np.maximum(mean, 1e-4)).astype(np.float32)
    return np.ascontiguousarray(encoded(linear).transpose(1, 2, 0))


def _roughness(drawn: PackedSurface, steps: int) -> UInt8Array:
    """Return perceptual roughness as an image (size, size), 255 for 1."""
    rough = drawn.rough * np.float32(1 / 200) + np.float32(steps * _ROUGHNESS_STEP - 0.5)
    return (np.clip(rough, _SMOOTHEST, 1) * np.float32(255) + np.float32(0.5)).astype(np.uint8)


def _is_left_handed(
    vertices: Float64Array, faces: Int64Array, normals: Float64Array | None, uvs: Float64Array
) -> AnyArray:
    """Return for each vertex (V,) whether most of its faces have left-handed (u, v, normal)."""
    a, b, c = (uvs[faces[:, k]] for k in range(3))
    turn = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    if normals is not None:  # faces of catalogues and thin sheets may be wound the other way
        p, q, r = (vertices[faces[:, k]] for k in range(3))
        facing = (np.cross(q - p, r - p) * normals[faces[:, 0]]).sum(axis=1)
        turn = np.where(facing < 0, -turn, turn)
    votes = np.zeros(len(vertices))
    for k in range(3):
        np.add.at(votes, faces[:, k], np.sign(turn))
    return votes < 0


def _repeats(material: Material | CatalogueMaterial) -> TypeGuard[Material]:
    """True for a material with a pattern; uvs of others are in units of the image already."""
    if isinstance(material, CatalogueMaterial) or material.kind == "picture":
        return False
    return has_surface(material.kind)


def _key(material: Material) -> tuple[str, ...]:
    """Names of a seed that tell a material from others of its kind."""
    return (material.kind, str(material.variant), *(f"{band:.4f}" for band in material.color))


def _picture_image(material: Material, size: int) -> UInt8Array:
    """Return a picture as an image whose first row is its top."""
    planes = encoded(picture(generator(material.variant, "picture"), size))
    return np.ascontiguousarray(planes.transpose(1, 2, 0)[::-1])


def _clamped(color: Color, limit: float) -> Color:
    return (min(color[0], limit), min(color[1], limit), min(color[2], limit))


def _reference(name: str, to: str) -> str:
    return f'<ref name="{name}" id="{to}"/>'


def _float(name: str, value: float) -> str:
    return f'<float name="{name}" value="{value:.6g}"/>'


def _rgb(name: str, color: Color) -> str:
    return f'<rgb name="{name}" value="{color[0]:.6g} {color[1]:.6g} {color[2]:.6g}"/>'


def _image(name: str, file: str, raw: bool = False, id: str = "", nearest: bool = False) -> str:
    raw_flag = '<boolean name="raw" value="true"/>' if raw else ""
    # Roughness needs no interpolation, which costs three more texels at every vertex of a path.
    if nearest:
        raw_flag += '<string name="filter_type" value="nearest"/>'
    label = f'id="{id}"' if id else f'name="{name}"'
    return (
        f'<texture type="bitmap" {label}><string name="filename" value="{file}"/>'
        f"{raw_flag}</texture>"
    )
