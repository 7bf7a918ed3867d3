"""Curtains, rugs and cushions."""

from __future__ import annotations

import numpy as np

from scenes.procedural.furniture.build import Builder
from scenes.procedural.furniture.cloth import stuffed
from scenes.procedural.furniture.geometry import (
    bar,
    box,
    cylinder,
    grid,
    loft,
    rounded_box,
    sphere,
    superellipse,
    thick_sheet,
    tube,
)
from scenes.procedural.furniture.style import Style
from scenes.procedural.piece import FurniturePiece


def curtains(
    rng: np.random.Generator, style: Style, width: float = 1.4, height: float = 2.3
) -> FurniturePiece:
    """A pair of open pleated curtains on a rod.

    `width` of the window and `height` of the rod above the floor, metres. The origin is on the
    floor below the centre of the window (`mount_height` 0); the hem is 1.5 cm above the floor.
    """
    b = Builder("curtains", "curtain", "on_wall")
    off = 0.1  # metres from the wall to the rod
    bunch = min(max(0.25 * width, 0.26), 0.6) * float(rng.uniform(0.85, 1.25))
    half_span = width / 2 + float(rng.uniform(0.14, 0.24))
    hem, top = 0.015, height - 0.035
    for side in (-1.0, 1.0):
        count, rows = 90, 14
        s = np.linspace(0, 1, count)
        t = np.linspace(0, 1, rows)
        pleats = float(round(bunch / rng.uniform(0.045, 0.06)))
        phase = np.cumsum(rng.uniform(0.6, 1.4, count))
        phase = 2 * np.pi * pleats * (phase - phase[0]) / (phase[-1] - phase[0])
        depth = 0.036 * (0.75 + 0.35 * np.sin(3.1 * s + rng.uniform(0, 6)))
        drift = rng.uniform(-0.5, 0.5, 3)
        spread = bunch * (1 + 0.18 * t**1.5)  # wider at the hem than at the rod
        swing = 1 - 0.25 * np.exp(-(((t - 0.02) / 0.08) ** 2))
        wave = phase[None, :] + 0.5 * t[:, None] * np.sin(2 * np.pi * s * 1.5 + drift[0])
        x = s[None, :] * spread[:, None] + 0.01 * np.sin(2 * wave) * t[:, None]
        y = -off + depth[None, :] * swing[:, None] * np.sin(wave) * (1 + 0.25 * t[:, None])
        z = top + (hem - top) * t
        outer = side * (half_span - x)
        points = np.stack(
            [outer, np.broadcast_to(y, x.shape), np.broadcast_to(z[:, None], x.shape)], axis=-1
        )
        with b.holding("curtain", "curtain"):
            b.add(style.curtain, grid(points[:, ::-1] if side < 0 else points), name="curtain")
        for k in range(int(pleats)):
            at = float(np.interp(2 * np.pi * (k + 0.5), phase, s)) * bunch
            turn = 2 * np.pi * np.arange(14) / 14
            ring = np.stack([0 * turn, 0.017 * np.cos(turn), 0.017 * np.sin(turn) - 0.006], axis=1)
            loop = tube(ring, 0.0022, 8, closed=True)
            b.add(style.metal, loop.moved(side * (half_span - at), -off, height), name="ring")
    end = half_span + 0.07
    b.add(style.metal, bar((-end, -off, height), (end, -off, height), 0.0105, 12), name="rod")
    for side in (-1, 1):
        b.add(style.metal, sphere(0.022, 14, 8).moved(side * end, -off, height), name="rod")
        x = side * (half_span + 0.025)
        b.add(style.metal, bar((x, -0.003, height), (x, -off, height), 0.007, 8), name="bracket")
        b.add(
            style.metal,
            cylinder(0.02, 0, 0.006, 16).turned("x", 90).moved(x, 0, height),
            name="bracket",
        )
    return b.piece()


def rug(
    rng: np.random.Generator, style: Style, width: float | None = None, depth: float | None = None
) -> FurniturePiece:
    """A rug with a border and fringes at its short ends, or a round one."""
    width = float(rng.uniform(1.6, 2.4)) if width is None else width
    depth = float(rng.uniform(1.1, 1.7)) if depth is None else depth
    b = Builder("rug", "rug", "centre")
    thickness = float(rng.uniform(0.008, 0.014))
    if abs(width - depth) < 0.05 * width and rng.random() < 0.6:
        rings = [
            superellipse(width / 2 - inset, width / 2 - inset, z, 2.0, 64)
            for z, inset in ((0.0, 0.0), (0.7 * thickness, 0.0), (thickness, 0.006))
        ]
        b.add(style.rug, loft(np.stack(rings)))
        return b.piece()
    n, m = 25, 17
    x, y = np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1, 1, m), indexing="ij")
    lie = 0.0015 * np.sin(4 * x + rng.uniform(0, 6)) * np.sin(3 * y + rng.uniform(0, 6))
    points = np.stack([x * width / 2, y * depth / 2, thickness + lie], axis=-1)
    mesh = thick_sheet(points, thickness - 0.002)
    mesh.vertices[:, 2] -= mesh.vertices[:, 2].min()
    b.add(style.rug, mesh)
    if rng.random() < 0.6:
        spacing = 0.03
        for side in (-1, 1):
            for v in np.arange(-depth / 2 + 0.015, depth / 2, spacing):
                length = float(rng.uniform(0.04, 0.055))
                start = side * (width / 2 - 0.003)
                b.add(
                    style.rug,
                    box(
                        (length, 0.009, 0.003),
                        (
                            start + side * length / 2,
                            float(v) + float(rng.uniform(-0.004, 0.004)),
                            0.0015,
                        ),
                    ),
                    name="fringe",
                )
    return b.piece()


def cushion(rng: np.random.Generator, style: Style) -> FurniturePiece:
    """A loose cushion."""
    size = float(rng.uniform(0.38, 0.5))
    b = Builder("cushion", "cushion", "on_top")
    fabric = style.cushions[int(rng.integers(len(style.cushions)))]
    b.add(fabric, stuffed((size, size * rng.uniform(0.75, 1.0), 0.15), int(rng.integers(5))))
    return b.piece()


def folded_blanket(rng: np.random.Generator, style: Style) -> FurniturePiece:
    """A blanket folded into a stack of layers."""
    b = Builder("folded blanket", "textile", "on_top")
    width, depth = float(rng.uniform(0.32, 0.42)), float(rng.uniform(0.26, 0.34))
    z = 0.0
    for _ in range(int(rng.integers(3, 5))):
        b.add(
            style.throw,
            rounded_box(
                (width * rng.uniform(0.96, 1.0), depth * rng.uniform(0.96, 1.0), 0.032),
                (float(rng.uniform(-0.006, 0.006)), float(rng.uniform(-0.006, 0.006)), z),
                0.0155,
                (0, 0, 0.001),
            ),
        )
        z += 0.031
    low = min(float(part.vertices[:, 2].min()) for part in b.piece().parts)
    lifted = Builder("folded blanket", "textile", "on_top")
    lifted.add_from(b, z=-low)
    return lifted.piece()
