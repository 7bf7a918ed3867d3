"""Choice of a method, and of the samples that give the best picture in so many seconds.

Seconds are expected from those of the reference run, and measured on this machine for what is
chosen (`pbrnet.model.evaluation.speeds`); a view's picture counts whole, from its inputs on, but
not loading and compiling. Which picture errs less was measured beforehand: mean
FLIP over some test views of the reference run (docs/results.md, Equal time).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pbrnet.model.evaluation.predict import ViewRenderer, example_of
from pbrnet.model.evaluation.previews import DENOISED, PREVIEWS, RADIOSITY, denoised, radiosity
from pbrnet.model.evaluation.speeds import (
    expected_seconds,
    keep_seconds,
    known_seconds,
    place_of,
    scaled,
    speeds_file,
)
from pbrnet.model.methods import MAX_SAMPLES
from pbrnet.pipeline.passes.denoise import Quality
from pbrnet.pipeline.pathtrace import integrator
from pbrnet.pipeline.views import View

if TYPE_CHECKING:
    from pbrnet.model.evaluation.inference import Networks

HYBRID, PLUS = "hybrid", "plus"
# Methods and samples per pixel, each with less error than the one before, at 160x120 and 480x360;
# from 64 and 32 denoised samples on taken for granted.
SMALL = (
    *(("radiosity", 1), ("radiosity", 2), ("denoised", 8), ("radiosity", 4), ("denoised", 16)),
    *(("radiosity", 8), ("radiosity", 16), ("hybrid", 1), ("hybrid", 2), ("hybrid", 4)),
    *(("denoised", 32), ("hybrid", 8)),
    *(("denoised", 1 << power) for power in range(6, 13)),
)
LARGE = (
    *(("radiosity", 1), ("radiosity", 2), ("denoised", 8), ("hybrid", 1), ("radiosity", 4)),
    *(("hybrid", 2), ("hybrid", 4), ("denoised", 16), ("hybrid", 8)),
    *(("denoised", 1 << power) for power in range(5, 13)),
)
# With the denoiser's quality `fast`, for what takes less time than any of these.
FAST = (("denoised", 1), ("radiosity", 1))
_TURNS = 2  # of a measurement; kernels are compiled and launches recorded in the first
_PATIENCE = 5  # budgets: until then another effort may be measured
_LARGE_PIXELS = 57_600  # half-way between the two sizes, in logarithms


@dataclass(frozen=True)
class Effort:
    """A method and its samples per pixel."""

    method: str
    spp: int
    quality: Quality = "high"  # of the denoiser

    def __str__(self) -> str:
        words = f"--method {self.method} --spp {self.spp}"
        return words if self.quality == "high" else f"{words} --denoiser {self.quality}"


@dataclass(frozen=True)
class Choice:
    """Effort chosen for a budget, its seconds, measured or expected, and what was measured now."""

    effort: Effort
    seconds: float
    is_measured: bool
    measured: Mapping[str, float]


def best_method(
    has_network: Callable[[str], bool], spp: int, tiles: bool, quality: bool, own_models: bool
) -> str | None:
    """Return the available method with the lowest error in docs/results.md that fits the options.

    None where the first network of the user's own models should draw.
    """
    available = integrator.available()
    networks = not quality and available
    if networks and not tiles and spp <= MAX_SAMPLES and has_network(HYBRID):
        return HYBRID
    if networks and not spp and has_network(PLUS):
        return PLUS
    return RADIOSITY if available and not tiles and not own_models else None


def choose_for(
    seconds: float, renderer: ViewRenderer, view: View, networks: Networks | None
) -> Choice:
    """Return the effort for a budget as measured on this view; measurements are kept.

    `networks`: those of `HYBRID`, or None without them.
    """
    methods: Sequence[str] = PREVIEWS if integrator.available() else (DENOISED,)
    methods = (*methods, *((HYBRID,) if networks else ()))
    pixels = view.width * view.height
    file, place = speeds_file(), place_of(renderer.scene, view)
    known, measure = known_seconds(file, place), stopwatch(renderer, view, networks)
    choice = choose(seconds, efforts_for(pixels, methods), measure, pixels, known)
    if choice.measured:
        keep_seconds(file, place, {**known, **choice.measured})
    return choice


def efforts_for(pixels: int, methods: Sequence[str]) -> list[Effort]:
    """Return the efforts of these methods for an image of so many pixels, by falling error."""
    ladder = LARGE if pixels > _LARGE_PIXELS else SMALL
    fast = [Effort(method, spp, "fast") for method, spp in FAST if method in methods]
    return fast + [Effort(method, spp) for method, spp in ladder if method in methods]


def choose(
    budget: float,
    efforts: Sequence[Effort],
    seconds: Callable[[Effort], float],
    pixels: int,
    known: Mapping[str, float],
    clock: Callable[[], float] = time.perf_counter,
) -> Choice:
    """Return the last of `efforts` that takes at most `budget` seconds, else the fastest.

    `efforts` by falling error. `seconds` measures one, `known` are those measured before, by name.
    The best by expectation is measured, which compiles what its picture needs; another one, by
    the expectation that follows, only while all measurements end within `_PATIENCE` budgets.
    """
    expected = {
        str(effort): expected_seconds(effort.method, effort.spp, effort.quality, pixels)
        for effort in efforts
    }
    found: dict[str, float] = {name: known[name] for name in expected if name in known}
    measured: dict[str, float] = {}
    began = ended = clock()
    longest = 0.0
    while True:
        guess = scaled(expected, found)
        fitting = [effort for effort in efforts if guess[str(effort)] <= budget]
        best = fitting[-1] if fitting else min(efforts, key=lambda effort: guess[str(effort)])
        name = str(best)
        if name in found or (measured and ended - began + longest > _PATIENCE * budget):
            return Choice(best, guess[name], name in found, measured)
        found[name] = measured[name] = seconds(best)
        longest, ended = max(longest, clock() - ended), clock()


def stopwatch(
    renderer: ViewRenderer, view: View, networks: Networks | None
) -> Callable[[Effort], float]:
    """Return a function that measures the seconds of an effort on this view.

    `networks`: those of the methods beside `radiosity` and `denoised`; None without them.
    """

    scene, params = renderer.scene, renderer.params

    def draw(effort: Effort) -> None:
        if effort.method == RADIOSITY:
            radiosity(scene, view, params.transport, params.seed, effort.spp, effort.quality)
        elif effort.method == DENOISED:
            denoised(scene, view, params.groundtruth, params.seed, effort.spp, effort.quality)
        else:
            assert networks is not None
            given = renderer.inputs(view, [networks.card], effort.spp)
            example = example_of(view, given, networks.card, None)
            networks.predict(effort.method, example)

    def seconds(effort: Effort) -> float:
        for _ in range(_TURNS):
            began = time.perf_counter()
            draw(effort)
        return time.perf_counter() - began

    return seconds
