"""Emitters and fields of view of any Mitsuba version, translated to Mitsuba 3.

Input: emitter elements in the file's world. Output: Mitsuba 3 emitter elements in ours (metres,
Z up).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from xml.etree.ElementTree import Element

import numpy as np

from pbrnet.scenes.arrays import Float64Array, as_triple
from pbrnet.scenes.color import Color
from pbrnet.scenes.importing.materials.textures import UnreadableImage
from pbrnet.scenes.importing.shape import (
    Emitter,
    EmitterKind,
    directional_light,
    point_light,
)
from pbrnet.scenes.importing.xml_elements import plugin, prop
from pbrnet.scenes.mitsuba.reader import Node, unresolved
from pbrnet.scenes.mitsuba.textures import Textures
from pbrnet.scenes.mitsuba.values import Properties, Scope


class Emitters:
    """Translates emitters; `frame` (4, 4), a similarity, maps the file's world to ours.

    `replacement` makes the emitter that replaces a missing environment map, given the scale of
    the map; a constant white sky if None.
    """

    def __init__(
        self,
        scope: Scope,
        textures: Textures,
        frame: Float64Array,
        replacement: Callable[[float], Emitter] | None = None,
    ) -> None:
        self.scope, self.textures, self.frame = scope, textures, frame
        self.replacement = replacement
        self.scale = float(np.cbrt(np.linalg.det(frame[:3, :3])))

    def area(self, node: Node) -> Element:
        """Translate the emitter of a shape; radiance is independent of the scene's scale."""
        properties = self._properties(node)
        if node.type not in ("area", "directionalarea"):
            raise node.error(f"{node.type!r} cannot be the emitter of a shape; use 'area'")
        found = properties.color("radiance", emission=True)
        if found is None:
            found = properties.color("intensity", emission=True)
        radiance: Color | Element = (1.0, 1.0, 1.0)
        if isinstance(found, Node):
            radiance = self._radiance_texture(found)
        elif found is not None:
            radiance = found
        if node.type == "directionalarea":
            self.scope.changes.note("a directional area light was replaced by a diffuse one")
        properties.report_unused()
        return plugin("emitter", "area", radiance=radiance)

    def world(self, node: Node) -> Emitter | None:
        """Translate an emitter without shape; None, with a note, if Mitsuba 3 has no equivalent."""
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
            self.scope.changes.note(
                "an emitter of unsupported type was left out: {}", repr(node.type)
            )
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
        """The rotation of the frame times a transform (4, 4), without the frame's scale."""
        turned = np.eye(4)
        turned[:3, :3] = self.frame[:3, :3] / self.scale @ matrix[:3, :3]
        return turned

    def _color(self, properties: Properties, name: str, factor: float = 1.0) -> Color:
        found = properties.color(name, emission=True)
        if isinstance(found, Node):
            self.scope.changes.note(f"the texture of an emitter's {name} was left out")
            found = None
        return as_triple(np.array(found if found is not None else (1.0, 1.0, 1.0)) * factor)

    def _position(self, properties: Properties) -> tuple[float, float, float]:
        given = properties.vector("position")
        local = properties.transform() @ np.array([0.0, 0, 0, 1])
        return as_triple(self.frame @ (local if given is None else np.array([*given, 1.0])))

    def _point(self, properties: Properties) -> Emitter:
        # Irradiance falls with the squared distance, which is scaled.
        intensity = self._color(properties, "intensity", self.scale**2)
        return point_light(self._position(properties), intensity)

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
        return Emitter(made, ("spot",), as_triple(place))

    def _directional(self, properties: Properties) -> Emitter:
        given = properties.vector("direction")
        turn = self._rotation(properties.transform())[:3, :3]
        if given is not None:
            turn = self.frame[:3, :3] / self.scale
        direction = turn @ (np.array([0.0, 0, 1]) if given is None else given)
        direction = direction / np.linalg.norm(direction)
        return directional_light(direction, self._color(properties, "irradiance"))

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
                stored = self.textures.store.radiance(path)
                made = plugin("emitter", "envmap", filename=stored, scale=scale, to_world=turn)
                return Emitter(made, ("environment",))
            except UnreadableImage as error:
                name = f"{name} ({error})"
        if self.replacement is not None:
            self.scope.changes.note(
                "missing environment map, replaced by sun and sky: {}", repr(name)
            )
            return self.replacement(scale)
        self.scope.changes.note(
            "missing environment map, replaced by a constant white sky: {}", repr(name)
        )
        radiance = (scale, scale, scale)
        return Emitter(plugin("emitter", "constant", radiance=radiance), ("environment",))

    def _sunsky(self, properties: Properties) -> Emitter:
        """`sky`, `sun` and `sunsky`: directions are rotated, date and place are copied."""
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
            # Version 0.x scales the solar radius; Mitsuba 3 takes the full angle in degrees.
            factor = properties.number("sun_radius_scale", 1.0)
            aperture = 0.5358 * factor
            if not 0.01 <= aperture <= 90:
                self.scope.changes.note("sunRadiusScale was clamped: {}", f"{factor:g}")
            made.append(prop("sun_aperture", min(max(aperture, 0.01), 90.0)))
        elif "sun_aperture" in properties:
            made.append(prop("sun_aperture", properties.number("sun_aperture", 0.5358)))
        direction = properties.vector("sun_direction")
        turn = self._rotation(properties.transform())[:3, :3]
        if direction is not None:
            towards_sun = turn @ direction
            towards_sun = towards_sun / np.linalg.norm(towards_sun)
            if towards_sun[2] < 0.02:
                self.scope.changes.note("a sun at or below the horizon was moved just above it")
                towards_sun[2] = 0.02
                towards_sun = towards_sun / np.linalg.norm(towards_sun)
            made.append(
                Element(
                    "vector", {"name": "sun_direction", "value": " ".join(map(str, towards_sun))}
                )
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
        parts: list[tuple[EmitterKind, float]] = [("sky", sky), ("sun", sun)]
        return Emitter(made, tuple(part for part, scale in parts if scale > 0))

    def _radiance_texture(self, node: Node) -> Color | Element:
        properties = Properties(node, self.scope)
        is_image = node.type in ("bitmap", "ldrtexture")
        path = self.textures.image_path(properties) if is_image else None
        if path is None:
            return self.textures.texture(node)
        try:
            stored = self.textures.store.radiance(path)
            return plugin("texture", "bitmap", filename=stored, raw=True)
        except UnreadableImage as error:
            self.scope.changes.note(
                "damaged texture of an emitter, replaced by white: {}", f"{path.name} ({error})"
            )
            return (1.0, 1.0, 1.0)


def half_fov_x(properties: Properties, width: int, height: int) -> float:
    """Half the horizontal field of view, radians, of a perspective sensor of any version.

    `width` and `height` are the film's size in pixels.
    """
    if "focal_length" in properties and "fov" not in properties:
        text = properties.text("focal_length", "50mm").lower().removesuffix("mm").strip()
        try:
            focal = float(text)
        except ValueError:
            raise properties.node.error(f"{text!r} is not a focal length in mm") from None
        # All versions refer to 35 mm film, with a diagonal of 43.27 mm.
        half_diagonal = 0.5 * math.hypot(36, 24) / max(focal, 1e-3)
        return math.atan(half_diagonal * width / math.hypot(width, height))
    fov = properties.number("fov", 45.0)
    if not 0.1 <= fov < 179.5:
        raise properties.node.error(
            f"the field of view is {fov:g} degrees; it must be from 0.1 to less than 179.5"
        )
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
