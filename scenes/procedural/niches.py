"""Niches: linings in front of walls with a recess for a few boards and what stands on them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.assets.free_space import SupportSurface
from pbrnet.scenes.geometry.regions import buffered
from pbrnet.scenes.procedural.furniture.parts.geometry import BodyMesh, prism, span
from pbrnet.scenes.procedural.piece import FurniturePiece, Material, PiecePart
from pbrnet.scenes.procedural.plan import Niche, Plan, PlanRoom, WallEdge
from pbrnet.scenes.procedural.scene_item import make_part
from pbrnet.scenes.seeds import Draw

BACK = 0.025  # metres, of the lining behind its recess
BOARD = 0.024  # metres, thickness of a board
_EMBED = 0.01  # metres that the lining reaches into wall, floor and ceiling
_SHARE = 0.26  # of the rooms, tried: in many no wall has place for one
_ROOMS = ("living", "bedroom", "dining", "study", "bathroom", "hall")
_LEVEL = 0.3  # metres, least height between boards
_BEFORE = 0.8  # metres that stay free before it


def draw_niches(rng: Draw, plan: Plan) -> Plan:
    """Return the plan with a niche in some of its rooms, where a wall has place for one."""
    drawn = [_draw_niche(rng, plan, room) for room in plan.rooms if room.type in _ROOMS]
    return replace(plan, niches=tuple(niche for niche in drawn if niche is not None))


def _draw_niche(rng: Draw, plan: Plan, room: PlanRoom) -> Niche | None:
    wanted = rng.chance(_SHARE)
    wide, depth = round(rng.between(0.75, 1.5), 3), round(rng.between(0.16, 0.3), 3)
    pier = round(rng.between(0.08, 0.14), 3)
    low, top = round(rng.between(0.4, 0.95), 3), round(rng.between(1.75, 2.15), 3)
    count = rng.whole(1, 5)
    order = rng.shuffled(range(len(room.edges)))
    place = rng.between(0.3, 0.7)
    if not wanted:
        return None
    if room.type == "bathroom":
        low += 0.3
    count = max(1, min(count, int((top - low) / _LEVEL)))
    between = np.linspace(low, top, count + 1)[1:-1]
    ways = [
        one.edge_in(room.id).strip(
            *((-0.35, one.width + 0.35) if one.kind == "window" else (-0.2, one.width + 0.2)),
            0.0,
            0.4 if one.kind == "window" else one.width + 0.15,
        )
        for one in plan.openings
        if room.id in one.rooms
    ]
    if plan.stairs is not None and plan.stairs.room == room.id:
        ways.append(buffered(plan.stairs.footprint, _BEFORE))
    floor = buffered(room.shape, 1e-3, join_style="mitre")
    for index in order:
        edge = room.edges[index]
        following = room.edges[(index + 1) % len(room.edges)]
        free = edge.length - wide
        starts = [round(place * free, 3)]
        if _is_corner(edge, following):
            starts.insert(0, free)
        if _is_corner(room.edges[index - 1], edge):
            starts.insert(0, 0.0)
        for s0 in starts if free > 0.3 else []:
            hole = (s0 + pier, s0 + wide - pier, low, top)
            boards = tuple(round(float(z), 4) for z in between)
            niche = Niche(room.id, edge, s0, s0 + wide, depth, hole, boards)
            before = edge.strip(s0, s0 + wide, 0.0, depth + _BEFORE)
            beside = edge.strip(s0 - 0.1, s0 + wide + 0.1, 0.0, depth)
            if (
                floor.covers(before)
                and not any(before.intersects(way) or beside.intersects(way) for way in ways)
                and plan.free_height(niche.footprint) > plan.height - 1e-6
            ):
                return niche
    return None


def _is_corner(edge: WallEdge, following: WallEdge) -> bool:
    """Test whether two walls of a room meet in a corner, and not at the end of one of them."""
    return edge.along[0] * following.along[1] - edge.along[1] * following.along[0] > 0


def niche_parts(niche: Niche, height: float, lining: Material, board: Material) -> list[PiecePart]:
    """Lining and boards of a niche in a room of some height."""
    # In a corner the lining reaches into the other wall.
    low = niche.s0 - _EMBED if niche.s0 < 1e-6 else niche.s0
    high = niche.s1 + _EMBED if niche.s1 > niche.edge.length - 1e-6 else niche.s1
    a, b, z0, z1 = niche.hole
    lap = 0.004
    front = prism(
        _rectangle(low, high, -_EMBED, height + _EMBED), -_EMBED, niche.depth,
        [_rectangle(a, b, z0, z1)],
    )  # fmt: skip
    back = prism(_rectangle(a - lap, b + lap, z0 - lap, z1 + lap), 0.5 * _EMBED, BACK)
    parts = [make_part("niche", lining, _stood(niche, front), _stood(niche, back))]
    boards = [
        span((a - lap, z - BOARD, BACK - lap), (b + lap, z, niche.depth - 0.012))
        for z in niche.boards
    ]
    if boards:
        parts.append(make_part("boards", board, *(_stood(niche, each) for each in boards)))
    return parts


def niche_piece(niche: Niche) -> FurniturePiece:
    """The niche as a carrier of things: its recess's floor and boards. It has no parts."""
    a, b, z0, z1 = niche.hole
    levels = (z0, *niche.boards)
    tops = (*(z - BOARD for z in niche.boards), z1)
    # Its x axis points against the wall's direction, its y axis out of the room.
    middle = 0.5 * (niche.s0 + niche.s1)
    surfaces = [
        SupportSurface(
            x=middle - 0.5 * (a + b),
            y=-0.5 * (BACK + niche.depth),
            z=level,
            half_x=0.5 * (b - a) - 0.012,
            half_y=0.5 * (niche.depth - BACK) - 0.014,
            headroom=top - level - 0.012,
        )
        for level, top in zip(levels, tops, strict=True)
    ]
    return FurniturePiece("niche", "wall", (), "wall", surfaces=tuple(surfaces))


def niche_solids(niche: Niche, height: float) -> Float64Array:
    """Boxes (N, 2, 3) that the lining and its boards fill."""
    a, b, z0, z1 = niche.hole
    deep = niche.depth
    blocks = [
        (niche.s0, a, 0.0, deep, 0.0, height),
        (b, niche.s1, 0.0, deep, 0.0, height),
        (a, b, 0.0, deep, 0.0, z0),
        (a, b, 0.0, deep, z1, height),
        (a, b, 0.0, BACK, z0, z1),
        *((a, b, BACK, deep, z - BOARD, z) for z in niche.boards),
    ]
    boxes = []
    for s0, s1, near, far, low, high in blocks:
        x0, y0, x1, y1 = niche.edge.strip(s0, s1, near, far).bounds
        boxes.append([[x0, y0, low], [x1, y1, high]])
    return np.array(boxes)


def _rectangle(a: float, b: float, c: float, d: float) -> list[tuple[float, float]]:
    return [(a, c), (b, c), (b, d), (a, d)]


def _stood(niche: Niche, mesh: BodyMesh) -> BodyMesh:
    """From (along the wall, up, into the room) to the world."""
    s, up, away = mesh.vertices.T
    vertices = niche.edge.points(s, away, up)
    return BodyMesh(vertices, mesh.faces[:, ::-1], mesh.uvs, mesh.smooth)
