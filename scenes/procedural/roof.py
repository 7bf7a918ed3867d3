"""Sloping ceilings: the roof comes down along an outer wall, or two opposite ones, of a home.

Rooms there have a knee wall, and roof windows instead of windows in it. All of the building is made
as for a level ceiling and then cut off below the slopes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
from shapely.geometry import Polygon

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.contract import Portal
from pbrnet.scenes.geometry.regions import buffered, difference, intersection, union
from pbrnet.scenes.procedural.finishes import Finishes
from pbrnet.scenes.procedural.furniture.parts.geometry import BodyMesh, frame_bars, span
from pbrnet.scenes.procedural.plan import WINDOWLESS, Opening, Plan, RoofWindow, Slope, WallEdge
from pbrnet.scenes.procedural.scene_item import SceneItem, make_part
from pbrnet.scenes.seeds import Draw

COVER = 0.24  # metres, vertical thickness of the roof above a slope
PANE = 0.6  # of the cover, height of the panes in it
_SHARE = 0.23  # of the homes, tried; in one of eight no side allows it
_BOTH = 0.4  # of the homes with a slope: another one on the opposite side
_TRIES = 4  # slopes drawn for each side
_KNEES = (1.0, 1.6)  # metres
_RUNS = (1.0, 2.0)  # metres
_RISES = (0.5, 1.4)  # metres per metre
_STANDING = 1.9  # metres, free height where people stand
_SILL = 1.3  # metres, least height of a roof window's lower edge
_OVER = 0.12  # metres above openings in walls that meet the slope
_TOUCH = 1e-9  # metres
_LINING = 0.012  # thickness of the boards round a roof window


def draw_roof(rng: Draw, plan: Plan) -> Plan:
    """Return the plan with slopes where the draw wants them and its rooms allow them.

    Homes with slopes have no beams and no stairs.
    """
    if rng.random() > _SHARE:
        return plan
    both = rng.chance(_BOTH)
    x0, y0, x1, y1 = Polygon(plan.inner).bounds
    corners = ((x0, y1), (x0, y0), (x1, y0), (x1, y1), (x0, y1))
    sides = [WallEdge(start, end, True) for start, end in pairwise(corners)]
    bare = replace(plan, beams=(), stairs=None)
    one: Plan | None = None
    for index in rng.permutation(4).tolist():
        sloping = _with_slope(rng, bare, sides[index])
        opposite = sloping and _with_slope(rng, sloping, sides[(index + 2) % 4])
        if both and opposite:
            return opposite
        one = one or sloping
    return one or plan


def _with_slope(rng: Draw, plan: Plan, side: WallEdge) -> Plan | None:
    """Return the plan with a slope along one side; None if none of the drawn ones is possible."""
    for _ in range(_TRIES):
        knee = round(rng.between(*_KNEES), 3)
        run = round(rng.between(*_RUNS), 3)
        made = Slope(side, knee, run, plan.height)
        if not _RISES[0] < made.rise < _RISES[1] or not _has_sound_walls(plan, made):
            continue
        below, beside = _openings_below(plan, made)
        if beside is None:
            continue
        sloping = replace(
            plan,
            slopes=(*plan.slopes, made),
            openings=tuple(beside),
            roof_windows=(*plan.roof_windows, *_roof_windows(rng, plan, made, below)),
        )
        needed = {room.id for room in plan.rooms if room.type not in WINDOWLESS}
        if needed <= sloping.with_window and sloping.with_window and _are_high(sloping):
            return sloping
    return None


def _has_sound_walls(plan: Plan, slope: Slope) -> bool:
    """Test that no outer wall but the slope's own runs along it below it, or just behind it."""
    ring = plan.inner
    for start, end in zip(ring, ring[1:] + ring[:1], strict=True):
        first, last = (slope.edge.coordinates(point)[1] for point in (start, end))
        if abs(first - last) < 1e-3 and 1e-3 < first < slope.run + plan.outer_thickness + 0.4:
            return False
    return True


def _openings_below(plan: Plan, slope: Slope) -> tuple[list[Opening], list[Opening] | None]:
    """Windows in the slope's wall, and the openings that stay; None if doors have no room.

    Windows in other walls that reach above the slope go.
    """
    inside, kept = [], []
    sloping = replace(plan, slopes=(*plan.slopes, slope))
    for opening in plan.openings:
        is_window = opening.kind in ("window", "patio")
        own = opening.edge.faces_like(slope.edge) and opening.is_outer
        if own and abs(slope.edge.coordinates(opening.start)[1]) < 1e-3:
            if not is_window:
                return [], None
            inside.append(opening)
            continue
        swings = opening.kind in ("door", "entrance")
        around = buffered(opening.footprint, opening.width + 0.1 if swings else _OVER)
        if sloping.free_height(around) > opening.z1 + _OVER:
            kept.append(opening)
        elif not is_window:
            return [], None
    return inside, kept


def _roof_windows(rng: Draw, plan: Plan, slope: Slope, windows: list[Opening]) -> list[RoofWindow]:
    """Roof windows above the places of windows in the slope's wall; two for a wide one."""
    found: list[RoofWindow] = []
    wide = round(rng.between(0.62, 1.15), 2)
    near = round(max(rng.between(0.14, 0.22), _depth_of(slope, _SILL)), 3)
    far = round(min(slope.run - rng.between(0.12, 0.25), near + 1.3), 3)
    for window in windows:
        middle = slope.edge.coordinates(window.edge.at(0.5 * window.width))[0]
        count = 2 if window.width > 2 * wide + 0.1 else 1
        for number in range(count):
            centre = middle + (number - 0.5 * (count - 1)) * (wide + 0.24)
            s0, s1 = round(centre - 0.5 * wide, 4), round(centre + 0.5 * wide, 4)
            name = window.id if number == 0 else f"{window.id}-{number + 1}"
            made = RoofWindow(name, window.rooms[0], slope, s0, s1, near, far)
            around = buffered(made.footprint, 0.1, join_style="mitre")
            if far - near > 0.45 and plan.room(made.room).shape.covers(around):
                found.append(made)
    return found


def _are_high(plan: Plan) -> bool:
    """Test that people can stand in most of each room, and get to all of that."""
    for room in plan.rooms:
        lows = [
            slope.edge.strip(-9.0, slope.edge.length + 9.0, -9.0, _depth_of(slope, _STANDING))
            for slope in plan.slopes
        ]
        high = difference(room.shape, union(lows))
        walked = buffered(high, -0.35, join_style="mitre")
        if high.area < 0.55 * room.shape.area or walked.geom_type != "Polygon" or walked.is_empty:
            return False
        if level_part(plan, room.shape).area < 0.3 * room.shape.area:
            return False
    return True


def _depth_of(slope: Slope, height: float) -> float:
    """Metres from the wall to where the ceiling has a height."""
    return max(0.0, (height - slope.knee) / slope.rise)


def level_part(plan: Plan, shape: Polygon) -> Polygon:
    """Return the part of a floor below the level ceiling."""
    return difference(shape, union([slope.strip() for slope in plan.slopes]))


def gable_cuts(plan: Plan, edge: WallEdge, lift: float) -> tuple[list[float], list[float]]:
    """Places (along, up) where a wall is divided, so that most of it stays rectangles.

    `lift` is how far the wall reaches into the roof, metres.
    """
    across, up = [], []
    for slope in plan.slopes:
        first, last = (slope.edge.coordinates(point)[1] for point in (edge.start, edge.end))
        if min(first, last) < slope.run:
            up.append(slope.height_at(*(edge.start if first < last else edge.end)) + lift)
            if abs(last - first) > 1e-3:
                across.append((slope.run - first) / (last - first) * edge.length)
    return across, up


def cut_below(mesh: BodyMesh, plan: Plan, lift: float) -> tuple[BodyMesh | None, BodyMesh | None]:
    """Return what of a wall is lower than `lift` metres above the slopes: quadrilaterals, gables.

    The wall's faces are pairs of triangles that make up quadrilaterals. Those that are cut become
    triangles.
    """
    rows = np.column_stack([mesh.vertices, mesh.uvs])
    quads = rows[mesh.faces.reshape(-1, 6)[:, [0, 1, 2, 5]]]
    signed = [slope.height_at(quads[..., 0], quads[..., 1]) + lift for slope in plan.slopes]
    whole = np.ones(len(quads), dtype=bool)
    for heights in signed:
        whole &= (heights - quads[..., 2] > -_TOUCH).all(axis=1)
    gables = []
    for outline in quads[~whole]:
        for slope in plan.slopes:
            below = slope.height_at(outline[:, 0], outline[:, 1]) + lift - outline[:, 2]
            outline = _cut(outline, below)
        gables += [outline[[0, k, k + 1]] for k in range(1, len(outline) - 1)]
    return _sheet(quads[whole][:, [0, 1, 2, 0, 2, 3]]), _sheet(np.array(gables))


def _sheet(corners: Float64Array) -> BodyMesh | None:
    """Mesh of separate triangles from rows of vertices with uvs; None without any."""
    flat = corners.reshape(-1, 5)
    faces = np.arange(len(flat), dtype=np.int64).reshape(-1, 3)
    return BodyMesh(flat[:, :3], faces, flat[:, 3:]) if len(flat) else None


def _cut(outline: Float64Array, signed: Float64Array) -> Float64Array:
    """Part of a convex polygon where `signed` is positive (Sutherland and Hodgman 1974)."""
    kept = []
    for k in range(len(outline)):
        there = (k + 1) % len(outline)
        if signed[k] > _TOUCH:
            kept.append(outline[k])
        if (signed[k] > _TOUCH) != (signed[there] > _TOUCH):
            share = signed[k] / (signed[k] - signed[there])
            kept.append((1 - share) * outline[k] + share * outline[there])
    return np.array(kept).reshape(-1, outline.shape[1])


def panels(
    plan: Plan,
    area: Polygon,
    low: float,
    high: tuple[float, float],
    extrude: Callable[[Polygon, float, float], BodyMesh],
    lap: float,
    margin: float = 0.0,
) -> tuple[list[BodyMesh], list[BodyMesh]]:
    """Level and sloping slabs that together cover an area.

    They begin `low` metres above the ceiling and end `high` (level, sloping) metres above it.
    Sloping ones end `lap` metres within the level one, and have holes for the roof's windows,
    grown by a margin.
    """
    level = level_part(plan, area) if plan.slopes else area
    flat = [extrude(level, plan.height + low, plan.height + high[0])]
    sloping = []
    for slope in plan.slopes:
        part = intersection(area, slope.strip(lap))
        for window in plan.roof_windows:
            if window.slope == slope:
                hole = buffered(window.footprint, margin, join_style="mitre")
                part = difference(part, hole)
        if part.area > 1e-6:
            sloping.append(raised(slope, extrude(part, low, high[1])))
    return flat, sloping


def raised(slope: Slope, mesh: BodyMesh) -> BodyMesh:
    """Return a body that was made as if the slope were level at z = 0, sheared up to it."""
    vertices = mesh.vertices.copy()
    x, y, z = vertices.T
    vertices[:, 2] = z + slope.height_at(x, y)
    (ax, ay), (nx, ny) = slope.edge.along, slope.edge.inward
    # In metres along the slope, so that textures keep their scale.
    steep = float(np.sqrt(1 + slope.rise * slope.rise))
    uvs = np.stack([x * ax + y * ay, (x * nx + y * ny) * steep], axis=1)
    return BodyMesh(vertices, mesh.faces, uvs, mesh.smooth)


def roof_window(window: RoofWindow, finishes: Finishes) -> SceneItem:
    """Roof window: boards through the roof round it, frame, sash and handle, without panes."""
    s0, s1, d0, d1 = window.s0, window.s1, window.near, window.far
    middle = PANE * COVER

    def block(a: float, b: float, c: float, d: float, z0: float, z1: float) -> BodyMesh:
        """Sheared box over [a, b] along the wall and [c, d] away from it."""
        x0, y0, x1, y1 = window.slope.edge.strip(a, b, c, d).bounds
        return raised(window.slope, span((x0, y0, z0), (x1, y1, z1)))

    def border(inset: float, wide: float, z0: float, z1: float) -> list[BodyMesh]:
        """Four bars round the window, from `inset` metres inside its outline."""
        a, b, c, d = s0 + inset, s1 - inset, d0 + inset, d1 - inset
        bars = frame_bars((a, b, c, d), (a + wide, b - wide, c + wide, d - wide))
        return [block(*bar, z0, z1) for bar in bars]

    boards = border(-_LINING, _LINING + 0.001, -0.004, COVER + 0.012)
    frame = border(-0.004, 0.044, middle - 0.045, middle + 0.03)
    sash = border(0.034, 0.05, middle - 0.058, middle + 0.018)
    centre = 0.5 * (s0 + s1)
    handle = [
        block(centre - 0.16, centre + 0.16, d1 - 0.072, d1 - 0.06, middle - 0.1, middle - 0.088),
        block(centre - 0.15, centre - 0.14, d1 - 0.071, d1 - 0.061, middle - 0.09, middle - 0.05),
        block(centre + 0.14, centre + 0.15, d1 - 0.071, d1 - 0.061, middle - 0.09, middle - 0.05),
    ]
    parts = [
        make_part("lining", finishes.ceiling, *boards),
        make_part("frame", finishes.frame, *frame, *sash),
        make_part("handle", finishes.handle, *handle),
    ]
    return SceneItem(window.id, "window", "window", tuple(parts), True, window.room)


def roof_portal(window: RoofWindow) -> Portal:
    """Portal of a roof window, in the plane of its panes."""
    slope = window.slope
    s0, s1, near, far = window.s0, window.s1, window.near, window.far
    corners = [slope.edge.at(*at) for at in ((s0, near), (s0, far), (s1, far), (s1, near))]
    (nx, ny), rise = slope.edge.inward, slope.rise
    length = (1 + rise * rise) ** 0.5
    return Portal(
        id=f"portal-{window.id}",
        kind="window",
        polygon=tuple(
            (round(x, 6), round(y, 6), round(slope.height_at(x, y) + PANE * COVER, 6))
            for x, y in corners
        ),
        normal=(-nx * rise / length + 0.0, -ny * rise / length + 0.0, 1 / length),
        clear=True,
        room=window.room,
        panes=2,
    )
