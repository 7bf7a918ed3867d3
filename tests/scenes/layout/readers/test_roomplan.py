"""RoomPlan's captures: axes, surfaces, fronts, sections, and refused captures."""

import math
from pathlib import Path
from typing import Any

import pytest
from shapely.geometry import Polygon

from pbrnet.scenes.errors import InputError
from pbrnet.scenes.layout.readers import roomplan
from tests.fixtures.layout_formats import TURN, capture


def turned_back(point: tuple[float, ...]) -> tuple[float, float]:
    """A place on the plan in the frame of the room, in which x is right and y is -z."""
    cos, sin = math.cos(-TURN), math.sin(-TURN)
    return (point[0] * cos - point[1] * sin, point[0] * sin + point[1] * cos)


def test_a_capture_is_upright_and_keeps_its_sizes() -> None:
    assert roomplan.recognises(capture())
    layout = roomplan.read(capture(), Path("room.json"))
    (room,) = layout.rooms
    corners = [turned_back(corner) for corner in room.polygon]
    assert sorted((round(x, 6), round(y, 6)) for x, y in corners) == [
        (-2, -1.5), (-2, 1.5), (2, -1.5), (2, 1.5)
    ]  # fmt: skip
    assert Polygon(room.polygon).exterior.is_ccw
    assert (room.type, layout.height) == ("living", 2.4)
    door, window = layout.openings
    assert (door.kind, door.bottom, door.open_degrees) == ("entrance", 0, 80)
    assert door.top == pytest.approx(2.0)
    assert window.bottom == pytest.approx(1.0)
    assert turned_back(window.start) == pytest.approx((0.4, -1.5))


def test_objects_keep_their_fronts() -> None:
    layout = roomplan.read(capture(), Path("room.json"))
    sofa, shelf, strange = layout.objects
    assert turned_back(sofa.center) == pytest.approx((0, 1.0))
    assert sofa.center[2] == pytest.approx(0.4)
    assert sofa.size == (2, 0.9, 0.8)
    # +z is the front: towards the room's middle, -y of the plan
    assert sofa.yaw == pytest.approx(30.0)
    assert (shelf.category, shelf.size) == ("shelf", (1.0, 0.5, 2.0))
    assert shelf.yaw == pytest.approx((270.0 + 30.0) % 360)
    assert strange.category == "other"
    assert any("hovercraft" in change for change in layout.changes)


def test_a_structure_joins_its_rooms() -> None:
    second = capture()
    for kind in ("walls", "doors", "windows", "objects"):
        for one in second[kind]:
            one["identifier"] += "-second"
            one["transform"][12] += 4.1 * math.cos(TURN)
            one["transform"][14] -= 4.1 * math.sin(TURN)
    second["sections"] = []
    layout = roomplan.read({"rooms": [capture(), second]}, Path("flat.json"))
    assert [round(Polygon(room.polygon).area, 2) for room in layout.rooms] == [12, 12]
    assert [opening.kind for opening in layout.openings][:2] == ["entrance", "door"]


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda room: room["walls"][0].update(transform=[0.0] * 16), "expected a rotation"),
        (lambda room: room["walls"][0].update(transform=[1.0] * 9), "a list of 16 numbers"),
        (lambda room: room["walls"][0].update(dimensions="4"), r"walls\[0\].dimensions"),
        (lambda room: room["walls"].pop(), "enclose no room"),
        (lambda room: room["walls"].clear(), "no wall was captured"),
        (lambda room: room["walls"][0].update(story=1), "walls on 2 storeys"),
        (lambda room: room["objects"][0].update(category=7), r"objects\[0\].category"),
    ],
)
def test_captures_that_hold_no_room_are_refused(change: Any, told: str) -> None:
    content = capture()
    change(content)
    with pytest.raises(InputError, match=told):
        roomplan.read(content, Path("room.json"))
