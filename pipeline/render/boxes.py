"""Upright oriented boxes of a scene's objects.

A box stands on its base, as furniture does: one axis is the world's up, the other two are those of
the smallest rectangle around the object's outline from above. If the rectangle along the world's
axes is hardly larger, the box takes that: so round and square things have no arbitrary turn.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import mitsuba as mi
import numpy as np
import shapely

from pbrnet.pipeline.render.drjit_arrays import bounds_of
from pbrnet.pipeline.render.scene_geometry import SceneGeometry
from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.geometry.directions import turned

_HARDLY = 1.01  # ratio of areas below which the world's axes are preferred
_GRID = 1e-6  # metres, and of cosines: what is decided and stored is rounded to it


@dataclass(frozen=True)
class Box:
    """Oriented box in world metres: centre (3,), unit axes as rows (3, 3), half sizes (3,).

    The third axis is up; the first lies 0 to 90 degrees left of +X, the second to its left.
    """

    centre: Float64Array
    axes: Float64Array
    half_sizes: Float64Array

    @property
    def corners(self) -> Float64Array:
        """The eight corners, (8, 3)."""
        return self.grid(2)

    def grid(self, count: int) -> Float64Array:
        """Return a regular grid of points over the box, borders included, (count^3, 3)."""
        steps = np.linspace(-1, 1, count)
        places = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), -1).reshape(-1, 3)
        return self.centre + turned(places * self.half_sizes, self.axes.T)


class ObjectBoxes:
    """Boxes of the objects of an open scene, each made when it is first needed."""

    def __init__(self, geometry: SceneGeometry) -> None:
        self._geometry = geometry
        self._made: dict[int, Box] = {}

    def of(self, number: int) -> Box:
        """Return the box of the object with this index in `scene.objects`."""
        if number not in self._made:
            shapes = np.flatnonzero(self._geometry.objects == number)
            points = [shape_points(self._geometry.shapes[shape]) for shape in shapes]
            self._made[number] = box_around(np.concatenate(points))
        return self._made[number]


def box_around(points: Float64Array) -> Box:
    """Return the upright box around points (N, 3) in world metres."""
    path = np.concatenate([points, points[:1]])[:, :2]  # a line needs two points
    outline = shapely.get_coordinates(shapely.convex_hull(shapely.linestrings(path)))
    edges = np.diff(np.concatenate([outline, outline[:1]]), axis=0)
    edges = edges[np.linalg.norm(edges, axis=1) > 0]
    angles = np.append(0.0, np.arctan2(edges[:, 1], edges[:, 0]) % (math.pi / 2))
    along = outline @ np.stack([np.cos(angles), np.sin(angles)])
    across = outline @ np.stack([-np.sin(angles), np.cos(angles)])
    areas = np.ptp(along, axis=0) * np.ptp(across, axis=0)
    best = int(areas.argmin())
    angle = 0.0 if areas[0] <= _HARDLY * areas[best] else angles[best]
    x = _rounded(np.array([math.cos(angle), math.sin(angle), 0]))
    axes = np.stack([x, [-x[1], x[0], 0], [0, 0, 1]])
    local = turned(points, axes)
    low, high = local.min(axis=0), local.max(axis=0)
    # Rounded outwards, so that the stored box holds every point.
    half = np.ceil((high - low) / 2 / _GRID + 1) * _GRID
    return Box(_rounded(turned((low + high) / 2, axes.T)), axes, half)


def shape_points(shape: Any) -> Float64Array:
    """Return points (N, 3) whose hull holds a shape: vertices, or corners of its bounds."""
    params = mi.traverse(shape)
    if "vertex_positions" in params:
        return np.array(params["vertex_positions"], dtype=np.float64).reshape(-1, 3)
    if shape.class_name() == "Rectangle":
        to_world = np.array(params["to_world"].matrix, dtype=np.float64).reshape(4, 4)
        corners = np.array([[-1, -1, 0, 1], [1, -1, 0, 1], [1, 1, 0, 1], [-1, 1, 0, 1]])
        return (corners @ to_world.T)[:, :3]
    ends = bounds_of(shape)
    return np.array([[ends[i, 0], ends[j, 1], ends[k, 2]] for i, j, k in np.ndindex(2, 2, 2)])


def _rounded(values: Float64Array) -> Float64Array:
    return np.round(values / _GRID) * _GRID
