"""Sets of things that stand or hang together: spice racks, trays of bottles, key boards, ledges.

Each thing of a set is an object of its own.
"""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.procedural.furniture.parts.build import Builder, assembles
from pbrnet.scenes.procedural.furniture.parts.geometry import (
    BodyMesh,
    bar,
    box,
    cylinder,
    lathe,
    span,
    tube,
)
from pbrnet.scenes.procedural.furniture.style import CHROME, GLASS, PAGES, STEEL, Style
from pbrnet.scenes.procedural.furniture.things.vessels import (
    bottle,
    cup,
    glazed,
    jar,
    printed,
    tinted,
)
from pbrnet.scenes.procedural.piece import FurniturePiece, Material
from pbrnet.scenes.seeds import Draw

# What a set holds -> names of its things.
_CONTENTS: dict[str, tuple[str, ...]] = {
    "spices": ("paprika", "oregano", "thyme", "cumin", "curry powder", "rosemary", "peppercorns"),
    "care": ("body oil", "face tonic", "talcum", "cleanser", "hair tonic", "bath salts"),
    "sauces": ("chilli sauce", "walnut oil", "fish sauce", "balsamic", "sesame oil"),
    "cups": ("tall cup", "small cup", "milk pot", "sugar pot", "wide cup"),
    "desk": ("glue stick", "ink bottle", "pot of clips", "marker pot", "tape roll"),
    "candles": ("wide candle", "slim candle", "low candle", "tall candle"),
}
_KEYS = ("front door key", "bicycle key", "cellar key", "letter box key", "car key", "shed key")


def _add(b: Builder, piece: FurniturePiece, x: float, y: float, z: float) -> None:
    """Add a piece at a place, as an object of its own."""
    with b.holding(piece.name, piece.category):
        for part in piece.parts:
            assert isinstance(part.material, Material)
            mesh = BodyMesh(part.vertices, part.faces, part.uvs, part.smooth)
            b.add(part.material, mesh.moved(x, y, z), name=part.name)


def _content(draw: Draw, style: Style, what: str, name: str) -> FurniturePiece:
    """One thing of a set, at most 8 cm wide."""
    if what == "spices":
        return jar(draw, style, (0.019, 0.023), (0.08, 0.1), name=name)
    if what == "care":
        height = (0.1, 0.19)
        if draw.chance(0.35):
            return jar(draw, style, (0.024, 0.034), (0.05, 0.1), name=name, category="fitting")
        return bottle(
            draw, style, (0.02, 0.03), height, 0.75, body="plastic", name=name, category="fitting"
        )
    if what == "sauces":
        return bottle(draw, style, (0.024, 0.032), (0.16, 0.26), body="glass", name=name)
    if what == "cups":
        return cup(draw, style, (0.03, 0.036), (0.06, 0.11), handle=False, name=name)
    if what == "candles":
        b = Builder(name, "candle", "on_top")
        radius, tall = draw.between(0.014, 0.034), draw.between(0.05, 0.2)
        wax = draw.pick(style.accents).color
        body = cylinder(radius, 0.0, tall, 20, 0.002)
        b.add(Material("plastic", wax, 0.6), body, name="wax")
        return b.piece()
    return jar(draw, style, (0.018, 0.03), (0.05, 0.1), name=name, category="clutter")


def _row(
    draw: Draw, style: Style, what: str, width: float, share: float
) -> list[tuple[FurniturePiece, float]]:
    """Different things of a set in a row of a width, and their places along it."""
    found: list[tuple[FurniturePiece, float]] = []
    names = [_CONTENTS[what][k] for k in draw.permutation(len(_CONTENTS[what]))]
    at = -width / 2
    while names and draw.chance(share + 1.0 * (len(found) < 2)):
        made = _content(draw, style, what, names.pop())
        low, high = made.bounds[:, 0]
        if at + high - low > width / 2:
            break
        found.append((made, at - float(low)))
        at += float(high - low) + draw.between(0.004, 0.03)
    return found


@assembles("clutter")
def tray(b: Builder, draw: Draw, style: Style, what: str, width: float = 0.34) -> None:
    """A tray with a row of bottles, jars, cups or candles."""
    width *= draw.between(0.9, 1.1)
    depth = 0.13
    body = draw.pick([style.wood, style.metal, style.lacquer, glazed(draw, style)])
    b.add(body, box((width, depth, 0.012), bevel=0.003), name="tray")
    for side in (-1, 1):
        at = (side * (0.5 * width - 0.004), 0.0, 0.0118)
        b.add(body, box((0.008, depth - 0.004, 0.014), at, 0.002), name="rim")
    for made, x in _row(draw, style, what, width - 0.04, 0.92):
        _add(b, made, x, draw.between(-0.02, 0.02), 0.0122)


@assembles("shelf", "on_wall")
def ledge(b: Builder, draw: Draw, style: Style, what: str, width: float = 0.42) -> None:
    """A narrow board on the wall with a rail, and a row of bottles or jars on it."""
    b.mount_height = draw.between(1.3, 1.5)
    width *= draw.between(0.9, 1.15)
    depth = 0.1
    board = [style.wood, style.lacquer, GLASS if what == "care" else style.dark_wood]
    b.add(draw.pick(board), span((-width / 2, -depth, -0.012), (width / 2, 0, 0)))
    rail = style.metal if draw.chance(0.6) else CHROME
    y = 0.004 - depth
    ends = ((-width / 2 + 0.012, y, 0.03), (width / 2 - 0.012, y, 0.03))
    b.add(rail, bar(*ends, 0.003, 8), name="rail")
    for x, _, z in ends:
        b.add(rail, bar((x, y, 0.0002), (x, y, z), 0.003, 8), name="rail")
    for made, x in _row(draw, style, what, width - 0.05, 0.97):
        _add(b, made, x, -0.048, 0.0004)


@assembles("shelf", "on_wall")
def frames(b: Builder, draw: Draw, style: Style) -> None:
    """A ledge on the wall with photographs in frames that lean at it."""
    b.mount_height = draw.between(1.3, 1.5)
    width = draw.between(0.5, 0.8)
    body = style.wood if draw.chance(0.5) else style.lacquer
    b.add(body, span((-width / 2, -0.09, -0.014), (width / 2, 0, 0)), name="ledge")
    b.add(body, span((-width / 2, -0.09, 0.0002), (width / 2, -0.08, 0.02)), name="lip")
    at = -width / 2 + 0.01
    while True:
        x, z = draw.between(0.11, 0.2), draw.between(0.13, 0.26)
        if at + x > width / 2 - 0.01:
            return
        rim = draw.pick([style.wood, style.metal, style.dark_wood])
        photo = box((x - 0.03, 0.001, z - 0.03), (0, -0.0076, 0.015))
        with b.holding("framed photograph", "picture"):
            for part, (material, mesh) in (
                ("frame", (rim, box((x, 0.014, z), bevel=0.002))),
                ("photo", printed(draw, style, photo)),
            ):
                b.add(
                    material, mesh.turned("x", -8.0).moved(at + 0.5 * x, -0.05, 0.0012), name=part
                )
        at += x + draw.between(0.01, 0.06)


@assembles("fitting", "on_wall")
def keys(b: Builder, draw: Draw, style: Style) -> None:
    """A board with hooks and keys on most of them."""
    b.mount_height = draw.between(1.4, 1.55)
    count = draw.whole(4, 7)
    width = 0.055 * count + 0.03
    b.add(style.wood, span((-width / 2, -0.015, -0.035), (width / 2, 0, 0.035), 0.003))
    for k, which in enumerate(draw.permutation(len(_KEYS))[:count].tolist()):
        x = (k - 0.5 * (count - 1)) * 0.055
        b.add(style.metal, bar((x, -0.0145, -0.012), (x, -0.035, -0.008), 0.002, 6), name="hooks")
        if draw.chance(0.25):
            continue
        with b.holding(_KEYS[which], "fitting"):
            turn = np.linspace(0, 2 * np.pi, 14)[:-1]
            ring = np.stack(
                [x + 0.011 * np.sin(turn), 0 * turn - 0.027, -0.0184 - 0.011 * np.cos(turn)], 1
            )
            b.add(STEEL, tube(ring, 0.0012, 6, closed=True), name="ring")
            long = draw.between(0.035, 0.055)
            key = span((x - 0.004, -0.0285, -0.029 - long), (x + 0.004, -0.0265, -0.0275))
            b.add(STEEL if draw.chance(0.7) else style.metal, key, name="key")
            if draw.chance(0.5):
                fob = box((0.022, 0.004, 0.034), (x + 0.006, -0.0301, -0.07), 0.001)
                b.add(tinted(draw, style), fob, name="fob")


@assembles("fitting", "free")
def stand(b: Builder, draw: Draw, style: Style) -> None:
    """An umbrella stand with umbrellas and a stick."""
    r, h = draw.between(0.11, 0.13), draw.between(0.42, 0.5)
    wall = [(0.0, 0.0), (r, 0.0), (r, h), (r - 0.006, h), (r - 0.006, 0.012), (0.0, 0.012)]
    body = draw.pick([style.metal, glazed(draw, style), style.dark_wood])
    b.add(body, lathe(wall, 28), name="stand")
    b.add(STEEL, cylinder(r - 0.008, 0.0122, 0.0128, 28), name="dish")
    names = ("long umbrella", "walking stick", "short umbrella")
    for k in draw.permutation(3)[: draw.whole(1, 4)].tolist():
        turn = 2 * np.pi * (k + draw.between(-0.15, 0.15)) / 3
        foot = 0.03 * np.array([np.cos(turn), np.sin(turn)])
        head = 0.065 * np.array([np.cos(turn), np.sin(turn)])
        tall = h + draw.between(0.16, 0.34)
        ends = (*foot.tolist(), 0.0142), (*head.tolist(), tall)
        with b.holding(names[k], "bag" if k != 1 else "clutter"):
            if k != 1:
                at = tuple((np.array(ends[0]) + 0.8 * np.subtract(*ends[::-1])).tolist())
                b.add(tinted(draw, style), bar(ends[0], at, 0.017, 12), name="cloth")
                b.add(style.dark_wood, bar(at, ends[1], 0.008, 8), name="grip")
            else:
                b.add(style.wood, bar(*ends, 0.01, 10), name="stick")


@assembles("fitting", "free")
def rolls(b: Builder, draw: Draw, style: Style) -> None:
    """A stand with spare rolls of toilet paper on a pole."""
    b.add(CHROME, cylinder(0.08, 0.0, 0.012, 28, 0.002), name="foot")
    count = draw.whole(2, 5)
    r = draw.between(0.05, 0.058)
    for k in range(count):
        with b.holding("roll on a pole", "paper"):
            low = 0.0125 + 0.1005 * k
            b.add(PAGES, cylinder(r, low, low + 0.1, 26, 0.002), name="roll")
    top = 0.0127 + 0.1005 * count
    b.add(CHROME, cylinder(0.02, top, top + 0.004, 20, 0.001), name="pole")
    b.add(CHROME, cylinder(0.008, top + 0.0038, 0.48, 12, 0.002), name="pole")
