"""A shell behind the walls of a building whose surfaces miss each other.

Slabs behind single cracks (`caulk`) need walks of light that find those first, and the finest are
found by one walk in a million. So where there are cracks, sheets are set up all around, behind
what is seen from indoors: along each wall, above the ceilings, below the floors. The sheet of a
wall with openings stands just behind the first of them and has a hole for each; what is deeper
there, the niche of a window or a fireplace, gets a box. World: metres, Z up.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import shapely
import trimesh
from scipy import ndimage
from shapely.geometry import Polygon, box
from shapely.geometry.polygon import orient

from scenes.arrays import Float64Array, Int64Array
from scenes.geometry.mesh import face_areas
from scenes.reconstruction.aperture_sections import Frame
from scenes.reconstruction.hidden_openings import Walker
from scenes.reconstruction.light_walks import blocked, places
from scenes.reconstruction.raycast import RayCaster
from scenes.reconstruction.rooms import FoundOpening, FoundRoom
from scenes.seeds import generator

SHELL_ID = "shell"
_WALKS = 16_384  # a scene
_BEHIND = 0.02  # metres from the deepest that is seen, and from openings, to a sheet
_STRAYS = (2e-4, 1e-3, 5e-3)  # of what walks meet may lie further out, by a crack; tried in turn
_RELIEF = 0.1  # metres that panels and cornices may lie behind the plan of a wall
_DEEPEST = 1.5  # metres that something seen from indoors may lie behind a wall
_RIM = 0.02  # metres by which a hole is less than its portal, which reaches into its frame
_OVERLAP = 0.01  # metres by which sheets cross, so that no ray slips between them
_WALL = 0.4  # metres that a wall between two rooms may be thick
_STOREY = 0.5  # metres by which floors of one storey may differ
_COLLAR = 0.3  # metres at most between an opening and the sheet of its wall
_FLARE = 3.0  # metres that a collar gets wider on each side in a metre
_PARALLEL = 0.98  # cosine between an opening's normal and its wall's
_SHARP = 0.1  # sine of the least angle between two walls that meet
_TINY = 1e-6  # square metres
_CELL = 0.1  # metres, of the grid that tells one recess from another
_LOOKS = 20_000
_CUT = 5e-4  # of them may meet the shell close before something
_CRACKS = 2e-3  # or before something far away, which was seen through a crack
_MOST = 0.03  # of the walks get out by cracks; where more do, a wall is missing on purpose
_LEAST = 0.5  # a shell that lets more than this of the escapes go on is not worth having


class _Misfit(Exception):
    """A building that no such shell fits."""


@dataclass
class _Sheet:
    """A flat part of the shell: `outline` at `depth` behind a side, with holes for `openings`."""

    outline: Polygon
    depth: float
    openings: list[FoundOpening] = field(default_factory=list)


@dataclass
class _Side:
    """A wall, the ceilings or the floors: its main sheet, and those of boxes that stand deeper."""

    frame: Frame
    main: _Sheet
    boxes: list[_Sheet] = field(default_factory=list)

    def distance(self, opening: FoundOpening) -> float:
        """How deep an opening lies behind it, metres; infinite if it lies elsewhere."""
        local = self.frame.local(opening.polygon)
        middle = local.mean(axis=0)
        if (
            self.frame.normal @ opening.normal < _PARALLEL
            or self.main.outline.distance(shapely.Point(middle[:2])) > _WALL
            or not -_WALL < middle[2] < _DEEPEST
        ):
            return np.inf
        return float(middle[2])

    def flat(self, opening: FoundOpening) -> Polygon:
        """An opening's outline in its plane."""
        return Polygon(self.frame.local(opening.polygon)[:, :2])


def shell(
    corners: Float64Array, rays: RayCaster, rooms: list[FoundRoom], openings: list[FoundOpening]
) -> tuple[Float64Array, list[FoundOpening]]:
    """Triangles (F, 3, 3) around a building that leaks, and the openings that it leaves open.

    No triangles if none are wanted or none fit. Closed are openings that no wall holds: those
    up a fireplace. `corners` are the triangles that stop light as it is, `rays` cast at them.
    """
    without: tuple[Float64Array, list[FoundOpening]] = (np.empty((0, 3, 3)), openings)
    if not rooms or any(room.guessed for room in rooms):
        return without
    normals = face_areas(corners)[1]
    count = max(1, _WALKS // len(rooms))
    escapes, met = Walker(rays, normals, openings).walks(rooms, count, 200)
    if not 0 < len(escapes) <= _MOST * count * len(rooms):
        return without
    for stray in _STRAYS:
        try:
            sides, kept = _sides(rooms, openings, met, int(stray * len(met)))
            made = np.concatenate([sheet for side in sides for sheet in _triangles(side)])
        except _Misfit:
            continue
        closed = Walker(RayCaster(made, rays), np.concatenate([normals, face_areas(made)[1]]), kept)
        still = closed.escapes(rooms, count, 200)
        if len(still) <= _LEAST * len(escapes) and not _cuts(made, rays, rooms, kept):
            return made, kept
    return without


def _sides(
    rooms: list[FoundRoom], openings: list[FoundOpening], met: Float64Array, stray: int
) -> tuple[list[_Side], list[FoundOpening]]:
    """The shell's sides, and the openings that have holes in them.

    `met` (N, 3) is where walks of light from indoors met something, `stray` of them outdoors.
    """
    floors, ceilings = [room.floor_z for room in rooms], [room.ceiling_z for room in rooms]
    if np.ptp(floors) > _STOREY:
        raise _Misfit
    ring = _ring(rooms)
    walls = _walls(ring, min(floors), max(ceilings))
    east, north = np.eye(3)[0], np.eye(3)[1]
    plan = Polygon(ring)
    top = _Side(Frame(np.array([0.0, 0.0, max(ceilings)]), east, north), _Sheet(plan, 0.0))
    under = shapely.transform(plan, lambda flat: flat[:, ::-1])
    bottom = _Side(Frame(np.array([0.0, 0.0, min(floors)]), north, east), _Sheet(under, 0.0))
    sides = [*walls, top, bottom]
    kept = [opening for opening in openings if _hang(opening, sides)]
    nearest = _nearest_wall(ring, met[:, :2])
    for number, side in enumerate(sides):
        behind = met[nearest == number] if number < len(walls) else met
        _set_back(side, side.frame.local(behind), stray)
    low = bottom.frame.origin[2] - bottom.main.depth
    high = top.frame.origin[2] + top.main.depth
    around = _moved_out(ring, [wall.main.depth for wall in walls])
    for wall, start, end in zip(walls, around, np.roll(around, -1, axis=0), strict=True):
        ends = wall.frame.local(np.array([[*start, 0.0], [*end, 0.0]]))[:, 0]
        wall.main.outline = box(ends[0], low, ends[1], high)
    for side in (top, bottom):
        level = np.column_stack([around, np.zeros(len(around))])
        side.main.outline = Polygon(side.frame.local(level)[:, :2])
    return sides, kept


def _ring(rooms: list[FoundRoom]) -> Float64Array:
    """Corners (N, 2) of the outline of all rooms with the walls between them, anticlockwise."""
    grown = [room.floor.buffer(0.5 * _WALL, join_style="mitre") for room in rooms]
    plan = shapely.union_all(grown).buffer(-0.5 * _WALL, join_style="mitre").simplify(0.01)
    if not isinstance(plan, Polygon):
        raise _Misfit
    return np.array(orient(Polygon(plan.exterior)).exterior.coords)[:-1]


def _walls(ring: Float64Array, floor: float, ceiling: float) -> list[_Side]:
    walls = []
    for start, end in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        length = float(np.linalg.norm(end - start))
        frame = Frame(np.append(start, 0.0), np.append((end - start) / length, 0.0), np.eye(3)[2])
        walls.append(_Side(frame, _Sheet(box(0, floor, length, ceiling), 0.0)))
    return walls


def _hang(opening: FoundOpening, sides: list[_Side]) -> bool:
    """Whether an opening lies in one of the sides, which then knows of it."""
    away = [abs(side.distance(opening)) for side in sides]
    nearest = int(np.argmin(away))
    if np.isinf(away[nearest]):
        if not opening.hidden:
            raise _Misfit
        return False
    sides[nearest].main.openings.append(opening)
    return True


def _nearest_wall(ring: Float64Array, points: Float64Array) -> Int64Array:
    """Of points (N, 2) outside a ring the number of the nearest edge, (N,); inside -1."""
    edges = np.stack([ring, np.roll(ring, -1, axis=0)], axis=1)
    away = [shapely.distance(edge, shapely.points(points)) for edge in shapely.linestrings(edges)]
    inside = shapely.contains_xy(Polygon(ring), points[:, 0], points[:, 1])
    return np.where(inside, -1, np.argmin(away, axis=0))


def _set_back(side: _Side, local: Float64Array, stray: int) -> None:
    """Put a side's main sheet behind the first of its openings, else behind the relief of its
    wall, and what is deeper into boxes.

    `local` (N, 3) are places in its axes, of which `stray` may lie further out.
    """
    depths = np.sort(local[:, 2])
    deepest = max(0.0, float(depths[-1 - stray]) if len(depths) > stray else 0.0)
    relief = float(np.max(depths[depths <= min(deepest, _RELIEF)], initial=0.0))
    openings, side.main.openings = side.main.openings, []
    first = min((side.distance(opening) for opening in openings), default=relief)
    side.main.depth = max(0.0, first) + _BEHIND
    if max(deepest, side.main.depth) > _DEEPEST:
        raise _Misfit
    behind = (local[:, 2] > side.main.depth) & (local[:, 2] <= deepest)
    side.boxes = _recesses(local[behind], stray)
    for opening in openings:
        depth = side.distance(opening) + _BEHIND
        around = side.flat(opening).buffer(_FLARE * _BEHIND + _RIM, join_style="mitre")
        if depth > side.main.depth + _BEHIND:
            side.boxes.append(_Sheet(around, depth, [opening]))
        else:
            side.main.openings.append(opening)
    side.boxes = _joined(side.boxes)
    for one in side.boxes:  # openings that a niche or a fireplace comes too close to
        taken = [each for each in side.main.openings if side.flat(each).intersects(one.outline)]
        one.openings += taken
        side.main.openings = [
            each for each in side.main.openings if not any(each is other for other in taken)
        ]


def _joined(boxes: list[_Sheet]) -> list[_Sheet]:
    """Boxes that stand apart: those that touch become one as large and as deep as both."""
    apart: list[_Sheet] = []
    for new in boxes:
        touching = [one for one in apart if one.outline.intersects(new.outline)]
        while touching:
            apart = [one for one in apart if not any(one is other for other in touching)]
            whole = shapely.union_all([new.outline, *(one.outline for one in touching)])
            new = _Sheet(
                box(*whole.bounds),
                max(new.depth, *(one.depth for one in touching)),
                [*new.openings, *(each for one in touching for each in one.openings)],
            )
            touching = [one for one in apart if one.outline.intersects(new.outline)]
        apart.append(new)
    return apart


def _recesses(local: Float64Array, stray: int) -> list[_Sheet]:
    """The ends of boxes around what is seen behind a sheet, (N, 3) in its side's axes."""
    if len(local) <= stray:
        return []
    cells = np.floor(local[:, :2] / _CELL).astype(np.int64)
    cells -= cells.min(axis=0)
    grid = np.zeros(cells.max(axis=0) + 1, dtype=bool)
    grid[tuple(cells.T)] = True
    labels = ndimage.label(grid, structure=np.ones((3, 3)))[0][tuple(cells.T)]
    found = []
    for label in np.unique(labels):
        some = local[labels == label]
        if len(some) > stray:
            low, high = some.min(axis=0) - _BEHIND, some.max(axis=0) + _BEHIND
            found.append(_Sheet(box(low[0], low[1], high[0], high[1]), float(high[2])))
    return found


def _moved_out(ring: Float64Array, depths: list[float]) -> Float64Array:
    """The corners (N, 2) of a ring whose edges move outwards by their depths."""
    ways = np.roll(ring, -1, axis=0) - ring
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    outwards = np.column_stack([ways[:, 1], -ways[:, 0]])
    reach = np.sum(outwards * ring, axis=1) + np.array(depths)
    corners = []
    for index in range(len(ring)):
        pair = outwards[[index - 1, index]]
        if abs(np.linalg.det(pair)) < _SHARP:
            raise _Misfit
        corners.append(np.linalg.solve(pair, reach[[index - 1, index]]))
    moved = np.array(corners)
    if not Polygon(moved).is_valid or not Polygon(moved).contains(Polygon(ring)):
        raise _Misfit
    return moved


def _triangles(side: _Side) -> list[Float64Array]:
    """A side's sheets with the collars of openings and the walls of boxes, (F, 3, 3) each."""
    made, ends = [], []
    for sheet in side.boxes:
        outline = sheet.outline.intersection(side.main.outline)
        made.append(
            _band(side.frame, outline, side.main.depth - _OVERLAP, outline, sheet.depth + _OVERLAP)
        )
        made += _holed(side, _Sheet(outline, sheet.depth, sheet.openings), [])
        ends.append(outline)
    return [*made, *_holed(side, side.main, ends)]


def _holed(side: _Side, sheet: _Sheet, holes: list[Polygon]) -> list[Float64Array]:
    """A sheet around `holes` and its openings, with the collars that lead to these."""
    made, holes = [], list(holes)
    for opening in sheet.openings:
        way = sheet.depth - side.distance(opening)
        inner = side.flat(opening).buffer(-_RIM, join_style="mitre")
        wide = inner.buffer(_FLARE * way, join_style="mitre").intersection(sheet.outline)
        if way > _COLLAR:
            raise _Misfit
        made.append(_band(side.frame, inner, sheet.depth - way, wide, sheet.depth))
        holes.append(wide.buffer(-_OVERLAP, join_style="mitre"))
    whole = shapely.union_all(holes)
    meet = sum(hole.area for hole in holes) - whole.area
    if meet > _TINY or whole.difference(sheet.outline).area > _TINY:
        raise _Misfit
    plane = sheet.outline.buffer(_OVERLAP, join_style="mitre").difference(whole)
    return [*made, *_flat(side.frame, plane, sheet.depth)]


def _flat(frame: Frame, outline: Polygon, depth: float) -> list[Float64Array]:
    made = []
    for part in shapely.get_parts(outline).tolist():
        if not isinstance(part, Polygon) or part.area < _TINY:
            continue
        points, faces = trimesh.creation.triangulate_polygon(part, engine="earcut")
        made.append(frame.world(np.asarray(points), depth)[np.asarray(faces)])
    return made


def _band(frame: Frame, one: Polygon, depth: float, other: Polygon, far: float) -> Float64Array:
    """Between the rims of two outlines, of as many corners each, at two depths."""
    plain = all(isinstance(each, Polygon) and not each.is_empty for each in (one, other))
    if not plain or len(one.exterior.coords) != len(other.exterior.coords):
        raise _Misfit
    near, away = (np.array(orient(each).exterior.coords)[:-1] for each in (one, other))
    first = int(np.argmin(np.linalg.norm(away - near[0], axis=1)))
    low, high = frame.world(near, depth), frame.world(np.roll(away, -first, axis=0), far)
    next_low, next_high = np.roll(low, -1, axis=0), np.roll(high, -1, axis=0)
    halves = [low, next_low, next_high], [low, next_high, high]
    return np.concatenate([np.stack(half, axis=1) for half in halves])


def _cuts(
    made: Float64Array, rays: RayCaster, rooms: list[FoundRoom], openings: list[FoundOpening]
) -> bool:
    """Whether a shell stands before more than cracks, for who looks around indoors.

    What is seen through an opening does not count: the outside of another wall.
    """
    rng = generator(0, "shell")
    each = max(1, _LOOKS // len(rooms))
    eyes = np.concatenate(
        [places(room.floor, room.floor_z, room.ceiling_z, each, rng) for room in rooms]
    )
    ways = rng.normal(size=eyes.shape)
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    sheet, thing = RayCaster(made).cast(eyes, ways)[0], rays.cast(eyes, ways)[0]
    before = (sheet < thing) & np.isfinite(thing) & ~blocked(openings, eyes, ways, sheet)
    close = before & (thing < sheet + _DEEPEST)
    return bool(close.mean() > _CUT or before.mean() > _CRACKS)
