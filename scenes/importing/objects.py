"""Objects of a scene from its shapes: categories by name, structure by position.

Input: shapes in metres, Z up, and the rooms found. Output: the objects of `scene.json`. A shape
is part of the building's structure if most of its surface lies on the floor, walls or ceiling of
a room. All other shapes get a category from their names, and those of one category that touch,
or share a model number, become one object.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import cache

import numpy as np
import shapely
from shapely.geometry import Polygon

from pbrnet.scenes.arrays import BoolArray, Float64Array
from pbrnet.scenes.contract import SceneObject
from pbrnet.scenes.geometry.mesh import face_areas
from pbrnet.scenes.geometry.regions import intersection
from pbrnet.scenes.importing.categories import (
    category_of,
    category_of_part,
    has_structural_name,
    is_surface_by_name,
    own_name,
    room_type,
    surface_of,
)
from pbrnet.scenes.importing.shape import Shape, bounds_of, make_object
from pbrnet.scenes.reconstruction.room_index import RoomIndex
from pbrnet.scenes.reconstruction.rooms import FoundRoom

_SAMPLES = 400  # points on a shape's surface
_ON_WALL, _ON_LEVEL = 0.12, 0.06  # metres from a room's hull at which a surface counts as on it
_NEAR = 0.3  # metres around a room in which a surface may belong to its hull
_TOUCH_DISTANCE = 0.02  # metres
_LARGEST_RUG = 15.0  # square metres; what is larger and lies on a floor is a part of it
_NICHE_DEPTH = 0.8  # metres behind the outline of a room, as in a window bay, that belong to it
# Categories that stand on the floor; elsewhere, a name that says so is ignored.
_FLOOR_CATEGORIES = (
    "sofa",
    "armchair",
    "stool",
    "chair",
    "desk",
    "table",
    "bed",
    "wardrobe",
    "stove",
    "fridge",
    "toilet",
    "rug",
)

# Categories of things that a space may be inside of, and the greatest depth of such a thing.
_HOLLOW_CATEGORIES = (
    "wardrobe", "cabinet", "kitchen unit", "fridge", "chest", "sideboard", "shelf", "bookshelf",
    "tv stand", "box", "stove", "fireplace",
)  # fmt: skip
_HOLLOW_DEPTH = 1.6  # metres


@dataclass(frozen=True)
class _SurfaceSample:
    points: Float64Array  # (N, 3)
    normals: Float64Array  # unit (N, 3)
    area: float  # of the whole surface, square metres


def shape_category(shape: Shape) -> str:
    """The category that the names of a shape and of its material tell."""
    return category_of_part(shape.name, shape.surface.name)


def hollow_furniture(shapes: list[Shape]) -> list[tuple[Float64Array, Float64Array]]:
    """The bounds, two corners (3,), of shapes that are closed furniture by name and size."""
    bounds = [shape.mesh.bounds for shape in shapes if shape_category(shape) in _HOLLOW_CATEGORIES]
    return [(low, high) for low, high in bounds if (high - low)[:2].min() <= _HOLLOW_DEPTH]


def group_objects(
    shapes: list[Shape], rooms: list[FoundRoom], room_ids: list[str]
) -> tuple[SceneObject, ...]:
    """Group shapes into objects: structure by position, everything else by name and contact."""
    index = RoomIndex(rooms)
    structure = {shape.id: structure_category(shape, index) for shape in shapes}
    categories = {
        shape.id: structure[shape.id]
        or ("lamp" if shape.emitter is not None else "")
        or shape_category(shape)
        for shape in shapes
    }
    objects = []
    for members in _groups(shapes, structure, categories):
        first = members[0]
        low, high = bounds_of(members)
        category = categories[first.id]
        if category in _FLOOR_CATEGORIES and not _on_floor(low, rooms):
            category = "other"
        label = first.surface.name if first.name.lower().startswith("mesh") else first.name
        objects.append(
            make_object(
                first.id,
                label or category,
                category,
                members,
                is_structure=structure[first.id] != "",
                room=room_of(0.5 * (low + high), low, index, room_ids),
            )
        )
    return tuple(objects)


def type_of_room(objects: tuple[SceneObject, ...], room: str, hint: str) -> str:
    """The type of a room from `hint`, the scene's name, else from the objects in it."""
    inside = [
        scene_object.category
        for scene_object in objects
        if scene_object.room == room and not scene_object.is_structure
    ]
    return room_type(hint, inside)


def structure_category(shape: Shape, index: RoomIndex) -> str:
    """The structural category of a shape: floor, ceiling, wall or structure; "" for furniture.

    A shape is structure if most of its surface lies on a room's hull (floor, walls, ceiling) and
    it spans much of the room, or if it lies outside all rooms.
    """
    low, high = shape.mesh.bounds
    named = shape_category(shape)
    if named == "rug" and (
        category_of(shape.name) == "other" or (high - low)[:2].prod() > _LARGEST_RUG
    ):
        named = "other"  # carpet may be the floor's material
    if (
        named not in ("other", "window", "door")
        and index.containing(0.5 * (low + high), _NICHE_DEPTH) is not None
    ):
        return ""
    sample = _sample(shape)
    inside_any = False
    spread = _Spread()
    for number in index.near(low, high, _NEAR):
        room = index.rooms[number]
        x, y, z = sample.points.T
        near = shapely.contains_xy(index.grown(number, _NEAR), x, y)
        near &= (z > room.floor_z - _NEAR) & (z < room.ceiling_z + _NEAR)
        deep = (
            shapely.contains_xy(index.grown(number, -0.05), x, y)
            & (z > room.floor_z + 0.05)
            & (z < room.ceiling_z - 0.05)
        )
        if deep.mean() > 0.05:
            inside_any = True
        tight = shapely.contains_xy(index.grown(number, 0.05), x, y)
        inside_any = inside_any or (near & tight).mean() > 0.6
        spread.add(room, sample.points[near], sample.normals[near], tight[near])
        if near.mean() < 0.3:
            continue
        kind = _hull_category(sample, near, room, low, high)
        if kind:
            return kind
    if kind := spread.kind:
        return kind
    if index.rooms and not inside_any:
        return "structure"
    kind = surface_of(shape.name)
    if is_surface_by_name(own_name(shape.name, shape.surface.name)):
        return kind
    is_part = has_structural_name(shape.name) and (kind or has_structural_name(shape.surface.name))
    if is_part and float(np.max(high - low)) > 1.5:
        return kind or "structure"
    return ""


@dataclass
class _Spread:
    """A surface on the floors and ceilings of several rooms, none of which has most of it."""

    rooms: int = 0  # that it lies on
    points: int = 0  # of the sample, beside these rooms
    level: dict[str, int] = field(default_factory=lambda: {"floor": 0, "ceiling": 0})

    def add(
        self, room: FoundRoom, points: Float64Array, normals: Float64Array, inside: BoolArray
    ) -> None:
        """Add a room and the points (N, 3) of the sample beside it."""
        flat = (np.abs(normals[:, 2]) > 0.8) & inside
        found = {
            "floor": flat & (np.abs(points[:, 2] - room.floor_z) < _ON_LEVEL),
            "ceiling": flat & (np.abs(points[:, 2] - room.ceiling_z) < _ON_LEVEL),
        }
        self.rooms += int(any(each.any() for each in found.values()))
        self.points += int(inside.sum())
        for kind, on in found.items():
            self.level[kind] += int(on.sum())

    @property
    def kind(self) -> str:
        """The part of the building that it is, "" if it is none."""
        if self.rooms < 2:
            return ""
        return next((kind for kind, on in self.level.items() if on > 0.4 * self.points), "")


def _hull_category(
    sample: _SurfaceSample,
    near: BoolArray,
    room: FoundRoom,
    low: Float64Array,
    high: Float64Array,
) -> str:
    """The part of a room's hull that a shape with bounds `low` and `high` (3,) forms, or "".

    `near` (N,) selects the sample points close to the room.
    """
    points, normals = sample.points[near], sample.normals[near]
    edge = shapely.distance(room.floor.exterior, shapely.points(points[:, :2]))
    outside = ~shapely.contains_xy(room.floor, points[:, 0], points[:, 1])
    floor = (points[:, 2] < room.floor_z + _ON_LEVEL) & (np.abs(normals[:, 2]) > 0.8)
    ceiling = (points[:, 2] > room.ceiling_z - _ON_LEVEL) & (np.abs(normals[:, 2]) > 0.8)
    wall = (edge < _ON_WALL) | outside
    on = floor | ceiling | wall
    if on.mean() < 0.6:
        return ""
    west, south, east, north = room.floor.bounds
    spans = np.array([(high[0] - low[0]) / (east - west), (high[1] - low[1]) / (north - south)])
    tall = (high[2] - low[2]) / (room.ceiling_z - room.floor_z)
    area = sample.area
    if floor.mean() > 0.4:
        covered = intersection(Polygon.from_bounds(low[0], low[1], high[0], high[1]), room.floor)
        return "floor" if covered.area > min(0.6 * room.floor.area, _LARGEST_RUG) else ""
    if ceiling.mean() > 0.4:
        covered = intersection(Polygon.from_bounds(low[0], low[1], high[0], high[1]), room.floor)
        return "ceiling" if covered.area > 0.5 * room.floor.area else ""
    if wall.mean() > 0.5 and ((spans.max() > 0.5 and tall > 0.5) or (tall > 0.85 and area > 2.0)):
        return "wall"
    if spans.max() > 0.7:
        return "structure"
    return ""


def _groups(
    shapes: list[Shape], structure: dict[str, str], categories: dict[str, str]
) -> list[list[Shape]]:
    """Groups of shapes that share a model number, or have one category and touch."""
    parent = list(range(len(shapes)))

    def root(index: int) -> int:
        while parent[index] != index:
            parent[index] = parent[parent[index]]
            index = parent[index]
        return index

    models: dict[str, int] = {}
    for index, shape in enumerate(shapes):
        match = re.match(r"(.*#\d+)", shape.name)
        if match and not structure[shape.id]:
            parent[root(index)] = root(models.setdefault(match[1], index))
    bounds = np.array([shape.mesh.bounds for shape in shapes])
    for index, shape in enumerate(shapes):
        category = categories[shape.id]
        if structure[shape.id] or category in ("other", "lamp"):
            continue
        meets = (bounds[:, 0] <= bounds[index, 1] + _TOUCH_DISTANCE).all(axis=1) & (
            bounds[:, 1] >= bounds[index, 0] - _TOUCH_DISTANCE
        ).all(axis=1)
        for other in np.nonzero(meets)[0].tolist():
            same = categories[shapes[other].id] == category and not structure[shapes[other].id]
            if other > index and same:
                parent[root(other)] = root(index)
    groups: dict[int, list[Shape]] = {}
    for index, shape in enumerate(shapes):
        groups.setdefault(root(index), []).append(shape)
    return list(groups.values())  # in the file's order of their first members


def _sample(shape: Shape) -> _SurfaceSample:
    """Sample a surface uniformly by area with a Halton sequence, without randomness."""
    corners = shape.mesh.corners
    areas, normals = face_areas(corners)
    total = float(areas.sum())
    picks = np.searchsorted(np.cumsum(areas), (np.arange(_SAMPLES) + 0.5) * total / _SAMPLES)
    picks = np.minimum(picks, len(areas) - 1)
    a, b = _places_in_triangle()
    chosen = corners[picks]
    points = (
        chosen[:, 0]
        + a[:, None] * (chosen[:, 1] - chosen[:, 0])
        + b[:, None] * (chosen[:, 2] - chosen[:, 0])
    )
    return _SurfaceSample(points, normals[picks], total)


@cache
def _places_in_triangle() -> tuple[Float64Array, Float64Array]:
    """Halton points of the unit square, folded into a triangle, in its two coordinates."""
    a, b = _halton(2), _halton(3)
    fold = a + b > 1
    return np.where(fold, 1 - a, a), np.where(fold, 1 - b, b)


def _halton(base: int) -> Float64Array:
    """The first elements (N,) of the Halton sequence in `base` (van der Corput)."""
    index = np.arange(1, _SAMPLES + 1)
    result, fraction = np.zeros(_SAMPLES), 1.0
    while index.any():
        fraction /= base
        result += fraction * (index % base)
        index = index // base
    return result


def room_of(
    centre: Float64Array, low: Float64Array, index: RoomIndex, ids: list[str]
) -> str | None:
    """The id of the room that contains an object, or None.

    `centre` and `low` (3,) are the centre and the lowest corner of its bounds. Niches and window
    bays belong to the room.
    """
    foot = np.array([centre[0], centre[1], low[2]])
    for place, margin in ((centre, 0.1), (foot, 0.1), (centre, _NICHE_DEPTH)):
        number = index.containing(place, margin)
        if number is not None:
            return ids[number]
    return None


def _on_floor(low: Float64Array, rooms: list[FoundRoom]) -> bool:
    return not rooms or any(abs(low[2] - room.floor_z) < 0.35 for room in rooms)
