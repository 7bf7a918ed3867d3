"""SpatialLM's text: exact rooms, openings and boxes, fronts, and refused lines."""

from itertools import pairwise
from pathlib import Path

import pytest
from shapely.geometry import Polygon

from pbrnet.scenes.errors import InputError
from pbrnet.scenes.layout.layout import Layout
from pbrnet.scenes.layout.readers import spatiallm
from tests.fixtures.layout_formats import SPATIALLM
from tests.fixtures.paths import ROOT


def read(text: str) -> Layout:
    return spatiallm.read(text, Path("plan.txt"))


def test_rooms_are_what_walls_enclose() -> None:
    assert spatiallm.recognises(SPATIALLM)
    layout = read(SPATIALLM)
    assert [sorted(room.polygon) for room in layout.rooms] == [
        sorted([(0, 0), (4, 0), (4, 3), (0, 3)]),
        sorted([(4, 0), (6, 0), (6, 3), (4, 3)]),
    ]
    assert all(Polygon(room.polygon).exterior.is_ccw for room in layout.rooms)
    assert layout.height == 2.5
    assert layout.rooms[0].type == "living"  # it holds a sofa


def test_the_example_has_a_living_room_and_a_bedroom_with_eleven_boxes() -> None:
    layout = read((ROOT / "examples" / "flat.spatiallm.txt").read_text())
    assert [room.type for room in layout.rooms] == ["living", "bedroom"]
    assert (len(layout.openings), len(layout.objects)) == (4, 11)


def test_openings_stand_above_the_floor() -> None:
    inner, outer, window = read(SPATIALLM).openings
    assert (inner.kind, outer.kind, window.kind) == ("door", "entrance", "window")
    assert (inner.start, inner.end) == ((4.0, pytest.approx(1.05)), (4.0, pytest.approx(1.95)))
    assert (inner.bottom, inner.top) == (0, 2)
    assert (window.bottom, window.top) == (pytest.approx(0.9), pytest.approx(1.9))


def test_objects_have_their_backs_to_walls_and_chairs_face_tables() -> None:
    layout = read(SPATIALLM)
    sofa, table, chair, rug, strange = layout.objects
    assert (sofa.category, sofa.yaw) == ("sofa", 0)  # front to -y, away from the wall at y = 3
    assert sofa.center == (2, 2.55, pytest.approx(0.4))
    assert (chair.category, chair.yaw) == ("chair", 180)  # front to +y, where the table is
    assert table.category == "table"
    assert rug.category == "rug"
    assert rug.size[2] > 0
    assert strange.category == "other"
    assert strange.yaw % 180 == pytest.approx(45, abs=1e-4)
    assert any("wobble" in change for change in layout.changes)


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("__import__('os').system('true')", "line 17: expected a line such as wall_0=Wall"),
        ("wall_9=Wall(__import__('os'),0,0,0,0,0,0,0)", "line 17: expected a line"),
        ("wall_9=Wall(0,0,0,4,0,0,2.5)", "line 17: a wall has 8 values, got 7"),
        ("wall_9=Wall(0,0,0,nan,0,0,2.5,0)", "line 17: expected a number, got 'nan'"),
        ("wall_9=Wall(0,0,0,1e400,0,0,2.5,0)", "line 17: expected a number"),
        ("wall_9=Door(0,0,0,4,0,0,2.5,0)", "line 17: expected a line"),
        ("wall_0=Wall(0,0,0,4,0,0,2.5,0)", "wall_0 is there twice"),
        ("door_9=Door(0,0,0,1,1,2)", "the first value of a door is its wall"),
        ("bbox_9=Bbox(<b>,0,0,0,0,1,1,1)", "no name of a category"),
    ],
)
def test_lines_that_are_no_entity_are_refused(line: str, told: str) -> None:
    with pytest.raises(InputError, match=r"plan\.txt: line") as caught:
        read(SPATIALLM + line)
    assert told in str(caught.value)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("wall_0=Wall(0,0,0,4,0,0,2.5,0)\nwall_1=Wall(4,0,0,4,4,0,2.5,0)", "enclose no room"),
        ("bbox_0=Bbox(sofa,2,2.5,1.9,0,2,0.9,0.8)", "no line of a wall"),
        ("\n".join(f"wall_{n}=Wall(0.5,{n},0,9,0,0,2.5,0)" for n in range(601)), "at most 600"),
        ("wall_0=Wall(2,2,2,132,2,2,136,0)", "bins of the model's own output"),
    ],
)
def test_texts_without_a_plan_are_refused(text: str, told: str) -> None:
    with pytest.raises(InputError, match=told):
        read(text)


def test_openings_of_missing_walls_are_named() -> None:
    layout = read(SPATIALLM + "door_7=Door(wall_77,4,1.5,2.5,0.9,2.0)")
    assert len(layout.openings) == 3
    assert any("door_7" in change for change in layout.changes)


def test_a_room_inside_another_is_left_out_and_named() -> None:
    outer = [(0, 0), (8, 0), (8, 8), (0, 8), (0, 0)]
    inner = [(3, 3), (5, 3), (5, 5), (3, 5), (3, 3)]
    ends = [pair for ring in (outer, inner) for pair in pairwise(ring)]
    lines = [f"wall_{n}=Wall({a},{b},0,{c},{d},0,2.5,0)" for n, ((a, b), (c, d)) in enumerate(ends)]
    layout = read("\n".join(lines))
    assert [Polygon(room.polygon).area for room in layout.rooms] == [64]
    assert any("4.0 square metres inside another" in change for change in layout.changes)
