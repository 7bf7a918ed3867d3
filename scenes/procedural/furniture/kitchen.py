"""Kitchen units of equal height and depth, appliances and pots.

Units are placed side by side: each is exactly `width` wide, worktop included. Backs are at
y = 0.3, doors at y = -0.3, front edges of worktops at y = -0.32.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.procedural.furniture import materials as m
from pbrnet.scenes.procedural.furniture.cabinets import (
    BOARD,
    add_door,
    add_drawers,
    add_grip,
    carcass,
    pulled_out,
    shelf,
)
from pbrnet.scenes.procedural.furniture.parts import geometry as g
from pbrnet.scenes.procedural.furniture.parts.build import Builder
from pbrnet.scenes.procedural.furniture.spec import (
    Spec,
    any_of,
    between,
    chance,
    drawn,
    either,
    maybe,
    optional,
    pick,
    repeated,
    several,
    when,
    whole,
)
from pbrnet.scenes.procedural.piece import Material

DEPTH = 0.6
PLINTH = 0.1
TOP = 0.038
INSIDE = Material("paint", m.hex_color("#dedad2"), 0.5)
Depths = tuple[float, float, float]  # two heights and the depth of doors


class Doors(Spec):
    """One or two doors, one of them ajar with a mean probability of `share`."""

    share: float = 0.2
    angle: float = maybe(
        lambda doors: doors.share * (0.2 + 1.6 * doors.style.disorder), between(15, 75), 0.0
    )

    def add_to(
        self, b: Builder, width: float, more: Depths, low: bool = False, handed: str = "left"
    ) -> None:
        """Add the doors over a width; `low`: with handles at their lower ends."""
        half, door = width / 2, (b, self.style, self.style.kitchen)
        if width > 0.62:
            add_door(*door, -half, 0, *more, "left", self.angle, low)
            add_door(*door, 0, half, *more, "right", 0.0, low)
        else:
            add_door(*door, -half, half, *more, handed, self.angle, low)


def _doors(share: float = 0.2) -> Any:
    """A field of doors."""
    return drawn(lambda draw, spec: Doors.draw(draw, spec.style, share=share))


class Unit(Spec):
    """Parts that base units share: plinth, carcass, worktop; `width` includes the worktop."""

    width: float = 0.6

    @property
    def under(self) -> float:
        """Height of the worktop's underside, metres."""
        return self.style.worktop_height - TOP

    def add_body(
        self, b: Builder, holes: tuple[Float64Array, ...] = (), bare: bool = False
    ) -> None:
        """Add plinth and worktop, and the carcass unless it is `bare`."""
        half, style, high = self.width / 2, self.style, self.style.worktop_height
        low = (-half + 0.001, -DEPTH / 2 + 0.06, 0)
        plinth = g.span(low, (half - 0.001, -DEPTH / 2 + 0.078, PLINTH + 0.001))
        b.add(style.kitchen, plinth, name="plinth")
        if holes:
            outline = np.array([[-1, -0.32], [1, -0.32], [1, 0.3], [-1, 0.3]]) * [half, 1]
            top = g.prism(outline, high - TOP, high, holes)
        else:
            top = g.span((-half, -0.32, high - TOP), (half, 0.3, high), grain="x")
        b.add(style.worktop, top, name="worktop")
        if not bare:
            b.add(INSIDE, *carcass(self.width, DEPTH, PLINTH, self.under - 0.001))


class BaseCupboard(Unit, piece=("base cupboard", "kitchen unit", "wall"), front_clearance=0.9):
    """A base unit with doors, often with a drawer at the top; a door may be ajar."""

    drawer: bool = chance(0.6)
    pulled: float = when("drawer", maybe(0.12, between(0.08, 0.25), 0.0), 0.0)
    handed: str = drawn(lambda draw, spec: "left" if draw.chance(0.5) else "right")
    doors: Doors = _doors()

    def assemble(self, b: Builder) -> None:
        self.add_body(b)
        width, under = self.width, self.under
        split = under - 0.003
        if self.drawer:
            split = under - 0.15
            zs, out = (split, under - 0.002), (self.pulled,)
            add_drawers(b, self.style, self.style.kitchen, INSIDE, width / 2, zs, DEPTH, out)
        self.doors.add_to(b, width, (PLINTH, split, DEPTH), handed=self.handed)
        level = 0.5 * (PLINTH + split)
        b.add(INSIDE, shelf(width, DEPTH, level))
        if self.doors.angle > 0:
            with b.holding("pot", "pot"):
                b.add(m.STEEL, _pot(0.11, 0.12).moved(-0.1 * width, 0, level), name="pots")
            b.add(m.CERAMIC, _plates(5).moved(0.0, 0, PLINTH + BOARD), name="plates")
        b.surface(0, 0, self.style.worktop_height, width / 2 - 0.02, 0.27)


class DrawerUnit(Unit, piece=("drawer unit", "kitchen unit", "wall"), front_clearance=0.9):
    """A base unit with three or four drawers, sometimes one pulled out."""

    shares: tuple[float, ...] = maybe(0.5, (0.0, 0.42, 0.78, 1.0), (0.0, 0.3, 0.6, 0.8, 1.0))
    pulled: tuple[float, ...] = pulled_out(lambda unit: len(unit.shares) - 1, 0.08, 0.28)

    def assemble(self, b: Builder) -> None:
        self.add_body(b)
        half = self.width / 2
        zs = PLINTH + (self.under - 0.002 - PLINTH) * np.array(self.shares)
        add_drawers(b, self.style, self.style.kitchen, INSIDE, half, zs, DEPTH, self.pulled)
        b.surface(0, 0, self.style.worktop_height, half - 0.02, 0.27)


class SinkUnit(Unit, piece=("sink unit", "kitchen unit", "wall"), front_clearance=0.9):
    """A base unit with doors, a sink in the worktop and a high tap."""

    width: float = 0.8
    side: float = pick(-1.0, 1.0)
    tap: Material = either(0.7, m.CHROME, "metal")
    doors: Doors = _doors()

    def assemble(self, b: Builder) -> None:
        width, high = self.width, self.style.worktop_height
        half_x, half_y, y = min(0.2, width / 2 - 0.08), 0.19, -0.04
        x = self.side * max(0.0, width / 2 - 0.1 - half_x)
        hole = g.superellipse(half_x, half_y, 0, 7, 40, x, y)[:, :2]
        self.add_body(b, (hole,), bare=True)
        basin = (  # beyond the hole, above the worktop, power
            *((-0.03, -0.19, 4.0), (-0.008, -0.17, 6.0), (-0.004, 0.0005, 7.0)),
            *((0.014, 0.0005, 7.0), (0.014, 0.003, 7.0), (-0.008, 0.003, 7.0)),
            *((-0.014, -0.15, 6.0), (-0.035, -0.178, 4.0)),
        )
        rings = [
            g.superellipse(half_x + grow, half_y + grow, high + z, power, 40)
            for grow, z, power in basin
        ]
        b.add(m.STEEL, g.loft(rings).moved(x, y), name="sink")
        b.add(m.IRON, g.cylinder(0.04, -0.1785, -0.1755, 24).moved(x, y, high), name="drain")
        self._add_tap(b, x, high)
        b.add(INSIDE, *carcass(width, DEPTH, PLINTH, self.under - 0.001, top=False))
        self.doors.add_to(b, width, (PLINTH, self.under - 0.003, DEPTH))
        free = width / 2 + abs(x) - half_x - 0.04
        if free > 0.16:
            at = -float(np.sign(x)) * (width / 2 - free / 2)
            b.surface(at, -0.02, high, free / 2 - 0.01, 0.24)

    def _add_tap(self, b: Builder, x: float, high: float) -> None:
        t = np.linspace(0, np.pi, 12)
        arch = np.stack([0 * t, 0.225 - 0.1 + 0.1 * np.cos(t), 0.28 + 0.1 * np.sin(t)], axis=1)
        path = np.concatenate([[[0, 0.225, 0.0], [0, 0.225, 0.2]], arch, [[0, 0.025, 0.22]]])
        spout = g.tube(path, 0.0125, 12).moved(x, 0, high - 0.001)
        foot = g.cylinder(0.026, 0, 0.05, 20, 0.003).moved(x, 0.225, high)
        lever = g.bar((x + 0.015, 0.225, high + 0.075), (x + 0.085, 0.205, high + 0.105), 0.006, 8)
        with b.holding("tap", "fitting"):
            b.add(self.tap, spout, foot, lever, name="tap")


_PLATES = (  # x, y, radius
    *((-0.145, -0.14, 0.075), (0.145, -0.14, 0.095)),
    *((-0.145, 0.11, 0.095), (0.145, 0.11, 0.075)),
)


class PotOnHob(Spec):
    """A pot on one of the four plates of a hob."""

    place: tuple[float, float, float] = pick(*_PLATES)
    body: Material = either(0.6, m.STEEL, "accent")
    height: float = between(0.09, 0.15)
    lid: bool = chance(0.5)


class HobUnit(Unit, piece=("hob and oven", "kitchen unit", "wall"), front_clearance=0.9):
    """An oven with knobs below a gas or glass-ceramic hob."""

    front: Material = either(0.6, m.STEEL, m.BLACK_PLASTIC)
    gas: bool = chance(0.5)
    pot: PotOnHob | None = optional(0.14, PotOnHob)

    def assemble(self, b: Builder) -> None:
        self.add_body(b)
        high = self.style.worktop_height
        self._add_oven(b)
        hob = g.box((min(0.58, self.width - 0.02), 0.51, 0.007), (0, -0.02, high), 0.002)
        b.add(m.STEEL if self.gas else m.SCREEN, hob, name="hob")
        for x, y, radius in _PLATES:
            (self._add_burner if self.gas else self._add_ring)(b, x, y, high, radius)
        if self.pot:
            x, y, _ = self.pot.place
            z = high + (0.0405 if self.gas else 0.0083)
            pot = _pot(0.1, self.pot.height, self.pot.lid).moved(x, y, z)
            with b.holding("pot on the hob", "pot"):
                b.add(self.pot.body, pot, name="pot")

    def _add_oven(self, b: Builder) -> None:
        half, under, f, panel = self.width / 2, self.under, -DEPTH / 2, 0.1
        low, high = PLINTH + 0.1, under - panel - 0.004

        def board(z0: float, z1: float, bevel: float) -> g.BodyMesh:
            return g.span((-half + 0.002, f, z0), (half - 0.002, f + 0.019, z1), bevel)

        b.add(self.front, board(under - panel, under - 0.003, 0.002), name="panel")
        knob = g.lathe([(0.019, -0.002), (0.018, 0.016), (0.014, 0.02), (0.0, 0.02)], 20)
        for k in range(5):
            at = ((k - 2) * 0.095, f, under - panel / 2)
            b.add(m.IRON, knob.turned("x", 90).moved(*at), name="knobs")
        b.add(self.front, board(low, high, 0.002), name="door")
        corner = (-half + 0.05, f - 0.002, low + 0.05)
        b.add(m.SCREEN, g.span(corner, (half - 0.05, f + 0.001, high - 0.075)), name="window")
        z = high - 0.035
        ends, feet = (((-x, z), (x, z)) for x in (half - 0.06, half - 0.09))
        add_grip(b, ends, feet, (f + 0.002, f - 0.042), (0.009, 0.007))
        swings = (-half, -0.055, 0.0), (half, 0.02, high - low)
        b.hinge((0.0, f, low), (1.0, 0.0, 0.0), 0.0, swings)
        b.add(self.style.kitchen, board(PLINTH + 0.002, low - 0.004, 0.0015), name="front")

    def _add_burner(self, b: Builder, x: float, y: float, high: float, radius: float) -> None:
        profile = [(0.5 * radius, 0.006), (0.48 * radius, 0.02), (0.4 * radius, 0.026), (0, 0.027)]
        b.add(m.IRON, g.lathe(profile, 24).moved(x, y, high), name="burners")
        arm = g.bar((0.3 * radius, 0, 0.036), (1.25 * radius, 0, 0.036), 0.004, 8)
        foot = g.bar((1.25 * radius, 0, 0.006), (1.25 * radius, 0, 0.0385), 0.004, 8)
        for turn in range(4):
            for mesh in (arm, foot):
                b.add(m.IRON, mesh.turned("z", 45 + 90 * turn).moved(x, y, high), name="grates")

    def _add_ring(self, b: Builder, x: float, y: float, high: float, radius: float) -> None:
        angle = 2 * np.pi * np.arange(40) / 40
        ring = np.stack([radius * np.cos(angle), radius * np.sin(angle), 0 * angle], axis=1)
        b.add(m.IRON, g.tube(ring, 0.0012, 8, closed=True).moved(x, y, high + 0.0068), name="rings")


class Note(Spec):
    """A note on the door of a fridge."""

    x: float = between(-0.2, 0.2)
    z: float = between(1.15, 1.5)
    paper: Material = either(0.4, "picture", Material("paper", (0.8, 0.75, 0.5), 0.9))

    def add_to(self, b: Builder, front: float, split: float) -> None:
        """Add the note and its magnet to the front, on one of the doors that meet at `split`."""
        x, z = self.x, split + 0.075 if abs(self.z - split) < 0.075 else self.z
        board = g.span((x - 0.05, front - 0.0012, z - 0.06), (x + 0.05, front - 0.0004, z + 0.06))
        if self.paper.kind == "picture":
            u = (board.vertices[:, 0] - x) / 0.1 + 0.5
            v = (board.vertices[:, 2] - z) / 0.12 + 0.5
            board = g.BodyMesh(board.vertices, board.faces, np.stack([u, v], 1), smooth=False)
        magnet = g.cylinder(0.011, 0, 0.006, 14).turned("x", 90).moved(x, front - 0.001, z + 0.045)
        with b.holding("note", "paper"):
            b.add(self.paper, board, name="note")
            b.add(self.style.accents[1], magnet, name="magnet")


class Fridge(Spec, piece=("fridge", "fridge", "wall"), front_clearance=0.9):
    """A tall fridge with a freezer compartment below or above."""

    width: float = 0.6
    height: float = between(1.7, 1.95)
    case: Material = either(0.45, m.STEEL, m.WHITE_PAINT)
    freezer_below: bool = chance(0.7)
    side: float = pick(-1.0, 1.0)
    has_notes: bool = chance(0.14)
    notes: tuple[Note, ...] = when("has_notes", several(Note, 2, 5), ())

    def assemble(self, b: Builder) -> None:
        depth, height, half, case = 0.64, self.height, self.width / 2, self.case
        f = -depth / 2
        b.add(case, g.span((-half, f + 0.065, 0.03), (half, depth / 2, height), 0.006), name="case")
        foot = g.span((-half + 0.01, f + 0.08, 0), (half - 0.01, depth / 2 - 0.02, 0.031))
        b.add(m.BLACK_PLASTIC, foot, name="foot")
        split = 0.36 * height if self.freezer_below else 0.66 * height
        for z0, z1 in ((0.06, split), (split + 0.006, height - 0.002)):
            size, at = (self.width - 0.002, 0.06, z1 - z0), (0, f + 0.03, z0)
            b.add(case, g.rounded_box(size, at, 0.012, inner=1), name="door")
            length = min(0.4, 0.6 * (z1 - z0))
            start = z1 - 0.05 - length if (z1 == split) else z0 + 0.05
            x = self.side * (half - 0.05)
            ends = ((x, start), (x, start + length))
            feet = ((x, start + 0.03), (x, start + length - 0.03))
            add_grip(b, ends, feet, (f + 0.003, f - 0.035), (0.009, 0.006))
            left, right = (-2 * half, 0.0) if self.side < 0 else (0.0, 2 * half)
            swings = (left, -0.05, 0.0), (right, 0.061, z1 - z0)
            b.hinge((-self.side * half, f, z0), (0.0, 0.0, -self.side), 0.0, swings)
        for note in self.notes:
            note.add_to(b, f, split)
        b.surface(0, 0.03, height, half - 0.05, depth / 2 - 0.08)


class WallCupboard(Spec, piece=("wall cupboard", "kitchen unit", "on_wall")):
    """A wall cupboard, with crockery if a door is ajar; the origin is on its lower back edge."""

    width: float = 0.6
    handed: str = drawn(lambda draw, spec: "left" if draw.chance(0.5) else "right")
    doors: Doors = _doors(0.3)
    glaze: Material | None = when(lambda cupboard: cupboard.doors.angle, any_of("accents"))
    # On each level.
    plates: tuple[int, ...] = repeated(lambda spec: 3 if spec.doors.angle else 0, whole(3, 8))

    def assemble(self, b: Builder) -> None:
        depth, height, width, levels = 0.34, 0.7, self.width, (0.24, 0.47)
        mount_height = self.style.worktop_height + 0.52
        b.mount_height = mount_height
        b.add(self.style.kitchen, *carcass(width, depth, 0, height))
        for z in levels:
            b.add(INSIDE, shelf(width, depth, z))
        self.doors.add_to(b, width, (0.0, height, depth), low=True, handed=self.handed)
        profile = [(0.03, 0), (0.04, 0.012), (0.043, 0.085), (0.039, 0.085), (0.034, 0.014)]
        cup = g.lathe([*profile, (0, 0.01)], 20)
        for z, count in zip((BOARD, *levels), self.plates, strict=False):
            b.add(m.CERAMIC, _plates(count).moved(-0.2 * width, 0.01, z), name="plates")
            for k in range(2):
                at = (0.22 * width, -0.06 + 0.11 * k, z)
                b.add(self.glaze or m.CERAMIC, cup.moved(*at), name="cups")
        b.move(y=-depth / 2)


class ExtractorHood(Spec, piece=("extractor hood", "extractor hood", "on_wall"), mount_height=1.58):
    """A steel canopy with a flue and two small lamps; `height` of the flue's upper end, metres."""

    width: float = 0.6
    height: float = 0.9
    steel: Material = either(0.8, m.STEEL, m.WHITE_PAINT)
    top: float = between(0.2, 0.34)

    def assemble(self, b: Builder) -> None:
        width, steel, top = self.width, self.steel, self.top
        b.add(
            steel,
            g.post([(0, -0.25, 0.0), (0, -0.25, 0.05)], [(width, 0.5)] * 2),
            g.post([(0, -0.2495, 0.0505), (0, -0.14, top)], [(width - 0.002, 0.499), (0.28, 0.28)]),
            g.box((0.26, 0.26, self.height - top + 0.005), (0, -0.1305, top - 0.005), 0.002),
            name="hood",
        )
        b.add(m.IRON, g.box((width - 0.06, 0.4, 0.004), (0, -0.25, -0.003)), name="filter")
        for k in range(int((width - 0.1) / 0.03)):
            x = -width / 2 + 0.065 + 0.03 * k
            b.add(steel, g.box((0.012, 0.3, 0.003), (x, -0.22, -0.0055)), name="filter")
        kelvin = self.style.kelvin + 300
        for side in (-1, 1):
            lamp = g.cylinder(0.03, -0.0065, -0.0005, 24).moved(side * (width / 2 - 0.14), -0.42)
            b.add(m.WHITE_PAINT, lamp, name="diffuser", lumens=260.0, kelvin=kelvin)
        for k in range(3):
            button = g.cylinder(0.009, 0, 0.004, 14).turned("x", 90)
            b.add(m.BLACK_PLASTIC, button.moved((k - 1) * 0.035, -0.4995, 0.025), name="buttons")


def _pot(radius: float, height: float, lid: bool = False) -> g.BodyMesh:
    """Pot with two handles, open or with a lid."""
    profile = [(radius - 0.006, 0.0), (radius, 0.006), (radius, height), (radius - 0.003, height)]
    if not lid:
        meshes = [g.lathe([*profile, (radius - 0.006, 0.01), (0.0, 0.008)], 32)]
    else:
        cover = [(0.92 * radius, height + 0.008), (0.03, height + 0.022), (0, height + 0.022)]
        meshes = [
            g.lathe([*profile[:3], *cover], 32),
            g.cylinder(0.006, height + 0.015, height + 0.036, 10),
            g.sphere(0.017, 14, 8).scaled(z=0.7).moved(z=height + 0.042),
        ]
    t = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 8)
    for side in (-1, 1):
        ear = np.stack(
            [side * (radius - 0.003 + 0.03 * np.cos(t)), 0.035 * np.sin(t), 0 * t + 0.75 * height],
            axis=1,
        )
        meshes.append(g.tube(ear, 0.005, 8))
    return g.merge(meshes)


def _plates(count: int) -> g.BodyMesh:
    plate = [
        (0.06, 0.0), (0.068, 0.004), (0.105, 0.016), (0.106, 0.019), (0.068, 0.008), (0.0, 0.007),
    ]  # fmt: skip
    return g.merge([g.lathe(plate, 28).moved(z=0.0075 * k) for k in range(count)])


class CookingPot(Spec, piece=("cooking pot", "pot", "on_top")):
    """A pot with a lid."""

    body: Material = either(0.5, m.STEEL, "accents")
    radius: float = between(0.09, 0.13)
    height: float = between(0.09, 0.16)

    def assemble(self, b: Builder) -> None:
        b.add(self.body, _pot(self.radius, self.height, True))


class Kettle(Spec, piece=("kettle", "kettle", "on_top")):
    """An electric kettle on its base."""

    body: Material = either(0.6, m.STEEL, "accents")

    def assemble(self, b: Builder) -> None:
        b.add(m.BLACK_PLASTIC, g.cylinder(0.08, 0, 0.018, 32, bevel=0.004), name="base")
        profile = [(0.075, 0.0185), (0.078, 0.03), (0.066, 0.16), (0.056, 0.2), (0.05, 0.207)]
        b.add(self.body, g.lathe([*profile, (0, 0.212)], 32), name="body")
        b.add(m.BLACK_PLASTIC, g.sphere(0.012, 12, 8).moved(z=0.217), name="knob")
        path = [(0.055, 0.195), (0.095, 0.2), (0.118, 0.17), (0.115, 0.1), (0.073, 0.05)]
        b.add(m.BLACK_PLASTIC, g.tube([(x, 0, z) for x, z in path], 0.01, 10), name="handle")
        curve = [(-0.05, 0, 0.15), (-0.085, 0, 0.19), (-0.095, 0, 0.2)]
        spout = g.tube(curve, [0.022, 0.014, 0.011], 12)
        b.add(self.body, spout, name="body")


class Microwave(Spec, piece=("microwave", "microwave", "on_top")):
    """A microwave oven."""

    width: float = between(0.44, 0.52)
    depth: float = between(0.34, 0.39)
    height: float = between(0.26, 0.3)
    case: Material = maybe(0.5, m.STEEL, either(0.5, m.BLACK_PLASTIC, m.WHITE_PAINT))

    def assemble(self, b: Builder) -> None:
        half, depth, height, case = self.width / 2, self.depth, self.height, self.case
        f = -depth / 2
        body = g.span((-half, f + 0.012, 0.012), (half, depth / 2, height), 0.004)
        b.add(case, body, name="case")
        door = g.span((-half, f, 0.014), (half - 0.122, f + 0.0115, height - 0.002), 0.003)
        b.add(case, door, name="door")
        corner = (-half + 0.035, f - 0.0015, 0.05)
        b.add(m.SCREEN, g.span(corner, (half - 0.16, f + 0.001, height - 0.04)), name="window")
        panel = g.span((half - 0.12, f, 0.014), (half, f + 0.0115, height - 0.002), 0.002)
        b.add(m.BLACK_PLASTIC, panel, name="panel")
        for row in range(4):
            for column in range(3):
                at = (half - 0.09 + 0.03 * column, f, 0.05 + 0.035 * row)
                b.add(m.STEEL, g.box((0.02, 0.003, 0.018), at), name="keys")
        x = half - 0.14
        ends, feet = ((x, 0.05), (x, height - 0.05)), ((x, 0.07), (x, height - 0.07))
        add_grip(b, ends, feet, (f + 0.002, f - 0.025), (0.007, 0.005), segments=8)
        swings = (0.0, -0.035, 0.0), (2 * half - 0.121, 0.012, height)
        b.hinge((-half, f, 0.014), (0.0, 0.0, -1.0), 0.0, swings)
        for sx, sy in g.CORNERS:
            x, y = sx * (half - 0.04), sy * (depth / 2 - 0.05)
            b.add(m.BLACK_PLASTIC, g.cylinder(0.014, 0, 0.013, 12).moved(x, y), name="feet")
