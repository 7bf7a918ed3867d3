"""Rows of the time budgets: the best picture in 0.1 to 5 s, by this project, Mitsuba and Cycles.

Homes of a root seed of their own become clay scenes, which both renderers show alike: the
reference of a view is the mean of the two denoised long renders, which must agree. A picture's
seconds are those of one further view of an open scene, in a process that has rendered others of
that size and number of samples before: light plan, transport, inputs, guides, samples, denoiser
and networks all count; opening the scene, compiling and writing files do not. Blender Cycles gets
the camera and keeps its data, and measures itself.

From two probes of a view that is not scored, each renderer gets the samples that fit into each
budget. Then the methods take turns. Elapsed seconds count on a quiet machine; if others use it,
processor seconds divided by the number of processors do.

Writes `data/budgets.json`, `images/budgets.png` and a sheet of pictures, `images/budgets.jpg`.
Every home and size is kept in `build/bench/budgets` as soon as it is measured, and is not measured
again by the same code with the same networks on the same machine: a run that was cut off goes on.
"""

from __future__ import annotations

import json
import os
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from statistics import mean, median
from typing import Any

import numpy as np
import torch

from benchmarks.bench import ROOT, Bench, Reference, resized
from benchmarks.budget_results import GROUPS, QUICK, Point, budget_plot, cells
from benchmarks.clay import write_clay
from benchmarks.cycles import (
    AGREE,
    Blender,
    BlenderMissing,
    Denoise,
    apart,
    blender,
    blender_python,
    views_by_light,
)
from benchmarks.results import OtherLoad, measured_on
from benchmarks.rows import Row, at_least, at_most, missing
from benchmarks.timing import Clock, Spent, spread, timed
from pbrnet.model.evaluation.inference import Networks, available, load_networks
from pbrnet.model.evaluation.metrics import flip_map, ssim
from pbrnet.model.evaluation.predict import ViewRenderer, example_of
from pbrnet.model.methods import MAX_SAMPLES
from pbrnet.pipeline.farm.versions import processor
from pbrnet.pipeline.frames import Channels, stacked
from pbrnet.pipeline.images import contact_sheet, jpeg_bytes
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.passes.denoise import Quality, denoise
from pbrnet.pipeline.passes.groundtruth import render_color, render_truth
from pbrnet.pipeline.passes.settings import GroundTruthParams
from pbrnet.pipeline.passes.transport import transport_of
from pbrnet.pipeline.passes.truth import sample_guides
from pbrnet.pipeline.render.scene import RenderScene, open_scene
from pbrnet.pipeline.tonemap import exposure_of, to_bytes, tonemap
from pbrnet.pipeline.transport.settings import TRANSPORT_SAMPLES
from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import Float32Array
from pbrnet.scenes.files import atomic_file, digest_bytes, digest_file, write_json

NAME = "ours in every time budget"
# Most samples of the methods that take samples.
MOST = {
    method: {"hybrid": MAX_SAMPLES}.get(method, 1 << 12)
    for methods in GROUPS.values()
    for method in methods
    if method != "plus"
}
# Numbers of samples, of methods that take only some.
ALLOWED = dict.fromkeys(("radiosity", "radiosity_quick"), TRANSPORT_SAMPLES)
_CYCLES: dict[str, Denoise] = {"fast": "FAST", "quick": "QUICK"}  # by the end of the name
_BLOCK = 16  # most samples of one block
_QUIET = 0.1  # processors in use by others
_LISTEN = 3.0  # seconds
_PROBES = (1, 4)  # samples
_MARGIN = 0.97  # of a budget, for which samples are chosen
_LONG = 1.5  # seconds; longer pictures have one turn
_SHEET = 1.0  # seconds; budget of the pictures on the sheet

Picture = tuple[Float32Array, Spent]  # linear (H, W, 3)
Way = Callable[[View, int, int], Picture]  # view, samples, seed


@dataclass(frozen=True)
class Setting:
    """Parameters, networks and clock, which all homes share."""

    params: Params
    networks: dict[str, Networks]  # by method
    clock: Clock
    processors: int

    def seconds(self, spent: Spent) -> float:
        """Return the seconds by which budgets are kept."""
        return spent.wall if self.clock == "wall" else spent.cpu / self.processors


def budget_rows(bench: Bench) -> Iterator[Row]:
    """Yield agreement of the renderers by home, and in how many budgets ours is the best."""
    try:
        interpreter = blender_python(bench.tools, bench.bpy)
    except BlenderMissing as error:
        yield missing(NAME, "budgets in which the lowest FLIP is ours", str(error))
        return
    weights = ROOT / "weights"
    networks: dict[str, Networks] = {
        name: load_networks(weights, [name])
        for name in ("plus", "hybrid")
        if name in available(weights)
    }
    processors = len(os.sched_getaffinity(0))
    torch.set_num_threads(processors)
    setting = Setting(bench.params_of("unseen"), networks, clock(), processors)
    kept = bench.tools / "budgets" / _signature(bench, setting, weights)
    kept.mkdir(parents=True, exist_ok=True)
    homes: list[list[Measured]] = []
    for name in list(bench.unseen)[: bench.sizes.budget_homes]:
        homes.append([])
        for one in _measured(bench, setting, name, interpreter, kept):
            homes[-1].append(one)
            yield one.agreement(name)
    yield from _rows(_written(bench, setting, homes))


def _signature(bench: Bench, setting: Setting, weights: Path) -> str:
    """Return a name for all that figures depend on: machine, code, sizes, clock and networks."""
    files = {name: digest_file(weights / f"{name}.safetensors") for name in setting.networks}
    about = [measured_on(bench.sizes.label), repr(bench.sizes), setting.clock, files]
    return digest_bytes(json.dumps(about, sort_keys=True).encode())[:16]


def _measured(
    bench: Bench, setting: Setting, name: str, interpreter: Path, kept: Path
) -> Iterator[Measured]:
    """Yield what is measured of a home at each size: kept files first, the others anew."""
    sizes = dict(zip(bench.sizes.budget_sizes, bench.sizes.budget_spp, strict=True))
    files = {size: kept / f"{name}-{size[0]}x{size[1]}.npz" for size in sizes}
    if all(file.is_file() for file in files.values()):
        yield from (Measured.load(file) for file in files.values())
        return
    home = Home(bench, setting, name)
    with blender(interpreter, home.folder) as other:
        for size, spp in sizes.items():
            if not files[size].is_file():
                load, started = OtherLoad(), time.monotonic()
                view = ClayView(home, other, size, spp)
                view.measure(bench.sizes.budgets, bench.sizes.repeats)
                others = load.processors(time.monotonic() - started)
                view.measured(other.version, others).save(files[size])
            yield Measured.load(files[size])


def _written(
    bench: Bench, setting: Setting, views: Sequence[Sequence[Measured]]
) -> list[dict[str, Any]]:
    """Write the files of what was measured, by home and size; return the cells."""
    budgets = bench.sizes.budgets
    homes = [[point for view in home for point in view.points] for home in views]
    found = cells(homes, budgets)
    sizes = list(zip(*views, strict=True))  # of all homes each
    each_view = [view for home in views for view in home]
    record = {
        "blender": each_view[0].blender,
        "others_busy": round(max(view.others for view in each_view), 2),
        "sizes": bench.sizes.label,
        "homes": len(views),
        "clock": setting.clock,
        "processors": setting.processors,
        "processor": processor(),
        "trained_views": {name: each.card.data.views for name, each in setting.networks.items()},
        "reference_spp": {each[0].size: each[0].spp for each in sizes},
        "halves_flip": {each[0].size: mean(view.between for view in each) for each in sizes},
        "halves_apart": max(view.apart for each in sizes for view in each),
        "points": [[asdict(point) for point in points] for points in homes],
        "cells": [
            {**row, **{group: row[group] and asdict(row[group]) for group in GROUPS}}
            for row in found
        ],
    }
    write_json(bench.docs / "data" / "budgets.json", record)
    words = f"Lowest FLIP in so much time; mean of {len(views)} homes as clay, a view of each"
    large = "{}x{}".format(*bench.sizes.large)
    sheet = next(view for view in views[0] if view.size == large).sheet
    labels = tuple(label for label, _ in sheet)
    pictures = contact_sheet([to_bytes(image) for _, image in sheet], 2, labels)
    for file, data in (
        ("budgets.png", budget_plot(homes, budgets, words)),
        ("budgets.jpg", jpeg_bytes(pictures)),
    ):
        with atomic_file(bench.docs / "images" / file) as partial_file:
            partial_file.write_bytes(data)
    return found


@dataclass(frozen=True)
class Measured:
    """Times and qualities of a view of a home at one image size."""

    size: str  # WIDTHxHEIGHT
    spp: int  # of the long renders
    between: float  # FLIP of the two long renders
    apart: float  # largest difference of their means, relative
    points: tuple[Point, ...]
    sheet: tuple[tuple[str, Float32Array], ...]  # labels and pictures, display values
    blender: str
    others: float  # processors that other programs used

    def agreement(self, home: str) -> Row:
        """Return the row that compares the two long renders."""
        return Row(
            f"Cycles' mean / ours - 1, {home}, {self.size}",
            "largest difference of the means of the two denoised long renders, over three bands",
            spread([self.apart]),
            goal=at_most(AGREE),
        )

    def save(self, path: Path) -> None:
        """Write to an .npz file."""
        about = asdict(replace(self, sheet=()))
        about["labels"] = [label for label, _ in self.sheet]
        pictures = {f"picture-{n}": image for n, (_, image) in enumerate(self.sheet)}
        with atomic_file(path) as partial_file, partial_file.open("wb") as file:
            np.savez(file, about=np.array(json.dumps(about)), **pictures)

    @classmethod
    def load(cls, path: Path) -> Measured:
        """Read a file that `save` wrote."""
        with np.load(path, allow_pickle=False) as file:
            about = json.loads(str(file["about"]))
            labels = about.pop("labels")
            about["sheet"] = tuple((label, file[f"picture-{n}"]) for n, label in enumerate(labels))
        about["points"] = tuple(Point(**point) for point in about["points"])
        return cls(**about)


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


class Home:
    """A clay scene of a home, and the ways to render its views in this process."""

    def __init__(self, bench: Bench, setting: Setting, name: str) -> None:
        self.setting, self.params, self.name = setting, setting.params, name
        self.folder = bench.folder / f"clay-{name}"
        self.sheet_width = bench.sizes.large[0]
        home = bench.open(name, "unseen")
        depth = self.params.groundtruth.max_depth
        self.views = views_by_light(
            home, bench.unseen[name], bench.folder / f"probe-{name}", self.params.groundtruth
        )
        self.clay: RenderScene = open_scene(write_clay(home, self.views[0], depth, self.folder))

    def ways(self) -> dict[str, Way]:
        """Ways of this process by method; networks without weights are left out."""
        found: dict[str, Callable[[View, int, int], Float32Array]] = {
            "radiosity": self._radiosity,
            "planned_denoised": self.planned,
            "mitsuba_denoised": self._path,
            "radiosity_quick": partial(self._radiosity, quality="fast"),
            "planned_quick": partial(self.planned, quality="fast"),
            "mitsuba_quick": partial(self._path, quality="fast"),
            **{name: partial(self._net, name) for name in self.setting.networks},
        }
        return {name: partial(_timed, render) for name, render in found.items()}

    def planned(self, view: View, spp: int, seed: int, quality: Quality = "high") -> Float32Array:
        """Colour by this project's path tracer, denoised."""
        color, _ = render_color(self.clay, view, self._settings(spp), seed)
        return self._denoised(view, color, quality)

    def _path(self, view: View, spp: int, seed: int, quality: Quality = "high") -> Float32Array:
        """Colour by Mitsuba's `path`, with the same guides and denoiser."""
        color, _ = render_truth(self.clay.neutral(None), view, self._settings(spp), seed)
        return self._denoised(view, color, quality)

    def _denoised(self, view: View, color: Channels, quality: Quality) -> Float32Array:
        return stacked(denoise(color, *sample_guides(self.clay, view), quality))

    def _settings(self, spp: int) -> GroundTruthParams:
        return replace(self.params.groundtruth, spp=spp, block_spp=min(spp, _BLOCK), denoise="none")

    def _radiosity(
        self, view: View, spp: int, seed: int, quality: Quality = "high"
    ) -> Float32Array:
        """The picture of light transport; with few samples, from fewer surfels."""
        settings = self.params.transport.reduced(spp)
        return transport_of(self.clay, view, settings, seed, quality=quality).color

    def _net(self, name: str, view: View, spp: int, seed: int) -> Float32Array:
        """The picture of `pbrnet predict`, in the unit of the scene."""
        networks, params = self.setting.networks[name], replace(self.params, seed=seed)
        given = ViewRenderer(self.clay, params).inputs(view, [networks.card], spp)
        example = example_of(view, given, networks.card, None)
        found = networks.predict(name, example).linear
        assert found is not None
        return found


class ClayView:
    """The measured view of a home at one image size, with its reference."""

    def __init__(self, home: Home, other: Blender, size: tuple[int, int], spp: int) -> None:
        self.home, self.setting, self.spp = home, home.setting, spp
        self.size = f"{size[0]}x{size[1]}"
        first, *others = (resized(view, size) for view in home.views)
        self.view, self.others = first, (others or [first])
        self.ways = {**home.ways(), **_cycles(other)}
        ours = home.planned(self.view, spp, 1)
        theirs, _ = self.ways["cycles_portals"](self.view, spp, 1)
        self.reference = Reference(ours, theirs)
        self.apart = apart(self.reference, theirs, ours)
        self.exposure = exposure_of(self.reference.image, home.params.tone)
        self.truth = self._shown(self.reference.image)
        self.between = self._flip(self._shown(ours), self._shown(theirs))
        self.spent: dict[tuple[str, int], list[float]] = defaultdict(list)
        self.quality: dict[tuple[str, int], tuple[float, float]] = {}
        self.kept: dict[tuple[str, int], Float32Array] = {}

    def measure(self, budgets: Sequence[float], turns: int) -> None:
        """Time and score all methods, with the samples that fit into the budgets."""
        jobs = self._jobs(budgets)
        here = [job for job in jobs if job[0] not in GROUPS["cycles"]]
        for turn, view in enumerate((self.others * 2)[:2]):  # until all launches are recorded
            for method, spp in here:
                self.ways[method](view, spp, turn)
        for turn in range(turns):
            for job in jobs:
                if turn == 0 or self.spent[job][0] < _LONG:
                    self._turn(job, turn)

    def measured(self, version: str, others: float) -> Measured:
        """Return medians of the turns, the quality of the first, and the sheet of the large size.

        `version` is Blender's, `others` the processors that other programs used meanwhile.
        """
        points = (
            Point(self.size, method, spp, median(seconds), *self.quality[method, spp])
            for (method, spp), seconds in self.spent.items()
        )
        sheet = tuple(self.sheet()) if self.kept else ()
        known = (self.size, self.spp, self.between, self.apart)
        return Measured(*known, tuple(points), sheet, version, others)

    def sheet(self) -> list[tuple[str, Float32Array]]:
        """Reference and best picture of each group in `_SHEET` seconds: labels, display values."""
        shown = [("reference", self.truth)]
        for group, methods in GROUPS.items():
            jobs = [
                job
                for job, seconds in self.spent.items()
                if job[0] in methods and median(seconds) <= _SHEET
            ]
            if jobs:
                best = min(jobs, key=lambda job: self.quality[job][0])
                name = f"{best[0]} {best[1]}" if best[1] else best[0]
                words = f"{group}: {name}, FLIP {self.quality[best][0]:.3f}"
                shown.append((words, self.kept[best]))
        return shown

    def _jobs(self, budgets: Sequence[float]) -> list[tuple[str, int]]:
        """Methods and samples to measure."""
        jobs: list[tuple[str, int]] = []
        missed: dict[str, list[float]] = {}  # budgets by methods that have no picture in them
        for method, way in self.ways.items():
            due = missed[QUICK[method]] if method in QUICK else budgets
            if method not in MOST:
                jobs.append((method, 0))
            if method not in MOST or not due:
                continue
            probes = [(spp, self._probe(way, spp)) for spp in _PROBES]
            fit = {budget: min(fitting(probes, budget), MOST[method]) for budget in due}
            missed[method] = [budget for budget, samples in fit.items() if not samples]
            chosen = set(fit.values()) - {0}
            if method in ALLOWED:
                chosen = {max(n for n in ALLOWED[method] if n <= most) for most in chosen}
            jobs += [(method, spp) for spp in sorted(chosen)]
        return jobs

    def _probe(self, way: Way, spp: int) -> float:
        """Seconds of a picture of another view, after two that compile."""
        views = (self.others * 3)[:3]
        return [self.setting.seconds(way(view, spp, n)[1]) for n, view in enumerate(views)][-1]

    def _turn(self, job: tuple[str, int], turn: int) -> None:
        method, spp = job
        image, spent = self.ways[method](self.view, spp, 10 + turn)
        self.spent[job].append(self.setting.seconds(spent))
        if job not in self.quality:
            shown = self._shown(image)
            self.quality[job] = self._flip(self.truth, shown), ssim(self.truth, shown)
            if self.view.width == self.home.sheet_width:
                self.kept[job] = shown

    def _shown(self, image: np.ndarray) -> Float32Array:
        """Display values under the exposure of the reference."""
        return tonemap(np.asarray(image, np.float32), self.exposure)

    @staticmethod
    def _flip(truth: Float32Array, image: Float32Array) -> float:
        return float(flip_map(truth, image).mean())


def _timed(
    render: Callable[[View, int, int], Float32Array], view: View, spp: int, seed: int
) -> Picture:
    return timed(lambda: render(view, spp, seed))


def _cycles(other: Blender) -> dict[str, Way]:
    """Ways of Cycles, denoised: as Blender does and quickly, with portals in the windows or not."""

    def picture(
        portals: bool, denoise: Denoise, view: View, spp: int, seed: int
    ) -> tuple[np.ndarray, Spent]:
        return other.picture(spp, seed, portals, view, denoise)

    return {
        name: partial(picture, "portals" in name, _CYCLES.get(name.split("_")[-1], "ACCURATE"))
        for name in GROUPS["cycles"]
    }


def _rows(found: Sequence[dict[str, Any]]) -> Iterator[Row]:
    """Yield in how many budgets ours is the best, and by how much at each image size."""
    tried = [row for row in found if row["first"]]
    yield Row(
        NAME,
        f"budgets, of {len(found)} (image sizes x seconds), in which the lowest FLIP is ours, as a "
        "mean over the homes; budgets without any renderer's image of every home are not counted",
        spread([sum(row["first"] == "ours" for row in tried)]),
        unit=f"of {len(tried)}",
        goal=at_least(len(tried)),
    )
    for size in dict.fromkeys(row["size"] for row in found):
        ratios = [
            min(other.flip for other in others) / row["ours"].flip
            for row in found
            if row["size"] == size
            and row["ours"]
            and (others := [row[group] for group in ("path", "cycles") if row[group]])
        ]
        name = f"FLIP of the best other / ours, {size}"
        meaning = "over the budgets in which ours and another renderer finish an image"
        if ratios:
            yield Row(name, meaning, spread(ratios))
        else:
            yield missing(name, meaning, "in no budget")
