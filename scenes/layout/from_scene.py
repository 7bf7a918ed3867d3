"""Description of a scene folder as a layout: rooms, openings and boxes of `scene.json` alone.

Portals are windows and entrances, doors are where hinges are stated, and boxes face away from the
nearest wall unless a joint tells their front.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from shapely.geometry import LineString, Point, Polygon

from pbrnet.scenes.contract import Joint, Portal, Room, Scene, SceneObject, load_scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.layout.describe import write_layout
from pbrnet.scenes.layout.layout import LayoutObject
from pbrnet.scenes.layout.readers.fronts import facing
from pbrnet.scenes.layout.readers.own import KEY, VALUE
from pbrnet.scenes.procedural.furniture import FURNITURE_KINDS
from pbrnet.scenes.procedural.furniture.things.kinds import THINGS
from pbrnet.scenes.procedural.structure import LINING

_STOREY = 0.5  # metres between floors of one storey
_FRAME = LINING + 0.003  # metres from the opening's end to the leaf
_NEAR = 0.3  # metres from a portal to the door that fills it
_SLOPE = 0.3  # vertical part of the normal, from which a portal is a roof window
_AHEAD = 0.4  # metres before a door, where the room lies into which it swings


def describe_scenes(folders: Iterable[Path], out: Path) -> list[Path]:
    """Write scene folders as layouts to a folder; returns the files."""
    written: dict[str, Path] = {}
    for scene in map(load_scene, folders):
        if not scene.rooms:
            raise InputError(f"{scene.folder}: has no rooms, so no layout")
        if scene.scene_id in written:
            raise InputError(f"{scene.folder}: a second scene with the id {scene.scene_id!r}")
        written[scene.scene_id] = write_layout(out, described_scene(scene))
    return [*written.values()]


def described_scene(scene: Scene) -> dict[str, Any]:
    """Return the storey of the largest room as the content of a layout in pbrnet's own format."""
    ground = max(scene.rooms, key=lambda room: Polygon(room.floor).area).floor_z
    rooms = [room for room in scene.rooms if abs(room.floor_z - ground) < _STOREY]
    credits = [credit for credit in scene.credits if credit.licence]
    objects = _objects(scene, rooms, ground)
    return {
        KEY: VALUE,
        "name": scene.scene_id,
        "author": ", ".join(dict.fromkeys(credit.author for credit in credits))[:200],
        "licence": " AND ".join(dict.fromkeys(credit.licence for credit in credits))[:200],
        "strict": False,
        "rooms": [
            {
                "id": room.id,
                "name": room.name,
                **({} if room.type == "other" else {"type": room.type}),
                "polygon": [[round(x, 5), round(y, 5)] for x, y in room.floor],
                "height": round(room.ceiling_z - room.floor_z, 4),
            }
            for room in rooms
        ],
        "openings": [*_windows(scene, rooms, ground), *_doors(scene, rooms, ground)],
        "objects": [
            {
                "category": one.category,
                **({"kind": one.kind} if one.kind else {}),
                "id": one.id,
                "room": one.room,
                "at": [round(float(value), 4) for value in one.center],
                "size": [round(max(float(value), 1e-3), 4) for value in one.size],
                "yaw": round(one.yaw, 3),
            }
            for one in objects
        ],
    }


def _windows(scene: Scene, rooms: Sequence[Room], ground: float) -> Iterator[dict[str, Any]]:
    ids = {room.id for room in rooms}
    for portal in scene.portals:
        if portal.room not in ids or abs(portal.normal[2]) > _SLOPE:
            continue
        points = np.array(portal.polygon)
        start, end = _line(portal)
        kind = "entrance" if portal.kind == "door" and not portal.clear else "window"
        bottom, top = points[:, 2].min() - ground, points[:, 2].max() - ground
        yield {
            "kind": kind,
            "id": portal.id,
            "room": portal.room,
            "start": start,
            "end": end,
            "bottom": round(max(float(bottom), 0.0), 5),
            "top": round(float(top), 5),
        }


def _line(portal: Portal) -> tuple[list[float], list[float]]:
    """The ends of a portal seen from above."""
    points = np.array(portal.polygon)[:, :2]
    along = np.array([-portal.normal[1], portal.normal[0]])
    places = points @ along
    ends = points[places.argmin()], points[places.argmax()]
    return np.round(ends[0], 5).tolist(), np.round(ends[1], 5).tolist()


def _doors(scene: Scene, rooms: Sequence[Room], ground: float) -> Iterator[dict[str, Any]]:
    """Doors between rooms, where their hinges are."""
    joints = {joint.object: joint for joint in scene.joints}
    ids = {room.id for room in rooms}
    outer = [LineString(_line(portal)) for portal in scene.portals if portal.kind == "door"]
    for thing in scene.objects:
        joint = joints.get(thing.id)
        if thing.category != "door" or joint is None or (thing.room and thing.room not in ids):
            continue
        start, end, inward = _leaf(joint)
        if any(LineString([start, end]).distance(line) < _NEAR for line in outer):
            continue
        ahead = Point(0.5 * (start + end) + _AHEAD * inward)
        swing = [room.id for room in rooms if Polygon(room.floor).contains(ahead)]
        yield {
            "kind": "door",
            "id": thing.id,
            "start": np.round(start, 5).tolist(),
            "end": np.round(end, 5).tolist(),
            "bottom": 0.0,
            "top": round(joint.pivot[2] + joint.boxes[0][1][2] + _FRAME - ground, 5),
            "open_degrees": round(min(joint.value, 110.0), 3),
            "hinge": "start",
            **({"swing": swing[0]} if swing else {}),
        }


def _leaf(joint: Joint) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Both ends of the opening of a door, its hinge first, and the direction it swings into."""
    angle = math.radians(joint.yaw)
    along = np.array([math.cos(angle), math.sin(angle)])
    pivot = np.array(joint.pivot[:2])
    width = joint.boxes[0][1][0]
    inward = joint.axis[2] * np.array([-along[1], along[0]])
    return pivot - _FRAME * along, pivot + (width + _FRAME) * along, inward


def _objects(scene: Scene, rooms: Sequence[Room], ground: float) -> list[LayoutObject]:
    """The objects that stand in the rooms; things inside pieces of pbrnet come with these."""
    by_id = {room.id: room for room in rooms}
    yaws = {joint.object: joint.yaw for joint in scene.joints}
    ours = scene.source.get("kind") in ("procedural", "layout")
    found = []
    for thing in scene.objects:
        room = by_id.get(thing.room or "")
        if thing.is_structure or room is None:
            continue
        named = re.fullmatch(rf"{re.escape(room.id)}-(\w+)-\d+", thing.id)
        kind = named[1] if named and (named[1] in FURNITURE_KINDS or named[1] in THINGS) else ""
        if kind or not ours:
            found.append(_box(thing, kind, room, yaws.get(thing.id), ground))
    walls = [(a, b) for room in rooms for a, b in _sides(room)]
    free = facing([one for one in found if one.id not in yaws], walls)
    return [*(one for one in found if one.id in yaws), *free]


def _box(
    thing: SceneObject, kind: str, room: Room, yaw: float | None, ground: float
) -> LayoutObject:
    low, high = np.array(thing.bbox_min), np.array(thing.bbox_max)
    size, middle = high - low, 0.5 * (low + high)
    if yaw is None:
        yaw = min((0.0, 90.0, 180.0, 270.0), key=lambda turn: _behind(middle, size, turn, room))
    sine, cosine = abs(math.sin(math.radians(yaw))), abs(math.cos(math.radians(yaw)))
    if sine > 0.02 and cosine > 0.02 and abs(cosine**2 - sine**2) > 0.2:
        # The box around a turned one is (w cos + d sin, w sin + d cos).
        made = np.linalg.solve([[cosine, sine], [sine, cosine]], size[:2])
        size = np.array([*np.maximum(made, 0.01), size[2]])
    elif sine > cosine:
        size = size[[1, 0, 2]]
    at = (float(middle[0]), float(middle[1]), float(low[2] - ground))
    width, depth, height = (float(value) for value in size)
    return LayoutObject(thing.id, thing.category, at, (width, depth, height), yaw % 360,
                        kind=kind, room=room.id)  # fmt: skip


def _behind(middle: np.ndarray, size: np.ndarray, yaw: float, room: Room) -> float:
    """Distance of the side that is the back of a box at a yaw from the walls, metres."""
    angle = math.radians(yaw)
    back = np.array([-math.sin(angle), math.cos(angle)])
    place = Point(middle[:2] + 0.5 * np.abs(back) @ size[:2] * back)
    return min(LineString(side).distance(place) for side in _sides(room))


def _sides(room: Room) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    return list(zip(room.floor, (*room.floor[1:], room.floor[0]), strict=True))
