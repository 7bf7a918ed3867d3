"""Covering boxes and support surfaces of a mesh.

Both are computed on a grid from triangles that are subdivided until they are smaller than a cell.
Local frame: metres, Z up, centre of the footprint at the origin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pbrnet.scenes.arrays import BoolArray, Float64Array, Int64Array
from pbrnet.scenes.geometry.mesh import face_areas

MAX_BOXES = 160
_MAX_TRIANGLES = 1_000_000
_FLAT_NORMAL = 0.995  # least |z| of the unit normals of a support surface
_UNEVENNESS = 0.003  # metres, tolerance of its height
_HEADROOM = 0.1  # metres, least free height above it
_MIN_SIDE = 0.08  # metres, least length of its shorter side
_MAX_SURFACES = 8
_CLOSED_FRONT = 0.3  # greatest share of its front that may be covered


@dataclass(frozen=True)
class SupportSurface:
    """A horizontal rectangle on which other pieces can stand.

    Centre x, y, height z, half the sides along x and y, and free height above, metres.
    """

    x: float
    y: float
    z: float
    half_x: float
    half_y: float
    headroom: float = 10.0


def subdivide_triangles(corners: Float64Array, size: float) -> tuple[Float64Array, Int64Array]:
    """Subdivide triangles (F, 3, 3) until none extends more than `size` along any axis.

    Returns the small triangles (N, 3, 3) and the index (N,) of the original triangle of each.
    Stops before there are more than a million.
    """
    # Separate arrays of corners: NumPy is slow along axes of length three.
    a, b, c = (np.ascontiguousarray(corners[:, corner]) for corner in range(3))
    owners = np.arange(len(corners))
    done = []
    count = 0
    while len(a):
        span = np.maximum(np.maximum(a, b), c) - np.minimum(np.minimum(a, b), c)
        large = (span[:, 0] > size) | (span[:, 1] > size) | (span[:, 2] > size)
        if count + len(a) + int(large.sum()) > _MAX_TRIANGLES:
            large[:] = False
        fine = ~large
        done.append((np.stack([a[fine], b[fine], c[fine]], axis=1), owners[fine]))
        count += int(fine.sum())
        a, b, c, owners = a[large], b[large], c[large], owners[large]
        # Rotate the corners so that the longest edge is ab, and split it in the middle.
        ab, bc, ca = (_squares(end - start) for start, end in ((a, b), (b, c), (c, a)))
        by_bc = ((bc > ab) & (bc >= ca))[:, None]
        by_ca = ((ca > ab) & (ca > bc))[:, None]
        a, b, c = (
            np.where(by_bc, b, np.where(by_ca, c, a)),
            np.where(by_bc, c, np.where(by_ca, a, b)),
            np.where(by_bc, a, np.where(by_ca, b, c)),
        )
        middle = 0.5 * (a + b)
        a, b, c = (
            np.concatenate([a, middle]),
            np.concatenate([middle, b]),
            np.concatenate([c, c]),
        )
        owners = np.concatenate([owners, owners])
    return np.concatenate([part for part, _ in done]), np.concatenate([own for _, own in done])


def _squares(vectors: Float64Array) -> Float64Array:
    return vectors[:, 0] ** 2 + vectors[:, 1] ** 2 + vectors[:, 2] ** 2


def covering_boxes(corners: Float64Array) -> Float64Array:
    """Return at most `MAX_BOXES` boxes (N, 2, 3) that together cover the triangles (F, 3, 3)."""
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    cell = float(np.clip((high - low).max() / 40, 0.02, 0.5))
    while True:
        boxes = _merge_cells(_occupied_cells(corners, low, high, cell)) * cell + low
        if len(boxes) <= MAX_BOXES:
            return np.clip(boxes, low, high)
        cell *= 1.5


def _occupied_cells(
    corners: Float64Array, low: Float64Array, high: Float64Array, cell: float
) -> BoolArray:
    shape = np.maximum(np.ceil((high - low) / cell - 1e-9).astype(int), 1)
    small, _ = subdivide_triangles(corners, 0.5 * cell)
    a, b, c = (small[:, corner] for corner in range(3))
    ends = np.stack([np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)])
    index = np.clip(np.floor((ends - low) / cell).astype(int), 0, shape - 1)
    filled = np.zeros(shape, dtype=bool)
    # A triangle this small touches only cells that contain a corner of its bounding box.
    for x, y, z in np.ndindex(2, 2, 2):
        filled[index[x, :, 0], index[y, :, 1], index[z, :, 2]] = True
    return filled


def _merge_cells(filled: BoolArray) -> Float64Array:
    """Merge occupied cells into boxes (N, 2, 3), in cells, grown along x, then y, then z."""
    left = filled.copy()
    boxes = []
    for i, j, k in np.argwhere(filled):
        if not left[i, j, k]:
            continue
        end = [i + 1, j + 1, k + 1]
        while end[0] < left.shape[0] and left[end[0], j, k]:
            end[0] += 1
        while end[1] < left.shape[1] and left[i : end[0], end[1], k].all():
            end[1] += 1
        while end[2] < left.shape[2] and left[i : end[0], j : end[1], end[2]].all():
            end[2] += 1
        left[i : end[0], j : end[1], k : end[2]] = False
        boxes.append([[i, j, k], end])
    return np.array(boxes, dtype=np.float64).reshape(-1, 2, 3)


def support_surfaces(corners: Float64Array, drop: float | None) -> tuple[SupportSurface, ...]:
    """Find the support surfaces of a piece with triangles (F, 3, 3); the one at `drop` is first.

    `drop` is the height in metres that the catalogue gives; None means that nothing stands on the
    piece, and the result is empty.
    """
    if drop is None:
        return ()
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    cell = float(np.clip((high - low)[:2].max() / 60, 0.01, 0.1))
    small, owner = subdivide_triangles(corners, 0.5 * cell)
    points = (small[:, 0] + small[:, 1] + small[:, 2]) / 3
    areas, normals = face_areas(corners)
    is_flat = np.abs(normals[:, 2]) > _FLAT_NORMAL
    heights = corners[is_flat][:, :, 2].mean(axis=1)
    bins = np.round(heights / (2 * _UNEVENNESS)).astype(np.int64)
    found, inverse = np.unique(bins, return_inverse=True)
    weights = np.bincount(inverse.reshape(-1), areas[is_flat], minlength=len(found))
    worth = [k for k in np.argsort(-weights, kind="stable") if weights[k] > _MIN_SIDE**2]
    # The height from the catalogue first, then by area.
    worth.sort(key=lambda k: (abs(2 * _UNEVENNESS * found[k] - drop) > 0.015, -weights[k]))
    shape = np.maximum(np.ceil((high - low)[:2] / cell).astype(int), 1)
    cells = np.clip(np.floor((points[:, :2] - low[:2]) / cell).astype(int), 0, shape - 1)
    flat_cell = cells[:, 0] * shape[1] + cells[:, 1]
    made: list[SupportSurface] = []
    for k in worth[: 2 * _MAX_SURFACES]:
        z = float(2 * _UNEVENNESS * found[k])
        surface = _surface_at(points[:, 2], flat_cell, is_flat[owner], z, shape, cell, low)
        if surface is not None and all(abs(surface.z - other.z) > 0.02 for other in made):
            made.append(surface)
    return tuple(made[:_MAX_SURFACES])


def _surface_at(
    heights: Float64Array,
    cells: Int64Array,
    is_flat: BoolArray,
    z: float,
    shape: Int64Array,
    cell: float,
    low: Float64Array,
) -> SupportSurface | None:
    """Largest free rectangle at height `z`; `cells` are the grid columns of the triangles.

    None if it is too small or behind a closed front.
    """
    count = int(shape.prod())
    at_level = is_flat & (np.abs(heights - z) <= 1.5 * _UNEVENNESS)
    held = np.bincount(cells[at_level], minlength=count) > 0
    tops = np.full(count, -np.inf)
    np.maximum.at(tops, cells[at_level], heights[at_level])
    above = np.full(count, np.inf)
    over = heights > z + 1.5 * _UNEVENNESS
    np.minimum.at(above, cells[over], heights[over])
    free = (held & (above - z > _HEADROOM)).reshape(shape)
    x0, x1, y0, y1 = _largest_rectangle(free)
    if min(x1 - x0, y1 - y0) * cell < _MIN_SIDE:
        return None
    inside = np.zeros(tuple(shape), dtype=bool)
    inside[x0:x1, y0:y1] = True
    chosen = inside.ravel()
    top = float(tops[chosen].max())
    column = cells // shape[1]
    before = (column >= x0) & (column < x1) & (cells % shape[1] < y1) & (heights > z + 0.02)
    if np.isfinite(above[chosen]).any():
        # Something is above: a closed cupboard, unless most of the front is open.
        before &= heights < above[chosen].min() - 0.01
        if len(np.unique(column[before])) > _CLOSED_FRONT * (x1 - x0):
            return None
    first, last = low[:2] + cell * np.array([x0, y0]), low[:2] + cell * np.array([x1, y1])
    half = 0.5 * (last - first) - 0.25 * cell
    centre = 0.5 * (first + last)
    headroom = float(min(above[chosen].min() - top - 0.005, 10.0))
    return SupportSurface(
        float(centre[0]), float(centre[1]), top, float(half[0]), float(half[1]), headroom
    )


def _largest_rectangle(free: BoolArray) -> tuple[int, int, int, int]:
    """x0, x1, y0, y1 of the largest all-true rectangle of a grid; zeros if there is none."""
    best, where = 0, (0, 0, 0, 0)
    run = np.zeros(free.shape[1], dtype=int)
    for x in range(free.shape[0]):
        run = np.where(free[x], run + 1, 0)
        stack: list[tuple[int, int]] = []  # (first y, run length), lengths increase
        for y, length in enumerate([*run.tolist(), 0]):
            start = y
            while stack and stack[-1][1] >= length:
                start, tall = stack.pop()
                if tall * (y - start) > best:
                    best, where = tall * (y - start), (x + 1 - tall, x + 1, start, y)
            if length:
                stack.append((start, length))
    return where
