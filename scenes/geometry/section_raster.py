"""Quick test on a raster whether a section may enclose air.

Exact unions of thousands of segments take tenths of a second each, and most sections enclose
nothing. Here the segments are drawn as thick walls on a grid; only where seeds lie in cells that
are cut off from the border is the exact section worth its time. The walls are drawn thicker than
the exact ones by the diagonal of a cell, so the test errs on the side of the exact computation.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy import ndimage

from pbrnet.scenes.arrays import Float64Array, Int64Array

_CELL = 0.02  # metres
_MOST_CELLS = 250  # along a side; larger windows get larger cells
_BESIDE = 3  # cells from cut-off air at which a seed still counts
_POINTS = 200  # at most about twice as many describe a region
_LEAST_AREA = 0.01  # square metres that thick walls leave of air worth a closer look


def cut_off_regions(
    lines: Float64Array, seeds: Float64Array, half_gap: float, margin: float, least: int
) -> list[Float64Array]:
    """Regions that walls may cut off and that hold at least `least` of `seeds` (K, 2).

    `lines` (N, 2, 2) are the walls' centre lines, `half_gap` metres thick to each side. A region
    is cut off if it does not reach `margin` metres past all seeds. Returns points (M, 2) for each,
    spread evenly over it.
    """
    low, high = seeds.min(axis=0) - margin, seeds.max(axis=0) + margin
    cell = max(_CELL, float((high - low).max()) / _MOST_CELLS)
    shape = np.ceil((high - low) / cell).astype(int)
    wall = np.zeros(shape, dtype=bool)
    drawn = _drawn_cells((lines - low) / cell)
    inside = ((drawn >= 0) & (drawn < shape)).all(axis=1)
    wall[tuple(drawn[inside].T)] = True
    if not wall.any():
        return []
    reach = half_gap / cell + np.sqrt(0.5)
    labels, count = ndimage.label(ndimage.distance_transform_edt(~wall) > reach)
    labels = labels.astype(np.int64)
    cut_off = np.bincount(labels.reshape(-1), minlength=count + 1) * cell**2 >= _LEAST_AREA
    cut_off[0] = False
    for side in (labels[0], labels[-1], labels[:, 0], labels[:, -1]):
        cut_off[side] = False
    if not cut_off.any():
        return []
    around = sliding_window_view(np.pad(labels * cut_off[labels], _BESIDE), (2 * _BESIDE + 1,) * 2)
    places = np.minimum(((seeds - low) / cell).astype(int), shape - 1)
    held = np.bincount(around[tuple(places.T)].max(axis=(1, 2)), minlength=count + 1)
    found = []
    for label in np.nonzero(cut_off & (held >= least))[0].tolist():
        cells = np.argwhere(labels == label)
        found.append(low + (cells[:: 1 + len(cells) // _POINTS] + 0.5) * cell)
    return found


def _drawn_cells(lines: Float64Array) -> Int64Array:
    """Cells (M, 2) that segments (N, 2, 2), in cells, pass; a step is at most one cell."""
    span = np.abs(lines[:, 1] - lines[:, 0]).max(axis=1)
    steps = np.ceil(span).astype(np.int64) + 1
    which = np.repeat(np.arange(len(lines)), steps)
    first = np.repeat(np.cumsum(steps) - steps, steps)
    share = (np.arange(len(which)) - first) / np.maximum(steps[which] - 1, 1)
    start, end = lines[which, 0], lines[which, 1]
    return np.floor(start + share[:, None] * (end - start)).astype(np.int64)
