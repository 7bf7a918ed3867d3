"""Training checkpoints, from which a resumed run continues bit-identically."""

from __future__ import annotations

import io
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch

from pbrnet.model.networks.objective import Objective
from pbrnet.scenes.checked import plain
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import atomic_file

Optimisers = dict[str, torch.optim.Adam]  # by the names of the objective's modules


@dataclass(frozen=True)
class CurvePoint:
    """Point of a learning curve: a row of `plots/train_NAME.csv`."""

    step: int
    epoch: int
    train_loss: float
    validation_loss: float | None


@dataclass
class State:
    """Progress of a training run, without the states of networks and optimisers."""

    step: int = 0
    loss_sum: float = 0.0  # over the steps of the current epoch
    curve: list[CurvePoint] = field(default_factory=list)


@dataclass(frozen=True)
class Checkpoint:
    """Checkpoint file of one training run."""

    path: Path
    identity: str  # digest of the run's settings; checkpoints of other runs are ignored

    def save(self, objective: Objective, optimisers: Optimisers, state: State) -> None:
        """Write everything that the next step depends on, by rename."""
        content = {
            "identity": self.identity,
            "players": {name: m.state_dict() for name, m in objective.modules.items()},
            "optimisers": {name: o.state_dict() for name, o in optimisers.items()},
            "memory": objective.state_dict(),
            "step": state.step,
            "loss_sum": state.loss_sum,
            "curve": [plain(point) for point in state.curve],
        }
        packed = io.BytesIO()  # onto a full disk, torch ends in an error that does not say so
        torch.save(content, packed)
        with atomic_file(self.path) as partial:
            partial.write_bytes(packed.getbuffer())

    def resume(self, objective: Objective, optimisers: Optimisers) -> State:
        """Restore the checkpoint if it belongs to this run; otherwise return a new `State`.

        Raises `InputError` for a damaged file.
        """
        if not self.path.is_file():
            return State()
        try:
            content: dict[str, Any] = torch.load(self.path, map_location="cpu", weights_only=True)
            if content["identity"] != self.identity:
                return State()
            for name, module in objective.modules.items():
                module.load_state_dict(content["players"][name])
                optimisers[name].load_state_dict(content["optimisers"][name])
            objective.load_state_dict(content["memory"])
        except Exception as error:
            raise InputError(
                f"{self.path}: damaged checkpoint ({type(error).__name__}); delete it to start over"
            ) from None
        return State(
            step=content["step"],
            loss_sum=content["loss_sum"],
            curve=[CurvePoint(**point) for point in content["curve"]],
        )
