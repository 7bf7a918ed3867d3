"""Registry of methods: networks, their inputs, objectives, optimisers and titles.

docs/architecture.md has the recipe for a new baseline.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from torch import nn

from pbrnet.model.baselines import can, cyclegan, end_to_end, pix2pix, unet
from pbrnet.model.data.encoding import PAPER_INPUTS, input_columns, input_named
from pbrnet.model.data.reader import NOISY_SPP
from pbrnet.model.networks import hybrid, plus
from pbrnet.model.networks.objective import ExposedLoss, Objective, PairedLoss, Setting, Target
from pbrnet.model.networks.pbrnet import Architecture, composition_network, shading_network
from pbrnet.model.settings import TrainParams
from pbrnet.scenes.errors import InputError


@dataclass(frozen=True)
class Adam:
    """Parameters of Adam from a method's paper."""

    rate: float
    betas: tuple[float, float] = (0.9, 0.999)
    decay: Literal["constant", "halfway"] = "constant"  # halfway: constant, then linearly to 0


@dataclass(frozen=True)
class Method:
    """A network and its training.

    `inputs` names what it takes, of `pbrnet.model.data.encoding.INPUTS` or an image column as it
    is. `own_loss` describes a loss other than the part-perceptual one in the model card. A method
    with `adam` has the optimiser of its paper, others the learning rate and decay of the
    parameters.
    """

    kind: str  # of the network's `Architecture`; methods of one kind share `build`
    build: Callable[[Architecture], nn.Module]
    title: str  # in tables and plots of results
    network_title: str  # in learning curves, example pictures, help texts and model cards
    inputs: tuple[str, ...] = PAPER_INPUTS
    objective: Callable[[Setting], Objective] = PairedLoss
    target: Target = "color"
    uses_shading_net: bool = False  # takes the output of the fixed shading network
    predicts_radiance: bool = False  # in the unit of its inputs; others predict display values
    revision: int = 1  # raised when weights of an earlier form no longer fit
    adam: Adam | None = None
    own_loss: str = ""

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns beyond the paper's that a view must have."""
        return input_columns(self.inputs)

    @property
    def optional_inputs(self) -> tuple[str, ...]:
        """Inputs that the network is trained with where the dataset has their columns."""
        return tuple(name for name in self.inputs if input_named(name).optional)

    @property
    def takes_samples(self) -> bool:
        """True for a network that takes noisy samples."""
        return NOISY_SPP in self.columns

    def rate(self, params: TrainParams, step: int, steps: int) -> float:
        """Return the learning rate of a step, counted from 0, of `steps`."""
        if self.adam is None:
            return learning_rate(params, step, steps)
        late = max(0.0, 2 * step / steps - 1) if self.adam.decay == "halfway" else 0.0
        return self.adam.rate * (1 - late)


METHODS: dict[str, Method] = {
    "shading": Method(
        "shading", shading_network, "Shading network", "Shading network", target="shading"
    ),
    "composition": Method(
        "composition",
        composition_network,
        "Composition network",
        "Composition network",
        uses_shading_net=True,
    ),
    "plus": Method(
        "plus",
        plus.PlusNet,
        "PBR-Net plus: our network without samples",
        "PBR-Net plus",
        plus.INPUTS,
        ExposedLoss,
        predicts_radiance=True,
        revision=4,
        own_loss=ExposedLoss.description,
    ),
    "hybrid": Method(
        "hybrid",
        hybrid.HybridNet,
        "PBR-Net hybrid: a few samples a pixel, denoised, corrected by a network",
        "PBR-Net hybrid",
        hybrid.INPUTS,
        ExposedLoss,
        predicts_radiance=True,
        revision=5,
        own_loss=ExposedLoss.description,
    ),
    "unet": Method("unet", unet.build, "One direct U-Net", "Direct U-Net"),
    "end_to_end": Method(
        "end_to_end",
        end_to_end.EndToEnd,
        "Both networks, trained on colour alone",
        "Both networks, on colour alone",
    ),
    "can": Method("can", can.CAN, "CAN, trained with our loss", "CAN, our loss"),
    "can_own": Method(
        "can",
        can.CAN,
        "CAN, with its own loss: mean squares",
        "CAN, its own loss",
        objective=can.MeanSquares,
        adam=Adam(1e-4),
        own_loss="mean squares",
    ),
    "pix2pix": Method(
        "pix2pix",
        pix2pix.Generator,
        "pix2pix's generator, trained with our loss",
        "pix2pix, our loss",
    ),
    "pix2pix_own": Method(
        "pix2pix",
        pix2pix.Generator,
        "pix2pix, with its own loss: adversarial and L1",
        "pix2pix, its own loss",
        objective=pix2pix.AdversarialObjective,
        adam=Adam(2e-4, (0.5, 0.999)),
        own_loss="log loss of 70x70 patches + 100 L1",
    ),
    "cyclegan": Method(
        "cyclegan",
        cyclegan.ForwardGenerator,
        "CycleGAN's generator, trained with our loss",
        "CycleGAN, our loss",
    ),
    "cyclegan_own": Method(
        "cyclegan",
        cyclegan.ForwardGenerator,
        "CycleGAN, with its own loss: unpaired, adversarial and cycles",
        "CycleGAN, its own loss",
        objective=cyclegan.CycleObjective,
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


def columns_of(methods: Iterable[str]) -> tuple[str, ...]:
    """Return the columns beyond the paper's that any of these methods needs."""
    found = [METHODS[name].columns for name in methods if name in METHODS]
    return tuple(dict.fromkeys(column for columns in found for column in columns))


def learning_rate(params: TrainParams, step: int, steps: int) -> float:
    """Return the learning rate of a step: constant as in the paper, or half a cosine down to 0."""
    if params.decay == "constant":
        return params.learning_rate
    return params.learning_rate * 0.5 * (1 + math.cos(math.pi * step / steps))


def trained_baselines(models: Path) -> list[str]:
    """Return the methods of one network whose model is in the folder, in the registry's order."""
    return [name for name in BASELINES if (models / f"{name}.safetensors").is_file()]
