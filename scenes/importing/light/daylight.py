"""Daylight for scenes without light of their own: sun, clear sky, and a ground plane."""

from __future__ import annotations

from xml.etree.ElementTree import Element

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.contract import SceneObject
from pbrnet.scenes.geometry.mesh import Mesh
from pbrnet.scenes.importing.materials.surface import Surface
from pbrnet.scenes.importing.shape import Emitter, Shape, make_object
from pbrnet.scenes.importing.xml_elements import plugin

GROUND_ID = "outside_ground"
_HALF_SIZE = 2500.0  # metres of ground to each side
_SUN = "0.5 -0.7 0.5"  # direction towards the sun, 30 degrees above the horizon
_TURBIDITY = 3.5
_GROUND = (0.22, 0.20, 0.16)  # reflectance of dry grass and paving


def daylight(scale: float = 1.0) -> Emitter:
    """Sun and sky of Mitsuba's `sunsky` emitter, its radiance times `scale`."""
    made = plugin(
        "emitter", "sunsky", turbidity=_TURBIDITY, sun_scale=float(scale), sky_scale=float(scale)
    )
    made.append(Element("vector", {"name": "sun_direction", "value": _SUN}))
    return Emitter(made, ("sky", "sun"))


def ground(low: Float64Array, high: Float64Array) -> tuple[Shape, SceneObject]:
    """A ground plane 2 cm below a scene with bounds `low` and `high` (3,): shape and object."""
    middle, z = 0.5 * (low + high)[:2], float(low[2]) - 0.02
    corners = middle + _HALF_SIZE * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
    vertices = np.column_stack([corners, np.full(4, z)])
    mesh = Mesh(vertices, np.array([[0, 1, 2], [0, 2, 3]]))
    matt = plugin("bsdf", "diffuse", reflectance=_GROUND)
    surface = Surface(plugin("bsdf", "twosided", bsdf=matt), double=True, name="ground")
    shape = Shape(GROUND_ID, GROUND_ID, mesh, surface)
    return shape, make_object(GROUND_ID, "ground", "ground", [shape], is_structure=True)
