"""What the shapes are: categories by name, structure by place, one object per thing."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry import Polygon

from scenes.arrays import Float64Array
from scenes.contract import SceneObject
from scenes.geometry.mesh import face_areas
from scenes.importing.categories import category_of, room_type
from scenes.importing.shape import Shape
from scenes.reconstruction.rooms import FoundRoom

_SAMPLES = 400
_ON_WALL, _ON_LEVEL = 0.12, 0.06  # metres from the room's hull that still belong to it
_TOUCHING = 0.02
_NICHE = 0.8  # metres behind the room's outline (window bays) where a named thing is still in it
_STANDING = (
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

_WALL_WORDS = ("wall", "walls", "ceiling", "floor", "roof", "skirting", "baseboard", "beam",
               "molding", "moulding", "cornice", "plinth", "pillar", "column", "slab")  # fmt: skip


@dataclass(frozen=True)
class _Sample:
    points: Float64Array
    normals: Float64Array
    area: float


def category_of_shape(shape: Shape) -> str:
    """The category by the names of the shape and of its material."""
    return category_of(shape.name, shape.surface.name)


def group_objects(
    shapes: list[Shape], rooms: list[FoundRoom], room_ids: list[str]
) -> tuple[SceneObject, ...]:
    """Objects out of shapes: structure by where it lies, things by name and touch."""
    structure = {shape.id: structural_kind(shape, rooms) for shape in shapes}
    categories = {
        shape.id: structure[shape.id]
        or ("lamp" if shape.emitter is not None else "")
        or category_of_shape(shape)
        for shape in shapes
    }
    objects = []
    for members in _groups(shapes, structure, categories):
        first = members[0]
        low, high = bounds_of(members)
        category = categories[first.id]
        if category in _STANDING and not _on_floor(low, rooms):
            category = "other"
        label = first.surface.name if first.name.lower().startswith("mesh") else first.name
        objects.append(
            SceneObject(
                id=first.id,
                name=label or category,
                category=category,
                shapes=tuple(member.id for member in members),
                bbox_min=_triple(low),
                bbox_max=_triple(high),
                is_structure=structure[first.id] != "",
                room=room_of(0.5 * (low + high), low, rooms, room_ids),
            )
        )
    return tuple(objects)


def type_of_room(objects: tuple[SceneObject, ...], room: str, hint: str) -> str:
    """The type of a room from the scene's name, else from what stands in it."""
    inside = [thing.category for thing in objects if thing.room == room and not thing.is_structure]
    return room_type(hint, inside)


def structural_kind(shape: Shape, rooms: list[FoundRoom]) -> str:
    """Which part of the building a shape is: floor, ceiling, wall or structure; "" for things.

    A shape is structure when most of its surface lies on a room's hull and it spans much of it.
    """
    sample = _sample(shape)
    low, high = shape.mesh.bounds
    if category_of_shape(shape) not in ("other", "window", "door") and any(
        room.holds(0.5 * (low + high), _NICHE) for room in rooms
    ):
        return ""
    inside_any = False
    for room in rooms:
        grown = room.floor.buffer(0.3)
        near = shapely.contains_xy(grown, sample.points[:, 0], sample.points[:, 1])
        near &= (sample.points[:, 2] > room.floor_z - 0.3) & (
            sample.points[:, 2] < room.ceiling_z + 0.3
        )
        deep = (
            shapely.contains_xy(room.floor.buffer(-0.05), sample.points[:, 0], sample.points[:, 1])
            & (sample.points[:, 2] > room.floor_z + 0.05)
            & (sample.points[:, 2] < room.ceiling_z - 0.05)
        )
        if deep.mean() > 0.05:
            inside_any = True
        tight = shapely.contains_xy(room.floor.buffer(0.05), *sample.points[:, :2].T)
        inside_any = inside_any or (near & tight).mean() > 0.6
        if near.mean() < 0.3:
            continue
        kind = _on_hull(sample, near, room, low, high)
        if kind:
            return kind
    if rooms and not inside_any:
        return "structure"
    words = _words(shape.name)
    hints = words & set(_WALL_WORDS)
    if hints and (
        _words(shape.surface.name) & set(_WALL_WORDS) or hints & {"wall", "floor", "ceiling"}
    ):
        span = float(np.max(high - low))
        if span > 1.5:
            return next(
                (kind for kind in ("floor", "ceiling", "wall") if kind in words), "structure"
            )
    return ""


def _on_hull(
    sample: _Sample, near: np.ndarray, room: FoundRoom, low: Float64Array, high: Float64Array
) -> str:
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
        covered = Polygon.from_bounds(low[0], low[1], high[0], high[1]).intersection(room.floor)
        return "floor" if covered.area > 0.6 * room.floor.area else ""
    if ceiling.mean() > 0.4:
        covered = Polygon.from_bounds(low[0], low[1], high[0], high[1]).intersection(room.floor)
        return "ceiling" if covered.area > 0.5 * room.floor.area else ""
    if wall.mean() > 0.5 and ((spans.max() > 0.5 and tall > 0.5) or (tall > 0.85 and area > 2.0)):
        return "wall"
    if spans.max() > 0.7:
        return "structure"
    return ""


def _groups(
    shapes: list[Shape], structure: dict[str, str], categories: dict[str, str]
) -> list[list[Shape]]:
    """Shapes that are one thing: same model number, or same category and touching."""
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
        meets = (bounds[:, 0] <= bounds[index, 1] + _TOUCHING).all(axis=1) & (
            bounds[:, 1] >= bounds[index, 0] - _TOUCHING
        ).all(axis=1)
        for other in np.nonzero(meets)[0].tolist():
            same = categories[shapes[other].id] == category and not structure[shapes[other].id]
            if other > index and same:
                parent[root(other)] = root(index)
    groups: dict[int, list[Shape]] = {}
    for index, shape in enumerate(shapes):
        groups.setdefault(root(index), []).append(shape)
    # A group is called after its first member, which keeps the file's order.
    return sorted(groups.values(), key=lambda group: shapes.index(group[0]))


def _sample(shape: Shape) -> _Sample:
    """Points spread over the surface in proportion to area, the same every time."""
    corners = shape.mesh.corners
    areas, normals = face_areas(corners)
    total = float(areas.sum())
    picks = np.searchsorted(np.cumsum(areas), (np.arange(_SAMPLES) + 0.5) * total / _SAMPLES)
    picks = np.minimum(picks, len(areas) - 1)
    # Halton numbers, folded into the triangle.
    a = _halton(2)
    b = _halton(3)
    fold = a + b > 1
    a, b = np.where(fold, 1 - a, a), np.where(fold, 1 - b, b)
    chosen = corners[picks]
    points = (
        chosen[:, 0]
        + a[:, None] * (chosen[:, 1] - chosen[:, 0])
        + b[:, None] * (chosen[:, 2] - chosen[:, 0])
    )
    return _Sample(points, normals[picks], total)


def _halton(base: int) -> Float64Array:
    index = np.arange(1, _SAMPLES + 1)
    result, fraction = np.zeros(_SAMPLES), 1.0
    while index.any():
        fraction /= base
        result += fraction * (index % base)
        index = index // base
    return result


def bounds_of(shapes: list[Shape]) -> tuple[Float64Array, Float64Array]:
    """Lowest and highest corner (3,) of shapes together."""
    bounds = np.array([shape.mesh.bounds for shape in shapes])
    return bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)


def room_of(
    centre: Float64Array, low: Float64Array, rooms: list[FoundRoom], ids: list[str]
) -> str | None:
    """The room that holds a thing with this centre and lowest corner; niches count."""
    foot = np.array([centre[0], centre[1], low[2]])
    for place, margin in ((centre, 0.1), (foot, 0.1), (centre, _NICHE)):
        for room, name in zip(rooms, ids, strict=True):
            if room.holds(place, margin):
                return name
    return None


def _on_floor(low: Float64Array, rooms: list[FoundRoom]) -> bool:
    return not rooms or any(abs(low[2] - room.floor_z) < 0.35 for room in rooms)


def _words(label: str) -> set[str]:
    spaced = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", label)
    return {word.lower() for word in re.findall(r"[A-Za-z]+", spaced)} | {
        word.lower() for word in re.findall(r"[A-Za-z]+", label)
    }


def _triple(values: Float64Array) -> tuple[float, float, float]:
    return (float(values[0]), float(values[1]), float(values[2]))
