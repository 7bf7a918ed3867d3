"""Boxes, papers and devices: things made of a few blocks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy import ndimage

from pbrnet.scenes.procedural.furniture import materials as m
from pbrnet.scenes.procedural.furniture.decoration import display, showing
from pbrnet.scenes.procedural.furniture.parts import geometry as g
from pbrnet.scenes.procedural.furniture.parts.build import Builder, Print, Shown, Skin
from pbrnet.scenes.procedural.furniture.spec import (
    Spec,
    any_of,
    between,
    by,
    chance,
    drawn,
    either,
    maybe,
    pick,
    printed,
    repeated,
    scaled,
    times,
    when,
    whole,
)
from pbrnet.scenes.procedural.furniture.things.thing import Size, Thing
from pbrnet.scenes.procedural.piece import FurniturePiece, Material
from pbrnet.scenes.seeds import Draw

CARDBOARD = Material("paper", m.hex_color("#a98a62"), 0.9, family="corrugated")
_PAPER = Material("paper", m.hex_color("#e4e2dc"), 0.9, family="creased")


class Package(Thing, category="box"):
    """A cardboard box or carton: printed, plain brown with tape, or of one colour."""

    size: Size = scaled(0.88, 1.12)
    look: str = "print"
    skin: Skin = by("look", {"print": printed(), "brown": CARDBOARD, "plain": any_of("books")})

    def assemble(self, b: Builder) -> None:
        x, _, z = self.size
        b.add(self.skin, g.box(self.size, bevel=0.0008), name="carton")
        if self.look == "brown":
            tape = Material("plastic", m.hex_color("#b79a6a"), 0.25)
            b.add(tape, g.box((x * 0.995, 0.05, 0.0006), (0, 0, z + 0.0001)), name="tape")


class Carton(Thing, category="box"):
    """A milk or juice carton with a cap."""

    size: Size = scaled(0.92, 1.08, (0.07, 0.07, 0.19))
    skin: Print = printed()

    def assemble(self, b: Builder) -> None:
        z = self.size[2]
        b.add(self.skin, g.box(self.size, bevel=0.001), name="carton")
        b.add(m.WHITE_PLASTIC, g.cylinder(0.014, z + 0.0002, z + 0.016, 16, 0.002), name="cap")


def _of_sheet(draw: Draw, papers: Papers) -> Skin:
    kind = draw.random()
    if papers.look == "white":
        return _PAPER
    if papers.look == "print" or kind < 0.6:
        return Print.draw(draw, papers.style)
    return draw.pick(papers.style.books)


class Papers(Thing, category="clutter"):
    """Papers, letters, magazines or notebooks, each a little askew."""

    size: Size
    sheets: int
    look: str = "white"
    pile: tuple[tuple[Size, float, tuple[float, float], Skin], ...] = repeated(
        drawn(lambda draw, papers: draw.whole(1, papers.sheets + 1)),
        drawn(lambda draw, papers: times(draw, papers.size, 0.94, 1.06)),
        between(-12, 12),
        repeated(2, between(-0.01, 0.01)),
        drawn(_of_sheet),
    )
    pen: Material | None = by("look", {"white": maybe(0.4, any_of("tinted"))})

    def assemble(self, b: Builder) -> None:
        b.category = "books" if self.look == "cover" else "paper"
        z = 0.0
        for size, turn, at, skin in self.pile:
            sheet = g.box(size).turned("z", turn).moved(*at, z)
            plain = "paper" if skin is _PAPER else "cover"
            b.add(skin, sheet, name="print" if isinstance(skin, Print) else plain)
            z += size[2] + 0.0003
        if self.pen:
            pen = g.bar((-0.06, 0.01, z + 0.0042), (0.07, 0.03, z + 0.0042), 0.004, 8)
            b.add(self.pen, pen, name="pen")


class Slab(Thing, category="electronics"):
    """A flat device: phone, tablet, remote control, calculator, console."""

    size: Size = scaled(0.94, 1.06)
    screen: bool = False
    keys: bool = False
    white: bool = False
    pale: bool = when("white", True, chance(0.25))
    shown: Shown | None = when("screen", showing(40, 100))

    def assemble(self, b: Builder) -> None:
        x, y, z = self.size
        shell = g.rounded_box(self.size, radius=min(0.45 * z, 0.008), steps=2, inner=1)
        b.add(m.WHITE_PLASTIC if self.pale else m.BLACK_PLASTIC, shell, name="shell")
        if self.shown:
            b.add(m.SCREEN, g.box((0.93 * x, 0.93 * y, 0.0006), (0, 0, z + 0.0001)), name="screen")
            picture = display(0.45 * x, 0.45 * y).turned("x", -90).moved(z=z + 0.001)
            b.show(picture, self.shown)
        rows, columns = max(2, round(y / 0.02)), max(2, round(x / 0.014))
        for i in range(rows if self.keys else 0):
            for j in range(columns):
                across = (j - 0.5 * (columns - 1)) * 0.8 * x / columns
                at = (across, (i - 0.5 * (rows - 1)) * 0.8 * y / rows, z + 0.0001)
                b.add(m.RUBBER, g.box((0.5 * x / columns, 0.5 * y / rows, 0.0014), at), name="keys")


class Device(Thing, category="electronics"):
    """A device on its feet: speaker, router, radio, toaster, coffee machine, printer and so on."""

    size: Size = scaled(0.88, 1.12)
    detail: str = ""
    shell: Material = any_of(m.BLACK_PLASTIC, m.WHITE_PLASTIC, m.STEEL, "tinted")
    dials: int = by("detail", {"dials": whole(1, 4)}, 0)

    def assemble(self, b: Builder) -> None:
        x, y, z = self.size
        foot, radius = 0.004, min(0.14 * min(x, y, z), 0.02)
        body = g.rounded_box((x, y, z - foot), (0, 0, foot), radius, steps=2, inner=1)
        b.add(self.shell, body, name="shell")
        for side_x, side_y in g.CORNERS:
            at = (0.38 * side_x * x, 0.36 * side_y * y, 0.0)
            b.add(m.RUBBER, g.box((0.014, 0.014, foot + radius), at), name="feet")
        front = -0.5 * y
        dark = m.SCREEN if self.shell is not m.BLACK_PLASTIC else m.RUBBER
        for k in range(self.dials):
            knob = g.disc(min(0.12 * z, 0.13 * x), 0.0, 0.012, 18, 0.002)
            b.add(m.CHROME, knob.moved((k - 1) * 0.3 * x, front - 0.0002, 0.4 * z), name="dials")
        if self.detail == "display":
            screen = g.box((0.6 * x, 0.004, 0.45 * z), (0, front - 0.0021, 0.3 * z))
            b.add(dark, screen, name="display")
        elif self.detail == "cones":
            for high, r in ((0.36, 0.34), (0.74, 0.18)):
                cone = g.disc(r * min(x, 0.7 * z), 0.0, 0.006, 28, 0.002)
                b.add(dark, cone.moved(0, front - 0.0002, high * z), name="cones")
        elif self.detail == "slots":
            for back in (-0.17, 0.17):
                slot = g.box((0.75 * x, 0.14 * y, 0.001), (0, back * y, z + 0.0001))
                b.add(m.SCREEN, slot, name="slots")
            lever = g.box((0.02, 0.03, 0.014), (0.5 * x + 0.0102, 0, 0.6 * z), 0.003)
            b.add(m.BLACK_PLASTIC, lever, name="lever")
        elif self.detail == "spout":
            at = (0, front - 0.2 * y - 0.0002, 0.62 * z)
            b.add(dark, g.box((0.34 * x, 0.4 * y, 0.09 * z), at, 0.004), name="spout")
            at = (0, front - 0.25 * y - 0.0002, 0)
            b.add(m.STEEL, g.box((0.8 * x, 0.5 * y, 0.06 * z), at, 0.003), name="tray")
        elif self.detail == "aerials":
            for k in (-1, 1):
                ends = (0.35 * k * x, 0.3 * y, z), (0.45 * k * x, 0.32 * y, z + 0.12)
                b.add(self.shell, g.bar(*ends, 0.005, 10), name="aerials")
        elif self.detail == "paper":
            sheet = g.box((0.6 * x, 0.3 * y, 0.006), (0, front - 0.14 * y, 0.35 * z))
            b.add(_PAPER, sheet, name="paper")
            keys = g.box((0.2 * x, 0.05 * y, 0.004), (0.3 * x, -0.3 * y, z + 0.0001))
            b.add(dark, keys, name="keys")


class Charger(Thing, category="cable"):
    """A charger with its cable in loose loops."""

    plastic: Material = either(0.6, m.WHITE_PLASTIC, m.BLACK_PLASTIC)
    turns: int = whole(2, 4)
    size: float = between(0.04, 0.07)
    phase: float = between(0, 6)

    def assemble(self, b: Builder) -> None:
        t = np.linspace(0, self.turns, 14 * self.turns)
        radius = self.size * (0.35 + 0.65 * t / self.turns)
        radius = radius * (1 + 0.12 * np.sin(2.7 * t + self.phase))
        x, y = radius * np.cos(2 * np.pi * t) - radius[0], radius * np.sin(2 * np.pi * t)
        path = np.stack([x, y, np.full(len(t), 0.0026)], axis=1)
        b.add(self.plastic, g.tube(path, 0.0026, 7), name="cable")
        at = (float(path[-1][0]) + 0.0228, float(path[-1][1]) + 0.012, 0)
        b.add(self.plastic, g.rounded_box((0.045, 0.03, 0.026), at, 0.005, inner=1), name="plug")


class PowerCable(Spec, piece=("cable", "cable", "on_wall")):
    """A plug in a socket, an object of its own, and its cable to furniture at the wall.

    The origin is the socket's middle. The cable hangs to the side of the furniture at x = `run` and
    climbs behind it, in the gap to the wall, to z = `end`; metres.
    """

    run: float
    end: float
    plastic: Material = either(0.5, m.WHITE_PLASTIC, m.BLACK_PLASTIC)
    sag: float = between(0.07, 0.1)  # above the highest skirting

    @property
    def behind(self) -> float:
        """Place where the cable climbs, 5 cm behind the furniture."""
        return self.run + float(np.copysign(0.05, self.run))

    def assemble(self, b: Builder) -> None:
        with b.holding("socket", "switch"):
            plate = g.box((0.085, 0.01, 0.085), (0, -0.005, -0.0425), 0.003)
            b.add(m.WHITE_PLASTIC, plate, name="plate")
        b.add(self.plastic, g.disc(0.018, 0.0102, 0.045, 18, 0.003), name="plug")
        run, low, behind = self.run, -self.sag, self.behind
        corners = [
            *((0.0, -0.034, -0.012), (0.0, -0.036, -0.07), (0.3 * run, -0.03, low)),
            *((0.7 * run, -0.018, low), (run, _IN_GAP, -0.085), (behind, _IN_GAP, -0.04)),
            (behind, _IN_GAP, self.end),
        ]
        t, knots = np.linspace(0, len(corners) - 1, 60), np.arange(len(corners))
        path = np.stack([np.interp(t, knots, along) for along in zip(*corners, strict=True)], 1)
        path = ndimage.gaussian_filter1d(path, 3.0, axis=0, mode="nearest")
        b.add(self.plastic, g.tube(path, 0.0025, 8), name="cable")

    def build(self) -> FurniturePiece:
        over = float(np.copysign(0.01, self.run))
        gap, hanging = sorted((self.run, self.behind + over)), sorted((-over, self.run))
        boxes = [
            [[-0.0425, -0.05, -0.0425], [0.0425, 0.0, 0.0425]],
            [[hanging[0], -0.04, -0.11], [hanging[1], -0.002, -0.02]],
            [[gap[0], -0.0085, -0.12], [gap[1], -0.0005, self.end + 0.005]],
        ]
        return replace(super().build(), boxes=np.array(boxes))


_IN_GAP = -0.0045  # metres, of a cable in the gap between furniture and wall


class PowerStrip(Thing, category="cable", anchor="free"):
    """A strip of sockets with its cable, on the floor."""

    count: int = whole(3, 6)

    def assemble(self, b: Builder) -> None:
        long = 0.055 * self.count + 0.04
        b.add(m.WHITE_PLASTIC, g.box((long, 0.055, 0.04), (0, 0, 0), 0.005), name="strip")
        for k in range(self.count):
            x = (k - 0.5 * (self.count - 1)) * 0.055
            b.add(m.RUBBER, g.cylinder(0.02, 0.0401, 0.0408, 18).moved(x, 0, 0), name="sockets")
        t = np.linspace(0, 1, 24)
        path = np.stack([0.5 * long + 0.004 + 0.5 * t, 0.09 * np.sin(5 * t) * t, 0.0036 + 0 * t], 1)
        b.add(m.WHITE_PLASTIC, g.tube(path, 0.0035, 8), name="cable")


def _add_photo(b: Builder, frame: Material, photo: Print, size: Size, at: Size) -> None:
    """Add a photograph in a frame of a width, a height and degrees that it leans back."""
    x, z, lean = size
    rim = g.box((x, 0.014, z), bevel=0.002)
    sheet = g.box((x - 0.03, 0.001, z - 0.03), (0, -0.0076, 0.015))
    b.add(frame, rim.turned("x", -lean).moved(*at), name="frame")
    b.add(photo, sheet.turned("x", -lean).moved(*at), name="photo")


class Frame(Thing, category="picture"):
    """A photograph in a frame that stands on its prop."""

    x: float = between(0.1, 0.2)
    z: float = between(0.13, 0.24)
    frame: Material = any_of("wood", "metal", "lacquer")
    photo: Print = printed()

    def assemble(self, b: Builder) -> None:
        _add_photo(b, self.frame, self.photo, (self.x, self.z, 11.0), (0, 0, 0))
        prop = g.bar((0, 0.018, 0.5 * self.z), (0, 0.3 * self.z, 0.003), 0.003, 8)
        b.add(m.BLACK_PLASTIC, prop, name="prop")
        b.ground()


def _leaning(draw: Draw, ledge: Photos) -> Iterator[tuple[float, float, float, Material, Print]]:
    """Draw place, width, height, frame and photograph of each that there is room for."""
    style, at = ledge.style, -ledge.width / 2 + 0.01
    while True:
        x, z = draw.between(0.11, 0.2), draw.between(0.13, 0.26)
        if at + x > ledge.width / 2 - 0.01:
            return
        frame = draw.pick([style.wood, style.metal, style.dark_wood])
        yield at + 0.5 * x, x, z, frame, Print.draw(draw, style)
        at += x + draw.between(0.01, 0.06)


class Photos(Thing, category="shelf", anchor="on_wall"):
    """A ledge on the wall with framed photographs that lean at it, each an object of its own."""

    mount_height: float = between(1.3, 1.5)
    width: float = between(0.5, 0.8)
    body: Material = either(0.5, "wood", "lacquer")
    photos: tuple[tuple[float, float, float, Material, Print], ...] = drawn(
        lambda *of: tuple(_leaning(*of))
    )

    def assemble(self, b: Builder) -> None:
        half = self.width / 2
        b.add(self.body, g.span((-half, -0.09, -0.014), (half, 0, 0)), name="ledge")
        b.add(self.body, g.span((-half, -0.09, 0.0002), (half, -0.08, 0.02)), name="lip")
        for at, x, z, frame, photo in self.photos:
            with b.holding("framed photograph", "picture"):
                _add_photo(b, frame, photo, (x, z, 8.0), (at, -0.05, 0.0012))


class Rack(Thing, category="crockery"):
    """A dish rack with plates standing in it."""

    metal: Material = either(0.6, m.STEEL, "metal")
    glaze: Material = any_of("glazed")
    plates: tuple[float, ...] = repeated(whole(3, 8), between(0.085, 0.12))  # their radii

    def assemble(self, b: Builder) -> None:
        ring = [(-0.19, -0.14), (0.19, -0.14), (0.19, 0.14), (-0.19, 0.14)]
        for z in (0.012, 0.1):
            for start, end in zip(ring, (*ring[1:], ring[0]), strict=True):
                b.add(self.metal, g.bar((*start, z), (*end, z), 0.003, 8), name="rack")
        for corner in ring:
            b.add(self.metal, g.bar((*corner, 0.0), (*corner, 0.1), 0.0032, 8), name="rack")
        for k, radius in enumerate(self.plates):
            plate = g.cylinder(radius, 0.0, 0.006, 30, 0.002).turned("y", 82)
            low = float(plate.vertices[:, 2].min())
            b.add(self.glaze, plate.moved(-0.14 + 0.036 * k, 0, 0.016 - low), name="plates")


class Board(Thing, category="clutter"):
    """A chopping board with a knife, a tray, or a placemat."""

    size: Size = scaled(0.88, 1.12, (0.36, 0.24, 0.018))

    def assemble(self, b: Builder) -> None:
        z = self.size[2] + 0.0002
        b.add(self.style.wood, g.box(self.size, bevel=0.004), name="board")
        if self.name == "chopping board":
            b.add(m.STEEL, g.box((0.18, 0.03, 0.0016), (-0.04, 0.01, z)), name="blade")
            grip = g.box((0.1, 0.024, 0.014), (0.1005, 0.01, z), 0.004)
            b.add(m.BLACK_PLASTIC, grip, name="grip")


class Knives(Thing, category="clutter"):
    """A block of knives."""

    def assemble(self, b: Builder) -> None:
        b.add(self.style.wood, g.box((0.1, 0.14, 0.2), bevel=0.005), name="block")
        for k in range(5):
            at = (-0.03 + 0.03 * (k % 3), -0.03 + 0.06 * (k // 3), 0.2002)
            b.add(m.BLACK_PLASTIC, g.box((0.016, 0.022, 0.09), at, 0.004), name="grips")


class Cleaner(Thing, category="clutter"):
    """A sponge with a side that scours."""

    def assemble(self, b: Builder) -> None:
        foam = Material("paper", m.hex_color("#d9b93a"), 0.95, family="corrugated")
        b.add(foam, g.box((0.1, 0.065, 0.028), bevel=0.003), name="foam")
        scourer = Material("carpet", m.hex_color("#3a6a3a"), 0.95, family="loop")
        b.add(scourer, g.box((0.1, 0.065, 0.008), (0, 0, 0.0281), 0.001), name="scourer")


class Eggs(Thing, category="food"):
    """Eggs in their tray."""

    def assemble(self, b: Builder) -> None:
        b.add(CARDBOARD, g.box((0.15, 0.1, 0.03), bevel=0.006), name="tray")
        shell = Material("ceramic", m.hex_color("#c9966a"), 0.6, family="earthenware")
        for k in range(6):
            at = (-0.048 + 0.048 * (k % 3), -0.024 + 0.048 * (k // 3), 0.046)
            b.add(shell, g.sphere(0.021, 16, 10).scaled(z=1.25).moved(*at), name="eggs")


class Fixture(Thing, category="clutter", anchor="on_wall"):
    """A plate on the wall: socket, switch, thermostat, vent, intercom."""

    size: Size
    height: float
    holes: int

    def assemble(self, b: Builder) -> None:
        b.category = "switch" if self.name in ("socket", "switch") else "fitting"
        b.mount_height = self.height
        x, y, z = self.size
        plate = g.box((x, y, z), (0, -0.5 * y, 0), min(0.003, 0.3 * y))
        b.add(m.WHITE_PLASTIC, plate, name="plate")
        places = [(k - 0.5 * (self.holes - 1)) for k in range(self.holes)]
        if self.name == "socket":
            for at in places:
                ring = g.disc(0.02, 0.0, 0.001, 20).moved(at * x / self.holes, -y - 0.0001, 0.5 * z)
                b.add(m.RUBBER, ring, name="sockets")
        elif self.name == "switch":
            for at in places:
                place = (at * 0.9 * x / self.holes, -y - 0.0026, 0.14 * z)
                rockers = g.box((0.75 * x / self.holes, 0.005, 0.72 * z), place, 0.0015)
                b.add(m.WHITE_PLASTIC, rockers, name="rockers")
        elif self.name == "vent":
            for k in range(6):
                slat = g.box((0.84 * x, 0.004, 0.05 * z), (0, -y - 0.0021, (0.13 + 0.14 * k) * z))
                b.add(m.RUBBER, slat, name="slats")
        else:
            screen = g.box((0.55 * x, 0.002, 0.4 * z), (0, -y - 0.0011, 0.4 * z))
            b.add(m.SCREEN, screen, name="display")


class Detector(Thing, category="fitting", anchor="ceiling"):
    """A smoke detector under the ceiling."""

    r: float = between(0.045, 0.06)

    def assemble(self, b: Builder) -> None:
        case = g.cylinder(0.75 * self.r, -0.036, 0.0, 28, 0.004, top=1.33)
        b.add(m.WHITE_PLASTIC, case, name="case")
        lamp = g.sphere(0.0025, 8, 6).moved(0.4 * self.r, 0, -0.0365)
        b.add(Material("plastic", m.hex_color("#8a1a14"), 0.3), lamp, name="lamp")


def _scattered(draw: Draw, bricks: Bricks) -> Iterator[tuple[float, float, int, float, Material]]:
    """Draw place, level, direction and paint of each brick."""
    used: list[tuple[float, float]] = []
    for k in range(draw.whole(6, 16)):
        x, y = draw.between(-0.2, 0.2), draw.between(-0.2, 0.2)
        if any(abs(x - a) + abs(y - c) < 0.09 for a, c in used):
            continue
        used.append((x, y))
        tall = draw.whole(1, 4) if k < 3 else 1
        for level in range(tall):
            paint = bricks.style.tinted(draw)
            yield x, y, level, draw.between(0, 180) if tall == 1 else 90.0 * level, paint


class Bricks(Thing, category="toy", anchor="free"):
    """A scatter of building bricks around a little tower."""

    bricks: tuple[tuple[float, float, int, float, Material], ...] = drawn(
        lambda draw, bricks: tuple(_scattered(draw, bricks))
    )

    def assemble(self, b: Builder) -> None:
        for x, y, level, turn, paint in self.bricks:
            brick = g.box((0.06, 0.03, 0.03), (0, 0, 0), 0.002).turned("z", turn)
            b.add(paint, brick.moved(x, y, 0.0301 * level), name="bricks")


class Car(Thing, category="toy"):
    """A toy car or train of two."""

    paints: tuple[tuple[Material, Material], ...] = repeated(  # of body and cabin
        by("name", {"toy train": 2}, 1), any_of("tinted"), any_of("tinted")
    )

    def assemble(self, b: Builder) -> None:
        wheel = g.cylinder(0.013, 0.0, 0.01, 16, 0.002).turned("x", 90)
        for k, (paint, other) in enumerate(self.paints):
            x = 0.12 * k
            b.add(paint, g.box((0.1, 0.05, 0.025), (x, 0, 0.012), 0.006), name="body")
            b.add(other, g.box((0.05, 0.044, 0.024), (x + 0.006, 0, 0.0372), 0.006), name="cabin")
            for side, end in g.CORNERS:
                at = (x + 0.03 * end, side * 0.0305 + 0.005, 0.013)
                b.add(m.RUBBER, wheel.moved(*at), name="wheels")


class Teddy(Thing, category="toy"):
    """A stuffed animal that sits."""

    color: str = pick("#8a6240", "#b59a78", "#77706a")
    s: float = between(0.8, 1.3)

    def _ball(self, r: float, x: float, y: float, z: float, tall: float = 1.0) -> g.BodyMesh:
        s = self.s
        return g.sphere(r * s, 16, 10).scaled(z=tall).moved(x * s, y * s, z * s)

    def assemble(self, b: Builder) -> None:
        ball, plush = self._ball, Material("fabric", m.hex_color(self.color), 0.95, family="boucle")
        b.add(plush, ball(0.07, 0, 0, 0.077, 1.1), ball(0.055, 0, 0, 0.19), name="body")
        for side in (-1, 1):
            ear, leg = ball(0.02, side * 0.042, 0, 0.235), ball(0.03, side * 0.05, -0.085, 0.03)
            b.add(plush, ear, leg, ball(0.026, side * 0.08, -0.02, 0.1, 1.5), name="limbs")
            b.add(m.BLACK_PLASTIC, ball(0.006, side * 0.02, -0.05, 0.205), name="eyes")
        b.add(m.BLACK_PLASTIC, ball(0.008, 0, -0.055, 0.185), name="nose")


class Ball(Thing, category="toy", anchor="free"):
    """A ball or a globe without its stand."""

    radius: float = scaled(0.9, 1.1)
    accent: Material = any_of("accents")

    def assemble(self, b: Builder) -> None:
        skin = Material("leather", self.accent.color, 0.4, family="pebbled")
        b.add(skin, g.sphere(self.radius, 26, 16).moved(z=self.radius), name="ball")


class Dumbbells(Thing, category="toy", anchor="free"):
    """A pair of dumbbells."""

    def assemble(self, b: Builder) -> None:
        weight = g.cylinder(0.045, -0.025, 0.025, 26, 0.005).turned("y", 90)
        for y in (-0.065, 0.065):
            b.add(m.CHROME, g.bar((-0.07, y, 0.045), (0.07, y, 0.045), 0.013, 14), name="bars")
            for side in (-1, 1):
                b.add(m.RUBBER, weight.moved(side * 0.0952, y, 0.045), name="weights")


class Pages(Thing, category="books"):
    """An open book, face up."""

    x: float = between(0.13, 0.18)
    y: float = between(0.19, 0.26)
    cover: Material = any_of("books")

    def assemble(self, b: Builder) -> None:
        x, y = self.x, self.y
        b.add(self.cover, g.box((2 * x + 0.012, y + 0.008, 0.004)), name="cover")
        for side in (-1, 1):
            half = g.box((x, y, 0.012), (side * (0.5 * x + 0.0006), 0, 0.0042), 0.0025)
            b.add(m.PAGES, half, name="pages")
