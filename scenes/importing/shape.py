"""Shapes and emitters of an imported scene, and objects made of shapes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal
from xml.etree.ElementTree import Element

import numpy as np

from pbrnet.scenes.arrays import Float64Array, as_triple
from pbrnet.scenes.color import Color
from pbrnet.scenes.contract import SceneObject
from pbrnet.scenes.geometry.mesh import Mesh
from pbrnet.scenes.geometry.transforms import frame_along
from pbrnet.scenes.importing.materials.surface import Surface
from pbrnet.scenes.importing.xml_elements import plugin

MAX_SHAPES = 100_000  # of a scene
MAX_SCENE_TRIANGLES = 20_000_000

EmitterKind = Literal["area", "point", "spot", "directional", "sun", "sky", "environment"]


@dataclass(frozen=True)
class Shape:
    """One shape in world space, first the file's world, later ours (metres, Z up)."""

    id: str
    name: str  # as in the file
    mesh: Mesh  # always triangles, for measuring
    surface: Surface
    emitter: Any = None  # emission as the source describes it, None without emission
    sphere: Float64Array | None = None  # (4, 4) map of the unit sphere, for analytic spheres
    inside_out: bool = False  # whether the normals of the sphere point inwards

    def transformed(self, matrix: Float64Array) -> Shape:
        """The shape under a similarity, `matrix` (4, 4)."""
        return replace(
            self,
            mesh=self.mesh.transformed(matrix),
            sphere=None if self.sphere is None else matrix @ self.sphere,
        )


@dataclass(frozen=True)
class Emitter:
    """An emitter that belongs to no shape; `position` in metres, Z up, if it has one."""

    element: Element
    kinds: tuple[EmitterKind, ...]
    position: tuple[float, float, float] | None = None


def bounds_of(shapes: list[Shape]) -> tuple[Float64Array, Float64Array]:
    """Lowest and highest corner (3,) of shapes together."""
    bounds = np.array([shape.mesh.bounds for shape in shapes])
    return bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)


def point_light(place: tuple[float, float, float], intensity: Color) -> Emitter:
    """A light without extent at `place`, which shines evenly to all sides."""
    made = plugin("emitter", "point", intensity=intensity)
    made.append(Element("point", {"name": "position", "value": " ".join(map(str, place))}))
    return Emitter(made, ("point",), place)


def spot_light(
    place: tuple[float, float, float],
    direction: Float64Array,
    intensity: Color,
    outer: float,
    inner: float,
) -> Emitter:
    """A spot that shines along the unit vector `direction`, `intensity` W/sr on its axis.

    Light fades from `inner` to `outer` degrees off the axis.
    """
    made = plugin(
        "emitter",
        "spot",
        intensity=intensity,
        cutoff_angle=outer,
        beam_width=min(inner, 0.999 * outer),
        to_world=frame_along(place, direction),
    )
    return Emitter(made, ("spot",), place)


def directional_light(direction: Float64Array, irradiance: Color) -> Emitter:
    """A light infinitely far away that shines in `direction` (3,)."""
    made = plugin("emitter", "directional", irradiance=irradiance)
    made.append(Element("vector", {"name": "direction", "value": " ".join(map(str, direction))}))
    return Emitter(made, ("directional",))


def make_object(
    id: str,
    name: str,
    category: str,
    shapes: list[Shape],
    is_structure: bool = False,
    room: str | None = None,
) -> SceneObject:
    """An object of `scene.json` that consists of `shapes`, with their common bounds."""
    low, high = bounds_of(shapes)
    return SceneObject(
        id=id,
        name=name,
        category=category,
        shapes=tuple(shape.id for shape in shapes),
        bbox_min=as_triple(low),
        bbox_max=as_triple(high),
        is_structure=is_structure,
        room=room,
    )
