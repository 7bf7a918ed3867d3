"""Scale, up axis and kind of a model: one decision from all the evidence in the file.

Input: a `Model` in the file's axes and units, and the options. Output: a `Placement` with its
reasons. The up axis is the one that the options or the file state; otherwise +Y and +Z (and +X)
are compared by level surfaces at both ends, by parts that stand on one level, and by the shape of
named things; two likely ones also by what rests on something, and by the rooms that they give. For
each, `scale_clues` gives the scale; the pair with the most evidence wins.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.geometry.mesh import face_areas
from pbrnet.scenes.importing.categories import category_of, own_name, surface_of, words_of
from pbrnet.scenes.importing.changes import NO_ROOM, UNSURE_SCALE, UNSURE_UP
from pbrnet.scenes.importing.shape import Shape
from pbrnet.scenes.models.model import Model
from pbrnet.scenes.models.options import ModelOptions
from pbrnet.scenes.models.resting import resting_shares
from pbrnet.scenes.reconstruction.interior import Interior, find_interior
from pbrnet.scenes.reconstruction.orientation import upright
from pbrnet.scenes.reconstruction.scale_clues import (
    CEILING,
    NAMED,
    OBJECT_EXTENT,
    USUAL_UNITS,
    Clue,
    ScaleEstimate,
    building_clues,
    estimate_scale,
    object_clues,
    size_clues,
    unit_name,
    usual_size,
)
from pbrnet.scenes.reconstruction.surroundings import connected_parts, part_bounds, without_ground

LARGEST_OBJECT = 6.0  # metres; a larger model without a room is a scene of its own
LEAST_CONFIDENCE = 0.5
_SMALLEST_SCENE, _LARGEST_SCENE = 1.5, 400.0  # metres, of a model that may have rooms
_SMALLEST_OBJECT = 0.02  # metres
_ROOM_SIDE, _ROOM_HEIGHT = 2.5, 1.8  # metres, from which an unnamed object may be a part of a room
_UP_PRIOR = {"y": 0.7, "z": 0.27, "x": 0.03}
_BUILDING_WORDS = {"wall", "walls", "floor", "floors", "ceiling", "room", "roof", "house", "home",
                   "apartment", "flat", "building", "interior", "kitchen", "bathroom", "bedroom",
                   "office", "livingroom", "loft", "studio", "museum", "gallery", "garage",
                   "hall", "lobby", "classroom", "school", "library", "cafe", "restaurant",
                   "shop", "hotel", "church", "theater", "theatre", "factory", "warehouse",
                   "hospital", "coffeeshop", "bookshop", "showroom", "ballroom", "playroom",
                   "diningroom", "storeroom", "boardroom"}  # fmt: skip
_STRUCTURE = ("door", "window", "stairs", "railing", "fireplace")  # categories of parts of one
# Categories by the axis along which such a thing is longest or shortest.
_TALL = ("door", "wardrobe", "fridge", "bookshelf", "person", "chair", "shower")
_FLAT = ("bed", "rug", "table", "desk", "sofa", "bath")
_MOST_TRIANGLES = 400_000  # that are split into parts to see what stands on one level
_ACROSS = 0.95  # part of a normal along an axis, from which a face lies across it
_CLEAR_UP = 0.95  # probability of another up axis than the stated one, from which it is named
_CONTESTED = 0.15  # times the evidence of the likeliest up axis, from which another is looked at
_RESTING, _ROOMS = 3.0, 1.0  # natural logarithms of what things that rest, and rooms, tell
_SURE_UP = 1.0  # the same, of the evidence for one axis over another, from which it is sure
_SURE_NAMES = 5.0  # natural logarithm of how much names of floors, ceilings and walls tell
_BESIDE = 0.02  # of a model's extent, from which a light stands beside it
_SAME_HEIGHT = 0.2  # share by which a measured ceiling may differ from a room's height
_SHOWN = 4  # kinds of named things among the reasons
_SURE_BUILDING, _SURE_OBJECT = 0.98, 0.02
_SURE_MANY = 0.998  # of a building that has many parts or several walls, too
_MANY_PARTS, _SEVERAL = 10, 3
_PART_OF_ROOM = 0.5  # of its usual size in metres: share of a building above which a thing is many
_LEAST_PART = 0.2  # least such share: small things are often drawn too large
_LEAST_STATED = 0.1  # probability of the stated unit below which it is asked for
_NEARLY = 0.45  # natural logarithm by which scales differ that together are one answer
_SURE_TOGETHER = 0.7  # their least probability together
_CLEARLY = 2.0  # times as probable as the stated unit is clearly better


@dataclass(frozen=True)
class Placement:
    """The decision, its reasons as sentences, and how sure it is, 0 to 1."""

    kind: Literal["building", "object"]
    up: Float64Array  # axis (3,) of the file
    scale: float  # metres per unit
    confidence: float
    reasons: tuple[str, ...]
    interior: Interior | None  # of a building that has rooms or may get some
    doubts: tuple[str, ...] = ()  # sentences, if another up axis or unit is nearly as likely

    @property
    def summary(self) -> dict[str, object]:
        """The decision for `scene.json`."""
        return {
            "kind": self.kind,
            "up": "xyz"[int(np.argmax(self.up))],
            "scale": self.scale,
            "confidence": round(self.confidence, 3),
            "reasons": list(self.reasons),
        }


@dataclass(frozen=True)
class _Named:
    """Bounds of the things with a known name, by category, and whether names tell the kind."""

    bounds: dict[str, list[Float64Array]]  # (2, 3) each
    building: float  # probability that the file is a building
    parts: tuple[_NamedPart, ...] = ()


@dataclass(frozen=True)
class _NamedPart:
    """A floor, ceiling or wall by name: shares (3,) of its area across the axes, and its middle."""

    kind: str
    level: Float64Array
    middle: Float64Array


def place_model(model: Model, name: str, options: ModelOptions) -> Placement:
    """Decide how the model called `name` is placed.

    Raises `InputError` with the candidates if no scale is probable enough, and with the reason
    for a building that cannot become a room.
    """
    named = _named(model, name)
    stated_up = options.up if options.up != "auto" else model.up
    corners = _own_corners(model, stated_up or "y")
    found: list[tuple[float, str, ScaleEstimate, list[Clue]]] = []
    for axis, weight in _up_weights(corners, named, stated_up).items():
        turned = corners @ upright(_axis(axis)).T
        estimate, clues = _estimate(turned, named, options.scale or model.unit)
        found.append((weight * estimate.evidence, axis, estimate, clues))
    total = sum(each[0] for each in found)
    evidence, axis, estimate, clues = max(found, key=lambda each: each[0])
    confidence = evidence / total if total > 0 else 1.0
    doubt = ""
    if not stated_up and named.building > _SURE_OBJECT:
        settled = _settled_up(corners, named, {each[1]: each[0] for each in found})
        if settled is not None:
            confidence = settled.probability if settled.axis != axis else confidence
            _, axis, estimate, clues = next(each for each in found if each[1] == settled.axis)
            doubt = settled.doubt
    reasons = [_up_reason(axis, stated_up, options)]
    if model.up and options.up == "auto":
        against, sentence = _doubted_up(corners, named, model.up)
        confidence = min(confidence, 1 - against)
        reasons += sentence
    turned = corners @ upright(_axis(axis)).T
    extent = float(np.max(np.ptp(without_ground(turned)[0].reshape(-1, 3), axis=0)))
    scale, share = options.scale, 1.0
    if scale is None:
        smallest = _SMALLEST_SCENE if named.building >= _SURE_MANY else _SMALLEST_OBJECT
        stated = model.unit
        if stated and not smallest < stated * extent < _LARGEST_SCENE:
            stated = None
            estimate, clues = _estimate(turned, named, None)
        scale, share = chosen_scale(estimate, stated)
        confidence = min(confidence, share)
        if not scale:
            other = _other_up(corners, named, axis) if model.up and options.up == "auto" else ""
            raise InputError(_question(estimate, clues, confidence) + other)
    is_thing = named.building <= _SURE_OBJECT and scale * extent <= LARGEST_OBJECT
    interior = None if is_thing else _interior(scale * turned, scale * extent, named, model)
    is_object = interior is None and scale * extent <= LARGEST_OBJECT
    is_unclear = options.scale is None and share < LEAST_CONFIDENCE
    if interior is None and not is_object and not model.cameras and is_unclear:
        question = _question(estimate, clues, share)
        raise InputError(
            f"no room was found in a scene {scale * extent:.3g} m across, and {question}"
        )
    if is_object and not stated_up:
        axis, reasons[0] = "y", "+Y points up, as in most models of single objects"
    if is_object and options.scale is None and scale * extent < _SMALLEST_OBJECT:
        scale = 0.5 / extent
        reasons.append(f"an object of {extent:.3g} units was enlarged to 0.5 m")
    elif options.scale is None:
        shown = _fitting_clues(clues, scale, extent, interior, is_object)
        reasons += _scale_reasons(scale, model.unit, shown)
        reasons += [_unclear_reason(estimate, scale)] if is_unclear else []
    else:
        reasons.append(f"1 unit is {scale:g} m, as --scale says")
    if interior is not None:
        reasons.append(_interior_reason(interior))
    elif is_object:
        reasons.append("a single object, since it has no room that a person can stand in")
    else:
        reasons.append(f"a scene of its own, since it is {scale * extent:.3g} m across")
    doubts = [doubt] if doubt else []
    if is_unclear and not math.isclose(scale, estimate.scale):
        doubts.append(_scale_doubt(estimate, scale, "as the file states"))
    elif _is_hardly_clearer(model.unit, scale, share) and options.scale is None:
        doubts.append(_scale_doubt(estimate, scale, f"though the file states {model.unit:g} m"))
    if is_object:
        doubts = _object_doubts(named, scale * np.ptp(turned.reshape(-1, 3), axis=0))
    kind: Literal["building", "object"] = "object" if is_object else "building"
    return Placement(
        kind, _axis(axis), scale, min(1.0, confidence), tuple(reasons), interior, tuple(doubts)
    )  # fmt: skip


def _interior(corners: Float64Array, extent: float, named: _Named, model: Model) -> Interior | None:
    """The rooms in upright triangles (F, 3, 3) in metres, or None.

    Raises `InputError` for a building by name whose walls are too few.
    """
    if not _SMALLEST_SCENE < extent < _LARGEST_SCENE:
        return None
    interior = find_interior(corners)
    if interior.rooms or interior.completion.spaces:
        return interior
    refused = interior.completion.refused
    if refused and named.building >= _SURE_BUILDING and not model.cameras:
        raise InputError(
            f"the building cannot become a room, because {refused}. Add walls, or import its "
            "pieces of furniture one by one"
        )
    return None


def _object_doubts(named: _Named, size: Float64Array) -> list[str]:
    """The doubt about an object of `size` (3,) metres that is called a building, or as large."""
    if named.building >= _SURE_BUILDING:
        why = "its names are those of a building"
    elif named.building > _SURE_OBJECT and size[:2].min() >= _ROOM_SIDE and size[2] >= _ROOM_HEIGHT:
        why = "it is as large as a room"
    else:
        return []
    return [
        f"{NO_ROOM}: the file was taken for a single object, though {why}; "
        "if it is one, ignore this, else add walls and a floor, or give --scale or --up"
    ]


def _fitting_clues(
    clues: list[Clue], scale: float, extent: float, interior: Interior | None, is_object: bool
) -> list[Clue]:
    """The clues that measure what the file turned out to be, for its reasons."""
    named = [clue for clue in clues if clue.what.endswith(NAMED)]
    if is_object:
        return named or [clue for clue in clues if clue.what == OBJECT_EXTENT]
    building = [clue for clue in clues if clue not in named and clue.what != OBJECT_EXTENT]
    if not building:
        building = [Clue("extent of the building", extent, 8.0, 0.8, 1.2)]
    if interior is not None:
        heights = [room.ceiling_z - room.floor_z for room in interior.rooms]
        building = [
            clue
            for clue in building
            if clue.what != CEILING
            or any(abs(scale * clue.length / height - 1) < _SAME_HEIGHT for height in heights)
        ]
    return [*named, *building]


def _own_corners(model: Model, axis: str) -> Float64Array:
    """The triangles (F, 3, 3) of a model without lights that stand around it, as in a studio."""
    lights = [shape for shape in model.shapes if shape.id in model.emissions]
    rest = [shape for shape in model.shapes if shape.id not in model.emissions]
    everything = [shape.mesh.corners for shape in model.shapes]
    if not lights or not rest:
        return np.concatenate(everything)
    turn = upright(_axis(axis)).T
    building, is_ground = without_ground(np.concatenate([s.mesh.corners for s in rest]) @ turn)
    own = building[~is_ground].reshape(-1, 3)
    low, high = own.min(axis=0), own.max(axis=0)
    margin = _BESIDE * float((high - low).max())
    kept = [shape.mesh.corners for shape in rest]
    for light in lights:
        points = light.mesh.vertices @ turn
        beside = (points.min(axis=0) > high + margin) | (points.max(axis=0) < low - margin)
        if not beside.any():
            kept.append(light.mesh.corners)
    return np.concatenate(kept)


def chosen_scale(estimate: ScaleEstimate, stated: float | None) -> tuple[float, float]:
    """Metres per unit and its probability; 0 metres if that is not clear.

    The unit that the file states holds unless another one is clearly better.
    """
    best, share = estimate.candidates[0]
    near = [each for each in estimate.candidates if abs(math.log(each[0] / best)) < _NEARLY]
    together = sum(part for _, part in near)
    if share < LEAST_CONFIDENCE and together >= _SURE_TOGETHER:  # neighbours are one answer
        if not any(math.isclose(unit, usual) for unit, _ in near for usual in USUAL_UNITS):
            best = math.exp(sum(part * math.log(unit) for unit, part in near) / together)
        share = together
    if stated is None or math.isclose(best, stated):
        is_clear = share >= LEAST_CONFIDENCE or stated is not None
        return (best if is_clear else 0.0), share
    if share >= LEAST_CONFIDENCE and share >= _CLEARLY * estimate.stated:
        return best, share
    return (stated if estimate.stated >= _LEAST_STATED else 0.0), estimate.stated


def _other_up(corners: Float64Array, named: _Named, stated: str) -> str:
    """The end of a question: options for another up axis than the stated one, if they are clear."""
    found = []
    for axis in sorted({*_UP_PRIOR} - {stated}):
        estimate, _ = _estimate(corners @ upright(_axis(axis)).T, named, None)
        best, share = estimate.candidates[0]
        found.append((share, axis, best))
    share, axis, best = max(found)
    if share < LEAST_CONFIDENCE:
        return ""
    return (
        f"; or, if the file's +{axis.upper()} points up: --up {axis} --scale {best:.4g} "
        f"({unit_name(best)}, probability {share:.0%})"
    )


def _doubted_up(corners: Float64Array, named: _Named, stated: str) -> tuple[float, list[str]]:
    """The probability that another axis than the stated one points up, and the reason.

    Zero, and none, unless the file's surfaces and names tell clearly.
    """
    weights = _up_weights(corners, named, "")
    best = max(weights, key=lambda axis: weights[axis])
    share = weights[best]
    if best == stated or share < _CLEAR_UP:
        return 0.0, []
    return share, [
        f"against it: by level surfaces, what stands on them and named things, +{best.upper()} "
        f"points up (probability {share:.0%}); if so, give --up {best}"
    ]


@dataclass(frozen=True)
class _SettledUp:
    """The up axis that was decided among two likely ones, its probability, and what is in doubt."""

    axis: str
    probability: float
    doubt: str


def _settled_up(
    corners: Float64Array, named: _Named, evidence: dict[str, float]
) -> _SettledUp | None:
    """Decide between the two likeliest up axes of a building; None where one is clear.

    What rests on something and, if that is not enough, which axis gives rooms, add to the
    `evidence` of each axis.
    """
    first, *others = sorted(evidence, key=lambda axis: -evidence[axis])
    if not others or evidence[others[0]] < _CONTESTED * evidence[first]:
        return None
    pair = (first, others[0])
    resting, count = resting_shares(corners)
    logs = {
        axis: math.log(evidence[axis])
        + _RESTING * count / (count + 1) * float(resting["xyz".index(axis)])
        for axis in pair
    }
    is_sure = abs(logs[pair[0]] - logs[pair[1]]) >= _SURE_UP
    if not is_sure:  # a room that lies on its side may still look like one
        for axis in pair:
            logs[axis] += _ROOMS * _gives_rooms(corners @ upright(_axis(axis)).T, named)
    best, other = sorted(pair, key=lambda axis: -logs[axis])
    probability = 1 / (1 + math.exp(logs[other] - logs[best]))
    doubt = ""
    if not is_sure:
        doubt = (
            f"{UNSURE_UP}: +{best.upper()} was taken (probability {probability:.0%}), but the file "
            f"states none, and +{other.upper()} is possible; check the plan, and give "
            f"--up {best} or --up {other}"
        )
    return _SettledUp(best, probability, doubt)


def _gives_rooms(turned: Float64Array, named: _Named) -> bool:
    """Return whether upright triangles (F, 3, 3) have rooms at their likeliest scale."""
    estimate, _ = _estimate(turned, named, None)
    metres = estimate.scale * turned
    if not _SMALLEST_SCENE < float(np.ptp(metres.reshape(-1, 3), axis=0).max()) < _LARGEST_SCENE:
        return False
    interior = find_interior(metres)
    return bool(interior.rooms or interior.completion.spaces)


def _axis(name: str) -> Float64Array:
    return np.eye(3)["xyz".index(name)]


def _estimate(
    turned: Float64Array, named: _Named, stated: float | None
) -> tuple[ScaleEstimate, list[Clue]]:
    """The scale of upright triangles, and the clues of the more probable kind."""
    sizes = {
        category: [float(np.max(bounds[1] - bounds[0])) for bounds in found]
        for category, found in named.bounds.items()
    }
    known = size_clues(sizes)
    single = known or object_clues(turned)
    building = [*known, *building_clues(*without_ground(turned))]
    share = named.building
    estimate = estimate_scale([(share, building), (1 - share, single)], stated)
    return estimate, building if share >= 0.5 else single


def _named(model: Model, name: str) -> _Named:
    """The things whose names tell what they are."""
    bounds: dict[str, list[Float64Array]] = {}
    whole = "other" if "lights" in words_of(name) else category_of(name)  # lights of a scene
    is_thing = whole != "other" and whole not in _STRUCTURE
    words = set() if is_thing else words_of(name)
    groups = 0
    parts: list[_NamedPart] = []
    for label, shapes in _groups(model):
        groups += 1
        label = own_name(label, shapes[0].surface.name)
        category, spoken = category_of(label), words_of(label)
        low = np.min([shape.mesh.bounds[0] for shape in shapes], axis=0)
        high = np.max([shape.mesh.bounds[1] for shape in shapes], axis=0)
        surface = surface_of(label) or ("roof" if "roof" in spoken else "")
        is_surface = bool(surface) and category in ("other", *_STRUCTURE)
        if is_surface:
            parts.append(_named_part(surface, shapes))
        if category == "other" or category in _STRUCTURE:  # an office chair is no office
            words |= spoken
        if category == "other" or is_surface:  # a wall with a door is as large as the wall
            continue
        if (high - low).min() > 1e-3 * (high - low).max():
            bounds.setdefault(category, []).append(np.array([low, high]))
    things = set(bounds) - set(_STRUCTURE)
    is_named_building = bool(parts or words & _BUILDING_WORDS) or len(things) >= _SEVERAL
    low = np.min([shape.mesh.bounds[0] for shape in model.shapes], axis=0)
    high = np.max([shape.mesh.bounds[1] for shape in model.shapes], axis=0)
    if whole != "other" and not is_named_building:  # a couch's seat is no chair
        bounds, things = {whole: [np.array([low, high])]}, {whole}
    building = 0.5
    if is_named_building:
        building = _SURE_BUILDING
        if groups >= _MANY_PARTS or len(parts) >= _SEVERAL:
            building = _SURE_MANY
        bounds = _single(bounds, float((high - low).max()))
    elif is_thing or (
        len(things) == 1 and not set(bounds) & set(_STRUCTURE)
        and sum(map(len, bounds.values())) >= len(model.shapes)
    ):  # fmt: skip
        building = _SURE_OBJECT
    return _Named(bounds, building, tuple(parts))


def _named_part(kind: str, shapes: list[Shape]) -> _NamedPart:
    corners = np.concatenate([shape.mesh.corners for shape in shapes])
    areas, normals = face_areas(corners)
    across = np.abs(normals) > _ACROSS
    level = (areas[:, None] * across).sum(axis=0) / max(float(areas.sum()), 1e-300)
    return _NamedPart(kind, level, 0.5 * (corners.min(axis=(0, 1)) + corners.max(axis=(0, 1))))


def _single(bounds: dict[str, list[Float64Array]], extent: float) -> dict[str, list[Float64Array]]:
    """`bounds` without those of things that are too large a part of a building: all its chairs.

    `extent` is that of the building. One of 3 m holds nothing of 1.5 times its usual size.
    """
    kept = {}
    for category, found in bounds.items():
        usual = usual_size(category)
        most = math.inf
        if usual is not None:
            most = max(_PART_OF_ROOM * usual, _LEAST_PART) * extent
        single = [each for each in found if np.ptp(each, axis=0).max() <= most]
        if single:
            kept[category] = single
    return kept


def _groups(model: Model) -> Iterator[tuple[str, list[Shape]]]:
    """The innermost named nodes of a model, each with its shapes."""
    groups: dict[tuple[str, ...], list[Shape]] = {}
    for shape in model.shapes:
        groups.setdefault(model.node_paths.get(shape.id, (shape.name,)), []).append(shape)
    for path, shapes in groups.items():
        yield path[-1].partition(":")[2] or shapes[0].name, shapes


def _up_weights(corners: Float64Array, named: _Named, stated: str) -> dict[str, float]:
    """The axes that may point up, with their probabilities."""
    if stated:
        return {stated: 1.0}
    areas, normals = face_areas(corners)
    centres = corners.mean(axis=1)
    logs = {}
    for axis, prior in _UP_PRIOR.items():
        k = "xyz".index(axis)
        low, high = corners[:, :, k].min(), corners[:, :, k].max()
        edge = 0.08 * max(high - low, 1e-9)
        ends = (centres[:, k] < low + edge) | (centres[:, k] > high - edge)
        level = areas[(np.abs(normals[:, k]) > 0.95) & ends].sum() / areas.sum()
        logs[axis] = math.log(prior) + 1.5 * math.log(level + 0.05) + _shape_score(named, k)
        logs[axis] += _part_score(named.parts, k)
    standing = _standing(corners)
    for k, axis in enumerate("xyz"):
        logs[axis] += 4.0 * standing[k]
    top = max(logs.values())
    weights = {axis: math.exp(value - top) for axis, value in logs.items()}
    total = sum(weights.values())
    return {axis: value / total for axis, value in weights.items() if value > 0.02 * total}


def _shape_score(named: _Named, k: int) -> float:
    """Fit of the shapes of named things to the up axis number `k`, -3 to 3."""
    score = 0.0
    for category, found in named.bounds.items():
        for low, high in found:
            size = high - low
            if category in _TALL:
                score += 1.0 if np.argmax(size) == k else -0.5
            elif category in _FLAT:
                score += 1.0 if np.argmin(size) == k else -0.5
    return min(3.0, max(-3.0, score))


def _part_score(parts: Sequence[_NamedPart], k: int) -> float:
    """Fit of floors, ceilings and walls by name to the up axis number `k`, -15 to 15.

    Floors and ceilings are level, walls are not, and ceilings are above floors.
    """
    flat = [part for part in parts if part.kind in ("floor", "ceiling")]
    upright = [part for part in parts if part.kind == "wall"]
    score = 0.0
    if flat:
        score += _SURE_NAMES * float(np.mean([2 * part.level[k] - 1 for part in flat]))
    if upright:
        score += _SURE_NAMES * float(np.mean([1 - 2 * part.level[k] for part in upright]))
    lows, highs = ([part.middle[k] for part in flat if part.kind == kind]
                   for kind in ("floor", "ceiling"))  # fmt: skip
    if lows and highs:
        score += _SURE_NAMES if np.mean(highs) > np.mean(lows) else -_SURE_NAMES
    return score


def _standing(corners: Float64Array) -> Float64Array:
    """Share (3,) of the parts that begin at one level of each axis, less that which end at one."""
    if len(corners) > _MOST_TRIANGLES:
        return np.zeros(3)
    part = connected_parts(corners)
    lows, highs = part_bounds(corners, part)
    if len(lows) < 6:
        return np.zeros(3)
    extent = (highs.max(axis=0) - lows.min(axis=0)).max()
    return np.array(
        [_share_at_one_level(lows[:, k], extent) - _share_at_one_level(highs[:, k], extent)
         for k in range(3)]
    )  # fmt: skip


def _share_at_one_level(values: Float64Array, extent: float) -> float:
    ordered = np.sort(values)
    ends = np.searchsorted(ordered, ordered + 0.003 * extent, side="right")
    return float((ends - np.arange(len(ordered))).max() / len(ordered))


def _up_reason(axis: str, stated: str, options: ModelOptions) -> str:
    if options.up != "auto":
        return f"+{axis.upper()} points up, as --up says"
    if stated:
        return f"+{axis.upper()} points up, as the file states"
    return f"+{axis.upper()} points up, by level surfaces, what stands on them and named things"


def _scale_reasons(scale: float, stated: float | None, clues: list[Clue]) -> list[str]:
    source = "which the file does not state"
    if stated:
        agrees = math.isclose(stated, scale)
        source = "as the file states" if agrees else f"though the file states {stated:g} m"
    named = [clue for clue in clues if clue.what.endswith(NAMED)]
    named.sort(key=lambda clue: abs(clue.deviation(scale)))
    shown = [*named[:_SHOWN], *(clue for clue in clues if not clue.what.endswith(NAMED))]
    sentences = [clue.sentence(scale) for clue in shown]
    if len(named) > _SHOWN:
        fit = sum(clue.agrees(scale) for clue in named)
        sentences.append(f"{fit} of {len(named)} kinds of named things have their usual size")
    return [f"1 unit is {scale:.4g} m ({unit_name(scale)}), {source}", *sentences]


def _unclear_reason(estimate: ScaleEstimate, scale: float) -> str:
    return (
        "the stated unit was taken, though it is not sure, because no other one is clearly better "
        f"({_other_units(estimate, scale)}); change it with --scale"
    )


def _is_hardly_clearer(stated: float | None, scale: float, share: float) -> bool:
    """Return whether another unit than the stated one was taken that is not far more probable."""
    return bool(stated) and not math.isclose(scale, stated or 1.0) and share < _SURE_TOGETHER


def _scale_doubt(estimate: ScaleEstimate, scale: float, source: str) -> str:
    return (
        f"{UNSURE_SCALE}: {unit_name(scale)} was taken, {source}, but "
        f"{_other_units(estimate, scale)} are possible; check the plan, and give --scale"
    )


def _other_units(estimate: ScaleEstimate, scale: float) -> str:
    return ", ".join(
        f"{unit_name(other)} {share:.0%}"
        for other, share in estimate.candidates
        if not math.isclose(other, scale)
    )


def _question(estimate: ScaleEstimate, clues: list[Clue], confidence: float) -> str:
    """The error that asks for `--scale`."""
    options = "; ".join(
        f"--scale {scale:.4g} ({unit_name(scale)}, probability {share:.0%}: "
        + ", ".join(clue.sentence(scale) for clue in clues[:3])
        + ")"
        for scale, share in estimate.candidates[:3]
    )
    return (
        f"the unit of length is not clear (confidence {confidence:.2f}, "
        f"{LEAST_CONFIDENCE} is needed). Give it: {options}"
    )


def _interior_reason(interior: Interior) -> str:
    if interior.rooms:
        return f"a building, since it has closed rooms ({len(interior.rooms)})"
    return f"a building, since it has floors between walls ({len(interior.completion.spaces)})"
