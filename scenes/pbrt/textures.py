"""Textures of a pbrt scene as Mitsuba 3 textures or plain colours."""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.color import REC709, Color
from pbrnet.scenes.importing.materials.surface import clipped
from pbrnet.scenes.importing.materials.textures import TextureStore, UnreadableImage
from pbrnet.scenes.importing.xml_elements import plugin
from pbrnet.scenes.pbrt.values import Context, Entity, without_excess

_MAX_NESTING = 8
_GREY: Color = (0.5, 0.5, 0.5)
_WRAPS = {"repeat": None, "octahedralsphere": None, "black": "clamp", "clamp": "clamp"}


class Textures:
    """Translates textures of colours and of numbers."""

    def __init__(self, context: Context, store: TextureStore) -> None:
        self.context, self.store = context, store
        self._depth = 0

    def color(
        self, entity: Entity, name: str, default: Color, factor: float = 1.0
    ) -> Color | Element:
        """Translate a colour parameter of a material, a reflectance or its texture, times `factor`.

        Without the parameter it is `default`.
        """
        if entity.is_texture(name):
            texture = entity.texture(name)
            return default if texture is None else self._texture(texture, np.full(3, factor))
        return without_excess(entity.color(name, default) or default, self.context.changes)

    def number(self, entity: Entity, name: str, default: float) -> float | Element:
        """Translate the parameter `name`, a number, or its texture as linear data."""
        if not entity.is_texture(name):
            return entity.number(name, default)
        texture = entity.texture(name)
        if texture is None:
            return default
        made = self._texture(texture, np.ones(3), raw=True)
        return made if isinstance(made, Element) else float(np.array(made) @ REC709)

    def image(self, entity: Entity, name: str = "filename") -> Path | None:
        """Find the image that a parameter names; None, with a note, if it is missing."""
        given = entity.text(name)
        path = self.context.sandbox.find(given, entity.place, True) if given else None
        if path is None:
            self.context.changes.note(
                "missing texture, replaced by grey: {}", f"{given!r:.120} ({entity.place})"
            )
        return path

    def bitmap(
        self, path: Path, factor: Float64Array, raw: bool, to_uv: Float64Array | None, wrap: str
    ) -> Element | None:
        """A `bitmap` of an image times `factor` (3,); None, with a note, if it is damaged."""
        try:
            if raw and not (factor == 1).all():
                stored = self.store.channel_scaled(path, 0, float(factor[0]))
            elif (factor == 1).all():
                stored = self.store.color(path)
            else:
                stored = self.store.scaled(path, factor)
        except UnreadableImage as error:
            self.context.changes.note(
                "damaged texture, replaced by grey: {}", f"{path.name} ({error})"
            )
            return None
        return plugin(
            "texture",
            "bitmap",
            filename=stored,
            wrap_mode=_WRAPS.get(wrap),
            raw=True if raw else None,
            to_uv=to_uv,
        )

    def _texture(self, texture: Entity, factor: Float64Array, raw: bool = False) -> Color | Element:
        """A texture times `factor` (3,); of numbers if `raw`."""
        known = {
            "constant": self._constant,
            "imagemap": self._imagemap,
            "scale": self._scale,
            "mix": self._mix,
            "checkerboard": self._checkerboard,
        }.get(texture.type)
        if known is None:
            self.context.changes.note(
                "a texture of unsupported type was replaced by grey: {}",
                f"{texture.type!r:.40} ({texture.place})",
            )
            return _times(_GREY, factor)
        if self._depth >= _MAX_NESTING:
            raise texture.error("textures are nested too deep or inside themselves")
        self._depth += 1
        try:
            made = known(texture, factor, raw)
        finally:
            self._depth -= 1
        texture.report_unused()
        return made

    def _inner(
        self, texture: Entity, name: str, default: Color, factor: Float64Array, raw: bool
    ) -> Color | Element:
        """The colour or texture that a parameter of a texture gives, times `factor`."""
        if texture.is_texture(name):
            found = texture.texture(name)
            return _times(default, factor) if found is None else self._texture(found, factor, raw)
        return _times(texture.color(name, default) or default, factor)

    def _constant(self, texture: Entity, factor: Float64Array, raw: bool) -> Color | Element:
        return _times(texture.color("value", (1.0, 1.0, 1.0)) or _GREY, factor)

    def _imagemap(self, texture: Entity, factor: Float64Array, raw: bool) -> Color | Element:
        path = self.image(texture)
        to_uv = _to_uv(texture)
        texture.ignore("filter", "trilinear", "maxanisotropy", "filename")
        if texture.boolean("invert", False):
            self.context.changes.note("the inversion of a texture was left out")
        encoding = texture.text("encoding", "sRGB").lower()
        is_linear = encoding == "linear" or not texture.boolean("gamma", True)
        scale = texture.number("scale", 1.0)
        if path is None:
            return _times(_GREY, factor)
        made = self.bitmap(
            path, factor * scale, raw or is_linear, to_uv, texture.text("wrap", "repeat")
        )
        return _times(_GREY, factor) if made is None else made

    def _scale(self, texture: Entity, factor: Float64Array, raw: bool) -> Color | Element:
        """`scale`: `tex` times `scale` (version 4), or `tex1` times `tex2` (version 3)."""
        first, second = (
            ("tex1", "tex2") if "tex1" in texture or "tex2" in texture else ("tex", "scale")
        )
        if texture.is_texture(second) and not texture.is_texture(first):
            first, second = second, first
        one: Color = (1.0, 1.0, 1.0)
        times = self._inner(texture, second, one, factor, raw)
        if isinstance(times, Element):
            self.context.changes.note("the product of two textures was replaced by the first")
            times = _times(one, factor)
        return self._inner(texture, first, one, np.array(times), raw)

    def _mix(self, texture: Entity, factor: Float64Array, raw: bool) -> Color | Element:
        first = self._inner(texture, "tex1", (0.0, 0.0, 0.0), factor, raw)
        second = self._inner(texture, "tex2", (1.0, 1.0, 1.0), factor, raw)
        amount = min(max(texture.number("amount", 0.5), 0.0), 1.0)
        if not isinstance(first, Element) and not isinstance(second, Element):
            return clipped((1 - amount) * np.array(first) + amount * np.array(second))
        self.context.changes.note("a mixture of textures was replaced by its larger part")
        return first if amount <= 0.5 else second

    def _checkerboard(self, texture: Entity, factor: Float64Array, raw: bool) -> Color | Element:
        """`checkerboard` in two dimensions; Mitsuba's fields are half as wide."""
        first = self._inner(texture, "tex1", (1.0, 1.0, 1.0), factor, raw)
        second = self._inner(texture, "tex2", (0.0, 0.0, 0.0), factor, raw)
        to_uv = _to_uv(texture)
        texture.ignore("aamode")
        if texture.whole("dimension", 2) != 2:
            self.context.changes.note("a checkerboard in space was replaced by its mean colour")
            if isinstance(first, tuple) and isinstance(second, tuple):
                return clipped((np.array(first) + second) / 2)
            return _times(_GREY, factor)
        halved = np.diag([0.5, 0.5, 1.0, 1.0]) @ (np.eye(4) if to_uv is None else to_uv)
        return plugin("texture", "checkerboard", color0=first, color1=second, to_uv=halved)


def _to_uv(texture: Entity) -> Float64Array | None:
    """Mitsuba's `to_uv` (4, 4) of the `uv` mapping, for meshes whose v is turned over."""
    scale_u, scale_v = texture.number("uscale", 1.0), texture.number("vscale", 1.0)
    move_u, move_v = texture.number("udelta", 0.0), texture.number("vdelta", 0.0)
    if texture.text("mapping", "uv") != "uv":
        texture.context.changes.note("a projected texture takes the mesh's own coordinates")
        texture.ignore("v1", "v2")
        return None
    if (scale_u, scale_v, move_u, move_v) == (1.0, 1.0, 0.0, 0.0):
        return None
    made = np.diag([scale_u, scale_v, 1.0, 1.0])
    made[:2, 3] = move_u, 1 - scale_v - move_v
    return made


def _times(color: Color, factor: Float64Array) -> Color:
    return clipped(np.array(color) * factor)
