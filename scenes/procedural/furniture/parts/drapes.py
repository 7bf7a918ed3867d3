"""Cloth thrown over furniture: throws, clothes, towels and table cloths, as it falls there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from pbrnet.scenes.arrays import BoolArray, Float64Array
from pbrnet.scenes.procedural.furniture.parts.build import Builder
from pbrnet.scenes.procedural.furniture.parts.cloth import (
    LINEN,
    Push,
    Samples,
    Weave,
    block,
    cleared,
    pierces,
    plane,
    refined,
    settle,
    solid,
    started,
    surface,
)
from pbrnet.scenes.procedural.furniture.parts.geometry import BodyMesh
from pbrnet.scenes.procedural.piece import FurniturePiece, Material
from pbrnet.scenes.seeds import Draw

Cut = Literal["sheet", "shirt", "trousers"]
_DEEPEST = 0.0025  # metres that a cloth may reach into what it lies on
_TORN = 0.1  # metres, length of an edge in cloth that was pulled through something
_FINE_STEPS = 25


Ripples = tuple[tuple[float, float, float, float], ...]  # frequencies along u, v; height; phase
Pleats = tuple[float, float, float]  # their number, phase, and phase of their drift


class Hanging(NamedTuple):
    """Fall of a hanging towel: share that it is pushed together, waves, a lower corner."""

    tight: float
    ripples: Ripples
    lean: float


def ripples(draw: Draw) -> Ripples:
    """Draw the waves in which a cloth falls."""
    return tuple(
        (*draw.uniform(-16, 16, 2).tolist(), draw.between(0.4, 1), draw.between(0, 6.3))
        for _ in range(6)
    )


def hanging(draw: Draw) -> Hanging:
    """Draw how a towel hangs over a bar."""
    tight = draw.between(0.05, 0.22)
    ranges = ((0.3, 1), (10, 45), (-2.5, 2.5), (0, 6.3))
    waves = [[draw.between(*each) for each in ranges] for _ in range(5)]
    return Hanging(
        tight, tuple((a, c, high, phase) for high, a, c, phase in waves), draw.normal(0, 0.05)
    )


def pleats(draw: Draw) -> Pleats:
    """Draw the pleats of what hangs on a hook."""
    return draw.between(2.2, 3.4), draw.between(0, 6.3), draw.between(0, 6)


def dropped(
    ripples: Ripples,
    bodies: Sequence[Push],
    size: tuple[float, float],
    at: tuple[float, float, float],
    *,
    turn: float = 0.0,
    tight: float = 0.04,
    rumple: float = 1.0,
    thickness: float = 0.005,
    step: float = 0.03,
    cut: Cut = "sheet",
) -> BodyMesh:
    """Return a cloth of `size` that fell from `at`, below its middle, onto bodies.

    `turn` in degrees about Z; `tight` is the share by which it was pushed together before, `rumple`
    scales the waves it falls in.
    `bodies` keep it away by its thickness and more.
    """
    n, m = (max(6, round(length / step) + 1) for length in size)
    rest = (size[0] / (n - 1), size[1] / (m - 1))
    u = (np.arange(n) / (n - 1) - 0.5)[:, None]
    v = (np.arange(m) / (m - 1) - 0.5)[None, :]
    waves = np.zeros((n, m))
    for a, c, high, phase in ripples:
        waves = waves + high * np.sin(a * u + c * v + phase)
    x, y = u * size[0] * (1 - tight), v * size[1] * (1 - tight)
    cosine, sine = np.round([np.cos(np.radians(turn)), np.sin(np.radians(turn))], 9)
    height = rumple * (0.008 + 0.03 * float(np.sqrt(tight)))
    lifted = at[2] + height * (waves - waves.min())
    place = started((at[0] + x * cosine - y * sine, at[1] + x * sine + y * cosine, lifted))
    cells = _cells(cut, n - 1, m - 1)
    ghost = None if cells is None else ~_corners(cells)
    place = refined(settle(place, rest, bodies, 100, LINEN, ghost=ghost, friction=0.8))
    rest = (0.5 * rest[0], 0.5 * rest[1])
    if cells is not None:
        cells = cells.repeat(2, axis=0).repeat(2, axis=1)
        ghost = ~_corners(cells)
    # Again at twice the resolution: the sheet bends around thin rails.
    place = settle(place, rest, bodies, _FINE_STEPS, LINEN, ghost=ghost, friction=0.8)
    return solid(place, rest, thickness, cells)


def _cells(cut: Cut, n: int, m: int) -> BoolArray | None:
    """The quads (n, m) of a grid that the outline of a garment has; None: all."""
    if cut == "sheet":
        return None
    u = np.abs((np.arange(n) + 0.5) / n - 0.5)[:, None]
    v = ((np.arange(m) + 0.5) / m)[None, :]
    if cut == "shirt":  # body and two sleeves; the neck is at v = 1
        body = (u < 0.27) & (v < 1.0)
        sleeves = (v > 0.72) & (u < 0.5)
        neck = (u < 0.07) & (v > 0.93)
        return np.asarray((body | sleeves) & ~neck)
    legs = (u > 0.04) | (v > 0.66)
    return np.asarray(np.broadcast_to(legs & (u < 0.5), (n, m)))


def hung(
    hanging: Hanging,
    size: float,
    front: float,
    back: float,
    gap: float,
    wall: float,
) -> BodyMesh:
    """Return a towel of width `size` over a bar along x through the origin; the wall is at +y.

    It hangs down by `front` and `back` metres; it keeps `gap` metres from the bar's axis, and in
    front of the plane y = `wall`.
    """
    n = round(size / 0.025) + 1
    around = np.pi * gap
    m = round((front + back + around) / 0.025) + 1
    rest = (size / (n - 1), (front + back + around) / (m - 1))
    s = (np.arange(n) / (n - 1) - 0.5)[:, None] * size
    t = np.arange(m)[None, :] * rest[1]  # from the hem in front, over the bar
    arc = np.clip((t - front) / gap, 0, np.pi)
    y = -gap * np.cos(arc)
    fallen = np.maximum(front - t, 0) + np.maximum(t - front - around, 0)
    tight, waves = hanging.tight, np.zeros((n, m))
    for a, c, high, phase in hanging.ripples:
        waves = waves + high * np.sin(a * s + c * t + phase)
    deep = 0.022 * float(np.sqrt(tight))
    loose = np.minimum(fallen / 0.08, 1.0)
    side = np.where(t < front + 0.5 * around, -1.0, 1.0)
    x, y = s * (1 - tight * (0.4 + 0.6 * loose)), y + side * deep * loose * np.abs(waves)
    place = started((x, y, gap * np.sin(arc) - fallen * (1 + hanging.lean * s / size)))
    held = np.ones((n, m))
    held[:, int(np.argmin(np.abs(t[0] - front - 0.5 * around)))] = 0.0

    def push(place: Float64Array) -> BoolArray:
        y = place[1]
        near, far = np.where(side < 0, -1.0, gap), np.where(side < 0, -gap, wall)
        level = (place[2] < 0.0) & ((y < near) | (y > far))
        place[1] = np.where(place[2] < 0.0, np.clip(y, near, np.maximum(near, far)), y)
        return level

    place = settle(place, rest, [push], 120, Weave(1.0, 0.2, 0.02), mass=held, friction=0.15)
    return solid(refined(place)[:, :, ::-1], (0.5 * rest[0], 0.5 * rest[1]), 0.006)


def hooked(
    pleats: Pleats,
    size: tuple[float, float],
    *,
    cut: Cut = "sheet",
) -> BodyMesh:
    """Return a cloth that hangs from z = 0 at y = -0.05, in front of the wall y = 0.02."""
    n, m = (round(length / 0.042) + 1 for length in size)
    rest = (size[0] / (n - 1), size[1] / (m - 1))
    u = (np.arange(n) / (n - 1) - 0.5)[:, None]
    v = ((m - 1 - np.arange(m)) / (m - 1))[None, :]  # 0 at the top
    count, start, drift = pleats
    phase = 2 * np.pi * count * u + start + 0.4 * np.sin(5 * v + drift)
    narrow = 0.22 + 0.2 * v
    deep = size[0] / count * 0.22 * (0.5 + 0.5 * v)
    y, z = -0.05 - deep * np.sin(phase) + 0 * v, -size[1] * v - 0.45 * size[0] * np.abs(u) + 0.0
    place = started((u * size[0] * narrow, y, z))
    held = np.where((np.abs(u) * size[0] < 0.04) & (v * size[1] < 0.04), 0.0, 1.0)
    cells = _cells(cut, n - 1, m - 1)
    ghost = None if cells is None else ~_corners(cells)
    wall, weave = [plane(1, 0.02, -1.0)], Weave(1.0, 0.15, 0.03)
    place = settle(place, rest, wall, 130, weave, mass=held, ghost=ghost, friction=0.3)
    if cells is not None:
        cells = cells.repeat(2, axis=0).repeat(2, axis=1)
    return solid(refined(place), (0.5 * rest[0], 0.5 * rest[1]), 0.005, cells)


def _corners(cells: BoolArray) -> BoolArray:
    """Points (n + 1, m + 1) of the quads (n, m) that are there."""
    kept = np.zeros((cells.shape[0] + 1, cells.shape[1] + 1), dtype=bool)
    for rows in (slice(0, -1), slice(1, None)):
        for columns in (slice(0, -1), slice(1, None)):
            kept[rows, columns] |= cells
    return kept


def over(
    draw: Draw,
    carrier: FurniturePiece,
    name: str,
    category: str,
    material: Material,
    size: tuple[float, float],
    at: tuple[float, float, float],
    *,
    turn: float = 0.0,
    tight: float = 0.05,
    thickness: float = 0.006,
    cut: Cut = "sheet",
    within: Sequence[Push] = (),
    gap: float = 0.004,
) -> FurniturePiece | None:
    """Return a cloth that lies over a piece of furniture, in the frame of that piece.

    `at` is where its middle is dropped; `within` are further bodies. It is
    kept `gap` metres away. None if it ended up in it, or torn.
    """
    triangles = np.concatenate([part.vertices[part.faces] for part in carrier.parts])
    half = 0.5 * float(np.hypot(*size))
    low = triangles.min(axis=1)[:, :2] - np.array(at[:2])
    high = triangles.max(axis=1)[:, :2] - np.array(at[:2])
    near = ((low < half + 0.05) & (high > -half - 0.05)).all(axis=1)
    samples = Samples(triangles[near])
    bodies = [*within, plane(2, thickness + 0.02), surface(samples, thickness + gap)]
    mesh = dropped(
        ripples(draw), bodies, size, at, turn=turn, tight=tight, thickness=thickness, cut=cut
    )
    mended = cleared(mesh, samples, _DEEPEST)
    if mended is None or _longest(mended) > _TORN or pierces(triangles[near], mended):
        return None
    b = Builder(name, category, "free")
    b.add(material, mended, name="cloth")
    return b.piece()


def _longest(mesh: BodyMesh) -> float:
    corners = mesh.vertices[mesh.faces]
    edges = np.roll(corners, -1, axis=1) - corners
    return float(np.sqrt((edges**2).sum(axis=-1).max()))


def slices(points: Float64Array, low: float, gap: float) -> list[Push]:
    """Blocks around the points (N, 3) of an upright thing above z = `low`, each 6 cm high."""
    top = float(points[:, 2].max())
    count = max(1, round((top - low) / 0.06))
    levels = np.linspace(low, top, count + 1)
    bodies = []
    for k in range(count):
        # The slice below, too: blocks that step back would hold the cloth in a notch.
        own = points[(points[:, 2] >= levels[k] - 0.03) & (points[:, 2] <= levels[k + 1] + 0.03)]
        if len(own):
            first, last = own.min(axis=0), own.max(axis=0)
            first[2], last[2] = levels[k] - 0.01, levels[k + 1]
            bodies.append(block(first, last, 0.008, gap))
    return bodies
