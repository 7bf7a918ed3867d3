"""Shapes that an import adds to close a building: ceilings, walls, and seals of gaps."""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.color import Color
from pbrnet.scenes.contract import SceneObject
from pbrnet.scenes.geometry.mesh import Mesh
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.materials.surface import Surface
from pbrnet.scenes.importing.shape import Shape, make_object
from pbrnet.scenes.importing.xml_elements import plugin
from pbrnet.scenes.reconstruction.completion import Completion

# Reflectances
_GREY: Color = (0.5, 0.5, 0.5)
_WALL: Color = (0.72, 0.71, 0.69)
CEILING: Color = (0.82, 0.82, 0.80)
FLOOR: Color = (0.4, 0.38, 0.35)


def completing_shapes(completion: Completion, changes: Changes) -> list[Shape]:
    """The ceiling and walls that close open spaces and slits; notes them in `changes`."""
    if completion.slits:
        changes.note(f"ceilings that ended before the walls were continued: {completion.slits}")
        return [sealing_shape("added_ceiling", completion.ceilings, CEILING)]
    if not completion.spaces:
        return []
    shapes = [sealing_shape("added_ceiling", completion.ceilings, CEILING)]
    changes.note(f"rooms open above got a ceiling: {len(completion.spaces)}")
    if completion.raised:
        changes.note("low walls were continued up to the ceiling")
    if len(completion.walls):
        shapes.append(sealing_shape("added_wall", completion.walls, _WALL))
    if completion.has_added_walls:
        window = ", the longest with a window" if completion.has_window else ""
        changes.note(f"outer walls were missing: they were added{window}")
    return shapes


def sealing_shape(name: str, corners: Float64Array, color: Color = _GREY) -> Shape:
    """A matt, two-sided shape of triangles (F, 3, 3); `name` is its id, too."""
    matt = plugin("bsdf", "diffuse", reflectance=color)
    surface = Surface(plugin("bsdf", "twosided", bsdf=matt), double=True, name=name)
    mesh = Mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
    return Shape(name, name, mesh, surface)


def structure_object(shape: Shape) -> SceneObject:
    """A sealing shape as part of the building's structure."""
    return make_object(shape.id, shape.id, "structure", [shape], is_structure=True)
