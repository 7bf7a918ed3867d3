"""Registry of methods: networks, their inputs, objectives, optimisers, sizes and titles.

docs/architecture.md has the recipe for a new baseline. Networks and objectives are named as
"module:class" and imported when they are used: parameters, titles and help texts need no torch.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from pbrnet.scenes.checked import imported

Target = Literal["shading", "color"]
MAX_SAMPLES = 8  # per pixel, of noisy samples
MIN_TILE = 16  # least side of a tile in pixels
PAPER_INPUTS = ("depth", "normal", "reflectance", "intensity", "distance")
GEOMETRY = ("depth", "normal", "materials")  # inputs that all bands of plus and hybrid share
_ENCODING = "pbrnet.model.data.encoding"
_BASELINES, _NETWORKS = "pbrnet.model.baselines", "pbrnet.model.networks"
_PAIRED, _EXPOSED = f"{_NETWORKS}.objective:PairedLoss", f"{_NETWORKS}.objective:ExposedLoss"


@dataclass(frozen=True)
class Join:
    """A way in which the panorama joins the image, by its features and often a further input.

    That input, `direct`, is the panorama's direct light in so many `bands`, unless
    `pbrnet.model.data.encoding.INPUTS` has another of this name; `columns` are what it needs beyond
    geometry and panorama.
    """

    direct: str = ""
    columns: tuple[str, ...] = ()
    bands: int = 1
    without_product: str = ""  # the same join without its product, if it has one
    resized: bool = False  # features of the panorama, to the image; else looked up by normals

    @property
    def product(self) -> bool:
        """True if the last three channels of `direct` display the product with reflectance."""
        return bool(self.without_product)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Inputs of the network beyond those of its method."""
        return (self.direct,) if self.direct else ()


JOINS = {
    "normal": Join(),
    "resize": Join(resized=True),
    "position": Join("direct"),
    "colour": Join("direct_colour", ("tint",), 3),
    "shadows": Join("direct_shadows", ("visibility",)),
    "product": Join("direct_product", ("visibility",), without_product="shadows"),
}
if TYPE_CHECKING:
    Panorama = str
else:
    Panorama = Literal[tuple(JOINS)]


def join_of(panorama: Panorama, target: Target) -> Join:
    """The join of a network that takes the panorama and predicts `target`.

    Networks that predict shading know nothing of reflectance, so they get no product with it.
    """
    join = JOINS[panorama]
    return JOINS[join.without_product] if join.product and target == "shading" else join


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
    is. `epochs`, `width` and `levels` are defaults of the section `train.NAME`, `note` is its
    meaning. A method with `adam` has the optimiser of its paper, others the learning rate and decay
    of the parameters.
    """

    kind: str  # of the network's `Architecture`; methods of one kind share `build`
    build: str  # "module:function" that makes a network of an `Architecture`
    title: str  # in tables and plots of results
    network_title: str  # in learning curves, example pictures, help texts and model cards
    inputs: tuple[str, ...] = PAPER_INPUTS
    objective_class: str = _PAIRED
    target: Target = "color"
    first: Target = "color"  # what the network that takes the panorama predicts
    uses_shading_net: bool = False  # takes the output of the fixed shading network
    predicts_radiance: bool = False  # in the unit of its inputs; others predict display values
    adam: Adam | None = None
    epochs: int = 10
    width: int = 32
    levels: int = 5
    note: str = ""

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns beyond the paper's that a view must have."""
        found: tuple[str, ...] = imported(f"{_ENCODING}:input_columns")(self.inputs)
        return found

    def inputs_with(self, panorama: Panorama) -> tuple[str, ...]:
        """Inputs of the network with this join of the panorama, `train.panorama`."""
        join = join_of(panorama, self.first)
        return (*self.inputs, *(join.inputs if "intensity" in self.inputs else ()))

    @property
    def optional_inputs(self) -> tuple[str, ...]:
        """Inputs that the network is trained with where the dataset has their columns."""
        input_named = imported(f"{_ENCODING}:input_named")
        return tuple(name for name in self.inputs if input_named(name).optional)

    @property
    def takes_samples(self) -> bool:
        """True for a network that takes noisy samples."""
        return "samples" in self.inputs

    @property
    def own_loss(self) -> str:
        """Words for a loss other than the part-perceptual one, for the model card; else empty."""
        return str(imported(self.objective_class).description)

    def objective(self, setting: Any) -> Any:
        """Build the objective for a `Setting` of `pbrnet.model.networks.objective`."""
        return imported(self.objective_class)(setting)

    def rate(self, usual: float, step: int, steps: int) -> float:
        """Return the learning rate of a step, counted from 0, of `steps`; `usual` by default."""
        if self.adam is None:
            return usual
        late = max(0.0, 2 * step / steps - 1) if self.adam.decay == "halfway" else 0.0
        return self.adam.rate * (1 - late)


METHODS: dict[str, Method] = {
    "shading": Method(
        "shading",
        f"{_NETWORKS}.pbrnet:shading_network",
        "Shading network",
        "Shading network",
        target="shading",
        first="shading",
    ),
    "composition": Method(
        "composition",
        f"{_NETWORKS}.pbrnet:composition_network",
        "Composition network",
        "Composition network",
        first="shading",
        uses_shading_net=True,
        epochs=6,
        levels=3,
    ),
    "plus": Method(
        "plus",
        f"{_NETWORKS}.plus:PlusNet",
        "PBR-Net plus: light transport, corrected by a network",
        "PBR-Net plus",
        (*GEOMETRY, "reflectance", "transport", "level"),
        _EXPOSED,
        predicts_radiance=True,
        note="light transport corrected by a network",
    ),
    "hybrid": Method(
        "hybrid",
        f"{_NETWORKS}.hybrid:HybridNet",
        "PBR-Net hybrid: a few samples per pixel, denoised, corrected by a network",
        "PBR-Net hybrid",
        (*GEOMETRY, "reflectance", "transport", "noisy", "samples"),
        _EXPOSED,
        predicts_radiance=True,
        width=16,
        note="denoised samples mixed with light transport",
    ),
    "unet": Method(
        "unet",
        f"{_BASELINES}.unet:build",
        "One direct U-Net",
        "Direct U-Net",
        note="one U-Net from inputs to colour",
    ),
    "end_to_end": Method(
        "end_to_end",
        f"{_BASELINES}.end_to_end:EndToEnd",
        "Both networks, trained on colour alone",
        "Both networks, on colour alone",
        first="shading",
        note="both networks trained together, on colour alone",
    ),
    "can": Method(
        "can", f"{_BASELINES}.can:CAN", "CAN, trained with our loss", "CAN, our loss", levels=10
    ),
    "can_own": Method(
        "can",
        f"{_BASELINES}.can:CAN",
        "CAN, with its own loss: mean squares",
        "CAN, its own loss",
        objective_class=f"{_BASELINES}.can:MeanSquares",
        adam=Adam(1e-4),
        levels=10,
        note="NAME_own: with its own loss",
    ),
    "pix2pix": Method(
        "pix2pix",
        f"{_BASELINES}.pix2pix:Generator",
        "pix2pix's generator, trained with our loss",
        "pix2pix, our loss",
        width=64,
        levels=7,
    ),
    "pix2pix_own": Method(
        "pix2pix",
        f"{_BASELINES}.pix2pix:Generator",
        "pix2pix, with its own loss: adversarial and L1",
        "pix2pix, its own loss",
        objective_class=f"{_BASELINES}.pix2pix:AdversarialObjective",
        adam=Adam(2e-4, (0.5, 0.999)),
        width=64,
        levels=7,
    ),
    "cyclegan": Method(
        "cyclegan",
        f"{_BASELINES}.cyclegan:ForwardGenerator",
        "CycleGAN's generator, trained with our loss",
        "CycleGAN, our loss",
        width=64,
        levels=6,
    ),
    "cyclegan_own": Method(
        "cyclegan",
        f"{_BASELINES}.cyclegan:ForwardGenerator",
        "CycleGAN, with its own loss: unpaired, adversarial and cycles",
        "CycleGAN, its own loss",
        objective_class=f"{_BASELINES}.cyclegan:CycleObjective",
        adam=Adam(2e-4, (0.5, 0.999), "halfway"),
        width=64,
        levels=6,
    ),
}
BASELINES = tuple(name for name in METHODS if name not in ("shading", "composition"))
PRODUCTS = ("product", "product_linear")  # of reflectance and predicted shading
PREDICTABLE = ("pbrnet", *PRODUCTS, *BASELINES)


def columns_of(methods: Iterable[str]) -> tuple[str, ...]:
    """Return the columns beyond the paper's that any of these methods needs."""
    found = [METHODS[name].columns for name in methods if name in METHODS]
    return tuple(dict.fromkeys(column for columns in found for column in columns))


def trained_baselines(models: Path) -> list[str]:
    """Return the methods of one network whose model is in the folder, in the registry's order."""
    return [name for name in BASELINES if (models / f"{name}.safetensors").is_file()]
