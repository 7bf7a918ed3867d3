"""Beds with mattress, bedding and pillows; the head is at the back (+Y)."""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.arrays import BoolArray, Float64Array
from pbrnet.scenes.procedural.furniture.build import Builder
from pbrnet.scenes.procedural.furniture.cabinets import feet, leg_material
from pbrnet.scenes.procedural.furniture.cloth import (
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
from pbrnet.scenes.procedural.furniture.geometry import BodyMesh, box, rounded_box, span
from pbrnet.scenes.procedural.furniture.style import Style
from pbrnet.scenes.procedural.piece import FurniturePiece, Material


def double_bed(
    rng: np.random.Generator, style: Style, width: float | None = None
) -> FurniturePiece:
    """A double bed; `width` of the mattress in metres."""
    width = float(rng.choice([1.4, 1.6, 1.8])) if width is None else width
    return _bed(rng, style, "double bed", width, 2)


def single_bed(rng: np.random.Generator, style: Style, width: float = 0.9) -> FurniturePiece:
    """A single bed; `width` of the mattress in metres."""
    return _bed(rng, style, "single bed", width, 1)


_DUVET = 0.034  # metres thick
_CLOSE = 0.004  # metres between the layers of one that is turned back
_STEP = 0.05  # metres between the points of a duvet before it is refined


def _duvet(
    rng: np.random.Generator, bodies: list[Push], width: float, top: float, untidy: float
) -> BodyMesh:
    """A duvet on a mattress `width` wide with its upper side at `top`, metres.

    Made with its upper end turned back, left as it was slept in, or heaped at the foot; `untidy`
    in [0, 1] decides how often.
    """
    wide = width + float(rng.uniform(0.3, 0.48) if width > 1 else rng.uniform(0.4, 0.5))
    long = float(rng.uniform(1.9, 2.05))
    n, m = round(wide / _STEP) + 1, round(long / _STEP) + 1
    rest = (wide / (n - 1), long / (m - 1))
    slept = rng.random() < 0.15 + 0.8 * untidy
    heaped = slept and rng.random() < 0.35
    tight = rng.uniform(0.05, 0.14, 2) if slept else np.array([0.035, 0.045])
    if heaped:
        tight = np.array([float(rng.uniform(0.08, 0.16)), float(rng.uniform(0.3, 0.45))])
    turn = float(rng.normal(0, 2 + 7 * slept)) * np.pi / 180
    aside = float(rng.normal(0, 0.02 + 0.1 * slept))
    s = (np.arange(n) / (n - 1) - 0.5)[:, None] * wide
    t = np.arange(m)[None, :] * rest[1]
    back = 0.0 if heaped else float(rng.uniform(0.25, 0.5))
    fold = m - 1 - round(back / rest[1])  # the row along which it is turned back
    slant = float(rng.normal(0, 0.15 + 0.35 * slept))  # of the fold, metres from side to side
    line = fold * rest[1] + slant * s / wide
    over = t > line
    along = np.where(over, 2 * line - t, t)
    waves = np.zeros((n, m))
    for _ in range(7):
        a, c, phase = rng.uniform(-9, 9), rng.uniform(-12, 12) * (1 + heaped), rng.uniform(0, 6.3)
        waves = waves + rng.uniform(0.4, 1) * np.sin(a * s + c * along + phase)
    # As high as the length that is pushed together needs.
    height = 0.025 + 0.3 * float(np.sqrt(tight).max()) * (0.12 + 0.1 * heaped)
    x = s * (1 - tight[0])
    y = along * (1 - tight[1])
    z = top + 0.07 + height * waves + 0.03 * over * (1 + np.minimum(t - line, 0.1) / 0.1)
    y = y - 0.985 + float(rng.uniform(0.0, 0.06)) - 0.14 * (rng.random() < 0.6)
    cosine, sine = np.round([np.cos(turn), np.sin(turn)], 9)
    place = started((x * cosine - y * sine + aside, x * sine + y * cosine, z))
    pushes = [*bodies, plane(1, 0.52, -1.0)]
    if back > 0:
        pushes.append(_turned_back(over, np.round(2 * line / rest[1] - np.arange(m)[None, :])))
    weave = Weave(1.0, 0.2, 0.04, 0.02)
    place = settle(place, rest, pushes, 150, weave, friction=0.9)
    fine = refined(place)
    return solid(fine, (0.5 * rest[0], 0.5 * rest[1]), _DUVET)


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


def _bed(
    rng: np.random.Generator, style: Style, name: str, width: float, sleepers: int
) -> FurniturePiece:
    length = 2.0
    b = Builder(name, "bed", "wall", front_clearance=0.5, side_clearance=0.5 * (sleepers == 2))
    outer = width + 0.08
    built = style.shape(rng, "bed", ("padded", "padded", "panel", "slats"))
    padded = built == "padded"
    frame = style.upholstery if padded else (style.wood if rng.random() < 0.7 else style.lacquer)
    rail_low, rail_high = rng.uniform(0.12, 0.2), rng.uniform(0.32, 0.38)
    head = float(rng.uniform(0.9, 1.15))
    back = length / 2 + 0.08
    front = -length / 2 - 0.04
    middle = (front + back) / 2  # moved to the origin below
    parts = Builder("", "", "free")
    parts.add(
        leg_material(style, style.wood),
        *(m.moved(y=middle) for m in feet(style, outer, back - front, rail_low + 0.02, 0.06, 0.02)),
    )
    if padded:
        parts.add(
            frame,
            rounded_box(
                (outer, back - front - 0.06, rail_high - rail_low),
                (0, middle - 0.03, rail_low),
                0.025,
            ),
        )
        parts.add(
            frame,
            rounded_box(
                (outer + 0.04, 0.1, head - 0.08), (0, back - 0.05, 0.08), 0.035, (0, 0.006, 0)
            ),
        )
        columns = max(3, round(outer / 0.3))
        for k in range(columns):
            each = outer / columns
            parts.add(
                frame,
                rounded_box(
                    (each - 0.006, 0.05, head - rail_high - 0.12),
                    (-outer / 2 + (k + 0.5) * each, back - 0.1, rail_high + 0.08),
                    0.022,
                    (0, 0.012, 0),
                    steps=1,
                ),
            )
    else:
        for side in (-1, 1):
            parts.add(
                frame,
                box(
                    (0.028, length + 0.02, rail_high - rail_low),
                    (side * (outer / 2 - 0.014), -0.0, rail_low),
                    0.003,
                ),
            )
        parts.add(
            frame,
            box((outer, 0.03, rail_high - rail_low + 0.001), (0, front + 0.015, rail_low), 0.003),
        )
        parts.add(
            frame,
            span(
                (-outer / 2 + 0.02, front + 0.034, rail_low + 0.02),
                (outer / 2 - 0.02, length / 2, rail_low + 0.05),
            ),
        )
        if built == "panel":
            parts.add(frame, box((outer + 0.02, 0.032, head - 0.1), (0, back - 0.03, 0.1), 0.005))
        else:
            for side in (-1, 1):  # posts; the legs beside them reach a millimetre lower
                at = (side * (outer / 2 - 0.005), back - 0.035, 0.001)
                parts.add(frame, box((0.05, 0.045, head - 0.001), at, 0.005))
            for z in np.arange(rail_high, head - 0.12, 0.16):
                parts.add(
                    frame, box((outer - 0.06, 0.022, 0.12), (0, back - 0.035, float(z)), 0.003)
                )
    mattress_z = rail_high - 0.06
    top = mattress_z + float(rng.uniform(0.18, 0.22))
    sheet = Material("fabric", (0.8, 0.79, 0.76), 0.95)
    parts.add(
        sheet,
        rounded_box((width, length, top - mattress_z), (0, 0, mattress_z), 0.05, (0, 0, 0.006)),
        name="mattress",
    )
    gap = _DUVET + 0.005
    bodies = [
        block((-width / 2, -length / 2, mattress_z), (width / 2, length / 2, top), 0.05, gap),
        block((-outer / 2, front, 0.0), (outer / 2, length / 2, rail_high), 0.02, gap),
        plane(2, 0.045),
        plane(1, front - 0.1),
        *(plane(0, -side * (outer / 2 + 0.13), side) for side in (-1.0, 1.0)),
    ]
    duvet = _duvet(rng, bodies, width, top, style.disorder)
    with parts.holding("duvet", "textile"):
        parts.add(style.bedding, duvet, name="duvet")
    rows = 2 if sleepers == 2 and rng.random() < 0.6 else 1
    for k in range(sleepers):
        x = (k - (sleepers - 1) / 2) * (width / 2)
        for row in range(rows):
            size = (min(0.72, width / sleepers - 0.06), 0.46, 0.17)
            lean = rng.uniform(24, 36) + 14 * (row == 0)
            cloth = style.bedding if row == 1 else sheet
            pillow = (
                stuffed(size, int(rng.integers(4)), dented=True, turned=rng.random() < 0.5)
                .turned("z", float(rng.normal(0, 2 + 9 * style.disorder)))
                .turned("x", float(lean))
                .moved(x, length / 2 - 0.22 - 0.17 * row, top + 0.215 - 0.035 * row - 0.085)
            )
            lowest = float(pillow.vertices[:, 2].min())
            with parts.holding("pillow", "cushion"):  # it sinks in
                parts.add(cloth, pillow.moved(z=top - 0.012 - lowest), name="pillow")
    if rng.random() < 0.45:
        cushion = (
            stuffed((0.4, 0.3, 0.14), int(rng.integers(4)))
            .turned("z", float(rng.normal(0, 10)))
            .turned("x", 48)
            .moved(0.0, length / 2 - 0.58, top + 0.1)
        )
        lowest = float(cushion.vertices[:, 2].min())
        with parts.holding("cushion", "cushion"):
            parts.add(style.cushions[0], cushion.moved(z=top - 0.01 - lowest), name="cushion")
    b.add_from(parts, y=-middle)
    return b.piece()
