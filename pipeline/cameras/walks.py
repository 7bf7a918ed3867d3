"""Walks: smooth camera trajectories over the free floor, from one room to the next.

A walk leads from a random place to further random places, in rooms not yet visited first, by
shortest ways that keep off obstacles, and rather onward than back. The way is smoothed, and the
camera looks along it, a little ahead. It is walked as fast as the bounds of step and turn allow,
then place and heading are smoothed over time, which keeps the bounds: the mean of steps is no
longer than the longest.

The free floor is made of the cells of a grid where a person can stand: a ray down from the eye
meets the floor, nothing hangs at the eye's height, and short horizontal rays at three heights find
nothing between a cell and its neighbours. Cells lie in rooms, or in the wall between two of them:
so open doors join rooms, and shut ones do not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.ndimage
import shapely
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from shapely.geometry import Polygon

from pbrnet.pipeline.render.scene import RenderScene, cast
from pbrnet.scenes.arrays import BoolArray, Float64Array, Int32Array
from pbrnet.scenes.contract import Room

_SAMPLE = 0.02  # metres between points of a way
_SMOOTHING = (0.3, 0.15, 0.08, 0.0)  # metres, standard deviation; the first that stays clear
_MARGIN = 0.05  # metres that smoothing may come nearer to obstacles than a person's half width
_AHEAD = 0.8  # metres along the way to the place that the camera looks at
_CALM = 4.0  # frames, standard deviation of the smoothing over time
_ROOMY = 0.6  # metres of clearance of the places that a walk leads to, where there is as much
_FAR = 1.5  # metres, least distance of the next place, where there is one
_LEGS = 60
_GOALS = 6  # next places of which the one that needs the least turn is taken
_GRID = 6  # decimals of metres and radians: the same bits on every processor
_CELL = 0.05  # metres
_MOST_CELLS = 200_000  # of a storey; larger storeys have larger cells
_STEP = 0.12  # metres between floors that a person walks over: carpets, thresholds
_WALL = 0.25  # metres: half of the thickest wall that a door leads through
_HEIGHTS = (0.3, 0.9)  # metres above the floor of the horizontal rays, beside the eye's height
BODY = 0.2  # metres: half of a person's width


@dataclass(frozen=True)
class Walk:
    """Place (F, 2), metres, and heading (F,), radians from +X towards +Y, of each frame."""

    floor: FreeFloor
    places: Float64Array
    headings: Float64Array


def find_walk(
    floor: FreeFloor,
    steps: csr_array,
    frames: int,
    step: float,
    turn: float,
    rng: np.random.Generator,
) -> Walk | None:
    """Return a walk over a storey, or None if there is nowhere to go.

    `steps` is `floor.steps()`; `step` (metres) and `turn` (radians) are the most per frame.
    """
    way = _way(floor, steps, 1.3 * step * (frames + 8 * _CALM) + _AHEAD, rng)
    if way is None:
        return None
    for spread in _SMOOTHING:
        places, headings = _walked(_smoothed(way, spread), frames, step, turn)
        if len(places) < frames:
            return None
        if floor.clearance_at(places).min() >= BODY - _MARGIN:
            return Walk(floor, places, headings)
    return None


def _way(
    floor: FreeFloor, steps: csr_array, length: float, rng: np.random.Generator
) -> Float64Array | None:
    """Return the points (N, 2) of a way of at least `length` metres, or None."""
    walkable = floor.walkable.ravel()
    clearance, rooms = floor.clearance.ravel(), floor.room.ravel()
    starts = np.flatnonzero(walkable & (rooms >= 0))
    if not len(starts):
        return None
    here = int(_roomy(starts, clearance, rng))
    visited = {int(rooms[here])}
    way = [here]
    for _ in range(_LEGS):
        cost, before = dijkstra(steps, indices=here, return_predecessors=True)
        reached = np.flatnonzero(np.isfinite(cost) & (rooms >= 0))
        away = floor.places(reached) - floor.places(np.array([here]))
        far = reached[(away**2).sum(axis=1) >= _FAR**2]
        if not len(far):
            far = reached[reached != here]
        if not len(far):
            return None
        fresh = sorted(set(rooms[far].tolist()) - visited)
        if fresh:
            far = far[rooms[far] == fresh[int(rng.integers(len(fresh)))]]
        legs = [_leg(before, here, int(_roomy(far, clearance, rng))) for _ in range(_GOALS)]
        leg = max(legs, key=lambda leg: _straightness(floor, way, leg))
        goal = leg[-1]
        visited = visited | {int(rooms[goal])} if fresh else {int(rooms[goal])}
        way += leg
        here = goal
        points = floor.places(np.array(way))
        travelled = float(np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1)).sum())
        if travelled >= length:
            return points
    return None


def _leg(before: Int32Array, here: int, goal: int) -> list[int]:
    """Return the cells of the shortest way from `here`, without that one, to `goal`."""
    leg = [goal]
    while leg[-1] != here:
        leg.append(int(before[leg[-1]]))
    return leg[-2::-1]


def _straightness(floor: FreeFloor, way: list[int], leg: list[int]) -> float:
    """Return the cosine of the turn from a way into its next leg; 1 for the first leg."""
    reach = round(_AHEAD / floor.cell)
    cells = [way[max(0, len(way) - 1 - reach)], way[-1], leg[min(reach, len(leg)) - 1]]
    one, other = np.diff(floor.places(np.array(cells)), axis=0)
    lengths = np.sqrt((one**2).sum() * (other**2).sum())
    return float((one * other).sum() / lengths) if lengths else 1.0


def _roomy(cells: np.ndarray, clearance: Float64Array, rng: np.random.Generator) -> int:
    """Return one of these cells at random, of those with much clearance."""
    enough = min(_ROOMY, 0.8 * float(clearance[cells].max()))
    good = cells[clearance[cells] >= enough]
    return int(good[int(rng.integers(len(good)))])


def _smoothed(way: Float64Array, spread: float) -> Float64Array:
    """Return a way in points `_SAMPLE` apart, smoothed along its length by `spread` metres."""
    for deviation in (0.0, spread):
        if deviation:
            way = scipy.ndimage.gaussian_filter1d(way, deviation / _SAMPLE, axis=0, mode="nearest")
        along = np.concatenate([[0.0], np.cumsum(np.sqrt((np.diff(way, axis=0) ** 2).sum(axis=1)))])
        even = np.arange(0.0, along[-1], _SAMPLE)
        way = np.stack([np.interp(even, along, way[:, axis]) for axis in (0, 1)], axis=1)
    return way


def _walked(
    way: Float64Array, frames: int, step: float, turn: float
) -> tuple[Float64Array, Float64Array]:
    """Return place (F, 2) and heading (F,) of each frame of a walk along a way, smoothed."""
    ahead = round(_AHEAD / _SAMPLE)
    chords = way[np.minimum(np.arange(len(way)) + ahead, len(way) - 1)] - way
    headings = np.array([math.atan2(y, x) for x, y in chords.tolist()])
    # Where the way turns back, the place ahead is too near to look at: the last heading stays.
    seen = np.flatnonzero((chords**2).sum(axis=1) > (0.25 * _AHEAD) ** 2)
    if not len(seen):
        return np.zeros((0, 2)), np.zeros(0)
    latest = seen[np.maximum(np.searchsorted(seen, np.arange(len(way)), side="right") - 1, 0)]
    headings = np.unwrap(headings[latest])
    metres = np.sqrt((np.diff(way, axis=0) ** 2).sum(axis=1))
    spent = np.maximum(metres / step, np.abs(np.diff(headings)) / turn)
    time = np.concatenate([[0.0], np.cumsum(spent)])
    margin = math.ceil(4 * _CALM)
    moments = np.arange(frames + 2 * margin, dtype=np.float64)
    if time[-1] < moments[-1]:
        return np.zeros((0, 2)), np.zeros(0)
    columns = (way[:, 0], way[:, 1], headings)
    walked = np.stack([np.interp(moments, time, values) for values in columns], axis=1)
    calm = scipy.ndimage.gaussian_filter1d(walked, _CALM, axis=0, mode="nearest")
    calm = np.round(calm[margin : margin + frames], _GRID)
    return calm[:, :2], calm[:, 2]


@dataclass(frozen=True)
class FreeFloor:
    """Cells of a storey; arrays are (columns along x, rows along y).

    `clearance` is the distance in metres from a cell's centre to the nearest cell that is not
    free, `room` the index in `rooms` of the room that it lies in, -1: in a wall.
    """

    rooms: tuple[Room, ...]
    corner: tuple[float, float]  # least x and y, metres
    cell: float  # metres
    floor_z: float
    clearance: Float64Array
    room: Int32Array

    @property
    def walkable(self) -> BoolArray:
        """Cells in which a person fits."""
        result: BoolArray = self.clearance >= BODY
        return result

    def places(self, cells: npt.NDArray[np.intp]) -> Float64Array:
        """Return the centres (N, 2), metres, of cells given as flat indices (N,)."""
        columns, rows = np.divmod(cells, self.clearance.shape[1])
        return np.array(self.corner) + (np.stack([columns, rows], axis=1) + 0.5) * self.cell

    def clearance_at(self, places: Float64Array) -> Float64Array:
        """Return the clearance in metres at places (N, 2), of the cell that each lies in."""
        cells = np.floor((places - np.array(self.corner)) / self.cell).astype(int)
        cells = np.clip(cells, 0, np.array(self.clearance.shape) - 1)
        return self.clearance[cells[:, 0], cells[:, 1]]

    def steps(self) -> csr_array:
        """Return the graph of steps between walkable cells, (cells, cells); weights are costs.

        A cost is the step's length, increased near obstacles: ways keep to the middle.
        """
        walkable, shape = self.walkable, self.clearance.shape
        number = np.arange(walkable.size).reshape(shape)
        price = 1 + (2 * BODY / np.maximum(self.clearance, BODY)) ** 2
        starts, ends, costs = [], [], []
        for dx, dy in ((1, 0), (0, 1), (1, 1), (1, -1)):
            low, high = max(0, -dy), shape[1] - max(0, dy)
            one = (slice(0, shape[0] - dx), slice(low, high))
            two = (slice(dx, shape[0]), slice(low + dy, high + dy))
            open_ = walkable[one] & walkable[two]
            if dx and dy:  # not around a corner
                open_ &= walkable[two[0], one[1]] & walkable[one[0], two[1]]
            starts.append(number[one][open_])
            ends.append(number[two][open_])
            length = self.cell * (2**0.5 if dx and dy else 1.0)
            costs.append(length * 0.5 * (price[one] + price[two])[open_])
        start, end, cost = (np.concatenate(parts) for parts in (starts, ends, costs))
        both = np.concatenate([start, end]), np.concatenate([end, start])
        return csr_array((np.tile(cost, 2), both), shape=(walkable.size, walkable.size))


def free_floors(
    render_scene: RenderScene, rooms: Sequence[Room], eye_height: float
) -> list[FreeFloor]:
    """Return the free floor of each storey of `rooms`, from below; `eye_height` is in metres."""
    storeys: list[list[Room]] = []
    for room in sorted(rooms, key=lambda room: (room.floor_z, room.id)):
        if storeys and room.floor_z - storeys[-1][0].floor_z <= _STEP:
            storeys[-1].append(room)
        else:
            storeys.append([room])
    return [_free_floor(render_scene, tuple(storey), eye_height) for storey in storeys]


def _free_floor(render_scene: RenderScene, rooms: tuple[Room, ...], eye_height: float) -> FreeFloor:
    polygons = [shapely.make_valid(Polygon(room.floor)) for room in rooms]
    low_x, low_y, high_x, high_y = shapely.union_all([p.envelope for p in polygons]).bounds
    area = (high_x - low_x) * (high_y - low_y)
    cell = max(_CELL, (area / _MOST_CELLS) ** 0.5)
    corner = (low_x - cell, low_y - cell)
    across, along = int((high_x - low_x) / cell) + 3, int((high_y - low_y) / cell) + 3
    x = corner[0] + (np.arange(across) + 0.5)[:, None] * cell + np.zeros((1, along))
    y = corner[1] + (np.arange(along) + 0.5)[None, :] * cell + np.zeros((across, 1))
    room = np.full(x.shape, -1, dtype=np.int32)
    near = np.zeros(x.shape, dtype=np.int32)
    for index, polygon in enumerate(polygons):
        room[shapely.contains_xy(polygon, x, y)] = index
        near += shapely.contains_xy(polygon.buffer(_WALL), x, y)
    floor_z = rooms[0].floor_z
    free = (room >= 0) | (near >= 2)
    points = np.stack([x, y, np.full(x.shape, floor_z + eye_height)], axis=-1)
    inside = free.copy()
    ground = _first(render_scene, points[inside], (0.0, 0.0, -1.0))
    free[inside] &= np.abs(ground - eye_height) <= _STEP
    free[inside] &= _first(render_scene, points[inside], (0.0, 0.0, 1.0)) > _STEP
    for height in (*_HEIGHTS, eye_height):
        points[..., 2] = floor_z + height
        for axis in (0, 1):
            first = np.delete(np.ones(x.shape, dtype=bool), -1, axis=axis)
            pair = inside.take(range(x.shape[axis] - 1), axis) & inside.take(
                range(1, x.shape[axis]), axis
            )
            starts = points.take(range(x.shape[axis] - 1), axis)[pair]
            towards = (1.0, 0.0, 0.0) if axis == 0 else (0.0, 1.0, 0.0)
            first[pair] = _first(render_scene, starts, towards) > cell
            open_ = np.ones(x.shape, dtype=bool)
            lower = tuple(slice(0, -1) if k == axis else slice(None) for k in (0, 1))
            upper = tuple(slice(1, None) if k == axis else slice(None) for k in (0, 1))
            open_[lower] &= first
            open_[upper] &= first
            free &= open_
    clearance = scipy.ndimage.distance_transform_edt(np.pad(free, 1))[1:-1, 1:-1] * cell
    return FreeFloor(rooms, corner, cell, floor_z, clearance, room)


def _first(
    render_scene: RenderScene, origins: Float64Array, towards: tuple[float, float, float]
) -> Float64Array:
    """Return the distance (N,) of the first surface from each origin (N, 3) along a direction."""
    if not len(origins):
        return np.zeros(0)
    directions = np.broadcast_to(np.array(towards), origins.shape)
    return cast(render_scene, origins, directions)[0].astype(np.float64)
