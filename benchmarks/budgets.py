"""Rows of the time budgets: the best picture in 0.1 to 5 s, by this project, Mitsuba and Cycles.

Homes of a root seed of their own are shown as clay and furnished, alike by both renderers
(`benchmarks.shown`): the reference of a view is the mean of the two denoised long renders. A scene
is left out by name where these do not agree at the smallest size, within `APART` and `BETWEEN`;
the FLIP of their noise, which two halves of each tell, does not count.

Cycles and Mitsuba run at their best. A trial on some scenes tries each combination of Cycles' path
guiding, light tree, adaptive sampling and portals, and each of Mitsuba's samplers; the budgets then
are measured with the best `BEST` of each kind of scene and budget, with three settings of the
denoiser, and the one that errs least in a cell counts. From two probes of a view that is not
scored, they get the samples that fit. This project's method and samples are those that `pbrnet
predict --seconds` chooses on that view, without the truth.

A picture's seconds are those of one further view of an open scene, in a process that has rendered
others of that size and number of samples before: light plan, transport, inputs, guides, samples,
denoiser and network all count; opening the scene, compiling and writing files do not, and are
counted apart (`benchmarks.first_pictures`). Blender keeps its data, and measures itself. Elapsed
seconds count on a quiet machine; if others use it, processor seconds divided by the number of
processors do.

Writes `data/budgets.json`, `images/budgets.png` and a sheet of pictures, `images/budgets.jpg`.
Every scene and size is kept in `build/bench/budgets` as soon as it is measured, and is not measured
again by the same code with the same networks on the same machine: a run that was cut off goes on.
"""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import starmap
from pathlib import Path
from statistics import mean, median
from typing import Any

import numpy as np
import torch

from benchmarks.bench import ROOT, Bench, Reference, Sizes, resized
from benchmarks.budget_results import (
    CYCLES,
    GROUPS,
    OURS,
    PATH,
    Measured,
    Point,
    best_options,
    budget_plot,
    cells,
)
from benchmarks.cycles import Blender, BlenderMissing, apart, blender, blender_python
from benchmarks.first_pictures import FirstPicture, first_pictures
from benchmarks.renderers import (
    DENOISERS,
    QUALITIES,
    SAMPLERS,
    CyclesOptions,
    Ours,
    Way,
    all_options,
    allowed_samples,
    cycles_way,
    mitsuba_way,
)
from benchmarks.results import OtherLoad, measured_on
from benchmarks.rows import Row, at_least, at_most, missing
from benchmarks.shown import Kind, Shown, show
from benchmarks.timing import Clock, Spent, spread
from pbrnet.model.evaluation.budget import HYBRID, Effort
from pbrnet.model.evaluation.inference import Networks, available, load_networks
from pbrnet.model.evaluation.metrics import flip_map, ssim
from pbrnet.pipeline.farm.versions import processor
from pbrnet.pipeline.images import contact_sheet, jpeg_bytes
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.tonemap import exposure_of, to_bytes, tonemap
from pbrnet.scenes.arrays import Float32Array
from pbrnet.scenes.files import atomic_file, digest_bytes, digest_file, read_json, write_json

NAME = "cells in which ours is first"
APART, BETWEEN = 0.02, 0.05  # of two long renders: relative difference of means, and FLIP
BEST = 2  # combinations of options that a kind of scene and budget keeps from the trial
_FIRST = 0.8  # share of the cells
_MOST = 1 << 12  # samples
_QUIET = 0.1  # processors in use by others
_LISTEN = 3.0  # seconds
_PROBES = (1, 4)  # samples
_MARGIN = 0.97  # of a budget, for which samples are chosen
_LONG = 0.4  # seconds; longer pictures have one turn
_SHEET = 1.0  # seconds; budget of the pictures on the sheet
_LONG_WAY = CyclesOptions(portals=True, light_tree=True)  # of the reference


@dataclass(frozen=True)
class Setting:
    """Parameters, network and clock, which all scenes share, and the folder of what is kept."""

    params: Params
    hybrid: Networks | None
    clock: Clock
    processors: int
    kept: Path

    def seconds(self, spent: Spent) -> float:
        """Return the seconds by which budgets are kept."""
        return spent.wall if self.clock == "wall" else spent.cpu / self.processors


@dataclass(frozen=True)
class Chosen:
    """Choice of the trial: combinations of Cycles' options by kind of scene, and samplers."""

    cycles: Mapping[Kind, Sequence[CyclesOptions]]
    samplers: Mapping[Kind, Sequence[str]]


def budget_rows(bench: Bench) -> Iterator[Row]:
    """Yield agreement of the renderers by scene, and in how many cells ours is the best."""
    try:
        interpreter = blender_python(bench.tools, bench.bpy)
    except BlenderMissing as error:
        yield missing(NAME, "image sizes and budgets with the lowest FLIP", str(error))
        return
    weights = ROOT / "weights"
    known = HYBRID in available(weights)
    processors = len(os.sched_getaffinity(0))
    torch.set_num_threads(processors)
    hybrid = load_networks(weights, [HYBRID]) if known else None
    setting = Setting(bench.params_of("unseen"), hybrid, clock(), processors, bench.tools)
    kept = bench.tools / "budgets" / _signature(bench, setting, weights)
    kept.mkdir(parents=True, exist_ok=True)
    setting = replace(setting, kept=kept)
    chosen, tried = _trial(bench, setting, interpreter)
    scenes: list[list[Measured]] = []
    for kind, name in _scenes(bench):
        found = list(_measured(bench, setting, chosen, (kind, name), interpreter))
        yield agreement(found[0])
        if found[0].agrees(APART, BETWEEN):
            scenes.append(found)
    starts = first_pictures(bench, setting.params, interpreter)
    yield from _rows(_written(bench, setting, scenes, tried, starts))


def _scenes(bench: Bench) -> list[tuple[Kind, str]]:
    """Return kind and name of the scenes; the furnished ones are in each kind of light in turn."""
    names, sizes = list(bench.unseen), bench.sizes
    clay: list[tuple[Kind, str]] = [("clay", name) for name in names[: sizes.budget_clay]]
    return clay + [("furnished", name) for name in names[: sizes.budget_homes]]


def _signature(bench: Bench, setting: Setting, weights: Path) -> str:
    """Return a name for all that figures depend on: machine, code, sizes, clock and network."""
    file = weights / f"{HYBRID}.safetensors"
    network = digest_file(file) if setting.hybrid else ""
    about = [measured_on(bench.sizes.label), repr(bench.sizes), setting.clock, network]
    return digest_bytes(json.dumps(about, sort_keys=True).encode())[:16]


def _trial(
    bench: Bench, setting: Setting, interpreter: Path
) -> tuple[Chosen, dict[str, dict[str, float]]]:
    """Return the best options and samplers, and the FLIP of all of them by kind and budget."""
    size, spp = bench.sizes.budget_sizes[0], bench.sizes.budget_spp[0]
    ways = [*map(str, all_options()), *SAMPLERS]
    found: dict[Kind, list[dict[str, float]]] = {}
    scenes = _scenes(bench)
    number = bench.sizes.budget_trials
    furnished = [scene for scene in scenes if scene[0] == "furnished"][:number]
    for kind, name in [*scenes[:1], *furnished]:
        file = setting.kept / f"trial-{kind}-{name}.json"
        if not file.is_file():
            with contest(bench, setting, (kind, name), interpreter) as make:
                write_json(file, make(size, spp).tried(bench.sizes.budget_tried))
        found.setdefault(kind, []).append(read_json(file))
    tried = {
        f"{kind}, {budget:g} s": {
            way: float(np.mean([scene[f"{budget:g} {way}"] for scene in scenes_of]))
            for way in ways
            if all(f"{budget:g} {way}" in scene for scene in scenes_of)
        }
        for kind, scenes_of in found.items()
        for budget in bench.sizes.budget_tried
    }
    by_name = {str(options): options for options in all_options()}
    cycles: dict[Kind, list[CyclesOptions]] = {}
    samplers: dict[Kind, list[str]] = {}
    for kind in found:
        mine = [flips for title, flips in tried.items() if title.startswith(kind)]
        cycles[kind] = [by_name[name] for name in best_options(mine, list(by_name), BEST)]
        samplers[kind] = best_options(mine, list(SAMPLERS), 1)
    return Chosen(cycles, samplers), tried


@contextmanager
def contest(
    bench: Bench, setting: Setting, scene: tuple[Kind, str], interpreter: Path
) -> Iterator[Callable[[tuple[int, int], int], Contest]]:
    """Open a scene in both renderers; yield a function that makes the `Contest` of a size."""
    shown = show(bench, *scene)
    with blender(interpreter, shown.folder) as other:
        yield partial(Contest, shown, setting, other)


def _measured(
    bench: Bench, setting: Setting, chosen: Chosen, scene: tuple[Kind, str], interpreter: Path
) -> Iterator[Measured]:
    """Yield what is measured of a scene at each size: kept files first, the others anew.

    A scene whose long renders do not agree is measured at the smallest size alone.
    """
    sizes = dict(zip(bench.sizes.budget_sizes, bench.sizes.budget_spp, strict=True))
    title = "-".join(scene)
    first = next(iter(sizes))
    with ExitStack() as opened:
        make: Callable[[tuple[int, int], int], Contest] | None = None
        for size, spp in sizes.items():
            file = setting.kept / f"{title}-{size[0]}x{size[1]}.npz"
            if not file.is_file():
                make = make or opened.enter_context(contest(bench, setting, scene, interpreter))
                load, started = OtherLoad(), time.monotonic()
                found = make(size, spp).measure(chosen, bench.sizes)
                others = load.processors(time.monotonic() - started)
                replace(found, others=others).save(file)
            measured = Measured.load(file)
            yield measured
            if size == first and not measured.agrees(APART, BETWEEN):
                return


class Contest:
    """The scored view of a scene at one image size, with its reference, for all renderers."""

    def __init__(
        self, shown: Shown, setting: Setting, other: Blender, size: tuple[int, int], spp: int
    ) -> None:
        self.shown, self.setting, self.other, self.spp = shown, setting, other, spp
        self.size = f"{size[0]}x{size[1]}"
        first, *others = (resized(view, size) for view in shown.views)
        self.view, self.others = first, (others or [first])
        self.ours = Ours(shown, setting.params, setting.hybrid, setting.seconds)
        file = setting.kept / f"long-{shown.kind}-{shown.name}-{self.size}.npz"
        if not file.is_file():
            cycles = cycles_way(shown, other, _LONG_WAY, "ACCURATE")
            mine = [self.ours.long(first, spp // 2, seed) for seed in (1, 2)]
            theirs = [cycles(first, spp // 2, seed)[0] for seed in (1, 2)]
            with atomic_file(file) as half_written, half_written.open("wb") as opened:
                np.savez(opened, mine=np.stack(mine), theirs=np.stack(theirs))
        with np.load(file, allow_pickle=False) as pair:
            halves = pair["mine"], pair["theirs"]
        mine, theirs = (half.mean(axis=0) for half in halves)
        self.reference = Reference(mine, theirs)
        self.apart = apart(self.reference, theirs, mine)
        self.exposure = exposure_of(self.reference.image, setting.params.tone)
        self.truth = self._displayed(self.reference.image)
        whole = self._flip(self._displayed(mine), self._displayed(theirs))
        pairs = zip(*(map(self._displayed, half) for half in halves), strict=True)
        self.between = whole, without_noise(whole, mean(starmap(self._flip, pairs)))
        self.best: dict[str, tuple[float, str, Float32Array]] = {}  # of the sheet, by group

    def tried(self, budgets: Sequence[float]) -> dict[str, float]:
        """Return the FLIP of Cycles' options and Mitsuba's samplers, by budget and name."""
        ways = {
            **{str(o): cycles_way(self.shown, self.other, o, "FAST") for o in all_options()},
            **{
                name: mitsuba_way(self.shown.scene, self.setting.params, name, "high")
                for name in SAMPLERS
            },
        }
        adaptive = {str(options) for options in all_options() if options.adaptive}
        found: dict[str, float] = {}
        for name, way in ways.items():
            for budget, most in self._fitting(way, budgets, name in adaptive).items():
                if spp := allowed_samples(name, most) if name in SAMPLERS else most:
                    group = PATH if name in SAMPLERS else CYCLES
                    found[f"{budget:g} {name}"] = self._point(group, name, way, spp, 1).flip
        return found

    def measure(self, chosen: Chosen, sizes: Sizes) -> Measured:
        """Time and score all renderers, with the samples that fit into the budgets."""
        budgets, turns = sizes.budgets, sizes.repeats
        ours: dict[str, Point] = {}
        efforts = self.ours.chosen(self.others[0], budgets)
        timed = {
            effort: self._point(OURS, _named(effort), self.ours.way(effort), effort.spp, turns)
            for effort in dict.fromkeys(efforts.values())
        }
        for budget, effort in efforts.items():
            ours[f"{budget:g}"] = timed[effort]
        rivals: list[Point] = []
        kind = self.shown.kind
        for sampler in chosen.samplers[kind]:
            ways = {
                f"{sampler}; denoiser {quality}": mitsuba_way(
                    self.shown.scene, self.setting.params, sampler, quality
                )
                for quality in QUALITIES
            }
            rivals += self._within(PATH, ways, budgets, turns, sampler)
        for options in chosen.cycles[kind]:
            named = {
                f"{options}; denoiser {denoiser.lower()}": cycles_way(
                    self.shown, self.other, options, denoiser
                )
                for denoiser in DENOISERS
            }
            rivals += self._within(CYCLES, named, budgets, turns, adaptive=options.adaptive)
        sheet = (("reference", self.truth), *((words, image) for _, words, image in
                 (self.best[group] for group in GROUPS if group in self.best)))  # fmt: skip
        return Measured(
            self.shown.kind, self.shown.name, self.shown.lighting, self.size, self.spp,
            *self.between, self.apart, ours, tuple(rivals), sheet, self.other.version, 0.0,
        )  # fmt: skip

    def _within(
        self,
        group: str,
        ways: Mapping[str, Way],
        budgets: Sequence[float],
        turns: int,
        sampler: str = SAMPLERS[0],
        adaptive: bool = False,
    ) -> list[Point]:
        """Measure the ways with the samples that fit; the last only where no other way fits."""
        *usual, (last, quickest) = ways.items()
        points: list[Point] = []
        missed = set(budgets)
        for name, way in usual:
            fit = self._fitting(way, budgets, adaptive)
            missed -= {budget for budget, spp in fit.items() if spp}
            counts = sorted({allowed_samples(sampler, spp) for spp in fit.values()} - {0})
            points += [self._point(group, name, way, spp, turns) for spp in counts]
        fit = self._fitting(quickest, sorted(missed), adaptive) if missed else {}
        counts = sorted({allowed_samples(sampler, spp) for spp in fit.values()} - {0})
        return points + [self._point(group, last, quickest, spp, turns) for spp in counts]

    def _fitting(
        self, way: Way, budgets: Sequence[float], adaptive: bool = False
    ) -> dict[float, int]:
        """Return the samples that fit into each budget by probes of another view.

        With `adaptive` sampling another probe of so many samples tells how many are left out.
        """
        probes = [(spp, self._probe(way, spp)) for spp in _PROBES]
        found: dict[float, int] = {}
        for budget in budgets:
            spp = min(fitting(probes, budget), _MOST)
            if adaptive and spp > _PROBES[-1]:
                again = [probes[0], (spp, self._probe(way, spp, 0))]
                spp = min(fitting(again, budget), _MOST)
            found[budget] = spp
        return found

    def _probe(self, way: Way, spp: int, warm: int = 2) -> float:
        """Seconds of a picture of another view, after some that compile."""
        views = (self.others * 3)[: warm + 1]
        return [self.setting.seconds(way(view, spp, n)[1]) for n, view in enumerate(views)][-1]

    def _point(self, group: str, name: str, way: Way, spp: int, turns: int) -> Point:
        """Median seconds of some turns, and the quality of the first."""
        if group == OURS:
            for turn, view in enumerate((self.others * 2)[:2]):  # until launches are recorded
                way(view, spp, turn)
        seconds: list[float] = []
        flip = quality = 0.0
        for turn in range(turns):
            image, spent = way(self.view, spp, 10 + turn)
            seconds.append(self.setting.seconds(spent))
            if turn == 0:
                display = self._displayed(image)
                flip, quality = self._flip(self.truth, display), ssim(self.truth, display)
                words = f"{group}: {name} {spp}, FLIP {flip:.3f}"
                if seconds[0] <= _SHEET and flip < self.best.get(group, (np.inf,))[0]:
                    self.best[group] = (flip, words, display)
            if seconds[0] > _LONG:
                break
        return Point(group, name, spp, median(seconds), flip, quality)

    def _displayed(self, image: np.ndarray) -> Float32Array:
        """Display values under the exposure of the reference."""
        return tonemap(np.asarray(image, np.float32), self.exposure)

    @staticmethod
    def _flip(truth: Float32Array, image: Float32Array) -> float:
        return float(flip_map(truth, image).mean())


def _named(effort: Effort) -> str:
    return effort.method + ("" if effort.quality == "high" else "; denoiser fast")


def without_noise(whole: float, half: float) -> float:
    """Return the FLIP of two renderers for infinitely many samples, by those of `whole` and half.

    FLIP minus that limit falls with the square root of the samples.
    """
    return max(whole - (half - whole) / (math.sqrt(2) - 1), 0.0)


def clock() -> Clock:
    """Return the clock that is right now: "wall" on a quiet machine, else "cpu"."""
    load, started = OtherLoad(), time.monotonic()
    time.sleep(_LISTEN)
    return "wall" if load.processors(time.monotonic() - started) < _QUIET else "cpu"


def fitting(probes: Sequence[tuple[int, float]], budget: float) -> int:
    """Return the samples that fit into a budget, by two probes of (samples, seconds); 0: none.

    Of 1, 2, 3, 4, 6, 8, 12, 16, ...: blocks of samples are powers of two.
    """
    (few, short), (many, long) = probes
    rate = max((long - short) / (many - few), 1e-9)
    most = (_MARGIN * budget - (short - few * rate)) / rate
    if most < 1:
        return 0
    power = 1 << int(np.log2(most))
    return power + power // 2 if power > 1 and most >= 1.5 * power else power


def agreement(found: Measured) -> Row:
    """Return the row that compares the two long renders of a scene."""
    return Row(
        f"Cycles' mean / ours - 1, {found.title}, {found.size}",
        "largest difference of the means of the two denoised long renders, over three bands; their "
        f"FLIP is {found.between:.3f}, {found.limit:.3f} without noise, and the scene is left out "
        f"above {BETWEEN} of it",
        spread([found.apart]),
        goal=at_most(APART),
    )


def _written(
    bench: Bench,
    setting: Setting,
    scenes: Sequence[Sequence[Measured]],
    tried: Mapping[str, Mapping[str, float]],
    starts: Sequence[FirstPicture],
) -> list[dict[str, Any]]:
    """Write the files of what was measured; return the cells."""
    found = cells(scenes, bench.sizes.budgets)
    every = [one for scene in scenes for one in scene]
    kept = {one.title for one in every}
    everything = [f"{kind} {name}" for kind, name in _scenes(bench)]
    record = {
        "blender": every[0].blender if every else "",
        "others_busy": round(max((one.others for one in every), default=0.0), 2),
        "sizes": bench.sizes.label,
        "left_out": [title for title in everything if title not in kept],
        "clock": setting.clock,
        "processors": setting.processors,
        "processor": processor(),
        "trained_views": setting.hybrid.card.data.views if setting.hybrid else 0,
        "tried": tried,
        "first_pictures": [asdict(one) for one in starts],
        "measured": [asdict(replace(one, sheet=())) for one in every],
        "cells": found,
    }
    write_json(bench.docs / "data" / "budgets.json", record)
    pictures: list[tuple[str, bytes]] = [("budgets.png", budget_plot(found))]
    sheets = [one.sheet for one in every if one.kind == "furnished" and len(one.sheet) > 1]
    if sheets:
        labels, images = zip(*sheets[-1], strict=True)
        made = contact_sheet([to_bytes(image) for image in images], 2, labels)
        pictures.append(("budgets.jpg", jpeg_bytes(made)))
    for file, data in pictures:
        with atomic_file(bench.docs / "images" / file) as half_written:
            half_written.write_bytes(data)
    return found


def _rows(found: Sequence[Mapping[str, Any]]) -> Iterator[Row]:
    """Yield in how many cells ours is first, and by how much by kind of scene and size."""
    tried = [cell for cell in found if cell["first"]]
    mine = sum(cell["first"] == OURS for cell in tried)
    yield Row(
        NAME,
        f"cells, of {len(found)} (kinds of scene x image sizes x seconds), in which the lowest "
        "mean FLIP over the scenes is ours; cells without any renderer's image of every scene are "
        "not counted",
        spread([mine]),
        unit=f"of {len(tried)}",
        goal=at_least(math.ceil(_FIRST * len(tried))),
    )
    for kind, size in dict.fromkeys((cell["kind"], cell["size"]) for cell in found):
        ratios = [
            min(other["flip"] for other in others) / cell[OURS]["flip"]
            for cell in found
            if (cell["kind"], cell["size"]) == (kind, size)
            and cell[OURS]
            and (others := [cell[group] for group in (PATH, CYCLES) if cell[group]])
        ]
        name = f"FLIP of the best other / ours, {kind}, {size}"
        meaning = "over the budgets in which ours and another renderer finish an image"
        if ratios:
            yield Row(name, meaning, spread(ratios))
        else:
            yield missing(name, meaning, "no budget has pictures of two renderers")
