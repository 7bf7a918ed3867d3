"""Summary of an evaluation: a flat JSON file and a contact sheet of images.

`metrics/reference.json` holds the project's reference figures: the mean of each metric of each
method, in a flat layout that is easy to read by other programs, with confidence intervals and facts
about the data and the networks.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from pbrnet.model.data.reader import Dataset, Example, Split
from pbrnet.model.evaluation.evaluate import EVALUATED_METHODS, image_of, open_split, true_color
from pbrnet.model.evaluation.inference import available, load_networks
from pbrnet.model.evaluation.metrics import NAMES, bootstrap
from pbrnet.model.methods import METHODS, PREDICTABLE
from pbrnet.model.training.train import Folders
from pbrnet.pipeline.images import contact_sheet, enlarge, png_bytes
from pbrnet.pipeline.tonemap import ToneParams, to_bytes
from pbrnet.scenes.checked import plain
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import read_csv, read_json
from pbrnet.scenes.seeds import derive

BASELINES = ("unet", "can", "pix2pix", "cyclegan")  # of the paper, trained with its loss
PAIRS = (
    ("hybrid", "denoised"),
    ("plus", "pbrnet"),
    ("plus", "radiosity"),
    ("pbrnet", "product"),
    *((ours, other) for ours in ("pbrnet", "plus") for other in BASELINES),
)
SHOWN = 320  # width of an image on the sheet in pixels, by integer enlargement


def summary(folders: Folders, seed: int) -> dict[str, Any]:
    """Contents of `reference.json`: figures of each method, and facts on data and networks.

    `differences` compares the methods of `PAIRS` view by view, so the difficulty of the scenes
    cancels. Raises `InputError` without `evaluation.json` and `.csv`, or if a network is missing or
    damaged.
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
        "differences": _differences(folders.metrics / "evaluation.csv", seed),
        **{name: found[name] for name in ("split", "views", "scenes", "exposure", "backbone")},
        "kept_back": (held_out := found.get("kept_back"))
        and {
            "views": held_out["views"],
            "scenes": held_out["scenes"],
            "methods": _flat(held_out["methods"]),
            "intervals": _intervals(held_out["methods"]),
        },
        "trained_on": {
            "dataset": trained.fingerprint,
            "views": trained.views,
            "scenes": len(trained.scenes),
            "plans": len(trained.plans),
        },
        "training_views": trained.views,
        "trainings": 1,  # of each network
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


def sheet(
    split: Split, tone: ToneParams, folders: Folders, methods: Sequence[str], count: int
) -> bytes:
    """Contact sheet as PNG: a row for each view, from the best to the worst of the first method.

    Columns: the truth, then the methods. The `count` rows are spread evenly over the ranking by
    FLIP. Raises `InputError` for a method without figures, and as `open_split` does.
    """
    ranked = _ranked(folders.metrics / "evaluation.csv", methods[0])
    steps = max(1, min(count, len(ranked)) - 1)
    chosen = [ranked[k * (len(ranked) - 1) // steps] for k in range(min(count, len(ranked)))]
    networks, dataset = open_split(split, tone, folders, _shown(folders.models, methods))
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
    """Methods to load: those shown, and for `denoised` one that uses noisy samples.

    `pbrnet` comes first if it is available, so that all sheets have the same exposure.
    """
    return [
        name
        for name in PREDICTABLE
        if name in available(models)
        and (
            name == "pbrnet"
            or name in methods
            or ("denoised" in methods and name in METHODS and METHODS[name].takes_samples)
        )
    ] or available(models)[:1]


def _examples(dataset: Dataset, chosen: Sequence[tuple[str, str, float]]) -> Iterator[Example]:
    keys = zip(dataset.column("scene_id"), dataset.column("view_id"), strict=True)
    numbers = {key: number for number, key in enumerate(keys)}
    return dataset.at([numbers[scene, view] for scene, view, _ in chosen])


def _ranked(path: Path, method: str) -> list[tuple[str, str, float]]:
    """Scene, view and FLIP of all views, in order of increasing FLIP."""
    rows = _scores(path, "flip").get(method)
    if not rows:
        raise InputError(f"{path}: no figures for {method!r}")
    found = [(scene, view, value) for (scene, view), value in rows.items()]
    return sorted(found, key=lambda row: (row[2], row[0], row[1]))


def _differences(path: Path, seed: int) -> dict[str, dict[str, Any]]:
    """Differences by pair, "one - other": each metric's mean difference and 95 % interval.

    `better` is the number of views on which the first method has a lower FLIP.
    """
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
    """A metric by method, then by (scene, view)."""
    if not path.is_file():
        raise InputError(f"{path}: no such file; make it with: pbrnet evaluate")
    scores: dict[str, dict[tuple[str, str], float]] = {}
    try:
        for row in read_csv(path):
            view = row["scene_id"], row["view_id"]
            scores.setdefault(row["method"], {})[view] = float(row[name])
    except (KeyError, ValueError) as error:
        raise InputError(f"{path}: damaged ({error}); make it with: pbrnet evaluate") from None
    return scores


def _flat(methods: dict[str, Any]) -> dict[str, dict[str, float | None]]:
    return {
        method: {
            **{name: values[name]["mean"] if values[name] else None for name in NAMES},
            "seconds": values["seconds"],
        }
        for method in EVALUATED_METHODS
        if (values := methods.get(method))
    }


def _intervals(methods: dict[str, Any]) -> dict[str, dict[str, list[float] | None]]:
    return {
        method: {
            name: [figure["low"], figure["high"]] if (figure := values[name]) else None
            for name in NAMES
        }
        for method in EVALUATED_METHODS
        if (values := methods.get(method))
    }
