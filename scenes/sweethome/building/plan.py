"""Plan of a home: each storey with its walls, openings, spaces and ceiling heights."""

from __future__ import annotations

from dataclasses import dataclass

import shapely
from shapely.geometry import Polygon

from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.sweethome.building.door_gaps import with_walls_at_doors
from pbrnet.scenes.sweethome.building.levels import Storey, storeys
from pbrnet.scenes.sweethome.building.openings import Opening, opening_of
from pbrnet.scenes.sweethome.building.outlines import is_round
from pbrnet.scenes.sweethome.building.slabs import CeilingHeights, build_slabs, stairwells
from pbrnet.scenes.sweethome.building.spaces import Space, find_spaces
from pbrnet.scenes.sweethome.building.walls import PlannedWall, build_walls, plan_walls
from pbrnet.scenes.sweethome.furnishing.items import PlacedItem
from pbrnet.scenes.sweethome.home import Home
from pbrnet.scenes.sweethome.options import SweetHomeOptions


@dataclass(frozen=True)
class Level:
    """A storey with its planned walls, openings, spaces and ceiling heights."""

    storey: Storey
    walls: list[PlannedWall]
    openings: list[Opening]
    spaces: list[Space]
    heights: CeilingHeights

    @property
    def wall_regions(self) -> list[tuple[Polygon, bool]]:
        """Region of each wall on the plan, and whether the wall is round."""
        return [(one.outline.region, is_round(one.wall)) for one in self.walls]


def planned_levels(home: Home, options: SweetHomeOptions, changes: Changes) -> list[Level]:
    made = []
    for storey in storeys(home, options.level, changes):
        openings = [
            opening
            for piece in storey.pieces
            if (opening := opening_of(piece, storey.elevation, changes)) is not None
        ]
        storey = with_walls_at_doors(storey, openings, changes)
        walls = plan_walls(storey, home.wall_height, changes)
        spaces = find_spaces(storey, walls, openings, changes)
        made.append(Level(storey, walls, openings, spaces, CeilingHeights(storey, walls, spaces)))
    return made


def building_items(levels: list[Level], changes: Changes) -> list[PlacedItem]:
    wells = stairwells(
        [(piece, level.storey.elevation) for level in levels for piece in level.storey.pieces],
        changes,
    )
    openings = [opening for level in levels for opening in level.openings]
    items: list[PlacedItem] = []
    for level in levels:
        items += build_walls(level.storey, level.walls, openings)
        items += build_slabs(level.storey, level.spaces, level.heights, wells)
    return items


def cutting_pieces(levels: list[Level]) -> set[int]:
    """Return the `id()` of each piece whose opening cuts a wall of any level."""
    walls = [wall for level in levels for wall in level.wall_regions]
    regions = [region for region, _ in walls]
    tree = shapely.STRtree(regions)
    return {
        id(opening.piece)
        for level in levels
        for opening in level.openings
        if any(
            opening.depths(regions[number], walls[number][1]) is not None
            for number in tree.query(opening.footprint)
        )
    }
