"""Use of a home by place: walked paths, seats, hands at doors, table tops, hob and sink, windows.

Surfaces that show it get materials of their own (`Material.use`). Nothing is added to the geometry:
faces are dealt out to other parts, and walls are cut round the places that were touched.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, dijkstra

from scenes.arrays import BoolArray, Float64Array, Int64Array
from scenes.geometry.regions import simplified
from scenes.procedural.piece import Material, PiecePart, Trace, Use
from scenes.procedural.plan import Plan, PlanRoom
from scenes.procedural.scene_item import SceneItem
from scenes.procedural.structure import GABLE
from scenes.seeds import generator

_CELL = 0.15  # metres, of the grid that paths are found on
_BLOCKED = 40.0  # cost of a step through furniture, relative to free floor
_WALKED_TO = ("sofa", "armchair", "bed", "desk", "toilet", "kitchen unit", "wardrobe", "bathtub")
_SOLID = 0.06  # metres; lower things are walked over
_GRID = 4  # decimals of metres: the last bits of coordinates depend on the processor
_ASIDE = 1.3e-6  # metres; keeps multiples of half a step of that grid off its borders

Point = tuple[float, float]
Draw = np.random.Generator


@dataclass(frozen=True)
class _Face:
    """Parallel faces of a part that one set of images covers.

    (s, t) = `axes` @ point + `start`; `panels` as in `Use`.
    """

    axes: Float64Array  # (2, 3)
    start: Float64Array  # (2,)
    faces: Int64Array
    st: Float64Array  # (V, 2) of all vertices of the part; of others than the faces' unused
    low: Point
    high: Point
    panels: tuple[tuple[float, float, float, float, float, float], ...]

    def at(self, point: Float64Array) -> Point:
        """(s, t) of a point in the world."""
        place = (self.axes * point).sum(axis=1) + self.start
        return _rounded(place)

    @property
    def size(self) -> Point:
        """Metres along s and t."""
        return self.high[0] - self.low[0], self.high[1] - self.low[1]

    def inside(self, s: float, t: float) -> Point:
        """(s, t) of a place in shares of the extent."""
        return _rounded(np.array(self.low) + np.array([s, t]) * self.size)


def leave_traces(items: Iterable[SceneItem], plan: Plan, seed: int) -> list[SceneItem]:
    """Return the items with traces of use on the surfaces that hands and feet reach."""
    items = list(items)
    rooms = {room.id: room for room in plan.rooms}
    used = []
    for item in items:
        rng = generator(seed, "use", item.id)
        if item.category == "floor" and item.room in rooms:
            room = rooms[item.room]
            standing = [each for each in items if each.room == item.room and not each.is_structure]
            item = _whole(item, _on_floor(plan, room, standing), rng)
        elif item.category == "wall" and item.room in rooms:
            beside = [each for each in items if each.room == item.room and not each.is_structure]
            item = _walls(item, beside, rng)
        elif item.category == "door":
            levers = [part.vertices.mean(axis=0) for part in item.parts if part.name == "lever"]
            if levers:
                item = _leaf(item, levers[0], rng)
        elif item.name in _TOPS:
            name, marks = _TOPS[item.name]
            item = _split(item, name, np.array([0.0, 0.0, 1.0]), marks, rng)
        elif item.category in ("sofa", "armchair"):
            item = _seats(item, rng)
        used.append(item)
    return used


# Floors


def _on_floor(
    plan: Plan, room: PlanRoom, standing: Sequence[SceneItem]
) -> Callable[[_Face, Draw], list[Trace]]:
    """Paths between doors, seats and beds, scuffs by chairs, dust at walls, sun at windows."""

    def traces(face: _Face, rng: Draw) -> list[Trace]:
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
            width = round(float(rng.uniform(0.3, 0.42)), 3)
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
            low, high = _on_grid(item.bounds)
            if item.category in ("chair", "stool") and low[2] < _SOLID:
                middle = (float(low[0] + high[0]) / 2, float(low[1] + high[1]) / 2)
                found.append(line("scuff", middle, middle, 0.45, float(rng.uniform(0.5, 1))))
            elif low[2] > 0.08 and low[2] < 0.5 and (high - low)[:2].min() > 0.3:
                # Nobody sweeps below a low piece.
                half = 0.5 * float((high - low)[:2].min())
                axis = int(np.argmax((high - low)[:2]))
                ends = [(low + high)[:2] / 2, (low + high)[:2] / 2]
                ends[0][axis], ends[1][axis] = low[axis] + half, high[axis] - half
                a, b = (_rounded(end) for end in ends)
                found.append(line("dust", a, b, half, 0.8))
        for _ in range(int(rng.integers(0, 4))):
            x, y = rng.random(2)
            place = face.inside(float(x), float(y))
            found.append(Trace("spill", place, place, round(float(rng.uniform(0.04, 0.15)), 3)))
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
        low, high = _on_grid(item.bounds)
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
            low, high = _on_grid(item.bounds)
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
                found.append(([_rounded(corner) for corner in corners], strength))
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


# Furniture and doors


def _on_table(face: _Face, rng: Draw) -> list[Trace]:
    """Hands along the edges, rings of glasses, a spill, scratches in the middle."""
    wide = face.size[0] > face.size[1]
    found = []
    for side in (0.13, 0.87):
        ends = ((0.15, side), (0.85, side)) if wide else ((side, 0.15), (side, 0.85))
        a, b = (face.inside(*end) for end in ends)
        found.append(Trace("touch", a, b, 0.16, round(float(rng.uniform(0.4, 0.9)), 2)))
    middle = face.inside(0.5, 0.5)
    found.append(Trace("scuff", middle, middle, round(0.5 * min(face.size), 3), 0.7))
    return found + _rings(face, rng, 2, 7) + _spots(face, rng, "spill", 0, 3, (0.03, 0.09))


def _on_low_table(face: _Face, rng: Draw) -> list[Trace]:
    middle = face.inside(0.5, 0.5)
    touched = Trace("touch", middle, middle, round(0.5 * min(face.size), 3), 0.5)
    return [touched, *_rings(face, rng, 1, 5), *_spots(face, rng, "spill", 0, 2, (0.02, 0.06))]


def _on_desk(face: _Face, rng: Draw) -> list[Trace]:
    a, b = face.inside(0.35, 0.5), face.inside(0.65, 0.5)
    found = [Trace("touch", a, b, 0.25, 0.8), Trace("scuff", a, b, 0.22, 0.5)]
    return found + _rings(face, rng, 0, 3)


def _by_sink(face: _Face, rng: Draw) -> list[Trace]:
    a, b = face.inside(0.2, 0.5), face.inside(0.8, 0.5)
    return [Trace("scale", a, b, 0.3, 0.8), *_spots(face, rng, "spill", 1, 3, (0.03, 0.07))]


def _by_hob(face: _Face, rng: Draw) -> list[Trace]:
    a, b = face.inside(0.1, 0.5), face.inside(0.9, 0.5)
    return [Trace("touch", a, b, 0.35, 0.9), *_spots(face, rng, "spill", 3, 7, (0.015, 0.05))]


def _on_worktop(face: _Face, rng: Draw) -> list[Trace]:
    middle = face.inside(0.5, 0.45)
    cut = Trace("scuff", middle, middle, 0.26, round(float(rng.uniform(0.4, 1.0)), 2))
    return [cut, *_rings(face, rng, 0, 3), *_spots(face, rng, "spill", 0, 3, (0.02, 0.06))]


def _on_rug(face: _Face, rng: Draw) -> list[Trace]:
    a, b = face.inside(0.2, 0.4), face.inside(0.8, 0.6)
    walked = Trace("walk", a, b, round(0.45 * min(face.size), 3), 0.9)
    return [walked, *_spots(face, rng, "spill", 0, 3, (0.04, 0.12))]


# Name of an item -> name of its part, and the traces on top of it.
_TOPS: dict[str, tuple[str, Callable[[_Face, Draw], list[Trace]]]] = {
    "dining table": ("top", _on_table),
    "coffee table": ("top", _on_low_table),
    "side table": ("top", _on_low_table),
    "console table": ("top", _on_low_table),
    "desk": ("top", _on_desk),
    "sink unit": ("worktop", _by_sink),
    "hob and oven": ("worktop", _by_hob),
    "drawer unit": ("worktop", _on_worktop),
    "base cupboard": ("worktop", _on_worktop),
    "rug": ("", _on_rug),
}


def _rings(face: _Face, rng: Draw, low: int, high: int) -> list[Trace]:
    found = []
    for _ in range(int(rng.integers(low, high))):
        place = face.inside(*rng.uniform(0.08, 0.92, 2).tolist())
        radius = round(float(rng.uniform(0.03, 0.045)), 3)
        found.append(Trace("ring", place, place, radius, round(float(rng.uniform(0.3, 1)), 2)))
    return found


def _spots(
    face: _Face, rng: Draw, kind: str, low: int, high: int, radius: tuple[float, float]
) -> list[Trace]:
    found = []
    for _ in range(int(rng.integers(low, high))):
        place = face.inside(*rng.uniform(0.05, 0.95, 2).tolist())
        found.append(Trace(kind, place, place, round(float(rng.uniform(*radius)), 3)))
    return found


def _leaf(item: SceneItem, lever: Float64Array, rng: Draw) -> SceneItem:
    """Hands round the handles of a door, feet at its lower edge."""

    def traces(face: _Face, rng: Draw) -> list[Trace]:
        below, above = (face.at(lever + np.array([0, 0, dz])) for dz in (-0.1, 0.16))
        floor = face.at(np.zeros(3))
        found = [
            Trace("touch", below, above, 0.14, 1.0),
            Trace("touch", face.at(lever), face.at(lever), 0.3, 0.45),
        ]
        across = 0 if abs(face.axes[1, 2]) > 0.5 else 1  # the axis that is level
        ends = [list(face.low), list(face.high)]
        ends[0][1 - across] = ends[1][1 - across] = floor[1 - across] + 0.05
        foot = [(float(end[0]), float(end[1])) for end in ends]
        found.append(Trace("scuff", foot[0], foot[1], 0.16, round(float(rng.uniform(0.4, 1)), 2)))
        found.append(Trace("dust", foot[0], foot[1], 0.05, 0.6))
        return found

    part = next((part for part in item.parts if part.name == "leaf"), None)
    if part is None:
        return item
    corners = part.vertices[part.faces]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    out = facing[int(np.argmax((facing * facing).sum(axis=1)))]
    out = out / math.sqrt(float((out * out).sum()))
    return _split(_split(item, "leaf", out, traces, rng), "leaf", -out, traces, rng)


def _seats(item: SceneItem, rng: Draw) -> SceneItem:
    """Seats that were sat on."""

    def traces(face: _Face, rng: Draw) -> list[Trace]:
        found = []
        for s0, t0, s1, t1, _, _ in face.panels:
            if min(s1 - s0, t1 - t0) > 0.3:
                middle = ((s0 + s1) / 2, (t0 + t1) / 2)
                radius = round(0.5 * min(s1 - s0, t1 - t0), 3)
                found.append(
                    Trace("seat", middle, middle, radius, round(float(rng.uniform(0.6, 1)), 2))
                )
        return found

    names = [part.name for part in item.parts if _kind(part) in ("fabric", "leather")]
    return _split(item, names[0], np.array([0.0, 0.0, 1.0]), traces, rng) if names else item


def _kind(part: PiecePart) -> str:
    return part.material.kind


# Walls


def _walls(item: SceneItem, beside: Sequence[SceneItem], rng: Draw) -> SceneItem:
    """Walls with the places where hands, backs and warm air reach them."""
    done: list[tuple[Float64Array, Float64Array]] = []
    for other in beside:
        touched = _TOUCHED.get(other.name if other.category == "switch" else other.category)
        if touched is None:
            continue
        low, high = _on_grid(other.bounds)
        for inward in _LEVEL:
            axis = int(np.argmax(np.abs(inward)))
            gap = _wall_behind(item, low, high, inward)
            if gap is None:
                continue
            place = 0.5 * (low + high)
            place[axis] = gap
            rise, reach, _ = touched
            place[2] = low[2] + rise * (high[2] - low[2])
            half = 0.5 * (high - low)
            half[axis] = 0.0
            half[2] = 0.0
            ends = (place - half, place + half)
            margin = np.full(3, reach + 0.04)
            margin[axis] = 0.001
            box = (ends[0] - margin, ends[1] + margin)
            if any((box[0] < b[1]).all() and (box[1] > b[0]).all() for b in done):
                break
            done.append(box)
            item = _patched(item, box, inward, _rubbed(touched, ends, rng), rng)
            break
    return item


_LEVEL = tuple(np.array(d) for d in ((1.0, 0, 0), (-1.0, 0, 0), (0, 1.0, 0), (0, -1.0, 0)))
# Category of what stands or hangs at a wall (of switches the name: sockets are left alone) ->
# height of the traces in shares of its own, their radius, their kinds and strengths.
_TOUCHED: dict[str, tuple[float, float, tuple[tuple[str, float], ...]]] = {
    "switch": (0.5, 0.16, (("touch", 1.0),)),
    "sofa": (0.95, 0.14, (("touch", 0.7), ("scuff", 0.4))),
    "armchair": (0.95, 0.12, (("touch", 0.6), ("scuff", 0.4))),
    "bed": (1.0, 0.16, (("touch", 0.8),)),
    "radiator": (1.08, 0.3, (("soot", 0.9),)),
    "coat hooks": (0.3, 0.25, (("touch", 0.6), ("scuff", 0.7))),
}
_BEHIND = 0.14  # metres between a thing and the wall that it soils


def _rubbed(
    touched: tuple[float, float, tuple[tuple[str, float], ...]],
    ends: tuple[Float64Array, Float64Array],
    rng: Draw,
) -> Callable[[_Face, Draw], list[Trace]]:
    _, reach, kinds = touched
    share = float(rng.uniform(0.5, 1.0))

    def traces(face: _Face, rng: Draw) -> list[Trace]:
        a, b = face.at(ends[0]), face.at(ends[1])
        return [Trace(kind, a, b, reach, round(share * each, 2)) for kind, each in kinds]

    return traces


def _wall_behind(
    item: SceneItem, low: Float64Array, high: Float64Array, inward: Float64Array
) -> float | None:
    """The wall that a box stands at with its back: its place along its normal, metres."""
    axis = int(np.argmax(np.abs(inward)))
    others = [other for other in range(3) if other != axis]
    back = low[axis] if inward[axis] > 0 else high[axis]
    middle = 0.5 * (low + high)
    for part in item.parts:
        corners = part.vertices[part.faces]
        facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        towards = (facing * inward).sum(axis=1)
        plane = corners[:, 0, axis]
        near = (back - plane) * inward[axis]
        holds = (towards > 1e-9) & (near > -0.03) & (near < _BEHIND)
        for other in others:
            holds &= corners[:, :, other].min(axis=1) < middle[other] + 1e-9
            holds &= corners[:, :, other].max(axis=1) > middle[other] - 1e-9
        if holds.any():
            return float(plane[int(np.argmax(holds))])
    return None


def _patched(
    item: SceneItem,
    box: tuple[Float64Array, Float64Array],
    inward: Float64Array,
    traces: Callable[[_Face, Draw], list[Trace]],
    rng: Draw,
) -> SceneItem:
    """Cut the faces of walls that lie in a box out, and give them traces of use."""
    parts: list[PiecePart] = []
    for part in item.parts:
        material = part.material
        gable = part.name.startswith(GABLE)
        if gable or not isinstance(material, Material) or material.use is not None:
            parts.append(part)
            continue
        cut = _cut(part, box, inward)
        middle = cut.vertices[cut.faces].mean(axis=1)
        inside = ((middle > box[0]) & (middle < box[1])).all(axis=1)
        patch = _of_faces(cut, inside) if inside.any() else None
        face = None if patch is None else _face_of(patch, inward)
        if patch is None or face is None:
            parts.append(part)
            continue
        rest = np.ones(len(patch.faces), dtype=bool)
        rest[face.faces] = False
        left = ~inside
        left[np.flatnonzero(inside)[rest]] = True
        if left.any():
            parts.append(_of_faces(cut, left))
        used = _of_faces(replace(patch, uvs=face.st), ~rest)
        parts.append(replace(used, material=_used(material, face, traces, rng)))
    return replace(item, parts=tuple(parts))


def _cut(
    part: PiecePart, box: tuple[Float64Array, Float64Array], inward: Float64Array
) -> PiecePart:
    """Cut the rectangles of a wall's plane along the lines through the sides of a box.

    Lines go through the whole wall, so that faces keep sharing all of their corners.
    """
    axis = int(np.argmax(np.abs(inward)))
    across = 1 - axis
    quads = part.faces.reshape(-1, 2, 3)
    order = np.stack([quads[:, 0, 0], quads[:, 0, 1], quads[:, 0, 2], quads[:, 1, 2]], axis=1)
    places, uvs = part.vertices[order], part.uvs[order]
    for along, level in ((across, 0), (across, 1), (2, 0), (2, 1)):
        at = box[level][along]
        low, high = places[..., along].min(axis=1), places[..., along].max(axis=1)
        level_in = (places[..., axis] > box[0][axis]) & (places[..., axis] < box[1][axis])
        crossed = level_in.all(axis=1) & (low < at - 1e-4) & (high > at + 1e-4)
        if not crossed.any():
            continue
        share = (at - low[crossed]) / (high - low)[crossed]
        halves = []
        for values in (places, uvs):
            own = values[crossed]
            lower = own.copy()
            upper = own.copy()
            line = places[crossed][..., along]
            for k in range(4):
                for other in (k - 1, (k + 1) % 4):
                    rises = line[:, other] > line[:, k] + 1e-6
                    falls = line[:, other] < line[:, k] - 1e-6
                    mixed = own[:, k] + share[:, None] * (own[:, other] - own[:, k])
                    upper[rises, k] = mixed[rises]
                    mixed = own[:, other] + share[:, None] * (own[:, k] - own[:, other])
                    lower[falls, k] = mixed[falls]
            if values is places:
                upper[..., along] = np.maximum(upper[..., along], at)
                lower[..., along] = np.minimum(lower[..., along], at)
            halves.append(np.concatenate([values[~crossed], lower, upper]))
        places, uvs = halves
    corners = np.array([[0, 1, 2], [0, 2, 3]])
    faces = (4 * np.arange(len(places))[:, None, None] + corners).reshape(-1, 3)
    return replace(part, vertices=places.reshape(-1, 3), faces=faces, uvs=uvs.reshape(-1, 2))


# Faces


def _whole(item: SceneItem, traces: Callable[[_Face, Draw], list[Trace]], rng: Draw) -> SceneItem:
    """Give the whole first part of an item a material with traces on its upper face."""
    part = item.parts[0]
    face = _face_of(part, np.array([0.0, 0.0, 1.0]))
    if face is None or not isinstance(part.material, Material):
        return item
    made = replace(part, material=_used(part.material, face, traces, rng), uvs=face.st)
    return replace(item, parts=(made, *item.parts[1:]))


def _split(
    item: SceneItem,
    name: str,
    towards: Float64Array,
    traces: Callable[[_Face, Draw], list[Trace]],
    rng: Draw,
) -> SceneItem:
    """Deal the faces of a part that look in a direction out to a part with traces of use."""
    parts = list(item.parts)
    for number, part in enumerate(parts):
        if (name and part.name != name) or not isinstance(part.material, Material):
            continue
        face = _face_of(part, towards)
        if face is None or part.lumens > 0:
            return item
        rest = np.ones(len(part.faces), dtype=bool)
        rest[face.faces] = False
        material = _used(part.material, face, traces, rng)
        normals = part.normals if part.smooth else None
        upper = _of_faces(replace(part, uvs=face.st, given_normals=normals), ~rest)
        parts[number] = replace(upper, name=f"{part.name}_used", material=material)
        if rest.any():
            parts.append(_of_faces(part, rest))
        return replace(item, parts=tuple(parts))
    return item


def _used(
    material: Material, face: _Face, traces: Callable[[_Face, Draw], list[Trace]], rng: Draw
) -> Material:
    left = tuple(traces(face, rng))
    return replace(
        material, use=Use(face.low, face.high, face.panels, left, int(rng.integers(1 << 30)))
    )


def _of_faces(part: PiecePart, keep: BoolArray) -> PiecePart:
    """The part with some of its faces, and the vertices that they need."""
    needed, faces = np.unique(part.faces[keep], return_inverse=True)
    normals = None if part.given_normals is None else part.given_normals[needed]
    return replace(
        part,
        vertices=part.vertices[needed],
        faces=faces.reshape(-1, 3),
        uvs=part.uvs[needed],
        given_normals=normals,
    )


def _face_of(part: PiecePart, towards: Float64Array) -> _Face | None:
    """The largest face of a part in a direction, with those that are parallel in pattern, too."""
    corners = part.vertices[part.faces]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.sqrt((facing * facing).sum(axis=1))
    ahead = (facing * towards).sum(axis=1) > 0.75 * area
    count = len(part.vertices)
    ends = (part.faces[:, [0, 1]].T, part.faces[:, [1, 2]].T)
    pairs = np.concatenate(ends, axis=1)
    links = coo_array((np.ones(pairs.shape[1], dtype=bool), pairs), shape=(count, count))
    number, labels = connected_components(links, directed=False)
    of_face = labels[part.faces[:, 0]]
    sizes = np.bincount(of_face, area, number)
    astray = np.bincount(of_face, np.where(ahead, 0.0, area), number)
    islands = np.flatnonzero((sizes > 1e-3) & (astray < 0.2 * sizes))
    islands = islands[np.argsort(-np.round(sizes[islands], 6), kind="stable")]
    chosen: list[int] = []
    panels = []
    axes = start = None
    st = part.uvs.copy()
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for island in islands.tolist():
        own = np.flatnonzero(labels == island)
        fitted = _fitted(part.vertices[own], part.uvs[own], towards)
        if fitted is None:
            continue
        linear, constant, sign = fitted
        if axes is None or start is None:
            axes, start = linear, constant
        elif np.abs(linear - axes).max() > 0.02:
            continue
        shift = _on_grid(constant - start)
        st[own] = part.uvs[own] * [sign, 1.0] - shift
        a, b = _on_grid(st[own].min(axis=0)), _on_grid(st[own].max(axis=0))
        low, high = np.minimum(low, a), np.maximum(high, b)
        panels.append((*a.tolist(), *b.tolist(), *shift.tolist()))
        chosen.append(island)
    if axes is None or start is None or (high - low).min() < 0.05:
        return None
    faces = np.flatnonzero(np.isin(of_face, chosen))
    return _Face(axes, start, faces, st, _rounded(low), _rounded(high), tuple(panels[::-1]))


def _fitted(
    points: Float64Array, uvs: Float64Array, towards: Float64Array
) -> tuple[Float64Array, Float64Array, float] | None:
    """Affine map from points to right-handed uvs: (2, 3), (2,), and the sign that u got."""
    middle, centre = points.mean(axis=0), uvs.mean(axis=0)
    linear = np.linalg.lstsq(points - middle, uvs - centre, rcond=1e-6)[0].T
    if np.abs((points - middle) @ linear.T + centre - uvs).max() > 0.03:
        return None
    sign = 1.0 if (np.cross(linear[0], linear[1]) * towards).sum() > 0 else -1.0
    linear = linear * [[sign], [1.0]]
    constant = centre * [sign, 1.0] - (linear * middle).sum(axis=1)
    return linear, constant, sign


def _rounded(point: Float64Array) -> Point:
    s, t = _on_grid(point).tolist()
    return s, t


def _on_grid(values: Float64Array) -> Float64Array:
    return np.asarray(np.round(values + _ASIDE, _GRID))
