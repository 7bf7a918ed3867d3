"""Sloping ceilings and niches of procedural homes: where they are, and that homes stay sound."""

import numpy as np
import pytest
from shapely.geometry import Point, Polygon

from pbrnet.pipeline.cameras.view_sampling import surroundings
from pbrnet.pipeline.render.scene import cast, open_scene, set_variant
from pbrnet.scenes.procedural.niches import BACK, niche_solids
from pbrnet.scenes.procedural.plan import Plan
from pbrnet.scenes.procedural.planning import make_plan
from pbrnet.scenes.seeds import generator
from tests.scenes.procedural import test_homes
from tests.scenes.procedural.test_homes import Home, home_of


def plan_of(seed: int) -> Plan:
    return make_plan(generator(seed, "plan"), 1, 6)


@pytest.fixture(scope="module")
def plans() -> list[Plan]:
    return [plan_of(seed) for seed in range(150)]


@pytest.fixture(scope="module")
def attic(tmp_path_factory: pytest.TempPathFactory) -> Home:
    """A home of two rooms with a slope, roof windows and a niche."""
    return home_of(tmp_path_factory.mktemp("attic"), 1188)


def test_a_fifth_of_the_homes_have_slopes_and_a_sixth_of_the_rooms_niches(
    plans: list[Plan],
) -> None:
    sloping = [plan for plan in plans if plan.slopes]
    assert 0.12 < len(sloping) / len(plans) < 0.3
    assert any(len(plan.slopes) == 2 for plan in sloping)
    rooms = sum(len(plan.rooms) for plan in plans)
    assert 0.1 < sum(len(plan.niches) for plan in plans) / rooms < 0.25


def test_slopes_leave_room_to_stand_and_for_all_openings(plans: list[Plan]) -> None:
    for plan in plans:
        for slope in plan.slopes:
            assert 1.0 <= slope.knee <= 1.6 and 1.0 <= slope.run <= 2.0
            (x, y), (nx, ny) = slope.edge.at(1.0), slope.edge.inward
            assert slope.height_at(x, y) == pytest.approx(slope.knee)
            far = slope.height_at(x + slope.run * nx, y + slope.run * ny)
            assert far == pytest.approx(plan.height)
            assert not plan.beams and plan.stairs is None
        for opening in plan.openings:
            assert plan.free_height(opening.footprint) > opening.z1 + 0.05
        for room in plan.rooms:
            points = np.random.default_rng(0).uniform(*_bounds(room.shape), (100, 2))
            inside = [point for point in points if room.shape.contains(Point(point))]
            high = [plan.free_height(Point(point).buffer(1e-6)) > 1.9 for point in inside]
            assert np.mean(high) > 0.45
        for window in plan.roof_windows:
            assert plan.room(window.room).shape.covers(window.footprint)
            assert window.far < window.slope.run


def _bounds(shape: Polygon) -> tuple[tuple[float, float], tuple[float, float]]:
    x0, y0, x1, y1 = shape.bounds
    return (x0, y0), (x1, y1)


def test_a_ray_upwards_meets_the_slope_at_its_height(attic: Home) -> None:
    set_variant("auto")
    scene = open_scene(attic.scene)
    (slope,) = attic.plan.slopes
    names = [item.id for item in attic.scene.objects]
    rng = generator(0, "points")
    for room in attic.plan.rooms:
        holes = [window.footprint.buffer(0.03) for window in attic.plan.roof_windows]
        holes += [niche.footprint.buffer(0.01) for niche in attic.plan.niches]
        points = rng.uniform(*_bounds(room.shape), (300, 2))
        points = np.array(
            [
                point
                for point in points
                if room.shape.buffer(-0.01).contains(Point(point))
                and not any(hole.contains(Point(point)) for hole in holes)
            ]
        )
        expected = np.minimum(slope.height_at(points[:, 0], points[:, 1]), attic.plan.height)
        origins = np.column_stack([points, expected - 0.02])
        distance, hit = cast(scene, origins, np.tile([0.0, 0.0, 1.0], (len(points), 1)))
        ceiling = np.array([names[index] == f"ceiling-{room.id}" for index in hit])
        assert ceiling.mean() > 0.9  # the others met a lamp or a detector
        assert distance[ceiling] == pytest.approx(0.02, abs=1e-4)


def test_no_view_is_taken_above_the_roof(attic: Home) -> None:
    """Eyes at every height above the low strip are refused above the ceiling."""
    set_variant("auto")
    scene = open_scene(attic.scene)
    (slope,) = attic.plan.slopes
    rng, windows = generator(1, "eyes"), attic.plan.roof_windows
    s, depth = rng.uniform(0.3, slope.edge.length - 0.3, 200), rng.uniform(0.02, 0.4, 200)
    eyes = np.array([slope.edge.at(*each) for each in np.column_stack([s, depth])])
    floor = slope.height_at(eyes[:, 0], eyes[:, 1])
    eyes = np.column_stack([eyes, floor + rng.uniform(0.01, 0.8, 200)])
    apart = [
        not any(one.footprint.buffer(0.1).contains(Point(eye[:2])) for one in windows)
        for eye in eyes
    ]
    close, enclosed = surroundings(scene, eyes[apart], 0.1)
    assert (close | enclosed).all()


def test_an_attic_is_sound(attic: Home) -> None:
    test_homes.test_rooms_are_furnished([attic])
    test_homes.test_nothing_intersects([attic])
    test_homes.test_nothing_floats([attic])
    test_homes.test_rooms_can_be_walked([attic])
    test_homes.test_portals_lie_in_outer_walls_and_face_outdoors([attic])
    test_homes.test_light_enters_a_home_through_portals_only([attic])
    assert any(portal.normal[2] > 0.1 for portal in attic.scene.portals)
    assert attic.scene.source["slopes"] and attic.scene.source["niches"]


def test_niches_are_recesses_that_hold_things(attic: Home, plans: list[Plan]) -> None:
    for plan in plans:
        for niche in plan.niches:
            room = plan.room(niche.room)
            assert room.shape.buffer(1e-3).covers(niche.footprint)
            assert all(niche.footprint.distance(one.footprint) > 0.05 for one in plan.openings)
            a, b, z0, z1 = niche.hole
            levels = (z0, *niche.boards, z1)
            assert niche.s0 < a < b < niche.s1 and min(np.diff(levels)) > 0.25
            filled = np.prod(np.ptp(niche_solids(niche, plan.height), axis=1), axis=1).sum()
            whole = (niche.s1 - niche.s0) * niche.depth * plan.height
            recess = (b - a) * (z1 - z0) * (niche.depth - BACK)
            assert whole - recess - 1e-6 < filled < whole - 0.8 * recess
