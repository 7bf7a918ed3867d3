"""Buildings outside the windows: facades with recessed windows, roofs, balconies, lit rooms."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.color import Color
from pbrnet.scenes.geometry.mesh import face_areas
from pbrnet.scenes.procedural.furniture.materials import hex_color
from pbrnet.scenes.procedural.furniture.parts.geometry import BodyMesh, box, grid, prism, span
from pbrnet.scenes.procedural.piece import Material, MaterialKind, PiecePart
from pbrnet.scenes.procedural.scene_item import SceneItem, make_part, outdoor_item
from pbrnet.scenes.seeds import Draw

STOREY = 2.9  # metres
Roof = Literal["gable", "flat", "hip"]

_WALLS = ("#b8b0a0", "#a99a82", "#9fa19d", "#b29d86", "#8f897e", "#c2beb2", "#7f7a76", "#a18b77")
_BRICKS = ("#8d4a38", "#9a5a44", "#7a4238", "#a67a5c")
_ROOFS = ("#6f4034", "#4c4845", "#7d4a38", "#3d3d40", "#5a4a40")
_FAR_WALLS = ("#a29585", "#77706a", "#94705e")  # of far blocks, before haze
_FAR = (60.0, 180.0, 300.0, 500.0)  # metres behind the nearest, of groups of one haze
_AIR = 1100.0  # metres of air that pale a colour by 63 %
_HORIZON = (0.42, 0.49, 0.56)
_RECESS = 0.16  # metres from the facade to the glass
_LUMINANCE = (5.0, 12.0, 30.0)  # candelas a square metre of lit windows, as behind curtains
_KELVIN = (2700.0, 3000.0, 4000.0)


@dataclass(frozen=True)
class Block:
    """Shape of a building: metres, storeys, and which sides show windows (front first)."""

    width: float
    depth: float
    storeys: int
    roof: Roof = "gable"
    faces: tuple[int, ...] = (0, 2)  # quarter turns of the front: 0 front, 1 right, 2 back, 3 left
    detailed: bool = True  # frames, sills and balconies


def building(
    rng: Draw, name: str, block: Block, at: Float64Array, degrees: float, ground: float
) -> SceneItem:
    """Return a building whose front faces -Y before it is turned, with its centre at `at` (2,).

    At night some of its windows shine, see `pbrnet.scenes.procedural.lighting`: their parts have
    lumens.
    """
    width, depth = block.width, block.depth
    high = STOREY * block.storeys + 0.4
    is_brick = rng.chance(0.3)
    codes = _BRICKS if is_brick else _WALLS
    code = rng.pick(codes)
    kind: MaterialKind = "brick" if is_brick else "plaster"
    accent = hex_color("#97908a") if is_brick else None
    wall = Material(kind, hex_color(code), 0.9, accent=accent, variant=rng.variant())
    trim = Material("paint", hex_color(rng.pick(("#cfccc4", "#8c8880", "#4a4a4a"))), 0.6)
    walls: list[BodyMesh] = []
    trims: list[BodyMesh] = []
    panes: list[list[BodyMesh]] = [[] for _ in range(2 + len(_LUMINANCE))]
    size = (rng.between(0.95, 1.3), rng.between(1.25, 1.6))
    for turn in range(4):
        length, out = (width, depth / 2) if turn % 2 == 0 else (depth, width / 2)
        if turn in block.faces:
            face = _facade(rng, length, high, block, size, turn)
        else:
            face = [_sheet(-length / 2, length / 2, -0.4, high)], [], [[] for _ in panes]
        for target, found in zip([walls, trims, *panes], [face[0], face[1], *face[2]], strict=True):
            target += [mesh.moved(y=-out).turned("z", 90.0 * turn) for mesh in found]
    roof = _roof(rng, block, high)
    roof_color = hex_color(rng.pick(_ROOFS))
    parts = [("walls", wall, walls), ("trim", trim, trims)]
    parts.append(("roof", Material("paint", roof_color, 0.85), roof))
    parts.append(("panes", Material("plastic", hex_color("#1b2126"), 0.08), panes[0]))
    curtain = hex_color(rng.pick(("#8f8b82", "#a39d92", "#7d7a74")))
    parts.append(("curtains", Material("plastic", curtain, 0.25), panes[1]))
    made = [
        make_part(label, material, *(m.turned("z", degrees) for m in meshes))
        for label, material, meshes in parts
        if meshes
    ]
    glass = Material("plastic", hex_color("#20262b"), 0.09)
    for level, kelvin, meshes in zip(_LUMINANCE, _KELVIN, panes[2:], strict=True):
        if meshes:
            part = make_part(f"lit-{level:g}", glass, *(m.turned("z", degrees) for m in meshes))
            made.append(_lit(part, level, kelvin))
    moved = [_moved(part, float(at[0]), float(at[1]), ground) for part in made]
    return outdoor_item(name, "building", *moved)


def far_blocks(
    rng: Draw, centre: Float64Array, ground: float, near: float, count: int
) -> SceneItem:
    """Return plain blocks in the haze of a town, from `near` metres on."""
    groups: dict[tuple[int, int], list[BodyMesh]] = {}
    for number in range(count):
        distance = near + float(rng.exponential(140.0))
        angle = rng.between(0, 2 * np.pi)
        place = centre + distance * np.array([np.cos(angle), np.sin(angle)])
        width, depth = rng.between(10, 40), rng.between(9, 16)
        high = float(rng.gamma(3.0, 4.0)) + 5
        below = 1 + 0.01 * number  # metres; blocks that overlap share no plane
        mesh = box((width, depth, high + below), (0, 0, -below)).turned("z", rng.between(0, 180))
        haze = min(len(_FAR) - 1, int((distance - near) / 120))
        group = (haze, number % len(_FAR_WALLS))
        groups.setdefault(group, []).append(mesh.moved(place[0], place[1], ground))
    parts = [
        make_part(
            f"blocks-{haze}-{wall}",
            Material("paint", hazed(hex_color(_FAR_WALLS[wall]), near + _FAR[haze]), 0.95),
            *groups[haze, wall],
        )
        for haze, wall in sorted(groups)
    ]
    return outdoor_item("town", "building", *parts)


def hazed(color: Color, distance: float) -> Color:
    """Return the colour of a far surface as it looks through `distance` metres of air.

    It pales towards the horizon's sky, as reflectance: air itself is not modelled.
    """
    share = 1 - float(np.exp(-distance / _AIR))
    mixed = [
        round((1 - share) * own + share * sky, 4) for own, sky in zip(color, _HORIZON, strict=True)
    ]
    return (mixed[0], mixed[1], mixed[2])


def _facade(
    rng: Draw, length: float, high: float, block: Block, size: tuple[float, float], turn: int
) -> tuple[list[BodyMesh], list[BodyMesh], list[list[BodyMesh]]]:
    """Return wall, trim and panes of a facade in the plane y = 0 that faces -Y.

    No two faces lie in one plane with the same front (a test holds it): which of them a ray meets
    would depend on the processor.
    """
    is_front = turn == block.faces[0]
    columns = max(1, int((length - 0.8) / rng.between(2.1, 3.0)))
    wide, tall = size
    spacing = length / columns
    wide = min(wide, spacing - 0.5)
    centres = spacing * (np.arange(columns) + 0.5) - length / 2
    walls, trims = [], []
    panes: list[list[BodyMesh]] = [[] for _ in range(2 + len(_LUMINANCE))]
    edges = np.concatenate([[-length / 2], np.ravel(centres[:, None] + [-wide / 2, wide / 2])])
    edges = np.append(edges, length / 2)
    bottom = -0.4
    has_balconies = block.detailed and is_front and block.storeys > 2 and rng.chance(0.5)
    for storey in range(block.storeys):
        low = 0.9 + STOREY * storey
        door = storey > 0 and has_balconies
        sill, top = (low - 0.8 if door else low), low + tall
        walls.append(_sheet(-length / 2, length / 2, bottom, sill))
        walls += [_sheet(a, b, sill, top) for a, b in edges.reshape(-1, 2)]
        bottom = top
        for x in centres:
            walls += _reveal(x - wide / 2, x + wide / 2, sill, top)
            pane = _sheet(x - wide / 2, x + wide / 2, sill, top, _RECESS)
            panes[_state(rng)].append(pane)
            if block.detailed:
                trims += _frame(x, wide, sill, top)
                trims.append(box((wide + 0.12, 0.14, 0.05), (x, -0.05, sill - 0.06)))
        if door:
            for x in centres[:: rng.whole(1, 3)]:
                trims += _balcony(float(x), spacing - 0.3, sill - 0.02)
    walls.append(_sheet(-length / 2, length / 2, bottom, high))
    if block.detailed:
        cornice = length + (0.2 if turn % 2 == 0 else -0.12)  # the sides' end at the front's
        trims.append(box((cornice, 0.16, 0.18), (0, -0.02, high - 0.2)))
        if is_front:
            trims.append(box((1.1, 0.1, 2.15), (float(centres[0]) + spacing / 2, -0.02, -0.1)))
    return walls, trims, panes


def _state(rng: Draw) -> int:
    """Return the group of a window: dark, with curtains, or lit at one of the levels by night."""
    draw = rng.random()
    if draw < 0.55:
        return 0
    return 1 if draw < 0.7 else 2 + rng.whole(len(_LUMINANCE))


def _sheet(x0: float, x1: float, z0: float, z1: float, y: float = 0.0) -> BodyMesh:
    """Return a rectangle that faces -Y; u is x and v is z."""
    points = np.array([[[x0, y, z0], [x0, y, z1]], [[x1, y, z0], [x1, y, z1]]], dtype=float)
    return grid(points, points[..., [0, 2]])


def _reveal(x0: float, x1: float, z0: float, z1: float) -> list[BodyMesh]:
    """Return the four sides of a window's recess, which faces -Y; they face its middle."""
    corners = [[x0, 0, z0], [x0, 0, z1], [x1, 0, z1], [x1, 0, z0], [x0, 0, z0]]
    front = np.array(corners, dtype=float)
    return [grid(np.stack([front, front + np.array([0, _RECESS, 0])]))]


def _frame(x: float, wide: float, z0: float, z1: float) -> list[BodyMesh]:
    """Return the frame of a window and the bar between its sashes."""
    y, bar, lap = _RECESS - 0.03, 0.06, 0.005
    beside = (wide - bar) / 2 - lap
    return [
        *(box((wide, 0.06, bar), (x, y, z)) for z in (z0, z1 - bar)),
        *(
            box((bar, 0.05, z1 - z0 - 2 * lap), (x + shift, y, z0 + lap))
            for shift in (-beside, 0.0, beside)
        ),
    ]


def _balcony(x: float, wide: float, z: float) -> list[BodyMesh]:
    """Return a slab with a railing before a window."""
    deep, high, ends = 1.2, 1.0, (x + -wide / 2, x + wide / 2)
    bars = [
        box((0.02, 0.02, high), (x + offset, -deep + 0.03, z))
        for offset in np.linspace(-wide / 2 + 0.03, wide / 2 - 0.03, max(6, int(wide / 0.14)))
    ]
    return [
        span((x - wide / 2, -deep, z - 0.16), (x + wide / 2, 0, z)),
        box((wide, 0.05, 0.05), (x, -deep + 0.03, z + high)),
        *(box((0.04, deep, 0.04), (at, -deep / 2, z + high + 0.005)) for at in ends),
        *bars,
    ]


def _roof(rng: Draw, block: Block, high: float) -> list[BodyMesh]:
    """Return the roof: with a gable along X, hipped, or flat with a parapet."""
    width, depth, eaves = block.width, block.depth, 0.4
    if block.roof == "flat":
        ring = [
            span((-width / 2, y - 0.15, high), (width / 2, y + 0.15, high + 0.5))
            for y in (-depth / 2 + 0.15, depth / 2 - 0.15)
        ]
        ring += [
            span((x - 0.15, -depth / 2 + 0.3, high), (x + 0.15, depth / 2 - 0.3, high + 0.5))
            for x in (-width / 2 + 0.15, width / 2 - 0.15)
        ]
        hut = box((2.5, 2.5, 1.8), (rng.between(-0.3, 0.3) * width, 0, high))
        low = (0.02 - width / 2, 0.02 - depth / 2, high - 0.05)
        return [span(low, (width / 2 - 0.02, depth / 2 - 0.02, high)), *ring, hut]
    ridge = rng.between(0.3, 0.5) * depth
    chimney = box((0.6, 0.5, ridge + 0.75), (rng.between(-0.3, 0.3) * width, 0.3, high + 0.05))
    if block.roof == "hip":
        a, b = width / 2 + eaves, depth / 2 + eaves
        inset = max(0.2, a - b)
        corners = [(-a, -b, high), (a, -b, high), (a, b, high), (-a, b, high)]
        tops = [(-inset, 0, high + ridge), (inset, 0, high + ridge)]
        vertices = np.array([*corners, *tops], dtype=float)
        faces = np.array(
            [[0, 1, 5], [0, 5, 4], [1, 2, 5], [2, 3, 4], [2, 4, 5], [3, 0, 4], [0, 2, 1], [0, 3, 2]]
        )
        return [BodyMesh(vertices, faces, vertices[:, :2].copy(), smooth=False), chimney]
    gable = [(-depth / 2 - eaves, 0.0), (depth / 2 + eaves, 0.0), (0.0, ridge)]
    roof = prism(gable, -width / 2 - eaves, width / 2 + eaves)
    # The gable was extruded along z: permute the axes so that it runs along x with its tip up.
    vertices = np.stack([roof.vertices[:, 2], roof.vertices[:, 0], roof.vertices[:, 1]], axis=1)
    return [BodyMesh(vertices + np.array([0, 0, high]), roof.faces, roof.uvs), chimney]


def _lit(part: PiecePart, luminance: float, kelvin: float) -> PiecePart:
    """Return panes that emit `luminance` candelas a square metre while they are lit."""
    area = float(face_areas(part.vertices[part.faces])[0].sum())
    return replace(part, lumens=round(np.pi * luminance * area, 1), kelvin=kelvin)


def _moved(part: PiecePart, x: float, y: float, z: float) -> PiecePart:
    return replace(part, vertices=part.vertices + np.array([x, y, z]))
