"""Tables and desks."""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.procedural.furniture.build import Builder
from pbrnet.scenes.procedural.furniture.cabinets import (
    BOARD,
    add_drawer,
    carcass,
    feet,
    left_open,
    leg_material,
)
from pbrnet.scenes.procedural.furniture.cloth import block, plane
from pbrnet.scenes.procedural.furniture.drapes import dropped
from pbrnet.scenes.procedural.furniture.geometry import (
    box,
    cylinder,
    lathe,
    loft,
    post,
    span,
    superellipse,
)
from pbrnet.scenes.procedural.furniture.style import GLASS, Style
from pbrnet.scenes.procedural.piece import FurniturePiece, Material


def dining_table(
    rng: np.random.Generator, style: Style, width: float | None = None, depth: float | None = None
) -> FurniturePiece:
    """A rectangular table; `width` along x."""
    width = float(rng.uniform(1.2, 2.0)) if width is None else width
    depth = float(rng.uniform(0.78, 0.95)) if depth is None else depth
    height = rng.uniform(0.73, 0.77)
    b = Builder("dining table", "table", "centre", front_clearance=0.6, side_clearance=0.6)
    wood = style.wood
    top = rng.uniform(0.024, 0.04)
    planks = 5
    for k in range(planks):  # separate planks show fine joints
        each = depth / planks
        b.add(
            wood,
            box((width, each, top), (0, (k - (planks - 1) / 2) * each, height - top), 0.0015, "x"),
            name="top",
        )
    thickness = rng.uniform(0.055, 0.08)
    under = height - top
    b.add(
        leg_material(style, wood),
        *feet(style, width, depth, under + 0.002, thickness, 0.03, splay=0.015),
    )
    apron = 0.08
    x, y = width / 2 - 0.03 - thickness / 2, depth / 2 - 0.03 - thickness / 2
    for side in (-1, 1):
        b.add(
            wood,
            box((2 * x, 0.02, apron), (0, side * y, under - apron + 0.001)),
            box((0.02, 2 * y - 0.02, apron - 0.002), (side * x, 0, under - apron + 0.002)),
        )
    if rng.random() < 0.2:
        hang, thin = float(rng.uniform(0.12, 0.21)), 0.003
        # Down to below the hem, so that the cloth does not swing in under the top.
        low, high = (-width / 2, -depth / 2, height - 0.4), (width / 2, depth / 2, height)
        top_box = block(low, high, 0.008, thin + 0.001)
        size = (width + 2 * hang, depth + 2 * hang)
        cloth = dropped(
            rng,
            [top_box, plane(2, height + thin + 0.0012, -1.0)],
            size,
            (0, 0, height + 0.01),
            turn=float(rng.normal(0, 0.6)),
            tight=0.0,
            rumple=0.1,
            thickness=thin,
            step=0.045,
        )
        b.add(_table_linen(rng, style), cloth, name="cloth")
        height = height + thin + 0.002
    b.surface(0, 0, height, width / 2 - 0.05, depth / 2 - 0.05)
    return b.piece()


def _table_linen(rng: np.random.Generator, style: Style) -> Material:
    """White or coloured linen, plain or checked."""
    color = (0.72, 0.71, 0.68) if rng.random() < 0.5 else style.cushions[2].color
    family = ("linen", "plain", "checked")[int(rng.integers(3))]
    return Material("fabric", color, 0.9, variant=int(rng.integers(1 << 20)), family=family)


def round_table(
    rng: np.random.Generator, style: Style, width: float | None = None
) -> FurniturePiece:
    """A round table on one turned column; `width` is its diameter."""
    radius = (float(rng.uniform(0.9, 1.25)) if width is None else width) / 2
    height = rng.uniform(0.73, 0.77)
    b = Builder("round table", "table", "centre", front_clearance=0.6, side_clearance=0.6)
    wood = style.wood if rng.random() < 0.7 else style.dark_wood
    b.add(wood, cylinder(radius, height - 0.03, height, 48, bevel=0.006), name="top")
    b.add(wood, cylinder(0.35 * radius, height - 0.05, height - 0.028, 32))
    if style.shape(rng, "round_table", ("tulip", "column")) == "tulip":
        profile = [(0.5 * radius, 0.0), (0.5 * radius, 0.01), (0.3 * radius, 0.03)]
        profile += [(0.08, 0.12), (0.045, 0.3), (0.045, 0.5), (0.08, height - 0.08)]
        profile += [(0.14, height - 0.049)]
        b.add(style.lacquer if rng.random() < 0.5 else wood, lathe(profile, 36))
    else:
        b.add(
            wood,
            lathe(
                [
                    (0.06, 0.1),
                    (0.07, 0.2),
                    (0.045, 0.28),
                    (0.06, 0.4),
                    (0.06, 0.5),
                    (0.045, 0.55),
                    (0.075, height - 0.05),
                ],
                24,
            ),
        )
        for k in range(4):
            extent = 0.62 * radius
            foot = [(extent, 0, 0.0), (extent - 0.02, 0, 0.045), (0.06, 0, 0.2)]
            arm = post(foot, [(0.06, 0.045), (0.05, 0.04), (0.03, 0.04)])
            b.add(wood, arm.turned("z", 45 + 90 * k))
    b.surface(0, 0, height, 0.62 * radius, 0.62 * radius)
    return b.piece()


def coffee_table(
    rng: np.random.Generator, style: Style, width: float | None = None
) -> FurniturePiece:
    """A low table with a shelf, with a round or glass top, or a drum."""
    width = float(rng.uniform(0.8, 1.2)) if width is None else width
    depth, height = rng.uniform(0.5, 0.62), rng.uniform(0.36, 0.45)
    b = Builder("coffee table", "table", "centre", front_clearance=0.3)
    wood = style.wood if rng.random() < 0.7 else style.dark_wood
    kind = style.shape(rng, "coffee_table", ("shelf", "oval", "glass", "drum"))
    if kind == "drum":
        radius = min(0.5 * width, 0.5 * depth + 0.08)
        body = wood if rng.random() < 0.6 else style.lacquer
        b.add(body, cylinder(0.92 * radius, 0, 0.03, 48))
        b.add(body, cylinder(radius, 0.03, height - 0.022, 48, bevel=0.006), name="drum")
        b.add(wood, cylinder(radius + 0.006, height - 0.022, height, 48, bevel=0.004), name="top")
        b.surface(0, 0, height, 0.66 * radius, 0.66 * radius)
        return b.piece()
    if kind == "oval":
        rings = [
            superellipse(width / 2 - inset, depth / 2 - inset, z, 2.4, 48)
            for z, inset in (
                (height - 0.03, 0.008),
                (height - 0.022, 0.0),
                (height - 0.006, 0.0),
                (height, 0.006),
            )
        ]
        b.add(wood, loft(np.stack(rings)), name="top")
        b.add(
            leg_material(style, wood),
            *feet(style, 0.78 * width, 0.78 * depth, height - 0.028, 0.045, 0, splay=0.04),
        )
        b.surface(0, 0, height, 0.36 * width, 0.34 * depth)
        return b.piece()
    b.add(leg_material(style, wood), *feet(style, width, depth, height - 0.01, 0.045, 0.0))
    if kind == "glass":
        b.add(GLASS, box((width - 0.01, depth - 0.01, 0.01), (0, 0, height - 0.01)), name="top")
        for side in (-1, 1):
            b.add(
                wood,
                box((width - 0.09, 0.03, 0.045), (0, side * (depth / 2 - 0.0225), height - 0.056)),
                box((0.03, depth - 0.09, 0.045), (side * (width / 2 - 0.0225), 0, height - 0.0565)),
            )
    else:
        b.add(
            wood, box((width + 0.02, depth + 0.02, 0.028), (0, 0, height - 0.02), 0.003), name="top"
        )
        height += 0.008
    shelf_z = 0.14
    b.add(wood, box((width - 0.05, depth - 0.05, 0.018), (0, 0, shelf_z - 0.018)))
    b.surface(0, 0, height, width / 2 - 0.04, depth / 2 - 0.04)
    b.surface(0, 0, shelf_z, width / 2 - 0.08, depth / 2 - 0.08, height - shelf_z - 0.08)
    return b.piece()


def side_table(rng: np.random.Generator, style: Style) -> FurniturePiece:
    """A small round table for beside a seat."""
    radius, height = rng.uniform(0.2, 0.27), rng.uniform(0.46, 0.58)
    b = Builder("side table", "table", "free")
    wood = style.wood
    if rng.random() < 0.5:
        b.add(wood, cylinder(radius, height - 0.02, height, 36, bevel=0.004), name="top")
        frame = leg_material(style, wood)
        size = 0.018 if frame.kind == "metal" else 0.03
        for k in range(3):
            a = np.radians(90 + 120 * k)
            c, s = float(np.cos(a)), float(np.sin(a))
            points = [
                (0.95 * radius * c, 0.95 * radius * s, 0),
                (0.55 * radius * c, 0.55 * radius * s, height - 0.018),
            ]
            b.add(frame, post(points, [(0.7 * size, 0.7 * size), (size, size)]))
    else:  # a tray on one stem
        tray = [
            (radius - 0.002, height - 0.012),
            (radius, height + 0.017),
            (radius - 0.003, height + 0.017),
            (radius - 0.006, height),
        ]
        b.add(style.metal, lathe(tray, 36), name="top")
        b.add(style.metal, cylinder(0.014, 0.008, height - 0.011, 16))
        b.add(style.metal, cylinder(0.75 * radius, 0, 0.012, 36, bevel=0.003))
    b.surface(0, 0, height, 0.6 * radius, 0.6 * radius)
    return b.piece()


def desk(rng: np.random.Generator, style: Style, width: float | None = None) -> FurniturePiece:
    """A desk with a pedestal of drawers, sometimes one pulled out; the seat is in front (-Y)."""
    width = float(rng.uniform(1.15, 1.6)) if width is None else width
    depth, height = rng.uniform(0.6, 0.72), rng.uniform(0.72, 0.76)
    b = Builder("desk", "desk", "wall", front_clearance=0.75)
    wood, top = style.wood, 0.028
    b.add(wood, box((width, depth, top), (0, 0, height - top), 0.002), name="top")
    under = height - top
    pedestal, side = 0.4, float(rng.choice([-1.0, 1.0]))
    inner = depth - 0.06
    x = side * (width / 2 - pedestal / 2 - 0.02)
    parts = Builder("", "", "free")
    parts.add(style.cabinet, *carcass(pedestal, inner, 0.04, under - 0.001))
    parts.add(style.dark_wood, box((pedestal - 0.04, inner - 0.08, 0.041), (0, 0.01, 0)))
    heights = np.linspace(0.04, under - 0.004, 4)
    pulled = left_open(rng, style, 4)
    for k in range(3):
        add_drawer(
            parts,
            style,
            style.cabinet,
            style.wood,
            -pedestal / 2,
            pedestal / 2,
            float(heights[k]),
            float(heights[k + 1]),
            inner,
            float(rng.uniform(0.06, 0.18)) if k == pulled else 0.0,
        )
    b.add_from(parts, x=x)
    frame = leg_material(style, wood)
    size = 0.05
    for sy in (-1, 1):
        at = (-side * (width / 2 - 0.05), sy * (depth / 2 - 0.06))
        b.add(frame, post([(*at, 0), (*at, under + 0.001)], [(size, size)] * 2))
    # Modesty panel between the pedestal and the legs.
    low, high = sorted((-side * (width / 2 - 0.07), x - side * pedestal / 2))
    b.add(
        wood,
        span(
            (low, depth / 2 - 0.09, under - 0.3), (high, depth / 2 - 0.09 + BOARD, under + 0.0005)
        ),
    )
    b.surface(0, 0.02, height, width / 2 - 0.06, depth / 2 - 0.08)
    return b.piece()


def console_table(
    rng: np.random.Generator, style: Style, width: float | None = None
) -> FurniturePiece:
    """A narrow table for the hall, with a lower shelf."""
    width = float(rng.uniform(0.8, 1.2)) if width is None else width
    depth, height = rng.uniform(0.3, 0.36), rng.uniform(0.76, 0.84)
    b = Builder("console table", "table", "wall", front_clearance=0.5)
    wood = style.wood
    b.add(wood, box((width, depth, 0.026), (0, 0, height - 0.026), 0.002), name="top")
    b.add(leg_material(style, wood), *feet(style, width, depth, height - 0.024, 0.035, 0.015))
    b.add(wood, box((width - 0.06, depth - 0.05, 0.018), (0, 0, 0.16)))
    for side in (-1, 1):
        b.add(
            wood, box((width - 0.1, 0.016, 0.06), (0, side * (depth / 2 - 0.033), height - 0.085))
        )
    b.surface(0, 0, height, width / 2 - 0.05, depth / 2 - 0.04)
    b.surface(0, 0, 0.178, width / 2 - 0.08, depth / 2 - 0.06, height - 0.28)
    return b.piece()
