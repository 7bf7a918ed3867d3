"""Parts of cabinets: carcasses, doors, drawers, handles and legs.

Cabinets have their back at y = depth / 2; the outer faces of their fronts lie at -depth / 2.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from pbrnet.scenes.contract import Joint
from pbrnet.scenes.procedural.furniture import materials as m
from pbrnet.scenes.procedural.furniture.parts import geometry as g
from pbrnet.scenes.procedural.furniture.parts.build import Builder
from pbrnet.scenes.procedural.furniture.spec import drawn
from pbrnet.scenes.procedural.furniture.style import Style
from pbrnet.scenes.procedural.piece import Material
from pbrnet.scenes.seeds import Draw

BOARD = 0.018  # metres
FRONT = 0.019
GAP = 0.003  # between neighbouring fronts
_GRIP = 0.037  # that handles stand out
_REACH = 0.75  # of the length of a drawer, that it comes out


def carcass(width: float, depth: float, z0: float, z1: float, top: bool = True) -> list[g.BodyMesh]:
    """Return the boards of an open-fronted box, set back by the thickness of the fronts."""
    front, rear = -depth / 2 + FRONT + 0.002, depth / 2
    half, inner, near = width / 2, width / 2 - BOARD, front + 0.001
    boards = [
        g.span((-half, front, z0), (-half + BOARD, rear, z1)),
        g.span((half - BOARD, front, z0), (half, rear, z1)),
        g.span((-inner, near, z0 + 0.001), (inner, rear - 0.001, z0 + BOARD)),
    ]
    if top:
        boards.append(g.span((-inner, near, z1 - BOARD), (inner, rear - 0.001, z1 - 0.001)))
    boards.append(g.span((-inner, rear - 0.012, z0 + BOARD), (inner, rear - 0.004, z1 - BOARD)))
    return boards


def shelf(width: float, depth: float, z: float, thickness: float = BOARD) -> g.BodyMesh:
    """Return a board between the sides of a carcass, its upper face at `z`."""
    return g.span(
        (-width / 2 + BOARD, -depth / 2 + FRONT + 0.012, z - thickness),
        (width / 2 - BOARD, depth / 2 - 0.013, z),
    )


def panel(width: float, height: float, style: Style) -> list[g.BodyMesh]:
    """Return a door or drawer front: bottom centred at the origin, y from -FRONT to 0."""
    rail = 0.065
    if style.front == "flat" or min(width, height) < 3.2 * rail:
        return [g.span((-width / 2, -FRONT, 0), (width / 2, 0, height), bevel=0.0015)]
    w, h, inner, y = width / 2, height, width / 2 - rail, -FRONT + 0.0005
    return [
        g.span((-w, -FRONT, 0), (-inner, 0, h), 0.0015),
        g.span((inner, -FRONT, 0), (w, 0, h), 0.0015),
        g.span((-inner, y, 0.0003), (inner, -0.0003, rail), 0.0015, "x"),
        g.span((-inner, y, h - rail), (inner, -0.0003, h - 0.0003), 0.0015, "x"),
        g.span((-inner - 0.004, -0.011, rail - 0.004), (inner + 0.004, -0.001, h - rail + 0.004)),
    ]


def handle(style: Style, vertical: bool, room: float) -> list[g.BodyMesh]:
    """Return a handle on a front whose outer face is y = 0; it extends to y = -0.035 at most.

    `room` bounds its length, metres.
    """
    if style.handle == "knob":
        knob = [(0.006, -0.002), (0.006, 0.01), (0.015, 0.017), (0.016, 0.022), (0.011, 0.027)]
        return [g.lathe(knob, 14).turned("x", 90)]
    if style.handle == "edge":
        length = min(0.12, 0.8 * room)
        size = (0.012, 0.022, length) if vertical else (length, 0.022, 0.012)
        at = (0.0, -0.009, -length / 2 if vertical else -0.006)
        return [g.box(size, at, bevel=0.003)]
    half = min(0.16, 0.7 * room) / 2
    ends = [(0.0, 0.002, -half), (0.0, -0.028, -half), (0.0, -0.028, half), (0.0, 0.002, half)]
    meshes = [
        g.bar((0, -0.03, -half - 0.012), (0, -0.03, half + 0.012), 0.006, 8),
        g.bar(ends[0], ends[1], 0.0045, 8),
        g.bar(ends[3], ends[2], 0.0045, 8),
    ]
    return meshes if vertical else [mesh.turned("y", 90) for mesh in meshes]


Pair = tuple[float, float]
Points = Sequence[Pair]


def add_grip(
    b: Builder, ends: Points, feet: Points, ys: Pair, radii: Pair, segments: int = 10
) -> None:
    """Add a bar handle of steel on two feet, for appliances.

    `ends` and `feet`: x, z on the front; `ys`: where the feet begin and where the bar is; `radii`
    of the bar and of its feet; metres.
    """
    (x0, z0), (x1, z1) = ends
    b.add(m.STEEL, g.bar((x0, ys[1], z0), (x1, ys[1], z1), radii[0], segments), name="handle")
    for x, z in feet:
        b.add(m.STEEL, g.bar((x, ys[0], z), (x, ys[1], z), radii[1], 8), name="handle")


def add_door(
    b: Builder,
    style: Style,
    material: Material,
    x0: float,
    x1: float,
    z0: float,
    z1: float,
    depth: float,
    hinge: str = "left",
    angle: float = 0.0,
    handle_low: bool = False,
) -> None:
    """Add a door over [x0, x1] x [z0, z1] of a cabinet, opened by `angle` degrees."""
    width, height = x1 - x0 - GAP, z1 - z0 - GAP
    side = 1.0 if hinge == "left" else -1.0
    grip_z = height * (0.5 if height > 1.0 else (0.2 if handle_low else 0.8))
    grip_x = side * (width / 2 - 0.035)

    def place(mesh: g.BodyMesh) -> g.BodyMesh:
        hung = mesh.moved(x=side * width / 2).turned("z", -side * angle)
        edge = x0 + GAP / 2 if hinge == "left" else x1 - GAP / 2
        return hung.moved(edge, -depth / 2 + FRONT, z0 + GAP / 2)

    b.add(material, *(place(mesh) for mesh in panel(width, height, style)), name="front")
    grips = handle(style, True, height)
    b.add(
        style.metal, *(place(mesh.moved(grip_x, -FRONT, grip_z)) for mesh in grips), name="handle"
    )
    across = (0.0, width) if hinge == "left" else (-width, 0.0)
    edge = (x0 + GAP / 2 if hinge == "left" else x1 - GAP / 2, -depth / 2 + FRONT, z0 + GAP / 2)
    swept = (across[0], -FRONT - _GRIP, 0.0), (across[1], 0.0, height)
    b.hinge(edge, (0.0, 0.0, -side), angle, swept)


def add_drawer(
    b: Builder,
    style: Style,
    material: Material,
    inside: Material,
    x0: float,
    x1: float,
    z0: float,
    z1: float,
    depth: float,
    pulled: float = 0.0,
) -> None:
    """Add a drawer whose front covers [x0, x1] x [z0, z1], pulled out by `pulled` metres."""
    width, height = x1 - x0 - GAP, z1 - z0 - GAP
    at = {"x": (x0 + x1) / 2, "y": -depth / 2 + FRONT - pulled, "z": z0 + GAP / 2}
    b.add(material, *(mesh.moved(**at) for mesh in panel(width, height, style)), name="front")
    for offset in (-0.25, 0.25) if width > 0.85 else (0.0,):
        for mesh in handle(style, False, width):
            grip = mesh.moved(offset * width, -FRONT, height / 2).moved(**at)
            b.add(style.metal, grip, name="handle")
    half, wall, length = width / 2 - 0.025, 0.012, depth - 0.1
    inner = length if pulled > 0 else 0.0  # closed ones are fronts alone
    swept = (-width / 2, -FRONT - _GRIP, 0.0), (width / 2, inner, height)
    pivot, out = (at["x"], -depth / 2 + FRONT, at["z"]), (0.0, -1.0, 0.0)
    b.joints.append(Joint("", "slide", pivot, out, (0.0, _REACH * length), pulled, (swept,)))
    if pulled <= 0:
        return
    low, high = 0.02, max(0.05, height - 0.04)
    walls = (
        g.span((-half, 0.001, low), (-half + wall, length, high)),
        g.span((half - wall, 0.001, low), (half, length, high)),
        g.span((-half + wall, length - wall, low), (half - wall, length - 0.001, high - 0.002)),
        g.span((-half + wall, 0.001, low + 0.002), (half - wall, length - wall, low + 0.01)),
    )
    b.add(inside, *(mesh.moved(**at) for mesh in walls), name="drawer")


def add_drawers(
    b: Builder,
    style: Style,
    material: Material,
    inside: Material,
    half: float,
    zs: Iterable[float],
    depth: float,
    pulled: Sequence[float] = (),
) -> None:
    """Add drawers over [-half, half], one above another between the heights `zs`."""
    for k, (z0, z1) in enumerate(pairwise(zs)):
        out = pulled[k] if pulled else 0.0
        add_drawer(b, style, material, inside, -half, half, float(z0), float(z1), depth, out)


def pulled_out(count: Callable[[Any], int], low: float, high: float, closed: int = 0) -> Any:
    """A field of how far each of `count` drawers is pulled out: one at most, by low to high metres.

    `closed` more count in the draw and are never pulled out.
    """

    def pulls(draw: Draw, spec: Any) -> tuple[float, ...]:
        rows = count(spec)
        one = left_open(draw, spec.style, rows + closed)
        return tuple(draw.between(low, high) if k == one else 0.0 for k in range(rows))

    return drawn(pulls)


def left_open(draw: Draw, style: Style, count: int) -> int:
    """Return which of `count` doors or drawers was left open; `count` if none, as in tidy homes."""
    one = draw.whole(count)
    return one if draw.chance(0.1 + 0.6 * style.disorder) else count


def feet(
    style: Style,
    width: float,
    depth: float,
    height: float,
    thickness: float = 0.04,
    inset: float = 0.03,
    splay: float = 0.0,
) -> list[g.BodyMesh]:
    """Return four legs from the floor to `height`, in the shape of the style."""
    meshes = []
    for sx, sy in g.CORNERS:
        x = sx * (width / 2 - inset - thickness / 2)
        y = sy * (depth / 2 - inset - thickness / 2)
        foot = (x + sx * splay, y + sy * splay, 0.0)
        if style.legs == "square":
            meshes.append(g.post([(x, y, 0), (x, y, height)], [(thickness, thickness)] * 2))
        elif style.legs == "tapered":
            sizes = [(0.55 * thickness, 0.55 * thickness), (thickness, thickness)]
            meshes.append(g.post([foot, (x, y, height)], sizes))
        elif style.legs == "round":
            meshes.append(_round_leg((x, y, height), foot, 0.5 * thickness))
        else:
            bottom = g.cylinder(0.45 * thickness, 0, 0.006, 12).moved(x, y, 0)
            meshes += [bottom, g.tube([(x, y, 0.004), (x, y, height)], 0.3 * thickness, 12)]
    return meshes


def add_feet(b: Builder, style: Style, wooden: Material, *sizes: float, **more: float) -> None:
    """Add the four legs of `feet`, of metal if the style has metal legs, else of wood."""
    b.add(leg_material(style, wooden), *feet(style, *sizes, **more))


def _round_leg(top: Sequence[float], foot: Sequence[float], radius: float) -> g.BodyMesh:
    """Tapered round leg, possibly splayed, with horizontal sections."""
    t = np.array([0.0, 0.06, 0.75, 1.0])
    radii = radius * np.array([0.55, 0.6, 1.0, 1.0])
    leg = g.lathe(np.stack([radii, t * top[2]], axis=1).tolist(), 12)
    share = leg.vertices[:, 2:] / top[2]
    offset = np.array([[foot[0], foot[1]]]) * (1 - share) + np.array([[top[0], top[1]]]) * share
    leg.vertices[:, :2] += offset
    return leg


def leg_material(style: Style, wooden: Material) -> Material:
    """Return the material of the legs: metal if the style has metal legs, else wood."""
    if style.legs == "metal":
        return style.metal
    return wooden if wooden.kind == "wood" else style.wood
