"""Training objectives: a single loss, or losses of several networks trained against each other.

An objective has modules, each with its own optimiser: the network and, in a GAN, discriminators.
`losses` yields pairs of a module's name and its loss, and the loop in model/training/loop.py
updates the module before it takes the next pair. A later loss is therefore computed with the
earlier update. A single loss yields one pair, a GAN yields two.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

import torch
from torch import nn

from pbrnet.model.data.display import tonemap_exposed
from pbrnet.model.data.encoding import Tensors
from pbrnet.model.networks.flip import Flip
from pbrnet.model.networks.pbrnet import CompositionNet

Criterion = Callable[[torch.Tensor, torch.Tensor], torch.Tensor]

# Weights of FLIP and of the logarithmic loss, and what is added to exposed radiance before the
# logarithm.
FLIP_WEIGHT, LOG_WEIGHT, LOSS_LOG_OFFSET = 100.0, 25.0, 0.05


@dataclass(frozen=True)
class Batch:
    """Inputs and targets of some views on the training device."""

    inputs: Tensors  # of `encode`
    truth: torch.Tensor  # display values (N, 3, H, W) of the network's target
    radiance: Tensors | None = None  # of `radiances`, for networks that predict radiance


@dataclass(frozen=True)
class Setting:
    """Network, criterion and settings from which an objective is built."""

    network: nn.Module
    criterion: Criterion  # the part-perceptual loss, on display values
    shading: nn.Module | None  # the fixed shading network whose output the network takes, or None
    width: int  # channels of the first level, of the network and of its discriminators
    autocast: Callable[[], AbstractContextManager[Any]]  # context that sets the precision


class Objective(ABC):
    """Modules and their losses. The module named `network` contains the network that is saved."""

    modules: dict[str, nn.Module]
    description = ""  # of a loss other than the part-perceptual one, for the model card

    @abstractmethod
    def losses(self, batch: Batch) -> Iterator[tuple[str, torch.Tensor]]:
        """Names of modules and their losses (scalars with gradient), in the order of updates."""

    @abstractmethod
    def loss(self, batch: Batch) -> torch.Tensor:
        """The loss of the module `network`, for validation; does not change the objective."""

    def state_dict(self) -> dict[str, Any]:
        """State of the objective without its modules, for a checkpoint."""
        return {}

    def load_state_dict(self, state: dict[str, Any]) -> None:  # noqa: B027  (most have none)
        """Restore the state that `state_dict` returned."""


class SingleLoss(Objective):
    """Objective with one loss whose only module is the network."""

    def __init__(self, setting: Setting) -> None:
        self.network = setting.network
        self.autocast, self.criterion = setting.autocast, setting.criterion
        self.modules = {"network": self.network}

    def losses(self, batch: Batch) -> Iterator[tuple[str, torch.Tensor]]:
        """The name of the only module, and its loss."""
        yield "network", self.loss(batch)


class PairedLoss(SingleLoss):
    """A loss between the prediction and the truth of the same view."""

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        self.shading = setting.shading

    def loss(self, batch: Batch) -> torch.Tensor:
        """The criterion between prediction and truth, a scalar with gradient."""
        with self.autocast():
            return self.criterion(self._predict(batch.inputs).float(), batch.truth)

    def _predict(self, inputs: Tensors) -> torch.Tensor:
        if self.shading is None:
            return self.network(inputs)
        assert isinstance(self.network, CompositionNet)
        with torch.no_grad():
            shading = self.shading(inputs).float().clamp(0, 1)
            images = self.network.images(shading, inputs["reflectance"])
        return self.network(images)


class ExposedLoss(SingleLoss):
    """Loss of predicted radiance: FLIP of the displayed colour, and L1 on logarithms.

    FLIP's gradient vanishes where the display is white or nearly black; there the logarithms still
    measure the error.
    """

    description = f"{FLIP_WEIGHT:g} FLIP + {LOG_WEIGHT:g} L1 of logarithms"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        device = next(setting.network.parameters()).device
        self.criterion = Flip().to(device)

    def loss(self, batch: Batch) -> torch.Tensor:
        """The sum of both terms, a scalar with gradient."""
        assert batch.radiance is not None
        scale, white = batch.radiance["exposure"].split(1, dim=1)
        with self.autocast():
            color = scale * self.network(batch.inputs)
            loss = FLIP_WEIGHT * self.criterion(tonemap_exposed(color, white), batch.truth)
        truth = scale * batch.radiance["color"]
        logs = [(image + LOSS_LOG_OFFSET).log() for image in (color, truth)]
        return loss + LOG_WEIGHT * (logs[0] - logs[1]).abs().mean()
