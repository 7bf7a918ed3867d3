"""Regions of rooms: drawn rooms, spaces enclosed by walls, and their shares of the walls.

World coordinates, metres. Each point inside a storey, walls included, belongs to at most one
room, so that floors meet under doors and floors and ceilings leave no gaps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import shapely
from shapely import STRtree
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from pbrnet.scenes.geometry.regions import buffered, difference, intersection, simplified, union
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.sweethome.building.levels import Storey
from pbrnet.scenes.sweethome.building.openings import Opening
from pbrnet.scenes.sweethome.building.outlines import polygon
from pbrnet.scenes.sweethome.building.solids import polygonal, polygons, to_world, world_region
from pbrnet.scenes.sweethome.building.walls import PlannedWall
from pbrnet.scenes.sweethome.home import RoomShape, Surface

_CRACK = 0.02  # metres: gaps between walls up to this size count as closed
_SMALLEST = 1.0  # square metres of a closed space that makes a room
_NARROW = 0.3  # metres: half the least width of such a space
_TALL = 0.7  # of the storey's height, that walls of rooms have; less under sloping roofs
_WALLED = 0.9  # of a room's area
_BEYOND = 0.1  # metres: half the width of what a room covers beyond the walls around it
_MOSTLY = 0.75  # of a space between walls
_PARTLY = 0.45  # of a room's outline, that walls with gaps follow
_NEARLY_ALL = 0.8  # of a room's outline, that walls and such rooms follow
_BESIDE = 0.12  # metres from a wall that follows the outline
CLOSING = 0.15  # metres: half of the widest wall in which a gap between two rooms is inside
_INSET = 0.01  # metres that slabs stay behind the outer faces of walls
_DOOR = 0.1  # metres: a door or window opens a space no farther away
_MANY_CORNERS = 200  # of a region, from which it is cut to the surroundings of what it meets
_SURROUNDINGS = 0.1  # metres around an area
_PLAIN_FLOOR = Surface(color=0xFFC8C2B8)
_Room = tuple[RoomShape, BaseGeometry]


@dataclass(frozen=True)
class Space:
    """A room: the visible regions of its floor and ceiling, and these with a share of the walls."""

    shape: RoomShape
    floor: BaseGeometry  # visible floor
    ceiling: BaseGeometry
    floor_slab: BaseGeometry
    ceiling_slab: BaseGeometry
    has_gaps: bool = False  # walls are missing at a part of its outline

    @property
    def is_indoors(self) -> bool:
        """True if the room has a ceiling."""
        return self.shape.ceiling_visible and not self.ceiling.is_empty


def find_spaces(
    storey: Storey, walls: list[PlannedWall], openings: list[Opening], changes: Changes
) -> list[Space]:
    """Return the rooms of a storey. Where drawn rooms overlap, the later one covers the earlier.

    Closed spaces without a drawn room are rooms too, if a door or window leads into them, or if
    the storey has neither drawn rooms nor doors. Rooms whose ceiling is hidden in the application,
    which is how its users look into a home, get one where walls of a room's height enclose them;
    terraces and galleries stay open. If walls enclose no room of a storey, as in sketches that
    draw doors and windows as gaps, walls along nearly half of a room's outline are enough.
    """
    solid = union([world_region(one.outline.region) for one in walls])
    drawn, gapped = _drawn_rooms(storey, walls, changes)
    inside = _enclosed_region(solid)
    if gapped:
        for region in (region for shape, region in drawn if shape.id in gapped):
            inside = union([inside, region])
        closed = buffered(inside, CLOSING, join_style="mitre")
        inside = buffered(closed, -CLOSING, join_style="mitre")
    doors = world_region(union([opening.footprint for opening in openings]))
    found, slivers = _closed_spaces(difference(inside, solid), drawn, doors, storey.number)
    if found:
        changes.note(
            f"closed spaces without a drawn room got a plain floor and ceiling ({len(found)})"
        )
    rooms = [*drawn, *found]
    floors = _later_wins([region if shape.floor_visible else Polygon() for shape, region in rooms])
    ceilings = _later_wins(
        [region if shape.ceiling_visible else Polygon() for shape, region in rooms]
    )
    inner = buffered(inside, -_INSET, join_style="mitre")
    floor_slabs = _extended_into_walls(floors, walls, slivers, inner)
    ceiling_slabs = _extended_into_walls(ceilings, walls, slivers, inner)
    return [
        Space(
            shape,
            floors[number],
            ceilings[number],
            floor_slabs[number],
            ceiling_slabs[number],
            shape.id in gapped,
        )
        for number, (shape, _) in enumerate(rooms)
        if not (floors[number].is_empty and ceilings[number].is_empty)
    ]


def _drawn_rooms(
    storey: Storey, walls: list[PlannedWall], changes: Changes
) -> tuple[list[_Room], set[str]]:
    """Return the drawn rooms that have an area, and the ids of those between walls with gaps.

    Hidden ceilings of rooms that walls enclose are shown.
    """
    tall = _enclosed_region(
        union([world_region(one.outline.region) for one in walls if is_tall(one, storey)])
    )
    gapped = _rooms_with_gaps(storey, walls, tall)
    solid = union([world_region(one.outline.region) for one in walls])
    drawn: list[_Room] = []
    for shape in storey.rooms:
        region, name = _region(shape), shape.name or shape.id
        if _is_walled(region, tall) and not buffered(difference(region, tall), -_BEYOND).is_empty:
            changes.note("rooms drawn across the walls around them end at the walls: {}", name)
            region = _between_walls(region, difference(tall, solid))
        if shape.id in gapped:
            changes.note(
                "rooms whose walls leave gaps got a ceiling, and openings in the gaps: {}", name
            )
            shape = replace(shape, ceiling_visible=True, floor_visible=True)
        elif not region.is_empty and not shape.ceiling_visible and _is_walled(region, tall):
            changes.note("hidden ceilings of rooms that walls enclose were shown: {}", name)
            shape = replace(shape, ceiling_visible=True, floor_visible=True)
        if region.is_empty:
            changes.note("rooms without area were left out: {}", name)
        elif shape.floor_visible or shape.ceiling_visible:
            drawn.append((shape, region))
        else:
            changes.note("rooms with neither floor nor ceiling were left out: {}", name)
    return drawn, gapped


def _closed_spaces(
    space: BaseGeometry, drawn: list[_Room], doors: BaseGeometry, level: int
) -> tuple[list[_Room], list[Polygon]]:
    """Return what is a room of the `space` between walls beside the drawn rooms, and slivers."""
    found: list[_Room] = []
    slivers = []
    is_all = not drawn and doors.is_empty
    for gap in polygons(difference(space, union([region for _, region in drawn]))):
        is_roomy = gap.area > _SMALLEST and not buffered(gap, -_NARROW).is_empty
        if is_roomy and (is_all or gap.distance(doors) < _DOOR):
            name = f"space-{level}-{len(found)}"
            shape = RoomShape(name, None, "", (), True, True, _PLAIN_FLOOR, Surface())
            found.append((shape, gap))
        elif not is_roomy:
            slivers.append(gap)
    return found, slivers


def is_tall(wall: PlannedWall, storey: Storey) -> bool:
    """Test whether a wall is as high as those of rooms; those of terraces are lower."""
    lowest = min(wall.top_at_start, wall.top_at_end) - storey.elevation
    return lowest >= _TALL * storey.height


def _rooms_with_gaps(storey: Storey, walls: list[PlannedWall], enclosed: BaseGeometry) -> set[str]:
    """Return the ids of rooms between walls with gaps, if walls enclose no room of the storey."""
    regions = {shape.id: _region(shape) for shape in storey.rooms}
    regions = {name: region for name, region in regions.items() if not region.is_empty}
    if any(shape.ceiling_visible for shape in storey.rooms) or any(
        _is_walled(region, enclosed) for region in regions.values()
    ):
        return set()
    bounds = union([world_region(one.outline.region) for one in walls if is_tall(one, storey)])

    def share(name: str) -> float:
        outline = regions[name].boundary
        return float(intersection(outline, buffered(bounds, _BESIDE)).length / outline.length)

    kept = {name for name in regions if share(name) >= _PARTLY}
    bounds = union([bounds, *(regions[name] for name in sorted(kept))])
    return kept | {name for name in regions if share(name) >= _NEARLY_ALL} if kept else set()


def _is_walled(region: BaseGeometry, enclosed: BaseGeometry) -> bool:
    """Test whether nearly all of a region lies in what tall walls enclose."""
    return bool(intersection(region, enclosed).area >= _WALLED * region.area)


def _between_walls(region: BaseGeometry, free: BaseGeometry) -> BaseGeometry:
    """Region within walls, and all of each space between them that it mostly fills."""
    cells = polygons(free)
    mostly = [cell for cell in cells if intersection(cell, region).area > _MOSTLY * cell.area]
    return union([intersection(region, free), *mostly])


def _region(shape: RoomShape) -> BaseGeometry:
    if len(shape.points) < 3:
        return Polygon()
    return polygon(to_world(shape.points))


def _enclosed_region(solid: BaseGeometry) -> BaseGeometry:
    """Return the region that walls enclose, walls included; gaps of a few cm count as closed."""
    closed = buffered(solid, _CRACK, join_style="mitre")
    whole = union([Polygon(part.exterior) for part in polygons(closed)])
    return buffered(whole, -_CRACK, join_style="mitre")


def _later_wins(regions: list[BaseGeometry]) -> list[BaseGeometry]:
    """Return each region without those after it; of copies, only the last has any left."""
    shapes = [region.wkb for region in regions]
    last = {shape: number for number, shape in enumerate(shapes)}
    kept = sorted(last.values())
    tree = STRtree([regions[number] for number in kept])
    made: list[BaseGeometry] = []
    for number, region in enumerate(regions):
        if region.is_empty:
            made.append(region)
        elif last[shapes[number]] > number:
            made.append(Polygon())
        else:
            later = [regions[kept[near]] for near in _near(tree, region) if kept[near] > number]
            made.append(polygonal(difference(region, union(later))))
    return made


def _near(tree: STRtree, region: BaseGeometry) -> list[int]:
    """Numbers of the shapes in a tree whose bounds touch those of a region, in order."""
    return sorted(tree.query(region).tolist())


def _around(area: BaseGeometry, region: BaseGeometry) -> BaseGeometry:
    """A region of many corners cut to the surroundings of an area; others as they are."""
    if shapely.get_num_coordinates(region) <= _MANY_CORNERS:
        return region
    west, south, east, north = area.bounds
    cut = shapely.clip_by_rect(
        region, west - _SURROUNDINGS, south - _SURROUNDINGS, east + _SURROUNDINGS,
        north + _SURROUNDINGS,
    )  # fmt: skip
    return cut if cut.is_valid else region


def _extended_into_walls(
    regions: list[BaseGeometry],
    walls: list[PlannedWall],
    slivers: list[Polygon],
    inner: BaseGeometry,
) -> list[BaseGeometry]:
    """Return the regions extended by half of the walls around them and by adjacent slivers."""
    shares: list[list[BaseGeometry]] = [[region] for region in regions]
    present = [number for number, region in enumerate(regions) if not region.is_empty]
    if not present:
        return regions
    # Areas to distribute, and how far a room extends into each.
    areas: list[tuple[BaseGeometry, float]] = [(sliver, 0.05) for sliver in slivers]
    for one in walls:
        middle = one.outline.middle
        reach = 0.006 * one.wall.thickness + 0.03
        areas += [
            (world_region(one.outline.ring(line, middle)), reach)
            for line in (one.outline.left, one.outline.right)
        ]
    rooms = STRtree([regions[number] for number in present])
    areas_tree = STRtree([area for area, _ in areas])
    # Each room grown by each reach, once: walls have few thicknesses, and a round room has as many
    # walls as corners.
    grown_regions: dict[tuple[int, float], BaseGeometry] = {}

    def grown_region(number: int, reach: float) -> BaseGeometry:
        key = (number, reach)
        if key not in grown_regions:
            grown_regions[key] = buffered(regions[number], reach, join_style="mitre")
        return grown_regions[key]

    # What each area has lost: rooms, and parts of other areas that rooms extend into.
    taken = [[regions[present[near]] for near in _near(rooms, area)] for area, _ in areas]
    for (area, reach), lost in zip(areas, taken, strict=True):
        rest = polygonal(difference(area, union([_around(area, shape) for shape in lost])))
        if rest.is_empty:
            continue
        within_reach = rooms.query(rest, predicate="dwithin", distance=2 * reach)
        near = [present[number] for number in sorted(within_reach.tolist())]
        fields = {
            number: polygonal(intersection(rest, _around(area, grown_region(number, reach))))
            for number in near
        }
        ranked = sorted(near, key=lambda number: (-fields[number].area, number))
        claimed = []
        for number in ranked:
            part = polygonal(intersection(fields[number], rest))
            shares[number].append(part)
            claimed.append(part)
            rest = polygonal(difference(rest, part))
        if ranked and not rest.is_empty:
            shares[ranked[0]].append(rest)
            claimed.append(rest)
        for part in claimed:
            for other in _near(areas_tree, part):
                taken[other].append(part)
    made = []
    for number, region in enumerate(regions):
        if region.is_empty:
            made.append(region)
            continue
        grown = union([buffered(part, 1e-4, join_style="mitre") for part in shares[number]])
        grown = buffered(grown, -1e-4, join_style="mitre")
        made.append(simplified(union([intersection(grown, inner), region]), 1e-4))
    return made
