"""Rows about error at equal time, by sampling strategy.

Efficiency is 1 / (mean squared error x core-seconds), which does not depend on the number of
samples. Each row is the efficiency of a strategy over that of plain `path` with Mitsuba's default
sampler: a geometric mean over homes of different light, each with lamps in several rooms. The
reference's own error is subtracted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from statistics import geometric_mean
from typing import Literal

import numpy as np

from benchmarks.bench import Bench, Reference, pixels, resized
from benchmarks.rendering import plain_render
from benchmarks.rows import Row, at_most
from benchmarks.timing import Spread, spread, timed
from pbrnet.pipeline.passes.groundtruth import render_both
from pbrnet.pipeline.passes.settings import GroundTruthParams
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.pipeline.views import View

Images = dict[str, np.ndarray]  # "color", "shading", or both, (H, W, 3)
Way = Callable[[int, int], Images]  # by samples a pixel and seed
SAMPLERS = ("multijitter", "stratified", "orthogonal", "ldsampler")
_SHOWN = {
    **{sampler: f"`path` with `{sampler}`" for sampler in SAMPLERS},
    "uniform": "joint trace, uniform lights",
    "planned": "joint trace, planned lights",
}
_BOTH = "both images at once"
_GOAL = at_most(0.4)


@dataclass(frozen=True)
class Tried:
    """One render: core-seconds, and the relative squared error by image."""

    cpu: float
    error: dict[str, float]


def strategy_rows(bench: Bench) -> Iterator[Row]:
    """Yield a row per home for the planned joint trace, then the means of every strategy."""
    homes: list[dict[str, Spread]] = []
    spp = bench.sizes.spp
    meaning = (
        "efficiency of the joint trace with planned lights over plain `path`'s two renders, by the "
        f"mean of both images' relative errors, {spp} spp each"
    )
    for name, views in sorted(bench.lit.items()):
        if views:
            scene = bench.open(name, "lit")
            homes.append(_of_home(bench, scene, resized(views[0], bench.sizes.middle)))
            where = f"{scene.scene.scene_id}, {scene.scene.lighting}: {_BOTH}"
            yield Row(where, meaning, homes[-1][_BOTH], clock="cpu")
    if homes:
        yield from summary(homes, spp)


def summary(homes: Sequence[dict[str, Spread]], spp: int) -> Iterator[Row]:
    """Yield geometric means of the efficiencies over homes, and the error at equal time."""
    for name, shown in _SHOWN.items():
        yield Row(
            shown,
            f"efficiency of colour alone over plain `path`'s with `independent`, {spp} spp each: "
            f"geometric mean over {len(homes)} homes, with the lowest and highest",
            _over([home[name].value for home in homes]),
            clock="cpu",
        )
    for shown, name in (("colour alone", "planned"), (_BOTH, _BOTH)):
        yield Row(
            f"error at equal time, {shown}",
            "mean squared error of the joint trace with planned lights over plain `path`'s in the "
            "same core-seconds: geometric mean with the lowest and highest",
            _over([1 / home[name].value for home in homes]),
            clock="cpu",
            goal=_GOAL,
        )


def _over(values: Sequence[float]) -> Spread:
    return Spread(geometric_mean(values), min(values), max(values), len(values))


def _of_home(bench: Bench, scene: RenderScene, view: View) -> dict[str, Spread]:
    """Return the efficiency of every strategy over plain `path` in one view."""
    sizes, grey = bench.sizes, bench.params.shading.albedo
    truth = replace(bench.params.groundtruth, spp=sizes.spp)
    ways = ways_of(scene, view, truth, grey)
    for way in ways.values():
        way(sizes.spp, 99)  # compiles
    halves = [ways["planned"](sizes.reference, seed) for seed in (0, 1)]
    references = {kind: Reference(*(half[kind] for half in halves)) for kind in halves[0]}
    turns = [
        {name: _try(partial(way, sizes.spp, 2 + turn), references) for name, way in ways.items()}
        for turn in range(sizes.trials)
    ]
    both = ("color", "shading")
    found = {
        name: spread([_gain([turn["color"]], turn[name], ("color",)) for turn in turns])
        for name in _SHOWN
    }
    found[_BOTH] = spread(
        [_gain([turn[kind] for kind in both], turn["planned"], both) for turn in turns]
    )
    return found


def ways_of(
    scene: RenderScene, view: View, truth: GroundTruthParams, grey: float
) -> dict[str, Way]:
    """Return strategies that render a view's images; the plain ones render one image each."""

    def plain(kind: str, sampler: str, spp: int, seed: int) -> Images:
        form = scene if kind == "color" else scene.neutral(grey)
        return {kind: plain_render(form, view, spp, seed, truth.max_depth, sampler)}

    def together(lights: Literal["planned", "uniform"], spp: int, seed: int) -> Images:
        settings = replace(truth, spp=spp, block_spp=min(truth.block_spp, spp), lights=lights)
        truths = render_both(scene, view, settings, grey, seed)
        return {"color": pixels(truths.color), "shading": pixels(truths.shading)}

    return {
        "color": partial(plain, "color", "independent"),
        "shading": partial(plain, "shading", "independent"),
        **{sampler: partial(plain, "color", sampler) for sampler in SAMPLERS},
        "uniform": partial(together, "uniform"),
        "planned": partial(together, "planned"),
    }


def _try(way: Callable[[], Images], references: dict[str, Reference]) -> Tried:
    found, spent = timed(way)
    return Tried(spent.cpu, {kind: references[kind].error(found[kind]) for kind in found})


def _gain(plain: list[Tried], tried: Tried, kinds: tuple[str, ...]) -> float:
    """Return the efficiency over that of the plain renders that make the same images."""
    theirs = sum(render.cpu for render in plain) * float(
        np.mean([render.error[kind] for render, kind in zip(plain, kinds, strict=True)])
    )
    ours = tried.cpu * float(np.mean([tried.error[kind] for kind in kinds]))
    return theirs / ours
