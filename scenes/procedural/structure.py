"""Building geometry: walls, floors, ceilings, doors, windows and mouldings.

Walls are faces towards the rooms and the outdoors, joined by the reveals of openings. Their upper
and lower edges extend into slabs that cover the whole storey, so light enters through openings
only. Windows have frames but no panes: a clear pane is a portal (see `pbrnet.scenes.contract`).
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import shapely
from shapely.geometry import MultiPolygon, Polygon

from pbrnet.scenes.arrays import Int64Array, as_triple
from pbrnet.scenes.contract import Joint, Portal
from pbrnet.scenes.geometry.regions import buffered, difference, union
from pbrnet.scenes.procedural.finishes import Finishes, RoomFinish
from pbrnet.scenes.procedural.furniture.parts.build import WIDEST
from pbrnet.scenes.procedural.furniture.parts.geometry import (
    BodyMesh,
    bar,
    cylinder,
    frame_bars,
    merge,
    prism,
    span,
)
from pbrnet.scenes.procedural.niches import niche_parts
from pbrnet.scenes.procedural.piece import Material, PiecePart
from pbrnet.scenes.procedural.plan import STEP, Opening, Plan, PlanRoom, WallEdge
from pbrnet.scenes.procedural.roof import (
    COVER,
    cut_below,
    gable_cuts,
    panels,
    roof_portal,
    roof_window,
)
from pbrnet.scenes.procedural.scene_item import SceneItem, make_part

EMBED = 0.02  # metres that walls extend into the slabs below and above
LAP = 0.005  # metres that faces overlap at inner corners
LINING = 0.02  # door lining, thickness
CASING = (0.07, 0.015)  # door casing, width and thickness
LEAF = 0.04  # thickness of a door leaf
FRAME = (0.05, 0.065)  # window frame, width and depth
_SASH = 0.045  # width of the frame of a sash
SKIRTING = 0.014  # thickness
GABLE = "gable_"  # before the names of parts that are not made of rectangles

Hole = tuple[float, float, float, float]  # s0, s1, z0, z1


def build_structure(plan: Plan, finishes: Finishes) -> tuple[list[SceneItem], list[Portal]]:
    """Build the items of the building and the portals in its outer walls."""
    items: list[SceneItem] = []
    for room in plan.rooms:
        finish = finishes.rooms[room.id]
        own = plan if room.height is None else replace(plan, height=room.height)
        items.append(_structure_item(f"floor-{room.id}", "floor", room.id, [_floor(room, finish)]))
        items.append(
            _structure_item(f"walls-{room.id}", "wall", room.id, _walls(own, room, finish))
        )
        whole = buffered(room.shape, EMBED, join_style="mitre")
        well = _stairwell(plan, room, 0.005)
        area = whole if well is None else difference(whole, well)
        level, sloping = panels(own, area, 0.0, (EMBED, EMBED), _extrude, lap=0.01, margin=0.004)
        parts = [make_part("ceiling", finishes.ceiling, *level, *sloping)]
        items.append(_structure_item(f"ceiling-{room.id}", "ceiling", room.id, parts))
        trim = _trim(own, room, finishes, finish)
        if trim:
            items.append(_structure_item(f"trim-{room.id}", "skirting", room.id, trim))
        items += _beams(plan, room, finishes)
    for niche in plan.niches:
        finish = finishes.rooms[niche.room]
        lining = finish.wall_tiles or finish.wall
        made = niche_parts(niche, plan.height, lining, finishes.threshold)
        items.append(_structure_item(f"niche-{niche.room}", "wall", niche.room, made))
    items += _stairs(plan, finishes)
    items.append(_facade(plan, finishes))
    items.append(_slabs(plan, finishes))
    portals = [roof_portal(window) for window in plan.roof_windows]
    items += [roof_window(window, finishes) for window in plan.roof_windows]
    for opening in plan.openings:
        if opening.kind in ("window", "patio"):
            items.append(_window(opening, finishes))
            portals.append(_portal(opening, clear=True))
        elif opening.kind != "open":
            items.append(_door(opening, finishes))
            if opening.kind == "entrance":
                portals.append(_portal(opening, clear=False))
    return items, portals


def pane_depth(opening: Opening) -> float:
    """Return the distance from the wall face to the centre of the frame or closed door, metres."""
    return 0.5 * LEAF if opening.kind == "entrance" else 0.6 * opening.thickness


def leaf_footprint(plan: Plan, opening: Opening) -> Polygon | None:
    """Return the footprint of an open door leaf; None without a leaf or if it is closed."""
    if opening.kind != "door" or opening.angle == 0:
        return None
    leaf = _leaf(opening, opening.edge_in(opening.swing), Material("paint", (0.5, 0.5, 0.5)), None)
    points = np.concatenate([part.vertices for part in leaf])
    return shapely.MultiPoint(points[:, :2]).convex_hull


def _structure_item(
    item_id: str, category: str, room: str | None, parts: list[PiecePart]
) -> SceneItem:
    return SceneItem(item_id, category, category, tuple(parts), True, room)


def _polygons(shape: Polygon | MultiPolygon) -> list[Polygon]:
    parts = list(getattr(shape, "geoms", [shape]))
    return [part for part in parts if part.geom_type == "Polygon" and part.area > 1e-6]


def _extrude(shape: Polygon | MultiPolygon, z0: float, z1: float) -> BodyMesh:
    return merge(
        prism(
            shapely.get_coordinates(polygon.exterior)[:-1],
            z0,
            z1,
            [shapely.get_coordinates(hole)[:-1] for hole in polygon.interiors],
        )
        for polygon in _polygons(shape)
    )


def _stairwell(plan: Plan, room: PlanRoom | None, margin: float) -> Polygon | None:
    """Opening in the ceiling above stairs, grown by a margin; None without stairs in the room."""
    stairs = plan.stairs
    if stairs is None or (room is not None and stairs.room != room.id):
        return None
    # Free of the wall, whose face ends at the ceiling; open where less than 2.05 m remain above.
    closed = 0.9 * (1 - 2.05 / plan.height) * (stairs.s1 - stairs.s0)
    s0, s1 = stairs.s0 + 0.03, stairs.s1 - 0.03
    s0, s1 = (s0, s1 - closed) if stairs.reverse else (s0 + closed, s1)
    hole = stairs.edge.strip(s0, s1, 0.03, stairs.width)
    return buffered(hole, margin, join_style="mitre")


def _floor(room: PlanRoom, finish: RoomFinish) -> PiecePart:
    mesh = _extrude(buffered(room.shape, EMBED, join_style="mitre"), -EMBED, 0.0)
    x0, y0, x1, y1 = room.shape.bounds
    uvs = mesh.vertices[:, :2] - (x0, y0)
    if y1 - y0 > x1 - x0:  # planks run along the room
        uvs = uvs[:, ::-1].copy()
    return make_part("floor", finish.floor, BodyMesh(mesh.vertices, mesh.faces, uvs))


def _face(
    edge: WallEdge,
    z0: float,
    z1: float,
    holes: list[Hole],
    s0: float,
    s1: float,
    cuts: tuple[list[float], list[float]] = ([], []),
) -> BodyMesh | None:
    """Rectangle [s0, s1] x [z0, z1] of a wall face minus its holes, facing the room.

    `cuts` are further places (along, up) where it is divided.
    """
    across_cuts = [*(s for hole in holes for s in hole[:2]), *cuts[0]]
    up_cuts = [*(z for hole in holes for z in hole[2:]), *cuts[1]]
    s_cuts = {s0, s1, *(min(max(s, s0), s1) for s in across_cuts)}
    z_cuts = {z0, z1, *(min(max(z, z0), z1) for z in up_cuts)}
    across, up = sorted(s_cuts), sorted(z_cuts)
    quads = []
    for a, b in pairwise(across):
        for c, d in pairwise(up):
            s, z = 0.5 * (a + b), 0.5 * (c + d)
            if not any(h[0] < s < h[1] and h[2] < z < h[3] for h in holes):
                quads.append([(a, c), (a, d), (b, d), (b, c)])
    if not quads:
        return None
    flat = np.array(quads).reshape(-1, 2)
    vertices = np.empty((len(flat), 3))
    vertices[:, 0] = edge.start[0] + flat[:, 0] * edge.along[0]
    vertices[:, 1] = edge.start[1] + flat[:, 0] * edge.along[1]
    vertices[:, 2] = flat[:, 1]
    return BodyMesh(vertices, _quad_faces(len(quads)), np.stack([-flat[:, 0], flat[:, 1]], axis=1))


def _quad_faces(count: int) -> Int64Array:
    corners = np.array([[0, 1, 2], [0, 2, 3]])
    return (4 * np.arange(count)[:, None, None] + corners).reshape(-1, 3).astype(np.int64)


def _quad(points: list[tuple[float, float, float]]) -> BodyMesh:
    """Planar quadrilateral, counter-clockwise seen from its front; uvs in its plane, metres."""
    vertices = np.array(points)
    u = vertices[1] - vertices[0]
    v = vertices[3] - vertices[0]
    uvs = np.array([[0, 0], [np.linalg.norm(u), 0], [np.linalg.norm(u), np.linalg.norm(v)], [0, 0]])
    uvs[3, 1] = np.linalg.norm(v)
    return BodyMesh(vertices, _quad_faces(1), uvs)


def _holes(edge: WallEdge, plan: Plan) -> list[Hole]:
    """Holes of all openings in a wall face, seen from either side of the wall."""
    holes = []
    for opening in plan.openings:
        if abs(np.dot(opening.edge.along, edge.along)) < 0.99:
            continue
        ends = [edge.coordinates(point) for point in (opening.start, opening.end)]
        depth = ends[0][1]
        near, far = abs(depth) < 1e-3, abs(depth + opening.thickness) < 1e-3
        facing = float(np.dot(opening.edge.inward, edge.inward)) > 0
        s0, s1 = sorted(end[0] for end in ends)
        if s1 < 0 or s0 > edge.length or not ((near and facing) or (far and not facing)):
            continue
        floor = -2 * EMBED if opening.z0 <= 0 else opening.z0
        holes.append((s0, s1, floor, opening.z1))
    return holes


def _laps(edges: tuple[WallEdge, ...], index: int) -> tuple[float, float]:
    """Lengths by which a face extends past its start and end: `LAP` at inner corners, else 0."""
    edge = edges[index]
    before, after = edges[index - 1], edges[(index + 1) % len(edges)]
    convex_start = before.along[0] * edge.along[1] - before.along[1] * edge.along[0] > 0
    convex_end = edge.along[0] * after.along[1] - edge.along[1] * after.along[0] > 0
    return (LAP if convex_start else 0.0, LAP if convex_end else 0.0)


def _walls(plan: Plan, room: PlanRoom, finish: RoomFinish) -> list[PiecePart]:
    quads: dict[str, list[BodyMesh]] = {"wall": [], "accent": [], "tiles": []}
    gables: dict[str, list[BodyMesh]] = {name: [] for name in quads}
    # The longest wall with the fewest openings has the accent colour.
    pierced = [len(_holes(edge, plan)) for edge in room.edges]
    order = sorted(range(len(room.edges)), key=lambda k: (pierced[k], -room.edges[k].length))
    tile_top = min(finish.tile_height, plan.height + EMBED) if finish.wall_tiles else 0.0
    for index, edge in enumerate(room.edges):
        holes, cuts = _holes(edge, plan), gable_cuts(plan, edge, EMBED)
        before, after = _laps(room.edges, index)
        bottom, top = -EMBED, plan.height + EMBED
        bands = [(bottom, top, "accent" if finish.accent and index == order[0] else "wall")]
        if tile_top:
            bands = [(bottom, tile_top, "tiles"), (tile_top, top, "wall")]
        for z0, z1, name in bands:
            if z1 - z0 > 1e-6:
                face = _face(edge, z0, z1, holes, -before, edge.length + after, cuts)
                upright, gable = cut_below(face, plan, EMBED) if face else (None, None)
                quads[name] += [upright] if upright else []
                gables[name] += [gable] if gable else []
    quads["wall"] += [
        quad
        for opening in plan.openings
        if opening.rooms[0] == room.id
        for quad in _reveals(opening)
    ]
    materials = {"wall": finish.wall, "accent": finish.accent, "tiles": finish.wall_tiles}
    parts = []
    for prefix, found in (("", quads), (GABLE, gables)):
        for name, meshes in found.items():
            material = materials[name]
            if meshes and material:
                parts.append(make_part(prefix + name, material, *meshes))
    return parts


def _reveals(opening: Opening) -> list[BodyMesh]:
    """Reveals of an opening: four quadrilaterals, three if it extends to the floor."""
    edge, width, deep = opening.edge, opening.width, -opening.thickness
    low = -EMBED if opening.z0 <= 0 else opening.z0
    high = opening.z1

    # Corners (along, into the wall, up) of each.
    sides: list[list[tuple[float, float, float]]] = [
        [(0, 0, low), (0, deep, low), (0, deep, high), (0, 0, high)],
        [(width, deep, low), (width, 0, low), (width, 0, high), (width, deep, high)],
        [(0, 0, high), (0, deep, high), (width, deep, high), (width, 0, high)],
    ]
    if opening.z0 > 0:
        sides.append([(0, deep, low), (0, 0, low), (width, 0, low), (width, deep, low)])
    return [_quad([(*edge.at(s, depth), z) for s, depth, z in side[::-1]]) for side in sides]


def _trim(plan: Plan, room: PlanRoom, finishes: Finishes, finish: RoomFinish) -> list[PiecePart]:
    """Skirting along the walls between doors, and cornice below the ceiling."""
    parts = []
    linings = [niche.footprint for niche in plan.niches if niche.room == room.id]
    shape = difference(room.shape, union(linings)) if linings else room.shape
    if finish.skirting:
        ring = difference(shape, buffered(shape, -SKIRTING, join_style="mitre"))
        for opening in plan.openings:
            if opening.z0 <= 0:
                margin = CASING[0] if opening.kind in ("door", "entrance") else 0.0
                gap = opening.edge.strip(-margin, opening.width + margin, 0.05, -1.0)
                ring = difference(ring, buffered(gap, 1e-4, join_style="mitre"))
                far = opening.edge.strip(
                    -margin, opening.width + margin, 0, -opening.thickness - 0.05
                )
                ring = difference(ring, far)
        parts.append(
            make_part(
                "skirting", finishes.skirting, _extrude(ring, -0.01, finishes.skirting_height)
            )
        )
    tiled_up = finish.wall_tiles and finish.tile_height > plan.height
    if finishes.cornice and not tiled_up and not plan.slopes:
        for step in (1.0, 0.5):
            size = finishes.cornice * step
            ring = difference(shape, buffered(shape, -size, join_style="mitre"))
            drop = finishes.cornice * (1.5 - step)
            mesh = _extrude(ring, plan.height - drop, plan.height + 0.01)
            parts.append(make_part(f"cornice_{step:g}", finishes.ceiling, mesh))
    return parts


def _stairs(plan: Plan, finishes: Finishes) -> list[SceneItem]:
    """The flight of stairs, and the closed shaft above it."""
    stairs = plan.stairs
    well = _stairwell(plan, None, 0.0)
    if stairs is None or well is None:
        return []
    count = round(plan.height / STEP)
    rise, length = plan.height / count, stairs.s1 - stairs.s0
    going = length / (count - 1)

    def placed(mesh: BodyMesh) -> BodyMesh:
        """From (way up the flight, away from the wall, up) to the world."""
        along, away, up = mesh.vertices.T
        s = stairs.s1 - along if stairs.reverse else stairs.s0 + along
        faces = mesh.faces[:, ::-1] if stairs.reverse else mesh.faces
        return BodyMesh(stairs.edge.points(s, away, up), faces, mesh.uvs, mesh.smooth)

    profile = [(0.0, 0.001)]
    for k in range(1, count):
        x, z = (k - 1) * going, k * rise - 0.036
        profile += [(x, z), (x + going, z)]
    profile[-1] = (length - 0.002, profile[-1][1])
    profile.append((length - 0.002, 0.001))
    side = prism(profile, 0.002, stairs.width - 0.03)
    # The prism was extruded along z: exchange y and z, which turns its faces over.
    body = BodyMesh(side.vertices[:, [0, 2, 1]], side.faces[:, ::-1], side.uvs, smooth=False)
    treads, rails = [], []
    far = stairs.width - 0.06
    tops = []
    for k in range(1, count):
        x, z = (k - 1) * going, k * rise
        end = min(x + going, length - 0.003)
        treads.append(span((x - 0.03, 0.003, z - 0.036), (end, stairs.width, z), 0.004, "y"))
        top = z + 0.86
        if top < plan.height - 0.08:
            wide = 0.03 if k == 1 else 0.011
            at = x + 0.5 * going
            rails.append(span((at - wide, far - wide, z - 0.005), (at + wide, far + wide, top)))
            tops.append((at, far, top))
    rails.append(bar(tops[0], tops[-1], 0.024, 12))
    flight = [
        make_part("flight", finishes.casing, placed(body)),
        make_part("treads", finishes.threshold, *map(placed, treads)),
        make_part("banister", finishes.threshold, *map(placed, rails)),
    ]
    # Walls of the shaft behind the edge of the hole in the ceiling, and its lid.
    x0, y0, x1, y1 = well.bounds
    low, high, thick = plan.height + 0.004, plan.height + 2.2, 0.05
    shaft = [
        span((x0 - thick, y0 - thick, low), (x0, y1 + thick, high)),
        span((x1, y0 - thick, low), (x1 + thick, y1 + thick, high)),
        span((x0, y0 - thick, low), (x1, y0, high)),
        span((x0, y1, low), (x1, y1 + thick, high)),
        span((x0 - thick, y0 - thick, high - 0.01), (x1 + thick, y1 + thick, high + thick)),
    ]
    upper = make_part("shaft", finishes.ceiling, *shaft)
    return [
        _structure_item(f"stairs-{stairs.room}", "stairs", stairs.room, flight),
        _structure_item("stairwell", "wall", stairs.room, [upper]),
    ]


def _beams(plan: Plan, room: PlanRoom, finishes: Finishes) -> list[SceneItem]:
    """Beams below the ceiling, their ends in the walls."""
    meshes = []
    for beam in plan.beams:
        if beam.room == room.id:
            (x0, y0), (x1, y1) = beam.low, beam.high
            grow_x, grow_y = (0.01, 0.0) if x1 - x0 > y1 - y0 else (0.0, 0.01)
            low = (x0 - grow_x, y0 - grow_y, plan.height - beam.depth)
            meshes.append(span(low, (x1 + grow_x, y1 + grow_y, plan.height + 0.01), bevel=0.004))
    if not meshes:
        return []
    part = make_part("beams", finishes.beam, *meshes)
    return [_structure_item(f"beams-{room.id}", "ceiling", room.id, [part])]


def _facade(plan: Plan, finishes: Finishes) -> SceneItem:
    """Outer faces of the outer walls."""
    # Backwards: the outdoors is to the left
    rings = [each[::-1] for each in (plan.outline, *plan.further)]
    edges = tuple(
        WallEdge(start, end, True)
        for ring in rings
        for start, end in zip(ring, ring[1:] + ring[:1], strict=True)
    )
    faces = []
    for edge in edges:
        face = _face(edge, -EMBED, plan.height + EMBED, _holes(edge, plan), 0.0, edge.length)
        faces += [part for part in cut_below(face, plan, EMBED) if part] if face else []
    return _structure_item("facade", "wall", None, [make_part("facade", finishes.facade, *faces)])


def _slabs(plan: Plan, finishes: Finishes) -> SceneItem:
    """Base slab, roof slab and thresholds of the whole storey."""
    outline = plan.covered
    base = _extrude(buffered(outline, 0.015, join_style="mitre"), plan.ground - 0.3, -0.5 * EMBED)
    cover = buffered(outline, 0.18, join_style="mitre")
    well = _stairwell(plan, None, 0.03)
    if well is not None:
        cover = difference(cover, well)
    level, sloping = panels(
        plan, cover, 0.5 * EMBED, (0.28, COVER), _extrude, lap=0.03, margin=0.004
    )
    sills = [
        make_part("roof", finishes.facade, *level, *sloping),
        make_part("base", finishes.facade, base),
    ]
    thresholds = [
        _edge_span(opening.edge, 0, opening.width, 0.0, -opening.thickness, -EMBED, 0.004)
        for opening in plan.openings
        if opening.z0 <= 0
    ]
    if thresholds:
        sills.append(make_part("threshold", finishes.threshold, *thresholds))
    return _structure_item("slabs", "slab", None, sills)


def _edge_span(
    edge: WallEdge, s0: float, s1: float, near: float, far: float, z0: float, z1: float
) -> BodyMesh:
    """Box in the coordinates of a wall: along, into the room, up."""
    if min(map(abs, edge.along)) > 1e-9:
        box = span((s0, min(near, far), min(z0, z1)), (s1, max(near, far), max(z0, z1)))
        return replace(box, vertices=edge.points(*box.vertices.T))
    a, b = edge.at(s0, near), edge.at(s1, far)
    low = (min(a[0], b[0]), min(a[1], b[1]), min(z0, z1))
    high = (max(a[0], b[0]), max(a[1], b[1]), max(z0, z1))
    return span(low, high)


def _edge_frame(
    edge: WallEdge, outer: Hole, inner: Hole, near: float, far: float
) -> list[BodyMesh]:
    """Bars between two rectangles on a wall."""
    bars = frame_bars(outer, inner)
    return [_edge_span(edge, s0, s1, near, far, z0, z1) for s0, s1, z0, z1 in bars]


def _portal(opening: Opening, clear: bool) -> Portal:
    edge, depth = opening.edge, -pane_depth(opening)
    width, z0, z1 = opening.width, opening.z0, opening.z1
    places = ((0.0, z0), (0.0, z1), (width, z1), (width, z0))
    corners = [(*edge.at(s, depth), z) for s, z in places]
    return Portal(
        id=f"portal-{opening.id}",
        kind="door" if opening.kind in ("entrance", "patio") else "window",
        polygon=tuple((round(x, 5), round(y, 5), round(z, 5)) for x, y, z in corners),
        normal=(-edge.inward[0] + 0.0, -edge.inward[1] + 0.0, 0.0),
        clear=clear,
        room=opening.rooms[0],
        panes=2 if clear else 0,
    )


def _window(opening: Opening, finishes: Finishes) -> SceneItem:
    """Window with frame, sashes, glazing bars, handles and sill, without panes."""
    edge, width, wide = opening.edge, opening.width, FRAME[0]
    middle = -pane_depth(opening)
    near, far = middle + FRAME[1] / 2, middle - FRAME[1] / 2
    z0, z1 = opening.z0 if opening.z0 > 0 else 0.004, opening.z1
    outer, inner = (
        (-LAP, width + LAP, z0 - LAP, z1 + LAP),
        (wide, width - wide, z0 + wide, z1 - wide),
    )
    frame = _edge_frame(edge, outer, inner, near, far)
    clear = width - 2 * wide
    sashes = max(1, int(np.ceil(clear / finishes.sash_width)))
    handles = []
    gap = 0.0015
    for number in range(sashes):
        left = wide + clear * number / sashes - (0.01 if number == 0 else -gap)
        right = wide + clear * (number + 1) / sashes + (0.01 if number == sashes - 1 else -gap)
        frame += _sash(opening, left, right, z0 + wide - 0.01, z1 - wide + 0.01)
        if finishes.glazing_bars:
            frame += _glazing_bars(opening, left, right, z0 + wide - 0.01, z1 - wide + 0.01)
        z = z0 + (1.0 if opening.kind == "patio" else 0.45 * (z1 - z0))
        s = right - _SASH / 2 if number < sashes / 2 else left + _SASH / 2
        handles += _window_handle(edge, s, near + 0.012, z)
    parts = [
        make_part("frame", finishes.frame, *frame),
        make_part("handle", finishes.handle, *handles),
    ]
    if opening.z0 > 0:
        back = -opening.thickness - 0.04
        board = [
            _edge_span(edge, -LAP, width + LAP, 0.0, near - 0.005, z0 - LAP, z0 + 0.022),
            _edge_span(edge, -0.04, width + 0.04, 0.045, 0.0, z0 - 0.008, z0 + 0.022),
            _edge_span(edge, -LAP, width + LAP, far + 0.005, back, z0 - LAP, z0 + 0.012),
        ]
        parts.append(make_part("sill", finishes.sill, *board))
    return _structure_item(opening.id, "window", opening.rooms[0], parts)


def _sash(opening: Opening, left: float, right: float, low: float, high: float) -> list[BodyMesh]:
    """The frame of one sash, between two places along the wall and two heights, metres."""
    edge, middle = opening.edge, -pane_depth(opening)
    front, back = middle + FRAME[1] / 2 + 0.012, middle - FRAME[1] / 4
    inner = left + _SASH, right - _SASH, low + _SASH, high - _SASH
    return _edge_frame(edge, (left, right, low, high), inner, front, back)


def _glazing_bars(
    opening: Opening, left: float, right: float, low: float, high: float
) -> list[BodyMesh]:
    """An upright bar in the middle of a sash, and one or two across it."""
    edge, middle = opening.edge, -pane_depth(opening)
    near, far = middle + 0.012, middle - 0.012
    count = 1 if opening.kind == "window" else 2
    levels = [low + (high - low) * k / (count + 1) for k in range(1, count + 1)]
    s = 0.5 * (left + right)
    across = [
        _edge_span(edge, left + _SASH, right - _SASH, near, far, z - 0.012, z + 0.012)
        for z in levels
    ]
    near, far = middle + 0.0125, middle - 0.0125  # no two faces in one plane
    upright = _edge_span(edge, s - 0.012, s + 0.012, near, far, low + _SASH, high - _SASH)
    return [*across, upright]


def _window_handle(edge: WallEdge, s: float, front: float, z: float) -> list[BodyMesh]:
    """Rosette, neck and lever on the sash whose face is `front` metres before the wall."""
    return [
        _edge_span(edge, s - 0.014, s + 0.014, front + 0.008, front - 0.002, z - 0.035, z + 0.035),
        _edge_span(edge, s - 0.006, s + 0.006, front + 0.04, front, z - 0.006, z + 0.006),
        _edge_span(edge, s - 0.008, s + 0.008, front + 0.045, front + 0.033, z - 0.11, z + 0.008),
    ]


def _door(opening: Opening, finishes: Finishes) -> SceneItem:
    """Door with lining, casings, leaf and handles; an archway has lining and casings only."""
    edge, width, top = opening.edge, opening.width, opening.z1
    near, far = 0.0, -opening.thickness
    outer, inner = (-LAP, width + LAP, 0.0, top + LAP), (LINING, width - LINING, 0.0, top - LINING)
    lining = _edge_frame(edge, outer, inner, near, far)
    wide, thickness = CASING
    for face, out in ((near, near + thickness), (far, far - thickness)):
        inset = LINING - 0.005
        outer = (-wide + inset, width + wide - inset, 0.0, top + wide - inset)
        inner = (inset, width - inset, 0.0, top - inset)
        lining += _edge_frame(edge, outer, inner, face, out)
    parts = [make_part("casing", finishes.casing, *lining)]
    if opening.kind != "archway":
        leaf_edge = opening.edge_in(opening.swing)
        parts += _leaf(opening, leaf_edge, finishes.door, finishes)
        # Door stops behind the closed leaf; they cover the gap around it.
        s0, s1, z1, wide = LINING, width - LINING, top - LINING, 0.012
        back = (-LEAF - 0.001, -LEAF - 0.001 - 0.03)
        inner = (s0 + wide, s1 - wide, 0.004, z1 - wide)
        lining += _edge_frame(leaf_edge, (s0, s1, 0.004, z1), inner, *back)
        parts[0] = make_part("casing", finishes.casing, *lining)
    made = _structure_item(opening.id, "door", opening.rooms[0], parts)
    return made if opening.kind == "archway" else replace(made, joints=(_hinge(opening),))


def _hinge(opening: Opening) -> Joint:
    """The hinge of a door, at the corner of its leaf; axes along the closed leaf."""
    start, width, bottom, top = _leaf_place(opening)
    edge, at_start = opening.edge_in(opening.swing), _at_start(opening)
    (x, y) = edge.along
    sign = 1.0 if at_start else -1.0
    at = edge.at(start if at_start else opening.width - start, 0.0)
    # Seen along the leaf from its hinge, the room it swings into is left for one at the start.
    faces = (-LEAF, 0.0) if at_start else (0.0, LEAF)
    lever = width - 0.065
    boxes = (
        ((0.0, faces[0] - 0.007, 0.0), (width, faces[1] + 0.007, top - bottom)),
        ((lever - 0.13, faces[0] - 0.065, 0.93 - bottom), (lever + 0.03, faces[1] + 0.065, 1.13)),
    )
    yaw = math.degrees(math.atan2(sign * y, sign * x))
    limits = (0.0, max(WIDEST, opening.angle))
    axis = (0.0, 0.0, sign)
    pivot = as_triple(np.round([*at, bottom], 6))
    return Joint(opening.id, "hinge", pivot, axis, limits, opening.angle, boxes, round(yaw, 6))


def _at_start(opening: Opening) -> bool:
    """Test whether the hinge is at the start of the wall of the room that the door swings into."""
    return opening.hinge_at_start == (opening.swing == opening.rooms[0])


def _leaf_place(opening: Opening) -> tuple[float, float, float, float]:
    """Distance of the hinge from the opening's end, width, bottom and top of the leaf, metres."""
    gap, bottom = 0.003, 0.008
    width = opening.width - 2 * (LINING + gap)
    if opening.kind == "entrance":
        # It is closed and fills its lining without a gap: no light leaks in.
        gap, bottom, width = -0.002, 0.0, opening.width - 2 * LINING + 0.004
    return LINING + gap, width, bottom, opening.z1 - LINING - gap


def _leaf(
    opening: Opening, edge: WallEdge, material: Material, finishes: Finishes | None
) -> list[PiecePart]:
    """Door leaf, rotated about its hinge by the opening's angle, with a lever on each side."""
    start, width, bottom, top = _leaf_place(opening)
    bodies = [span((0, -LEAF, bottom), (width, 0, top), grain="z")]
    panels = finishes.door_panels if finishes else "flat"
    rows: dict[str, list[tuple[float, float]]] = {
        "flat": [],
        "two": [(0.12, 0.9), (1.05, 1.88)],
        "four": [(0.12, 0.9), (1.05, 1.88)],
    }
    columns = 2 if panels == "four" else 1
    for low, high in rows[panels]:
        for column in range(columns):
            pitch = (width - 0.12) / columns
            x0 = 0.12 + column * pitch
            x1 = 0.12 + (column + 1) * pitch - 0.12
            for y0, y1 in ((-LEAF - 0.006, -LEAF), (0.0, 0.006)):
                bodies += _panel_frame(x0, x1, y0, y1, low, min(high, top - 0.1))
    handle_x, handle_z = width - 0.065, 1.03
    levers = []
    for sign, face in ((1.0, 0.0), (-1.0, -LEAF)):
        rosette = cylinder(0.024, 0.0, 0.008, 16).turned("x", -90 * sign)
        out = face + sign * 0.05
        ends = ((handle_x + 0.009, out, handle_z), (handle_x - 0.115, out, handle_z))
        levers += [
            rosette.moved(handle_x, face, handle_z),
            bar((handle_x, face, handle_z), (handle_x, out, handle_z), 0.009, 10),
            bar(*ends, 0.009, 10),
        ]
    at_start = _at_start(opening)
    angle = np.radians(opening.angle)

    def hung(mesh: BodyMesh) -> BodyMesh:
        x, y, z = mesh.vertices.T
        along = np.cos(angle) * x - np.sin(angle) * y
        inward = np.sin(angle) * x + np.cos(angle) * y
        s = start + along if at_start else opening.width - start - along
        faces = mesh.faces if at_start else mesh.faces[:, ::-1]
        return BodyMesh(edge.points(s, inward, z), faces, mesh.uvs)

    metal = finishes.handle if finishes else material
    return [
        make_part("leaf", material, *(hung(mesh) for mesh in bodies)),
        make_part("lever", metal, *(hung(mesh) for mesh in levers), smooth=True),
    ]


def _panel_frame(
    x0: float, x1: float, y0: float, y1: float, z0: float, z1: float
) -> list[BodyMesh]:
    """Rectangular moulding with a raised field inside."""
    w = 0.022
    bars = frame_bars((z0, z1, x0, x1), (z0 + w, z1 - w, x0 + w, x1 - w))
    return [
        *(span((left, y0, low), (right, y1, high)) for low, high, left, right in bars),
        span((x0 + 0.06, y0, z0 + 0.06), (x1 - 0.06, y1, z1 - 0.06), grain="z"),
    ]
