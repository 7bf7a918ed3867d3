"""Training: one loop for every network of the registry, two stages for ours.

The shading network first; then, fixed, it feeds the composition network (paper, section III-B).
On one machine a run that was killed and started again ends with the same bits as one that was
not: data order, mirroring and learning rate are functions of the step, and a checkpoint holds the
rest.
"""

from __future__ import annotations

import csv
import io
import math
import os
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from statistics import median
from typing import Any

import torch
from torch import nn

from model.backbone import Backbone, load_backbone
from model.data import Dataset, Example, coin_flips, mirrored
from model.encoding import encode, radiances, targets
from model.loss import PerceptualLoss
from model.methods import METHODS, Method, build_network
from model.networks import Architecture, channels_last
from model.objective import Batch, Objective, Setting
from model.store import ModelCard, TrainingData, load_model, save_model
from pipeline.params import Params, StageTrainParams, TrainParams
from pipeline.progress import Progress
from scenes.checked import plain
from scenes.errors import InputError, PbrnetError
from scenes.files import atomic_file, digest_bytes, digest_file, write_json, write_text
from scenes.seeds import derive, derive32

VALIDATION_VIEWS = 32  # at most so many are looked at after each epoch
LICENCE = "MIT"


class TrainingError(PbrnetError):
    """The training went astray."""


@dataclass(frozen=True)
class Folders:
    """Where training reads and writes."""

    data: Path = Path("data")
    models: Path = Path("models")
    metrics: Path = Path("metrics")
    plots: Path = Path("plots")
    backbone: Path = Path("models")

    @staticmethod
    def beside(data: Path, models: Path, backbone: Path) -> Folders:
        """Metrics and plots in their usual places, or inside `models` if that is another folder."""
        if models == Path("models"):
            return Folders(data=data, backbone=backbone)
        return Folders(data, models, models / "metrics", models / "plots", backbone)


@dataclass(frozen=True)
class CurvePoint:
    """A row of `plots/train_NAME.csv`."""

    step: int
    epoch: int
    train_loss: float
    validation_loss: float | None


@dataclass
class State:
    """What a checkpoint holds beside the objective and Adam's moments."""

    step: int = 0
    loss_sum: float = 0.0  # over the steps of this epoch
    curve: list[CurvePoint] = field(default_factory=list)


def train_network(
    name: str,
    params: Params,
    folders: Folders,
    start: Path | None = None,
    only: Collection[str] | None = None,
) -> ModelCard:
    """Train the method `name` of the registry; write its model, card, metrics and learning curve.

    `start`: a model file of the same architecture to go on from (fine-tuning). `only`: the scenes
    of the training split to learn from, all of them if None.
    Raises `TrainingError` that names view and step if the loss stops being a number,
    `InputError` for a dataset, backbone or model that cannot be used.
    """
    torch.set_num_threads(len(os.sched_getaffinity(0)))
    method = METHODS[name]
    stage: StageTrainParams = getattr(params.train, name)
    architecture = Architecture(
        method.layout, stage.width, stage.levels, params.train.panorama, params.train.exposure
    )
    dataset = Dataset(folders.data / "dataset", "train", method.noisy, only)
    backbone = load_backbone(folders.backbone)
    channels_last(backbone)
    shading, needs = _fixed_shading(method, params, folders)
    device = choose_device(params.train)
    precision = choose_precision(params.train, device)

    network = _initial(name, architecture, params.seed, start)
    steps_per_epoch = stage.steps_per_epoch or math.ceil(len(dataset) / params.train.batch)
    steps = stage.epochs * steps_per_epoch
    data = _seen(dataset)
    settings = _settings(params.train, method)
    identity = _identity(
        *(name, params.seed, settings, plain(params.tone), plain(architecture), data.fingerprint),
        *(plain(backbone.card), needs, digest_file(start) if start else "", steps, precision),
    )

    objective = _objective(
        method,
        Setting(
            channels_last(network.to(device)),
            PerceptualLoss(backbone.to(device), params.train.loss),
            shading if shading is None else shading.to(device),
            architecture.width,
            _autocast(device, precision),
        ),
        derive32(params.seed, "initial", name, "opponents"),
        device,
    )
    run = Run(name, method, params, objective, device, steps, steps_per_epoch)
    checkpoint = Checkpoint(folders.models / "checkpoints" / f"{name}.pt", identity)
    state = checkpoint.resume(run)
    began, first = time.monotonic(), state.step
    validation = _validation_views(folders.data / "dataset", method.noisy)
    _train(run, state, checkpoint, dataset, validation)
    seconds = (time.monotonic() - began) / max(1, steps - first)

    last = state.curve[-1]
    results = {"train_loss": last.train_loss, "validation_loss": last.validation_loss}
    whites = [float(white) for white in dataset.column("white_shading")]
    card = save_model(
        folders.models,
        network,
        {
            "name": name,
            "architecture": architecture,
            "exposure": params.train.exposure,
            "white": float(median(whites)),
            "tone": plain(params.tone),
            "albedo": params.shading.albedo,
            "training": {
                **settings,
                **plain(stage),
                "seed": params.seed,
                "steps": steps,
                "precision": precision,
                **({"noisy_spp": _noisy_spp(dataset)} if method.noisy else {}),
                "started_from": digest_file(start) if start else None,
            },
            "data": data,
            "backbone": _backbone_words(backbone),
            "metrics": results,
            "needs": needs,
            "versions": {"pbrnet": version("pbrnet"), "torch": torch.__version__},
            "licence": LICENCE,
        },
    )
    _write_curve(folders.plots / f"train_{name}.csv", state.curve)
    write_json(
        folders.metrics / f"train_{name}.json",
        {
            **results,
            "steps": steps,
            "epochs": stage.epochs,
            "views": len(dataset),
            "parameters": card.parameters,
            "seconds_per_step": round(seconds, 4) if steps > first else None,
            "backbone": backbone.card.network,
            "precision": precision,
            "exposure": params.train.exposure,
        },
    )
    checkpoint.path.unlink(missing_ok=True)
    return card


class Run:
    """One training: the objective, an optimiser for each of its players, and how to feed it."""

    def __init__(
        self,
        name: str,
        method: Method,
        params: Params,
        objective: Objective,
        device: torch.device,
        steps: int,
        steps_per_epoch: int,
    ) -> None:
        self.name, self.method, self.params = name, method, params
        self.objective, self.device = objective, device
        self.steps, self.steps_per_epoch = steps, steps_per_epoch
        self.optimisers = {
            player: torch.optim.Adam(
                module.parameters(),
                lr=params.train.learning_rate,
                betas=method.adam.betas if method.adam else (0.9, 0.999),
                fused=True,
            )
            for player, module in objective.players.items()
        }

    def batch(self, examples: Sequence[Example]) -> Batch:
        """The views as tensors on the device."""
        truth = {
            name: self._put(value)
            for name, value in targets(examples, self.params.train.exposure).items()
        }
        given = encode(examples, self.method.direct, self.method.noisy)
        inputs = {name: self._put(value) for name, value in given.items()}
        radiance = None
        if self.method.noisy:
            linear = radiances(examples, self.params.train.exposure)
            radiance = {name: self._put(value) for name, value in linear.items()}
        return Batch(inputs, truth[self.method.target], truth["shading"], radiance)

    def begin_step(self, step: int) -> None:
        """Learning rates and random draws (dropout, histories) are functions of the step."""
        torch.manual_seed(derive32(self.params.seed, "step", self.name, step))
        for optimiser in self.optimisers.values():
            for group in optimiser.param_groups:
                group["lr"] = self.method.rate(self.params.train, step, self.steps)

    def validate(self, views: Sequence[Example]) -> float | None:
        """Mean loss of the network on these views, without dropout; none without views."""
        if not views:
            return None
        self._set_mode(training=False)
        with torch.no_grad():
            losses = [float(self.objective.loss(self.batch([view]))) for view in views]
        self._set_mode(training=True)
        return sum(losses) / len(losses)

    def _set_mode(self, training: bool) -> None:
        for module in self.objective.players.values():
            module.train(training)

    def _put(self, value: torch.Tensor) -> torch.Tensor:
        return value.to(self.device, memory_format=torch.channels_last)


def _train(
    run: Run,
    state: State,
    checkpoint: Checkpoint,
    dataset: Dataset,
    validation: Sequence[Example],
) -> None:
    """The loop: from the state's step to the last, players in turn within a step."""
    name, epochs = run.name, run.steps // run.steps_per_epoch
    batches = _batches(dataset, run.params, state.step)
    whole = True  # whether all players have made equally many steps
    with torch.random.fork_rng(), Progress(run.steps, f"train {name}", "steps") as progress:
        progress.advance(state.step)
        try:
            while state.step < run.steps:
                examples = next(batches)
                run.begin_step(state.step)
                for player, value in run.objective.losses(run.batch(examples)):
                    _stop_if_diverged(value, name, state.step, examples)
                    optimiser = run.optimisers[player]
                    optimiser.zero_grad(set_to_none=True)
                    value.backward()  # type: ignore[no-untyped-call]
                    whole = False
                    optimiser.step()
                    if player == "network":
                        state.loss_sum += float(value.detach())
                state.step += 1
                whole = True
                if state.step % run.steps_per_epoch == 0:
                    point = _close_epoch(state, run, validation)
                    progress.write(_sentence(name, point, epochs))
                if state.step % run.params.train.checkpoint_steps == 0 and state.step < run.steps:
                    checkpoint.save(run, state)
                progress.advance()
        except KeyboardInterrupt:
            if whole:
                checkpoint.save(run, state)
            raise


def choose_device(params: TrainParams) -> torch.device:
    """The device that `params.device` means here; `auto` is CUDA where there is one."""
    if params.device == "cuda" and not torch.cuda.is_available():
        raise InputError("train.device is cuda, but torch sees no CUDA device; use auto or cpu")
    if params.device == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    return torch.device(params.device)


def choose_precision(params: TrainParams, device: torch.device) -> str:
    """`auto`: bfloat16 where the processor multiplies it natively, and so faster; else float32.

    Decided by capability flags, not by a stopwatch: the same machine always gives the same bits.
    """
    if params.precision != "auto":
        return params.precision
    if device.type == "cuda":
        return "bfloat16" if torch.cuda.is_bf16_supported() else "float32"
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
            f"{start}: is a {plain(card.architecture)}; the parameters ask for "
            f"{plain(architecture)}; make train.{name} equal to start from it"
        )
    network.load_state_dict(earlier.state_dict())
    return network


def _objective(method: Method, setting: Setting, seed: int, device: torch.device) -> Objective:
    """The method's objective on the device; opponents start from random weights of the seed."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        objective = method.objective(setting)
    for module in objective.players.values():
        channels_last(module.to(device))
    return objective


def _autocast(device: torch.device, precision: str) -> Callable[[], torch.autocast]:
    half = precision == "bfloat16"
    return lambda: torch.autocast(device.type, torch.bfloat16, enabled=half)


def _fixed_shading(
    method: Method, params: Params, folders: Folders
) -> tuple[nn.Module | None, dict[str, str]]:
    """The trained shading network whose predictions the composition network learns from."""
    if not method.fed:
        return None, {}
    network, card = load_model(folders.models / "shading.safetensors")
    if card.tone != plain(params.tone):
        raise InputError(
            f"{folders.models}/shading.json: trained with the tone mapping {card.tone}, now it is "
            f"{plain(params.tone)}; train the shading network again"
        )
    return network, {"shading": card.sha256}


def _validation_views(folder: Path, noisy: bool) -> list[Example]:
    try:
        dataset = Dataset(folder, "validation", noisy)
    except InputError:
        if list(folder.glob("validation-*.parquet")):
            raise
        return []
    return [example for _, example in zip(range(VALIDATION_VIEWS), dataset.ordered(), strict=False)]


def _noisy_spp(dataset: Dataset) -> int:
    """Samples a pixel of the noisy images: as many as the network should be given in use."""
    return int(median(dataset.column("noisy_spp")))


def _seen(dataset: Dataset) -> TrainingData:
    scenes = sorted(set(dataset.column("scene_id")))
    plans = dataset.plans()
    return TrainingData(
        fingerprint=dataset.fingerprint(),
        views=len(dataset),
        scenes=tuple(scenes),
        plans=tuple(sorted({plans.get(scene, scene) for scene in scenes})),
        licences=tuple(sorted(set(dataset.column("licence")))),
        attributions=tuple(sorted(set(dataset.column("attribution")))),
    )


def _identity(*parts: object) -> str:
    """All that determines the weights: a checkpoint of another identity is not gone on from."""
    return digest_bytes(*(repr(part).encode() for part in parts))


def _settings(params: TrainParams, method: Method) -> dict[str, Any]:
    """What networks share of the parameters that determine the weights, or the method's own."""
    others = ("checkpoint_steps", "device", "baselines", *METHODS)
    settings = {name: value for name, value in plain(params).items() if name not in others}
    if method.adam is not None:
        own = {"learning_rate": method.adam.rate, "decay": method.adam.decay, "loss": method.own}
        settings |= {**own, "betas": plain(method.adam.betas)}
    return settings


def _batches(dataset: Dataset, params: Params, step: int) -> Iterator[list[Example]]:
    """Endless batches from `step` on; the same ones whether or not training stopped between."""
    batch, seed = params.train.batch, derive(params.seed, "train")
    position = step * batch
    views = dataset.shuffled(seed, start=position)
    flips = coin_flips(seed, position, len(dataset))
    while True:
        examples = [
            mirrored(example) if params.train.flips and flip else example
            for _, example, flip in zip(range(batch), views, flips, strict=False)
        ]
        _same_size(examples)
        yield examples


def _same_size(examples: Sequence[Example]) -> None:
    sizes = {(example.depth.shape, example.intensity.shape) for example in examples}
    if len(sizes) > 1:
        raise InputError(
            f"views of different sizes in one batch ({examples[0].name} and others); "
            "set train.batch: 1, or render all scenes at one size"
        )


def _stop_if_diverged(
    value: torch.Tensor, name: str, step: int, examples: Sequence[Example]
) -> None:
    if not torch.isfinite(value):
        views = ", ".join(example.name for example in examples)
        raise TrainingError(
            f"train {name}: the loss became {value.item()} at step {step} on view {views}; "
            "look at the view with pbrnet inspect, or lower train.learning_rate"
        )


def _close_epoch(state: State, run: Run, validation: Sequence[Example]) -> CurvePoint:
    point = CurvePoint(
        step=state.step,
        epoch=state.step // run.steps_per_epoch,
        train_loss=state.loss_sum / run.steps_per_epoch,
        validation_loss=run.validate(validation),
    )
    state.loss_sum = 0.0
    state.curve.append(point)
    return point


def _sentence(name: str, point: CurvePoint, epochs: int) -> str:
    seen = "none" if point.validation_loss is None else f"{point.validation_loss:.2f}"
    return (
        f"train {name}: epoch {point.epoch} of {epochs}, "
        f"loss {point.train_loss:.2f}, validation {seen}"
    )


@dataclass(frozen=True)
class Checkpoint:
    """The file that a training goes on from after it was stopped."""

    path: Path
    identity: str  # of the training; what another one left is not gone on from

    def save(self, run: Run, state: State) -> None:
        """Write all that the next step depends on, by rename."""
        content = {
            "identity": self.identity,
            "players": {name: p.state_dict() for name, p in run.objective.players.items()},
            "optimisers": {name: o.state_dict() for name, o in run.optimisers.items()},
            "memory": run.objective.memory(),
            "step": state.step,
            "loss_sum": state.loss_sum,
            "curve": [plain(point) for point in state.curve],
        }
        with atomic_file(self.path) as partial:
            torch.save(content, partial)

    def resume(self, run: Run) -> State:
        """Go on from the checkpoint if it is of this very training, else from the start."""
        if not self.path.is_file():
            return State()
        try:
            content: dict[str, Any] = torch.load(self.path, map_location="cpu", weights_only=True)
            if content["identity"] != self.identity:
                return State()
            for name, player in run.objective.players.items():
                player.load_state_dict(content["players"][name])
                run.optimisers[name].load_state_dict(content["optimisers"][name])
            run.objective.remember(content["memory"])
        except Exception as error:
            raise InputError(
                f"{self.path}: damaged checkpoint ({type(error).__name__}); delete it to start over"
            ) from None
        return State(
            step=content["step"],
            loss_sum=content["loss_sum"],
            curve=[CurvePoint(**point) for point in content["curve"]],
        )


def _backbone_words(backbone: Backbone) -> dict[str, Any]:
    card = backbone.card
    return {"network": card.network, "source": card.source, "sha256": card.sha256}


def _write_curve(path: Path, curve: Sequence[CurvePoint]) -> None:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("step", "epoch", "train_loss", "validation_loss"))
    for point in curve:
        seen = "" if point.validation_loss is None else f"{point.validation_loss:.6g}"
        writer.writerow((point.step, point.epoch, f"{point.train_loss:.6g}", seen))
    write_text(path, text.getvalue())
