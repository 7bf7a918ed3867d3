"""Closed solids out of plan regions, and their surfaces as meshes (manifold3d does the cutting).

Everything here is in metres in the world: x = plan x / 100, y = -plan y / 100.
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

from scenes.arrays import Float64Array
from scenes.geometry.mesh import Mesh

_SMALLEST_AREA = 1e-6  # square metres: regions smaller than this are dropped
_GRID = 1e-6  # metres: spikes thinner than this are dropped

Heights = Callable[[Float64Array], Float64Array]  # z of points (N, 2)


def to_world(points: npt.ArrayLike) -> Float64Array:
    """Plan points (N, 2), centimetres, y down, as world points (N, 2)."""
    return np.asarray(points, dtype=np.float64) * [0.01, -0.01]


def world_region(region: BaseGeometry) -> BaseGeometry:
    """A plan region in the world."""
    return shapely.transform(region, to_world)


def polygons(region: BaseGeometry) -> list[Polygon]:
    """The polygons of a region, counter-clockwise, specks left out, in a fixed order."""
    if isinstance(region, Polygon):
        found = [region]
    elif isinstance(region, MultiPolygon):
        found = list(region.geoms)
    else:
        found = [part for part in getattr(region, "geoms", []) if isinstance(part, Polygon)]
    kept = [orient(part) for part in found if part.area > _SMALLEST_AREA]
    return sorted(kept, key=lambda part: (-part.area, part.bounds))


def polygonal(region: BaseGeometry) -> BaseGeometry:
    """The areas of a region, without the lines, points and spikes that overlays leave over.

    A spike, where an outline goes out and comes back along the same line, has no mitre.
    """
    return MultiPolygon(polygons(shapely.set_precision(region, _GRID)))


def prism(region: BaseGeometry, bottom: float, top: float | Heights) -> manifold3d.Manifold:
    """The solid over `region` from `bottom` to `top`, a height or a function of place."""
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
    """The surface of a solid as triangles with corners of their own; None if it is empty."""
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
    """The solid less the holes."""
    found = list(holes)
    if not found:
        return solid
    return manifold3d.Manifold.batch_boolean([solid, *found], manifold3d.OpType.Subtract)


def triangle_normals(mesh: Mesh) -> Float64Array:
    """Unit normals (F, 3) of the triangles of a mesh."""
    corners = mesh.corners
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return cross / np.maximum(np.linalg.norm(cross, axis=1), 1e-300)[:, None]
