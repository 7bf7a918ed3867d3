"""Closed solids from plan regions, and their surfaces as meshes (booleans by manifold3d).

All coordinates are metres in the world: x = plan x / 100, y = -plan y / 100.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import manifold3d
import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.geometry.mesh import Mesh
from pbrnet.scenes.geometry.regions import on_grid

_SMALLEST_AREA = 1e-6  # square metres: regions smaller than this are dropped
_GRID = 1e-6  # metres: spikes thinner than this are dropped

Heights = Callable[[Float64Array], Float64Array]  # z of points (N, 2)


def to_world(points: npt.ArrayLike) -> Float64Array:
    """Convert plan points (N, 2), centimetres, y down, to world points (N, 2), metres."""
    return np.asarray(points, dtype=np.float64) * [0.01, -0.01]


def world_region(region: BaseGeometry) -> BaseGeometry:
    """Convert a plan region to world coordinates."""
    return shapely.transform(region, to_world)


def polygons(region: BaseGeometry) -> list[Polygon]:
    """Return the polygons of a region, counter-clockwise, tiny ones dropped, in a fixed order."""
    if isinstance(region, Polygon):
        found = [region]
    elif isinstance(region, MultiPolygon):
        found = list(region.geoms)
    else:
        found = [part for part in getattr(region, "geoms", []) if isinstance(part, Polygon)]
    kept = [orient(part) for part in found if part.area > _SMALLEST_AREA]
    return sorted(kept, key=lambda part: (-part.area, part.bounds))


def polygonal(region: BaseGeometry) -> BaseGeometry:
    """Return the polygons of a region without the lines, points and spikes that overlays leave.

    A spike, an outline that returns along the same line, has no mitre when it is buffered.
    """
    return MultiPolygon(polygons(on_grid(region, _GRID)))


def prism(region: BaseGeometry, bottom: float, top: float | Heights) -> manifold3d.Manifold:
    """Return the solid over `region` from `bottom` to `top`, a height or a function of points."""
    contours = []
    for part in polygons(region):
        contours.append(np.asarray(part.exterior.coords)[:-1])
        contours += [np.asarray(hole.coords)[:-1] for hole in part.interiors]
    if not contours:
        return manifold3d.Manifold()
    section = manifold3d.CrossSection(contours, manifold3d.FillRule.Positive)
    solid = manifold3d.Manifold.extrude(section, 1.0)

    def lift(points: Float64Array) -> Float64Array:
        z = np.full(len(points), float(top)) if not callable(top) else top(points[:, :2])
        made = np.array(points, dtype=np.float64)
        made[:, 2] = bottom + points[:, 2] * (z - bottom)
        return made

    return solid.warp_batch(lift)


def surface(solid: manifold3d.Manifold) -> Mesh | None:
    """Return the surface of a solid with unshared vertices; None if it is empty."""
    if solid.is_empty():
        return None
    mesh = solid.to_mesh64()
    corners = np.asarray(mesh.vert_properties)[:, :3][np.asarray(mesh.tri_verts)]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    corners = corners[np.linalg.norm(cross, axis=1) > 1e-12]
    if not len(corners):
        return None
    return Mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


def cut(solid: manifold3d.Manifold, holes: Iterable[manifold3d.Manifold]) -> manifold3d.Manifold:
    """Subtract the holes from the solid."""
    found = list(holes)
    if not found:
        return solid
    return manifold3d.Manifold.batch_boolean([solid, *found], manifold3d.OpType.Subtract)


def triangle_normals(mesh: Mesh) -> Float64Array:
    """Return unit normals (F, 3) of the triangles of a mesh."""
    corners = mesh.corners
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return cross / np.maximum(np.linalg.norm(cross, axis=1), 1e-300)[:, None]
