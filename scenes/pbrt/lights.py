"""Lights of a pbrt scene as Mitsuba 3 emitters in metres, Z up."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from pbrnet.scenes.arrays import Float32Array, Float64Array, as_triple
from pbrnet.scenes.color import Color
from pbrnet.scenes.importing.materials.textures import TextureStore, UnreadableImage
from pbrnet.scenes.importing.shape import Emitter, directional_light, point_light, spot_light
from pbrnet.scenes.importing.xml_elements import plugin
from pbrnet.scenes.pbrt.textures import Textures
from pbrnet.scenes.pbrt.values import Context, Entity

_WHITE: Color = (1.0, 1.0, 1.0)
# pbrt's light space from the space of Mitsuba's `envmap`, for maps with equal u and v.
_ENVMAP_AXES = np.array([[0.0, 0, -1], [1, 0, 0], [0, 1, 0]])


class Lights:
    """Translates lights; `frame` (4, 4), a similarity, maps the world of `reader` to ours."""

    def __init__(
        self, context: Context, textures: Textures, store: TextureStore, frame: Float64Array
    ) -> None:
        self.context, self.textures, self.store, self.frame = context, textures, store, frame
        self.scale = float(np.cbrt(np.linalg.det(frame[:3, :3])))

    def area(self, light: Entity) -> Element | None:
        """Translate the emission of a shape; None, with a note, if it cannot be."""
        if light.type not in ("diffuse", "area"):
            self.context.changes.note(
                "an area light of unsupported type was left out: {}", repr(light.type)[:60]
            )
            return None
        strength = self._strength(light, "L")
        radiance: Color | Element = strength
        if light.boolean("twosided", False):
            self.context.changes.note("a light that shines to both sides shines to its front only")
        if "filename" in light:
            path = self.textures.image(light)
            if path is not None:
                radiance = self._image(path, strength)
        self._report(light)
        if isinstance(radiance, tuple) and max(radiance) <= 0:
            return None
        return plugin("emitter", "area", radiance=radiance)

    def world(self, light: Entity, to_world: Float64Array) -> Emitter | None:
        """Translate a light without shape; None, with a note, if it cannot be."""
        known: dict[str, Callable[[Entity, Float64Array], Emitter | None]] = {
            "point": self._point,
            "goniometric": self._point,
            "spot": self._spot,
            "projection": self._spot,
            "distant": self._distant,
            "infinite": self._infinite,
            "exinfinite": self._infinite,
        }
        handle = known.get(light.type)
        if handle is None:
            self.context.changes.note(
                "a light of unsupported type was left out: {}", repr(light.type)[:60]
            )
            return None
        if light.type in ("goniometric", "projection"):
            self.context.changes.note("the image of a light was left out: {}", light.type)
            light.ignore("mapname", "filename")
        made = handle(light, self.frame @ to_world)
        self._report(light)
        return made

    def _report(self, light: Entity) -> None:
        for name in ("power", "illuminance"):
            if name in light:
                self.context.changes.note(f"the {name} of a light was left out; its scale counts")
        light.ignore("samples", "nsamples", "power", "illuminance", "twosided", "portal")
        light.report_unused()

    def _strength(self, light: Entity, name: str, factor: float = 1.0) -> Color:
        """The spectrum `name` times the light's `scale`."""
        color = np.array(light.color(name, _WHITE) or _WHITE)
        if "scale" in light:
            color = color * np.array(light.color("scale", _WHITE) or _WHITE)
        return as_triple(color * factor)

    def _image(self, path: Path, radiance: Color) -> Color | Element:
        try:
            stored = self.store.radiance(path, radiance)
        except UnreadableImage as error:
            self.context.changes.note("the damaged image of a light was left out: {}", str(error))
            return radiance
        return plugin("texture", "bitmap", filename=stored, raw=True)

    def _point(self, light: Entity, to_world: Float64Array) -> Emitter:
        # Irradiance falls with the squared distance, which is scaled.
        place = as_triple((to_world @ [*_vector(light, "from", (0, 0, 0)), 1.0])[:3])
        return point_light(place, self._strength(light, "I", self.scale**2))

    def _spot(self, light: Entity, to_world: Float64Array) -> Emitter:
        start, end = _vector(light, "from", (0, 0, 0)), _vector(light, "to", (0, 0, 1))
        if light.type == "projection":
            cone, fade = 0.5 * light.number("fov", 90.0), 0.0
        else:
            cone = light.number("coneangle", 30.0)
            fade = light.number("conedeltaangle", 5.0)
        place = as_triple((to_world @ [*start, 1.0])[:3])
        direction = _unit(to_world[:3, :3] @ (end - start), light)
        cone = min(max(cone, 0.1), 89.9)
        strength = self._strength(light, "I", self.scale**2)
        return spot_light(place, direction, strength, cone, max(cone - fade, 0.0))

    def _distant(self, light: Entity, to_world: Float64Array) -> Emitter:
        start, end = _vector(light, "from", (0, 0, 0)), _vector(light, "to", (0, 0, 1))
        direction = _unit(to_world[:3, :3] @ (end - start), light)
        return directional_light(direction, self._strength(light, "L"))

    def _infinite(self, light: Entity, to_world: Float64Array) -> Emitter:
        radiance = self._strength(light, "L")
        name = "mapname" if "mapname" in light else "filename"
        path = self.context.sandbox.find(light.text(name), light.place) if name in light else None
        if path is None:
            if name in light:
                self.context.changes.note(
                    "missing environment map, replaced by a constant sky: {}",
                    repr(light.text(name))[:120],
                )
            made = plugin("emitter", "constant", radiance=radiance)
            return Emitter(made, ("environment",))
        axes = to_world[:3, :3] / np.cbrt(abs(np.linalg.det(to_world[:3, :3])))
        turn = axes @ _ENVMAP_AXES
        mirrored = bool(np.linalg.det(turn) < 0)
        if mirrored:
            turn = turn @ np.diag([-1.0, 1, 1])

        def upright(pixels: Float32Array) -> Float32Array:
            flat = from_octahedral(pixels) if pixels.shape[0] == pixels.shape[1] else pixels
            return flat[:, ::-1] if mirrored else flat

        try:
            stored = self.store.radiance(path, radiance, upright)
        except UnreadableImage as error:
            self.context.changes.note(
                "damaged environment map, replaced by a constant sky: {}", f"{path.name} ({error})"
            )
            return Emitter(plugin("emitter", "constant", radiance=radiance), ("environment",))
        pose = np.eye(4)
        pose[:3, :3] = turn
        made = plugin("emitter", "envmap", filename=stored, to_world=pose)
        return Emitter(made, ("environment",))


def from_octahedral(pixels: Float32Array) -> Float32Array:
    """Latitude-longitude map (H, 2 H, 3) of a square equal-area octahedral map (H, H, 3).

    The maps of version 4: Clarberg, *Fast Equal-Area Mapping of the (Hemi)Sphere using SIMD*
    (2008). Bilinear, with polar angle from +z and azimuth from +x.
    """
    size = len(pixels)
    polar = np.pi * (np.arange(size) + 0.5) / size
    azimuth = np.pi * (np.arange(2 * size) + 0.5) / size
    sine = np.sin(polar)[:, None]
    x, y = sine * np.cos(azimuth), sine * np.sin(azimuth)
    z = np.broadcast_to(np.cos(polar)[:, None], x.shape)
    radius = np.sqrt(1 - np.abs(z))
    angle = np.arctan2(np.abs(y), np.abs(x)) * 2 / np.pi
    v = angle * radius
    u = radius - v
    below = z < 0
    u, v = np.where(below, 1 - v, u), np.where(below, 1 - u, v)
    u, v = np.copysign(u, x), np.copysign(v, y)
    column = np.clip((u + 1) / 2 * size - 0.5, 0, size - 1)
    row = np.clip((v + 1) / 2 * size - 0.5, 0, size - 1)
    left, top = np.floor(column).astype(int), np.floor(row).astype(int)
    right, bottom = np.minimum(left + 1, size - 1), np.minimum(top + 1, size - 1)
    a, b = (column - left)[..., None], (row - top)[..., None]
    above = (1 - a) * pixels[top, left] + a * pixels[top, right]
    under = (1 - a) * pixels[bottom, left] + a * pixels[bottom, right]
    return np.asarray((1 - b) * above + b * under, dtype=np.float32)


def _vector(light: Entity, name: str, default: tuple[float, float, float]) -> Float64Array:
    given = light.numbers(name, 3)
    return np.array(default, dtype=np.float64) if given is None or not len(given) else given[0]


def _unit(direction: Float64Array, light: Entity) -> Float64Array:
    length = float(np.linalg.norm(direction))
    if length == 0:
        raise light.error("'from' and 'to' are the same point")
    return direction / length
