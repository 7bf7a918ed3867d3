"""A workplace for the studies: networks nobody has trained, a test split, keys and answers."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from model_fixtures import box_dataset

from model.methods import METHODS, build_network
from model.networks.pbrnet import Architecture
from model.studies.pairs.answers import Answer, Key, Pair
from model.training.store import TrainingData, save_model
from model.training.train import Folders
from pipeline.params import ToneParams
from scenes.checked import plain

SIZE = {"width": 40, "height": 30, "panorama": 16}


def untrained(models: Path, seed: int = 0) -> None:
    """The two networks and the U-Net with random weights, and cards that fit them."""
    torch.manual_seed(seed)
    seen = TrainingData("0" * 64, 0, (), (), (), ())
    needs: dict[str, str] = {}
    for name in ("shading", "composition", "unet"):
        architecture = Architecture(METHODS[name].layout, 4, 2)
        card = save_model(
            models,
            build_network(architecture),
            {
                "name": name,
                "architecture": architecture,
                "exposure": "shared",
                "white": 1.0,
                "tone": plain(ToneParams()),
                "albedo": 0.5,
                "training": {},
                "data": seen,
                "backbone": {"network": "none"},
                "metrics": {},
                "needs": needs,
                "versions": {},
                "licence": "MIT",
            },
        )
        needs = {"shading": card.sha256} if name == "shading" else {}


def workplace(root: Path, views: int = 14) -> Folders:
    """Data with so many test views, and models, as `pbrnet` expects them in `root`."""
    folders = Folders(*(root / part for part in ("data", "models", "metrics", "plots", "models")))
    box_dataset(folders.data, 0, 0, views, **SIZE)
    untrained(folders.models)
    (root / "params.yaml").write_text("seed: 0\n")
    return folders


def key_of(methods: dict[str, int], page: str = "0123456789abcdef") -> Key:
    """So many pairs of each method, the truth left and right in turn."""
    names = [method for method, count in methods.items() for _ in range(count)]
    pairs = tuple(
        Pair(f"p{i:04d}", f"home-{i}", "v0", method, "right" if i % 2 else "left")
        for i, method in enumerate(names)
    )
    return Key("pairs", 1, page, 3, "test", 3.0, 5.0, {}, pairs)


def answers_to(key: Key, choose: Callable[[int, Pair], str | None], session: int = 1) -> Any:
    """An answer file's content; `choose` says truth, method or None for every pair."""
    other = {"left": "right", "right": "left"}
    answers = []
    for index, pair in enumerate(key.pairs):
        choice = choose(index, pair)
        side = {"truth": pair.truth, "method": other[pair.truth], None: None}[choice]
        answers.append(plain(Answer(pair.pair, side, 1200 + index, side is None)))  # type: ignore[arg-type]
    return {
        "study": "pairs",
        "version": 1,
        "page": key.page,
        "seed": key.seed,
        "session": f"{session:032x}",
        "answers": answers,
    }


def write(path: Path, content: Any) -> Path:
    """As JSON; returns the path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content if isinstance(content, dict) else plain(content)))
    return path


def without(key: Key, count: int) -> Key:
    """The same without the last pairs."""
    return replace(key, pairs=key.pairs[:-count])
