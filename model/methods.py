"""Registry of methods: networks, their objectives and their optimisers.

A new baseline takes:

1. a file in model/baselines with the network, and with an objective if it has a loss of its own;
2. one entry in `METHODS`, or two if it has a loss of its own;
3. its titles in model/titles.py;
4. its name in `Baseline` and its section in `TrainParams`, both in pipeline/params.py;
5. its section in params.yaml and params/*.yaml, which the matrix of dvc.yaml reads.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from torch import nn

from pbrnet.model.baselines import can, cyclegan, end_to_end, pix2pix, unet
from pbrnet.model.data.reader import Extra
from pbrnet.model.networks.hybrid import HybridNet
from pbrnet.model.networks.objective import ExposedLoss, Objective, PairedLoss, Setting, Target
from pbrnet.model.networks.pbrnet import Architecture, composition_network, shading_network
from pbrnet.model.networks.plus import PlusNet
from pbrnet.model.training.settings import TrainParams
from pbrnet.scenes.errors import InputError


@dataclass(frozen=True)
class Adam:
    """Parameters of Adam from a method's paper."""

    rate: float
    betas: tuple[float, float] = (0.9, 0.999)
    decay: Literal["constant", "halfway"] = "constant"  # halfway: constant, then linearly to 0


@dataclass(frozen=True)
class Method:
    """A network and its training. All networks take inputs of `pbrnet.model.data.encoding.encode`.

    `own_loss` describes a loss other than the part-perceptual one in the model card. A method with
    `adam` has the optimiser of its paper, others the learning rate and decay of the parameters.
    """

    kind: str  # of the network's `Architecture`; methods of one kind share `build`
    build: Callable[[Architecture], nn.Module]
    objective: Callable[[Setting], Objective] = PairedLoss
    target: Target = "color"
    uses_shading_net: bool = False  # takes the output of the fixed shading network
    uses_panorama: bool = True
    uses_transport: bool = False  # takes light transport, and materials where they are known
    uses_noisy_samples: bool = False
    predicts_radiance: bool = False  # in the unit of its inputs; others predict display values
    revision: int = 1  # raised when weights of an earlier form no longer fit
    adam: Adam | None = None
    own_loss: str = ""

    @property
    def inputs(self) -> dict[str, bool]:
        """Arguments of `pbrnet.model.data.encoding.encode` that select the network's inputs."""
        return {
            "panorama": self.uses_panorama,
            "transport": self.uses_transport,
            "noisy_samples": self.uses_noisy_samples,
        }

    @property
    def extras(self) -> tuple[Extra, ...]:
        """Images beyond the paper's that the network needs."""
        needed: dict[Extra, bool] = {
            "noisy": self.uses_noisy_samples,
            "transport": self.uses_transport,
        }
        return tuple(name for name, wanted in needed.items() if wanted)

    def rate(self, params: TrainParams, step: int, steps: int) -> float:
        """Return the learning rate of a step, counted from 0, of `steps`."""
        if self.adam is None:
            return learning_rate(params, step, steps)
        late = max(0.0, 2 * step / steps - 1) if self.adam.decay == "halfway" else 0.0
        return self.adam.rate * (1 - late)


METHODS: dict[str, Method] = {
    "shading": Method("shading", shading_network, target="shading"),
    "composition": Method("composition", composition_network, uses_shading_net=True),
    "plus": Method(
        "plus",
        PlusNet,
        ExposedLoss,
        uses_panorama=False,
        uses_transport=True,
        predicts_radiance=True,
        revision=4,
        own_loss=ExposedLoss.description,
    ),
    "hybrid": Method(
        "hybrid",
        HybridNet,
        ExposedLoss,
        uses_panorama=False,
        uses_transport=True,
        uses_noisy_samples=True,
        predicts_radiance=True,
        revision=5,
        own_loss=ExposedLoss.description,
    ),
    "unet": Method("unet", unet.build),
    "end_to_end": Method("end_to_end", end_to_end.EndToEnd),
    "can": Method("can", can.CAN),
    "can_own": Method("can", can.CAN, can.MeanSquares, adam=Adam(1e-4), own_loss="mean squares"),
    "pix2pix": Method("pix2pix", pix2pix.Generator),
    "pix2pix_own": Method(
        "pix2pix",
        pix2pix.Generator,
        pix2pix.AdversarialObjective,
        adam=Adam(2e-4, (0.5, 0.999)),
        own_loss="log loss of 70x70 patches + 100 L1",
    ),
    "cyclegan": Method("cyclegan", cyclegan.ForwardGenerator),
    "cyclegan_own": Method(
        "cyclegan",
        cyclegan.ForwardGenerator,
        cyclegan.CycleObjective,
        adam=Adam(2e-4, (0.5, 0.999), "halfway"),
        own_loss="least squares of 70x70 patches + 10 cycle + 5 identity, unpaired",
    ),
}
BASELINES = tuple(name for name in METHODS if name not in ("shading", "composition"))
_BUILDERS = {method.kind: method.build for method in METHODS.values()}
_REVISIONS = {method.kind: method.revision for method in METHODS.values()}


def build_network(architecture: Architecture) -> nn.Module:
    """Build the network of an architecture, initialised from torch's random state.

    Raises `InputError` for a kind that no method has.
    """
    if architecture.kind not in _BUILDERS:
        known = ", ".join(_BUILDERS)
        raise InputError(f"no network of the kind {architecture.kind!r}; known are: {known}")
    return _BUILDERS[architecture.kind](architecture)


def is_current(architecture: Architecture) -> bool:
    """Test whether the network's code still has the form that weights were trained for."""
    return _REVISIONS.get(architecture.kind, architecture.revision) == architecture.revision


def extras_of(methods: Iterable[str]) -> tuple[Extra, ...]:
    """Return the images beyond the paper's that any of these methods needs."""
    found = [METHODS[name].extras for name in methods if name in METHODS]
    return tuple(dict.fromkeys(extra for extras in found for extra in extras))


def learning_rate(params: TrainParams, step: int, steps: int) -> float:
    """Return the learning rate of a step: constant as in the paper, or half a cosine down to 0."""
    if params.decay == "constant":
        return params.learning_rate
    return params.learning_rate * 0.5 * (1 + math.cos(math.pi * step / steps))


def trained_baselines(models: Path) -> list[str]:
    """Return the methods of one network whose model is in the folder, in the registry's order."""
    return [name for name in BASELINES if (models / f"{name}.safetensors").is_file()]
