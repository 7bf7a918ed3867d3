"""Training loop of all networks in the registry.

Data order, mirroring, random numbers and learning rate are functions of the step. A run that
resumes from a checkpoint is therefore bit-identical to an uninterrupted one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import torch

from pbrnet.model.data.encoding import encode, radiances, targets
from pbrnet.model.data.reader import Dataset, Example, coin_flips, mirrored
from pbrnet.model.methods import Method
from pbrnet.model.networks.objective import Batch, Objective
from pbrnet.model.settings import TrainParams, learning_rate
from pbrnet.model.training.checkpoint import Checkpoint, CurvePoint, Optimisers, State
from pbrnet.pipeline.progress import Progress
from pbrnet.scenes.errors import InputError, PbrnetError
from pbrnet.scenes.seeds import derive, derive32


class TrainingError(PbrnetError):
    """A training loss is not finite."""


def step_format(device: torch.device) -> torch.memory_format:
    """Return the memory format in which a training step is fastest.

    Channels last, but where the processor's widest instructions are AVX2: gradients of convolutions
    take 1.6 times as long with it there.
    """
    narrow = device.type == "cpu" and torch.backends.cpu.get_cpu_capability() == "AVX2"
    return torch.contiguous_format if narrow else torch.channels_last


class Run:
    """Training run: an objective, an optimiser for each of its modules, and their settings."""

    def __init__(
        self,
        name: str,
        method: Method,
        params: TrainParams,
        seed: int,
        objective: Objective,
        device: torch.device,
        steps: int,
        steps_per_epoch: int,
    ) -> None:
        self.name, self.method, self.params = name, method, params
        self.seed = seed
        self.objective, self.device = objective, device
        self.steps, self.steps_per_epoch = steps, steps_per_epoch
        self.optimisers: Optimisers = {
            name: torch.optim.Adam(
                module.parameters(),
                lr=params.learning_rate,
                betas=method.adam.betas if method.adam else (0.9, 0.999),
                fused=True,
            )
            for name, module in objective.modules.items()
        }

    def batch(self, examples: Sequence[Example]) -> Batch:
        """Inputs and targets of views as tensors on the device."""
        truth = {
            name: self._put(value)
            for name, value in targets(examples, self.params.exposure).items()
        }
        encoded = encode(examples, self.method.inputs_with(self.params.panorama))
        inputs = {name: self._put(value) for name, value in encoded.items()}
        radiance = None
        if self.method.predicts_radiance:
            linear = radiances(examples, self.params.exposure)
            radiance = {name: self._put(value) for name, value in linear.items()}
        return Batch(inputs, truth[self.method.target], radiance)

    def begin_step(self, step: int) -> None:
        """Set the learning rates and seed torch's random state (dropout, image buffers)."""
        torch.manual_seed(derive32(self.seed, "step", self.name, step))
        usual = learning_rate(self.params, step, self.steps)
        for optimiser in self.optimisers.values():
            for group in optimiser.param_groups:
                group["lr"] = self.method.rate(usual, step, self.steps)

    def backward(self, module: str, loss: torch.Tensor) -> None:
        """Compute the gradients of a module's loss."""
        self.optimisers[module].zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]

    def validate(self, views: Sequence[Example]) -> float | None:
        """Mean validation loss of the network, without dropout; None if there are no views."""
        if not views:
            return None
        self._set_mode(training=False)
        with torch.no_grad():
            losses = [float(self.objective.loss(self.batch([view]))) for view in views]
        self._set_mode(training=True)
        return sum(losses) / len(losses)

    def _set_mode(self, training: bool) -> None:
        for module in self.objective.modules.values():
            module.train(training)

    def _put(self, value: torch.Tensor) -> torch.Tensor:
        return value.to(self.device, memory_format=step_format(self.device))


def train_steps(
    run: Run,
    state: State,
    checkpoint: Checkpoint,
    dataset: Dataset,
    validation: Sequence[Example],
) -> None:
    """Train from the state's step to the last one.

    A step updates the modules one after the other. The loop writes a checkpoint every
    `train.checkpoint_steps` steps, and on Ctrl-C between two steps, outside of validation. Raises
    `TrainingError` if a loss is not finite.
    """
    batches = batches_from(dataset, run.params, run.seed, state.step)
    every = run.params.checkpoint_steps
    whole = True  # False within a step: some modules are updated, or the epoch is not closed
    with torch.random.fork_rng(), Progress(run.steps, f"train {run.name}", "steps") as progress:
        progress.advance(state.step)
        try:
            while state.step < run.steps:
                examples = next(batches)
                run.begin_step(state.step)
                for updated, loss in run.objective.losses(run.batch(examples)):
                    _stop_if_diverged(loss, run.name, state.step, examples)
                    run.backward(updated, loss)
                    whole = False
                    run.optimisers[updated].step()
                    if updated == "network":
                        state.loss_sum += float(loss.detach())
                state.step += 1
                if state.step % run.steps_per_epoch == 0:
                    progress.write(_epoch_message(run, _close_epoch(state, run, validation)))
                whole = True
                if state.step % every == 0 and state.step < run.steps:
                    checkpoint.save(run.objective, run.optimisers, state)
                progress.advance()
        except KeyboardInterrupt:
            if whole:
                checkpoint.save(run.objective, run.optimisers, state)
            raise


def batches_from(
    dataset: Dataset, params: TrainParams, root_seed: int, step: int
) -> Iterator[list[Example]]:
    """Endless batches from `step` on, the same in a resumed and in an uninterrupted run.

    Raises `InputError` if the views of a batch differ in size.
    """
    batch, seed = params.batch, derive(root_seed, "train")
    position = step * batch
    views = dataset.shuffled(seed, start=position)
    flips = coin_flips(seed, position, len(dataset))
    while True:
        examples = [
            mirrored(example) if params.flips and flip else example
            for _, example, flip in zip(range(batch), views, flips, strict=False)
        ]
        _same_size(examples)
        yield examples


def _same_size(examples: Sequence[Example]) -> None:
    sizes = {(example["depth"].shape, example["intensity"].shape) for example in examples}
    if len(sizes) > 1:
        raise InputError(
            f"the views of one batch differ in size ({examples[0].name} and others); "
            "set train.batch: 1, or render all scenes at one size"
        )


def _stop_if_diverged(
    value: torch.Tensor, name: str, step: int, examples: Sequence[Example]
) -> None:
    if not torch.isfinite(value):
        views = ", ".join(example.name for example in examples)
        raise TrainingError(
            f"train {name}: the loss became {value.item()} at step {step} on view {views}; "
            "check the view with pbrnet inspect, or reduce train.learning_rate"
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


def _epoch_message(run: Run, point: CurvePoint) -> str:
    validation = "none" if point.validation_loss is None else f"{point.validation_loss:.2f}"
    return (
        f"train {run.name}: epoch {point.epoch} of {run.steps // run.steps_per_epoch}, "
        f"loss {point.train_loss:.2f}, validation {validation}"
    )
