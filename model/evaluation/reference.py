"""Summary of an evaluation: one flat JSON file, and a contact sheet of pictures.

`metrics/reference.json` is what the project says of itself: every method's means, flat, so that
another program reads them in a line, and beside them what they rest on.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from model.data.reader import Dataset, Example
from model.evaluation.evaluate import METHODS, image_of, open_split, true_color
from model.evaluation.inference import PREDICTABLE, available, load_networks
from model.evaluation.metrics import NAMES, bootstrap
from model.methods import METHODS as TRAINED
from model.training.train import Folders
from pipeline.images import contact_sheet, enlarge, png_bytes
from pipeline.params import Params
from pipeline.tonemap import to_bytes
from scenes.checked import plain
from scenes.errors import InputError
from scenes.files import read_json
from scenes.seeds import derive

BASELINES = ("unet", "can", "pix2pix", "cyclegan")  # the paper's, with its loss
PAIRS = (
    ("hybrid", "denoised"),
    ("plus", "pbrnet"),
    ("pbrnet", "product"),
    *((ours, other) for ours in ("pbrnet", "plus") for other in BASELINES),
)
SHOWN = 320  # pixels, width of a picture on the sheet, by whole multiples


def summary(params: Params, folders: Folders) -> dict[str, Any]:
    """Every method's means and seconds an image; intervals, data and networks beside them.

    `differences` are those of `PAIRS`, view by view: what two methods have in common, the scenes,
    is out of them. Raises `InputError` without `evaluation.json` and `.csv`, or if a network is
    missing or damaged.
    """
    path = folders.metrics / "evaluation.json"
    if not path.is_file():
        raise InputError(f"{path}: no such file; make it with: pbrnet evaluate")
    found: dict[str, Any] = read_json(path)
    networks = load_networks(folders.models, available(folders.models))
    cards = networks.cards
    trained = cards.get("shading", networks.card).data
    return {
        "methods": _flat(found["methods"]),
        "intervals": _intervals(found["methods"]),
        "differences": _differences(folders.metrics / "evaluation.csv", params.seed),
        **{name: found[name] for name in ("split", "views", "scenes", "exposure", "backbone")},
        "kept_back": (apart := found.get("kept_back"))
        and {
            "views": apart["views"],
            "scenes": apart["scenes"],
            "methods": _flat(apart["methods"]),
            "intervals": _intervals(apart["methods"]),
        },
        "trained_on": {
            "dataset": trained.fingerprint,
            "views": trained.views,
            "scenes": len(trained.scenes),
            "plans": len(trained.plans),
        },
        "networks": {
            name: {
                "parameters": card.parameters,
                "steps": card.training["steps"],
                "width": card.architecture.width,
                "levels": card.architecture.levels,
                "sha256": card.sha256,
            }
            for name, card in cards.items()
        },
    }


def sheet(params: Params, folders: Folders, methods: Sequence[str], count: int) -> bytes:
    """A PNG: a row a view of the split, from the best of the first method to its worst.

    Columns: the truth, then the methods. Rows are spread evenly over the ranking by FLIP.
    Raises `InputError` for a method without figures, else as `open_split`.
    """
    wanted = _ranked(folders.metrics / "evaluation.csv", methods[0])
    steps = max(1, min(count, len(wanted)) - 1)
    chosen = [wanted[k * (len(wanted) - 1) // steps] for k in range(min(count, len(wanted)))]
    networks, dataset = open_split(params, folders, _shown(folders.models, methods))
    rows = {(row.scene_id, row.view_id): row for row in _examples(dataset, chosen)}
    pictures, labels = [], []
    for scene, view, flip in chosen:
        example = rows[scene, view]
        shading = networks.shading(example) if networks.two_stage else None
        images = [true_color(example, networks)]
        images += [image_of(method, example, shading, networks) for method in methods]
        pictures += [enlarge(to_bytes(image), SHOWN) for image in images]
        labels += [f"truth, {scene}", f"{methods[0]}, FLIP {flip:.2f}", *methods[1:]]
    return png_bytes(contact_sheet(pictures, 1 + len(methods), labels))


def _shown(models: Path, methods: Sequence[str]) -> list[str]:
    """Methods of the folder to load: those shown, and for `denoised` one that takes its samples.

    `pbrnet` comes first if it is there, so that all sheets have one exposure.
    """
    return [
        name
        for name in PREDICTABLE
        if name in available(models)
        and (
            name == "pbrnet"
            or name in methods
            or ("denoised" in methods and name in TRAINED and TRAINED[name].uses_noisy_samples)
        )
    ] or available(models)[:1]


def _examples(dataset: Dataset, chosen: Sequence[tuple[str, str, float]]) -> Iterator[Example]:
    keys = zip(dataset.column("scene_id"), dataset.column("view_id"), strict=True)
    numbers = {key: number for number, key in enumerate(keys)}
    return dataset.at([numbers[scene, view] for scene, view, _ in chosen])


def _ranked(path: Path, method: str) -> list[tuple[str, str, float]]:
    """Scene, view and FLIP of all views, the best first."""
    rows = _scores(path, "flip").get(method)
    if not rows:
        raise InputError(f"{path}: no figures of {method!r}")
    found = [(scene, view, value) for (scene, view), value in rows.items()]
    return sorted(found, key=lambda row: (row[2], row[0], row[1]))


def _differences(path: Path, seed: int) -> dict[str, dict[str, Any]]:
    """By "one - other": the mean difference of each metric and its 95 % interval over scenes, and
    on how many of the views one is better by FLIP."""
    result: dict[str, dict[str, Any]] = {}
    for name in ("ssim", "psnr", "flip"):
        scores = _scores(path, name)
        for one, other in PAIRS:
            if one not in scores or other not in scores:
                continue
            by_scene: dict[str, list[float]] = {}
            for (scene, view), value in scores[one].items():
                by_scene.setdefault(scene, []).append(value - scores[other][scene, view])
            pair = result.setdefault(f"{one} - {other}", {})
            pair[name] = plain(bootstrap(by_scene, derive(seed, "reference", name)))
            if name == "flip":
                pair["better"] = sum(gain < 0 for gains in by_scene.values() for gain in gains)
    return result


def _scores(path: Path, name: str) -> dict[str, dict[tuple[str, str], float]]:
    """A metric of every method and view: method -> scene and view -> value."""
    if not path.is_file():
        raise InputError(f"{path}: no such file; make it with: pbrnet evaluate")
    scores: dict[str, dict[tuple[str, str], float]] = {}
    with path.open(newline="", encoding="utf-8") as stream:
        for row in csv.DictReader(stream):
            view = row["scene_id"], row["view_id"]
            scores.setdefault(row["method"], {})[view] = float(row[name])
    return scores


def _flat(methods: dict[str, Any]) -> dict[str, dict[str, float | None]]:
    return {
        method: {
            **{name: values[name]["mean"] if values[name] else None for name in NAMES},
            "seconds": values["seconds"],
        }
        for method in METHODS
        if (values := methods.get(method))
    }


def _intervals(methods: dict[str, Any]) -> dict[str, dict[str, list[float] | None]]:
    return {
        method: {
            name: [figure["low"], figure["high"]] if (figure := values[name]) else None
            for name in NAMES
        }
        for method in METHODS
        if (values := methods.get(method))
    }
