"""Inference: loading of trained networks and prediction of views.

Commands, evaluation and studies load and run all networks through this module. Images may have any
size.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import nn

from pbrnet.model.data.encoding import (
    Tensors,
    color_exposure,
    encode,
    input_named,
    neutral_background,
    shading_exposure,
    to_batch,
    to_image,
)
from pbrnet.model.data.reader import Example
from pbrnet.model.evaluation.product import linear_product, product, product_linear
from pbrnet.model.methods import BASELINES, METHODS, PREDICTABLE, PRODUCTS, Method
from pbrnet.model.networks.pbrnet import CompositionNet
from pbrnet.model.networks.tiles import margin, tiled
from pbrnet.model.training.store import ModelCard, load_model
from pbrnet.pipeline.tonemap import Exposure, ToneParams, exposure_of, tonemap, untonemap
from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.errors import InputError

_PRODUCTS = dict(zip(PRODUCTS, (product, product_linear), strict=True))
_WHITE = 1 - 1e-6  # in float32 the sRGB encoding of 1 is slightly less than 1
_PREFERRED = ("pbrnet", "plus", *BASELINES, "product")  # default method: the first available one


@dataclass(frozen=True)
class Prediction:
    """Predicted images of a view: display values, float32 (H, W, 3), [0, 1]."""

    method: str
    shading: AnyArray | None  # None for methods that predict colour only
    color: AnyArray
    linear: AnyArray | None = None  # linear colour, for methods that predict radiance


@dataclass(frozen=True)
class Radiance:
    """Linear radiance of a prediction, float32 (H, W, 3); see docs/use.md."""

    color: AnyArray
    shading: AnyArray | None
    clipped: AnyArray  # bool (H, W): a display band is white, so the radiance is a lower bound
    exposure: Exposure  # used to invert the tone mapping of colour
    known: bool  # whether it is the true exposure, so that the unit is that of the scene


@dataclass(frozen=True)
class Networks:
    """Loaded networks of some methods; `tile` > 0 is the tile size for large images."""

    methods: tuple[str, ...]  # of `PREDICTABLE`; all have one exposure policy and tone mapping
    modules: dict[str, nn.Module]  # by name in the registry
    cards: dict[str, ModelCard]  # by name in the registry
    tile: int = 0

    @property
    def card(self) -> ModelCard:
        """Card of the first method's last network, which predicts colour (products: shading)."""
        return self.cards[needed(self.methods[0])[-1]]

    @property
    def two_stage(self) -> bool:
        """True if the shading network, the first stage of the paper, is loaded."""
        return "shading" in self.modules

    @property
    def baselines(self) -> list[str]:
        """The methods that consist of a single network."""
        return [method for method in self.methods if method in BASELINES]

    def shading(self, example: Example) -> AnyArray:
        """Shading of a view by the shading network, display values float32 (H, W, 3)."""
        inputs = encode([example], self._inputs("shading"))
        return to_image(self._run("shading", self.modules["shading"], inputs))

    def predict(self, method: str, example: Example, shading: AnyArray | None = None) -> Prediction:
        """Predict a view. Of its true images only the exposure is used.

        `shading` replaces the prediction of the shading network in methods of two stages. Raises
        `InputError` if the view lacks an input of the method.
        """
        if method in BASELINES:
            return self._predict_baseline(method, example)
        if shading is None:
            shading = self.shading(example)
        if method in PRODUCTS:
            reflectance = neutral_background(example, self.card.albedo)
            exposure = shading_exposure(example, self.card.exposure)
            color = _PRODUCTS[method](reflectance, shading, exposure, self.card)
            return Prediction(method, shading, color)
        network = self.modules["composition"]
        assert isinstance(network, CompositionNet)
        (reflectance,) = encode([example], ("reflectance",)).values()
        images = network.images(to_batch(shading), reflectance)
        composed = self._run("composition", network, images)
        return Prediction(method, shading, to_image(composed))

    def radiance(self, example: Example, predicted: Prediction) -> Radiance:
        """Linear radiance of a prediction, by the inverse of its tone mapping.

        For a product only the shading is inverted, because the product is computed from linear
        values. The exposure is the true one if the example has its true images; otherwise it has
        scale 1 and the median white point of the training data.
        """
        exposure = color_exposure(example, self.card.exposure)
        known = bool(example["color"].any())
        if predicted.linear is not None:
            unclipped = np.zeros(predicted.linear.shape[:2], bool)
            return Radiance(predicted.linear, None, unclipped, exposure, known=True)
        display = predicted.color
        shading: AnyArray | None = None
        of_shading = shading_exposure(example, self.card.exposure)
        if predicted.shading is not None:
            shading = untonemap(predicted.shading, of_shading)
        if predicted.method in PRODUCTS and predicted.shading is not None:
            reflectance = neutral_background(example, self.card.albedo)
            display = predicted.shading
            color = linear_product(reflectance, display, of_shading, self.card)
            exposure = of_shading
        else:
            color = untonemap(display, exposure)
        clipped = np.any(display >= _WHITE, axis=-1)
        return Radiance(color.astype(np.float32), shading, clipped, exposure, known)

    def _predict_baseline(self, name: str, example: Example) -> Prediction:
        """Predict a view by a method of a single network."""
        method, network = METHODS[name], self.modules[name]
        example = as_trained(example, method, self.cards[name])
        found = self._run(name, network, encode([example], self._inputs(name)))
        if not method.predicts_radiance:
            return Prediction(name, None, to_image(found))
        color = np.ascontiguousarray(found[0].permute(1, 2, 0).cpu().numpy())
        return Prediction(name, None, self._displayed(example, color), color)

    def _inputs(self, name: str) -> tuple[str, ...]:
        return METHODS[name].inputs_with(self.cards[name].architecture.panorama)

    def _displayed(self, example: Example, color: AnyArray) -> AnyArray:
        """Display values of radiance, in the exposure of the truth, or in its own if unknown."""
        if example["color"].any():
            return tonemap(color, color_exposure(example, self.card.exposure))
        return tonemap(color, exposure_of(color, ToneParams(**self.card.tone)))

    @torch.no_grad()
    def _run(
        self, name: str, call: Callable[[Tensors], torch.Tensor], inputs: Tensors
    ) -> torch.Tensor:
        return tiled(call, self.cards[name].architecture, inputs, self.tile)


def as_trained(example: Example, method: Method, card: ModelCard) -> Example:
    """The view with the optional inputs that the network was trained with, and without the others.

    Raises `InputError` if one is required and missing.
    """
    for name in method.optional_inputs:
        columns = input_named(name).columns
        if not card.training.get(name):
            example = example.without(*columns)
        elif all(column in example for column in method.columns):
            for column in columns:
                example[column]  # raises
    return example


def needed(method: str) -> tuple[str, ...]:
    """Return the names of a method's networks, in the order in which they run."""
    if method in PRODUCTS:
        return ("shading",)
    return ("shading", "composition") if method == "pbrnet" else (method,)


def available(models: Path) -> list[str]:
    """Return the methods whose networks are all in the folder, the default one first."""
    return [
        method
        for method in dict.fromkeys((*_PREFERRED, *PREDICTABLE))
        if all((models / f"{name}.safetensors").is_file() for name in needed(method))
    ]


def load_networks(models: Path, methods: Sequence[str] = ("pbrnet",), tile: int = 0) -> Networks:
    """Load the networks of these methods.

    Raises `InputError` if a network is missing or damaged, if the composition network was trained
    on another shading network, if the methods differ in exposure policy or tone mapping, or if
    `tile` is given for a network that does not support tiles.
    """
    modules, cards = {}, {}
    for name in dict.fromkeys(name for method in methods for name in needed(method)):
        modules[name], cards[name] = load_model(models / f"{name}.safetensors")
        if tile:
            margin(cards[name].architecture)
    if (
        "composition" in cards
        and cards["composition"].needs.get("shading") != cards["shading"].sha256
    ):
        raise InputError(
            f"{models}/composition.safetensors was trained on another shading network than the "
            "one in this folder; train it again with: pbrnet train composition"
        )
    first, *others = dict.fromkeys(needed(method)[-1] for method in methods)
    card = cards[first]
    for name in others:
        other = cards[name]
        if (other.exposure, other.tone) != (card.exposure, card.tone):
            raise InputError(
                f"{models}/{name}.safetensors and {first}.safetensors differ in exposure or tone "
                f"mapping ({other.exposure} exposure, {other.tone}; {card.exposure} exposure, "
                f"{card.tone}); train both with the same parameters"
            )
    return Networks(tuple(methods), modules, cards, tile)
