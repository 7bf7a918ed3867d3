"""Decoration: plants, pictures, mirrors, screens and small objects."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from pbrnet.scenes.procedural.furniture import materials as m
from pbrnet.scenes.procedural.furniture.parts import geometry as g
from pbrnet.scenes.procedural.furniture.parts.build import Builder, Shown
from pbrnet.scenes.procedural.furniture.parts.drapes import Pleats, hooked, pleats
from pbrnet.scenes.procedural.furniture.spec import (
    Spec,
    any_of,
    between,
    by,
    chance,
    drawn,
    either,
    maybe,
    one,
    optional,
    pick,
    repeated,
    several,
    when,
    whole,
)
from pbrnet.scenes.procedural.furniture.storage import LyingBook, VaseBody, add_basket, add_stack
from pbrnet.scenes.procedural.piece import Material
from pbrnet.scenes.seeds import Draw

LABEL = Material("paper", m.hex_color("#e9e1cc"), 0.8)


class Twig(Spec):
    """A twig with three blossoms."""

    extent: float = between(0.05, 0.14)
    rise: float = between(0.14, 0.3)
    blossoms: tuple[float, ...] = repeated(3, between(0.011, 0.019))  # their radii


class Twigs(Spec):
    """Five to eight twigs with blossoms of one colour."""

    bloom: Material = any_of("cushions")
    twigs: tuple[Twig, ...] = several(Twig, 5, 9)


class Vase(Spec, piece=("vase", "vase", "on_top")):
    """A vase, sometimes with twigs."""

    height: float = between(0.16, 0.34)
    glaze: Material = any_of("accents")
    body: VaseBody = drawn(lambda draw, spec: VaseBody.draw(draw, spec.style, height=spec.height))
    twigs: Twigs | None = optional(0.6, Twigs)

    def assemble(self, b: Builder) -> None:
        b.name = "vase with twigs" if self.twigs else "vase"
        b.add(self.glaze, self.body.mesh(), name="vase")
        if self.twigs:
            self._add_twigs(b, self.twigs)

    def _add_twigs(self, b: Builder, bunch: Twigs) -> None:
        brown, t = Material("wood", m.hex_color("#6a4c34"), 0.8), np.linspace(0, 1, 5)
        for k, twig in enumerate(bunch.twigs):
            out, low, top = twig.extent * t**1.5, 0.72 * self.height, self.height + twig.rise
            turn = k * 2.4
            path = np.stack([out * np.cos(turn), out * np.sin(turn), low + (top - low) * t], 1)
            b.add(brown, g.tube(path, np.linspace(0.0026, 0.0014, 5), 8), name="twigs")
            for share, size in zip((0.7, 0.85, 1.0), twig.blossoms, strict=True):
                at = [float(np.interp(share, t, path[:, c])) for c in range(3)]
                b.add(bunch.bloom, g.sphere(size, 10, 6).moved(*at), name="blossoms")


class Picture(Spec, piece=("picture", "picture", "on_wall")):
    """A framed picture behind a mount; the origin is its centre."""

    width: float = between(0.35, 1.0)
    height: float = drawn(lambda draw, spec: spec.width * draw.pick((0.7, 0.75, 1.3, 1.0)))
    mount_height: float = between(1.45, 1.6)
    rail: float = between(0.018, 0.04)
    wood: Material = either(0.5, "dark_wood", "wood")
    margin: float = between(0.08, 0.2)
    shown: Material = any_of("picture")

    def assemble(self, b: Builder) -> None:
        width, height = self.width, min(self.height, 1.1)
        _add_frame(b, self.wood, width, height, self.rail, 0.028)
        w, h = width / 2 - self.rail, height / 2 - self.rail
        mount = g.span((-w - 0.004, -0.016, -h - 0.004), (w + 0.004, -0.006, h + 0.004))
        b.add(m.WHITE_PAINT, mount, name="mount")
        margin = self.margin * min(width, height)
        picture = picture_plane(w - margin, h - margin, -0.0175, -0.0175 + 0.0012)
        b.add(self.shown, picture, name="picture")


def picture_plane(w: float, h: float, y: float, back: float) -> g.BodyMesh:
    """Thin board from y to `back` whose front has uvs [0, 1] x [0, 1]."""
    board = g.span((-w, y, -h), (w, back, h))
    uvs = np.stack([board.vertices[:, 0] / (2 * w) + 0.5, board.vertices[:, 2] / (2 * h) + 0.5], 1)
    return g.BodyMesh(board.vertices, board.faces, uvs, smooth=False)


def display(w: float, h: float) -> g.BodyMesh:
    """Rectangle in the plane y = 0 that faces -Y, with uvs [0, 1] x [0, 1]."""
    points = np.array([[-w, 0, -h], [w, 0, -h], [w, 0, h], [-w, 0, h]])
    uvs = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    return g.BodyMesh(points, np.array([[0, 1, 2], [0, 2, 3]]), uvs, smooth=False)


def showing(low: float, high: float, is_film: bool = False) -> Any:
    """A field of what a display shows: a scene if it `is_film`, else windows with text."""
    return drawn(lambda draw, _: Shown(draw.between(low, high), 2 * draw.variant() + (not is_film)))


def _add_frame(
    b: Builder, material: Material, width: float, height: float, rail: float, depth: float
) -> None:
    """Add four frame rails centred at the origin, with their back on the wall y = 0."""
    w, h = width / 2, height / 2
    for side in (-1, 1):
        x0, x1 = side * w - rail * (side > 0), side * w + rail * (side < 0)
        z0, z1 = side * h - rail * (side > 0), side * h + rail * (side < 0)
        post = g.span((x0, -depth, -h), (x1, 0, h), 0.003, "z")
        low, high = (-w + rail, -depth + 0.0005, z0), (w - rail, -0.0003, z1)
        b.add(material, post, g.span(low, high, 0.003, "x"), name="frame")


class WallMirror(Spec, piece=("wall mirror", "mirror", "on_wall")):
    """A mirror in a frame, rectangular or round; the origin is its centre.

    It is rectangular where a size is given.
    """

    mount_height: float = between(1.45, 1.55)
    is_round: bool = drawn(
        lambda draw, spec: not {"width", "height"} & vars(spec).keys() and draw.chance(0.4)
    )
    width: float = between(0.45, 0.75)
    height: float = drawn(lambda draw, spec: spec.width * draw.between(1.1, 1.7))
    frame: Material | None = when("is_round", None, either(0.6, "wood", "metal"))

    def assemble(self, b: Builder) -> None:
        w, h = self.width / 2, self.height / 2
        if self.frame is None:
            angle, inner = 2 * np.pi * np.arange(48) / 48, w - 0.012
            ring = np.stack([inner * np.cos(angle), inner * np.sin(angle), 0.014 + 0 * angle], 1)
            rim = g.tube(ring, 0.0139, 10, closed=True).turned("x", 90)
            b.add(self.style.metal, rim, name="frame")
            b.add(m.MIRROR, g.cylinder(inner, 0.0, 0.012, 48).turned("x", 90))
            return
        _add_frame(b, self.frame, self.width, self.height, 0.03, 0.026)
        b.add(m.MIRROR, g.span((-w + 0.028, -0.014, -h + 0.028), (w - 0.028, -0.004, h - 0.028)))


class FloorMirror(Spec, piece=("floor mirror", "mirror", "wall"), front_clearance=0.5):
    """A tall mirror that leans against the wall."""

    width: float = between(0.5, 0.7)
    height: float = between(1.55, 1.8)
    lean: float = between(5, 8)

    def assemble(self, b: Builder) -> None:
        w, h = self.width / 2, self.height / 2
        flat = Builder("floor mirror", "mirror", "wall", front_clearance=0.5)
        _add_frame(flat, self.style.wood, self.width, self.height, 0.04, 0.03)
        flat.add(m.MIRROR, g.span((-w + 0.038, -0.018, -h + 0.038), (w - 0.038, -0.004, h - 0.038)))
        leaning = flat.turned("x", -self.lean)
        low, high = leaning.piece().bounds
        b.add_from(leaning, y=-float(low[1] + high[1]) / 2, z=-float(low[2]))


class Television(Spec, piece=("television", "television", "on_top")):
    """A flat television on its feet."""

    width: float = between(0.9, 1.3)
    shown: Shown = showing(20, 60, is_film=True)

    def assemble(self, b: Builder) -> None:
        self._add_panel(b, 0.0, 0.07)
        for side, sy in g.CORNERS:
            x = side * 0.32 * self.width
            leg = g.bar((x, 0, 0.08), (x + side * 0.02, sy * 0.12, 0.0075), 0.007, 8)
            pad = g.cylinder(0.008, 0, 0.008, 10).moved(x + side * 0.02, sy * 0.12)
            b.add(m.BLACK_PLASTIC, leg, pad, name="feet")

    def _add_panel(self, b: Builder, y: float, z: float) -> None:
        """Add case and screen, their lower edge at z."""
        width, height = self.width, self.width * 0.575
        panel = g.span((-width / 2, y - 0.012, z), (width / 2, y + 0.014, z + height), 0.003)
        size, at = (0.7 * width, 0.05, 0.5 * height), (0, y + 0.03, z + 0.1 * height)
        b.add(m.BLACK_PLASTIC, panel, g.rounded_box(size, at, 0.015, inner=1), name="case")
        low, high = (-width / 2 + 0.009, y - 0.0135, z + 0.018), (width / 2 - 0.009, y - 0.0115)
        b.add(m.SCREEN, g.span(low, (*high, z + height - 0.009)), name="screen")
        w, h, middle = width / 2 - 0.012, height / 2 - 0.0165, z + height / 2 + 0.0045
        b.show(display(w, h).moved(0, y - 0.0138, middle), self.shown)


class WallTelevision(Television, piece=("television", "television", "on_wall"), mount_height=1.1):
    """A flat television at a wall."""

    def assemble(self, b: Builder) -> None:
        self._add_panel(b, -0.055, 0.0)


class Monitor(Spec, piece=("computer monitor", "monitor", "on_top")):
    """A computer monitor with keyboard and mouse in front."""

    width: float = between(0.52, 0.64)
    z: float = between(0.09, 0.14)
    pale_keys: bool = chance(0.5)
    board: Material = either(0.5, m.STEEL, m.BLACK_PLASTIC)
    shown: Shown = showing(40, 100)

    def assemble(self, b: Builder) -> None:
        width, height, y, z = self.width, 0.585 * self.width, 0.13, self.z
        case = g.span((-width / 2, y - 0.012, z), (width / 2, y + 0.014, z + height), 0.003)
        b.add(m.BLACK_PLASTIC, case, name="case")
        w, h, middle = width / 2 - 0.008, height / 2 - 0.011, z + height / 2 + 0.003
        dark = g.span((-w, y - 0.0135, middle - h), (w, y - 0.0115, middle + h))
        b.add(m.SCREEN, dark, name="screen")
        b.add(m.BLACK_PLASTIC, g.box((0.05, 0.02, z + 0.14), (0, y + 0.025, 0.006)), name="stand")
        b.add(m.BLACK_PLASTIC, g.box((0.24, 0.19, 0.01), (0, y + 0.02, 0), 0.003), name="stand")
        self._add_keyboard(b)
        size, at = (0.06, 0.1, 0.034), (0.25, -0.11, 0.0)
        mouse = g.rounded_box(size, at, 0.0165, (0, 0, 0.003), inner=1)
        with b.holding("computer mouse", "electronics"):
            b.add(m.BLACK_PLASTIC, mouse.moved(z=0.003), name="mouse")
            b.add(m.BLACK_PLASTIC, g.box((0.04, 0.07, 0.005), (0.25, -0.11, 0)), name="mouse")
        screen = display(w - 0.002, h - 0.002).moved(0, y - 0.0138, middle)
        b.show(screen, self.shown)

    def _add_keyboard(self, b: Builder) -> None:
        keys = Material("plastic", m.hex_color("#d9d8d4" if self.pale_keys else "#2a2b2e"), 0.5)
        with b.holding("keyboard", "electronics"):
            board = g.box((0.43, 0.125, 0.01), (-0.03, -0.11, 0.002), 0.003)
            b.add(self.board, board, name="keyboard")
            b.add(m.BLACK_PLASTIC, g.box((0.4, 0.1, 0.0035), (-0.03, -0.11, 0)), name="keyboard")
            for row in range(5):
                x = -0.235
                while x < 0.165:
                    wide = 0.1 if row == 0 and -0.12 < x < -0.05 else 0.0155
                    at = (x + wide / 2, -0.154 + 0.0215 * row, 0.0115)
                    b.add(keys, g.box((wide, 0.0165, 0.005), at), name="keys")
                    x += wide + 0.0035


class Laptop(Spec, piece=("laptop", "laptop", "on_top")):
    """An open laptop."""

    width: float = between(0.3, 0.36)
    case: Material = either(0.6, m.STEEL, m.BLACK_PLASTIC)
    lean: float = between(10, 28)
    shown: Shown = showing(40, 100)

    def assemble(self, b: Builder) -> None:
        width, depth, case = self.width, 0.68 * self.width, self.case
        b.add(case, g.box((width, depth, 0.014), (0, 0, 0.001), 0.003), name="case")
        b.add(m.BLACK_PLASTIC, g.box((width - 0.04, depth - 0.04, 0.002), (0, 0, 0)), name="feet")
        pitch = (width - 0.05) / 13
        for row in range(5):
            for k in range(13):
                in_bar = row == 0 and 4 <= k <= 8  # the space bar
                if in_bar and k != 6:
                    continue
                size = ((5 if in_bar else 1) * pitch - 0.003, pitch - 0.004, 0.002)
                at = ((k - 6) * pitch, -0.005 + row * pitch * 0.98 - 0.02, 0.0148)
                b.add(m.BLACK_PLASTIC, g.box(size, at), name="keys")
        at = (0, -depth / 2 + 0.18 * depth, 0.0147)
        b.add(m.BLACK_PLASTIC, g.box((0.34 * width, 0.27 * depth, 0.0008), at), name="touchpad")
        lid = Builder("", "", "free")
        lid.add(case, g.span((-width / 2, 0, 0), (width / 2, 0.006, depth), 0.002), name="case")
        w, h, middle = width / 2 - 0.008, depth / 2 - 0.011, depth / 2 + 0.002
        lid.add(m.SCREEN, g.span((-w, -0.0012, middle - h), (w, 0, middle + h)), name="screen")
        lean, y = -self.lean, depth / 2 - 0.006
        b.add_from(lid.turned("x", lean), y=y, z=0.012)
        screen = display(w - 0.002, h - 0.002).moved(0, -0.0015, middle)
        b.show(screen.turned("x", lean).moved(0, y, 0.012), self.shown)


class BooksStack(Spec, piece=("stack of books", "books", "on_top")):
    """A stack of three to six books."""

    count: int = whole(3, 7)
    turn: float = between(-20, 20)
    books: tuple[LyingBook, ...] = repeated(lambda spec: spec.count, one(LyingBook))

    def assemble(self, b: Builder) -> None:
        add_stack(b, self.books, 0, 0, 0, self.turn)


class Fruit(Spec):
    """One fruit of a bowl."""

    size: float = between(0.033, 0.04)
    color: str = pick("#b8322a", "#d98a2b", "#8aa83a", "#d9c23a", "#c24a2a")
    tilt: float = between(-40, 40)


class FruitBowl(Spec, piece=("fruit bowl", "bowl", "on_top")):
    """A bowl with five to seven fruits."""

    radius: float = between(0.12, 0.16)
    height: float = between(0.06, 0.09)
    body: Material = either(0.4, "wood", "accents")
    fruits: tuple[Fruit, ...] = several(Fruit, 5, 8)

    def assemble(self, b: Builder) -> None:
        radius, height = self.radius, self.height
        b.add(self.body, _bowl(radius, height), name="bowl")
        apple = [(0.0, -0.82), (0.3, -0.9), (0.7, -0.68), (1.0, -0.05), (0.93, 0.42), (0.6, 0.8)]
        apple += [(0.22, 0.82), (0.0, 0.62)]
        last = len(self.fruits) - 1
        for k, fruit in enumerate(self.fruits):
            size, ring = fruit.size, 0.0 if k == last else 0.52 * radius
            turn = 2 * np.pi * k / max(last, 1)
            z = 0.45 * height + size + (0.045 if ring == 0 else 0.0)
            body = g.lathe([(size * r, size * h) for r, h in apple], 18).turned("x", fruit.tilt)
            body = body.moved(ring * float(np.cos(turn)), ring * float(np.sin(turn)), z)
            b.add(Material("plastic", m.hex_color(fruit.color), 0.4), body, name="fruit")


def _bowl(radius: float, height: float) -> g.BodyMesh:
    t = np.linspace(0, 1, 7)
    outer = [(radius * (0.45 + 0.55 * float(s) ** 0.6), float(s) * height) for s in t]
    inner = [(r - 0.006, max(z, 0.008)) for r, z in outer[::-1]]
    return g.lathe([*outer, *inner[:-1], (inner[-1][0] - 0.004, 0.008)], 32)


class Cup(Spec):
    """A cup beside plates, of their glaze or of another."""

    own: Material | None = maybe(0.4, any_of("accents"))
    turn: float = between(0, 360)


class Crockery(Spec, piece=("crockery", "crockery", "on_top")):
    """A pile of plates and two or three cups."""

    glaze: Material = either(0.6, m.CERAMIC, "accents")
    plates: int = whole(2, 6)
    cups: tuple[Cup, ...] = several(Cup, 2, 4)

    def assemble(self, b: Builder) -> None:
        profile = [(0.075, 0.0), (0.085, 0.004), (0.127, 0.018), (0.128, 0.021), (0.084, 0.008)]
        plate = g.lathe([*profile, (0.0, 0.007)], 36)
        for k in range(self.plates):
            b.add(self.glaze, plate.moved(x=-0.07, z=0.0075 * k), name="plates")
        for k, each in enumerate(self.cups):
            cup = _cup().turned("z", each.turn).moved(0.13, (k - 0.8) * 0.135, 0)
            with b.holding("cup", "crockery"):
                b.add(each.own or self.glaze, cup, name="cups")


def _cup() -> g.BodyMesh:
    profile = [
        (0.03, 0.0), (0.038, 0.012), (0.042, 0.09), (0.0385, 0.09), (0.034, 0.014), (0.0, 0.01),
    ]  # fmt: skip
    t = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 9)
    ear = np.stack([0.039 + 0.026 * np.cos(t), 0 * t, 0.047 + 0.027 * np.sin(t)], axis=1)
    return g.merge([g.lathe(profile, 24), g.tube(ear, 0.0045, 8)])


class Candle(Spec, piece=("candles", "candle", "on_top")):
    """Candles of three heights on a tray."""

    candles: tuple[tuple[float, float], ...] = repeated(  # radius, height
        3, between(0.024, 0.034), between(0.06, 0.16)
    )

    def assemble(self, b: Builder) -> None:
        tray = [(0.1, 0.0), (0.105, 0.012), (0.101, 0.012), (0.097, 0.004), (0.0, 0.004)]
        b.add(self.style.metal, g.lathe(tray, 32), name="tray")
        wax = Material("plastic", m.hex_color("#efe6d2"), 0.6)
        for k, (radius, height) in enumerate(self.candles):
            turn = 2 * np.pi * k / 3 + 0.4
            x, y = 0.052 * float(np.cos(turn)), 0.052 * float(np.sin(turn))
            profile = [(radius, 0.0035), (radius, height), (0.8 * radius, height)]
            profile += [(0.6 * radius, height - 0.006), (0, height - 0.007)]
            wick = g.bar((x, y, height - 0.009), (x + 0.002, y, height + 0.008), 0.0012, 8)
            with b.holding("candle", "candle"):
                b.add(wax, g.lathe(profile, 22).moved(x, y), name="wax")
                b.add(m.BLACK_PLASTIC, wick, name="wick")


class WallClock(Spec, piece=("wall clock", "clock", "on_wall")):
    """A round clock; the origin is its centre."""

    radius: float = between(0.13, 0.19)
    mount_height: float = between(1.75, 1.95)
    rim: Material = either(0.4, "wood", "metal")
    hour: float = between(0, 360)  # degrees of the hands
    minute: float = between(0, 360)

    def assemble(self, b: Builder) -> None:
        radius = self.radius
        rim = [(radius, 0.0), (radius, 0.035), (radius - 0.015, 0.035), (radius - 0.017, 0.02)]
        b.add(self.rim, g.lathe(rim, 48).turned("x", 90), name="rim")
        dial = g.cylinder(radius - 0.0165, 0.015, 0.022, 48).turned("x", 90)
        b.add(m.WHITE_PAINT, dial, name="dial")
        for k in range(12):
            wide, long = (0.007, 0.024) if k % 3 == 0 else (0.004, 0.014)
            mark = g.box((wide, 0.0016, long), (0, -0.0232, radius - 0.03 - long))
            b.add(m.BLACK_PLASTIC, mark.turned("y", 30 * k), name="marks")
        hands = ((0.52, 0.009, self.hour, -0.026), (0.76, 0.006, self.minute, -0.029))
        for length, width, angle, y in hands:
            hand = g.box((width, 0.0018, length * radius + 0.02), (0, y, -0.02))
            b.add(m.BLACK_PLASTIC, hand.turned("y", angle), name="hands")
        b.add(m.BLACK_PLASTIC, g.cylinder(0.008, 0.021, 0.033, 14).turned("x", 90), name="hands")


class Radiator(Spec, piece=("radiator", "radiator", "on_wall"), mount_height=0.13):
    """A ribbed radiator with a valve, mounted just above the floor."""

    width: float = between(0.6, 1.3)

    def assemble(self, b: Builder) -> None:
        width, height = self.width, 0.55
        count = max(4, round(width / 0.06))
        pitch = width / count
        for k in range(count):
            x = -width / 2 + (k + 0.5) * pitch
            for y in (-0.115, -0.06):
                size = (0.8 * pitch, 0.028, height)
                b.add(m.WHITE_PAINT, g.rounded_box(size, (x, y, 0), 0.013, steps=1, inner=1))
        for z in (0.06, height - 0.06):
            size, at = (width - 0.4 * pitch, 0.075, 0.03), (0, -0.0875, z - 0.015)
            b.add(m.WHITE_PAINT, g.box(size, at, 0.006))
            for side in (-1, 1):
                bracket = g.box((0.03, 0.052, 0.02), (side * 0.3 * width, -0.026, z - 0.01))
                b.add(m.WHITE_PAINT, bracket, name="bracket")
        x, y = width / 2, -0.0875
        pipe = g.bar((x - 0.3 * pitch, y, 0.06), (x + 0.05, y, 0.06), 0.01, 10)
        down = g.bar((x + 0.04, y, 0.06), (x + 0.04, y, -0.12), 0.008, 10)
        b.add(m.CHROME, pipe, down, name="valve")
        knob = g.cylinder(0.02, 0, 0.06, 16, bevel=0.004).turned("y", 90)
        b.add(m.WHITE_PAINT, knob.moved(x + 0.045, y, 0.06), name="knob")


class Coat(NamedTuple):
    """A coat on a hook."""

    x: float
    cloth: Material
    size: tuple[float, float]
    pleats: Pleats

    def mesh(self) -> g.BodyMesh:
        """The coat below its hook."""
        return hooked(self.pleats, self.size).moved(self.x, -0.045, -0.012)


class CoatHooks(Spec, piece=("coat hooks", "coat hooks", "on_wall")):
    """A board with hooks, some with a coat."""

    width: float = between(0.6, 0.9)
    mount_height: float = between(1.6, 1.7)
    coats: tuple[Coat, ...] = drawn(lambda draw, spec: tuple(_coats(draw, spec)))

    @property
    def places(self) -> list[float]:
        """Places of the hooks along x."""
        count = int(self.width / 0.15)
        return [(k - (count - 1) / 2) * 0.15 for k in range(count)]

    def assemble(self, b: Builder) -> None:
        board = g.span((-self.width / 2, -0.022, -0.05), (self.width / 2, 0, 0.05), 0.003)
        b.add(self.style.wood, board)
        coats = {coat.x: coat for coat in self.coats}
        for x in self.places:
            path = [(x, -0.02, -0.01), (x, -0.05, -0.03), (x, -0.08, -0.02), (x, -0.088, 0.015)]
            b.add(self.style.metal, g.tube(path, 0.006, 8), name="hooks")
            b.add(self.style.metal, g.sphere(0.009, 10, 6).moved(x, -0.088, 0.018), name="hooks")
            if x in coats:
                with b.holding("coat", "clothing"):
                    b.add(coats[x].cloth, coats[x].mesh(), name="coat")


def _coats(draw: Draw, hooks: CoatHooks) -> Iterator[Coat]:
    """Draw coats; cloth of wide ones would lie in their neighbours', which are left out."""
    style, last, edge = hooks.style, -1.0, -1.0
    for x in hooks.places:
        if x - last > 0.28 and draw.chance(0.25 + 0.5 * style.disorder):
            cloth = draw.pick((*style.cushions, style.second_upholstery, style.throw))
            size = (draw.between(0.5, 0.8), draw.between(0.62, 0.85))
            coat = Coat(x, cloth, size, pleats(draw))
            along = coat.mesh().vertices[:, 0]
            if along.min() >= edge + 0.01:
                last, edge = x, along.max()
                yield coat


class StorageBox(Spec, piece=("storage basket", "box", "free")):
    """A lidded box of cardboard or an open basket."""

    width: float = between(0.3, 0.42)
    depth: float = between(0.24, 0.34)
    height: float = between(0.2, 0.3)
    paper: Material | None = maybe(0.5, any_of("accents"))  # None: a basket

    def assemble(self, b: Builder) -> None:
        b.name = "storage box" if self.paper else "storage basket"
        width, depth, height = self.width, self.depth, self.height
        if self.paper:
            paper = Material("paper", self.paper.color, 0.85)
            b.add(paper, g.box((width, depth, height - 0.02), (0, 0, 0), 0.002), name="box")
            lid = g.box((width + 0.008, depth + 0.008, 0.06), (0, 0, height - 0.06), 0.002)
            b.add(paper, lid, name="lid")
            label = g.box((0.07, 0.004, 0.03), (0, -depth / 2 - 0.001, 0.5 * height))
            b.add(self.style.metal, label, name="label")
            b.surface(0, 0, height, width / 2 - 0.02, depth / 2 - 0.02)
        else:
            add_basket(b, (0, 0, 0), (width / 2, depth / 2), height)
            size, at = (width - 0.06, depth - 0.06, 0.12), (0, 0, height - 0.13)
            b.add(self.style.throw, g.rounded_box(size, at, 0.05, (0, 0, 0.02)), name="linen")


class WasteBin(Spec, piece=("bin", "bin", "free")):
    """An open round bin, a basket for paper, or a bin with a pedal."""

    radius: float = between(0.11, 0.14)
    height: float = between(0.26, 0.33)
    kind: str = pick("waste bin", "paper basket", "pedal bin", "mesh bin")
    case: Material | None = by("kind", {"pedal bin": either(0.6, m.STEEL, m.WHITE_PLASTIC)})

    def assemble(self, b: Builder) -> None:
        b.name = self.kind
        radius, height = self.radius, self.height
        if self.case:
            b.add(self.case, g.cylinder(radius, 0.012, height, 32, 0.006), name="bin")
            b.add(m.BLACK_PLASTIC, g.cylinder(0.97 * radius, 0.0, 0.0121, 32), name="foot")
            lid = [(1.01 * radius, height + 0.003), (0.9 * radius, height + 0.022)]
            b.add(self.case, g.lathe([*lid, (0, height + 0.03)], 32), name="lid")
            pedal = g.box((0.06, 0.05, 0.008), (0, -radius - 0.015, 0.008), 0.002)
            b.add(m.BLACK_PLASTIC, pedal, name="pedal")
            return
        own = {"paper basket": m.WICKER, "mesh bin": self.style.metal}
        profile = [(0.8 * radius, 0.0), (radius, height), (radius - 0.004, height)]
        body = g.lathe([*profile, (0.8 * radius - 0.004, 0.006)], 32)
        b.add(own.get(self.kind, m.BLACK_PLASTIC), body, name="bin")


class Bottle(Spec, piece=("bottle and glasses", "glass", "on_top")):
    """A bottle and two glasses."""

    tint: str = pick("#24361f", "#3a2413", "#1c2f38")
    height: float = between(0.28, 0.33)
    width: float = between(0.034, 0.041)
    glasses: tuple[tuple[float, float], ...] = repeated(  # where they are off their places
        2, between(-0.01, 0.02), between(-0.01, 0.01)
    )

    def assemble(self, b: Builder) -> None:
        height, width = self.height, self.width
        body = [(width - 0.002, 0.0), (width, 0.006), (width, 0.62 * height)]
        body += [(0.8 * width, 0.71 * height), (0.015, 0.8 * height), (0.0145, height)]
        dark = Material("plastic", m.hex_color(self.tint), 0.1)
        b.add(dark, g.lathe([*body, (0.0, height)], 26), name="bottle")
        label = [(width + 0.0004, 0.22 * height), (width + 0.0004, 0.5 * height)]
        b.add(LABEL, g.lathe(label, 26), name="label")
        profile = [(0.028, 0.0), (0.034, 0.1), (0.0325, 0.1), (0.0265, 0.006), (0.0, 0.006)]
        for (x, y), (dx, dy) in zip(((0.1, -0.03), (0.085, 0.075)), self.glasses, strict=True):
            with b.holding("glass", "glass"):
                b.add(m.GLASS, g.lathe(profile, 24).moved(x + dx, y + dy), name="glasses")
