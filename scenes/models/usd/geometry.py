"""Triangles of the geometric prims of a USD stage: meshes and the implicit surfaces.

Runs in the child process that holds OpenUSD. Vertices are in the axes of the prim.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import UsdGeom

from pbrnet.scenes.arrays import Float64Array, Int64Array
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.formats.model_parts import triangulated
from pbrnet.scenes.geometry.mesh import Mesh, creased, face_areas
from pbrnet.scenes.geometry.primitives import cube, rectangle

UNREAD = ("BasisCurves", "NurbsCurves", "HermiteCurves", "Points", "NurbsPatch", "TetMesh",
          "Volume")  # fmt: skip
_MOST_CORNERS = 60_000_000  # of the polygons of a mesh
_MOST_OF_A_POLYGON = 4096
_COORDINATES = ("st", "UVMap", "st_0", "st0", "uv", "map1", "Texture_uv")
_SEGMENTS = 48  # around a surface of revolution
_CREASE = 40.0  # degrees, for the rims of cylinders
_TURNS = {  # from Z to the axis of a solid
    "X": np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]),
    "Y": np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]]),
}
_PLANES = {
    "X": np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]),
    "Y": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
}


@dataclass(frozen=True)
class Geometry:
    """Triangles with a vertex for each corner, (F, 3), of polygons numbered `polygon` (F,)."""

    points: Float64Array  # (F, 3, 3)
    polygon: Int64Array
    normals: Float64Array | None = None  # (F, 3, 3)
    uvs: Float64Array | None = None  # (F, 3, 2), v = 0 at the bottom of an image
    is_smooth: bool = False  # normals are to be made smooth: a subdivision surface


def mesh_geometry(prim: Any, coordinates: str, time: Any) -> Geometry:
    """Return the triangles of a `Mesh`; `coordinates` names the primvar that its textures use."""
    mesh = UsdGeom.Mesh(prim)
    where = str(prim.GetPath())
    points = _vectors(mesh.GetPointsAttr().Get(time), where)
    counts = _indices(mesh.GetFaceVertexCountsAttr().Get(time))
    corners = _indices(mesh.GetFaceVertexIndicesAttr().Get(time))
    if (counts < 0).any() or counts.sum() != len(corners):
        raise InputError(f"{where}: its faces have {counts.sum():,} corners, not {len(corners):,}")
    if len(corners) > _MOST_CORNERS or counts.max(initial=0) > _MOST_OF_A_POLYGON:
        raise InputError(
            f"{where}: more than {_MOST_CORNERS:,} corners, or than {_MOST_OF_A_POLYGON:,} of "
            "one polygon"
        )
    if len(corners) and (corners.min() < 0 or corners.max() >= len(points)):
        raise InputError(f"{where}: a face refers to a vertex that does not exist")
    used = counts >= 3
    used &= ~np.isin(np.arange(len(counts)), _indices(mesh.GetHoleIndicesAttr().Get(time)))
    polygon_of_corner = np.repeat(np.arange(len(counts)), counts)
    starts = np.cumsum(counts) - counts
    # Corners as (vertex, place in the list of corners): what `triangulated` keeps together.
    table = np.stack([corners, np.arange(len(corners)), polygon_of_corner], axis=1)
    groups = (
        table[starts[used & (counts == size)][:, None] + np.arange(size)]
        for size in np.unique(counts[used])
    )
    made = triangulated(groups, points)
    order = np.argsort(made[:, 0, 2], kind="stable")
    made = made[order]
    if mesh.GetOrientationAttr().Get(time) == "leftHanded":
        made = made[:, ::-1]
    vertex, corner, polygon = made[..., 0], made[..., 1], made[:, 0, 2]
    subdivided = mesh.GetSubdivisionSchemeAttr().Get(time) != "none"
    normals = None if subdivided else _normals(mesh, vertex, corner, polygon, time, where)
    uvs = _uvs(prim, coordinates, vertex, corner, polygon, time)
    return Geometry(points[vertex], polygon, normals, uvs, subdivided)


def subset_faces(subset: Any, time: Any) -> Int64Array:
    """Return the numbers of the polygons of a `GeomSubset`."""
    return _indices(subset.GetIndicesAttr().Get(time))


def implicit_geometry(prim: Any, time: Any) -> Geometry | None:
    """Return the triangles of a cube, plane, sphere, cylinder, cone or capsule; else None."""
    kind = str(prim.GetTypeName())
    radius, height = _number(prim, "radius", 1.0, time), _number(prim, "height", 1.0, time)
    turn = _TURNS.get(str(prim.GetAttribute("axis").Get(time)), np.eye(3))
    if kind == "Cube":
        corners = cube().corners * (0.5 * _number(prim, "size", 2.0, time))
        return Geometry(corners, np.arange(len(corners)))
    if kind == "Plane":
        # Width lies along X, but along Z for a plane across X; length along the other axis.
        size = [_number(prim, "width", 2.0, time), _number(prim, "length", 2.0, time), 1.0]
        across = _PLANES.get(str(prim.GetAttribute("axis").Get(time)), np.eye(3))
        corners = rectangle().corners * (0.5 * np.array(size)) @ across.T
        return Geometry(corners, np.arange(len(corners)))
    arc = np.linspace(-0.5 * np.pi, 0.5 * np.pi, _SEGMENTS // 2 + 1)
    circle = radius * np.stack([np.cos(arc), np.sin(arc)], axis=1)
    half = np.array([0, 0.5 * height])
    profiles = {
        "Sphere": circle,
        "Cylinder": np.array([[0, -0.5], [radius, -0.5], [radius, 0.5], [0, 0.5]]) * [1, height],
        "Cone": np.array([[0, -0.5], [radius, -0.5], [0, 0.5]]) * [1, height],
        "Capsule": np.concatenate([circle[arc <= 0] - half, circle[arc >= 0] + half]),
    }
    if kind not in profiles:
        return None
    mesh = revolved(profiles[kind], _SEGMENTS)
    corners = mesh.corners @ (np.eye(3) if kind == "Sphere" else turn).T
    normals = creased(Mesh(mesh.vertices, mesh.faces), _CREASE).normals
    assert normals is not None
    normals = normals.reshape(-1, 3, 3) @ (np.eye(3) if kind == "Sphere" else turn).T
    return Geometry(corners, np.arange(len(corners)), normals)


def revolved(profile: Float64Array, segments: int) -> Mesh:
    """Return the surface of a profile (N, 2), radius and z upwards, turned around Z."""
    angle = np.linspace(0, 2 * np.pi, segments + 1)[:-1]
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    radii, heights = np.maximum(profile[:, 0], 0), profile[:, 1]
    points = np.concatenate(
        [
            np.column_stack([radius * ring, np.full(segments, z)])
            for radius, z in zip(radii, heights, strict=True)
        ]
    )
    here = np.arange(segments)
    ahead = (here + 1) % segments
    low = np.arange(len(profile) - 1)[:, None] * segments
    a, b, c, d = low + here, low + ahead, low + segments + ahead, low + segments + here
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
    mesh = Mesh(points, faces)
    areas, _ = face_areas(mesh.corners)
    return mesh.subset(areas > 0)


def _number(prim: Any, name: str, default: float, time: Any) -> float:
    value = prim.GetAttribute(name).Get(time)
    if value is None or not math.isfinite(value):
        return default
    return min(max(float(value), 0.0), 1e9)


def _normals(
    mesh: Any, vertex: Int64Array, corner: Int64Array, polygon: Int64Array, time: Any, where: str
) -> Float64Array | None:
    primvar = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("normals")
    if primvar and primvar.HasValue():
        values, interpolation = primvar.ComputeFlattened(time), primvar.GetInterpolation()
    else:
        values, interpolation = mesh.GetNormalsAttr().Get(time), mesh.GetNormalsInterpolation()
    if values is None or not len(values):
        return None
    return _corner_values(_vectors(values, where), interpolation, vertex, corner, polygon)


def _uvs(
    prim: Any, name: str, vertex: Int64Array, corner: Int64Array, polygon: Int64Array, time: Any
) -> Float64Array | None:
    primvars = UsdGeom.PrimvarsAPI(prim)
    for candidate in dict.fromkeys((name, *_COORDINATES)):
        primvar = primvars.FindPrimvarWithInheritance(candidate) if candidate else None
        if primvar and primvar.HasValue():
            values = np.asarray(primvar.ComputeFlattened(time), dtype=np.float64)
            if values.ndim == 2 and values.shape[1] >= 2:
                return _corner_values(
                    values[:, :2], primvar.GetInterpolation(), vertex, corner, polygon
                )
    return None


def _corner_values(
    values: Float64Array,
    interpolation: str,
    vertex: Int64Array,
    corner: Int64Array,
    polygon: Int64Array,
) -> Float64Array | None:
    """The values (N, width) at the corners of triangles, (F, 3, width); None if they do not fit."""
    place = {
        "faceVarying": corner,
        "vertex": vertex,
        "varying": vertex,
        "uniform": np.broadcast_to(polygon[:, None], vertex.shape),
        "constant": np.zeros_like(vertex),
    }.get(interpolation)
    if place is None or (place.size and place.max() >= len(values)):
        return None
    return values[place]


def _vectors(values: Any, where: str) -> Float64Array:
    made = np.asarray(values if values is not None else [], dtype=np.float64).reshape(-1, 3)
    if not np.isfinite(made).all():
        raise InputError(f"{where}: a coordinate is not a finite number")
    return made


def _indices(values: Any) -> Int64Array:
    return np.asarray(values if values is not None else [], dtype=np.int64)
