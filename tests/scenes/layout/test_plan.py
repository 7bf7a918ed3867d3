"""Walls and openings of layouts: analytic faces, thicknesses and places."""

import math

import numpy as np
import pytest
from shapely.geometry import Polygon

from pbrnet.scenes.errors import InputError
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.layout.building.walls import straightened
from tests.fixtures.layouts import FLAT, changed, checked, planned

TWO = [{"id": "a", "rectangle": [0, 0, 4, 3]}, {"id": "b", "rectangle": [4, 0, 7, 3]}]


def bounds(plan: object, number: int) -> tuple[float, ...]:
    return Polygon(plan.rooms[number].polygon).bounds  # type: ignore[attr-defined]


def test_rooms_that_touch_step_back_by_half_a_wall() -> None:
    plan = planned(changed(rooms=TWO, openings=[], objects=[], wall=0.1))
    assert bounds(plan, 0) == pytest.approx((0, 0, 3.95, 3))
    assert bounds(plan, 1) == pytest.approx((4.05, 0, 7, 3))
    assert Polygon(plan.outline).bounds == pytest.approx((-0.3, -0.3, 7.3, 3.3))


def test_rooms_that_are_apart_keep_their_faces() -> None:
    apart = [TWO[0], TWO[1] | {"rectangle": [4.2, 0, 7, 3]}]
    plan = planned(changed(rooms=apart, openings=[], objects=[]))
    assert bounds(plan, 0) == pytest.approx((0, 0, 4, 3))
    assert bounds(plan, 1) == pytest.approx((4.2, 0, 7, 3))


def test_centre_lines_are_the_middle_of_outer_walls_too() -> None:
    plan = planned(changed(rooms=TWO, openings=[], objects=[], polygons="centre", outer_wall=0.4))
    assert bounds(plan, 0) == pytest.approx((0.2, 0.2, 3.94, 2.8))
    assert Polygon(plan.outline).bounds == pytest.approx((-0.2, -0.2, 7.2, 3.2))


def test_a_courtyard_is_open_and_a_part_apart_has_walls_of_its_own() -> None:
    ring = [
        {"rectangle": [0, 0, 9, 3]},
        {"rectangle": [0, 3, 3, 6]},
        {"rectangle": [6, 3, 9, 6]},
        {"rectangle": [0, 6, 9, 9]},
        {"rectangle": [20, 0, 24, 4]},
    ]
    plan = planned(changed(rooms=ring, openings=[], objects=[]))
    part, yard = plan.further
    assert Polygon(part).exterior.is_ccw and not Polygon(yard).exterior.is_ccw
    assert Polygon(yard).area == pytest.approx(2.4 * 2.52, abs=1e-6)
    assert plan.covered.area == pytest.approx(9.6 * 9.6 - 2.4 * 2.52 + 4.6 * 4.6, abs=1e-6)


def test_walls_run_at_any_angle() -> None:
    plan = planned(FLAT)
    window = next(one for one in plan.openings if one.id.startswith("window"))
    assert window.width == pytest.approx(1.5) and window.thickness == pytest.approx(0.3, abs=1e-5)
    along = np.subtract(window.end, window.start) / window.width
    assert along == pytest.approx([0.6, 0.8], abs=1e-5)
    assert window.z0 == 0.85 and window.rooms == ("living",)


@pytest.mark.parametrize("turn", [0.0, 17.0, 90.0, 211.0])
def test_a_turned_layout_has_a_turned_plan(turn: float) -> None:
    c, s = math.cos(math.radians(turn)), math.sin(math.radians(turn))

    def turned(x: float, y: float) -> list[float]:
        return [c * x - s * y, s * x + c * y]

    corners = [(0, 0), (4, 0), (4, 3), (0, 3)], [(4, 0), (7, 0), (7, 3), (4, 3)]
    rooms = [{"id": name, "polygon": [turned(*p) for p in ring]}
             for name, ring in zip("ab", corners, strict=True)]  # fmt: skip
    openings = [
        {"kind": "door", "start": turned(4, 1), "end": turned(4, 1.9)},
        {"kind": "window", "start": turned(1, 0), "end": turned(2, 0)},
    ]
    plan = planned(changed(rooms=rooms, openings=openings, objects=[]))
    door, window = plan.openings
    assert [room.shape.area for room in plan.rooms] == pytest.approx([3.94 * 3, 2.94 * 3])
    assert door.thickness == pytest.approx(0.12, abs=1e-5) and door.rooms == ("a", "b")
    assert door.width == pytest.approx(0.9, abs=1e-5) and window.width == pytest.approx(1, abs=1e-5)
    assert window.thickness == pytest.approx(0.3, abs=1e-5)


def test_openings_have_the_kind_that_their_place_asks_for() -> None:
    openings = [
        {"kind": "door", "room": "a", "wall": "west"},
        {"kind": "window", "room": "a", "wall": "south", "bottom": 0},
        {"kind": "window", "between": ["a", "b"], "width": 1},
        {"kind": "opening", "room": "b", "wall": "east"},
    ]
    changes = Changes()
    plan = planned(changed(rooms=TWO, openings=openings, objects=[]), changes)
    assert [one.kind for one in plan.openings] == ["entrance", "patio", "open", "patio"]
    assert len(changes.sentences()) == 2


def test_what_lies_in_no_wall_is_left_out_where_the_layout_is_not_strict() -> None:
    openings = [{"kind": "window", "start": [1, 1.5], "end": [2, 1.5]},
                {"kind": "window", "room": "a", "wall": "south"},
                {"kind": "window", "room": "a", "wall": "south", "width": 1}]  # fmt: skip
    changes = Changes()
    content = changed(rooms=TWO, openings=openings, objects=[], strict=False)
    assert len(planned(content, changes).openings) == 1
    assert "lies in no wall" in changes.sentences()[0] and "overlaps" in changes.sentences()[1]
    with pytest.raises(InputError, match=r"openings\[0\]"):
        planned(content | {"strict": True})


def test_names_that_are_no_file_names_are_replaced() -> None:
    rooms = [TWO[0] | {"id": "../../etc"}, TWO[1] | {"id": "floor", "name": "a\x1b[2J\nb"}]
    plan = planned(changed(rooms=rooms, openings=[], objects=[]))
    assert [room.id for room in plan.rooms] == ["space-0", "space-1"]
    assert plan.rooms[1].name.isprintable()


def test_corners_on_a_straight_wall_go() -> None:
    ring = np.array([[0, 0], [1, 0], [2, 0], [2, 2], [2, 2], [0, 2]], dtype=float)
    assert straightened(ring).tolist() == [[0, 0], [2, 0], [2, 2], [0, 2]]


def test_one_storey_is_built_with_its_floor_at_zero() -> None:
    rooms = [
        TWO[0] | {"floor_z": 3.0},
        TWO[1] | {"floor_z": 3.1},
        {"id": "up", "rectangle": [0, 0, 3, 3], "floor_z": 6.0},
    ]
    objects = [
        {"category": "chair", "room": "a", "at": [1, 1]},
        {"category": "stool", "room": "up", "at": [1, 1]},
        {"category": "bin", "at": [1, 2, 3.0]},
    ]
    content = changed(rooms=rooms, openings=[], objects=objects, strict=False)
    layout = checked(content)
    assert [(room.id, room.floor_z) for room in layout.rooms] == [("a", 0), ("b", 0)]
    heights = {each.category: each.center[2] - 0.5 * each.size[2] for each in layout.objects}
    assert heights == {"chair": pytest.approx(0), "bin": pytest.approx(0)}
    assert len(layout.changes) == 2
    with pytest.raises(InputError, match=r"rooms\[2\].floor_z: on another level"):
        checked(content | {"strict": True})
