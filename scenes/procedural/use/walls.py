"""Use of walls: hands at switches, backs of sofas, beds and coats, warm air above radiators.

Walls are cut round the places that were touched.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.procedural.piece import Material, PiecePart, Trace
from pbrnet.scenes.procedural.scene_item import SceneItem
from pbrnet.scenes.procedural.structure import GABLE
from pbrnet.scenes.procedural.use.faces import Face, face_of, of_faces, on_grid, with_traces
from pbrnet.scenes.seeds import Draw


def on_walls(item: SceneItem, beside: Sequence[SceneItem], rng: Draw) -> SceneItem:
    """Walls with the places where hands, backs and warm air reach them."""
    done: list[tuple[Float64Array, Float64Array]] = []
    for other in beside:
        touched = _TOUCHED.get(other.name if other.category == "switch" else other.category)
        if touched is None:
            continue
        low, high = on_grid(other.bounds)
        for inward in _LEVEL:
            axis = int(np.argmax(np.abs(inward)))
            gap = _wall_behind(item, low, high, inward)
            if gap is None:
                continue
            place = 0.5 * (low + high)
            place[axis] = gap
            rise, reach, _ = touched
            place[2] = low[2] + rise * (high[2] - low[2])
            half = 0.5 * (high - low)
            half[axis] = 0.0
            half[2] = 0.0
            ends = (place - half, place + half)
            margin = np.full(3, reach + 0.04)
            margin[axis] = 0.001
            box = (ends[0] - margin, ends[1] + margin)
            if any((box[0] < b[1]).all() and (box[1] > b[0]).all() for b in done):
                break
            done.append(box)
            item = _patched(item, box, inward, _rubbed(touched, ends, rng), rng)
            break
    return item


_LEVEL = tuple(np.array(d) for d in ((1.0, 0, 0), (-1.0, 0, 0), (0, 1.0, 0), (0, -1.0, 0)))
# Category of what stands or hangs at a wall (of switches the name: sockets are left alone) ->
# height of the traces in shares of its own, their radius, their kinds and strengths.
_TOUCHED: dict[str, tuple[float, float, tuple[tuple[str, float], ...]]] = {
    "switch": (0.5, 0.16, (("touch", 1.0),)),
    "sofa": (0.95, 0.14, (("touch", 0.7), ("scuff", 0.4))),
    "armchair": (0.95, 0.12, (("touch", 0.6), ("scuff", 0.4))),
    "bed": (1.0, 0.16, (("touch", 0.8),)),
    "radiator": (1.08, 0.3, (("soot", 0.9),)),
    "coat hooks": (0.3, 0.25, (("touch", 0.6), ("scuff", 0.7))),
}
_BEHIND = 0.14  # metres between a thing and the wall that it soils


def _rubbed(
    touched: tuple[float, float, tuple[tuple[str, float], ...]],
    ends: tuple[Float64Array, Float64Array],
    rng: Draw,
) -> Callable[[Face, Draw], list[Trace]]:
    _, reach, kinds = touched
    share = rng.between(0.5, 1.0)

    def traces(face: Face, rng: Draw) -> list[Trace]:
        a, b = face.at(ends[0]), face.at(ends[1])
        return [Trace(kind, a, b, reach, round(share * each, 2)) for kind, each in kinds]

    return traces


def _wall_behind(
    item: SceneItem, low: Float64Array, high: Float64Array, inward: Float64Array
) -> float | None:
    """The wall that a box stands at with its back: its place along its normal, metres."""
    axis = int(np.argmax(np.abs(inward)))
    others = [other for other in range(3) if other != axis]
    back = low[axis] if inward[axis] > 0 else high[axis]
    middle = 0.5 * (low + high)
    for part in item.parts:
        corners = part.vertices[part.faces]
        facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        towards = (facing * inward).sum(axis=1)
        plane = corners[:, 0, axis]
        near = (back - plane) * inward[axis]
        holds = (towards > 1e-9) & (near > -0.03) & (near < _BEHIND)
        for other in others:
            holds &= corners[:, :, other].min(axis=1) < middle[other] + 1e-9
            holds &= corners[:, :, other].max(axis=1) > middle[other] - 1e-9
        if holds.any():
            return float(plane[int(np.argmax(holds))])
    return None


def _patched(
    item: SceneItem,
    box: tuple[Float64Array, Float64Array],
    inward: Float64Array,
    traces: Callable[[Face, Draw], list[Trace]],
    rng: Draw,
) -> SceneItem:
    """Cut the faces of walls that lie in a box out, and give them traces of use."""
    parts: list[PiecePart] = []
    for part in item.parts:
        material = part.material
        gable = part.name.startswith(GABLE)
        if gable or not isinstance(material, Material) or material.use is not None:
            parts.append(part)
            continue
        cut = _cut(part, box, inward)
        middle = cut.vertices[cut.faces].mean(axis=1)
        inside = ((middle > box[0]) & (middle < box[1])).all(axis=1)
        patch = of_faces(cut, inside) if inside.any() else None
        face = None if patch is None else face_of(patch, inward)
        if patch is None or face is None:
            parts.append(part)
            continue
        rest = np.ones(len(patch.faces), dtype=bool)
        rest[face.faces] = False
        left = ~inside
        left[np.flatnonzero(inside)[rest]] = True
        if left.any():
            parts.append(of_faces(cut, left))
        used = of_faces(replace(patch, uvs=face.st), ~rest)
        parts.append(replace(used, material=with_traces(material, face, traces, rng)))
    return replace(item, parts=tuple(parts))


def _cut(
    part: PiecePart, box: tuple[Float64Array, Float64Array], inward: Float64Array
) -> PiecePart:
    """Cut the rectangles of a wall's plane along the lines through the sides of a box.

    Lines go through the whole wall, so that faces keep sharing all of their corners.
    """
    axis = int(np.argmax(np.abs(inward)))
    across = 1 - axis
    quads = part.faces.reshape(-1, 2, 3)
    order = np.stack([quads[:, 0, 0], quads[:, 0, 1], quads[:, 0, 2], quads[:, 1, 2]], axis=1)
    places, uvs = part.vertices[order], part.uvs[order]
    for along, level in ((across, 0), (across, 1), (2, 0), (2, 1)):
        at = box[level][along]
        low, high = places[..., along].min(axis=1), places[..., along].max(axis=1)
        level_in = (places[..., axis] > box[0][axis]) & (places[..., axis] < box[1][axis])
        crossed = level_in.all(axis=1) & (low < at - 1e-4) & (high > at + 1e-4)
        if not crossed.any():
            continue
        share = (at - low[crossed]) / (high - low)[crossed]
        halves = []
        for values in (places, uvs):
            own = values[crossed]
            lower = own.copy()
            upper = own.copy()
            line = places[crossed][..., along]
            for k in range(4):
                for other in (k - 1, (k + 1) % 4):
                    rises = line[:, other] > line[:, k] + 1e-6
                    falls = line[:, other] < line[:, k] - 1e-6
                    mixed = own[:, k] + share[:, None] * (own[:, other] - own[:, k])
                    upper[rises, k] = mixed[rises]
                    mixed = own[:, other] + share[:, None] * (own[:, k] - own[:, other])
                    lower[falls, k] = mixed[falls]
            if values is places:
                upper[..., along] = np.maximum(upper[..., along], at)
                lower[..., along] = np.minimum(lower[..., along], at)
            halves.append(np.concatenate([values[~crossed], lower, upper]))
        places, uvs = halves
    corners = np.array([[0, 1, 2], [0, 2, 3]])
    faces = (4 * np.arange(len(places))[:, None, None] + corners).reshape(-1, 3)
    return replace(part, vertices=places.reshape(-1, 3), faces=faces, uvs=uvs.reshape(-1, 2))
