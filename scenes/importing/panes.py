"""Window panes: flat clear glass in an opening, taken out of the scene and kept as a portal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from shapely.geometry import MultiPoint, Polygon

from scenes.arrays import Float64Array
from scenes.geometry.mesh import Mesh
from scenes.importing.shape import Shape
from scenes.reconstruction.rooms import FoundOpening

_THIN = 0.06  # metres
_LARGE = 0.15  # metres, the least of the two long sides
_NEAR = 0.75  # metres from the wall's inner face


def is_flat(mesh: Mesh) -> bool:
    """Whether a mesh is a thin sheet of some size, whatever its direction."""
    extents = _extents(mesh.vertices)
    return bool(extents[0] <= _THIN and extents[1] >= _LARGE)


def remove_panes(
    shapes: list[Shape], openings: list[FoundOpening]
) -> tuple[list[Shape], list[str], list[FoundOpening]]:
    """Shapes without the clear panes that fill `openings`, the ids touched, and the openings,
    those with a pane moved to its plane."""
    kept: list[Shape] = []
    touched: list[str] = []
    panes: dict[int, list[Float64Array]] = {}
    for shape in shapes:
        if not shape.surface.see_through or shape.sphere is not None or shape.emitter is not None:
            kept.append(shape)
            continue
        labels = _pieces(shape.mesh)
        stays = np.ones(len(shape.mesh.faces), dtype=bool)
        for label in range(labels.max() + 1):
            mine = labels == label
            points = shape.mesh.vertices[np.unique(shape.mesh.faces[mine])]
            number = _opening_of(points, openings)
            if number is not None:
                stays &= ~mine
                panes.setdefault(number, []).append(points)
        if stays.all():
            kept.append(shape)
            continue
        touched.append(shape.id)
        if stays.any():
            kept.append(replace(shape, mesh=shape.mesh.subset(stays)))
    moved = [
        _at_pane(opening, panes[number], touched) if number in panes else opening
        for number, opening in enumerate(openings)
    ]
    return kept, touched, moved


def frosted_openings(shapes: list[Shape], openings: list[FoundOpening]) -> set[int]:
    """The openings that a sheet of frosted glass fills."""
    found = set()
    for shape in shapes:
        if shape.surface.frosted:
            number = _opening_of(shape.mesh.vertices, openings)
            if number is not None:
                found.add(number)
    return found


def _opening_of(points: Float64Array, openings: list[FoundOpening]) -> int | None:
    """The opening that a thin sheet of these points stands in, parallel to it; else None."""
    extents = _extents(points)
    if extents[0] > _THIN or extents[1] < _LARGE:
        return None
    for number, opening in enumerate(openings):
        depth = (points - opening.polygon[0]) @ opening.normal
        if np.ptp(depth) > 2 * _THIN or depth.min() < -0.15 or depth.max() > _NEAR:
            continue
        frame = _frame(opening)
        here = Polygon((opening.polygon - opening.polygon[0]) @ frame.T).buffer(0.12)
        sheet = MultiPoint((points - opening.polygon[0]) @ frame.T).convex_hull
        if sheet.area > 0 and shapely.intersection(here, sheet).area > 0.5 * min(
            sheet.area, here.area
        ):
            return number
    return None


def _at_pane(opening: FoundOpening, sheets: list[Float64Array], touched: list[str]) -> FoundOpening:
    """The opening in its pane's plane, at least as large as pane and opening."""
    points = np.concatenate(sheets)
    depth = float(np.median((points - opening.polygon[0]) @ opening.normal))
    frame = _frame(opening)
    origin = opening.polygon[0]
    flat = np.concatenate([(points - origin) @ frame.T, (opening.polygon - origin) @ frame.T])
    low, high = flat.min(axis=0), flat.max(axis=0)
    corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    polygon = origin + corners @ frame + depth * opening.normal
    seeds = opening.seeds + depth * opening.normal
    return replace(opening, polygon=polygon, panes=list(touched), seeds=seeds)


def _frame(opening: FoundOpening) -> Float64Array:
    """Two axes (2, 3) of the opening's plane, right-handed with its normal."""
    first = opening.polygon[1] - opening.polygon[0]
    first = first / np.linalg.norm(first)
    return np.stack([first, np.cross(opening.normal, first)])


def _pieces(mesh: Mesh) -> np.ndarray:
    """A number for every face: which connected piece it belongs to (corners that coincide join)."""
    _, merged = np.unique(mesh.vertices.round(6), axis=0, return_inverse=True)
    faces = merged.reshape(-1)[mesh.faces]
    rows = np.concatenate([faces[:, 0], faces[:, 1]])
    columns = np.concatenate([faces[:, 1], faces[:, 2]])
    count = int(merged.max()) + 1
    graph = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(count, count))
    _, labels = connected_components(graph, directed=False)
    _, dense = np.unique(labels[faces[:, 0]], return_inverse=True)
    return dense.reshape(-1)


def _extents(points: Float64Array) -> Float64Array:
    """Sizes along the principal axes, smallest first."""
    centred = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    return np.sort(np.ptp(centred @ axes, axis=0))
