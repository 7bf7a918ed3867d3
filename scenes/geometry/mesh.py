"""Triangle meshes: cleaning, normals, creases, areas.

Coordinates are in the units of the file. Texture coordinates follow Mitsuba: v = 0 is the top row
of an image, so the v of OBJ files is flipped.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import mapbox_earcut
import numpy as np

from pbrnet.scenes.arrays import BoolArray, Float64Array, Int64Array
from pbrnet.scenes.errors import InputError

FARTHEST = 1e12  # largest coordinate of a vertex
FARTHEST_UV = 1e5  # beyond this float32 cannot resolve texels, and lookups fail
MAX_TRIANGLES = 10_000_000  # of one mesh; the whole scene has a limit of its own
_PAIRS = 4_000_000  # of corners at one point that are compared at a time


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh.

    `vertices` float64 (V, 3); `faces` int64 (F, 3), counter-clockwise seen from its front;
    `normals` unit float64 (V, 3), or None for flat facets; `uvs` float64 (V, 2) or None.
    """

    vertices: Float64Array
    faces: Int64Array
    normals: Float64Array | None = None
    uvs: Float64Array | None = None

    @property
    def corners(self) -> Float64Array:
        """Corner positions of the triangles, (F, 3, 3)."""
        return self.vertices[self.faces]

    @cached_property
    def bounds(self) -> Float64Array:
        """Axis-aligned bounds, (2, 3)."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    def transformed(self, matrix: Float64Array) -> Mesh:
        """Return the mesh under an affine map (4, 4); mirroring reverses the winding of faces."""
        linear = matrix[:3, :3]
        vertices = self.vertices @ linear.T + matrix[:3, 3]
        normals, faces = self.normals, self.faces
        if normals is not None:
            normals = _unit(normals @ np.linalg.inv(linear))
        if np.linalg.det(linear) < 0:
            faces = faces[:, ::-1]
        return Mesh(vertices, faces, normals, self.uvs)

    def flipped(self) -> Mesh:
        """Return the mesh with front and back exchanged."""
        normals = None if self.normals is None else -self.normals
        return replace(self, faces=self.faces[:, ::-1], normals=normals)

    def subset(self, keep: BoolArray) -> Mesh:
        """Return the faces where `keep` (F,) is true, and the vertices that they use."""
        faces = self.faces[keep]
        used, inverse = np.unique(faces, return_inverse=True)
        return Mesh(
            self.vertices[used],
            inverse.reshape(-1, 3),
            None if self.normals is None else self.normals[used],
            None if self.uvs is None else self.uvs[used],
        )


def join_meshes(meshes: list[Mesh]) -> Mesh:
    """Concatenate meshes that have the same attributes."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])[:-1]
    normals = [mesh.normals for mesh in meshes if mesh.normals is not None]
    uvs = [mesh.uvs for mesh in meshes if mesh.uvs is not None]
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate(
            [mesh.faces + int(start) for mesh, start in zip(meshes, starts, strict=True)]
        ),
        np.concatenate(normals) if normals else None,
        np.concatenate(uvs) if uvs else None,
    )


def face_areas(corners: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return areas (F,) and unit normals (F, 3), zero if degenerate, of triangles (F, 3, 3)."""
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(cross, axis=1)
    return 0.5 * length, cross / np.maximum(length, 1e-300)[:, None]


def faces_of_polygon(points: Float64Array, normal: Float64Array) -> Int64Array:
    """Return triangles (F, 3) of a planar polygon (N, 3) of any shape; they face `normal` (3,)."""
    flat = np.ascontiguousarray(np.delete(points, int(np.argmax(np.abs(normal))), axis=1))
    found = mapbox_earcut.triangulate_float64(flat, np.array([len(flat)], dtype=np.uint32))
    faces: Int64Array = found.reshape(-1, 3).astype(np.int64)
    a, b, c = (points[faces[:, corner]] for corner in range(3))
    turned = np.cross(b - a, c - a) @ normal < 0
    faces[turned] = faces[turned][:, ::-1]
    return faces


def cleaned(mesh: Mesh, where: str) -> tuple[Mesh, int]:
    """Return the mesh without zero-area triangles, and the number of removed triangles.

    Raises `InputError` for NaN or infinite vertices and for indices beyond the vertex list.
    """
    if len(mesh.faces) > MAX_TRIANGLES:
        raise InputError(f"{where}: {len(mesh.faces):,} triangles; at most {MAX_TRIANGLES:,}")
    if mesh.faces.size and (mesh.faces.min() < 0 or mesh.faces.max() >= len(mesh.vertices)):
        raise InputError(f"{where}: a face refers to a vertex that does not exist")
    bad = ~np.isfinite(mesh.vertices).all(axis=1)
    if bad.any():
        raise InputError(
            f"{where}: vertex {int(np.argmax(bad))} is not a finite number "
            f"({int(bad.sum())} such vertices); repair the mesh"
        )
    farthest = float(np.abs(mesh.vertices).max(initial=0.0))
    if farthest > FARTHEST:
        raise InputError(f"{where}: a vertex lies {farthest:.3g} units away; repair the mesh")
    areas, _ = face_areas(mesh.corners)
    keep = areas > 0
    normals, uvs = mesh.normals, mesh.uvs
    if normals is not None:
        length = np.linalg.norm(normals, axis=1)
        if not np.isfinite(normals).all() or (length < 1e-12).any():
            normals = smooth_normals(mesh.vertices, mesh.faces)
        else:
            normals = normals / length[:, None]
    if uvs is not None:
        uvs = np.where(np.abs(uvs) < FARTHEST_UV, uvs, 0.0)  # NaN compares false
    dropped = int((~keep).sum())
    mesh = Mesh(mesh.vertices, mesh.faces, normals, uvs)
    return (mesh.subset(keep) if dropped else mesh), dropped


def smooth_normals(vertices: Float64Array, faces: Int64Array) -> Float64Array:
    """Return vertex normals (V, 3) weighted by corner angles (Thürmer and Wüthrich 1998)."""
    corners = vertices[faces]
    _, face = face_areas(corners)
    normals = np.zeros_like(vertices)
    for corner in range(3):
        weighted = face * _corner_angle(corners, corner)[:, None]
        for axis in range(3):
            normals[:, axis] += np.bincount(
                faces[:, corner], weighted[:, axis], minlength=len(vertices)
            )
    return _unit(normals)


def creased(mesh: Mesh, degrees: float) -> Mesh:
    """Return a mesh with normals smooth across edges up to `degrees`, creased elsewhere.

    Mitsuba's `maxSmoothAngle`; no vertex is shared in the result.
    """
    corners = mesh.corners
    _, face = face_areas(corners)
    weights = np.stack([_corner_angle(corners, corner) for corner in range(3)], axis=1).ravel()
    keys = mesh.vertices if mesh.uvs is None else np.hstack([mesh.vertices, mesh.uvs])
    _, group = np.unique(keys, axis=0, return_inverse=True)
    corner_group = group.reshape(-1)[mesh.faces].ravel()
    owner = np.repeat(np.arange(len(mesh.faces)), 3)
    order = np.argsort(corner_group, kind="stable")
    sizes = np.bincount(corner_group)
    sizes = sizes[sizes > 0]
    if int((sizes.astype(np.int64) ** 2).sum()) > 200_000_000:
        return replace(mesh, normals=smooth_normals(mesh.vertices, mesh.faces))
    # All pairs (a, b) of corners at the same point; the normal of a sums those of b. Rows of
    # corners are taken in pieces, because a few points may have all corners of a mesh.
    size_of = np.repeat(sizes, sizes)
    start_of = np.repeat(np.concatenate([[0], np.cumsum(sizes)[:-1]]), sizes)
    piece_of = np.cumsum(size_of) // _PAIRS
    cosine = np.cos(np.radians(degrees)) - 1e-9
    normals = np.zeros((len(owner), 3))
    for rows in np.split(np.arange(len(order)), np.flatnonzero(np.diff(piece_of)) + 1):
        counts = size_of[rows]
        first = np.repeat(rows, counts)
        offset = np.arange(len(first)) - np.repeat(np.cumsum(counts) - counts, counts)
        second = np.repeat(start_of[rows], counts) + offset
        a, b = order[first], order[second]
        near = (face[owner[a]] * face[owner[b]]).sum(axis=1) >= cosine
        a, b = a[near], b[near]
        for axis in range(3):
            normals[:, axis] += np.bincount(a, face[owner[b]][:, axis] * weights[b], len(owner))
    flat = mesh.faces.ravel()
    return Mesh(
        mesh.vertices[flat],
        np.arange(len(flat)).reshape(-1, 3),
        _unit(normals),
        None if mesh.uvs is None else mesh.uvs[flat],
    )


def _corner_angle(corners: Float64Array, corner: int) -> Float64Array:
    here = corners[:, corner]
    one = _unit(corners[:, (corner + 1) % 3] - here)
    two = _unit(corners[:, (corner + 2) % 3] - here)
    return np.arccos(np.clip((one * two).sum(axis=1), -1, 1))


def _unit(vectors: Float64Array) -> Float64Array:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    fallback = np.zeros_like(vectors)
    fallback[..., 2] = 1.0
    return np.where(length > 1e-20, vectors / np.maximum(length, 1e-20), fallback)
