"""What an import adds to a building so that its walls are tight: plain grey parts of it."""

from __future__ import annotations

import numpy as np

from scenes.arrays import Float64Array
from scenes.contract import SceneObject
from scenes.geometry.mesh import Mesh
from scenes.importing.shape import Shape, Surface
from scenes.importing.xml_elements import plugin

_GREY = (0.5, 0.5, 0.5)


def filler_shape(name: str, corners: Float64Array) -> Shape:
    """Triangles (F, 3, 3) as a matt shape."""
    matt = plugin("bsdf", "diffuse", reflectance=_GREY)
    surface = Surface(plugin("bsdf", "twosided", bsdf=matt), double=True, name=name)
    mesh = Mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
    return Shape(name, name, mesh, surface)


def part_of_building(filler: Shape) -> SceneObject:
    """Such a shape as `scene.json` knows it."""
    low, high = filler.mesh.bounds
    return SceneObject(
        filler.id,
        filler.id,
        "structure",
        (filler.id,),
        (float(low[0]), float(low[1]), float(low[2])),
        (float(high[0]), float(high[1]), float(high[2])),
        is_structure=True,
    )
