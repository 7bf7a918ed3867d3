"""Beds with mattress, bedding and pillows; the head is at the back (+Y)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from pbrnet.scenes.arrays import BoolArray, Float64Array
from pbrnet.scenes.procedural.furniture.cabinets import feet, leg_material
from pbrnet.scenes.procedural.furniture.parts import geometry as g
from pbrnet.scenes.procedural.furniture.parts.build import Builder
from pbrnet.scenes.procedural.furniture.parts.cloth import (
    Push,
    Weave,
    block,
    normals,
    plane,
    refined,
    settle,
    solid,
    started,
    stuffed,
)
from pbrnet.scenes.procedural.furniture.spec import (
    Spec,
    between,
    chance,
    drawn,
    optional,
    pick,
    repeated,
    shape,
    when,
    whole,
)
from pbrnet.scenes.procedural.furniture.style import Style
from pbrnet.scenes.procedural.piece import Material
from pbrnet.scenes.seeds import Draw

_DUVET = 0.034  # metres thick
_CLOSE = 0.004  # metres between the layers of one that is turned back
_STEP = 0.05  # metres between the points of a duvet before it is refined


class Duvet(Spec):
    """A duvet: made with its upper end turned back, left as it was slept in, or heaped at the foot.

    The disorder of the style decides how often.
    """

    wide: float  # of the mattress
    more: float = when(lambda duvet: duvet.wide > 1, between(0.3, 0.48), between(0.4, 0.5))
    long: float = between(1.9, 2.05)
    slept: bool = drawn(lambda draw, spec: draw.chance(0.15 + 0.8 * spec.style.disorder))
    heaped: bool = drawn(lambda draw, spec: spec.slept and draw.chance(0.35))
    tight: tuple[float, float] = drawn(lambda draw, spec: _tight(draw, spec.slept, spec.heaped))
    turn: float = drawn(lambda draw, spec: draw.normal(0, 2 + 7 * spec.slept) * np.pi / 180)
    aside: float = drawn(lambda draw, spec: draw.normal(0, 0.02 + 0.1 * spec.slept))
    back: float = drawn(lambda draw, spec: 0.0 if spec.heaped else draw.between(0.25, 0.5))
    slant: float = drawn(lambda draw, spec: draw.normal(0, 0.15 + 0.35 * spec.slept))
    waves: tuple[tuple[float, float, float, float], ...] = repeated(
        7,
        between(-9, 9),
        drawn(lambda draw, spec: draw.between(-12, 12) * (1 + spec.heaped)),
        between(0, 6.3),
        between(0.4, 1),
    )
    down: float = between(0.0, 0.06)
    at_foot: bool = chance(0.6)

    def mesh(self, bodies: list[Push], top: float) -> g.BodyMesh:
        """The duvet on a mattress whose upper side is at `top`, metres."""
        wide = self.wide + self.more
        n, m = round(wide / _STEP) + 1, round(self.long / _STEP) + 1
        rest, tight = (wide / (n - 1), self.long / (m - 1)), np.array(self.tight)
        s = (np.arange(n) / (n - 1) - 0.5)[:, None] * wide
        t = np.arange(m)[None, :] * rest[1]
        fold = m - 1 - round(self.back / rest[1])  # the row along which it is turned back
        line = fold * rest[1] + self.slant * s / wide  # slanting from side to side
        over = t > line
        along = np.where(over, 2 * line - t, t)
        waves = np.zeros((n, m))
        for a, c, phase, high in self.waves:
            waves = waves + high * np.sin(a * s + c * along + phase)
        # As high as the length that is pushed together needs.
        height = 0.025 + 0.3 * float(np.sqrt(tight).max()) * (0.12 + 0.1 * self.heaped)
        x, y = s * (1 - tight[0]), along * (1 - tight[1])
        z = top + 0.07 + height * waves + 0.03 * over * (1 + np.minimum(t - line, 0.1) / 0.1)
        y = y - 0.985 + self.down - 0.14 * self.at_foot
        cosine, sine = np.round([np.cos(self.turn), np.sin(self.turn)], 9)
        place = started((x * cosine - y * sine + self.aside, x * sine + y * cosine, z))
        pushes = [*bodies, plane(1, 0.52, -1.0)]
        if self.back > 0:
            pushes.append(_turned_back(over, np.round(2 * line / rest[1] - np.arange(m)[None, :])))
        place = settle(place, rest, pushes, 150, Weave(1.0, 0.2, 0.04, 0.02), friction=0.9)
        return solid(refined(place), (0.5 * rest[0], 0.5 * rest[1]), _DUVET)


def _tight(draw: Draw, slept: bool, heaped: bool) -> tuple[float, float]:
    """Shares across and along by which a duvet is pushed together."""
    across, along = draw.uniform(0.05, 0.14, 2).tolist() if slept else (0.035, 0.045)
    return (draw.between(0.08, 0.16), draw.between(0.3, 0.45)) if heaped else (across, along)


def _turned_back(over: BoolArray, below: Float64Array) -> Push:
    """Keep the points that are turned back, `over`, off those under them, in column `below`."""
    m = over.shape[1]
    column = np.clip(below, 0, m - 1).astype(np.int64)
    row = np.broadcast_to(np.arange(over.shape[0])[:, None], over.shape)

    def push(place: Float64Array) -> BoolArray:
        under, facing = place[:, row, column], normals(place)[:, row, column]
        offset = place - under
        depth = offset[0] * facing[0] + offset[1] * facing[1] + offset[2] * facing[2]
        hit = over & (depth < _CLOSE)
        place += np.where(hit, (_CLOSE - depth) * facing, 0.0)
        return hit

    return push


class Pillow(Spec):
    """A pillow that leans at the head of a bed."""

    row: int  # from the head
    lean: float = between(24, 36)
    form: int = whole(0, 4)
    turned: bool = chance(0.5)
    askew: float = drawn(lambda draw, spec: draw.normal(0, 2 + 9 * spec.style.disorder))


class BedCushion(Spec):
    """A small cushion before the pillows."""

    form: int = whole(0, 4)
    askew: float = drawn(lambda draw, spec: draw.normal(0, 10))


class Bed(Spec):
    """A bed with mattress, bedding and pillows; `width` of the mattress in metres."""

    sleepers: ClassVar[int]
    width: float
    form: str = shape("bed", "padded", "padded", "panel", "slats")
    frame: Material = drawn(lambda draw, spec: _frame(draw, spec.style, spec.form))
    rail_low: float = between(0.12, 0.2)
    rail_high: float = between(0.32, 0.38)
    head: float = between(0.9, 1.15)
    mattress: float = between(0.18, 0.22)
    duvet: Duvet = drawn(lambda draw, spec: Duvet.draw(draw, spec.style, wide=spec.width))
    rows: int
    pillows: tuple[Pillow, ...] = drawn(
        lambda draw, spec: tuple(
            Pillow.draw(draw, spec.style, row=row)
            for _ in range(spec.sleepers)
            for row in range(spec.rows)
        )
    )
    cushion: BedCushion | None = optional(0.45, BedCushion)

    @property
    def outer(self) -> float:
        """Width with the frame, metres."""
        return self.width + 0.08

    def assemble(self, b: Builder) -> None:
        middle = (_BED_FRONT + _BED_BACK) / 2  # moved to the origin below
        sizes = (self.outer, _BED_BACK - _BED_FRONT, self.rail_low + 0.02, 0.06, 0.02)
        legs = (mesh.moved(y=middle) for mesh in feet(self.style, *sizes))
        b.add(leg_material(self.style, self.style.wood), *legs)
        (self._add_padded if self.form == "padded" else self._add_boards)(b, middle)
        mattress_z = self.rail_high - 0.06
        top = mattress_z + self.mattress
        sheet = Material("fabric", (0.8, 0.79, 0.76), 0.95)
        size = (self.width, _LONG, top - mattress_z)
        b.add(sheet, g.rounded_box(size, (0, 0, mattress_z), 0.05, (0, 0, 0.006)), name="mattress")
        with b.holding("duvet", "bedding"):
            b.add(self.style.bedding, self._duvet(mattress_z, top), name="duvet")
        self._add_pillows(b, sheet, top)
        b.move(y=-middle)

    def _add_padded(self, b: Builder, middle: float) -> None:
        frame, outer, head = self.frame, self.outer, self.head
        low, high = self.rail_low, self.rail_high
        size = (outer, _BED_BACK - _BED_FRONT - 0.06, high - low)
        b.add(frame, g.rounded_box(size, (0, middle - 0.03, low), 0.025))
        board = (outer + 0.04, 0.1, head - 0.08), (0, _BED_BACK - 0.05, 0.08)
        b.add(frame, g.rounded_box(*board, 0.035, (0, 0.006, 0)))
        columns = max(3, round(outer / 0.3))
        each = outer / columns
        size = (each - 0.006, 0.05, head - high - 0.12)
        for k in range(columns):
            at = (-outer / 2 + (k + 0.5) * each, _BED_BACK - 0.1, high + 0.08)
            b.add(frame, g.rounded_box(size, at, 0.022, (0, 0.012, 0), steps=1))

    def _add_boards(self, b: Builder, middle: float) -> None:
        frame, outer, head = self.frame, self.outer, self.head
        low, high = self.rail_low, self.rail_high
        for side in (-1, 1):
            at = (side * (outer / 2 - 0.014), -0.0, low)
            b.add(frame, g.box((0.028, _LONG + 0.02, high - low), at, 0.003))
        b.add(frame, g.box((outer, 0.03, high - low + 0.001), (0, _BED_FRONT + 0.015, low), 0.003))
        corner = (-outer / 2 + 0.02, _BED_FRONT + 0.034, low + 0.02)
        b.add(frame, g.span(corner, (outer / 2 - 0.02, _LONG / 2, low + 0.05)))
        y = _BED_BACK - 0.035
        if self.form == "panel":
            at = (0, _BED_BACK - 0.03, 0.1)
            b.add(frame, g.box((outer + 0.02, 0.032, head - 0.1), at, 0.005))
            return
        for side in (-1, 1):  # posts; the legs beside them reach a millimetre lower
            mesh = g.box((0.05, 0.045, head - 0.001), (side * (outer / 2 - 0.005), y, 0.001), 0.005)
            b.add(frame, mesh)
        for z in np.arange(high, head - 0.12, 0.16):
            b.add(frame, g.box((outer - 0.06, 0.022, 0.12), (0, y, float(z)), 0.003))

    def _duvet(self, mattress_z: float, top: float) -> g.BodyMesh:
        half, outer, gap = self.width / 2, self.outer / 2, _DUVET + 0.005
        bodies = [
            block((-half, -_LONG / 2, mattress_z), (half, _LONG / 2, top), 0.05, gap),
            block((-outer, _BED_FRONT, 0.0), (outer, _LONG / 2, self.rail_high), 0.02, gap),
            plane(2, 0.045),
            plane(1, _BED_FRONT - 0.1),
            *(plane(0, -side * (outer + 0.13), side) for side in (-1.0, 1.0)),
        ]
        return self.duvet.mesh(bodies, top)

    def _add_pillows(self, b: Builder, sheet: Material, top: float) -> None:
        size = (min(0.72, self.width / self.sleepers - 0.06), 0.46, 0.17)
        for number, each in enumerate(self.pillows):
            x = (number // self.rows - (self.sleepers - 1) / 2) * (self.width / 2)
            back = each.row
            at = (x, _LONG / 2 - 0.22 - 0.17 * back, top + 0.215 - 0.035 * back - 0.085)
            flat = stuffed(size, each.form, dented=True, turned=each.turned).turned("z", each.askew)
            pillow = flat.turned("x", each.lean + 14 * (back == 0)).moved(*at)
            cloth = self.style.bedding if back == 1 else sheet
            _add_sunk(b, "pillow", cloth, pillow, top - 0.012)
        if self.cushion:
            flat = stuffed((0.4, 0.3, 0.14), self.cushion.form).turned("z", self.cushion.askew)
            cushion = flat.turned("x", 48).moved(0.0, _LONG / 2 - 0.58, top + 0.1)
            _add_sunk(b, "cushion", self.style.cushions[0], cushion, top - 0.01)


_LONG = 2.0  # metres, length of a mattress
_BED_BACK, _BED_FRONT = _LONG / 2 + 0.08, -_LONG / 2 - 0.04


def _frame(draw: Draw, style: Style, form: str) -> Material:
    if form == "padded":
        return style.upholstery
    return style.wood if draw.chance(0.7) else style.lacquer


def _add_sunk(b: Builder, name: str, cloth: Material, mesh: g.BodyMesh, z: float) -> None:
    """Add a cushion, an object of its own, whose lowest point is at `z`: it sinks in."""
    with b.holding(name, "cushion"):
        b.add(cloth, mesh.moved(z=z - float(mesh.vertices[:, 2].min())), name=name)


class DoubleBed(Bed, piece=("double bed", "bed", "wall"), front_clearance=0.5, side_clearance=0.5):
    """A double bed; `width` of the mattress in metres."""

    sleepers = 2
    width: float = pick(1.4, 1.6, 1.8)
    rows: int = drawn(lambda draw, spec: 2 if draw.chance(0.6) else 1)


class SingleBed(Bed, piece=("single bed", "bed", "wall"), front_clearance=0.5):
    """A single bed; `width` of the mattress in metres."""

    sleepers = 1
    width: float = 0.9
    rows: int = 1
