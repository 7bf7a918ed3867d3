"""Shapes that an import adds to seal gaps between the surfaces of a building."""

from __future__ import annotations

import numpy as np

from scenes.arrays import Float64Array
from scenes.contract import SceneObject
from scenes.geometry.mesh import Mesh
from scenes.importing.shape import Shape, Surface, make_object
from scenes.importing.xml_elements import plugin

_GREY = (0.5, 0.5, 0.5)  # reflectance


def sealing_shape(name: str, corners: Float64Array) -> Shape:
    """A matt grey, two-sided shape of triangles (F, 3, 3); `name` is its id, too."""
    matt = plugin("bsdf", "diffuse", reflectance=_GREY)
    surface = Surface(plugin("bsdf", "twosided", bsdf=matt), double=True, name=name)
    mesh = Mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
    return Shape(name, name, mesh, surface)


def structure_object(shape: Shape) -> SceneObject:
    """A sealing shape as part of the building's structure."""
    return make_object(shape.id, shape.id, "structure", [shape], is_structure=True)
