"""Time study: seconds of every part, and image quality of every method at equal time.

A turn runs all parts one after the other; turns are repeated, so that other load on the machine
affects all parts alike. A few views are timed, each the first of a scene; their first turns, which
compile kernels and record launches, are not counted. Of the other views, which come last, only
errors are measured, in one turn. Times are elapsed seconds or (`clock`) processor seconds of all
threads, which other processes hardly change. Networks compete with the path tracer at a few samples
per pixel, raw and denoised. All are compared with a reference of many more samples and independent
random numbers.

References and the measurements of a view are kept: an interrupted study goes on after the last
view. Measurements are removed when it ends, since they tell of the machine and of the code.
"""

from __future__ import annotations

import os
import platform
import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import version
from itertools import groupby
from pathlib import Path
from statistics import mean, median
from typing import Any

import click
import numpy as np
import torch

from pbrnet.model.data.encoding import INPUTS, color_exposure, input_columns
from pbrnet.model.data.reader import Example
from pbrnet.model.evaluation.evaluate import true_color
from pbrnet.model.evaluation.inference import Networks
from pbrnet.model.evaluation.metrics import flip_map, ssim
from pbrnet.model.evaluation.predict import (
    Rendered,
    ViewRenderer,
    example_of,
    images_of,
)
from pbrnet.model.evaluation.selection import resized
from pbrnet.model.methods import METHODS, PRODUCTS, columns_of, trained_baselines
from pbrnet.model.studies.files import result_path, write_result
from pbrnet.model.studies.frame_store import FrameStore, open_views, opened_scene, with_samples
from pbrnet.model.studies.options import option
from pbrnet.model.studies.time.plot import time_plot
from pbrnet.model.studies.time.results import (
    CLOCKS,
    HYBRID_SAMPLES,
    TRANSPORT_SAMPLES,
    Clock,
    MethodPoint,
    PartSeconds,
    TimeResult,
)
from pbrnet.model.training.train import Folders
from pbrnet.pipeline.channels import TRUTHS, Kind
from pbrnet.pipeline.commands.options import Size
from pbrnet.pipeline.farm.settings import FarmParams
from pbrnet.pipeline.farm.versions import processor, scene_digest
from pbrnet.pipeline.frames import Channels, stacked
from pbrnet.pipeline.keys import keys
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.passes.denoise import denoise, denoiser_version
from pbrnet.pipeline.passes.groundtruth import render_color, render_truth
from pbrnet.pipeline.passes.inputs import render_inputs
from pbrnet.pipeline.passes.registry import render, settings_of
from pbrnet.pipeline.passes.settings import GroundTruthParams, IlluminationParams
from pbrnet.pipeline.passes.surfaces import render_surfaces
from pbrnet.pipeline.passes.transport import prepare_quick, render_quick, samples_for
from pbrnet.pipeline.passes.truth import noisy_trace, sample_guides
from pbrnet.pipeline.passes.visibility import render_lights
from pbrnet.pipeline.progress import Progress
from pbrnet.pipeline.render.scene import RenderScene, renderer_version, set_variant
from pbrnet.pipeline.tonemap import tonemap
from pbrnet.pipeline.transport.settings import TransportParams
from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.checked import build, plain
from pbrnet.scenes.contract import Scene
from pbrnet.scenes.errors import ParameterError
from pbrnet.scenes.files import digest_bytes, read_json, sweep, write_json
from pbrnet.scenes.seeds import derive

_REFERENCE_FACTOR = 16  # default samples of the reference, as a multiple of `max_spp`
_MIN_REFERENCE_FACTOR = 4  # smallest multiple
_MIN_SIZE = 16  # pixels a side, as for the dataset's images
_WARM_UP_TURNS = 2  # of a timed view: a kernel launch is recorded in the first or second turn
_TIMED = 6  # views at most
_PACKAGES = ("mitsuba", "drjit", "torch", "numpy", "pyoidn")


@dataclass(frozen=True)
class TimeConfig:
    """Size of the study."""

    size: tuple[int, int] | None = option(
        None, Size(), "Image size, WxH.  [default: as in the dataset]"
    )
    views: int = option(
        4, click.IntRange(1), "Maximum number of views, spread evenly over the split."
    )
    repeats: int = option(3, click.IntRange(1, 1000), "Timed repetitions of each view.")
    max_spp: int = option(
        64,
        click.IntRange(1, 1 << 14),
        "Largest number of samples per pixel of the renderer: 1, 2, 4, … up to it.",
    )
    reference_spp: int = option(
        0,
        click.IntRange(0, 1 << 20),
        "Samples per pixel of the reference.  [default: 16 x --max-spp]",
        shown=False,
    )
    clock: Clock = option(
        "wall",
        click.Choice(list(CLOCKS)),
        "wall: elapsed time; cpu: processor time of all threads, for a busy machine.",
    )
    raw_reference: bool = option(
        False, bool, "Do not denoise the reference; its noise then lowers SSIM."
    )

    @property
    def reference(self) -> int:
        """Samples per pixel of the reference; raises `ParameterError` if they are too few."""
        samples = self.reference_spp or _REFERENCE_FACTOR * self.max_spp
        if samples < _MIN_REFERENCE_FACTOR * self.max_spp:
            raise ParameterError(
                f"--reference-spp: {samples} is not allowed; a reference for --max-spp "
                f"{self.max_spp} needs at least {_MIN_REFERENCE_FACTOR * self.max_spp}"
            )
        return samples


@dataclass(frozen=True)
class ViewMeasurement:
    """Measurements of one view: seconds by part and turn, errors by method and samples.

    The dataset's own truth, which takes longer than all else, is timed once, in the first view.
    """

    seconds: dict[str, tuple[float, ...]]  # empty for a view that is not timed
    errors: dict[str, tuple[float, float]]  # FLIP, SSIM; by `_key`
    noise: float  # of the reference


def study_time(
    params: Params, folders: Folders, config: TimeConfig, renders: Path
) -> tuple[TimeResult, Path]:
    """Run the study and write `metrics/studies/time.json` and the plot `time.png`.

    Returns the result and the path of the JSON file. Reference images are kept below `renders`.
    Raises as `open_split`, `InputError` for missing scenes or cameras, `ParameterError` for a
    reference of too few samples.
    """
    if config.size and min(config.size) < _MIN_SIZE:
        raise ParameterError(
            f"--size: {config.size} is not allowed; at least {_MIN_SIZE} pixels a side"
        )
    truth = with_samples(params.groundtruth, config.reference, denoise=not config.raw_reference)
    seed = derive(params.seed, "study", "time", "reference")
    reference = settings_of(replace(params, groundtruth=truth), TRUTHS)
    # Waiting threads spin, which processor time would count as work.
    torch.set_num_threads(1 if config.clock == "cpu" else len(os.sched_getaffinity(0)))
    target = result_path(folders.metrics, "time")
    for place in (target.parent, renders):
        sweep(place)
    methods = ("pbrnet", *PRODUCTS, *trained_baselines(folders.models))
    set_variant(params.farm.variant)
    opened = open_views(params.evaluate.split, params.tone, folders, methods, config.views)
    networks, scenes, views = opened.networks, opened.scenes, opened.views
    views = [resized(view, config.size) for view in views] if config.size else views
    machine = _machine()
    size = f"{views[0].width}x{views[0].height}"
    folder = renders / (f"{size}-raw" if config.raw_reference else size)
    store = FrameStore(folder, reference, seed)
    _references(scenes, views, store)
    renderer_of = partial(ViewRenderer, params=params)
    paths = _kept(store, views, networks, config, scenes, plain(replace(params, farm=FarmParams())))
    measurements = _measure_views(scenes, views, renderer_of, networks, store, config, paths)
    result = TimeResult(
        seed=params.seed,
        split=opened.split,
        views=len(views),
        scenes=len(scenes),
        size=(views[0].width, views[0].height),
        panorama=params.illumination.width,
        repeats=config.repeats,
        clock=config.clock,
        dataset_spp=params.groundtruth.spp,
        reference_spp=config.reference,
        reference_denoised=not config.raw_reference,
        reference_noise=mean(measurement.noise for measurement in measurements),
        exposure=networks.card.exposure,
        machine=machine,
        versions=_versions(),
        models={name: card.sha256 for name, card in sorted(networks.cards.items())},
        parts=_parts(measurements),
        points=_points(measurements),
        better=_better(measurements),
        timed_views=sum(bool(measurement.seconds) for measurement in measurements),
    )
    write_result(target, result, time_plot(result))
    for path in paths:
        path.unlink(missing_ok=True)
    return result, target


class ViewBenchmark:
    """Timing of all parts and methods on one view."""

    def __init__(
        self,
        renderer: ViewRenderer,
        view: View,
        networks: Networks,
        store: FrameStore,
        clock: Clock = "wall",
    ) -> None:
        self.now = time.process_time if clock == "cpu" else time.perf_counter
        self.scene, self.params = renderer.scene, renderer.params
        self.view, self.networks = view, networks
        self.seed = derive(self.params.seed, "study", "time", view.scene_id, view.view_id)
        self.takes = columns_of(networks.baselines)
        given = {**self._surfaces(), **self._lights()}
        if "transport_color" in self.takes:
            given["transport"] = self._transport(self.params.transport)
        truths = store.read("shading", view), store.read("color", view)
        self.noise = float(truths[1].meta["noise"])
        pair = (truths[0].channels, truths[1].channels)
        self.example: Example = example_of(view, Rendered(given), networks.card, pair)
        self.truth = true_color(self.example, networks)
        self.seconds: dict[str, list[float]] = defaultdict(list)
        self.errors: dict[str, tuple[float, float]] = {}

    def run(self, samples: list[int], repeats: int, truths: bool = False) -> ViewMeasurement:
        """Run one turn for errors alone; with `repeats`, turns to warm up, then those to time.

        `truths`: also time the dataset's own truth, once.
        """
        for turn in range(_WARM_UP_TURNS + repeats if repeats else 1):
            if turn == _WARM_UP_TURNS:
                self.seconds.clear()
            self._networks_turn()
            self._renderer_turn(samples)
        if truths:
            seed = derive(self.seed, "truths")
            settings = settings_of(self.params, TRUTHS)
            self._timed("truths", partial(render, self.scene, self.view, settings, seed))
        seconds = {part: tuple(turns) for part, turns in self.seconds.items()} if repeats else {}
        return ViewMeasurement(seconds, dict(self.errors), self.noise)

    def _networks_turn(self) -> None:
        networks, example = self.networks, self.example
        self._timed("inputs", self._inputs)
        if self._materials_taken():
            self._timed("surfaces", self._surfaces)
        self._timed("illumination", self._lights)
        if "transport_color" in self.takes:
            self._timed("transport", partial(self._transport, self.params.transport))
            exposure = color_exposure(example, networks.card.exposure)
            self._measure("radiosity", None, tonemap(example["transport_color"], exposure))
            self._reduced_turn()
        shading = self._timed("shading", lambda: networks.shading(example))
        for method in ("pbrnet", "product", *networks.baselines):
            if method in METHODS and METHODS[method].takes_samples:
                self._hybrid_turn(method)
                continue
            part = "composition" if method == "pbrnet" else method
            prediction = self._timed(part, partial(networks.predict, method, example, shading))
            self._measure(method, None, prediction.color)

    def _reduced_turn(self) -> None:
        """Light transport with fewer samples, and the network that corrects it."""
        transport = self.params.transport
        own = transport.samples or samples_for(self.view.width * self.view.height)
        exposure = color_exposure(self.example, self.networks.card.exposure)
        for spp in (number for number in TRANSPORT_SAMPLES if number < own):
            few = partial(self._transport, transport.reduced(spp))
            light = self._timed(f"transport_{spp}", few)
            given = self.example.having(**images_of("transport", light))
            self._measure("radiosity", spp, tonemap(given["transport_color"], exposure))
            if "plus" in self.networks.baselines:
                prediction = self.networks.predict("plus", given)
                self._measure("plus", spp, prediction.color)

    def _hybrid_turn(self, method: str) -> None:
        """A network that takes noisy samples, with each number of `HYBRID_SAMPLES`.

        Light transport has made their guides and light plan.
        """
        truth, root = self.params.groundtruth, self.params.seed
        prepared = prepare_quick(self.scene, self.view, root)
        for spp in HYBRID_SAMPLES:
            own: dict[Kind, Any] = {"noisy": noisy_trace(truth, spp)}
            trace = partial(render_quick, self.scene, self.view, own, root, prepared)
            noisy, _ = self._timed(f"samples_{spp}", trace)["noisy"]
            given = self.example.having(
                **images_of("noisy", noisy), noisy_spp=np.array(spp, np.float32)
            )
            prediction = self._timed(method, partial(self.networks.predict, method, given))
            self._measure(method, spp, prediction.color)

    def _renderer_turn(self, samples: list[int]) -> None:
        scene, view, params = self.scene, self.view, self.params
        albedo, normal = self._timed("guides", lambda: sample_guides(scene, view))
        renderers: dict[str, Callable[[GroundTruthParams], Channels]] = {"mitsuba": self._plain}
        if settings_of(params, ["color"])["color"].joint:
            renderers["planned"] = self._planned
        for spp in samples:
            settings = with_samples(params.groundtruth, spp, denoise=False)
            for name, draw in renderers.items():
                image = self._timed(f"{name}_{spp}", partial(draw, settings))
                clean = self._timed("denoiser", partial(denoise, image, albedo, normal))
                self._measure(name, spp, self._displayed(image))
                self._measure(f"{name}_denoised", spp, self._displayed(clean))

    def _inputs(self) -> Channels:
        return render_inputs(self.scene, self.view)

    def _lights(self) -> dict[Kind, Channels]:
        """Panorama, and the visibility of its lights if a network needs that."""
        params = self.params.illumination
        settings: dict[Kind, IlluminationParams] = {"illumination": params}
        taken = {
            column
            for name, card in self.networks.cards.items()
            for column in input_columns(METHODS[name].inputs_with(card.architecture.panorama))
        }
        if "visibility" in taken and params.shadow_rays:
            settings["visibility"] = params
        made = render_lights(self.scene, self.view, settings)
        return {kind: channels for kind, (channels, _) in made.items()}

    def _transport(self, params: TransportParams) -> Channels:
        settings: dict[Kind, Any] = {"transport": params}
        return render_quick(self.scene, self.view, settings, self.params.seed)["transport"][0]

    def _materials_taken(self) -> bool:
        return any(card.training.get("materials") for card in self.networks.cards.values())

    def _surfaces(self) -> dict[Kind, Channels]:
        """Inputs and materials, from one trace."""
        names: dict[Kind, Any] = {"inputs": None}
        if self._materials_taken():
            names["materials"] = INPUTS["materials"].columns
        made = render_surfaces(self.scene, self.view, names)
        return {kind: channels for kind, (channels, _) in made.items()}

    def _plain(self, truth: GroundTruthParams) -> Channels:
        """Render colour with Mitsuba's path integrator."""
        return render_truth(self.scene.neutral(None), self.view, truth, self.seed)[0]

    def _planned(self, truth: GroundTruthParams) -> Channels:
        """Render colour alone with the dataset's emitter sampling and path guiding."""
        return render_color(self.scene, self.view, truth, self.seed)[0]

    def _displayed(self, image: Channels) -> AnyArray:
        """Return display values under the exposure of the ground truth."""
        example = self.example
        shared = self.networks.card.exposure == "shared"
        exposure = example.exposure_shading if shared else example.exposure_color
        return tonemap(stacked(image), exposure)

    def _timed(self, part: str, work: Callable[[], Any]) -> Any:
        began = self.now()
        result = work()
        self.seconds[part].append(self.now() - began)
        return result

    def _measure(self, method: str, spp: int | None, image: AnyArray) -> None:
        """Measure the error of a picture once; it is the same in every turn."""
        key = _key(method, spp)
        if key not in self.errors:
            flip = float(flip_map(self.truth, image).mean())
            self.errors[key] = flip, ssim(self.truth, image)


def _measure_views(
    scenes: dict[str, Scene],
    views: list[View],
    renderer_of: Callable[[RenderScene], ViewRenderer],
    networks: Networks,
    store: FrameStore,
    config: TimeConfig,
    paths: list[Path],
) -> list[ViewMeasurement]:
    """Measure every view, or read what an interrupted study has measured, from `paths`."""
    samples = _samples(config.max_spp)
    timed = _timed_views(views)
    others = [number for number in range(len(views)) if number not in timed]
    found: dict[int, ViewMeasurement] = {}
    with Progress(len(views), "study time: measurements", "views") as progress:
        for part, repeats in ((timed, config.repeats), (others, 0)):
            for scene_id, group in groupby(part, lambda number: views[number].scene_id):
                due = []
                for number in group:
                    if paths[number].is_file():
                        known = read_json(paths[number])
                        found[number] = build(ViewMeasurement, known)
                        progress.advance()
                    else:
                        due.append(number)
                if not due:
                    continue
                with opened_scene(scenes[scene_id]) as opened:
                    renderer = renderer_of(opened)
                    for number in due:
                        benchmark = ViewBenchmark(
                            renderer, views[number], networks, store, config.clock
                        )
                        first = number == timed[0]
                        found[number] = benchmark.run(samples, repeats, truths=first)
                        write_json(paths[number], plain(found[number]))
                        progress.advance()
    return [found[number] for number in range(len(views))]


def _timed_views(views: Sequence[View]) -> list[int]:
    """Return the first view of each scene, of at most `_TIMED` scenes at even distances."""
    scenes = [view.scene_id for view in views]
    first = sorted(scenes.index(scene) for scene in set(scenes))
    count = min(_TIMED, len(first))
    return [first[k * len(first) // count] for k in range(count)]


def _kept(
    store: FrameStore,
    views: list[View],
    networks: Networks,
    config: TimeConfig,
    scenes: Mapping[str, Scene],
    settings: dict[str, Any],
) -> list[Path]:
    """Return the file that keeps the measurement of each view until the study ends."""
    models = {name: card.sha256 for name, card in sorted(networks.cards.items())}
    digests = {name: scene_digest(scene.folder) for name, scene in sorted(scenes.items())}
    code = keys("evaluate", "studies.time")
    state = (config, models, processor(), _versions(), code, settings, digests)
    name = digest_bytes(repr(state).encode())[:16]
    return [store.root / name / view.scene_id / f"{view.view_id}.json" for view in views]


def _references(scenes: dict[str, Scene], views: list[View], store: FrameStore) -> None:
    """Render missing reference images."""
    with Progress(len(views), "study time: references", "views") as progress:
        for scene in scenes.values():
            digest = scene_digest(scene.folder)
            mine = [view for view in views if view.scene_id == scene.scene_id]
            due = [view for view in mine if store.missing(view, digest)]
            progress.advance(len(mine) - len(due))
            if not due:
                continue
            with opened_scene(scene) as opened:
                for view in due:
                    store.render(opened, view, digest)
                    progress.advance()


def _samples(most: int) -> list[int]:
    """Return 1, 2, 4, … up to `most`."""
    return [1 << power for power in range(most.bit_length()) if 1 << power <= most]


def _parts(measurements: list[ViewMeasurement]) -> dict[str, PartSeconds]:
    """Return the seconds of every part except the renderers, which are in `_points`."""
    timed = [measurement for measurement in measurements if measurement.seconds]
    names = [name for name in timed[0].seconds if not name.startswith(("mitsuba_", "planned_"))]
    return {name: _part_seconds(timed, name) for name in names}


def _points(measurements: list[ViewMeasurement]) -> tuple[MethodPoint, ...]:
    """Return time and quality of every method; times include all parts that it needs."""
    points = []
    timed = [measurement for measurement in measurements if measurement.seconds]
    for key in measurements[0].errors:
        method, spp = _method_of(key)
        needs = _parts_of(method, spp, "surfaces" in timed[0].seconds)
        seconds = mean(
            sum(median(measurement.seconds[part]) for part in needs) for measurement in timed
        )
        flip, likeness = (
            mean(measurement.errors[key][index] for measurement in measurements) for index in (0, 1)
        )
        points.append(MethodPoint(method, spp, seconds, flip, likeness))
    return tuple(sorted(points, key=lambda point: (point.method, point.spp or 0)))


def _better(measurements: list[ViewMeasurement]) -> dict[str, int]:
    """Count views by `TimeResult.better`, for methods and samples that both were measured."""
    counts: dict[str, int] = {}
    for measurement in measurements:
        for key, (flip, _) in measurement.errors.items():
            method, spp = _method_of(key)
            denoised = measurement.errors.get(_key("planned_denoised", spp))
            samples = method in METHODS and METHODS[method].takes_samples
            if samples and denoised is not None:
                counts[key] = counts.get(key, 0) + (flip < denoised[0])
    return counts


def _key(method: str, spp: int | None) -> str:
    """Return the name of a method at a number of samples, as in `TimeResult.better`."""
    return method if spp is None else f"{method} {spp}"


def _method_of(key: str) -> tuple[str, int | None]:
    method, _, spp = key.partition(" ")
    return method, int(spp) if spp else None


def _parts_of(method: str, spp: int | None, materials: bool) -> tuple[str, ...]:
    """Return the timed parts that a method needs; with `materials` transport's networks need them.

    `spp`: samples of a renderer, of a network that takes noisy samples, or of light transport.
    """
    sampled = method in METHODS and METHODS[method].takes_samples
    transport = "transport" if spp is None or sampled else f"transport_{spp}"
    if method == "radiosity":
        return (transport,)
    if method in METHODS and "transport" in METHODS[method].inputs:
        samples = (f"samples_{spp}",) if sampled else ()
        return ("surfaces" if materials else "inputs", transport, *samples, method)
    if spp is not None:
        renderer = method.removesuffix("_denoised")
        more = ("guides", "denoiser") if method.endswith("_denoised") else ()
        return (f"{renderer}_{spp}", *more)
    networks = {"pbrnet": ("shading", "composition"), "product": ("shading", "product")}
    return ("inputs", "illumination", *networks.get(method, (method,)))


def _part_seconds(measurements: list[ViewMeasurement], part: str) -> PartSeconds:
    times = [m.seconds[part] for m in measurements if part in m.seconds]
    return PartSeconds(
        mean(median(turns) for turns in times),
        mean(min(turns) for turns in times),
        mean(max(turns) for turns in times),
    )


def _machine() -> dict[str, str]:
    """Describe the machine and its load before the study."""
    return {
        "processor": processor(),
        "threads": f"{len(os.sched_getaffinity(0))} allowed of {os.cpu_count()}",
        "load": f"{os.getloadavg()[0]:.1f} before the study began",
        "renderer": renderer_version(),
        "networks": f"on the processor, float32, threads: {torch.get_num_threads()}",
    }


def _versions() -> dict[str, str]:
    found = {package: version(package) for package in _PACKAGES}
    return {"python": platform.python_version(), **found, "denoiser": denoiser_version()}
