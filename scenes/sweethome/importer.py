"""Importer of one Sweet Home 3D home: read, build, furnish, light, write."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from shapely.geometry.base import BaseGeometry

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.contract import (
    Light,
    Portal,
    Room,
    Scene,
    SceneObject,
    load_scene,
    save_scene,
    writing_scene,
)
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.formats.archive import MAX_XML, HomeArchive
from pbrnet.scenes.geometry.regions import union
from pbrnet.scenes.importing.changes import NO_ROOM, Changes
from pbrnet.scenes.importing.light.plan import note_filled, note_without_light
from pbrnet.scenes.importing.materials.textures import TextureStore
from pbrnet.scenes.installation import optional
from pbrnet.scenes.opened_files import OpenedFiles
from pbrnet.scenes.sweethome.building.plan import Level, building_items, planned_levels
from pbrnet.scenes.sweethome.building.slabs import build_ground
from pbrnet.scenes.sweethome.credits import Credits
from pbrnet.scenes.sweethome.furnishing.finishes import BsdfWriter
from pbrnet.scenes.sweethome.furnishing.items import PlacedItem, merge_parts
from pbrnet.scenes.sweethome.furnishing.lamps import hung_lamp
from pbrnet.scenes.sweethome.furnishing.missing import MissingPiece, note_missing
from pbrnet.scenes.sweethome.furnishing.models import Models
from pbrnet.scenes.sweethome.home import Home
from pbrnet.scenes.sweethome.options import SweetHomeOptions
from pbrnet.scenes.sweethome.pieces import furniture_items
from pbrnet.scenes.sweethome.reader import read_home
from pbrnet.scenes.sweethome.rooms import (
    Indoors,
    described_rooms,
    find_portals,
    indoor_rooms,
    lit_rooms,
    with_room,
)
from pbrnet.scenes.sweethome.sealing import seal_home
from pbrnet.scenes.sweethome.sun import Sky, make_sky
from pbrnet.scenes.sweethome.views import Camera, default_camera, stored_cameras
from pbrnet.scenes.sweethome.writer import write_scene

MAX_TRIANGLES = 20_000_000  # of a whole home


@dataclass(frozen=True)
class _Built:
    """A home as items in rooms, in metres, Z up."""

    items: list[PlacedItem]
    rooms: list[Room]
    indoors: Indoors
    portals: list[Portal]
    lost: list[tuple[MissingPiece, str | None]]  # pieces without a model, and their rooms
    sky: Sky
    middle: Float64Array  # (3,), of the bounds


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
        credits = Credits(home, archive, path.stem, options.licence, options.author)
        built = _build(home, archive, options, credits, changes)
        cameras = _indoor_first(stored_cameras(home, changes), built.indoors, changes)
        textures = TextureStore(folder / "textures", changes)
        finishes = BsdfWriter(archive, textures, Path(unpacked), changes)
        camera = cameras[0] if cameras else default_camera(built.rooms, built.middle)
        objects = write_scene(folder, built.items, finishes, built.sky, camera)
        lights = _lights(built.items, objects)
        scene = Scene(
            scene_id=scene_id,
            source={
                "kind": "sweethome",
                "file": path.name,
                "version": home.version,
                "light": _light_record(built.sky),
                "views": [camera.as_view() for camera in cameras],
                "missing": [one.as_record(room) for one, room in built.lost],
            },
            rooms=tuple(built.rooms),
            objects=tuple(objects),
            lights=(*lights, *built.sky.lights),
            portals=tuple(built.portals),
            credits=credits.all(changes),
            lighting=_lighting(built.sky, bool(lights)),
            plan=scene_id,
            joints=tuple(joint for item in built.items for joint in item.joints),
            changes=changes.sentences(),
        )
        save_scene(folder, scene)
    return load_scene(out)


def _build(
    home: Home,
    archive: HomeArchive,
    options: SweetHomeOptions,
    credits: Credits,
    changes: Changes,
) -> _Built:
    """Build walls and slabs, furnish and light the home, and seal its gaps."""
    levels = planned_levels(home, options, changes)
    if not any(level.walls for level in levels) and any(level.storey.rooms for level in levels):
        raise InputError(
            f"{archive.path}: the home has drawn rooms but no walls; draw walls around them"
        )
    if not any(level.walls or level.storey.pieces for level in levels):
        raise InputError(f"{archive.path}: the home is empty: no walls and no furniture")
    building = building_items(levels, changes)
    indoors = indoor_rooms(levels, changes)
    models = Models(archive, changes)
    pieces, missing = furniture_items(levels, models, options, credits, changes)
    note_missing(missing, changes)
    items = [*building, *pieces]
    bounds = np.array([item.bounds for item in items])
    middle = 0.5 * (bounds[:, 0].min(axis=0) + bounds[:, 1].max(axis=0))
    items.append(build_ground(home.environment, _cellars(levels), middle[:2]))
    if sum(len(part.mesh.faces) for item in items for part in item.parts) > MAX_TRIANGLES:
        raise InputError(f"{archive.path}: more than {MAX_TRIANGLES:,} triangles in all")
    items = [with_room(item, indoors) for item in items]
    items = [replace(item, parts=tuple(merge_parts(item.parts))) for item in items]
    portals, joined = find_portals(levels, indoors, pieces)
    lost = [(one, indoors.room_at(one.centre, 0.25)) for one in missing]
    sky = make_sky(home, options.time, changes)
    lit = lit_rooms(items, [] if sky.is_night else portals, joined)
    rooms = described_rooms(indoors.rooms, items, lost, lit)
    if options.lamps in ("auto", "fill"):
        lamps_added, rooms = _filled_with_light(rooms, changes)
        items += lamps_added
    note_without_light([room for room in rooms if not room.has_light], changes)
    items += seal_home(items, rooms, portals, changes)
    for texture in _textures(home):
        credits.texture(texture)
    sky = sky.beside(sum(item.sampling_weight for item in items if item.lumens > 0))
    if not rooms:
        changes.note(
            f"{NO_ROOM}: draw rooms and walls around them, or close the walls, to get views"
        )
    return _Built(items, rooms, indoors, portals, lost, sky, middle)


def _cellars(levels: list[Level]) -> list[BaseGeometry]:
    """Floors of the levels below the ground, on the plan."""
    return [
        union([space.floor_slab for space in level.spaces])
        for level in levels
        if level.storey.elevation < -1
    ]


def _lights(items: list[PlacedItem], objects: list[SceneObject]) -> tuple[Light, ...]:
    """Lamps that are on, as lights of the scene."""
    made = []
    for item, entry in zip(items, objects, strict=True):
        if item.lumens > 0:
            shapes = tuple(
                shape
                for shape, part in zip(entry.shapes, item.parts, strict=True)
                if part.radiance is not None
            )
            made.append(Light(item.id, "area", shapes, item.room, round(item.lumens, 1)))
    return tuple(made)


def _home_xml(archive: HomeArchive, changes: Changes) -> bytes:
    """`Home.xml` of the archive, made from serialised objects where the home is older than 5.3."""
    if "Home.xml" in archive:
        return archive.read("Home.xml", MAX_XML)
    if "Home" not in archive:
        raise InputError(f"{archive.path}: no Home.xml inside; not a Sweet Home 3D home")
    changes.note("the home is of a version before 5.3: its serialised objects were read")
    java = optional("pbrnet.scenes.sweethome.java_home")
    made: bytes = java.home_xml(archive.read("Home", java.MAX_BYTES), f"{archive.path}: Home")
    return made


def _indoor_first(
    cameras: list[Camera],
    rooms: Indoors,
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
