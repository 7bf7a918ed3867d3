"""Openings of a layout in the walls of its plan: the faces they are cut from, and their kind."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from pbrnet.scenes.contract import Point2
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.geometry.regions import intersection
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.layout.layout import Layout, LayoutOpening
from pbrnet.scenes.procedural.plan import Opening, OpeningKind, PlanRoom, WallEdge

_REACH = 0.5  # metres from a line to the face that it is cut from
_ALONG = math.cos(math.radians(8.0))  # least cosine between a line and its wall
_OPPOSITE = math.cos(math.radians(0.6))  # the same, of the two faces of a wall
_THICKEST = 1.5  # metres, of a wall
_MARGIN = 0.01  # metres from an opening to the end of its wall
_LINTEL = 0.02  # metres from an opening to the ceiling
_LEAST = {"door": 0.4, "entrance": 0.4, "archway": 0.3, "open": 0.2, "window": 0.25, "patio": 0.4}
_AT_FLOOR = 0.03  # metres; windows that begin lower are glazed doors


@dataclass(frozen=True)
class _Cut:
    """A stretch of wall: its face in a room, [s0, s1] along it, thickness, the room behind it."""

    room: PlanRoom
    face: WallEdge
    s0: float
    s1: float
    thickness: float
    behind: PlanRoom | None


def cut_openings(
    layout: Layout, rooms: Sequence[PlanRoom], rings: Iterable[tuple[Point2, ...]], changes: Changes
) -> list[tuple[Opening, LayoutOpening]]:
    """Return the openings of a plan with such rooms and outer faces (rings), as they were stated.

    What lies in no wall, or leaves no space, is refused or left out, see `Layout.strict`.
    """
    outside = [
        WallEdge(end, start, True)
        for ring in rings
        for start, end in zip(ring, ring[1:] + ring[:1], strict=True)
    ]
    heights = {room.id: room.height or layout.height for room in rooms}
    ids = {stated.id: room.id for stated, room in zip(layout.rooms, rooms, strict=True)}
    named_by = {made: stated for stated, made in ids.items()}
    made: list[tuple[Opening, LayoutOpening]] = []
    for number, stated in enumerate(layout.openings):
        named = [room for room in rooms if stated.room in (None, named_by[room.id])]
        cut = _find_cut(stated, named, rooms, outside)
        problem = "lies in no wall" if cut is None else ""
        if cut is not None:
            opening = _opening(stated, cut, heights, ids, len(made), changes)
            problem = _problem(opening, [other for other, _ in made])
        if not problem:
            made.append((opening, stated))
        elif layout.strict:
            raise InputError(f"openings[{number}]: the {stated.kind} {stated.id!r} {problem}")
        else:
            changes.note(f"left out, since it {problem}: {{}}", f"{stated.kind} {stated.id}")
    return made


def _find_cut(
    stated: LayoutOpening,
    named: Sequence[PlanRoom],
    rooms: Sequence[PlanRoom],
    outside: list[WallEdge],
) -> _Cut | None:
    """The wall of one of the named rooms that an opening lies in, and how much of it is cut."""
    best: tuple[float, float, PlanRoom, WallEdge, float, float] | None = None
    width = max(math.dist(stated.start, stated.end), 1e-9)
    for room in named:
        for edge in room.edges:
            (s0, d0), (s1, d1) = edge.coordinates(stated.start), edge.coordinates(stated.end)
            low, high = max(min(s0, s1), _MARGIN), min(max(s0, s1), edge.length - _MARGIN)
            depth = abs(0.5 * (d0 + d1))
            if abs(s1 - s0) < _ALONG * width or depth > _REACH or high - low < 0.4 * width:
                continue
            score = (round((high - low) / width, 2), -round(depth, 4))
            if best is None or score > best[:2]:
                best = (*score, room, edge, low, high)
    if best is None:
        return None
    _, _, room, face, s0, s1 = best
    inner = [(each, other) for other in rooms if other.id != room.id for each in other.edges]
    found = _opposite(face, s0, s1, inner)
    if found is None:
        found = _opposite(face, s0, s1, [(edge, None) for edge in outside])
    return None if found is None else _Cut(room, face, *found)


def _opposite(
    face: WallEdge,
    s0: float,
    s1: float,
    candidates: Iterable[tuple[WallEdge, PlanRoom | None]],
) -> tuple[float, float, float, PlanRoom | None] | None:
    """Of [s0, s1] what has a face behind it, the wall's thickness, and the room behind it.

    The nearest face that covers most of it counts.
    """
    best: tuple[float, float, float, float, PlanRoom | None] | None = None
    for edge, room in candidates:
        if float(np.dot(edge.inward, face.inward)) > -_OPPOSITE:
            continue
        near, far = face.coordinates(edge.end), face.coordinates(edge.start)
        low, high = max(s0, near[0] + _MARGIN), min(s1, far[0] - _MARGIN)
        share = near[1] + (0.5 * (low + high) - near[0]) / max(far[0] - near[0], 1e-9) * (
            far[1] - near[1]
        )
        if high - low < 0.5 * (s1 - s0) or not 0.015 < -share < _THICKEST:
            continue
        score = round((high - low) / (s1 - s0), 2) + share  # share < 0: the thickness counts
        if best is None or score > best[0]:
            best = (score, low, high, -share, room)
    return None if best is None else best[1:]


def _opening(
    stated: LayoutOpening,
    cut: _Cut,
    heights: dict[str, float],
    ids: dict[str, str],
    number: int,
    changes: Changes,
) -> Opening:
    """The opening in the plan; its start and end follow the direction of the wall's face."""
    rooms = (cut.room.id,) if cut.behind is None else (cut.room.id, cut.behind.id)
    kind, bottom = _kind(stated, cut.behind is None, changes)
    start_first = cut.face.coordinates(stated.start)[0] <= cut.face.coordinates(stated.end)[0]
    top = min(stated.top, min(heights[room] for room in rooms) - _LINTEL)
    swing = ids.get(stated.swing or "", "")
    return Opening(
        id="entrance" if kind == "entrance" and number == 0 else f"{_NAMES[kind]}-{number}",
        kind=kind,
        start=_rounded(cut.face.at(cut.s0)),
        end=_rounded(cut.face.at(cut.s1)),
        thickness=round(cut.thickness, 6),
        z0=bottom,
        z1=top,
        rooms=rooms,
        hinge_at_start=(stated.hinge == "start") == start_first,
        swing=swing if swing in rooms else rooms[0],
    )


_NAMES = {
    "door": "door", "entrance": "entrance", "archway": "archway", "open": "opening",
    "window": "window", "patio": "window",
}  # fmt: skip


def _kind(stated: LayoutOpening, outer: bool, changes: Changes) -> tuple[OpeningKind, float]:
    """The kind in the plan and the height of the lower edge."""
    low = stated.bottom if stated.bottom > _AT_FLOOR else 0.0
    if outer and stated.kind in ("opening", "archway"):
        changes.note("openings to the outdoors became windows: {}", stated.id)
    if outer and stated.kind not in ("door", "entrance"):
        return ("window", low) if low else ("patio", 0.0)
    if stated.kind in ("door", "entrance"):
        if low:
            changes.note("doors above the floor were brought down to it: {}", stated.id)
        return ("entrance" if outer else "door"), 0.0
    if stated.kind == "window":
        changes.note("windows between rooms became openings without a frame: {}", stated.id)
    return ("archway", 0.0) if stated.kind == "archway" and not low else ("open", low)


def _problem(opening: Opening, others: Sequence[Opening]) -> str:
    """Why an opening cannot be built; empty if it can."""
    if opening.width < _LEAST[opening.kind] or opening.z1 - opening.z0 < _LEAST["window"]:
        return (
            f"would be {opening.width:.2f} m wide and {opening.z1 - opening.z0:.2f} m high between "
            "the ends of its wall"
        )
    for other in others:
        apart = opening.z0 >= other.z1 or other.z0 >= opening.z1
        if not apart and intersection(opening.footprint, other.footprint).area > 1e-6:
            return f"overlaps {other.id!r}"
    return ""


def _rounded(point: Point2) -> Point2:
    return (round(point[0], 6), round(point[1], 6))
