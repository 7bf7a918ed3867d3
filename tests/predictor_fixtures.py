"""Networks nobody has trained, as sensitive as trained ones, and views for them."""

from __future__ import annotations

from pathlib import Path

import torch
from torch import nn

from model.data.encoding import Policy
from model.methods import METHODS, build_network
from model.networks.pbrnet import Architecture, Panorama
from model.training.store import TrainingData, save_model
from pipeline.params import ToneParams
from scenes.checked import plain


def untrained_models(
    models: Path,
    names: tuple[str, ...] = ("shading", "composition"),
    *,
    panorama: Panorama = "normal",
    levels: int = 4,
    width: int = 8,
    exposure: Policy = "shared",
    shadows: bool = False,
    seed: int = 0,
) -> Path:
    """Models of these names; the composition network fits the shading network. Returns `models`."""
    torch.manual_seed(seed)
    digests: dict[str, str] = {}
    data = TrainingData(
        "ab" * 32, 3, ("train-a",), ("plan-a",), ("CC0-1.0", "CC-BY-4.0"), ("a room by a test",)
    )
    for name in names:
        architecture = Architecture(METHODS[name].layout, width, levels, panorama, exposure)
        network = build_network(architecture)
        for layer in network.modules():
            if isinstance(layer, nn.Conv2d) and layer.out_channels == 3:
                nn.init.normal_(layer.weight, std=0.15)  # so that what lies below it shows
        card = save_model(
            models,
            network,
            {
                "name": name,
                "architecture": architecture,
                "exposure": exposure,
                "white": 4.0,
                "tone": plain(ToneParams()),
                "albedo": 0.5,
                "training": {
                    "epochs": 0,
                    "shadows": shadows,
                    "noisy_spp": 2 if name == "hybrid" else 0,
                },
                "data": data,
                "backbone": {"network": "none", "source": "nowhere"},
                "metrics": {"validation_loss": None},
                "needs": {"shading": digests["shading"]} if name == "composition" else {},
                "versions": {},
                "licence": "MIT",
            },
        )
        digests[name] = card.sha256
    return models
