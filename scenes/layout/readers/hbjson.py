"""Reader of Honeybee's models (HBJSON): rooms with faces, apertures and doors, without furniture.

Ladybug Tools, *Honeybee Schema*. Z is up; the unit is stated. A room's plan is that of its floors,
its height that of its ceiling. One storey is read.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from shapely.geometry import Polygon

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.checked import shown
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.geometry.regions import union, valid
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.layout.layout import Layout, LayoutOpening, LayoutRoom, OpeningKind
from pbrnet.scenes.layout.readers.enclosed import outline, rooms_beside, tidied
from pbrnet.scenes.layout.readers.labels import labelled_room, plain_label
from pbrnet.scenes.layout.readers.node import Node

_METRES = {
    "Meters": 1.0,
    "Centimeters": 0.01,
    "Millimeters": 0.001,
    "Feet": 0.3048,
    "Inches": 0.0254,
}
_STOREY = 1.2  # metres between floors of one storey
_LOW, _HIGH = 1.8, 20.0  # metres, heights of rooms; lower ones are plenums and crawl spaces
_LEVEL = 0.05  # metres by which a level face may rise
_NARROWEST = 0.1  # metres, of an opening
_SAME = 0.1  # metres between both sides of one opening
_SMALLEST = 0.5  # square metres of a room
_WALL = 0.15  # metres, thickness: walls of the model have none


@dataclass(frozen=True)
class _Space:
    """A room of the model in metres: plan, heights of floor and ceiling, and its faces."""

    node: Node
    plan: Polygon
    floor: float
    ceiling: float


def recognises(content: Any) -> bool:
    """Test whether a file's content is a Honeybee model."""
    return (
        isinstance(content, dict)
        and content.get("type") == "Model"
        and ("units" in content or "properties" in content)
        and isinstance(content.get("identifier"), str)
    )


def read(content: Any, path: Path, storey: str = "") -> Layout:
    """Read a storey of a model; raises `InputError` with file and key.

    `storey` is its name; empty: the lowest with the most rooms.
    """
    model, changes = Node(content, f"{path}: "), Changes()
    unit = model["units"].text("Meters")
    if unit not in _METRES:
        raise model["units"].error(f"expected one of {', '.join(_METRES)}")
    found = (_space(room, _METRES[unit], changes) for room in model["rooms"].items())
    spaces = [space for space in found if space is not None]
    if not spaces:
        raise InputError(f"{path}: the model holds no room with a floor; orphaned faces are none")
    _note_unread(model, changes)
    chosen = _without_rings(_storey(spaces, storey, path, changes), changes)
    base = min(space.floor for space in chosen)
    return Layout(
        name=path.stem,
        rooms=tuple(
            LayoutRoom(
                space.node["identifier"].text(),
                _type(space.node),
                outline(space.plan),
                space.node["display_name"].text("")[:60],
                floor_z=round(space.floor - base, 4),
                height=round(space.ceiling - space.floor, 4),
            )
            for space in chosen
        ),
        openings=tuple(_openings(chosen, _METRES[unit], changes)),
        wall=_WALL,
        polygons="centre",
        changes=changes.sentences(),
    )


def _note_unread(model: Node, changes: Changes) -> None:
    for key, what in (("orphaned_shades", "shades"), ("shade_meshes", "shades")):
        if count := len(list(model[key].items())):
            changes.note(f"{what} outdoors were left out: {count:,}")
    for key in ("orphaned_faces", "orphaned_apertures", "orphaned_doors"):
        if any(True for _ in model[key].items()):
            changes.note("parts of no room were left out: {}", key.replace("_", " "))


def _space(node: Node, unit: float, changes: Changes) -> _Space | None:
    name = node["display_name"].text("") or node["identifier"].text()
    floors, ceilings, places = [], [], []
    for face in node["faces"].items():
        corners = unit * _boundary(face["geometry"])
        places.append(corners[:, 2])
        kind = face["face_type"].text()
        if kind == "Floor" and np.ptp(corners[:, 2]) < _LEVEL:
            floors.append(corners)
        elif kind == "RoofCeiling":
            ceilings.append(corners[:, 2])
    plan = tidied(union(valid(Polygon(corners[:, :2])) for corners in floors))
    if plan.area < _SMALLEST:
        changes.note("rooms without a level floor were left out: {}", name)
        return None
    low = min(float(corners[:, 2].min()) for corners in floors)
    tops = np.concatenate(ceilings or places)
    ceiling = 0.5 * float(tops.min() + tops.max()) if ceilings else float(tops.max())
    if np.ptp(tops) > _LEVEL and ceilings:
        changes.note("sloped ceilings became flat ones at their mean height: {}", name)
    if not _LOW <= ceiling - low <= _HIGH:
        changes.note("spaces lower than 1.8 m or higher than 20 m were left out: {}", name)
        return None
    return _Space(node, plan, low, ceiling)


def _boundary(geometry: Node) -> Float64Array:
    corners = [corner.numbers(3) for corner in geometry["boundary"].items()]
    if len(corners) < 3:
        raise geometry["boundary"].error("expected three corners or more")
    return np.array(corners)


def _type(node: Node) -> Any:
    """Type of a room from its programme, else from its name."""
    programme = node["properties"]["energy"]["program_type"].text("")
    told = labelled_room(plain_label(programme.rpartition("::")[2]))
    return told if told != "other" else labelled_room(node["display_name"].text(""))


def _storey(spaces: Sequence[_Space], wanted: str, path: Path, changes: Changes) -> list[_Space]:
    """The rooms of one storey: the named one, or the lowest of those with the most rooms."""
    storeys: list[list[_Space]] = []
    for space in sorted(spaces, key=lambda each: each.floor):
        if storeys and space.floor - storeys[-1][0].floor < _STOREY:
            storeys[-1].append(space)
        else:
            storeys.append([space])
    names = [_storey_name(storey, number) for number, storey in enumerate(storeys)]
    if wanted and wanted not in names:
        raise InputError(f"{path}: no storey {shown(wanted)}; it has {', '.join(names)}")
    sizes = [len(storey) for storey in storeys]
    chosen = names.index(wanted) if wanted else sizes.index(max(sizes))
    for name in names[:chosen] + names[chosen + 1 :]:
        changes.note("other storeys were left out (option storey): {}", name)
    return storeys[chosen]


def _storey_name(storey: Sequence[_Space], number: int) -> str:
    told = [space.node["story"].text("") for space in storey]
    return max(sorted(set(told)), key=told.count) or f"storey {number}"


def _without_rings(spaces: Sequence[_Space], changes: Changes) -> list[_Space]:
    """The rooms without those around others, which a plan of outlines cannot hold."""
    kept = []
    for space in spaces:
        name = space.node["display_name"].text("room")
        holes = [Polygon(ring) for ring in space.plan.interiors]
        inside = (other.plan.representative_point() for other in spaces if other is not space)
        if holes and any(hole.contains(place) for place in inside for hole in holes):
            changes.note("rooms around other rooms were left out: {}", name)
            continue
        if holes:
            changes.note("yards inside rooms were filled: {}", name)
        kept.append(space)
    return kept


def _openings(spaces: Sequence[_Space], unit: float, changes: Changes) -> Iterator[LayoutOpening]:
    """Doors, windows and air boundaries, each once where two rooms state it."""
    plans = [space.plan for space in spaces]
    seen: list[Float64Array] = []
    for space in spaces:
        for node, kind in _holes(space.node):
            made = _opening(node, kind, space, plans, unit, changes)
            if made is None:
                continue
            place = np.array([*np.add(made.start, made.end) / 2, made.bottom + space.floor])
            if all(float(np.abs(place - other).max()) > _SAME for other in seen):
                seen.append(place)
                yield made


def _holes(room: Node) -> Iterator[tuple[Node, str]]:
    for face in room["faces"].items():
        for aperture in face["apertures"].items():
            yield aperture, "window"
        for door in face["doors"].items():
            yield door, "glazed" if door["is_glass"].value is True else "door"
        if face["face_type"].text() == "AirBoundary":
            yield face, "opening"


def _opening(
    node: Node,
    kind: str,
    space: _Space,
    plans: Sequence[Polygon],
    unit: float,
    changes: Changes,
) -> LayoutOpening | None:
    name = node["identifier"].text()
    corners = unit * _boundary(node["geometry"])
    low, high = float(corners[:, 2].min()), float(corners[:, 2].max())
    start, end = _ends(corners[:, :2])
    width = float(np.hypot(*np.subtract(end, start)))
    if Polygon(corners[:, :2]).area > 0.1 * width * max(high - low, 1e-9):
        changes.note(
            "skylights and other openings that do not stand upright were left out: {}", name
        )
        return None
    if width < _NARROWEST or high - low < _NARROWEST:
        changes.note("openings narrower than 0.1 m were left out: {}", name)
        return None
    outside = len(rooms_beside(plans, start, end)) < 2
    if kind == "window" and not outside:
        changes.note("windows between rooms became openings: {}", name)
    told: dict[str, OpeningKind] = {
        "window": "window" if outside else "opening",
        "glazed": "window" if outside else "door",
        "door": "entrance" if outside else "door",
        "opening": "opening",
    }
    bottom = max(low - space.floor, 0.0)
    return LayoutOpening(
        name, told[kind], start, end, bottom, max(high - space.floor, bottom + 0.1)
    )


def _ends(points: Float64Array) -> tuple[tuple[float, float], tuple[float, float]]:
    """The two of some points (N, 2) that are farthest from each other."""
    gaps = np.linalg.norm(points[:, None] - points[None], axis=2)
    first, last = np.unravel_index(int(gaps.argmax()), gaps.shape)
    (ax, ay), (bx, by) = points[first], points[last]
    return (float(ax), float(ay)), (float(bx), float(by))
