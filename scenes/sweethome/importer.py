"""Importer of one Sweet Home 3D home: read, build, furnish, light, write."""

from __future__ import annotations

import math
import re
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import shapely
from shapely.geometry import Point, Polygon
from shapely.geometry.base import BaseGeometry

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.contract import Light, Portal, Room, Scene, load_scene, save_scene, writing_scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.formats.archive import MAX_XML, HomeArchive
from pbrnet.scenes.formats.java_objects import MAX_BYTES
from pbrnet.scenes.formats.model_parts import UnreadableModel
from pbrnet.scenes.geometry.mesh import face_areas
from pbrnet.scenes.geometry.regions import buffered, deepest_point, simplified, union
from pbrnet.scenes.importing.categories import category_of_piece, room_type
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.light.plan import note_filled, note_without_light
from pbrnet.scenes.importing.materials.textures import TextureStore
from pbrnet.scenes.opened_files import OpenedFiles
from pbrnet.scenes.reconstruction.gap_sealing import GAP_SEALING_ID
from pbrnet.scenes.sweethome.building.gaps import find_gaps
from pbrnet.scenes.sweethome.building.levels import Storey, storeys
from pbrnet.scenes.sweethome.building.openings import Opening, opening_of
from pbrnet.scenes.sweethome.building.outlines import is_round
from pbrnet.scenes.sweethome.building.portals import Doorway, Leaves, find_doorways
from pbrnet.scenes.sweethome.building.slabs import (
    CeilingHeights,
    build_ground,
    build_slabs,
    floor_outline,
    stairwells,
)
from pbrnet.scenes.sweethome.building.solids import world_region
from pbrnet.scenes.sweethome.building.spaces import Space, find_spaces
from pbrnet.scenes.sweethome.building.walls import PlannedWall, build_walls, plan_walls
from pbrnet.scenes.sweethome.credits import Credits
from pbrnet.scenes.sweethome.furnishing.finishes import BsdfWriter
from pbrnet.scenes.sweethome.furnishing.furniture import (
    PlacedModel,
    place_piece,
    place_without_model,
)
from pbrnet.scenes.sweethome.furnishing.items import PlacedItem, merge_parts
from pbrnet.scenes.sweethome.furnishing.lamps import hung_lamp, lit_parts
from pbrnet.scenes.sweethome.furnishing.missing import MissingPiece, missing_piece, note_missing
from pbrnet.scenes.sweethome.furnishing.models import Models
from pbrnet.scenes.sweethome.home import Home, HomePiece
from pbrnet.scenes.sweethome.java_home import home_xml
from pbrnet.scenes.sweethome.options import SweetHomeOptions
from pbrnet.scenes.sweethome.reader import read_home
from pbrnet.scenes.sweethome.sealing import seal_home
from pbrnet.scenes.sweethome.sun import Sky, make_sky
from pbrnet.scenes.sweethome.views import Camera, default_camera, stored_cameras
from pbrnet.scenes.sweethome.writer import write_scene

_KNEE = 0.5  # metres from a floor or ceiling into its room
_REST = 0.1  # of a room's floor, below which its ceiling is a rest
_SLIVER = 0.05  # metres: half the width of a rest of floor or ceiling that makes no room
_LEAST_HEIGHT = 1.5  # metres of a room at its highest; a crawl space is lower
_RESERVED_STEMS = (
    "wall",
    "floor",
    "ceiling",
    "skirting",
    "slab",
    "ground",
    GAP_SEALING_ID,
)  # beginnings of generated ids
MAX_TRIANGLES = 20_000_000  # of a whole home
# Pieces are lifted slightly, neighbours by different amounts, so that no faces coincide with
# floors, sills and tops of other pieces.
_LIFT, _LIFT_STEPS = 0.02, 8  # cm; number of different amounts


@dataclass(frozen=True)
class _Level:
    """A storey with its planned walls, openings, spaces and ceiling heights."""

    storey: Storey
    walls: list[PlannedWall]
    openings: list[Opening]
    spaces: list[Space]
    heights: CeilingHeights


def import_sweethome(
    path: Path, out: Path, scene_id: str, options: SweetHomeOptions, opened: OpenedFiles
) -> Scene:
    """Import a `.sh3d` into the scene folder `out`.

    The archive is the only file that it opens. Raises `InputError` that names file and element
    for everything that cannot be used.
    """
    opened.is_file(path)
    changes = Changes()
    with (
        HomeArchive(path) as archive,
        tempfile.TemporaryDirectory(prefix="pbrnet-home-") as unpacked,
        writing_scene(out) as folder,
    ):
        home = read_home(path, _home_xml(archive, changes), changes)
        levels = _planned_levels(home, options, changes)
        if not any(level.walls or level.storey.pieces for level in levels):
            raise InputError(f"{path}: the home is empty: no walls and no furniture")
        building = _building_items(levels, changes)
        rooms, regions = _rooms(levels, changes)
        indoors = _Indoors(rooms, regions)
        models = Models(archive, changes)
        credits = Credits(home, archive, path.stem, options.licence, options.author)
        cutting_pieces = _cutting_pieces(levels)
        pieces, missing = _furniture_items(
            levels, models, cutting_pieces, options, credits, changes
        )
        note_missing(missing, changes)
        below = [
            union([space.floor_slab for space in level.spaces])
            for level in levels
            if level.storey.elevation < -1
        ]
        items = [*building, *pieces]
        bounds = np.array([item.bounds for item in items])
        middle = 0.5 * (bounds[:, 0].min(axis=0) + bounds[:, 1].max(axis=0))
        items.append(build_ground(home.environment, below, middle[:2]))
        if sum(len(part.mesh.faces) for item in items for part in item.parts) > MAX_TRIANGLES:
            raise InputError(f"{path}: more than {MAX_TRIANGLES:,} triangles in all")
        items = [_with_room(item, indoors) for item in items]
        items = [replace(item, parts=tuple(merge_parts(item.parts))) for item in items]
        portals, joined = _portals(levels, indoors, pieces)
        lost = [(one, indoors.room_at(one.centre, 0.25)) for one in missing]
        sky = make_sky(home, options.time, changes)
        lit = _lit_rooms(items, [] if sky.is_night else portals, joined)
        rooms = _described_rooms(rooms, items, lost, lit)
        if options.lamps in ("auto", "fill"):
            lamps_added, rooms = _filled_with_light(rooms, changes)
            items += lamps_added
        note_without_light([room for room in rooms if not room.has_light], changes)
        items += seal_home(items, rooms, portals, changes)
        lamps = [item for item in items if item.lumens > 0]
        for texture in _textures(home):
            credits.texture(texture)
        sky = sky.beside(sum(_weight(item) for item in lamps))
        if not rooms:
            changes.note("NO ROOM WAS FOUND: draw rooms, or close the walls, to get views")
        cameras = _indoor_first(stored_cameras(home, changes), indoors, changes)
        finishes = BsdfWriter(
            archive, TextureStore(folder / "textures", changes), Path(unpacked), changes
        )
        camera = cameras[0] if cameras else default_camera(rooms, middle)
        objects = write_scene(folder, items, finishes, sky, camera, _weight)
        lights = tuple(
            Light(
                item.id,
                "area",
                tuple(
                    shape
                    for shape, part in zip(entry.shapes, item.parts, strict=True)
                    if part.radiance is not None
                ),
                item.room,
                round(item.lumens, 1),
            )
            for item, entry in zip(items, objects, strict=True)
            if item.lumens > 0
        )
        scene = Scene(
            scene_id=scene_id,
            source={
                "kind": "sweethome",
                "file": path.name,
                "version": home.version,
                "light": _light_record(sky),
                "views": [camera.as_view() for camera in cameras],
                "missing": [one.as_record(room) for one, room in lost],
            },
            rooms=tuple(rooms),
            objects=tuple(objects),
            lights=(*lights, *sky.lights),
            portals=tuple(portals),
            credits=credits.all(changes),
            lighting=_lighting(sky, bool(lights)),
            plan=scene_id,
            changes=changes.sentences(),
        )
        save_scene(folder, scene)
    return load_scene(out)


def _home_xml(archive: HomeArchive, changes: Changes) -> bytes:
    """`Home.xml` of the archive, made from serialised objects where the home is older than 5.3."""
    if "Home.xml" in archive:
        return archive.read("Home.xml", MAX_XML)
    if "Home" not in archive:
        raise InputError(f"{archive.path}: no Home.xml inside; not a Sweet Home 3D home")
    changes.note("the home is of a version before 5.3: its serialised objects were read")
    return home_xml(archive.read("Home", MAX_BYTES), f"{archive.path}: Home")


def _planned_levels(home: Home, options: SweetHomeOptions, changes: Changes) -> list[_Level]:
    made = []
    for storey in storeys(home, options.level, changes):
        walls = plan_walls(storey, home.wall_height, changes)
        openings = [
            opening
            for piece in storey.pieces
            if (opening := opening_of(piece, storey.elevation, changes)) is not None
        ]
        spaces = find_spaces(storey, walls, openings, changes)
        made.append(_Level(storey, walls, openings, spaces, CeilingHeights(storey, walls, spaces)))
    return made


def _building_items(levels: list[_Level], changes: Changes) -> list[PlacedItem]:
    wells = stairwells(
        [(piece, level.storey.elevation) for level in levels for piece in level.storey.pieces],
        changes,
    )
    openings = [opening for level in levels for opening in level.openings]
    items: list[PlacedItem] = []
    for level in levels:
        items += build_walls(level.storey, level.walls, openings)
        items += build_slabs(level.storey, level.spaces, level.heights, wells)
    return items


def _cutting_pieces(levels: list[_Level]) -> set[int]:
    """Return the `id()` of each piece whose opening cuts a wall of any level."""
    walls = [(one.outline.region, is_round(one.wall)) for level in levels for one in level.walls]
    regions = [region for region, _ in walls]
    tree = shapely.STRtree(regions)
    return {
        id(opening.piece)
        for level in levels
        for opening in level.openings
        if any(
            opening.depths(regions[number], walls[number][1]) is not None
            for number in tree.query(opening.footprint)
        )
    }


def _furniture_items(
    levels: list[_Level],
    models: Models,
    cutting_pieces: set[int],
    options: SweetHomeOptions,
    credits: Credits,
    changes: Changes,
) -> tuple[list[PlacedItem], list[MissingPiece]]:
    """Return the pieces as items, and the records of those whose model cannot be read."""
    items: list[PlacedItem] = []
    missing: list[MissingPiece] = []
    taken: dict[str, int] = {}
    for level in levels:
        for piece in level.storey.pieces:
            if min(piece.width, piece.height, piece.depth) <= 0:
                changes.note("pieces without size were left out: {}", piece.name or piece.id)
                continue
            category, is_structure = category_of_piece(
                piece.kind, piece.name, piece.catalog_id, piece.model or ""
            )
            elevation = level.storey.elevation
            try:
                lifted = elevation + _LIFT * (2 + len(taken) % _LIFT_STEPS)
                placed = _placed_model(piece, lifted, models, credits, changes)
            except UnreadableModel as error:
                missing.append(missing_piece(piece, category, elevation, str(error)))
                placed = place_without_model(piece, elevation)
            parts, lumens = placed.parts, 0.0
            if id(piece) in cutting_pieces:
                panes = [part for part in parts if part.finish.kind == "glass"]
                if panes:
                    changes.note("clear panes of doors and windows were left out: {}", piece.name)
                    parts = tuple(part for part in parts if part.finish.kind != "glass")
            if (piece.bulbs or piece.emissive_materials) and options.lamps != "off":
                lamp = piece
                if options.lamps == "on" and piece.power <= 0:
                    lamp = replace(piece, power=0.5)
                parts, lumens = lit_parts(lamp, parts, placed.to_world, changes)
            if not parts:
                continue
            name = _unique(piece.name or category, taken)
            items.append(
                PlacedItem(
                    name,
                    piece.name or category,
                    category,
                    parts,
                    is_structure,
                    None,
                    lumens,
                    level.storey.number,
                )
            )
    return items, missing


def _placed_model(
    piece: HomePiece, elevation: float, models: Models, credits: Credits, changes: Changes
) -> PlacedModel:
    if piece.model is None:
        raise UnreadableModel("the home names none")
    model = models.get(piece.model)
    placed = place_piece(piece, model, elevation, changes)
    credits.model(piece.name, piece.creator, piece.model, model)
    return placed


def _rooms(levels: list[_Level], changes: Changes) -> tuple[list[Room], list[BaseGeometry]]:
    """Return the indoor rooms and their regions on the plan; `changes` says why others are none."""
    rooms: list[Room] = []
    regions: list[BaseGeometry] = []
    for level in levels:
        solid = union([world_region(one.outline.region) for one in level.walls])
        for space in level.spaces:
            outline = floor_outline(space, solid)
            reason = _why_no_room(space, outline)
            if outline is None or reason:
                changes.note(reason, space.shape.name or space.shape.id)
                continue
            outline = simplified(outline, 1e-3)
            corners = np.asarray(shapely.geometry.polygon.orient(outline).exterior.coords)[:-1]
            floor = 0.01 * level.storey.elevation
            places = np.vstack([corners, deepest_point(outline)])
            heights = level.heights.over(space.ceiling, places)
            if heights.max() < floor + _LEAST_HEIGHT:
                changes.note(
                    f"rooms lower than {_LEAST_HEIGHT} m have no views: {{}}",
                    space.shape.name or space.shape.id,
                )
                continue
            rooms.append(
                Room(
                    id=f"room_{len(rooms)}",
                    name=space.shape.name,
                    type="other",
                    floor=tuple((round(float(x), 5), round(float(y), 5)) for x, y in corners),
                    floor_z=round(floor, 5),
                    ceiling_z=round(float(np.mean(heights[:-1])), 5),
                    has_light=False,
                )
            )
            regions.append(union([space.floor, space.ceiling]))
    return rooms, regions


def _why_no_room(space: Space, outline: Polygon | None) -> str:
    """Return the sentence that says why a space is no room for views; empty if it is one."""
    if not space.shape.ceiling_visible:
        return "rooms without a ceiling are outdoors and have no views: {}"
    if space.ceiling.is_empty or space.ceiling.area < _REST * space.floor.area:
        return "rooms below the ceiling of another have no views of their own: {}"
    if outline is None or any(
        buffered(part, -_SLIVER).is_empty for part in (outline, space.ceiling)
    ):
        return f"rooms narrower than {2 * _SLIVER} m have no views: {{}}"
    return ""


class _Indoors:
    """Rooms with their regions on the plan, indexed by place."""

    def __init__(self, rooms: list[Room], regions: list[BaseGeometry]) -> None:
        self._rooms = rooms
        self._regions = regions
        self._tree = shapely.STRtree(regions)

    def room_at(self, point: Sequence[float] | Float64Array, margin: float) -> str | None:
        """Return the room that contains a point (3,), the last of overlapping ones; or None."""
        x, y, z = (float(value) for value in point)
        around = shapely.box(x - margin, y - margin, x + margin, y + margin)
        for number in sorted(self._tree.query(around).tolist(), reverse=True):
            room = self._rooms[number]
            if (
                room.floor_z - 0.3 <= z <= room.ceiling_z + 0.3
                and self._regions[number].distance(Point(x, y)) <= margin
            ):
                return room.id
        return None


def _with_room(item: PlacedItem, indoors: _Indoors) -> PlacedItem:
    if item.category in ("wall", "ground", "structure", "skirting"):
        return item
    if item.is_structure and item.category in ("floor", "ceiling"):
        return replace(item, room=_room_of_slab(item, indoors))
    centre = item.centre
    for margin in (0.0, 0.25):
        room = indoors.room_at(centre, margin)
        if room is not None:
            return replace(item, room=room)
    return item


def _room_of_slab(item: PlacedItem, indoors: _Indoors) -> str | None:
    """Return the room that a floor or ceiling bounds by most of its area; None outdoors.

    The middle of its bounds may lie in another room: that of an L-shaped corridor, of a terrace
    around the house.
    """
    inwards = np.array([0.0, 0.0, 1.0 if item.category == "floor" else -1.0])
    found: dict[str | None, float] = {}
    for part in item.parts:
        corners = part.mesh.corners
        areas, normals = face_areas(corners)
        for number in np.flatnonzero(normals @ inwards > 0.5):
            middle = corners[number].mean(axis=0) + _KNEE * inwards
            room = indoors.room_at(middle, 0.0)
            found[room] = found.get(room, 0.0) + float(areas[number])
    return max(found, key=lambda room: found[room]) if found else None


def _portals(
    levels: list[_Level], indoors: _Indoors, pieces: list[PlacedItem]
) -> tuple[list[Portal], set[tuple[str, str]]]:
    """Return the portals to the outside, and the pairs of rooms with a clear opening between."""
    portals: list[Portal] = []
    joined: set[tuple[str, str]] = set()
    leaves = Leaves(pieces)
    regions = {
        level.storey.number: [(one.outline.region, is_round(one.wall)) for one in level.walls]
        for level in levels
    }
    trees = {
        number: shapely.STRtree([region for region, _ in walls])
        for number, walls in regions.items()
    }
    for level in levels:
        doorways: list[tuple[Doorway, Literal["window", "door", "opening"]]] = [
            (doorway, "door" if _is_door(opening) else "window")
            for opening in level.openings
            for doorway in find_doorways(
                opening,
                [
                    regions[level.storey.number][near]
                    for near in sorted(trees[level.storey.number].query(opening.footprint).tolist())
                ],
            )
        ]
        gaps = find_gaps(level.storey, level.spaces, level.walls, level.heights)
        for doorway, kind in (*doorways, *((gap, "opening") for gap in gaps)):
            sides = [indoors.room_at(point, 0.0) for point in (doorway.front, doorway.back)]
            is_clear = doorway.is_clear(leaves)
            if is_clear and sides[0] is not None and sides[1] is not None:
                joined |= {(sides[0], sides[1]), (sides[1], sides[0])}
            if (sides[0] is None) == (sides[1] is None):
                continue
            room = sides[0] or sides[1]
            outward = doorway.normal if sides[0] is None else -doorway.normal
            polygon = doorway.polygon if sides[0] is None else doorway.polygon[::-1]
            portals.append(
                Portal(
                    id=f"portal_{len(portals)}",
                    kind=kind,
                    polygon=tuple((float(x), float(y), float(z)) for x, y, z in polygon),
                    normal=(float(outward[0]), float(outward[1]), float(outward[2])),
                    clear=is_clear,
                    room=room,
                )
            )
    return portals, joined


def _is_door(opening: Opening) -> bool:
    piece = opening.piece
    return category_of_piece(piece.kind, piece.name, piece.catalog_id)[0] == "door"


def _indoor_first(
    cameras: list[Camera],
    rooms: _Indoors,
    changes: Changes,
) -> list[Camera]:
    """Return the cameras in a room, then the stored ones outside; the visitor's only in a room."""
    indoors = [rooms.room_at(camera.eye, 0.0) is not None for camera in cameras]
    outdoors = [
        camera
        for camera, is_in in zip(cameras, indoors, strict=True)
        if not is_in and not camera.is_observer
    ]
    for camera in outdoors:
        changes.note(
            "stored views outside every room become views only with cameras.outside_views: {}",
            camera.name,
        )
    return [camera for camera, is_in in zip(cameras, indoors, strict=True) if is_in] + outdoors


def _described_rooms(
    rooms: list[Room],
    items: list[PlacedItem],
    lost: list[tuple[MissingPiece, str | None]],
    lit: set[str | None],
) -> list[Room]:
    """Add names, types and `has_light` to the rooms; missing pieces also indicate the type."""
    names: dict[str, int] = {}
    made = []
    contents: dict[str | None, list[str]] = {}
    for item in items:
        if not item.is_structure:
            contents.setdefault(item.room, []).append(item.category)
    for one, place in lost:
        contents.setdefault(place, []).append(one.category)
    for room in rooms:
        kind = room_type(room.name, contents.get(room.id, []))
        name = room.name or kind
        names[name] = names.get(name, 0) + 1
        if names[name] > 1:
            name = f"{name} {names[name]}"
        made.append(replace(room, name=name, type=kind, has_light=room.id in lit))
    return made


def _lit_rooms(
    items: list[PlacedItem], portals: list[Portal], joined: set[tuple[str, str]]
) -> set[str | None]:
    """Return the rooms with a lamp that is on or a clear portal, and those joined with one.

    At night, `portals` are none: a window gives no light then.
    """
    lit = {item.room for item in items if item.lumens > 0}
    lit |= {portal.room for portal in portals if portal.clear}
    return lit | {there for here, there in joined if here in lit}


def _filled_with_light(rooms: list[Room], changes: Changes) -> tuple[list[PlacedItem], list[Room]]:
    """Return ceiling lamps for the rooms without light, and the rooms with light."""
    dark = [room for room in rooms if not room.has_light]
    note_filled(dark, changes)
    lamps = [hung_lamp(room, number) for number, room in enumerate(dark)]
    return lamps, [replace(room, has_light=True) for room in rooms]


def _textures(home: Home) -> list:
    surfaces = [side for wall in home.walls for side in (wall.left, wall.right)]
    surfaces += [side for room in home.rooms for side in (room.floor, room.ceiling)]
    found = [surface.texture for surface in surfaces]
    found += [piece.texture for piece in home.pieces]
    found += [material.texture for piece in home.pieces for material in piece.materials]
    return [*found, home.environment.ground_texture]


def _weight(item: PlacedItem) -> float:
    """Return the sampling weight of a lamp: the square root of its flux over 800 lm."""
    return round(math.sqrt(item.lumens / 800.0), 4)


def _light_record(sky: Sky) -> dict[str, Any]:
    return {
        "time": sky.when,
        "sun_elevation": round(sky.elevation, 3),
        "sun_azimuth": round(sky.azimuth, 3),
    }


def _lighting(sky: Sky, has_lamps: bool) -> str:
    if sky.is_day:
        return "mixed" if has_lamps else "day"
    return "night" if sky.is_night else "evening"


def _unique(name: str, taken: dict[str, int]) -> str:
    """A new id that resembles a name; `taken` maps ids to the last number tried after them."""
    stem = re.sub(r"[^A-Za-z0-9]+", "-", name).strip("-")[:60].lower() or "piece"
    if stem.partition("-")[0] in _RESERVED_STEMS:
        stem = f"piece-{stem}"
    made, count = stem, taken.get(stem, 1)
    while made in taken:
        count += 1
        made = f"{stem}-{count}"
    taken[made] = 1
    taken[stem] = count
    return made
