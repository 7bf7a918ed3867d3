"""Indoor rooms of a home, what lies in them, and the portals that lead out of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
import shapely
from shapely.geometry import Point, Polygon
from shapely.geometry.base import BaseGeometry

from pbrnet.scenes.arrays import Float64Array, as_triple
from pbrnet.scenes.contract import Portal, Room
from pbrnet.scenes.geometry.mesh import face_areas
from pbrnet.scenes.geometry.regions import buffered, deepest_point, simplified, union
from pbrnet.scenes.importing.categories import category_of_piece, room_type
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.sweethome.building.gaps import find_gaps
from pbrnet.scenes.sweethome.building.openings import Opening
from pbrnet.scenes.sweethome.building.plan import Level
from pbrnet.scenes.sweethome.building.portals import Doorway, Leaves, find_doorways
from pbrnet.scenes.sweethome.building.slabs import floor_outline
from pbrnet.scenes.sweethome.building.solids import world_region
from pbrnet.scenes.sweethome.building.spaces import Space
from pbrnet.scenes.sweethome.furnishing.items import PlacedItem
from pbrnet.scenes.sweethome.furnishing.missing import MissingPiece

_KNEE = 0.5  # metres from a floor or ceiling into its room
_REST = 0.1  # of a room's floor, below which its ceiling is a rest
_SLIVER = 0.05  # metres: half the width of a rest of floor or ceiling that makes no room
_LEAST_HEIGHT = 1.5  # metres of a room at its highest; a crawl space is lower


def indoor_rooms(levels: list[Level], changes: Changes) -> Indoors:
    """Return the indoor rooms; `changes` says why other spaces are none."""
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
    return Indoors(rooms, regions)


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


class Indoors:
    """Rooms with their regions on the plan, indexed by place."""

    def __init__(self, rooms: list[Room], regions: list[BaseGeometry]) -> None:
        self.rooms = rooms
        self._regions = regions
        self._tree = shapely.STRtree(regions)

    def room_at(self, point: Sequence[float] | Float64Array, margin: float) -> str | None:
        """Return the room that contains a point (3,), the last of overlapping ones; or None."""
        x, y, z = (float(value) for value in point)
        around = shapely.box(x - margin, y - margin, x + margin, y + margin)
        for number in sorted(self._tree.query(around).tolist(), reverse=True):
            room = self.rooms[number]
            if (
                room.floor_z - 0.3 <= z <= room.ceiling_z + 0.3
                and self._regions[number].distance(Point(x, y)) <= margin
            ):
                return room.id
        return None


def with_room(item: PlacedItem, indoors: Indoors) -> PlacedItem:
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


def _room_of_slab(item: PlacedItem, indoors: Indoors) -> str | None:
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


def find_portals(
    levels: list[Level], indoors: Indoors, pieces: list[PlacedItem]
) -> tuple[list[Portal], set[tuple[str, str]]]:
    """Return the portals to the outside, and the pairs of rooms with a clear opening between."""
    portals: list[Portal] = []
    joined: set[tuple[str, str]] = set()
    leaves = Leaves(pieces)
    for level in levels:
        walls = level.wall_regions
        tree = shapely.STRtree([region for region, _ in walls])
        doorways: list[tuple[Doorway, Literal["window", "door", "opening"]]] = [
            (doorway, "door" if _is_door(opening) else "window")
            for opening in level.openings
            for doorway in find_doorways(
                opening, [walls[near] for near in sorted(tree.query(opening.footprint).tolist())]
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
                    polygon=tuple(as_triple(point) for point in polygon),
                    normal=as_triple(outward),
                    clear=is_clear,
                    room=room,
                )
            )
    return portals, joined


def _is_door(opening: Opening) -> bool:
    piece = opening.piece
    return category_of_piece(piece.kind, piece.name, piece.catalog_id)[0] == "door"


def described_rooms(
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


def lit_rooms(
    items: list[PlacedItem], portals: list[Portal], joined: set[tuple[str, str]]
) -> set[str | None]:
    """Return the rooms with a lamp that is on or a clear portal, and those joined with one.

    At night, `portals` are none: a window gives no light then.
    """
    lit = {item.room for item in items if item.lumens > 0}
    lit |= {portal.room for portal in portals if portal.clear}
    return lit | {there for here, there in joined if here in lit}
