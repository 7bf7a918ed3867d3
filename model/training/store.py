"""Trained networks on disk: weights in `NAME.safetensors` and a model card in `NAME.json`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import load_file
from torch import nn

from pbrnet.model.data.encoding import Policy
from pbrnet.model.networks.build import build_network, is_current
from pbrnet.model.networks.pbrnet import Architecture, channels_last
from pbrnet.model.training.weights import write_weights
from pbrnet.pipeline.passes.settings import NoisyParams
from pbrnet.pipeline.tonemap import ToneParams
from pbrnet.scenes.checked import build, plain, shown
from pbrnet.scenes.errors import InputError, ParameterError
from pbrnet.scenes.files import digest_file, read_json, regular_file, write_json


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

    def verify(self, where: str) -> None:
        """Check the values that predictions depend on; raises ValueError."""
        if self.white <= 0 or not 0 < self.albedo <= 1:
            raise ValueError(f"{where}: white must be above 0, and albedo above 0 and at most 1")
        try:
            build(ToneParams, self.tone, f"{where}: tone")
            samples = {"spp": self.training.get("noisy_spp", 0)}
            build(NoisyParams, samples, f"{where}: training.noisy_spp")
        except ParameterError as error:
            raise ValueError(str(error)) from None


def save_model(models: Path, network: nn.Module, card: dict[str, Any]) -> ModelCard:
    """Write the weights, then the card with their digest; each by rename."""
    name = card["name"]
    path = models / f"{name}.safetensors"
    state = {key: value.detach().cpu().contiguous() for key, value in network.state_dict().items()}
    write_weights(path, state)
    complete = ModelCard(
        parameters=sum(value.numel() for value in state.values()), sha256=digest_file(path), **card
    )
    write_json(models / f"{name}.json", plain(complete))
    return complete


def _fitting_network(path: Path, architecture: Architecture) -> nn.Module:
    """Build the network of an architecture if its weights have the names and shapes of a file's.

    They are compared before memory is allocated, because a card may ask for any size. Raises
    `InputError`.
    """
    try:
        with torch.device("meta"):
            planned = build_network(architecture).state_dict()
        with safe_open(str(regular_file(path)), framework="pt") as file:
            names = list(file.keys())
            stored = {name: tuple(file.get_slice(name).get_shape()) for name in names}
    except (SafetensorError, RuntimeError, ValueError, OSError) as error:
        raise InputError(f"{path}: does not match its card ({_words(error)})") from None
    wanted = {name: tuple(value.shape) for name, value in planned.items()}
    for name in sorted({*stored, *wanted}):
        if stored.get(name) != wanted.get(name):
            raise InputError(
                f"{path}: does not match its card: {shown(name)} is "
                f"{stored.get(name, 'missing')} in the file and "
                f"{wanted.get(name, 'unknown')} in the network"
            )
    return build_network(architecture)


def _words(error: Exception) -> str:
    return " ".join(str(error).split())[:300]


def load_model(path: Path) -> tuple[nn.Module, ModelCard]:
    """Load the network of a `.safetensors` file and its card, in evaluation mode.

    Raises `InputError` if either file is missing or damaged, if they do not belong together, or if
    the weights are of an earlier form of the network.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such model; make it with: pbrnet train {path.stem}")
    card = build(
        ModelCard, read_json(path.with_suffix(".json")), str(path.with_suffix(".json")), InputError
    )
    if digest_file(path) != card.sha256:
        raise InputError(f"{path}: damaged, or not the weights described in {path.stem}.json")
    if not is_current(card.architecture):
        kind = card.architecture.kind
        raise InputError(
            f"{path}: weights of an earlier form of {kind}, which has been built anew; train it "
            f"again with: pbrnet train {kind}"
        )
    network = _fitting_network(path, card.architecture)
    try:
        state = load_file(path)
        network.load_state_dict(state)
    except (SafetensorError, RuntimeError, OSError) as error:
        raise InputError(f"{path}: does not match its card ({_words(error)})") from None
    if not all(torch.isfinite(value).all() for value in state.values()):
        raise InputError(f"{path}: the weights contain NaN or infinity; train the network again")
    return channels_last(network.eval().requires_grad_(False)), card
