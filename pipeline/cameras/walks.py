"""Walks: smooth camera trajectories over the free floor, from one room to the next.

A walk leads from a random place to further random places, in rooms not yet visited first, by
shortest ways that keep off obstacles, and rather onward than back. The way is smoothed, and the
camera looks along it, a little ahead. It is walked as fast as the bounds of step and turn allow,
then place and heading are smoothed over time, which keeps the bounds: the mean of steps is no
longer than the longest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.ndimage
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from pbrnet.pipeline.cameras.free_floor import BODY, FreeFloor
from pbrnet.scenes.arrays import Float64Array, Int32Array

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
    chords = np.concatenate([way[ahead:], np.repeat(way[-1:], ahead, axis=0)]) - way
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
