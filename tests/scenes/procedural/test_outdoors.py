"""Procedural surroundings: what a ray meets does not depend on the processor."""

from __future__ import annotations

import numpy as np
import pytest

from scenes.geometry.directions import unit
from scenes.geometry.mesh import face_areas
from scenes.procedural.outdoors import build_outdoors
from scenes.procedural.planning import make_plan
from scenes.procedural.surroundings.buildings import Block, Roof, building
from scenes.reconstruction.raycast import RayCaster
from scenes.seeds import generator
from tests.fixtures.planes import bodies, coplanar_overlap


@pytest.mark.parametrize("seed", range(6))
def test_no_two_bodies_of_the_surroundings_share_a_visible_plane(seed: int) -> None:
    """Of such faces Embree chooses either, by the width of the processor's vectors.

    Leaves are single sheets that lie at random.
    """
    plan = make_plan(generator(seed, "plan"), 1, 6)
    for item in build_outdoors(generator(seed, "outdoors"), plan):
        if item.category != "plant":
            shared = coplanar_overlap(
                [
                    part.vertices[each]
                    for part in item.parts
                    for each in bodies(part.vertices, part.faces)
                ]
            )
            assert shared < 1e-6, f"{item.id}: {shared} m2"


@pytest.mark.parametrize("roof", ["gable", "hip", "flat"])
def test_buildings_face_outwards(roof: Roof) -> None:
    """A ray at a facade meets walls, reveals, panes and trim from their front."""
    block = Block(12, 9, 3, roof, (0, 1, 2, 3))
    made = building(generator(1, roof), "house", block, np.zeros(2), 0.0, 0.0)
    triangles = np.concatenate([part.vertices[part.faces] for part in made.parts])
    normals = face_areas(triangles)[1]
    aimed = generator(2).uniform((-5.5, -4, 0.2), (5.5, 4, 8.5), (400, 3))
    angle = generator(3).uniform(0, 2 * np.pi, 400)
    eyes = np.column_stack([40 * np.cos(angle), 40 * np.sin(angle), np.full(400, 5.0)])
    ways = unit(aimed - eyes)
    distance, face = RayCaster(triangles).cast(eyes, ways)
    assert np.isfinite(distance).all()
    assert ((normals[face] * ways).sum(axis=1) < 0).all()
