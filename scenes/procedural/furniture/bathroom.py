"""Bathroom fittings."""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.procedural.furniture import materials as m
from pbrnet.scenes.procedural.furniture.cabinets import add_door, add_drawers, carcass
from pbrnet.scenes.procedural.furniture.parts import geometry as g
from pbrnet.scenes.procedural.furniture.parts.build import Builder
from pbrnet.scenes.procedural.furniture.parts.cloth import plane, surface
from pbrnet.scenes.procedural.furniture.parts.drapes import (
    Hanging,
    Ripples,
    dropped,
    hanging,
    hung,
    ripples,
)
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
    when,
)
from pbrnet.scenes.procedural.piece import Material


def _tap(spout: float, height: float) -> g.BodyMesh:
    """Basin mixer at the origin, spout towards the front (-Y)."""
    t = np.linspace(0, 0.5 * np.pi, 6)
    bend = np.stack([0 * t, -0.05 + 0.05 * np.cos(t), height - 0.05 + 0.05 * np.sin(t)], axis=1)
    path = np.concatenate([[[0, 0, 0.0]], bend, [[0, -spout, height - 0.012]]])
    ends = (0, -spout + 0.008, height - 0.006), (0, -spout + 0.004, height - 0.034)
    lever = g.bar((0, -0.008, height), (0, 0.035, height + 0.035), 0.005, 8)
    foot = g.cylinder(0.023, 0, 0.014, 20, bevel=0.003)
    return g.merge([foot, g.tube(path, 0.0125, 12), g.bar(*ends, 0.0105, 10), lever])


class Towel(Spec):
    """A towel dropped over the rim of a bath."""

    long: float = between(0.7, 0.9)
    out: float = between(0.0, 0.05)
    turn: float = drawn(lambda draw, spec: draw.normal(0, 5))
    tight: float = between(0.04, 0.15)
    ripples: Ripples = drawn(lambda draw, spec: ripples(draw))

    def mesh(self, tub: Float64Array, x: float, y: float, z: float) -> g.BodyMesh:
        """The towel over the rim at (x, y, z) of a tub of triangles (N, 3, 3)."""
        near = (np.abs(tub[..., 0] - x).min(axis=1) < 0.35) & (tub[..., 1].min(axis=1) < 0.3)
        bodies, size = [surface(tub[near], 0.012), plane(2, 0.02)], (0.42, self.long)
        at, tight = (x, y - self.out, z + 0.06), self.tight
        return dropped(self.ripples, bodies, size, at, turn=self.turn, tight=tight, thickness=0.008)


class BathTub(Spec, piece=("bath tub", "bath", "wall"), front_clearance=0.5):
    """A bath along the wall, `width` long, with a mixer and hand shower on its rim."""

    width: float = 1.7
    depth: float = between(0.72, 0.8)
    height: float = between(0.54, 0.6)
    side: float = pick(-1.0, 1.0)
    towel: Towel | None = optional(0.6, Towel)

    def assemble(self, b: Builder) -> None:
        half_x, half_y, height, side = self.width / 2, self.depth / 2, self.height, self.side
        outline = (  # inset along x and y, height, power
            *((0.012, 0.012, 0.0, 24), (0.012, 0.012, height - 0.045, 24)),
            *((0.0, 0.0, height - 0.04, 24), (0.0, 0.0, height - 0.006, 24)),
            *((0.006, 0.006, height, 22), (0.062, 0.062, height, 5)),
            *((0.075, 0.075, height - 0.02, 4.5), (0.12, 0.1, height - 0.25, 4)),
            *((0.17, 0.13, 0.15, 3.6), (0.25, 0.2, 0.125, 3)),
        )
        rings = [g.superellipse(half_x - x, half_y - y, z, power, 96) for x, y, z, power in outline]
        b.add(m.CERAMIC, g.loft(rings), name="tub")
        drain = g.cylinder(0.028, 0.1255, 0.129, 24).moved(side * (half_x - 0.33))
        overflow = g.cylinder(0.03, 0, 0.008, 24).turned("y", -90 * side)
        overflow = overflow.moved(side * (half_x - 0.094), 0, height - 0.15)
        b.add(m.CHROME, drain, overflow, name="drain")
        with b.holding("tap", "fitting"):
            b.add(m.CHROME, _tap(0.15, 0.14).moved(0, half_y - 0.033, height), name="tap")
        t = np.linspace(0, 1, 14)
        arch = np.sin(np.pi * t)
        hose = [0.09 + 0.13 * t, half_y - 0.035 - 0.03 * arch, height + 0.01 + 0.11 * arch]
        b.add(m.STEEL, g.tube(np.stack(hose, 1), 0.006, 8), name="hose")
        y = half_y - 0.036
        stem = g.bar((0.22, y, height), (0.22, y, height + 0.06), 0.011, 10)
        path = [(half_y - 0.035, 0.05), (half_y - 0.06, 0.16), (half_y - 0.08, 0.19)]
        head = g.tube([(0.22, y, height + z) for y, z in path], [0.012, 0.012, 0.03], 12)
        b.add(m.CHROME, stem, head, name="shower")
        if self.towel:
            tub = np.concatenate([part.vertices[part.faces] for part in b.piece().parts])
            towel = self.towel.mesh(tub, side * -0.3 * self.width, -half_y, height)
            b.add(self.style.towel, towel, name="towel")


class WashBasin(Spec, piece=("wash basin", "wash basin", "wall"), front_clearance=0.7):
    """A wash basin with a mixer: on a cabinet, or on a pedestal."""

    width: float = between(0.55, 0.9)
    height: float = between(0.83, 0.88)
    on_cabinet: bool = chance(0.65)
    pulled: float = when("on_cabinet", maybe(0.25, between(0.06, 0.2), 0.0), 0.0)
    drawers: bool = drawn(lambda draw, spec: spec.on_cabinet and draw.chance(0.5))
    tap: Material = either(0.7, m.CHROME, "metal")

    def assemble(self, b: Builder) -> None:
        height, half_x = self.height, self.width / 2
        bowl_x = min(0.27, half_x - 0.05)
        bowl = (
            *((0.0, 0.15, 0.0, 3, -0.035), (0.012, 0.14, 0.015, 3, -0.035)),
            *((0.05, 0.105, 0.1, 2.6, -0.03), (0.15, 0.04, 0.125, 2.2, -0.03)),
        )
        inner = [
            g.superellipse(bowl_x - inset, half, height - deep, power, 64, y=y)
            for inset, half, deep, power, y in bowl
        ]
        if self.on_cabinet:
            self._add_cabinet(b, half_x)
            b.add(m.CERAMIC, g.loft([*self._basin(half_x, bowl_x), *inner]), name="basin")
        else:
            half_x = min(half_x, 0.31)
            shrunk = [ring * [min(1.0, (half_x - 0.05) / bowl_x), 1, 1] for ring in inner]
            b.add(m.CERAMIC, g.loft([*self._washstand(half_x), *shrunk]), name="basin")
            lower = ((0.12, 0.1, 0.0), (0.09, 0.085, 0.06), (0.075, 0.075, 0.4))
            column = (*lower, (0.1, 0.1, height - 0.17))
            rings = [g.superellipse(a, c, z, 2.3, 40, y=0.07) for a, c, z in column]
            b.add(m.CERAMIC, g.loft(rings), name="pedestal")
        drain = g.cylinder(0.022, -0.1245, -0.1215, 20).moved(0, -0.03, height)
        b.add(m.CHROME, drain, name="drain")
        with b.holding("tap", "fitting"):
            b.add(self.tap, _tap(0.13, 0.15).moved(0, 0.16, height - 0.001), name="tap")
        for side in (-1, 1) if half_x - bowl_x > 0.105 else ():
            b.surface(side * (half_x - 0.053), -0.02, height, 0.04, 0.16)

    def _basin(self, half_x: float, bowl_x: float) -> list[Float64Array]:
        """Rings of the outside of a basin on a cabinet, from below up to its rim."""
        height, half_y = self.height, _BASIN / 2
        return [
            g.superellipse(bowl_x - 0.13, 0.06, height - 0.14, 2.4, 64, y=-0.03),
            g.superellipse(bowl_x - 0.03, 0.13, height - 0.11, 2.6, 64, y=-0.03),
            g.superellipse(bowl_x, 0.16, height - 0.055, 3, 64, y=-0.03),
            g.superellipse(half_x, half_y, height - 0.055, 20, 64),
            g.superellipse(half_x, half_y, height - 0.004, 20, 64),
            g.superellipse(half_x - 0.004, half_y - 0.004, height, 18, 64),
        ]

    def _washstand(self, half_x: float) -> list[Float64Array]:
        """Rings of the outside of a basin on a pedestal, from below up to its rim."""
        height, half_y = self.height, _BASIN / 2
        return [
            g.superellipse(0.11, 0.11, height - 0.19, 2.4, 64, y=0.06),
            g.superellipse(0.7 * half_x, 0.17, height - 0.14, 2.6, 64, y=0.03),
            g.superellipse(0.97 * half_x, half_y - 0.01, height - 0.07, 3.2, 64),
            g.superellipse(half_x, half_y, height - 0.03, 3.6, 64),
            g.superellipse(half_x - 0.006, half_y - 0.006, height, 3.6, 64),
        ]

    def _add_cabinet(self, b: Builder, half_x: float) -> None:
        style, depth, low, high = self.style, _BASIN - 0.02, 0.26, self.height - 0.058
        finish, half = style.cabinet, half_x - 0.01
        b.add(finish, *carcass(self.width - 0.02, depth, low, self.height - 0.056, top=False))
        if self.drawers:
            zs = (low, low + 0.5 * (high - low), high)
            add_drawers(b, style, finish, style.wood, half, zs, depth, (self.pulled, 0.0))
        else:
            add_door(b, style, finish, -half, 0, low, high, depth, "left", 100 * self.pulled)
            add_door(b, style, finish, 0, half, low, high, depth, "right")
        for sx, sy in g.CORNERS:
            foot = (sx * (half_x - 0.06), sy * 0.16)
            b.add(style.metal, g.bar((*foot, 0), (*foot, low + 0.002), 0.014, 10), name="feet")


_BASIN = 0.47  # metres, depth of a basin


class Toilet(Spec, piece=("toilet", "toilet", "wall"), front_clearance=0.6, side_clearance=0.15):
    """A toilet with its cistern; the lid is down or up."""

    seat: float = between(0.4, 0.43)
    closed: bool = chance(0.7)
    cistern: float = between(0.36, 0.4)

    def assemble(self, b: Builder) -> None:
        back, seat = 0.34, self.seat
        outline = (  # half width, front, rear, height, power
            *((0.115, -0.19, back - 0.03, 0.0, 3.2), (0.11, -0.185, back - 0.03, 0.03, 3.2)),
            *((0.105, -0.19, back - 0.04, 0.16, 3.0), (0.14, -0.27, back - 0.06, 0.28, 2.6)),
            *((0.178, -0.325, back - 0.07, seat - 0.05, 2.5),),
            *((0.185, -0.335, back - 0.07, seat - 0.02, 2.5),),
            *((0.182, -0.332, back - 0.07, seat, 2.5), (0.125, -0.27, 0.06, seat, 2.2)),
            *((0.12, -0.265, 0.055, seat - 0.02, 2.2), (0.08, -0.2, -0.0, seat - 0.16, 2.0)),
            (0.04, -0.13, -0.06, seat - 0.2, 2.0),
        )
        b.add(m.CERAMIC, g.loft([_oval(*each) for each in outline]), name="bowl")
        hole = _oval(0.115, -0.26, 0.045, 0, 2.2)[:, :2]
        board = g.prism(_oval(0.183, -0.333, 0.12, 0)[:, :2], seat + 0.002, seat + 0.018, [hole])
        b.add(m.WHITE_PLASTIC, board, name="seat")
        heights = ((0.0, 1.0), (0.012, 1.0), (0.018, 0.95))
        lid = g.loft([_oval(0.18, -0.33, 0.125, z) * [shrink, 1, 1] for z, shrink in heights])
        if self.closed:
            lid = lid.moved(z=seat + 0.0195)
        else:
            lid = lid.moved(y=-0.125).turned("x", -96).moved(0, 0.125, seat + 0.02)
        b.add(m.WHITE_PLASTIC, lid, name="lid")
        for side in (-1, 1):
            one, other = ((side * 0.07 + dx, 0.135, seat + 0.012) for dx in (-0.02, 0.02))
            b.add(m.CHROME, g.bar(one, other, 0.009, 10), name="hinge")
        tank, y = seat + self.cistern, back - 0.084
        size = (0.37, 0.16, tank - seat + 0.008)
        cover = g.rounded_box((0.385, 0.168, 0.035), (0, y, tank - 0.005), 0.012)
        body = g.rounded_box(size, (0, back - 0.08, seat - 0.008), 0.03)
        b.add(m.CERAMIC, body, cover, name="cistern")
        b.add(m.CHROME, g.cylinder(0.022, 0, 0.006, 20).moved(0, y, tank + 0.029), name="button")
        for side in (-1, 1):  # beside the button
            b.surface(side * 0.096, y, tank + 0.03, 0.065, 0.055)


def _oval(half_x: float, front: float, rear: float, z: float, power: float = 2.5) -> Float64Array:
    return g.superellipse(half_x, (rear - front) / 2, z, power, 48, y=(front + rear) / 2)


class Shower(Spec, piece=("shower", "shower", "corner"), front_clearance=0.6):
    """A corner shower: tray, glass screens and door; walls at its back (+Y) and left (-X)."""

    width: float = 0.9
    height: float = between(1.9, 2.0)
    ajar: float = maybe(0.5, between(10, 50), 0.0)

    def assemble(self, b: Builder) -> None:
        half = self.width / 2
        tray = (  # inset, height, power
            *((0.0, 0.0, 30), (0.0, 0.045, 30), (0.004, 0.05, 28)),
            *((0.05, 0.05, 16), (0.07, 0.032, 14)),
        )
        rings = [g.superellipse(half - dx, half - dx, z, power, 64) for dx, z, power in tray]
        b.add(m.CERAMIC, g.loft(rings), name="tray")
        b.add(m.CHROME, g.cylinder(0.055, 0.0325, 0.036, 28).moved(-0.1, 0.1), name="drain")
        self._add_screens(b, half)
        self._add_fittings(b, half, -0.05, half - 0.055)
        if self.width > 0.85:  # a board in the corner of the walls
            low = (0.002 - half, half - 0.182, 1.1)
            b.add(m.GLASS, g.span(low, (0.182 - half, half - 0.002, 1.106)), name="board")
            b.surface(0.092 - half, half - 0.092, 1.106, 0.085, 0.085, 0.4)

    def _add_screens(self, b: Builder, half: float) -> None:
        pane, edge, split, height = 0.008, half - 0.025, -0.02, self.height
        low = (edge - pane, -edge + 0.01, 0.052)
        b.add(m.GLASS, g.span(low, (edge, half - 0.012, height)), name="screen")
        front = g.span((split, -edge, 0.052), (edge - 0.012, -edge + pane, height))
        b.add(m.GLASS, front, name="screen")
        length, hinge = half + split - 0.03, (-half + 0.024, -edge + pane / 2)
        door = g.span((0.004, -pane / 2, 0.058), (length, pane / 2, height - 0.004))
        b.add(m.GLASS, door.turned("z", -self.ajar).moved(*hinge), name="door")
        for side in (-1.0, 1.0):
            knob = g.cylinder(0.014, 0.002, 0.03, 16, bevel=0.003).turned("x", 90.0 * side)
            knob = knob.moved(length - 0.06, 0, 1.05).turned("z", -self.ajar).moved(*hinge)
            b.add(m.CHROME, knob, name="knob")
        swept = (0.0, -0.04, 0.0), (length, 0.04, height)
        b.hinge((*hinge, 0.058), (0.0, 0.0, -1.0), self.ajar, swept)
        low, high = (edge - 0.02, half - 0.02, 0.05), (edge + 0.012, half, height + 0.002)
        hung = g.span((-half, -edge - 0.01, 0.05), (-half + 0.022, -edge + 0.02, height + 0.002))
        x, z = edge - 0.004, height - 0.02
        top = g.bar((x, -edge + 0.004, z), (x, half - 0.005, z), 0.009, 8)
        for mesh in (g.span(low, high), hung, top):
            b.add(self.style.metal, mesh, name="profile")

    def _add_fittings(self, b: Builder, half: float, x: float, y: float) -> None:
        """Add riser, head, mixer and hand shower at (x, y)."""
        b.add(m.CHROME, g.bar((x, y, 0.98), (x, y, 2.06), 0.011, 12), name="riser")
        path = [(x, y, 2.04), (x, y - 0.03, 2.085), (x, y - 0.08, 2.09), (x, y - 0.32, 2.09)]
        b.add(m.CHROME, g.tube(path, 0.01, 10), name="riser")
        head = g.lathe([(0.105, 0.0), (0.11, 0.006), (0.03, 0.018), (0.018, 0.05), (0, 0.05)], 36)
        b.add(m.CHROME, head.moved(x, y - 0.31, 2.035), name="head")
        for z in (1.05, 1.95):
            b.add(m.CHROME, g.bar((x, half - 0.001, z), (x, y, z), 0.01, 10), name="riser")
        mixer = g.cylinder(0.022, -0.14, 0.14, 20, bevel=0.004).turned("y", 90)
        b.add(m.CHROME, mixer.moved(x, y, 1.0), name="mixer")
        t = np.linspace(0, 1, 18)
        sag = np.sin(np.pi * t)
        hang = 0.99 + 0.6 * t - 0.6 * sag * (1 - t)
        hose = np.stack([x + 0.12 - 0.03 * t - 0.04 * sag, y - 0.02 - 0.0 * t, hang], 1)
        b.add(m.STEEL, g.tube(hose, 0.006, 8), name="hose")
        x += 0.09
        path = [(x, y - 0.02, 1.58), (x, y - 0.05, 1.7), (x, y - 0.09, 1.73)]
        b.add(m.CHROME, g.tube(path, [0.012, 0.013, 0.035], 14), name="hand shower")
        b.add(m.CHROME, g.bar((-0.05, y, 1.6), (x, y - 0.02, 1.6), 0.01, 8), name="riser")


_IN_CABINET = (
    *("aftershave", "eye drops", "ointment", "antiseptic", "nasal spray", "sleeping pills"),
    *("cold cream", "mouth spray", "tweezers tube", "contact lens fluid"),
)


class MirrorCabinet(Spec, piece=("mirror cabinet", "mirror", "on_wall"), mount_height=1.2):
    """A cabinet with mirror doors, sometimes one ajar; the origin is on its lower back edge."""

    width: float = between(0.55, 0.8)
    angle: float = maybe(0.35, between(12, 50), 0.0)
    held: tuple[tuple[str, float], ...] = drawn(  # names and heights of bottles
        lambda draw, spec: tuple(
            (name, draw.between(0.7, 1.2))
            for name in (draw.shuffled(_IN_CABINET)[:5] if spec.angle else ())
        )
    )

    def assemble(self, b: Builder) -> None:
        width, depth, height = self.width, 0.15, 0.65
        b.add(m.WHITE_PAINT, *carcass(width, depth, 0, height))
        for z in (0.22, 0.44):
            low = (-width / 2 + 0.019, -depth / 2 + 0.03, z)
            shelf = g.span(low, (width / 2 - 0.019, depth / 2 - 0.013, z + 0.006))
            b.add(m.GLASS, shelf, name="shelf")
        each, y = width / 2 - 0.002, -depth / 2 + 0.019
        leaf = [
            (m.WHITE_PAINT, g.span((0, -0.012, 0), (each, 0, height))),
            (m.MIRROR, g.span((0.001, -0.0165, 0.001), (each - 0.001, -0.012, height - 0.001))),
        ]
        for material, mesh in leaf:
            b.add(material, mesh.turned("z", -self.angle).moved(-width / 2, y), name="door")
            b.add(material, mesh.moved(-each).moved(width / 2, y), name="door")
        outline = [(0.022, 0), (0.022, 0.1), (0.01, 0.12), (0.01, 0.14), (0, 0.14)]
        places = ((0.07, 0.018), (0.15, 0.2265), (0.23, 0.4465), (0.07, 0.2265), (0.14, 0.018))
        for k, (name, tall) in enumerate(self.held):
            x, z = places[k]
            bottle = g.lathe(outline, 16).scaled(z=tall).moved(x - width / 2, 0.0, z)
            with b.holding(name, "fitting"):
                b.add(self.style.accents[k], bottle, name="bottle")
        b.move(y=-depth / 2)


class TowelRail(Spec, piece=("towel rail", "towel rail", "on_wall"), mount_height=0.55):
    """A heated towel rail with one or two towels; the origin is on its lower back edge."""

    width: float = between(0.45, 0.55)
    height: float = between(0.8, 1.2)
    metal: Material = either(0.6, m.CHROME, m.WHITE_PAINT)
    wide: float = between(0.28, 0.34)  # of towels
    both: bool = chance(0.5)
    fronts: tuple[float, float] = drawn(
        lambda draw, spec: tuple(draw.uniform((0.36, 0.16), (0.5, 0.22)).tolist())
    )
    towels: tuple[tuple[Hanging, float], ...] = repeated(  # and their x
        lambda spec: 1 + spec.both, drawn(lambda draw, spec: hanging(draw)), between(-0.02, 0.02)
    )

    def assemble(self, b: Builder) -> None:
        width, height, metal, y = self.width, self.height, self.metal, -0.07
        for side in (-1, 1):
            x = side * width / 2
            b.add(metal, g.bar((x, y, 0), (x, y, height), 0.015, 12))
            for z in (0.08, height - 0.08):
                b.add(metal, g.bar((x, 0, z), (x, y, z), 0.009, 10))
        rungs = [0.04 + 0.055 * k for k in range(int(height / 0.055)) if k % 6 != 5]
        for z in rungs:
            b.add(metal, g.bar((-width / 2, y - 0.008, z), (width / 2, y - 0.008, z), 0.01, 10))
        rows, fronts = [rungs[-2], rungs[len(rungs) // 3]][: len(self.towels)], [*self.fronts]
        if self.both:  # the upper one ends above the lower one
            fronts[0] = min(fronts[0], rows[0] - rows[1] - 0.09)
        places = zip(rows, fronts, (0.2, 0.12), self.towels, strict=False)
        for z, front, back, (how, x) in places:
            towel = hung(how, self.wide, front, back, 0.018, 0.06).moved(x, y - 0.008, z)
            with b.holding("towel", "towel"):
                b.add(self.style.towel, towel, name="towel")


class WashingMachine(
    Spec, piece=("washing machine", "washing machine", "wall"), front_clearance=0.7
):
    """A front-loading washing machine."""

    depth: float = between(0.54, 0.6)
    height: float = between(0.845, 0.855)
    ring: Material = either(0.6, m.STEEL, m.BLACK_PLASTIC)

    def assemble(self, b: Builder) -> None:
        half, depth, height, f = 0.3, self.depth, self.height, -self.depth / 2
        case = g.span((-half, f + 0.01, 0.02), (half, depth / 2, height), 0.008)
        b.add(m.WHITE_PAINT, case, name="case")
        foot = g.span((-half + 0.03, f + 0.04, 0), (half - 0.03, depth / 2 - 0.03, 0.021))
        b.add(m.BLACK_PLASTIC, foot, name="foot")
        rim = [(0.185, -0.002), (0.185, 0.02), (0.17, 0.034), (0.145, 0.036), (0.14, 0.02)]
        door = g.lathe([*rim, (0.14, 0.004)], 48).turned("x", 90).moved(0.0, f + 0.01, 0.43)
        b.add(self.ring, door, name="door")
        lens = g.lathe([(0.139, 0.006), (0.125, 0.02), (0.07, 0.008), (0.0, 0.006)], 40)
        window = Material("plastic", m.hex_color("#15171a"), 0.06)
        b.add(window, lens.turned("x", 90).moved(0.0, f + 0.01, 0.43), name="window")
        b.add(m.IRON, g.box((0.03, 0.03, 0.07), (0.162, f - 0.02, 0.395), 0.006), name="handle")
        swings = (0.0, -0.05, -0.19), (0.38, 0.02, 0.19)
        b.hinge((-0.19, f + 0.01, 0.43), (0.0, 0.0, -1.0), 0.0, swings)
        low, high = (-half + 0.01, f + 0.002, height - 0.125), (half - 0.01, f + 0.02)
        b.add(m.WHITE_PLASTIC, g.span(low, (*high, height - 0.012), 0.004), name="panel")
        display = g.span((0.1, f, height - 0.1), (0.26, f + 0.004, height - 0.045))
        b.add(m.BLACK_PLASTIC, display, name="display")
        dial = g.lathe([(0.036, 0), (0.034, 0.02), (0.028, 0.024), (0, 0.024)], 28)
        b.add(m.STEEL, dial.turned("x", 90).moved(0, f + 0.003, height - 0.07), name="dial")
        drawer = g.span((-0.27, f, height - 0.11), (-0.08, f + 0.004, height - 0.03), 0.001)
        b.add(m.WHITE_PLASTIC, drawer, name="drawer")
        b.surface(0, 0, height, half - 0.05, depth / 2 - 0.05)


class Toiletries(Spec, piece=("toiletries", "toiletries", "on_top")):
    """A soap dispenser, a beaker with toothbrushes and a tube."""

    glaze: Material = any_of("accents")

    def assemble(self, b: Builder) -> None:
        body = [(0.03, 0), (0.032, 0.005), (0.032, 0.11), (0.012, 0.125), (0, 0.125)]
        b.add(self.glaze, g.lathe(body, 24).moved(-0.045), name="dispenser")
        stem = g.bar((-0.045, 0, 0.12), (-0.045, 0, 0.158), 0.004, 8)
        path = [(-0.045, 0.004, 0.156), (-0.045, -0.02, 0.158), (-0.045, -0.036, 0.15)]
        b.add(m.CHROME, stem, g.tube(path, 0.005, 8), name="dispenser")
        cup = [(0.03, 0), (0.034, 0.09), (0.0315, 0.09), (0.0275, 0.006), (0, 0.006)]
        with b.holding("beaker", "fitting"):
            b.add(m.CERAMIC, g.lathe(cup, 24).moved(0.04), name="beaker")
            for k in range(2):
                lean = -0.02 + 0.04 * k
                brush = Material("plastic", self.style.accents[k].color, 0.4)
                foot, top = (0.04 - 0.5 * lean, -0.01, 0.008), (0.04 + 1.3 * lean, 0.012, 0.185)
                b.add(brush, g.bar(foot, top, 0.003, 8), name="toothbrush")
                head = g.box((0.009, 0.012, 0.024), (top[0], 0.005, 0.164))
                b.add(m.WHITE_PLASTIC, head, name="toothbrush")
