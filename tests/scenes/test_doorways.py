"""Doorways without a lintel part the plan of two rooms; passages that are no doorways do not."""

import pytest
from shapely.geometry import Polygon, box

from pbrnet.scenes.geometry.doorways import parts_at_doorways

WALL = 0.15  # metres, from x = 4


def hall(*gaps: tuple[float, float], thick: float = WALL) -> Polygon:
    """A hall of 7 by 4 metres and a wall across it with gaps."""
    plan = box(0, 0, 7, 4)
    edges = [0.0, *(place for gap in gaps for place in gap), 4.0]
    for low, high in zip(edges[::2], edges[1::2], strict=True):
        plan = plan.difference(box(4, low, 4 + thick, high))
    assert isinstance(plan, Polygon)
    return plan


def areas(plan: Polygon) -> list[float]:
    return sorted(part.area for part in parts_at_doorways(plan))


@pytest.mark.parametrize("gap", [(1.5, 2.2), (1.5, 2.7), (0.1, 1.0)])
@pytest.mark.parametrize("thick", [0.06, WALL, 0.4])
def test_a_gap_as_wide_as_a_door_parts_two_rooms(gap: tuple[float, float], thick: float) -> None:
    assert areas(hall(gap, thick=thick)) == pytest.approx([4 * (3 - thick), 16.0], rel=0.02)


def test_two_doorways_in_one_wall_part_two_rooms() -> None:
    assert areas(hall((0.5, 1.4), (2.5, 3.4))) == pytest.approx([11.4, 16.0], rel=0.02)


@pytest.mark.parametrize("gap", [(0.0, 0.9), (3.0, 4.0)])
def test_a_wall_that_ends_a_door_s_width_before_another_parts_two_rooms(
    gap: tuple[float, float],
) -> None:
    assert areas(hall(gap)) == pytest.approx([11.4, 16.0], rel=0.02)


def test_a_wall_at_any_angle_is_parted() -> None:
    turned = hall((1.5, 2.4))
    plan = Polygon([(x - 0.5 * y, 0.5 * x + y) for x, y in turned.exterior.coords])
    assert areas(plan) == pytest.approx([1.25 * 11.4, 1.25 * 16.0], rel=0.02)


@pytest.mark.parametrize(
    "plan",
    [
        hall((1.2, 2.6)),  # a wide passage
        hall((0.0, 0.9), (1.5, 4.0)),  # a short wall that stops before a wall
        hall((0.0, 1.5)),
        hall((1.5, 2.4), thick=1.0),  # a corridor
        box(0, 0, 4, 4).union(box(4, 1.5, 7, 2.5)),  # the mouth of a corridor
        box(0, 0, 4, 4).union(box(4, 1, 5, 3)).difference(box(3.85, 0, 4, 1.5))
        .difference(box(3.85, 2.4, 4, 4)),  # a shower
        box(0, 0, 4, 4).union(box(4, 0, 7, 3)),  # the shape of an L
    ],
)  # fmt: skip
def test_other_narrow_places_part_nothing(plan: Polygon) -> None:
    assert parts_at_doorways(plan) == [plan]
