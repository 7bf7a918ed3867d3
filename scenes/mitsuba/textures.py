"""Textures of any Mitsuba version as Mitsuba 3 plugins, and colours that textures may replace."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from pbrnet.scenes.arrays import Float64Array, as_triple
from pbrnet.scenes.color import Color
from pbrnet.scenes.importing.materials.textures import TextureStore, UnreadableImage
from pbrnet.scenes.importing.xml_elements import plugin
from pbrnet.scenes.mitsuba.reader import Node, unresolved
from pbrnet.scenes.mitsuba.values import Properties, Scope

GREY: Color = (0.5, 0.5, 0.5)


class Textures:
    """Translates texture elements; `store` holds the images that the scene uses."""

    def __init__(self, scope: Scope, store: TextureStore) -> None:
        self.scope, self.store = scope, store
        self.note = scope.changes.note

    def color(
        self, properties: Properties, name: str, default: Color | None = None
    ) -> Color | Element | None:
        """Translate a reflectance to RGB, clipped to [0, 1], or to a texture element."""
        found = properties.color(name)
        if found is None:
            return default
        if isinstance(found, Node):
            return self.texture(found)
        if max(found) > 1:
            self.note("a reflectance above 1 was clipped to 1")
            found = (min(found[0], 1.0), min(found[1], 1.0), min(found[2], 1.0))
        return found

    def scalar(self, properties: Properties, name: str, default: float) -> float:
        """Read a number; a texture is replaced by its mean."""
        found = properties.color(name)
        if isinstance(found, Node):
            self.note(f"a texture of {name!r} was replaced by its mean value")
            made = self.texture(found, "data")
            found = made if isinstance(made, tuple) else GREY
        return default if found is None else float(np.mean(found))

    def weight(self, node: Node, use: str) -> float | Element:
        """Translate a texture of numbers; the mean of a constant one."""
        made = self.texture(node, use)
        return float(np.mean(made)) if isinstance(made, tuple) else made

    def texture(self, node: Node, use: str = "color") -> Color | Element:
        """Translate a texture element to Mitsuba 3's, or to RGB if it is constant.

        `use` is "color", "opacity" (linear, from the alpha channel if there is one) or "data"
        (linear).
        """
        known = _TEXTURES.get(node.type)
        if known is None:
            self.note("unknown texture, replaced by grey: {}", f"{node.type!r} ({node.place})")
            return GREY
        with self.scope.nested(node, "textures"):
            properties = Properties(node, self.scope)
            properties.ignore("id", "cache", "max_anisotropy", "format", "accel")
            made = known(self, properties, use)
            properties.report_unused()
        return made

    def image_path(self, properties: Properties) -> Path | None:
        """Find the image of a texture; None, with a note, if it is missing."""
        name = properties.text("filename", "")
        node = properties.node
        if not name or unresolved(name):
            self.note("a texture without an image was replaced by grey: {}", node.place)
            return None
        path = self.scope.sandbox.find(name, node.place, is_image=True)
        if path is None:
            self.note("missing texture, replaced by grey: {}", f"{name!r} ({node.place})")
        return path


def _bitmap(textures: Textures, properties: Properties, use: str) -> Color | Element:
    """`bitmap` of all versions, and its predecessors `ldrtexture` and `exrtexture`."""
    properties.ignore("filename")
    path = textures.image_path(properties)
    to_uv = _to_uv(properties)
    filtering, wrap = _filter_type(textures, properties), _wrap_mode(textures, properties)
    is_named = properties.text("gamma", "").lower() == "srgb"
    gamma = -1.0 if is_named else properties.number("gamma", -1.0)
    raw = properties.boolean("raw", False) or gamma == 1.0 or use == "data"
    if gamma > 0 and gamma != 1 and abs(gamma - 2.2) > 0.25:
        textures.note("a texture gamma was replaced by sRGB: {}", f"{gamma:g}")
    channel = properties.text("channel", "").lower()
    if path is None:
        return GREY
    try:
        stored, is_linear = _stored(textures, path, channel, use)
    except UnreadableImage as error:
        textures.note("damaged texture, replaced by grey: {}", f"{path.name} ({error})")
        return GREY
    return plugin(
        "texture",
        "bitmap",
        filename=stored,
        filter_type=filtering if filtering != "bilinear" else None,
        wrap_mode=wrap if wrap != "repeat" else None,
        raw=True if raw or is_linear else None,
        to_uv=to_uv,
    )


def _filter_type(textures: Textures, properties: Properties) -> str:
    filtering = properties.text("filter_type", "bilinear").lower()
    if filtering not in ("nearest", "bilinear"):
        textures.note("a texture filter was replaced by bilinear: {}", repr(filtering))
        return "bilinear"
    return filtering


def _wrap_mode(textures: Textures, properties: Properties) -> str:
    wrap = properties.text("wrap_mode", properties.text("wrap_mode_u", "repeat")).lower()
    if properties.text("wrap_mode_v", wrap).lower() != wrap:
        textures.note("a texture has two wrap modes; the mode in u was used for both directions")
    if wrap not in ("repeat", "mirror", "clamp"):
        textures.note("a texture wrap mode was replaced by clamp: {}", repr(wrap))
        return "clamp"
    return wrap


def _stored(textures: Textures, path: Path, channel: str, use: str) -> tuple[str, bool]:
    """Copy of an image in the scene's folder, and whether its values are linear."""
    if channel in ("r", "g", "b", "a", "x", "y", "z"):
        index = {"x": 0, "y": 1, "z": 2}.get(channel, "rgba".find(channel))
        return textures.store.channel(path, index), channel == "a"
    alpha = textures.store.alpha(path) if use == "opacity" else None
    if alpha is None:
        return textures.store.color(path), False
    textures.note("opacity was read from the image's alpha channel: {}", path.name)
    return alpha, True


def _checkerboard(textures: Textures, properties: Properties, use: str) -> Color | Element:
    """`checkerboard`, which all versions repeat once per unit."""
    return plugin(
        "texture",
        "checkerboard",
        color0=textures.color(properties, "color0", (0.4, 0.4, 0.4)),
        color1=textures.color(properties, "color1", (0.2, 0.2, 0.2)),
        to_uv=_to_uv(properties),
    )


def _grid(textures: Textures, properties: Properties, use: str) -> Color | Element:
    """`gridtexture`, which Mitsuba 3 lacks: the mean of its two colours by area."""
    lines = textures.color(properties, "color0", (0.2, 0.2, 0.2))
    field = textures.color(properties, "color1", (0.4, 0.4, 0.4))
    width = properties.number("line_width", 0.01)
    _to_uv(properties)
    textures.note("a grid texture was replaced by its mean colour")
    if not isinstance(lines, tuple) or not isinstance(field, tuple):
        return GREY
    share = 1 - max(0.0, 1 - 2 * width) ** 2
    return as_triple(share * np.array(lines) + (1 - share) * np.array(field))


def _scale(textures: Textures, properties: Properties, use: str) -> Color | Element:
    """`scale`: a texture times a colour, as one texture or colour."""
    factor = properties.color("scale")
    if factor is None:
        factor = properties.color("value")
    inner = [node for node in properties.nested("texture") if node is not factor]
    if isinstance(factor, Node) or not inner:
        textures.note("a scaled texture was replaced by grey")
        return GREY
    times = np.array(factor if factor is not None else (1.0, 1.0, 1.0))
    made = textures.texture(inner[0], use)
    if isinstance(made, tuple):
        return as_triple(np.array(made) * times)
    if made.get("type") == "bitmap" and use == "color" and inner[0].type in _BITMAPS:
        path = textures.image_path(Properties(inner[0], textures.scope))
        name = made.find("string[@name='filename']")
        if path is not None and name is not None:
            name.set("value", textures.store.scaled(path, times))
            return made
    textures.note("the factor of a scaled texture was left out")
    return made


def _vertex_colors(textures: Textures, properties: Properties, use: str) -> Color | Element:
    """Colours stored with mesh vertices, which are not imported: grey."""
    properties.ignore("name", "scale")
    textures.note("colours stored with mesh vertices were replaced by grey")
    return GREY


def _uniform(textures: Textures, properties: Properties, use: str) -> Color | Element:
    """`uniform`, `srgb` and `rgb` as texture plugins: their colour."""
    for name in ("value", "color"):
        found = properties.color(name)
        if isinstance(found, tuple):
            return found
    return GREY


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


_BITMAPS = ("bitmap", "ldrtexture", "exrtexture")
_TEXTURES: dict[str, Callable[[Textures, Properties, str], Color | Element]] = {
    **dict.fromkeys(_BITMAPS, _bitmap),
    "checkerboard": _checkerboard,
    "gridtexture": _grid,
    "scale": _scale,
    **dict.fromkeys(("vertexcolors", "mesh_attribute"), _vertex_colors),
    **dict.fromkeys(("uniform", "srgb", "rgb"), _uniform),
}
