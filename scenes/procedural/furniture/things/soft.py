"""Soft things: clothes, towels, bags, shoes; cloth is settled by a small simulation."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.procedural.furniture.parts.build import Builder, assembles
from pbrnet.scenes.procedural.furniture.parts.geometry import (
    CORNERS,
    bar,
    box,
    cylinder,
    lathe,
    loft,
    rounded_box,
    superellipse,
    thick_sheet,
    tube,
)
from pbrnet.scenes.procedural.furniture.style import BLACK_PLASTIC, RUBBER, Style, hex_color
from pbrnet.scenes.procedural.furniture.things.vessels import tinted
from pbrnet.scenes.procedural.piece import Material
from pbrnet.scenes.seeds import Draw, generator

_CLOTHS = ("cotton", "denim", "knit", "twill", "striped", "checked", "linen")
_FALLS = 6  # settled sheets of each size
_STEPS = 90


def garment(draw: Draw, style: Style) -> Material:
    """Cloth of a garment, in one of the home's small colours or in white, grey or blue."""
    plain = ("#d8d6d0", "#3a3d44", "#41546e", "#7a7d80")
    color = draw.pick(style.accents).color if draw.chance(0.5) else hex_color(draw.pick(plain))
    return Material("fabric", color, 0.95, family=draw.pick(_CLOTHS), variant=draw.whole(4) + 1)


@lru_cache(maxsize=64)
def fallen(fall: int, width: int, depth: int, gather: int) -> Float64Array:
    """A sheet of `width` x `depth` cm, let fall on a floor: positions (n, m, 3), metres.

    Masses and springs (Provot 1995) by position-based relaxation; `gather` per cent of the sheet is
    pushed together before it falls. Positions are rounded to 0.1 mm, because the simulation
    amplifies last digits.
    """
    draw = generator(fall, "fallen cloth", width, depth, gather)
    n, m = max(10, width // 3), max(10, depth // 3)
    rest_x, rest_y = width / 100 / (n - 1), depth / 100 / (m - 1)
    i, j = np.meshgrid(np.arange(n), np.arange(m), indexing="ij")
    shrink = 1 - gather / 100
    u, v = i / (n - 1) - 0.5, j / (m - 1) - 0.5
    bumps = sum(
        draw.between(0.4, 1)
        * np.sin(2 * np.pi * (draw.between(-4, 4) * u + draw.between(-4, 4) * v + draw.random()))
        for _ in range(6)
    )
    place = np.stack(
        [u * width / 100 * shrink, v * depth / 100 * shrink, 0.08 + 0.03 * bumps], axis=-1
    )
    place = np.round(place, 6)
    before = place.copy()
    diagonal = np.sqrt(rest_x**2 + rest_y**2)
    springs = [
        ((0, 1), rest_y), ((1, 0), rest_x), ((1, 1), diagonal), ((1, -1), diagonal),
        ((2, 0), 2 * rest_x), ((0, 2), 2 * rest_y),
    ]  # fmt: skip
    for _ in range(_STEPS):
        speed = 0.9 * (place - before)
        speed[..., 2] -= 0.0006
        before = place
        place = np.round(place + speed, 7)
        for (a, b), rest in springs:
            one = (slice(0, n - a), slice(max(0, -b), m - max(0, b)))
            two = (slice(a, n), slice(max(0, b), m - max(0, -b)))
            apart = place[two] - place[one]
            long = np.sqrt((apart * apart).sum(axis=-1, keepdims=True))
            stiff = 0.25 if max(a, abs(b)) < 2 else 0.02
            move = stiff * apart * (1 - rest / np.maximum(long, 1e-9))
            place[one] += move
            place[two] -= move
        lying = place[..., 2:] < 0.006
        place[..., :2] = np.where(lying, before[..., :2], place[..., :2])  # friction holds it
        place[..., 2] = np.maximum(place[..., 2], 0.004)
    return np.round(place, 4)


@assembles("clutter", "free")
def sheet(b: Builder, draw: Draw, style: Style, size: tuple[int, int], gather: int) -> None:
    """A cloth that fell: towel, garment, throw."""
    points = fallen(draw.whole(_FALLS), *size, gather)
    mesh = thick_sheet(points, 0.003)
    low = float(mesh.vertices[:, 2].min())
    b.add(garment(draw, style), mesh.moved(0, 0, -low), name="cloth")


@assembles("textile")
def folded(b: Builder, draw: Draw, style: Style, size: tuple[float, float], layers: int) -> None:
    """A pile of folded cloth; each piece has a colour of its own."""
    z = 0.0
    for _ in range(draw.whole(max(1, layers - 2), layers + 1)):
        x, y = (length * draw.between(0.92, 1.0) for length in size)
        thick = draw.between(0.022, 0.034)
        cloth = garment(draw, style)
        at = (draw.between(-0.006, 0.006), draw.between(-0.006, 0.006), z)
        b.add(cloth, rounded_box((x, y, thick), at, 0.45 * thick), name="cloth")
        z += thick + 0.0004


@assembles("shoe", "free")
def shoes(b: Builder, draw: Draw, style: Style) -> None:
    """A pair of shoes, sneakers, slippers or boots, not quite in line."""
    long, wide = draw.between(0.25, 0.3), 0.048
    upper = Material(
        "leather", hex_color(draw.pick(("#2a2522", "#5f4028", "#8a6a48"))), 0.45, family="nappa"
    )
    if b.name in ("sneakers", "slippers"):
        upper = garment(draw, style)
    sole = Material("plastic", hex_color("#dedbd2"), 0.6) if b.name == "sneakers" else RUBBER
    tall = {"boots": 0.24, "slippers": 0.05, "sneakers": 0.085}.get(b.name, 0.075)
    t = np.linspace(0, 2 * np.pi, 36, endpoint=False)
    waist = 1 - 0.16 * np.cos(2 * t) * (np.sin(t) > -2)
    outline = np.stack([wide * np.cos(t) * waist, 0.5 * long * np.sin(t)], axis=1)

    def ring(z: float, scale: float, back: float, short: float = 1.0) -> Float64Array:
        points = np.column_stack(
            [outline[:, 0] * scale, outline[:, 1] * scale * short + back, np.full(len(t), z)]
        )
        return np.asarray(points)

    thick = 0.02 if b.name != "slippers" else 0.012
    for k in (-1, 1):
        turn, x = draw.between(-14, 14), 0.075 * k
        y = draw.between(-0.03, 0.03)
        bottom = loft(np.stack([ring(0.0, 0.96, 0), ring(thick, 1.0, 0)]))
        back = 0.2 * long
        rings = [
            ring(thick + 0.0004, 0.97, 0), ring(thick + 0.25 * tall, 0.93, 0.005),
            ring(thick + 0.6 * tall, 0.72, 0.6 * back, 0.8), ring(thick + tall, 0.6, back, 0.62),
            ring(thick + tall, 0.5, back, 0.56), ring(thick + 0.3 * tall, 0.48, back, 0.55),
        ]  # fmt: skip
        body = loft(np.stack(rings))
        b.add(sole, bottom.turned("z", turn).moved(x, y), name="soles")
        b.add(upper, body.turned("z", turn).moved(x, y), name="uppers")


@assembles("bag", "free")
def bag(b: Builder, draw: Draw, style: Style, size: tuple[float, float, float]) -> None:
    """A bag that stands and sags: backpack, handbag, tote, paper bag."""
    x, y, z = (length * draw.between(0.9, 1.1) for length in size)
    if b.name == "paper bag":
        cloth = Material("paper", hex_color("#b0916a"), 0.9, family="creased")
    elif b.name == "handbag":
        cloth = Material(
            "leather", hex_color(draw.pick(("#3a2a22", "#7a4a30", "#20222a"))), 0.4, family="full"
        )
    else:
        cloth = garment(draw, style)
    count = 40
    turn = 2 * np.pi * np.arange(count) / count
    rings = []
    for t, scale in ((0.0, 0.9), (0.02, 1.0), (0.3, 1.05), (0.6, 0.99), (0.85, 0.85), (1.0, 0.7)):
        ring = superellipse(0.5 * x * scale, 0.5 * y * scale, t * z, 4.0, count)
        sag = 1 + 0.05 * t * np.sin(3 * turn + draw.between(0, 6)) * (t < 0.99)
        ring[:, :2] *= sag[:, None]
        rings.append(ring)
    b.add(cloth, loft(np.stack(rings)), name="bag")
    arc = np.linspace(0, np.pi, 13)
    for side in (-1, 1):
        across = side * 0.12 * y + 0.02 * side * np.sin(arc)
        handle = np.stack([0.2 * x * np.cos(arc), across, z - 0.01 + 0.3 * z * np.sin(arc)], axis=1)
        b.add(
            cloth if b.name != "backpack" else BLACK_PLASTIC, tube(handle, 0.006, 8), name="handles"
        )


@assembles("bag", "free")
def suitcase(b: Builder, draw: Draw, style: Style) -> None:
    """A suitcase on wheels with its handle down."""
    x, y, z = 0.42, 0.25, draw.between(0.55, 0.68)
    shell = tinted(draw, style)
    b.add(shell, rounded_box((x, y, z), (0, 0, 0.045), 0.04, steps=3, inner=2), name="shell")
    wheel = cylinder(0.022, -0.012, 0.012, 16, 0.003).turned("y", 90)
    for side, front in CORNERS:
        at = (0.38 * side * x, 0.32 * front * y)
        b.add(RUBBER, wheel.moved(*at, 0.022), name="wheels")
        b.add(BLACK_PLASTIC, box((0.03, 0.03, 0.03), (*at, 0.0442)), name="forks")
    b.add(BLACK_PLASTIC, box((0.16, 0.025, 0.02), (0, 0.06, z + 0.0455), 0.006), name="grip")


@assembles("clothing")
def hat(b: Builder, draw: Draw, style: Style) -> None:
    """A felt or straw hat."""
    straw = draw.chance(0.4)
    cloth = (
        Material("wood", hex_color("#c9a86a"), 0.8, family="wicker", scale=0.5)
        if straw
        else Material("fabric", hex_color("#4a4038"), 0.95, family="felt")
    )
    profile = [(0.16, 0.0), (0.162, 0.004), (0.098, 0.01), (0.09, 0.1), (0.06, 0.12), (0.0, 0.112)]
    b.add(cloth, lathe(profile, 36).scaled(y=1.15), name="hat")


@assembles("toy", "free")
def mat(b: Builder, draw: Draw, style: Style) -> None:
    """A rolled exercise mat."""
    r = draw.between(0.05, 0.065)
    body = cylinder(r, -0.3, 0.3, 26, 0.004).turned("y", 90)
    rubber = Material("leather", tinted(draw, style).color, 0.8, family="pebbled")
    b.add(rubber, body.moved(0, 0, r), name="mat")


@assembles("bag", "free")
def umbrella(b: Builder, draw: Draw, style: Style) -> None:
    """A closed umbrella lying on the floor."""
    cloth = Material("fabric", tinted(draw, style).color, 0.8, family="satin")
    body = lathe([(0.004, 0.0), (0.03, 0.06), (0.034, 0.4), (0.014, 0.6), (0.006, 0.62)], 18)
    b.add(cloth, body.turned("y", 90).moved(-0.3, 0, 0.034), name="cloth")
    b.add(style.wood, bar((-0.3, 0, 0.034), (-0.42, 0, 0.034), 0.009, 10), name="grip")
