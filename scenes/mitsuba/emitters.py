"""Emitters of any version as Mitsuba 3's, turned into the Z-up world."""

from __future__ import annotations

import math
from collections.abc import Callable
from xml.etree.ElementTree import Element

import numpy as np

from scenes.arrays import Float64Array
from scenes.color import Color
from scenes.importing.shape import Emitter, Kind
from scenes.importing.textures import UnreadableImage
from scenes.importing.xml_elements import plugin, prop
from scenes.mitsuba.materials import Materials
from scenes.mitsuba.reader import Node, unresolved
from scenes.mitsuba.values import Properties, Scope

_SKY_FILL: Color = (1.0, 1.0, 1.0)  # where an environment map is missing


class Emitters:
    """Translates emitters; `frame` (4, 4) maps the file's world to ours (a similarity).

    `stand_in` makes what takes the place of a missing environment map, given its scale; an even
    white sky if None.
    """

    def __init__(
        self,
        scope: Scope,
        materials: Materials,
        frame: Float64Array,
        stand_in: Callable[[float], Emitter] | None = None,
    ) -> None:
        self.scope, self.materials, self.frame = scope, materials, frame
        self.stand_in = stand_in
        self.scale = float(np.cbrt(np.linalg.det(frame[:3, :3])))

    def area(self, node: Node) -> Element:
        """The emitter of a shape; radiance does not change with the scene's scale."""
        properties = self._properties(node)
        if node.type not in ("area", "directionalarea"):
            raise node.error(f"{node.type!r} is no emitter for a shape")
        found = properties.color("radiance", emission=True)
        if found is None:
            found = properties.color("intensity", emission=True)
        radiance: Color | Element = (1.0, 1.0, 1.0)
        if isinstance(found, Node):
            radiance = self._radiance_texture(found)
        elif found is not None:
            radiance = found
        if node.type == "directionalarea":
            self.scope.changes.note("a directional area light now shines in all directions")
        properties.report_unused()
        return plugin("emitter", "area", radiance=radiance)

    def world(self, node: Node) -> Emitter | None:
        """An emitter without a shape; None, with a note, where Mitsuba 3 has nothing like it."""
        known = {
            "point": self._point,
            "spot": self._spot,
            "directional": self._directional,
            "constant": self._constant,
            "envmap": self._envmap,
            "sky": self._sunsky,
            "sun": self._sunsky,
            "sunsky": self._sunsky,
            "timed_sunsky": self._sunsky,
        }.get(node.type)
        if known is None:
            self.scope.changes.note("a light of kind {} was left out", repr(node.type))
            return None
        properties = self._properties(node)
        made = known(properties)
        properties.report_unused()
        return made

    def _properties(self, node: Node) -> Properties:
        properties = Properties(node, self.scope)
        properties.ignore("id", "sampling_weight", "cache")
        return properties

    def _rotation(self, matrix: Float64Array) -> Float64Array:
        """The frame's rotation times a transform's: directions only, scale 1."""
        turned = np.eye(4)
        turned[:3, :3] = self.frame[:3, :3] / self.scale @ matrix[:3, :3]
        return turned

    def _color(self, properties: Properties, name: str, factor: float = 1.0) -> Color:
        found = properties.color(name, emission=True)
        if isinstance(found, Node):
            self.scope.changes.note(f"the texture of a light's {name} was left out")
            found = None
        rgb = np.array(found if found is not None else (1.0, 1.0, 1.0)) * factor
        return (float(rgb[0]), float(rgb[1]), float(rgb[2]))

    def _position(self, properties: Properties) -> tuple[float, float, float]:
        given = properties.vector("position")
        local = properties.transform() @ np.array([0.0, 0, 0, 1])
        place = self.frame @ (local if given is None else np.array([*given, 1.0]))
        return (float(place[0]), float(place[1]), float(place[2]))

    def _point(self, properties: Properties) -> Emitter:
        # Irradiance falls with the square of the distance, which the scale changes.
        intensity = self._color(properties, "intensity", self.scale**2)
        place = self._position(properties)
        made = plugin("emitter", "point", intensity=intensity)
        made.append(Element("point", {"name": "position", "value": " ".join(map(str, place))}))
        return Emitter(made, ("point",), place)

    def _spot(self, properties: Properties) -> Emitter:
        matrix = properties.transform()
        place = self.frame @ matrix @ np.array([0.0, 0, 0, 1])
        linear = self._rotation(matrix)
        linear[:3, :3] /= np.linalg.norm(linear[:3, :3], axis=0)
        linear[:3, 3] = place[:3]
        if "texture" in properties or properties.nested("texture"):
            self.scope.changes.note("the texture of a spot light was left out")
        cutoff = properties.number("cutoff_angle", 20.0)
        made = plugin(
            "emitter",
            "spot",
            intensity=self._color(properties, "intensity", self.scale**2),
            cutoff_angle=cutoff,
            beam_width=properties.number("beam_width", 0.75 * cutoff),
            to_world=linear,
        )
        return Emitter(made, ("spot",), (float(place[0]), float(place[1]), float(place[2])))

    def _directional(self, properties: Properties) -> Emitter:
        given = properties.vector("direction")
        turn = self._rotation(properties.transform())[:3, :3]
        if given is not None:
            turn = self.frame[:3, :3] / self.scale
        way = turn @ (np.array([0.0, 0, 1]) if given is None else given)
        way = way / np.linalg.norm(way)
        made = plugin("emitter", "directional", irradiance=self._color(properties, "irradiance"))
        made.append(Element("vector", {"name": "direction", "value": " ".join(map(str, way))}))
        return Emitter(made, ("directional",))

    def _constant(self, properties: Properties) -> Emitter:
        made = plugin("emitter", "constant", radiance=self._color(properties, "radiance"))
        return Emitter(made, ("environment",))

    def _envmap(self, properties: Properties) -> Emitter:
        node = properties.node
        given = properties.child("filename")
        name = given.attributes.get("value", "") if given is not None else ""
        scale = properties.number("scale", 1.0)
        properties.ignore("gamma")
        turn = self._rotation(properties.transform())
        path = None
        if name and not unresolved(name):
            path = self.scope.sandbox.find(name, node.place)
        if path is not None:
            try:
                stored = self.materials.textures.radiance(path)
                made = plugin("emitter", "envmap", filename=stored, scale=scale, to_world=turn)
                return Emitter(made, ("environment",))
            except UnreadableImage as error:
                name = f"{name} ({error})"
        if self.stand_in is not None:
            self.scope.changes.note(
                "missing environment map, sun and sky took its place: {}", repr(name)
            )
            return self.stand_in(scale)
        self.scope.changes.note(
            "missing environment map, an even white sky took its place: {}", repr(name)
        )
        radiance = (scale, scale, scale)
        return Emitter(plugin("emitter", "constant", radiance=radiance), ("environment",))

    def _sunsky(self, properties: Properties) -> Emitter:
        """`sky`, `sun` and `sunsky`; time and place are handed on, directions are turned."""
        kind = properties.node.type
        both = properties.number("scale", 1.0)
        sky = 0.0 if kind == "sun" else properties.number("sky_scale", both)
        sun = 0.0 if kind == "sky" else properties.number("sun_scale", both)
        properties.ignore("resolution", "stretch", "extend", "sun_scale", "sky_scale")
        turbidity = min(max(properties.number("turbidity", 3.0), 1.0), 10.0)
        made = plugin("emitter", "sunsky", turbidity=turbidity, sky_scale=sky, sun_scale=sun)
        albedo = properties.color("albedo")
        if isinstance(albedo, tuple):
            made.append(prop("albedo", tuple(min(value, 1.0) for value in albedo)))
        if "sun_radius_scale" in properties:
            # Version 0.x scales the solar radius; Mitsuba 3 wants the full angle in degrees.
            factor = properties.number("sun_radius_scale", 1.0)
            aperture = 0.5358 * factor
            if not 0.01 <= aperture <= 90:
                self.scope.changes.note("sunRadiusScale {} was limited", f"{factor:g}")
            made.append(prop("sun_aperture", min(max(aperture, 0.01), 90.0)))
        elif "sun_aperture" in properties:
            made.append(prop("sun_aperture", properties.number("sun_aperture", 0.5358)))
        direction = properties.vector("sun_direction")
        turn = self._rotation(properties.transform())[:3, :3]
        if direction is not None:
            way = turn @ direction
            way = way / np.linalg.norm(way)
            if way[2] < 0.02:
                self.scope.changes.note("a sun at or below the horizon was raised just above it")
                way[2] = 0.02
                way = way / np.linalg.norm(way)
            made.append(
                Element("vector", {"name": "sun_direction", "value": " ".join(map(str, way))})
            )
        else:
            for name in ("year", "month", "day"):
                if name in properties:
                    made.append(prop(name, properties.whole(name, 1)))
            for name in ("hour", "minute", "second", "latitude", "longitude", "timezone"):
                if name in properties:
                    made.append(prop(name, properties.number(name, 0.0)))
            if kind != "sunsky" or self.scope.is_old:
                self.scope.changes.note("the sun's direction follows Mitsuba 3's compass (+X east)")
        parts: list[tuple[Kind, float]] = [("sky", sky), ("sun", sun)]
        return Emitter(made, tuple(part for part, scale in parts if scale > 0))

    def _radiance_texture(self, node: Node) -> Color | Element:
        properties = Properties(node, self.scope)
        path = (
            self.materials.image_path(properties) if node.type in ("bitmap", "ldrtexture") else None
        )
        if path is None:
            return self.materials.texture(node)
        try:
            return plugin(
                "texture", "bitmap", filename=self.materials.textures.radiance(path), raw=True
            )
        except UnreadableImage as error:
            self.scope.changes.note(
                "damaged texture of a light became white: {}", f"{path.name} ({error})"
            )
            return (1.0, 1.0, 1.0)


def half_fov_x(properties: Properties, width: int, height: int) -> float:
    """Half the horizontal angle, radians, of a perspective sensor of any version."""
    if "focal_length" in properties and "fov" not in properties:
        text = properties.text("focal_length", "50mm").lower().removesuffix("mm").strip()
        try:
            focal = float(text)
        except ValueError:
            raise properties.node.error(f"{text!r} is not a focal length") from None
        # Both generations mean 35 mm film by its diagonal of 43.27 mm.
        half_diagonal = 0.5 * math.hypot(36, 24) / max(focal, 1e-3)
        return math.atan(half_diagonal * width / math.hypot(width, height))
    fov = properties.number("fov", 45.0)
    if not 0.1 <= fov < 179.5:
        raise properties.node.error(f"a field of view of {fov:g} degrees is not possible")
    half = math.tan(math.radians(fov) / 2)
    axis = properties.text("fov_axis", "x").lower()
    if (
        axis == "y"
        or (axis == "smaller" and height < width)
        or (axis == "larger" and height > width)
    ):
        half *= width / height
    elif axis == "diagonal":
        half *= width / math.hypot(width, height)
    return math.atan(half)
