"""Things in meshes without a telling name: connected parts, told apart by size and place.

A name of furniture that is given to a whole room tells nothing.

Input: the shapes of a building in metres, Z up. Large meshes whose names tell nothing, as scans and
merged exports have them, are split by connected parts, as are the shapes of a large node, which
exporters write one for each material. Parts that stand on or in each other, such
as a table's legs and top, stay together as one piece; what is too large for furniture, flat like
the face of a wall, or tiny stays in the mesh. Pieces have no known category.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from shapely.geometry import Polygon

from pbrnet.scenes.arrays import BoolArray, Float64Array, Int64Array
from pbrnet.scenes.geometry.regions import intersection
from pbrnet.scenes.importing.categories import (
    category_of,
    category_of_part,
    has_structural_name,
)
from pbrnet.scenes.importing.names import extended
from pbrnet.scenes.importing.shape import Shape, bounds_of
from pbrnet.scenes.importing.shapes.panes import pieces_of_mesh
from pbrnet.scenes.reconstruction.scale_clues import usual_size

UNKNOWN = "unknown"  # category of a piece
_MERGED_EXTENT = 3.0  # metres; a smaller mesh is one thing
_MAX_SIZE = np.array([3.0, 3.0, 2.4])  # metres, of a piece along each axis
_MIN_SIZE = 0.05  # metres, longest side of a piece
_FLAT, _FLAT_AREA = 0.005, 0.3  # metres, square metres: a thin sheet so large is a wall's face
_TOUCH = 0.01  # metres
_WITHIN = 0.8  # share of a part's plan over another's from which both are one piece
_TOO_LARGE = 2.5  # times the usual size of what a name says
_ROOM_HEIGHT = 1.5  # metres
_HELD = 0.8  # share of a room's floor
_DECIMALS = 4  # of metres, to which vertices are welded
_MAX_PARTS = 50_000  # of a scene; more come from scans in fragments or from vegetation
_MAX_FACES = 3_000_000  # of a mesh


def without_misleading_names(
    shapes: list[Shape], labels: Mapping[str, tuple[str, ...]], floors: Sequence[Polygon]
) -> tuple[list[Shape], dict[str, tuple[str, ...]]]:
    """The shapes and their labels (as in `split_unnamed`) without names of things like "chair".

    Only where what has such a name is much larger and holds a whole room, whose `floors` are
    given.
    """
    members: dict[str, list[Shape]] = {}
    for shape in shapes:
        for label in {*labels.get(shape.id, ()), f"shape:{shape.name}"}:
            members.setdefault(label, []).append(shape)
    wrong = {label for label, found in members.items() if _is_misnamed(label, found, floors)}
    if not wrong:
        return shapes, dict(labels)
    spoken = {label.partition(":")[2] for label in wrong}
    return (
        [replace(each, name="part") if each.name in spoken else each for each in shapes],
        {id_: tuple(label for label in path if label not in wrong) for id_, path in labels.items()},
    )


def _is_misnamed(label: str, shapes: list[Shape], floors: Sequence[Polygon]) -> bool:
    usual = usual_size(category_of(label.partition(":")[2]))
    low, high = bounds_of(shapes)
    if usual is None or (high - low).max() <= _TOO_LARGE * usual or high[2] - low[2] < _ROOM_HEIGHT:
        return False
    plan = shapely.box(*low[:2], *high[:2])
    return any(intersection(plan, floor).area >= _HELD * floor.area for floor in floors)


@dataclass(frozen=True)
class Pieces:
    """Shapes of which some were split, and the piece that each new one belongs to."""

    shapes: list[Shape]
    origin: dict[str, str]  # id of a new shape -> id of the shape that it was part of
    piece: dict[str, str]  # id of a new shape -> name of its piece


def split_unnamed(shapes: list[Shape], labels: Mapping[str, tuple[str, ...]]) -> Pieces:
    """Split large meshes whose names tell nothing into pieces.

    `labels` holds the names of the nodes that contain a shape, by its id.
    """
    wide = _wide_nodes(shapes, labels)
    merged = [
        shape for shape in shapes
        if (labels.get(shape.id) in wide or _is_wide([shape]))
        and _is_untold(shape, labels.get(shape.id, ()))
    ]  # fmt: skip
    parts = {shape.id: pieces_of_mesh(shape.mesh, _DECIMALS) for shape in merged}
    counts = [int(parts[shape.id].max()) + 1 for shape in merged]
    if not merged or sum(counts) > _MAX_PARTS or (sum(counts) == len(merged) and not wide):
        return Pieces(shapes, {}, {})
    bounds = np.concatenate([_part_bounds(shape, parts[shape.id]) for shape in merged])
    is_piece, label = _pieces_of(bounds)
    names: dict[int, str] = {}
    made: list[Shape] = []
    origin: dict[str, str] = {}
    piece: dict[str, str] = {}
    starts = dict(zip((shape.id for shape in merged), np.cumsum([0, *counts]).tolist(),
                      strict=False))  # fmt: skip
    taken = {shape.id.lower() for shape in shapes}
    for shape in shapes:
        if shape.id not in parts:
            made.append(shape)
            continue
        rows = starts[shape.id] + parts[shape.id]
        rest = ~is_piece[rows]
        if rest.any():
            made.append(replace(shape, mesh=shape.mesh.subset(rest), sphere=None))
        for number in np.unique(label[rows[~rest]]).tolist():
            name = names.setdefault(number, f"piece {len(names) + 1}")
            id_ = extended(f"{shape.id}_piece{name.removeprefix('piece ')}", taken)
            chosen = ~rest & (label[rows] == number)
            made.append(replace(shape, id=id_, name=name, mesh=shape.mesh.subset(chosen)))
            origin[id_], piece[id_] = shape.id, name
    return Pieces(made, origin, piece)


def _wide_nodes(shapes: list[Shape], labels: Mapping[str, tuple[str, ...]]) -> set[tuple[str, ...]]:
    """The innermost nodes that hold several shapes and are wider than a thing."""
    nodes: dict[tuple[str, ...], list[Shape]] = {}
    for shape in shapes:
        if labels.get(shape.id):
            nodes.setdefault(labels[shape.id], []).append(shape)
    return {node for node, held in nodes.items() if len(held) > 1 and _is_wide(held)}


def _is_wide(shapes: list[Shape]) -> bool:
    low, high = bounds_of(shapes)
    return float((high - low)[:2].max()) > _MERGED_EXTENT


def _is_untold(shape: Shape, labels: tuple[str, ...]) -> bool:
    """Return whether neither a shape's name nor those of its nodes tell what it is."""
    if len(shape.mesh.faces) > _MAX_FACES:
        return False
    names = (*(label.partition(":")[2] for label in labels), shape.name)
    if shape.surface.see_through or any(has_structural_name(name) for name in names):
        return False
    return all(category_of_part(name, shape.surface.name) == "other" for name in names)


def _part_bounds(shape: Shape, parts: Int64Array) -> Float64Array:
    """Bounds (P, 2, 3) of the connected parts of a shape."""
    corners = shape.mesh.corners
    order = np.argsort(parts, kind="stable")
    starts = np.searchsorted(parts[order], np.arange(int(parts.max()) + 1))
    low = np.minimum.reduceat(corners.min(axis=1)[order], starts)
    high = np.maximum.reduceat(corners.max(axis=1)[order], starts)
    return np.stack([low, high], axis=1)


def _pieces_of(bounds: Float64Array) -> tuple[BoolArray, Int64Array]:
    """Group parts with `bounds` (P, 2, 3): whether each is in a piece (P,), and its number (P,)."""
    size = bounds[:, 1] - bounds[:, 0]
    fits = (size <= _MAX_SIZE).all(axis=1)
    ordered = np.sort(size, axis=1)
    fits &= ~((ordered[:, 0] < _FLAT) & (ordered[:, 1] * ordered[:, 2] > _FLAT_AREA))
    kept = np.nonzero(fits)[0]
    low, high = bounds[kept, 0] - _TOUCH, bounds[kept, 1] + _TOUCH
    plans = shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1])
    first, second = shapely.STRtree(plans).query(plans, predicate="intersects")
    meets = (low[first, 2] <= high[second, 2]) & (low[second, 2] <= high[first, 2])
    overlap = np.minimum(high[first], high[second]) - np.maximum(low[first], low[second])
    smaller = np.minimum(shapely.area(plans[first]), shapely.area(plans[second]))
    meets &= overlap[:, 0] * overlap[:, 1] >= _WITHIN * smaller
    graph = coo_matrix((np.ones(int(meets.sum())), (first[meets], second[meets])),
                       shape=(len(kept),) * 2)  # fmt: skip
    count, label = connected_components(graph, directed=False)
    whole_low, whole_high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(whole_low, label, bounds[kept, 0])
    np.maximum.at(whole_high, label, bounds[kept, 1])
    whole = whole_high - whole_low
    good = (whole.max(axis=1) >= _MIN_SIZE) & (whole <= _MAX_SIZE).all(axis=1)
    is_piece = np.zeros(len(bounds), dtype=bool)
    is_piece[kept] = good[label]
    number = np.full(len(bounds), -1, dtype=np.int64)
    number[kept] = label
    return is_piece, number
