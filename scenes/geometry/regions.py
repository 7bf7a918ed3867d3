"""Boolean operations and buffers of polygons that end for every finite input.

GEOS computes overlays in floating point and raises `GEOSException` where nearly coincident edges,
common in scenes by other people, contradict each other. Every operation here is tried exactly
first. If that fails, both operands are made valid, then rounded to ever coarser grids, relative to
their extent; on a grid, GEOS's snap-rounding overlay is robust (Hobby, *Practical Segment
Intersection with Finite Precision Output*, 1999). An operation that fails on all grids, as for
coordinates near the largest float, returns a region that its docstring states.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Literal

import numpy as np
import numpy.typing as npt
import shapely
from shapely.errors import GEOSException
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from pbrnet.scenes.arrays import Float64Array

_GRIDS = (1e-11, 1e-9, 1e-7, 1e-5, 1e-3)  # cell sizes, in extents of the operands

Join = Literal["round", "mitre", "bevel"]
Cap = Literal["round", "square", "flat"]


def union(regions: Iterable[BaseGeometry]) -> BaseGeometry:
    """The union of regions. One that no grid can join is left out; no region gives an empty one."""
    found = list(regions)

    def united(parts: list[BaseGeometry], grid: float | None) -> BaseGeometry:
        return shapely.union_all(parts, grid_size=grid)

    whole = _robust(united, found)
    if whole is None:
        whole = Polygon()
        for region in found:
            step = _robust(united, [whole, region])
            whole = whole if step is None else step
    return whole


def difference(first: BaseGeometry, second: BaseGeometry) -> BaseGeometry:
    """`first` without `second`; `first` itself where no grid helps."""
    made = _robust(lambda pair, grid: shapely.difference(*pair, grid_size=grid), [first, second])
    return first if made is None else made


def intersection(first: BaseGeometry, second: BaseGeometry) -> BaseGeometry:
    """The part that two regions share; nothing where no grid helps."""
    made = _robust(lambda pair, grid: shapely.intersection(*pair, grid_size=grid), [first, second])
    return Polygon() if made is None else made


def symmetric_difference(first: BaseGeometry, second: BaseGeometry) -> BaseGeometry:
    """The part that belongs to one of two regions only; `first` where no grid helps."""
    made = _robust(
        lambda pair, grid: shapely.symmetric_difference(*pair, grid_size=grid), [first, second]
    )
    return first if made is None else made


def buffered(
    region: BaseGeometry,
    distance: float,
    *,
    join_style: Join = "round",
    cap_style: Cap = "round",
    mitre_limit: float = 5.0,
    quad_segs: int = 16,
) -> BaseGeometry:
    """The region grown by `distance`, shrunk if it is negative; itself where no grid helps.

    Styles are those of `shapely.buffer`.
    """

    def grown(parts: list[BaseGeometry], grid: float | None) -> BaseGeometry:
        made = shapely.buffer(
            parts[0],
            distance,
            quad_segs=quad_segs,
            cap_style=cap_style,
            join_style=join_style,
            mitre_limit=mitre_limit,
        )
        return made if grid is None else shapely.set_precision(made, grid)

    made = _robust(grown, [region])
    return region if made is None else made


def thickened(
    shapes: Sequence[BaseGeometry] | npt.NDArray[np.object_],
    half_width: float,
    *,
    cap_style: Cap = "round",
    quad_segs: int = 8,
) -> BaseGeometry:
    """The union of lines and polygons, each grown by `half_width`.

    `shapes` is a sequence or array of geometries. Growing each before the union is a hundred times
    as fast as growing the union of lines.
    """
    try:
        grown = shapely.buffer(shapes, half_width, quad_segs=quad_segs, cap_style=cap_style)
    except GEOSException:
        grown = [
            buffered(shape, half_width, quad_segs=quad_segs, cap_style=cap_style)
            for shape in shapes
        ]
    return union(grown)


def simplified(region: BaseGeometry, tolerance: float) -> BaseGeometry:
    """The region with fewer corners, moved by up to `tolerance`; itself where that fails."""
    made = _robust(lambda parts, _: shapely.simplify(parts[0], tolerance), [region])
    return region if made is None else made


def on_grid(region: BaseGeometry, grid: float) -> BaseGeometry:
    """The region with its corners on a grid of `grid` wide cells, without spikes and slivers.

    The region itself where that fails.
    """
    made = _robust(lambda parts, _: shapely.set_precision(parts[0], grid), [region])
    return region if made is None else made


def valid(region: BaseGeometry) -> BaseGeometry:
    """The region with crossings and overlaps of its outline resolved (even-odd rule).

    Its convex hull where that fails.
    """
    if region.is_valid:
        return region
    try:
        return shapely.make_valid(region)
    except GEOSException:
        return shapely.convex_hull(region)


def deepest_point(region: BaseGeometry, tolerance: float | None = None) -> Float64Array:
    """The point (2,) of a region that is farthest from its outline, to `tolerance`.

    A corner if the region has no area.
    """
    try:
        found = shapely.maximum_inscribed_circle(region, tolerance).coords
    except GEOSException:
        found = shapely.get_coordinates(region)[:1]
    return np.array(found[0], dtype=np.float64)


def polygon_parts(region: BaseGeometry) -> list[Polygon]:
    """The polygons among the parts of a region, without empty ones, in GEOS's order."""
    found = [part for part in shapely.get_parts(region).tolist() if isinstance(part, Polygon)]
    return [part for part in found if not part.is_empty]


def largest_part(region: BaseGeometry) -> Polygon:
    """The polygon of the greatest area among the parts of a region; empty if there is none."""
    return max(polygon_parts(region), key=lambda part: part.area, default=Polygon())


def meets(first: BaseGeometry, second: BaseGeometry) -> bool:
    """Return whether two regions share a point; by their bounds where GEOS cannot tell."""
    try:
        return bool(shapely.intersects(first, second))
    except GEOSException:
        a, b = first.bounds, second.bounds
        return bool(a[0] <= b[2] and b[0] <= a[2] and a[1] <= b[3] and b[1] <= a[3])


def covers(first: BaseGeometry, second: BaseGeometry) -> bool:
    """Return whether `second` lies in `first`, their outlines included; False if GEOS fails."""
    try:
        return bool(shapely.covers(first, second))
    except GEOSException:
        return False


def _robust(
    operation: Callable[[list[BaseGeometry], float | None], BaseGeometry],
    operands: list[BaseGeometry],
) -> BaseGeometry | None:
    """The result of `operation(operands, grid_size)`; None if it fails on every grid."""
    try:
        return operation(operands, None)
    except GEOSException:
        pass
    repaired = [valid(each) for each in operands]
    for grid in (None, *(share * _extent(repaired) for share in _GRIDS)):
        if grid == 0 or (grid is not None and not np.isfinite(grid)):
            continue
        try:
            return operation([_on_grid(each, grid) for each in repaired], grid)
        except GEOSException:
            continue
    return None


def _on_grid(region: BaseGeometry, grid: float | None) -> BaseGeometry:
    return region if grid is None else shapely.set_precision(region, grid)


def _extent(regions: list[BaseGeometry]) -> float:
    """The larger side of the common bounds of regions; 0 if all are empty."""
    west, south, east, north = shapely.total_bounds(np.array(regions, dtype=object))
    return float(max(east - west, north - south)) if np.isfinite(west) else 0.0
