"""pbrnet's own layouts: what may be left out, and errors with key and line."""

import json
from pathlib import Path
from typing import Any

import pytest

from pbrnet.scenes.errors import InputError
from pbrnet.scenes.layout.importer import import_layout
from pbrnet.scenes.layout.options import LayoutOptions
from pbrnet.scenes.opened_files import OpenedFiles
from tests.fixtures.layouts import FLAT, changed, checked, write_layout


def test_what_is_left_out_has_a_usual_value() -> None:
    layout = checked(FLAT)
    assert [(room.id, room.type) for room in layout.rooms] == [
        ("living", "living"),
        ("bath", "bathroom"),
    ]
    door, entrance, _, window = layout.openings
    assert (door.bottom, door.top) == (0, 2.05)
    assert entrance.start == pytest.approx((0, 1.525)) and entrance.end == pytest.approx((0, 2.475))
    assert window.start[1] == window.end[1] == 6.5 and window.top == 2.15
    table, bowl, toilet, _ = layout.objects
    assert table.center == pytest.approx((1.6, 1.4, 0.37))
    assert bowl.center[2] == pytest.approx(0.74 + 0.07) and bowl.on == "table"
    assert toilet.size == (0.38, 0.67, 0.85) and toilet.yaw == -90


def test_usual_words_mean_categories() -> None:
    words = ("tv", "dresser", "night table", "thing of its own")
    sized = [{"category": word, "at": [1.0, 1.0], "size": [0.4, 0.4, 0.4]} for word in words]
    found = [one.category for one in checked({**FLAT, "objects": sized}).objects]
    assert found == ["television", "chest", "night table", "thing of its own"]


def test_a_door_between_two_rooms_lies_in_the_wall_they_share() -> None:
    door = checked(FLAT).openings[0]
    assert (door.start, door.end) == ((pytest.approx(0.375), 4), (pytest.approx(1.225), 4))


def with_room(**keys: Any) -> dict[str, Any]:
    rooms = [FLAT["rooms"][0] | keys, FLAT["rooms"][1]]
    return changed(rooms=rooms, openings=[], objects=[])


def with_opening(**keys: Any) -> dict[str, Any]:
    return changed(openings=[{"kind": "door", **keys}])


def with_object(**keys: Any) -> dict[str, Any]:
    return changed(objects=[{"category": "chair", "at": [1, 1], **keys}])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (changed(rooms=[], openings=[]), "rooms: there is none"),
        (changed(room=[]), "room: unknown key; did you mean 'rooms'"),
        (changed(style="gothic"), "style: 'gothic' is not one of"),
        (changed(height=0), "height: 0 is not from 1.8 to 20"),
        (changed(rooms=FLAT["rooms"] * 200), r"rooms: 400 are too many"),
        (changed(rooms=FLAT["rooms"] * 2), "rooms: the id 'living' is used 2 times"),
        (with_room(polygon=[[0, 0], [4, 4], [4, 0], [0, 4]]), r"rooms\[0\].polygon: Self-inter"),
        (with_room(polygon=[[0, 0], [4, 0]]), r"rooms\[0\].polygon: 2 corners"),
        (with_room(polygon=[[0, 0], [4, 0], [4, 5], [0, 5]]), r"rooms\[1\].polygon: overlaps"),
        (with_room(polygon=[[0, 0], [1e9, 0], [4, 5]]), r"rooms\[0\].polygon\[1\]\[0\]: 1000000"),
        (with_room(polygon=None), r"rooms\[0\]: give it either a polygon or a rectangle"),
        (with_room(rectangle=[0, 0, 0.1, 9], polygon=None), r"rooms\[0\].polygon: no floor is left|"
                                                            r"rooms\[1\].polygon: overlaps"),
        (with_opening(), r"openings\[0\]: give it start and end"),
        (with_opening(start=[8, 8], end=[9, 8]), r"openings\[0\]: the door .* lies in no wall"),
        (with_opening(between=["living", "attic"]), r"openings\[0\]: 'attic' is the id of no room"),
        (with_opening(room="bath", wall="north", width=3), r"does not fit into a wall of 2.50 m"),
        (with_opening(start=[1, 0], end=[2, 0], bottom=3, top=2), r"openings\[0\].top: 2 is n"),
        (with_object(size=[1, -1, 1]), r"objects\[0\].size\[1\]: -1.0 is not allowed"),
        (with_object(on="nothing"), r"objects\[0\].on: 'nothing' is the id of no object"),
        (with_object(at=[50, 50]), r"objects\[0\]: the 'chair' lies in no room"),
        (with_object(at=[1]), r"objects\[0\].at: give \[x, y\]"),
        (changed(objects=[{"category": "harp", "at": [1, 1]}]), r"objects\[0\].size: missing"),
    ],
)  # fmt: skip
def test_errors_name_file_line_and_key(
    tmp_path: Path, content: dict[str, Any], message: str
) -> None:
    path = write_layout(tmp_path / "flat.json", content)
    with pytest.raises(InputError, match=rf"flat.json: line \d+: .*(?:{message})") as caught:
        import_layout(path, tmp_path / "out", "out", LayoutOptions(), OpenedFiles(tmp_path))
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_a_door_in_the_wall_of_a_room_without_area_is_an_error(tmp_path: Path) -> None:
    content = with_room(polygon=[[0, 0], [4, 0]])
    room = content["rooms"][0]["id"]
    content["openings"] = [{"kind": "door", "room": room, "wall": "north"}]
    path = write_layout(tmp_path / "flat.json", content)
    with pytest.raises(InputError, match=r"flat\.json"):
        import_layout(path, tmp_path / "out", "out", LayoutOptions(), OpenedFiles(tmp_path))


def test_the_line_is_that_of_the_key(tmp_path: Path) -> None:
    content = with_object(yaw="north")
    path = write_layout(tmp_path / "flat.json", content)
    lines = path.read_text().splitlines()
    number = 1 + next(k for k, line in enumerate(lines) if '"yaw"' in line)
    with pytest.raises(InputError, match=rf"line {number}: objects\[0\].yaw: expected a number"):
        import_layout(path, tmp_path / "out", "out", LayoutOptions(), OpenedFiles(tmp_path))


def test_other_json_is_no_layout(tmp_path: Path) -> None:
    path = tmp_path / "cameras.json"
    path.write_text(json.dumps({"views": []}))
    with pytest.raises(InputError, match="no layout of a known format"):
        import_layout(path, tmp_path / "out", "out", LayoutOptions(), OpenedFiles(tmp_path))
