"""Pot plants: broad leaves on stalks, palms, sword leaves, cacti and herbs."""

from __future__ import annotations

from typing import Any

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.procedural.furniture import materials as m
from pbrnet.scenes.procedural.furniture.parts import geometry as g
from pbrnet.scenes.procedural.furniture.parts.build import Builder
from pbrnet.scenes.procedural.furniture.spec import (
    Spec,
    between,
    drawn,
    pick,
    repeated,
    when,
    whole,
)
from pbrnet.scenes.procedural.furniture.storage import add_basket
from pbrnet.scenes.procedural.piece import Material
from pbrnet.scenes.seeds import Draw

SPECIES = ("rubber plant", "palm", "aloe", "cactus", "herbs")  # of small plants
LEAVES = ("#4f7a3a", "#3c6a3a", "#5f8a4a", "#2f5a3a", "#74935a", "#4a6b3f")


class PlantPot(Spec):
    """A pot or a basket with soil; `radius` and `height` in metres."""

    radius: float
    height: float
    kind: float = drawn(lambda draw, spec: draw.random())
    glaze: Material = drawn(lambda draw, spec: _glaze(draw, spec))
    foot: float = when(lambda pot: pot.kind >= 0.25, between(0.65, 0.9), 0.0)

    def add_to(self, b: Builder) -> None:
        """Add the pot, standing at the origin."""
        radius, height, wall = self.radius, self.height, 0.08 * self.radius
        if self.kind < 0.25:
            add_basket(b, (0, 0, 0), (radius, radius), height, 2.0)
            b.add(m.SOIL, g.cylinder(radius - 0.028, 0.5 * height, 0.82 * height, 28), name="soil")
            return
        profile = [(self.foot * radius, 0.0), (radius - 0.06 * radius, 0.86 * height)]
        profile += [(radius, 0.87 * height), (radius, height), (radius - wall, height)]
        pot = g.lathe([*profile, (radius - 1.6 * wall, 0.7 * height)], 28)
        b.add(m.CERAMIC if self.kind > 0.8 else self.glaze, pot, name="pot")
        profile = [(0.8 * radius, 0.72 * height), (radius - 1.25 * wall, 0.86 * height)]
        b.add(m.SOIL, g.lathe([*profile, (0, 0.89 * height)], 24), name="soil")


def _glaze(draw: Draw, pot: PlantPot) -> Material:
    return m.TERRACOTTA if pot.kind < 0.5 else draw.pick(pot.style.accents)


class BroadLeaf(Spec):
    """A broad leaf on a stalk."""

    aside: float = between(-0.3, 0.3)
    share: float = between(0.35, 1.0)
    out: float = between(0.4, 1.0)
    length: float = between(0.24, 0.34)
    droop: float = between(0.7, 1.5)
    tilt: float = between(-35, 10)
    leaf: int = whole(0, 2)
    roll: float = between(-18, 18)

    def add_to(self, b: Builder, k: int, plant: Foliage) -> None:
        """Add the `k`-th leaf of a plant."""
        rise, turn = plant.rise, k * 2.4 + self.aside
        extent = 0.33 * rise * self.out * (1.25 - 0.6 * self.share)
        path = plant.branch(turn, extent, plant.base + 0.92 * rise * self.share)
        b.add(plant.stalk, g.tube(path, np.linspace(0.013, 0.005, 6) * rise, 8), name="stalks")
        length = self.length * rise
        leaf = _leaf(length, 0.62 * length, self.droop).turned("x", self.roll)
        leaf = leaf.turned("y", self.tilt).turned("z", np.degrees(turn)).moved(*path[-1])
        b.add(plant.leaves[self.leaf], leaf, name="leaves")


class Frond(Spec):
    """A frond of a palm: blades on both sides of its stalk."""

    aside: float = between(-0.3, 0.3)
    out: float = between(0.45, 1.0)
    top: float = between(0.6, 0.93)
    # Degrees from the stalk, leaf.
    blades: tuple[tuple[float, int], ...] = repeated(22, between(42, 62), whole(0, 2))

    def add_to(self, b: Builder, k: int, plant: Foliage) -> None:
        """Add the `k`-th frond of a plant."""
        rise, turn = plant.rise, k * 2.4 + self.aside
        path = plant.branch(turn, 0.45 * rise * self.out, plant.base + rise * self.top)
        b.add(plant.stalk, g.tube(path, np.linspace(0.009, 0.003, 6) * rise, 8), name="stalks")
        fine, blades = np.linspace(0.35, 1.0, 11), iter(self.blades)
        at = np.stack([np.interp(fine, np.linspace(0, 1, 6), path[:, c]) for c in range(3)], 1)
        for j, point in enumerate(at):
            length = 0.26 * rise * float(np.sin(np.pi * (0.25 + 0.68 * j / 10))) + 0.02
            for side in (-1, 1):
                wide, leaf = next(blades)
                away = np.degrees(turn) + side * wide * (1 - 0.04 * j)
                blade = _leaf(length, 0.13 * length, 0.8, rows=5).turned("y", -12)
                b.add(plant.leaves[leaf], blade.turned("z", away).moved(*point), name="leaves")


class SwordLeaf(Spec):
    """An upright leaf from the soil."""

    aside: float = between(-0.3, 0.3)
    length: float = between(0.55, 1.0)
    droop: float = between(0.02, 0.25)
    lean: float = between(68, 86)
    near: float = between(0.1, 1.0)
    leaf: int = whole(0, 2)
    roll: float = between(-60, 60)

    def add_to(self, b: Builder, k: int, plant: Foliage) -> None:
        """Add the `k`-th leaf of a plant."""
        turn, near = k * 2.4 + self.aside, 0.45 * plant.pot.radius * self.near
        width = max(0.1 * plant.rise, 0.012)
        blade = _leaf(plant.rise * self.length, width, self.droop, rows=9).turned("x", self.roll)
        blade = blade.turned("y", -self.lean).turned("z", np.degrees(turn))
        at = (near * float(np.cos(turn)), near * float(np.sin(turn)), plant.base)
        b.add(plant.leaves[self.leaf], blade.moved(*at), name="leaves")


class Herb(Spec):
    """A thin stalk with three small leaves."""

    out: float = drawn(lambda draw, spec: draw.random())
    tall: float = between(0.45, 1.0)
    blades: tuple[tuple[float, float, int], ...] = repeated(  # length, turn, leaf
        3, between(0.018, 0.032), between(0, 360), whole(0, 2)
    )

    def add_to(self, b: Builder, k: int, plant: Foliage) -> None:
        """Add the `k`-th stalk of a plant."""
        turn, out = k * 2.4, 0.75 * plant.pot.radius * float(np.sqrt(self.out))
        foot = (out * float(np.cos(turn)), out * float(np.sin(turn)), plant.base)
        tip = (1.7 * foot[0], 1.7 * foot[1], plant.base + plant.rise * self.tall)
        b.add(plant.stalk, g.bar(foot, tip, 0.0013, 8), name="stalks")
        for share, (length, around, leaf) in zip((0.45, 0.7, 0.92), self.blades, strict=True):
            at = np.array(foot) + share * (np.array(tip) - np.array(foot))
            blade = _leaf(length, 0.02, 0.8, rows=4).turned("y", -20.0).turned("z", around)
            b.add(plant.leaves[leaf], blade.moved(*at), name="leaves")


class CactusColumn(Spec):
    """A ribbed column of a cactus."""

    alone: bool
    size: float = when("alone", 1.0, between(0.45, 0.6))
    tall: float = between(0.6, 0.95)

    def add_to(self, b: Builder, k: int, plant: Foliage) -> None:
        """Add the `k`-th column of a plant."""
        angle, radius = 2 * np.pi * np.arange(48) / 48, 0.6 * plant.pot.radius
        size, tall = radius * self.size, plant.rise * self.tall
        x, y = (0.0 if self.alone else 0.55 * radius * f(2.1 * k) for f in (np.cos, np.sin))
        ribs, rings = 1 + 0.1 * np.cos(12 * angle), []
        for z, wide in ((0.0, 0.75), (0.2, 1.0), (0.6, 1.0), (0.85, 0.8), (0.96, 0.45), (1, 0.1)):
            ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
            at = (x, y, plant.base - 0.002 + z * tall)
            rings.append(ring * (size * wide * ribs)[:, None] + at)
        b.add(plant.leaves[0], g.loft(rings), name="columns")


_GROWTH: dict[str, tuple[type[Spec], int, int]] = {  # how many there are: at least, below
    "broad": (BroadLeaf, 14, 22),
    "palm": (Frond, 8, 12),
    "sword": (SwordLeaf, 12, 18),
    "cactus": (CactusColumn, 1, 4),
    "herbs": (Herb, 26, 40),
}


class Foliage(Spec):
    """A plant of a kind in its pot, `height` metres high."""

    pot: PlantPot
    height: float
    green: str = pick(*LEAVES)
    variants: tuple[int, int] = drawn(lambda draw, spec: (draw.variant(), draw.variant()))
    kind: str = pick("broad", "palm", "sword")
    grown: tuple[Any, ...] = drawn(lambda draw, spec: _grown(draw, spec))

    @property
    def base(self) -> float:
        """Height where the plant begins, metres."""
        return 0.84 * self.pot.height

    @property
    def rise(self) -> float:
        """Height of the plant above its base, metres."""
        return self.height - self.base

    @property
    def leaves(self) -> tuple[Material, Material]:
        """Dark and pale leaves."""
        red, green, blue = m.hex_color(self.green)
        pale = (min(1.0, red * 1.35), min(1.0, green * 1.3), min(1.0, blue * 1.2))
        one, two = self.variants
        dark = Material("leaf", (red, green, blue), 0.45, accent=pale, variant=one)
        return dark, Material("leaf", pale, 0.45, accent=pale, variant=two)

    @property
    def stalk(self) -> Material:
        red, green, blue = m.hex_color(self.green)
        return Material("leaf", (red * 1.1, green * 0.9, blue * 0.8), 0.6)

    def branch(self, turn: float, extent: float, top: float) -> Float64Array:
        """Path (6, 3) of a stalk up to the height `top`."""
        t = np.linspace(0, 1, 6)
        out = extent * t**1.7
        z = self.base + (top - self.base) * np.sin(0.5 * np.pi * t) ** 0.9
        return np.stack([out * np.cos(turn), out * np.sin(turn), z], axis=1)

    def add_to(self, b: Builder) -> None:
        """Add the pot and the plant."""
        self.pot.add_to(b)
        for k, each in enumerate(self.grown):
            each.add_to(b, k, self)


def _grown(draw: Draw, plant: Foliage) -> tuple[Spec, ...]:
    kind, least, below = _GROWTH[plant.kind]
    count = draw.whole(least, below)
    given = {"alone": count == 1} if kind is CactusColumn else {}
    return tuple(kind.draw(draw, plant.style, **given) for _ in range(count))


def _foliage(draw: Draw, spec: Plant | SmallPlant, kind: str | None = None) -> Foliage:
    pot = PlantPot.draw(draw, spec.style, radius=spec.radius, height=spec.pot)
    return Foliage.draw(draw, spec.style, pot=pot, height=spec.height, kind=kind)


class Plant(Spec, piece=("plant", "plant", "corner")):
    """A tall pot plant: broad leaves on stalks, a palm's fronds, or sword leaves."""

    height: float = between(0.8, 1.5)
    radius: float = between(0.14, 0.18)
    pot: float = between(0.26, 0.34)
    foliage: Foliage = drawn(_foliage)

    def assemble(self, b: Builder) -> None:
        self.foliage.add_to(b)


class SmallPlant(Spec, piece=("plant", "plant", "on_top")):
    """A pot plant for tables and sills, of a species of `SPECIES`."""

    species: int = whole(0, len(SPECIES))
    height: float = between(0.22, 0.4)
    radius: float = between(0.05, 0.07)
    pot: float = between(0.08, 0.12)
    foliage: Foliage = drawn(lambda draw, spec: _foliage(draw, spec, [*_GROWTH][spec.species]))

    def assemble(self, b: Builder) -> None:
        b.name = SPECIES[self.species]
        self.foliage.add_to(b)


def _leaf(length: float, width: float, droop: float, rows: int = 7) -> g.BodyMesh:
    """Leaf along +X from the origin, folded along its midrib, with a drooping tip."""
    t = np.linspace(0, 1, rows)
    half = 0.5 * width * np.sin(np.pi * t**0.8) ** 0.8
    half[-1] = 0.002
    half[0] = 0.004
    bend = 0.5 * (droop * t[1:] + droop * t[:-1])
    x = np.concatenate([[0], np.cumsum(np.cos(bend) * np.diff(t))]) * length
    z = -np.concatenate([[0], np.cumsum(np.sin(bend) * np.diff(t))]) * length
    points = np.empty((rows, 3, 3))
    for column, side in enumerate((-1.0, 0.0, 1.0)):
        points[:, column, 0] = x
        points[:, column, 1] = side * half
        points[:, column, 2] = z + 0.35 * abs(side) * half
    return g.grid(points)
