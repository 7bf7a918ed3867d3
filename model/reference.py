"""What a reference run found, in one small file to keep, and a sheet of its pictures.

`metrics/reference.json` is what the project says of itself: every method's means, flat, so that
another program reads them in a line, and beside them what they rest on.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from model.data import Dataset, Example
from model.evaluation import METHODS, image_of, open_split, true_color
from model.inference import load_networks
from model.methods import trained_baselines
from model.metrics import NAMES
from model.training import Folders
from pipeline.params import Params
from pipeline.pictures import contact_sheet, enlarge, png_bytes
from pipeline.tonemap import to_bytes
from scenes.errors import InputError
from scenes.files import read_json

SHOWN = 320  # pixels, width of a picture on the sheet, by whole multiples


def summary(folders: Folders) -> dict[str, Any]:
    """Every method's means and seconds an image; intervals, data and networks beside them.

    Raises `InputError` without `evaluation.json`, or if a network is missing or damaged.
    """
    path = folders.metrics / "evaluation.json"
    if not path.is_file():
        raise InputError(f"{path}: no such file; make it with: pbrnet evaluate")
    found: dict[str, Any] = read_json(path)
    cards = load_networks(folders.models, ("pbrnet", *trained_baselines(folders.models))).cards
    trained = cards["shading"].data
    return {
        "methods": _flat(found["methods"]),
        "intervals": _intervals(found["methods"]),
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
    networks, dataset = open_split(params, folders, trained_baselines(folders.models))
    rows = {(row.scene_id, row.view_id): row for row in _examples(dataset, chosen)}
    pictures, labels = [], []
    for scene, view, flip in chosen:
        example = rows[scene, view]
        shading = networks.shading(example)
        images = [true_color(example, networks)]
        images += [image_of(method, example, shading, networks) for method in methods]
        pictures += [enlarge(to_bytes(image), SHOWN) for image in images]
        labels += [f"truth, {scene}", f"{methods[0]}, FLIP {flip:.2f}", *methods[1:]]
    return png_bytes(contact_sheet(pictures, 1 + len(methods), labels))


def _examples(dataset: Dataset, chosen: Sequence[tuple[str, str, float]]) -> Iterator[Example]:
    keys = zip(dataset.column("scene_id"), dataset.column("view_id"), strict=True)
    numbers = {key: number for number, key in enumerate(keys)}
    return dataset.at([numbers[scene, view] for scene, view, _ in chosen])


def _ranked(path: Path, method: str) -> list[tuple[str, str, float]]:
    """Scene, view and FLIP of all views, the best first."""
    if not path.is_file():
        raise InputError(f"{path}: no such file; make it with: pbrnet evaluate")
    with path.open(newline="", encoding="utf-8") as stream:
        rows = [row for row in csv.DictReader(stream) if row["method"] == method]
    if not rows:
        raise InputError(f"{path}: no figures of {method!r}")
    found = [(row["scene_id"], row["view_id"], float(row["flip"])) for row in rows]
    return sorted(found, key=lambda row: (row[2], row[0], row[1]))


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
