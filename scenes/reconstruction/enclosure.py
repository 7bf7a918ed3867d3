"""An opaque enclosure around a building whose surfaces do not meet.

Input: the light-stopping triangles, the rooms and the openings. Output: triangles of flat sheets
behind the walls, above the ceilings and below the floors, with a hole for every opening.

Slabs behind single gaps (`gap_sealing`) need random walks that find each gap, and the finest gaps
are found by one walk in a million. So a building that leaks gets sheets all around, just behind
everything that is visible from indoors. The sheet of a wall with openings stands just behind the
first of them; deeper recesses, such as a window niche or a fireplace, get a box of their own, and
a flared collar leads from each opening to its sheet. The enclosure is used only if it stops most
of the walks that escaped and hides nothing that was visible from indoors. World: metres, Z up.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import shapely
import trimesh
from scipy import ndimage
from shapely.geometry import Polygon, box
from shapely.geometry.polygon import orient

from pbrnet.scenes.arrays import Float64Array, Int64Array
from pbrnet.scenes.geometry.directions import unit
from pbrnet.scenes.geometry.mesh import face_areas
from pbrnet.scenes.geometry.regions import (
    buffered,
    covers,
    difference,
    intersection,
    meets,
    simplified,
    union,
)
from pbrnet.scenes.reconstruction.aperture_sections import PlaneFrame
from pbrnet.scenes.reconstruction.light_walks import LightWalker, OpeningIndex, points_in_room
from pbrnet.scenes.reconstruction.raycast import RayCaster
from pbrnet.scenes.reconstruction.rooms import FoundOpening, FoundRoom
from pbrnet.scenes.seeds import generator

ENCLOSURE_ID = "shell"  # part of the format of scene folders
_WALKS = 16_384  # in a scene
_BEHIND = 0.02  # metres from the deepest visible point, and from openings, to a sheet
_OUTLIER_SHARES = (2e-4, 1e-3, 5e-3)  # of the hit points that may lie further out, having been
# reached through a gap; tried in turn
_MAX_RELIEF = 0.1  # metres that panels and cornices may lie behind the plan of a wall
_MAX_DEPTH = 1.5  # metres that something visible from indoors may lie behind a wall
_HOLE_INSET = 0.02  # metres by which a hole is smaller than its portal, which reaches into its
# frame
_OVERLAP = 0.01  # metres by which sheets overlap, so that no ray slips between them
_MAX_WALL = 0.4  # metres of thickness of a wall between two rooms
_MAX_FLOOR_STEP = 0.5  # metres by which the floors of one storey may differ
_MAX_COLLAR = 0.3  # metres between an opening and the sheet of its wall
_FLARE = 3.0  # metres by which a collar widens on each side over a metre
_PARALLEL = 0.98  # least cosine between an opening's normal and its wall's
_MIN_SINE = 0.1  # of the angle between two walls that meet
_MIN_AREA = 1e-6  # square metres
_CELL = 0.1  # metres; grid that separates one recess from another
_VIEW_RAYS = 20_000
_MAX_HIDDEN = 5e-4  # share of them that may hit the enclosure just in front of a surface
_MAX_HIDDEN_FAR = 2e-3  # ... or in front of a distant one, which was visible through a gap
_MAX_ESCAPES = 0.03  # share of the walks that gaps let out; more means a wall left out on purpose
_MAX_REMAINING = 0.5  # share of these that a useful enclosure may still let out


class _NoFit(Exception):
    """No enclosure of this form fits the building."""


@dataclass
class _Sheet:
    """A flat part: `outline` at `depth` behind a side, with holes for `openings`."""

    outline: Polygon
    depth: float
    openings: list[FoundOpening] = field(default_factory=list)


@dataclass
class _Side:
    """A wall, the ceilings or the floors: the main sheet, and the ends of deeper boxes."""

    frame: PlaneFrame
    main: _Sheet
    boxes: list[_Sheet] = field(default_factory=list)

    def opening_depth(self, opening: FoundOpening) -> float:
        """Depth of an opening behind this side, metres; infinite if it lies elsewhere."""
        local = self.frame.to_local(opening.polygon)
        middle = local.mean(axis=0)
        if (
            self.frame.normal @ opening.normal < _PARALLEL
            or self.main.outline.distance(shapely.Point(middle[:2])) > _MAX_WALL
            or not -_MAX_WALL < middle[2] < _MAX_DEPTH
        ):
            return np.inf
        return float(middle[2])

    def project(self, opening: FoundOpening) -> Polygon:
        """The outline of an opening in this side's axes."""
        return Polygon(self.frame.to_local(opening.polygon)[:, :2])


def build_enclosure(
    corners: Float64Array, rays: RayCaster, rooms: list[FoundRoom], openings: list[FoundOpening]
) -> tuple[Float64Array, list[FoundOpening]]:
    """Return triangles (F, 3, 3) around a building that leaks, and the openings they leave open.

    There are no triangles if the building is tight or no enclosure fits. Openings that lie in no
    wall, such as those up a fireplace, are closed. `corners` (F, 3, 3) are the light-stopping
    triangles that `rays` holds.
    """
    nothing: tuple[Float64Array, list[FoundOpening]] = (np.empty((0, 3, 3)), openings)
    if not rooms or any(room.guessed for room in rooms):
        return nothing
    normals = face_areas(corners)[1]
    count = max(1, _WALKS // len(rooms))
    escaped, hit_points = LightWalker(rays, normals, openings).trace_rooms(rooms, count, 200)
    if not 0 < len(escaped) <= _MAX_ESCAPES * count * len(rooms):
        return nothing
    for share in _OUTLIER_SHARES:
        try:
            sides, kept = _sides(rooms, openings, hit_points, int(share * len(hit_points)))
            added = np.concatenate([part for side in sides for part in _side_triangles(side)])
        except _NoFit:
            continue
        walker = LightWalker(
            RayCaster(added, rays), np.concatenate([normals, face_areas(added)[1]]), kept
        )
        remaining = walker.escaped_walks(rooms, count, 200)
        if len(remaining) <= _MAX_REMAINING * len(escaped) and not _hides_surfaces(
            added, rays, rooms, kept
        ):
            return added, kept
    return nothing


def _sides(
    rooms: list[FoundRoom], openings: list[FoundOpening], hit_points: Float64Array, outliers: int
) -> tuple[list[_Side], list[FoundOpening]]:
    """The sides of the enclosure, and the openings that have holes in them.

    `hit_points` (N, 3) are where random walks from indoors hit a surface; `outliers` of them may
    lie outdoors.
    """
    floors, ceilings = [room.floor_z for room in rooms], [room.ceiling_z for room in rooms]
    if np.ptp(floors) > _MAX_FLOOR_STEP:
        raise _NoFit
    ring = _building_outline(rooms)
    walls = _walls(ring, min(floors), max(ceilings))
    east, north = np.eye(3)[0], np.eye(3)[1]
    plan = Polygon(ring)
    top = _Side(PlaneFrame(np.array([0.0, 0.0, max(ceilings)]), east, north), _Sheet(plan, 0.0))
    swapped = shapely.transform(plan, lambda flat: flat[:, ::-1])
    bottom = _Side(PlaneFrame(np.array([0.0, 0.0, min(floors)]), north, east), _Sheet(swapped, 0.0))
    sides = [*walls, top, bottom]
    kept = [opening for opening in openings if _assign_to_side(opening, sides)]
    nearest = _nearest_wall(ring, hit_points[:, :2])
    for number, side in enumerate(sides):
        behind = hit_points[nearest == number] if number < len(walls) else hit_points
        _place_sheets(side, side.frame.to_local(behind), outliers)
    low = bottom.frame.origin[2] - bottom.main.depth
    high = top.frame.origin[2] + top.main.depth
    outer_ring = _offset_ring(ring, [wall.main.depth for wall in walls])
    for wall, start, end in zip(walls, outer_ring, np.roll(outer_ring, -1, axis=0), strict=True):
        ends = wall.frame.to_local(np.array([[*start, 0.0], [*end, 0.0]]))[:, 0]
        wall.main.outline = box(ends[0], low, ends[1], high)
    for side in (top, bottom):
        corners = np.column_stack([outer_ring, np.zeros(len(outer_ring))])
        side.main.outline = Polygon(side.frame.to_local(corners)[:, :2])
    return sides, kept


def _building_outline(rooms: list[FoundRoom]) -> Float64Array:
    """Outline (N, 2) of all rooms and the walls between them, counter-clockwise."""
    grown = [buffered(room.floor, 0.5 * _MAX_WALL, join_style="mitre") for room in rooms]
    plan = simplified(buffered(union(grown), -0.5 * _MAX_WALL, join_style="mitre"), 0.01)
    if not isinstance(plan, Polygon):
        raise _NoFit
    return np.array(orient(Polygon(plan.exterior)).exterior.coords)[:-1]


def _walls(ring: Float64Array, floor: float, ceiling: float) -> list[_Side]:
    """One side for each edge of the outline, its sheet not yet placed."""
    walls = []
    for start, end in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        length = float(np.linalg.norm(end - start))
        along = np.append((end - start) / length, 0.0)
        frame = PlaneFrame(np.append(start, 0.0), along, np.eye(3)[2])
        walls.append(_Side(frame, _Sheet(box(0, floor, length, ceiling), 0.0)))
    return walls


def _assign_to_side(opening: FoundOpening, sides: list[_Side]) -> bool:
    """Add an opening to the main sheet of the nearest side; False if it lies in none."""
    depths = [abs(side.opening_depth(opening)) for side in sides]
    nearest = int(np.argmin(depths))
    if np.isinf(depths[nearest]):
        if not opening.hidden:
            raise _NoFit
        return False
    sides[nearest].main.openings.append(opening)
    return True


def _nearest_wall(ring: Float64Array, points: Float64Array) -> Int64Array:
    """Number (N,) of the ring's edge nearest to each of `points` (N, 2); -1 for points inside."""
    edges = shapely.linestrings(np.stack([ring, np.roll(ring, -1, axis=0)], axis=1))
    outside = np.nonzero(~shapely.contains_xy(Polygon(ring), points[:, 0], points[:, 1]))[0]
    found = shapely.STRtree(edges).query_nearest(shapely.points(points[outside]))
    nearest = np.full(len(points), len(ring))
    np.minimum.at(nearest, outside[found[0]], found[1])  # of equally near ones, the first
    return np.where(nearest < len(ring), nearest, -1)


def _place_sheets(side: _Side, local: Float64Array, outliers: int) -> None:
    """Place the main sheet of a side and the boxes for what lies deeper.

    The main sheet stands behind the first of the side's openings or, without openings, behind
    the relief of the wall. `local` (N, 3) are visible points in the side's axes; `outliers` of
    them may lie further out.
    """
    depths = np.sort(local[:, 2])
    deepest = max(0.0, float(depths[-1 - outliers]) if len(depths) > outliers else 0.0)
    relief = float(np.max(depths[depths <= min(deepest, _MAX_RELIEF)], initial=0.0))
    openings, side.main.openings = side.main.openings, []
    first = min((side.opening_depth(opening) for opening in openings), default=relief)
    side.main.depth = max(0.0, first) + _BEHIND
    if max(deepest, side.main.depth) > _MAX_DEPTH:
        raise _NoFit
    behind = (local[:, 2] > side.main.depth) & (local[:, 2] <= deepest)
    side.boxes = _recesses(local[behind], outliers)
    for opening in openings:
        depth = side.opening_depth(opening) + _BEHIND
        around = buffered(side.project(opening), _FLARE * _BEHIND + _HOLE_INSET, join_style="mitre")
        if depth > side.main.depth + _BEHIND:
            side.boxes.append(_Sheet(around, depth, [opening]))
        else:
            side.main.openings.append(opening)
    side.boxes = _merge_touching(side.boxes)
    for recess in side.boxes:  # takes over the openings of the main sheet that it touches
        taken = [
            opening
            for opening in side.main.openings
            if meets(side.project(opening), recess.outline)
        ]
        recess.openings += taken
        side.main.openings = [
            opening
            for opening in side.main.openings
            if not any(opening is other for other in taken)
        ]


def _merge_touching(boxes: list[_Sheet]) -> list[_Sheet]:
    """Merge boxes that touch into one as large and as deep as all of them."""
    apart: list[_Sheet] = []
    for new in boxes:
        touching = [sheet for sheet in apart if meets(sheet.outline, new.outline)]
        while touching:
            apart = [sheet for sheet in apart if not any(sheet is other for other in touching)]
            whole = union([new.outline, *(sheet.outline for sheet in touching)])
            new = _Sheet(
                box(*whole.bounds),
                max(new.depth, *(sheet.depth for sheet in touching)),
                [*new.openings, *(opening for sheet in touching for opening in sheet.openings)],
            )
            touching = [sheet for sheet in apart if meets(sheet.outline, new.outline)]
        apart.append(new)
    return apart


def _recesses(local: Float64Array, outliers: int) -> list[_Sheet]:
    """End sheets of boxes around the visible points (N, 3) behind a main sheet."""
    if len(local) <= outliers:
        return []
    cells = np.floor(local[:, :2] / _CELL).astype(np.int64)
    cells -= cells.min(axis=0)
    grid = np.zeros(cells.max(axis=0) + 1, dtype=bool)
    grid[tuple(cells.T)] = True
    labels = ndimage.label(grid, structure=np.ones((3, 3)))[0][tuple(cells.T)]
    found = []
    for label in np.unique(labels):
        members = local[labels == label]
        if len(members) > outliers:
            low, high = members.min(axis=0) - _BEHIND, members.max(axis=0) + _BEHIND
            found.append(_Sheet(box(low[0], low[1], high[0], high[1]), float(high[2])))
    return found


def _offset_ring(ring: Float64Array, depths: list[float]) -> Float64Array:
    """Corners (N, 2) of a ring whose edges move outwards by `depths`."""
    along = np.roll(ring, -1, axis=0) - ring
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    outwards = np.column_stack([along[:, 1], -along[:, 0]])
    offsets = np.sum(outwards * ring, axis=1) + np.array(depths)
    corners = []
    for index in range(len(ring)):
        pair = outwards[[index - 1, index]]
        if abs(np.linalg.det(pair)) < _MIN_SINE:
            raise _NoFit
        corners.append(np.linalg.solve(pair, offsets[[index - 1, index]]))
    moved = np.array(corners)
    if not Polygon(moved).is_valid or not covers(Polygon(moved), Polygon(ring)):
        raise _NoFit
    return moved


def _side_triangles(side: _Side) -> list[Float64Array]:
    """Triangles (F, 3, 3) of a side: its sheets, collars and the walls of its boxes."""
    parts, box_outlines = [], []
    for sheet in side.boxes:
        outline = intersection(sheet.outline, side.main.outline)
        parts.append(
            _strip(side.frame, outline, side.main.depth - _OVERLAP, outline, sheet.depth + _OVERLAP)
        )
        parts += _sheet_triangles(side, _Sheet(outline, sheet.depth, sheet.openings), [])
        box_outlines.append(outline)
    return [*parts, *_sheet_triangles(side, side.main, box_outlines)]


def _sheet_triangles(side: _Side, sheet: _Sheet, holes: list[Polygon]) -> list[Float64Array]:
    """Triangles of a sheet around `holes` and its openings, with a collar for each opening."""
    parts, holes = [], list(holes)
    for opening in sheet.openings:
        length = sheet.depth - side.opening_depth(opening)
        inner = buffered(side.project(opening), -_HOLE_INSET, join_style="mitre")
        outer = intersection(buffered(inner, _FLARE * length, join_style="mitre"), sheet.outline)
        if length > _MAX_COLLAR:
            raise _NoFit
        parts.append(_strip(side.frame, inner, sheet.depth - length, outer, sheet.depth))
        holes.append(buffered(outer, -_OVERLAP, join_style="mitre"))
    whole = union(holes)
    overlap = sum(hole.area for hole in holes) - whole.area
    if overlap > _MIN_AREA or difference(whole, sheet.outline).area > _MIN_AREA:
        raise _NoFit
    plane = difference(buffered(sheet.outline, _OVERLAP, join_style="mitre"), whole)
    return [*parts, *_triangulated(side.frame, plane, sheet.depth)]


def _triangulated(frame: PlaneFrame, outline: Polygon, depth: float) -> list[Float64Array]:
    """Triangles (F, 3, 3) of each part of a flat outline."""
    parts = []
    for part in shapely.get_parts(outline).tolist():
        if not isinstance(part, Polygon) or part.area < _MIN_AREA:
            continue
        points, faces = trimesh.creation.triangulate_polygon(part, engine="earcut")
        parts.append(frame.to_world(np.asarray(points), depth)[np.asarray(faces)])
    return parts


def _strip(
    frame: PlaneFrame, near: Polygon, near_depth: float, far: Polygon, far_depth: float
) -> Float64Array:
    """Triangles (F, 3, 3) between the rims of two outlines with equally many corners."""
    is_simple = all(isinstance(each, Polygon) and not each.is_empty for each in (near, far))
    if not is_simple or len(near.exterior.coords) != len(far.exterior.coords):
        raise _NoFit
    near_ring, far_ring = (np.array(orient(each).exterior.coords)[:-1] for each in (near, far))
    first = int(np.argmin(np.linalg.norm(far_ring - near_ring[0], axis=1)))
    low = frame.to_world(near_ring, near_depth)
    high = frame.to_world(np.roll(far_ring, -first, axis=0), far_depth)
    next_low, next_high = np.roll(low, -1, axis=0), np.roll(high, -1, axis=0)
    halves = [low, next_low, next_high], [low, next_high, high]
    return np.concatenate([np.stack(half, axis=1) for half in halves])


def _hides_surfaces(
    added: Float64Array, rays: RayCaster, rooms: list[FoundRoom], openings: list[FoundOpening]
) -> bool:
    """Return whether an enclosure hides surfaces that were visible from indoors other than by gaps.

    Surfaces behind an opening, such as the outside of another wall, do not count.
    """
    rng = generator(0, "shell")
    count = max(1, _VIEW_RAYS // len(rooms))
    eyes = np.concatenate([points_in_room(room, count, rng) for room in rooms])
    directions = unit(rng.normal(size=eyes.shape))
    to_enclosure = RayCaster(added).cast(eyes, directions)[0]
    to_surface = rays.cast(eyes, directions)[0]
    hidden = (
        (to_enclosure < to_surface)
        & np.isfinite(to_surface)
        & ~OpeningIndex(openings).crossed(eyes, directions, to_enclosure)
    )
    just_behind = hidden & (to_surface < to_enclosure + _MAX_DEPTH)
    return bool(just_behind.mean() > _MAX_HIDDEN or hidden.mean() > _MAX_HIDDEN_FAR)
