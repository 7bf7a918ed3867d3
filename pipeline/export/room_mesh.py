"""Triangles of a room within a budget: cut out of the scene, simplified, and split evenly.

Pure geometry; `pbrnet.pipeline.export.renderformer` takes it from a loaded scene and shades it.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
import trimesh

from pbrnet.pipeline.export.parts import library
from pbrnet.scenes.arrays import Float64Array, Int64Array
from pbrnet.scenes.contract import Room

_MARGIN = 0.35  # metres around a room that belong to it: the thickness of its walls
_LEAST = 4  # triangles that a simplified shape keeps
_FOR_SHAPES = 0.6  # of the budget; the rest splits large triangles
_LEAST_AREA = 1e-8  # square metres


@dataclass(frozen=True)
class Soup:
    """N triangles: `corners` (N, 3, 3) in world metres, and the shape that each is of, (N,)."""

    corners: Float64Array
    shape: Int64Array

    def __len__(self) -> int:
        return len(self.corners)

    @property
    def normals(self) -> Float64Array:
        """Unit geometric normals (N, 3)."""
        edges = self.corners[:, 1:] - self.corners[:, :1]
        normals: Float64Array = np.cross(edges[:, 0], edges[:, 1])
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        return normals / np.maximum(lengths, 1e-30)

    @property
    def areas(self) -> Float64Array:
        """Areas (N,) in square metres."""
        edges = self.corners[:, 1:] - self.corners[:, :1]
        areas: Float64Array = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
        return areas


def cut_room(meshes: Sequence[tuple[int, Float64Array, Int64Array]], room: Room) -> Soup:
    """Return the triangles of a room: of `meshes` (shape, vertices, faces), what lies within it.

    Triangles are cut at the room's bounds, widened by the thickness of walls, and those that lie
    outside of its floor's outline, equally widened, are left out.
    """
    outline = shapely.Polygon(room.floor).buffer(_MARGIN, join_style="mitre")
    west, south, east, north = outline.bounds
    low = np.array([west, south, room.floor_z - _MARGIN])
    high = np.array([east, north, room.ceiling_z + _MARGIN])
    corners, shapes = [np.zeros((0, 3, 3))], [np.zeros(0, np.int64)]
    for shape, vertices, faces in meshes:
        if (vertices.max(axis=0) < low).any() or (vertices.min(axis=0) > high).any():
            continue
        mesh = trimesh.Trimesh(vertices, faces, process=False)
        for axis in range(3):
            for bound, sign in ((low, 1.0), (high, -1.0)):
                if len(mesh.faces):
                    normal = sign * np.eye(3)[axis]
                    origin = np.where(np.arange(3) == axis, bound, 0.0)
                    mesh = trimesh.intersections.slice_mesh_plane(mesh, normal, origin, cap=False)
        found = np.asarray(mesh.triangles, dtype=np.float64)
        centres = found.mean(axis=1)
        inside = shapely.contains_xy(outline, centres[:, 0], centres[:, 1])
        corners.append(found[inside])
        shapes.append(np.full(int(inside.sum()), shape))
    soup = Soup(np.concatenate(corners), np.concatenate(shapes))
    large = soup.areas > _LEAST_AREA
    return Soup(soup.corners[large], soup.shape[large])


def within_budget(soup: Soup, most: int) -> Soup:
    """Return `most` triangles, or fewer of tiny rooms: shapes simplified, then large ones split.

    Each shape keeps triangles in proportion to the square root of its area, but none more than it
    has. What the budget leaves splits the triangles with the longest edges.
    """
    reduced = soup
    if len(soup) > _FOR_SHAPES * most:
        reduced = _simplified(soup, int(_FOR_SHAPES * most))
    if len(reduced) > most:  # more shapes than triangles: the smallest go
        kept = np.sort(np.argsort(-reduced.areas, kind="stable")[:most])
        reduced = Soup(reduced.corners[kept], reduced.shape[kept])
    return split_longest(reduced, most)


def _simplified(soup: Soup, most: int) -> Soup:
    simplify = library("fast_simplification", "an export to RenderFormer").simplify
    shapes, counts = np.unique(soup.shape, return_counts=True)
    areas = soup.areas
    sizes = np.array([areas[soup.shape == shape].sum() for shape in shapes])
    quotas = _quotas(counts, np.sqrt(sizes), most)
    corners, owners = [], []
    for shape, count, quota in zip(shapes, counts, quotas, strict=True):
        own = soup.corners[soup.shape == shape]
        if quota < count:
            mesh = trimesh.Trimesh(own.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))
            mesh.merge_vertices()
            points, faces = simplify(
                np.asarray(mesh.vertices, np.float32),
                np.asarray(mesh.faces, np.int32),
                target_count=int(quota),
            )
            points = np.asarray(points, dtype=np.float64)
            if len(faces) > quota:  # many small parts, which cannot lose edges
                points, faces = clustered(points, np.asarray(faces, np.int64), int(quota))
            own = points[faces]
        corners.append(own)
        owners.append(np.full(len(own), shape))
    found = Soup(np.concatenate(corners), np.concatenate(owners))
    large = found.areas > _LEAST_AREA
    return Soup(found.corners[large], found.shape[large])


def clustered(
    vertices: Float64Array, faces: Int64Array, most: int
) -> tuple[Float64Array, Int64Array]:
    """Return a mesh of at most `most` faces: vertices in one cell of a grid become their mean.

    Vertex clustering (Rossignac and Borrel 1993), with cells that grow until it fits.
    """
    low = vertices.min(axis=0)
    cell = float((vertices.max(axis=0) - low).max()) / 128
    while True:
        keys = np.floor((vertices - low) / cell).astype(np.int64)
        _, number, count = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
        number = number.reshape(-1)
        found = number[faces]
        distinct = (found[:, 0] != found[:, 1]) & (found[:, 1] != found[:, 2])
        found = found[distinct & (found[:, 2] != found[:, 0])]
        _, first = np.unique(np.sort(found, axis=1), axis=0, return_index=True)
        found = found[np.sort(first)]
        if len(found) <= most:
            means = np.zeros((len(count), 3))
            np.add.at(means, number, vertices)
            return means / count[:, None], found
        cell *= 1.15


def _quotas(counts: Int64Array, weights: Float64Array, most: int) -> Int64Array:
    """Return how many triangles each shape keeps: `scale` x weight within its bounds, by bisection.

    The sum is at most `most`, or as small as the least allow.
    """
    low, high = 0.0, float(most) / max(float(weights.min()), 1e-9)
    for _ in range(60):
        scale = (low + high) / 2
        quotas = np.minimum(counts, np.maximum(_LEAST, (scale * weights).astype(np.int64)))
        low, high = (scale, high) if quotas.sum() <= most else (low, scale)
    return np.minimum(counts, np.maximum(_LEAST, (low * weights).astype(np.int64)))


def split_longest(soup: Soup, count: int) -> Soup:
    """Return `count` triangles: those with the longest edges are halved, again and again."""
    corners = list(soup.corners)
    shapes = list(soup.shape)
    if not corners:
        return soup
    queue = [(-_longest(one)[1], number) for number, one in enumerate(corners)]
    heapq.heapify(queue)
    while len(corners) < count:
        _, number = heapq.heappop(queue)
        side, _ = _longest(corners[number])
        a, b, c = np.roll(corners[number], -side, axis=0)
        middle = (a + b) / 2
        corners[number] = np.stack([a, middle, c])
        corners.append(np.stack([middle, b, c]))
        shapes.append(shapes[number])
        for half in (number, len(corners) - 1):
            heapq.heappush(queue, (-_longest(corners[half])[1], half))
    return Soup(np.array(corners), np.array(shapes))


def _longest(triangle: Float64Array) -> tuple[int, float]:
    """Return the first corner of a triangle's longest side, and that side's length."""
    lengths = np.linalg.norm(np.roll(triangle, -1, axis=0) - triangle, axis=1)
    side = int(lengths.argmax())
    return side, float(lengths[side])
