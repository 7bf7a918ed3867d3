"""Training of a network of the registry, from the dataset to a stored model.

The paper's networks are trained in two stages (section III-B): first the shading network, then the
composition network on the predictions of the fixed shading network. On one machine a resumed run is
bit-identical to an uninterrupted one (`model/training/loop.py`).
"""

from __future__ import annotations

import csv
import io
import math
import os
import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from statistics import median
from typing import Any, TypeVar

import torch
from torch import nn

from pbrnet.model.data.encoding import input_named
from pbrnet.model.data.reader import NOISY_SPP, Dataset, Example
from pbrnet.model.methods import METHODS, Method
from pbrnet.model.networks.build import build_network, revision_of
from pbrnet.model.networks.objective import Objective, Setting
from pbrnet.model.networks.pbrnet import Architecture
from pbrnet.model.settings import StageTrainParams, TrainParams
from pbrnet.model.training.backbone import Backbone, load_backbone
from pbrnet.model.training.checkpoint import Checkpoint, CurvePoint
from pbrnet.model.training.loop import Run, step_format, train_steps
from pbrnet.model.training.loss import PerceptualLoss
from pbrnet.model.training.store import ModelCard, TrainingData, load_model, save_model
from pbrnet.pipeline.farm.versions import PACKED
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.tonemap import ToneParams
from pbrnet.scenes.checked import plain
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import digest_bytes, digest_file, write_json, write_text
from pbrnet.scenes.seeds import derive32

M = TypeVar("M", bound=nn.Module)

VALIDATION_VIEWS = 32  # maximum number of views for the validation loss
LICENCE = "MIT"


@dataclass(frozen=True)
class Folders:
    """Folders that training reads and writes."""

    data: Path = Path("data")
    models: Path = Path("models")
    metrics: Path = Path("metrics")
    plots: Path = Path("plots")
    backbone: Path = Path("models")

    @staticmethod
    def beside(data: Path, models: Path, backbone: Path | None = None) -> Folders:
        """Folders with metrics and plots inside `models`, unless that is the default folder.

        Those of the pretrained networks are in `metrics/pretrained` and `plots/pretrained`. The
        backbone is in `models`, too, unless it is elsewhere.
        """
        backbone = backbone or models
        if models == Path("models"):
            return Folders(data=data, backbone=backbone)
        if models.resolve() == PACKED.resolve():  # nothing is written beside pretrained networks
            own = Path("metrics/pretrained"), Path("plots/pretrained")
            return Folders(data, models, *own, backbone)
        return Folders(data, models, models / "metrics", models / "plots", backbone)


def train_network(
    name: str,
    params: Params,
    folders: Folders,
    start: Path | None = None,
    only: Collection[str] | None = None,
) -> ModelCard:
    """Train the method `name` of the registry; write its model, card, metrics and learning curve.

    `start`: a model file of the same architecture whose weights are the initial ones (fine-tuning).
    `only`: the scenes of the training split to use, all if None.
    Raises `TrainingError` with view and step if the loss is not finite, and `InputError` for a
    dataset, backbone or model that cannot be used.
    """
    torch.set_num_threads(len(os.sched_getaffinity(0)))
    method = METHODS[name]
    stage: StageTrainParams = getattr(params.train, name)
    dataset = Dataset(folders.data / "dataset", "train", method.columns, only)
    backbone = load_backbone(folders.backbone)
    shading, needs = _fixed_shading(method, params.train, params.tone, folders)
    device = choose_device(params.train)
    precision = choose_precision(params.train, device)
    architecture = _architecture(method, stage, params.train)
    network = _initial(name, architecture, params.seed, start)
    data = _training_data(dataset, start)
    started_from = digest_file(start) if start else None

    steps_per_epoch = stage.steps_per_epoch or math.ceil(len(dataset) / params.train.batch)
    steps = stage.epochs * steps_per_epoch
    settings = _settings(params.train, method)
    identity = _identity(
        *(name, params.seed, settings, plain(params.tone), plain(architecture), data.fingerprint),
        *(plain(backbone.card), needs, started_from or "", steps, steps_per_epoch, precision),
    )
    setting = Setting(
        _placed(network, device),
        PerceptualLoss(_placed(backbone, device), params.train.loss),
        shading if shading is None else _placed(shading, device),
        architecture.width,
        _autocast(device, precision),
    )
    seed = derive32(params.seed, "initial", name, "opponents")
    objective = _objective(method, setting, seed, device)
    run = Run(name, method, params.train, params.seed, objective, device, steps, steps_per_epoch)
    checkpoint = Checkpoint(folders.models / "checkpoints" / f"{name}.pt", identity)
    validation = _validation_views(folders.data / "dataset", method.columns)
    curve, seconds = _train(run, checkpoint, dataset, validation)

    facts = {
        **_facts(name, dataset, backbone, data),
        "exposure": params.train.exposure,
        "tone": plain(params.tone),
        "albedo": params.shading.albedo,
        "architecture": architecture,
        "training": {
            **settings,
            **plain(stage),
            **_input_facts(method, dataset),
            "seed": params.seed,
            "steps": steps,
            "precision": precision,
            "started_from": started_from,
        },
        "metrics": _losses(curve),
        "needs": needs,
    }
    card = save_model(folders.models, network, facts)
    _write_curve(folders.plots / f"train_{name}.csv", curve)
    _write_metrics(folders.metrics / f"train_{name}.json", card, seconds)
    checkpoint.path.unlink(missing_ok=True)
    return card


def _architecture(method: Method, stage: StageTrainParams, params: TrainParams) -> Architecture:
    return Architecture(
        method.kind,
        stage.width,
        stage.levels,
        params.panorama,
        params.exposure,
        revision_of(method.kind),
    )


def _train(
    run: Run, checkpoint: Checkpoint, dataset: Dataset, validation: Sequence[Example]
) -> tuple[list[CurvePoint], float | None]:
    """Train from the last checkpoint; return the learning curve and seconds a step, if any."""
    state = checkpoint.resume(run.objective, run.optimisers)
    began, first = time.monotonic(), state.step
    train_steps(run, state, checkpoint, dataset, validation)
    done = run.steps - first
    return state.curve, round((time.monotonic() - began) / done, 4) if done > 0 else None


def _input_facts(method: Method, dataset: Dataset) -> dict[str, Any]:
    """Facts about the network's inputs beyond those of the paper, for the model card."""
    facts: dict[str, Any] = {}
    if method.takes_samples:
        samples = dataset.column(NOISY_SPP)
        facts["noisy_spp"] = int(median(samples))
        facts["noisy_range"] = [min(samples), max(samples)]
    for name in method.optional_inputs:
        facts[name] = set(input_named(name).columns) <= set(dataset.images)
    return facts


def _losses(curve: Sequence[CurvePoint]) -> dict[str, float | None]:
    """Final losses of the learning curve."""
    return {"train_loss": curve[-1].train_loss, "validation_loss": curve[-1].validation_loss}


def choose_device(params: TrainParams) -> torch.device:
    """Device of `params.device`; `auto` is CUDA if available, else the CPU.

    Raises `InputError` if CUDA is required and not available.
    """
    if params.device == "cuda" and not torch.cuda.is_available():
        raise InputError("train.device is cuda, but torch finds no CUDA device; use auto or cpu")
    if params.device == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    return torch.device(params.device)


def choose_precision(params: TrainParams, device: torch.device) -> str:
    """Precision of `params.precision`; `auto` is bfloat16 if the device supports it natively.

    The choice follows from capability flags, not from a timing, so one machine always chooses
    alike.
    """
    if params.precision != "auto":
        return params.precision
    if device.type == "cuda":
        return "bfloat16" if torch.cuda.is_bf16_supported(including_emulation=False) else "float32"
    flags = torch.cpu.get_capabilities()
    native = any(flags.get(name) for name in ("avx512_bf16", "amx_bf16", "bf16"))
    return "bfloat16" if native else "float32"


def _initial(name: str, architecture: Architecture, seed: int, start: Path | None) -> nn.Module:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(derive32(seed, "initial", architecture.kind))
        network = build_network(architecture)
    if start is None:
        return network
    earlier, card = load_model(start)
    if card.architecture != architecture:
        raise InputError(
            f"{start}: has the architecture {plain(card.architecture)}, but the parameters give "
            f"{plain(architecture)}; change train.{name} to match"
        )
    network.load_state_dict(earlier.state_dict())
    return network


def _objective(method: Method, setting: Setting, seed: int, device: torch.device) -> Objective:
    """Objective of the method on the device; `seed` initialises its discriminators."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        objective = method.objective(setting)
    for module in objective.modules.values():
        _placed(module, device)
    return objective


def _placed(module: M, device: torch.device) -> M:
    """The same module on the device, its weights in the memory format of a training step."""
    return module.to(device, memory_format=step_format(device))  # type: ignore[call-overload,no-any-return]


def _autocast(device: torch.device, precision: str) -> Callable[[], torch.autocast]:
    half = precision == "bfloat16"
    return lambda: torch.autocast(device.type, torch.bfloat16, enabled=half)


def _fixed_shading(
    method: Method, params: TrainParams, tone: ToneParams, folders: Folders
) -> tuple[nn.Module | None, dict[str, str]]:
    """Fixed shading network that the method takes as input, and its digest by name; or None.

    Raises `InputError` if it was trained with another tone mapping, exposure or panorama.
    """
    if not method.uses_shading_net:
        return None, {}
    network, card = load_model(folders.models / "shading.safetensors")
    for what, trained, wanted in (
        ("tone mapping", card.tone, plain(tone)),
        ("exposure", card.exposure, params.exposure),
        ("panorama", card.architecture.panorama, params.panorama),
    ):
        if trained != wanted:
            raise InputError(
                f"{folders.models}/shading.json: trained with the {what} {trained}, but the "
                f"parameters give {wanted}; train the shading network again"
            )
    return network, {"shading": card.sha256}


def _validation_views(folder: Path, columns: Sequence[str]) -> list[Example]:
    try:
        dataset = Dataset(folder, "validation", columns)
    except InputError:
        if list(folder.glob("validation-*.parquet")):
            raise
        return []
    return [example for _, example in zip(range(VALIDATION_VIEWS), dataset.ordered(), strict=False)]


def _training_data(dataset: Dataset, start: Path | None) -> TrainingData:
    """Data of the training, with scenes and credits of what the network at `start` had seen."""
    scenes = set(dataset.column("scene_id"))
    plans = dataset.plans()
    found = {
        "scenes": scenes,
        "plans": {plans.get(scene, scene) for scene in scenes},
        "licences": set(dataset.column("licence")),
        "attributions": set(dataset.column("attribution")),
    }
    if start is not None:
        earlier = load_model(start)[1].data
        found = {name: seen | set(getattr(earlier, name)) for name, seen in found.items()}
    return TrainingData(
        fingerprint=dataset.fingerprint(),
        views=len(dataset),
        **{name: tuple(sorted(seen)) for name, seen in found.items()},
    )


def _identity(*parts: object) -> str:
    """Digest of everything that determines the weights; checkpoints of other runs are ignored."""
    return digest_bytes(*(repr(part).encode() for part in parts))


def _settings(params: TrainParams, method: Method) -> dict[str, Any]:
    """Parameters that determine the weights; the method's own replace the shared ones."""
    excluded = ("checkpoint_steps", "device", "baselines", *METHODS)
    settings = {name: value for name, value in plain(params).items() if name not in excluded}
    if method.own_loss:
        settings["loss"] = method.own_loss
    if method.adam is not None:
        settings |= {
            "learning_rate": method.adam.rate,
            "decay": method.adam.decay,
            "betas": plain(method.adam.betas),
        }
    return settings


def _facts(name: str, dataset: Dataset, backbone: Backbone, data: TrainingData) -> dict[str, Any]:
    """Fields of the model card that are known before training."""
    loss = backbone.card
    return {
        "name": name,
        "white": float(median(float(white) for white in dataset.column("white_shading"))),
        "data": data,
        "backbone": {"network": loss.network, "source": loss.source, "sha256": loss.sha256},
        "versions": {"pbrnet": version("pbrnet"), "torch": torch.__version__},
        "licence": LICENCE,
    }


def _write_curve(path: Path, curve: Sequence[CurvePoint]) -> None:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("step", "epoch", "train_loss", "validation_loss"))
    for point in curve:
        validation = "" if point.validation_loss is None else f"{point.validation_loss:.6g}"
        writer.writerow((point.step, point.epoch, f"{point.train_loss:.6g}", validation))
    write_text(path, text.getvalue())


def _write_metrics(path: Path, card: ModelCard, seconds_per_step: float | None) -> None:
    write_json(
        path,
        {
            **card.metrics,
            "steps": card.training["steps"],
            "epochs": card.training["epochs"],
            "views": card.data.views,
            "parameters": card.parameters,
            "seconds_per_step": seconds_per_step,
            "backbone": card.backbone["network"],
            "precision": card.training["precision"],
            "exposure": card.exposure,
        },
    )
