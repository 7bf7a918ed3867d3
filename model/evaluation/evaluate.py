"""Evaluate stage: metrics and timings of all methods on scenes held out from training."""

from __future__ import annotations

import csv
import io
import math
import os
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import mean
from typing import Any

import numpy as np
import torch

from pbrnet.model.data.encoding import color_exposure, input_columns, input_named, shading_exposure
from pbrnet.model.data.reader import NOISY_SPP, Dataset, Example, Split, image_columns
from pbrnet.model.evaluation.inference import Networks, available, load_networks, needed
from pbrnet.model.evaluation.metrics import NAMES, bootstrap, find_lpips, flip_map, measure
from pbrnet.model.methods import BASELINES, METHODS, PREDICTABLE, PRODUCTS, columns_of
from pbrnet.model.training.store import ModelCard
from pbrnet.model.training.train import Folders
from pbrnet.pipeline.channels import column_channel, remedy
from pbrnet.pipeline.costs.ledger import read_ledger
from pbrnet.pipeline.images import error_picture, png_bytes
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.progress import Progress
from pbrnet.pipeline.splits import kept_back
from pbrnet.pipeline.tonemap import ToneParams, to_bytes, tonemap
from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.checked import plain
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import atomic_directory, read_json, write_json, write_text
from pbrnet.scenes.seeds import derive

# Methods of the renderer alone, by the column that holds their pictures.
RENDERED = {"radiosity": "transport_color", "denoised": "denoised_color"}
EVALUATED_METHODS = (*PREDICTABLE, *RENDERED, "ceiling")
LEDGER_PARTS = {"noisy": "sampling", "transport": "radiosity"}  # stage to part of a method
EXAMPLES = 4  # number of best views, and of worst views, with example images
RENDERER_STAGES = (
    "groundtruth",
    "color",
    "shading",
    "noisy",
    "inputs",
    "illumination",
    "visibility",
    "transport",
)


class LeakError(InputError):
    """A network was trained on a scene of the split to evaluate."""


@dataclass(frozen=True)
class Score:
    """Metrics of a method on a view: a row of `evaluation.csv`."""

    scene_id: str
    view_id: str
    method: str
    values: dict[str, float | None]  # by metric


def evaluate(params: Params, folders: Folders) -> dict[str, Any]:
    """Measure every method on the split; write `evaluation.json`, `.csv` and example images.

    A method is measured if its networks are in the models folder: `pbrnet` (both networks),
    `product` and `product_linear` (reflectance x predicted shading, tone-mapped by Reinhard's
    operator or linearly), and the trained methods of the registry. Further rows are `ceiling`
    (reflectance x true shading), the upper bound of `product`; `radiosity`, if the dataset has the
    set `transport`; and `denoised` (the denoiser alone) if the noisy samples of the dataset are
    read. The example images are the best and worst views of
    the first method.

    Raises `InputError` if there are no networks, or if `pbrnet` is trained but a method of
    `train.baselines` is not. Raises `LeakError` if a network was trained on a scene of the split or
    on another scene of its floor plan.
    """
    torch.set_num_threads(len(os.sched_getaffinity(0)))
    methods, left_out = _measurable(
        _methods_in(params.train.baselines, folders.models), params.evaluate.split, folders
    )
    networks, dataset = open_split(params.evaluate.split, params.tone, folders, methods)
    lpips = find_lpips()
    scores: list[Score] = []
    with Progress(len(dataset), "evaluate") as progress:
        if lpips is None:
            progress.write("evaluate: without LPIPS: its weights are not installed")
        for method, reason in left_out.items():
            progress.write(f"evaluate: without {method}: {reason}")
        for example in dataset.ordered():
            truth = true_color(example, networks)
            for method, image in _images(example, networks).items():
                if method in EVALUATED_METHODS:
                    values = measure(truth, image, lpips)
                    _stop_if_nan(values, example, method)
                    scores.append(Score(example.scene_id, example.view_id, method, values))
            progress.advance()

    ranked = sorted(
        (score for score in scores if score.method == networks.methods[0]),
        key=lambda score: (score.values["flip"], score.scene_id, score.view_id),
    )
    best, worst = ranked[:EXAMPLES], ranked[EXAMPLES:][-EXAMPLES:][::-1]
    seconds = time_networks(dataset, networks, params.evaluate.timing_views)
    seconds |= ledger_seconds(folders.data, scores)
    result = {
        "split": params.evaluate.split,
        "views": len(dataset),
        "scenes": len({score.scene_id for score in scores}),
        "backbone": networks.card.backbone["network"],
        "exposure": networks.card.exposure,
        **({"left_out": left_out} if left_out else {}),
        "methods": _methods(scores, seconds, params.seed),
        "kept_back": _kept_back(
            dataset, scores, seconds, params.dataset.splits.test_only, params.seed
        ),
        "timing": {**seconds, **renderer_seconds(folders.data, scores)},
        "examples_of": networks.methods[0],
        "examples": {
            "best": [[score.scene_id, score.view_id] for score in best],
            "worst": [[score.scene_id, score.view_id] for score in worst],
        },
    }
    _draw_examples(folders.metrics / "examples", dataset, networks, [*best, *worst])
    _write_scores(folders.metrics / "evaluation.csv", scores)
    write_json(folders.metrics / "evaluation.json", result)
    return result


def _stop_if_nan(values: Mapping[str, float | None], example: Example, method: str) -> None:
    """Raise `InputError` for a figure that is no number, as of an image with NaN."""
    for name, value in values.items():
        if value is not None and math.isnan(value):
            raise InputError(
                f"{example.scene_id}/{example.view_id}: {name} of {method} is not a number; "
                "look at the row with: pbrnet inspect"
            )


def _methods(scores: Sequence[Score], seconds: dict[str, float], seed: int) -> dict[str, Any]:
    """Figures of each method: metrics with their intervals, and seconds an image."""
    return {
        method: {
            **_summary([score for score in scores if score.method == method], seed),
            "seconds": _method_seconds(method, seconds),
        }
        for method in EVALUATED_METHODS
        if any(score.method == method for score in scores)
    }


def _kept_back(
    dataset: Dataset,
    scores: Sequence[Score],
    seconds: dict[str, float],
    test_only: Sequence[str],
    seed: int,
) -> dict[str, Any] | None:
    """Figures on the scenes of `dataset.splits.test_only`, whose sources training never uses.

    None if the split has none of these scenes.
    """
    known = dataset.plans()
    plans = {score.scene_id: known.get(score.scene_id, score.scene_id) for score in scores}
    held_out = kept_back(test_only, plans)
    selected = [score for score in scores if plans[score.scene_id] in held_out]
    if not selected:
        return None
    return {
        "views": len({(score.scene_id, score.view_id) for score in selected}),
        "scenes": len({score.scene_id for score in selected}),
        "methods": _methods(selected, seconds, seed),
    }


def open_split(
    split: Split,
    tone: ToneParams,
    folders: Folders,
    methods: Sequence[str],
    more: Sequence[str] = (),
) -> tuple[Networks, Dataset]:
    """Return the networks of these methods and the split they are measured on.

    `more`: columns to read beside those of the networks.

    Raises `LeakError` as `refuse_leaks` does, and `InputError` if a network is missing or its tone
    mapping differs from `tone`.
    """
    networks = load_networks(folders.models, methods)
    columns = dict.fromkeys((*columns_of(networks.baselines), *more))
    dataset = Dataset(folders.data / "dataset", split, tuple(columns))
    refuse_leaks(dataset, networks.cards)
    if networks.card.tone != plain(tone):
        raise InputError(
            f"{folders.models}: trained with the tone mapping {networks.card.tone}, but the "
            f"parameters give {plain(tone)}; train the networks again"
        )
    return networks, dataset


def _methods_in(baselines: Sequence[str], models: Path) -> list[str]:
    """Methods to measure: those whose networks are in the folder, in the order of `PREDICTABLE`.

    If `pbrnet` is among them, `baselines` are included even if missing, so
    that loading them fails. Raises `InputError` if the folder holds no networks.
    """
    present = available(models)
    if not present:
        raise InputError(
            f"{models}: no trained networks in this folder; train them (pbrnet train shading, "
            "pbrnet train composition), or give another folder with --models"
        )
    expected = baselines if "pbrnet" in present else ()
    return [name for name in PREDICTABLE if name in present or name in expected]


def _measurable(
    methods: Sequence[str], split: Split, folders: Folders
) -> tuple[list[str], dict[str, str]]:
    """Methods whose inputs the dataset has, and the reason for each of the others.

    Raises `InputError` if the dataset lacks an input of every method.
    """
    columns = image_columns(folders.data / "dataset", split)
    left_out = {}
    for method in methods:
        wanted = list(columns_of([method]))
        for name in needed(method):
            card = folders.models / f"{name}.json"
            if name not in METHODS or not card.is_file():
                continue
            facts = read_json(card)
            panorama = facts.get("architecture", {}).get("panorama", "normal")
            wanted += input_columns(METHODS[name].inputs_with(panorama))
            for optional in METHODS[name].optional_inputs:
                trained_with = facts.get("training", {}).get(optional)
                wanted += input_named(optional).columns if trained_with else ()
        missing = [name for name in dict.fromkeys(wanted) if name not in columns]
        if missing:
            remedies = "; ".join(dict.fromkeys(map(remedy, missing)))
            left_out[method] = f"the dataset has no {', '.join(missing)}; {remedies}"
    if len(left_out) == len(methods):
        reasons = "; ".join(f"{method}: {reason}" for method, reason in left_out.items())
        raise InputError(f"{folders.models}: no network can be measured ({reasons})")
    return [method for method in methods if method not in left_out], left_out


def refuse_leaks(dataset: Dataset, cards: Mapping[str, ModelCard]) -> None:
    """Raise `LeakError` if any network was trained on a scene or floor plan of this dataset.

    Evaluation on the split `train` is explicit, so it is allowed.
    """
    if dataset.split == "train":
        return
    plans = dataset.plans()
    scenes = sorted(set(dataset.column("scene_id")))
    for name, card in cards.items():
        for scene in scenes:
            # If plans are known they decide: different homes may have the same numbered name.
            if scene in card.data.scenes and scene not in plans:
                raise LeakError(
                    f"scene {scene!r} is in the {dataset.split} split, but {name} was trained on "
                    "it; train again on this dataset's own training split"
                )
            if plans.get(scene, scene) in card.data.plans:
                raise LeakError(
                    f"scene {scene!r} has the floor plan {plans.get(scene, scene)!r}, which "
                    f"{name} was trained on; train again on this dataset's own training split"
                )


def true_color(example: Example, networks: Networks) -> AnyArray:
    """True colour under the networks' exposure policy, display values float32 (H, W, 3)."""
    return tonemap(example["color"], color_exposure(example, networks.card.exposure))


def time_networks(dataset: Dataset, networks: Networks, views: int) -> dict[str, float]:
    """Seconds an image of each network or product: the median over `views`, after a warm-up."""
    examples = [example for _, example in zip(range(views + 1), dataset.ordered(), strict=False)]
    examples = [examples[0], *examples] if len(examples) == 1 else examples
    parts: dict[str, list[float]] = {}

    def timed(part: str, call: Callable[..., Any], *arguments: Any) -> Any:
        began = time.perf_counter()
        result = call(*arguments)
        parts.setdefault(part, []).append(time.perf_counter() - began)
        return result

    for example in examples:
        shading = timed("shading", networks.shading, example) if networks.two_stage else None
        for method in networks.methods:
            part = "composition" if method == "pbrnet" else method
            timed(part, networks.predict, method, example, shading)
    return {part: float(np.median(times[1:])) for part, times in parts.items()}


def ledger_seconds(data: Path, scores: Sequence[Score]) -> dict[str, float]:
    """Seconds of what a method takes from the renderer; without those that the ledger lacks.

    `sampling` traces the noisy samples of a view, `radiosity` computes its light transport.

    For each view: the worker's seconds without opening the scene, times its threads, divided by the
    processors on which the networks are timed. The median excludes the views during which the
    kernels of a scene were compiled, as the warm-up does for the networks.
    """
    views = {(score.scene_id, score.view_id) for score in scores}
    found: dict[str, list[float]] = {}
    for row in read_ledger(data).to_pylist():
        if row["stage"] in LEDGER_PARTS and (row["scene_id"], row["view_id"]) in views:
            seconds = (row["seconds"] - (row["opening"] or 0)) * (row["threads"] or 1)
            found.setdefault(LEDGER_PARTS[row["stage"]], []).append(seconds)
    processors = len(os.sched_getaffinity(0))
    return {part: float(np.median(times)) / processors for part, times in found.items()}


def renderer_seconds(data: Path, scores: Sequence[Score]) -> dict[str, float]:
    """Mean seconds a view of each rendering stage; empty without ledger rows."""
    views = {(score.scene_id, score.view_id) for score in scores}
    found: dict[str, list[float]] = {}
    for row in read_ledger(data).to_pylist():
        if (row["scene_id"], row["view_id"]) in views and row["stage"] in RENDERER_STAGES:
            found.setdefault(f"renderer_{row['stage']}", []).append(row["seconds"])
    return {stage: mean(times) for stage, times in sorted(found.items())}


def image_of(
    method: str, example: Example, shading: AnyArray | None, networks: Networks
) -> AnyArray:
    """Colour of a view by a method of `EVALUATED_METHODS`, display values float32 (H, W, 3).

    `shading` is the prediction of the shading network if it is known already. Raises `InputError`
    for `denoised` if the view has no noisy samples, for `radiosity` if it has no transport.
    """
    if method == "ceiling":
        exposure = shading_exposure(example, networks.card.exposure)
        method, shading = "product", tonemap(example["shading"], exposure)
    if method in RENDERED:
        exposure = color_exposure(example, networks.card.exposure)
        return tonemap(example[RENDERED[method]], exposure)
    return networks.predict(method, example, shading).color


def _images(example: Example, networks: Networks) -> dict[str, AnyArray]:
    """Colour of a view by each method, and `shading` of the shading network if it is loaded."""
    shading = networks.shading(example) if networks.two_stage else None
    methods = [networks.methods[0], "ceiling", *networks.methods[1:]]
    methods += [method for method, column in RENDERED.items() if column in example]
    images = {method: image_of(method, example, shading, networks) for method in methods}
    return images if shading is None else {"shading": shading, **images}


def _summary(scores: Sequence[Score], seed: int) -> dict[str, Any]:
    summary: dict[str, Any] = {}
    for name in NAMES:
        by_scene: dict[str, list[float]] = {}
        for score in scores:
            value = score.values[name]
            if value is not None:
                by_scene.setdefault(score.scene_id, []).append(value)
        interval = bootstrap(by_scene, derive(seed, "evaluate", name)) if by_scene else None
        summary[name] = plain(interval) if interval else None
    return summary


def _method_seconds(method: str, parts: dict[str, float]) -> float | None:
    """Seconds of all parts of a method, without its inputs; None if those of a part are unknown."""
    if method == "ceiling":
        return None
    needed: dict[str, tuple[str, ...]] = {"pbrnet": ("shading", "composition")}
    needed |= {name: ("shading", name) for name in PRODUCTS}
    # The ledger's seconds of `radiosity` are those of light transport, `sampling` those of samples.
    for name in BASELINES:
        kinds = {column_channel(c).kind for c in METHODS[name].columns if c != NOISY_SPP}
        needed[name] = (name, *(LEDGER_PARTS[kind] for kind in kinds if kind in LEDGER_PARTS))
    needed["denoised"] = ("sampling",)  # includes the guides and the denoiser
    times = [parts.get(part) for part in needed.get(method, (method,))]
    return None if None in times else sum(time for time in times if time is not None)


def _draw_examples(
    folder: Path, dataset: Dataset, networks: Networks, chosen: Iterable[Score]
) -> None:
    views = {(score.scene_id, score.view_id) for score in chosen}
    first = networks.methods[0]
    names = {"shading": "shading", "product": "product"}
    names |= {name: name for name in networks.baselines}
    names[first] = "prediction"
    with atomic_directory(folder) as partial:
        for example in dataset.ordered():
            if (example.scene_id, example.view_id) not in views:
                continue
            images = _images(example, networks)
            stem = f"{example.scene_id}--{example.view_id}"
            for method, name in names.items():
                if method in images:
                    picture = to_bytes(images[method])
                    (partial / f"{stem}--{name}.png").write_bytes(png_bytes(picture))
            errors = flip_map(true_color(example, networks), images[first])
            (partial / f"{stem}--error.png").write_bytes(png_bytes(error_picture(errors)))


def _write_scores(path: Path, scores: Sequence[Score]) -> None:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("scene_id", "view_id", "method", *NAMES))
    for score in scores:
        values = [
            "" if score.values[name] is None else f"{score.values[name]:.6g}" for name in NAMES
        ]
        writer.writerow((score.scene_id, score.view_id, score.method, *values))
    write_text(path, text.getvalue())
