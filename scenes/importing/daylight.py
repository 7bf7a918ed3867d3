"""Daylight for scenes that bring none: a clear sky with the sun in it, and ground under it."""

from __future__ import annotations

from xml.etree.ElementTree import Element

import numpy as np

from scenes.arrays import Float64Array
from scenes.contract import SceneObject
from scenes.geometry.mesh import Mesh
from scenes.importing.shape import Emitter, Shape, Surface
from scenes.importing.xml_elements import plugin

GROUND_ID = "outside_ground"
_REACH = 2500.0  # metres of ground to each side; beyond, the horizon
_SUN = "0.5 -0.7 0.5"  # 30 degrees up
_TURBIDITY = 3.5
_GROUND = (0.22, 0.20, 0.16)  # reflectance of dry grass and paving


def daylight(scale: float = 1.0) -> Emitter:
    """Sun and sky, `scale` times as bright as `sunsky` makes them."""
    made = plugin(
        "emitter", "sunsky", turbidity=_TURBIDITY, sun_scale=float(scale), sky_scale=float(scale)
    )
    made.append(Element("vector", {"name": "sun_direction", "value": _SUN}))
    return Emitter(made, ("sky", "sun"))


def ground(low: Float64Array, high: Float64Array) -> tuple[Shape, SceneObject]:
    """A plain just below what lies between `low` and `high` (3,), as a shape and as an object."""
    middle, z = 0.5 * (low + high)[:2], float(low[2]) - 0.02
    corners = middle + _REACH * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
    vertices = np.column_stack([corners, np.full(4, z)])
    mesh = Mesh(vertices, np.array([[0, 1, 2], [0, 2, 3]]))
    matt = plugin("bsdf", "diffuse", reflectance=_GROUND)
    surface = Surface(plugin("bsdf", "twosided", bsdf=matt), double=True, name="ground")
    lowest, highest = mesh.bounds
    thing = SceneObject(
        GROUND_ID,
        "ground",
        "ground",
        (GROUND_ID,),
        (float(lowest[0]), float(lowest[1]), z),
        (float(highest[0]), float(highest[1]), z),
        is_structure=True,
    )
    return Shape(GROUND_ID, GROUND_ID, mesh, surface), thing
