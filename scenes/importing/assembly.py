"""Assembly of a scene folder from a draft scene, the same for every importer.

Input: a `Draft` with shapes, emitters and cameras in metres, Z up. Output: a scene folder with
`scene.xml`, meshes and `scene.json`. The assembly finds rooms and openings, replaces clear window
panes by portals, groups shapes into objects, seals gaps, and assigns lights to rooms.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, count
from pathlib import Path
from typing import Any, Literal, Protocol
from xml.etree.ElementTree import Element

import numpy as np
from shapely.geometry import box

from pbrnet.scenes.arrays import as_triple
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
from pbrnet.scenes.importing.camera import Camera, default_camera, sensor_of, view_of
from pbrnet.scenes.importing.changes import NO_ROOM, Changes
from pbrnet.scenes.importing.light.ceiling_lamps import HungLamp, free_ceiling_lamps, hung_lamp
from pbrnet.scenes.importing.light.daylight import GROUND_ID, daylight, ground
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
from pbrnet.scenes.importing.semantics import FURNITURE
from pbrnet.scenes.importing.shape import Emitter, Shape, bounds_of
from pbrnet.scenes.importing.shapes.panes import frosted_openings, remove_panes, solid_corners
from pbrnet.scenes.importing.shapes.sealing_shapes import sealing_shape, structure_object
from pbrnet.scenes.importing.shapes.shells import with_parted_shells
from pbrnet.scenes.importing.writer import write_scene_xml
from pbrnet.scenes.reconstruction.aperture_sections import CrossSections, at_narrowest_section
from pbrnet.scenes.reconstruction.enclosure import ENCLOSURE_ID, build_enclosure
from pbrnet.scenes.reconstruction.gap_sealing import GAP_SEALING_ID, seal_gaps
from pbrnet.scenes.reconstruction.hidden_openings import hidden_openings
from pbrnet.scenes.reconstruction.interior import find_rooms
from pbrnet.scenes.reconstruction.raycast import RayCaster
from pbrnet.scenes.reconstruction.rooms import FoundOpening, FoundRoom, find_openings

_LEAST_SEEN = 3.0  # square metres of floor around a camera in a room


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
    parts_shells: bool = True  # floors, ceilings and walls in one mesh become shapes of their own


def assemble(folder: Path, draft: Draft, changes: Changes) -> None:
    """Find rooms, openings and objects of `draft` and write the scene to `folder`.

    Raises `InputError` if nothing in the scene is visible or it is far too large.
    """
    shapes, rooms, openings = _visible_in_rooms(draft, changes)
    area = {shape.id: draft.area[shape.id] for shape in shapes if shape.id in draft.area}
    room_ids = [f"room_{index}" for index in range(len(rooms))]
    objects = draft.grouping(shapes, rooms, room_ids)
    names = draft.room_names(shapes, rooms, room_ids) if draft.room_names else {}
    emitters, has_ground, dim = draft.emitters, draft.ground, frozenset[str]()
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
    if has_ground and all(shape.id.lower() != GROUND_ID for shape in shapes):
        ground_shape, ground_object = ground(*bounds_of(shapes))
        shapes, objects = [*shapes, ground_shape], (*objects, ground_object)
    lights = lights_of(shapes, area, emitters, rooms, room_ids)
    used_ids = {shape.id for shape in shapes} | {each.id for each in objects}
    sealing_shapes, openings = _seal(shapes, rooms, openings, used_ids, changes)
    shapes = [*shapes, *sealing_shapes]
    objects = (*objects, *(structure_object(shape) for shape in sealing_shapes))
    frosted = frosted_openings(shapes, openings)
    portals = _portals(openings, frosted, rooms, room_ids)
    has_camera = bool(draft.cameras)
    rooms, room_ids, is_closed = _with_some_room(
        rooms, room_ids, bounding_room, has_camera, changes
    )
    positions = [each.position for each in emitters if each.position is not None]
    lighting = RoomLighting(shapes, rooms, room_ids, lights, portals, positions, dim)
    described = _described_rooms(draft, objects, rooms, room_ids, lighting.lit)
    dark = _rooms_to_light(draft.lamps, lighting, is_closed)
    for lamp in _ceiling_lamps(dark, lighting, used_ids):
        shapes, objects = [*shapes, lamp.shape], (*objects, lamp.object)
        area[lamp.shape.id] = lamp.emitter
        name, room = f"light_{len(lights)}", lamp.object.room
        lights = (*lights, Light(name, "area", (lamp.shape.id,), room, lamp.lumens))
    for number in dark:
        described[number] = replace(described[number], has_light=True)
    if dark:
        note_filled([described[number] for number in dark], changes)
    camera = draft.cameras[0] if draft.cameras else default_camera(rooms[0])
    write_scene_xml(folder, shapes, area, emitters, sensor_of(camera), draft.max_depth)
    views = [view_of(camera, names) for camera in draft.cameras]
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
    if not draft.stated_rooms and all(is_closed):
        _note_no_furniture(scene, changes)
    save_scene(folder, replace(scene, changes=changes.sentences()))


def _note_no_furniture(scene: Scene, changes: Changes) -> None:
    """Record that rooms were found and no furniture, as in models of a building's outside."""
    if FURNITURE.isdisjoint(one.category for one in scene.objects):
        changes.note(
            "no object is known as furniture, so the rooms follow from walls, floors and ceilings "
            "alone: if the file shows a building from outside, they may be none"
        )


def _visible_in_rooms(
    draft: Draft, changes: Changes
) -> tuple[list[Shape], list[FoundRoom], list[FoundOpening]]:
    """The shapes without clear panes and invisible ones, the rooms, and the openings."""
    stated = [room for _, room in draft.stated_rooms]
    rooms, openings = find_rooms_and_openings(draft.shapes, draft.cameras, stated)
    shapes, pane_shapes, openings = _locate_openings(draft.shapes, rooms, openings)
    if pane_shapes:
        changes.note("clear window panes became portals: {}", ", ".join(pane_shapes))
    for shape in shapes:
        if shape.surface.invisible:
            changes.note("an invisible shape was left out: {}", shape.name)
    shapes = [shape for shape in shapes if not shape.surface.invisible]
    if draft.parts_shells:
        shapes = with_parted_shells(shapes, rooms, draft.area)
    if not shapes:
        raise InputError(
            f"{draft.scene_id}: nothing in the scene is visible; every shape is a clear window "
            "pane or has an invisible material"
        )
    return shapes, rooms, openings


def _with_some_room(
    rooms: list[FoundRoom],
    room_ids: list[str],
    bounding_room: FoundRoom,
    has_camera: bool,
    changes: Changes,
) -> tuple[list[FoundRoom], list[str], list[bool]]:
    """The rooms, or the bounding box as one; their ids; and whether each is closed.

    What a camera of the file sees is taken for a room. What the middle of the scene sees, or a
    camera with hardly any space around it, is a guess that ends with exit code 1.
    """
    guessed = [room.floor.area for room in rooms if room.guessed]
    if guessed:
        place = "camera" if has_camera else "middle of the scene"
        is_seen = has_camera and max(guessed) >= _LEAST_SEEN
        changes.note(
            f"{'no closed room was found; the' if is_seen else f'{NO_ROOM}: the'} space around "
            f"the {place} is used as a room"
        )
    if not rooms:
        changes.note(f"{NO_ROOM}: the bounding box of the scene is used as a room")
        return [bounding_room], ["room_0"], [False]
    return rooms, room_ids, [not room.guessed for room in rooms]


def _rooms_to_light(lamps: str, lighting: RoomLighting, is_closed: list[bool]) -> list[int]:
    """Numbers of the rooms that get ceiling lamps, see `Draft.lamps`."""
    dark = lighting.dark if lamps in ("auto", "fill", "unlit") else []
    if lamps == "auto":
        return [number for number in dark if is_closed[number]]
    if lamps == "unlit" and not (all(is_closed) and len(dark) == len(is_closed)):
        return []
    return dark


def _ceiling_lamps(
    dark: list[int], lighting: RoomLighting, used_ids: set[str]
) -> Iterator[HungLamp]:
    """Plain ceiling lamps in rooms, with ids that are not among `used_ids`."""
    for number in dark:
        for globe in free_ceiling_lamps(lighting.rooms[number], lighting.rays):
            name = _unused_id(f"ceiling_lamp_{number}", used_ids)
            used_ids.add(name)
            yield hung_lamp(globe, name, lighting.room_ids[number])


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
                polygon=tuple(as_triple(point) for point in opening.polygon),
                normal=as_triple(opening.normal),
                clear=number not in frosted,
                room=room_ids[opening.room],
            )
        )
    return tuple(portals)


def _bounding_room(shapes: list[Shape]) -> FoundRoom:
    """A guessed room from the scene's bounding box."""
    low, high = bounds_of(shapes)
    side = np.maximum(0.5 * (high - low)[:2], 1.0)
    middle = 0.5 * (low + high)[:2]
    floor = box(*(middle - side), *(middle + side))
    return FoundRoom(floor, float(low[2]), float(max(high[2], low[2] + 2.2)), guessed=True)
