"""Walls around doors and windows that stand in gaps between walls, as sketches draw them.

A gap that a door fills is a doorway: rooms end there, and a lintel closes it up to the ceiling. A
gap in the lining of a wall that has the window itself is a recess, and stays.

Plan coordinates, centimetres.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely
from shapely.geometry import LineString

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.geometry.regions import buffered, difference, union
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.sweethome.building.levels import Storey
from pbrnet.scenes.sweethome.building.openings import Opening
from pbrnet.scenes.sweethome.building.outlines import has_length
from pbrnet.scenes.sweethome.home import Wall

_BESIDE = 25.0  # beyond the sides of a door, up to which walls end beside it
_FREE = 0.6  # of a door's width, around its middle, without a wall
_BEFORE = 15.0  # in front of or behind a door, up to which the line of the walls lies
_PARALLEL = 0.98  # least cosine between a door and the wall that ends beside it
_INTO = 1.0  # by which the added wall reaches into what it ends at


def with_walls_at_doors(storey: Storey, openings: list[Opening], changes: Changes) -> Storey:
    """Return the storey with a wall in each gap between walls that an opening fills.

    It continues the wall that ends beside the opening, which then cuts it.
    """
    straight = [wall for wall in storey.walls if not wall.arc and has_length(wall)]
    regions = [
        buffered(LineString([wall.start, wall.end]), 0.5 * wall.thickness, cap_style="flat")
        for wall in straight
    ]
    tree = shapely.STRtree(regions)
    added: list[Wall] = []
    for opening in openings:
        if opening.is_in_wall([regions[near] for near in tree.query(opening.footprint)]):
            continue
        for wall in straight:
            depth = _depth_beside(opening, wall)
            ends = None if depth is None else _gap(opening, depth, regions, tree)
            if ends is not None:
                is_along = (np.subtract(wall.end, wall.start) @ opening.across) > 0
                start, end = ends if is_along else ends[::-1]
                name = f"{wall.id}-at-door-{len(added)}"
                added.append(
                    replace(
                        wall, id=name, start=start, end=end, wall_at_start=None, wall_at_end=None
                    )
                )
                changes.note(
                    "gaps between walls around doors and windows were closed: {}",
                    opening.piece.name,
                )
                break
    return replace(storey, walls=(*storey.walls, *added)) if added else storey


def _depth_beside(opening: Opening, wall: Wall) -> float | None:
    """The depth in an opening's frame of the line of a wall that ends beside it; else None."""
    piece = opening.piece
    along = np.subtract(wall.end, wall.start)
    ends = np.array([wall.start, wall.end]) - opening.centre
    across, depths = ends @ opening.across, ends @ opening.out
    near = int(np.argmin(np.abs(across)))
    if (
        abs(along @ opening.across) < _PARALLEL * float(np.linalg.norm(along))
        or across[0] * across[1] <= 0
        or not 0.5 * _FREE * piece.width <= abs(across[near]) <= 0.5 * piece.width + _BESIDE
        or abs(depths[near]) > 0.5 * piece.depth + _BEFORE
        or (wall.height is not None and wall.height < piece.elevation + piece.height)
    ):
        return None
    return float(depths[near])


def _gap(
    opening: Opening, depth: float, regions: list[shapely.Polygon], tree: shapely.STRtree
) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """The ends of the gap between walls along an opening, at a depth in its frame; else None."""
    reach = 0.5 * opening.piece.width + _BESIDE
    line = LineString([opening.at(-reach, depth), opening.at(reach, depth)])
    near = [regions[number] for number in sorted(tree.query(line).tolist())]
    free = shapely.get_parts(difference(line, union(near))).tolist()
    for part in (each for each in free if not each.is_empty):
        along = (np.asarray(part.coords) - opening.centre) @ opening.across
        low, high = float(along.min()), float(along.max())
        if (
            -reach < low - _INTO
            and low <= -0.5 * _FREE * opening.piece.width
            and high >= 0.5 * _FREE * opening.piece.width
            and high + _INTO < reach
        ):
            return _place(opening.at(low - _INTO, depth)), _place(opening.at(high + _INTO, depth))
    return None


def _place(point: Float64Array) -> tuple[float, float]:
    return float(point[0]), float(point[1])
