"""Trained networks on disk: weights in `NAME.safetensors` and a model card in `NAME.json`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import nn

from model.data.encoding import Policy
from model.methods import build_network
from model.networks.pbrnet import Architecture, channels_last
from scenes.checked import build, plain
from scenes.errors import InputError
from scenes.files import atomic_file, digest_file, read_json, write_json


@dataclass(frozen=True)
class TrainingData:
    """Training data of a network."""

    fingerprint: str  # SHA-256 over the bytes of the training shards
    views: int
    scenes: tuple[str, ...]
    plans: tuple[str, ...]  # floor plans of the scenes; scenes with these must not be tested
    licences: tuple[str, ...]
    attributions: tuple[str, ...]


@dataclass(frozen=True)
class ModelCard:
    """Model card, `models/NAME.json`. It holds neither dates nor times, so it is reproducible."""

    name: str
    architecture: Architecture
    parameters: int
    sha256: str  # of the weights
    exposure: Policy  # exposure policy of the predicted colours
    white: float  # median white point of the training shadings, for views without truth
    tone: dict[str, float]  # key and burn of the tone mapping
    albedo: float  # reflectance of every surface in the shading frames
    training: dict[str, Any]
    data: TrainingData
    backbone: dict[str, Any]  # network, source and sha256 of the loss's feature extractor
    metrics: dict[str, float | None]
    needs: dict[str, str]  # networks whose output it takes: name -> sha256
    versions: dict[str, str]
    licence: str
    precision: str = "float32"  # of the stored weights
    packed_from: str = ""  # sha256 of the original weights, for weights in half precision


def save_model(models: Path, network: nn.Module, card: dict[str, Any]) -> ModelCard:
    """Write the weights, then the card with their digest; each by rename."""
    name = card["name"]
    path = models / f"{name}.safetensors"
    state = {key: value.detach().cpu().contiguous() for key, value in network.state_dict().items()}
    with atomic_file(path) as partial:
        save_file(state, partial)
    complete = ModelCard(
        parameters=sum(value.numel() for value in state.values()), sha256=digest_file(path), **card
    )
    write_json(models / f"{name}.json", plain(complete))
    return complete


def load_model(path: Path) -> tuple[nn.Module, ModelCard]:
    """Load the network of a `.safetensors` file and its card, in evaluation mode.

    Raises `InputError` if either file is missing or damaged, or if they do not belong together.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such model; make it with: pbrnet train {path.stem}")
    card = build(
        ModelCard, read_json(path.with_suffix(".json")), str(path.with_suffix(".json")), InputError
    )
    if digest_file(path) != card.sha256:
        raise InputError(f"{path}: damaged, or not the weights described in {path.stem}.json")
    network = build_network(card.architecture)
    try:
        network.load_state_dict(load_file(path))
    except (SafetensorError, RuntimeError) as error:
        raise InputError(f"{path}: does not match its card ({error})") from None
    return channels_last(network.eval().requires_grad_(False)), card
