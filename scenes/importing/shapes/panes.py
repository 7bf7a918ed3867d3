"""Window panes: flat clear glass in openings, which a portal replaces.

A renderer that samples portals needs no glass in them: clear panes are removed from the shapes,
and the opening moves into the plane of its pane. Frosted panes stay.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from shapely.geometry import MultiPoint, Polygon

from pbrnet.scenes.arrays import Float64Array, Int64Array
from pbrnet.scenes.geometry.mesh import Mesh
from pbrnet.scenes.geometry.regions import buffered, intersection
from pbrnet.scenes.importing.categories import category_of, words_of
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.materials.surface import Surface
from pbrnet.scenes.importing.shape import Shape
from pbrnet.scenes.importing.xml_elements import plugin
from pbrnet.scenes.reconstruction.rooms import FoundOpening

_MAX_THICKNESS = 0.06  # metres
_MIN_WIDTH = 0.15  # metres, of the shorter one of the two long sides
_PANE_WORDS = {"glass", "pane", "window", "glazing", "glas", "scheibe", "vitre", "vidrio", "vetro"}
_AROUND_PANES = {"frame", "sill", "handle", "lamp", "light", "table"}
_PANE_CATEGORIES = ("glass", "window", "door", "other")
_MOST_PANES = 64
_MAX_DEPTH = 0.75  # metres behind the inner face of the wall


def is_flat(mesh: Mesh) -> bool:
    """Return whether a mesh is a thin sheet of some size, in any orientation."""
    extents = _extents(mesh.vertices)
    return bool(extents[0] <= _MAX_THICKNESS and extents[1] >= _MIN_WIDTH)


def with_named_glass(shapes: list[Shape], changes: Changes) -> list[Shape]:
    """Make flat shapes without a material whose name is that of a pane clear glass."""
    made = []
    for shape in shapes:
        if shape.surface.unstated and names_pane(shape.name) and _is_of_flat_pieces(shape.mesh):
            changes.note("flat shapes named as glass, without a material, became glass: {}",
                         shape.name)  # fmt: skip
            glass = plugin("bsdf", "thindielectric", int_ior=1.5)
            surface = Surface(glass, transmissive=True, see_through=True, name="named_glass")
            shape = replace(shape, surface=surface)
        made.append(shape)
    return made


def names_pane(name: str) -> bool:
    """Return whether a name is that of a window or its glass, not of what is around it."""
    words = words_of(name)
    return bool(
        words & _PANE_WORDS and not words & _AROUND_PANES and category_of(name) in _PANE_CATEGORIES
    )


def solid_corners(shapes: list[Shape]) -> Float64Array:
    """The triangles (F, 3, 3) that stop light; all triangles if none does."""
    solid = [
        shape.mesh.corners
        for shape in shapes
        if not shape.surface.see_through
        and not shape.surface.invisible
        and not (shape.surface.frosted and is_flat(shape.mesh))
    ]
    return np.concatenate(solid or [shape.mesh.corners for shape in shapes])


def remove_panes(
    shapes: list[Shape], openings: list[FoundOpening]
) -> tuple[list[Shape], list[str], list[FoundOpening]]:
    """Remove the clear panes that fill `openings`.

    Returns the remaining shapes, the ids of shapes that lost a pane, and the openings, those with
    a pane moved to its plane.
    """
    kept: list[Shape] = []
    touched: list[str] = []
    panes: dict[int, list[Float64Array]] = {}
    for shape in shapes:
        if not shape.surface.see_through or shape.sphere is not None or shape.emitter is not None:
            kept.append(shape)
            continue
        labels = pieces_of_mesh(shape.mesh)
        keep = np.ones(len(shape.mesh.faces), dtype=bool)
        for label in range(labels.max() + 1):
            members = labels == label
            points = shape.mesh.vertices[np.unique(shape.mesh.faces[members])]
            number = _opening_of(points, openings)
            if number is not None:
                keep &= ~members
                panes.setdefault(number, []).append(points)
        if keep.all():
            kept.append(shape)
            continue
        touched.append(shape.id)
        if keep.any():
            kept.append(replace(shape, mesh=shape.mesh.subset(keep)))
    moved = [
        _moved_to_pane(opening, panes[number], touched) if number in panes else opening
        for number, opening in enumerate(openings)
    ]
    return kept, touched, moved


def frosted_openings(shapes: list[Shape], openings: list[FoundOpening]) -> set[int]:
    """Numbers of the openings that a sheet of frosted glass fills."""
    found = set()
    for shape in shapes:
        if shape.surface.frosted:
            number = _opening_of(shape.mesh.vertices, openings)
            if number is not None:
                found.add(number)
    return found


def _opening_of(points: Float64Array, openings: list[FoundOpening]) -> int | None:
    """Number of the opening that a thin parallel sheet of `points` (N, 3) fills, or None."""
    extents = _extents(points)
    if extents[0] > _MAX_THICKNESS or extents[1] < _MIN_WIDTH:
        return None
    for number, opening in enumerate(openings):
        depth = (points - opening.polygon[0]) @ opening.normal
        if np.ptp(depth) > 2 * _MAX_THICKNESS or depth.min() < -0.15 or depth.max() > _MAX_DEPTH:
            continue
        frame = _plane_axes(opening)
        here = buffered(Polygon((opening.polygon - opening.polygon[0]) @ frame.T), 0.12)
        sheet = MultiPoint((points - opening.polygon[0]) @ frame.T).convex_hull
        if sheet.area > 0 and intersection(here, sheet).area > 0.5 * min(sheet.area, here.area):
            return number
    return None


def _moved_to_pane(
    opening: FoundOpening, sheets: list[Float64Array], touched: list[str]
) -> FoundOpening:
    """The opening in the plane of its panes, as a rectangle around panes and opening.

    `sheets` are the vertices (N, 3) of the panes.
    """
    points = np.concatenate(sheets)
    depth = float(np.median((points - opening.polygon[0]) @ opening.normal))
    frame = _plane_axes(opening)
    origin = opening.polygon[0]
    flat = np.concatenate([(points - origin) @ frame.T, (opening.polygon - origin) @ frame.T])
    low, high = flat.min(axis=0), flat.max(axis=0)
    corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    polygon = origin + corners @ frame + depth * opening.normal
    seeds = opening.seeds + depth * opening.normal
    return replace(opening, polygon=polygon, panes=list(touched), seeds=seeds)


def _plane_axes(opening: FoundOpening) -> Float64Array:
    """Two unit axes (2, 3) of an opening's plane, right-handed with its normal."""
    first = opening.polygon[1] - opening.polygon[0]
    first = first / np.linalg.norm(first)
    return np.stack([first, np.cross(opening.normal, first)])


def pieces_of_mesh(mesh: Mesh, decimals: int = 6) -> Int64Array:
    """Number (F,) of the connected piece of each face.

    Vertices that coincide when rounded to `decimals` connect faces.
    """
    _, merged = np.unique(mesh.vertices.round(decimals), axis=0, return_inverse=True)
    faces = merged.reshape(-1)[mesh.faces]
    rows = np.concatenate([faces[:, 0], faces[:, 1]])
    columns = np.concatenate([faces[:, 1], faces[:, 2]])
    count = int(merged.max()) + 1
    graph = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(count, count))
    _, labels = connected_components(graph, directed=False)
    _, dense = np.unique(labels[faces[:, 0]], return_inverse=True)
    return dense.reshape(-1)


def _is_of_flat_pieces(mesh: Mesh) -> bool:
    """Return whether each connected piece of a mesh, at most `_MOST_PANES`, is a thin sheet."""
    labels = pieces_of_mesh(mesh)
    return bool(labels.max() < _MOST_PANES) and all(
        is_flat(mesh.subset(labels == label)) for label in range(labels.max() + 1)
    )


def _extents(points: Float64Array) -> Float64Array:
    """Extents (3,) of points (N, 3) along their principal axes, smallest first."""
    centred = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    return np.sort(np.ptp(centred @ axes, axis=0))
