"""Beds with mattress, bedding and pillows; the head is at the back (+Y)."""

from __future__ import annotations

import numpy as np

from scenes.arrays import Float64Array
from scenes.procedural.furniture.build import Builder
from scenes.procedural.furniture.cabinets import feet, leg_material
from scenes.procedural.furniture.geometry import (
    BodyMesh,
    box,
    pillow,
    rounded_box,
    span,
    thick_sheet,
)
from scenes.procedural.furniture.style import Style
from scenes.procedural.piece import FurniturePiece, Material


def double_bed(
    rng: np.random.Generator, style: Style, width: float | None = None
) -> FurniturePiece:
    """A double bed; `width` of the mattress in metres."""
    width = float(rng.choice([1.4, 1.6, 1.8])) if width is None else width
    return _bed(rng, style, "double bed", width, 2)


def single_bed(rng: np.random.Generator, style: Style, width: float = 0.9) -> FurniturePiece:
    """A single bed; `width` of the mattress in metres."""
    return _bed(rng, style, "single bed", width, 1)


def _drape(beyond: Float64Array, radius: float) -> tuple[Float64Array, Float64Array]:
    """Outward and downward displacement of cloth over a rounded edge, metres.

    `beyond` is the arc length past the start of the edge; negative on the flat side.
    """
    arc = np.clip(beyond, 0, radius * np.pi / 2)
    hang = np.maximum(beyond - radius * np.pi / 2, 0)
    out = np.minimum(beyond, 0) + radius * np.sin(arc / radius) + 0.08 * hang
    return out, radius * (1 - np.cos(arc / radius)) + hang


class _Wrinkles:
    """Waves, creases and folds that all layers of a bed's bedding share."""

    def __init__(self, rng: np.random.Generator, height: float) -> None:
        self.height = height  # amplitude, metres
        self.waves = [(*rng.uniform(-7, 7, 2), rng.uniform(0, 6.3)) for _ in range(7)]
        self.creases = [
            (rng.uniform(0, np.pi), rng.uniform(-0.7, 0.7), rng.uniform(0.03, 0.07))
            for _ in range(6)
        ]
        self.phases = rng.uniform(0, 6, 4)

    def lift(self, s: Float64Array, t: Float64Array) -> Float64Array:
        """Return the added height in metres at cloth coordinates s across and t along the bed."""
        up = np.zeros_like(s)
        for a, c, phase in self.waves:
            up += 0.4 * np.sin(a * s + c * t + phase)
        for turn, at, width in self.creases:
            along = -s * np.sin(turn) + t * np.cos(turn)
            across = s * np.cos(turn) + t * np.sin(turn) + 0.04 * np.sin(5 * along)
            up += 1.6 * np.exp(-(((across - at) / width) ** 2)) * np.exp(-((along / 0.6) ** 2))
        return self.height * up

    def fold(self, along: Float64Array, side: int) -> Float64Array:
        """Return folds of the hanging cloth, in [-1.6, 1.6], at the sides (0) or the foot (1)."""
        first, second = self.phases[2 * side : 2 * side + 2]
        return np.asarray(np.sin(9 * along + first) + 0.6 * np.sin(17 * along + second))


def _cover(
    wrinkles: _Wrinkles,
    half_x: float,
    foot: float,
    head: float,
    top: float,
    hang: float,
    foot_hang: float,
    thickness: float,
    counts: tuple[int, int] = (41, 27),
) -> BodyMesh:
    """Layer of bedding with its upper side at z = `top`, from y = `foot` to y = `head`.

    It hangs down at x = +-`half_x` by `hang` metres below the rounded edge, and at the foot by
    `foot_hang` if that is above 0.
    """
    radius = 0.08
    core = half_x - radius
    half_width = core + radius * np.pi / 2 + hang
    s = np.sin(np.linspace(-1, 1, counts[0]) * 1.25) / np.sin(1.25) * half_width
    start = foot + radius
    low = start - (radius * np.pi / 2 + foot_hang) if foot_hang > 0 else foot
    t = np.linspace(low, head, counts[1])
    out_x, drop_x = _drape(np.abs(s) - core, radius)
    out_y, drop_y = _drape(start - t, radius) if foot_hang > 0 else (start - t, 0 * t)
    across, along = np.meshgrid(s, t, indexing="ij")
    down_x = np.broadcast_to(drop_x[:, None], across.shape)
    down_y = np.broadcast_to(drop_y[None, :], across.shape)
    side = np.minimum(down_x / 0.2, 1.2) * wrinkles.fold(along, 0)
    end = np.minimum(down_y / 0.2, 1.2) * wrinkles.fold(across, 1)
    lying = np.exp(-6 * (down_x + down_y))  # wrinkles lift the lying part only
    points = np.empty((*across.shape, 3))
    points[..., 0] = np.sign(across) * (core + out_x[:, None] + 0.017 * side)
    points[..., 1] = (start - out_y)[None, :] - 0.015 * end
    points[..., 2] = top - down_x - down_y + wrinkles.lift(across, along) * lying
    return thick_sheet(points, thickness)


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
    wrinkles = _Wrinkles(rng, float(rng.uniform(0.005, 0.012)))
    beside = outer / 2 + 0.07  # the hanging cloth clears the frame
    over_foot = not padded and rng.random() < 0.7
    cover = _cover(
        wrinkles,
        beside,
        front - 0.065 if over_foot else -length / 2 + 0.01,
        length / 2 - float(rng.uniform(0.45, 0.6)),
        top + 0.042,
        float(rng.uniform(0.1, 0.2)),
        float(rng.uniform(0.08, 0.16)) if over_foot else 0.0,
        0.034,
    )
    parts.add(style.bedding, cover, name="duvet")
    edge = float(cover.vertices[:, 1].max())
    fold = _cover(
        wrinkles, beside + 0.012, edge - 0.26, edge + 0.006, top + 0.056, 0.08, 0, 0.013, (35, 9)
    )
    parts.add(sheet, fold, name="fold")
    if rng.random() < 0.5:
        start = -length / 2 + float(rng.uniform(0.1, 0.3))
        throw = _cover(
            wrinkles, beside + 0.011, start, start + 0.5, top + 0.054, 0.22, 0, 0.011, (35, 11)
        )
        parts.add(style.throw, throw, name="throw")
    rows = 2 if sleepers == 2 and rng.random() < 0.6 else 1
    for k in range(sleepers):
        x = (k - (sleepers - 1) / 2) * (width / 2)
        for row in range(rows):
            size = (min(0.72, width / sleepers - 0.06), 0.46, 0.17)
            lean = rng.uniform(24, 36) + 14 * (row == 0)
            cloth = style.bedding if row == 1 else sheet
            parts.add(
                cloth,
                pillow(size, rng=rng)
                .turned("z", float(rng.uniform(-4, 4)))
                .turned("x", float(lean))
                .moved(x, length / 2 - 0.22 - 0.17 * row, top + 0.215 - 0.035 * row - 0.085),
                name="pillow",
            )
    if rng.random() < 0.45:
        parts.add(
            style.cushions[0],
            pillow((0.4, 0.3, 0.14), rng=rng)
            .turned("x", 48)
            .moved(0.0, length / 2 - 0.58, top + 0.1),
            name="cushion",
        )
    b.add_from(parts, y=-middle)
    return b.piece()
