"""Tables and desks."""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.procedural.furniture import materials as m
from pbrnet.scenes.procedural.furniture.cabinets import (
    BOARD,
    add_drawers,
    add_feet,
    carcass,
    leg_material,
    pulled_out,
)
from pbrnet.scenes.procedural.furniture.parts import geometry as g
from pbrnet.scenes.procedural.furniture.parts.build import Builder
from pbrnet.scenes.procedural.furniture.parts.cloth import block, plane
from pbrnet.scenes.procedural.furniture.parts.drapes import Ripples, dropped, ripples
from pbrnet.scenes.procedural.furniture.spec import (
    Spec,
    between,
    by,
    chance,
    drawn,
    either,
    optional,
    pick,
    shape,
)
from pbrnet.scenes.procedural.furniture.style import Style
from pbrnet.scenes.procedural.piece import Material
from pbrnet.scenes.seeds import Draw


class TableCloth(Spec):
    """A table cloth of linen, plain or checked, that hangs down at all sides."""

    hang: float = between(0.12, 0.21)
    turn: float = drawn(lambda draw, spec: draw.normal(0, 0.6))
    ripples: Ripples = drawn(lambda draw, spec: ripples(draw))
    linen: Material = drawn(lambda draw, spec: _table_linen(draw, spec.style))

    def mesh(self, width: float, depth: float, height: float) -> g.BodyMesh:
        """The cloth on a table top of this size and height."""
        thin = 0.003
        # Down to below the hem, so that the cloth does not swing in under the top.
        low, high = (-width / 2, -depth / 2, height - 0.4), (width / 2, depth / 2, height)
        top = block(low, high, 0.008, thin + 0.001)
        bodies = [top, plane(2, height + thin + 0.0012, -1.0)]
        size, at = (width + 2 * self.hang, depth + 2 * self.hang), (0, 0, height + 0.01)
        return dropped(
            self.ripples, bodies, size, at, turn=self.turn, tight=0.0, rumple=0.1,
            thickness=thin, step=0.045,
        )  # fmt: skip


def _table_linen(draw: Draw, style: Style) -> Material:
    """White or coloured linen, plain or checked."""
    color = (0.72, 0.71, 0.68) if draw.chance(0.5) else style.cushions[2].color
    family = draw.pick(("linen", "plain", "checked"))
    return Material("fabric", color, 0.9, variant=draw.whole(1 << 20), family=family)


class DiningTable(
    Spec, piece=("dining table", "table", "centre"), front_clearance=0.6, side_clearance=0.6
):
    """A rectangular table; `width` along x."""

    width: float = between(1.2, 2.0)
    depth: float = between(0.78, 0.95)
    height: float = between(0.73, 0.77)
    top: float = between(0.024, 0.04)
    leg: float = between(0.055, 0.08)
    cloth: TableCloth | None = optional(0.2, TableCloth)

    def assemble(self, b: Builder) -> None:
        width, depth, height = self.width, self.depth, self.height
        top, wood = self.top, self.style.wood
        each = depth / 5
        for k in range(5):  # separate planks show fine joints
            plank = g.box((width, each, top), (0, (k - 2.0) * each, height - top), 0.0015, "x")
            b.add(wood, plank, name="top")
        under, apron = height - top, 0.08
        add_feet(b, self.style, wood, width, depth, under + 0.002, self.leg, 0.03, splay=0.015)
        x, y = width / 2 - 0.03 - self.leg / 2, depth / 2 - 0.03 - self.leg / 2
        for side in (-1, 1):
            long = g.box((2 * x, 0.02, apron), (0, side * y, under - apron + 0.001))
            at = (side * x, 0, under - apron + 0.002)
            b.add(wood, long, g.box((0.02, 2 * y - 0.02, apron - 0.002), at))
        if self.cloth:
            b.add(self.cloth.linen, self.cloth.mesh(width, depth, height), name="cloth")
            height = height + 0.003 + 0.002
        b.surface(0, 0, height, width / 2 - 0.05, depth / 2 - 0.05)


class RoundTable(
    Spec, piece=("round table", "table", "centre"), front_clearance=0.6, side_clearance=0.6
):
    """A round table on one turned column; `width` is its diameter."""

    width: float = between(0.9, 1.25)
    height: float = between(0.73, 0.77)
    wood: Material = either(0.7, "wood", "dark_wood")
    foot: str = shape("round_table", "tulip", "column")
    tulip: Material | None = by("foot", {"tulip": drawn(lambda *of: _tulip(*of))})

    def assemble(self, b: Builder) -> None:
        radius, height, wood = self.width / 2, self.height, self.wood
        b.add(wood, g.cylinder(radius, height - 0.03, height, 48, bevel=0.006), name="top")
        b.add(wood, g.cylinder(0.35 * radius, height - 0.05, height - 0.028, 32))
        if self.tulip:
            profile = [(0.5 * radius, 0.0), (0.5 * radius, 0.01), (0.3 * radius, 0.03)]
            profile += [(0.08, 0.12), (0.045, 0.3), (0.045, 0.5), (0.08, height - 0.08)]
            b.add(self.tulip, g.lathe([*profile, (0.14, height - 0.049)], 36))
        else:
            profile = [(0.06, 0.1), (0.07, 0.2), (0.045, 0.28), (0.06, 0.4), (0.06, 0.5)]
            b.add(wood, g.lathe([*profile, (0.045, 0.55), (0.075, height - 0.05)], 24))
            extent = 0.62 * radius
            foot = [(extent, 0, 0.0), (extent - 0.02, 0, 0.045), (0.06, 0, 0.2)]
            arm = g.post(foot, [(0.06, 0.045), (0.05, 0.04), (0.03, 0.04)])
            for k in range(4):
                b.add(wood, arm.turned("z", 45 + 90 * k))
        b.surface(0, 0, height, 0.62 * radius, 0.62 * radius)


def _tulip(draw: Draw, spec: RoundTable) -> Material:
    return spec.style.lacquer if draw.chance(0.5) else spec.wood


class CoffeeTable(Spec, piece=("coffee table", "table", "centre"), front_clearance=0.3):
    """A low table with a shelf, with a round or glass top, or a drum."""

    width: float = between(0.8, 1.2)
    depth: float = between(0.5, 0.62)
    height: float = between(0.36, 0.45)
    wood: Material = either(0.7, "wood", "dark_wood")
    form: str = shape("coffee_table", "shelf", "oval", "glass", "drum")
    painted: bool = drawn(lambda draw, spec: spec.form == "drum" and not draw.chance(0.6))

    def assemble(self, b: Builder) -> None:
        if self.form == "drum":
            self._add_drum(b)
        elif self.form == "oval":
            self._add_oval(b)
        else:
            self._add_shelved(b)

    def _add_drum(self, b: Builder) -> None:
        height, radius = self.height, min(0.5 * self.width, 0.5 * self.depth + 0.08)
        body = self.style.lacquer if self.painted else self.wood
        b.add(body, g.cylinder(0.92 * radius, 0, 0.03, 48))
        b.add(body, g.cylinder(radius, 0.03, height - 0.022, 48, bevel=0.006), name="drum")
        top = g.cylinder(radius + 0.006, height - 0.022, height, 48, bevel=0.004)
        b.add(self.wood, top, name="top")
        b.surface(0, 0, height, 0.66 * radius, 0.66 * radius)

    def _add_oval(self, b: Builder) -> None:
        width, depth, height = self.width, self.depth, self.height
        edge = ((0.03, 0.008), (0.022, 0.0), (0.006, 0.0), (0.0, 0.006))
        rings = [
            g.superellipse(width / 2 - inset, depth / 2 - inset, height - below, 2.4, 48)
            for below, inset in edge
        ]
        b.add(self.wood, g.loft(rings), name="top")
        sizes = (0.78 * width, 0.78 * depth, height - 0.028, 0.045, 0)
        add_feet(b, self.style, self.wood, *sizes, splay=0.04)
        b.surface(0, 0, height, 0.36 * width, 0.34 * depth)

    def _add_shelved(self, b: Builder) -> None:
        width, depth, height, wood = self.width, self.depth, self.height, self.wood
        add_feet(b, self.style, wood, width, depth, height - 0.01, 0.045, 0.0)
        if self.form == "glass":
            pane = g.box((width - 0.01, depth - 0.01, 0.01), (0, 0, height - 0.01))
            b.add(m.GLASS, pane, name="top")
            for side in (-1, 1):
                y, x = side * (depth / 2 - 0.0225), side * (width / 2 - 0.0225)
                long = g.box((width - 0.09, 0.03, 0.045), (0, y, height - 0.056))
                b.add(wood, long, g.box((0.03, depth - 0.09, 0.045), (x, 0, height - 0.0565)))
        else:
            top = g.box((width + 0.02, depth + 0.02, 0.028), (0, 0, height - 0.02), 0.003)
            b.add(wood, top, name="top")
            height += 0.008
        shelf_z = 0.14
        b.add(wood, g.box((width - 0.05, depth - 0.05, 0.018), (0, 0, shelf_z - 0.018)))
        b.surface(0, 0, height, width / 2 - 0.04, depth / 2 - 0.04)
        b.surface(0, 0, shelf_z, width / 2 - 0.08, depth / 2 - 0.08, height - shelf_z - 0.08)


class SideTable(Spec, piece=("side table", "table", "free")):
    """A small round table for beside a seat."""

    radius: float = between(0.2, 0.27)
    height: float = between(0.46, 0.58)
    on_legs: bool = chance(0.5)  # else a tray on one stem

    def assemble(self, b: Builder) -> None:
        radius, height, wood, metal = self.radius, self.height, self.style.wood, self.style.metal
        if self.on_legs:
            b.add(wood, g.cylinder(radius, height - 0.02, height, 36, bevel=0.004), name="top")
            frame = leg_material(self.style, wood)
            size = 0.018 if frame.kind == "metal" else 0.03
            for k in range(3):
                a = np.radians(90 + 120 * k)
                c, s = float(np.cos(a)), float(np.sin(a))
                foot = (0.95 * radius * c, 0.95 * radius * s, 0)
                top = (0.55 * radius * c, 0.55 * radius * s, height - 0.018)
                b.add(frame, g.post([foot, top], [(0.7 * size, 0.7 * size), (size, size)]))
        else:
            tray = [(radius - 0.002, height - 0.012), (radius, height + 0.017)]
            tray += [(radius - 0.003, height + 0.017), (radius - 0.006, height)]
            b.add(metal, g.lathe(tray, 36), name="top")
            b.add(metal, g.cylinder(0.014, 0.008, height - 0.011, 16))
            b.add(metal, g.cylinder(0.75 * radius, 0, 0.012, 36, bevel=0.003))
        b.surface(0, 0, height, 0.6 * radius, 0.6 * radius)


class Desk(Spec, piece=("desk", "desk", "wall"), front_clearance=0.75):
    """A desk with a pedestal of drawers, sometimes one pulled out; the seat is in front (-Y)."""

    width: float = between(1.15, 1.6)
    depth: float = between(0.6, 0.72)
    height: float = between(0.72, 0.76)
    side: float = pick(-1.0, 1.0)
    pulled: tuple[float, ...] = pulled_out(lambda desk: 3, 0.06, 0.18, closed=1)

    def assemble(self, b: Builder) -> None:
        width, depth, height, side = self.width, self.depth, self.height, self.side
        wood, top, pedestal, inner = self.style.wood, 0.028, 0.4, depth - 0.06
        b.add(wood, g.box((width, depth, top), (0, 0, height - top), 0.002), name="top")
        under = height - top
        x = side * (width / 2 - pedestal / 2 - 0.02)
        parts = Builder("", "", "free")
        cabinet = self.style.cabinet
        parts.add(cabinet, *carcass(pedestal, inner, 0.04, under - 0.001))
        plinth = g.box((pedestal - 0.04, inner - 0.08, 0.041), (0, 0.01, 0))
        parts.add(self.style.dark_wood, plinth)
        zs = np.linspace(0.04, under - 0.004, 4)
        add_drawers(parts, self.style, cabinet, wood, pedestal / 2, zs, inner, self.pulled)
        b.add_from(parts, x=x)
        frame, size = leg_material(self.style, wood), 0.05
        for sy in (-1, 1):
            at = (-side * (width / 2 - 0.05), sy * (depth / 2 - 0.06))
            b.add(frame, g.post([(*at, 0), (*at, under + 0.001)], [(size, size)] * 2))
        # Modesty panel between the pedestal and the legs.
        low, high = sorted((-side * (width / 2 - 0.07), x - side * pedestal / 2))
        y = depth / 2 - 0.09
        b.add(wood, g.span((low, y, under - 0.3), (high, y + BOARD, under + 0.0005)))
        b.surface(0, 0.02, height, width / 2 - 0.06, depth / 2 - 0.08)


class ConsoleTable(Spec, piece=("console table", "table", "wall"), front_clearance=0.5):
    """A narrow table for the hall, with a lower shelf."""

    width: float = between(0.8, 1.2)
    depth: float = between(0.3, 0.36)
    height: float = between(0.76, 0.84)

    def assemble(self, b: Builder) -> None:
        width, depth, height, wood = self.width, self.depth, self.height, self.style.wood
        b.add(wood, g.box((width, depth, 0.026), (0, 0, height - 0.026), 0.002), name="top")
        add_feet(b, self.style, wood, width, depth, height - 0.024, 0.035, 0.015)
        b.add(wood, g.box((width - 0.06, depth - 0.05, 0.018), (0, 0, 0.16)))
        for side in (-1, 1):
            at = (0, side * (depth / 2 - 0.033), height - 0.085)
            b.add(wood, g.box((width - 0.1, 0.016, 0.06), at))
        b.surface(0, 0, height, width / 2 - 0.05, depth / 2 - 0.04)
        b.surface(0, 0, 0.178, width / 2 - 0.08, depth / 2 - 0.06, height - 0.28)
