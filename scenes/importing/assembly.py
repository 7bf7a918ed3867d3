"""Assembly of a scene folder from a draft scene, the same for every importer.

Input: a `Draft` with shapes, emitters and cameras in metres, Z up. Output: a scene folder with
`scene.xml`, meshes and `scene.json`. The assembly finds rooms and openings, replaces clear window
panes by portals, groups shapes into objects, seals gaps, and assigns lights to rooms.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, count
from pathlib import Path
from typing import Any, Literal, Protocol
from xml.etree.ElementTree import Element

import numpy as np
from shapely.geometry import box

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.contract import (
    MAX_EXTENT,
    Credit,
    Light,
    Portal,
    Room,
    Scene,
    SceneObject,
    save_scene,
)
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.geometry.transforms import look_at
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.light.ceiling_lamps import free_ceiling_lamps, hung_lamp
from pbrnet.scenes.importing.light.daylight import daylight, ground
from pbrnet.scenes.importing.light.in_rooms import (
    RoomLighting,
    lighting_of,
    lights_of,
)
from pbrnet.scenes.importing.light.plan import (
    light_plan,
    note_dark_rooms,
    note_filled,
    note_sky,
)
from pbrnet.scenes.importing.objects import group_objects, hollow_furniture, type_of_room
from pbrnet.scenes.importing.panes import frosted_openings, remove_panes, solid_corners
from pbrnet.scenes.importing.sealing_shapes import sealing_shape, structure_object
from pbrnet.scenes.importing.shape import Emitter, Shape, bounds_of
from pbrnet.scenes.importing.writer import sensor_element, write_scene_xml
from pbrnet.scenes.reconstruction.aperture_sections import CrossSections, at_narrowest_section
from pbrnet.scenes.reconstruction.enclosure import ENCLOSURE_ID, build_enclosure
from pbrnet.scenes.reconstruction.gap_sealing import GAP_SEALING_ID, seal_gaps
from pbrnet.scenes.reconstruction.hidden_openings import hidden_openings
from pbrnet.scenes.reconstruction.interior import find_rooms
from pbrnet.scenes.reconstruction.orientation import (
    guess_scale,
    signed_axis,
    surface_heights,
    tallest_gaps,
    up_from_geometry,
    upright,
)
from pbrnet.scenes.reconstruction.raycast import RayCaster
from pbrnet.scenes.reconstruction.rooms import FoundOpening, FoundRoom, find_openings
from pbrnet.scenes.source_options import FreeAxesOptions


@dataclass(frozen=True)
class Camera:
    """A pinhole camera of the source, before it is written as a stored view."""

    name: str
    to_world: Float64Array  # (4, 4), Mitsuba's axes: x left, y up, z forward
    half_fov_x: float  # radians
    width: int  # pixels
    height: int
    room: str = ""  # name of the room that contains it, in the source
    more: dict[str, Any] = field(default_factory=dict)  # further keys of the stored view


class Grouping(Protocol):
    """A source's rule to group shapes into objects, given the rooms and their ids."""

    def __call__(
        self, shapes: list[Shape], rooms: list[FoundRoom], room_ids: list[str]
    ) -> tuple[SceneObject, ...]: ...


@dataclass(frozen=True)
class Draft:
    """An imported scene in metres, Z up, whose rooms and openings are not yet known."""

    scene_id: str
    source: dict[str, Any]  # for `scene.json`; views are added to it
    shapes: list[Shape]
    area: dict[str, Element]  # area emitters by shape id
    emitters: list[Emitter]  # all other emitters
    cameras: list[Camera]
    credits: tuple[Credit, ...]
    hint: str = ""  # name of the whole scene, which may tell the type of its only room
    max_depth: int = 17  # of paths, for the integrator in `scene.xml`
    grouping: Grouping = group_objects
    # Maps the source's names of rooms to ids, for sources that name rooms.
    room_names: Callable[[list[Shape], list[FoundRoom], list[str]], dict[str, str]] | None = None
    ground: bool = False  # add a ground plane
    # Names and rooms, for sources that state them; otherwise rooms are found in the triangles.
    stated_rooms: tuple[tuple[str, FoundRoom], ...] = ()
    photometric: bool = False  # the power of its lamps is known, so that too weak ones do not count
    sky_if_dark: bool = False  # add sun, sky and ground if no room is lit; needs `photometric`
    # Plain ceiling lamps in rooms without light: in all of them ("fill"), in closed ones ("auto"),
    # in closed ones if no room has light ("unlit"), or in none ("home").
    lamps: str = "auto"


def assemble(folder: Path, draft: Draft, changes: Changes) -> None:
    """Find rooms, openings and objects of `draft` and write the scene to `folder`.

    Raises `InputError` if nothing in the scene is visible or it is far too large.
    """
    shapes, cameras = draft.shapes, draft.cameras
    stated = [room for _, room in draft.stated_rooms]
    rooms, openings = find_rooms_and_openings(shapes, cameras, stated)
    shapes, pane_shapes, openings = _locate_openings(shapes, rooms, openings)
    if pane_shapes:
        changes.note("clear window panes became portals: {}", ", ".join(pane_shapes))
    for shape in shapes:
        if shape.surface.invisible:
            changes.note("an invisible shape was left out: {}", shape.name)
    shapes = [shape for shape in shapes if not shape.surface.invisible]
    if not shapes:
        raise InputError(
            f"{draft.scene_id}: nothing in the scene is visible; every shape is a clear window "
            "pane or has an invisible material"
        )
    area = {shape.id: draft.area[shape.id] for shape in shapes if shape.id in draft.area}
    room_ids = [f"room_{index}" for index in range(len(rooms))]
    objects = draft.grouping(shapes, rooms, room_ids)
    names = draft.room_names(shapes, rooms, room_ids) if draft.room_names else {}
    emitters, has_ground = draft.emitters, draft.ground
    dim = frozenset[str]()
    if draft.photometric:
        plan = light_plan(folder, shapes, area, emitters, objects, rooms)
        closed = [name for name, room in zip(room_ids, rooms, strict=True) if not room.guessed]
        dim = frozenset(
            name for name, light in zip(closed, plan.rooms, strict=True) if light.is_dark
        )
        if draft.sky_if_dark and plan.needs_sky:
            emitters, has_ground = [*emitters, daylight()], True
            note_sky(plan, changes)
    bounding_room = _bounding_room(shapes)
    if has_ground:
        ground_shape, ground_object = ground(*bounds_of(shapes))
        shapes, objects = [*shapes, ground_shape], (*objects, ground_object)
    lights = lights_of(shapes, area, emitters, rooms, room_ids)
    used_ids = {shape.id for shape in shapes} | {each.id for each in objects}
    sealing_shapes, openings = _seal(shapes, rooms, openings, used_ids, changes)
    shapes = [*shapes, *sealing_shapes]
    objects = (*objects, *(structure_object(shape) for shape in sealing_shapes))
    frosted = frosted_openings(shapes, openings)
    portals = _portals(openings, frosted, rooms, room_ids)
    if any(room.guessed for room in rooms):
        changes.note(
            "no closed room was found; the space around the camera, or around the middle of the "
            "scene, is used as a room"
        )
    is_closed = [not room.guessed for room in rooms]
    if not rooms:
        rooms, room_ids, is_closed = [bounding_room], ["room_0"], [False]
        changes.note("NO ROOM WAS FOUND: the bounding box of the scene is used as a room")
    camera = cameras[0] if cameras else _default_camera(rooms[0])
    positions = [each.position for each in emitters if each.position is not None]
    lighting = RoomLighting(shapes, rooms, room_ids, lights, portals, positions, dim)
    described = _described_rooms(draft, objects, rooms, room_ids, lighting.lit)
    dark = lighting.dark if draft.lamps in ("auto", "fill", "unlit") else []
    if draft.lamps == "auto":
        dark = [number for number in dark if is_closed[number]]
    elif draft.lamps == "unlit" and not (all(is_closed) and len(dark) == len(rooms)):
        dark = []
    if dark:
        for number in dark:
            for globe in free_ceiling_lamps(rooms[number], lighting.rays):
                name = _unused_id(f"ceiling_lamp_{number}", used_ids)
                used_ids.add(name)
                lamp = hung_lamp(globe, name, room_ids[number])
                shapes, objects = [*shapes, lamp.shape], (*objects, lamp.object)
                area[name] = lamp.emitter
                light_id = f"light_{len(lights)}"
                lights = (*lights, Light(light_id, "area", (name,), room_ids[number], lamp.lumens))
            described[number] = replace(described[number], has_light=True)
        note_filled([described[number] for number in dark], changes)
    write_scene_xml(folder, shapes, area, emitters, _sensor(camera), draft.max_depth)
    views = [_view(camera, names) for camera in cameras]
    scene = Scene(
        scene_id=draft.scene_id,
        source={**draft.source, "views": views, **({"rooms": names} if names else {})},
        rooms=tuple(described),
        objects=objects,
        lights=lights,
        portals=portals,
        credits=draft.credits,
        lighting=lighting_of(lights),
        plan=draft.scene_id,
    )
    note_dark_rooms(scene, changes)
    save_scene(folder, replace(scene, changes=changes.sentences()))


def transformed_camera(camera: Camera, frame: Float64Array, changes: Changes) -> Camera:
    """Transform a camera by `frame` (4, 4) and make its axes orthonormal and right-handed."""
    matrix = frame @ camera.to_world
    axes = matrix[:3, :3] / np.linalg.norm(matrix[:3, :3], axis=0)
    if np.linalg.det(axes) < 0:
        axes[:, 0] = -axes[:, 0]
        changes.note("a mirrored camera was made right-handed: {}", camera.name)
    forward = axes[:, 2]
    left = np.cross(axes[:, 1], forward)
    left /= np.linalg.norm(left)
    rigid = np.eye(4)
    rigid[:3, :3] = np.stack([left, np.cross(forward, left), forward], axis=1)
    rigid[:3, 3] = matrix[:3, 3]
    return replace(camera, to_world=rigid)


def upright_metric_frame(
    shapes: list[Shape],
    cameras: list[Camera],
    options: FreeAxesOptions,
    changes: Changes,
    default_up: tuple[float, float, float] = (0.0, 1.0, 0.0),
) -> Float64Array:
    """The similarity (4, 4) from a file's right-handed world to ours (metres, Z up).

    Up is what the options state, else that of the first camera, else found in the geometry with
    `default_up` in doubt; the scale is what the options state or a guess.
    """
    corners = np.concatenate([shape.mesh.corners for shape in shapes])
    if options.up != "auto":
        up = np.eye(3)["xyz".index(options.up)]
    elif cameras:
        up = signed_axis(cameras[0].to_world[:3, 1])
    else:
        up = up_from_geometry(corners, np.array(default_up))
    turn = upright(up)
    if not np.array_equal(turn, np.eye(3)):
        name = ("-" if up.sum() < 0 else "+") + "XYZ"[int(np.argmax(np.abs(up)))]
        changes.note(f"the scene was turned so that its {name} axis points up (Z)")
    scale = options.scale
    if scale is None:
        scale = guess_scene_scale(corners @ turn.T, cameras, turn, changes)
    frame = np.eye(4)
    frame[:3, :3] = scale * turn
    return frame


def guess_scene_scale(
    corners: Float64Array, cameras: list[Camera], turn: Float64Array, changes: Changes
) -> float:
    """Guess metres per unit from the height between floor and ceiling.

    `corners` (F, 3, 3) are upright triangles; `turn` (3, 3) made them so. With cameras, the
    height is measured around the first one.
    """
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
    columns = surface_heights(rays, points, float(low[2]), float(high[2]))
    gaps = tallest_gaps(columns, through)
    if not len(gaps):
        changes.note(
            "the unit of length could not be guessed, because no floor with a ceiling was found; "
            "1 unit was read as 1 m (change it with --scale)"
        )
        return 1.0
    height = float(np.percentile(gaps[:, 1] - gaps[:, 0], 75))
    scale, unit = guess_scale(height)
    if scale != 1.0:
        changes.note(
            f"lengths were read as {unit}, because a room is {height:.4g} units high "
            "(change it with --scale)"
        )
    return scale


def find_rooms_and_openings(
    shapes: list[Shape], cameras: list[Camera], stated: Sequence[FoundRoom] = ()
) -> tuple[list[FoundRoom], list[FoundOpening]]:
    """Find openings and, unless they are `stated`, rooms.

    Clear glass and frosted panes do not close an opening.
    """
    everything = np.concatenate([shape.mesh.corners for shape in shapes])
    extent = float(np.ptp(everything.reshape(-1, 3), axis=0).max())
    if extent > MAX_EXTENT:
        raise InputError(
            f"the scene is {extent:.3g} m across; at most {MAX_EXTENT:g} m are supported. Give "
            "its unit with --scale, or repair the shape that lies so far out"
        )
    eye = cameras[0].to_world[:3, 3] if cameras else None
    rooms = list(stated) or find_rooms(everything, eye, hollow_furniture(shapes))
    return rooms, find_openings(RayCaster(solid_corners(shapes)), rooms)


def _locate_openings(
    shapes: list[Shape], rooms: list[FoundRoom], openings: list[FoundOpening]
) -> tuple[list[Shape], list[str], list[FoundOpening]]:
    """Remove clear panes and locate every opening exactly.

    Returns the shapes without panes, the ids of shapes that had some, and all openings: those
    given, moved to their narrowest section, and those that only random walks find.
    """
    shapes, pane_shapes, openings = remove_panes(shapes, openings)
    corners = solid_corners(shapes)
    sections = CrossSections(corners)
    openings = [at_narrowest_section(sections, opening) for opening in openings]
    hidden = hidden_openings(RayCaster(corners), sections, rooms, openings)
    shapes, more, hidden = remove_panes(shapes, hidden)
    return shapes, [*pane_shapes, *more], openings + hidden


def _seal(
    shapes: list[Shape],
    rooms: list[FoundRoom],
    openings: list[FoundOpening],
    used_ids: set[str],
    changes: Changes,
) -> tuple[list[Shape], list[FoundOpening]]:
    """Seal the gaps that let light in.

    Returns the sealing shapes, with ids that are not among `used_ids`, and the openings that
    stay open.
    """
    added = []
    solid = solid_corners(shapes)
    rays = RayCaster(solid)
    sheets, kept = build_enclosure(solid, rays, rooms, openings)
    if len(sheets):
        added.append(sealing_shape(_unused_id(ENCLOSURE_ID, used_ids), sheets))
        solid, rays = np.concatenate([solid, sheets]), RayCaster(sheets, rays)
        changes.note(
            "light leaked in through gaps: an enclosure was added behind walls, floors and ceilings"
        )
    if len(kept) < len(openings):
        changes.note(
            "openings that lie in no wall, such as up a fireplace, were closed: "
            f"{len(openings) - len(kept)}"
        )
    slabs, slab_count = seal_gaps(solid, rays, rooms, kept)
    if slab_count:
        added.append(sealing_shape(_unused_id(GAP_SEALING_ID, used_ids), slabs))
        changes.note(f"light leaked in through gaps: {slab_count} slabs were added behind them")
    return added, kept


def _unused_id(name: str, used_ids: set[str]) -> str:
    """`name`, or `name` with the first number that makes it unused."""
    numbered = (f"{name}-{number}" for number in count(2))
    return next(each for each in chain([name], numbered) if each not in used_ids)


def _described_rooms(
    draft: Draft,
    objects: tuple[SceneObject, ...],
    rooms: list[FoundRoom],
    room_ids: list[str],
    lit_rooms: set[str | None],
) -> list[Room]:
    """The rooms of `scene.json`, with types and names by their objects unless they are stated."""
    labels = [label for label, _ in draft.stated_rooms] or [""] * len(rooms)
    hints = labels if draft.stated_rooms else [draft.hint if len(rooms) == 1 else ""] * len(rooms)
    return [
        Room(
            id=name,
            name=labels[index] or f"{type_of_room(objects, name, draft.hint)} {index}",
            type=type_of_room(objects, name, hints[index]),
            floor=tuple((float(x), float(y)) for x, y in list(room.floor.exterior.coords)[:-1]),
            floor_z=room.floor_z,
            ceiling_z=room.ceiling_z,
            has_light=name in lit_rooms,
        )
        for index, (name, room) in enumerate(zip(room_ids, rooms, strict=True))
    ]


def _portals(
    openings: list[FoundOpening], frosted: set[int], rooms: list[FoundRoom], room_ids: list[str]
) -> tuple[Portal, ...]:
    """Portals of openings, classified as window, door or opening by size and position."""
    portals = []
    for number, opening in enumerate(openings):
        room = rooms[opening.room]
        low, high = opening.polygon.min(axis=0), opening.polygon.max(axis=0)
        kind: Literal["window", "door", "opening"] = "window"
        if opening.hidden and opening.normal[2] > 0.9 and not opening.panes:
            kind = "opening"  # not a skylight: it cannot be seen through from below
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


def _bounding_room(shapes: list[Shape]) -> FoundRoom:
    """A guessed room from the scene's bounding box."""
    bounds = np.array([shape.mesh.bounds for shape in shapes])
    low, high = bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)
    side = np.maximum(0.5 * (high - low)[:2], 1.0)
    middle = 0.5 * (low + high)[:2]
    floor = box(*(middle - side), *(middle + side))
    return FoundRoom(floor, float(low[2]), float(max(high[2], low[2] + 2.2)), guessed=True)


def _default_camera(room: FoundRoom) -> Camera:
    """A view across the room, for files without a usable camera."""
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


def _view(camera: Camera, room_names: dict[str, str]) -> dict[str, Any]:
    """The camera as a stored view: OpenCV axes are Mitsuba's with x and y negated.

    `room_names` maps the source's names of rooms to ids.
    """
    pose = camera.to_world @ np.diag([-1.0, -1, 1, 1])
    room = {"room": room_names[camera.room]} if camera.room in room_names else {}
    return {
        **camera.more,
        **room,
        "name": re.sub(r"[^A-Za-z0-9_-]+", "_", camera.name),
        "camera_to_world": pose.tolist(),
        "half_fov_x": camera.half_fov_x,
        "width": camera.width,
        "height": camera.height,
    }
