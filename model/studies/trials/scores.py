"""What a trial's networks are worth: scores of every view, intervals over scenes, a sheet."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import mean, stdev
from typing import Any

import numpy as np

from model.data.encoding import Policy, color_exposure
from model.data.reader import Dataset, Example
from model.evaluation.evaluate import image_of
from model.evaluation.inference import PREDICTABLE, Networks, load_networks
from model.evaluation.metrics import NAMES, bootstrap, find_lpips, measure
from model.studies.trials.patterns import detail, grid
from model.studies.trials.results import TrialsFigure
from model.studies.trials.specular import measure_apart, specular_mask
from model.training.store import ModelCard
from pipeline.images import Picture, contact_sheet, enlarge, png_bytes, read_picture
from pipeline.progress import Progress
from pipeline.tonemap import to_bytes, tonemap
from scenes.arrays import AnyArray
from scenes.files import atomic_directory
from scenes.seeds import derive

MEASURED = (*NAMES, "detail", "grid")
SHOWN = 320  # pixels that a picture on the sheet is about wide

Painter = Callable[[Example], AnyArray]  # display values (H, W, 3)
Key = tuple[str, str]  # scene, view


@dataclass(frozen=True)
class Scored:
    """A view as a method draws it, measured."""

    scene_id: str
    view_id: str
    method: str
    values: dict[str, float | None]  # by metric


def load_painters(
    methods: Iterable[str], folder: Path
) -> tuple[dict[str, Painter], dict[str, ModelCard]]:
    """How each method draws a view, from the models in `folder`, and the cards of those.

    Raises `InputError` for a missing or damaged model.
    """
    networks = load_networks(folder, [name for name in methods if name in PREDICTABLE])
    painters = {method: _painter(method, networks) for method in methods}
    return painters, networks.cards


def score_views(
    dataset: Dataset,
    painters: Mapping[str, Painter],
    exposure: Policy,
    pictures: Path,
    wanted: Sequence[Key],
    label: str,
    albedo: float | None = None,
) -> list[Scored]:
    """Every metric of every view by every method, and `truth`, the renderer's own picture.

    The `wanted` views are drawn into the folder `pictures`: `SCENE--VIEW--METHOD.png`. With
    `albedo`, the grey of the shading, what is specular is measured apart.
    """
    lpips = find_lpips()
    rows: list[Scored] = []
    with Progress(len(dataset), label) as progress, atomic_directory(pictures) as partial:
        for example in dataset.ordered():
            truth = tonemap(example.color, color_exposure(example, exposure))
            mask = None if albedo is None else specular_mask(example, albedo)
            drawn = {name: paint(example) for name, paint in painters.items()}
            for name, image in ({"truth": truth} | drawn).items():
                values: dict[str, float | None] = dict.fromkeys(NAMES)
                if name != "truth":
                    values = measure(truth, image, lpips)
                values |= {"detail": detail(truth, image), "grid": grid(image)}
                if mask is not None and name != "truth":
                    values |= measure_apart(truth, image, mask)
                rows.append(Scored(example.scene_id, example.view_id, name, values))
                if (example.scene_id, example.view_id) in wanted:
                    file = f"{example.scene_id}--{example.view_id}--{name}.png"
                    (partial / file).write_bytes(png_bytes(to_bytes(image)))
            progress.advance()
    return rows


def figures(
    repeats: Sequence[Sequence[Scored]],
    reference: Sequence[Sequence[Scored]] | None,
    seed: int,
    study: str,
) -> dict[str, Any]:
    """Means and intervals of one method's scores, a list of views for each repeat.

    A view counts with its mean over the repeats; scenes are drawn for the interval. `reference`:
    the same of the method that this one is compared with, view by view; None for that itself.
    """
    result: dict[str, Any] = {}
    others = {name for rows in repeats for row in rows for name in row.values} - set(MEASURED)
    for name in (*MEASURED, *sorted(others)):
        values = _by_view(repeats, name)
        if not values:
            result[name] = None
            continue
        lots = derive(seed, "study", study, name)
        interval = bootstrap(_by_scene(values), lots)
        means = [mean(_by_view([rows], name).values()) for rows in repeats]
        gain = None
        if reference is not None:
            theirs = _by_view(reference, name)
            differences = {key: values[key] - theirs[key] for key in values if key in theirs}
            gain = bootstrap(_by_scene(differences), lots) if differences else None
        result[name] = TrialsFigure(
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
    """The first view of each scene, then the second of each, until there are `count`."""
    keys = zip(dataset.column("scene_id"), dataset.column("view_id"), strict=True)
    views: dict[str, list[str]] = {}
    for scene, view in sorted(keys):
        views.setdefault(scene, []).append(view)
    rounds = sorted((place, scene) for scene, names in views.items() for place in range(len(names)))
    return [(scene, views[scene][place]) for place, scene in rounds[:count]]


def sheet(columns: Mapping[str, tuple[Path, str]], wanted: Sequence[Key], crop: float) -> bytes:
    """A PNG with a row a view and a column a method, all cut alike and enlarged by whole pixels.

    `columns`: label -> folder of pictures and the method's name in it; the first column, the
    truth, says where to cut: where it has most edges. `crop`: share of height and width.
    """
    cells: list[Picture] = []
    labels: list[str] = []
    for scene, view in wanted:
        place: tuple[slice, slice] | None = None
        for label, (folder, method) in columns.items():
            picture = read_picture((folder / f"{scene}--{view}--{method}.png").read_bytes())
            place = place or busiest(picture, crop)
            cells.append(enlarge(picture[place], SHOWN))
            labels.append(f"{label}, {scene}" if label == next(iter(columns)) else label)
    return png_bytes(contact_sheet(cells, len(columns), labels))


def busiest(picture: Picture, share: float) -> tuple[slice, slice]:
    """Rows and columns of the window with the most edges; `share` of height and width."""
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


def _painter(method: str, networks: Networks) -> Painter:
    return lambda example: image_of(method, example, None, networks)


def _by_view(repeats: Sequence[Sequence[Scored]], name: str) -> dict[Key, float]:
    """The metric of every view, its mean over the repeats."""
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
