"""Boxes, papers and devices: things made of a few blocks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import ndimage

from pbrnet.scenes.procedural.furniture.decoration import display, shown_on
from pbrnet.scenes.procedural.furniture.parts.build import Builder, assembles
from pbrnet.scenes.procedural.furniture.parts.geometry import (
    CORNERS,
    BodyMesh,
    bar,
    box,
    cylinder,
    rounded_box,
    sphere,
    tube,
)
from pbrnet.scenes.procedural.furniture.style import (
    BLACK_PLASTIC,
    CHROME,
    PAGES,
    RUBBER,
    SCREEN,
    STEEL,
    WHITE_PLASTIC,
    Style,
    hex_color,
)
from pbrnet.scenes.procedural.furniture.things.vessels import glazed, printed, tinted
from pbrnet.scenes.procedural.piece import FurniturePiece, Material
from pbrnet.scenes.seeds import Draw

CARDBOARD = Material("paper", hex_color("#a98a62"), 0.9, family="corrugated")
_PAPER = Material("paper", hex_color("#e4e2dc"), 0.9, family="creased")
Size = tuple[float, float, float]


def _sized(draw: Draw, size: Size, spread: float = 0.12) -> list[float]:
    return [float(length * draw.between(1 - spread, 1 + spread)) for length in size]


@assembles("box")
def package(b: Builder, draw: Draw, style: Style, size: Size, look: str = "print") -> None:
    """A cardboard box or carton: printed, plain brown with tape, or of one colour."""
    x, y, z = _sized(draw, size)
    body = box((x, y, z), bevel=0.0008)
    if look == "print":
        b.add(*printed(draw, style, body), name="carton")
    elif look == "brown":
        b.add(CARDBOARD, body, name="carton")
        tape = Material("plastic", hex_color("#b79a6a"), 0.25)
        b.add(tape, box((x * 0.995, 0.05, 0.0006), (0, 0, z + 0.0001)), name="tape")
    else:
        b.add(draw.pick(style.books), body, name="carton")


@assembles("box")
def gabled(b: Builder, draw: Draw, style: Style) -> None:
    """A milk or juice carton with a gable or a cap."""
    x, y, z = _sized(draw, (0.07, 0.07, 0.19), 0.08)
    b.add(*printed(draw, style, box((x, y, z), bevel=0.001)), name="carton")
    b.add(WHITE_PLASTIC, cylinder(0.014, z + 0.0002, z + 0.016, 16, 0.002), name="cap")


@assembles("clutter")
def papers(
    b: Builder, draw: Draw, style: Style, size: Size, sheets: int, look: str = "white"
) -> None:
    """Papers, letters, magazines or notebooks, each a little askew."""
    b.category = "books" if look == "cover" else "paper"
    z = 0.0
    for _ in range(draw.whole(1, sheets + 1)):
        x, y, thick = _sized(draw, size, 0.06)
        sheet = box((x, y, thick)).turned("z", draw.between(-12, 12))
        sheet = sheet.moved(draw.between(-0.01, 0.01), draw.between(-0.01, 0.01), z)
        kind = draw.random()
        if look == "white":
            b.add(_PAPER, sheet, name="paper")
        elif look == "print" or kind < 0.6:
            b.add(*printed(draw, style, sheet), name="print")
        else:
            b.add(draw.pick(style.books), sheet, name="cover")
        z += thick + 0.0003
    if look == "white" and draw.chance(0.4):
        pen = bar((-0.06, 0.01, z + 0.0042), (0.07, 0.03, z + 0.0042), 0.004, 8)
        b.add(tinted(draw, style), pen, name="pen")


@assembles("electronics")
def slab(
    b: Builder,
    draw: Draw,
    style: Style,
    size: Size,
    screen: bool = False,
    keys: bool = False,
    white: bool = False,
) -> None:
    """A flat device: phone, tablet, remote control, calculator, console."""
    x, y, z = _sized(draw, size, 0.06)
    shell = WHITE_PLASTIC if white or draw.chance(0.25) else BLACK_PLASTIC
    b.add(
        shell, rounded_box((x, y, z), radius=min(0.45 * z, 0.008), steps=2, inner=1), name="shell"
    )
    if screen:
        b.add(SCREEN, box((0.93 * x, 0.93 * y, 0.0006), (0, 0, z + 0.0001)), name="screen")
    if keys:
        rows, columns = max(2, round(y / 0.02)), max(2, round(x / 0.014))
        for i in range(rows):
            for j in range(columns):
                across = (j - 0.5 * (columns - 1)) * 0.8 * x / columns
                at = (across, (i - 0.5 * (rows - 1)) * 0.8 * y / rows, z + 0.0001)
                b.add(RUBBER, box((0.5 * x / columns, 0.5 * y / rows, 0.0014), at), name="keys")
    if screen:
        shown = display(0.45 * x, 0.45 * y).turned("x", -90).moved(z=z + 0.001)
        b.show(shown, shown_on(draw, 40, 100))


@assembles("electronics")
def device(b: Builder, draw: Draw, style: Style, size: Size, detail: str = "") -> None:
    """A device on its feet: speaker, router, radio, toaster, coffee machine, printer and so on."""
    x, y, z = _sized(draw, size)
    shells = [BLACK_PLASTIC, WHITE_PLASTIC, STEEL, tinted(draw, style)]
    shell = draw.pick(shells)
    foot = 0.004
    radius = min(0.14 * min(x, y, z), 0.02)
    b.add(
        shell, rounded_box((x, y, z - foot), (0, 0, foot), radius, steps=2, inner=1), name="shell"
    )
    for side_x, side_y in CORNERS:
        at = (0.38 * side_x * x, 0.36 * side_y * y, 0.0)
        b.add(RUBBER, box((0.014, 0.014, foot + radius), at), name="feet")
    front = -0.5 * y
    dark = SCREEN if shell is not BLACK_PLASTIC else RUBBER
    if detail == "dials":
        for k in range(draw.whole(1, 4)):
            knob = cylinder(min(0.12 * z, 0.13 * x), 0.0, 0.012, 18, 0.002).turned("x", 90)
            b.add(CHROME, knob.moved((k - 1) * 0.3 * x, front - 0.0002, 0.4 * z), name="dials")
    elif detail == "display":
        b.add(dark, box((0.6 * x, 0.004, 0.45 * z), (0, front - 0.0021, 0.3 * z)), name="display")
    elif detail == "cones":
        for high, r in ((0.36, 0.34), (0.74, 0.18)):
            cone = cylinder(r * min(x, 0.7 * z), 0.0, 0.006, 28, 0.002).turned("x", 90)
            b.add(dark, cone.moved(0, front - 0.0002, high * z), name="cones")
    elif detail == "slots":
        for y_at in (-0.17, 0.17):
            b.add(SCREEN, box((0.75 * x, 0.14 * y, 0.001), (0, y_at * y, z + 0.0001)), name="slots")
        lever = box((0.02, 0.03, 0.014), (0.5 * x + 0.0102, 0, 0.6 * z), 0.003)
        b.add(BLACK_PLASTIC, lever, name="lever")
    elif detail == "spout":
        spout = box((0.34 * x, 0.4 * y, 0.09 * z), (0, front - 0.2 * y - 0.0002, 0.62 * z), 0.004)
        b.add(dark, spout, name="spout")
        tray = box((0.8 * x, 0.5 * y, 0.06 * z), (0, front - 0.25 * y - 0.0002, 0), 0.003)
        b.add(STEEL, tray, name="tray")
    elif detail == "aerials":
        for k in (-1, 1):
            foot_ = (0.35 * k * x, 0.3 * y, z)
            tip = (0.45 * k * x, 0.32 * y, z + 0.12)
            b.add(shell, bar(foot_, tip, 0.005, 10), name="aerials")
    elif detail == "paper":
        b.add(_PAPER, box((0.6 * x, 0.3 * y, 0.006), (0, front - 0.14 * y, 0.35 * z)), name="paper")
        b.add(dark, box((0.2 * x, 0.05 * y, 0.004), (0.3 * x, -0.3 * y, z + 0.0001)), name="keys")


def _wire(draw: Draw, start: list[float], turns: int, size: float) -> np.ndarray:
    """A path of a cable lying on its surface from `start`, in loose loops."""
    count = 14 * turns
    t = np.linspace(0, turns, count)
    radius = size * (0.35 + 0.65 * t / turns) * (1 + 0.12 * np.sin(2.7 * t + draw.between(0, 6)))
    x = start[0] + radius * np.cos(2 * np.pi * t) - radius[0]
    y = start[1] + radius * np.sin(2 * np.pi * t)
    return np.stack([x, y, np.full(count, 0.0026)], axis=1)


@assembles("cable")
def charger(b: Builder, draw: Draw, style: Style) -> None:
    """A charger with its cable in loose loops."""
    plastic = WHITE_PLASTIC if draw.chance(0.6) else BLACK_PLASTIC
    path = _wire(draw, [0.0, 0.0], draw.whole(2, 4), draw.between(0.04, 0.07))
    b.add(plastic, tube(path, 0.0026, 7), name="cable")
    at = (float(path[-1][0]) + 0.0228, float(path[-1][1]) + 0.012, 0)
    b.add(plastic, rounded_box((0.045, 0.03, 0.026), at, 0.005, inner=1), name="plug")


def power_cable(draw: Draw, style: Style, run: float, end: float) -> FurniturePiece:
    """A plug in a socket, an object of its own, and its cable to furniture at the wall.

    The origin is the socket's middle. The cable hangs to the side of the furniture at x = `run` and
    climbs behind it, in the gap to the wall, to z = `end`; metres.
    """
    b = Builder("cable", "cable", "on_wall")
    plastic = WHITE_PLASTIC if draw.chance(0.5) else BLACK_PLASTIC
    with b.holding("socket", "switch"):
        b.add(WHITE_PLASTIC, box((0.085, 0.01, 0.085), (0, -0.005, -0.0425), 0.003), name="plate")
    b.add(plastic, cylinder(0.018, 0.0102, 0.045, 18, 0.003).turned("x", 90), name="plug")
    low = -draw.between(0.07, 0.1)  # above the highest skirting
    behind = run + _BEHIND * _sign(run)
    corners = np.array(
        [
            *((0.0, -0.034, -0.012), (0.0, -0.036, -0.07), (0.3 * run, -0.03, low)),
            *((0.7 * run, -0.018, low), (run, _IN_GAP, -0.085), (behind, _IN_GAP, -0.04)),
            (behind, _IN_GAP, end),
        ]
    )
    t = np.linspace(0, len(corners) - 1, 60)
    path = np.stack([np.interp(t, np.arange(len(corners)), corners[:, k]) for k in range(3)], 1)
    path = ndimage.gaussian_filter1d(path, 3.0, axis=0, mode="nearest")
    b.add(plastic, tube(path, 0.0025, 8), name="cable")
    gap = sorted((run, behind + 0.01 * _sign(run)))
    hanging = sorted((-0.01 * _sign(run), run))
    boxes = [
        [[-0.0425, -0.05, -0.0425], [0.0425, 0.0, 0.0425]],
        [[hanging[0], -0.04, -0.11], [hanging[1], -0.002, -0.02]],
        [[gap[0], -0.0085, -0.12], [gap[1], -0.0005, end + 0.005]],
    ]
    return replace(b.piece(), boxes=np.array(boxes))


_IN_GAP = -0.0045  # metres, of a cable in the gap between furniture and wall
_BEHIND = 0.05  # metres, how far behind the furniture a cable climbs


def _sign(value: float) -> float:
    return 1.0 if value > 0 else -1.0


@assembles("cable", "free")
def power_strip(b: Builder, draw: Draw, style: Style) -> None:
    """A strip of sockets with its cable, on the floor."""
    count = draw.whole(3, 6)
    long = 0.055 * count + 0.04
    b.add(WHITE_PLASTIC, box((long, 0.055, 0.04), (0, 0, 0), 0.005), name="strip")
    for k in range(count):
        x = (k - 0.5 * (count - 1)) * 0.055
        b.add(RUBBER, cylinder(0.02, 0.0401, 0.0408, 18).moved(x, 0, 0), name="sockets")
    t = np.linspace(0, 1, 24)
    path = np.stack([0.5 * long + 0.004 + 0.5 * t, 0.09 * np.sin(5 * t) * t, 0.0036 + 0 * t], 1)
    b.add(WHITE_PLASTIC, tube(path, 0.0035, 8), name="cable")


@assembles("picture")
def frame(b: Builder, draw: Draw, style: Style) -> None:
    """A photograph in a frame that stands on its prop."""
    x, z = draw.between(0.1, 0.2), draw.between(0.13, 0.24)
    body = draw.pick([style.wood, style.metal, style.lacquer])
    tilted = [(body, box((x, 0.014, z), (0, 0, 0), 0.002))]
    photo = box((x - 0.03, 0.001, z - 0.03), (0, -0.0076, 0.015))
    lean = -11.0
    for material, mesh in (*tilted, printed(draw, style, photo)):
        b.add(material, mesh.turned("x", lean), name="frame" if material is body else "photo")
    prop = bar((0, 0.018, 0.5 * z), (0, 0.3 * z, 0.003), 0.003, 8)
    b.add(BLACK_PLASTIC, prop, name="prop")
    b.ground()


@assembles("crockery")
def rack(b: Builder, draw: Draw, style: Style) -> None:
    """A dish rack with plates standing in it."""
    x, y = 0.38, 0.28
    metal = STEEL if draw.chance(0.6) else style.metal
    ring = [(-x / 2, -y / 2), (x / 2, -y / 2), (x / 2, y / 2), (-x / 2, y / 2)]
    for z in (0.012, 0.1):
        for k in range(4):
            a, c = ring[k], ring[(k + 1) % 4]
            b.add(metal, bar((*a, z), (*c, z), 0.003, 8), name="rack")
    for corner in ring:
        b.add(metal, bar((*corner, 0.0), (*corner, 0.1), 0.0032, 8), name="rack")
    glaze = glazed(draw, style)
    for k in range(draw.whole(3, 8)):
        disc = cylinder(draw.between(0.085, 0.12), 0.0, 0.006, 30, 0.002).turned("y", 82)
        low = float(disc.vertices[:, 2].min())
        b.add(glaze, disc.moved(-0.14 + 0.036 * k, 0, 0.016 - low), name="plates")


@assembles("clutter")
def board(b: Builder, draw: Draw, style: Style) -> None:
    """A chopping board with a knife, a tray, or a placemat."""
    x, y, z = _sized(draw, (0.36, 0.24, 0.018))
    b.add(style.wood, box((x, y, z), bevel=0.004), name="board")
    if b.name == "chopping board":
        b.add(STEEL, box((0.18, 0.03, 0.0016), (-0.04, 0.01, z + 0.0002)), name="blade")
        b.add(
            BLACK_PLASTIC, box((0.1, 0.024, 0.014), (0.1005, 0.01, z + 0.0002), 0.004), name="grip"
        )


@assembles("clutter")
def knives(b: Builder, draw: Draw, style: Style) -> None:
    """A block of knives."""
    b.add(style.wood, box((0.1, 0.14, 0.2), bevel=0.005), name="block")
    for k in range(5):
        at = (-0.03 + 0.03 * (k % 3), -0.03 + 0.06 * (k // 3), 0.2002)
        b.add(BLACK_PLASTIC, box((0.016, 0.022, 0.09), at, 0.004), name="grips")


@assembles("clutter")
def cleaner(b: Builder, draw: Draw, style: Style) -> None:
    """A sponge and a bottle of washing-up liquid's little tray."""
    foam = Material("paper", hex_color("#d9b93a"), 0.95, family="corrugated")
    b.add(foam, box((0.1, 0.065, 0.028), bevel=0.003), name="foam")
    scourer = box((0.1, 0.065, 0.008), (0, 0, 0.0281), 0.001)
    b.add(Material("carpet", hex_color("#3a6a3a"), 0.95, family="loop"), scourer, name="scourer")


@assembles("food")
def eggs(b: Builder, draw: Draw, style: Style) -> None:
    """Eggs in their tray."""
    b.add(CARDBOARD, box((0.15, 0.1, 0.03), bevel=0.006), name="tray")
    shell = Material("ceramic", hex_color("#c9966a"), 0.6, family="earthenware")
    for k in range(6):
        egg = sphere(0.021, 16, 10).scaled(z=1.25)
        eggs = egg.moved(-0.048 + 0.048 * (k % 3), -0.024 + 0.048 * (k // 3), 0.046)
        b.add(shell, eggs, name="eggs")


@assembles("clutter", "on_wall")
def fixture(b: Builder, draw: Draw, style: Style, size: Size, height: float, holes: int) -> None:
    """A plate on the wall: socket, switch, thermostat, vent, intercom."""
    b.category = "switch" if b.name in ("socket", "switch") else "fitting"
    b.mount_height = height
    x, y, z = size
    plate = box((x, y, z), (0, -0.5 * y, 0), min(0.003, 0.3 * y))
    b.add(WHITE_PLASTIC, plate, name="plate")
    if b.name == "socket":
        for k in range(holes):
            at = (k - 0.5 * (holes - 1)) * x / holes
            ring = cylinder(0.02, 0.0, 0.001, 20).turned("x", 90)
            b.add(RUBBER, ring.moved(at, -y - 0.0001, 0.5 * z), name="sockets")
    elif b.name == "switch":
        for k in range(holes):
            at = (k - 0.5 * (holes - 1)) * 0.9 * x / holes
            rockers = box((0.75 * x / holes, 0.005, 0.72 * z), (at, -y - 0.0026, 0.14 * z), 0.0015)
            b.add(WHITE_PLASTIC, rockers, name="rockers")
    elif b.name == "vent":
        for k in range(6):
            slat = box((0.84 * x, 0.004, 0.05 * z), (0, -y - 0.0021, (0.13 + 0.14 * k) * z))
            b.add(RUBBER, slat, name="slats")
    else:
        b.add(SCREEN, box((0.55 * x, 0.002, 0.4 * z), (0, -y - 0.0011, 0.4 * z)), name="display")


@assembles("fitting", "ceiling")
def detector(b: Builder, draw: Draw, style: Style) -> None:
    """A smoke detector under the ceiling."""
    r = draw.between(0.045, 0.06)
    b.add(WHITE_PLASTIC, cylinder(0.75 * r, -0.036, 0.0, 28, 0.004, top=1.33), name="case")
    lamp = sphere(0.0025, 8, 6).moved(0.4 * r, 0, -0.0365)
    b.add(Material("plastic", hex_color("#8a1a14"), 0.3), lamp, name="lamp")


@assembles("toy", "free")
def bricks(b: Builder, draw: Draw, style: Style) -> None:
    """A scatter of building bricks around a little tower."""
    used: list[tuple[float, float]] = []
    for k in range(draw.whole(6, 16)):
        x, y = (float(value) for value in draw.uniform(-0.2, 0.2, 2))
        if any(abs(x - a) + abs(y - c) < 0.09 for a, c in used):
            continue
        used.append((x, y))
        tall = draw.whole(1, 4) if k < 3 else 1
        for level in range(tall):
            paint = tinted(draw, style)
            turn = draw.between(0, 180) if tall == 1 else 90.0 * level
            brick = box((0.06, 0.03, 0.03), (0, 0, 0), 0.002).turned("z", turn)
            b.add(paint, brick.moved(x, y, 0.0301 * level), name="bricks")


@assembles("toy")
def car(b: Builder, draw: Draw, style: Style) -> None:
    """A toy car or train of two."""
    for k in range(2 if b.name == "toy train" else 1):
        x = 0.12 * k
        paint = tinted(draw, style)
        b.add(paint, box((0.1, 0.05, 0.025), (x, 0, 0.012), 0.006), name="body")
        cabin = box((0.05, 0.044, 0.024), (x + 0.006, 0, 0.0372), 0.006)
        b.add(tinted(draw, style), cabin, name="cabin")
        wheel = cylinder(0.013, 0.0, 0.01, 16, 0.002).turned("x", 90)
        for side, end in CORNERS:
            at = (x + 0.03 * end, side * 0.0305 + 0.005, 0.013)
            b.add(RUBBER, wheel.moved(*at), name="wheels")


@assembles("toy")
def teddy(b: Builder, draw: Draw, style: Style) -> None:
    """A stuffed animal that sits."""
    plush = Material(
        "fabric", hex_color(draw.pick(("#8a6240", "#b59a78", "#77706a"))), 0.95, family="boucle"
    )
    s = draw.between(0.8, 1.3)

    def ball(r: float, x: float, y: float, z: float, tall: float = 1.0) -> BodyMesh:
        return sphere(r * s, 16, 10).scaled(z=tall).moved(x * s, y * s, z * s)

    b.add(plush, ball(0.07, 0, 0, 0.077, 1.1), ball(0.055, 0, 0, 0.19), name="body")
    for side in (-1, 1):
        b.add(
            plush,
            ball(0.02, side * 0.042, 0, 0.235),
            ball(0.03, side * 0.05, -0.085, 0.03),
            ball(0.026, side * 0.08, -0.02, 0.1, 1.5),
            name="limbs",
        )
        b.add(BLACK_PLASTIC, ball(0.006, side * 0.02, -0.05, 0.205), name="eyes")
    b.add(BLACK_PLASTIC, ball(0.008, 0, -0.055, 0.185), name="nose")


@assembles("toy", "free")
def ball(b: Builder, draw: Draw, style: Style, radius: float) -> None:
    """A ball or a globe without its stand."""
    r = radius * draw.between(0.9, 1.1)
    skin = Material("leather", draw.pick(style.accents).color, 0.4, family="pebbled")
    b.add(skin, sphere(r, 26, 16).moved(0, 0, r), name="ball")


@assembles("toy", "free")
def dumbbells(b: Builder, draw: Draw, style: Style) -> None:
    """A pair of dumbbells."""
    for k in (-1, 1):
        y = 0.065 * k
        b.add(CHROME, bar((-0.07, y, 0.045), (0.07, y, 0.045), 0.013, 14), name="bars")
        for side in (-1, 1):
            disc = cylinder(0.045, -0.025, 0.025, 26, 0.005).turned("y", 90)
            b.add(RUBBER, disc.moved(side * 0.0952, y, 0.045), name="weights")


@assembles("books")
def pages(b: Builder, draw: Draw, style: Style) -> None:
    """An open book, face up."""
    x, y = draw.between(0.13, 0.18), draw.between(0.19, 0.26)
    cover = draw.pick(style.books)
    b.add(cover, box((2 * x + 0.012, y + 0.008, 0.004)), name="cover")
    for side in (-1, 1):
        b.add(
            PAGES, box((x, y, 0.012), (side * (0.5 * x + 0.0006), 0, 0.0042), 0.0025), name="pages"
        )
