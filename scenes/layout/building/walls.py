"""Net floors of a layout's rooms, and the outlines of its outer walls.

Where polygons of rooms touch, both step back by half a wall. Lengths are in metres.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely import STRtree
from shapely.geometry import Polygon

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.contract import Point2
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.geometry.regions import (
    buffered,
    difference,
    intersection,
    largest_part,
    polygon_parts,
    union,
)
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.layout.layout import Layout

THINNEST = 0.05  # of walls: a smaller gap between rooms is widened to the layout's wall
_OVERLAP = 0.15  # by which rooms may overlap at a wall, or 3/4 of the wall
_PARALLEL = math.cos(math.radians(2.0))
_BESIDE = 0.05  # least length of wall that two rooms share
_STRAIGHT = 1e-6  # by which a corner may be off the line between its neighbours
_SMALLEST = 0.3  # square metres of a room
_SHAFT = 1.5  # square metres; smaller holes between rooms are solid
_FARTHEST = 3.0  # of a corner from its own, in widths of the wall


@dataclass(frozen=True)
class Shell:
    """Net floors by room, counter-clockwise, and the outer faces of outer walls.

    `parts` are counter-clockwise, the largest first; `yards` are clockwise.
    """

    floors: tuple[tuple[Point2, ...], ...]
    parts: tuple[tuple[Point2, ...], ...]
    yards: tuple[tuple[Point2, ...], ...]


def build_shell(layout: Layout, changes: Changes) -> Shell:
    """Return the faces of the walls; `InputError` names a room that has no floor left."""
    outer = 0.5 * layout.outer_wall if layout.polygons == "centre" else 0.0
    rings = [straightened(np.array(room.polygon)) for room in layout.rooms]
    moved = []
    for number, ring in enumerate(rings):
        others = [each for k, each in enumerate(rings) if k != number]
        steps = _steps(ring, others, layout.wall, outer)
        floor = _stepped_back(ring, steps)
        if floor is None:
            raise InputError(
                f"rooms[{number}].polygon: no floor is left between walls of {layout.wall:g} m"
            )
        moved.append(floor)
    floors = _apart(moved, layout, changes)
    solid = union([buffered(one, layout.outer_wall, join_style="mitre") for one in floors])
    parts = sorted(polygon_parts(solid), key=lambda part: -part.area)
    yards = [ring for part in parts for ring in part.interiors if Polygon(ring).area > _SHAFT]
    return Shell(
        tuple(_points(np.array(floor.exterior.coords)[:-1], True) for floor in floors),
        tuple(_points(np.array(part.exterior.coords)[:-1], True) for part in parts),
        tuple(_points(np.array(ring.coords)[:-1], False) for ring in yards),
    )


def straightened(ring: Float64Array) -> Float64Array:
    """A ring (N, 2) without repeated corners and corners on a straight line."""
    kept = list(ring)
    k = 0
    while k < len(kept) and len(kept) > 3:
        before, here, after = kept[k - 1], kept[k], kept[(k + 1) % len(kept)]
        along = after - before
        length = float(np.hypot(*along))
        off = abs(along[0] * (here - before)[1] - along[1] * (here - before)[0])
        if length < _STRAIGHT or off <= _STRAIGHT * length:
            del kept[k]
            k = max(0, k - 1)
        else:
            k += 1
    return np.array(kept)


def _points(ring: Float64Array, counter_clockwise: bool) -> tuple[Point2, ...]:
    ring = straightened(ring)
    if Polygon(ring).exterior.is_ccw != counter_clockwise:
        ring = ring[::-1]
    return tuple((float(x), float(y)) for x, y in np.round(ring, 9))


def _directions(ring: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Unit vectors along the sides and into the room (N, 2), and lengths (N,)."""
    along = np.roll(ring, -1, axis=0) - ring
    length = np.hypot(along[:, 0], along[:, 1])
    along = along / np.maximum(length, 1e-12)[:, None]
    return along, np.stack([-along[:, 1], along[:, 0]], axis=1), length


def _steps(
    ring: Float64Array, others: Sequence[Float64Array], wall: float, outer: float
) -> Float64Array:
    """Metres by which each side of a ring steps back, (N,)."""
    along, inward, length = _directions(ring)
    steps = np.full(len(ring), outer)
    if not others:
        return steps
    starts = np.concatenate(others)
    ends = np.concatenate([np.roll(each, -1, axis=0) for each in others])
    theirs = np.concatenate([_directions(each)[0] for each in others])
    for k in range(len(ring)):
        facing = theirs @ along[k] < -_PARALLEL
        near, far = starts[facing] - ring[k], ends[facing] - ring[k]
        low = np.maximum(far @ along[k], 0.0)
        high = np.minimum(near @ along[k], length[k])
        gaps = -0.5 * (near + far) @ inward[k]
        least = -max(_OVERLAP, 0.75 * wall)
        shared = gaps[(high - low > _BESIDE) & (gaps > least) & (gaps < max(0.5, 2 * wall))]
        if len(shared):
            gap = float(shared.min())
            steps[k] = 0.5 * (wall - gap) if gap < min(THINNEST, wall) else 0.0
    return steps


def _stepped_back(ring: Float64Array, steps: Float64Array) -> Polygon | None:
    """The polygon whose sides are moved inwards; None if it has no area left."""
    if not steps.any():
        return Polygon(ring)
    along, inward, _ = _directions(ring)
    corners: list[Float64Array] = []
    for k in range(len(ring)):
        corners += _corner(ring[k], along[k - 1 : k + 1] if k else along[[-1, 0]],
                           inward[k - 1 : k + 1] if k else inward[[-1, 0]],
                           steps[k - 1 : k + 1] if k else steps[[-1, 0]])  # fmt: skip
    made = Polygon(np.array(corners))
    if not made.is_valid:
        made = largest_part(buffered(made, 0.0))
    return made if made.area > _SMALLEST and made.exterior.is_ccw else None


def _corner(
    corner: Float64Array, along: Float64Array, inward: Float64Array, steps: Float64Array
) -> list[Float64Array]:
    """The corner of two sides that are moved inwards: one point, two on nearly straight walls."""
    moved = corner + steps[:, None] * inward
    cross = float(along[0, 0] * along[1, 1] - along[0, 1] * along[1, 0])
    if abs(cross) > 0.05:
        offset = moved[1] - moved[0]
        share = (offset[0] * along[1, 1] - offset[1] * along[1, 0]) / cross
        met = moved[0] + share * along[0]
        if math.dist(met, corner) < _FARTHEST * max(float(steps.max()), 0.01) + 1.0:
            return [met]
    if abs(steps[0] - steps[1]) < 1e-9:
        return [moved.mean(axis=0)]
    return [moved[0], moved[1]]


def _apart(floors: list[Polygon], layout: Layout, changes: Changes) -> list[Polygon]:
    """Floors that do not overlap: what two share goes to the first, or is refused."""
    kept: list[Polygon] = []
    tree = STRtree(floors)
    for number, floor in enumerate(floors):
        for other in sorted(int(k) for k in tree.query(floor)):
            shared = intersection(floor, kept[other]).area if other < number else 0.0
            if shared < 1e-4:
                continue
            if layout.strict or shared > 0.5 * floor.area:
                raise InputError(
                    f"rooms[{number}].polygon: overlaps rooms[{other}] by {shared:.2f} square "
                    "metres; rooms may touch, not overlap"
                )
            changes.note("what two rooms shared went to one of them: {}", layout.rooms[number].id)
            around = buffered(kept[other], layout.wall, join_style="mitre")
            floor = largest_part(difference(floor, around))
        if floor.area < _SMALLEST or floor.interiors:
            raise InputError(f"rooms[{number}].polygon: another room lies inside; cut it out")
        kept.append(floor)
    return kept


def check_ring(polygon: tuple[Point2, ...], where: str) -> None:
    """Check that a polygon is simple, counter-clockwise and has an area; raises `InputError`."""
    if len(polygon) < 3:
        raise InputError(f"{where}: {len(polygon)} corners; a room has at least 3")
    shape = Polygon(polygon)
    if not shape.is_valid:
        raise InputError(f"{where}: {shapely.is_valid_reason(shape)}; give a simple polygon")
    if shape.area < _SMALLEST:
        raise InputError(f"{where}: {shape.area:.3g} square metres; a room has {_SMALLEST:g}")


def counter_clockwise(layout: Layout) -> Layout:
    """The layout with the polygons of all rooms counter-clockwise."""
    turned = [
        room if Polygon(room.polygon).exterior.is_ccw else replace(room, polygon=room.polygon[::-1])
        for room in layout.rooms
    ]
    return replace(layout, rooms=tuple(turned))
