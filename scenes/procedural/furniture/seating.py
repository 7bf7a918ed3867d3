"""Chairs, armchairs, sofas, stools."""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.procedural.furniture import materials as m
from pbrnet.scenes.procedural.furniture.cabinets import add_feet, leg_material
from pbrnet.scenes.procedural.furniture.parts import geometry as g
from pbrnet.scenes.procedural.furniture.parts.build import Builder
from pbrnet.scenes.procedural.furniture.parts.cloth import stuffed
from pbrnet.scenes.procedural.furniture.spec import (
    Spec,
    any_of,
    between,
    by,
    chance,
    drawn,
    either,
    repeated,
    several,
    shape,
    when,
    whole,
)
from pbrnet.scenes.procedural.furniture.style import Style
from pbrnet.scenes.procedural.piece import Material
from pbrnet.scenes.seeds import Draw

_CHAIRS = ("slats", "rails", "pad", "spindles", "shell")
_SPARS = {"slats": whole(4, 7), "spindles": whole(6, 9), "rails": whole(3, 5)}  # in a back


class DiningChair(Spec, piece=("dining chair", "chair", "free"), front_clearance=0.5):
    """A wooden chair with a back of slats, rails, spindles or a pad, or a moulded shell on legs."""

    frame: WoodenChair | ShellChair = drawn(
        lambda draw, spec: _chair(draw, spec.style, spec.style.shape(draw, "chair", _CHAIRS))
    )

    def assemble(self, b: Builder) -> None:
        self.frame.assemble(b)


def _chair(draw: Draw, style: Style, back: str) -> WoodenChair | ShellChair:
    if back == "shell":
        return ShellChair.draw(draw, style)
    return WoodenChair.draw(draw, style, back=back)


class WoodenChair(Spec):
    """A wooden chair with a back of slats, rails, spindles or a pad."""

    back: str
    width: float = between(0.42, 0.47)
    depth: float = between(0.42, 0.46)
    seat: float = between(0.44, 0.47)
    top: float = between(0.84, 0.98)
    wood: Material = either(0.75, "wood", "lacquer")
    padded: bool = drawn(lambda draw, spec: spec.back == "pad" or draw.chance(0.5))
    lean: float = between(0.06, 0.1)
    spars: int = by("back", _SPARS, 0)

    @property
    def front(self) -> float:
        return -self.depth / 2 + 0.03

    @property
    def rear(self) -> float:
        return self.depth / 2 - 0.05

    def _on_back(self, z: float) -> float:
        """Place of the back at height `z`: y in metres."""
        share = (z - self.seat) / (self.top - self.seat)
        return float(self.rear + self.lean * np.interp(share, [0, 0.6, 1], [0, 0.4, 1]))

    def assemble(self, b: Builder) -> None:
        thick, seat, front, rear = 0.036, self.seat, self.front, self.rear
        x, under, wood = self.width / 2 - thick / 2, seat - 0.03, self.wood
        foot = [(0.7 * thick, 0.7 * thick), (thick, thick)]
        sizes = [(0.028, 0.03), (0.03, thick), (0.03, thick), (0.028, 0.028), (0.026, 0.022)]
        for side in (-1, 1):
            points = [(rear + 0.045, 0), (rear, 0.5 * seat), (rear, seat)]
            points += [(rear + 0.4 * self.lean, 0.6 * self.top + 0.4 * seat)]
            points += [(rear + self.lean, self.top)]
            middle = (front + rear) / 2
            b.add(
                wood,
                g.post([(side * x, front, 0), (side * x, front, under + 0.002)], foot),
                g.post([(side * x, y, z) for y, z in points], sizes),
                # Rails below the seat and a stretcher between the legs.
                g.box((0.018, rear - front - 0.03, 0.05), (side * x, middle, under - 0.05)),
                g.box((0.016, rear - front, 0.024), (side * x, middle + 0.01, 0.16)),
            )
        b.add(
            wood,
            g.box((2 * x - 0.034, 0.018, 0.05), (0, front, under - 0.05)),
            g.box((2 * x - 0.028, 0.018, 0.05), (0, rear, under - 0.05)),
            g.box((2 * x - 0.014, 0.016, 0.022), (0, (front + rear) / 2, 0.161)),
        )
        deep, y, width = rear - front + 0.05, (front + rear) / 2 - 0.025, self.width
        if self.padded:
            b.add(wood, g.box((width - 0.02, deep - 0.02, 0.012), (0, y, under)))
            pad = g.rounded_box((width, deep, 0.045), (0, y, under + 0.01), 0.02, (0, 0, 0.012))
            b.add(self.style.second_upholstery, pad)
        else:
            b.add(wood, g.box((width, deep, 0.028), (0, y, under), bevel=0.008, grain="y"))
        self._add_back(b, 2 * x - 0.02, self.top - 0.05)

    def _add_back(self, b: Builder, inner: float, high: float) -> None:
        wood, seat, on_back, count = self.wood, self.seat, self._on_back, self.spars
        if self.back == "slats":
            low = seat + 0.1
            for z in (low, high):
                b.add(wood, g.box((inner, 0.02, 0.05), (0, on_back(z + 0.025), z), bevel=0.004))
            for k in range(count):
                sx = (k - (count - 1) / 2) * inner / count
                points = [(sx, on_back(z), z) for z in np.linspace(low + 0.03, high + 0.02, 4)]
                b.add(wood, g.post(points, [(0.5 * inner / count, 0.01)] * 4))
        elif self.back == "spindles":
            b.add(wood, g.box((inner + 0.03, 0.024, 0.045), (0, on_back(high), high), bevel=0.008))
            for k in range(count):
                share = (k - (count - 1) / 2) / (count - 1)
                foot = (0.72 * inner * share, on_back(seat + 0.02) - 0.012, seat - 0.008)
                tip = (0.88 * inner * share, on_back(high) + 0.002, high + 0.01)
                b.add(wood, g.bar(foot, tip, 0.0065, 8))
        elif self.back == "rails":
            for k in range(count):
                z = high - k * 0.105
                if z > seat + 0.08:
                    rail = g.box((inner, 0.016, 0.055), (0, on_back(z + 0.03), z), bevel=0.005)
                    b.add(wood, rail)
        else:
            lean = -float(np.degrees(np.arctan2(self.lean, self.top - seat)))
            size = (inner + 0.01, 0.05, self.top - seat - 0.13)
            pad = g.rounded_box(size, (0, 0, 0), 0.022, (0, 0.012, 0)).turned("x", lean)
            pad = pad.moved(y=on_back(seat + 0.12) + 0.002, z=seat + 0.11)
            b.add(self.style.second_upholstery, pad)


class ShellChair(Spec):
    """A chair with seat and back of one moulded shell, on four splayed legs."""

    width: float = between(0.43, 0.47)
    seat: float = between(0.44, 0.47)
    top: float = between(0.79, 0.86)
    paint: Material = either(0.5, "lacquer", "accents")
    wooden: bool = chance(0.35)

    def assemble(self, b: Builder) -> None:
        style, seat, top = self.style, self.seat, self.top
        # Profile of the shell from the front edge of the seat to the top of the back: y, z.
        profile = np.array([
            (-0.215, seat - 0.025), (-0.2, seat - 0.006), (-0.13, seat), (-0.02, seat - 0.012),
            (0.08, seat - 0.008), (0.135, seat + 0.022), (0.158, seat + 0.075), (0.17, seat + 0.16),
            (0.195, 0.5 * (seat + top) + 0.08), (0.212, top),
        ])  # fmt: skip
        wide = np.array([0.8, 0.92, 1.0, 1.0, 0.97, 0.93, 0.92, 0.96, 0.9, 0.62])
        across = np.linspace(-1, 1, 11)
        cup = np.array([0.004, 0.008, 0.016, 0.02, 0.022, 0.03, 0.035, 0.03, 0.02, 0.008])
        points = np.empty((len(across), len(profile), 3))
        points[..., 0] = across[:, None] * (0.5 * self.width * wide)
        # The sides of the seat curve up, those of the back forwards.
        lying = np.clip((0.17 - profile[:, 0]) / 0.1, 0, 1) * (profile[:, 1] < seat + 0.05)
        points[..., 1] = profile[:, 0] - (1 - lying) * cup * across[:, None] ** 2
        points[..., 2] = profile[:, 1] + lying * cup * across[:, None] ** 2
        shell = style.wood if self.wooden else self.paint
        b.add(shell, g.thick_sheet(points, 0.008), name="shell")
        frame = leg_material(style, style.wood)
        thick, under = 0.018 if frame.kind == "metal" else 0.032, seat - 0.03
        b.add(frame, g.box((0.24, 0.2, 0.014), (0, -0.02, under - 0.012), 0.002))
        for sx in (-1, 1):
            for y, foot in ((-0.1, -0.2), (0.06, 0.19)):
                ends = [(sx * 0.2, foot, 0), (sx * 0.1, y, under - 0.004)]
                b.add(frame, g.post(ends, [(0.6 * thick, 0.6 * thick), (thick, thick)]))


class LooseCushion(Spec):
    """A cushion that leans in a corner of a couch."""

    size: float = between(0.38, 0.46)
    aside: float = between(0.0, 0.06)
    form: int = whole(0, 5)
    turned: bool = chance(0.5)
    askew: float = drawn(lambda draw, spec: draw.normal(0, 2 + 7 * spec.style.disorder))
    lean: float = between(20, 28)
    inwards: float = between(5, 22)
    cloth: Material = any_of("cushions")

    def mesh(self, end: int) -> g.BodyMesh:
        """The cushion at an end of the couch (-1, 1) or between (0), about the origin."""
        flat = stuffed((self.size, self.size, 0.15), self.form, turned=self.turned).moved(z=-0.075)
        upright = flat.turned("z", self.askew).turned("x", 90 - self.lean)
        return upright.turned("z", -end * self.inwards)


class Couch(Spec):
    """Parts that armchairs and sofas share: a frame, arms, cushions to sit and lean on."""

    width: float  # with its arms
    seats: int
    depth: float = between(0.84, 0.96)
    seat: float = between(0.41, 0.46)
    back_top: float = between(0.76, 0.9)
    arm_top: float = between(0.56, 0.66)
    arm: float = between(0.12, 0.2)
    foot: float = between(0.08, 0.16)
    form: str = shape("sofa", "block", "slim", "low", "rolled")
    cloth: Material
    legs: Material = either(0.4, "dark_wood", "wood")
    leans: tuple[float, ...] = repeated(lambda spec: spec.seats, between(9, 14))
    loose: tuple[LooseCushion, ...]

    def measures(self) -> tuple[float, float, float, float]:
        """Width of an arm, heights of the feet, the arms and the back; metres."""
        arm, foot, arm_z, back_z = self.arm, self.foot, self.arm_top, self.back_top
        if self.form == "slim":  # thin arms and high legs
            arm, foot, arm_z = 0.55 * arm, foot + 0.06, arm_z + 0.01
        elif self.form == "low":  # broad arms as high as the back, close to the floor
            arm, foot, arm_z, back_z = arm + 0.04, 0.035, arm_z + 0.03, back_z - 0.05
            back_z = max(back_z, 0.78)
        return arm, foot, min(arm_z, 0.84 * back_z - 0.055 * (self.form == "rolled")), back_z

    def assemble(self, b: Builder) -> None:
        width, depth, seat_z, cloth = self.width, self.depth, self.seat, self.cloth
        arm, foot, arm_z, back_z = self.measures()
        back, cushion = 0.17, 0.15
        add_feet(b, self.style, self.legs, width, depth, foot + 0.02, 0.045, 0.03)
        size = (width - 0.03, depth - 0.05, seat_z - cushion - foot)
        rest = (width - 0.04, back, back_z - foot - 0.03)
        behind = g.rounded_box(rest, (0, depth / 2 - back / 2, foot + 0.01), 0.05)
        b.add(cloth, g.rounded_box(size, (0, 0, foot), 0.02, inner=2), behind)
        radius = min(0.035 if arm < 0.16 else 0.06, 0.45 * arm)
        for side in (-1, 1):
            x = side * (width / 2 - arm / 2)
            size, at = (arm, depth - 0.01, arm_z - foot), (x, -0.005, foot)
            b.add(cloth, g.rounded_box(size, at, radius, (0.008, 0, 0.01)))
            if self.form == "rolled":
                roll = g.cylinder(0.085, 0, depth - 0.02, 28, bevel=0.02).turned("x", 90)
                b.add(cloth, roll.moved(x, depth / 2 - 0.012, arm_z - 0.03))
        inner = width - 2 * arm
        each, deep = inner / self.seats, depth - back - 0.01
        for k, lean in enumerate(self.leans):
            x = -inner / 2 + (k + 0.5) * each
            at = (x, -depth / 2 + deep / 2 - 0.005, seat_z - cushion - 0.002)
            size, rest = (each - 0.006, deep, cushion), (each - 0.012, 0.17, back_z - seat_z + 0.06)
            leaning = g.rounded_box(rest, (0, 0, 0), 0.06, (0, 0.03, 0.015), inner=4)
            leaning = leaning.turned("x", -lean).moved(x, depth / 2 - back - 0.115, seat_z + 0.025)
            b.add(cloth, g.rounded_box(size, at, 0.04, (0, 0.005, 0.022), inner=4), leaning)
        for loose, end in zip(self.loose, (-1, 1, 0), strict=False):
            x, mesh = end * (inner / 2 - loose.size / 2 - loose.aside), loose.mesh(end)
            lowest = float(mesh.vertices[:, 2].min()) + 0.012  # it sinks in
            with b.holding("cushion", "cushion"):
                placed = mesh.moved(x, depth / 2 - back - 0.29, seat_z - lowest)
                b.add(loose.cloth, placed, name="cushion")
        if b.name == "sofa" and len(self.loose) == 2:  # between the cushions at its ends
            b.surface(0, -depth / 2 + 0.22, seat_z + 0.008, inner / 2 - 0.62, 0.17)


class Armchair(Couch, piece=("armchair", "armchair", "free"), front_clearance=0.45):
    """An upholstered armchair."""

    width: float = between(0.78, 0.92)
    seats: int = 1
    cloth: Material = either(0.6, "second_upholstery", "upholstery")
    loose: tuple[LooseCushion, ...] = several(LooseCushion, 0, 2)


class Sofa(Couch, piece=("sofa", "sofa", "wall"), front_clearance=0.45):
    """A sofa of two or three seats with loose cushions; `width` includes the arms, metres."""

    width: float = between(1.6, 2.35)
    seats: int = drawn(lambda draw, spec: 3 if spec.width > 1.95 else 2)
    cloth: Material = drawn(lambda draw, spec: spec.style.upholstery)
    loose: tuple[LooseCushion, ...] = several(LooseCushion, 2, 4)


class Stool(Spec, piece=("stool", "stool", "free")):
    """A round stool, low or of bar height."""

    high: bool = chance(0.35)
    seat: float = when("high", between(0.62, 0.68), between(0.43, 0.48))
    radius: float = between(0.15, 0.19)
    wooden: bool = chance(0.5)

    def assemble(self, b: Builder) -> None:
        b.name = "bar stool" if self.high else "stool"
        seat, radius, wood = self.seat, self.radius, self.style.wood
        frame = leg_material(self.style, wood)
        size = 0.024 if self.style.legs == "metal" else 0.034
        spread, ring = radius * (1.15 if self.high else 1.05), 0.35 * seat
        for k in range(4):
            angle = np.pi / 4 + k * np.pi / 2
            c, s = float(np.cos(angle)), float(np.sin(angle))
            foot, top = (
                (spread * c, spread * s, 0),
                (0.62 * radius * c, 0.62 * radius * s, seat - 0.02),
            )
            b.add(frame, g.post([foot, top], [(0.8 * size, 0.8 * size), (size, size)]))
        at_ring = spread + (0.62 * radius - spread) * ring / (seat - 0.02)
        turn = np.pi / 4 + np.arange(4) * np.pi / 2
        corners = np.stack([at_ring * np.cos(turn), at_ring * np.sin(turn), np.full(4, ring)], 1)
        for k in range(4):
            b.add(frame, g.bar(corners[k], corners[(k + 1) % 4], 0.009, 8))
        if self.wooden:
            b.add(wood, g.cylinder(radius, seat - 0.035, seat, 32, bevel=0.008))
            return
        b.add(wood, g.cylinder(radius - 0.01, seat - 0.045, seat - 0.028, 32))
        profile = [(radius - 0.012, seat - 0.03), (radius - 0.003, seat - 0.022)]
        profile += [(radius, seat - 0.01), (radius - 0.003, seat + 0.002)]
        profile += [(radius - 0.014, seat + 0.011), (0.75 * radius, seat + 0.019)]
        b.add(self.style.second_upholstery, g.lathe([*profile, (0, seat + 0.024)], 32))


class OfficeChair(Spec, piece=("office chair", "chair", "free"), front_clearance=0.4):
    """A swivel chair on a five-armed base with castors."""

    seat: float = between(0.45, 0.51)
    base: Material = either(0.4, m.CHROME, m.BLACK_PLASTIC)
    cloth: Material = either(0.5, "second_upholstery", "upholstery")
    start: float = between(0, 72)
    castors: tuple[float, ...] = repeated(5, between(0, 360))
    height: float = between(0.46, 0.64)
    has_arms: bool = chance(0.75)

    def assemble(self, b: Builder) -> None:
        self._add_base(b)
        seat, cloth = self.seat, self.cloth
        low = g.box((0.2, 0.24, 0.03), (0, 0, seat - 0.1), bevel=0.006)
        b.add(m.BLACK_PLASTIC, low, g.rounded_box((0.46, 0.46, 0.03), (0, 0, seat - 0.075), 0.012))
        at = (0, -0.01, seat - 0.055)
        b.add(cloth, g.rounded_box((0.49, 0.48, 0.075), at, 0.035, (0, 0, 0.012)))
        back = g.rounded_box((0.46, 0.065, self.height), (0, 0, 0), 0.03, (0, 0.01, 0))
        back.vertices[:, 1] -= 0.5 * back.vertices[:, 0] ** 2  # concave towards the seat
        b.add(cloth, back.turned("x", -8).moved(y=0.235, z=seat + 0.1))
        path = [(0, 0.1, seat - 0.08), (0, 0.25, seat - 0.07), (0, 0.3, seat), (0, 0.3, seat + 0.3)]
        b.add(m.BLACK_PLASTIC, g.tube(path, [0.018, 0.02, 0.02, 0.016], 10))
        for side in (-1, 1) if self.has_arms else ():
            corners = ((0.16, -0.07), (0.27, -0.06), (0.29, 0.0), (0.29, 0.19))
            stem = g.tube([(side * x, 0.03, seat + z) for x, z in corners], 0.014, 10)
            pad = g.rounded_box((0.075, 0.25, 0.03), (side * 0.29, -0.01, seat + 0.18), 0.013)
            b.add(m.BLACK_PLASTIC, stem, pad)

    def _add_base(self, b: Builder) -> None:
        ends = ((0.02, 0.026, 0.115, 0.02), (0.31, 0.015, 0.078, 0.009))
        for k, castor in enumerate(self.castors):
            at = self.start + 72 * k
            rings = [
                np.array([[x, -w, z - t], [x, w, z - t], [x, w, z + t], [x, -w, z + t]])
                for x, w, z, t in ends
            ]
            b.add(self.base, g.loft(rings).turned("z", at))
            wheel = g.cylinder(0.028, -0.009, 0.009, 16, bevel=0.003).turned("x", 90)
            for side in (-1, 1):
                rolling = wheel.moved(y=0.014 * side).turned("z", castor).moved(0.295, 0, 0.028)
                b.add(m.RUBBER, rolling.turned("z", at))
            b.add(m.RUBBER, g.cylinder(0.008, 0.028, 0.072, 8).moved(x=0.295).turned("z", at))
        b.add(self.base, g.cylinder(0.035, 0.085, 0.14, 20), g.cylinder(0.026, 0.13, 0.28, 20))
        b.add(m.CHROME, g.cylinder(0.016, 0.27, self.seat - 0.09, 16))


class Pouf(Spec, piece=("pouf", "stool", "free")):
    """A round upholstered footstool."""

    radius: float = between(0.22, 0.3)
    height: float = between(0.34, 0.42)

    def assemble(self, b: Builder) -> None:
        radius, height = self.radius, self.height
        shares = ((0.3, 1.0), (0.48, 0.985), (0.5, 0.965), (0.52, 0.985), (0.7, 1.0), (0.93, 0.92))
        outline = [(0.0, 0.86), (0.02, 0.94), *((z * height, share) for z, share in shares)]
        outline += [(0.985 * height, 0.75), (height, 0.4), (1.004 * height, 0.05)]
        rings = [g.superellipse(radius * wide, radius * wide, z, 2.0, 36) for z, wide in outline]
        b.add(self.style.second_upholstery, g.loft(rings))
        b.add(self.style.dark_wood, g.sphere(0.014, 12, 6).scaled(z=0.5).moved(z=1.004 * height))
        b.surface(0, 0, height, 0.6 * radius, 0.6 * radius)


class Bench(Spec, piece=("bench", "bench", "wall"), front_clearance=0.4):
    """A plain wooden bench, for the hall or along a table."""

    width: float = between(0.95, 1.5)
    depth: float = between(0.32, 0.38)
    height: float = between(0.43, 0.47)

    def assemble(self, b: Builder) -> None:
        width, depth, height, wood = self.width, self.depth, self.height, self.style.wood
        add_feet(b, self.style, wood, width, depth, height - 0.03, 0.045, 0.04, splay=0.01)
        each = depth / 3
        for k in range(3):
            at = (0, (k - 1) * each, height - 0.032)
            b.add(wood, g.box((width, each - 0.006, 0.032), at, 0.004, grain="x"))
        for sx in (-1, 1):
            x = sx * (width / 2 - 0.12)
            b.add(wood, g.box((0.03, depth - 0.1, 0.04), (x, 0, height - 0.071)))
        b.surface(0, 0, height, width / 2 - 0.05, depth / 2 - 0.03)
