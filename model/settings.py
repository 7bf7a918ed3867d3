"""Parameters of networks: pretrained features, training and evaluation."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeVar

from pbrnet.model.methods import BASELINES, JOINS, METHODS, Panorama
from pbrnet.scenes.checked import INLINE, param, within

if TYPE_CHECKING:
    Baseline = str
else:
    # Baselines of the comparison; `_own`: trained with the loss of its own paper.
    Baseline = Literal[BASELINES]

T = TypeVar("T")


@dataclass(frozen=True)
class BackboneParams:
    """Pretrained features of the perceptual loss."""

    network: Literal["auto", "vgg19", "efficientnet_lite0"] = param(
        "auto", "vgg19 if its weights are found or may be downloaded, else efficientnet_lite0"
    )
    weights: str = param("", "file with VGG-19 weights, named as in torchvision")
    download: bool = param(False, "allow downloading VGG-19")


@dataclass(frozen=True)
class LossParams:
    """Part-perceptual loss (paper, equations 1 and 2): input, then conv1_2 ... conv5_2."""

    kind: Literal["part", "full", "fifth", "l1"] = param("part", "part, full, fifth or l1")
    part: tuple[float, ...] = param(
        (1.0, 1.5, 1.5, 0.5, 0.0, 0.0), "weights of the input and the layers"
    )

    def verify(self, where: str) -> None:
        """Raise ValueError unless there are six weights."""
        if len(self.part) != 6:
            raise ValueError(f"{where}.part: {len(self.part)} weights; six are needed")


@dataclass(frozen=True)
class StageTrainParams:
    """One network's training."""

    epochs: int = param(10, "number of epochs", within(1, 100_000))
    steps_per_epoch: int = param(0, "steps per epoch; 0: one per view", within(0, 10_000_000))
    width: int = param(32, "channels of the first level", within(1, 1024))
    levels: int = param(
        5,
        "resolutions of a U-Net, layers of CAN, halvings of pix2pix, blocks of CycleGAN",
        within(1, 16),
    )


def _with_baselines(cls: type[T]) -> type[T]:
    """Add to `TrainParams` a section for each baseline, with the sizes in `METHODS`."""
    for name in BASELINES:
        cls.__annotations__[name] = "StageTrainParams"
        setattr(cls, name, param(_sizes(name), METHODS[name].note, INLINE))
    return cls


def _sizes(name: str) -> StageTrainParams:
    method = METHODS[name]
    return StageTrainParams(epochs=method.epochs, width=method.width, levels=method.levels)


@dataclass(frozen=True)
@_with_baselines
class TrainParams:
    """Two-stage training: the shading network, then fixed, the composition network.

    Each baseline has a section of its name, too: `plus`, `unet` and so on.
    """

    learning_rate: float = param(
        0.0006, "the paper: 0.0001, constant, for 280,000 steps", within(above=0)
    )
    batch: int = param(1, "views per step", within(1, 256))
    precision: Literal["auto", "float32", "bfloat16"] = param("auto", "auto, float32 or bfloat16")
    device: Literal["auto", "cpu", "cuda"] = param("auto", "auto, cpu or cuda")
    decay: Literal["constant", "cosine"] = param(
        "cosine", "constant, or cosine: to 0 by the last step"
    )
    exposure: Literal["own", "shared"] = param("shared", "shared, or own as in the paper")
    flips: bool = param(True, "mirror views at random with probability 1/2")
    panorama: Panorama = param("normal", f"{', '.join(JOINS)}; see docs/networks.md")
    checkpoint_steps: int = param(500, "steps between checkpoints", within(1))
    loss: LossParams = param(LossParams(), "part-perceptual")
    shading: StageTrainParams = param(_sizes("shading"))
    composition: StageTrainParams = param(_sizes("composition"))
    baselines: tuple[Baseline, ...] = param(
        ("unet",), "baselines to train and evaluate; hybrid requires noisy.spp"
    )

    def verify(self, where: str) -> None:
        """Raise ValueError for a repeated baseline or for too few levels."""
        if len(set(self.baselines)) < len(self.baselines):
            raise ValueError(f"{where}.baselines: {list(self.baselines)} names a baseline twice")
        for name, least in (("can", 3), ("pix2pix", 2)):
            for section in (name, f"{name}_own"):
                levels = getattr(self, section).levels
                if levels < least:
                    raise ValueError(f"{where}.{section}.levels: {levels}; at least {least}")


@dataclass(frozen=True)
class EvaluateParams:
    """Evaluation on the test split."""

    split: Literal["test", "validation", "train"] = param("test", "test, validation or train")
    timing_views: int = param(4, "number of views timed", within(1, 1000))


def learning_rate(params: TrainParams, step: int, steps: int) -> float:
    """Return the learning rate of a step: constant as in the paper, or half a cosine down to 0."""
    if params.decay == "constant":
        return params.learning_rate
    return params.learning_rate * 0.5 * (1 + math.cos(math.pi * step / steps))
