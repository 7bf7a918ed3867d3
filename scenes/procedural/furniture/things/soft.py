"""Soft things: clothes, towels, bags, shoes; cloth is settled by a small simulation."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.procedural.furniture import materials as m
from pbrnet.scenes.procedural.furniture.parts import geometry as g
from pbrnet.scenes.procedural.furniture.parts.build import Builder
from pbrnet.scenes.procedural.furniture.spec import (
    any_of,
    between,
    by,
    drawn,
    either,
    pick,
    repeated,
    scaled,
    times,
    whole,
)
from pbrnet.scenes.procedural.furniture.things.thing import Size, Thing, turned
from pbrnet.scenes.procedural.piece import Material
from pbrnet.scenes.seeds import Draw, generator

_FALLS = 6  # settled sheets of each size
_STEPS = 90


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
    place = np.stack([u * width / 100 * shrink, v * depth / 100 * shrink, 0.08 + 0.03 * bumps], -1)
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


class Sheet(Thing, category="clutter", anchor="free"):
    """A cloth that fell: towel, garment, throw."""

    size: tuple[int, int]
    gather: int
    fall: int = whole(0, _FALLS)
    cloth: Material = any_of("garment")

    def assemble(self, b: Builder) -> None:
        points = fallen(self.fall, *self.size, self.gather)
        b.add(self.cloth, g.thick_sheet(points, 0.003), name="cloth")
        b.ground()


class Folded(Thing, category="textile"):
    """A pile of folded cloth; each piece has a colour of its own."""

    size: tuple[float, float]
    layers: int
    pile: tuple[tuple[tuple[float, float], float, Material, tuple[float, float]], ...] = repeated(
        drawn(lambda draw, pile: draw.whole(max(1, pile.layers - 2), pile.layers + 1)),
        drawn(lambda draw, pile: times(draw, pile.size, 0.92, 1.0)),
        between(0.022, 0.034),
        any_of("garment"),
        repeated(2, between(-0.006, 0.006)),
    )

    def assemble(self, b: Builder) -> None:
        z = 0.0
        for size, thick, cloth, at in self.pile:
            b.add(cloth, g.rounded_box((*size, thick), (*at, z), 0.45 * thick), name="cloth")
            z += thick + 0.0004


_TALL = {"boots": 0.24, "slippers": 0.05, "sneakers": 0.085}


class Shoes(Thing, category="shoe", anchor="free"):
    """A pair of shoes, sneakers, slippers or boots, not quite in line."""

    long: float = between(0.25, 0.3)
    leather: str = pick("#2a2522", "#5f4028", "#8a6a48")
    cloth: Material | None = by("name", dict.fromkeys(("sneakers", "slippers"), any_of("garment")))
    places: tuple[tuple[float, float], ...] = repeated(2, between(-14, 14), between(-0.03, 0.03))

    def _ring(self, z: float, scale: float, back: float, short: float = 1.0) -> Float64Array:
        t = np.linspace(0, 2 * np.pi, 36, endpoint=False)
        waist = 1 - 0.16 * np.cos(2 * t) * (np.sin(t) > -2)
        x, y = 0.048 * np.cos(t) * waist, 0.5 * self.long * np.sin(t)
        return np.column_stack([x * scale, y * scale * short + back, np.full(len(t), z)])

    def assemble(self, b: Builder) -> None:
        upper = Material("leather", m.hex_color(self.leather), 0.45, family="nappa")
        pale = Material("plastic", m.hex_color("#dedbd2"), 0.6)
        thick = 0.02 if self.name != "slippers" else 0.012
        tall, back, ring = _TALL.get(self.name, 0.075), 0.2 * self.long, self._ring
        bottom = g.loft(np.stack([ring(0.0, 0.96, 0), ring(thick, 1.0, 0)]))
        rings = [
            ring(thick + 0.0004, 0.97, 0), ring(thick + 0.25 * tall, 0.93, 0.005),
            ring(thick + 0.6 * tall, 0.72, 0.6 * back, 0.8), ring(thick + tall, 0.6, back, 0.62),
            ring(thick + tall, 0.5, back, 0.56), ring(thick + 0.3 * tall, 0.48, back, 0.55),
        ]  # fmt: skip
        body = g.loft(np.stack(rings))
        for x, (turn, y) in zip((-0.075, 0.075), self.places, strict=True):
            sole = pale if self.name == "sneakers" else m.RUBBER
            b.add(sole, bottom.turned("z", turn).moved(x, y), name="soles")
            b.add(self.cloth or upper, body.turned("z", turn).moved(x, y), name="uppers")


class Bag(Thing, category="bag", anchor="free"):
    """A bag that stands and sags: backpack, handbag, tote, paper bag."""

    size: Size = scaled(0.9, 1.1)
    cloth: Material = drawn(lambda draw, bag: _of_bag(draw, bag))
    sags: tuple[float, ...] = repeated(6, between(0, 6))

    def assemble(self, b: Builder) -> None:
        x, y, z = self.size
        turn = 2 * np.pi * np.arange(40) / 40
        levels = ((0.0, 0.9), (0.02, 1.0), (0.3, 1.05), (0.6, 0.99), (0.85, 0.85), (1.0, 0.7))
        rings = []
        for (t, scale), phase in zip(levels, self.sags, strict=True):
            ring = g.superellipse(0.5 * x * scale, 0.5 * y * scale, t * z, 4.0, 40)
            ring[:, :2] *= (1 + 0.05 * t * np.sin(3 * turn + phase) * (t < 0.99))[:, None]
            rings.append(ring)
        b.add(self.cloth, g.loft(np.stack(rings)), name="bag")
        arch = np.linspace(0, np.pi, 13)
        strap = m.BLACK_PLASTIC if self.name == "backpack" else self.cloth
        for side in (-1, 1):
            across = side * 0.12 * y + 0.02 * side * np.sin(arch)
            high = z - 0.01 + 0.3 * z * np.sin(arch)
            handle = g.tube(np.stack([0.2 * x * np.cos(arch), across, high], axis=1), 0.006, 8)
            b.add(strap, handle, name="handles")


def _of_bag(draw: Draw, bag: Bag) -> Material:
    if bag.name == "paper bag":
        return Material("paper", m.hex_color("#b0916a"), 0.9, family="creased")
    if bag.name == "handbag":
        color = m.hex_color(draw.pick(("#3a2a22", "#7a4a30", "#20222a")))
        return Material("leather", color, 0.4, family="full")
    return bag.style.garment(draw)


class Suitcase(Thing, category="bag", anchor="free"):
    """A suitcase on wheels with its handle down."""

    z: float = between(0.55, 0.68)
    shell: Material = any_of("tinted")

    def assemble(self, b: Builder) -> None:
        x, y, z = 0.42, 0.25, self.z
        shell = g.rounded_box((x, y, z), (0, 0, 0.045), 0.04, steps=3, inner=2)
        b.add(self.shell, shell, name="shell")
        wheel = g.cylinder(0.022, -0.012, 0.012, 16, 0.003).turned("y", 90)
        for side, front in g.CORNERS:
            at = (0.38 * side * x, 0.32 * front * y)
            b.add(m.RUBBER, wheel.moved(*at, 0.022), name="wheels")
            b.add(m.BLACK_PLASTIC, g.box((0.03, 0.03, 0.03), (*at, 0.0442)), name="forks")
        grip = g.box((0.16, 0.025, 0.02), (0, 0.06, z + 0.0455), 0.006)
        b.add(m.BLACK_PLASTIC, grip, name="grip")


_STRAW = Material("wood", m.hex_color("#c9a86a"), 0.8, family="wicker", scale=0.5)
_FELT = Material("fabric", m.hex_color("#4a4038"), 0.95, family="felt")


class Hat(Thing, category="clothing"):
    """A felt or straw hat."""

    cloth: Material = either(0.4, _STRAW, _FELT)

    def assemble(self, b: Builder) -> None:
        b.add(self.cloth, turned("hat", 1, 1, 36).scaled(y=1.15), name="hat")


class Mat(Thing, category="toy", anchor="free"):
    """A rolled exercise mat."""

    r: float = between(0.05, 0.065)
    tint: Material = any_of("tinted")

    def assemble(self, b: Builder) -> None:
        body = g.cylinder(self.r, -0.3, 0.3, 26, 0.004).turned("y", 90)
        rubber = Material("leather", self.tint.color, 0.8, family="pebbled")
        b.add(rubber, body.moved(0, 0, self.r), name="mat")


class Umbrella(Thing, category="bag", anchor="free"):
    """A closed umbrella lying on the floor."""

    tint: Material = any_of("tinted")

    def assemble(self, b: Builder) -> None:
        cloth = Material("fabric", self.tint.color, 0.8, family="satin")
        body = turned("umbrella", 1, 1, 18).turned("y", 90).moved(-0.3, 0, 0.034)
        b.add(cloth, body, name="cloth")
        b.add(self.style.wood, g.bar((-0.3, 0, 0.034), (-0.42, 0, 0.034), 0.009, 10), name="grip")


def _held(draw: Draw, stand: UmbrellaStand) -> Iterator[tuple[int, float, float, Material]]:
    """Draw which umbrellas are in a stand: number, direction, height above the rim, cloth."""
    for k in draw.permutation(3)[: draw.whole(1, 4)].tolist():
        aside, over = draw.between(-0.15, 0.15), draw.between(0.16, 0.34)
        yield k, aside, over, stand.style.tinted(draw) if k != 1 else stand.style.wood


class UmbrellaStand(Thing, category="fitting", anchor="free"):
    """An umbrella stand with umbrellas and a stick, each an object of its own."""

    r: float = between(0.11, 0.13)
    h: float = between(0.42, 0.5)
    body: Material = any_of("metal", "glazed", "dark_wood")
    held: tuple[tuple[int, float, float, Material], ...] = drawn(lambda *of: tuple(_held(*of)))

    def assemble(self, b: Builder) -> None:
        r, h = self.r, self.h
        wall = [(0.0, 0.0), (r, 0.0), (r, h), (r - 0.006, h), (r - 0.006, 0.012), (0.0, 0.012)]
        b.add(self.body, g.lathe(wall, 28), name="stand")
        b.add(m.STEEL, g.cylinder(r - 0.008, 0.0122, 0.0128, 28), name="dish")
        names = ("long umbrella", "walking stick", "short umbrella")
        for k, aside, over, stuff in self.held:
            turn = 2 * np.pi * (k + aside) / 3
            x, y = float(np.cos(turn)), float(np.sin(turn))
            foot, head = (0.03 * x, 0.03 * y, 0.0142), (0.065 * x, 0.065 * y, h + over)
            with b.holding(names[k], "bag" if k != 1 else "clutter"):
                if k == 1:
                    b.add(stuff, g.bar(foot, head, 0.01, 10), name="stick")
                    continue
                at = [low + 0.8 * (high - low) for low, high in zip(foot, head, strict=True)]
                b.add(stuff, g.bar(foot, at, 0.017, 12), name="cloth")
                b.add(self.style.dark_wood, g.bar(at, head, 0.008, 8), name="grip")
