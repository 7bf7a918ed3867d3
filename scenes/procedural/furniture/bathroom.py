"""Bathroom fittings."""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.procedural.furniture.build import Builder
from pbrnet.scenes.procedural.furniture.cabinets import add_door, add_drawer, carcass
from pbrnet.scenes.procedural.furniture.cloth import plane, surface
from pbrnet.scenes.procedural.furniture.drapes import dropped, hanging, hung, ripples
from pbrnet.scenes.procedural.furniture.geometry import (
    BodyMesh,
    bar,
    box,
    cylinder,
    lathe,
    loft,
    merge,
    prism,
    rounded_box,
    span,
    superellipse,
    tube,
)
from pbrnet.scenes.procedural.furniture.style import (
    BLACK_PLASTIC,
    CERAMIC,
    CHROME,
    GLASS,
    IRON,
    MIRROR,
    STEEL,
    WHITE_PAINT,
    WHITE_PLASTIC,
    Style,
    hex_color,
)
from pbrnet.scenes.procedural.piece import FurniturePiece, Material
from pbrnet.scenes.seeds import Draw


def _tap(spout: float, height: float) -> BodyMesh:
    """Basin mixer at the origin, spout towards the front (-Y)."""
    t = np.linspace(0, 0.5 * np.pi, 6)
    bend = np.stack([0 * t, -0.05 + 0.05 * np.cos(t), height - 0.05 + 0.05 * np.sin(t)], axis=1)
    path = np.concatenate([[[0, 0, 0.0]], bend, [[0, -spout, height - 0.012]]])
    return merge(
        [
            cylinder(0.023, 0, 0.014, 20, bevel=0.003),
            tube(path, 0.0125, 12),
            bar(
                (0, -spout + 0.008, height - 0.006), (0, -spout + 0.004, height - 0.034), 0.0105, 10
            ),
            bar((0, -0.008, height), (0, 0.035, height + 0.035), 0.005, 8),
        ]
    )


def bath_tub(draw: Draw, style: Style, width: float = 1.7) -> FurniturePiece:
    """A bath along the wall, `width` long, with a mixer and hand shower on its rim."""
    depth, height = draw.between(0.72, 0.8), draw.between(0.54, 0.6)
    b = Builder("bath tub", "bath", "wall", front_clearance=0.5)
    half_x, half_y = width / 2, depth / 2
    rings = [
        superellipse(half_x - 0.012, half_y - 0.012, 0.0, 24, 96),
        superellipse(half_x - 0.012, half_y - 0.012, height - 0.045, 24, 96),
        superellipse(half_x, half_y, height - 0.04, 24, 96),
        superellipse(half_x, half_y, height - 0.006, 24, 96),
        superellipse(half_x - 0.006, half_y - 0.006, height, 22, 96),
        superellipse(half_x - 0.062, half_y - 0.062, height, 5, 96),
        superellipse(half_x - 0.075, half_y - 0.075, height - 0.02, 4.5, 96),
        superellipse(half_x - 0.12, half_y - 0.1, height - 0.25, 4, 96),
        superellipse(half_x - 0.17, half_y - 0.13, 0.15, 3.6, 96),
        superellipse(half_x - 0.25, half_y - 0.2, 0.125, 3, 96),
    ]
    b.add(CERAMIC, loft(np.stack(rings)), name="tub")
    side = draw.pick((-1.0, 1.0))
    x = side * (half_x - 0.33)
    b.add(CHROME, cylinder(0.028, 0.1255, 0.129, 24).moved(x), name="drain")
    drain = cylinder(0.03, 0, 0.008, 24).turned("y", -90 * side)
    drain = drain.moved(side * (half_x - 0.094), 0, height - 0.15)
    b.add(CHROME, drain, name="drain")
    with b.holding("tap", "fitting"):
        b.add(CHROME, _tap(0.15, 0.14).moved(0, half_y - 0.033, height), name="tap")
    t = np.linspace(0, 1, 14)
    hose = np.stack(
        [
            0.09 + 0.13 * t,
            half_y - 0.035 - 0.03 * np.sin(np.pi * t),
            height + 0.01 + 0.11 * np.sin(np.pi * t),
        ],
        1,
    )
    b.add(STEEL, tube(hose, 0.006, 8), name="hose")
    shower = bar((0.22, half_y - 0.036, height), (0.22, half_y - 0.036, height + 0.06), 0.011, 10)
    b.add(CHROME, shower, name="shower")
    path = [
        (0.22, half_y - 0.035, height + 0.05), (0.22, half_y - 0.06, height + 0.16),
        (0.22, half_y - 0.08, height + 0.19),
    ]  # fmt: skip
    b.add(CHROME, tube(path, [0.012, 0.012, 0.03], 12), name="shower")
    if draw.chance(0.6):
        tub = np.concatenate([part.vertices[part.faces] for part in b.piece().parts])
        x = side * -0.3 * width
        near = (np.abs(tub[..., 0] - x).min(axis=1) < 0.35) & (tub[..., 1].min(axis=1) < 0.3)
        long, out = draw.between(0.7, 0.9), draw.between(0.0, 0.05)
        turn, tight = draw.normal(0, 5), draw.between(0.04, 0.15)
        towel = dropped(
            ripples(draw),
            [surface(tub[near], 0.012), plane(2, 0.02)],
            (0.42, long),
            (x, -half_y - out, height + 0.06),
            turn=turn,
            tight=tight,
            thickness=0.008,
        )
        b.add(style.towel, towel, name="towel")
    return b.piece()


def wash_basin(draw: Draw, style: Style, width: float | None = None) -> FurniturePiece:
    """A wash basin with a mixer: on a cabinet, or on a pedestal."""
    width = draw.between(0.55, 0.9) if width is None else width
    depth, height = 0.47, draw.between(0.83, 0.88)
    b = Builder("wash basin", "wash basin", "wall", front_clearance=0.7)
    half_x, half_y = width / 2, depth / 2
    bowl_x = min(0.27, half_x - 0.05)
    inner = [
        superellipse(bowl_x, 0.15, height, 3, 64, y=-0.035),
        superellipse(bowl_x - 0.012, 0.14, height - 0.015, 3, 64, y=-0.035),
        superellipse(bowl_x - 0.05, 0.105, height - 0.1, 2.6, 64, y=-0.03),
        superellipse(bowl_x - 0.15, 0.04, height - 0.125, 2.2, 64, y=-0.03),
    ]
    if draw.chance(0.65):
        low = 0.26
        finish = style.cabinet
        b.add(finish, *carcass(width - 0.02, depth - 0.02, low, height - 0.056, top=False))
        high = height - 0.058
        split = low + 0.5 * (high - low)
        parts = (style, finish, style.wood, -half_x + 0.01, half_x - 0.01)
        pulled = draw.between(0.06, 0.2) if draw.chance(0.25) else 0.0
        if draw.chance(0.5):
            add_drawer(b, *parts, low, split, depth - 0.02, pulled)
            add_drawer(b, *parts, split, high, depth - 0.02)
        else:
            add_door(
                b,
                style,
                finish,
                -half_x + 0.01,
                0,
                low,
                high,
                depth - 0.02,
                "left",
                100 * pulled,
            )
            add_door(b, style, finish, 0, half_x - 0.01, low, high, depth - 0.02, "right")
        for sx in (-1, 1):
            for sy in (-1, 1):
                b.add(
                    style.metal,
                    bar(
                        (sx * (half_x - 0.06), sy * 0.16, 0),
                        (sx * (half_x - 0.06), sy * 0.16, low + 0.002),
                        0.014,
                        10,
                    ),
                    name="feet",
                )
        outer = [
            superellipse(bowl_x - 0.13, 0.06, height - 0.14, 2.4, 64, y=-0.03),
            superellipse(bowl_x - 0.03, 0.13, height - 0.11, 2.6, 64, y=-0.03),
            superellipse(bowl_x, 0.16, height - 0.055, 3, 64, y=-0.03),
            superellipse(half_x, half_y, height - 0.055, 20, 64),
            superellipse(half_x, half_y, height - 0.004, 20, 64),
            superellipse(half_x - 0.004, half_y - 0.004, height, 18, 64),
        ]
        b.add(CERAMIC, loft(np.stack([*outer, *inner])), name="basin")
    else:
        half_x = min(half_x, 0.31)
        outer = [
            superellipse(0.11, 0.11, height - 0.19, 2.4, 64, y=0.06),
            superellipse(0.7 * half_x, 0.17, height - 0.14, 2.6, 64, y=0.03),
            superellipse(0.97 * half_x, half_y - 0.01, height - 0.07, 3.2, 64),
            superellipse(half_x, half_y, height - 0.03, 3.6, 64),
            superellipse(half_x - 0.006, half_y - 0.006, height, 3.6, 64),
        ]
        shrunk = [ring * [min(1.0, (half_x - 0.05) / bowl_x), 1, 1] for ring in inner]
        b.add(CERAMIC, loft(np.stack([*outer, *shrunk])), name="basin")
        column = [
            superellipse(a, c, z, 2.3, 40, y=0.07)
            for a, c, z in (
                (0.12, 0.1, 0.0),
                (0.09, 0.085, 0.06),
                (0.075, 0.075, 0.4),
                (0.1, 0.1, height - 0.17),
            )
        ]
        b.add(CERAMIC, loft(np.stack(column)), name="pedestal")
    b.add(CHROME, cylinder(0.022, -0.1245, -0.1215, 20).moved(0, -0.03, height), name="drain")
    with b.holding("tap", "fitting"):
        tap = _tap(0.13, 0.15).moved(0, 0.16, height - 0.001)
        b.add(CHROME if draw.chance(0.7) else style.metal, tap, name="tap")
    if half_x - bowl_x > 0.105:
        for side in (-1, 1):
            b.surface(side * (half_x - 0.053), -0.02, height, 0.04, 0.16)
    return b.piece()


def toilet(draw: Draw, style: Style) -> FurniturePiece:
    """A toilet with its cistern; the lid is down or up."""
    b = Builder("toilet", "toilet", "wall", front_clearance=0.6, side_clearance=0.15)
    back = 0.34
    seat = draw.between(0.4, 0.43)

    def ring(half_x: float, front: float, rear: float, z: float, power: float = 2.5) -> np.ndarray:
        return superellipse(half_x, (rear - front) / 2, z, power, 48, y=(front + rear) / 2)

    rings = [
        ring(0.115, -0.19, back - 0.03, 0.0, 3.2), ring(0.11, -0.185, back - 0.03, 0.03, 3.2),
        ring(0.105, -0.19, back - 0.04, 0.16, 3.0), ring(0.14, -0.27, back - 0.06, 0.28, 2.6),
        ring(0.178, -0.325, back - 0.07, seat - 0.05),
        ring(0.185, -0.335, back - 0.07, seat - 0.02), ring(0.182, -0.332, back - 0.07, seat),
        ring(0.125, -0.27, 0.06, seat, 2.2), ring(0.12, -0.265, 0.055, seat - 0.02, 2.2),
        ring(0.08, -0.2, -0.0, seat - 0.16, 2.0), ring(0.04, -0.13, -0.06, seat - 0.2, 2.0),
    ]  # fmt: skip
    b.add(CERAMIC, loft(np.stack(rings)), name="bowl")
    outline = ring(0.183, -0.333, 0.12, 0)[:, :2]
    hole = ring(0.115, -0.26, 0.045, 0, 2.2)[:, :2]
    b.add(WHITE_PLASTIC, prism(outline, seat + 0.002, seat + 0.018, [hole]), name="seat")
    lid_rings = [
        ring(0.18, -0.33, 0.125, z) * [shrink, 1, 1]
        for z, shrink in ((0.0, 1.0), (0.012, 1.0), (0.018, 0.95))
    ]
    lid = loft(np.stack(lid_rings))
    if draw.chance(0.7):
        b.add(WHITE_PLASTIC, lid.moved(z=seat + 0.0195), name="lid")
    else:
        b.add(
            WHITE_PLASTIC,
            lid.moved(y=-0.125).turned("x", -96).moved(0, 0.125, seat + 0.02),
            name="lid",
        )
    for side in (-1, 1):
        b.add(
            CHROME,
            bar(
                (side * 0.07 - 0.02, 0.135, seat + 0.012),
                (side * 0.07 + 0.02, 0.135, seat + 0.012),
                0.009,
                10,
            ),
            name="hinge",
        )
    tank = seat + draw.between(0.36, 0.4)
    cistern = rounded_box((0.37, 0.16, tank - seat + 0.008), (0, back - 0.08, seat - 0.008), 0.03)
    b.add(CERAMIC, cistern, name="cistern")
    cistern = rounded_box((0.385, 0.168, 0.035), (0, back - 0.084, tank - 0.005), 0.012)
    b.add(CERAMIC, cistern, name="cistern")
    b.add(CHROME, cylinder(0.022, 0, 0.006, 20).moved(0, back - 0.084, tank + 0.029), name="button")
    for side in (-1, 1):  # beside the button
        b.surface(side * 0.096, back - 0.084, tank + 0.03, 0.065, 0.055)
    return b.piece()


def shower(draw: Draw, style: Style, width: float = 0.9) -> FurniturePiece:
    """A corner shower: tray, glass screens and door; walls at its back (+Y) and left (-X)."""
    half, height = width / 2, draw.between(1.9, 2.0)
    b = Builder("shower", "shower", "corner", front_clearance=0.6)
    rings = [
        superellipse(half, half, 0.0, 30, 64),
        superellipse(half, half, 0.045, 30, 64),
        superellipse(half - 0.004, half - 0.004, 0.05, 28, 64),
        superellipse(half - 0.05, half - 0.05, 0.05, 16, 64),
        superellipse(half - 0.07, half - 0.07, 0.032, 14, 64),
    ]
    b.add(CERAMIC, loft(np.stack(rings)), name="tray")
    b.add(CHROME, cylinder(0.055, 0.0325, 0.036, 28).moved(-0.1, 0.1), name="drain")
    pane = 0.008
    edge = half - 0.025
    b.add(
        GLASS, span((edge - pane, -edge + 0.01, 0.052), (edge, half - 0.012, height)), name="screen"
    )
    split = -0.02
    b.add(GLASS, span((split, -edge, 0.052), (edge - 0.012, -edge + pane, height)), name="screen")
    ajar = draw.between(10, 50) if draw.chance(0.5) else 0.0
    length = half + split - 0.03
    door = span((0.004, -pane / 2, 0.058), (length, pane / 2, height - 0.004)).turned("z", -ajar)
    hinge = (-half + 0.024, -edge + pane / 2)
    b.add(GLASS, door.moved(*hinge), name="door")
    for side in (-1.0, 1.0):
        knob = cylinder(0.014, 0.002, 0.03, 16, bevel=0.003).turned("x", 90.0 * side)
        b.add(
            CHROME, knob.moved(length - 0.06, 0, 1.05).turned("z", -ajar).moved(*hinge), name="knob"
        )
    profile = span((edge - 0.02, half - 0.02, 0.05), (edge + 0.012, half, height + 0.002))
    b.add(style.metal, profile, name="profile")
    profile = span((-half, -edge - 0.01, 0.05), (-half + 0.022, -edge + 0.02, height + 0.002))
    b.add(style.metal, profile, name="profile")
    b.add(
        style.metal,
        bar(
            (edge - 0.004, -edge + 0.004, height - 0.02),
            (edge - 0.004, half - 0.005, height - 0.02),
            0.009,
            8,
        ),
        name="profile",
    )
    x, y = -0.05, half - 0.055
    b.add(CHROME, bar((x, y, 0.98), (x, y, 2.06), 0.011, 12), name="riser")
    b.add(
        CHROME,
        tube(
            [(x, y, 2.04), (x, y - 0.03, 2.085), (x, y - 0.08, 2.09), (x, y - 0.32, 2.09)], 0.01, 10
        ),
        name="riser",
    )
    head = lathe([(0.105, 0.0), (0.11, 0.006), (0.03, 0.018), (0.018, 0.05), (0, 0.05)], 36)
    head = head.moved(x, y - 0.31, 2.035)
    b.add(CHROME, head, name="head")
    for z in (1.05, 1.95):
        b.add(CHROME, bar((x, half - 0.001, z), (x, y, z), 0.01, 10), name="riser")
    mixer = cylinder(0.022, -0.14, 0.14, 20, bevel=0.004).turned("y", 90).moved(x, y, 1.0)
    b.add(CHROME, mixer, name="mixer")
    t = np.linspace(0, 1, 18)
    hose = np.stack(
        [
            x + 0.12 - 0.03 * t - 0.04 * np.sin(np.pi * t),
            y - 0.02 - 0.0 * t,
            0.99 + 0.6 * t - 0.6 * np.sin(np.pi * t) * (1 - t),
        ],
        1,
    )
    b.add(STEEL, tube(hose, 0.006, 8), name="hose")
    b.add(
        CHROME,
        tube(
            [(x + 0.09, y - 0.02, 1.58), (x + 0.09, y - 0.05, 1.7), (x + 0.09, y - 0.09, 1.73)],
            [0.012, 0.013, 0.035],
            14,
        ),
        name="hand shower",
    )
    b.add(CHROME, bar((x, y, 1.6), (x + 0.09, y - 0.02, 1.6), 0.01, 8), name="riser")
    if width > 0.85:  # a board in the corner of the walls
        low = (0.002 - half, half - 0.182, 1.1)
        b.add(GLASS, span(low, (0.182 - half, half - 0.002, 1.106)), name="board")
        b.surface(0.092 - half, half - 0.092, 1.106, 0.085, 0.085, 0.4)
    return b.piece()


_IN_CABINET = (
    *("aftershave", "eye drops", "ointment", "antiseptic", "nasal spray", "sleeping pills"),
    *("cold cream", "mouth spray", "tweezers tube", "contact lens fluid"),
)


def mirror_cabinet(draw: Draw, style: Style, width: float | None = None) -> FurniturePiece:
    """A cabinet with mirror doors, sometimes one ajar; the origin is on its lower back edge."""
    width = draw.between(0.55, 0.8) if width is None else width
    depth, height = 0.15, 0.65
    b = Builder("mirror cabinet", "mirror", "on_wall", mount_height=1.2)
    parts = Builder("", "", "free")
    parts.add(WHITE_PAINT, *carcass(width, depth, 0, height))
    for z in (0.22, 0.44):
        parts.add(
            GLASS,
            span(
                (-width / 2 + 0.019, -depth / 2 + 0.03, z),
                (width / 2 - 0.019, depth / 2 - 0.013, z + 0.006),
            ),
            name="shelf",
        )
    angle = draw.between(12, 50) if draw.chance(0.35) else 0.0
    each = width / 2 - 0.002
    leaf = [
        (WHITE_PAINT, span((0, -0.012, 0), (each, 0, height))),
        (MIRROR, span((0.001, -0.0165, 0.001), (each - 0.001, -0.012, height - 0.001))),
    ]
    for material, mesh in leaf:
        parts.add(
            material, mesh.turned("z", -angle).moved(-width / 2, -depth / 2 + 0.019), name="door"
        )
        parts.add(material, mesh.moved(-each).moved(width / 2, -depth / 2 + 0.019), name="door")
    if angle:
        outline = [(0.022, 0), (0.022, 0.1), (0.01, 0.12), (0.01, 0.14), (0, 0.14)]
        for k, which in enumerate(draw.permutation(len(_IN_CABINET))[:5].tolist()):
            x, z = ((0.07, 0.018), (0.15, 0.2265), (0.23, 0.4465), (0.07, 0.2265), (0.14, 0.018))[k]
            with parts.holding(_IN_CABINET[which], "fitting"):
                bottle = lathe(outline, 16).scaled(z=draw.between(0.7, 1.2))
                parts.add(style.accents[k], bottle.moved(x - width / 2, 0.0, z), name="bottle")
    b.add_from(parts, y=-depth / 2)
    return b.piece()


def towel_rail(draw: Draw, style: Style) -> FurniturePiece:
    """A heated towel rail with one or two towels; the origin is on its lower back edge."""
    width, height = draw.between(0.45, 0.55), draw.between(0.8, 1.2)
    b = Builder("towel rail", "towel rail", "on_wall", mount_height=0.55)
    metal = CHROME if draw.chance(0.6) else WHITE_PAINT
    y = -0.07
    for side in (-1, 1):
        b.add(metal, bar((side * width / 2, y, 0), (side * width / 2, y, height), 0.015, 12))
        for z in (0.08, height - 0.08):
            b.add(metal, bar((side * width / 2, 0, z), (side * width / 2, y, z), 0.009, 10))
    rungs = []
    for k in range(int(height / 0.055)):
        if k % 6 != 5:
            z = 0.04 + 0.055 * k
            rungs.append(z)
            b.add(metal, bar((-width / 2, y - 0.008, z), (width / 2, y - 0.008, z), 0.01, 10))
    wide, rows = draw.between(0.28, 0.34), [rungs[-2]]
    if draw.chance(0.5):
        rows.append(rungs[len(rungs) // 3])
    fronts = draw.uniform((0.36, 0.16), (0.5, 0.22))
    if len(rows) == 2:  # the upper one ends above the lower one
        fronts[0] = min(float(fronts[0]), rows[0] - rows[1] - 0.09)
    for z, front, back in zip(rows, fronts, (0.2, 0.12), strict=False):
        towel = hung(hanging(draw), wide, float(front), back, 0.018, 0.06)
        x = draw.between(-0.02, 0.02)
        with b.holding("towel", "towel"):
            b.add(style.towel, towel.moved(x, y - 0.008, z), name="towel")
    return b.piece()


def washing_machine(draw: Draw, style: Style) -> FurniturePiece:
    """A front-loading washing machine."""
    width, depth, height = 0.6, draw.between(0.54, 0.6), draw.between(0.845, 0.855)
    b = Builder("washing machine", "washing machine", "wall", front_clearance=0.7)
    f = -depth / 2
    case = span((-width / 2, f + 0.01, 0.02), (width / 2, depth / 2, height), 0.008)
    b.add(WHITE_PAINT, case, name="case")
    foot = span((-width / 2 + 0.03, f + 0.04, 0), (width / 2 - 0.03, depth / 2 - 0.03, 0.021))
    b.add(BLACK_PLASTIC, foot, name="foot")
    rim = [
        (0.185, -0.002), (0.185, 0.02), (0.17, 0.034), (0.145, 0.036), (0.14, 0.02), (0.14, 0.004),
    ]  # fmt: skip
    at = (0.0, f + 0.01, 0.43)
    door = lathe(rim, 48).turned("x", 90).moved(*at)
    b.add(STEEL if draw.chance(0.6) else BLACK_PLASTIC, door, name="door")
    lens = [(0.139, 0.006), (0.125, 0.02), (0.07, 0.008), (0.0, 0.006)]
    window = lathe(lens, 40).turned("x", 90).moved(*at)
    b.add(Material("plastic", hex_color("#15171a"), 0.06), window, name="window")
    b.add(IRON, box((0.03, 0.03, 0.07), (0.162, f - 0.02, 0.395), 0.006), name="handle")
    b.add(
        WHITE_PLASTIC,
        span(
            (-width / 2 + 0.01, f + 0.002, height - 0.125),
            (width / 2 - 0.01, f + 0.02, height - 0.012),
            0.004,
        ),
        name="panel",
    )
    b.add(
        BLACK_PLASTIC,
        span((0.1, f, height - 0.1), (0.26, f + 0.004, height - 0.045)),
        name="display",
    )
    dial = lathe([(0.036, 0), (0.034, 0.02), (0.028, 0.024), (0, 0.024)], 28).turned("x", 90)
    dial = dial.moved(0, f + 0.003, height - 0.07)
    b.add(STEEL, dial, name="dial")
    drawer = span((-0.27, f, height - 0.11), (-0.08, f + 0.004, height - 0.03), 0.001)
    b.add(WHITE_PLASTIC, drawer, name="drawer")
    b.surface(0, 0, height, width / 2 - 0.05, depth / 2 - 0.05)
    return b.piece()


def toiletries(draw: Draw, style: Style) -> FurniturePiece:
    """A soap dispenser, a beaker with toothbrushes and a tube."""
    b = Builder("toiletries", "toiletries", "on_top")
    glaze = draw.pick(style.accents)
    dispenser = lathe([(0.03, 0), (0.032, 0.005), (0.032, 0.11), (0.012, 0.125), (0, 0.125)], 24)
    dispenser = dispenser.moved(-0.045)
    b.add(glaze, dispenser, name="dispenser")
    b.add(
        CHROME,
        bar((-0.045, 0, 0.12), (-0.045, 0, 0.158), 0.004, 8),
        tube([(-0.045, 0.004, 0.156), (-0.045, -0.02, 0.158), (-0.045, -0.036, 0.15)], 0.005, 8),
        name="dispenser",
    )
    cup = [(0.03, 0), (0.034, 0.09), (0.0315, 0.09), (0.0275, 0.006), (0, 0.006)]
    with b.holding("beaker", "fitting"):
        b.add(CERAMIC, lathe(cup, 24).moved(0.04), name="beaker")
        for k in range(2):
            lean = -0.02 + 0.04 * k
            tint = style.accents[k]
            brush = Material("plastic", tint.color, 0.4)
            top = (0.04 + 1.3 * lean, 0.012, 0.185)
            b.add(brush, bar((0.04 - 0.5 * lean, -0.01, 0.008), top, 0.003, 8), name="toothbrush")
            b.add(
                WHITE_PLASTIC, box((0.009, 0.012, 0.024), (top[0], 0.005, 0.164)), name="toothbrush"
            )
    return b.piece()
