"""From shapes in metres to a scene folder: rooms, panes, portals, objects, lights; any source."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import chain, count
from pathlib import Path
from typing import Any, Literal, Protocol
from xml.etree.ElementTree import Element

import numpy as np
from shapely.geometry import box

from scenes.arrays import Float64Array
from scenes.contract import Credit, Light, Portal, Room, Scene, SceneObject, save_scene
from scenes.errors import InputError
from scenes.geometry.transforms import look_at
from scenes.importing.changes import Changes
from scenes.importing.daylight import ground
from scenes.importing.objects import bounds_of, group_objects, type_of_room
from scenes.importing.panes import frosted_openings, is_flat, remove_panes
from scenes.importing.sealing_shapes import filler_shape, part_of_building
from scenes.importing.shape import Emitter, Shape
from scenes.importing.writer import sensor_element, write_scene_xml
from scenes.reconstruction.aperture_sections import Cuts, seated
from scenes.reconstruction.enclosure import SHELL_ID, shell
from scenes.reconstruction.gap_sealing import CAULK_ID, caulk
from scenes.reconstruction.hidden_openings import hidden_openings
from scenes.reconstruction.orientation import crossings, guess_scale, tallest_gaps
from scenes.reconstruction.raycast import RayCaster
from scenes.reconstruction.rooms import FoundOpening, FoundRoom, find_openings, find_rooms

_LARGEST = 1e6  # metres that a scene may be across, skies and grounds included


@dataclass(frozen=True)
class Camera:
    """A pinhole camera, before it is written as a stored view."""

    name: str
    to_world: Float64Array  # Mitsuba's frame: x left, y up, z forward
    half_fov_x: float
    width: int
    height: int
    room: str = ""  # the source's own name for the room it stands in
    more: dict[str, Any] = field(default_factory=dict)  # what else the source says about it


class Grouping(Protocol):
    """How a source makes objects of its shapes, knowing the rooms and their ids."""

    def __call__(
        self, shapes: list[Shape], rooms: list[FoundRoom], room_ids: list[str]
    ) -> tuple[SceneObject, ...]: ...


@dataclass(frozen=True)
class Draft:
    """A scene in our world (metres, Z up) that still has to be surveyed and written."""

    scene_id: str
    source: dict[str, Any]  # for `scene.json`; its views are added here
    shapes: list[Shape]
    area: dict[str, Element]  # the emitters of shapes, by shape id
    emitters: list[Emitter]
    cameras: list[Camera]
    credits: tuple[Credit, ...]
    hint: str = ""  # words about the whole scene that may tell the type of its only room
    max_depth: int = 17
    grouping: Grouping = group_objects
    # The source's own names of rooms -> our ids, where it has names.
    room_names: Callable[[list[Shape], list[FoundRoom], list[str]], dict[str, str]] | None = None
    ground: bool = False  # lay ground below, for a sky that has none


def assemble(folder: Path, draft: Draft, changes: Changes) -> None:
    """Find the rooms and openings of `draft`, turn panes into portals, write everything to
    `folder`."""
    shapes, cameras = draft.shapes, draft.cameras
    rooms, openings = survey_rooms(shapes, cameras)
    shapes, glazed, openings = _open_up(shapes, rooms, openings)
    if glazed:
        changes.note("clear window panes became portals: {}", ", ".join(glazed))
    for shape in shapes:
        if shape.surface.invisible:
            changes.note("an invisible shape was left out: {}", shape.name)
    shapes = [shape for shape in shapes if not shape.surface.invisible]
    if not shapes:
        raise InputError(f"{draft.scene_id}: nothing of it is visible: all of it is clear glass")
    area = {shape.id: draft.area[shape.id] for shape in shapes if shape.id in draft.area}
    room_ids = [f"room_{index}" for index in range(len(rooms))]
    objects = draft.grouping(shapes, rooms, room_ids)
    names = draft.room_names(shapes, rooms, room_ids) if draft.room_names else {}
    if draft.ground:
        plain, thing = ground(*bounds_of(shapes))
        shapes, objects = [*shapes, plain], (*objects, thing)
    lights = _lights(shapes, area, draft.emitters, rooms, room_ids)
    taken = {shape.id for shape in shapes} | {thing.id for thing in objects}
    fillers, openings = _closed(shapes, rooms, openings, taken, changes)
    shapes = [*shapes, *fillers]
    objects = (*objects, *(part_of_building(filler) for filler in fillers))
    frosted = frosted_openings(shapes, openings)
    portals = _portals(openings, frosted, rooms, room_ids)
    if any(room.guessed for room in rooms):
        changes.note(
            "no closed room was found; the space around the camera or the middle stands for one"
        )
    if not rooms:
        rooms, room_ids = [_whole(shapes)], ["room_0"]
        changes.note("NO ROOM WAS FOUND: the whole scene's extent stands for one")
    camera = cameras[0] if cameras else _own_camera(rooms[0])
    write_scene_xml(folder, shapes, area, draft.emitters, _sensor(camera), draft.max_depth)
    lit = {light.room for light in lights} | {portal.room for portal in portals}
    everywhere = any(light.room is None and light.kind != "environment" for light in lights)
    views = [_view(camera, names) for camera in cameras]
    scene = Scene(
        scene_id=draft.scene_id,
        source={**draft.source, "views": views, **({"rooms": names} if names else {})},
        rooms=tuple(
            Room(
                id=name,
                name=f"{type_of_room(objects, name, draft.hint)} {index}",
                type=type_of_room(objects, name, draft.hint if len(rooms) == 1 else ""),
                floor=tuple((float(x), float(y)) for x, y in list(room.floor.exterior.coords)[:-1]),
                floor_z=room.floor_z,
                ceiling_z=room.ceiling_z,
                has_light=name in lit or everywhere or room.guessed,
            )
            for index, (name, room) in enumerate(zip(room_ids, rooms, strict=True))
        ),
        objects=objects,
        lights=lights,
        portals=portals,
        credits=draft.credits,
        lighting=_lighting(lights),
        plan=draft.scene_id,
        changes=changes.sentences(),
    )
    save_scene(folder, scene)


def moved(camera: Camera, frame: Float64Array, changes: Changes) -> Camera:
    """The camera in our world, its axes made rigid."""
    matrix = frame @ camera.to_world
    axes = matrix[:3, :3] / np.linalg.norm(matrix[:3, :3], axis=0)
    if np.linalg.det(axes) < 0:
        axes[:, 0] = -axes[:, 0]
        changes.note("a mirroring camera was turned into a proper one: {}", camera.name)
    forward = axes[:, 2]
    left = np.cross(axes[:, 1], forward)
    left /= np.linalg.norm(left)
    rigid = np.eye(4)
    rigid[:3, :3] = np.stack([left, np.cross(forward, left), forward], axis=1)
    rigid[:3, 3] = matrix[:3, 3]
    return replace(camera, to_world=rigid)


def guessed_scale(
    corners: Float64Array, cameras: list[Camera], turn: Float64Array, changes: Changes
) -> float:
    """Metres per unit from the height between floor and ceiling, around the camera if any."""
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    rays = RayCaster(corners)
    xs, ys = (np.linspace(low[axis], high[axis], 32)[1:-1] + 1e-4 for axis in (0, 1))
    points = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
    through = None
    if cameras:
        eye = turn @ cameras[0].to_world[:3, 3]
        if (eye > low).all() and (eye < high).all():
            points = np.concatenate([points, eye[None, :2]])
            through = float(eye[2])
    columns = crossings(rays, points, float(low[2]), float(high[2]))
    gaps = tallest_gaps(columns, through)
    if not len(gaps):
        changes.note(
            "no floor with a ceiling was found to tell the scale by; 1 unit was taken as 1 m"
        )
        return 1.0
    height = float(np.percentile(gaps[:, 1] - gaps[:, 0], 75))
    scale, unit = guess_scale(height)
    if scale != 1.0:
        changes.note(
            f"a room {height:.4g} units high: lengths were read as {unit} "
            "(say otherwise with --scale)"
        )
    return scale


def survey_rooms(
    shapes: list[Shape], cameras: list[Camera]
) -> tuple[list[FoundRoom], list[FoundOpening]]:
    """Rooms and openings; clear glass and frosted panes do not close an opening."""
    everything = np.concatenate([shape.mesh.corners for shape in shapes])
    extent = float(np.ptp(everything.reshape(-1, 3), axis=0).max())
    if extent > _LARGEST:
        raise InputError(
            f"the scene is {extent:.3g} m across, at most {_LARGEST:g} m are taken; say what its "
            "unit is with --scale, or mend the shape that lies so far out"
        )
    eye = cameras[0].to_world[:3, 3] if cameras else None
    rooms = find_rooms(RayCaster(everything), everything, eye)
    return rooms, find_openings(RayCaster(_solid_corners(shapes)), rooms)


def _open_up(
    shapes: list[Shape], rooms: list[FoundRoom], openings: list[FoundOpening]
) -> tuple[list[Shape], list[str], list[FoundOpening]]:
    """Shapes without clear panes, the ids of what had some, and all openings: those found, where
    their holes are narrowest, and those that only walks of light find."""
    shapes, glazed, openings = remove_panes(shapes, openings)
    corners = _solid_corners(shapes)
    cuts = Cuts(corners)
    openings = [seated(cuts, opening) for opening in openings]
    hidden, _ = hidden_openings(RayCaster(corners), cuts, rooms, openings)
    shapes, more, hidden = remove_panes(shapes, hidden)
    return shapes, [*glazed, *more], openings + hidden


def _closed(
    shapes: list[Shape],
    rooms: list[FoundRoom],
    openings: list[FoundOpening],
    taken: set[str],
    changes: Changes,
) -> tuple[list[Shape], list[FoundOpening]]:
    """What closes the cracks that light comes through, under ids that are not `taken`, and the
    openings that stay open."""
    fillers = []
    solid = _solid_corners(shapes)
    rays = RayCaster(solid)
    sheets, kept = shell(solid, rays, rooms, openings)
    if len(sheets):
        fillers.append(filler_shape(_unused(SHELL_ID, taken), sheets))
        solid, rays = np.concatenate([solid, sheets]), RayCaster(sheets, rays)
        changes.note("light came through cracks: a shell was set up behind walls, floors, ceilings")
    if len(kept) < len(openings):
        changes.note(f"openings up a fireplace were closed with it: {len(openings) - len(kept)}")
    slabs, made = caulk(solid, rays, rooms, kept)
    if made:
        fillers.append(filler_shape(_unused(CAULK_ID, taken), slabs))
        changes.note(f"cracks that light came through were closed from outside: {made} slabs")
    return fillers, kept


def _unused(name: str, taken: set[str]) -> str:
    """The name, or the first with a number behind it that is not taken."""
    numbered = (f"{name}-{number}" for number in count(2))
    return next(each for each in chain([name], numbered) if each not in taken)


def _solid_corners(shapes: list[Shape]) -> Float64Array:
    """The triangles (F, 3, 3) that stop light; all of them if none does."""
    solid = [
        shape.mesh.corners
        for shape in shapes
        if not shape.surface.see_through
        and not shape.surface.invisible
        and not (shape.surface.frosted and is_flat(shape.mesh))
    ]
    return np.concatenate(solid or [shape.mesh.corners for shape in shapes])


def _lights(
    shapes: list[Shape],
    area: dict[str, Element],
    others: list[Emitter],
    rooms: list[FoundRoom],
    room_ids: list[str],
) -> tuple[Light, ...]:
    lights: list[Light] = []
    for shape in shapes:
        if shape.id in area:
            centre = shape.mesh.bounds.mean(axis=0)
            lights.append(
                Light(
                    f"light_{len(lights)}", "area", (shape.id,), _room_at(centre, rooms, room_ids)
                )
            )
    for emitter in others:
        for kind in emitter.kinds:
            room = None
            if emitter.position is not None:
                room = _room_at(np.array(emitter.position), rooms, room_ids)
            lights.append(Light(f"light_{len(lights)}", kind, (), room))
    return tuple(lights)


def _portals(
    openings: list[FoundOpening], frosted: set[int], rooms: list[FoundRoom], room_ids: list[str]
) -> tuple[Portal, ...]:
    portals = []
    for number, opening in enumerate(openings):
        room = rooms[opening.room]
        low, high = opening.polygon.min(axis=0), opening.polygon.max(axis=0)
        kind: Literal["window", "door", "opening"] = "window"
        if opening.hidden and opening.normal[2] > 0.9 and not opening.panes:
            kind = "opening"  # no skylight: nobody looks up through it
        elif not opening.overhead and not opening.panes and number not in frosted:
            on_floor = low[2] < room.floor_z + 0.12
            if opening.wall_share > 0.8:
                kind = "opening"
            elif on_floor:
                width = math.hypot(high[0] - low[0], high[1] - low[1])
                kind = "door" if width < 1.4 and high[2] - low[2] > 1.7 else "opening"
        portals.append(
            Portal(
                id=f"portal_{number}",
                kind=kind,
                polygon=tuple((float(x), float(y), float(z)) for x, y, z in opening.polygon),
                normal=(
                    float(opening.normal[0]),
                    float(opening.normal[1]),
                    float(opening.normal[2]),
                ),
                clear=number not in frosted,
                room=room_ids[opening.room],
            )
        )
    return tuple(portals)


def _room_at(point: Float64Array, rooms: list[FoundRoom], room_ids: list[str]) -> str | None:
    for room, name in zip(rooms, room_ids, strict=True):
        if room.holds(point, 0.15):
            return name
    return None


def _lighting(lights: tuple[Light, ...]) -> str:
    outdoors = any(light.kind in ("sun", "sky", "environment", "directional") for light in lights)
    lamps = any(light.kind in ("area", "point", "spot") for light in lights)
    if outdoors and lamps:
        return "mixed"
    return "day" if outdoors else "night"


def _whole(shapes: list[Shape]) -> FoundRoom:
    """The scene's box, where nothing better is known."""
    bounds = np.array([shape.mesh.bounds for shape in shapes])
    low, high = bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)
    side = np.maximum(0.5 * (high - low)[:2], 1.0)
    middle = 0.5 * (low + high)[:2]
    floor = box(*(middle - side), *(middle + side))
    return FoundRoom(floor, float(low[2]), float(max(high[2], low[2] + 2.2)), guessed=True)


def _own_camera(room: FoundRoom) -> Camera:
    """A view across the room, for files without a usable sensor."""
    points = np.array(room.floor.exterior.coords)
    centre = room.centre
    far = points[int(np.argmax(np.linalg.norm(points - centre[:2], axis=1)))]
    eye = centre.copy()
    eye[2] = min(room.floor_z + 1.55, room.ceiling_z - 0.2)
    target = np.array([*far, room.floor_z + 0.6])
    matrix = look_at(eye, target, np.array([0.0, 0, 1]))
    return Camera("centre", matrix, 0.5534, 480, 360)


def _sensor(camera: Camera) -> Element:
    return sensor_element(
        camera.to_world, math.degrees(2 * camera.half_fov_x), camera.width, camera.height
    )


def _view(camera: Camera, own_names: dict[str, str]) -> dict[str, Any]:
    """The camera as an offered view: OpenCV axes are Mitsuba's with x and y turned round.

    `own_names` leads from the source's names of rooms to ours.
    """
    pose = camera.to_world @ np.diag([-1.0, -1, 1, 1])
    room = {"room": own_names[camera.room]} if camera.room in own_names else {}
    return {
        **camera.more,
        **room,
        "name": re.sub(r"[^A-Za-z0-9_-]+", "_", camera.name),
        "camera_to_world": pose.tolist(),
        "half_fov_x": camera.half_fov_x,
        "width": camera.width,
        "height": camera.height,
    }
