"""Ornaments on shelves and sills, and what hangs on walls: posters, calendars, hooks, rails."""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.files import data_beside
from pbrnet.scenes.procedural.furniture.parts.build import Builder, assembles
from pbrnet.scenes.procedural.furniture.parts.drapes import hooked, pleats
from pbrnet.scenes.procedural.furniture.parts.geometry import (
    CORNERS,
    BodyMesh,
    bar,
    box,
    cylinder,
    lathe,
    loft,
    span,
    sphere,
    superellipse,
    tube,
)
from pbrnet.scenes.procedural.furniture.style import (
    BLACK_PLASTIC,
    CERAMIC,
    CHROME,
    MIRROR,
    PAGES,
    STEEL,
    WHITE_PLASTIC,
    Style,
    hex_color,
)
from pbrnet.scenes.procedural.furniture.things.vessels import Range, glazed, printed, tinted
from pbrnet.scenes.procedural.piece import Material
from pbrnet.scenes.seeds import Draw

_CORK = Material("paper", hex_color("#b08a5e"), 0.95, family="corrugated")
_WAX = Material("plastic", hex_color("#efe6d2"), 0.6)
# Board -> what is pinned to it; on others flyers
_PINNED = {"magnetic board": "memo", "cork board": "ticket"}
# Of turned ornaments: outline from the foot to the top, radius and height relative to the greatest.
_SHAPES: dict[str, list[list[float]]] = data_beside(__file__)


@assembles("clutter")
def turned(b: Builder, draw: Draw, style: Style, shape: str, radius: Range, height: Range) -> None:
    """A turned ornament of glaze, wood or metal, with or without a candle."""
    r, h = draw.between(*radius), draw.between(*height)
    outline = np.array(_SHAPES[shape])
    t = np.linspace(0, 1, len(outline))
    fine = np.linspace(0, 1, 3 * len(outline))
    profile = [
        (r * float(np.interp(s, t, outline[:, 0])), h * float(np.interp(s, t, outline[:, 1])))
        for s in fine
    ]
    body = draw.pick([glazed(draw, style), style.wood, style.dark_wood, style.metal])
    b.add(body, lathe(profile, 24), name="body")
    if shape == "candlestick":
        b.add(_WAX, cylinder(0.011, h, h + draw.between(0.06, 0.2), 14), name="candle")


@assembles("clutter")
def globe(b: Builder, draw: Draw, style: Style) -> None:
    """A globe on a turned foot."""
    r = draw.between(0.07, 0.13)
    foot = [(0.6 * r, 0), (0.62 * r, 0.012), (0.12 * r, 0.03), (0.1 * r, 0.06)]
    b.add(style.dark_wood, lathe(foot, 22), name="foot")
    b.add(*printed(draw, style, sphere(r, 24, 14).moved(z=0.058 + r)), name="globe")
    turn = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 14)
    arc = np.stack(
        [(r + 0.008) * np.cos(turn), 0 * turn, 0.058 + r + (r + 0.008) * np.sin(turn)], 1
    )
    b.add(style.metal, tube(arc, 0.0035, 8), name="arc")


@assembles("candle")
def lantern(b: Builder, draw: Draw, style: Style) -> None:
    """A lantern: a candle between four posts under a hood."""
    half, h = draw.between(0.05, 0.08), draw.between(0.18, 0.3)
    frame = style.metal if draw.chance(0.6) else style.wood
    b.add(frame, box((2 * half, 2 * half, 0.015), (0, 0, 0), 0.002), name="frame")
    b.add(frame, box((2.1 * half, 2.1 * half, 0.012), (0, 0, h), 0.002), name="frame")
    for x, y in CORNERS:
        at = (0.88 * x * half, 0.88 * y * half, 0.0148)
        b.add(frame, box((0.011, 0.011, h - 0.0145), at), name="frame")
    turn = np.linspace(0, np.pi, 12)
    ring = np.stack([0.03 * np.cos(turn), 0 * turn, h + 0.011 + 0.03 * np.sin(turn)], 1)
    b.add(frame, tube(ring, 0.003, 8), name="handle")
    b.add(_WAX, cylinder(0.45 * half, 0.0152, 0.5 * h, 20, 0.002), name="candle")


@assembles("clutter", "on_wall")
def sheet(
    b: Builder, draw: Draw, style: Style, size: tuple[float, float], look: str, height: float = 1.5
) -> None:
    """A flat thing on the wall, its middle `height` metres up: poster, calendar, board, plate.

    What is pinned to a notice board are objects of their own.
    """
    categories = {"mirror": "mirror", "board": "clutter", "plate": "crockery", "woven": "textile"}
    b.category = categories.get(look, "picture" if look == "poster" else "paper")
    b.mount_height = height
    x, z = (float(length * draw.between(0.85, 1.15)) for length in size)
    if look == "plate":
        ring = [(0.0, 0.0), (0.3 * x, 0.0), (0.5 * x, 0.018), (0.495 * x, 0.021)]
        ring += [(0.3 * x, 0.006), (0.0, 0.006)]
        b.add(glazed(draw, style), lathe(ring, 32).turned("x", 90), name="plate")
    elif look == "woven":
        cloth = draw.pick(style.cushions)
        b.add(style.wood, bar((-x / 2, -0.01, z / 2), (x / 2, -0.01, z / 2), 0.01, 10))
        b.add(cloth, span((-0.46 * x, -0.0135, -z / 2), (0.46 * x, -0.0075, z / 2 - 0.004)))
    elif look == "mirror":
        b.add(style.metal, cylinder(x / 2, 0.0, 0.014, 40, 0.004).turned("x", 90), name="rim")
        b.add(MIRROR, cylinder(x / 2 - 0.012, 0.0141, 0.0155, 40).turned("x", 90), name="mirror")
    elif look == "board":
        b.add(style.wood, span((-x / 2, -0.015, -z / 2), (x / 2, 0.0, z / 2), 0.003), name="frame")
        inner = _CORK if draw.chance(0.6) else WHITE_PLASTIC
        face = span((0.03 - x / 2, -0.0165, 0.03 - z / 2), (x / 2 - 0.03, -0.0151, z / 2 - 0.03))
        b.add(inner, face, name="face")
        for k in range(draw.whole(2, 5)):
            half = draw.between(0.035, 0.055)
            left = -x / 2 + 0.1 + (x - 0.2) * k / 4
            up = draw.between(-0.5, 0.5) * (z - 0.2)
            with b.holding(_PINNED.get(b.name, "flyer"), "paper"):
                note = span((left - half, -0.0178, up - half), (left + half, -0.0168, up + half))
                b.add(*printed(draw, style, note), name="note")
                pin = cylinder(0.006, 0.0, 0.008, 10).turned("x", 90)
                b.add(tinted(draw, style), pin.moved(left, -0.0176, up + 0.8 * half), name="pin")
    else:
        paper = style.picture(draw) if look == "poster" else PAGES
        face = span((-x / 2, -0.0022, -z / 2), (x / 2, -0.0006, z / 2))
        b.add(paper, _whole(face, x, z) if look == "poster" else face, name="sheet")
        if look == "calendar":
            upper = span((0.01 - x / 2, -0.003, 0.02), (x / 2 - 0.01, -0.0023, z / 2 - 0.01))
            b.add(*printed(draw, style, upper), name="print")
            for row in range(5):
                for column in range(7):
                    at = ((column - 3) * 0.12 * x, -0.0026, -0.06 * z - 0.085 * z * row)
                    b.add(BLACK_PLASTIC, box((0.03 * x, 0.0006, 0.02 * z), at), name="days")


def _whole(face: BodyMesh, x: float, z: float) -> BodyMesh:
    """The mesh of a sheet with uvs from 0 to 1 over its front."""
    uvs = np.stack([face.vertices[:, 0] / x + 0.5, face.vertices[:, 2] / z + 0.5], 1)
    return BodyMesh(face.vertices, face.faces, uvs, smooth=False)


@assembles("fitting", "on_wall")
def on_hook(b: Builder, draw: Draw, style: Style, size: tuple[float, float], held: str) -> None:
    """A hook on the wall with a towel, an apron or a coat, an object of its own."""
    name, b.name = b.name, f"hook of the {b.name}"
    b.mount_height = draw.between(1.5, 1.7)
    b.add(style.metal, cylinder(0.022, 0.0, 0.006, 18, 0.001).turned("x", 90), name="plate")
    path = [(0, -0.004, 0.0), (0, -0.05, -0.022), (0, -0.08, -0.016), (0, -0.088, 0.016)]
    b.add(style.metal, tube(path, 0.006, 8), name="hook")
    cloth = draw.pick(style.cushions)
    if held == "towel":
        cloth = style.towel
    wide, long = (float(length * draw.between(0.9, 1.1)) for length in size)
    with b.holding(name, held):
        b.add(cloth, hooked(pleats(draw), (wide, long)).moved(0, -0.035, -0.012), name="cloth")


@assembles("fitting", "on_wall")
def rail(b: Builder, draw: Draw, style: Style) -> None:
    """A rail with ladles, sieves and spatulas on hooks, each an object of its own."""
    b.mount_height = draw.between(1.5, 1.65)
    metal = STEEL if draw.chance(0.6) else style.metal
    half = draw.between(0.2, 0.32)
    b.add(metal, bar((-half, -0.04, 0), (half, -0.04, 0), 0.006, 10), name="rail")
    for side in (-1, 1):
        at = side * (half - 0.03)
        b.add(metal, bar((at, 0.0, 0), (at, -0.04, 0), 0.005, 8), name="bracket")
    for k, x in enumerate(np.arange(-half + 0.07, half - 0.05, 0.095)):
        long = draw.between(0.22, 0.3)
        body = draw.pick([metal, style.wood, BLACK_PLASTIC])
        end = -0.02 - long
        with b.holding(("ladle", "spatula", "whisk", "sieve", "wooden spoon")[k % 5], "fitting"):
            turn = np.linspace(0, np.pi, 8)
            hook = np.stack([0 * turn + x, -0.04 - 0.011 * np.cos(turn), 0.011 * np.sin(turn)], 1)
            path = [*hook.tolist(), [float(x), -0.029, -0.03]]
            b.add(metal, tube(path, 0.0022, 7), name="hook")
            b.add(body, bar((x, -0.029, -0.026), (x, -0.032, end), 0.005, 8), name="shaft")
            blade = superellipse(0.03, 0.008, 0.0, 2.0, 20)
            sizes = ((0.3, 0.0), (1.0, 0.03), (1.0, 0.07), (0.3, 0.095))
            rings = [blade * (size, size, 1) + (0, 0, z) for size, z in sizes]
            b.add(body, loft(np.stack(rings)).moved(float(x), -0.032, end - 0.085), name="blade")


@assembles("paper", "on_wall")
def paper_holder(b: Builder, draw: Draw, style: Style) -> None:
    """A toilet roll on a holder."""
    b.mount_height = draw.between(0.68, 0.8)
    b.add(CHROME, cylinder(0.022, 0.0, 0.008, 18, 0.001).turned("x", 90), name="plate")
    b.add(CHROME, bar((0, -0.004, 0), (0, -0.07, 0), 0.006, 10), name="arm")
    b.add(CHROME, bar((-0.004, -0.07, 0), (0.13, -0.07, 0), 0.006, 10), name="arm")
    roll = cylinder(draw.between(0.04, 0.056), 0.016, 0.116, 26, 0.002).turned("y", 90)
    b.add(PAGES, roll.moved(0, -0.07, -0.012), name="roll")


@assembles("fitting", "free")
def brush(b: Builder, draw: Draw, style: Style) -> None:
    """A toilet brush in its holder, on the floor."""
    holder = [(0.045, 0), (0.05, 0.16), (0.046, 0.16), (0.04, 0.008), (0, 0.008)]
    b.add(CERAMIC if draw.chance(0.5) else STEEL, lathe(holder, 22), name="holder")
    b.add(WHITE_PLASTIC, bar((0, 0, 0.0085), (0.008, 0, 0.38), 0.008, 10), name="handle")


@assembles("clutter", "free")
def leaning(b: Builder, draw: Draw, style: Style) -> None:
    """A long thing that stands against the wall: a broom, an ironing board, a yoga roll."""
    tall = draw.between(0.95, 1.05)
    if b.name == "broom":
        b.add(style.wood, bar((0, -0.06, 0.07), (0, 0.05, tall), 0.012, 10), name="stick")
        head = box((0.3, 0.05, 0.05), (0, -0.065, 0.03), 0.006)
        b.add(tinted(draw, style), head, name="head")
        b.add(BLACK_PLASTIC, box((0.28, 0.04, 0.031), (0, -0.065, 0)), name="bristles")
    else:
        b.add(WHITE_PLASTIC, box((0.32, 0.03, tall), (0, 0.02, 0), 0.004), name="board")
        cloth = draw.pick(style.cushions)
        b.add(cloth, box((0.325, 0.012, tall - 0.1), (0, -0.0012, 0.06), 0.003), name="cover")
        for side in (-1, 1):
            leg = bar((side * 0.1, 0.041, 0.01), (-side * 0.1, 0.041, tall - 0.15), 0.01, 8)
            b.add(STEEL, leg.moved(y=0.006 * side + 0.006), name="legs")
