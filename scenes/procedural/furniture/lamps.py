"""Lamps; the visible shade, globe, panel or diffuser emits, not a bulb inside it."""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.procedural.furniture.build import Builder
from pbrnet.scenes.procedural.furniture.geometry import (
    bar,
    box,
    cylinder,
    lathe,
    loft,
    rounded_box,
    sphere,
    superellipse,
    tube,
)
from pbrnet.scenes.procedural.furniture.style import CHROME, WHITE_PAINT, Style
from pbrnet.scenes.procedural.piece import FurniturePiece, Material
from pbrnet.scenes.seeds import Draw

OPAL = Material("plastic", (0.86, 0.85, 0.82), 0.4)
_DOWNWARDS = 0.5  # share of a shaded lamp's light that leaves by its diffuser


def _shade_profile(
    low: float, high: float, z0: float, z1: float, wall: float = 0.003
) -> list[tuple[float, float]]:
    """Closed profile (radius, z) of an open lampshade of thickness `wall`."""
    t = np.linspace(0, 1, 4)
    outer = [(float(low + (high - low) * s), float(z0 + (z1 - z0) * s)) for s in t]
    inner = [(r - wall, z) for r, z in outer[::-1]]
    return [*outer, *inner]


def _profile_rings(profile: list[tuple[float, float]], segments: int) -> Float64Array:
    """Rings for `loft` of a closed profile: a body of revolution with a hole."""
    closed = np.array([*profile, profile[0]])
    angle = 2 * np.pi * np.arange(segments) / segments
    rings = np.zeros((len(closed), segments, 3))
    rings[..., :2] = closed[:, None, :1] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    rings[..., 2] = closed[:, 1:]
    return rings


def _add_shade(
    b: Builder,
    style: Style,
    low: float,
    high: float,
    z0: float,
    z1: float,
    lumens: float,
    y: float = 0.0,
    x: float = 0.0,
) -> None:
    """Add an emitting shade, open at the top, a brighter diffuser below, and the wires."""
    shade = loft(_profile_rings(_shade_profile(low, high, z0, z1), 36), closed=False)
    glow = (1 - _DOWNWARDS) * lumens
    b.add(style.shade, shade.moved(x, y), name="shade", lumens=glow, kelvin=style.kelvin)
    diffuser = cylinder(low - 0.006, z0 + 0.012, z0 + 0.019, 36).moved(x, y)
    b.add(OPAL, diffuser, name="diffuser", lumens=_DOWNWARDS * lumens, kelvin=style.kelvin)
    z = z1 - 0.02
    for k in range(3):
        turn = np.radians(120 * k)
        radius = high - 0.004
        mesh = bar((x, y, z), (x + radius * np.cos(turn), y + radius * np.sin(turn), z), 0.002, 8)
        b.add(style.metal, mesh)


def pendant_lamp(draw: Draw, style: Style, drop: float | None = None) -> FurniturePiece:
    """A lamp hanging from the ceiling: drum, dome, globe or paper lantern.

    `drop` metres to its lowest point.
    """
    drop = draw.between(0.7, 1.0) if drop is None else drop
    b = Builder("pendant lamp", "lamp", "ceiling")
    kind = style.shape(draw, "pendant", ("drum", "dome", "globe", "lantern"))
    lumens = draw.between(900, 1600)
    b.add(style.metal, lathe([(0.05, -0.025), (0.055, -0.012), (0.055, 0.0)], 24), name="rose")
    if kind == "drum":
        radius, height = draw.between(0.17, 0.25), draw.between(0.17, 0.24)
        _add_shade(
            b, style, radius, radius * draw.between(0.75, 1.0), -drop, -drop + height, lumens
        )
        top = -drop + height - 0.021
        b.add(OPAL, cylinder(0.022, top - 0.07, top - 0.01, 16), name="socket")
        b.add(OPAL, sphere(0.042, 16, 10).moved(z=top - 0.105), name="bulb")
    elif kind == "dome":
        radius, height = draw.between(0.16, 0.24), draw.between(0.16, 0.22)
        t = np.linspace(0, np.pi / 2, 9)
        outer = [
            (radius * float(np.cos(a)) + 0.02 * float(np.sin(a)), -drop + height * float(np.sin(a)))
            for a in t
        ]
        inner = [(max(r - 0.004, 0.003), z - 0.004 * (z > -drop)) for r, z in outer[::-1]]
        inner[0] = (0.016, inner[0][1])
        b.add(
            style.metal
            if style.shape(draw, "dome", ("metal", "painted")) == "metal"
            else style.accents[0],
            loft(_profile_rings([*outer, *inner], 36), closed=False),
            name="reflector",
        )
        cap = cylinder(0.024, -drop + height - 0.012, -drop + height + 0.03, 16)
        b.add(style.metal, cap, name="cap")
        body = [
            (0.0, -drop + 0.001), (0.6 * radius, -drop + 0.004), (radius - 0.006, -drop + 0.012),
            (radius - 0.012, -drop + 0.016),
        ]  # fmt: skip
        b.add(OPAL, lathe(body, 36), name="diffuser", lumens=0.8 * lumens, kelvin=style.kelvin)
        top = -drop + height + 0.028
    elif kind == "lantern":  # paper over rings of wire
        radius, ribs = draw.between(0.17, 0.24), draw.whole(9, 14)
        flat = draw.between(0.6, 0.95)
        t = np.linspace(-0.94, 0.94, 4 * ribs + 1) * np.pi / 2
        wave = 1 - 0.022 * np.abs(np.sin(2 * ribs * (t / (0.94 * np.pi))))
        paper = [
            (radius * float(np.cos(a) * w), -drop + radius * flat * float(1 + np.sin(a)))
            for a, w in zip(t, wave, strict=True)
        ]
        b.add(style.shade, lathe(paper, 32), name="shade", lumens=lumens, kelvin=style.kelvin)
        top = -drop + radius * flat * (1 + float(np.sin(0.94 * np.pi / 2)))
        b.add(style.metal, cylinder(0.02, top - 0.004, top + 0.02, 16), name="cap")
        top += 0.018
    else:
        radius = draw.between(0.12, 0.17)
        globe = sphere(radius, 28, 16).moved(z=-drop + radius)
        b.add(OPAL, globe, name="globe", lumens=lumens, kelvin=style.kelvin)
        top = -drop + 2 * radius
        b.add(style.metal, cylinder(0.03, top - 0.008, top + 0.05, 20), name="cap")
        top += 0.048
    cord = bar((0, 0, top), (0, 0, -0.02), 0.003, 8)
    b.add(Material("plastic", (0.02, 0.02, 0.02), 0.6), cord, name="cord")
    return b.piece()


def ceiling_lamp(draw: Draw, style: Style) -> FurniturePiece:
    """A flat ceiling lamp: a round bowl or a square panel with a rim."""
    b = Builder("ceiling lamp", "lamp", "ceiling")
    lumens = draw.between(1200, 2400)
    if draw.chance(0.6):
        radius, depth = draw.between(0.15, 0.24), draw.between(0.07, 0.1)
        b.add(style.metal, cylinder(radius + 0.008, -0.03, 0.0, 40, bevel=0.004), name="rim")
        t = np.linspace(0, np.pi / 2, 8)
        bowl = [(radius * float(np.sin(a)), -0.03 - (depth - 0.03) * float(np.cos(a))) for a in t]
        diffuser = lathe([*bowl, (radius, -0.025)], 40)
        b.add(OPAL, diffuser, name="diffuser", lumens=lumens, kelvin=style.kelvin)
    else:
        half = draw.between(0.17, 0.3)
        b.add(WHITE_PAINT, box((2 * half, 2 * half, 0.045), (0, 0, -0.045), 0.004), name="rim")
        diffuser = box((2 * half - 0.03, 2 * half - 0.03, 0.012), (0, 0, -0.054), 0.003)
        b.add(OPAL, diffuser, name="diffuser", lumens=1.2 * lumens, kelvin=style.kelvin + 500)
    return b.piece()


def spot_rail(draw: Draw, style: Style) -> FurniturePiece:
    """A rail at the ceiling with three spotlights in random directions."""
    b = Builder("ceiling spots", "lamp", "ceiling")
    length = draw.between(0.6, 0.9)
    b.add(style.metal, box((length, 0.05, 0.022), (0, 0, -0.022), 0.003), name="rail")
    for k in range(3):
        x = (k - 1) * 0.38 * length
        b.add(style.metal, bar((x, 0, -0.02), (x, 0, -0.075), 0.006, 8))
        tilt, turn = draw.between(15, 45), draw.between(0, 360)
        can = lathe([(0.036, -0.075), (0.04, -0.07), (0.04, 0.01), (0.03, 0.03)], 24)
        diffuser = lathe([(0.0, -0.0785), (0.032, -0.0785), (0.032, -0.0745)], 24)
        b.add(style.metal, can.turned("x", tilt).turned("z", turn).moved(x, 0, -0.1), name="spot")
        b.add(
            OPAL,
            diffuser.turned("x", tilt).turned("z", turn).moved(x, 0, -0.1),
            name="diffuser",
            lumens=1350.0,
            kelvin=style.kelvin,
        )
    return b.piece()


def floor_lamp(draw: Draw, style: Style) -> FurniturePiece:
    """A floor lamp: straight, on a tripod, or arched."""
    b = Builder("floor lamp", "lamp", "corner")
    height = draw.between(1.45, 1.7)
    low, tall = draw.between(0.18, 0.24), draw.between(0.22, 0.3)
    high = low * draw.between(0.65, 1.0)
    lumens = draw.between(600, 1000)
    kind = style.shape(draw, "floor_lamp", ("straight", "tripod", "arch"))
    if kind == "arch":
        t = np.radians(np.linspace(0, 115, 18))
        path = np.stack(
            [0 * t, 0.3 - 0.53 * (1 - np.cos(t)), 0.025 + (height + 0.14) * np.sin(t)], axis=1
        )
        b.add(style.metal, tube(path, 0.011, 10))
        b.add(style.metal, cylinder(0.15, 0, 0.03, 36, bevel=0.004).moved(y=0.3), name="foot")
        end = path[-1]
        y, top = float(end[1]), float(end[2])
        b.add(style.metal, cylinder(0.02, top - 0.07, top + 0.01, 16).moved(y=y))
        _add_shade(b, style, low, high, top - tall, top, lumens, y=y)
        return b.piece()
    _add_shade(b, style, low, high, height - tall, height, lumens)
    stem_top = height - 0.018
    if kind == "straight":
        b.add(style.metal, cylinder(0.14, 0, 0.022, 36, bevel=0.004), name="foot")
        b.add(style.metal, bar((0, 0, 0.02), (0, 0, stem_top), 0.01, 12))
    else:
        joint = height - tall - 0.06
        for k in range(3):
            turn = np.radians(90 + 120 * k)
            rest = 0.012 * 0.265 / float(np.hypot(0.265, joint))  # the slanted end touches z = 0
            foot = (0.27 * float(np.cos(turn)), 0.27 * float(np.sin(turn)), rest)
            mesh = tube([foot, (0.02 * foot[0], 0.02 * foot[1], joint)], [0.012, 0.016], 10)
            b.add(style.wood, mesh)
        b.add(style.metal, cylinder(0.03, joint - 0.03, joint + 0.012, 20))
        b.add(style.metal, bar((0, 0, joint), (0, 0, stem_top), 0.007, 10))
    b.add(OPAL, sphere(0.035, 14, 8).moved(z=height - 0.4 * tall - 0.05), name="bulb")
    return b.piece()


def table_lamp(draw: Draw, style: Style) -> FurniturePiece:
    """A lamp with a turned ceramic or wooden body and a cloth shade."""
    b = Builder("table lamp", "lamp", "on_top")
    body, height = draw.between(0.2, 0.28), draw.between(0.15, 0.2)
    material = style.wood if draw.chance(0.4) else draw.pick(style.accents)
    width = draw.between(0.05, 0.085)
    power = draw.between(0.7, 1.6)
    t = np.linspace(0, 1, 11)
    radii = 0.016 + (width - 0.016) * np.sin(np.pi * t**power) ** 0.8
    profile = [(0.9 * width, 0.0), (0.9 * width, 0.012)]
    profile += [
        (float(r), 0.012 + float(s) * (body - 0.012)) for r, s in zip(radii, t, strict=True)
    ]
    b.add(material, lathe(profile, 28), name="body")
    low = draw.between(0.12, 0.16)
    z0 = body - 0.015
    _add_shade(
        b, style, low, low * draw.between(0.6, 0.95), z0, z0 + height, draw.between(350, 550)
    )
    b.add(style.metal, bar((0, 0, body - 0.004), (0, 0, z0 + height - 0.018), 0.005, 10))
    b.add(OPAL, sphere(0.028, 14, 8).moved(z=z0 + 0.5 * height), name="bulb")
    return b.piece()


def desk_lamp(draw: Draw, style: Style) -> FurniturePiece:
    """A jointed desk lamp with its diffuser pointing down."""
    b = Builder("desk lamp", "lamp", "on_top")
    metal = style.metal if draw.chance(0.5) else style.accents[0]
    b.add(metal, cylinder(0.085, 0, 0.018, 32, bevel=0.004), name="foot")
    joint = (0.0, 0.09, 0.3 + draw.between(0, 0.06))
    head = (0.0, -0.17, 0.42 + draw.between(-0.04, 0.04))
    base = (0.0, 0.0, 0.016)
    for side in (-0.008, 0.008):
        b.add(metal, bar((side, base[1], base[2]), (side, joint[1], joint[2]), 0.0045, 8))
        b.add(metal, bar((side, joint[1], joint[2]), (side, head[1], head[2]), 0.0045, 8))
    hinge = cylinder(0.014, -0.014, 0.014, 14, bevel=0.002).turned("y", 90)
    b.add(metal, hinge.moved(*joint), hinge.moved(*head), name="hinge")
    outer = [(0.07, -0.1), (0.062, -0.07), (0.034, -0.02), (0.024, 0.02)]
    inner = [(0.021, 0.017), (0.031, -0.02), (0.058, -0.07), (0.067, -0.1)]
    tilt = draw.between(8, 22)
    cone = loft(_profile_rings([*outer, *inner], 28), closed=False).turned("x", tilt).moved(*head)
    cap = cylinder(0.0235, 0.008, 0.021, 20).turned("x", tilt).moved(*head)
    diffuser = (
        lathe([(0.0, -0.093), (0.061, -0.09), (0.061, -0.084)], 28).turned("x", tilt).moved(*head)
    )
    b.add(metal, cone, cap, name="reflector")
    b.add(OPAL, diffuser, name="diffuser", lumens=draw.between(300, 450), kelvin=3200.0)
    return b.piece()


def wall_lamp(draw: Draw, style: Style) -> FurniturePiece:
    """A lamp on the wall: a globe on an arm, or a half-round shade."""
    b = Builder("wall lamp", "lamp", "on_wall", mount_height=draw.between(1.6, 1.8))
    lumens = draw.between(300, 500)
    b.add(style.metal, cylinder(0.05, 0, 0.018, 24, bevel=0.004).turned("x", 90), name="plate")
    if draw.chance(0.5):
        radius = draw.between(0.06, 0.085)
        y = -0.09 - radius * 0.4
        path = [(0, -0.01, 0), (0, 0.7 * y, -0.005), (0, y, 0.0), (0, y, 0.03)]
        b.add(style.metal, tube(path, 0.007, 10))
        b.add(style.metal, lathe([(0.02, 0.02), (0.035, 0.035), (0.03, 0.045)], 20).moved(y=y))
        globe = sphere(radius, 24, 14).moved(y=y, z=0.035 + radius)
        b.add(OPAL, globe, name="globe", lumens=lumens, kelvin=style.kelvin)
    else:
        rings = []
        for z, half in ((-0.1, 0.07), (-0.03, 0.085), (0.1, 0.1)):
            rings.append(superellipse(half, 0.055 + 0.2 * (half - 0.07), z, 2.6, 32, y=-0.085))
        shade = loft(np.stack(rings))
        b.add(style.shade, shade, name="shade", lumens=lumens, kelvin=style.kelvin)
        b.add(style.metal, bar((0, -0.01, 0), (0, -0.05, 0), 0.012, 10))
    return b.piece()


def light_strip(draw: Draw, style: Style, width: float = 0.6) -> FurniturePiece:
    """A slim wall lamp for above a mirror or below wall cupboards."""
    b = Builder("mirror lamp", "lamp", "on_wall", mount_height=draw.between(1.98, 2.08))
    metal = CHROME if draw.chance(0.6) else style.metal
    depth = draw.between(0.036, 0.05)
    b.add(metal, box((0.09, 0.03, 0.04), (0, -0.015, -0.02), 0.003), name="plate")
    b.add(metal, box((width, 0.022, 0.03), (0, -0.055, -0.008), 0.003), name="rail")
    b.add(metal, bar((0, -0.028, 0), (0, -0.05, 0), 0.009, 8))
    b.add(
        OPAL,
        rounded_box((width - 0.02, depth, 0.035), (0, -0.06, -0.042), 0.016, steps=2, inner=2),
        name="diffuser",
        lumens=draw.between(500, 800),
        kelvin=style.kelvin + 500,
    )
    return b.piece()
