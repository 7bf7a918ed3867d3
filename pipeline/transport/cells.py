"""Irradiance cache: light of surfels by cells of space and direction, and its look-up in kernels.

A cell holds the mean of the surfels in a cube whose normals point to one of six sides. Cubes come
in levels, each four times as large as the one before. A point takes the smallest cell that holds a
surfel, or else the mean of all surfels.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from pbrnet.pipeline.render.drjit_arrays import column
from pbrnet.scenes.arrays import AnyArray, BoolArray, Float32Array, Float64Array, Int64Array

CELL = 0.25  # metres: side of the smallest cubes
LEVELS = 4  # of cubes of 0.25, 1, 4 and 16 metres
_GROWTH = 4
_BITS = 9  # of a cube's number along an axis; what lies outside belongs to the outermost cubes
_MOST = (1 << _BITS) - 1
_SIZE_BITS = 17  # a kernel's table holds less than 2^17 cells
_UNUSED = 0xFFFFFFFF


def max_surfels() -> int:
    """Return the largest number of surfels whose cells fit into a table."""
    return ((1 << _SIZE_BITS) - 1) // LEVELS


@dataclass(frozen=True)
class Cells:
    """Cells that surfels fill. Points are (N, 3), world metres, normals (N, 3)."""

    origin: Float32Array  # (3,): corner of the grid
    keys: AnyArray  # uint32 (C,), sorted
    members: Int64Array  # (LEVELS, M): the cells of each surfel
    measure: Float32Array  # (M,): weight of each surfel
    total: Float64Array  # (C,): weight of the surfels in each cell

    @property
    def is_fine(self) -> BoolArray:
        """Mask of the cells (C + 1,) of the two smallest sizes; the last one is none."""
        return np.append(self.keys >> np.uint32(3 * _BITS + 3) < 2, False)

    @classmethod
    def of(
        cls, points: Float32Array, normals: Float32Array, measure: Float32Array, centre: AnyArray
    ) -> Cells:
        """Return the cells of surfels of these weights, in a grid around `centre` (3,)."""
        half = np.float32(CELL * (1 << (_BITS - 1)))
        origin = np.asarray(centre, dtype=np.float32) - half
        keys, members = np.unique(_keys(points, normals, origin), return_inverse=True)
        members = members.reshape(LEVELS, len(points))
        weights = np.tile(measure.astype(np.float64), LEVELS)
        total = np.bincount(members.ravel(), weights, len(keys)).astype(np.float64)
        return cls(origin, keys, members, measure, total)

    def find(self, points: Float32Array, normals: Float32Array) -> Int64Array:
        """Return the cell of each point (N,); the number of cells where none is found."""
        cell = np.full(len(points), len(self.keys), dtype=np.int64)
        missing = np.arange(len(points))
        for wanted in _keys(points, normals, self.origin):
            keys = wanted[missing]
            place = np.minimum(np.searchsorted(self.keys, keys), len(self.keys) - 1)
            found = self.keys[place] == keys
            cell[missing[found]] = place[found]
            missing = missing[~found]
        return cell

    def means(self, light: Float32Array) -> Float32Array:
        """Return the means over each cell's surfels of light (M, N): (C + 1, N).

        The last row is the mean of all surfels.
        """
        cells = len(self.keys)
        weighted = light * self.measure[:, None]
        sums = [
            sum(np.bincount(row, band, cells) for row in self.members)
            for band in np.ascontiguousarray(weighted.T)
        ]
        means = np.stack(sums, axis=1) / self.total[:, None]
        mean = weighted.sum(axis=0, keepdims=True, dtype=np.float64) / self.measure.sum()
        return np.concatenate([means, mean]).astype(np.float32)


@dataclass(init=False, eq=False)
class LightTable:
    """Light by cell in a kernel; a dataclass, so that Dr.Jit finds its arrays."""

    keys: mi.UInt32  # sorted
    irradiance: mi.Float  # over pi, three bands a cell; the last entry is for all surfels
    radiosity: mi.Float  # likewise: what the surfels reflect
    large: mi.UInt32  # likewise: 1 where `radiosity` is without direct light
    origin: list[mi.Float]

    def __init__(self, cells: Cells) -> None:
        keys = np.full(1 << _SIZE_BITS, _UNUSED, dtype=np.uint32)
        keys[: len(cells.keys)] = cells.keys
        self.keys = column(mi.UInt32, keys)
        dark = np.zeros((len(cells.keys) + 1, 3), dtype=np.float32)
        self.fill(dark, dark)
        large = np.ones((1 << _SIZE_BITS) + 1, dtype=np.uint32)
        large[: len(cells.keys)] = ~cells.is_fine[:-1]
        self.large = column(mi.UInt32, large)
        self.origin = [dr.opaque(mi.Float, float(side)) for side in cells.origin]

    def fill(self, irradiance: Float32Array, radiosity: Float32Array) -> None:
        """Set the light of the cells, (C + 1, 3) each; before, they are dark."""
        self.irradiance, self.radiosity = _table(irradiance), _table(radiosity)

    def find(
        self, position: mi.Point3f, shift: mi.Vector3f, normal: mi.Vector3f, active: mi.Bool
    ) -> mi.UInt32:
        """Return the entry of surface points, `mi.UInt32`.

        The smallest cell at `position` + `shift` counts; if no surfel is there, as behind the edge
        of a wall, the smallest cell at `position` that holds one.
        """
        side = _side(normal)

        def step(
            missing: mi.Bool, entry: mi.UInt32, place: mi.Point3f, level: mi.UInt32, scale: mi.Float
        ) -> tuple[mi.Bool, mi.UInt32, mi.Point3f, mi.UInt32, mi.Float]:
            key = mi.UInt32(level << (3 * _BITS + 3)) | side
            for axis in range(3):
                number = mi.UInt32(dr.clip((place[axis] - self.origin[axis]) * scale, 0, _MOST))
                key |= number << ((2 - axis) * _BITS + 3)
            found = mi.UInt32(0)
            for bit in reversed(range(_SIZE_BITS)):
                further = found + (1 << bit)
                before = dr.gather(mi.UInt32, self.keys, further - 1, missing)
                found = dr.select(before < key, further, found)
            hit = missing & (dr.gather(mi.UInt32, self.keys, found, missing) == key)
            entry = dr.select(hit, found, entry)
            again = dr.any(place != position)
            level = dr.select(again, level, level + 1)
            scale = dr.select(again, scale, scale * (1 / _GROWTH))
            missing = missing & ~hit & (level < LEVELS)
            return missing, entry, mi.Point3f(position), level, scale

        width = dr.width(position)
        state = (
            mi.Bool(active),
            dr.full(mi.UInt32, 1 << _SIZE_BITS, width),
            mi.Point3f(position + shift),
            dr.zeros(mi.UInt32, width),
            dr.full(mi.Float, 1 / CELL, width),
        )
        return dr.while_loop(
            state,
            cond=lambda missing, entry, place, level, scale: missing,
            body=step,
            labels=("missing", "entry", "place", "level", "scale"),
        )[1]


def _table(light: Float32Array) -> mi.Float:
    """Return the light of cells (C + 1, 3) as a table with a fixed number of entries."""
    table = np.zeros(((1 << _SIZE_BITS) + 1, 3), dtype=np.float32)
    table[: len(light) - 1], table[-1] = light[:-1], light[-1]
    return column(mi.Float, table.ravel())


def _keys(points: Float32Array, normals: Float32Array, origin: Float32Array) -> AnyArray:
    """Return the keys of the points' cells at every level, uint32 (LEVELS, N)."""
    size = np.abs(normals)
    axis = np.where(
        (size[:, 0] >= size[:, 1]) & (size[:, 0] >= size[:, 2]),
        0,
        np.where(size[:, 1] >= size[:, 2], 1, 2),
    )
    positive = np.take_along_axis(normals, axis[:, None], axis=1)[:, 0] > 0
    side = (2 * axis + positive).astype(np.uint32)
    keys = np.empty((LEVELS, len(points)), dtype=np.uint32)
    for level in range(LEVELS):
        scale = np.float32(1 / (CELL * _GROWTH**level))
        cube = np.clip((points - origin) * scale, 0, _MOST).astype(np.uint32)
        packed = (cube[:, 0] << (2 * _BITS)) | (cube[:, 1] << _BITS) | cube[:, 2]
        keys[level] = np.uint32(level << (3 * _BITS + 3)) | (packed << 3) | side
    return keys


def _side(normal: mi.Vector3f) -> mi.UInt32:
    """Return which of six sides a normal points to, `mi.UInt32`; as in `_keys`."""
    size = dr.abs(normal)
    along_x = (size.x >= size.y) & (size.x >= size.z)
    axis = dr.select(along_x, 0, dr.select(size.y >= size.z, 1, 2))
    largest = dr.select(axis == 0, normal.x, dr.select(axis == 1, normal.y, normal.z))
    return mi.UInt32(2 * axis) + dr.select(largest > 0, mi.UInt32(1), mi.UInt32(0))
