"""Procedural surroundings: what a ray meets does not depend on the processor."""

import numpy as np
import pytest

from pbrnet.scenes.geometry.directions import unit
from pbrnet.scenes.geometry.mesh import face_areas
from pbrnet.scenes.procedural.outdoors import GROUND, build_outdoors
from pbrnet.scenes.procedural.planning import make_plan
from pbrnet.scenes.procedural.surroundings.buildings import Block, Roof, building, hazed
from pbrnet.scenes.procedural.surroundings.clouds import FARTHEST, LARGEST, NEAREST, clouds
from pbrnet.scenes.reconstruction.raycast import RayCaster
from pbrnet.scenes.seeds import generator
from tests.fixtures.planes import bodies, coplanar_overlap


@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.check) for seed in range(2, 6))]
)
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


def _sun(seed: int) -> np.ndarray:
    azimuth, elevation = np.radians(generator(seed, "sun").uniform((0, 2), (360, 75)))
    flat = np.cos(elevation)
    return np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])


@pytest.mark.parametrize("seed", range(5))
def test_clouds_are_far_and_never_before_the_sun(seed: int) -> None:
    centre, sun, ground = np.array([5.0, 4.0]), _sun(seed), -3.0
    made = clouds(generator(seed, "clouds"), centre, sun, ground)
    again = clouds(generator(seed, "clouds"), centre, sun, ground)
    assert made is not None and again is not None
    (part,) = made.parts
    assert part.vertices.tobytes() == again.parts[0].vertices.tobytes()
    assert made.category == "cloud" and made.is_structure and len(part.faces) < 100_000
    away = np.linalg.norm(part.vertices[:, :2] - centre, axis=1)
    assert away.min() > NEAREST - 1.3 * LARGEST and away.max() < FARTHEST + 1.3 * LARGEST
    assert np.abs(part.vertices[:, :2]).max() < GROUND  # the scene does not grow sideways
    assert part.vertices[:, 2].min() - ground > 250 and part.vertices[:, 2].max() < 1200
    caster = RayCaster(part.vertices[part.faces])
    # From every place in and around the home, over the whole disc of the sun and its glare.
    rng = generator(seed, "eyes")
    eyes = np.column_stack([centre + rng.uniform(-80, 80, (500, 2)), rng.uniform(-3, 3, 500)])
    ways = unit(sun + rng.normal(0, 0.05, (500, 3)))
    assert np.isinf(caster.cast(eyes, ways)[0]).all()


@pytest.mark.parametrize("seed", range(3))
def test_no_two_lumps_of_clouds_share_a_visible_plane(seed: int) -> None:
    made = clouds(generator(seed, "clouds"), np.zeros(2), _sun(seed), 0.0)
    assert made is not None
    points, faces = made.parts[0].vertices, made.parts[0].faces
    corners = np.sort(points[faces][:, :, 2], axis=1)
    assert (corners[:, 2] - corners[:, 0]).min() > 0  # none is level
    planes = np.column_stack([face_areas(points[faces])[1], points[faces].mean(axis=1)])
    assert len(np.unique(np.round(planes, 3), axis=0)) == len(faces)


def test_haze_pales_what_is_far() -> None:
    near, middle, far = (hazed((0.1, 0.12, 0.08), metres) for metres in (50.0, 300.0, 1500.0))
    assert np.less(near, middle).all() and np.less(middle, far).all()
    assert np.ptp(far) > 0 and far[2] > far[0]  # bluish
