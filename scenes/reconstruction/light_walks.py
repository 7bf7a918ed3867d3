"""Random walks that show where light gets into a building.

With every lamp off and every portal closed, the rooms of a house must be black. Light paths are
reversible, so each walk starts at a random point inside a room and bounces off surfaces as light
does off matt ones. A walk that leaves the scene without crossing a known opening has found a way
in for light.

Importers use the escaped walks to find hidden openings and gaps; `pbrnet.pipeline.render.leaks`
uses the same sampling to prove that a finished scene has none. World: metres, Z up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
import shapely
from shapely.geometry import Polygon

from pbrnet.scenes.arrays import BoolArray, Float64Array, Int64Array
from pbrnet.scenes.geometry.directions import unit
from pbrnet.scenes.geometry.regions import buffered, deepest_point
from pbrnet.scenes.reconstruction.raycast import RayCaster
from pbrnet.scenes.reconstruction.rooms import FoundOpening, FoundRoom
from pbrnet.scenes.seeds import generator

MAX_BOUNCES = 8
_ESCAPE_LENGTH = 3.0  # metres of an escaped walk's last segment that are kept
_MAX_DRAWS = 50  # of points in a room's bounding rectangle
_OFFSET = 1e-4  # metres above a surface at which the next segment starts
_MIN_COSINE = 0.01  # below it, the next segment starts closer to the surface
_LEAST_LEVEL = 1e-6  # of a direction's length; steeper segments end on the plan where they start
_FEW_OPENINGS = 6  # up to which every plane is compared with every segment
_OVERLAP = 2e-3  # metres by which the blocker of a portal overlaps the portal's frame


class PlanarOpening(Protocol):
    """A planar polygon: corners (N, 3) and the normal (3,) of its plane."""

    @property
    def polygon(self) -> Any: ...

    @property
    def normal(self) -> Any: ...


@dataclass(frozen=True)
class EscapedWalk:
    """A walk that left the scene from room number `room`.

    `points` (K, 3) are its vertices: the start, every bounce, and an end point outdoors.
    """

    room: int
    points: Float64Array


@dataclass(frozen=True)
class LightWalker:
    """Random walks among triangles with unit `normals` (F, 3); `openings` absorb them."""

    rays: RayCaster
    normals: Float64Array
    openings: list[FoundOpening]

    @cached_property
    def _index(self) -> OpeningIndex:
        return OpeningIndex(self.openings)

    def escaped_walks(self, rooms: list[FoundRoom], count: int, seed: int) -> list[EscapedWalk]:
        """Trace `count` walks in each room and return those that escape."""
        return self.trace_rooms(rooms, count, seed)[0]

    def trace_rooms(
        self, rooms: list[FoundRoom], count: int, seed: int
    ) -> tuple[list[EscapedWalk], Float64Array]:
        """Trace `count` walks in each room.

        Returns those that escape, and the points (N, 3) where all of them hit a surface.
        """
        escaped, hit_points = [], [np.empty((0, 3))]
        for number, room in enumerate(rooms):
            rng = generator(seed, "escapes", number)
            origins = points_in_room(room, count, rng)
            directions = unit(rng.normal(size=(count, 3)))
            found, hits = self.trace(number, origins, directions, rng)
            escaped += found
            hit_points += hits
        return escaped, np.concatenate(hit_points)

    def trace(
        self,
        room: int,
        origins: Float64Array,
        directions: Float64Array,
        rng: np.random.Generator,
    ) -> tuple[list[EscapedWalk], list[Float64Array]]:
        """Trace walks that start at `origins` (N, 3) along unit `directions` (N, 3).

        Returns those that escape, and the hit points (M, 3) of each bounce.
        """
        escaped = []
        vertices = [origins]
        # Row of each active walk in every array of `vertices`.
        history = np.arange(len(origins))[:, None]
        for _ in range(MAX_BOUNCES):
            distance, triangle = self.rays.cast(origins, directions)
            absorbed = self._index.crossed(origins, directions, distance)
            for row in np.nonzero(~absorbed & np.isinf(distance))[0].tolist():
                past = [points[index] for points, index in zip(vertices, history[row], strict=True)]
                end = origins[row] + _ESCAPE_LENGTH * directions[row]
                escaped.append(EscapedWalk(room, np.array([*past, end])))
            active = ~absorbed & np.isfinite(distance)
            if not active.any():
                break
            origins, directions = diffuse_bounce(
                origins[active],
                directions[active],
                distance[active],
                self.normals[triangle[active]],
                rng,
            )
            vertices.append(origins)
            history = np.column_stack([history[active], np.arange(len(origins))])
        return escaped, vertices[1:]


class OpeningIndex:
    """Planar openings, indexed by their place on the plan, for segments that may cross them."""

    def __init__(self, openings: Sequence[PlanarOpening]) -> None:
        found = [_blocker(opening) for opening in openings]
        self._corner = np.array([corner for corner, *_ in found]).reshape(-1, 3)
        self._normal = np.array([normal for _, normal, *_ in found]).reshape(-1, 3)
        self._axes = np.array([axes for *_, axes, _ in found]).reshape(-1, 3, 2)
        self._blockers = np.array([blocker for *_, blocker in found], dtype=object)
        shapely.prepare(self._blockers)
        bounds = np.array([_plan_bounds(*one) for one in found]).reshape(-1, 4)
        self._tree = shapely.STRtree(shapely.box(*bounds.T))
        self._low, self._high = (
            bounds[:, :2].min(axis=0, initial=np.inf),
            bounds[:, 2:].max(axis=0, initial=-np.inf),
        )

    def crossed(
        self, origins: Float64Array, directions: Float64Array, distances: Float64Array
    ) -> BoolArray:
        """Return which segments (N,) cross an opening.

        Segments start at `origins` (N, 3), run along unit `directions` (N, 3) and end after
        `distances` (N,), which are infinite where nothing is hit.
        """
        crossed = np.zeros(len(origins), dtype=bool)
        if not len(self._blockers) or not len(origins):
            return crossed
        rows, near = self._candidates(origins, directions, distances)
        offset, way = self._corner[near] - origins[rows], directions[rows]
        normal = self._normal[near]
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = (offset * normal).sum(axis=1) / (way * normal).sum(axis=1)
        reached = np.isfinite(reach) & (reach > 0) & (reach < distances[rows] + _OFFSET)
        rows, near = rows[reached], near[reached]
        local = np.einsum(
            "ni,nij->nj", reach[reached, None] * way[reached] - offset[reached], self._axes[near]
        )
        inside = shapely.contains_xy(self._blockers[near], local[:, 0], local[:, 1])
        crossed[rows[inside]] = True
        return crossed

    def _candidates(
        self, origins: Float64Array, directions: Float64Array, distances: Float64Array
    ) -> tuple[Int64Array, Int64Array]:
        """Return pairs (M,), (M,) of segments and openings that may cross.

        Pairs that are left out do not cross. For few openings their planes tell more cheaply than
        the index.
        """
        if len(self._blockers) <= _FEW_OPENINGS:
            ahead = np.zeros((len(origins), len(self._blockers)))
            slope = np.zeros_like(ahead)
            for axis in range(3):
                normal = self._normal[:, axis]
                ahead += (self._corner[:, axis] - origins[:, axis, None]) * normal
                slope += directions[:, axis, None] * normal
            # Towards the plane, and long enough to reach it.
            with np.errstate(invalid="ignore"):
                longest = (distances[:, None] + 2 * _OFFSET) * np.abs(slope)
            meets = (ahead * slope > 0) & (np.abs(ahead) <= longest)
            segments, openings = np.nonzero(meets)
            return segments, openings
        starts = origins[:, :2]
        # Where every opening has been passed.
        past = np.linalg.norm(np.maximum(self._high - starts, starts - self._low), axis=1) + 1.0
        level = np.maximum(np.linalg.norm(directions[:, :2], axis=1), _LEAST_LEVEL)
        lengths = np.minimum(distances + _OFFSET, past / level)
        ends = starts + lengths[:, None] * directions[:, :2]
        lines = shapely.linestrings(np.stack([starts, ends], axis=1))
        rows, near = self._tree.query(lines, predicate="intersects")
        return rows, near


_Blocker = tuple[Float64Array, Float64Array, Float64Array, Polygon]


def _blocker(opening: PlanarOpening) -> _Blocker:
    """First corner (3,), unit normal (3,) and axes (3, 2) of an opening's plane, and its outline.

    The outline is a little wider than the opening, in the axes, from the corner.
    """
    corners = np.asarray(opening.polygon, dtype=np.float64)
    normal = np.asarray(opening.normal, dtype=np.float64)
    normal = normal / np.linalg.norm(normal)
    first = np.cross(normal, [0.0, 0.0, 1.0] if abs(normal[2]) < 0.9 else [1.0, 0.0, 0.0])
    first = first / np.linalg.norm(first)
    axes = np.stack([first, np.cross(normal, first)], axis=1)
    blocker = buffered(Polygon((corners - corners[0]) @ axes), _OVERLAP, join_style="mitre")
    return corners[0], normal, axes, blocker


def _plan_bounds(
    corner: Float64Array, normal: Float64Array, axes: Float64Array, blocker: Polygon
) -> Float64Array:
    """Lowest and highest x and y (4,) of an opening's outline in the world."""
    plan = corner[:2] + shapely.get_coordinates(blocker) @ axes[:2].T
    low, high = plan.min(axis=0), plan.max(axis=0)
    return np.concatenate([low - _OFFSET, high + _OFFSET])


def points_in_room(room: FoundRoom, count: int, rng: np.random.Generator) -> Float64Array:
    """Sample points (count, 3) in the lower half of a room, also below a sloping ceiling."""
    made = sample_room_points(room.floor, room.floor_z, room.ceiling_z, count, rng)
    return room.lowered(made)


def sample_room_points(
    floor: Polygon, floor_z: float, ceiling_z: float, count: int, rng: np.random.Generator
) -> Float64Array:
    """Sample points (count, 3) in the lower half of a room, a little off floor and walls.

    The lower half, because the ceiling height is that of most of the room: under a sloping roof
    the upper half may lie outdoors.
    """
    inner = buffered(floor, -0.05)
    if inner.is_empty:
        inner = floor
    west, south, east, north = inner.bounds
    accepted: list[Float64Array] = []
    for _ in range(_MAX_DRAWS):
        drawn = rng.uniform((west, south), (east, north), (4 * count, 2))
        accepted.append(drawn[shapely.contains_xy(inner, drawn[:, 0], drawn[:, 1])])
        if sum(map(len, accepted)) >= count:
            break
    else:  # a sliver that hardly any point falls into
        accepted.append(np.tile(deepest_point(inner), (count, 1)))
    plan = np.concatenate(accepted)[:count]
    low = floor_z + 0.02
    high = max(0.5 * (floor_z + ceiling_z), floor_z + 0.03)
    return np.column_stack([plan, rng.uniform(low, high, count)])


def diffuse_bounce(
    origins: Float64Array,
    directions: Float64Array,
    distances: Float64Array,
    normals: Float64Array,
    rng: np.random.Generator,
) -> tuple[Float64Array, Float64Array]:
    """Sample the next segment of walks that hit two-sided matt surfaces.

    The segments came from `origins` (N, 3) along unit `directions` (N, 3) and hit surfaces with
    unit `normals` (N, 3) after `distances` (N,). Returns the next origins and unit directions,
    (N, 3) each, cosine-distributed about the normal. A next origin lies a little before the hit
    point on the incoming segment: above the surface, and never behind another one that meets it
    in a crease.
    """
    cosine = np.sum(normals * directions, axis=-1, keepdims=True)
    facing = np.where(cosine > 0, -normals, normals)
    back = np.minimum(_OFFSET / np.maximum(np.abs(cosine[:, 0]), _MIN_COSINE), 0.5 * distances)
    outgoing = unit(facing + unit(rng.normal(size=facing.shape)))
    return origins + (distances - back)[:, None] * directions, outgoing
