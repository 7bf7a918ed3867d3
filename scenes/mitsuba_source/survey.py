"""The import of one Mitsuba scene: read, turn upright, find rooms, lights and openings, write."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal
from xml.etree.ElementTree import Element

import numpy as np
from shapely.geometry import box

from scenes.contract import (
    Credit,
    Light,
    Portal,
    Room,
    Scene,
    load_scene,
    save_scene,
    writing_scene,
)
from scenes.errors import InputError
from scenes.mitsuba_source.changes import Changes
from scenes.mitsuba_source.credits import find_credit
from scenes.mitsuba_source.elements import plugin
from scenes.mitsuba_source.emitters import Emitter, Emitters, half_fov_x
from scenes.mitsuba_source.materials import Materials
from scenes.mitsuba_source.meshes import Floats
from scenes.mitsuba_source.orientation import (
    crossings,
    guess_scale,
    signed_axis,
    tallest_gaps,
    up_from_geometry,
    upright,
)
from scenes.mitsuba_source.outdoors import daylight, ground
from scenes.mitsuba_source.panes import frosted_openings, is_flat, remove_panes
from scenes.mitsuba_source.pbrs import (
    ReleaseCamera,
    Thing,
    find_release,
    release_objects,
    rooms_by_name,
    things_of,
    with_lamps,
    without_doubles,
)
from scenes.mitsuba_source.rays import RayCaster
from scenes.mitsuba_source.reader import Node, read_tree, unresolved
from scenes.mitsuba_source.rooms import (
    FoundOpening,
    FoundRoom,
    find_openings,
    find_rooms,
)
from scenes.mitsuba_source.sandbox import Sandbox
from scenes.mitsuba_source.shapes import Shape, ShapeReader
from scenes.mitsuba_source.textures import TextureStore
from scenes.mitsuba_source.things import group_objects, room_type
from scenes.mitsuba_source.values import Properties, Scope, look_at
from scenes.mitsuba_source.writer import sensor_element, write_scene_xml

_MAX_SENSORS = 64
_SENSORS = ("sensor", "camera")
_MAX_SIZE = 8192


@dataclass(frozen=True)
class MitsubaOptions:
    """What the user may say about a file that does not say it itself."""

    parameters: dict[str, str] | None = None  # values for its $parameters
    scale: float | None = None  # metres per unit; guessed if None
    up: Literal["x", "y", "z", "auto"] = "auto"
    root: Path | None = None  # a folder above the scene's, inside which it may open files
    skip_missing: bool = False  # go on without shapes whose mesh file is missing
    sky: bool = False  # add sun and sky to a scene without any light
    licence: str = ""
    author: str = ""


@dataclass(frozen=True)
class _Camera:
    name: str
    to_world: Floats  # Mitsuba's frame: x left, y up, z forward
    half_fov_x: float
    width: int
    height: int
    room: str = ""  # the source's own name for the room it stands in
    more: dict[str, Any] = field(default_factory=dict)  # what else the source says about it


def import_mitsuba(path: Path, out: Path, scene_id: str, options: MitsubaOptions) -> Scene:
    """Import a Mitsuba XML scene of any version into the scene folder `out`.

    Raises `InputError` that names file, line and element for everything that cannot be used.
    """
    changes = Changes()
    given = dict(options.parameters or {})
    release = find_release(path, changes)
    usual = release.parameters if release else {}
    sandbox = Sandbox(path.parent, options.root, (*given.values(), *usual.values()))
    root, version = read_tree(path, sandbox, given, changes, usual)
    scope = Scope(sandbox, changes, tuple(int(part) for part in version.split(".")))
    _index(root, scope)
    with writing_scene(out) as folder:
        materials = Materials(scope, TextureStore(folder / "textures", changes))
        shapes = ShapeReader(scope, materials, options.skip_missing).read(root.children)
        shapes = _visible(shapes, changes)
        if not shapes:
            raise InputError(f"{path}: the scene holds no shapes")
        things: list[Thing] = []
        if release:
            shapes = without_doubles(shapes, changes)
            things = things_of(shapes)
            shapes = with_lamps(shapes, things, release, path, changes)
            options = replace(options, up="y" if options.up == "auto" else options.up)
            options = replace(options, scale=options.scale or 1.0)
        if release and release.cameras:
            root.children = [node for node in root.children if node.tag not in _SENSORS]
            cameras = [_release_camera(camera, root) for camera in release.cameras]
        else:
            cameras = _cameras(root, scope)
        frame = _frame(shapes, cameras, root, scope, options)
        shapes = [shape.transformed(frame) for shape in shapes]
        cameras = [_moved(camera, frame, changes) for camera in cameras]
        rooms, openings = _survey(shapes, cameras)
        shapes, glazed, openings = remove_panes(shapes, openings)
        if glazed:
            changes.note("clear window panes became portals: {}", ", ".join(glazed))
        frosted = frosted_openings(shapes, openings)
        removed = [shape for shape in shapes if shape.surface.invisible]
        shapes = [shape for shape in shapes if not shape.surface.invisible]
        for shape in removed:
            changes.note("an invisible shape was left out: {}", shape.name)
        emitters = Emitters(scope, materials, frame, daylight if release else None)
        area = {
            shape.id: emitters.area(shape.emitter) for shape in shapes if shape.emitter is not None
        }
        others = [
            made
            for node in root.children
            if (target := scope.resolve(node)).tag in ("emitter", "luminaire")
            and (made := emitters.world(target)) is not None
        ]
        others += _lights_if_none(path, area, others, options, changes)
        _report_dropped(root, scope)
        for old, new in sandbox.moved:
            if old != new:
                changes.note("files were found under another path: {}", f"{old!r} as {new!r}")
        room_ids = [f"room_{index}" for index in range(len(rooms))]
        if release:
            objects = release_objects(shapes, things, release, rooms, room_ids)
            own_names = rooms_by_name(things, shapes, rooms, room_ids)
        else:
            objects = group_objects(shapes, rooms, room_ids)
            own_names = {}
        if release and any("sun" in emitter.kinds for emitter in others):
            plain, thing = ground(shapes)
            shapes, objects = [*shapes, plain], (*objects, thing)
        lights = _lights(shapes, area, others, rooms, room_ids)
        portals = _portals(openings, frosted, rooms, room_ids)
        if any(room.guessed for room in rooms):
            changes.note(
                "no closed room was found; the space around the camera or the middle stands for one"
            )
        if not rooms:
            rooms, room_ids = [_whole(shapes)], ["room_0"]
            changes.note("NO ROOM WAS FOUND: the whole scene's extent stands for one")
        camera = cameras[0] if cameras else _own_camera(rooms[0])
        write_scene_xml(folder, shapes, area, others, _sensor(camera), _max_depth(root, scope))
        lit = {light.room for light in lights} | {portal.room for portal in portals}
        everywhere = any(light.room is None and light.kind != "environment" for light in lights)
        scene = Scene(
            scene_id=scene_id,
            source={
                "kind": "mitsuba",
                "file": path.name,
                "version": version,
                "views": [_view(camera, own_names) for camera in cameras],
                **({"rooms": own_names} if own_names else {}),
            },
            rooms=tuple(
                Room(
                    id=name,
                    name=f"{room_type(objects, name, path.parent.name)} {index}",
                    type=room_type(objects, name, path.parent.name if len(rooms) == 1 else ""),
                    floor=tuple(
                        (float(x), float(y)) for x, y in list(room.floor.exterior.coords)[:-1]
                    ),
                    floor_z=room.floor_z,
                    ceiling_z=room.ceiling_z,
                    has_light=name in lit or everywhere or room.guessed,
                )
                for index, (name, room) in enumerate(zip(room_ids, rooms, strict=True))
            ),
            objects=objects,
            lights=lights,
            portals=portals,
            credits=(_credit(path, scene_id, options, release is not None, changes),),
            lighting=_lighting(lights),
            plan=scene_id,
            changes=changes.sentences(),
        )
        save_scene(folder, scene)
    return load_scene(out)


def _index(root: Node, scope: Scope) -> None:
    """Note every element with an id; `<alias>`es are second names."""
    for node in root.walk():
        name = node.attributes.get("id")
        if not name or node.tag == "ref":
            continue
        if node.tag == "alias":
            target = scope.by_id.get(name)
            if target is None:
                raise node.error(f"no element has the id {name!r}")
            scope.by_id[node.attributes.get("as", "")] = target
        elif name in scope.by_id:
            raise node.error(f"the id {name!r} is used twice")
        else:
            scope.by_id[name] = node


def _visible(shapes: list[Shape], changes: Changes) -> list[Shape]:
    """Emitters keep their shape whatever its material; a null material then becomes matt black."""
    kept = []
    for shape in shapes:
        if shape.surface.invisible and shape.emitter is not None:
            black = plugin("bsdf", "diffuse", reflectance=(0.0, 0.0, 0.0))
            surface = replace(
                shape.surface, element=black, invisible=False, see_through=False, transmissive=False
            )
            shape = replace(shape, surface=surface)
            changes.note("an invisible shape that emits light became matt black")
        kept.append(shape)
    return kept


def _cameras(root: Node, scope: Scope) -> list[_Camera]:
    cameras: list[_Camera] = []
    for child in root.children:
        node = scope.resolve(child) if child.tag == "ref" else child
        if node.tag not in _SENSORS:
            continue
        if node.type not in ("perspective", "thinlens", "perspective_rdist"):
            scope.changes.note("a sensor of kind {} was left out", repr(node.type))
            continue
        missing = sorted({name for part in node.walk() for text in part.attributes.values()
                          for name in unresolved(text)})  # fmt: skip
        if missing:
            scope.changes.note(
                "a sensor was left out, its parameters have no value: {}",
                ", ".join(f"${name}" for name in missing),
            )
            continue
        if len(cameras) >= _MAX_SENSORS:
            scope.changes.note(f"of the sensors only the first {_MAX_SENSORS} were kept")
            break
        cameras.append(_camera(node, len(cameras), scope))
    return cameras


def _camera(node: Node, number: int, scope: Scope) -> _Camera:
    properties = Properties(node, scope)
    properties.ignore("id", "near_clip", "far_clip", "shutter_open", "shutter_close", "mode")
    if node.type != "perspective":
        properties.ignore("aperture_radius", "focus_distance", "kc")
        scope.changes.note("a lens ({}) became a pinhole", node.type)
    properties.ignore("focus_distance", "animated")
    size = [1280, 720]
    for film in properties.nested("film"):
        inner = Properties(film, scope)
        size = [inner.whole("width", 768), inner.whole("height", 576)]
        crop = inner.whole("crop_width", 0)
        if crop:
            scope.changes.note("the crop window of a film was left out")
    width, height = (min(max(side, 1), _MAX_SIZE) for side in size)
    half = half_fov_x(properties, width, height)
    for name in ("principal_point_offset_x", "principal_point_offset_y", "shift_x", "shift_y"):
        if properties.number(name, 0.0) != 0:
            scope.changes.note("the shift of a camera's principal point was left out")
    matrix = properties.transform()
    properties.nested("sampler", "film")
    properties.report_unused()
    return _Camera(node.attributes.get("id") or f"sensor_{number}", matrix, half, width, height)


def _release_camera(camera: ReleaseCamera, root: Node) -> _Camera:
    pose = look_at(camera.eye, camera.eye + camera.towards, camera.up, root)
    more = {"sector": camera.sector, "score": camera.score, "half_fov_y": camera.half_fov[1]}
    return _Camera(camera.name, pose, camera.half_fov[0], 640, 480, camera.room, more)


def _moved(camera: _Camera, frame: Floats, changes: Changes) -> _Camera:
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


def _frame(
    shapes: list[Shape], cameras: list[_Camera], root: Node, scope: Scope, options: MitsubaOptions
) -> Floats:
    """The similarity from the file's world to ours: upright, in metres."""
    corners = np.concatenate([shape.mesh.corners for shape in shapes])
    if options.up != "auto":
        up = np.eye(3)["xyz".index(options.up)]
    elif cameras:
        up = signed_axis(cameras[0].to_world[:3, 1])
    else:
        usual = np.array([0.0, 1, 0])
        kinds = {node.type for node in root.children if node.tag == "emitter"}
        if not scope.is_old and kinds & {"sunsky", "timed_sunsky"}:
            usual = np.array([0.0, 0, 1])
        up = up_from_geometry(corners, usual)
    turn = upright(up)
    if not np.array_equal(turn, np.eye(3)):
        name = ("-" if up.sum() < 0 else "+") + "XYZ"[int(np.argmax(np.abs(up)))]
        scope.changes.note(f"the scene was turned so that its {name} axis points up (Z)")
    scale = options.scale
    if scale is None:
        scale = _guessed_scale(corners @ turn.T, cameras, turn, scope.changes)
    frame = np.eye(4)
    frame[:3, :3] = scale * turn
    return frame


def _guessed_scale(
    corners: Floats, cameras: list[_Camera], turn: Floats, changes: Changes
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


def _survey(
    shapes: list[Shape], cameras: list[_Camera]
) -> tuple[list[FoundRoom], list[FoundOpening]]:
    """Rooms and openings; clear glass and frosted panes do not close an opening."""
    solid = [
        shape
        for shape in shapes
        if not shape.surface.see_through
        and not shape.surface.invisible
        and not (shape.surface.frosted and is_flat(shape.mesh))
    ]
    everything = np.concatenate([shape.mesh.corners for shape in shapes])
    corners = np.concatenate([shape.mesh.corners for shape in solid]) if solid else everything
    eye = cameras[0].to_world[:3, 3] if cameras else None
    rooms = find_rooms(RayCaster(everything), everything, eye)
    return rooms, find_openings(RayCaster(corners), rooms)


def _credit(
    path: Path, scene_id: str, options: MitsubaOptions, release: bool, changes: Changes
) -> Credit:
    if not release:
        return find_credit(path.parent, scene_id, options.licence, options.author, changes)
    author = options.author or "SUNCG; prepared for Mitsuba by Zhang et al. (PBRS, 2017)"
    changes.note(
        "this house of the PBRS release comes from SUNCG: look up on what terms you have it "
        "before you share anything made from it"
    )
    return find_credit(path.parent, path.parent.name, options.licence, author, changes)


def _lights_if_none(
    path: Path,
    area: dict[str, Element],
    others: list[Emitter],
    options: MitsubaOptions,
    changes: Changes,
) -> list[Emitter]:
    if area or others:
        return []
    if not options.sky:
        raise InputError(f"{path}: the scene has no light; add sun and sky with --sky")
    changes.note("the scene had no light; sun and sky were added")
    return [daylight()]


def _report_dropped(root: Node, scope: Scope) -> None:
    """Name what stands at the top of the file and has no place in a scene of ours."""
    for node in root.children:
        if node.tag == "integrator" and node.type not in ("path", "volpath"):
            scope.changes.note("integrator {} gave way to path tracing", repr(node.type))
        elif node.tag == "medium":
            scope.changes.note("participating media were left out")
        elif node.tag not in (
            "integrator", "bsdf", "texture", "shape", "emitter", "luminaire", "sensor", "camera",
            "ref", "alias", "film", "sampler", "rfilter", *("default", "include", "path"),
        ):  # fmt: skip
            scope.changes.note(
                "an unknown element was left out: {}", f"<{node.tag}> ({node.place})"
            )


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
        if not opening.overhead and not opening.panes and number not in frosted:
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


def _room_at(point: Floats, rooms: list[FoundRoom], room_ids: list[str]) -> str | None:
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


def _own_camera(room: FoundRoom) -> _Camera:
    """A view across the room, for files without a usable sensor."""
    points = np.array(room.floor.exterior.coords)
    centre = room.centre
    far = points[int(np.argmax(np.linalg.norm(points - centre[:2], axis=1)))]
    eye = centre.copy()
    eye[2] = min(room.floor_z + 1.55, room.ceiling_z - 0.2)
    target = np.array([*far, room.floor_z + 0.6])
    matrix = look_at(eye, target, np.array([0.0, 0, 1]), Node("sensor", {}, Path(), 0))
    return _Camera("centre", matrix, 0.5534, 480, 360)


def _sensor(camera: _Camera) -> Element:
    return sensor_element(
        camera.to_world, math.degrees(2 * camera.half_fov_x), camera.width, camera.height
    )


def _max_depth(root: Node, scope: Scope) -> int:
    for node in root.children:
        if node.tag == "integrator":
            depth = Properties(node, scope).whole("max_depth", -1)
            if depth > 0:
                return min(max(depth, 2), 65)
    return 17


def _view(camera: _Camera, own_names: dict[str, str]) -> dict[str, Any]:
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
