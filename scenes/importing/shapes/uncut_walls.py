"""Walls with windows and doors inside them: solid boxes that lie in each other, as scanners write.

RoomPlan and the like write a wall as a whole box, and a window, door or passage as another box
inside it. The wall gets a hole there; the window becomes a clear pane, the passage is left open.
World: metres, Z up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely.geometry import box

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.geometry.mesh import Mesh, face_areas
from pbrnet.scenes.geometry.regions import difference, union
from pbrnet.scenes.importing.categories import category_of, words_of
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.materials.surface import clear_glass
from pbrnet.scenes.importing.shape import Shape
from pbrnet.scenes.reconstruction.completion import extruded

_THICKEST = 0.7  # metres, of a wall
_BOX = 0.03  # share by which the surface of a box may differ from that of its bounds
_BESIDE = 0.05  # metres by which what is inside a wall may stand out of it
_LEAST = 0.2  # metres, width and height of a hole
_THINNEST = 0.002  # metres, of a wall with holes; scanners also write walls of no thickness


@dataclass(frozen=True)
class _Slab:
    """An upright box: `frame` rows are along, up, across; `low` and `high` (3,) in that frame."""

    frame: Float64Array
    low: Float64Array
    high: Float64Array

    def within(self, points: Float64Array) -> tuple[Float64Array, Float64Array] | None:
        """Bounds (3,), (3,) of points (N, 3) in the frame, if they lie inside; else None."""
        local = points @ self.frame.T
        low, high = local.min(axis=0), local.max(axis=0)
        inside = (low >= self.low - _BESIDE).all() and (high <= self.high + _BESIDE).all()
        return (low, high) if inside and (high - low)[:2].min() >= _LEAST else None

    def without(self, holes: Sequence[tuple[Float64Array, Float64Array]]) -> Mesh:
        """The box as a mesh, with holes from one face to the other."""
        cut = union([box(*low[:2], *high[:2]) for low, high in holes])
        plan = difference(box(*self.low[:2], *self.high[:2]), cut)
        middle = 0.5 * float(self.low[2] + self.high[2])
        half = 0.5 * max(float(self.high[2] - self.low[2]), _THINNEST)
        corners = extruded(plan, middle - half, middle + half) @ self.frame
        return Mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


def with_cut_walls(shapes: list[Shape], changes: Changes) -> list[Shape]:
    """Cut whole boxes called walls where windows, doors and openings lie inside them."""
    slabs = {
        shape.id: slab
        for shape in shapes
        if "wall" in words_of(shape.name) and (slab := _slab(shape.mesh)) is not None
    }
    holes: dict[str, list[tuple[Float64Array, Float64Array]]] = {}
    made: list[Shape] = []
    for shape in shapes:
        kind = "" if shape.id in slabs else _kind(shape.name)
        found = [
            (id_, bounds)
            for id_, slab in slabs.items()
            if kind and (bounds := slab.within(shape.mesh.vertices)) is not None
        ]
        for id_, bounds in found:
            holes.setdefault(id_, []).append(bounds)
        if not found or kind == "door" or (kind == "window" and _slab(shape.mesh) is None):
            made.append(shape)
        elif kind == "window":
            id_, bounds = found[0]
            made.append(replace(shape, mesh=_pane(slabs[id_], *bounds), surface=clear_glass()))
    if holes:
        changes.note(f"walls were cut where windows, doors or openings lie in them: {len(holes)}")
    cut = [
        replace(shape, mesh=slabs[shape.id].without(holes[shape.id]))
        if shape.id in holes
        else shape
        for shape in made
    ]
    return [shape for shape in cut if len(shape.mesh.faces)]  # a door can fill its whole wall


def _kind(name: str) -> str:
    category = category_of(name)
    return category if category in ("window", "door") else "opening" * ("opening" in words_of(name))


def _slab(mesh: Mesh) -> _Slab | None:
    """The upright box that a mesh is; None if it is another form, or has holes."""
    points = mesh.vertices
    rectangle = shapely.MultiPoint(points[:, :2]).minimum_rotated_rectangle
    if rectangle.geom_type != "Polygon":
        return None
    ring = np.array(rectangle.exterior.coords)
    sides = np.diff(ring[:3], axis=0)
    lengths = np.linalg.norm(sides, axis=1)
    along = np.append(sides[int(np.argmax(lengths))] / lengths.max(), 0.0)
    up = np.array([0.0, 0.0, 1.0])
    frame = np.stack([along, up, np.cross(along, up)])
    local = points @ frame.T
    low, high = local.min(axis=0), local.max(axis=0)
    width, height, depth = high - low
    whole = 2 * (width * height + height * depth + depth * width)
    surface = float(face_areas(mesh.corners)[0].sum())
    is_box = abs(surface - whole) <= _BOX * whole and depth <= _THICKEST
    return _Slab(frame, low, high) if is_box else None


def _pane(slab: _Slab, low: Float64Array, high: Float64Array) -> Mesh:
    """A sheet across a hole, in the middle of the wall."""
    middle = 0.5 * (slab.low[2] + slab.high[2])
    local = np.array(
        [
            [x, z, middle]
            for x, z in ((low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1]))
        ]
    )
    return Mesh(local @ slab.frame, np.array([[0, 1, 2], [0, 2, 3]]))  # fmt: skip
