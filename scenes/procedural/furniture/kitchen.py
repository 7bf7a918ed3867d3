"""Kitchen units of equal height and depth, appliances and pots.

Units are placed side by side: each is exactly `width` wide, worktop included. Backs are at
y = 0.3, doors at y = -0.3, front edges of worktops at y = -0.32.
"""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.procedural.furniture.build import Builder
from pbrnet.scenes.procedural.furniture.cabinets import (
    BOARD,
    add_door,
    add_drawer,
    carcass,
    left_open,
    shelf,
)
from pbrnet.scenes.procedural.furniture.geometry import (
    BodyMesh,
    bar,
    box,
    cylinder,
    lathe,
    loft,
    merge,
    post,
    prism,
    rounded_box,
    span,
    sphere,
    superellipse,
    tube,
)
from pbrnet.scenes.procedural.furniture.style import (
    BLACK_PLASTIC,
    CERAMIC,
    CHROME,
    IRON,
    SCREEN,
    STEEL,
    WHITE_PAINT,
    Style,
    hex_color,
)
from pbrnet.scenes.procedural.piece import FurniturePiece, Material
from pbrnet.scenes.seeds import Draw

DEPTH = 0.6
PLINTH = 0.1
TOP = 0.038
INSIDE = Material("paint", hex_color("#dedad2"), 0.5)


def _base(style: Style, name: str, width: float, worktop: bool = True) -> tuple[Builder, float]:
    """Builder with plinth and worktop, and the height of the worktop's underside."""
    b = Builder(name, "kitchen unit", "wall", front_clearance=0.9)
    under = style.worktop_height - TOP
    b.add(
        style.kitchen,
        span(
            (-width / 2 + 0.001, -DEPTH / 2 + 0.06, 0),
            (width / 2 - 0.001, -DEPTH / 2 + 0.078, PLINTH + 0.001),
        ),
        name="plinth",
    )
    if worktop:
        _add_top(b, style, width)
    return b, under


def _add_top(b: Builder, style: Style, width: float, holes: tuple[Float64Array, ...] = ()) -> None:
    outline = np.array([[-1, -0.32], [1, -0.32], [1, 0.3], [-1, 0.3]]) * [width / 2, 1]
    high = style.worktop_height
    if holes:
        b.add(style.worktop, prism(outline, high - TOP, high, holes), name="worktop")
    else:
        worktop = span((-width / 2, -0.32, high - TOP), (width / 2, 0.3, high), grain="x")
        b.add(style.worktop, worktop, name="worktop")


def _add_doors(
    b: Builder,
    draw: Draw,
    style: Style,
    width: float,
    z0: float,
    z1: float,
    depth: float,
    low_handles: bool = False,
    chance: float = 0.2,
    handed: str = "left",
) -> bool:
    """Add one or two doors; returns True if one is ajar, with a mean probability of `chance`."""
    ajar = draw.between(15, 75) if draw.chance(chance * (0.2 + 1.6 * style.disorder)) else 0.0
    if width > 0.62:
        add_door(b, style, style.kitchen, -width / 2, 0, z0, z1, depth, "left", ajar, low_handles)
        add_door(b, style, style.kitchen, 0, width / 2, z0, z1, depth, "right", 0.0, low_handles)
    else:
        add_door(
            b, style, style.kitchen, -width / 2, width / 2, z0, z1, depth, handed, ajar, low_handles
        )
    return ajar > 0


def base_cupboard(draw: Draw, style: Style, width: float = 0.6) -> FurniturePiece:
    """A base unit with doors, often with a drawer at the top; a door may be ajar."""
    b, under = _base(style, "base cupboard", width)
    b.add(INSIDE, *carcass(width, DEPTH, PLINTH, under - 0.001))
    split = under - 0.003
    if draw.chance(0.6):
        split = under - 0.15
        out = draw.between(0.08, 0.25) if draw.chance(0.12) else 0.0
        add_drawer(
            b, style, style.kitchen, INSIDE, -width / 2, width / 2, split, under - 0.002, DEPTH, out
        )
    handed = "left" if draw.chance(0.5) else "right"
    shown = _add_doors(b, draw, style, width, PLINTH, split, DEPTH, handed=handed)
    level = 0.5 * (PLINTH + split)
    b.add(INSIDE, shelf(width, DEPTH, level))
    if shown:
        with b.holding("pot", "pot"):
            b.add(STEEL, _pot(0.11, 0.12).moved(-0.1 * width, 0, level), name="pots")
        b.add(CERAMIC, _plates(5).moved(0.0, 0, PLINTH + BOARD), name="plates")
    b.surface(0, 0, style.worktop_height, width / 2 - 0.02, 0.27)
    return b.piece()


def drawer_unit(draw: Draw, style: Style, width: float = 0.6) -> FurniturePiece:
    """A base unit with three or four drawers, sometimes one pulled out."""
    b, under = _base(style, "drawer unit", width)
    b.add(INSIDE, *carcass(width, DEPTH, PLINTH, under - 0.001))
    shares = [0.0, 0.42, 0.78, 1.0] if draw.chance(0.5) else [0.0, 0.3, 0.6, 0.8, 1.0]
    zs = PLINTH + (under - 0.002 - PLINTH) * np.array(shares)
    pulled = left_open(draw, style, len(shares) - 1)
    for k in range(len(shares) - 1):
        out = draw.between(0.08, 0.28) if k == pulled else 0.0
        add_drawer(
            b,
            style,
            style.kitchen,
            INSIDE,
            -width / 2,
            width / 2,
            float(zs[k]),
            float(zs[k + 1]),
            DEPTH,
            out,
        )
    b.surface(0, 0, style.worktop_height, width / 2 - 0.02, 0.27)
    return b.piece()


def sink_unit(draw: Draw, style: Style, width: float = 0.8) -> FurniturePiece:
    """A base unit with doors, a sink in the worktop and a high tap."""
    b, under = _base(style, "sink unit", width, worktop=False)
    half_x, half_y = min(0.2, width / 2 - 0.08), 0.19
    x, y, high = (
        draw.pick((-1.0, 1.0)) * max(0.0, width / 2 - 0.1 - half_x),
        -0.04,
        style.worktop_height,
    )
    _add_top(b, style, width, (superellipse(half_x, half_y, 0, 7, 40, x, y)[:, :2],))
    rings = [
        superellipse(half_x + grow, half_y + grow, high + z, power, 40)
        for grow, z, power in (
            (-0.03, -0.19, 4.0),
            (-0.008, -0.17, 6.0),
            (-0.004, 0.0005, 7.0),
            (0.014, 0.0005, 7.0),
            (0.014, 0.003, 7.0),
            (-0.008, 0.003, 7.0),
            (-0.014, -0.15, 6.0),
            (-0.035, -0.178, 4.0),
        )
    ]
    b.add(STEEL, loft(np.stack(rings)).moved(x, y), name="sink")
    b.add(IRON, cylinder(0.04, -0.1785, -0.1755, 24).moved(x, y, high), name="drain")
    tap = CHROME if draw.chance(0.7) else style.metal
    t = np.linspace(0, np.pi, 12)
    arch = np.stack([0 * t, 0.225 - 0.1 + 0.1 * np.cos(t), 0.28 + 0.1 * np.sin(t)], axis=1)
    path = np.concatenate([[[0, 0.225, 0.0], [0, 0.225, 0.2]], arch, [[0, 0.025, 0.22]]])
    with b.holding("tap", "fitting"):
        b.add(
            tap,
            tube(path, 0.0125, 12).moved(x, 0, high - 0.001),
            cylinder(0.026, 0, 0.05, 20, 0.003).moved(x, 0.225, high),
            name="tap",
        )
        b.add(
            tap,
            bar((x + 0.015, 0.225, high + 0.075), (x + 0.085, 0.205, high + 0.105), 0.006, 8),
            name="tap",
        )
    b.add(INSIDE, *carcass(width, DEPTH, PLINTH, under - 0.001, top=False))
    _add_doors(b, draw, style, width, PLINTH, under - 0.003, DEPTH)
    free = width / 2 + abs(x) - half_x - 0.04
    if free > 0.16:
        b.surface(-float(np.sign(x)) * (width / 2 - free / 2), -0.02, high, free / 2 - 0.01, 0.24)
    return b.piece()


def hob_unit(draw: Draw, style: Style, width: float = 0.6) -> FurniturePiece:
    """An oven with knobs below a gas or glass-ceramic hob."""
    b, under = _base(style, "hob and oven", width)
    high = style.worktop_height
    steel = STEEL if draw.chance(0.6) else BLACK_PLASTIC
    b.add(INSIDE, *carcass(width, DEPTH, PLINTH, under - 0.001))
    f = -DEPTH / 2
    panel = 0.1
    b.add(
        steel,
        span(
            (-width / 2 + 0.002, f, under - panel),
            (width / 2 - 0.002, f + 0.019, under - 0.003),
            0.002,
        ),
        name="panel",
    )
    for k in range(5):
        knob = lathe([(0.019, -0.002), (0.018, 0.016), (0.014, 0.02), (0.0, 0.02)], 20).turned(
            "x", 90
        )
        b.add(IRON, knob.moved((k - 2) * 0.095, f, under - panel / 2), name="knobs")
    door_low = PLINTH + 0.1
    door_high = under - panel - 0.004
    door = span((-width / 2 + 0.002, f, door_low), (width / 2 - 0.002, f + 0.019, door_high), 0.002)
    b.add(steel, door, name="door")
    b.add(
        SCREEN,
        span(
            (-width / 2 + 0.05, f - 0.002, door_low + 0.05),
            (width / 2 - 0.05, f + 0.001, door_high - 0.075),
        ),
        name="window",
    )
    z = door_high - 0.035
    b.add(
        STEEL,
        bar((-width / 2 + 0.06, f - 0.042, z), (width / 2 - 0.06, f - 0.042, z), 0.009, 10),
        name="handle",
    )
    for side in (-1, 1):
        b.add(
            STEEL,
            bar(
                (side * (width / 2 - 0.09), f + 0.002, z),
                (side * (width / 2 - 0.09), f - 0.042, z),
                0.007,
                8,
            ),
            name="handle",
        )
    b.add(
        style.kitchen,
        span(
            (-width / 2 + 0.002, f, PLINTH + 0.002),
            (width / 2 - 0.002, f + 0.019, door_low - 0.004),
            0.0015,
        ),
        name="front",
    )
    gas = draw.chance(0.5)
    hob = box((min(0.58, width - 0.02), 0.51, 0.007), (0, -0.02, high), 0.002)
    b.add(STEEL if gas else SCREEN, hob, name="hob")
    places = [
        (-0.145, -0.14, 0.075), (0.145, -0.14, 0.095), (-0.145, 0.11, 0.095), (0.145, 0.11, 0.075),
    ]  # fmt: skip
    for x, y, radius in places:
        if gas:
            burner = [
                (0.5 * radius, 0.006), (0.48 * radius, 0.02), (0.4 * radius, 0.026), (0, 0.027),
            ]  # fmt: skip
            b.add(IRON, lathe(burner, 24).moved(x, y, high), name="burners")
            for turn in range(4):
                arm = bar((0.3 * radius, 0, 0.036), (1.25 * radius, 0, 0.036), 0.004, 8)
                foot = bar((1.25 * radius, 0, 0.006), (1.25 * radius, 0, 0.0385), 0.004, 8)
                b.add(
                    IRON,
                    *(m.turned("z", 45 + 90 * turn).moved(x, y, high) for m in (arm, foot)),
                    name="grates",
                )
        else:
            angle = 2 * np.pi * np.arange(40) / 40
            ring = np.stack([radius * np.cos(angle), radius * np.sin(angle), 0 * angle], axis=1)
            b.add(IRON, tube(ring, 0.0012, 8, closed=True).moved(x, y, high + 0.0068), name="rings")
    if draw.chance(0.14):
        x, y, radius = draw.pick(places)
        z = high + (0.0405 if gas else 0.0083)
        with b.holding("pot on the hob", "pot"):
            b.add(
                STEEL if draw.chance(0.6) else style.accents[0],
                _pot(0.1, draw.between(0.09, 0.15), draw.chance(0.5)).moved(x, y, z),
                name="pot",
            )
    return b.piece()


def fridge(draw: Draw, style: Style, width: float = 0.6) -> FurniturePiece:
    """A tall fridge with a freezer compartment below or above."""
    depth, height = 0.64, draw.between(1.7, 1.95)
    b = Builder("fridge", "fridge", "wall", front_clearance=0.9)
    case = STEEL if draw.chance(0.45) else WHITE_PAINT
    f = -depth / 2
    b.add(
        case,
        span((-width / 2, f + 0.065, 0.03), (width / 2, depth / 2, height), 0.006),
        name="case",
    )
    foot = span((-width / 2 + 0.01, f + 0.08, 0), (width / 2 - 0.01, depth / 2 - 0.02, 0.031))
    b.add(BLACK_PLASTIC, foot, name="foot")
    split = 0.36 * height if draw.chance(0.7) else 0.66 * height
    side = draw.pick((-1.0, 1.0))
    for z0, z1 in ((0.06, split), (split + 0.006, height - 0.002)):
        door = rounded_box((width - 0.002, 0.06, z1 - z0), (0, f + 0.03, z0), 0.012, inner=1)
        b.add(case, door, name="door")
        length = min(0.4, 0.6 * (z1 - z0))
        start = z1 - 0.05 - length if (z1 == split) else z0 + 0.05
        x = side * (width / 2 - 0.05)
        b.add(
            STEEL,
            bar((x, f - 0.035, start), (x, f - 0.035, start + length), 0.009, 10),
            name="handle",
        )
        for z in (start + 0.03, start + length - 0.03):
            b.add(STEEL, bar((x, f + 0.003, z), (x, f - 0.035, z), 0.006, 8), name="handle")
    if draw.chance(0.14):
        for _ in range(draw.whole(2, 5)):
            x, z = draw.between(-0.2, 0.2), draw.between(1.15, 1.5)
            if abs(z - split) < 0.075:
                z = split + 0.075  # on one door
            note = (
                style.picture(draw)
                if draw.chance(0.4)
                else Material("paper", (0.8, 0.75, 0.5), 0.9)
            )
            board = span((x - 0.05, f - 0.0012, z - 0.06), (x + 0.05, f - 0.0004, z + 0.06))
            uvs = np.stack(
                [(board.vertices[:, 0] - x) / 0.1 + 0.5, (board.vertices[:, 2] - z) / 0.12 + 0.5], 1
            )
            if note.kind == "picture":
                board = BodyMesh(board.vertices, board.faces, uvs, smooth=False)
            with b.holding("note", "paper"):
                b.add(note, board, name="note")
                magnet = cylinder(0.011, 0, 0.006, 14).turned("x", 90)
                magnet = magnet.moved(x, f - 0.001, z + 0.045)
                b.add(style.accents[1], magnet, name="magnet")
    b.surface(0, 0.03, height, width / 2 - 0.05, depth / 2 - 0.08)
    return b.piece()


def wall_cupboard(draw: Draw, style: Style, width: float = 0.6) -> FurniturePiece:
    """A wall cupboard, with crockery if a door is ajar; the origin is on its lower back edge."""
    depth, height = 0.34, 0.7
    b = Builder(
        "wall cupboard", "kitchen unit", "on_wall", mount_height=style.worktop_height + 0.52
    )
    parts = Builder("", "", "free")
    parts.add(style.kitchen, *carcass(width, depth, 0, height))
    levels = (0.24, 0.47)
    for z in levels:
        parts.add(INSIDE, shelf(width, depth, z))
    handed = "left" if draw.chance(0.5) else "right"
    if _add_doors(parts, draw, style, width, 0.0, height, depth, True, 0.3, handed):
        glaze = draw.pick(style.accents)
        for z in (BOARD, *levels):
            plates = _plates(draw.whole(3, 8)).moved(-0.2 * width, 0.01, z)
            parts.add(CERAMIC, plates, name="plates")
            profile = [
                (0.03, 0), (0.04, 0.012), (0.043, 0.085), (0.039, 0.085), (0.034, 0.014), (0, 0.01),
            ]  # fmt: skip
            cup = lathe(profile, 20)
            for k in range(2):
                parts.add(glaze, cup.moved(0.22 * width, -0.06 + 0.11 * k, z), name="cups")
    b.add_from(parts, y=-depth / 2)
    return b.piece()


def extractor_hood(
    draw: Draw, style: Style, width: float = 0.6, height: float = 0.9
) -> FurniturePiece:
    """A steel canopy with a flue and two small lamps; `height` of the flue's upper end, metres."""
    b = Builder("extractor hood", "extractor hood", "on_wall", mount_height=1.58)
    steel = STEEL if draw.chance(0.8) else WHITE_PAINT
    top = draw.between(0.2, 0.34)
    b.add(
        steel,
        post([(0, -0.25, 0.0), (0, -0.25, 0.05)], [(width, 0.5)] * 2),
        post([(0, -0.2495, 0.0505), (0, -0.14, top)], [(width - 0.002, 0.499), (0.28, 0.28)]),
        box((0.26, 0.26, height - top + 0.005), (0, -0.1305, top - 0.005), 0.002),
        name="hood",
    )
    b.add(IRON, box((width - 0.06, 0.4, 0.004), (0, -0.25, -0.003)), name="filter")
    for k in range(int((width - 0.1) / 0.03)):
        x = -width / 2 + 0.065 + 0.03 * k
        b.add(steel, box((0.012, 0.3, 0.003), (x, -0.22, -0.0055)), name="filter")
    for side in (-1, 1):
        diffuser = cylinder(0.03, -0.0065, -0.0005, 24).moved(side * (width / 2 - 0.14), -0.42)
        b.add(WHITE_PAINT, diffuser, name="diffuser", lumens=260.0, kelvin=style.kelvin + 300)
    for k in range(3):
        button = cylinder(0.009, 0, 0.004, 14).turned("x", 90)
        b.add(BLACK_PLASTIC, button.moved((k - 1) * 0.035, -0.4995, 0.025), name="buttons")
    return b.piece()


def _pot(radius: float, height: float, lid: bool = False) -> BodyMesh:
    """Pot with two handles, open or with a lid."""
    profile = [(radius - 0.006, 0.0), (radius, 0.006), (radius, height), (radius - 0.003, height)]
    profile += [(radius - 0.006, 0.01), (0.0, 0.008)] if not lid else []
    meshes = [
        lathe(
            profile
            if not lid
            else [
                *profile[:3],
                (0.92 * radius, height + 0.008),
                (0.03, height + 0.022),
                (0, height + 0.022),
            ],
            32,
        )
    ]
    if lid:
        meshes += [
            cylinder(0.006, height + 0.015, height + 0.036, 10),
            sphere(0.017, 14, 8).scaled(z=0.7).moved(z=height + 0.042),
        ]
    t = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 8)
    for side in (-1, 1):
        ear = np.stack(
            [side * (radius - 0.003 + 0.03 * np.cos(t)), 0.035 * np.sin(t), 0 * t + 0.75 * height],
            axis=1,
        )
        meshes.append(tube(ear, 0.005, 8))
    return merge(meshes)


def _plates(count: int) -> BodyMesh:
    plate = [
        (0.06, 0.0), (0.068, 0.004), (0.105, 0.016), (0.106, 0.019), (0.068, 0.008), (0.0, 0.007),
    ]  # fmt: skip
    return merge([lathe(plate, 28).moved(z=0.0075 * k) for k in range(count)])


def cooking_pot(draw: Draw, style: Style) -> FurniturePiece:
    """A pot with a lid."""
    b = Builder("cooking pot", "pot", "on_top")
    material = STEEL if draw.chance(0.5) else draw.pick(style.accents)
    b.add(material, _pot(draw.between(0.09, 0.13), draw.between(0.09, 0.16), True))
    return b.piece()


def kettle(draw: Draw, style: Style) -> FurniturePiece:
    """An electric kettle on its base."""
    b = Builder("kettle", "kettle", "on_top")
    body = STEEL if draw.chance(0.6) else draw.pick(style.accents)
    b.add(BLACK_PLASTIC, cylinder(0.08, 0, 0.018, 32, bevel=0.004), name="base")
    profile = [
        (0.075, 0.0185), (0.078, 0.03), (0.066, 0.16), (0.056, 0.2), (0.05, 0.207), (0, 0.212),
    ]  # fmt: skip
    b.add(body, lathe(profile, 32), name="body")
    b.add(BLACK_PLASTIC, sphere(0.012, 12, 8).moved(z=0.217), name="knob")
    path = [(0.055, 0, 0.195), (0.095, 0, 0.2), (0.118, 0, 0.17), (0.115, 0, 0.1), (0.073, 0, 0.05)]
    b.add(BLACK_PLASTIC, tube(path, 0.01, 10), name="handle")
    b.add(
        body,
        tube([(-0.05, 0, 0.15), (-0.085, 0, 0.19), (-0.095, 0, 0.2)], [0.022, 0.014, 0.011], 12),
        name="body",
    )
    return b.piece()


def microwave(draw: Draw, style: Style) -> FurniturePiece:
    """A microwave oven."""
    width, depth = draw.between(0.44, 0.52), draw.between(0.34, 0.39)
    height = draw.between(0.26, 0.3)
    b = Builder("microwave", "microwave", "on_top")
    case = STEEL if draw.chance(0.5) else BLACK_PLASTIC if draw.chance(0.5) else WHITE_PAINT
    f = -depth / 2
    b.add(
        case,
        span((-width / 2, f + 0.012, 0.012), (width / 2, depth / 2, height), 0.004),
        name="case",
    )
    door = span((-width / 2, f, 0.014), (width / 2 - 0.122, f + 0.0115, height - 0.002), 0.003)
    b.add(case, door, name="door")
    b.add(
        SCREEN,
        span((-width / 2 + 0.035, f - 0.0015, 0.05), (width / 2 - 0.16, f + 0.001, height - 0.04)),
        name="window",
    )
    b.add(
        BLACK_PLASTIC,
        span((width / 2 - 0.12, f, 0.014), (width / 2, f + 0.0115, height - 0.002), 0.002),
        name="panel",
    )
    for row in range(4):
        for column in range(3):
            at = (width / 2 - 0.09 + 0.03 * column, f, 0.05 + 0.035 * row)
            b.add(STEEL, box((0.02, 0.003, 0.018), at), name="keys")
    b.add(
        STEEL,
        bar(
            (width / 2 - 0.14, f - 0.025, 0.05),
            (width / 2 - 0.14, f - 0.025, height - 0.05),
            0.007,
            8,
        ),
        name="handle",
    )
    for z in (0.07, height - 0.07):
        b.add(
            STEEL,
            bar((width / 2 - 0.14, f + 0.002, z), (width / 2 - 0.14, f - 0.025, z), 0.005, 8),
            name="handle",
        )
    for sx in (-1, 1):
        for sy in (-1, 1):
            feet = cylinder(0.014, 0, 0.013, 12)
            feet = feet.moved(sx * (width / 2 - 0.04), sy * (depth / 2 - 0.05))
            b.add(BLACK_PLASTIC, feet, name="feet")
    return b.piece()
