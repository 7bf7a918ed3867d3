"""Floors, ceilings and the ground as closed slabs, with stairwells cut out."""

from __future__ import annotations

import math
from dataclasses import replace

import mapbox_earcut
import numpy as np
import shapely
from scipy.spatial import cKDTree
from shapely.geometry import Polygon, box
from shapely.geometry.base import BaseGeometry

from pbrnet.scenes.arrays import BoolArray, Float64Array
from pbrnet.scenes.geometry.mesh import Mesh
from pbrnet.scenes.geometry.regions import buffered, difference, intersection, union
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.sweethome.building.cutouts import UnreadablePath, path_region
from pbrnet.scenes.sweethome.building.levels import Storey
from pbrnet.scenes.sweethome.building.solids import (
    polygonal,
    polygons,
    prism,
    surface,
    to_world,
    world_region,
)
from pbrnet.scenes.sweethome.building.spaces import Space, is_tall
from pbrnet.scenes.sweethome.building.walls import PlannedWall
from pbrnet.scenes.sweethome.furnishing.finishes import (
    ground_reflectance,
    reflectance_of_argb,
    surface_finish,
    texture_coordinates,
)
from pbrnet.scenes.sweethome.furnishing.items import ItemPart, PlacedItem, SurfaceFinish
from pbrnet.scenes.sweethome.home import Environment, HomePiece, Surface

Stairwell = tuple[BaseGeometry, float, float]  # region (world), foot and top (cm)
_FLOOR = 0.12  # metres: thickness of a floor on the ground
_CEILING = 0.12  # metres: of a ceiling with nothing above
_BACKING_HEIGHT = 0.02  # metres between a ceiling and the slab above all ceilings
_SAME_CORNER = 0.1  # cm between corners of walls that count as one
_SAME_PLACE = 1e-6  # metres between distances to edges that may be equal
_STEP = 20.0  # cm: larger differences of wall heights at a corner are intended
_PARAPET = 130.0  # cm above the floor: a wall between rooms that ends below may carry no ceiling
_JOINT = 30.0  # cm between the ends of walls that meet
_SLIVER = 0.02  # metres: half the width of parts between walls that are no floor
_BESIDE = 15.0  # cm from a wall's face to the point that tells what is on that side
_GROUND = -0.03  # metres: the ground lies a little below floors at 0
_GROUND_EXTENT = 2500.0  # metres of ground to each side


def stairwells(pieces: list[tuple[HomePiece, float]], changes: Changes) -> list[Stairwell]:
    """Return the stairwells of pieces: region (world), bottom and top (cm).

    Each piece comes with the elevation of its level (cm).
    """
    wells = []
    for piece, elevation in pieces:
        if piece.staircase is None:
            continue
        try:
            shape = intersection(path_region(piece.staircase), box(0, 0, 1, 1))
        except (UnreadablePath, ValueError) as error:
            changes.note("stairwell shapes that cannot be read became rectangles: {}",
                         f"{piece.name} ({error})")  # fmt: skip
            shape = box(0, 0, 1, 1)
        cosine, sine = math.cos(piece.angle), math.sin(piece.angle)
        mirror = -1.0 if piece.mirrored else 1.0

        def placed(points: Float64Array, piece: HomePiece = piece, mirror: float = mirror,
                   cosine: float = cosine, sine: float = sine) -> Float64Array:  # fmt: skip
            across = mirror * (points[:, 0] - 0.5) * piece.width
            out = (points[:, 1] - 0.5) * piece.depth
            return np.stack(
                [piece.x + across * cosine - out * sine, piece.y + across * sine + out * cosine],
                axis=1,
            )

        foot = elevation + piece.elevation
        wells.append((world_region(shapely.transform(shape, placed)), foot, foot + piece.height))
    return wells


class CeilingHeights:
    """Ceiling heights of a storey: its own height; on the highest level those of the walls.

    There, as in the application, a corner of a ceiling is as high as the nearest corner of a
    wall; but parapets and walls below stairs carry no ceiling. The
    application defines this for corners of the drawn room; `over` extends it to points outside.
    """

    def __init__(self, storey: Storey, walls: list[PlannedWall], spaces: list[Space]) -> None:
        if storey.is_highest and walls:
            walls = _walls_under_ceilings(storey, walls, spaces)
        self._level = 0.01 * (storey.elevation + storey.height)
        self._points = np.zeros((0, 2))
        self._tops = np.zeros(0)
        if storey.is_highest and walls:
            self._points = np.concatenate(
                [np.concatenate([one.outline.left, one.outline.right]) for one in walls]
            )
            self._tops = np.concatenate(
                [one.top(np.concatenate([one.outline.left, one.outline.right])) for one in walls]
            )
        self._corners = cKDTree(self._points)

    def at(self, points: Float64Array) -> Float64Array:
        """Return heights (N,) in metres at world points (N, 2)."""
        if not len(self._tops):
            return np.full(len(points), self._level)
        plan = points * [100, -100]
        nearest, _ = self._corners.query(plan)
        around = self._corners.query_ball_point(plan, nearest + 2 * _SAME_CORNER)
        made = np.empty(len(plan))
        for number, (point, close) in enumerate(zip(plan, around, strict=True)):
            close = sorted(close)
            away = np.linalg.norm(self._points[close] - point, axis=1)
            tops = self._tops[close]
            top = tops[int(np.argmin(away))]
            # If a wall at this corner slopes, heights differ slightly: take the lowest, so that
            # there is no gap above it.
            meeting = tops[away < away.min() + _SAME_CORNER]
            made[number] = meeting[np.abs(meeting - top) < _STEP].min()
        return 0.01 * made

    def over(self, region: BaseGeometry, points: Float64Array) -> Float64Array:
        """Return heights (N,) in metres of the ceiling of `region` at points (N, 2), also outside.

        Heights are linear between the corners of the boundary of the region.
        """
        rims = [
            np.asarray(ring.coords)
            for part in polygons(region)
            for ring in (part.exterior, *part.interiors)
        ]
        starts = np.concatenate([rim[:-1] for rim in rims])
        ends = np.concatenate([rim[1:] for rim in rims])
        low, high = self.at(starts), self.at(ends)
        if np.ptp(low) < 1e-3:
            return np.full(len(points), float(np.median(low)))
        along = ends - starts
        length = np.maximum((along**2).sum(axis=1), 1e-18)
        edges = shapely.STRtree(shapely.linestrings(np.stack([starts, ends], axis=1)))
        places = shapely.points(points)
        _, nearest = edges.query_nearest(places, return_distance=True, all_matches=False)
        rows, near = edges.query(places, predicate="dwithin", distance=nearest + _SAME_PLACE)
        order = np.lexsort((near, rows))
        firsts = np.searchsorted(rows[order], np.arange(len(points) + 1))
        made = np.empty(len(points))
        for number, point in enumerate(points):
            close = near[order[firsts[number] : firsts[number + 1]]]
            start, way = starts[close], along[close]
            share = np.clip(((point - start) * way).sum(axis=1) / length[close], 0.0, 1.0)
            away = ((start + share[:, None] * way - point) ** 2).sum(axis=1)
            best = int(np.argmin(away))
            edge = close[best]
            made[number] = low[edge] + share[best] * (high[edge] - low[edge])
        return made


def _walls_under_ceilings(
    storey: Storey, walls: list[PlannedWall], spaces: list[Space]
) -> list[PlannedWall]:
    """Return the walls without those that end low between rooms: parapets, walls below stairs.

    Partitions below a sloping roof end low, too, but beside an outer wall that is as low.
    """
    if any(space.has_gaps for space in spaces):
        return [one for one in walls if is_tall(one, storey)]
    lowest = storey.elevation + _PARAPET

    def low_ends(one: PlannedWall) -> list[Float64Array]:
        line, tops = one.outline.middle, (one.top_at_start, one.top_at_end)
        return [line[end] for end, top in zip((0, -1), tops, strict=True) if top <= lowest]

    ends = [low_ends(one) for one in walls]
    doubtful = np.array([bool(tips) for tips in ends])
    doubtful[doubtful] = _between_rooms(
        [one for one, is_low in zip(walls, doubtful, strict=True) if is_low], spaces
    )
    eaves = union(
        [one.outline.region for one, tips, other in zip(walls, ends, doubtful, strict=True)
         if tips and not other]
    )  # fmt: skip
    shapely.prepare(eaves)
    kept = [
        one
        for one, tips, is_doubtful in zip(walls, ends, doubtful, strict=True)
        if not is_doubtful or shapely.dwithin(eaves, shapely.points(tips), _JOINT).all()
    ]
    return kept or walls


def _between_rooms(walls: list[PlannedWall], spaces: list[Space]) -> BoolArray:
    """Return which walls (N,) have a room on both sides."""
    points = []
    for wall in walls:
        middle = 0.5 * (wall.outline.middle[0] + wall.outline.middle[-1])
        for line in (wall.outline.left, wall.outline.right):
            face = 0.5 * (line[0] + line[-1])
            away = face - middle
            points.append(face + _BESIDE * away / max(float(np.linalg.norm(away)), 1e-9))
    if not points:
        return np.zeros(0, dtype=bool)
    floors = shapely.STRtree([space.floor for space in spaces])
    in_room = np.zeros(len(points), dtype=bool)
    in_room[floors.query(shapely.points(to_world(points)), predicate="covered_by")[0]] = True
    sides = in_room.reshape(-1, 2)
    return sides[:, 0] & sides[:, 1]


def build_slabs(
    storey: Storey,
    spaces: list[Space],
    heights: CeilingHeights,
    wells: list[Stairwell],
) -> list[PlacedItem]:
    """Return a floor and a ceiling for each room, and one slab above all ceilings."""
    floor_z, ceiling_z = storey.elevation, storey.elevation + storey.height
    through_floor = union(
        [
            region
            for region, foot, top in wells
            if foot < floor_z and top >= floor_z - storey.floor_thickness
        ]
    )
    through_ceiling = union(
        [region for region, foot, top in wells if foot < ceiling_z <= top and not storey.is_highest]
    )
    thickness = _FLOOR if storey.is_lowest else max(0.01 * storey.floor_thickness - 0.01, 0.02)
    above = _CEILING
    if storey.above is not None:
        above = min(above, max(0.01 * (storey.above - ceiling_z) - 0.02, 0.03))
    items: list[PlacedItem] = []
    backing: list[tuple[BaseGeometry, float]] = []
    for number, space in enumerate(spaces):
        label = space.shape.name or "room"
        region = difference(space.floor_slab, through_floor)
        mesh = surface(prism(region, 0.01 * floor_z - thickness, 0.01 * floor_z))
        if mesh is not None:
            part = _covered(mesh, space.shape.floor, -1.0)
            name = f"floor-{storey.number}-{number}"
            items.append(
                PlacedItem(name, f"{label} floor", "floor", (part,), True, level=storey.number)
            )
        region = difference(space.ceiling_slab, through_ceiling)
        mesh, flat = _ceiling(region, space.ceiling, heights, above)
        if mesh is not None:
            part = _covered(mesh, space.shape.ceiling, 1.0)
            name = f"ceiling-{storey.number}-{number}"
            items.append(
                PlacedItem(name, f"{label} ceiling", "ceiling", (part,), True, level=storey.number)
            )
            if flat is not None:
                backing.append((region, flat))
    for number, z in enumerate(sorted({round(z, 4) for _, z in backing})):
        regions = [region for region, height in backing if abs(height - z) < 1e-3]
        together = union([buffered(region, 1e-3, join_style="mitre") for region in regions])
        together = difference(buffered(together, -2e-3, join_style="mitre"), through_ceiling)
        if above > 2 * _BACKING_HEIGHT:
            mesh = surface(prism(together, z + _BACKING_HEIGHT, z + above - 0.005))
            if mesh is not None:
                part = ItemPart(mesh, SurfaceFinish(color=(0.5, 0.5, 0.5)))
                name = f"slab-{storey.number}-{number}"
                items.append(
                    PlacedItem(name, "slab", "structure", (part,), True, level=storey.number)
                )
    return items


def build_ground(
    environment: Environment, below: list[BaseGeometry], centre: Float64Array
) -> PlacedItem:
    """Return the ground around the home, with holes where floors lie below it."""
    x, y = centre
    region: BaseGeometry = box(
        x - _GROUND_EXTENT, y - _GROUND_EXTENT, x + _GROUND_EXTENT, y + _GROUND_EXTENT
    )
    if below:
        region = difference(region, union(below))
    vertices, faces = triangulated(region)
    points = np.column_stack([vertices, np.full(len(vertices), _GROUND)])
    texture = environment.ground_texture
    uvs = None
    if texture is not None:
        uvs = texture_coordinates(100 * vertices, texture)
        uvs = np.stack([uvs[:, 0], 1 - uvs[:, 1]], axis=1)
    finish = surface_finish(
        Surface(None, texture), ground_reflectance(reflectance_of_argb(environment.ground_color))
    )
    return PlacedItem(
        "ground", "ground", "ground", (ItemPart(Mesh(points, faces, None, uvs), finish),), True
    )


def triangulated(region: BaseGeometry) -> tuple[Float64Array, np.ndarray]:
    """Triangulate a region with holes: vertices (V, 2) and faces (F, 3), facing up."""
    vertices, faces, start = [], [], 0
    for part in polygons(region):
        rings = [np.asarray(part.exterior.coords)[:-1]]
        rings += [np.asarray(hole.coords)[:-1] for hole in part.interiors]
        points = np.concatenate(rings)
        ends = np.cumsum([len(ring) for ring in rings]).astype(np.uint32)
        found = mapbox_earcut.triangulate_float64(points, ends).reshape(-1, 3).astype(np.int64)
        a, b, c = (points[found[:, corner]] for corner in range(3))
        turned = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
        found[turned < 0] = found[turned < 0][:, ::-1]
        vertices.append(points)
        faces.append(found + start)
        start += len(points)
    if not vertices:
        return np.zeros((0, 2)), np.zeros((0, 3), dtype=np.int64)
    return np.concatenate(vertices), np.concatenate(faces)


def _ceiling(
    region: BaseGeometry, drawn: BaseGeometry, heights: CeilingHeights, thickness: float
) -> tuple[Mesh | None, float | None]:
    """Return the mesh of a ceiling over `region`, and its height if it is level, else None."""
    corners = [np.asarray(ring.coords)[:-1] for part in polygons(region)
               for ring in (part.exterior, *part.interiors)]  # fmt: skip
    if not corners or not polygons(drawn):
        return None, None
    tops = heights.over(drawn, np.concatenate(corners))
    if np.ptp(tops) < 1e-3:
        z = float(np.median(tops))
        return surface(prism(region, z, z + thickness)), z
    vertices, faces = _creased_at(region, drawn)
    lowest = heights.over(drawn, vertices)
    low = np.column_stack([vertices, lowest])
    high = np.column_stack([vertices, lowest + thickness])
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    keys = {(int(a), int(b)) for a, b in edges}
    rim = np.array([(a, b) for a, b in sorted(keys) if (b, a) not in keys], dtype=np.int64)
    count = len(low)
    sides = np.concatenate(
        [
            np.stack([rim[:, 0], rim[:, 1], rim[:, 1] + count], axis=1),
            np.stack([rim[:, 0], rim[:, 1] + count, rim[:, 0] + count], axis=1),
        ]
    )
    all_faces = np.concatenate([faces[:, ::-1], faces + count, sides])
    points = np.concatenate([low, high])[all_faces].reshape(-1, 3)
    return Mesh(points, np.arange(len(points)).reshape(-1, 3)), None


def _creased_at(region: BaseGeometry, drawn: BaseGeometry) -> tuple[Float64Array, np.ndarray]:
    """Triangulate a region with edges along the boundary of `drawn`: (V, 2) and (F, 3).

    A sloping ceiling follows the tops of walls along their inner faces; the part over the walls
    is triangulated apart.
    """
    within, within_faces = triangulated(polygonal(intersection(region, drawn)))
    beyond, beyond_faces = triangulated(polygonal(difference(region, drawn)))
    points = np.round(np.concatenate([within, beyond]), 6)
    faces = np.concatenate([within_faces, beyond_faces + len(within)])
    vertices, index = np.unique(points, axis=0, return_inverse=True)
    return vertices, index.reshape(-1)[faces]


def _covered(mesh: Mesh, finish: Surface, toward: float) -> ItemPart:
    """Return a slab with its finish and texture coordinates; `toward` is -1 for floors, 1 above.

    The top of a floor's image is at the top of the plan; a ceiling's image is mirrored so that
    it is upright seen from below.
    """
    texture = finish.texture
    if texture is not None:
        points = 100 * mesh.vertices[:, :2] * [1.0, -toward]
        if texture.fitting:
            low, high = points.min(axis=0), points.max(axis=0)
            uvs = (points - low) / np.maximum(high - low, 1e-6)
        else:
            uvs = texture_coordinates(points, texture)
        mesh = replace(mesh, uvs=np.stack([uvs[:, 0], 1 - uvs[:, 1]], axis=1))
    return ItemPart(mesh, surface_finish(finish))


def floor_outline(space: Space, walls: BaseGeometry) -> Polygon | None:
    """Return the largest part of a room's floor between `walls`, without holes; None if empty.

    Drawn rooms may reach under walls and into the recesses of doors.
    """
    drawn = space.floor if not space.floor.is_empty else space.ceiling
    between = buffered(difference(drawn, walls), -_SLIVER, join_style="mitre")
    found = [*polygons(buffered(between, _SLIVER, join_style="mitre")), *polygons(drawn)]
    return Polygon(found[0].exterior) if found else None
