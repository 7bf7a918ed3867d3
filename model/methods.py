"""The registry: every method that can be trained, ours and those ours are compared with.

A new baseline is a file in model/baselines, a line in `LAYOUTS`, one or two in `METHODS`, and its
section in pipeline/params.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from torch import nn

from model.baselines import can, cyclegan, end_to_end, pix2pix, unet
from model.networks.hybrid import Exposed, HybridNet
from model.networks.objective import Objective, Paired, Setting, Target
from model.networks.pbrnet import Architecture, Kind, composition_network, shading_network
from model.networks.plus import Decomposed, PlusNet
from pipeline.params import TrainParams

LAYOUTS: dict[Kind, Callable[[Architecture], nn.Module]] = {
    "shading": shading_network,
    "composition": composition_network,
    "unet": unet.build,
    "end_to_end": end_to_end.EndToEnd,
    "can": can.CAN,
    "pix2pix": pix2pix.Generator,
    "cyclegan": cyclegan.Forwards,
    "plus": PlusNet,
    "hybrid": HybridNet,
}


@dataclass(frozen=True)
class Adam:
    """Adam as a method's paper has it."""

    rate: float
    betas: tuple[float, float] = (0.9, 0.999)
    decay: Literal["constant", "halfway"] = "constant"  # halfway: then linearly to nothing


@dataclass(frozen=True)
class Method:
    """A network and how it is trained; all see `encode`'s inputs.

    With `own` it has its paper's loss and optimiser, in those words for its card; else our
    loss and the rate and decay of the parameters, as ours.
    """

    layout: Kind
    title: str
    objective: Callable[[Setting], Objective] = Paired
    target: Target = "color"
    fed: bool = False  # by the fixed shading network
    direct: bool = False  # given the direct light of the panorama too
    noisy: bool = False  # given noisy samples too, and predicts radiance, not display values
    shaded: bool = False  # has the method `parts`: shading beside the colour
    adam: Adam | None = None
    own: str = ""

    def rate(self, params: TrainParams, step: int, steps: int) -> float:
        """The learning rate of a step of so many."""
        if self.adam is None:
            return learning_rate(params, step, steps)
        late = max(0.0, 2 * step / steps - 1) if self.adam.decay == "halfway" else 0.0
        return self.adam.rate * (1 - late)


METHODS: dict[str, Method] = {
    "shading": Method("shading", "Shading network", target="shading"),
    "composition": Method("composition", "Composition network", fed=True),
    "plus": Method("plus", "PBR-Net plus", Decomposed, direct=True, shaded=True),
    "hybrid": Method("hybrid", "PBR-Net hybrid", Exposed, noisy=True, shaded=True),
    "unet": Method("unet", "Direct U-Net"),
    "end_to_end": Method("end_to_end", "Both networks, shading not supervised"),
    "can": Method("can", "CAN, our loss"),
    "can_own": Method(
        "can", "CAN, its own loss", can.MeanSquares, adam=Adam(1e-4), own="mean squares"
    ),
    "pix2pix": Method("pix2pix", "pix2pix, our loss"),
    "pix2pix_own": Method(
        "pix2pix",
        "pix2pix, its own loss",
        pix2pix.Game,
        adam=Adam(2e-4, (0.5, 0.999)),
        own="log loss of 70x70 patches + 100 L1",
    ),
    "cyclegan": Method("cyclegan", "CycleGAN, our loss"),
    "cyclegan_own": Method(
        "cyclegan",
        "CycleGAN, its own loss",
        cyclegan.Cycles,
        adam=Adam(2e-4, (0.5, 0.999), "halfway"),
        own="least squares of 70x70 patches + 10 cycle + 5 identity, unpaired",
    ),
}
BASELINES = tuple(name for name in METHODS if name not in ("shading", "composition"))


def build_network(architecture: Architecture) -> nn.Module:
    """The network of an architecture, freshly initialised from torch's random state."""
    return LAYOUTS[architecture.kind](architecture)


def learning_rate(params: TrainParams, step: int, steps: int) -> float:
    """Constant as in the paper, or half a cosine down to nothing at `steps`."""
    if params.decay == "constant":
        return params.learning_rate
    return params.learning_rate * 0.5 * (1 + math.cos(math.pi * step / steps))


def trained_baselines(models: Path) -> list[str]:
    """Those whose model is in the folder, in the registry's order."""
    return [name for name in BASELINES if (models / f"{name}.safetensors").is_file()]
