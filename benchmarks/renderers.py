"""The renderers of the time budgets: this project, Mitsuba's `path`, and Blender Cycles."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np

from benchmarks.cycles import Blender, Denoise
from benchmarks.rendering import plain_render
from benchmarks.shown import Shown
from benchmarks.timing import Spent, timed
from pbrnet.model.evaluation.budget import HYBRID, Effort, choose, efforts_for
from pbrnet.model.evaluation.inference import Networks
from pbrnet.model.evaluation.predict import ViewRenderer, example_of
from pbrnet.model.evaluation.previews import DENOISED, PREVIEWS, Preview
from pbrnet.pipeline.frames import banded, stacked
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.passes.denoise import Quality, denoise
from pbrnet.pipeline.passes.truth import sample_guides
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import Float32Array

# Mitsuba's samplers; the last two take powers of four.
SAMPLERS = ("independent", "multijitter", "stratified", "ldsampler")
QUALITIES: tuple[Quality, ...] = ("high", "fast")
DENOISERS: tuple[Denoise, ...] = ("ACCURATE", "FAST", "QUICK")
_TURNS = 2  # of a probe; kernels are compiled and launches recorded in the first
_NOISE = 0.01  # Blender's threshold of adaptive sampling

Picture = tuple[Float32Array, Spent]  # linear (H, W, 3), in the scene's unit
Way = Callable[[View, int, int], Picture]  # view, samples per pixel, seed


@dataclass(frozen=True)
class CyclesOptions:
    """Ways of sampling that a user of Cycles may switch on."""

    portals: bool = False
    guiding: bool = False
    light_tree: bool = False
    adaptive: bool = False

    def __str__(self) -> str:
        names = {
            "portals": self.portals,
            "path guiding": self.guiding,
            "light tree": self.light_tree,
            "adaptive sampling": self.adaptive,
        }
        return ", ".join(name for name, on in names.items() if on) or "none of the options"


def all_options() -> list[CyclesOptions]:
    """Return every combination of the options."""
    return [CyclesOptions(*on) for on in product((False, True), repeat=4)]


def allowed_samples(sampler: str, spp: int) -> int:
    """Return the greatest number of samples up to `spp` that one of `SAMPLERS` takes."""
    if sampler in SAMPLERS[:2] or spp < 1:
        return spp
    return int(4 ** ((spp.bit_length() - 1) // 2))


def cycles_way(shown: Shown, other: Blender, options: CyclesOptions, denoiser: Denoise) -> Way:
    """Return Cycles with these options; it has the scene open and times itself."""

    def render(view: View, spp: int, seed: int) -> Picture:
        image, spent = other.picture(
            spp,
            seed,
            options.portals,
            view,
            denoiser,
            guiding=options.guiding,
            light_tree=options.light_tree,
            noise=_NOISE if options.adaptive else 0.0,
        )
        return image * np.float32(shown.unit), spent

    return render


def mitsuba_way(scene: RenderScene, params: Params, sampler: str, quality: Quality) -> Way:
    """Return Mitsuba's `path` with a sampler, denoised with our guides, cheaper than its own."""
    depth = params.groundtruth.max_depth

    def render(view: View, spp: int, seed: int) -> Float32Array:
        image = plain_render(scene, view, spp, seed, depth, sampler)
        return stacked(denoise(banded(image), *sample_guides(scene, view), quality))

    return lambda view, spp, seed: timed(lambda: render(view, spp, seed))


class Ours:
    """This project, which chooses method and samples as `pbrnet predict --seconds` does."""

    def __init__(
        self,
        shown: Shown,
        params: Params,
        networks: Networks | None,
        seconds: Callable[[Spent], float],
    ) -> None:
        self._networks, self._seconds = networks, seconds
        self._renderer = ViewRenderer(shown.scene, params)
        self._methods = (*PREVIEWS, *((HYBRID,) if networks else ()))

    def chosen(self, view: View, budgets: Sequence[float]) -> dict[float, Effort]:
        """Return the effort for each budget, as measured on a view that is not scored."""
        pixels = view.width * view.height
        efforts = efforts_for(pixels, self._methods)
        known: dict[str, float] = {}

        def seconds(effort: Effort) -> float:
            way = self.way(effort)
            return [self._seconds(way(view, effort.spp, turn)[1]) for turn in range(_TURNS)][-1]

        found: dict[float, Effort] = {}
        for budget in sorted(budgets, reverse=True):  # the long ones tell about the short ones
            choice = choose(budget, efforts, seconds, pixels, known)
            known |= choice.measured
            found[budget] = choice.effort
        return found

    def way(self, effort: Effort) -> Way:
        """Return a way to render with an effort; it has its own number of samples."""
        return lambda view, spp, seed: timed(partial(self._picture, effort, view, seed))

    def long(self, view: View, spp: int, seed: int) -> Float32Array:
        """Return a long render, denoised."""
        return self._picture(Effort(DENOISED, spp), view, seed)

    def _picture(self, effort: Effort, view: View, seed: int) -> Float32Array:
        renderer = replace(self._renderer, params=replace(self._renderer.params, seed=seed))
        if effort.method in PREVIEWS:
            return Preview(renderer, effort.method, effort.spp, effort.quality).render(view).color
        assert self._networks is not None
        given = renderer.inputs(view, [self._networks.card], effort.spp)
        example = example_of(view, given, self._networks.card, None)
        found = self._networks.predict(HYBRID, example).linear
        assert found is not None
        return found
