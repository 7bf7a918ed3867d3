"""Bottles, jars, cups, pans and other bodies of revolution."""

from __future__ import annotations

from typing import Any

import numpy as np

from pbrnet.scenes.files import data_beside
from pbrnet.scenes.procedural.furniture import materials as m
from pbrnet.scenes.procedural.furniture.parts import geometry as g
from pbrnet.scenes.procedural.furniture.parts.build import Builder, Print
from pbrnet.scenes.procedural.furniture.spec import (
    any_of,
    between,
    by,
    drawn,
    either,
    pick,
    printed,
    ranged,
    repeated,
    scaled,
    when,
    whole,
)
from pbrnet.scenes.procedural.furniture.style import Style
from pbrnet.scenes.procedural.furniture.things.thing import RoundThing, Thing, turned
from pbrnet.scenes.procedural.piece import Material, MaterialKind
from pbrnet.scenes.seeds import Draw

_GREEN = Material("plastic", m.hex_color("#24402a"), 0.08)
_BROWN = Material("plastic", m.hex_color("#3a2312"), 0.08)
_ALUMINIUM = Material("metal", m.hex_color("#c4c5c6"), 0.35, family="brushed")


class Bottle(RoundThing, category="bottle"):
    """A bottle: body, shoulder from `shoulder` of the height on, neck, cap, paper label."""

    shoulder: float = 0.6
    neck: float = 0.35
    body: str = "any"
    label: bool = True
    shell: Material = drawn(lambda draw, bottle: _of_bottle(draw, bottle))
    cap: Material = pick(m.BLACK_PLASTIC, m.WHITE_PLASTIC, _ALUMINIUM)
    paper: Print | None = when(lambda it: it.label and it.shoulder * it.height > 0.05, printed())

    def assemble(self, b: Builder) -> None:
        r, h, n = self.radius, self.height, max(self.neck * self.radius, 0.009)
        s, top = self.shoulder * h, h - 0.02
        profile = [
            (0.9 * r, 0.0), (r, 0.05 * h), (r, s), (0.85 * r, s + 0.25 * (top - s)),
            (1.15 * n, s + 0.6 * (top - s)), (n, top),
        ]  # fmt: skip
        b.add(self.shell, g.lathe(profile, 20), name="body")
        b.add(self.cap, g.cylinder(1.2 * n, top, h, 16, 0.001), name="cap")
        if self.paper:
            self.add_label(b, self.paper, 0.22 * s, 0.85 * s, 20)


def _of_bottle(draw: Draw, bottle: Bottle) -> Material:
    style = bottle.style
    choices = {
        "glass": [_GREEN, _BROWN, m.CERAMIC],
        "plastic": [m.WHITE_PLASTIC, style.tinted(draw), style.tinted(draw)],
        "any": [_GREEN, _BROWN, m.WHITE_PLASTIC, style.tinted(draw)],
        "metal": [_ALUMINIUM, style.metal, style.tinted(draw)],
    }
    return draw.pick(choices[bottle.body])


class Jar(RoundThing, category="box"):
    """A jar, tin or can: straight body with a lid."""

    body: str = "plastic"
    lid: bool = True
    label: bool = True
    shell: Material = drawn(lambda draw, jar: _of_jar(draw, jar))
    cover: int = when("lid", whole(0, 4), 0)
    paper: Print | None = when("label", printed())

    def assemble(self, b: Builder) -> None:
        r, h = self.radius, self.height
        top = 0.88 * h if self.lid else h
        b.add(self.shell, g.cylinder(r, 0.0, top, 22, min(0.003, 0.1 * r)), name="body")
        if self.lid:
            cover = (self.style.wood, m.BLACK_PLASTIC, _ALUMINIUM, self.shell)[self.cover]
            b.add(cover, g.cylinder(1.03 * r, top, h, 22, 0.0015), name="lid")
        if self.paper:
            self.add_label(b, self.paper, 0.15 * top, 0.8 * top, 22)


def _of_jar(draw: Draw, jar: Jar) -> Material:
    style = jar.style
    return {
        "plastic": style.tinted(draw),
        "ceramic": style.glazed(draw),
        "metal": _ALUMINIUM,
        "tin": draw.pick(style.books),
        "wood": style.wood,
        "white": m.WHITE_PLASTIC,
    }[jar.body]


def _hollow(r: float, h: float, foot: float, segments: int, wall: float = 0.003) -> g.BodyMesh:
    """An open vessel: from its foot outwards, over the rim, down inside."""
    t = np.linspace(0, 1, 6)
    outer = [(r * (foot + (1 - foot) * float(x) ** 0.5), float(x) * h) for x in t]
    inner = [(max(a - wall, 0.001), max(z, wall * 1.6)) for a, z in outer[::-1]]
    return g.lathe([*outer, *inner[:-1], (inner[-1][0] - 0.001, wall * 1.6)], segments)


class Cup(RoundThing, category="crockery"):
    """A cup, mug, tumbler or bowl."""

    handle: bool = True
    glass: bool = False
    foot: float = 0.75
    body: Material = when("glass", m.GLASS, any_of("glazed"))

    def assemble(self, b: Builder) -> None:
        r, h = self.radius, self.height
        b.add(self.body, _hollow(r, h, self.foot, 24), name="body")
        if self.handle:
            ear = g.arc(0.92 * r, 0.52 * h, 0.3 * h, 0.3 * h)
            b.add(self.body, g.tube(ear, 0.0045, 8), name="handle")


class Stemmed(RoundThing, category="glass"):
    """A wine or champagne glass, its bowl from `stem` of the height on."""

    stem: float

    def assemble(self, b: Builder) -> None:
        r, h, bowl = self.radius, self.height, self.stem * self.height
        profile = [
            (0.034, 0.0), (0.034, 0.0015), (0.005, 0.006), (0.0035, bowl), (0.55 * r, bowl + 0.012),
            (r, bowl + 0.35 * (h - bowl)), (0.8 * r, h), (0.8 * r - 0.0014, h),
            (r - 0.0014, bowl + 0.35 * (h - bowl)), (0.55 * r, bowl + 0.0145),
            (0.001, bowl + 0.006),
        ]  # fmt: skip
        b.add(m.GLASS, g.lathe(profile, 24), name="glass")


# What a beaker holds -> its category, length and radius of each.
_STICKS = {
    "pens": ("clutter", 0.15, 0.004),
    "brushes": ("clutter", 0.2, 0.004),
    "spoons": ("crockery", 0.3, 0.005),
    "toothbrushes": ("fitting", 0.18, 0.005),
}


class FilledCup(RoundThing, category="clutter"):
    """A beaker with pens, brushes, spoons or toothbrushes in it."""

    what: str
    body: Material = any_of("glazed")
    sticks: tuple[tuple[float, float, Material], ...] = repeated(  # direction, length, material
        whole(2, 7), between(0, 0.1), between(0.85, 1.1), any_of("wood", "tinted", m.BLACK_PLASTIC)
    )

    def assemble(self, b: Builder) -> None:
        b.category, long, thick = _STICKS[self.what]
        r, h = self.radius, self.height
        b.add(self.body, _hollow(r, h, 0.92, 20), name="beaker")
        for k, (aside, length, stuff) in enumerate(self.sticks):
            turn = 2 * np.pi * (k / 7 + aside)
            along = np.array([np.cos(turn), np.sin(turn)])
            foot, lean = 0.3 * r * along, 0.72 * r * along
            reach = long * length / h
            end = foot + (lean - foot) * reach
            stick = g.bar((*foot.tolist(), 0.006), (*end.tolist(), reach * h), thick, 8)
            b.add(stuff, stick, name="sticks")


class Pan(Thing, category="pot"):
    """A pan or saucepan with a straight handle."""

    radius: float = ranged()
    deep: float
    metal: Material = pick(m.IRON, m.STEEL, m.BLACK_PLASTIC)
    grip: Material = either(0.6, m.BLACK_PLASTIC, "wood")

    def assemble(self, b: Builder) -> None:
        b.add(self.metal, _hollow(self.radius, self.deep, 0.82, 32), name="pan")
        handle = g.box((0.17, 0.022, 0.016), (self.radius + 0.075, 0, 0.75 * self.deep), 0.005)
        b.add(self.grip, handle, name="handle")


class Plate(Thing, category="crockery"):
    """A plate with crumbs, or two plates with a fork and a knife on them."""

    crumbs: bool
    radius: float = between(0.095, 0.135)
    glaze: Material = any_of("glazed")
    bits: tuple[tuple[tuple[float, ...], tuple[float, ...]], ...] = repeated(  # place, size
        when("crumbs", whole(4, 9), 0),
        repeated(2, drawn(lambda draw, it: draw.between(-0.4 * it.radius, 0.4 * it.radius))),
        repeated(3, between(0.003, 0.009)),
    )

    def assemble(self, b: Builder) -> None:
        b.add(self.glaze, turned("plate", self.radius, 1, 36), name="plate")
        for at, size in self.bits:
            crumb = g.box(size, (*at, 0.0066), 0.0008)
            b.add(Material("paper", m.hex_color("#8a5a30"), 0.9), crumb, name="crumbs")
        for y in () if self.crumbs else (-0.012, 0.012):
            fork = g.box((1.35 * self.radius, 0.009, 0.002), (0.0, y, 0.0202), 0.0006)
            b.add(m.STEEL, fork, name="cutlery")


class Teapot(Thing, category="crockery"):
    """A teapot with a spout, a handle and a lid."""

    radius: float = between(0.065, 0.085)
    glaze: Material = any_of("glazed")

    def assemble(self, b: Builder) -> None:
        r = self.radius
        b.add(self.glaze, turned("teapot", r, r, 28), name="body")
        spout = np.array([[0.9 * r, 0, 0.55 * r], [1.3 * r, 0, 0.8 * r], [1.65 * r, 0, 1.35 * r]])
        b.add(self.glaze, g.tube(spout, [0.18 * r, 0.13 * r, 0.1 * r], 12), name="spout")
        ear = g.arc(-0.85 * r, 0.8 * r, -0.5 * r, 0.45 * r)
        b.add(self.glaze, g.tube(ear, 0.007, 8), name="handle")


class Mill(Thing, category="clutter"):
    """A pepper mill."""

    height: float = between(0.14, 0.26)
    wood: Material = either(0.5, "dark_wood", "wood")

    def assemble(self, b: Builder) -> None:
        b.add(self.wood, turned("pepper mill", 1, self.height, 20), name="mill")


class Roll(Thing, category="paper"):
    """A roll of paper standing, with its core; kitchen rolls on a stand."""

    radius: float
    height: float
    spike: bool

    def assemble(self, b: Builder) -> None:
        core, z = 0.021, 0.012 if self.spike else 0.0
        outline = [(core, z), (self.radius, z), (self.radius, z + self.height)]
        paper = Material("paper", m.hex_color("#efece6"), 0.95, family="creased")
        b.add(paper, g.lathe([*outline, (core, z + self.height)], 28), name="paper")
        if self.spike:
            b.add(self.style.wood, g.cylinder(0.075, 0.0, 0.0115, 28, 0.002), name="stand")
            pole = g.cylinder(0.01, 0.0118, self.height + 0.05, 14, 0.002)
            b.add(self.style.wood, pole, name="stand")
        else:
            b.add(m.PAGES, g.cylinder(core - 0.0015, 0.0006, self.height - 0.0006, 18), name="core")


class Bucket(Thing, category="bin", anchor="free"):
    """A bucket, basket or planter on the floor."""

    size: float = scaled(0.9, 1.1)
    body: Material = any_of("tinted", "metal", m.WHITE_PLASTIC)

    def assemble(self, b: Builder) -> None:
        b.add(self.body, _hollow(self.size, 1.7 * self.size, 0.75, 28, 0.004), name="bucket")


class WrappedFood(Thing, category="food"):
    """A loaf of bread, an onion, a lemon or a pumpkin."""

    color: str
    radius: float = scaled(0.9, 1.12)
    flat: float
    long: float = 1.0
    peel: bool = False
    stalk: bool = False

    def assemble(self, b: Builder) -> None:
        r, turn = self.radius, np.linspace(-0.5 * np.pi, 0.5 * np.pi, 12)
        profile = [(max(r * np.cos(t), 0.0), r * self.flat * (1 + np.sin(t))) for t in turn]
        profile[0], profile[-1] = (0.0, 0.0), (0.0, profile[-1][1])
        body = g.lathe(profile, 24)
        if self.long > 1:
            stretched = body.scaled(x=self.long).vertices
            body = g.BodyMesh(stretched, body.faces, body.uvs * self.long**0.5)
        family = "nappa" if self.peel else "creased"
        kind: MaterialKind = "leather" if self.peel else "paper"
        b.add(Material(kind, m.hex_color(self.color), 0.6, family=family), body, name="food")
        if self.stalk:
            high = profile[-1][1]
            stem = g.bar((0, 0, 0.9 * high), (0.004, 0, 1.12 * high), 0.04 * r + 0.001, 6)
            b.add(self.style.dark_wood, stem, name="stalk")


class Candle(RoundThing, category="candle"):
    """A candle of one of the home's small colours."""

    accent: Material = any_of("accents")

    def assemble(self, b: Builder) -> None:
        wax = Material("plastic", self.accent.color, 0.6)
        b.add(wax, g.cylinder(self.radius, 0.0, self.height, 20, 0.002), name="wax")


# What a set holds: names of its things, their kind and its options; each at most 8 cm wide.
_SETS: dict[str, dict[str, Any]] = data_beside(__file__)
_KINDS: dict[str, type[RoundThing]] = {"jar": Jar, "bottle": Bottle, "cup": Cup, "candle": Candle}
Row = tuple[tuple[RoundThing, float], ...]  # things of a set and their places


def _row(draw: Draw, style: Style, what: str, width: float, share: float) -> Row:
    """Draw different things of a set in a row of a width."""
    names, at = draw.shuffled(_SETS[what]["names"]), -width / 2
    row: list[tuple[RoundThing, float]] = []
    while names and draw.chance(share + 1.0 * (len(row) < 2)):
        name, made = names.pop(), _SETS[what]
        if "or" in made and draw.chance(0.35):
            made = made["or"]
        thing = _KINDS[made["kind"]].draw(draw, style, name=name, **made["options"])
        low, high = thing.build().bounds[:, 0].tolist()
        if at + high - low > width / 2:
            break
        row.append((thing, at - low))
        at += high - low + draw.between(0.004, 0.03)
    return tuple(row)


def _add_thing(b: Builder, thing: RoundThing, x: float, y: float, z: float) -> None:
    """Add a thing, an object of its own, at a place."""
    with b.holding(thing.name, thing.category):
        b.add_from(thing.builder(), x, y, z)


class Tray(Thing, category="clutter"):
    """A tray with a row of bottles, jars, cups or candles, each an object of its own."""

    what: str
    width: float = scaled(0.9, 1.1, 0.34)
    body: Material = any_of("wood", "metal", "lacquer", "glazed")
    row: Row = drawn(lambda draw, it: _row(draw, it.style, it.what, it.width - 0.04, 0.92))
    depths: tuple[float, ...] = repeated(lambda it: len(it.row), between(-0.02, 0.02))

    def assemble(self, b: Builder) -> None:
        b.add(self.body, g.box((self.width, 0.13, 0.012), bevel=0.003), name="tray")
        for side in (-1, 1):
            at = (side * (0.5 * self.width - 0.004), 0.0, 0.0118)
            b.add(self.body, g.box((0.008, 0.126, 0.014), at, 0.002), name="rim")
        for (thing, x), y in zip(self.row, self.depths, strict=True):
            _add_thing(b, thing, x, y, 0.0122)


_BOARD = any_of("wood", "lacquer", "dark_wood")


class Ledge(Thing, category="shelf", anchor="on_wall"):
    """A narrow board on the wall with a rail, and a row of bottles or jars on it."""

    what: str
    mount_height: float = between(1.3, 1.5)
    width: float = scaled(0.9, 1.15, 0.42)
    board: Material = by("what", {"care": any_of("wood", "lacquer", m.GLASS)}, _BOARD)
    rail: Material = either(0.6, "metal", m.CHROME)
    row: Row = drawn(lambda draw, it: _row(draw, it.style, it.what, it.width - 0.05, 0.97))

    def assemble(self, b: Builder) -> None:
        half, y = self.width / 2, -0.096
        b.add(self.board, g.span((-half, -0.1, -0.012), (half, 0, 0)))
        ends = ((-half + 0.012, y, 0.03), (half - 0.012, y, 0.03))
        b.add(self.rail, g.bar(*ends, 0.003, 8), name="rail")
        for x, _, z in ends:
            b.add(self.rail, g.bar((x, y, 0.0002), (x, y, z), 0.003, 8), name="rail")
        for thing, x in self.row:
            _add_thing(b, thing, x, -0.048, 0.0004)
