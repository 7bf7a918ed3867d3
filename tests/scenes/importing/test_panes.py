"""Panes by name: flat shapes without a material that are called glass let light through."""

import numpy as np
import pytest

from pbrnet.scenes.geometry.mesh import Mesh
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.materials.surface import Surface
from pbrnet.scenes.importing.shape import Shape
from pbrnet.scenes.importing.shapes.panes import with_named_glass
from pbrnet.scenes.importing.xml_elements import plugin
from tests.fixtures.buildings import Corner, block

SHEET = ((0.0, 0.0, 0.0), (2.0, 0.02, 1.5))
BLOCK = ((0.0, 0.0, 0.0), (0.5, 0.5, 0.8))


def named(name: str, low: Corner, high: Corner, unstated: bool = True) -> Shape:
    points = block(low, high).reshape(-1, 3)
    first = 4 * np.arange(6)[:, None]
    faces = (first + np.array([0, 1, 2, 0, 2, 3])).reshape(-1, 3)
    matt = Surface(plugin("bsdf", "diffuse"), unstated=unstated)
    return Shape(name, name, Mesh(points, faces), matt)


@pytest.mark.parametrize(
    ("shape", "is_glass"),
    [
        (named("Glass_For_Facade", *SHEET), True),
        (named("Door_Glass", *SHEET), True),
        (named("Window.001", *SHEET), True),
        (named("window_frame", *SHEET), False),
        (named("TV_Glass", *SHEET), False),
        (named("Wall", *SHEET), False),
        (named("wine_glass", *BLOCK), False),
        (named("Glass_For_Facade", *SHEET, unstated=False), False),
    ],
)
def test_only_sheets_without_a_material_become_glass(shape: Shape, is_glass: bool) -> None:
    changes = Changes()
    (made,) = with_named_glass([shape], changes)
    assert made.surface.see_through == is_glass
    assert (made is shape) != is_glass
    assert any(shape.name in change for change in changes.sentences()) == is_glass
