"""ProcTHOR's houses: Unity's axes, holes along walls, sizes of assets and of types."""

import json
from pathlib import Path
from typing import Any

import pytest

from pbrnet.scenes.errors import InputError
from pbrnet.scenes.layout.readers import procthor
from pbrnet.scenes.procedural.furniture import FURNITURE_KINDS
from pbrnet.scenes.procedural.furniture.things.kinds import THINGS
from tests.fixtures.layout_formats import house, thing


def test_plan_and_openings_are_those_seen_from_above() -> None:
    content = house()
    assert procthor.recognises(content)
    layout = procthor.read(content, Path("house.json"))
    assert [room.type for room in layout.rooms] == ["bedroom", "kitchen"]
    assert set(layout.rooms[0].polygon) == {(0, 0), (4, 0), (4, 3), (0, 3)}
    assert layout.height == 2.8
    inner, entrance, window = layout.openings
    assert (inner.kind, inner.start, inner.end) == ("door", (4, 2.5), (4, 1.6))
    assert (inner.top, inner.open_degrees) == (2.1, 45)
    assert (entrance.kind, entrance.start, entrance.end) == ("entrance", (1, 3), (2.6, 3))
    assert (window.kind, window.start, window.end) == ("window", (0, 1), (0, 2.2))
    assert (window.bottom, window.top) == (0.9, 1.8)


def test_objects_face_what_unity_calls_forward() -> None:
    dresser, vase, bed, picture = procthor.read(house(), Path("house.json")).objects
    assert (dresser.category, dresser.yaw) == ("chest", 180)  # +z is forward: here +y
    assert (bed.category, bed.yaw) == ("bed", 90)  # +x
    assert (picture.category, picture.yaw) == ("picture", 270)  # -x
    assert vase.on == dresser.id
    assert vase.center == (1, 0.3, 0.9)


def test_small_things_are_those_of_their_type() -> None:
    content = house()
    content["objects"] = [thing("Apple_4", 1, 1, 1, 0), thing("Teddy_Bear_1", 2, 1, 1, 0)]
    assert [one.kind for one in procthor.read(content, Path("h.json")).objects] == [
        "apple",
        "teddy",
    ]
    assert {*procthor._TABLE["kinds"].values()} <= THINGS.keys() | FURNITURE_KINDS.keys()
    assert procthor._TABLE["kinds"].keys() <= procthor._TYPES.keys()


def test_usual_sizes_yield_to_the_floor_and_the_wall() -> None:
    dresser, *_ = procthor.read(house(), Path("house.json")).objects
    assert dresser.size == (1.2, pytest.approx(0.44), pytest.approx(0.8))


def test_sizes_of_a_database_of_assets_are_exact(tmp_path: Path) -> None:
    box = {"x": 1.3, "y": 0.8, "z": 0.41}
    database = tmp_path / "asset-database.json"
    database.write_text(json.dumps({"Dresser": [{"assetId": "Dresser_201_1", "boundingBox": box}]}))
    dresser, _, bed, _ = procthor.read(house(), Path("house.json"), database).objects
    assert dresser.size == (1.3, 0.41, 0.8)
    assert bed.size[2] == pytest.approx(0.8)  # not in the database: as without it
    database.write_text(json.dumps({"Dresser": [{"assetId": "Dresser_201_1"}]}))
    with pytest.raises(InputError, match=r"asset-database.json: Dresser\[0\].boundingBox.x"):
        procthor.read(house(), Path("house.json"), database)


@pytest.mark.parametrize(
    ("keys", "value", "told"),
    [
        (("objects", 1, "position", "x"), "left", r"objects\[1\].position.x: expected a number"),
        (("objects", 1, "position", "x"), 1e9, "at most a million"),
        (("rooms", 0, "floorPolygon"), [], r"rooms\[0\].floorPolygon: expected three corners"),
        (("doors", 0, "holePolygon"), 3, r"doors\[0\].holePolygon: expected a list"),
        (("objects", 0, "children"), {"a": 1}, r"objects\[0\].children: expected a list"),
        (("rooms",), [], "house.json: rooms: the house has none"),
        (("walls", 0, "id"), None, r"walls\[0\].id: expected text"),
        (("objects",), [0] * 20_001, "items; at most 20,000"),
    ],
)
def test_wrong_values_are_named_by_key(keys: tuple[Any, ...], value: Any, told: str) -> None:
    content: Any = house()
    place = content
    for key in keys[:-1]:
        place = place[key]
    place[keys[-1]] = value
    assert procthor.recognises(content)
    with pytest.raises(InputError, match=told):
        procthor.read(content, Path("house.json"))


def test_objects_on_objects_end_somewhere() -> None:
    content = house()
    for _ in range(9):
        content["objects"][0] = thing("Box_1", 1, 0.4, 1, 0, children=[content["objects"][0]])
    with pytest.raises(InputError, match="objects on objects"):
        procthor.read(content, Path("house.json"))
