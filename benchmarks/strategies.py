"""Rows about equal-time error: what each way of sampling makes of the same seconds.

Efficiency is 1 / (mean squared error x core-seconds), which does not depend on the number of
samples. Each row is that of one way over that of plain `path` with Mitsuba's default sampler,
in one home; each home has a light setting of its own. A reference's own error is known and
taken off.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np

from benchmarks.bench import Bench, Reference, pixels, resized
from benchmarks.rendering import plain_render
from benchmarks.rows import Row, missing
from benchmarks.timing import spend, spread
from pipeline import joint
from pipeline.groundtruth import render_both
from pipeline.params import GroundTruthParams
from pipeline.renderer import RenderScene
from pipeline.views import View

Images = dict[str, np.ndarray]  # "color", "shading", or both, (H, W, 3)
Way = Callable[[int, int], Images]  # by samples a pixel and seed
_SHOWN = {
    "multijitter": "`multijitter`",
    "uniform": "joint trace, all lights alike",
    "planned": "joint trace, planned lights",
}


@dataclass(frozen=True)
class Tried:
    """One render: core-seconds, and by image the relative squared error."""

    cpu: float
    error: dict[str, float]


def strategy_rows(bench: Bench) -> Iterator[Row]:
    """Every home, every strategy, and both images at once."""
    if not joint.available():
        yield missing("strategies", "equal-time error", "joint traces are not in scalar variants")
        return
    for name in sorted(bench.views):
        if bench.views[name]:
            scene = bench.open(name)
            view = resized(bench.views[name][0], bench.sizes.middle)
            yield from _of_home(bench, scene, view)


def _of_home(bench: Bench, scene: RenderScene, view: View) -> Iterator[Row]:
    sizes, grey = bench.sizes, bench.params.shading.albedo
    truth = replace(bench.params.groundtruth, spp=sizes.spp)
    ways = ways_of(scene, view, truth, grey)
    for way in ways.values():
        way(sizes.spp, 99)  # compiles
    halves = [ways["planned"](sizes.reference, seed) for seed in (0, 1)]
    references = {kind: Reference(*(half[kind] for half in halves)) for kind in halves[0]}
    turns = [
        {name: _try(partial(way, sizes.spp, 2 + turn), references) for name, way in ways.items()}
        for turn in range(sizes.repeats)
    ]
    where = f"{scene.scene.scene_id}, {scene.scene.lighting}"
    for name, shown in _SHOWN.items():
        yield Row(
            f"{where}: {shown}",
            f"efficiency of colour over plain `path`'s, {sizes.spp} spp each",
            spread([_gain([turn["color"]], turn[name], ("color",)) for turn in turns]),
            clock="cpu",
        )
    both = ("color", "shading")
    yield Row(
        f"{where}: both images at once",
        "efficiency of the joint trace with planned lights over plain `path`'s two renders, "
        "by the mean of both images' relative errors",
        spread([_gain([turn[kind] for kind in both], turn["planned"], both) for turn in turns]),
        clock="cpu",
    )


def ways_of(
    scene: RenderScene, view: View, truth: GroundTruthParams, grey: float
) -> dict[str, Way]:
    """Ways to a view's images; the plain ones give one image each."""

    def plain(kind: str, sampler: str, spp: int, seed: int) -> Images:
        form = scene if kind == "color" else scene.neutral(grey)
        return {kind: plain_render(form, view, spp, seed, truth.max_depth, sampler)}

    def together(lights: Literal["planned", "uniform"], spp: int, seed: int) -> Images:
        asked = replace(truth, spp=spp, block_spp=min(64, spp), lights=lights)
        truths = render_both(scene, view, asked, grey, seed)
        return {"color": pixels(truths.color), "shading": pixels(truths.shading)}

    return {
        "color": partial(plain, "color", "independent"),
        "shading": partial(plain, "shading", "independent"),
        "multijitter": partial(plain, "color", "multijitter"),
        "uniform": partial(together, "uniform"),
        "planned": partial(together, "planned"),
    }


def _try(way: Callable[[], Images], references: dict[str, Reference]) -> Tried:
    found: Images = {}
    spent = spend(lambda: found.update(way()))
    return Tried(spent.cpu, {kind: references[kind].error(found[kind]) for kind in found})


def _gain(plain: list[Tried], tried: Tried, kinds: tuple[str, ...]) -> float:
    """Efficiency of one way over that of the plain renders that make the same images."""
    theirs = sum(render.cpu for render in plain) * float(
        np.mean([render.error[kind] for render, kind in zip(plain, kinds, strict=True)])
    )
    ours = tried.cpu * float(np.mean([tried.error[kind] for kind in kinds]))
    return theirs / ours
