"""Outdoor surroundings of a home by setting: street, courtyard, garden, high floor, countryside."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
import shapely
from shapely.geometry import Polygon

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.geometry.regions import buffered
from pbrnet.scenes.procedural.furniture.materials import hex_color
from pbrnet.scenes.procedural.furniture.parts.geometry import (
    BodyMesh,
    box,
    cylinder,
    merge,
    prism,
    span,
)
from pbrnet.scenes.procedural.piece import Material, MaterialKind
from pbrnet.scenes.procedural.plan import Plan, WallEdge
from pbrnet.scenes.procedural.scene_item import SceneItem, make_part, outdoor_item
from pbrnet.scenes.procedural.surroundings.buildings import Block, Roof, building, far_blocks, hazed
from pbrnet.scenes.procedural.surroundings.plants import hedge, shrubs, tree
from pbrnet.scenes.procedural.surroundings.street import PAVEMENT, ROAD, fence, street
from pbrnet.scenes.procedural.textures.fields import Spectrum, noise
from pbrnet.scenes.seeds import Draw

Setting = Literal["street", "courtyard", "garden", "high floor", "countryside"]
LAWN = 70.0  # half the side of the lawn, metres
GROUND = 2500.0  # half the side of the ground plane, metres
_HILL_RINGS = ((320.0, 6.0, 3.0), (1500.0, 30.0, 20.0))  # metres: radius, height and its variation
_UPSTAIRS = -2.0  # metres; ground below this is that of an upper floor
_LAWNS = ("#4d5543", "#545a48", "#575848")
_FIELDS = ("#6d6a4e", "#5f6a4a", "#7a7258", "#59634c", "#80795c")
_HILLS = ("#57664f", "#4f5f55")  # of distant woods and hills, before haze


@dataclass(frozen=True)
class Site:
    """Place of a home: its outline and that one's centre (2,), half its diagonal, the ground's z.

    Metres.
    """

    outline: Polygon
    centre: Float64Array
    half: float
    ground: float

    def at(self, angle: float, away: float) -> Float64Array:
        """The place (2,) so many metres away in a direction, radians."""
        return self.centre + away * np.array([np.cos(angle), np.sin(angle)])

    def reach(self, turn: float) -> float:
        """Extent of the home from its centre towards -Y turned by `turn` degrees."""
        towards = _turned(np.array([0.0, -1.0]), turn)
        return float(((shapely.get_coordinates(self.outline) - self.centre) @ towards).max())


def build_outdoors(rng: Draw, plan: Plan) -> list[SceneItem]:
    """Build the surroundings of a home as structure items.

    Houses with a garden or in the country stand on the ground, most flats above it look onto a
    street or a courtyard, or from high above a town. Parts with lumens shine at night.
    """
    settings = get_args(Setting)
    shares = (0.3, 0.3, 0.0, 0.4, 0.0) if plan.ground < _UPSTAIRS else (0.3, 0.15, 0.35, 0.0, 0.2)
    setting: Setting = rng.weighted(settings, shares)
    outline = Polygon(plan.outline)
    low, high = np.min(plan.outline, axis=0), np.max(plan.outline, axis=0)
    ground = plan.ground
    items: list[SceneItem] = []
    if setting == "high floor":
        ground -= 2.9 * rng.whole(2, 9)
        items.append(_tower(plan, ground))
    centre = np.array(outline.centroid.coords[0])
    site = Site(outline, centre, 0.5 * float(np.hypot(*(high - low))), ground)
    if plan.ground < _UPSTAIRS:
        items += _balconies(rng, plan, outline)
    items += _grounds(rng, plan, site, setting)
    return _with_windows_together([*items, *_AROUND[setting](rng, site)])


def _with_windows_together(items: list[SceneItem]) -> list[SceneItem]:
    """Move the panes that shine at night from all buildings to one item.

    The renderer samples emitters one by one: a few large ones cost less than many small ones.
    """
    kept, panes = [], []
    for item in items:
        if item.category == "building":
            panes += [part for part in item.parts if part.lumens > 0]
            item = replace(item, parts=tuple(part for part in item.parts if part.lumens <= 0))
        kept.append(item)
    if panes:
        kept.append(SceneItem("outside-windows", "lit windows", "window", tuple(panes), True, None))
    return kept


def _street(rng: Draw, site: Site) -> list[SceneItem]:
    """A street before the home, houses opposite and beside it, gardens behind."""
    turn = 90.0 * rng.whole(4)
    near = site.reach(turn) + rng.between(3.0, 7.0)
    items = [_placed(item, site.centre) for item in street(rng, near, 110.0, turn, site.ground)]
    across = near + ROAD + PAVEMENT + rng.between(1.5, 5.0)
    items += _row(rng, "opposite", site, across, 90.0, turn, (2, 5))
    beside = site.half + rng.between(8, 12)
    for number, side in enumerate((-1, 1)):
        place = site.centre + _turned(np.array([side * (beside + 5), rng.between(-3, 3)]), turn)
        block, facing = _house(rng), turn + 180.0 * (side < 0)
        items.append(building(rng, f"beside-{number}", block, place, facing, site.ground))
    items += _row(rng, "behind", site, site.half + rng.between(22, 30), 60.0, turn + 180, (2, 4))
    return items + _trees(rng, site, 2.5, 9, rng.whole(2, 5), behind=turn)


def _courtyard(rng: Draw, site: Site) -> list[SceneItem]:
    """Facades on all sides of a paved yard with some trees and shrubs."""
    items = []
    storeys = rng.whole(3, 6)
    for number in range(4):
        turn = 90.0 * number
        away = site.reach(turn) + rng.between(8, 15)
        levels = (storeys - 1, storeys + 1)
        items += _row(rng, f"side-{number}", site, away, 2 * away + 12, turn, levels)
    items += _trees(rng, site, 2.0, 6, rng.whole(1, 4))
    return items + _shrubs(rng, site)


def _garden(rng: Draw, site: Site) -> list[SceneItem]:
    """A garden with hedge or fence, neighbours in theirs, and a street beyond on one side."""
    edge = site.half + rng.between(4.0, 7.0)
    enclose = hedge if rng.chance(0.6) else fence
    items = [enclose(rng, site.centre, edge, site.ground)]
    start = rng.between(0, 360)
    for number in range(rng.whole(3, 6)):
        angle = np.radians(start + 72 * number + rng.between(-20, 20))
        place = site.at(angle, edge + rng.between(7, 20))
        house, facing = _house(rng), _facing(angle)
        items.append(building(rng, f"neighbour-{number}", house, place, facing, site.ground))
    items += _trees(rng, site, 3.0, 12, rng.whole(4, 8))
    return items + _shrubs(rng, site)


def _town(rng: Draw, site: Site) -> list[SceneItem]:
    """Roofs and blocks of a town around a high building."""
    turn = 90.0 * rng.whole(4)
    near = site.half + rng.between(6, 14)
    items = [_placed(item, site.centre) for item in street(rng, near, 130.0, turn, site.ground)]
    number = 0
    for ring, count in ((site.half + 30, 6), (site.half + 58, 9)):
        start = rng.between(0, 360)
        for k in range(count):
            angle = np.radians(start + 360 * k / count + rng.between(-8, 8))
            place = site.at(angle, ring * rng.between(0.95, 1.2))
            size = rng.between(14, 24), rng.between(10, 13), rng.whole(3, 11)
            near_by = ring < site.half + 40
            block = Block(*size, _roof(rng, flat=0.6), (0, 1, 2, 3), detailed=near_by)
            facing = 180.0 + _facing(angle)
            items.append(building(rng, f"block-{number}", block, place, facing, site.ground))
            number += 1
    items.append(far_blocks(rng, site.centre, site.ground, site.half + 140, 120))
    return items + _trees(rng, site, 8, 22, 5, 1400, turn)


def _country(rng: Draw, site: Site) -> list[SceneItem]:
    """Fields with rows of trees, a farm or two far off, and a tree by the house."""
    items = [_fields(rng, site.centre, site.ground)]
    for number in range(rng.whole(1, 4)):
        place = site.at(rng.between(0, 2 * np.pi), rng.between(60, 140))
        block = Block(rng.between(12, 26), 9.0, rng.whole(1, 3), "gable", (0, 2))
        facing = rng.between(0, 360)
        items.append(building(rng, f"farm-{number}", block, place, facing, site.ground))
    for row in range(2):
        angle, away = rng.between(0, 2 * np.pi), rng.between(35, 80)
        middle = site.at(angle, away)
        along = np.array([-np.sin(angle), np.cos(angle)])
        for k in range(6):
            place = middle + along * (k - 2.5) * rng.between(6, 9)
            items.append(tree(rng, f"row-{row}-{k}", place, site.ground, 900))
    items += _trees(rng, site, 3.0, 12, rng.whole(2, 5))
    if rng.chance(0.5):
        items.append(fence(rng, site.centre, site.half + rng.between(6, 12), site.ground))
    return items + _shrubs(rng, site)


_AROUND: dict[Setting, Callable[[Draw, Site], list[SceneItem]]] = {
    "street": _street,
    "courtyard": _courtyard,
    "garden": _garden,
    "high floor": _town,
    "countryside": _country,
}


def _facing(angle: float) -> float:
    """Degrees by which a building in a direction (radians) is turned, in steps of 15."""
    return round(float(np.degrees(angle)) / 15) * 15 + 90.0


def _row(
    rng: Draw,
    name: str,
    site: Site,
    away: float,
    length: float,
    turn: float,
    storeys: tuple[int, int],
) -> list[SceneItem]:
    """A row of houses along X at y = -away before it is turned, facing the home."""
    items = []
    x, number = -length / 2, 0
    while x < length / 2:
        width, depth = rng.between(8, 16), rng.between(9, 12)
        levels, detailed = rng.whole(storeys[0], storeys[1] + 1), abs(x + width / 2) < 30
        block = Block(width, depth, levels, _roof(rng, flat=0.3), (0,), detailed=detailed)
        place = site.centre + _turned(np.array([x + width / 2, -away - depth / 2]), turn)
        # Fronts face -Y: turned round, they face the home.
        items.append(building(rng, f"{name}-{number}", block, place, turn + 180.0, site.ground))
        x, number = x + width, number + 1
    return items


def _house(rng: Draw) -> Block:
    size = rng.between(8, 13), rng.between(7, 10), rng.whole(1, 4)
    return Block(*size, _roof(rng, flat=0.15), (0, 1, 2, 3))


def _roof(rng: Draw, flat: float) -> Roof:
    draw = rng.random()
    return "flat" if draw < flat else ("hip" if draw > 0.8 else "gable")


def _trees(
    rng: Draw,
    site: Site,
    near: float,
    far: float,
    count: int,
    leaves: int = 2600,
    behind: float | None = None,
) -> list[SceneItem]:
    """Trees between two distances around the home, clear of its walls.

    `behind` is the turn of a street that they stand away from.
    """
    items = []
    for number in range(count):
        angle = rng.between(0, 2 * np.pi)
        if behind is not None:
            angle = np.radians(behind + 90.0) + (angle - np.pi) * 0.55
        place = site.at(angle, rng.between(site.half + near, site.half + far))
        if site.outline.distance(shapely.Point(place)) > 3.0:
            items.append(tree(rng, f"tree-{number}", place, site.ground, leaves))
    return items


def _shrubs(rng: Draw, site: Site) -> list[SceneItem]:
    angles = rng.uniform(0, 2 * np.pi, 9)
    away = site.half * rng.uniform(0.9, 1.4, 9)
    places = site.centre + away[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    kept = [place for place in places if site.outline.distance(shapely.Point(place)) > 1.4]
    return [shrubs(rng, "shrubs", np.array(kept), site.ground)] if kept else []


def _grounds(rng: Draw, plan: Plan, site: Site, setting: Setting) -> list[SceneItem]:
    """Ground near and far, terrace, and what closes the horizon."""
    ground = site.ground

    def drawn(kind: MaterialKind, codes: tuple[str, ...], accent: str, scale: float) -> Material:
        color = hex_color(rng.pick(codes))
        variant = rng.variant()
        return Material(kind, color, 0.9, accent=hex_color(accent), scale=scale, variant=variant)

    grass = drawn("grass", _LAWNS, "#3f4734", 1.0)
    paving = drawn("tiles", ("#8d887f", "#7c7975", "#968975"), "#625e57", 1.4)
    x, y = site.centre
    paved = setting in ("courtyard", "high floor")
    near = _ground(x - LAWN, y - LAWN, x + LAWN, y + LAWN, ground)
    far = _ground(x - GROUND, y - GROUND, x + GROUND, y + GROUND, ground - 0.1)
    around = buffered(site.outline, rng.between(0.8, 2.6), join_style="mitre")
    ring = shapely.get_coordinates(around.exterior)[:-1]
    terrace = prism(ring, plan.ground - 0.05, plan.ground + 0.02)
    terrace = BodyMesh(terrace.vertices, terrace.faces, terrace.vertices[:, :2].copy())
    rural = setting in ("garden", "countryside")
    plain = Material("paint", hex_color("#6b7064" if rural else "#6f6e6b"), 0.95)
    horizon = [
        make_part(
            f"hills-{k}",
            Material("paint", hazed(hex_color(code), _HILL_RINGS[k][0]), 0.95),
            _hills(rng, site, k),
        )
        for k, code in enumerate(_HILLS)
    ]
    items = [
        outdoor_item("ground", "ground", make_part("near", paving if paved else grass, near)),
        outdoor_item("fields", "ground", make_part("fields", plain, far), *horizon),
    ]
    if plan.ground > _UPSTAIRS or setting != "high floor":
        items.append(outdoor_item("terrace", "ground", make_part("paving", paving, terrace)))
    return items


def _tower(plan: Plan, ground: float) -> SceneItem:
    """The storeys below a home on a high floor, without windows: nobody sees them."""
    outline = buffered(Polygon(plan.outline), 0.01, join_style="mitre")
    ring = shapely.get_coordinates(outline.exterior)[:-1]
    shaft = prism(ring, ground - 0.3, plan.ground - 0.31)
    plaster = Material("plaster", hex_color("#b3aea4"), 0.9)
    return outdoor_item("tower", "building", make_part("shaft", plaster, shaft))


def _balconies(rng: Draw, plan: Plan, outline: Polygon) -> list[SceneItem]:
    """Balconies before the glazed doors of an upper floor: slab, railing, and a place to sit."""
    items = []
    concrete = Material("stone", hex_color("#9a968e"), 0.8, family="concrete")
    code = rng.pick(("#4a4d50", "#cfccc4", "#2f3133", "#7d8084"))
    rail = Material("paint", hex_color(code), 0.5)
    wood = Material("wood", hex_color("#94683f"), 0.7, variant=rng.variant())
    for opening in plan.openings:
        deep, high, beside = rng.uniform((1.1, 0.95, 0.2), (1.8, 1.1, 1.0)).tolist()
        seats, solid = rng.random(2)
        edge, out = opening.edge, -opening.thickness
        s0, s1 = -beside, opening.width + beside
        if opening.kind != "patio":
            continue
        if edge.strip(s0, s1, out - 0.02, out - deep - 0.3).intersects(outline):
            continue  # another wall of the home is in the way

        def placed(
            mesh: BodyMesh, edge: WallEdge = edge, out: float = out
        ) -> BodyMesh:  # from (along, out, up)
            s, away, up = mesh.vertices.T
            # Along and outwards form a left-handed frame with up.
            vertices = edge.points(s, out - away, up)
            return BodyMesh(vertices, mesh.faces[:, ::-1], mesh.uvs, mesh.smooth)

        floor = [span((s0, 0.002, -0.24), (s1, deep, -0.03))]
        bars = [
            span((s0, deep - 0.05, high), (s1, deep, high + 0.04)),
            span((s0, 0.01, high), (s0 + 0.05, deep - 0.05, high + 0.04)),
            span((s1 - 0.05, 0.01, high), (s1, deep - 0.05, high + 0.04)),
        ]
        if solid < 0.3:
            bars += [
                span((s0 + 0.002, deep - 0.03, -0.04), (s1 - 0.002, deep - 0.01, high)),
                span((s0 + 0.01, 0.01, -0.04), (s0 + 0.03, deep - 0.03, high)),
                span((s1 - 0.03, 0.01, -0.04), (s1 - 0.01, deep - 0.03, high)),
            ]
        else:
            for s in np.arange(s0 + 0.025, s1, 0.11):
                bars.append(span((s - 0.008, deep - 0.033, -0.04), (s + 0.008, deep - 0.017, high)))
            for away in np.arange(0.1, deep - 0.06, 0.11):
                for s in (s0 + 0.017, s1 - 0.033):
                    bars.append(span((s, away - 0.008, -0.04), (s + 0.016, away + 0.008, high)))
        parts = [
            make_part("slab", concrete, *map(placed, floor)),
            make_part("railing", rail, *map(placed, bars)),
        ]
        if seats < 0.6:
            parts.append(make_part("seats", wood, *map(placed, _bistro(s0 + 0.45, deep / 2))))
        name = f"balcony-{opening.id}"
        items.append(outdoor_item(name, "railing", *parts))
    return items


def _bistro(s: float, away: float) -> list[BodyMesh]:
    """Slatted seat and a small round table, standing on a balcony's floor."""
    floor = -0.03
    table = [
        cylinder(0.27, floor + 0.68, floor + 0.7, 28).moved(s + 0.05, away),
        cylinder(0.02, floor, floor + 0.68, 10).moved(s + 0.05, away),
        cylinder(0.18, floor, floor + 0.015, 24).moved(s + 0.05, away),
    ]
    x = s + 0.62
    chair = [
        box((0.38, 0.07, 0.018), (x, away + 0.085 * k, floor + 0.44)) for k in (-2, -1, 0, 1, 2)
    ]
    chair += [
        box((0.02, 0.36, 0.05), (x + 0.2 + 0.02 * k, away, floor + 0.55 + 0.09 * k))
        for k in range(4)
    ]
    chair += [
        box((0.025, 0.025, tall), (x + dx, away + dy, floor))
        for dx, tall in ((-0.17, 0.44), (0.18, 0.9))
        for dy in (-0.17, 0.17)
    ]
    return [*table, *chair]


def _fields(rng: Draw, centre: Float64Array, ground: float) -> SceneItem:
    """Strips of fields in different colours around the meadow by the house."""
    groups: dict[str, list[BodyMesh]] = {}
    heading = rng.between(0, 180)
    for side in (-1, 1):
        start = 30.0
        for _ in range(9):
            wide = rng.between(20, 70)
            code = rng.pick(_FIELDS)
            mesh = box((600.0, wide - 0.6, 0.12), (0, side * (start + wide / 2), 0.0))
            groups.setdefault(code, []).append(mesh.turned("z", heading))
            start += wide
    parts = [
        make_part(
            f"crop-{k}",
            Material("grass", hex_color(code), 0.95, scale=2.0, variant=rng.variant()),
            merge(meshes).moved(float(centre[0]), float(centre[1]), ground - 0.09),
        )
        for k, (code, meshes) in enumerate(groups.items())
    ]
    return outdoor_item("crops", "ground", *parts)


def _turned(place: Float64Array, degrees: float) -> Float64Array:
    """Return a place (2,) turned about the origin."""
    sine, cosine = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    return np.array([cosine * place[0] - sine * place[1], sine * place[0] + cosine * place[1]])


def _placed(item: SceneItem, centre: Float64Array) -> SceneItem:
    """Return an item made around the origin, around `centre`."""
    move = np.array([centre[0], centre[1], 0.0])
    parts = tuple(replace(part, vertices=part.vertices + move) for part in item.parts)
    return replace(item, parts=parts)


def _ground(x0: float, y0: float, x1: float, y1: float, z: float) -> BodyMesh:
    vertices = np.array([[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]])
    return BodyMesh(vertices, np.array([[0, 1, 2], [0, 2, 3]]), vertices[:, :2].copy())


def _hills(rng: Draw, site: Site, ring: int) -> BodyMesh:
    """Ring of distant woods (`ring` 0) or of higher and more distant hills (1)."""
    radius, low, high = _HILL_RINGS[ring]
    count = 512
    skyline = noise(rng, count, Spectrum(1.1))[0]
    tops = site.ground + np.maximum(low + high * skyline, 2.0)
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    circle = site.centre + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    bottoms = np.full(count, site.ground - 1.0)
    points = np.stack([np.column_stack([circle, z]) for z in (bottoms, tops)])
    low_ring = np.arange(count)
    after = np.roll(low_ring, -1)
    lower = np.column_stack([low_ring, after, low_ring + count])
    faces = np.concatenate([lower, np.column_stack([after, after + count, low_ring + count])])
    return BodyMesh(points.reshape(-1, 3), faces, points.reshape(-1, 3)[:, [0, 2]].copy())
