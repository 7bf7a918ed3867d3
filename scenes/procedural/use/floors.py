"""Use of floors: walked ways, scuffs by chairs, dust at walls and below pieces, sun at windows."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import shapely
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.geometry.regions import simplified
from pbrnet.scenes.procedural.piece import Trace
from pbrnet.scenes.procedural.plan import Plan, PlanRoom
from pbrnet.scenes.procedural.scene_item import SceneItem
from pbrnet.scenes.procedural.use.faces import Face, Point, on_grid, rounded
from pbrnet.scenes.seeds import Draw

_CELL = 0.15  # metres, of the grid that paths are found on
_BLOCKED = 40.0  # cost of a step through furniture, relative to free floor
_WALKED_TO = ("sofa", "armchair", "bed", "desk", "toilet", "kitchen unit", "wardrobe", "bathtub")
_SOLID = 0.06  # metres; lower things are walked over


def on_floor(
    plan: Plan, room: PlanRoom, standing: Sequence[SceneItem]
) -> Callable[[Face, Draw], list[Trace]]:
    """Paths between doors, seats and beds, scuffs by chairs, dust at walls, sun at windows."""

    def traces(face: Face, rng: Draw) -> list[Trace]:
        def line(kind: str, a: Point, b: Point, radius: float, strength: float = 1.0) -> Trace:
            return Trace(
                kind,
                face.at(np.array([*a, 0.0])),
                face.at(np.array([*b, 0.0])),
                radius,
                round(strength, 2),
            )

        found = []
        for path, strength in _paths(plan, room, standing):
            width = round(rng.between(0.3, 0.42), 3)
            found += [
                line("walk", path[k], path[k + 1], width, strength) for k in range(len(path) - 1)
            ]
        for opening in plan.openings:
            if room.id not in opening.rooms:
                continue
            edge, wide = opening.edge_in(room.id), opening.width
            if opening.kind in ("door", "entrance", "archway", "patio"):
                found.append(line("walk", edge.at(0.3 * wide, 0.1), edge.at(0.7 * wide, 0.1), 0.45))
            if opening.kind in ("window", "patio"):
                found.append(line("bleach", edge.at(0.1, 0.5), edge.at(wide - 0.1, 0.5), 1.1))
        for edge in room.edges:
            found.append(line("dust", edge.at(0.0), edge.at(edge.length), 0.16, 0.9))
        for item in standing:
            low, high = on_grid(item.bounds)
            if item.category in ("chair", "stool") and low[2] < _SOLID:
                middle = (float(low[0] + high[0]) / 2, float(low[1] + high[1]) / 2)
                found.append(line("scuff", middle, middle, 0.45, rng.between(0.5, 1)))
            elif low[2] > 0.08 and low[2] < 0.5 and (high - low)[:2].min() > 0.3:
                # Nobody sweeps below a low piece.
                half = 0.5 * float((high - low)[:2].min())
                axis = int(np.argmax((high - low)[:2]))
                ends = [(low + high)[:2] / 2, (low + high)[:2] / 2]
                ends[0][axis], ends[1][axis] = low[axis] + half, high[axis] - half
                a, b = (rounded(end) for end in ends)
                found.append(line("dust", a, b, half, 0.8))
        for _ in range(rng.whole(0, 4)):
            x, y = rng.random(2)
            place = face.inside(float(x), float(y))
            found.append(Trace("spill", place, place, round(rng.between(0.04, 0.15), 3)))
        return found

    return traces


def _paths(
    plan: Plan, room: PlanRoom, standing: Sequence[SceneItem]
) -> list[tuple[list[Point], float]]:
    """Walked paths in a room, each as its corners and strength."""
    x0, y0, x1, y1 = room.shape.bounds
    columns, rows = (max(2, math.ceil((b - a) / _CELL)) for a, b in ((x0, x1), (y0, y1)))
    xs = x0 + (np.arange(columns) + 0.5) * (x1 - x0) / columns
    ys = y0 + (np.arange(rows) + 0.5) * (y1 - y0) / rows
    x, y = np.meshgrid(xs, ys)
    inside = shapely.contains_xy(room.shape, x, y)
    solid = np.zeros_like(inside)
    for item in standing:
        low, high = on_grid(item.bounds)
        if low[2] < 1.2 and high[2] > _SOLID:
            solid |= (x > low[0]) & (x < high[0]) & (y > low[1]) & (y < high[1])
    near = ndimage.binary_dilation(solid) | ~ndimage.binary_erosion(inside)
    cost = np.where(solid | ~inside, _BLOCKED, np.where(near, 3.0, 1.0))
    links = _links(cost)

    def cell(point: Point) -> int:
        column = min(columns - 1, max(0, int((point[0] - x0) / (x1 - x0) * columns)))
        row = min(rows - 1, max(0, int((point[1] - y0) / (y1 - y0) * rows)))
        return row * columns + column

    doors = [
        cell(opening.edge_in(room.id).at(opening.width / 2, 0.3))
        for opening in plan.openings
        if room.id in opening.rooms and opening.kind != "window"
    ]
    if not doors:
        return []
    seats: list[int] = []
    for item in standing:
        if item.category in _WALKED_TO and len(seats) < 8:
            low, high = on_grid(item.bounds)
            seats.append(cell((float(low[0] + high[0]) / 2, float(low[1] + high[1]) / 2)))
    distance, before = dijkstra(links, indices=doors, return_predecessors=True)
    found = []
    for number in range(len(doors)):
        goals = [(goal, 1.0) for goal in doors[number + 1 :]]
        goals += [(goal, 0.7) for goal in seats if int(np.argmin(distance[:, goal])) == number]
        for goal, strength in goals:
            steps = [goal]
            while steps[-1] != doors[number] and before[number, steps[-1]] >= 0:
                steps.append(int(before[number, steps[-1]]))
            # The way ends in front of the furniture.
            steps = [k for k in steps if not solid.flat[k]]
            if len(steps) > 1:
                line = shapely.LineString([(x.flat[k], y.flat[k]) for k in steps])
                corners = shapely.get_coordinates(simplified(line, 0.5 * _CELL))
                found.append(([rounded(corner) for corner in corners], strength))
    return found


def _links(cost: Float64Array) -> coo_array:
    """Steps between neighbouring cells of a grid, with their costs."""
    rows, columns = cost.shape
    index = np.arange(rows * columns).reshape(rows, columns)
    first, second, price = [], [], []
    for down, right, length in ((0, 1, 1.0), (1, 0, 1.0), (1, 1, 1.4143), (1, -1, 1.4144)):
        a = (slice(0, rows - down), slice(max(0, -right), columns - max(0, right)))
        b = (slice(down, rows), slice(max(0, right), columns - max(0, -right)))
        first += [index[a].ravel(), index[b].ravel()]
        second += [index[b].ravel(), index[a].ravel()]
        price += [(length * (cost[a] + cost[b])).ravel()] * 2
    places = (np.concatenate(first), np.concatenate(second))
    return coo_array((np.concatenate(price), places), shape=(index.size, index.size)).tocsr()
