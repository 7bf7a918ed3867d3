"""Packing of trained networks for release, in half precision and with a model card.

The folder `weights/` contains the pretrained networks of pbrnet, which are used if no network has
been trained. A packed network is stored like any other (`model/training/store.py`), with half the
bytes per weight.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from pbrnet.model.data.reader import Dataset, Example
from pbrnet.model.evaluation.inference import Networks, available, load_networks, needed
from pbrnet.model.methods import METHODS, columns_of
from pbrnet.model.titles import NETWORK_TITLES
from pbrnet.model.training.store import ModelCard, load_model
from pbrnet.model.training.weights import write_weights
from pbrnet.pipeline.farm.versions import PACKED
from pbrnet.pipeline.templating import templates
from pbrnet.scenes.checked import plain
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import atomic_directory, digest_file, read_json, write_json

DEPTH = "depth"  # network of photographs, from `pbrnet.model.studies.photographs.release`
DEPTH_FILES = (f"{DEPTH}.safetensors", f"{DEPTH}.json")
LIMIT = 16_000_000  # maximum size of the folder in bytes
# Maximum and mean difference allowed between predictions of a packed and the original network, in
# display values [0, 1]. A step of 8 bits is 0.0039.
WORST, MEAN = 0.008, 0.001
VIEWS = 4  # number of views for the comparison
HALF_MAX = 0.5 * torch.finfo(torch.float16).max


@dataclass(frozen=True)
class Models:
    """Folder of networks, the method to run, and a description for messages."""

    folder: Path
    method: str
    description: str


@dataclass(frozen=True)
class Difference:
    """Difference between predictions of packed and original networks, in display values."""

    method: str
    views: int
    worst: float
    mean: float


def find_models(models: Path | None, method: str | None) -> Models:
    """Folder of networks for a method: `models` if given, else `models/`, else `PACKED`.

    Without `method` it is the first available one. Raises `InputError` if no folder has its
    networks.
    """
    folders = [models] if models is not None else [Path("models"), PACKED]
    for folder in folders:
        present = available(folder)
        chosen = method if method in present else None if method else next(iter(present), None)
        if chosen:
            packed = models is None and folder == PACKED
            description = f"{folder} (pretrained, see its README.md)" if packed else str(folder)
            return Models(folder, chosen, description)
    names = needed(method or "pbrnet")
    searched = " or ".join(str(folder) for folder in folders)
    others = sorted({name for folder in folders for name in available(folder)})
    hint = f"; available are networks for --method {', '.join(others)}" if others else ""
    raise InputError(
        f"{folders[0] / names[0]}.safetensors: no such model (looked in {searched}){hint}; make it "
        + " and ".join(f"with: pbrnet train {name}" for name in names)
    )


def pack(
    source: Path, target: Path, methods: Sequence[str], data: Path, metrics: Path
) -> list[Difference]:
    """Write the packed networks of these methods to the folder `target`, by rename.

    Returns the differences between predictions. Raises `InputError` and leaves `target` unchanged
    if networks or views for the comparison are missing, if `target` contains other files, if
    predictions differ by more than `WORST` or `MEAN`, or if the folder would exceed `LIMIT`.
    """
    _check_target(source, target)
    methods = tuple(dict.fromkeys(methods))
    originals = load_networks(source, methods)
    examples = _views(data, columns_of(methods))
    figures = _figures(metrics)
    names = tuple(dict.fromkeys(name for method in methods for name in needed(method)))
    with atomic_directory(target) as partial:
        digests: dict[str, str] = {}
        for name in names:
            digests[name] = _pack_network(source, partial, name, digests)
        packed = load_networks(partial, methods)
        differences = [_compare(originals, packed, method, examples) for method in methods]
        for kept in (target / name for name in DEPTH_FILES if (target / name).is_file()):
            shutil.copy(kept, partial)  # the network of photographs is packed apart
        card = _card(packed, differences, figures)
        (partial / "README.md").write_text(card, encoding="utf-8")
        size = sum(file.stat().st_size for file in partial.iterdir())
        if size > LIMIT:
            raise InputError(
                f"{target}: {size / 1e6:.1f} MB of weights, but at most {LIMIT / 1e6:.0f} MB are "
                f"allowed; train {' and '.join(names)} with a smaller width, or pack fewer "
                "methods, for example: --method plus"
            )
    return differences


def _check_target(source: Path, target: Path) -> None:
    """Raise `InputError` if the folder, which is replaced as a whole, contains other files."""
    if target.resolve() == source.resolve():
        raise InputError(f"{target}: contains the networks to pack; give another folder")
    if target.exists() and not target.is_dir():
        raise InputError(f"{target}: not a folder")
    packed = {"README.md", *DEPTH_FILES} | {f"{name}{suffix}" for name in METHODS
                            for suffix in (".safetensors", ".json")}  # fmt: skip
    present = {path.name for path in target.iterdir()} if target.is_dir() else set()
    if present - packed:
        raise InputError(
            f"{target}: contains {min(present - packed)!r}, which is not a packed network; the "
            "folder would be replaced, so give an empty or a new one"
        )


def _pack_network(source: Path, target: Path, name: str, digests: dict[str, str]) -> str:
    """Write a network in half precision with its card; returns the digest of the weights."""
    network, card = load_model(source / f"{name}.safetensors")
    state = {key: value.contiguous() for key, value in network.state_dict().items()}
    dtype = half_type(state)
    path = target / f"{name}.safetensors"
    write_weights(path, {key: value.to(dtype) for key, value in state.items()})
    digest = digest_file(path)
    needs = {other: digests[other] for other in card.needs}
    packed = replace(
        card,
        sha256=digest,
        needs=needs,
        precision=str(dtype).removeprefix("torch."),
        packed_from=card.packed_from or card.sha256,
    )
    write_json(target / f"{name}.json", plain(packed))
    return digest


def half_type(state: dict[str, torch.Tensor]) -> torch.dtype:
    """float16, or bfloat16 if a weight exceeds half the range of float16."""
    largest = max(float(value.abs().max()) for value in state.values() if value.numel())
    return torch.float16 if largest < HALF_MAX else torch.bfloat16


def _views(data: Path, columns: Sequence[str]) -> list[Example]:
    """Views spread evenly over the first split that exists: test, validation or train."""
    missing: InputError | None = None
    for split in ("test", "validation", "train"):
        try:
            dataset = Dataset(data / "dataset", split, columns)  # type: ignore[arg-type]
        except InputError as error:
            missing = missing or error
            continue
        numbers = np.linspace(0, len(dataset) - 1, min(VIEWS, len(dataset))).astype(int)
        return list(dataset.at([int(number) for number in numbers]))
    raise InputError(f"packing requires a dataset to compare predictions: {missing}")


def _compare(
    original: Networks, packed: Networks, method: str, examples: Sequence[Example]
) -> Difference:
    errors = [
        np.abs(original.predict(method, example).color - packed.predict(method, example).color)
        for example in examples
    ]
    worst = max(float(error.max()) for error in errors)
    mean = float(np.mean([error.mean() for error in errors]))
    if not (worst <= WORST and mean <= MEAN):
        raise InputError(
            f"{method}: predictions of the packed networks differ from the original ones by up to "
            f"{worst:.4f}, on average by {mean:.5f} (allowed: {WORST} and {MEAN}); half precision "
            "does not suit these weights: train longer, or release models/ itself"
        )
    return Difference(method, len(examples), worst, mean)


def _figures(metrics: Path) -> dict[str, Any]:
    """Results of `pbrnet evaluate` for the card; `InputError` if it has not been run."""
    path = metrics / "evaluation.json"
    if not path.is_file():
        raise InputError(f"{path}: no such file; the card requires results: pbrnet evaluate")
    found: dict[str, Any] = read_json(path)
    missing = [key for key in ("views", "scenes", "split", "methods") if key not in found]
    if missing:
        raise InputError(f"{path}: {missing[0]!r} is missing; make it again with: pbrnet evaluate")
    return found


def _card(packed: Networks, differences: Sequence[Difference], figures: dict[str, Any]) -> str:
    cards: list[ModelCard] = list(packed.cards.values())
    licences = sorted({licence for card in cards for licence in card.data.licences})
    credits = sorted({line for card in cards for line in card.data.attributions})
    shown, held_out = [*packed.methods, "denoised", "ceiling"], figures.get("kept_back")
    environment = templates("pbrnet.model.release", markup=False)
    environment.filters["json"] = lambda value: json.dumps(value, sort_keys=True)
    return environment.get_template("model_card.md").render(
        methods=packed.methods,
        titles={name: NETWORK_TITLES[name] for name in packed.cards},
        cards=packed.cards,
        card=packed.card,
        differences=differences,
        worst=WORST,
        mean=MEAN,
        figures=figures,
        tables=[
            {**block, "rows": [(name, block["methods"].get(name)) for name in shown]}
            for block in (figures, held_out)
            if block
        ],
        transport=any("transport" in METHODS[card.architecture.kind].inputs for card in cards),
        materials=any(card.training.get("materials") for card in cards),
        noisy_spp=[spp for card in cards if (spp := card.training.get("noisy_spp"))],
        noisy_range=next((r for card in cards if (r := card.training.get("noisy_range"))), [4, 4]),
        licences=licences,
        credits=credits,
    )
