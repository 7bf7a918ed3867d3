"""Layouts in the formats of others become homes with the rooms, openings and things stated."""

import json
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from shapely.geometry import Polygon

from pbrnet.scenes.errors import InputError
from pbrnet.scenes.registry import import_scene
from tests.fixtures.layout_formats import SPATIALLM, capture, house, model


@pytest.mark.parametrize(
    ("name", "content", "rooms", "portals", "things"),
    [
        ("house.json", house(), {"bedroom": 12, "kitchen": 6}, {"door": 1, "window": 1},
         ("bed", "chest", "vase", "picture")),
        ("room.json", capture(), {"living": 12}, {"door": 1, "window": 1}, ("sofa", "shelf")),
        ("a.hbjson", model(), {"kitchen": 17.7, "other": 10.3}, {"window": 1}, ()),
        ("a.txt", SPATIALLM, {"living": 12, "other": 6}, {"door": 1, "window": 1},
         ("sofa", "table", "chair", "rug")),
    ],
)  # fmt: skip
def test_a_layout_of_others_is_a_furnished_home(
    tmp_path: Path,
    name: str,
    content: Any,
    rooms: dict[str, float],
    portals: dict[str, int],
    things: tuple[str, ...],
) -> None:
    path = tmp_path / name
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    scene = import_scene(path, tmp_path / "out", outdoors="none", licence="CC0-1.0", author="A")
    areas = {room.type: Polygon(room.floor).area for room in scene.rooms}
    assert areas == pytest.approx(rooms, rel=0.08)  # less half of the walls
    assert Counter(portal.kind for portal in scene.portals) == portals
    assert set(things) <= {one.category for one in scene.objects}
    if things:
        assert scene.source["furnishing"]["median_iou"] > 0.9


@pytest.mark.parametrize("name", ["a.json", "a.hbjson", "a.txt"])
def test_other_content_is_refused_with_the_formats_that_are_read(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text('{"rooms": [{"width": 3}], "walls": []}')
    with pytest.raises(InputError, match=r"ProcTHOR.*RoomPlan.*HBJSON.*SpatialLM"):
        import_scene(tmp_path / name, tmp_path / "out")
