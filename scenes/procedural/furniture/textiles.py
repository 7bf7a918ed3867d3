"""Curtains, rugs and cushions."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from pbrnet.scenes.arrays import BoolArray, Float64Array
from pbrnet.scenes.procedural.furniture import materials as m
from pbrnet.scenes.procedural.furniture.parts import geometry as g
from pbrnet.scenes.procedural.furniture.parts.build import Builder
from pbrnet.scenes.procedural.furniture.parts.cloth import (
    Weave,
    plane,
    refined,
    settle,
    started,
    stuffed,
)
from pbrnet.scenes.procedural.furniture.spec import (
    Spec,
    any_of,
    between,
    chance,
    drawn,
    repeated,
    several,
    when,
    whole,
)
from pbrnet.scenes.procedural.piece import Material
from pbrnet.scenes.seeds import Draw, generator

SHAPES = 6  # simulations of each size of curtain
_BUNCHES = (0.3, 0.41, 0.55)  # metres, widths of open panels
_OFF = 0.12  # metres from the wall to the rod
_BACK, _FRONT = 0.062, 0.075  # metres from the rod that cloth reaches: it clears sills
_RAIL = 0.014  # metres, height of a rail
_RING_LOW = 0.0255  # metres from the rod's axis to the lower end of its rings
_LONGEST = 2.5  # metres, of a panel before it is cut
_ACROSS, _DOWN = 0.029, 0.096  # metres between points
_STEPS = 45
_TIE = 1.3  # metres from the rod down to a tie
_TIED = (0.075, 0.05)  # half widths of what is tied
_TIED_X = 0.07  # metres from the outer edge to the middle of the tie
_TIED_Z = 0.07  # metres above and below the middle of a tie without a sill


class Curtains(Spec, piece=("curtains", "curtain", "on_wall")):
    """A pair of open curtains on a rod with rings or in a rail, some of them tied back.

    `width` of the window, heights of the rod, of the cloth's `hem` and of the window's `sill` above
    the floor, metres. The origin is on the floor below the centre of the window (`mount_height` 0).
    `shape` chooses one of `SHAPES` simulations of the folds, which all windows of a home may share.
    Where a tie would run into the sill there is none.
    """

    width: float = 1.4
    height: float = 2.3
    hem: float = 0.015
    shape: float = 0.0
    sill: float = 0.0
    wide: float = between(0.85, 1.2)
    beyond: float = between(0.14, 0.24)  # metres that the rod reaches past the window
    railed: bool = chance(0.35)
    tied: bool = chance(0.25)

    @property
    def gap(self) -> float:
        """Metres from the height to the cloth."""
        return _RAIL + 0.001 if self.railed else _RING_LOW + 0.001

    @property
    def ties(self) -> bool:
        """True if they are tied back: they are long enough, and the tie is free of the sill."""
        clear = abs(self.height - self.gap - _TIE - self.sill) > _TIED_Z
        drop = self.height - self.gap - self.hem
        return self.tied and self.hem < 0.1 and drop > _TIE + 0.6 and clear

    def assemble(self, b: Builder) -> None:
        wide = min(max(0.25 * self.width, 0.26), 0.6) * self.wide
        half_span = self.width / 2 + self.beyond
        size = int(np.argmin([abs(bunch - wide) for bunch in _BUNCHES]))
        stretch = min(max(wide / _BUNCHES[size], 0.87), 1.15)
        made = panels(int(self.shape), size, self.style.curtain.translucent, self.ties)
        for place, hooks, side in zip(made.places, made.hooks, (-1.0, 1.0), strict=True):
            self._add_panel(b, place, made.rest[0], (half_span, stretch), side)
            for at in [] if self.railed else hooks:
                turn = 2 * np.pi * np.arange(14) / 14
                ring = [0 * turn, 0.017 * np.cos(turn), 0.017 * np.sin(turn) - 0.006]
                loop = g.tube(np.stack(ring, axis=1), 0.0022, 8, closed=True)
                along = side * (half_span - stretch * at)
                b.add(self.style.metal, loop.moved(along, -_OFF, self.height), name="ring")
        (self._add_rail if self.railed else self._add_rod)(b, half_span)

    def _add_panel(
        self, b: Builder, place: Float64Array, rest: float, spans: tuple[float, float], side: float
    ) -> None:
        half_span, stretch = spans
        cloth, top = _cut(refined(place), self.height - self.gap - self.hem), self.height - self.gap
        x = side * (half_span - stretch * cloth[0])
        points = np.stack([x, cloth[1] - _OFF, cloth[2] + self.height - self.gap], axis=-1)
        s = rest / 2 * np.arange(points.shape[0])[:, None]
        uvs = np.stack(np.broadcast_arrays(s, -points[..., 2]), axis=-1)
        if side > 0:
            points, uvs = points[::-1], uvs[::-1]
        with b.holding("curtain", "curtain"):
            b.add(self.style.curtain, g.grid(points, uvs), name="curtain")
            if self.ties:
                cord = _cord(side * (half_span - stretch * _TIED_X), top - _TIE, side)
                b.add(self.style.curtain, *cord, name="tie")

    def _add_rail(self, b: Builder, half_span: float) -> None:
        half, height = half_span + 0.05, self.height
        rail = g.box((2 * half, 0.024, _RAIL), (0, -_OFF, height - _RAIL), 0.003)
        b.add(m.WHITE_PAINT, rail, name="rail")
        for x in np.linspace(-half + 0.08, half - 0.08, 2 + int(self.width > 1.6)):
            arm = g.box((0.03, _OFF, 0.006), (float(x), -_OFF / 2, height + 0.001))
            b.add(m.WHITE_PAINT, arm, name="bracket")

    def _add_rod(self, b: Builder, half_span: float) -> None:
        end, height, metal = half_span + 0.07, self.height, self.style.metal
        b.add(metal, g.bar((-end, -_OFF, height), (end, -_OFF, height), 0.0105, 12), name="rod")
        for side in (-1, 1):
            b.add(metal, g.sphere(0.022, 14, 8).moved(side * end, -_OFF, height), name="rod")
            x = side * (half_span + 0.025)
            arm = g.bar((x, -0.003, height), (x, -_OFF, height), 0.007, 8)
            plate = g.cylinder(0.02, 0, 0.006, 16).turned("x", 90).moved(x, 0, height)
            b.add(metal, arm, plate, name="bracket")


class Panels(NamedTuple):
    """Two simulated panels of curtain: sheets (3, 2, n, m), x from the outer edge, z from the top.

    `rest`: distances of the points at rest; `hooks`: where along x each hangs from rings.
    """

    places: tuple[Float64Array, Float64Array]
    hooks: tuple[list[float], list[float]]
    rest: tuple[float, float]


@lru_cache(maxsize=64)
def panels(shape: int, size: int, sheer: bool, tied: bool) -> Panels:
    """The left and the right panel of a curtain of one of `_BUNCHES`, longer than any window.

    Folds of uneven width and depth are held at the top and fall down from there. Sheer cloth has
    less fullness, and so flatter folds. Tied panels are drawn to the side `_TIE` metres below.
    """
    draw = generator(shape, "curtain", size, sheer, tied)
    bunch = _BUNCHES[size]
    cloth = bunch * (1.75 if sheer else 2.5)
    n, m = round(cloth / _ACROSS) + 1, round(_LONGEST / _DOWN) + 1
    rest = (cloth / (n - 1), _LONGEST / (m - 1))
    t = np.arange(m)[None, :] / (m - 1)
    starts, hooks = [], []
    for _ in range(2):
        x, y, hook = _heading(draw, n, cloth, bunch, 0.15 if sheer else 0.2)
        u = np.arange(n)[:, None] / (n - 1)
        # Further down folds drift, open and close.
        drift = 0.034 * t * np.sin(2 * np.pi * (1.3 * u + draw.random()) + 2 * t)
        drift = drift + 0.016 * t * np.sin(2 * np.pi * (2.7 * u + draw.random()) - 3 * t)
        deep = np.interp(u[:, 0], np.linspace(0, 1, 7), draw.uniform(0.0, 1.6, 7))
        across = x[:, None] * (1 + 0.16 * t * np.sqrt(t)) + drift
        out = y[:, None] * (1 + np.minimum(2 * t, 1) * (deep[:, None] - 1))
        if tied:
            below = t * _LONGEST - _TIE
            waist = np.maximum(0, 1 - np.abs(below) / np.where(below < 0, _TIE, 0.9))
            waist = waist * waist * (3 - 2 * waist)
            across = across + waist * (_TIED_X + (u - 0.5) * 1.6 * _TIED[0] - across)
            out = out * (1 - 0.35 * waist)
        starts.append(started((across, out, -_LONGEST * t + 0 * u)))
        hooks.append(hook)
    held = np.ones((n, m))
    held[:, 0] = 0.0
    bodies = [plane(1, _BACK, -1.0), plane(1, -_FRONT), plane(0, -0.06)]
    if tied:
        bodies.append(_tie)
    weave = Weave(1.0, 0.08, 0.004)
    place = settle(
        np.stack(starts, axis=1), rest, bodies, _STEPS, weave, mass=held, friction=0.3, iterations=4
    )
    return Panels((place[:, 0], place[:, 1]), (hooks[0], hooks[1]), rest)


def _heading(
    draw: Draw, n: int, cloth: float, bunch: float, fold: float
) -> tuple[Float64Array, Float64Array, list[float]]:
    """Points x, y (n,) of a curtain's upper edge, evenly along its folds, and places of rings.

    `cloth` metres are gathered to `bunch`; a fold takes about `fold` metres.
    """
    folds = max(3, round(cloth / fold))
    ends = np.cumsum([0.0, *draw.uniform(0.65, 1.35, folds)])
    ends = bunch * ends / ends[-1]
    along = np.linspace(0, bunch, 240 * folds + 1)
    phase = 2 * np.pi * np.interp(along, ends, np.arange(folds + 1))
    knots = np.linspace(0, bunch, 2 * folds + 1)
    depth = np.interp(along, knots, draw.uniform(0.75, 1.1, 2 * folds + 1))
    # A little past upright, as gathered cloth is.
    x = np.round(along - 0.1 * bunch / folds * np.sin(2 * phase), 9)
    y = np.round(depth * np.sin(phase), 9)
    low, high = 0.0, 0.3
    for _ in range(30):  # the depth at which the folds take all of the cloth
        middle = 0.5 * (low + high)
        edge = _evenly(x, middle * y, n)
        low, high = (middle, high) if _lengths(*edge)[-1] < cloth else (low, middle)
    return (*_evenly(x, low * y, n), [float(end) for end in ends])


def _evenly(x: Float64Array, y: Float64Array, count: int) -> tuple[Float64Array, Float64Array]:
    """Points x, y (count,) evenly along a curve."""
    length = _lengths(x, y)
    at = np.linspace(0, length[-1], count)
    return np.interp(at, length, x), np.interp(at, length, y)


def _lengths(x: Float64Array, y: Float64Array) -> Float64Array:
    """Length (N,) of a curve up to each of its points."""
    steps = np.sqrt(np.diff(x) * np.diff(x) + np.diff(y) * np.diff(y))
    return np.concatenate([[0.0], np.cumsum(steps)])


def _tie(place: Float64Array) -> BoolArray:
    """Draw what is as high as the tie into it."""
    near = np.abs(place[2] + _TIE) < 0.06
    offsets = (place[0] - _TIED_X) / _TIED[0], place[1] / _TIED[1]
    far = np.sqrt(offsets[0] * offsets[0] + offsets[1] * offsets[1])
    hit = near & (far > 1)
    scale = np.where(hit, 1 / np.maximum(far, 1), 1.0)
    place[0] = _TIED_X + scale * (place[0] - _TIED_X)
    place[1] = scale * place[1]
    return hit


def _cord(x: float, z: float, side: float) -> list[g.BodyMesh]:
    """Two turns of cord around a tied curtain, and the hook in the wall that holds them."""
    turn = 2 * np.pi * np.arange(28) / 28
    away, deep = _TIED[0] + 0.012, 0.5 * (_OFF + _TIED[1]) + 0.004
    loops = []
    for down in (-0.009, 0.009):
        rings = [
            x + away * np.cos(turn), deep * np.sin(turn) - deep - 0.012,
            z + down + 0.25 * side * away * np.cos(turn),
        ]  # fmt: skip
        loops.append(g.tube(np.stack(rings, axis=1), 0.008, 8, closed=True))
    return loops


def _cut(place: Float64Array, drop: float) -> Float64Array:
    """Return a sheet (3, n, m), held at z = 0, cut off where it hangs down by `drop` metres."""
    low = -np.min(place[2], axis=0)
    last = int(np.argmax(low >= drop))
    if low[last] < drop:
        return place
    share = (drop - low[last - 1]) / (low[last] - low[last - 1])
    hem = place[:, :, last - 1] + share * (place[:, :, last] - place[:, :, last - 1])
    return np.concatenate([place[:, :, :last], hem[:, :, None]], axis=2)


class Rug(Spec, piece=("rug", "rug", "centre")):
    """A rug with a border and fringes at its short ends, or a round one."""

    width: float = between(1.6, 2.4)
    depth: float = between(1.1, 1.7)
    thickness: float = between(0.008, 0.014)
    is_round: bool = drawn(
        lambda draw, spec: abs(spec.width - spec.depth) < 0.05 * spec.width and draw.chance(0.6)
    )
    phases: tuple[float, ...] = when("is_round", (), repeated(2, between(0, 6)))  # of its lie
    fringed: bool = drawn(lambda draw, spec: not spec.is_round and draw.chance(0.6))
    fringes: tuple[tuple[float, float], ...] = repeated(  # length, place beside its own
        lambda rug: 2 * len(rug.places) * rug.fringed, between(0.04, 0.055), between(-0.004, 0.004)
    )

    @property
    def places(self) -> list[float]:
        """Places of the fringes along the short ends."""
        return np.arange(-self.depth / 2 + 0.015, self.depth / 2, 0.03).tolist()

    def assemble(self, b: Builder) -> None:
        cloth = self.style.rug
        width, depth, thickness = self.width, self.depth, self.thickness
        if self.is_round:
            edge = ((0.0, 0.0), (0.7 * thickness, 0.0), (thickness, 0.006))
            half = width / 2
            rings = [g.superellipse(half - dx, half - dx, z, 2.0, 64) for z, dx in edge]
            b.add(cloth, g.loft(rings))
            return
        x, y = np.meshgrid(np.linspace(-1, 1, 25), np.linspace(-1, 1, 17), indexing="ij")
        one, other = self.phases
        lie = 0.0015 * np.sin(4 * x + one) * np.sin(3 * y + other)
        points = np.stack([x * width / 2, y * depth / 2, thickness + lie], axis=-1)
        mesh = g.thick_sheet(points, thickness - 0.002)
        mesh.vertices[:, 2] -= mesh.vertices[:, 2].min()
        b.add(cloth, mesh)
        places = [(side, v) for side in (-1, 1) for v in self.places]
        for (side, v), (length, off) in zip(places, self.fringes, strict=False):
            at = (side * (width / 2 - 0.003) + side * length / 2, v + off, 0.0015)
            b.add(cloth, g.box((length, 0.009, 0.003), at), name="fringe")


class Cushion(Spec, piece=("cushion", "cushion", "on_top")):
    """A loose cushion."""

    size: float = between(0.38, 0.5)
    fabric: Material = any_of("cushions")
    narrow: float = between(0.75, 1.0)
    form: int = whole(0, 5)

    def assemble(self, b: Builder) -> None:
        b.add(self.fabric, stuffed((self.size, self.size * self.narrow, 0.15), self.form))


class Fold(Spec):
    """One layer of a folded blanket: its share of the size, and where it lies."""

    wide: float = between(0.96, 1.0)
    deep: float = between(0.96, 1.0)
    x: float = between(-0.006, 0.006)
    y: float = between(-0.006, 0.006)


class FoldedBlanket(Spec, piece=("folded blanket", "textile", "on_top")):
    """A blanket folded into a stack of layers."""

    width: float = between(0.32, 0.42)
    depth: float = between(0.26, 0.34)
    folds: tuple[Fold, ...] = several(Fold, 3, 5)

    def assemble(self, b: Builder) -> None:
        z = 0.0
        for fold in self.folds:
            size = (self.width * fold.wide, self.depth * fold.deep, 0.032)
            b.add(self.style.throw, g.rounded_box(size, (fold.x, fold.y, z), 0.0155, (0, 0, 0.001)))
            z += 0.031
        b.ground()
