"""Windows that are opaque blocks or images of glass, in holes of a wall: they become clear panes.

Many models fill a window's hole with a box or a panel without transparency, in the colour or with
an image of glass. By name it is a window or glass; it fills a hole, upright, with a room on one
side and outdoors on the other. What hangs before a whole wall stays. World: metres, Z up.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from pbrnet.scenes.arrays import BoolArray, Float64Array
from pbrnet.scenes.geometry.directions import fibonacci_sphere
from pbrnet.scenes.geometry.mesh import Mesh, face_areas, join_meshes
from pbrnet.scenes.geometry.regions import union
from pbrnet.scenes.importing.categories import category_of, has_structural_name
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.materials.surface import clear_glass
from pbrnet.scenes.importing.names import extended
from pbrnet.scenes.importing.shape import Shape
from pbrnet.scenes.importing.shapes.panes import names_pane, pieces_of_mesh
from pbrnet.scenes.reconstruction.raycast import RayCaster

_THICKEST = 0.35  # metres
_LEAST, _MOST = 0.25, 8.0  # metres, width and height
_FILLED = 0.75  # share of its bounds that a panel covers; frames cover less
_MOST_PIECES = 64
_GRID = 5  # points across a panel, each way
_FREE = 0.4  # metres on both sides that are free, but for frames
_IS_FREE = 0.6  # share of the points
_EDGE = 0.25  # metres around a panel, within which the wall is
_HELD = 0.6  # share of the points at its edges
_BEFORE = 0.5  # metres to the side of a panel, where it is a room or outdoors
_CEILING = 10.0  # metres
_OUTDOORS, _FAN = 0.25, 96  # share of directions that lead outdoors, and directions
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class _Panel:
    """An upright panel: rows of `frame` are along, up and across; bounds (3,) in that frame."""

    frame: Float64Array
    low: Float64Array
    high: Float64Array

    def points(self, shares: Float64Array) -> Float64Array:
        """Points (N, 3) in the middle of its thickness, at shares (N, 2) of width and height."""
        flat = self.low[:2] + shares * (self.high - self.low)[:2]
        depth = np.full(len(flat), 0.5 * (self.low[2] + self.high[2]))
        world: Float64Array = np.column_stack([flat, depth]) @ self.frame
        return world


def with_clear_windows(
    shapes: list[Shape], others: Sequence[Shape], shining: Collection[str], changes: Changes
) -> list[Shape]:
    """Replace opaque windows in holes of walls by clear panes.

    `others` are further shapes of the building, such as added ceilings; `shining` are ids of shapes
    that emit light.
    """
    named = {
        shape.id
        for shape in shapes
        if shape.id not in shining and not shape.surface.transmissive and _is_named(shape)
    }
    found = {shape.id: panels for shape in shapes if shape.id in named
             and (panels := _panels(shape.mesh))}  # fmt: skip
    solid = [
        shape.mesh.corners
        for shape in [*shapes, *others]
        if shape.id not in found and not shape.surface.see_through and not shape.surface.invisible
    ]
    if not found or not solid:
        return shapes
    rays = RayCaster(np.concatenate(solid))
    taken = {shape.id.lower() for shape in [*shapes, *others]}
    made: list[Shape] = []
    for shape in shapes:
        open_ones = [
            (faces, panel) for faces, panel in found.get(shape.id, []) if _is_window(panel, rays)
        ]
        if not open_ones:
            made.append(shape)
            continue
        changes.note("opaque windows in holes of walls became clear glass: {}", shape.name)
        rest = ~np.any([faces for faces, _ in open_ones], axis=0)
        if rest.any():
            made.append(replace(shape, mesh=shape.mesh.subset(rest)))
        sheets = [_pane(shape.mesh, faces, panel) for faces, panel in open_ones]
        id_ = extended(f"{shape.id}-pane", taken) if rest.any() else shape.id
        made.append(replace(shape, id=id_, mesh=join_meshes(sheets), surface=clear_glass()))
    return made


def _is_named(shape: Shape) -> bool:
    """Return whether a name says that a shape is a window: its own, or else its material's."""
    if names_pane(shape.name):
        return True
    says_more = category_of(shape.name) != "other" or has_structural_name(shape.name)
    return not says_more and names_pane(shape.surface.name)


def _panels(mesh: Mesh) -> list[tuple[BoolArray, _Panel]]:
    """The connected pieces of a mesh that are upright panels: their faces (F,) and bounds."""
    labels = pieces_of_mesh(mesh)
    if labels.max() >= _MOST_PIECES:
        return []
    pieces = [labels == label for label in range(labels.max() + 1)]
    whole = _panel(mesh)
    if whole is not None:
        return [(np.ones(len(mesh.faces), dtype=bool), whole)]
    return [(faces, panel) for faces in pieces if (panel := _panel(mesh.subset(faces))) is not None]


def _panel(mesh: Mesh) -> _Panel | None:
    """The upright panel that a mesh is; None if it is another form, or a frame."""
    points = mesh.vertices
    centred = points[:, :2] - points[:, :2].mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    along = np.append(axes[:, 1], 0.0)
    frame = np.stack([along, _UP, np.cross(along, _UP)])
    local = points @ frame.T
    low, high = local.min(axis=0), local.max(axis=0)
    width, height, depth = (high - low).tolist()
    if depth > min(_THICKEST, 0.5 * width) or not min(width, height) >= _LEAST:
        return None
    if max(width, height) > _MOST:
        return None
    flat = (mesh.corners @ frame.T)[:, :, :2]
    facing = np.abs(face_areas(mesh.corners)[1] @ frame[2]) > 0.9
    covered = union(list(shapely.polygons(flat[facing]))).area if facing.any() else 0.0
    return _Panel(frame, low, high) if covered >= _FILLED * width * height else None


def _is_window(panel: _Panel, rays: RayCaster) -> bool:
    """Return whether a panel fills a hole between a room and outdoors."""
    steps = (np.arange(_GRID) + 0.5) / _GRID
    points = panel.points(np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2))
    across = panel.frame[2]
    reach = _FREE + 0.5 * float(panel.high[2] - panel.low[2])
    sides = [rays.cast(points, side * across)[0] > reach for side in (1.0, -1.0)]
    if (sides[0] & sides[1]).mean() < _IS_FREE or _held_share(panel, rays) < _HELD:
        return False
    middle = panel.points(np.array([[0.5, 0.5]]))
    for side in (1.0, -1.0):
        inner = middle - side * _BEFORE * across
        fan = fibonacci_sphere(_FAN)
        fan = fan[fan @ (side * across) > 0.05]
        outer = np.repeat(middle + side * _BEFORE * across, len(fan), axis=0)
        is_roofed = rays.cast(inner, _UP)[0][0] < _CEILING
        if is_roofed and rays.escapes(outer, fan).mean() >= _OUTDOORS:
            return True
    return False


def _held_share(panel: _Panel, rays: RayCaster) -> float:
    """Share of the points at a panel's edges beside which the wall is."""
    steps = (np.arange(_GRID) + 0.5) / _GRID
    size = (panel.high - panel.low)[:2]
    held = []
    for axis, sign in ((0, -1.0), (0, 1.0), (1, -1.0), (1, 1.0)):
        shares = np.empty((_GRID, 2))
        shares[:, axis], shares[:, 1 - axis] = 0.5, steps
        distance = rays.cast(panel.points(shares), sign * panel.frame[axis])[0]
        held.append(distance <= 0.5 * size[axis] + _EDGE)
    return float(np.mean(held))


def _pane(mesh: Mesh, faces: BoolArray, panel: _Panel) -> Mesh:
    """The outline of a panel as a sheet in the middle of its thickness."""
    local = mesh.vertices @ panel.frame.T
    cosines = face_areas(mesh.corners)[1] @ panel.frame[2]
    sides = [faces & (sign * cosines > 0.9) for sign in (1.0, -1.0)]
    front = max(sides, key=lambda side: float(face_areas(mesh.corners[side])[0].sum()))
    local[:, 2] = 0.5 * (panel.low[2] + panel.high[2])
    return Mesh(local @ panel.frame, mesh.faces).subset(front)
