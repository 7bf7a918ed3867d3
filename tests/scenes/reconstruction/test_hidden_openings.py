"""The search for hidden openings: what it finds, and how it ends where there is none."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from shapely.geometry import box

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.reconstruction import hidden_openings as search
from pbrnet.scenes.reconstruction.aperture_sections import CrossSections
from pbrnet.scenes.reconstruction.raycast import RayCaster
from pbrnet.scenes.reconstruction.rooms import FoundOpening, FoundRoom
from tests.fixtures.buildings import Part, slab, walls

WIDTH, DEPTH, HEIGHT = 4.0, 3.0, 2.5
ROOM = FoundRoom(box(0, 0, WIDTH, DEPTH), 0.0, HEIGHT)
HOLE = (1.5, 2.3, 0.9, 1.5)  # from, to, low, high of an opening in the south wall, metres


def triangles(parts: list[Part]) -> Float64Array:
    quads = np.concatenate([part.quads for part in parts])
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


@cache
def shell(is_open: bool) -> tuple[RayCaster, CrossSections]:
    """A room with a hole in a wall, or without that wall and without a ceiling."""
    floor = slab("Floor", WIDTH, DEPTH, -0.1, 0)
    if is_open:
        parts = [floor, *walls(WIDTH, DEPTH, HEIGHT, without="s")]
    else:
        ceiling = slab("Ceiling", WIDTH, DEPTH, HEIGHT, HEIGHT + 0.1)
        parts = [floor, ceiling, *walls(WIDTH, DEPTH, HEIGHT, south=[HOLE])]
    corners = triangles(parts)
    return RayCaster(corners), CrossSections(corners)


def found(is_open: bool) -> list[FoundOpening]:
    rays, sections = shell(is_open)
    return search.hidden_openings(rays, sections, [ROOM], [])


def test_a_hole_that_was_missed_is_found_where_it_is() -> None:
    openings = found(is_open=False)
    assert openings
    for opening in openings:
        low, high = opening.polygon.min(axis=0), opening.polygon.max(axis=0)
        assert low[[0, 2]] == pytest.approx([HOLE[0], HOLE[2]], abs=0.06)
        assert high[[0, 2]] == pytest.approx([HOLE[1], HOLE[3]], abs=0.06)
        assert -0.25 <= low[1] <= high[1] <= 0.01


@pytest.mark.parametrize("most", [3, 8])
def test_the_search_in_an_open_room_ends_after_a_number_of_sections(
    monkeypatch: pytest.MonkeyPatch, most: int
) -> None:
    monkeypatch.setattr(search, "_MOST_FRUITLESS", most)
    monkeypatch.setattr(search, "_LEAST_FRUITLESS", 1)
    computed = 0
    wants = search._Search.wants

    def counted(self: Any, *arguments: Any, **names: Any) -> bool:
        nonlocal computed
        wanted = wants(self, *arguments, **names)
        computed += wanted
        return wanted

    monkeypatch.setattr(search._Search, "wants", counted)
    openings = found(is_open=True)
    assert 0 < computed <= most + len(openings)
