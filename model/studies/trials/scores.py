"""Scores of a trial: metrics of every view, intervals over scenes, and a sheet of pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from statistics import mean, stdev
from typing import Any

import numpy as np

from pbrnet.model.data.encoding import Policy, color_exposure
from pbrnet.model.data.reader import Dataset, Example
from pbrnet.model.evaluation.evaluate import Score, image_of
from pbrnet.model.evaluation.inference import Networks, load_networks
from pbrnet.model.evaluation.metrics import NAMES, bootstrap, find_lpips, measure
from pbrnet.model.methods import PREDICTABLE
from pbrnet.model.studies.trials.results import MetricEstimate
from pbrnet.model.studies.trials.specular import measure_apart, specular_mask
from pbrnet.model.studies.trials.texture import detail, grid
from pbrnet.model.training.store import ModelCard
from pbrnet.pipeline.images import Picture, contact_sheet, enlarge, png_bytes, read_picture
from pbrnet.pipeline.progress import Progress
from pbrnet.pipeline.tonemap import to_bytes, tonemap
from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.files import atomic_directory, read_bytes
from pbrnet.scenes.seeds import derive

MEASURED = (*NAMES, "detail", "grid")
SHEET_WIDTH = 320  # approximate width of a picture on the sheet, pixels

Predictor = Callable[[Example], AnyArray]  # view -> display values (H, W, 3)
Key = tuple[str, str]  # scene, view


def load_predictors(
    methods: Iterable[str], folder: Path
) -> tuple[dict[str, Predictor], dict[str, ModelCard]]:
    """Return the predictor of each method, from the models in `folder`, and their model cards.

    Raises `InputError` for a missing or damaged model.
    """
    networks = load_networks(folder, [name for name in methods if name in PREDICTABLE])
    predictors = {method: _predictor(method, networks) for method in methods}
    return predictors, networks.cards


def score_views(
    dataset: Dataset,
    predictors: Mapping[str, Predictor],
    exposure: Policy,
    pictures: Path,
    wanted: Sequence[Key],
    label: str,
    albedo: float | None = None,
) -> list[Score]:
    """Return the metrics of every view by every method and of `truth`, the renderer's picture.

    The `wanted` views are drawn into the folder `pictures`, as `SCENE--VIEW--METHOD.png`. With
    `albedo`, the grey of the shading, specular and matte pixels are also measured separately.
    """
    lpips = find_lpips()
    rows: list[Score] = []
    with Progress(len(dataset), label) as progress, atomic_directory(pictures) as partial:
        for example in dataset.ordered():
            truth = tonemap(example["color"], color_exposure(example, exposure))
            mask = None if albedo is None else specular_mask(example, albedo)
            drawn = {name: predict_image(example) for name, predict_image in predictors.items()}
            for name, image in ({"truth": truth} | drawn).items():
                values: dict[str, float | None] = dict.fromkeys(NAMES)
                if name != "truth":
                    values = measure(truth, image, lpips)
                values |= {"detail": detail(truth, image), "grid": grid(image)}
                if mask is not None and name != "truth":
                    values |= measure_apart(truth, image, mask)
                rows.append(Score(example.scene_id, example.view_id, name, values))
                if (example.scene_id, example.view_id) in wanted:
                    file = f"{example.scene_id}--{example.view_id}--{name}.png"
                    (partial / file).write_bytes(png_bytes(to_bytes(image)))
            progress.advance()
    return rows


def figures(
    repeats: Sequence[Sequence[Score]],
    reference: Sequence[Sequence[Score]] | None,
    seed: int,
    study: str,
) -> dict[str, Any]:
    """Return mean and interval of every metric of one method; `repeats`: its scores by repeat.

    A view counts with its mean over the repeats; intervals resample scenes. `reference`: scores of
    the method to compare with, view by view; None for the reference itself.
    """
    result: dict[str, Any] = {}
    others = {name for rows in repeats for row in rows for name in row.values} - set(MEASURED)
    for name in (*MEASURED, *sorted(others)):
        values = _by_view(repeats, name)
        if not values:
            result[name] = None
            continue
        resampling_seed = derive(seed, "study", study, name)
        interval = bootstrap(_by_scene(values), resampling_seed)
        means = [mean(_by_view([rows], name).values()) for rows in repeats]
        gain = None
        if reference is not None:
            reference_values = _by_view(reference, name)
            differences = {
                key: values[key] - reference_values[key]
                for key in values
                if key in reference_values
            }
            gain = bootstrap(_by_scene(differences), resampling_seed) if differences else None
        result[name] = MetricEstimate(
            mean=interval.mean,
            low=interval.low,
            high=interval.high,
            spread=stdev(means) if len(means) > 1 else None,
            gain=gain.mean if gain else None,
            gain_low=gain.low if gain else None,
            gain_high=gain.high if gain else None,
        )
    return result


def picture_views(dataset: Dataset, count: int) -> list[Key]:
    """Return `count` views: the first of each scene, then the second of each, and so on."""
    keys = zip(dataset.column("scene_id"), dataset.column("view_id"), strict=True)
    views: dict[str, list[str]] = {}
    for scene, view in sorted(keys):
        views.setdefault(scene, []).append(view)
    rounds = sorted((place, scene) for scene, names in views.items() for place in range(len(names)))
    return [(scene, views[scene][place]) for place, scene in rounds[:count]]


def sheet(columns: Mapping[str, tuple[Path, str]], wanted: Sequence[Key], crop: float) -> bytes:
    """Return a PNG with a row per view and a column per method, cropped alike and enlarged.

    `columns`: label -> folder of pictures and the method's name in it. The crop, a share of height
    and width, is where the first column has most edges.
    """
    cells: list[Picture] = []
    labels: list[str] = []
    for scene, view in wanted:
        place: tuple[slice, slice] | None = None
        for label, (folder, method) in columns.items():
            picture = read_picture(read_bytes(folder / f"{scene}--{view}--{method}.png"))
            place = place or busiest_window(picture, crop)
            cells.append(enlarge(picture[place], SHEET_WIDTH))
            labels.append(f"{label}, {scene}" if label == next(iter(columns)) else label)
    return png_bytes(contact_sheet(cells, len(columns), labels))


def busiest_window(picture: Picture, share: float) -> tuple[slice, slice]:
    """Return rows and columns of the window with most edges; `share`: of height and width."""
    height, width = picture.shape[:2]
    tall, wide = max(1, round(share * height)), max(1, round(share * width))
    grey = picture.astype(np.float64).mean(axis=-1)
    edges = np.abs(np.diff(grey, axis=0, append=grey[-1:])) + np.abs(
        np.diff(grey, axis=1, append=grey[:, -1:])
    )
    total = np.pad(edges.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    sums = total[tall:, wide:] - total[:-tall, wide:] - total[tall:, :-wide] + total[:-tall, :-wide]
    top, left = np.unravel_index(int(sums.argmax()), sums.shape)
    return slice(int(top), int(top) + tall), slice(int(left), int(left) + wide)


def _predictor(method: str, networks: Networks) -> Predictor:
    return lambda example: image_of(method, example, None, networks)


def _by_view(repeats: Sequence[Sequence[Score]], name: str) -> dict[Key, float]:
    """Return the mean of a metric over the repeats, for every view."""
    values: dict[Key, list[float]] = {}
    for rows in repeats:
        for row in rows:
            value = row.values.get(name)
            if value is not None:
                values.setdefault((row.scene_id, row.view_id), []).append(value)
    return {key: mean(found) for key, found in values.items()}


def _by_scene(values: Mapping[Key, float]) -> dict[str, list[float]]:
    scenes: dict[str, list[float]] = {}
    for (scene, _), value in sorted(values.items()):
        scenes.setdefault(scene, []).append(value)
    return scenes
