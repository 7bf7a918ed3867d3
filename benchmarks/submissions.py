"""Submissions of this project to its open benchmark: pictures by method, with CPU seconds.

Colour by the methods of a dataset with the set `transport` and noisy samples, and by the networks
in `weights/`; albedo and normals by rules so simple that other methods should beat them.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import click
import numpy as np
from scipy.ndimage import gaussian_filter

from pbrnet.model.benchmark.pictures import Task
from pbrnet.model.benchmark.views import ViewList
from pbrnet.model.data.reader import Dataset, Example
from pbrnet.model.evaluation.inference import Networks, load_networks
from pbrnet.model.methods import METHODS
from pbrnet.pipeline.costs.ledger import read_ledger
from pbrnet.pipeline.export.images import write_exr
from pbrnet.pipeline.frames import banded
from pbrnet.pipeline.tonemap import tonemap
from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.color import decode_srgb, luminance
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import write_json

WEIGHTS = Path("weights")
_MATT = 0.5  # mean reflectance that the rules for albedo take for granted
_COMPILED = 4.0  # a view with the compilation of its kernels, relative to the quickest, at least


@dataclass(frozen=True)
class Way:
    """A method: picture of a view, and the pipeline's stages whose cost belongs to it."""

    name: str
    task: Task
    title: str
    samples: int  # a pixel, traced
    picture: Callable[[Example], AnyArray]
    stages: tuple[str, ...] = ()


def submissions(dataset: Path, data: Path, views: ViewList, out: Path) -> dict[Task, list[Path]]:
    """Write the pictures of every method; return the folders by task.

    `data` is the data folder of the dataset: its ledger says what a stage took.
    """
    reader = Dataset(dataset, "test", METHODS["hybrid"].columns)
    names = {(view.scene_id, view.view_id) for view in views.views}
    examples = [one for one in reader.ordered() if (one.scene_id, one.view_id) in names]
    folders: dict[Task, list[Path]] = {}
    for way in _ways():
        folder = out / way.task / way.name
        folder.mkdir(parents=True, exist_ok=True)
        for path in folder.iterdir():
            path.unlink()
        seconds = _write(way, examples, folder)
        seconds += sum(_stage_seconds(data, stage, names) for stage in way.stages)
        write_json(folder / "seconds.json", seconds)
        about = {"method": way.title, "samples": way.samples}
        write_json(folder / "about.json", about)
        folders.setdefault(way.task, []).append(folder)
    return folders


def _ways() -> Iterator[Way]:
    yield Way("reflectance", "color", "reflectance x one grey", 0, lambda one: one["reflectance"])
    yield Way(
        "radiosity", "color", "light transport", 0, lambda one: one["transport_color"],
        stages=("transport",),
    )  # fmt: skip
    yield from _network("plus", "network on light transport, pretrained", 0, ("transport",))
    yield Way(
        "denoised", "color", "4 samples, Open Image Denoise", 4,
        lambda one: one["denoised_color"], stages=("noisy",),
    )  # fmt: skip
    yield from _network("hybrid", "4 samples, network, pretrained", 4, ("noisy", "transport"))
    yield Way("grey", "albedo", "one grey", 0, lambda one: np.full_like(one["color"], _MATT))
    yield Way("picture", "albedo", "the image itself", 0, _as_displayed)
    yield Way("retinex", "albedo", "image over its blurred luminance", 0, _retinex)
    yield Way("camera", "normal", "all towards the camera", 0, _towards)
    yield Way("box", "normal", "floor, ceiling and two walls", 0, _box)


def _network(name: str, title: str, samples: int, stages: tuple[str, ...]) -> Iterator[Way]:
    """Yield the method of pretrained networks; nothing if the weights are of an earlier form."""
    try:
        networks = load_networks(WEIGHTS, [name])
    except InputError as error:
        click.echo(f"left out: {error}")
        return
    yield Way(name, "color", title, samples, partial(_radiance, networks), stages)


def _write(way: Way, examples: Sequence[Example], folder: Path) -> float:
    """Write the pictures; return the median CPU seconds of a view, the first left out."""
    way.picture(examples[0])
    spent = []
    for example in examples:
        before = time.process_time()
        picture = way.picture(example)
        spent.append(time.process_time() - before)
        name = f"{example.scene_id}--{example.view_id}"
        write_exr(folder / f"{name}.exr", banded(picture.astype(np.float32)))
    return float(np.median(spent))


def _stage_seconds(data: Path, stage: str, names: set[tuple[str, str]]) -> float:
    """Return the median CPU seconds of a view in a stage, without opening the scene.

    The first view of a scene in each worker compiles its kernels, which takes many times as long
    as the view: those that took `_COMPILED` times the quickest are left out.
    """
    seconds = np.array(
        [
            (row["seconds"] - (row["opening"] or 0)) * (row["threads"] or 1)
            for row in read_ledger(data).to_pylist()
            if row["stage"] == stage and (row["scene_id"], row["view_id"]) in names
        ]
    )
    return float(np.median(seconds[seconds < _COMPILED * seconds.min()]))


def _radiance(networks: Networks, example: Example) -> AnyArray:
    return networks.radiance(example, networks.predict(networks.methods[0], example)).color


def _as_displayed(example: Example) -> AnyArray:
    """Return what the picture shows as if it were albedo."""
    return decode_srgb(tonemap(example["color"], example.exposure_color).astype(np.float32))


def _retinex(example: Example) -> AnyArray:
    """Return radiance over its luminance blurred by a tenth of the width: light varies slowly."""
    level = luminance(example["color"].astype(np.float64))
    blurred = gaussian_filter(level, example["color"].shape[1] / 10)
    return np.clip(_MATT * example["color"] / np.maximum(blurred, 1e-9)[..., None], 0, 1)


def _towards(example: Example) -> AnyArray:
    normal = np.zeros_like(example["normal"])
    normal[..., 2] = -1
    return normal


def _box(example: Example) -> AnyArray:
    """Return normals of a box room seen straight on: the lower quarter of the picture is floor."""
    height, width = example["color"].shape[:2]
    normal = _towards(example)
    normal[:, : width // 4] = (1, 0, 0)
    normal[:, -(width // 4) :] = (-1, 0, 0)
    normal[-(height // 4) :] = (0, -1, 0)
    normal[: height // 8] = (0, 1, 0)
    return normal
