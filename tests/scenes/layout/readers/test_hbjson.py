"""Honeybee's models: units, storeys, openings stated twice, and what is left out."""

from pathlib import Path
from typing import Any

import pytest

from pbrnet.scenes.errors import InputError
from pbrnet.scenes.layout.readers import hbjson
from tests.fixtures.layout_formats import model


def test_the_storey_with_most_rooms_is_read() -> None:
    assert hbjson.recognises(model())
    layout = hbjson.read(model(), Path("house.hbjson"))
    assert [(each.type, each.height) for each in layout.rooms] == [("kitchen", 3), ("hall", 3)]
    assert set(layout.rooms[0].polygon) == {(0, 0), (5, 0), (5, 4), (0, 4)}
    for told in ("First", "skylight", "shades outdoors were left out: 2"):
        assert any(told in change for change in layout.changes)


def test_a_named_storey_is_read_from_its_own_floor() -> None:
    layout = hbjson.read(model(), Path("house.hbjson"), "First")
    assert [(each.type, each.floor_z) for each in layout.rooms] == [("bedroom", 0)]
    with pytest.raises(InputError, match="no storey 'Attic'; it has Ground, First"):
        hbjson.read(model(), Path("house.hbjson"), "Attic")


def test_a_door_that_both_rooms_state_is_there_once() -> None:
    door, window = hbjson.read(model(), Path("house.hbjson")).openings
    assert (door.kind, window.kind) == ("door", "window")
    assert {door.start, door.end} == {(5, 1), (5, 2)}
    assert (window.bottom, window.top) == (pytest.approx(0.9), pytest.approx(2.1))


def test_units_are_converted() -> None:
    content = model()
    content["units"] = "Feet"
    with pytest.raises(InputError, match="no room with a floor"):  # 0.9 m are no room's height
        hbjson.read(content, Path("house.hbjson"))
    for each in content["rooms"]:
        for part in each["faces"]:
            boundary = part["geometry"]["boundary"]
            boundary[:] = [[value / 0.3048 for value in place] for place in boundary]
    layout = hbjson.read(content, Path("house.hbjson"))
    assert layout.rooms[0].height == pytest.approx(3)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda it: it.update(units="Cubits"), "units: expected one of Meters"),
        (lambda it: it.update(rooms=[]), "no room with a floor"),
        (lambda it: it["rooms"][0].update(faces=5), r"rooms\[0\].faces: expected a list"),
        (
            lambda it: it["rooms"][0]["faces"][0]["geometry"].update(boundary=[[0, 0, 0]]),
            "three corners or more",
        ),
        (
            lambda it: it["rooms"][0]["faces"][0]["geometry"]["boundary"][0].append(1),
            "expected a list of 3 numbers",
        ),
    ],
)
def test_models_that_hold_no_room_are_refused(change: Any, told: str) -> None:
    content = model()
    change(content)
    with pytest.raises(InputError, match=told):
        hbjson.read(content, Path("house.hbjson"))
