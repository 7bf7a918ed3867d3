"""Kinds of buildings that others write and that are easily misread: axes, boxes, scans, studios."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from shapely.geometry import Polygon

from pbrnet.pipeline.cli import cli
from pbrnet.scenes.contract import Scene, load_scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.importing.changes import UNSURE_SCALE, UNSURE_UP
from pbrnet.scenes.models.placement import chosen_scale
from pbrnet.scenes.reconstruction.raycast import RayCaster
from pbrnet.scenes.reconstruction.rooms import with_visible_space
from pbrnet.scenes.reconstruction.scale_clues import ScaleEstimate
from pbrnet.scenes.registry import import_scene
from tests.fixtures.buildings import (
    Building,
    Part,
    block,
    chair,
    part,
    slab,
    sofa,
    two_rooms,
    wall,
    walls,
)
from tests.fixtures.rooms import Block, write_obj

pytestmark = pytest.mark.usefixtures("few_walks")

WIDTH, DEPTH, HEIGHT = 4.0, 3.0, 2.5


def sheet(*corners: tuple[float, float, float]) -> np.ndarray:
    return np.array([corners])


def sheets() -> dict[str, np.ndarray]:
    """A room of six sheets, lower than it is deep, as a scan or a plain model has it."""
    w, d, h = WIDTH, DEPTH, HEIGHT
    return {
        "Floor": sheet((0, 0, 0), (w, 0, 0), (w, d, 0), (0, d, 0)),
        "Ceiling": sheet((0, 0, h), (0, d, h), (w, d, h), (w, 0, h)),
        "Wall_South": sheet((0, 0, 0), (0, 0, h), (w, 0, h), (w, 0, 0)),
        "Wall_North": sheet((0, d, 0), (w, d, 0), (w, d, h), (0, d, h)),
        "Wall_West": sheet((0, 0, 0), (0, d, 0), (0, d, h), (0, 0, h)),
        "Wall_East": sheet((w, 0, 0), (w, 0, h), (w, d, h), (w, d, 0)),
    }


def imported(parts: list[Part], folder: Path, **how: str) -> Scene:
    building = Building(tuple(parts), (), 0, **how)
    return import_scene(building.save(folder / "in"), folder / "out", lamps="home")


def areas(scene: Scene) -> list[float]:
    return [Polygon(room.floor).area for room in scene.rooms]


def test_names_of_floors_ceilings_and_walls_tell_what_is_up(tmp_path: Path) -> None:
    scene = imported([Part(*each) for each in sheets().items()], tmp_path, up="z", suffix=".obj")
    assert scene.source["placement"]["up"] == "z"
    assert areas(scene) == [pytest.approx(12.0, rel=0.03)]
    found = {item.name: item.category for item in scene.objects}
    assert (found["Floor"], found["Ceiling"], found["Wall_West"]) == ("floor", "ceiling", "wall")


def unnamed(parts: list[Part]) -> list[Part]:
    return [Part("", np.concatenate([each.quads for each in parts]))]


@pytest.mark.parametrize("up", ["y", "z"])
def test_what_rests_on_something_tells_what_is_up_without_names(tmp_path: Path, up: str) -> None:
    things = [sofa(0.6, 0.5), chair(3.0, 1.0), part("", ((1, 2, 0), (2, 2.5, 0.8)))]
    parts = unnamed([*(Part(*each) for each in sheets().items()), *things])
    scene = imported(parts, tmp_path, up=up, suffix=".obj")
    assert scene.source["placement"]["up"] == up
    assert not any(UNSURE_UP in change for change in scene.changes)


def test_a_room_without_names_and_things_may_lie_on_its_side(tmp_path: Path) -> None:
    parts = unnamed([Part(*each) for each in sheets().items()])
    made = Building(tuple(parts), (), 0, up="z", suffix=".obj")
    path, out = made.save(tmp_path / "in"), tmp_path / "out"
    result = CliRunner().invoke(cli, ["import", str(path), "--out", str(out)])
    assert result.exit_code == 1 and UNSURE_UP in result.output and "--up z" in result.output
    again = CliRunner().invoke(
        cli, ["import", str(path), "--out", str(tmp_path / "turned"), "--up", "z"]
    )
    assert again.exit_code == 0 and areas(load_scene(tmp_path / "turned")) == [
        pytest.approx(12.0, rel=0.03)
    ]


def test_a_gltf_file_against_its_standard_is_doubted(tmp_path: Path) -> None:
    parts = [Part(*each) for each in sheets().items()]
    for up, is_doubted in (("y", False), ("z", True)):
        scene = imported(parts, tmp_path / up, up=up, suffix=".glb")
        placement = scene.source["placement"]
        assert placement["up"] == "y"
        assert any("--up z" in reason for reason in placement["reasons"]) == is_doubted
        assert (placement["confidence"] < 0.5) == is_doubted


@pytest.mark.parametrize(("name", "size"), [("house", 2.0), ("mesh", 4.0)])
def test_what_may_be_a_building_is_no_object_without_a_warning(
    tmp_path: Path, name: str, size: float
) -> None:
    """A house without a floor, and a scan of two walls of a room."""
    parts = walls(size, size, 0.5 * size, without="ew")
    quads = np.concatenate([each.quads for each in parts])
    path = Building((Part(name, quads),), (), 0, suffix=".glb").save(tmp_path)
    command = ["import", str(path), "--out", str(tmp_path / "out"), "--scale", "1"]
    done = CliRunner().invoke(cli, command)
    assert done.exit_code == 1 and "NO ROOM WAS FOUND: the file was taken for" in done.output


def test_the_reason_for_the_axis_of_an_object_agrees_with_it(tmp_path: Path) -> None:
    parts = [Part("floor", sheets()["Floor"])]  # level in Z, yet an object by default stands in Y
    placement = imported(parts, tmp_path, up="z").source["placement"]
    assert placement["kind"] == "object" and placement["up"] == "y"
    assert placement["reasons"][0].startswith("+Y points up")


def test_a_scan_with_a_part_of_its_ceiling_is_one_whole_room(tmp_path: Path) -> None:
    parts = sheets()
    parts["Ceiling"] = parts["Ceiling"] * [0.4, 0.5, 1]
    scene = imported([Part("", np.concatenate(list(parts.values())))], tmp_path, suffix=".glb")
    assert areas(scene) == [pytest.approx(12.0, rel=0.03)] and not scene.portals
    assert any("rooms open above got a ceiling: 1" in change for change in scene.changes)


@pytest.mark.parametrize("t", [0.16, 0.0001])
def test_boxes_of_windows_and_doors_are_cut_out_of_boxes_of_walls(tmp_path: Path, t: float) -> None:
    """As RoomPlan writes a room: everything is a box, what is in a wall lies inside its box.

    Its later versions write walls of a tenth of a millimetre.
    """
    boxes = {
        "Floor0": ((0, 0, -t), (5, 4, 0)),
        "Wall0": ((-t, -t, 0), (5 + t, 0, 2.5)),
        "Wall1": ((-t, 4, 0), (5 + t, 4 + t, 2.5)),
        "Wall2": ((-t, 0, 0), (0, 4, 2.5)),
        "Wall3": ((5, 0, 0), (5 + t, 4, 2.5)),
        "Window0": ((1.5, -t, 0.9), (2.9, 0, 2.1)),
        "Door0": ((1, 4, 0), (1.9, 4 + t, 2.1)),
        "Opening0": ((-t, 1, 0), (0, 2.5, 2.2)),
    }
    parts = [Part(name, block(*ends)) for name, ends in boxes.items()]
    scene = imported(parts, tmp_path, suffix=".glb")
    assert areas(scene) == [pytest.approx(20.0, rel=0.03)]
    assert sorted(portal.kind for portal in scene.portals) == ["opening", "window"]
    window = next(portal for portal in scene.portals if portal.kind == "window")
    assert np.ptp(window.polygon, axis=0) == pytest.approx([1.4, 0, 1.2], abs=0.1)
    found = {item.name: (item.category, item.is_structure) for item in scene.objects}
    assert found["Door0"][0] == "door" and "Window0" not in found
    assert any("walls were cut" in change for change in scene.changes)
    assert sum(item.category == "wall" for item in scene.objects) >= 4


def test_a_wall_that_its_door_fills_is_no_shape(tmp_path: Path) -> None:
    parts = sheets()
    fills = block((1, -0.1, 0), (2, 0, 2.1))
    made = [*(Part(*each) for each in parts.items()), Part("Wall9", fills), Part("Door9", fills)]
    scene = imported(made, tmp_path, suffix=".glb")
    assert areas(scene) == [pytest.approx(12.0, rel=0.03)]
    names = {item.name for item in scene.objects}
    assert "Door9" in names and "Wall9" not in names


def test_walls_without_a_floor_get_one(tmp_path: Path) -> None:
    """As RoomPlan's first version wrote a room, with an opening that is a gap."""
    t = 0.16
    boxes = {
        "Wall0": ((-t, -t, 0), (5 + t, 0, 2.5)),
        "Wall1": ((-t, 4, 0), (5 + t, 4 + t, 2.5)),
        "Wall2": ((-t, 0, 0), (0, 4, 2.5)),
        "Wall3": ((5, 0, 0), (5 + t, 3, 2.5)),
        "Table0": ((1, 1, 0), (2.2, 1.8, 0.75)),
    }
    parts = [Part(name, block(*ends)) for name, ends in boxes.items()]
    scene = imported(parts, tmp_path, suffix=".glb")
    assert areas(scene) == [pytest.approx(20.0, rel=0.03)]
    assert scene.rooms[0].floor_z == pytest.approx(0, abs=0.01)
    assert any("walls without a floor" in change for change in scene.changes)


def test_the_terrace_around_an_open_house_is_no_room(tmp_path: Path) -> None:
    t = 0.2
    boxes = {
        "base": ((-0.9, 0, -0.2), (6.9, 5.1, 0)),
        "south": ((0, 0, 0), (6, t, 2.5)),
        "north": ((0, 4, 0), (6, 4 + t, 2.5)),
        "west": ((0, 0, 0), (t, 4, 2.5)),
        "east": ((6 - t, 0, 0), (6, 4, 2.5)),
    }
    scene = imported([Part(n, block(*ends)) for n, ends in boxes.items()], tmp_path, suffix=".glb")
    assert areas(scene) == [pytest.approx(5.6 * 3.8, rel=0.03)]


@pytest.mark.slow
def test_lights_around_a_diorama_are_not_its_size(tmp_path: Path) -> None:
    diorama = [
        Block("base", (0, 0, -0.1), (4, 4, 0)),
        Block("back", (0, 3.9, 0), (4, 4, 2.6)),
        Block("side", (0, 0, 0), (0.1, 4, 2.6)),
        Block("television", (1, 3.7, 1), (2.2, 3.8, 1.7)),
        Block("plane", (-18, -18, -0.2), (22, 22, -0.15)),
    ]
    lights = [Block(f"Area.{x}", (x, 2, 6), (x + 2, 4, 6.05), 20.0) for x in (-12, 12)]
    rooms = []
    for name, blocks in (("alone", diorama), ("lit", [*diorama, *lights])):
        path = write_obj(tmp_path / name / "scene.obj", blocks)
        scene = import_scene(path, tmp_path / name / "out", up="z", scale=1.0)
        rooms.append(areas(scene))
        assert not any("NO ROOM" in change for change in scene.changes)
    assert rooms[0] == pytest.approx(rooms[1], rel=0.01)


def hall(*beams: Part) -> list[Part]:
    window = walls(8, 5, 2.8, south=[(2, 4, 0.9, 2.2)])
    return [slab("Floor", 8, 5, -0.2, 0), slab("Ceiling", 8, 5, 2.8, 3.0), *window, *beams]


BEAMS = {
    "one": ([(3.9, 4.2)], 2.3),
    "two": ([(2.5, 2.8), (5.3, 5.6)], 2.4),
    "joists": ([(x, x + 0.15) for x in np.arange(0.4, 7.8, 0.6).tolist()], 2.5),
}


@pytest.mark.parametrize("name", BEAMS)
def test_beams_below_a_ceiling_part_no_room(tmp_path: Path, name: str) -> None:
    spans, z = BEAMS[name]
    beams = [part("Beam", ((west, 0, z), (east, 5, 2.8))) for west, east in spans]
    scene = imported(hall(*beams), tmp_path, suffix=".glb")
    assert areas(scene) == [pytest.approx(40.0, rel=0.03)]
    assert [portal.kind for portal in scene.portals] == ["window"]


@pytest.mark.parametrize("has_backdrop", [False, True])
def test_a_room_ends_at_its_windows_though_no_pane_is_in_them(has_backdrop: bool) -> None:
    """A ceiling of tilted panels is no level one, so that the room is what a camera sees."""
    edges = np.arange(-0.2, 8.2, 0.5).tolist()
    panels = [sheet((x, -0.2, 3), (x + 0.5, -0.2, 3.1), (x + 0.5, 6.2, 3.1), (x, 6.2, 3))
              for x in edges]  # fmt: skip
    windows = walls(
        8, 6, 3.0, south=[(0.5, 2.5, 0.9, 2.4), (3, 5, 0.9, 2.4)], west=[(2, 4, 0, 2.4)]
    )
    parts = [slab("Floor", 8, 6, -0.2, 0), *windows, Part("Panels", np.concatenate(panels))]
    parts += [Part("Backdrop", block((-40, -40, -0.5), (40, 40, 20)))] if has_backdrop else []
    quads = np.concatenate([each.quads for each in parts])
    corners = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    (room,) = with_visible_space(RayCaster(corners), corners, [], np.array([4.0, 3.0, 1.5]))
    assert room.floor.area == pytest.approx(48.0, rel=0.02)
    assert room.guessed and room.ceiling_z == pytest.approx(3.05, abs=0.06)


@pytest.mark.parametrize("has_ceiling", [True, False])
def test_a_doorway_without_a_lintel_parts_two_rooms(tmp_path: Path, has_ceiling: bool) -> None:
    """As in floor plans drawn upwards: gaps from floor to ceiling, or walls that are open above."""
    building = two_rooms((1.5, 2.4, 0.0, 2.7))
    parts = [each for each in building.parts if has_ceiling or each.name != "Ceiling"]
    scene = imported(parts, tmp_path, suffix=".glb")
    assert sorted(areas(scene)) == [pytest.approx(area, rel=0.03) for area in (12.0, 16.0)]
    assert [portal.kind for portal in scene.portals] == ["window"]
    assert all(room.has_light for room in scene.rooms)


def test_a_closet_of_an_open_plan_is_no_outdoors(tmp_path: Path) -> None:
    outer = walls(6, 4, 2.5, south=[(2.5, 4.0, 0.9, 2.1)])
    closet = [
        wall("Wall closet", (1.6, 0), (1.7, 1.5), 2.5, [(0.3, 1.1, 0.0, 2.05)]),
        wall("Wall closet", (0, 1.5), (1.7, 1.6), 2.5),
    ]
    scene = imported([slab("Floor", 6, 4, -0.2, 0), *outer, *closet], tmp_path, suffix=".glb")
    whole = 24.0 - 1.7 * 1.6
    assert sorted(areas(scene)) == [pytest.approx(area, rel=0.03) for area in (2.4, whole)]
    assert [portal.kind for portal in scene.portals] == ["window"]


def test_a_hollow_wall_of_an_open_room_is_not_the_room(tmp_path: Path) -> None:
    """A thick wall, modelled without its inner side where a window is."""
    hollow = [
        Part("Wall east", block((5, -0.2, -0.2), (5.8, 4.2, 4.5), without="w")),
        Part("Wall east", block((5, 0, 0), (5.01, 1, 4.5))),
        Part("Wall east", block((5, 3, 0), (5.01, 4, 4.5))),
    ]
    parts = [slab("Floor", 5, 4, -0.2, 0), *walls(5, 4, 3.5, without="es"), *hollow]
    scene = imported(parts, tmp_path, suffix=".glb")
    assert max(areas(scene)) == pytest.approx(20.0, rel=0.1)


def test_floors_and_walls_are_known_in_other_languages(tmp_path: Path) -> None:
    names = {"Floor": "Sol", "Ceiling": "Plafond", "South": "Mur_sud"}
    parts = [Part(names.get(name, names.get(name[5:], name)), quads)
             for name, quads in sheets().items()]  # fmt: skip
    scene = imported(parts, tmp_path, up="z", suffix=".obj")
    assert scene.source["placement"]["up"] == "z"
    assert not any(UNSURE_UP in change for change in scene.changes)
    found = {item.name: item.category for item in scene.objects}
    assert (found["Sol"], found["Plafond"], found["Mur_sud"]) == ("floor", "ceiling", "wall")


def test_short_walls_are_walls_and_wall_art_is_not(tmp_path: Path) -> None:
    things = [
        part("wall_3_18", ((2, 1, 0), (2.1, 1.8, 1.2))),
        part("wall art", ((1, 2.8, 1), (2.8, 2.85, 1.4))),
    ]
    scene = imported(
        [*(Part(*each) for each in sheets().items()), *things], tmp_path, suffix=".glb"
    )
    found = {item.name: (item.category, item.is_structure) for item in scene.objects}
    assert found["wall_3_18"] == ("wall", True) and found["wall art"] == ("other", False)


def test_backs_of_furniture_on_a_rug_are_no_walls(tmp_path: Path) -> None:
    panels = [("TV", ((0.65, -0.1, 0), (2.85, 0, 1.5))),
              ("Sofa", ((0.65, 5.0, 0), (2.85, 5.1, 1.5))),
              ("Shelf", ((-0.1, 1, 0), (0, 2, 1.5)))]  # fmt: skip
    parts = [part("Living_Rug", ((0, 0, -0.02), (3.5, 5, 0))),
             *(part(f"Living_{name}", ends) for name, ends in panels)]  # fmt: skip
    made = Building(tuple(parts), (), 0, suffix=".glb", name="livingroom")
    with pytest.raises(InputError, match="a room needs 50%"):
        import_scene(made.save(tmp_path / "in"), tmp_path / "out")


def test_neighbouring_scales_are_one_answer() -> None:
    def chosen(*candidates: tuple[float, float], stated: float | None = 1.0) -> tuple[float, float]:
        return chosen_scale(ScaleEstimate(candidates, 1.0, 0.0), stated)

    scale, share = chosen((0.003, 0.43), (0.0036, 0.19), (0.0025, 0.17))
    assert 0.0028 < scale < 0.0032 and share == pytest.approx(0.79)
    assert chosen((0.01, 0.45), (0.0125, 0.3)) == (0.01, pytest.approx(0.75))
    assert chosen((0.1, 0.37), (0.01, 0.32), (0.0254, 0.1))[0] == 0.0


def kinds(scene: Scene) -> set[str]:
    return {item.category for item in scene.objects if item.is_structure}


def test_floor_ceiling_and_walls_in_one_mesh_are_told_apart(tmp_path: Path) -> None:
    parts = [Part("Room", np.concatenate(list(sheets().values())))]
    scene = imported(parts, tmp_path, suffix=".glb")
    assert {"floor", "ceiling", "wall"} <= kinds(scene)
    size = {item.category: np.subtract(item.bbox_max, item.bbox_min) for item in scene.objects}
    assert size["floor"] == pytest.approx([WIDTH, DEPTH, 0], abs=0.01)
    assert size["wall"] == pytest.approx([WIDTH, DEPTH, HEIGHT], abs=0.01)


def test_one_floor_below_six_rooms_is_a_floor(tmp_path: Path) -> None:
    parts = [
        *walls(9.4, 6.2, 2.5),
        *(wall("Inner", (x, 0), (x + 0.2, 6.2), 2.5) for x in (3, 6.2)),
        *(wall("Cross", (x, 3), (x + 3, 3.2), 2.5) for x in (0, 3.2, 6.4)),
        Part("Mesh.001", slab("", 9.4, 6.2, -0.1, 0).quads),
        Part("Mesh.002", slab("", 9.4, 6.2, 2.5, 2.6).quads),
    ]
    scene = imported(parts, tmp_path, suffix=".glb")
    found = {item.name: item.category for item in scene.objects}
    assert len(scene.rooms) == 6
    assert (found["Mesh.001"], found["Mesh.002"]) == ("floor", "ceiling")


def test_a_carpet_as_large_as_a_hall_is_its_floor(tmp_path: Path) -> None:
    parts = {name: quads * [2, 2, 1] for name, quads in sheets().items() if name != "Floor"}
    carpet = Part("Carpet", sheets()["Floor"] * [2, 2, 1])
    scene = imported([carpet, *(Part(*each) for each in parts.items())], tmp_path, suffix=".glb")
    found = {item.name: item.category for item in scene.objects}
    assert found["Carpet"] == "floor"


def divided(quads: np.ndarray, count: int) -> np.ndarray:
    """Quads (N, 4, 3), each divided into `count` by `count`."""
    a, b, c, d = (quads[:, None, None, k] for k in range(4))
    u, v = np.meshgrid(np.arange(count + 1) / count, np.arange(count + 1) / count)
    u, v = u[None, ..., None], v[None, ..., None]
    grid = (1 - u) * (1 - v) * a + u * (1 - v) * b + u * v * c + (1 - u) * v * d
    cells = [grid[:, :-1, :-1], grid[:, :-1, 1:], grid[:, 1:, 1:], grid[:, 1:, :-1]]
    return np.stack(cells, axis=3).reshape(-1, 4, 3)


def test_finely_divided_walls_are_walls(tmp_path: Path) -> None:
    """An open box whose faces are all much lower than its walls, as in scans."""
    parts = sheets()
    del parts["Ceiling"]
    quads = divided(np.concatenate(list(parts.values())), 12)
    scene = imported([Part("Cube.001", quads)], tmp_path, suffix=".glb")
    assert areas(scene) == [pytest.approx(12.0, rel=0.03)]
    assert scene.rooms[0].ceiling_z - scene.rooms[0].floor_z == pytest.approx(HEIGHT, abs=0.05)


def test_a_stated_unit_that_is_less_likely_than_another_is_doubted(tmp_path: Path) -> None:
    """Halls of hundreds of metres, as metres are stated; centimetres are as likely, and more."""
    parts = [Part("", quads * [40, 50, 3.0]) for quads in sheets().values()]
    scene = imported(parts, tmp_path, suffix=".glb")
    assert any(UNSURE_SCALE in change and "--scale" in change for change in scene.changes)
