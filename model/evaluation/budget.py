"""Time budgets: which method, with how many samples, gives the best picture in so many seconds.

Seconds are measured on this machine, with a view of the scene; a view's picture counts whole, from
its inputs on, but not loading and compiling. Which picture errs less was measured beforehand: mean
FLIP over some test views of the reference run (docs/results.md, Equal time).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pbrnet.model.evaluation.inference import Networks
from pbrnet.model.evaluation.predict import ViewRenderer, example_of
from pbrnet.model.evaluation.previews import DENOISED, RADIOSITY, denoised, radiosity
from pbrnet.pipeline.passes.denoise import Quality
from pbrnet.pipeline.views import View

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
_TURNS = 3  # of a measurement; kernels are compiled and launches recorded in the first two
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
    """Effort chosen for a budget, and the seconds that it took when it was measured."""

    effort: Effort
    seconds: float
    tried: int


def efforts_for(pixels: int, methods: Sequence[str]) -> list[Effort]:
    """Return the efforts of these methods for an image of so many pixels, by falling error."""
    ladder = LARGE if pixels > _LARGE_PIXELS else SMALL
    fast = [Effort(method, spp, "fast") for method, spp in FAST if method in methods]
    return fast + [Effort(method, spp) for method, spp in ladder if method in methods]


def choose(budget: float, efforts: Sequence[Effort], seconds: Callable[[Effort], float]) -> Choice:
    """Return the last of `efforts` that takes at most `budget` seconds, else the fastest.

    `efforts` by falling error. `seconds` measures one. Of each method the efforts are measured by
    rising samples, until one is too long, or the next would be by the last two; those with less
    than the denoiser's best only if no other fits.
    """
    found: dict[Effort, float] = {}
    groups = dict.fromkeys((effort.quality, effort.method) for effort in efforts)
    for group in sorted(groups, key=lambda group: group[0] != "high"):
        if group[0] != "high" and min(found.values(), default=budget + 1) <= budget:
            break
        spent: list[tuple[int, float]] = []
        own = [effort for effort in efforts if (effort.quality, effort.method) == group]
        for effort in sorted(own, key=lambda effort: effort.spp):
            if _expected(spent, effort.spp) > budget:
                break
            found[effort] = seconds(effort)
            spent.append((effort.spp, found[effort]))
            if found[effort] > budget:
                break
    fitting = [effort for effort in efforts if found.get(effort, budget + 1) <= budget]
    best = fitting[-1] if fitting else min(found, key=lambda effort: found[effort])
    return Choice(best, found[best], len(found))


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


def _expected(spent: Sequence[tuple[int, float]], spp: int) -> float:
    """Return the seconds of `spp` samples by a line through the last two, 0 without them."""
    if len(spent) < 2:
        return 0.0
    (few, short), (many, long) = spent[-2:]
    return long + max(0.0, (long - short) / (many - few)) * (spp - many)
