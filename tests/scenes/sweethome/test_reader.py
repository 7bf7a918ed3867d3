"""Sweet Home 3D homes: placement and measures, computed by hand from the application's rules."""

import math
from dataclasses import replace
from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest
import trimesh
from shapely.geometry import Point

from pbrnet.scenes.assets.piece import LightSource
from pbrnet.scenes.contract import Scene
from pbrnet.scenes.files import digest_folder
from pbrnet.scenes.formats.obj_model import read_model_materials, read_obj_model
from pbrnet.scenes.importing.categories import category_of_piece, room_type
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.photometry import LUMEN
from pbrnet.scenes.reconstruction.raycast import RayCaster
from pbrnet.scenes.registry import import_scene
from pbrnet.scenes.sweethome.building.cutouts import path_region
from pbrnet.scenes.sweethome.building.levels import storeys
from pbrnet.scenes.sweethome.building.openings import opening_of
from pbrnet.scenes.sweethome.building.outlines import joined, unjoined
from pbrnet.scenes.sweethome.building.slabs import CeilingHeights, build_slabs, stairwells
from pbrnet.scenes.sweethome.building.spaces import find_spaces
from pbrnet.scenes.sweethome.building.walls import build_walls, plan_walls
from pbrnet.scenes.sweethome.credits import licence_in
from pbrnet.scenes.sweethome.furnishing.finishes import (
    ground_reflectance,
    reflectance_of_argb,
    roughness_of,
    texture_coordinates,
)
from pbrnet.scenes.sweethome.furnishing.lamps import lumens_of
from pbrnet.scenes.sweethome.furnishing.placement import model_to_unit_box, unit_box_to_world
from pbrnet.scenes.sweethome.home import Home, HomePiece, Texture, Wall
from pbrnet.scenes.sweethome.home import Surface as Side
from pbrnet.scenes.sweethome.reader import read_home
from pbrnet.scenes.sweethome.sun import make_sky, sun_position
from pbrnet.scenes.sweethome.views import stored_cameras
from tests.fixtures import sweethome as draw

MARK = np.array([2.0, 1.0, 4.0])  # the box's right, upper, front corner
HAIR = 0.002  # metres by which pieces may stand above their place
CORNERS = np.array([[x, y, z] for x in (0, 2) for y in (0, 1) for z in (0, 4)], dtype=float)


def read(xml: str) -> tuple[Home, Changes]:
    changes = Changes()
    return read_home(Path("test.sh3d"), xml.encode(), changes), changes


def bring(folder: Path, xml: str, members: dict[str, str | bytes] | None = None,
          **options: object) -> Scene:  # fmt: skip
    return import_scene(draw.pack(folder / "test.sh3d", xml, members), folder / "out", **options)


def a_piece(**more: object) -> HomePiece:
    given = {"id": "", "kind": "pieceOfFurniture", "name": "box", "catalog_id": "", "creator": "",
             "level": None, "model": None, "x": 300.0, "y": 200.0, "elevation": 10.0,
             "width": 100.0, "depth": 50.0, "height": 80.0, "angle": 0.0}  # fmt: skip
    return HomePiece(**{**given, **more})  # type: ignore[arg-type]


def landed(piece: HomePiece, elevation: float = 0.0, point: np.ndarray = MARK) -> list[float]:
    """Position of a corner of the box in the world, metres."""
    to_box = model_to_unit_box(CORNERS, piece)
    in_box = CORNERS @ to_box[:3, :3].T + to_box[:3, 3]
    whole = unit_box_to_world(in_box, piece, elevation) @ to_box
    return (whole[:3, :3] @ point + whole[:3, 3]).round(6).tolist()


class TestPlacement:
    """The mark starts as (+50, 80, +25) cm: right, top, front (the plan's lower side)."""

    def test_size_and_place(self) -> None:
        assert landed(a_piece()) == [3.5, -2.25, 0.9]

    def test_turn_is_clockwise_on_the_plan(self) -> None:
        # A quarter turn takes right to below and front to the left: (300 - 25, 200 + 50).
        assert landed(a_piece(angle=math.pi / 2)) == [2.75, -2.5, 0.9]

    def test_mirror_turn_elevation_and_level(self) -> None:
        # Mirrored the mark is on the left, which a quarter turn takes up: (300 - 25, 200 - 50).
        made = landed(a_piece(mirrored=True, angle=math.pi / 2), elevation=250.0)
        assert made == [2.75, -1.5, 3.4]

    def test_pitch_lays_it_on_its_front(self) -> None:
        # Front becomes up and up becomes back: 50 cm high now, foot on the elevation again.
        assert landed(a_piece(pitch=math.pi / 2)) == [3.5, -1.6, 0.6]

    def test_roll_lays_it_on_its_right_side(self) -> None:
        # Right becomes down and up becomes right: the mark lies at the foot.
        assert landed(a_piece(roll=math.pi / 2)) == [3.4, -2.25, 0.1]

    def test_model_rotation_comes_before_the_size(self) -> None:
        # (x, y, z) -> (x, z, -y): the front is up, the top is behind, sizes apply afterwards.
        turned = a_piece(rotation=((1, 0, 0), (0, 0, 1), (0, -1, 0)))
        assert landed(turned) == [3.5, -1.75, 0.9]

    def test_mirrored_faces_still_face_outwards(self, tmp_path: Path) -> None:
        item = draw.piece(model="box", x=200, y=150, modelMirrored="true", angle=0.3)
        scene = bring(tmp_path, draw.usual(item), {"box": draw.BOX})
        vertices, faces = read_ply(scene, "thing.0")
        a, b, c = (vertices[faces[:, k]] for k in range(3))
        volume = float((np.cross(a, b) * c).sum()) / 6
        assert volume == pytest.approx(1.0 * 0.5 * 0.8, rel=1e-4)

    def test_group_members_know_their_own_place(self, tmp_path: Path) -> None:
        inner = draw.piece(model="box", x=200, y=150)
        group = f"<furnitureGroup name='set' angle='1' x='5' y='5'>{inner}</furnitureGroup>"
        scene = bring(tmp_path, draw.usual(group), {"box": draw.BOX})
        (item,) = [one for one in scene.objects if one.name == "thing"]
        assert item.bbox_min == pytest.approx((1.5, -1.75, 0), abs=HAIR)
        assert item.bbox_max == pytest.approx((2.5, -1.25, 0.8), abs=HAIR)
        assert item.room == "room_0"

    def test_deformed_parts_move(self, tmp_path: Path) -> None:
        model = draw.BOX.replace("usemtl", "g sweethome3d_opening_on_hinge_1_door\nusemtl")
        model += "g frame\nusemtl white\nv 0 0 0\nv 2 0 0\nv 2 1 4\nf 9 10 11\n"
        # The door moves up by its own height: the model is twice as high, all in 80 cm.
        moved = "<transformation name='sweethome3d_hinge_1' matrix='1 0 0 0 0 1 0 1 0 0 1 0'/>"
        scene = bring(tmp_path, draw.usual(draw.piece("pieceOfFurniture", moved, model="m",
                                                      x=200, y=150)), {"m": model})  # fmt: skip
        shapes = next(one for one in scene.objects if one.name == "thing").shapes
        lows = sorted(round(float(read_ply(scene, shape)[0][:, 2].min()), 4) for shape in shapes)
        assert lows == pytest.approx([0.0, 0.4], abs=HAIR)


def read_ply(scene: Scene, shape: str) -> tuple[np.ndarray, np.ndarray]:
    mesh = trimesh.load(scene.folder / "meshes" / f"{shape}.ply", process=False)
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def a_wall(name: str, start: tuple[float, float], end: tuple[float, float], **more: object) -> Wall:
    given = {"level": None, "thickness": 20.0, "height": 250.0, "height_at_end": None,
             "arc": None, "wall_at_start": None, "wall_at_end": None, "left": Side(),
             "right": Side(), "top_color": None}  # fmt: skip
    return Wall(name, start=start, end=end, **{**given, **more})  # type: ignore[arg-type]


class TestWalls:
    def test_corners_are_mitred(self) -> None:
        one = a_wall("one", (0, 0), (400, 0), wall_at_end="two")
        two = a_wall("two", (400, 0), (400, 300), wall_at_start="one")
        walls = {"one": one, "two": two}
        # Walking east, then south: outside is left.
        assert joined(one, walls).left[-1].tolist() == pytest.approx([410, -10])
        assert joined(one, walls).right[-1].tolist() == pytest.approx([390, 10])
        assert joined(two, walls).left[0].tolist() == pytest.approx([410, -10])
        assert joined(two, walls).right[0].tolist() == pytest.approx([390, 10])

    def test_walls_joined_head_to_head(self) -> None:
        one = a_wall("one", (0, 0), (400, 0), wall_at_end="two")
        two = a_wall("two", (400, 300), (400, 0), wall_at_end="one")
        walls = {"one": one, "two": two}
        assert joined(one, walls).left[-1].tolist() == pytest.approx([410, -10])
        assert joined(two, walls).right[-1].tolist() == pytest.approx([410, -10])

    def test_sharp_corners_stay_blunt(self) -> None:
        # 10 degrees apart: the tip would lie 10 / sin 5 = 115 cm away, more than 40.
        tip = (400 - 300 * math.cos(math.radians(10)), 300 * math.sin(math.radians(10)))
        one = a_wall("one", (0, 0), (400, 0), wall_at_end="two")
        two = a_wall("two", (400, 0), tip, wall_at_start="one")
        made = joined(one, {"one": one, "two": two})
        assert made.left[-1].tolist() == pytest.approx([400, -10])

    def test_round_wall(self) -> None:
        # A quarter of a circle about (200, 200), clockwise from the west to the north.
        made = unjoined(a_wall("arc", (0, 200), (200, 0), arc=math.pi / 2))
        centre = np.array([200.0, 200.0])
        assert np.linalg.norm(made.left - centre, axis=1) == pytest.approx(210)
        assert np.linalg.norm(made.right - centre, axis=1) == pytest.approx(190)
        assert made.left[0].tolist() == pytest.approx([-10, 200])
        middle = made.middle[len(made.middle) // 2]
        assert (middle[0] < 200) and (middle[1] < 200)
        other = unjoined(a_wall("arc", (0, 200), (200, 0), arc=-math.pi / 2))
        assert np.linalg.norm(other.right, axis=1) == pytest.approx(210)  # about (0, 0)

    def test_sloping_wall(self) -> None:
        xml = draw.home(draw.wall("w", (0, 0), (400, 0), height=250, heightAtEnd=100))
        drawing, changes = read(xml)
        (storey,) = storeys(drawing, (), changes)
        (item,) = build_walls(storey, plan_walls(storey, 250, changes), [])
        points = np.concatenate([part.mesh.vertices for part in item.parts])
        top = points[points[:, 2] > 0.5]
        # 5 mm reach into the ceiling.
        assert top[:, 2] == pytest.approx(2.505 - (1.5 / 4) * top[:, 0], abs=1e-6)
        assert np.unique(top[:, 0]).tolist() == pytest.approx([0, 4])

    def test_two_sides_two_colours_and_a_window(self) -> None:
        xml = draw.home(
            draw.wall("w", (0, 0), (400, 0), leftSideColor="FFFF0000", rightSideColor="FF0000FF",
                      topColor="FF00FF00")
            + draw.window(x=100, y=0)
        )  # fmt: skip
        drawing, changes = read(xml)
        (storey,) = storeys(drawing, (), changes)
        planned = plan_walls(storey, 250, changes)
        opening = opening_of(storey.pieces[0], 0, changes)
        assert opening is not None
        (item,) = build_walls(storey, planned, [opening])
        red, blue = reflectance_of_argb(0xFFFF0000), reflectance_of_argb(0xFF0000FF)
        areas = {part.finish.color: facing_area(part.mesh, axis=1) for part in item.parts}
        # North (+y) is left. Each side: 4 x 2.51 m (both embeds) less the hole of 1 m^2.
        assert areas[red][0] == pytest.approx(4 * 2.51 - 1, rel=1e-6)
        assert areas[blue][1] == pytest.approx(4 * 2.51 - 1, rel=1e-6)
        assert reflectance_of_argb(0xFF00FF00) in areas

    def test_doors_leave_no_wall_in_the_floor(self) -> None:
        xml = draw.home(draw.wall("w", (0, 0), (400, 0)) + draw.window(x=100, elevation=0))
        drawing, changes = read(xml)
        (storey,) = storeys(drawing, (), changes)
        opening = opening_of(storey.pieces[0], 0, changes)
        assert opening is not None
        (item,) = build_walls(storey, plan_walls(storey, 250, changes), [opening])
        for part in item.parts:
            corners = part.mesh.corners
            level = np.ptp(corners[:, :, 2], axis=1) < 1e-6
            in_floor = np.abs(corners[:, :, 2].mean(axis=1)) < 1e-3
            assert not (level & in_floor).any()

    def test_round_cut_out(self) -> None:
        region = path_region("M0,0.5 a0.5,0.5 0 1,0 1,0 a0.5,0.5 0 1,0 -1,0 z")
        assert region.area == pytest.approx(math.pi / 4, rel=0.01)
        assert region.centroid.distance(Point(0.5, 0.5)) < 1e-9
        assert path_region("M0,0 C0,1 1,1 1,0 Z").area == pytest.approx(0.6, rel=0.02)


def facing_area(mesh: object, axis: int) -> tuple[float, float]:
    """Areas of the triangles that face along +axis and -axis."""
    corners = mesh.corners  # type: ignore[attr-defined]
    cross = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1)
    along = cross[:, axis] / np.maximum(area, 1e-12)
    return float(area[along > 0.99].sum()), float(area[along < -0.99].sum())


LEVELS = """<level id='low' name='Low' elevation='0' floorThickness='12' height='250'/>
<level id='high' name='High' elevation='262' floorThickness='12' height='250'/>"""


def two_storeys(extra: str = "") -> str:
    rooms = "".join(draw.room(10, 10, 400, 500, level=level) for level in ("low", "high"))
    walls = "".join(draw.box_walls(0, 0, 420, 520, tag=level, level=level)
                    for level in ("low", "high"))  # fmt: skip
    return draw.home(LEVELS + extra + walls + rooms)


def slab_areas(xml: str) -> dict[str, tuple[float, float]]:
    """Areas that face up and down of each floor and ceiling."""
    drawing, changes = read(xml)
    found = storeys(drawing, (), changes)
    wells = stairwells([(p, s.elevation) for s in found for p in s.pieces], changes)
    areas = {}
    for storey in found:
        walls = plan_walls(storey, drawing.wall_height, changes)
        spaces = find_spaces(storey, walls, [], changes)
        for item in build_slabs(storey, spaces, CeilingHeights(storey, walls, spaces), wells):
            areas[item.id] = facing_area(item.parts[0].mesh, axis=2)
    return areas


def test_stairs_cut_both_storeys() -> None:
    stairs = draw.piece(name="stairs", level="low", x=200, y=250, width=100, depth=300, height=262,
                        staircaseCutOutShape=draw.FULL)  # fmt: skip
    whole, cut = slab_areas(two_storeys()), slab_areas(two_storeys(stairs))
    lost = {name: whole[name][0] - cut[name][0] for name in whole}
    assert lost["ceiling-0-0"] == pytest.approx(3.0, abs=1e-4)
    assert lost["floor-1-0"] == pytest.approx(3.0, abs=1e-4)
    assert lost["floor-0-0"] == pytest.approx(0, abs=1e-6)
    assert lost["ceiling-1-0"] == pytest.approx(0, abs=1e-6)
    # The room's 4 x 5 m and the walls around to 1 cm from their outer faces.
    assert whole["floor-0-0"][0] == pytest.approx(4.38 * 5.38, rel=1e-3)


def test_levels_are_chosen_and_heights_follow() -> None:
    drawing, changes = read(two_storeys())
    low, high = storeys(drawing, (), changes)
    assert (low.base, high.base, high.elevation, low.above) == (0, 250, 262, 262)
    (only,) = storeys(drawing, ("High",), changes)
    assert only.name == "High"


def test_pieces_share_no_face_with_floors_or_each_other(tmp_path: Path) -> None:
    boxes = draw.piece(model="box", x=200, y=150) + draw.piece(model="box", x=230, y=150)
    scene = bring(tmp_path, draw.usual(boxes), {"box": draw.BOX}, lamps="home")
    lows = [item.bbox_min[2] for item in scene.objects if not item.is_structure]
    assert len(lows) == 2 and all(1e-4 < low < HAIR for low in lows)
    assert abs(lows[0] - lows[1]) > 1e-4


def test_later_rooms_cover_earlier_ones() -> None:
    xml = draw.home(draw.room(0, 0, 400, 300) + draw.room(300, 0, 200, 300))
    drawing, changes = read(xml)
    (storey,) = storeys(drawing, (), changes)
    first, second = find_spaces(storey, [], [], changes)
    assert first.floor.area == pytest.approx(9.0)
    assert second.floor.area == pytest.approx(6.0)


def test_what_a_later_room_leaves_of_one_is_no_room(tmp_path: Path) -> None:
    walls = draw.box_walls(0, 0, 420, 320)
    body = walls + draw.room(10, 10, 400, 300, name="Below") + draw.room(10, 10, 400, 299)
    scene = bring(tmp_path, draw.home(body))
    assert [room.name for room in scene.rooms if room.name == "Below"] == []
    assert len(scene.rooms) == 1
    assert "rooms narrower than 0.1 m have no views: Below" in scene.changes


def test_floor_and_ceiling_drawn_apart_are_one_room(tmp_path: Path) -> None:
    """The ceiling covers the room with the floor, but for a strip of 20 cm."""
    walls = draw.box_walls(0, 0, 420, 320)
    floor = draw.room(10, 10, 400, 300, name="Floor")
    ceiling = draw.room(10, 10, 400, 280, name="Ceiling", floorVisible="false")
    scene = bring(tmp_path, draw.home(walls + floor + ceiling))
    assert [room.name for room in scene.rooms] == ["Ceiling"]
    assert "rooms below the ceiling of another have no views of their own: Floor" in scene.changes


def test_a_crawl_space_and_a_terrace_are_no_rooms_and_are_named(tmp_path: Path) -> None:
    """A garret whose ceiling slopes from 2.2 m down to 0.6 m is a room."""
    walls = draw.box_walls(0, 0, 420, 320, height="120")
    crawl = draw.room(10, 10, 400, 300, name="Crawl space")
    terrace = draw.room(500, 10, 300, 300, name="Terrace", ceilingVisible="false")
    ring = [(0, 1000), (420, 1000), (420, 1320), (0, 1320), (0, 1000)]
    heights = [(220, 220), (220, 60), (60, 60), (60, 220)]
    roofed = "".join(
        draw.wall(f"roofed-{number}", ring[number], ring[number + 1], height=start, heightAtEnd=end,
                  wallAtStart=f"roofed-{(number - 1) % 4}", wallAtEnd=f"roofed-{(number + 1) % 4}")
        for number, (start, end) in enumerate(heights)
    )  # fmt: skip
    garret = draw.room(10, 1010, 400, 300, name="Garret")
    scene = bring(tmp_path, draw.home(walls + crawl + terrace + roofed + garret))
    assert [room.name for room in scene.rooms] == ["Garret"]
    assert "rooms lower than 1.5 m have no views: Crawl space" in scene.changes
    assert "rooms without a ceiling are outdoors and have no views: Terrace" in scene.changes


def test_walls_make_a_room_where_none_is_drawn(tmp_path: Path) -> None:
    xml = draw.home(draw.box_walls(0, 0, 420, 320) + draw.window(x=200, y=0))
    scene = bring(tmp_path, xml)
    (room,) = scene.rooms
    corners = np.array([[0.1, -3.1], [0.1, -0.1], [4.1, -3.1], [4.1, -0.1]])
    assert np.array(sorted(room.floor)) == pytest.approx(corners, abs=1e-4)
    assert any("without a drawn room" in change for change in scene.changes)


class TestSun:
    def test_almanac(self) -> None:
        # Reda and Andreas, Solar Position Algorithm (NREL/TP-560-34302), appendix A.5: zenith
        # 50.11162 degrees with refraction of 0.0164, azimuth 194.34024.
        when = datetime(2003, 10, 17, 12, 30, 30, tzinfo=timezone(timedelta(hours=-7)))
        height, azimuth = sun_position(when, math.radians(39.742476), math.radians(-105.1786))
        assert math.degrees(height) == pytest.approx(90 - 50.11162 - 0.0164, abs=0.01)
        assert math.degrees(azimuth) == pytest.approx(194.34024, abs=0.01)

    @pytest.mark.parametrize("north, expected", [(0.0, (0, -1)), (math.pi / 2, (-1, 0))])
    def test_noon_sun_stands_in_the_south(self, north: float, expected: tuple[int, int]) -> None:
        # Midsummer noon at Greenwich: 90 - 51.48 + 23.43 degrees high. 1 ms = clock time.
        noon = int(datetime(2021, 6, 21, 12, 2, tzinfo=timezone.utc).timestamp() * 1000)  # noqa: UP017
        camera = (f"<observerCamera attribute='observerCamera' x='1' y='1' z='1' yaw='0' pitch='0' "
                  f"fieldOfView='1' time='{noon}'/>")  # fmt: skip
        compass = (f"<compass x='0' y='0' diameter='1' northDirection='{north}' longitude='0' "
                   f"latitude='{math.radians(51.48)}' timeZone='UTC'/>")  # fmt: skip
        drawing, changes = read(draw.home(compass + camera))
        sky = make_sky(drawing, None, changes)
        assert sky.elevation == pytest.approx(90 - 51.48 + 23.43, abs=0.02)
        flat = np.array(sky.direction[:2]) / np.hypot(*sky.direction[:2])
        assert flat.tolist() == pytest.approx(expected, abs=0.01)
        assert sky.is_day

    def test_time_of_day_can_be_chosen(self) -> None:
        drawing, changes = read(draw.home("<compass x='0' y='0' diameter='1' longitude='0' "
                                          "latitude='0.8' timeZone='UTC'/>"))  # fmt: skip
        kinds = {
            time: [light.kind for light in make_sky(drawing, time, changes).lights]
            for time in ("12:00", "20:30", "0:30")
        }
        assert kinds == {"12:00": ["sky", "sun"], "20:30": ["sky"], "0:30": ["environment"]}


class TestFinishes:
    def test_colours_are_linearised(self) -> None:
        assert reflectance_of_argb(0xFF808080) == pytest.approx((0.2158605,) * 3, rel=1e-6)
        assert reflectance_of_argb(0xFFFFFFFF) == pytest.approx((0.82,) * 3)
        red = reflectance_of_argb(0xFFFF8080)
        assert red == pytest.approx((0.82, 0.82 * 0.2158605, 0.82 * 0.2158605))

    def test_no_paint_is_darker_than_its_surface(self) -> None:
        assert reflectance_of_argb(0xFF000000) == (0.03, 0.03, 0.03)

    @pytest.mark.parametrize("color", [0xFFA8FF00, 0xFF00FF00, 0xFF0000FF, 0xFFFFFFFF])
    def test_ground_is_no_signal_colour(self, color: int) -> None:
        drawn, ground = (
            np.array(reflectance_of_argb(color)),
            np.array(ground_reflectance(reflectance_of_argb(color))),
        )
        assert ground @ [0.2126, 0.7152, 0.0722] <= 0.15 + 1e-9
        assert ground.min() >= 0.35 * ground.max() - 1e-9
        assert np.argmax(ground) == np.argmax(drawn)

    def test_soil_stays_as_it_is(self) -> None:
        assert ground_reflectance((0.12, 0.10, 0.07)) == pytest.approx((0.12, 0.10, 0.07))

    def test_gloss(self) -> None:
        assert roughness_of(0.0) == pytest.approx(1.0)
        assert roughness_of(0.5) == pytest.approx((2 / 66) ** 0.25)

    def test_textures_are_shifted_turned_and_scaled(self) -> None:
        tile = Texture("t", "t", 50.0, 25.0)
        assert texture_coordinates(np.array([[50.0, 50.0]]), tile).tolist() == [[1.0, 2.0]]
        assert texture_coordinates(np.array([[50.0, 50.0]]), replace(tile, scale=2.0)).tolist() == [
            [0.5, 1.0]
        ]
        shifted = texture_coordinates(np.array([[50.0, 50.0]]), replace(tile, x_offset=0.5))
        assert shifted.tolist() == [[0.5, 2.0]]
        turned = texture_coordinates(np.array([[50.0, 0.0]]), replace(tile, angle=math.pi / 2))
        assert turned[0].tolist() == pytest.approx([0.0, 2.0])


def test_lamp_lumens() -> None:
    usual = LightSource(0.5, 0.5, 0.5, 0x00AA9770, None)
    assert lumens_of(usual, 0.5) == pytest.approx(1000)
    assert lumens_of(usual, 0.25) == pytest.approx(250)  # the flux goes with the power squared
    # The work lamp's darker colour: 62.53 / 152.23 of the luminance.
    assert lumens_of(replace(usual, color=0x00463E2E), 0.5) == pytest.approx(411, abs=1)


def test_categories_and_rooms() -> None:
    assert category_of_piece("pieceOfFurniture", "Table de chevet", "eTeks#bedsideTable") == (
        "night table", False)  # fmt: skip
    assert category_of_piece("pieceOfFurniture", "Kitchen cabinet", "eTeks#kitchenCabinet")[0] == (
        "kitchen unit")  # fmt: skip
    assert category_of_piece("pieceOfFurniture", "Canapé", "Someone#123") == ("sofa", False)
    assert category_of_piece("doorOrWindow", "Front door", "eTeks#frontDoor") == ("door", True)
    assert category_of_piece("doorOrWindow", "Round window", "eTeks#roundWindow") == (
        "window",
        True,
    )
    assert room_type("Salle de bains", []) == "bathroom"
    assert room_type("Bedroom #2", []) == "bedroom"
    assert room_type("", ["sofa", "table"]) == "living"
    assert room_type("Corridor", []) == "other"


def test_licences() -> None:
    assert licence_in("http://creativecommons.org/licenses/by/3.0/") == "CC-BY-3.0"
    assert licence_in("CC-BY Creative Commons Attribution 3.0 Unported license") == "CC-BY-3.0"
    assert licence_in("CC-0") == "CC0-1.0"
    assert licence_in("all mine") == ""


def test_views_look_where_the_camera_looks() -> None:
    # Yaw 0 looks down the plan (south, -y), a quarter turn clockwise from there to the west.
    camera = ("<observerCamera attribute='storedCamera' name='A b' x='100' y='200' z='170' "
              "yaw='{}' pitch='0.2' fieldOfView='1.0'/>")  # fmt: skip
    drawing, changes = read(draw.home(camera.format(0) + camera.format(math.pi / 2)))
    south, west = (view.camera_to_world for view in stored_cameras(drawing, changes))
    assert south[:3, 3].tolist() == pytest.approx([1, -2, 1.7])
    assert south[:3, 2].tolist() == pytest.approx([0, -math.cos(0.2), -math.sin(0.2)])
    assert west[:3, 2].tolist() == pytest.approx([-math.cos(0.2), 0, -math.sin(0.2)])
    assert west[:3, 0].tolist() == pytest.approx([0, 1, 0])  # facing west, right is north
    assert np.linalg.det(west[:3, :3]) == pytest.approx(1)


def test_models_without_a_library_use_the_built_in_materials() -> None:
    model = read_obj_model(draw.BOX.encode(), "box.obj", lambda name: {})
    (part,) = model.parts
    assert part.material.color == (0.5755, 0.2678, 0)
    assert len(part.mesh.faces) == 12
    assert model.bounds.tolist() == [[0, 0, 0], [2, 1, 4]]


def test_concave_polygons_keep_their_area() -> None:
    # An L of area 3 in a tilted plane.
    ell = "v 0 0 0\nv 2 0 2\nv 2 1 2\nv 1 1 1\nv 1 2 1\nv 0 2 0\nf 1 2 3 4 5 6\n"
    (part,) = read_obj_model(ell.encode(), "ell.obj", lambda name: {}).parts
    corners = part.mesh.corners
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert 0.5 * np.linalg.norm(cross, axis=1).sum() == pytest.approx(3 * math.sqrt(2))
    assert (cross @ np.cross([2, 0, 2], [0, 1, 0]) > 0).all()


def test_mtl() -> None:
    text = "newmtl glass\nKd 1 1 1\nd 0.3\nnewmtl wood\nKd 0 0 0\nmap_Kd -s 1 1 1 C:\\a\\Oak.JPG\n"
    found = {"Oak.JPG": "3/oak.jpg"}
    made = read_model_materials(text.encode(), "a.mtl", lambda name: found.get(name[-7:]))
    assert made["glass"].opacity == 0.3
    assert made["wood"].image == "3/oak.jpg"


def test_damaged_lines_of_an_mtl_leave_the_defaults() -> None:
    data = b"newmtl a\nKd red\nNs nan\nd\nKs 0.5 0.5 0.5\n"
    material = read_model_materials(data, "a.mtl", lambda name: None)["a"]
    assert (material.color, material.exponent, material.opacity) == ((1, 1, 1), 0, 1)
    assert material.highlight == 0.5


def test_same_home_same_bytes(tmp_path: Path) -> None:
    xml = draw.usual(draw.lamp(x=100, y=100, elevation=150) + draw.window(x=200, y=0))
    path = draw.pack(tmp_path / "test.sh3d", xml)
    for name in ("one", "two"):
        import_scene(path, tmp_path / name, scene_id="same")
    assert digest_folder(tmp_path / "one") == digest_folder(tmp_path / "two")


def test_portal_lies_in_its_window(tmp_path: Path) -> None:
    scene = bring(tmp_path, draw.usual(draw.window(x=200, y=0)))
    (portal,) = scene.portals
    assert (portal.kind, portal.clear, portal.room) == ("window", True, "room_0")
    assert portal.normal == pytest.approx((0, 1, 0))  # north
    points = np.array(portal.polygon)
    assert points.min(axis=0).tolist() == pytest.approx([1.5, 0, 0.9])
    assert points.max(axis=0).tolist() == pytest.approx([2.5, 0, 1.9])
    # Counter-clockwise seen from outside.
    normal = np.cross(points[1] - points[0], points[2] - points[1])
    assert normal @ portal.normal > 0
    assert scene.rooms[0].has_light


def test_panes_leave_and_overrides_come_in_order(tmp_path: Path) -> None:
    pane = draw.BOX.replace("usemtl amber", "g sweethome3d_window_pane\nusemtl amber")
    members = {"box": draw.BOX, "pane": pane}
    named = "<material name='amber' color='FF0000FF'/>"
    xml = draw.usual(
        draw.piece("pieceOfFurniture", named, name="a", model="box", x=100, y=100, color="FFFF0000")
        + draw.piece("pieceOfFurniture", named, name="b", model="box", x=250, y=100)
        + draw.piece("pieceOfFurniture", "", name="c", model="pane", x=100, y=200, color="FFFF0000")
        + draw.window(x=200, y=0, model="pane")
    )
    scene = bring(tmp_path, xml, members)
    text = scene.xml.read_text()

    def material(shape: str) -> str:
        return text.split(f'id="{shape}"')[1].split('<ref id="')[1].split('"')[0]

    def colour(shape: str) -> list[float]:
        described = text.split(f'id="{material(shape)}"')[1]
        return [float(v) for v in described.split('<rgb name="')[1].split('value="')[1]
                .split('"')[0].split()]  # fmt: skip

    assert colour("a.0") == pytest.approx([0.82, 0.03, 0.03])  # the piece's colour wins
    assert colour("b.0") == pytest.approx([0.03, 0.03, 0.82])
    assert material("c.0").startswith("glass")  # panes keep what they are
    assert "window" not in {one.name for one in scene.objects}  # nothing but a pane: a portal
    assert [portal.clear for portal in scene.portals] == [True]


def test_newer_homes_come_in_with_what_is_known(tmp_path: Path) -> None:
    xml = draw.usual(
        "<hologram/><hologram/><polyline><point x='1' y='1'/></polyline><label/>"
        + draw.piece(inside="<scent/>", model="nothing", x=100, y=100),
        version=9900,
    )
    scene = bring(tmp_path, xml)
    said = " ".join(scene.changes)
    for words in ("newer version", "<hologram> (2)", "<scent> (1)", "polylines", "labels",
                  "WITHOUT A MODEL"):  # fmt: skip
        assert words in said
    assert len(scene.rooms) == 1


def test_emitted_flux_is_the_lamps(tmp_path: Path) -> None:
    scene = bring(tmp_path, draw.usual(draw.lamp(x=210, y=160, elevation=190)))
    (light,) = [one for one in scene.lights if one.kind == "area"]
    assert light.lumens == pytest.approx(1000)
    text = scene.xml.read_text()
    radiance = [float(v) for v in text.split('name="radiance" value="')[1].split('"')[0].split()]
    luminance = np.dot([0.2126, 0.7152, 0.0722], radiance)
    # A Lambertian ball of 5 cm radius (10 cm diameter, the largest that is kept).
    flux = math.pi * luminance * 4 * math.pi * 0.05**2 / LUMEN
    assert flux == pytest.approx(1000, rel=1e-5)


def test_glowing_materials_have_the_flux_of_the_bulbs(tmp_path: Path) -> None:
    # Two sources of 1000 lm; the shade is the box of 2 x 1 x 4 scaled to 0.2 x 0.1 x 0.4 m.
    source = "<lightSource x='0.5' y='0.5' z='0.5' color='00AA9770' diameter='0.5'/>"
    lamp = draw.piece("light", 2 * source + "<lightSourceMaterial name='amber'/>", model="m",
                      x=210, y=160, width=20, height=10, depth=40, power=0.5)  # fmt: skip
    scene = bring(tmp_path, draw.usual(lamp), {"m": draw.BOX})
    (light,) = [one for one in scene.lights if one.kind == "area"]
    assert light.lumens == pytest.approx(2000)
    assert len(light.shapes) == 1
    text = scene.xml.read_text()
    assert 'type="sphere"' not in text
    radiance = [float(v) for v in text.split('name="radiance" value="')[1].split('"')[0].split()]
    surface = 2 * (0.2 * 0.1 + 0.2 * 0.4 + 0.1 * 0.4)
    flux = math.pi * np.dot([0.2126, 0.7152, 0.0722], radiance) * surface / LUMEN
    assert flux == pytest.approx(2000, rel=1e-5)


def test_shelf_units_are_furniture(tmp_path: Path) -> None:
    shelf = draw.piece("shelfUnit", "<shelf elevation='0.5'/>", name="Bookcase", model="m",
                       x=100, y=100)  # fmt: skip
    grouped = f"<furnitureGroup name='group'>{shelf}</furnitureGroup>"
    scene = bring(tmp_path, draw.usual(shelf + grouped), {"m": draw.BOX})
    assert [one.category for one in scene.objects if one.name == "Bookcase"] == ["bookshelf"] * 2
    assert "unknown" not in " ".join(scene.changes)


def test_homes_without_models_say_what_is_missing(tmp_path: Path) -> None:
    bed = draw.piece(name="Bunk bed", model="7", x=150, y=100, width=90, depth=200, height=150,
                     elevation=10, angle=math.pi / 2)  # fmt: skip
    xml = draw.home(
        draw.box_walls(0, 0, 420, 320)
        + draw.room(10, 10, 400, 300)
        + 3 * bed
        + draw.piece(name="Vase", model="8", x=50, y=50)
        + draw.window(x=200, y=0, model="1")
        + draw.piece("doorOrWindow", name="Front door", model="2", x=0, y=160, angle=math.pi / 2,
                     width=90, depth=20, height=200)
        + draw.lamp(x=210, y=160, elevation=190, model="3")
    )  # fmt: skip
    scene = bring(tmp_path, xml, {"8": "# nothing"})
    said = list(scene.changes)
    assert "PIECES WITHOUT A MODEL WERE LEFT OUT (4): 3 x Bunk bed, Vase (no faces in it)" in said
    assert "DOORS AND WINDOWS WITHOUT A MODEL CAME IN AS OPEN HOLES (2): window, Front door" in said
    assert "LAMPS WITHOUT A MODEL CAME IN AS BARE BULBS (1): bulb" in said
    missing = scene.source["missing"]
    assert [one["kept"] for one in missing] == ["nothing"] * 4 + ["opening"] * 2 + ["light"]
    assert missing[0]["centre"] == pytest.approx([1.5, -1.0, 0.85])
    assert missing[0]["size"] == pytest.approx([0.9, 2.0, 1.5])
    assert missing[0]["angle"] == pytest.approx(-math.pi / 2, abs=1e-5)
    assert missing[0]["room"] == "room_0"
    # No stand-ins: only the building and the bulb. What was lost still tells what the room is.
    assert {one.category for one in scene.objects if not one.is_structure} == {"lamp"}
    assert scene.rooms[0].type == "bedroom"
    # The walls are cut: rays go through both holes, which are clear portals.
    assert [(portal.kind, portal.clear) for portal in scene.portals] == [
        ("window", True),
        ("door", True),
    ]
    walls = [
        np.asarray(trimesh.load(scene.folder / "meshes" / f"{shape}.ply").triangles)
        for one in scene.objects
        if one.category == "wall"
        for shape in one.shapes
    ]
    caster = RayCaster(np.concatenate(walls))
    north, east, south, west = np.array([[0.0, 1, 0], [1, 0, 0], [0, -1, 0], [-1, 0, 0]])
    away, _ = caster.cast(np.array([2.0, -1.6, 1.4]), np.stack([north, south]))
    assert away == pytest.approx([np.inf, 1.5])
    away, _ = caster.cast(np.array([2.0, -1.6, 1.0]), np.stack([west, east]))
    assert away == pytest.approx([np.inf, 2.1])


def test_outlines_without_spikes_need_no_mitre(
    tmp_path: Path, recwarn: pytest.WarningsRecorder
) -> None:
    # Walls at 45 degrees with corners that are off by less than a micrometre.
    corners = [(0, 600), (200.00002, 600), (400, 800), (200, 1000), (-7.5782878e-06, 800)]
    walls = "".join(
        draw.wall(
            f"w{number}",
            corner,
            corners[(number + 1) % 5],
            wallAtStart=f"w{(number - 1) % 5}",
            wallAtEnd=f"w{(number + 1) % 5}",
        )
        for number, corner in enumerate(corners)
    )
    scene = bring(tmp_path, draw.home(walls + draw.window(x=100, y=600)))
    assert len(scene.rooms) == 1
    assert [str(one.message) for one in recwarn if one.category is RuntimeWarning] == []
