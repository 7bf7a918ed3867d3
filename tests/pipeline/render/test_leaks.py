"""Light leak detection: finds the gaps of a building that let light through, and only those."""

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from pbrnet.pipeline.render.leaks import find_leaks
from pbrnet.pipeline.render.scene import open_scene
from pbrnet.scenes.contract import Portal, Scene, load_scene, save_scene
from pbrnet.scenes.params import SceneParams
from pbrnet.scenes.procedural.home import make_home
from pbrnet.scenes.reconstruction.light_walks import OpeningIndex, diffuse_bounce
from pbrnet.scenes.registry import import_scene
from tests.fixtures.command import printed
from tests.fixtures.gltf import Builder
from tests.fixtures.leak import ROOM, box_quads, built, west
from tests.fixtures.stages import write_room

pytestmark = pytest.mark.usefixtures("variant")

SIZE = (4.0, 3.0, 2.6)
EAST = ((4.0, 0.0, 0.0), (4.0, 3.0, 0.0), (4.0, 3.0, 2.6), (4.0, 0.0, 2.6))


def room(folder: Path, without: str = "", portals: tuple[Portal, ...] = ()) -> Scene:
    """A closed room; without the wall `without`, if given; with these portals."""
    scene = write_room(folder, size=SIZE)
    file = folder / "scene.xml"
    tree = ElementTree.parse(file)
    for shape in tree.getroot().findall("shape"):
        if shape.get("id") == without:
            tree.getroot().remove(shape)
    tree.write(file)
    kept = tuple(thing for thing in scene.objects if thing.id != without)
    save_scene(folder, replace(scene, objects=kept, portals=portals))
    return load_scene(folder)


def test_a_closed_room_is_dark(tmp_path: Path) -> None:
    assert find_leaks(open_scene(room(tmp_path / "closed")), walks=500) == []


def test_a_missing_wall_is_found_and_a_portal_in_it_mends_it(tmp_path: Path) -> None:
    (leak,) = find_leaks(open_scene(room(tmp_path / "open", "wall-e")), walks=500)
    assert leak.room == "living" and leak.share > 0.3
    assert all(-0.01 <= value <= most + 0.01 for value, most in zip(leak.point, SIZE, strict=True))
    _x, y, z = np.array(leak.point) + (4.0 - leak.point[0]) / leak.direction[0] * np.array(
        leak.direction
    )
    assert leak.direction[0] > 0 and 0 <= y <= 3 and 0 <= z <= 2.6, "it points at the missing wall"
    assert "living" in str(leak)

    whole = Portal("gap", "opening", EAST, (1.0, 0.0, 0.0), True, "living")
    assert find_leaks(open_scene(room(tmp_path / "mended", "wall-e", (whole,))), walks=500) == []
    low = tuple((x, y, 0.9 * z) for x, y, z in EAST)
    half = replace(whole, polygon=low)
    (left,) = find_leaks(open_scene(room(tmp_path / "half", "wall-e", (half,))), walks=2000)
    assert 0 < left.share < leak.share


def test_portals_block_what_crosses_them_and_nothing_else() -> None:
    portal = Portal("p", "window", EAST, (1.0, 0.0, 0.0), True)
    origins = np.array([[2.0, 1.5, 1.0]] * 4)
    ways = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [1 / np.sqrt(2), 0, 1 / np.sqrt(2)]])
    far, near = np.full(4, np.inf), np.full(4, 1.0)
    index = OpeningIndex((portal,))
    assert index.crossed(origins, ways, far).tolist() == [True, False, False, False]
    assert not index.crossed(origins, ways, near).any(), "something stands before it"


def test_inspect_says_where_light_leaks(tmp_path: Path) -> None:
    room(tmp_path / "open", "ceiling")
    told = printed("inspect", tmp_path / "open", "--leaks", "--text-only")
    assert "light leaks into living" in told
    room(tmp_path / "closed")
    told = printed("inspect", tmp_path / "closed", "--leaks", "--text-only")
    assert "no light gets in" in told


@pytest.mark.slow
def test_light_enters_a_real_room_by_its_windows(shared_scenes: Path, tmp_path: Path) -> None:
    """Windows at the back of niches that reach the floor, a fireplace without a flue, panelling
    that misses the wall by millimetres: an enclosure closes the fireplace and the gaps."""
    file = shared_scenes / "mitsuba" / "grey-white-room" / "scene.xml"
    scene = open_scene(import_scene(file, tmp_path / "room"))
    assert [portal.kind for portal in scene.scene.portals] == ["window"] * 4
    for portal in scene.scene.portals:
        depth = np.array(portal.polygon) @ portal.normal
        assert 0.4 < depth.mean() < 0.6, "at the sash, not at the wall's face"
    assert any("enclosure" in change for change in scene.scene.changes)
    assert any("up a fireplace" in change for change in scene.scene.changes)
    assert find_leaks(scene, walks=50_000) == []
    bare = replace(scene, scene=replace(scene.scene, portals=()))
    (leak,) = find_leaks(bare)
    assert leak.share > 0.2, "without portals the windows are leaks"


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, pytest.param(8, marks=pytest.mark.check)])
def test_procedural_homes_are_dark(tmp_path: Path, seed: int) -> None:
    params = SceneParams(rooms_min=3, rooms_max=4, texture_size=64)
    scene = make_home(tmp_path / "home", "home", params.home(seed, "day"))
    leaks = find_leaks(open_scene(scene), walks=2000)
    assert not leaks, str(leaks[0])


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    ["1-BedroomApartment", pytest.param("4-BedroomHouse", marks=pytest.mark.check), "Sample"],
)
def test_homes_that_people_drew_are_dark(shared_scenes: Path, tmp_path: Path, name: str) -> None:
    scene = import_scene(shared_scenes / "homes" / f"{name}.sh3d", tmp_path / name)
    leaks = find_leaks(open_scene(scene), walks=1000)
    assert not leaks, str(leaks[0])


@pytest.mark.slow
def test_a_house_of_the_release_is_dark(shared_scenes: Path, tmp_path: Path) -> None:
    """Its outer doors stand ajar, and each portal fills the frame, the leaf's shadow too."""
    (file,) = (shared_scenes / "pbrs").glob("*/main_template_color.xml")
    scene = open_scene(import_scene(file, tmp_path / "house", root=shared_scenes / "pbrs"))
    for portal in scene.scene.portals:
        if portal.kind == "door":
            low, high = np.min(portal.polygon, axis=0), np.max(portal.polygon, axis=0)
            assert 0.69 < np.hypot(*(high - low)[:2]) < 0.75, "as wide as the frame is clear"
    assert find_leaks(scene) == []


def test_a_model_of_a_building_is_dark_but_for_its_window(tmp_path: Path) -> None:
    """A glTF room of 5 x 4 x 2.7 m whose wall at z = 0 has a hole of 1 x 1 m."""
    x, y, z = 5.0, 2.7, 4.0
    points = [(0, 0, 0), (x, 0, 0), (x, y, 0), (0, y, 0), (0, 0, z), (x, 0, z), (x, y, z),
              (0, y, z), (2, 1, 0), (3, 1, 0), (3, 2, 0), (2, 2, 0)]  # fmt: skip
    quads = [(0, 4, 5, 1), (3, 2, 6, 7), (0, 3, 7, 4), (1, 5, 6, 2), (4, 7, 6, 5),
             (0, 1, 9, 8), (1, 2, 10, 9), (2, 3, 11, 10), (3, 0, 8, 11)]  # fmt: skip
    faces = [index for a, b, c, d in quads for index in (a, b, c, a, c, d)]
    made = Builder()
    paint = made.add("materials", {"doubleSided": True})
    made.node(mesh=made.mesh(np.array(points, dtype=float), faces, material=paint), name="shell")
    scene = open_scene(import_scene(made.save(tmp_path / "flat.glb"), tmp_path / "flat"))
    (portal,) = scene.scene.portals
    low, high = np.min(portal.polygon, axis=0), np.max(portal.polygon, axis=0)
    assert 1 <= (high - low)[2] < 1.15
    assert find_leaks(scene, walks=1000) == []
    bare = replace(scene, scene=replace(scene.scene, portals=()))
    assert [leak.room for leak in find_leaks(bare, walks=1000)] == [portal.room]


def test_a_window_at_the_back_of_a_niche(tmp_path: Path) -> None:
    """The niche is 0.4 m deep and reaches the floor; the portal is at its back, not in the wall."""
    quads = box_quads((0, 0, 0), ROOM, "w") + west(0.0, (1.2, 2.6), (0.0, 2.2), ROOM)
    quads += box_quads((-0.4, 1.2, 0), (0, 2.6, 2.2), "we")
    quads += [
        tuple((x, y + 1.2, z) for x, y, z in quad)  # type: ignore[misc]
        for quad in west(-0.4, (0.3, 1.1), (0.9, 1.9), (5.0, 1.4, 2.2))
    ]
    scene = built(tmp_path, quads)
    (portal,) = scene.scene.portals
    low, high = np.min(portal.polygon, axis=0), np.max(portal.polygon, axis=0)
    assert low[0] == pytest.approx(-0.4, abs=0.06), "one cut is every 4 cm"
    assert np.abs(low[1:] - (1.5, 0.9)).max() < 0.06 and np.abs(high[1:] - (2.3, 1.9)).max() < 0.06
    assert find_leaks(scene) == []


@pytest.mark.parametrize("degrees", [25.0, 50.0])
def test_a_door_that_stands_ajar(tmp_path: Path, degrees: float) -> None:
    """The hole is 0.9 m wide in a wall 0.1 m thick, the leaf swings out: the portal is the hole."""
    hole = ((1.5, 2.4), (0.0, 2.05))
    quads = box_quads((0, 0, 0), ROOM, "w") + west(0.0, *hole, ROOM) + west(-0.1, *hole, ROOM)
    quads += box_quads((-0.1, 1.5, 0), (0, 2.4, 2.05), "we")
    turn = np.radians(degrees)
    end = (-0.1 - 0.88 * np.sin(turn), 1.51 + 0.88 * np.cos(turn))
    quads.append(((-0.1, 1.51, 0.01), (*end, 0.01), (*end, 2.04), (-0.1, 1.51, 2.04)))
    scene = built(tmp_path, quads)
    (portal,) = scene.scene.portals
    low, high = np.min(portal.polygon, axis=0), np.max(portal.polygon, axis=0)
    assert portal.kind == "door" and portal.normal[0] == pytest.approx(-1)
    assert np.abs(low[1:] - (1.5, 0.0)).max() < 0.06 and np.abs(high[1:] - (2.4, 2.05)).max() < 0.06
    assert -0.11 < low[0] < 0.01
    assert find_leaks(scene) == []


def test_a_hole_that_nobody_looks_through(tmp_path: Path) -> None:
    """A fireplace of 0.8 x 0.4 m that is open at the top: no straight way leads out of the wall."""
    quads = box_quads((0, 0, 0), ROOM, "w") + west(0.0, (1.6, 2.4), (0.0, 0.7), ROOM)
    quads += box_quads((-0.4, 1.6, 0), (0, 2.4, 1.1), "et")
    scene = built(tmp_path, quads)
    (portal,) = scene.scene.portals
    low, high = np.min(portal.polygon, axis=0), np.max(portal.polygon, axis=0)
    assert portal.kind == "opening" and portal.normal == pytest.approx((0, 0, 1))
    assert 0.7 <= low[2] <= 1.1, "where the shaft is narrowest: above the fire's opening"
    assert np.abs(low[:2] - (-0.4, 1.6)).max() < 0.06 and np.abs(high[:2] - (0, 2.4)).max() < 0.06
    assert find_leaks(scene) == []


def test_a_walk_never_steps_behind_the_next_surface() -> None:
    """In a crease it continues from its own segment, in front of the surface that it hit."""
    origins, ways = np.array([[0.0, 0.0, 1.0]]), np.array([[0.6, 0.0, -0.8]])
    rng = np.random.default_rng(0)
    start, onward = diffuse_bounce(
        origins, ways, np.array([1.25]), np.array([[0.0, 0.0, -1.0]]), rng
    )
    assert start[0, 2] == pytest.approx(1e-4) and start[0, 0] == pytest.approx(0.75 * (1 - 1e-4))
    assert onward[0, 2] > 0 and np.linalg.norm(onward) == pytest.approx(1)
