"""Procedural homes: geometry, lighting and materials of the written scene files."""

import math
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import defusedxml.ElementTree
import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from shapely.geometry import LineString, Point, Polygon

from pbrnet.pipeline.render.scene import set_variant
from pbrnet.scenes.color import luminance
from pbrnet.scenes.contract import Scene, SceneObject, load_scene
from pbrnet.scenes.files import digest_file, digest_folder
from pbrnet.scenes.formats.ply import read_ply
from pbrnet.scenes.geometry.mesh import Mesh, face_areas
from pbrnet.scenes.params import SceneParams
from pbrnet.scenes.photometry import LUMEN
from pbrnet.scenes.procedural.furniture import FURNITURE_KINDS, make_style
from pbrnet.scenes.procedural.home import make_home
from pbrnet.scenes.procedural.lighting import (
    area_emitter,
    draw_screen_states,
    in_state,
    lamp_items,
    mean_radiance,
)
from pbrnet.scenes.procedural.materials import MaterialLibrary
from pbrnet.scenes.procedural.piece import Material, PiecePart
from pbrnet.scenes.procedural.plan import Plan, WallEdge
from pbrnet.scenes.procedural.planning import SIZES, make_plan
from pbrnet.scenes.procedural.roof import COVER
from pbrnet.scenes.procedural.scene_item import SceneItem
from pbrnet.scenes.reconstruction.raycast import RayCaster
from pbrnet.scenes.seeds import generator
from tests.fixtures.geometry import Solids, crossings

SMALL = SceneParams(texture_size=64)
SEEDS = (8, 5, 14, 7)  # rooms of all types; beams, niches, stairs
HANGING = ("textile", "bedding", "clothing", "towel", "curtain", "cushion")
ON_HOOKS = ("utensil_rail", "key_board")  # carriers of what hangs
SETTINGS = ("day", "evening", "night", "mixed")
_TOUCH = 3e-3  # metres that bounds share if they only touch


@dataclass(frozen=True)
class Home:
    """A written home and the plan it was made from."""

    seed: int
    folder: Path
    scene: Scene
    plan: Plan

    @cached_property
    def bodies(self) -> dict[str, list[tuple[Polygon, float, float]]]:
        """Object id -> connected bodies of its meshes: (hull of footprint, lowest, highest z).

        Without what is outside: each leaf of a tree would be a body.
        """
        return {
            item.id: [body for shape in item.shapes for body in self._bodies(shape)]
            for item in self.scene.objects
            if not item.id.startswith("outside-")
        }

    def triangles(self, item: SceneObject) -> np.ndarray:
        """Corners (N, 3, 3) of all triangles of an object, metres."""
        return np.concatenate([self.mesh(shape).corners for shape in item.shapes])

    def mesh(self, shape: str) -> Mesh:
        return read_ply(self.folder / "meshes" / f"{shape}.ply")

    def _bodies(self, shape: str) -> list[tuple[Polygon, float, float]]:
        mesh = self.mesh(shape)
        vertices, faces = mesh.vertices, mesh.faces
        welded = _numbered(np.round(vertices, 4) + 0.0)
        corners = welded[faces]
        count = int(corners.max()) + 1
        links = coo_array(
            (np.ones(2 * len(corners)), (corners[:, :2].ravel(), corners[:, 1:].ravel())),
            shape=(count, count),
        )
        number, labels = connected_components(links, directed=False)
        order = np.argsort(labels[welded], kind="stable")
        points, labels = vertices[order], labels[welded][order]
        feet = shapely.multipoints(shapely.points(points[:, :2]), indices=labels)
        starts = np.searchsorted(labels, np.arange(number))
        lows, highs = (way.reduceat(points[:, 2], starts) for way in (np.minimum, np.maximum))
        return list(zip(shapely.convex_hull(feet), lows.tolist(), highs.tolist(), strict=True))


def _numbered(points: np.ndarray) -> np.ndarray:
    """Numbers (N,) of points (N, 3) in the order of their coordinates; equal points share one."""
    order = np.lexsort(points.T[::-1])
    ordered = points[order]
    numbers = np.empty(len(points), dtype=np.int64)
    numbers[order] = np.cumsum(np.r_[False, (ordered[1:] != ordered[:-1]).any(axis=1)])
    return numbers


@pytest.fixture(scope="session")
def homes(tmp_path_factory: pytest.TempPathFactory) -> list[Home]:
    root = tmp_path_factory.mktemp("homes")
    return [home_of(root, seed) for seed in SEEDS]


def home_of(root: Path, seed: int) -> Home:
    """Make the home of a seed below `root`."""
    folder = root / f"home-{seed}"
    make_home(folder, folder.name, SMALL.home(seed, SETTINGS[seed % 4]))
    plan = make_plan(generator(seed, "plan"), SMALL.rooms_min, SMALL.rooms_max)
    return Home(seed, folder, load_scene(folder), plan)


def _room_count(home: Home) -> int:
    return len(home.scene.rooms)


def furniture_of(home: Home) -> list[SceneObject]:
    return [item for item in home.scene.objects if not item.is_structure]


def test_every_file_is_used_and_every_reference_exists(homes: list[Home]) -> None:
    for home in homes:
        root = defusedxml.ElementTree.parse(home.folder / "scene.xml").getroot()
        named = {
            node.get("value") for node in root.iter("string") if node.get("name") == "filename"
        }
        present = {
            path.relative_to(home.folder).as_posix()
            for sub in ("meshes", "textures")
            for path in (home.folder / sub).iterdir()
        }
        assert named == present
        shapes = [node.get("id") for node in root.iter("shape")]
        assert sorted(shapes) == sorted(id for item in home.scene.objects for id in item.shapes)
        assert len(shapes) <= 1100


def test_meshes_are_sound(homes: list[Home]) -> None:
    for home in homes:
        triangles = 0
        for path in sorted((home.folder / "meshes").iterdir()):
            mesh = read_ply(path)
            assert mesh.uvs is not None, path.name
            assert np.isfinite(mesh.vertices).all() and np.isfinite(mesh.uvs).all(), path.name
            assert mesh.faces.min() >= 0 and mesh.faces.max() < len(mesh.vertices), path.name
            triangles += len(mesh.faces)
        assert triangles < 1_000_000


def test_equal_seeds_and_the_first_variant_give_equal_bytes(
    homes: list[Home], tmp_path: Path
) -> None:
    home = homes[3]
    again = tmp_path / home.folder.name
    first = replace(SMALL, vary=("finishes", "furniture", "light", "outdoors"))
    make_home(again, again.name, first.home(home.seed, home.scene.lighting, 0))
    assert digest_folder(again) == digest_folder(home.folder)


def test_light_settings_share_plan_and_furniture(homes: list[Home], tmp_path: Path) -> None:
    home = min((home for home in homes if home.scene.lighting == "night"), key=_room_count)
    scene = make_home(tmp_path / "day", "day", SMALL.home(home.seed, "day"))
    assert scene.plan == home.scene.plan
    assert _still(scene) == _still(home.scene)
    windows = {portal.room for portal in scene.portals if portal.clear}
    assert not [light for light in scene.lights if light.kind == "area" and light.room in windows]
    assert [light for light in home.scene.lights if light.kind == "area"]


def _still(scene: Scene) -> list[Any]:
    """Ids and places of the objects, but of clouds: they belong to the light."""
    return [(one.id, one.bbox_min) for one in scene.objects if one.category != "cloud"]


def test_clouds_stand_in_the_sky_of_homes_in_the_sun(homes: list[Home]) -> None:
    counts = [home.scene.source["light"]["clouds"] for home in homes]
    assert 0 < sum(counts) < len(homes)
    for home, count in zip(homes, counts, strict=True):
        sunny = any(light.kind == "sun" for light in home.scene.lights)
        assert count == sum(one.category == "cloud" for one in home.scene.objects) <= sunny


def test_homes_differ(homes: list[Home]) -> None:
    floors = {str([room.floor for room in home.scene.rooms]) for home in homes}
    walls = {digest_file(home.folder / "meshes" / "facade.0.ply") for home in homes}
    assert len(floors) == len(walls) == len({home.scene.plan for home in homes}) == len(homes)


def test_mitsuba_loads_homes_without_a_warning(homes: list[Home]) -> None:
    set_variant("auto")

    class Collector(mi.Appender):
        def __init__(self) -> None:
            super().__init__()
            self.lines: list[str] = []

        def append(self, level: Any, text: str) -> None:
            if level >= mi.LogLevel.Warn:
                self.lines.append(text)

        def log_progress(self, *args: Any) -> None:
            pass

    collector = Collector()
    mi.logger().add_appender(collector)
    try:
        for home in homes:
            mi.load_file(str(home.scene.xml), optimize=False, parallel=False)
    finally:
        mi.logger().remove_appender(collector)
    assert collector.lines == []


def test_the_plain_mitsuba_command_renders_a_home(homes: list[Home], tmp_path: Path) -> None:
    command = Path(sys.executable).with_name("mitsuba")
    if not command.is_file():
        pytest.skip("the mitsuba command is not installed beside this Python")
    folder = tmp_path / "home"
    shutil.copytree(homes[3].folder, folder)
    text = (folder / "scene.xml").read_text()
    text = text.replace('name="sample_count" value="64"', 'name="sample_count" value="1"')
    text = text.replace('"width" value="480"', '"width" value="32"')
    text = text.replace('"height" value="360"', '"height" value="24"')
    (folder / "scene.xml").write_text(text)
    run = [str(command), "-m", "scalar_rgb", "-o", str(tmp_path / "out.exr"), "scene.xml"]
    done = subprocess.run(run, cwd=folder, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    assert (tmp_path / "out.exr").stat().st_size > 100


def test_plans_are_habitable() -> None:
    outlines = set()
    forms: set[str] = set()
    for seed in range(60):
        plan = make_plan(generator(seed, "plan"), 1, 6)
        shapes = [room.shape for room in plan.rooms]
        inner, outline = Polygon(plan.inner), Polygon(plan.outline)
        outlines.add(len(plan.outline))
        for room, shape in zip(plan.rooms, shapes, strict=True):
            assert shape.is_valid and shape.exterior.is_ccw
            assert 0.75 * SIZES[room.type][0] <= shape.area <= 60
            assert inner.buffer(1e-4).covers(shape)
            assert room.type in ("bathroom", "hall") or room.id in plan.with_window, (
                f"seed {seed}: {room.type} without a window"
            )
        for index, first in enumerate(shapes):
            for second in shapes[index + 1 :]:
                assert first.distance(second) > 0.9 * plan.partition
        assert outline.exterior.distance(inner) == pytest.approx(plan.outer_thickness, abs=1e-3)
        assert sum(opening.kind == "entrance" for opening in plan.openings) == 1
        joined = [{room.id} for room in plan.rooms]
        for opening in plan.openings:
            if not opening.is_outer:
                one = [group for group in joined if group & set(opening.rooms)]
                joined = [group for group in joined if group not in one] + [set().union(*one)]
        assert len(joined) == 1, f"seed {seed}: not all rooms can be reached"
        for beam in plan.beams:
            under = shapely.box(*beam.low, *beam.high)
            room = plan.room(beam.room)
            assert room.shape.buffer(1e-3).covers(under) and plan.height - beam.depth > 2.3
            assert sum(edge_line(edge).distance(under) < 1e-3 for edge in room.edges) >= 2
            assert all(opening.z1 < plan.height - beam.depth for opening in plan.openings)
        if plan.stairs is not None:
            forms.add("stairs")
            flight = plan.stairs.footprint
            assert plan.room(plan.stairs.room).shape.buffer(1e-3).covers(flight)
            assert all(flight.distance(one.footprint) > 0.02 for one in plan.openings)
        forms |= {opening.kind for opening in plan.openings}
        forms |= {room.type for room in plan.rooms} | ({"beams"} if plan.beams else set())
        forms |= {"L" for room in plan.rooms if len(room.edges) == 6}
    assert outlines >= {4, 6}  # rectangles and L shapes at least
    assert forms >= {"open", "archway", "patio", "hall", "beams", "stairs", "L"}


def edge_line(edge: WallEdge) -> LineString:
    return LineString([edge.start, edge.end])


def test_openings_pierce_walls_from_face_to_face() -> None:
    for seed in range(40):
        plan = make_plan(generator(seed, "plan"), 1, 6)
        rooms = shapely.union_all([room.shape for room in plan.rooms])
        solid = Polygon(plan.outline).difference(rooms)
        holes = [opening.footprint for opening in plan.openings]
        for opening, hole in zip(plan.openings, holes, strict=True):
            assert solid.buffer(1e-3).covers(hole), f"seed {seed}: {opening.id}"
            for room_id in opening.rooms:
                assert plan.room(room_id).shape.distance(hole) < 1e-3
            assert opening.z1 < plan.height
        for index, first in enumerate(holes):
            assert all(first.distance(second) > 0.05 for second in holes[index + 1 :])


def test_portals_lie_in_outer_walls_and_face_outdoors(homes: list[Home]) -> None:
    for home in homes:
        wall = Polygon(home.plan.outline).difference(Polygon(home.plan.inner)).buffer(1e-3)
        rooms = {room.id: Polygon(room.floor) for room in home.scene.rooms}
        assert any(portal.clear for portal in home.scene.portals)
        for portal in home.scene.portals:
            corners = np.array(portal.polygon)
            normal = np.array(portal.normal)
            assert np.linalg.norm(normal) == pytest.approx(1)
            assert np.ptp(corners @ normal) < 1e-4
            if normal[2] > 1e-6:  # a window in the roof
                assert _is_in_a_slope(home.plan, corners, normal)
                continue
            assert all(wall.covers(Point(corner)) for corner in corners[:, :2])
            outside = corners[:, :2].mean(axis=0) + home.plan.outer_thickness * normal[:2]
            assert not Polygon(home.plan.outline).contains(Point(outside))
            assert rooms[portal.room or ""].distance(Point(corners[0])) < home.plan.outer_thickness
            around = np.cross(corners[1] - corners[0], corners[2] - corners[1])
            assert abs(around @ normal) == pytest.approx(np.linalg.norm(around))


def _is_in_a_slope(plan: Plan, corners: np.ndarray, normal: np.ndarray) -> bool:
    """Test that a portal is parallel to a slope and within the roof above it."""
    for slope in plan.slopes:
        above = corners[:, 2] - slope.height_at(corners[:, 0], corners[:, 1])
        steep = np.array([*slope.edge.inward, 0.0]) + np.array([0, 0, slope.rise])
        inside = Polygon(plan.inner).covers(shapely.MultiPoint(corners[:, :2]))
        if np.ptp(above) < 1e-4 and abs(normal @ steep) < 1e-6 and inside:
            return bool(0.02 < above[0] < COVER)
    return False


def test_light_enters_a_home_through_portals_only(homes: list[Home]) -> None:
    """Rays in all directions from inside the rooms leave through portals only."""
    set_variant("auto")
    for home in homes[: 4 if mi.variant().startswith("scalar") else len(homes)]:
        scene = mi.load_file(str(home.scene.xml), optimize=False, parallel=False)
        outdoors = {
            shape
            for item in home.scene.objects
            if item.id.startswith("outside")
            for shape in item.shapes
        }
        rng = generator(home.seed, "leaks")
        origins, directions = _rays_inside(home, rng, 400 if mi.variant()[0] == "s" else 20_000)
        distance, names = _trace(scene, origins, directions)
        left = [name is None or name in outdoors for name in names]
        through = np.zeros(len(origins), dtype=bool)
        for portal in home.scene.portals:
            through |= _crosses(origins, directions, distance, portal) & portal.clear
        escaped = np.flatnonzero(np.array(left) & ~through)
        assert len(escaped) == 0, [
            (origins[k].tolist(), directions[k].tolist(), names[k]) for k in escaped[:3]
        ]
        assert np.array(left).any(), "no ray left through a window: the test shows nothing"


def _rays_inside(home: Home, rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Origins and directions (N, 3); half aim at the seams of walls, floors and ceilings."""
    origins, directions = [], []
    each = count // len(home.scene.rooms)
    for room in home.scene.rooms:
        x, y = Polygon(room.floor).representative_point().coords[0]
        origin = np.array([x, y, 0.5 * (room.floor_z + room.ceiling_z)])
        free = rng.normal(size=(each // 2, 3))
        corners = np.array(room.floor)
        which = rng.integers(len(corners), size=each // 2)
        along = rng.random((each // 2, 1))
        seam = corners[which] * (1 - along) + corners[(which + 1) % len(corners)] * along
        heights = rng.choice([room.floor_z, room.ceiling_z], size=each // 2)
        upright = rng.random(each // 2) < 0.3  # the vertical edges between walls too
        seam = np.where(upright[:, None], corners[which], seam)
        heights = np.where(upright, rng.uniform(room.floor_z, room.ceiling_z, each // 2), heights)
        aimed = np.column_stack([seam, heights]) - origin + rng.normal(0, 3e-4, (each // 2, 3))
        block = np.concatenate([free, aimed])
        origins.append(np.broadcast_to(origin, block.shape))
        directions.append(block / np.linalg.norm(block, axis=1, keepdims=True))
    return np.concatenate(origins), np.concatenate(directions)


def _trace(scene: Any, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, list]:
    """Distance, and id of the shape that is hit or None, of each ray."""
    shapes = [shape.id() for shape in scene.shapes()]
    if mi.variant().startswith("scalar"):
        hits = [
            scene.ray_intersect(mi.Ray3f(mi.Point3f(*o), mi.Vector3f(*d)))
            for o, d in zip(origins.tolist(), directions.tolist(), strict=True)
        ]
        found = [hit.is_valid() for hit in hits]
        names = [hit.shape.id() if ok else None for hit, ok in zip(hits, found, strict=True)]
        return np.array(
            [hit.t if ok else np.inf for hit, ok in zip(hits, found, strict=True)]
        ), names
    ray = mi.Ray3f(mi.Point3f(origins.T), mi.Vector3f(directions.T))
    hit = scene.ray_intersect(ray)
    valid = np.array(hit.is_valid())
    pointers = np.array(dr.reinterpret_array(mi.UInt32, hit.shape))
    table = {
        int(np.array(dr.reinterpret_array(mi.UInt32, pointer))[0]): name
        for pointer, name in zip(
            (mi.ShapePtr(shape) for shape in scene.shapes()), shapes, strict=True
        )
    }
    return np.where(valid, np.array(hit.t), np.inf), [
        table[int(pointer)] if ok else None for pointer, ok in zip(pointers, valid, strict=True)
    ]


def _crosses(
    origins: np.ndarray, directions: np.ndarray, distance: np.ndarray, portal: Any
) -> np.ndarray:
    corners, normal = np.array(portal.polygon), np.array(portal.normal)
    facing = directions @ normal
    with np.errstate(divide="ignore", invalid="ignore"):
        t = ((corners[0] - origins) @ normal) / facing
    points = origins + np.where(np.isfinite(t), t, 0)[:, None] * directions
    low, high = corners.min(axis=0) - 2e-3, corners.max(axis=0) + 2e-3
    within = ((points >= low) & (points <= high)).all(axis=1)
    return np.asarray((facing > 0) & (t > 0) & (t < distance) & within)


def test_lamps_emit_their_lumens(homes: list[Home]) -> None:
    # A plane of 2 m^2: flux = pi x area x radiance; its luminance in lumens is the lamp's flux.
    part = PiecePart(
        "disc",
        np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0.0]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
        np.zeros((4, 2)),
        Material("paper", (0.8, 0.8, 0.8)),
        lumens=1500.0,
        kelvin=3000.0,
    )
    found = re.search(r'radiance" value="([^"]+)"', area_emitter(part))
    assert found is not None
    radiance = np.array([float(word) for word in found.group(1).split()])
    flux = math.pi * 2.0 * float(luminance(radiance))
    assert flux == pytest.approx(1500 * LUMEN, rel=1e-4)
    assert radiance[0] > radiance[1] > radiance[2]  # 3000 K is reddish
    for home in homes:
        lamps = [light for light in home.scene.lights if light.kind == "area" and light.room]
        outside = [light for light in home.scene.lights if light.id.startswith("outside-")]
        dark = home.scene.source["light"].get("sky_scale", 0.0) < 0.2
        assert dark or not outside, "streets and other homes are lit in the dark"
        lit = {lamp.room for lamp in lamps}
        windows = {portal.room for portal in home.scene.portals if portal.clear}
        if home.scene.lighting == "day":
            assert not lit & windows
        assert lit | windows == {room.id for room in home.scene.rooms}  # no room is dark
        assert all(1 <= (lamp.lumens or 0) <= 6000 for lamp in lamps)  # 1 lm: a telephone's screen
        if home.scene.lighting == "night":
            assert lit == {room.id for room in home.scene.rooms}


def test_light_of_pbrs_is_white_uniform_and_complete(homes: list[Home], tmp_path: Path) -> None:
    home = min((one for one in homes if one.scene.lighting != "day"), key=_room_count)
    made = make_home(tmp_path / "pbrs", "pbrs", SMALL.home(home.seed, "pbrs"))
    assert made.lighting == "pbrs" and not [one for one in _still(made) if _is_outside(one[0])]
    assert _still(made) == [one for one in _still(home.scene) if not _is_outside(one[0])]
    lit = {light.id for light in made.lights if light.kind == "area"}
    lamps = {item.id for item in made.objects if item.category == "lamp"}
    assert lamps and lamps <= lit, "every lamp is on"
    root = defusedxml.ElementTree.parse(made.xml).getroot()
    (sky,) = root.findall("emitter")
    assert sky.get("type") == "constant" and not root.findall(".//emitter/texture")
    (white,), (bulb,) = (_radiances(root, path) for path in ("emitter/rgb", "shape/emitter/rgb"))
    assert white == (white[0],) * 3
    assert bulb == pytest.approx((white[0] * 400 / 75,) * 3)
    varied = replace(SMALL, vary=("furniture",)).home(home.seed, "pbrs", 1)
    other = make_home(tmp_path / "v", "v", varied)
    assert other.source["light"] == made.source["light"] and _still(other) != _still(made)


def test_homes_without_outdoors_keep_the_rest(homes: list[Home], tmp_path: Path) -> None:
    home = min(homes, key=_room_count)
    bare = replace(SMALL, outdoors="none").home(home.seed, home.scene.lighting)
    made = make_home(tmp_path / "bare", "bare", bare)
    assert _still(made) == [one for one in _still(home.scene) if not _is_outside(one[0])]
    assert made.source["light"] == home.scene.source["light"]


def _is_outside(name: str) -> bool:
    return name.startswith("outside") and "cloud" not in name


def _radiances(root: Any, path: str) -> set[tuple[float, ...]]:
    texts = [item.get("value") for item in root.findall(path)]
    return {tuple(float(word) for word in text.split()) for text in texts}


def test_screens_show_pictures_of_their_flux(tmp_path: Path) -> None:
    set_variant("auto")
    television = FURNITURE_KINDS["television"].make(generator(0), make_style(generator(0)))
    part = next(part for part in television.parts if part.picture is not None)
    (tmp_path / "textures").mkdir()
    library = MaterialLibrary(tmp_path, 64)
    image = library.display(part.picture or 0, mean_radiance(part))
    bitmap = mi.Bitmap(str(tmp_path / image)).convert(mi.Bitmap.PixelFormat.RGB)
    pixels = np.array(bitmap).astype(np.float64)
    area = face_areas(part.vertices[part.faces])[0].sum()
    flux = math.pi * area * float(luminance(pixels).mean())
    assert flux == pytest.approx(part.lumens * LUMEN, rel=5e-3)
    assert 15 < part.lumens < 300
    assert f'value="{image}"' in area_emitter(part, image=image)
    assert pixels.std() > 0.1 * pixels.mean()  # a picture, not a glow
    item = SceneItem("tv", "television", "television", television.parts, False, "room")
    assert lamp_items([item]) == []
    states = [draw_screen_states(generator(k), "night", [item]) for k in range(40)]
    assert 5 < sum(map(bool, states)) < 35
    assert not any(draw_screen_states(generator(k), "day", [item]) for k in range(40))
    (off,) = [in_state(one, None) for one in item.parts if one.picture is not None]
    assert off.lumens == 0


def test_a_variant_keeps_the_plan_and_differs_in_what_may_vary(
    homes: list[Home], tmp_path: Path
) -> None:
    home = min(homes, key=_room_count)

    def variant(number: int, *vary: str) -> Scene:
        folder = tmp_path / "-".join([str(number), *vary])
        twin = replace(SMALL, vary=vary).home(home.seed, home.scene.lighting, number)
        return make_home(folder, "twin", twin)

    def furniture(scene: Scene) -> list[Any]:
        return [(item.id, item.bbox_min) for item in scene.objects if not item.is_structure]

    def outdoors(scene: Scene) -> list[Any]:
        return [each for each in _still(scene) if each[0].startswith("outside")]

    def materials(scene: Scene) -> str:
        text = (scene.folder / "scene.xml").read_text()
        clouds = re.search(r'id="outside-clouds.0".*?<ref id="([^"]+)"', text)
        made = re.findall(r"<bsdf.*?</bsdf>", text, re.DOTALL)
        return "".join(one for one in made if clouds is None or f'id="{clouds[1]}"' not in one)

    plain = home.scene
    one = variant(1, "finishes", "furniture", "light", "outdoors")
    assert one.plan == plain.plan
    assert [room.floor for room in one.rooms] == [room.floor for room in plain.rooms]
    assert one.portals == plain.portals
    assert furniture(one) != furniture(plain) and outdoors(one) != outdoors(plain)
    assert materials(one) != materials(plain)
    assert one.source["light"] != plain.source["light"]
    assert one.source["varied"] == ["finishes", "furniture", "light", "outdoors"]
    light = variant(1, "light")
    assert furniture(light) == furniture(plain) and outdoors(light) == outdoors(plain)
    assert materials(light) == materials(plain)
    assert light.source["light"] != plain.source["light"]
    outside = variant(1, "outdoors")
    assert furniture(outside) == furniture(plain) and outdoors(outside) != outdoors(plain)
    assert outside.source["light"] == plain.source["light"]


def test_rooms_are_furnished(homes: list[Home]) -> None:
    for home in homes:
        for room in home.scene.rooms:
            inside = [item for item in furniture_of(home) if item.room == room.id]
            assert len(inside) >= 5, f"seed {home.seed}: {room.name} has {len(inside)} things"
            shape = Polygon(room.floor).buffer(2e-3)
            for item in inside:
                for slope in home.plan.slopes:
                    x, y, z = home.triangles(item).reshape(-1, 3).T
                    assert (z < slope.height_at(x, y) + 2e-3).all(), f"{home.seed}: {item.id}"
                for footprint, low, high in home.bodies[item.id]:
                    assert low > -2e-3 and high < room.ceiling_z + 2e-3, item.id
                    in_bay = item.bbox_min[2] > 0.2
                    assert in_bay or shape.covers(footprint), f"seed {home.seed}: {item.id}"


def test_nothing_intersects(homes: list[Home]) -> None:
    for home in homes:
        assert crossings(Solids(home.scene)) == [], f"seed {home.seed}"


def test_furniture_leaves_room_for_skirting(homes: list[Home]) -> None:
    for home in homes:
        for room in home.scene.rooms:
            trim = [item for item in home.scene.objects if item.id == f"trim-{room.id}"]
            if not trim or trim[0].bbox_min[2] > 0.1:
                continue
            high = min(top for _, low, top in home.bodies[trim[0].id] if low < 0.1)
            clear = Polygon(room.floor).buffer(-0.013, join_style="mitre")
            for item in furniture_of(home):
                for footprint, low, _ in home.bodies[item.id]:
                    if item.room == room.id and low < high - 0.005:
                        assert clear.covers(footprint), f"seed {home.seed}: {item.id}"


def _boxes_meet(first: SceneObject, second: SceneObject) -> bool:
    low = np.maximum(first.bbox_min, second.bbox_min)
    high = np.minimum(first.bbox_max, second.bbox_max)
    return bool((high - low > _TOUCH).all())


def test_nothing_floats(homes: list[Home]) -> None:
    """Each object is on the floor, on another object, at the ceiling or on a wall.

    Cloth may sink up to 2 cm into a cushion, and hang over or from what reaches nearly as high as
    it does; cushions lie on what they sink into. Notes stick to the front of a fridge.
    """
    for home in homes:
        for room in home.scene.rooms:
            walls = Polygon(room.floor).exterior
            solid = [
                item
                for item in home.scene.objects
                if item.room == room.id and (not item.is_structure or item.category == "window")
            ]
            for item in solid:
                if item.is_structure:
                    continue
                low, high = item.bbox_min[2], item.bbox_max[2]
                footprint = shapely.box(*item.bbox_min[:2], *item.bbox_max[:2])
                held = (
                    low < 0.003
                    or high > room.ceiling_z - 0.003
                    or (low > 0.005 and walls.distance(footprint) < 0.004)
                    or any(
                        -0.02 < low - top < 0.012 and footprint.intersects(below)
                        for other in solid
                        if other.id != item.id
                        for below, _, top in home.bodies[other.id]
                    )
                )
                held = held or (
                    (item.category in HANGING or any(one in item.id for one in ON_HOOKS))
                    and (_hangs_from(home, item, solid) or _hangs_over(home, item, solid))
                )
                held = held or (item.category == "paper" and _sticks(home, item, solid))
                held = held or any(
                    -0.02 < low - level < 0.012 and niche.footprint.covers(footprint.centroid)
                    for niche in home.plan.niches
                    if niche.room == room.id
                    for level in (niche.hole[2], *niche.boards)
                )
                assert held, f"seed {home.seed}: {item.id} floats at {low:.3f}"


def _hangs_from(home: Home, cloth: SceneObject, others: list[SceneObject]) -> bool:
    """Return True if the upper edge of the cloth meets a hook, a rod or its rings."""
    place = shapely.box(*cloth.bbox_min[:2], *cloth.bbox_max[:2])
    return any(
        low - 0.03 < cloth.bbox_max[2] < high + 0.01 and place.intersects(body)
        for other in others
        if other.id != cloth.id
        for body, low, high in home.bodies[other.id]
    )


def _sticks(home: Home, note: SceneObject, others: list[SceneObject]) -> bool:
    """Return True if an upright surface that is as high lies 4 mm or less behind a note."""
    place = shapely.box(*note.bbox_min[:2], *note.bbox_max[:2])
    return any(
        low < note.bbox_min[2] and note.bbox_max[2] < high and body.distance(place) < 0.004
        for other in others
        if other.id != note.id
        for body, low, high in home.bodies[other.id]
    )


def _hangs_over(home: Home, cloth: SceneObject, others: list[SceneObject]) -> bool:
    """Return True if a fiftieth of the cloth lies within 3 cm above other objects."""
    below = [
        home.triangles(other)
        for other in others
        if other.id != cloth.id and _boxes_meet(cloth, other)
    ]
    if not below:
        return False
    points = home.triangles(cloth).mean(axis=1)
    down = RayCaster(np.concatenate(below)).cast(points, np.array([0.0, 0.0, -1.0]))[0]
    return bool((down < 0.03).mean() > 0.02)


def test_rooms_can_be_walked(homes: list[Home]) -> None:
    """Floor wide enough for a person of 0.4 m joins all doors of a room."""
    for home in homes:
        for room in home.plan.rooms:
            items = [item for item in furniture_of(home) if item.room == room.id]
            standing = [
                footprint
                for item in items
                for footprint, low, high in home.bodies[item.id]
                if high > 0.07 and low < 1.7
            ] + [niche.footprint for niche in home.plan.niches if niche.room == room.id]
            blocked = shapely.union_all(standing).buffer(0.2) if standing else Polygon()
            lows = [
                slope.strip((1.7 - slope.height) / slope.rise)
                for slope in home.plan.slopes
                if slope.knee < 1.7
            ]
            free = room.shape.buffer(-0.2, join_style="mitre").difference(blocked)
            free = free.difference(shapely.union_all(lows))
            patches = list(getattr(free, "geoms", [free]))
            doors = [
                _before(home.plan, room.id, opening)
                for opening in home.plan.openings
                if room.id in opening.rooms and opening.kind != "window"
            ]
            reached = [
                {k for k, patch in enumerate(patches) if patch.distance(door) < 0.45}
                for door in doors
            ]
            assert not reached or set.intersection(*reached), f"seed {home.seed}: {room.id}"
            assert max(patch.area for patch in patches) > 0.06 * room.shape.area


def _before(plan: Plan, room_id: str, opening: Any) -> Point:
    depth = 0.35 if opening.rooms[0] == room_id else -opening.thickness - 0.35
    return Point(opening.edge.at(opening.width / 2, depth))


def test_the_sensor_stands_free(homes: list[Home]) -> None:
    for home in homes:
        found = re.search(r'lookat origin="([^"]+)"', (home.folder / "scene.xml").read_text())
        assert found is not None
        eye = np.array([float(value) for value in found.group(1).split(",")])
        for item in home.scene.objects:
            if item.category == "stairs" or not item.is_structure:
                inside = (eye > item.bbox_min).all() and (eye < item.bbox_max).all()
                assert not inside, f"seed {home.seed}: the sensor is in {item.id}"
    assert any(item.category == "stairs" for home in homes for item in home.scene.objects)


def test_floors_and_walls_are_textured_in_real_scale(homes: list[Home]) -> None:
    """A uv unit is one period of the texture and has the same length in metres everywhere."""
    sides = {"tiles": (0.2, 2.8), "planks": (0.8, 4.0), "carpet": (0.3, 3), "plaster": (0.3, 3)}
    seen = set()
    for home in homes[:3]:
        text = (home.folder / "scene.xml").read_text()
        assert "to_uv" not in text
        for name in [f"floor-{room.id}.0" for room in home.scene.rooms] + ["walls-room-0.0"]:
            mesh = home.mesh(name)
            assert mesh.uvs is not None
            ua, ub, uc = (mesh.uvs[mesh.faces[:, k]] for k in range(3))
            areas, normals = face_areas(mesh.corners)
            area = 2 * areas
            e, f = ub - ua, uc - ua
            flat = np.abs(e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0])
            shown = area > 0
            if name.startswith("floor"):  # the sides of the slab are hidden in the walls
                shown = np.abs(normals[:, 2]) > 0.5
            metres = np.sqrt(area[shown].sum() / flat[shown].sum())
            assert flat[shown] * metres**2 == pytest.approx(area[shown], rel=2e-3, abs=1e-6)
            found = re.search(rf'id="{name}".*?<ref id="(([a-z]+)-[^"]*)"', text)
            assert found is not None
            kind = found[2]
            low, high = sides.get(kind, (0.2, 3.0))
            if (home.folder / "textures" / f"{found[1]}-rough.png").exists():
                # It shows traces of use: one image over the whole floor.
                low = high = float(np.sqrt(np.ptp(mesh.vertices[:, :2], axis=0).prod()))
                low, high = 0.97 * low, 1.03 * high  # whole texels
            assert low * 0.999 <= metres <= high * 1.001, (name, kind, metres)
            seen.add(kind)
    assert {"tiles", "planks"} & seen


def test_mitsuba_shows_the_top_row_of_an_image_at_v_0() -> None:
    set_variant("auto")
    ruler = np.zeros((4, 4, 3), np.uint8)
    ruler[0] = 255  # top row of the file
    texture = mi.load_dict(
        {
            "type": "bitmap",
            "bitmap": mi.Bitmap(ruler),
            "raw": True,
            "filter_type": "nearest",
        }
    )
    si = dr.zeros(mi.SurfaceInteraction3f)
    for v, expected in ((0.05, 1.0), (0.95, 0.0)):
        si.uv = mi.Point2f(0.5, v)
        assert float(np.array(texture.eval(si)).ravel()[0]) == expected


RULES = (
    test_meshes_are_sound,
    test_rooms_are_furnished,
    test_nothing_intersects,
    test_furniture_leaves_room_for_skirting,
    test_nothing_floats,
    test_rooms_can_be_walked,
    test_portals_lie_in_outer_walls_and_face_outdoors,
)


@pytest.mark.check
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("first", range(1000, 2000, 20))
def test_a_thousand_homes_are_sound(first: int, tmp_path: Path) -> None:
    forms = set()
    for seed in range(first, first + 20):
        home = home_of(tmp_path, seed)
        for rule in RULES:
            rule([home])
        size = sum(path.stat().st_size for path in (home.folder / "meshes").iterdir())
        forms.add((home.scene.source["style"], len(home.scene.objects), size))
        shutil.rmtree(home.folder)
    assert len(forms) == 20, "no two are alike"
