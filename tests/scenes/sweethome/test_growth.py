"""Work of importing a home grows with its walls and openings, not with their product."""

import math
from collections.abc import Sequence
from pathlib import Path

import pytest
import shapely
from shapely.geometry.base import BaseGeometry

from pbrnet.scenes.geometry.regions import difference, union
from pbrnet.scenes.importing import writer
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.sweethome import pieces
from pbrnet.scenes.sweethome.building import spaces
from pbrnet.scenes.sweethome.building.levels import storeys
from pbrnet.scenes.sweethome.building.openings import Opening, opening_of
from pbrnet.scenes.sweethome.building.walls import build_walls, plan_walls
from pbrnet.scenes.sweethome.reader import read_home
from tests.fixtures import sweethome as draw


def test_a_wall_is_tried_only_with_the_openings_near_it(monkeypatch: pytest.MonkeyPatch) -> None:
    count = 40
    body = "".join(
        draw.wall(f"w{n}", (500 * n, 0), (500 * n + 300, 0)) + draw.window(x=500 * n + 150, y=0)
        for n in range(count)
    )
    changes = Changes()
    home = read_home(Path("row.sh3d"), draw.home(body).encode(), changes)
    (storey,) = storeys(home, (), changes)
    found = [opening_of(piece, 0.0, changes) for piece in storey.pieces]
    openings = [opening for opening in found if opening is not None]
    tried = []
    depths = Opening.depths
    monkeypatch.setattr(Opening, "depths", lambda *given: tried.append(1) or depths(*given))
    items = build_walls(storey, plan_walls(storey, 250.0, changes), openings)
    assert len(items) == len(openings) == len(tried) == count
    solid = 2 * 12  # triangles of two half walls
    assert all(sum(len(part.mesh.faces) for part in item.parts) > solid for item in items)


def test_corners_cut_to_find_rooms_grow_with_the_rooms(monkeypatch: pytest.MonkeyPatch) -> None:
    cut: list[int] = []

    def counted(first: BaseGeometry, second: BaseGeometry) -> BaseGeometry:
        cut.append(shapely.get_num_coordinates(first) + shapely.get_num_coordinates(second))
        return difference(first, second)

    monkeypatch.setattr(spaces, "difference", counted)

    def total(count: int) -> int:
        body = "".join(
            draw.box_walls(500 * n, 0, 420, 320, str(n)) + draw.room(500 * n + 10, 10, 400, 300)
            for n in range(count)
        )
        changes = Changes()
        home = read_home(Path("row.sh3d"), draw.home(body).encode(), changes)
        (storey,) = storeys(home, (), changes)
        cut.clear()
        assert len(spaces.find_spaces(storey, plan_walls(storey, 250.0, changes), [], changes)) == (
            count
        )
        return sum(cut)

    assert total(12) < 4.5 * total(3)


def test_corners_of_a_round_room_grow_with_its_walls(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every wall meets the whole room, which is grown once and cut to the place of each wall."""
    worked_on: list[int] = []

    def counted(first: BaseGeometry | Sequence[BaseGeometry], *rest: BaseGeometry) -> None:
        operands = first if isinstance(first, Sequence) else [first, *rest]
        worked_on.extend(int(shapely.get_num_coordinates(each)) for each in operands)

    for name in ("union", "difference", "intersection", "buffered"):
        operation = getattr(spaces, name)

        def spied(*given: BaseGeometry, call: object = operation, **more: object) -> BaseGeometry:
            counted(*(each for each in given if not isinstance(each, float)))
            return call(*given, **more)  # type: ignore[operator, no-any-return]

        monkeypatch.setattr(spaces, name, spied)
    monkeypatch.setattr(spaces, "_MANY_CORNERS", 12)

    def total(count: int) -> int:
        corners = [
            (1000 * math.cos(2 * math.pi * n / count), 1000 * math.sin(2 * math.pi * n / count))
            for n in range(count)
        ]
        body = "".join(
            draw.wall(f"w{n}", corners[n], corners[(n + 1) % count], wallAtStart=f"w{n - 1}",
                      wallAtEnd=f"w{(n + 1) % count}") for n in range(count)
        )  # fmt: skip
        changes = Changes()
        home = read_home(Path("round.sh3d"), draw.home(body).encode(), changes)
        (storey,) = storeys(home, (), changes)
        worked_on.clear()
        (space,) = spaces.find_spaces(storey, plan_walls(storey, 250.0, changes), [], changes)
        assert space.floor.area == pytest.approx(math.pi * 9.9**2, rel=0.02)
        return sum(worked_on)

    assert total(96) < 4.5 * total(24)


def test_copies_of_levels_walls_and_rooms_take_no_unions(monkeypatch: pytest.MonkeyPatch) -> None:
    united: list[int] = []

    def counted(regions: list[BaseGeometry]) -> BaseGeometry:
        united.append(len(regions))
        return union(regions)

    monkeypatch.setattr(spaces, "union", counted)
    level = (
        "<level id='l' name='n' elevation='0' height='250' floorThickness='12' elevationIndex='0'/>"
    )
    body = draw.box_walls(0, 0, 420, 320, "a") + draw.room(10, 10, 400, 300) + level
    changes = Changes()
    home = read_home(Path("copies.sh3d"), draw.home(body * 100).encode(), changes)
    found = storeys(home, (), changes)
    assert [len(storey.walls) for storey in found] == [4] + 99 * [0]
    assert len(found[0].rooms) == 100
    spaces.find_spaces(found[0], plan_walls(found[0], 250.0, changes), [], changes)
    assert sum(united) < 600
    assert build_walls(found[1], [], []) == []


def test_pieces_of_one_name_are_numbered_in_one_go() -> None:
    class Asked(dict[str, int]):
        times = 0

        def __contains__(self, key: object) -> bool:
            self.times += 1
            return super().__contains__(key)

    for new_id, between in ((pieces._unique, "-"), (writer._material_id, "_")):
        taken = Asked({"chair-3": 1, "material_chair_3": 1})
        first, *others = (new_id("Chair", taken) for _ in range(50))
        assert [other.removeprefix(first) for other in others] == [
            f"{between}{number}" for number in range(2, 52) if number != 3
        ]
        assert taken.times < 3 * 50
