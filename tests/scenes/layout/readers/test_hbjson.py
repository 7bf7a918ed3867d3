"""Honeybee's models: units, storeys, openings stated twice, and what is left out."""

from pathlib import Path
from typing import Any

import pytest

from pbrnet.scenes.errors import InputError
from pbrnet.scenes.layout.readers import hbjson

Corners = list[list[float]]


def face(name: str, kind: str, corners: Corners, **more: Any) -> dict[str, Any]:
    return {
        "identifier": name,
        "face_type": kind,
        "geometry": {"type": "Face3D", "boundary": corners},
        **more,
    }


def upright(x: float, y0: float, y1: float, z0: float, z1: float) -> Corners:
    """A rectangle in the plane of x."""
    return [[x, y0, z0], [x, y1, z0], [x, y1, z1], [x, y0, z1]]


def room(name: str, x0: float, x1: float, z: float, story: str, **east: Any) -> dict[str, Any]:
    """A room 3 m high from y = 0 to 4; `east` goes into its wall at x1."""
    level = [[x0, 0, 0], [x1, 0, 0], [x1, 4, 0], [x0, 4, 0]]
    floor, ceiling = ([[x, y, z + up] for x, y, _ in level] for up in (0, 3))
    return {
        "identifier": name.replace(" ", "_"),
        "display_name": name,
        "story": story,
        "faces": [
            face(f"{name}-floor", "Floor", floor),
            face(f"{name}-ceiling", "RoofCeiling", ceiling),
            face(f"{name}-east", "Wall", upright(x1, 0, 4, z, z + 3), **east),
            face(f"{name}-west", "Wall", upright(x0, 0, 4, z, z + 3)),
        ],
    }


def opening(name: str, corners: Corners, **more: Any) -> dict[str, Any]:
    return {"identifier": name, "geometry": {"type": "Face3D", "boundary": corners}, **more}


def model() -> dict[str, Any]:
    """Two rooms on the ground that share a door, and one above."""
    kitchen = room("Kitchen", 0, 5, 0, "Ground", doors=[
        opening("door_a", upright(5, 1, 2, 0, 2.1))
    ])  # fmt: skip
    hall = room("Corridor", 5, 8, 0, "Ground", apertures=[
        opening("window", upright(8, 1, 3, 0.9, 2.1))
    ])  # fmt: skip
    hall["faces"][3]["doors"] = [opening("door_b", upright(5, 2, 1, 0, 2.1))]
    hall["faces"][1]["apertures"] = [
        opening("skylight", [[6, 1, 3], [7, 1, 3], [7, 2, 3], [6, 2, 3]])
    ]
    above = room("Bedroom", 0, 5, 3.3, "First")
    return {
        "type": "Model",
        "identifier": "house",
        "units": "Meters",
        "rooms": [kitchen, hall, above],
        "orphaned_shades": [{}, {}],
    }


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
