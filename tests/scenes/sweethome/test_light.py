"""Light in imported homes: no leaks, lamps as bright as they say, images the right way round."""

import math
from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest
from shapely.geometry import Polygon

from pbrnet.scenes.contract import Scene
from pbrnet.scenes.formats.ply import write_ply
from pbrnet.scenes.geometry.mesh import Mesh
from pbrnet.scenes.photometry import LUMEN
from pbrnet.scenes.registry import import_scene
from pbrnet.scenes.sweethome.building.slabs import triangulated
from tests.fixtures import sweethome as draw

pytestmark = pytest.mark.usefixtures("variant")

SIDE = 24  # pixels


def bring(folder: Path, xml: str, members: dict[str, str | bytes] | None = None,
          **options: object) -> Scene:  # fmt: skip
    folder.mkdir(exist_ok=True)
    return import_scene(draw.pack(folder / "test.sh3d", xml, members), folder / "out", **options)


def loaded(scene: Scene, blocked: bool = False) -> object:
    """The Mitsuba scene; `blocked` puts two black boards, too large, into every portal.

    Two, as rays may slip between the two triangles of one.
    """
    text = scene.xml.read_text()
    boards = []
    for portal in scene.portals if blocked else ():
        points = np.array(portal.polygon)
        middle = points.mean(axis=0)
        axes = np.stack([np.cross([0, 0, 1.0], portal.normal), [0, 0, 1.0]])
        flat = (points - middle) @ axes.T
        for margin, along in ((0.03, 0.0), (0.04, 0.01)):
            vertices, faces = triangulated(Polygon(flat).buffer(margin, join_style="mitre"))
            name = f"meshes/board-{portal.id}-{margin}.ply"
            points = middle + vertices @ axes + along * np.array(portal.normal)
            write_ply(scene.folder / name, Mesh(points, faces))
            boards.append(f'<shape type="ply"><string name="filename" value="{name}"/>'
                          '<bsdf type="twosided"><bsdf type="diffuse">'
                          '<rgb name="reflectance" value="0"/></bsdf></bsdf></shape>')  # fmt: skip
    path = scene.folder / "boarded.xml"
    path.write_text(text.replace("</scene>", "".join(boards) + "</scene>"))
    return mi.load_file(str(path), optimize=False, parallel=False)


def looks(scene: object, eye: tuple[float, float, float], spp: int = 32) -> np.ndarray:
    """Images all around from `eye`: six views of 90 degrees, (6, SIDE, SIDE, 3)."""
    made = []
    for number, way in enumerate(np.concatenate([np.eye(3), -np.eye(3)]).tolist()):
        up = [0, 1, 0] if way[2] else [0, 0, 1]
        sensor = mi.load_dict({
            "type": "perspective", "fov": 90, "near_clip": 0.001,
            "to_world": mi.ScalarTransform4f().look_at(
                list(eye), (np.array(eye) + way).tolist(), up),
            "film": {"type": "hdrfilm", "width": SIDE, "height": SIDE, "rfilter": {"type": "box"},
                     "pixel_format": "rgb", "component_format": "float32"},
        })  # fmt: skip
        integrator = mi.load_dict({"type": "path", "max_depth": 12})
        made.append(np.asarray(mi.render(scene, sensor=sensor, integrator=integrator, spp=spp,
                                         seed=number)))  # fmt: skip
    return np.stack(made)


def middle_of(scene: Scene, number: int) -> tuple[float, float, float]:
    room = scene.rooms[number]
    point = Polygon(room.floor).representative_point()
    return (point.x, point.y, 0.6 * room.floor_z + 0.4 * room.ceiling_z)


WINDOW = draw.window(x=200, y=0)


@pytest.mark.slow
def test_a_home_without_light_is_black(tmp_path: Path) -> None:
    # Rooms with a window, a wall that only touches, a gap of a centimetre at a corner.
    walls = (
        draw.box_walls(0, 0, 420, 320)
        + draw.wall("touching", (210, 10), (210, 309), thickness=10)
        + WINDOW
        + draw.window(x=420, y=160, angle=math.pi / 2)
    )
    rooms = draw.room(10, 10, 195, 300) + draw.room(215, 10, 195, 300)
    scene = bring(tmp_path, draw.home(walls + rooms), lamps="off")
    assert len(scene.portals) == 2
    open_, closed = loaded(scene), loaded(scene, blocked=True)
    for number in range(2):
        eye = middle_of(scene, number)
        assert looks(open_, eye).mean() > 1e-3
        assert looks(closed, eye, spp=128).max() == 0


@pytest.mark.slow
def test_two_storeys_without_light_are_black(tmp_path: Path) -> None:
    levels = "".join(
        f"<level id='{name}' name='{name}' elevation='{up}' floorThickness='12' height='250'/>"
        for name, up in (("low", 0), ("high", 262))
    )
    body = levels + "".join(
        draw.box_walls(0, 0, 420, 320, tag=level, level=level)
        + draw.room(10, 10, 400, 300, level=level)
        for level in ("low", "high")
    )
    stairs = draw.piece(name="stairs", level="low", x=200, y=160, width=100, depth=200, height=262,
                        staircaseCutOutShape=draw.FULL)  # fmt: skip
    lamp = draw.lamp(x=60, y=60, elevation=100, level="low")
    dark = bring(tmp_path, draw.home(body + stairs), lamps="off")
    for number in range(2):
        assert looks(loaded(dark), middle_of(dark, number), spp=128).max() == 0
    # A lamp below shines up the stairwell, and only there.
    lit = bring(tmp_path, draw.home(body + stairs + lamp), time="0:00", lamps="home")
    assert looks(loaded(lit), middle_of(lit, 1)).mean() > 0
    closed = bring(tmp_path, draw.home(body + lamp), time="0:00", lamps="home")
    assert looks(loaded(closed), middle_of(closed, 0)).mean() > 0
    assert looks(loaded(closed), middle_of(closed, 1), spp=128).max() == 0


def test_a_lamp_lights_its_closed_room_alone(tmp_path: Path) -> None:
    walls = draw.box_walls(0, 0, 420, 320) + draw.wall("between", (210, 0), (210, 320))
    rooms = draw.room(10, 10, 190, 300) + draw.room(220, 10, 190, 300)
    lamp = draw.lamp(x=100, y=160, elevation=150)
    scene = bring(tmp_path, draw.home(walls + rooms + lamp), lamps="home")
    made = loaded(scene)
    assert looks(made, (0.5, -2.5, 1.2)).mean() > 1e-4
    assert looks(made, middle_of(scene, 1), spp=128).max() == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "Studio",
        "Sample",
        pytest.param("1-BedroomApartment", marks=pytest.mark.check),
        pytest.param("3-BedroomApartment", marks=pytest.mark.check),
        pytest.param("4-BedroomHouse", marks=pytest.mark.check),
    ],
)
def test_a_real_home_without_light_is_black(name: str, shared_scenes: Path, tmp_path: Path) -> None:
    scene = import_scene(shared_scenes / "homes" / f"{name}.sh3d", tmp_path / "out", lamps="off")
    bright = looks(loaded(scene), middle_of(scene, 1), spp=4)
    assert bright.mean() > 1e-5
    closed = loaded(scene, blocked=True)
    for number in range(len(scene.rooms)):
        seen = looks(closed, middle_of(scene, number), spp=16)
        assert seen.max() == 0, scene.rooms[number].name


def test_illuminance_below_a_lamp(tmp_path: Path) -> None:
    # 1000 lm all around, 2 m above a white floor between black walls: 1000 / (4 pi 2^2) lux.
    black = {"leftSideColor": "FF000000", "rightSideColor": "FF000000"}
    xml = draw.home(
        draw.box_walls(0, 0, 420, 320, **black)
        + draw.room(10, 10, 400, 300, floorColor="FFFFFFFF", ceilingColor="FF000000")
        + draw.lamp(x=210, y=160, elevation=190)
    )
    scene = bring(tmp_path, xml)
    sensor = mi.load_dict({
        "type": "perspective", "fov": 4, "near_clip": 0.001,
        "to_world": mi.ScalarTransform4f().look_at([2.1, -1.6, 1.0], [2.1, -1.6, 0], [0, 1, 0]),
        "film": {"type": "hdrfilm", "width": 8, "height": 8, "rfilter": {"type": "box"},
                 "pixel_format": "rgb", "component_format": "float32"},
    })  # fmt: skip
    # From lamp to floor to eye: black paint, too, reflects a little.
    integrator = mi.load_dict({"type": "path", "max_depth": 2})
    seen = np.asarray(mi.render(loaded(scene), sensor=sensor, integrator=integrator, spp=256))
    luminance = (seen.reshape(-1, 3) @ [0.2126, 0.7152, 0.0722]).mean()
    lux = luminance * math.pi / 0.82 / LUMEN
    assert lux == pytest.approx(1000 / (4 * math.pi * 4), rel=0.02)


def test_images_stand_upright_in_true_size(tmp_path: Path) -> None:
    def tile(attribute: str) -> str:
        return (f"<texture attribute='{attribute}' name='tile' width='100' height='100' "
                "image='tile'/>")  # fmt: skip

    both = tile("leftSideTexture") + tile("rightSideTexture")
    xml = draw.home(
        draw.box_walls(0, 0, 420, 320, inside=both)
        + draw.room(10, 10, 400, 300, tile("floorTexture") + tile("ceilingTexture"))
    )
    scene = loaded(bring(tmp_path, xml, {"tile": draw.quadrants()}))

    def color(origin: tuple[float, ...], way: tuple[float, ...]) -> str:
        hit = scene.ray_intersect(mi.Ray3f(list(origin), list(way)))  # type: ignore[attr-defined]
        value = hit.bsdf().eval_diffuse_reflectance(hit, True)
        red, green, blue = (float(np.asarray(value[band]).ravel()[0]) > 0.5 for band in range(3))
        names = {(1, 0, 0): "red", (0, 1, 0): "green", (0, 0, 1): "blue", (1, 1, 1): "white"}
        return names[red, green, blue]

    down, up, north, south = (0, 0, -1), (0, 0, 1), (0, 1, 0), (0, -1, 0)
    # Floor: metre tiles from the plan's origin, the image's top to the north.
    assert color((1.25, -0.25, 1), down) == "red"
    assert color((1.75, -0.25, 1), down) == "green"
    assert color((1.25, -0.75, 1), down) == "blue"
    assert color((1.75, -0.75, 1), down) == "white"
    # Ceiling: the same seen in a mirror, so that it reads from below.
    assert color((1.25, -0.25, 1), up) == "blue"
    assert color((1.75, -0.75, 1), up) == "green"
    # The north wall from inside: from its inner corner at x = 0.1 on, west is left.
    assert color((0.35, -1, 0.75), north) == "red"
    assert color((0.85, -1, 0.75), north) == "green"
    assert color((0.35, -1, 0.25), north) == "blue"
    # From outside west is right: red lies east of green.
    assert color((0.15, 1, 0.75), south) == "green"
    assert color((0.65, 1, 0.75), south) == "red"


@pytest.mark.slow
def test_a_sloping_ceiling_leaves_no_gap(tmp_path: Path) -> None:
    # The east wall is a metre lower than the west one; north and south slope between them. The
    # plan is no rectangle, so that inner corners lie off the walls' ends.
    corners = [(0, 0), (420, 60), (420, 320), (0, 320)]
    slopes = [(350, 250), (250, 250), (250, 350), (350, 350)]
    walls = "".join(
        draw.wall(
            f"w{number}",
            corners[number],
            corners[(number + 1) % 4],
            wallAtStart=f"w{(number - 1) % 4}",
            wallAtEnd=f"w{(number + 1) % 4}",
            height=slopes[number][0],
            heightAtEnd=slopes[number][1],
        )
        for number in range(4)
    )
    scene = bring(tmp_path, draw.home(walls + draw.window(x=210, y=320)), lamps="off")
    assert looks(loaded(scene), middle_of(scene, 0)).mean() > 1e-3
    closed = loaded(scene, blocked=True)
    for eye in ((1.0, -1.6, 1.0), (3.0, -1.6, 2.3), (0.4, -2.8, 2.9)):
        assert looks(closed, eye, spp=128).max() == 0


def test_an_open_door_between_two_dark_rooms_lights_neither(tmp_path: Path) -> None:
    walls = draw.box_walls(0, 0, 420, 320) + draw.wall("between", (210, 0), (210, 320))
    rooms = draw.room(10, 10, 190, 300) + draw.room(220, 10, 190, 300)
    door = draw.piece("doorOrWindow", name="door", x=210, y=160, angle=math.pi / 2, width=90,
                      depth=20, height=205)  # fmt: skip
    body = walls + rooms + door
    dark = bring(tmp_path / "dark", draw.home(body), lamps="home")
    assert [room.has_light for room in dark.rooms] == [False, False]
    window = draw.window(x=100, y=0)
    day = bring(tmp_path / "day", draw.home(body + window), time="12:00", lamps="home")
    assert [room.has_light for room in day.rooms] == [True, True]
    night = bring(tmp_path / "night", draw.home(body + window), time="0:00", lamps="home")
    assert [room.has_light for room in night.rooms] == [False, False]


def test_rooms_without_light_are_named_and_filled(tmp_path: Path) -> None:
    body = draw.box_walls(-10, -10, 520, 420) + draw.room(0, 0, 500, 400, name="Cellar")
    dark = bring(tmp_path, draw.home(body), lamps="home")
    assert not dark.rooms[0].has_light and not any(light.kind == "area" for light in dark.lights)
    assert any("--lamps fill" in note and "Cellar" in note for note in dark.changes)
    # A closed white box: the walls see the lamp's light, and nothing else.
    assert looks(loaded(dark), (2.5, -2.0, 1.5), spp=8).mean() == 0
    lit = bring(tmp_path, draw.home(body))
    (lamp,) = [light for light in lit.lights if light.kind == "area"]
    assert lit.rooms[0].has_light and lamp.room == lit.rooms[0].id
    assert lamp.lumens == pytest.approx(150 * 5 * 4)
    assert not any("--lamps fill" in note for note in lit.changes)
    assert looks(loaded(lit), (2.5, -2.0, 1.5), spp=8).mean() > 0
