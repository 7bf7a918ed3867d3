"""Training checkpoints: a resumed training is bit-identical to an uninterrupted one."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch

from model.networks.objective import Objective
from scenes.checked import plain
from scenes.errors import InputError
from scenes.files import atomic_file

Optimisers = dict[str, torch.optim.Adam]  # by the objective's players


@dataclass(frozen=True)
class CurvePoint:
    """A row of `plots/train_NAME.csv`."""

    step: int
    epoch: int
    train_loss: float
    validation_loss: float | None


@dataclass
class State:
    """Progress of a training: the part of a checkpoint beside networks and Adam's moments."""

    step: int = 0
    loss_sum: float = 0.0  # over the steps of this epoch
    curve: list[CurvePoint] = field(default_factory=list)


@dataclass(frozen=True)
class Checkpoint:
    """Checkpoint file of one training."""

    path: Path
    identity: str  # of the training; what another one left is not gone on from

    def save(self, objective: Objective, optimisers: Optimisers, state: State) -> None:
        """Write all that the next step depends on, by rename."""
        content = {
            "identity": self.identity,
            "players": {name: p.state_dict() for name, p in objective.players.items()},
            "optimisers": {name: o.state_dict() for name, o in optimisers.items()},
            "memory": objective.memory(),
            "step": state.step,
            "loss_sum": state.loss_sum,
            "curve": [plain(point) for point in state.curve],
        }
        with atomic_file(self.path) as partial:
            torch.save(content, partial)

    def resume(self, objective: Objective, optimisers: Optimisers) -> State:
        """Go on from the checkpoint if it is of this very training, else from the start."""
        if not self.path.is_file():
            return State()
        try:
            content: dict[str, Any] = torch.load(self.path, map_location="cpu", weights_only=True)
            if content["identity"] != self.identity:
                return State()
            for name, player in objective.players.items():
                player.load_state_dict(content["players"][name])
                optimisers[name].load_state_dict(content["optimisers"][name])
            objective.remember(content["memory"])
        except Exception as error:
            raise InputError(
                f"{self.path}: damaged checkpoint ({type(error).__name__}); delete it to start over"
            ) from None
        return State(
            step=content["step"],
            loss_sum=content["loss_sum"],
            curve=[CurvePoint(**point) for point in content["curve"]],
        )
