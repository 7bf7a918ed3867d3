"""Walls and skirtings as closed solids: two halves with a finish each, openings cut out."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import manifold3d
import numpy as np
from shapely import STRtree
from shapely.geometry import Point
from shapely.geometry.base import BaseGeometry

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.geometry.mesh import Mesh, creased
from pbrnet.scenes.geometry.regions import union
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.sweethome.building.levels import Storey
from pbrnet.scenes.sweethome.building.openings import Opening
from pbrnet.scenes.sweethome.building.outlines import (
    Outline,
    arc_centre,
    has_length,
    is_round,
    joined,
)
from pbrnet.scenes.sweethome.building.solids import (
    cut,
    prism,
    surface,
    triangle_normals,
    world_region,
)
from pbrnet.scenes.sweethome.furnishing.finishes import (
    reflectance_of_argb,
    surface_finish,
    texture_coordinates,
)
from pbrnet.scenes.sweethome.furnishing.items import ItemPart, PlacedItem, SurfaceFinish
from pbrnet.scenes.sweethome.home import Baseboard, Surface, Texture, Wall

EMBED = 0.5  # cm by which walls extend into floor and ceiling
_NEARLY = 20.0  # cm: a wall that ends no farther below the ceiling is raised to it
_GAP = 4.0  # cm: smaller gaps between a free end and another wall are closed; `spaces` takes
# them for closed, too
_ROUND = 25.0  # degrees between facets that are smoothed on round walls


@dataclass(frozen=True)
class PlannedWall:
    """A wall with its outline (cm) and its height at both ends above the ground (cm)."""

    wall: Wall
    outline: Outline
    bottom: float
    top_at_start: float
    top_at_end: float

    def top(self, points: Float64Array) -> Float64Array:
        """Return the height (N,) of the wall's top, cm above the ground, at plan points (N, 2).

        It is linear along the line from start to end, for round walls too.
        """
        start, end = np.array(self.wall.start), np.array(self.wall.end)
        along = end - start
        share = (np.asarray(points) - start) @ along / max(float(along @ along), 1e-12)
        return self.top_at_start + share * (self.top_at_end - self.top_at_start)


def plan_walls(storey: Storey, wall_height: float, changes: Changes) -> list[PlannedWall]:
    """Return outlines and heights of the walls of a storey."""
    usable = [wall for wall in storey.walls if has_length(wall)]
    for wall in storey.walls:
        if not has_length(wall):
            changes.note("walls without length were left out: {}", wall.id)
    usable = _extended_to_neighbours(usable)
    by_id = {wall.id: wall for wall in usable}
    planned = []
    for wall in usable:
        height = wall_height if wall.height is None else wall.height
        at_end = height if wall.height_at_end is None else wall.height_at_end
        tops = [storey.elevation + height, storey.elevation + at_end]
        ceiling = storey.elevation + storey.height
        if not storey.is_highest and 0 < ceiling - min(tops) <= _NEARLY and tops[0] == tops[1]:
            tops = [ceiling, ceiling]
            changes.note("walls that ended just below their ceiling were raised to it")
        if min(tops) <= storey.elevation and max(tops) <= storey.elevation:
            changes.note("walls without height were left out: {}", wall.id)
            continue
        planned.append(PlannedWall(wall, joined(wall, by_id), storey.base, *tops))
    return planned


def build_walls(
    storey: Storey, planned: list[PlannedWall], openings: list[Opening]
) -> list[PlacedItem]:
    """Return one item for each wall and one for each skirting, openings cut out."""
    if not planned:
        return []
    boards = {
        planned_wall.wall.id: tuple(
            board.thickness if board is not None else 0.0
            for board in (planned_wall.wall.left_baseboard, planned_wall.wall.right_baseboard)
        )
        for planned_wall in planned
    }
    by_id = {planned_wall.wall.id: planned_wall.wall for planned_wall in planned}
    items = []
    footprints = STRtree([opening.footprint for opening in openings])
    for number, one in enumerate(planned):
        region = one.outline.region
        holes = []
        for near in sorted(footprints.query(region).tolist()):
            opening = openings[near]
            depths = opening.depths(region, is_round(one.wall))
            if depths is not None:
                holes.append(opening.hole(*depths, storey.elevation))
        name = f"wall-{storey.number}-{number}"
        parts = _wall_parts(one, holes)
        if parts:
            items.append(PlacedItem(name, "wall", "wall", tuple(parts), True, level=storey.number))
        skirting = []
        thick = joined(one.wall, by_id, boards)  # type: ignore[arg-type]
        for board, inner, outer in (
            (one.wall.left_baseboard, one.outline.left, thick.left),
            (one.wall.right_baseboard, one.outline.right, thick.right),
        ):
            if board is not None and board.thickness > 0 and board.height > 0:
                strip = one.outline.ring(inner, outer)
                skirting += _board_parts(one, board, strip, storey.elevation, holes)
        if skirting:
            items.append(
                PlacedItem(
                    f"skirting-{storey.number}-{number}",
                    "skirting",
                    "skirting",
                    tuple(skirting),
                    True,
                    level=storey.number,
                )
            )
    return items


def _wall_parts(one: PlannedWall, holes: list[manifold3d.Manifold]) -> list[ItemPart]:
    parts: list[ItemPart] = []
    middle = one.outline.middle
    for side, line, is_left in (
        (one.wall.left, one.outline.left, True),
        (one.wall.right, one.outline.right, False),
    ):
        half = world_region(one.outline.ring(line, middle))

        def top(points: Float64Array) -> Float64Array:
            lifted = one.top(points * [100, -100]) + EMBED
            return 0.01 * np.maximum(lifted, one.bottom)

        solid = cut(prism(half, 0.01 * (one.bottom - EMBED), top), holes)
        mesh = surface(solid)
        if mesh is None:
            continue
        parts += _half_wall_parts(one, mesh, side, is_left)
    return parts


def _half_wall_parts(one: PlannedWall, mesh: Mesh, side: Surface, is_left: bool) -> list[ItemPart]:
    """Return the surface of half a wall: its top in the top's colour, the rest in the side's."""
    finish = surface_finish(side)
    highest = _is_top(one, mesh) if one.wall.top_color is not None else np.zeros(0, dtype=bool)
    parts = []
    if highest.any() and one.wall.top_color is not None:
        parts.append(
            ItemPart(
                mesh.subset(highest), SurfaceFinish(color=reflectance_of_argb(one.wall.top_color))
            )
        )
        mesh = mesh.subset(~highest)
    if side.texture is not None:
        mesh = replace(mesh, uvs=wall_uvs(one, mesh, side.texture, is_left))
    if is_round(one.wall):
        mesh = creased(mesh, _ROUND)
    return [ItemPart(mesh, finish), *parts]


def _is_top(one: PlannedWall, mesh: Mesh) -> np.ndarray:
    middles = mesh.corners.mean(axis=1)
    top = 0.01 * (one.top(middles[:, :2] * [100, -100]) + EMBED)
    return (triangle_normals(mesh)[:, 2] > 0.3) & (np.abs(middles[:, 2] - top) < 2e-3)


def wall_uvs(one: PlannedWall, mesh: Mesh, texture: Texture, is_left: bool) -> Float64Array:
    """Return texture coordinates (V, 2) of a wall's side: along the wall from its start, and up.

    Seen from the front an image is upright and not mirrored. On ends, tops and reveals it
    continues along or across the wall.
    """
    points = mesh.vertices[:, :2] * [100, -100]
    along, through = _along(one.wall, points)
    line = one.outline.left if is_left else one.outline.right
    along = along - _along(one.wall, line[:1])[0][0]
    up = 100 * mesh.vertices[:, 2]
    if is_left and texture.left_to_right:
        along = -along
    normals = np.repeat(triangle_normals(mesh), 3, axis=0)
    flat = np.abs(normals[:, 2]) > 0.7
    # Ends and reveals: the normal is parallel to the wall.
    step = 0.5
    ahead, _ = _along(one.wall, points + step * normals[:, :2] * [1, -1])
    base, _ = _along(one.wall, points)
    across = ~flat & (np.abs(ahead - base) > 0.7 * step)
    u = np.where(across, through, along)
    v = np.where(flat, through, up)
    coordinates = np.stack([u, v], axis=1)
    if texture.fitting:
        low, high = coordinates.min(axis=0), coordinates.max(axis=0)
        uvs = (coordinates - low) / np.maximum(high - low, 1e-6)
    else:
        uvs = texture_coordinates(coordinates, texture)
    return np.stack([uvs[:, 0], 1 - uvs[:, 1]], axis=1)


def _along(wall: Wall, points: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return distances (cm) of plan points along the centre line of a wall and to its left."""
    start, end = np.array(wall.start), np.array(wall.end)
    if is_round(wall):
        assert wall.arc is not None
        centre = arc_centre(wall)
        radius = math.dist(centre, wall.start)
        middle = math.atan2(*(start - centre)[::-1]) + 0.5 * wall.arc
        offset = points - centre
        angle = np.arctan2(offset[:, 1], offset[:, 0]) - middle
        angle = (angle + math.pi) % (2 * math.pi) - math.pi
        sign = math.copysign(1.0, wall.arc)
        return (
            radius * (sign * angle + 0.5 * abs(wall.arc)),
            sign * (np.linalg.norm(offset, axis=1) - radius),
        )
    direction = (end - start) / math.dist(wall.start, wall.end)
    left = np.array([direction[1], -direction[0]])
    return (points - start) @ direction, (points - start) @ left


def _board_parts(
    one: PlannedWall,
    board: Baseboard,
    strip: BaseGeometry,
    floor: float,
    holes: list[manifold3d.Manifold],
) -> list[ItemPart]:
    top = min(floor + board.height, max(one.top_at_start, one.top_at_end))
    if top <= floor:
        return []
    solid = prism(world_region(strip), 0.01 * (floor - EMBED), 0.01 * top)
    mesh = surface(cut(solid, holes))
    if mesh is None:
        return []
    if board.surface.texture is not None:
        mesh = replace(mesh, uvs=wall_uvs(one, mesh, board.surface.texture, False))
    if is_round(one.wall):
        mesh = creased(mesh, _ROUND)
    return [ItemPart(mesh, surface_finish(board.surface))]


def _extended_to_neighbours(walls: list[Wall]) -> list[Wall]:
    """Extend walls whose free ends stop just short of another wall into that wall."""
    by_id = {wall.id: wall for wall in walls}
    regions = [joined(wall, by_id).region for wall in walls]
    tree = STRtree(regions)
    made = []
    for number, wall in enumerate(walls):
        if is_round(wall):
            made.append(wall)
            continue
        near = tree.query(regions[number], predicate="dwithin", distance=_GAP)
        others = union([regions[other] for other in sorted(near) if other != number])
        start, end = np.array(wall.start), np.array(wall.end)
        along = (end - start) / math.dist(wall.start, wall.end)
        if not others.is_empty:
            if wall.wall_at_start not in by_id:
                start = start - along * _reach(start, others)
            if wall.wall_at_end not in by_id:
                end = end + along * _reach(end, others)
        made.append(replace(wall, start=_pair(start), end=_pair(end)))
    return made


def _reach(tip: Float64Array, others: BaseGeometry) -> float:
    distance = others.distance(Point(tip))
    return distance + 1.0 if 0 <= distance < _GAP and not others.contains(Point(tip)) else 0.0


def _pair(point: Float64Array) -> tuple[float, float]:
    return (float(point[0]), float(point[1]))
