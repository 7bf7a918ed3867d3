"""Surface finishes from colours, shininess and textures of a home, and their Mitsuba BSDFs.

Colours in the file are sRGB; they are linearised and limited to the reflectance of paint.
The application's shininess s is a Phong exponent 128 s; the equivalent roughness is
(2 / (128 s + 2))^(1/4) (Walter et al. 2007, equation 35, with alpha = roughness squared).
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from pbrnet.scenes.arrays import Float64Array, as_triple
from pbrnet.scenes.color import REC709, Color, decode_srgb_value
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.formats.archive import HomeArchive
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.materials.surface import wrapped
from pbrnet.scenes.importing.materials.textures import TextureStore, UnreadableImage
from pbrnet.scenes.importing.xml_elements import plugin, prop
from pbrnet.scenes.sweethome.furnishing.items import SurfaceFinish
from pbrnet.scenes.sweethome.home import Surface, Texture

WHITEST = 0.82  # largest reflectance of paint
DARKEST = 0.03  # smallest reflectance of paint in any band: that of its surface
_GROUND_LUMINANCE = 0.15  # largest luminance of grass, soil and gravel
_LEAST_BAND = 0.35  # smallest ratio of the weakest to the strongest band of a ground colour
WHITE: Color = (WHITEST, WHITEST, WHITEST)
_MATT = 1 / 128  # shininess up to which a surface is modelled as diffuse
_MAX_IMAGE = 64 * 2**20  # bytes


def decode_clipped(value: float) -> float:
    """Decode an sRGB value, clipped to [0, 1], to a linear one."""
    return decode_srgb_value(min(max(value, 0.0), 1.0))


def reflectance_of_display(display: tuple[float, float, float]) -> Color:
    """Return the linear reflectance of an sRGB colour, limited to that of paint.

    A colour that is too bright is scaled, which keeps its hue; too dark bands are raised.
    """
    red, green, blue = (decode_clipped(value) for value in display)
    scale = min(1.0, WHITEST / max(red, green, blue, 1e-9))
    return tuple(max(value * scale, DARKEST) for value in (red, green, blue))  # type: ignore[return-value]


def ground_reflectance(color: Color) -> Color:
    """Return a plausible reflectance of ground that is drawn in `color` (linear).

    It keeps the hue but is limited in luminance and saturation: many homes draw their ground in
    signal colours.
    """
    values = np.maximum(np.array(color, dtype=np.float64), 1e-6)
    # Mix with grey of the same luminance until the weakest band is strong enough.
    grey = float(values @ REC709)
    low, high = values.min(), values.max()
    if low < _LEAST_BAND * high:
        share = (_LEAST_BAND * high - low) / ((grey - low) + _LEAST_BAND * (high - grey))
        values = values + share * (grey - values)
    values *= min(1.0, _GROUND_LUMINANCE / float(values @ REC709))
    return as_triple(values)


def reflectance_of_argb(color: int) -> Color:
    """Return the linear reflectance of a colour 0xAARRGGBB; alpha is ignored."""
    return reflectance_of_display(tuple(((color >> shift) & 255) / 255 for shift in (16, 8, 0)))  # type: ignore[arg-type]


def roughness_of(shininess: float) -> float:
    """Return the roughness that is equivalent to a shininess in [0, 1]."""
    return (2 / (128 * min(max(shininess, 0.0), 1.0) + 2)) ** 0.25


def surface_finish(surface: Surface, default: Color = WHITE) -> SurfaceFinish:
    """Return the finish of a wall's side, a floor or a ceiling."""
    base = SurfaceFinish() if surface.shininess <= _MATT else glossy_finish(surface.shininess)
    if surface.texture is not None:
        return replace(base, image=surface.texture.image, color=WHITE)
    return replace(
        base, color=default if surface.color is None else reflectance_of_argb(surface.color)
    )


def glossy_finish(shininess: float) -> SurfaceFinish:
    """Return the finish of a glossy surface with a shininess in [0, 1]."""
    return SurfaceFinish("gloss", roughness=round(roughness_of(shininess), 4))


def texture_coordinates(points: Float64Array, texture: Texture) -> Float64Array:
    """Return texture coordinates (N, 2), v up, of points (N, 2) on the surface, cm, y up.

    Points are shifted by the offset, rotated counter-clockwise and divided by the image size.
    """
    size = texture.scale * np.array([texture.width, texture.height])
    shifted = points - size * [texture.x_offset, texture.y_offset]
    cosine, sine = math.cos(texture.angle), math.sin(texture.angle)
    turned = shifted @ np.array([[cosine, sine], [-sine, cosine]])
    return turned / size


def mapped_uvs(uvs: Float64Array, texture: Texture) -> Float64Array:
    """Transform texture coordinates (N, 2) of a model by offset, angle and scale."""
    return texture_coordinates(uvs, replace(texture, width=1.0, height=1.0))


class BsdfWriter:
    """Writes each finish once as a `<bsdf>`, and its image into the scene folder."""

    def __init__(
        self, archive: HomeArchive, store: TextureStore, unpacked: Path, changes: Changes
    ) -> None:
        self._archive, self._store, self._unpacked = archive, store, unpacked
        self._changes = changes
        self._ids: dict[SurfaceFinish, str] = {}
        self._images: dict[str, Path | None] = {}
        self.elements: list[Element] = []

    def bsdf(self, finish: SurfaceFinish) -> str:
        """Return the id of the BSDF for `finish`."""
        if finish not in self._ids:
            name = f"{finish.kind}-{len(self._ids)}"
            self._ids[finish] = name
            made = self._describe(finish)
            made.set("id", name)
            self.elements.append(made)
        return self._ids[finish]

    def _describe(self, finish: SurfaceFinish) -> Element:
        if finish.kind == "glass":
            return plugin("bsdf", "thindielectric")
        if finish.kind == "mirror":
            return wrapped(
                "twosided",
                plugin("bsdf", "conductor", material="none", specular_reflectance=finish.color),
            )
        color, alpha = self._color(finish)
        if finish.kind in ("gloss", "metal"):
            inner = plugin("bsdf", "principled", base_color=color, roughness=finish.roughness)
            if finish.kind == "metal":
                inner.append(prop("metallic", 1.0))
        else:
            inner = plugin("bsdf", "diffuse", reflectance=color)
        made = wrapped("twosided", inner)
        if alpha is None and finish.kind == "sheer":
            alpha = prop("opacity", float(finish.opacity))
        if alpha is not None:
            made = wrapped("mask", alpha, made)
        return made

    def _color(self, finish: SurfaceFinish) -> tuple[Color | Element, Element | None]:
        path = self._image(finish.image) if finish.image is not None else None
        if path is None:
            return finish.color, None
        try:
            color, alpha = self._store.color(path), self._store.alpha(path)
        except UnreadableImage as error:
            self._changes.note("images that cannot be read gave way to plain colour: {}",
                               f"{finish.image} ({error})")  # fmt: skip
            return finish.color, None
        mask = None
        if alpha is not None:
            mask = plugin("texture", "bitmap", "opacity", filename=alpha, raw=True)
        return plugin("texture", "bitmap", filename=color), mask

    def _image(self, member: str) -> Path | None:
        """Unpack a member of the home to a file with a generated name; None if that fails."""
        if member not in self._images:
            path = None
            if member not in self._archive:
                self._changes.note("images that are missing gave way to plain colour: {}", member)
            else:
                try:
                    data = self._archive.read(member, _MAX_IMAGE)
                    path = self._unpacked / f"image-{len(self._images)}"
                    path.write_bytes(data)
                except InputError as error:
                    path = None
                    self._changes.note("images that cannot be read gave way to plain colour: {}",
                                       str(error))  # fmt: skip
            self._images[member] = path
        return self._images[member]
