"""The time study: seconds of every part, and how good a picture each way gives for its seconds.

Everything is timed by turns, one after the other and again from the start, so that whatever else
the machine does falls on all alike; the first turn of a view, which compiles kernels, does not
count. Seconds are a waiting person's, or (`clock`) those of all the process's threads together,
which other processes hardly change. Rivals of the networks are the path tracer at a few samples a
pixel, and the same denoised. All are compared with a reference of many more samples that shares no
random number with them.
"""

from __future__ import annotations

import os
import platform
import time
from collections import defaultdict
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from statistics import mean, median
from typing import Any

import numpy as np
import torch

from model.data.reader import Example
from model.evaluation.evaluate import open_split, true_color
from model.evaluation.inference import Networks
from model.evaluation.metrics import flip_map, ssim
from model.evaluation.predict import example_of, resized, sampled, shadows_of, with_samples_of
from model.methods import METHODS, trained_baselines
from model.studies.relight import LightChange, open_changed
from model.studies.renders import Renders, scene_of, spread_over, views_of, with_samples
from model.studies.time.plot import time_plot
from model.studies.time.results import Clock, Point, Spent, TimeResult
from model.training.train import Folders
from pipeline.farm.scene_digest import scene_digest
from pipeline.frames import Channels
from pipeline.params import Params
from pipeline.passes.denoise import denoise, denoiser_version, guides
from pipeline.passes.groundtruth import render_both, render_truth
from pipeline.passes.illumination import render_illumination
from pipeline.passes.inputs import render_inputs
from pipeline.passes.registry import render_truths, traced_together
from pipeline.progress import Progress
from pipeline.render.scene import RenderScene, renderer_version, set_variant
from pipeline.tonemap import tonemap
from pipeline.views import View
from scenes.arrays import AnyArray
from scenes.checked import plain
from scenes.contract import Scene
from scenes.errors import ParameterError
from scenes.files import atomic_file, sweep, write_json
from scenes.seeds import derive

_MORE = 16  # times the samples of the longest rival that the reference has, unless asked for others
_LEAST = 4  # at least so many times
_SMALLEST = 16  # pixels a side, as of the dataset's images
_WARM = 2  # turns: a launch is recorded in its first or second, and at full speed from the third on
_PACKAGES = ("mitsuba", "drjit", "torch", "numpy", "pyoidn")


@dataclass(frozen=True)
class Wish:
    """What to do."""

    views: int = 4  # at most
    repeats: int = 3
    max_spp: int = 64
    reference_spp: int = 0  # 0: `_MORE` times `max_spp`
    raw_reference: bool = False  # not denoised
    size: tuple[int, int] | None = None  # width, height; None: the dataset's
    clock: Clock = "wall"

    @property
    def reference(self) -> int:
        """Samples a pixel of the reference; `ParameterError` if they are too few."""
        samples = self.reference_spp or _MORE * self.max_spp
        if samples < _LEAST * self.max_spp:
            raise ParameterError(
                f"--reference-spp: {samples} is not allowed; a reference for --max-spp "
                f"{self.max_spp} needs at least {_LEAST * self.max_spp}"
            )
        return samples


@dataclass(frozen=True)
class Outcome:
    """What the turns over one view brought: seconds by part, and pictures by method and samples."""

    seconds: dict[str, list[float]]
    errors: dict[tuple[str, int | None], tuple[float, float]]  # FLIP, SSIM
    noise: float  # of the reference


def study_time(
    params: Params, folders: Folders, wish: Wish, renders: Path
) -> tuple[TimeResult, Path]:
    """Run the study; writes `metrics/studies/time.json` and the plot `time.png` beside it.

    References are kept below `renders` and not made again. Raises as `open_split`, `InputError` if
    the scenes or cameras are not there, `ParameterError` for a reference of too few samples.
    """
    if wish.size and min(wish.size) < _SMALLEST:
        raise ParameterError(
            f"--size: {wish.size} is not allowed; at least {_SMALLEST} pixels a side"
        )
    reference = with_samples(params, wish.reference, denoise=not wish.raw_reference)
    reference = replace(reference, seed=derive(params.seed, "study", "time", "reference"))
    # Threads that wait for one another spin, which by the processor's clock would count as work.
    torch.set_num_threads(1 if wish.clock == "cpu" else len(os.sched_getaffinity(0)))
    folder = folders.metrics / "studies"
    for place in (folder, renders):
        sweep(place)
    networks, dataset = open_split(params, folders, trained_baselines(folders.models))
    examples = spread_over(dataset, wish.views)
    scenes = {name: scene_of(folders.data, name) for name in {e.scene_id for e in examples}}
    views = views_of(folders.data, examples)
    views = [resized(view, wish.size) for view in views] if wish.size else views
    set_variant(params.farm.variant)
    machine = _machine()
    size = f"{views[0].width}x{views[0].height}"
    store = Renders(renders / (f"{size}-raw" if wish.raw_reference else size), reference)
    _references(scenes, views, store)
    outcomes = []
    with Progress(len(views) * (_WARM + wish.repeats), "study time: by turns", "turns") as progress:
        for view in views:
            with open_changed(scenes[view.scene_id], LightChange()) as opened:
                bench = Bench(opened, view, params, networks, store, wish.clock)
                outcomes.append(bench.run(_samples(wish.max_spp), wish.repeats, progress))
    shaded = {name for name, card in networks.cards.items() if card.training.get("shadows")}
    result = TimeResult(
        seed=params.seed,
        split=dataset.split,
        views=len(views),
        scenes=len(scenes),
        size=(views[0].width, views[0].height),
        panorama=params.illumination.width,
        repeats=wish.repeats,
        clock=wish.clock,
        dataset_spp=params.groundtruth.spp,
        reference_spp=wish.reference,
        reference_denoised=not wish.raw_reference,
        reference_noise=mean(outcome.noise for outcome in outcomes),
        exposure=networks.card.exposure,
        machine=machine,
        versions=_versions(),
        models={name: card.sha256 for name, card in sorted(networks.cards.items())},
        parts=_parts(outcomes),
        points=_points(outcomes, shaded),
    )
    with atomic_file(folder / "time.png") as partial:
        partial.write_bytes(time_plot(result))
    write_json(folder / "time.json", plain(result))
    return result, folder / "time.json"


class Bench:
    """One view with all ways to a picture of it."""

    def __init__(
        self,
        scene: RenderScene,
        view: View,
        params: Params,
        networks: Networks,
        store: Renders,
        clock: Clock = "wall",
    ) -> None:
        self.now = time.process_time if clock == "cpu" else time.perf_counter
        self.scene, self.view, self.params, self.networks = scene, view, params, networks
        self.seed = derive(params.seed, "study", "time", view.scene_id, view.view_id)
        self.panorama = self._illumination()
        self.inputs = self._inputs()
        light = self.panorama | self._visibility()
        truths = store.read("shading", view), store.read("color", view)
        self.noise = float(truths[1].meta["noise"])
        pair = (truths[0].channels, truths[1].channels)
        self.example: Example = example_of(view, self.inputs, light, networks.card, pair)
        self.truth = true_color(self.example, networks)
        self.seconds: dict[str, list[float]] = defaultdict(list)
        self.errors: dict[tuple[str, int | None], tuple[float, float]] = {}

    def run(self, samples: list[int], repeats: int, progress: Progress) -> Outcome:
        """`_WARM` turns that do not count, then so many that do."""
        for turn in range(_WARM + repeats):
            if turn == _WARM:
                self.seconds.clear()
            self._networks_turn()
            self._renderer_turn(samples)
            progress.advance()
        return Outcome(dict(self.seconds), dict(self.errors), self.noise)

    def _networks_turn(self) -> None:
        networks, example = self.networks, self.example
        self._timed("inputs", self._inputs)
        self._timed("illumination", self._illumination)
        if self._shadows():
            self._timed("visibility", self._visibility)
        shading = self._timed("shading", lambda: networks.shading(example))
        for method in ("pbrnet", "product", *networks.baselines):
            given = example
            if method in METHODS and METHODS[method].noisy:
                noisy = self._timed("samples", partial(self._sampled, method))
                given = with_samples_of(example, noisy)
            part = "composition" if method == "pbrnet" else method
            made = self._timed(part, partial(networks.predict, method, given, shading))
            self._note(method, None, made.color)

    def _renderer_turn(self, samples: list[int]) -> None:
        scene, view, params = self.scene, self.view, self.params
        albedo, normal = self._timed("guides", lambda: guides(scene, view))
        truth_seed = derive(self.seed, "truths")
        self._timed("truths", lambda: render_truths(scene, view, params, truth_seed))
        ways: dict[str, Callable[[Params], Channels]] = {"mitsuba": self._plain}
        if traced_together(params):
            ways["planned"] = self._planned
        for spp in samples:
            given = with_samples(params, spp, denoise=False)
            for name, way in ways.items():
                image = self._timed(f"{name}_{spp}", partial(way, given))
                clean = self._timed("denoiser", partial(denoise, image, albedo, normal))
                self._note(name, spp, self._shown(image))
                self._note(f"{name}_denoised", spp, self._shown(clean))

    def _inputs(self) -> Channels:
        return render_inputs(self.scene, self.view)

    def _illumination(self) -> Channels:
        return render_illumination(self.scene, self.view, self.params.illumination)

    def _shadows(self) -> bool:
        return any(card.training.get("shadows") for card in self.networks.cards.values())

    def _visibility(self) -> Channels:
        """The shadows of the panorama's lights, if a network takes them."""
        if not self._shadows():
            return {}
        return shadows_of(self.scene, self.view, self.params, self.panorama, self.inputs)

    def _sampled(self, name: str) -> Channels:
        """The noisy samples that a network takes."""
        made = sampled(self.scene, self.view, self.params, self.networks.cards[name])
        assert made is not None
        return made

    def _plain(self, given: Params) -> Channels:
        """Colour by Mitsuba's own path integrator."""
        return render_truth(self.scene.neutral(None), self.view, given.groundtruth, self.seed)[0]

    def _planned(self, given: Params) -> Channels:
        """Colour, and shading with it, as the dataset's are made."""
        both = render_both(
            self.scene, self.view, given.groundtruth, given.shading.albedo, self.seed
        )
        return both.color[0]

    def _shown(self, image: Channels) -> AnyArray:
        """Display values under the truth's exposure."""
        example = self.example
        shared = self.networks.card.exposure == "shared"
        exposure = example.exposure_shading if shared else example.exposure_color
        return tonemap(np.stack([image[band] for band in "RGB"], axis=-1), exposure)

    def _timed(self, part: str, work: Callable[[], Any]) -> Any:
        began = self.now()
        made = work()
        self.seconds[part].append(self.now() - began)
        return made

    def _note(self, method: str, spp: int | None, image: AnyArray) -> None:
        """How far a picture is from the truth; every turn makes the same one."""
        if (method, spp) not in self.errors:
            flip = float(flip_map(self.truth, image).mean())
            self.errors[method, spp] = flip, ssim(self.truth, image)


def _references(scenes: dict[str, Scene], views: list[View], store: Renders) -> None:
    """Make the references that are not there."""
    with Progress(len(views), "study time: references", "views") as progress:
        for scene in scenes.values():
            digest = scene_digest(scene.folder)
            mine = [view for view in views if view.scene_id == scene.scene_id]
            due = [view for view in mine if store.missing(view, digest)]
            progress.advance(len(mine) - len(due))
            if not due:
                continue
            with open_changed(scene, LightChange()) as opened:
                for view in due:
                    store.render(opened, view, digest)
                    progress.advance()


def _samples(most: int) -> list[int]:
    """1, 2, 4, … up to `most`."""
    return [1 << power for power in range(most.bit_length()) if 1 << power <= most]


def _parts(outcomes: list[Outcome]) -> dict[str, Spent]:
    """Seconds of every part but the renderer's ladder of samples, which is in the points."""
    names = [name for name in outcomes[0].seconds if not name.startswith(("mitsuba_", "planned_"))]
    return {name: _spent(outcomes, name) for name in names}


def _points(outcomes: list[Outcome], shaded: Collection[str]) -> tuple[Point, ...]:
    """Every way to a picture, with the seconds of all that it needs."""
    points = []
    for method, spp in outcomes[0].errors:
        needs = _needs(method, spp, shaded)
        seconds = mean(sum(median(outcome.seconds[part]) for part in needs) for outcome in outcomes)
        flip, likeness = (
            mean(outcome.errors[method, spp][index] for outcome in outcomes) for index in (0, 1)
        )
        points.append(Point(method, spp, seconds, flip, likeness))
    return tuple(sorted(points, key=lambda point: (point.method, point.spp or 0)))


def _needs(method: str, spp: int | None, shaded: Collection[str]) -> tuple[str, ...]:
    """The timed parts that make up a way to a picture; methods in `shaded` take shadows."""
    if spp is not None:
        renderer = method.removesuffix("_denoised")
        more = ("guides", "denoiser") if method.endswith("_denoised") else ()
        return (f"{renderer}_{spp}", *more)
    networks = {"pbrnet": ("shading", "composition"), "product": ("shading", "product")}
    if method in METHODS and METHODS[method].noisy:
        return ("inputs", "samples", method)  # it looks at no panorama
    light = ("illumination", "visibility") if method in shaded else ("illumination",)
    return ("inputs", *light, *networks.get(method, (method,)))


def _spent(outcomes: list[Outcome], part: str) -> Spent:
    times = [outcome.seconds[part] for outcome in outcomes]
    return Spent(
        mean(median(turns) for turns in times),
        mean(min(turns) for turns in times),
        mean(max(turns) for turns in times),
    )


def _machine() -> dict[str, str]:
    """Where it was timed, and how busy the machine was before it began."""
    return {
        "processor": _processor(),
        "threads": f"{len(os.sched_getaffinity(0))} allowed of {os.cpu_count()}",
        "load": f"{os.getloadavg()[0]:.1f} before the study began",
        "renderer": renderer_version(),
        "networks": f"on the processor, float32, threads: {torch.get_num_threads()}",
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _versions() -> dict[str, str]:
    found = {package: version(package) for package in _PACKAGES}
    return {"python": platform.python_version(), **found, "denoiser": denoiser_version()}
