"""Use of furniture and doors: hands and glasses on tops, sink and hob, seats, door handles."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.procedural.piece import Trace
from pbrnet.scenes.procedural.scene_item import SceneItem
from pbrnet.scenes.procedural.use.faces import Face, split
from pbrnet.scenes.seeds import Draw


def _on_table(face: Face, rng: Draw) -> list[Trace]:
    """Hands along the edges, rings of glasses, a spill, scratches in the middle."""
    wide = face.size[0] > face.size[1]
    found = []
    for side in (0.13, 0.87):
        ends = ((0.15, side), (0.85, side)) if wide else ((side, 0.15), (side, 0.85))
        a, b = (face.inside(*end) for end in ends)
        found.append(Trace("touch", a, b, 0.16, round(rng.between(0.4, 0.9), 2)))
    middle = face.inside(0.5, 0.5)
    found.append(Trace("scuff", middle, middle, round(0.5 * min(face.size), 3), 0.7))
    return found + _rings(face, rng, 2, 7) + _spills(face, rng, 0, 3, (0.03, 0.09))


def _on_low_table(face: Face, rng: Draw) -> list[Trace]:
    middle = face.inside(0.5, 0.5)
    touched = Trace("touch", middle, middle, round(0.5 * min(face.size), 3), 0.5)
    return [touched, *_rings(face, rng, 1, 5), *_spills(face, rng, 0, 2, (0.02, 0.06))]


def _on_desk(face: Face, rng: Draw) -> list[Trace]:
    a, b = face.inside(0.35, 0.5), face.inside(0.65, 0.5)
    found = [Trace("touch", a, b, 0.25, 0.8), Trace("scuff", a, b, 0.22, 0.5)]
    return found + _rings(face, rng, 0, 3)


def _by_sink(face: Face, rng: Draw) -> list[Trace]:
    a, b = face.inside(0.2, 0.5), face.inside(0.8, 0.5)
    return [Trace("scale", a, b, 0.3, 0.8), *_spills(face, rng, 1, 3, (0.03, 0.07))]


def _by_hob(face: Face, rng: Draw) -> list[Trace]:
    a, b = face.inside(0.1, 0.5), face.inside(0.9, 0.5)
    return [Trace("touch", a, b, 0.35, 0.9), *_spills(face, rng, 3, 7, (0.015, 0.05))]


def _on_worktop(face: Face, rng: Draw) -> list[Trace]:
    middle = face.inside(0.5, 0.45)
    cut = Trace("scuff", middle, middle, 0.26, round(rng.between(0.4, 1.0), 2))
    return [cut, *_rings(face, rng, 0, 3), *_spills(face, rng, 0, 3, (0.02, 0.06))]


def _on_rug(face: Face, rng: Draw) -> list[Trace]:
    a, b = face.inside(0.2, 0.4), face.inside(0.8, 0.6)
    walked = Trace("walk", a, b, round(0.45 * min(face.size), 3), 0.9)
    return [walked, *_spills(face, rng, 0, 3, (0.04, 0.12))]


# Name of an item -> name of its part, and the traces on top of it.
TOPS: dict[str, tuple[str, Callable[[Face, Draw], list[Trace]]]] = {
    "dining table": ("top", _on_table),
    "coffee table": ("top", _on_low_table),
    "side table": ("top", _on_low_table),
    "console table": ("top", _on_low_table),
    "desk": ("top", _on_desk),
    "sink unit": ("worktop", _by_sink),
    "hob and oven": ("worktop", _by_hob),
    "drawer unit": ("worktop", _on_worktop),
    "base cupboard": ("worktop", _on_worktop),
    "rug": ("", _on_rug),
}


def _rings(face: Face, rng: Draw, low: int, high: int) -> list[Trace]:
    found = []
    for _ in range(rng.whole(low, high)):
        place = face.inside(*rng.uniform(0.08, 0.92, 2).tolist())
        radius = round(rng.between(0.03, 0.045), 3)
        found.append(Trace("ring", place, place, radius, round(rng.between(0.3, 1), 2)))
    return found


def _spills(face: Face, rng: Draw, low: int, high: int, radius: tuple[float, float]) -> list[Trace]:
    found = []
    for _ in range(rng.whole(low, high)):
        place = face.inside(*rng.uniform(0.05, 0.95, 2).tolist())
        found.append(Trace("spill", place, place, round(rng.between(*radius), 3)))
    return found


def on_leaf(item: SceneItem, lever: Float64Array, rng: Draw) -> SceneItem:
    """Hands round the handles of a door, feet at its lower edge."""

    def traces(face: Face, rng: Draw) -> list[Trace]:
        below, above = (face.at(lever + np.array([0, 0, dz])) for dz in (-0.1, 0.16))
        floor = face.at(np.zeros(3))
        found = [
            Trace("touch", below, above, 0.14, 1.0),
            Trace("touch", face.at(lever), face.at(lever), 0.3, 0.45),
        ]
        across = 0 if abs(face.axes[1, 2]) > 0.5 else 1  # the axis that is level
        ends = [list(face.low), list(face.high)]
        ends[0][1 - across] = ends[1][1 - across] = floor[1 - across] + 0.05
        foot = [(float(end[0]), float(end[1])) for end in ends]
        found.append(Trace("scuff", foot[0], foot[1], 0.16, round(rng.between(0.4, 1), 2)))
        found.append(Trace("dust", foot[0], foot[1], 0.05, 0.6))
        return found

    part = next((part for part in item.parts if part.name == "leaf"), None)
    if part is None:
        return item
    corners = part.vertices[part.faces]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    out = facing[int(np.argmax((facing * facing).sum(axis=1)))]
    out = out / math.sqrt(float((out * out).sum()))
    return split(split(item, "leaf", out, traces, rng), "leaf", -out, traces, rng)


def on_seats(item: SceneItem, rng: Draw) -> SceneItem:
    """Seats that were sat on."""

    def traces(face: Face, rng: Draw) -> list[Trace]:
        found = []
        for s0, t0, s1, t1, _, _ in face.panels:
            if min(s1 - s0, t1 - t0) > 0.3:
                middle = ((s0 + s1) / 2, (t0 + t1) / 2)
                radius = round(0.5 * min(s1 - s0, t1 - t0), 3)
                found.append(Trace("seat", middle, middle, radius, round(rng.between(0.6, 1), 2)))
        return found

    names = [part.name for part in item.parts if part.material.kind in ("fabric", "leather")]
    return split(item, names[0], np.array([0.0, 0.0, 1.0]), traces, rng) if names else item
