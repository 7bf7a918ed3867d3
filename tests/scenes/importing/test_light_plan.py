"""Light of imported rooms: what shines decides whether sun and sky are added."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from shapely.geometry import Polygon, box

from pbrnet.scenes.contract import Light, Scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.geometry.mesh import Mesh
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.light.in_rooms import RoomLighting
from pbrnet.scenes.importing.light.plan import LightPlan, RoomLight, light_plan, note_dark_rooms
from pbrnet.scenes.importing.materials.surface import Surface
from pbrnet.scenes.importing.shape import Emitter, Shape, make_object
from pbrnet.scenes.importing.xml_elements import plugin
from pbrnet.scenes.photometry import LUMEN
from pbrnet.scenes.reconstruction.rooms import FoundRoom
from pbrnet.scenes.registry import import_scene
from tests.fixtures import mitsuba_files, pbrt_files
from tests.fixtures.rooms import Block, shell, write_obj

pytestmark = pytest.mark.usefixtures("few_walks")

SOFA = Block("sofa", (1.0, 3.0, 0.0), (3.0, 3.9, 0.8))
SCREEN = Block("television", (4.9, 1.0, 0.8), (4.95, 2.0, 1.4), 300)
STRIP = Block("shelf_edge", (0.5, 3.9, 1.6), (2.5, 3.91, 1.61), 1000)
LAMP = Block("ceiling_lamp", (2.3, 1.8, 2.5), (2.7, 2.2, 2.59), 4000)


def imported(folder: Path, *things: Block, **options: object) -> Scene:
    """A room with `things` through the whole import."""
    path = write_obj(folder / "in" / "room.obj", [*shell(), SOFA, *things])
    return import_scene(path, folder / "out", up="z", **options)


@pytest.mark.parametrize(
    ("things", "reason"),
    [
        ([SCREEN], "screens and other displays"),
        ([STRIP], "lamps give no room more than"),
        ([], "the file has no light"),
    ],
)
def test_what_lights_no_room_gets_a_sky(things: list[Block], reason: str, tmp_path: Path) -> None:
    scene = imported(tmp_path, *things)
    assert {"sun", "sky"} <= {light.kind for light in scene.lights}
    assert any("sun, sky" in change and reason in change for change in scene.changes)
    assert any(each.category == "ground" for each in scene.objects)


def test_a_ceiling_lamp_is_light_enough(tmp_path: Path) -> None:
    scene = imported(tmp_path, LAMP, SCREEN)
    assert {light.kind for light in scene.lights} == {"area"}
    assert not any("sky" in change for change in scene.changes)


def test_rooms_that_no_light_reaches_are_named_with_the_remedy(tmp_path: Path) -> None:
    scene = imported(tmp_path, LAMP)
    (room,) = scene.rooms

    def sentences(**changed: object) -> str:
        changes = Changes()
        note_dark_rooms(replace(scene, **changed), changes)  # type: ignore[arg-type]
        return " ".join(changes.sentences())

    assert sentences() == ""
    assert "--lamps fill hangs lamps there: room_0" in sentences(
        rooms=(replace(room, has_light=False),)
    )
    elsewhere = tuple(replace(light, room="room_9") for light in scene.lights)
    assert scene.portals
    assert "with --lamps fill: room_0" in sentences(lights=elsewhere)
    outside = (*elsewhere, Light("sky", "sky", (), None))
    assert sentences(lights=outside) == ""


def closed_room() -> FoundRoom:
    """A room of 20 square metres."""
    return FoundRoom(box(0, 0, 5, 4), 0.0, 2.5)


def test_lumens_per_floor_area_are_those_of_the_emitters() -> None:
    square = np.array([[1.0, 1, 2], [2, 1, 2], [2, 2, 2], [1, 2, 2]])
    shape = Shape("a", "a", Mesh(square, np.array([[0, 1, 2], [0, 2, 3]])), Surface(None))
    area = {"a": plugin("emitter", "area", radiance=(100 * LUMEN,) * 3)}
    point = plugin("emitter", "point", intensity=(10 * LUMEN,) * 3)
    spot = plugin("emitter", "spot", intensity=(10 * LUMEN,) * 3, cutoff_angle=60.0)
    emitters = [Emitter(point, ("point",), (1, 1, 1)), Emitter(spot, ("spot",), (9, 9, 1))]
    objects = (make_object("a", "a", "lamp", [shape]),)
    (found,) = light_plan(Path(), [shape], area, emitters, objects, [closed_room()]).rooms
    assert found.lamps == pytest.approx((100 * np.pi + 40 * np.pi) / 20)
    assert found.glow == 0
    inside = [Emitter(spot, ("spot",), (1, 1, 1))]
    (found,) = light_plan(Path(), [], {}, inside, (), [closed_room()]).rooms
    assert found.lamps == pytest.approx(2 * np.pi * 0.5 * 10 / 20)
    screen = (make_object("a", "a", "television", [shape]),)
    (found,) = light_plan(Path(), [shape], area, [], screen, [closed_room()]).rooms
    assert (found.lamps, found.glow) == (0, pytest.approx(100 * np.pi / 20))


def test_sky_is_needed_only_where_nothing_shines() -> None:
    dark, lit = RoomLight(5, 200), RoomLight(80, 0)
    assert LightPlan((dark,), 100, 4000, False).needs_sky
    assert LightPlan((), 0, 500, False).needs_sky
    assert not LightPlan((), 1, 0, False).needs_sky
    assert not LightPlan((dark, lit), 1600, 4000, False).needs_sky
    assert not LightPlan((dark,), 100, 4000, True).needs_sky
    sun = Emitter(plugin("emitter", "directional"), ("directional",))
    assert light_plan(Path(), [], {}, [sun], (), [closed_room()]).needs_sky


MITSUBA = """<scene version="3.0.0"><shape type="cube"><emitter type="area">
<rgb name="radiance" value="1"/></emitter></shape></scene>"""


def test_a_mitsuba_scene_gets_a_sky_beside_its_lamps_if_asked_to(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    path = tmp_path / "in" / "scene.xml"
    path.write_text(MITSUBA)
    options = {"scale": 1.0, "up": "z"}
    kinds = [
        {light.kind for light in import_scene(path, tmp_path / f"{sky}", sky=sky, **options).lights}
        for sky in (False, True)
    ]
    assert kinds == [{"area"}, {"area", "sun", "sky"}]
    path.write_text(MITSUBA.replace('<emitter type="area">', "").replace("</emitter>", "").replace(
        '<rgb name="radiance" value="1"/>', ""))  # fmt: skip
    with pytest.raises(InputError, match="--sky"):
        import_scene(path, tmp_path / "none", lamps="home", **options)
    lit = import_scene(path, tmp_path / "lit", **options)
    assert {light.kind for light in lit.lights} == {"sun", "sky", "area"}


@pytest.mark.slow
def test_a_dark_room_of_any_source_gets_a_lamp_if_asked_to(tmp_path: Path) -> None:
    """A closed room as OBJ, Mitsuba and PBRT, whose lamp hangs in free air below its ceiling."""
    beam = Block("beam", (1.5, 1.6, 2.3), (3.5, 2.4, 2.6))
    model = write_obj(tmp_path / "in" / "room.obj", [*shell(has_window=False), SOFA, beam])
    mitsuba = mitsuba_files.write(tmp_path / "mitsuba", mitsuba_files.room())
    pbrt = pbrt_files.write(tmp_path / "pbrt", pbrt_files.room())
    for path, options in ((model, {"up": "z"}), (mitsuba, {}), (pbrt, {})):
        scene = import_scene(path, tmp_path / f"from{path.suffix}", lamps="fill", **options)
        (room,) = scene.rooms
        (lamp,) = [light for light in scene.lights if light.kind == "area"]
        assert room.has_light and lamp.room == room.id
        assert lamp.lumens == pytest.approx(150 * Polygon(room.floor).area, rel=0.01)
        (globe,) = [each for each in scene.objects if each.category == "lamp"]
        assert globe.shapes == lamp.shapes and globe.room == room.id
        assert 0.1 < room.ceiling_z - globe.bbox_max[2] < 0.7
        assert any("got plain ceiling lamps: room_0" in change for change in scene.changes)
        if path is model:
            outside = np.greater(globe.bbox_min, beam.high) | np.less(globe.bbox_max, beam.low)
            assert outside.any()


def test_lamps_that_are_too_weak_leave_a_closed_room_without_light(tmp_path: Path) -> None:
    path = write_obj(tmp_path / "in" / "room.obj", [*shell(has_window=False), SOFA, STRIP])
    dark = import_scene(path, tmp_path / "dark", up="z", lamps="home")
    assert not dark.rooms[0].has_light
    assert any("--lamps fill hangs lamps there: room_0" in change for change in dark.changes)
    assert import_scene(path, tmp_path / "lit", up="z").rooms[0].has_light


def test_a_lamp_in_no_room_lights_the_rooms_that_its_rays_enter() -> None:
    """A point light above a ceiling with a hole, beside a closed room."""

    def level(x: float, y: float, u: float, v: float, z: float) -> list[list[list[float]]]:
        a, b, c, d = [x, y, z], [u, y, z], [u, v, z], [x, v, z]
        return [[a, b, c], [a, c, d]]

    hole = level(0, 0, 1, 4, 2.5) + level(2, 0, 5, 4, 2.5)
    closed = level(5, 0, 10, 4, 2.5)
    corners = np.array(level(0, 0, 10, 4, 0) + hole + closed)
    mesh = Mesh(corners.reshape(-1, 3), np.arange(corners.size // 3).reshape(-1, 3))
    rooms = [FoundRoom(box(0, 0, 5, 4), 0.0, 2.5), FoundRoom(box(5, 0, 10, 4), 0.0, 2.5)]
    lights = (Light("a", "point"),)
    shape = Shape("a", "a", mesh, Surface(None))
    above_hole = RoomLighting([shape], rooms, ["a", "b"], lights, (), [(1.5, 2.0, 2.9)])
    assert "a" in above_hole.lit
    above_closed = RoomLighting([shape], rooms, ["a", "b"], lights, (), [(7.0, 2.0, 2.9)])
    assert "b" not in above_closed.lit
