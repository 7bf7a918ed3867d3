"""Lamps; the visible shade, globe, panel or diffuser emits, not a bulb inside it."""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.procedural.furniture import materials as m
from pbrnet.scenes.procedural.furniture.parts import geometry as g
from pbrnet.scenes.procedural.furniture.parts.build import Builder
from pbrnet.scenes.procedural.furniture.spec import (
    Spec,
    between,
    by,
    chance,
    either,
    maybe,
    repeated,
    shape,
    when,
    whole,
)
from pbrnet.scenes.procedural.furniture.style import Style
from pbrnet.scenes.procedural.piece import Material

OPAL = Material("plastic", (0.86, 0.85, 0.82), 0.4)
_DOWNWARDS = 0.5  # share of a shaded lamp's light that leaves by its diffuser


def _shade_profile(low: float, high: float, z0: float, z1: float) -> list[tuple[float, float]]:
    """Closed profile (radius, z) of an open lampshade, 3 mm thick."""
    t = np.linspace(0, 1, 4)
    outer = [(float(low + (high - low) * s), float(z0 + (z1 - z0) * s)) for s in t]
    inner = [(r - 0.003, z) for r, z in outer[::-1]]
    return [*outer, *inner]


Ends = tuple[float, float]  # of a shade: below, above


def _add_shade(
    b: Builder, style: Style, radii: Ends, zs: Ends, lumens: float, y: float = 0.0
) -> None:
    """Add an emitting shade, open at the top, a brighter diffuser below, and the wires."""
    (low, high), (z0, z1) = radii, zs
    shade = g.hollow_lathe(_shade_profile(low, high, z0, z1), 36)
    glow = (1 - _DOWNWARDS) * lumens
    b.add(style.shade, shade.moved(y=y), name="shade", lumens=glow, kelvin=style.kelvin)
    diffuser = g.cylinder(low - 0.006, z0 + 0.012, z0 + 0.019, 36).moved(y=y)
    b.add(OPAL, diffuser, name="diffuser", lumens=_DOWNWARDS * lumens, kelvin=style.kelvin)
    z = z1 - 0.02
    for k in range(3):
        turn = np.radians(120 * k)
        radius = high - 0.004
        mesh = g.bar((0, y, z), (radius * np.cos(turn), y + radius * np.sin(turn), z), 0.002, 8)
        b.add(style.metal, mesh)


_RADII = {"drum": between(0.17, 0.25), "dome": between(0.16, 0.24)}
_RADII |= {"lantern": between(0.17, 0.24), "globe": between(0.12, 0.17)}
_HEIGHTS = {"drum": between(0.17, 0.24), "dome": between(0.16, 0.22)}


class PendantLamp(Spec, piece=("pendant lamp", "lamp", "ceiling")):
    """A lamp hanging from the ceiling: drum, dome, globe or paper lantern.

    `drop` metres to its lowest point.
    """

    drop: float = between(0.7, 1.0)
    kind: str = shape("pendant", "drum", "dome", "globe", "lantern")
    lumens: float = between(900, 1600)
    radius: float = by("kind", _RADII)
    height: float = by("kind", _HEIGHTS, 0.0)
    narrow: float = by("kind", {"drum": between(0.75, 1.0)}, 1.0)
    coat: str = by("kind", {"dome": shape("dome", "metal", "painted")}, "")
    ribs: int = by("kind", {"lantern": whole(9, 14)}, 0)
    flat: float = when("ribs", between(0.6, 0.95), 1.0)

    def assemble(self, b: Builder) -> None:
        metal = self.style.metal
        b.add(metal, g.lathe([(0.05, -0.025), (0.055, -0.012), (0.055, 0.0)], 24), name="rose")
        add = {"drum": self._add_drum, "dome": self._add_dome, "lantern": self._add_lantern}
        top = add.get(self.kind, self._add_globe)(b)
        cord = g.bar((0, 0, top), (0, 0, -0.02), 0.003, 8)
        b.add(Material("plastic", (0.02, 0.02, 0.02), 0.6), cord, name="cord")

    def _add_drum(self, b: Builder) -> float:
        radius, low, high = self.radius, -self.drop, -self.drop + self.height
        _add_shade(b, self.style, (radius, radius * self.narrow), (low, high), self.lumens)
        top = high - 0.021
        b.add(OPAL, g.cylinder(0.022, top - 0.07, top - 0.01, 16), name="socket")
        b.add(OPAL, g.sphere(0.042, 16, 10).moved(z=top - 0.105), name="bulb")
        return top

    def _add_dome(self, b: Builder) -> float:
        radius, height, low, style = self.radius, self.height, -self.drop, self.style
        sides = [(float(np.cos(a)), float(np.sin(a))) for a in np.linspace(0, np.pi / 2, 9)]
        outer = [(radius * c + 0.02 * s, low + height * s) for c, s in sides]
        inner = [(max(r - 0.004, 0.003), z - 0.004 * (z > low)) for r, z in outer[::-1]]
        inner[0] = (0.016, inner[0][1])
        reflector = g.hollow_lathe([*outer, *inner], 36)
        coat = style.metal if self.coat == "metal" else style.accents[0]
        b.add(coat, reflector, name="reflector")
        cap = g.cylinder(0.024, low + height - 0.012, low + height + 0.03, 16)
        b.add(style.metal, cap, name="cap")
        body = [(0.0, low + 0.001), (0.6 * radius, low + 0.004), (radius - 0.006, low + 0.012)]
        diffuser = g.lathe([*body, (radius - 0.012, low + 0.016)], 36)
        b.add(OPAL, diffuser, name="diffuser", lumens=0.8 * self.lumens, kelvin=style.kelvin)
        return low + height + 0.028

    def _add_lantern(self, b: Builder) -> float:
        """Paper over rings of wire."""
        radius, ribs, low, rise = self.radius, self.ribs, -self.drop, self.radius * self.flat
        t = np.linspace(-0.94, 0.94, 4 * ribs + 1) * np.pi / 2
        wave = 1 - 0.022 * np.abs(np.sin(2 * ribs * (t / (0.94 * np.pi))))
        paper = [
            (radius * float(np.cos(a) * w), low + rise * float(1 + np.sin(a)))
            for a, w in zip(t, wave, strict=True)
        ]
        kelvin = self.style.kelvin
        b.add(self.style.shade, g.lathe(paper, 32), name="shade", lumens=self.lumens, kelvin=kelvin)
        top = low + rise * (1 + float(np.sin(0.94 * np.pi / 2)))
        b.add(self.style.metal, g.cylinder(0.02, top - 0.004, top + 0.02, 16), name="cap")
        return top + 0.018

    def _add_globe(self, b: Builder) -> float:
        globe = g.sphere(self.radius, 28, 16).moved(z=-self.drop + self.radius)
        b.add(OPAL, globe, name="globe", lumens=self.lumens, kelvin=self.style.kelvin)
        top = -self.drop + 2 * self.radius
        b.add(self.style.metal, g.cylinder(0.03, top - 0.008, top + 0.05, 20), name="cap")
        return top + 0.048


class CeilingLamp(Spec, piece=("ceiling lamp", "lamp", "ceiling")):
    """A flat ceiling lamp: a round bowl or a square panel with a rim."""

    lumens: float = between(1200, 2400)
    is_bowl: bool = chance(0.6)
    half: float = when("is_bowl", between(0.15, 0.24), between(0.17, 0.3))
    depth: float = when("is_bowl", between(0.07, 0.1), 0.0)

    def assemble(self, b: Builder) -> None:
        half, kelvin = self.half, self.style.kelvin
        lumens = self.lumens
        if self.is_bowl:
            rim = g.cylinder(half + 0.008, -0.03, 0.0, 40, bevel=0.004)
            b.add(self.style.metal, rim, name="rim")
            sides = [(float(np.sin(a)), float(np.cos(a))) for a in np.linspace(0, np.pi / 2, 8)]
            bowl = [(half * s, -0.03 - (self.depth - 0.03) * c) for s, c in sides]
            diffuser = g.lathe([*bowl, (half, -0.025)], 40)
        else:
            rim = g.box((2 * half, 2 * half, 0.045), (0, 0, -0.045), 0.004)
            b.add(m.WHITE_PAINT, rim, name="rim")
            diffuser = g.box((2 * half - 0.03, 2 * half - 0.03, 0.012), (0, 0, -0.054), 0.003)
            lumens, kelvin = 1.2 * lumens, kelvin + 500
        b.add(OPAL, diffuser, name="diffuser", lumens=lumens, kelvin=kelvin)


class SpotRail(Spec, piece=("ceiling spots", "lamp", "ceiling")):
    """A rail at the ceiling with three spotlights in random directions."""

    length: float = between(0.6, 0.9)
    # Tilt and turn of each.
    spots: tuple[tuple[float, float], ...] = repeated(3, between(15, 45), between(0, 360))

    def assemble(self, b: Builder) -> None:
        metal = self.style.metal
        b.add(metal, g.box((self.length, 0.05, 0.022), (0, 0, -0.022), 0.003), name="rail")
        can = g.lathe([(0.036, -0.075), (0.04, -0.07), (0.04, 0.01), (0.03, 0.03)], 24)
        lamp = g.lathe([(0.0, -0.0785), (0.032, -0.0785), (0.032, -0.0745)], 24)
        for k, (tilt, turn) in enumerate(self.spots):
            x = (k - 1) * 0.38 * self.length
            b.add(metal, g.bar((x, 0, -0.02), (x, 0, -0.075), 0.006, 8))
            aimed = can.turned("x", tilt).turned("z", turn).moved(x, 0, -0.1)
            diffuser = lamp.turned("x", tilt).turned("z", turn).moved(x, 0, -0.1)
            b.add(metal, aimed, name="spot")
            b.add(OPAL, diffuser, name="diffuser", lumens=1350.0, kelvin=self.style.kelvin)


class FloorLamp(Spec, piece=("floor lamp", "lamp", "corner")):
    """A floor lamp: straight, on a tripod, or arched."""

    height: float = between(1.45, 1.7)
    low: float = between(0.18, 0.24)
    tall: float = between(0.22, 0.3)
    narrow: float = between(0.65, 1.0)
    lumens: float = between(600, 1000)
    kind: str = shape("floor_lamp", "straight", "tripod", "arch")

    def assemble(self, b: Builder) -> None:
        style = self.style
        height, tall, shade = self.height, self.tall, (self.low, self.low * self.narrow)
        if self.kind == "arch":
            t = np.radians(np.linspace(0, 115, 18))
            ys, zs = 0.3 - 0.53 * (1 - np.cos(t)), 0.025 + (height + 0.14) * np.sin(t)
            b.add(style.metal, g.tube(np.stack([0 * t, ys, zs], axis=1), 0.011, 10))
            b.add(style.metal, g.cylinder(0.15, 0, 0.03, 36, bevel=0.004).moved(y=0.3), name="foot")
            y, top = float(ys[-1]), float(zs[-1])
            b.add(style.metal, g.cylinder(0.02, top - 0.07, top + 0.01, 16).moved(y=y))
            _add_shade(b, style, shade, (top - tall, top), self.lumens, y)
            return
        _add_shade(b, style, shade, (height - tall, height), self.lumens)
        stem_top = height - 0.018
        if self.kind == "straight":
            b.add(style.metal, g.cylinder(0.14, 0, 0.022, 36, bevel=0.004), name="foot")
            b.add(style.metal, g.bar((0, 0, 0.02), (0, 0, stem_top), 0.01, 12))
        else:
            self._add_tripod(b, height - tall - 0.06, stem_top)
        b.add(OPAL, g.sphere(0.035, 14, 8).moved(z=height - 0.4 * tall - 0.05), name="bulb")

    def _add_tripod(self, b: Builder, joint: float, stem_top: float) -> None:
        rest = 0.012 * 0.265 / float(np.hypot(0.265, joint))  # the slanted end touches z = 0
        for k in range(3):
            turn = np.radians(90 + 120 * k)
            foot = (0.27 * float(np.cos(turn)), 0.27 * float(np.sin(turn)), rest)
            leg = g.tube([foot, (0.02 * foot[0], 0.02 * foot[1], joint)], [0.012, 0.016], 10)
            b.add(self.style.wood, leg)
        b.add(self.style.metal, g.cylinder(0.03, joint - 0.03, joint + 0.012, 20))
        b.add(self.style.metal, g.bar((0, 0, joint), (0, 0, stem_top), 0.007, 10))


class TableLamp(Spec, piece=("table lamp", "lamp", "on_top")):
    """A lamp with a turned ceramic or wooden body and a cloth shade."""

    body: float = between(0.2, 0.28)
    height: float = between(0.15, 0.2)
    glaze: Material = either(0.4, "wood", "accents")
    width: float = between(0.05, 0.085)
    power: float = between(0.7, 1.6)
    low: float = between(0.12, 0.16)
    narrow: float = between(0.6, 0.95)
    lumens: float = between(350, 550)

    def assemble(self, b: Builder) -> None:
        body, width, low, t = self.body, self.width, self.low, np.linspace(0, 1, 11)
        radii = 0.016 + (width - 0.016) * np.sin(np.pi * t**self.power) ** 0.8
        profile = [(0.9 * width, 0.0), (0.9 * width, 0.012)]
        for r, s in zip(radii, t, strict=True):
            profile.append((float(r), 0.012 + float(s) * (body - 0.012)))
        b.add(self.glaze, g.lathe(profile, 28), name="body")
        z0, z1 = body - 0.015, body - 0.015 + self.height
        _add_shade(b, self.style, (low, low * self.narrow), (z0, z1), self.lumens)
        b.add(self.style.metal, g.bar((0, 0, body - 0.004), (0, 0, z1 - 0.018), 0.005, 10))
        b.add(OPAL, g.sphere(0.028, 14, 8).moved(z=z0 + 0.5 * self.height), name="bulb")


class DeskLamp(Spec, piece=("desk lamp", "lamp", "on_top")):
    """A jointed desk lamp with its diffuser pointing down."""

    metal: Material = either(0.5, "metal", "accent")
    joint: float = between(0, 0.06)
    head: float = between(-0.04, 0.04)
    tilt: float = between(8, 22)
    lumens: float = between(300, 450)

    def assemble(self, b: Builder) -> None:
        metal, tilt = self.metal, self.tilt
        b.add(metal, g.cylinder(0.085, 0, 0.018, 32, bevel=0.004), name="foot")
        joint, head = (0.0, 0.09, 0.3 + self.joint), (0.0, -0.17, 0.42 + self.head)
        for side in (-0.008, 0.008):
            elbow = (side, joint[1], joint[2])
            b.add(metal, g.bar((side, 0.0, 0.016), elbow, 0.0045, 8))
            b.add(metal, g.bar(elbow, (side, head[1], head[2]), 0.0045, 8))
        hinge = g.cylinder(0.014, -0.014, 0.014, 14, bevel=0.002).turned("y", 90)
        b.add(metal, hinge.moved(*joint), hinge.moved(*head), name="hinge")
        outer = [(0.07, -0.1), (0.062, -0.07), (0.034, -0.02), (0.024, 0.02)]
        inner = [(0.021, 0.017), (0.031, -0.02), (0.058, -0.07), (0.067, -0.1)]
        cone = g.hollow_lathe([*outer, *inner], 28)
        cap, glow = g.cylinder(0.0235, 0.008, 0.021, 20), [(0.0, -0.093), (0.061, -0.09)]
        lamp = g.lathe([*glow, (0.061, -0.084)], 28)
        cone, cap, lamp = (mesh.turned("x", tilt).moved(*head) for mesh in (cone, cap, lamp))
        b.add(metal, cone, cap, name="reflector")
        b.add(OPAL, lamp, name="diffuser", lumens=self.lumens, kelvin=3200.0)


class WallLamp(Spec, piece=("wall lamp", "lamp", "on_wall")):
    """A lamp on the wall: a globe on an arm, or a half-round shade."""

    mount_height: float = between(1.6, 1.8)
    lumens: float = between(300, 500)
    radius: float | None = maybe(0.5, between(0.06, 0.085))  # of its globe

    def assemble(self, b: Builder) -> None:
        metal, glow = self.style.metal, {"lumens": self.lumens, "kelvin": self.style.kelvin}
        b.add(metal, g.cylinder(0.05, 0, 0.018, 24, bevel=0.004).turned("x", 90), name="plate")
        if self.radius:
            y = -0.09 - self.radius * 0.4
            path = [(0, -0.01, 0), (0, 0.7 * y, -0.005), (0, y, 0.0), (0, y, 0.03)]
            b.add(metal, g.tube(path, 0.007, 10))
            b.add(metal, g.lathe([(0.02, 0.02), (0.035, 0.035), (0.03, 0.045)], 20).moved(y=y))
            globe = g.sphere(self.radius, 24, 14).moved(y=y, z=0.035 + self.radius)
            b.add(OPAL, globe, name="globe", **glow)
        else:
            rings = [
                g.superellipse(half, 0.055 + 0.2 * (half - 0.07), z, 2.6, 32, y=-0.085)
                for z, half in ((-0.1, 0.07), (-0.03, 0.085), (0.1, 0.1))
            ]
            b.add(self.style.shade, g.loft(rings), name="shade", **glow)
            b.add(metal, g.bar((0, -0.01, 0), (0, -0.05, 0), 0.012, 10))


class LightStrip(Spec, piece=("mirror lamp", "lamp", "on_wall")):
    """A slim wall lamp for above a mirror or below wall cupboards."""

    width: float = 0.6
    mount_height: float = between(1.98, 2.08)
    metal: Material = either(0.6, m.CHROME, "metal")
    depth: float = between(0.036, 0.05)
    lumens: float = between(500, 800)

    def assemble(self, b: Builder) -> None:
        b.add(self.metal, g.box((0.09, 0.03, 0.04), (0, -0.015, -0.02), 0.003), name="plate")
        b.add(self.metal, g.box((self.width, 0.022, 0.03), (0, -0.055, -0.008), 0.003), name="rail")
        b.add(self.metal, g.bar((0, -0.028, 0), (0, -0.05, 0), 0.009, 8))
        size, at = (self.width - 0.02, self.depth, 0.035), (0, -0.06, -0.042)
        lamp, kelvin = g.rounded_box(size, at, 0.016, steps=2, inner=2), self.style.kelvin + 500
        b.add(OPAL, lamp, name="diffuser", lumens=self.lumens, kelvin=kelvin)
