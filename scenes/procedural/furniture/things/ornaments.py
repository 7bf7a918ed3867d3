"""Ornaments on shelves and sills, and what hangs on walls: posters, calendars, hooks, rails."""

from __future__ import annotations

from typing import Any

import numpy as np

from pbrnet.scenes.procedural.furniture import materials as m
from pbrnet.scenes.procedural.furniture.decoration import picture_plane
from pbrnet.scenes.procedural.furniture.parts import geometry as g
from pbrnet.scenes.procedural.furniture.parts.build import Builder, Print
from pbrnet.scenes.procedural.furniture.parts.drapes import Pleats, hooked, pleats
from pbrnet.scenes.procedural.furniture.spec import (
    Spec,
    any_of,
    between,
    by,
    drawn,
    either,
    maybe,
    one,
    printed,
    repeated,
    scaled,
    whole,
)
from pbrnet.scenes.procedural.furniture.things.thing import OUTLINES, RoundThing, Thing, turned
from pbrnet.scenes.procedural.piece import Material

_CORK = Material("paper", m.hex_color("#b08a5e"), 0.95, family="corrugated")
_WAX = Material("plastic", m.hex_color("#efe6d2"), 0.6)
# Board -> what is pinned to it; on others flyers
_PINNED = {"magnetic board": "memo", "cork board": "ticket"}
_KEYS = ("front door key", "bicycle key", "cellar key", "letter box key", "car key", "shed key")


class Turned(RoundThing, category="clutter"):
    """A turned ornament of glaze, wood or metal, with or without a candle."""

    shape: str
    body: Material = any_of("glazed", "wood", "dark_wood", "metal")
    candle: float = by("shape", {"candlestick": between(0.06, 0.2)}, 0.0)

    def assemble(self, b: Builder) -> None:
        outline = np.array(OUTLINES[self.shape])
        t, fine = np.linspace(0, 1, len(outline)), np.linspace(0, 1, 3 * len(outline))
        radii, heights = (np.interp(fine, t, outline[:, k]) for k in (0, 1))
        profile = np.stack([self.radius * radii, self.height * heights], axis=1).tolist()
        b.add(self.body, g.lathe(profile, 24), name="body")
        if self.candle:
            top = self.height + self.candle
            b.add(_WAX, g.cylinder(0.011, self.height, top, 14), name="candle")


class Globe(Thing, category="clutter"):
    """A globe on a turned foot."""

    r: float = between(0.07, 0.13)
    map: Print = printed()

    def assemble(self, b: Builder) -> None:
        r, z = self.r, 0.058 + self.r
        b.add(self.style.dark_wood, turned("globe foot", r, 1, 22), name="foot")
        b.add(self.map, g.sphere(r, 24, 14).moved(z=z), name="globe")
        meridian = g.arc(0, z, r + 0.008, r + 0.008, count=14)
        b.add(self.style.metal, g.tube(meridian, 0.0035, 8), name="arc")


class Lantern(Thing, category="candle"):
    """A lantern: a candle between four posts under a hood."""

    half: float = between(0.05, 0.08)
    h: float = between(0.18, 0.3)
    frame: Material = either(0.6, "metal", "wood")

    def assemble(self, b: Builder) -> None:
        half, h = self.half, self.h
        floor = g.box((2 * half, 2 * half, 0.015), (0, 0, 0), 0.002)
        hood = g.box((2.1 * half, 2.1 * half, 0.012), (0, 0, h), 0.002)
        b.add(self.frame, floor, hood, name="frame")
        for x, y in g.CORNERS:
            at = (0.88 * x * half, 0.88 * y * half, 0.0148)
            b.add(self.frame, g.box((0.011, 0.011, h - 0.0145), at), name="frame")
        b.add(self.frame, g.tube(g.arc(0, h + 0.011, 0.03, 0.03, 0.0, 12), 0.003, 8), name="handle")
        b.add(_WAX, g.cylinder(0.45 * half, 0.0152, 0.5 * h, 20, 0.002), name="candle")


_FACES = {"plate": any_of("glazed"), "woven": any_of("cushions"), "calendar": printed()}
_FACES |= {"board": either(0.6, _CORK, m.WHITE_PLASTIC), "poster": any_of("picture")}
_CATEGORIES = {"mirror": "mirror", "board": "clutter", "plate": "crockery", "woven": "textile"}
_CATEGORIES["poster"] = "picture"


class Sheet(Thing, category="clutter", anchor="on_wall"):
    """A flat thing on the wall, its middle `height` metres up: poster, calendar, board, plate.

    What is pinned to a notice board are objects of their own.
    """

    size: tuple[float, float] = scaled(0.85, 1.15)
    look: str
    height: float = 1.5
    face: Any = by("look", _FACES)
    notes: tuple[tuple[float, float, Print, Material], ...] = repeated(  # half width, height
        by("look", {"board": whole(2, 5)}, 0),
        between(0.035, 0.055),
        between(-0.5, 0.5),
        printed(),
        any_of("tinted"),
    )

    def assemble(self, b: Builder) -> None:
        (x, z), wood = self.size, self.style.wood
        b.category = _CATEGORIES.get(self.look, "paper")
        b.mount_height = self.height
        if self.look == "plate":
            b.add(self.face, turned("wall plate", x, 1, 32).turned("x", 90), name="plate")
        elif self.look == "woven":
            b.add(wood, g.bar((-x / 2, -0.01, z / 2), (x / 2, -0.01, z / 2), 0.01, 10))
            cloth = g.span((-0.46 * x, -0.0135, -z / 2), (0.46 * x, -0.0075, z / 2 - 0.004))
            b.add(self.face, cloth)
        elif self.look == "mirror":
            b.add(self.style.metal, g.disc(x / 2, 0.0, 0.014, 40, 0.004), name="rim")
            b.add(m.MIRROR, g.disc(x / 2 - 0.012, 0.0141, 0.0155, 40), name="mirror")
        elif self.look == "board":
            b.add(wood, g.span((-x / 2, -0.015, -z / 2), (x / 2, 0.0, z / 2), 0.003), name="frame")
            low, high = (0.03 - x / 2, -0.0165, 0.03 - z / 2), (x / 2 - 0.03, -0.0151, z / 2 - 0.03)
            b.add(self.face, g.span(low, high), name="face")
            self._add_notes(b)
        else:
            if self.look == "poster":
                b.add(self.face, picture_plane(x / 2, z / 2, -0.0022, -0.0006), name="sheet")
            else:
                face = g.span((-x / 2, -0.0022, -z / 2), (x / 2, -0.0006, z / 2))
                b.add(m.PAGES, face, name="sheet")
                self._add_days(b)

    def _add_notes(self, b: Builder) -> None:
        x, z = self.size
        for k, (half, high, skin, pin) in enumerate(self.notes):
            left, up = -x / 2 + 0.1 + (x - 0.2) * k / 4, high * (z - 0.2)
            with b.holding(_PINNED.get(self.name, "flyer"), "paper"):
                note = g.span((left - half, -0.0178, up - half), (left + half, -0.0168, up + half))
                b.add(skin, note, name="note")
                head = g.disc(0.006, 0.0, 0.008, 10).moved(left, -0.0176, up + 0.8 * half)
                b.add(pin, head, name="pin")

    def _add_days(self, b: Builder) -> None:
        x, z = self.size
        upper = g.span((0.01 - x / 2, -0.003, 0.02), (x / 2 - 0.01, -0.0023, z / 2 - 0.01))
        b.add(self.face, upper, name="print")
        for row in range(5):
            for column in range(7):
                at = ((column - 3) * 0.12 * x, -0.0026, -0.06 * z - 0.085 * z * row)
                b.add(m.BLACK_PLASTIC, g.box((0.03 * x, 0.0006, 0.02 * z), at), name="days")


class OnHook(Thing, category="fitting", anchor="on_wall"):
    """A hook on the wall with a towel, an apron or a coat, an object of its own."""

    held: str
    mount_height: float = between(1.5, 1.7)
    cloth: Material = any_of("cushions")
    size: tuple[float, float] = scaled(0.9, 1.1)
    pleats: Pleats = drawn(lambda draw, hook: pleats(draw))

    def assemble(self, b: Builder) -> None:
        b.name = f"hook of the {self.name}"
        b.add(self.style.metal, g.disc(0.022, 0.0, 0.006, 18, 0.001), name="plate")
        path = [(0, -0.004, 0.0), (0, -0.05, -0.022), (0, -0.08, -0.016), (0, -0.088, 0.016)]
        b.add(self.style.metal, g.tube(path, 0.006, 8), name="hook")
        cloth = self.style.towel if self.held == "towel" else self.cloth
        with b.holding(self.name, self.held):
            b.add(cloth, hooked(self.pleats, self.size).moved(0, -0.035, -0.012), name="cloth")


class Rail(Thing, category="fitting", anchor="on_wall"):
    """A rail with ladles, sieves and spatulas on hooks, each an object of its own."""

    mount_height: float = between(1.5, 1.65)
    metal: Material = either(0.6, m.STEEL, "metal")
    half: float = between(0.2, 0.32)
    tools: tuple[tuple[float, Material], ...] = repeated(  # length, material
        lambda rail: len(rail.places),
        between(0.22, 0.3),
        drawn(lambda draw, rail: draw.pick([rail.metal, rail.style.wood, m.BLACK_PLASTIC])),
    )

    @property
    def places(self) -> list[float]:
        """Places of the tools along x."""
        return np.arange(-self.half + 0.07, self.half - 0.05, 0.095).tolist()

    def assemble(self, b: Builder) -> None:
        metal, half = self.metal, self.half
        b.add(metal, g.bar((-half, -0.04, 0), (half, -0.04, 0), 0.006, 10), name="rail")
        for at in (0.03 - half, half - 0.03):
            b.add(metal, g.bar((at, 0.0, 0), (at, -0.04, 0), 0.005, 8), name="bracket")
        names = ("ladle", "spatula", "whisk", "sieve", "wooden spoon")
        turn = np.linspace(0, np.pi, 8)
        blade = g.superellipse(0.03, 0.008, 0.0, 2.0, 20)
        sizes = ((0.3, 0.0), (1.0, 0.03), (1.0, 0.07), (0.3, 0.095))
        blade = np.stack([blade * (size, size, 1) + (0, 0, z) for size, z in sizes])
        for k, (x, (long, body)) in enumerate(zip(self.places, self.tools, strict=True)):
            end = -0.02 - long
            with b.holding(names[k % 5], "fitting"):
                hook = [0 * turn + x, -0.04 - 0.011 * np.cos(turn), 0.011 * np.sin(turn)]
                path = [*np.stack(hook, 1).tolist(), [x, -0.029, -0.03]]
                b.add(metal, g.tube(path, 0.0022, 7), name="hook")
                b.add(body, g.bar((x, -0.029, -0.026), (x, -0.032, end), 0.005, 8), name="shaft")
                b.add(body, g.loft(blade).moved(x, -0.032, end - 0.085), name="blade")


class PaperHolder(Thing, category="paper", anchor="on_wall"):
    """A toilet roll on a holder."""

    mount_height: float = between(0.68, 0.8)
    r: float = between(0.04, 0.056)

    def assemble(self, b: Builder) -> None:
        b.add(m.CHROME, g.disc(0.022, 0.0, 0.008, 18, 0.001), name="plate")
        b.add(m.CHROME, g.bar((0, -0.004, 0), (0, -0.07, 0), 0.006, 10), name="arm")
        b.add(m.CHROME, g.bar((-0.004, -0.07, 0), (0.13, -0.07, 0), 0.006, 10), name="arm")
        roll = g.cylinder(self.r, 0.016, 0.116, 26, 0.002).turned("y", 90)
        b.add(m.PAGES, roll.moved(0, -0.07, -0.012), name="roll")


class RollTower(Thing, category="fitting", anchor="free"):
    """A stand with spare rolls of toilet paper on a pole, each an object of its own."""

    count: int = whole(2, 5)
    r: float = between(0.05, 0.058)

    def assemble(self, b: Builder) -> None:
        b.add(m.CHROME, g.cylinder(0.08, 0.0, 0.012, 28, 0.002), name="foot")
        for k in range(self.count):
            low = 0.0125 + 0.1005 * k
            with b.holding("roll on a pole", "paper"):
                b.add(m.PAGES, g.cylinder(self.r, low, low + 0.1, 26, 0.002), name="roll")
        top = 0.0127 + 0.1005 * self.count
        b.add(m.CHROME, g.cylinder(0.02, top, top + 0.004, 20, 0.001), name="pole")
        b.add(m.CHROME, g.cylinder(0.008, top + 0.0038, 0.48, 12, 0.002), name="pole")


class Brush(Thing, category="fitting", anchor="free"):
    """A toilet brush in its holder, on the floor."""

    body: Material = either(0.5, m.CERAMIC, m.STEEL)

    def assemble(self, b: Builder) -> None:
        b.add(self.body, turned("brush holder", 1, 1, 22), name="holder")
        b.add(m.WHITE_PLASTIC, g.bar((0, 0, 0.0085), (0.008, 0, 0.38), 0.008, 10), name="handle")


class Leaning(Thing, category="clutter", anchor="free"):
    """A long thing that stands against the wall: a broom, an ironing board, a yoga roll."""

    tall: float = between(0.95, 1.05)
    paint: Material = by("name", {"broom": any_of("tinted"), "ironing board": any_of("cushions")})

    def assemble(self, b: Builder) -> None:
        tall = self.tall
        if self.name == "broom":
            stick = g.bar((0, -0.06, 0.07), (0, 0.05, tall), 0.012, 10)
            b.add(self.style.wood, stick, name="stick")
            b.add(self.paint, g.box((0.3, 0.05, 0.05), (0, -0.065, 0.03), 0.006), name="head")
            b.add(m.BLACK_PLASTIC, g.box((0.28, 0.04, 0.031), (0, -0.065, 0)), name="bristles")
            return
        b.add(m.WHITE_PLASTIC, g.box((0.32, 0.03, tall), (0, 0.02, 0), 0.004), name="board")
        cover = g.box((0.325, 0.012, tall - 0.1), (0, -0.0012, 0.06), 0.003)
        b.add(self.paint, cover, name="cover")
        for side in (-1, 1):
            leg = g.bar((side * 0.1, 0.041, 0.01), (-side * 0.1, 0.041, tall - 0.15), 0.01, 8)
            b.add(m.STEEL, leg.moved(y=0.006 * side + 0.006), name="legs")


class Key(Spec):
    """A key on its ring, some with a fob."""

    long: float = between(0.035, 0.055)
    metal: Material = either(0.7, m.STEEL, "metal")
    fob: Material | None = maybe(0.5, any_of("tinted"))

    def add(self, b: Builder, x: float) -> None:
        """Add the key below its hook at x."""
        turn = np.linspace(0, 2 * np.pi, 14)[:-1]
        ring = [x + 0.011 * np.sin(turn), 0 * turn - 0.027, -0.0184 - 0.011 * np.cos(turn)]
        b.add(m.STEEL, g.tube(np.stack(ring, 1), 0.0012, 6, closed=True), name="ring")
        low, high = (x - 0.004, -0.0285, -0.029 - self.long), (x + 0.004, -0.0265, -0.0275)
        b.add(self.metal, g.span(low, high), name="key")
        if self.fob:
            fob = g.box((0.022, 0.004, 0.034), (x + 0.006, -0.0301, -0.07), 0.001)
            b.add(self.fob, fob, name="fob")


class KeyBoard(Thing, category="fitting", anchor="on_wall"):
    """A board with hooks and keys on most of them, each an object of its own."""

    mount_height: float = between(1.4, 1.55)
    count: int = whole(4, 7)
    names: tuple[str, ...] = drawn(lambda draw, it: tuple(draw.shuffled(_KEYS)[: it.count]))
    keys: tuple[Key | None, ...] = repeated(
        lambda it: it.count,
        maybe(0.25, None, one(Key)),
    )

    def assemble(self, b: Builder) -> None:
        half = (0.055 * self.count + 0.03) / 2
        b.add(self.style.wood, g.span((-half, -0.015, -0.035), (half, 0, 0.035), 0.003))
        for k, (name, key) in enumerate(zip(self.names, self.keys, strict=True)):
            x = (k - 0.5 * (self.count - 1)) * 0.055
            hook = g.bar((x, -0.0145, -0.012), (x, -0.035, -0.008), 0.002, 6)
            b.add(self.style.metal, hook, name="hooks")
            if key:
                with b.holding(name, "fitting"):
                    key.add(b, x)
