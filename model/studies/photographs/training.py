"""Training of the study's network on one row's pictures, and its predictions.

Draws and learning rate are functions of the step and the seed. A row with several stages shares the
steps equally among them, under one learning rate.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch
from torch.nn import functional

from pbrnet.model.studies.photographs.measures import Prediction
from pbrnet.model.studies.photographs.network import (
    Output,
    PhotographNetwork,
    new_network,
    thirteen,
)
from pbrnet.model.studies.photographs.samples import Pool, Sample, display
from pbrnet.pipeline.progress import Progress
from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.errors import PbrnetError
from pbrnet.scenes.seeds import derive32, generator

BATCH = 8
RATE, DECAY = 1e-3, 0.01  # highest learning rate, weight decay of AdamW
ENCODER = 0.3  # the encoder's learning rate, of the decoder's
WARM_UP = 0.05  # share of the steps
WEIGHTS = {"depth": 1.0, "normal": 1.0, "classes": 0.2}  # of the losses
SCHEDULE = (BATCH, RATE, DECAY, ENCODER, WARM_UP, *WEIGHTS.values())  # for fingerprints


def train(
    stages: Sequence[Sequence[Pool]], steps: int, seed: int, device: torch.device, label: str
) -> PhotographNetwork:
    """Train a network for `steps` steps; each picture comes from a pool of its stage at random.

    Raises `PbrnetError` if the loss is not finite.
    """
    network = new_network(derive32(seed, "weights")).to(device).train()
    decoder = [p for name, p in network.named_parameters() if not name.startswith("encoder.")]
    groups = [
        {"params": decoder, "share": 1.0},
        {"params": list(network.encoder.parameters()), "share": ENCODER},
    ]
    optimiser = torch.optim.AdamW(groups, weight_decay=DECAY)
    with Progress(steps, f"train {label}", "steps") as progress:
        for step in range(steps):
            pools = stages[step * len(stages) // steps]
            rng = generator(seed, "step", step)
            loss = _loss(network, [rng.pick(pools).draw(rng) for _ in range(BATCH)], device)
            if not torch.isfinite(loss):
                raise PbrnetError(f"train {label}: the loss became {loss.item()} at step {step}")
            optimiser.zero_grad(set_to_none=True)
            loss.backward()  # type: ignore[no-untyped-call]
            torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
            for group in optimiser.param_groups:
                group["lr"] = group["share"] * rate(step, steps)
            optimiser.step()
            progress.advance()
    return network.eval()


def rate(step: int, steps: int) -> float:
    """Learning rate of a step: a linear rise, then half a cosine to 0."""
    rise = max(1, round(WARM_UP * steps))
    if step < rise:
        return RATE * (step + 1) / rise
    return RATE / 2 * (1 + math.cos(math.pi * (step - rise) / max(1, steps - rise)))


@torch.no_grad()
def predict(network: PhotographNetwork, sample: Sample, device: torch.device) -> Prediction:
    """Predict for a whole picture; images of the sample's size."""
    image = torch.tensor(display(sample)).permute(2, 0, 1)[None].to(device) / 255
    rays = torch.from_numpy(sample.rays).permute(2, 0, 1)[None].to(device)
    output = network(image, rays)

    def enlarged(values: torch.Tensor) -> AnyArray:
        whole = functional.interpolate(values, size=sample.depth.shape, mode="bilinear")[0]
        return whole.cpu().numpy()

    normal = enlarged(output.normal).transpose(1, 2, 0)
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-6)
    return Prediction(
        depth=np.exp(enlarged(output.log_depth[:, None])[0]),
        normal=normal,
        label40=(enlarged(output.classes).argmax(0) + 1).astype(np.uint8),
        label13=(enlarged(thirteen(output.classes)).argmax(0) + 1).astype(np.uint8),
    )


def _loss(
    network: PhotographNetwork, samples: Sequence[Sample], device: torch.device
) -> torch.Tensor:
    """Loss of a batch; every task is averaged over its known pixels."""

    def stacked(name: str, step: int = 1) -> torch.Tensor:
        arrays = [np.ascontiguousarray(getattr(s, name)[::step, ::step]) for s in samples]
        return torch.from_numpy(np.stack(arrays)).to(device)

    image = stacked("image").permute(0, 3, 1, 2).contiguous(memory_format=torch.channels_last)
    output: Output = network(image / 255, stacked("rays").permute(0, 3, 1, 2))
    depth, normal = stacked("depth", 2), stacked("normal", 2).permute(0, 3, 1, 2).float()
    away = (output.log_depth - torch.log(depth.clamp(min=1e-3))).abs()
    cosine = (output.normal * normal).sum(1)
    return (
        WEIGHTS["depth"] * _mean(away, depth > 0)
        + WEIGHTS["normal"] * _mean(1 - cosine, (normal != 0).any(1))
        + WEIGHTS["classes"] * _mean(_surprise(thirteen(output.classes), stacked("label13", 2)))
        + WEIGHTS["classes"] / 2 * _mean(_surprise(output.classes, stacked("label40", 2)))
    )


def _surprise(log_probability: torch.Tensor, labels: torch.Tensor) -> torch.Tensor:
    """Cross entropy of the known pixels, (K,)."""
    flat = functional.nll_loss(
        log_probability, labels.long() - 1, reduction="none", ignore_index=-1
    )
    return flat[labels > 0]


def _mean(values: torch.Tensor, known: torch.Tensor | None = None) -> torch.Tensor:
    """Mean over the known values; 0 without any."""
    chosen = values if known is None else values[known]
    return chosen.sum() / max(chosen.numel(), 1)
