"""Unit of length of a building or object, from several kinds of evidence.

Each clue compares a length measured in the file's units with the usual length of such a thing in
metres: furniture by name, ceilings and walls above the floor, furniture's tops, the extent. Its
likelihood is log-normal with a floor, so that no single clue decides; halls and museums make
greater lengths likelier than smaller ones. The prior favours the unit that the file states, then
common units; a small part of it is spread over all scales, for files in no unit at all.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pbrnet.scenes.arrays import BoolArray, Float64Array
from pbrnet.scenes.geometry.mesh import face_areas
from pbrnet.scenes.reconstruction.orientation import surface_heights, upright_columns
from pbrnet.scenes.reconstruction.raycast import RayCaster

UNITS = {1.0: "metres", 0.01: "centimetres", 0.001: "millimetres", 0.0254: "inches",
         0.3048: "feet", 0.1: "decimetres", 0.5: "half metres"}  # fmt: skip
_PRIOR = {1.0: 0.45, 0.01: 0.24, 0.001: 0.08, 0.0254: 0.1, 0.3048: 0.05, 0.1: 0.01, 0.5: 0.01}
USUAL_UNITS = tuple(unit for unit, prior in _PRIOR.items() if prior >= 0.05)
_STATED = 0.85  # prior of the unit that the file states, if programs write it unasked
_CHOSEN = 0.9  # prior of another one: somebody chose it
_UNASKED = (1.0, 0.01)  # metres: units that programs write unasked
_FREE = 0.07  # prior of all other scales together
_FREE_RANGE = (1e-4, 1e3)  # metres per unit
_FREE_STEPS = 800
_UNLIKELY = 0.01  # least likelihood of a clue from one thing
_MOST_COUNTED = 5
_WINDOW = 0.17  # natural logarithm; scales as close as this are one candidate
_GRID = 48  # vertical rays each way
_COLUMN = 0.01  # of a building's extent: cells of the plan above which walls are measured
_TALL = 0.1  # of a building's extent: faces so high tell a wall's height alone
_SAME_HEIGHT = 0.03  # of the height measured
_LEAST_HEIGHT = 0.02  # of a building's extent: lower gaps are in floors, not between them
_LEAST_SHARE = 0.25  # of the columns that must have a ceiling at about the same height

OBJECT_EXTENT, CEILING = "extent of the object", "ceiling above the floor"  # titles of clues
NAMED = " by name"  # ends the titles of clues from names
# Longest side in metres, and its spread as a natural logarithm, by category.
_SIZES = {
    "bed": (2.1, 0.12), "sofa": (2.0, 0.25), "armchair": (0.9, 0.15), "chair": (0.9, 0.15),
    "stool": (0.55, 0.3), "table": (1.3, 0.4), "desk": (1.4, 0.25), "wardrobe": (2.05, 0.18),
    "fridge": (1.75, 0.2), "stove": (0.9, 0.2), "toilet": (0.72, 0.15), "bath": (1.7, 0.15),
    "shower": (2.0, 0.15), "wash basin": (0.6, 0.35), "door": (2.05, 0.1),
    "night table": (0.55, 0.25), "tv stand": (1.5, 0.3), "television": (1.1, 0.3),
    "bookshelf": (1.9, 0.3), "dishwasher": (0.85, 0.12), "washing machine": (0.85, 0.12),
    "microwave": (0.5, 0.2), "sideboard": (1.6, 0.3), "chest": (1.0, 0.35), "bench": (1.2, 0.3),
    "piano": (1.5, 0.2), "laptop": (0.35, 0.2), "person": (1.7, 0.12), "crockery": (0.13, 0.4),
    "bowl": (0.22, 0.5), "kettle": (0.25, 0.3), "vase": (0.3, 0.5), "clock": (0.3, 0.5),
    "candle": (0.2, 0.6), "cabinet": (1.2, 0.4), "window": (1.4, 0.4), "radiator": (1.0, 0.4),
}  # fmt: skip


@dataclass(frozen=True)
class Clue:
    """A length in the file's units beside the usual one in metres."""

    what: str
    length: float  # units
    usual: float  # metres
    spread: float  # standard deviation of the natural logarithm
    spread_above: float = 0.0  # of greater lengths than the usual one; 0: the same
    count: int = 1  # things of about this length: the more there are, the less can a name mislead

    def log_likelihood(self, scales: Float64Array) -> Float64Array:
        """Natural logarithms (N,) for `scales` (N,), metres per unit."""
        distance = np.log(self.length * scales / self.usual)
        distance /= np.where(distance > 0, self.spread_above or self.spread, self.spread)
        least = _UNLIKELY / min(self.count, _MOST_COUNTED)
        return np.log(least + (1 - least) * np.exp(-0.5 * distance**2))

    def deviation(self, scale: float) -> float:
        """Distance to the usual length in standard deviations, for `scale` metres per unit."""
        distance = math.log(self.length * scale / self.usual)
        return distance / ((self.spread_above or self.spread) if distance > 0 else self.spread)

    def agrees(self, scale: float) -> bool:
        """Return whether the length is usual for `scale` metres per unit."""
        return abs(self.deviation(scale)) <= 2

    def sentence(self, scale: float) -> str:
        """The clue in words, for `scale` metres per unit."""
        start = "" if self.agrees(scale) else "against it: "
        return f"{start}{self.what}: {self.length * scale:.2g} m (usually {self.usual:.2g} m)"


@dataclass(frozen=True)
class ScaleEstimate:
    """Candidates, metres per unit, by falling probability, and the weight of all evidence."""

    candidates: tuple[tuple[float, float], ...]  # scale, probability
    evidence: float
    stated: float  # probability of the unit that the file states; 0 if it states none

    @property
    def scale(self) -> float:
        """The most probable scale."""
        return self.candidates[0][0]


def unit_name(scale: float) -> str:
    """Return the name of a unit that is `scale` metres long."""
    for value, name in UNITS.items():
        if math.isclose(scale, value, rel_tol=1e-6):
            return name
    return f"units of {scale:.3g} m"


def estimate_scale(
    hypotheses: Sequence[tuple[float, Sequence[Clue]]], stated: float | None
) -> ScaleEstimate:
    """Estimate metres per unit.

    `hypotheses` are weights with the clues that hold then, such as of a building and of an
    object; `stated` is the unit that the file states, metres.
    """
    units = dict.fromkeys([*([stated] if stated else []), *UNITS])
    prior = np.array([_PRIOR.get(unit, 0.0) for unit in units])
    if stated:
        prior[0] = _STATED if stated in _UNASKED else _CHOSEN
        prior[1:] *= (1 - prior[0] - _FREE) / prior[1:].sum()
    free = np.geomspace(*_FREE_RANGE, _FREE_STEPS)
    scales = np.concatenate([list(units), free])
    weights = np.concatenate([prior, np.full(_FREE_STEPS, _FREE / _FREE_STEPS)])
    likelihood = np.zeros(len(scales))
    for weight, clues in hypotheses:
        total = sum((clue.log_likelihood(scales) for clue in clues), np.zeros(len(scales)))
        likelihood += weight * np.exp(total)
    mass = weights * likelihood
    evidence = float(mass.sum())
    left, candidates = mass / evidence, []
    logs = np.log(scales)
    of_stated = float(left[np.abs(logs - logs[0]) <= _WINDOW].sum()) if stated else 0.0
    for _ in range(4):
        near = np.abs(logs[:, None] - logs[None]) <= _WINDOW
        best = int(np.argmax(near @ left))
        window = near[best]
        share = float(left[window].sum())
        if share < 0.01:
            break
        first = int(np.argmax(np.where(window, left, 0.0)))  # a unit, if one fits
        candidates.append((float(scales[first]), share))
        left = np.where(window, 0.0, left)
    return ScaleEstimate(tuple(candidates), evidence, of_stated)


def usual_size(category: str) -> float | None:
    """Usual longest side in metres of a thing; None if its category has none."""
    return _SIZES[category][0] if category in _SIZES else None


def size_clues(sizes: dict[str, list[float]]) -> list[Clue]:
    """Clues from the longest sides, in units, of the things of each category."""
    made = []
    for category, found in sizes.items():
        if category in _SIZES:
            length, (usual, spread) = float(np.median(found)), _SIZES[category]
            same = sum(abs(math.log(each / length)) <= 2 * spread for each in found)
            made.append(Clue(f"{category}{NAMED}", length, usual, spread, count=max(same, 1)))
    return made


def object_clues(corners: Float64Array) -> list[Clue]:
    """Clues from the triangles (F, 3, 3) if they are a single object."""
    return [Clue(OBJECT_EXTENT, float(np.ptp(corners.reshape(-1, 3), axis=0).max()),
                 0.7, 1.1)]  # fmt: skip


def building_clues(corners: Float64Array, is_ground: BoolArray) -> list[Clue]:
    """Clues from the upright triangles (F, 3, 3) if they are a building.

    `is_ground` (F,) tells which are ground.
    """
    own = corners[~is_ground]
    low, high = own.min(axis=(0, 1)), own.max(axis=(0, 1))
    extent = float(np.max((high - low)[:2]))
    clues = [Clue("extent of the building", extent, 8.0, 0.8, 1.2)]
    xs, ys = (
        np.linspace(low[axis], high[axis], _GRID + 2)[1:-1] + 1e-4 * extent for axis in (0, 1)
    )
    points = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
    bottom = float(corners[:, :, 2].min())
    columns = surface_heights(RayCaster(corners), points, bottom, float(high[2]))
    columns = [column for column in columns if len(column)]
    if not columns:
        return clues
    ceiling = _ceiling(columns)
    if ceiling is not None and ceiling[1] > _LEAST_HEIGHT * extent:
        floor, height = ceiling
        clues.append(Clue(CEILING, height, 2.6, 0.2, 0.35))
    else:
        floor = _common_low(np.array([column[-1] for column in columns]))
        height = _wall_height(own, floor)
        if height <= _LEAST_HEIGHT * extent:
            return clues
        clues.append(Clue("walls above the floor", height, 2.5, 0.3))
    top = _furniture_top(own, floor, height)
    if top is not None:
        clues.append(Clue("tops of furniture above the floor", top, 0.55, 0.4, 0.6))
    return clues


def _ceiling(columns: list[Float64Array]) -> tuple[float, float] | None:
    """Floor level and height of the rooms; None if few columns have a ceiling at one height."""
    tallest = [int(np.argmax(np.diff(column))) for column in columns if len(column) > 1]
    pairs = [column for column in columns if len(column) > 1]
    if len(pairs) < _LEAST_SHARE * len(columns):
        return None
    gaps = np.array([[c[k], c[k + 1]] for c, k in zip(pairs, tallest, strict=True)])
    heights = gaps[:, 1] - gaps[:, 0]
    height = float(np.percentile(heights, 75))
    near = np.abs(heights - height) <= _SAME_HEIGHT * height
    if near.mean() < _LEAST_SHARE or near.sum() < _LEAST_SHARE * len(columns):
        return None
    return float(np.median(gaps[near, 0])), float(np.median(heights[near]))


def _common_low(tops: Float64Array) -> float:
    """The lowest height that a tenth of the columns share: the floor seen from above."""
    ordered = np.sort(tops)
    window = max(1, len(ordered) // 10)
    step = 0.01 * max(float(ordered[-1] - ordered[0]), 1e-12)
    for start in range(len(ordered) - window + 1):
        if ordered[start + window - 1] - ordered[start] <= step:
            return float(ordered[start])
    return float(ordered[0])


def _wall_height(corners: Float64Array, floor: float) -> float:
    """Height above `floor` at which most of the upright surface ends; 0 without any."""
    extent = float(np.ptp(corners[:, :, :2].reshape(-1, 2), axis=0).max())
    _, high, areas = upright_columns(corners, max(_COLUMN * extent, 1e-300), _TALL * extent)
    above = high > floor
    if not above.any():
        return 0.0
    order = np.argsort(high[above], kind="stable")
    ordered, total = high[above][order] - floor, np.cumsum(areas[above][order])
    return float(ordered[int(np.searchsorted(total, 0.6 * total[-1]))])


def _furniture_top(corners: Float64Array, floor: float, height: float) -> float | None:
    """The height above the floor at which half of the level surface of furniture lies."""
    areas, normals = face_areas(corners)
    middle = corners[:, :, 2].mean(axis=1) - floor
    tops = (normals[:, 2] > 0.95) & (middle > 0.08 * height) & (middle < 0.55 * height)
    if not tops.any():
        return None
    order = np.argsort(middle[tops])
    ordered, total = middle[tops][order], np.cumsum(areas[tops][order])
    return float(ordered[int(np.searchsorted(total, 0.5 * total[-1]))])
