"""Training objectives: a single loss, or losses of several networks trained against each other.

The loop in model/training/loop.py knows only this: an objective has players, each a module with an
optimiser of its own, and `losses` hands out, one after the other, a player and the loss that it
is to lower. The loop lowers it before it asks for the next, so a later loss already sees the
earlier update. A plain loss hands out one; a GAN hands out two.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, Literal

import torch
from torch import nn

from model.data.encoding import Tensors

Criterion = Callable[[torch.Tensor, torch.Tensor], torch.Tensor]
Target = Literal["shading", "color"]


@dataclass(frozen=True)
class Batch:
    """Views on the training device."""

    inputs: Tensors  # as `encode` gives them
    truth: torch.Tensor  # display values (N, 3, H, W) of the network's target
    shading: torch.Tensor | None = None  # the truth of shading, for those that learn both
    radiance: Tensors | None = None  # `radiances`, for those that predict radiance


@dataclass(frozen=True)
class Setting:
    """Network, criterion and settings from which an objective is built."""

    network: nn.Module
    criterion: Criterion  # the part-perceptual loss, on display values
    shading: nn.Module | None  # the fixed shading network that feeds the network, if one does
    width: int  # of the network's first level; opponents are as wide
    half: Callable[[], AbstractContextManager[Any]]  # the precision to compute in


class Objective(ABC):
    """Players and the losses they lower. The player named `network` holds what is saved."""

    players: dict[str, nn.Module]

    @abstractmethod
    def losses(self, batch: Batch) -> Iterator[tuple[str, torch.Tensor]]:
        """Player and loss, a scalar with gradient, in the order of updates of one step."""

    @abstractmethod
    def loss(self, batch: Batch) -> torch.Tensor:
        """The loss of the player `network`, for validation; leaves the objective as it was."""

    def memory(self) -> dict[str, Any]:
        """State of the objective beside its players, for a checkpoint."""
        return {}

    def remember(self, memory: dict[str, Any]) -> None:  # noqa: B027  (most have no memory)
        """Restore the state that `memory` returned."""


class SingleLoss(Objective):
    """Objective with one loss and no player but the network."""

    def __init__(self, setting: Setting) -> None:
        self.network = setting.network
        self.half, self.criterion = setting.half, setting.criterion
        self.players = {"network": self.network}

    def losses(self, batch: Batch) -> Iterator[tuple[str, torch.Tensor]]:
        """One player, one loss."""
        yield "network", self.loss(batch)


class PairedLoss(SingleLoss):
    """A loss between the prediction and the truth of the same view."""

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        self.shading = setting.shading

    def loss(self, batch: Batch) -> torch.Tensor:
        """The criterion of the network's prediction, a scalar with gradient."""
        with self.half():
            return self.criterion(self._predict(batch.inputs).float(), batch.truth)

    def _predict(self, inputs: Tensors) -> torch.Tensor:
        if self.shading is None:
            return self.network(inputs)
        with torch.no_grad():
            shading = self.shading(inputs).float().clamp(0, 1)
        return self.network(shading, inputs["reflectance"])
