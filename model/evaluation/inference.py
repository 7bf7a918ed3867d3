"""Inference: load trained networks and predict a view by a method.

Commands, evaluation and studies all load and run networks through this module. Images may have any
size.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import nn

from model.data.encoding import (
    Tensors,
    color_exposure,
    encode,
    encode_reflectance,
    neutral_background,
    to_batch,
    to_image,
)
from model.data.reader import Example
from model.evaluation.product import linear_product, product, product_linear
from model.methods import BASELINES, METHODS
from model.networks.tiles import margin, tiled
from model.training.store import ModelCard, load_model
from pipeline.params import ToneParams
from pipeline.tonemap import Exposure, exposure_of, tonemap, untonemap
from scenes.arrays import AnyArray
from scenes.errors import InputError

PRODUCTS = {"product": product, "product_linear": product_linear}
PREDICTABLE = ("pbrnet", *PRODUCTS, *BASELINES)
_WHITE = 1 - 1e-6  # sRGB of 1 is a little less in float32
_PREFERRED = ("pbrnet", "plus", *BASELINES, "product")  # where no method is named


@dataclass(frozen=True)
class Prediction:
    """A method's picture: display values, float32 (H, W, 3), [0, 1]."""

    method: str
    shading: AnyArray | None  # None of methods that go straight to colour
    color: AnyArray
    linear: tuple[AnyArray, AnyArray] | None = (
        None  # shading and colour of methods that predict radiance
    )


@dataclass(frozen=True)
class Radiance:
    """Linear HDR of a prediction, float32 (H, W, 3); see docs/use.md."""

    color: AnyArray
    shading: AnyArray | None
    clipped: AnyArray  # bool (H, W): where a band of what was inverted is at white; a lower bound
    exposure: Exposure  # that colour was taken to have
    known: bool  # whether it is the true one, so that the unit is the scene's


@dataclass(frozen=True)
class Networks:
    """Loaded networks of some methods; `tile` > 0 computes large images in tiles of that size."""

    methods: tuple[str, ...]  # of `PREDICTABLE`; all show their colours as the first does
    modules: dict[str, nn.Module]  # by their names in the registry
    cards: dict[str, ModelCard]  # of the same names
    tile: int = 0

    @property
    def card(self) -> ModelCard:
        """Of the network that makes the first method's colour, or a product's shading."""
        return self.cards[needed(self.methods[0])[-1]]

    @property
    def two_stage(self) -> bool:
        """True if the shading network, the paper's first stage, is loaded."""
        return "shading" in self.modules

    @property
    def baselines(self) -> list[str]:
        """The methods that are one network of their own."""
        return [method for method in self.methods if method in BASELINES]

    def shading(self, example: Example) -> AnyArray:
        """Shading of a view predicted by the shading network, display values float32 (H, W, 3)."""
        return to_image(self._run("shading", self.modules["shading"], encode([example])))

    def predict(self, method: str, example: Example, shading: AnyArray | None = None) -> Prediction:
        """A view by a method; its truth is not looked at, but for its exposure.

        `shading`: what a method of two steps goes on from, if not from the shading network.
        """
        if method in BASELINES:
            return self._directly(method, example)
        if shading is None:
            shading = self.shading(example)
        if method in PRODUCTS:
            given = neutral_background(example, self.card.albedo)
            color = PRODUCTS[method](given, shading, example.exposure_shading, self.card)
            return Prediction(method, shading, color)
        network = self.modules["composition"]
        composed = self._run(
            "composition",
            lambda given: network(given["shading"], given["reflectance"]),
            {"shading": to_batch(shading), "reflectance": encode_reflectance([example])},
        )
        return Prediction(method, shading, to_image(composed))

    def radiance(self, example: Example, made: Prediction) -> Radiance:
        """Undo the tone mapping of a prediction of the example.

        A product is linear before it is displayed, so only its shading is inverted. The exposure
        is the example's: the true one if its truth is known; else scale 1 and training's median
        white.
        """
        color_by = color_exposure(example, self.card.exposure)
        known = bool(example.color.any())
        if made.linear is not None:
            light, color = made.linear
            nowhere = np.zeros(color.shape[:2], bool)
            return Radiance(color, light, nowhere, color_by, known=True)
        display = made.color
        shading: AnyArray | None = None
        if made.shading is not None:
            shading = untonemap(made.shading, example.exposure_shading)
        if made.method in PRODUCTS and made.shading is not None:
            given = neutral_background(example, self.card.albedo)
            display = made.shading
            color = linear_product(given, display, example.exposure_shading, self.card)
            color_by = example.exposure_shading
        else:
            color = untonemap(display, color_by)
        clipped = np.any(display >= _WHITE, axis=-1)
        return Radiance(color.astype(np.float32), shading, clipped, color_by, known)

    def _directly(self, name: str, example: Example) -> Prediction:
        """By one network: colour, or shading and colour, as display values or as radiance."""
        how, network = METHODS[name], self.modules[name]
        if how.uses_direct_light:
            example = in_the_light_of_training(example, self.cards[name])
        inputs = encode([example], how.uses_direct_light, how.uses_noisy_samples)
        if not how.predicts_shading:
            return Prediction(name, None, to_image(self._run(name, network, inputs)))
        parts: Callable[..., tuple[torch.Tensor, ...]] = network.parts  # type: ignore[assignment]
        both = self._run(name, lambda given: torch.cat(parts(given), dim=1), inputs)
        if how.uses_noisy_samples:
            pixels = both[0].permute(1, 2, 0).cpu().numpy()
            return self._displayed(name, example, pixels[..., :3].copy(), pixels[..., 3:].copy())
        return Prediction(name, to_image(both[:, :3]), to_image(both[:, 3:]))

    def _displayed(
        self, name: str, example: Example, shading: AnyArray, color: AnyArray
    ) -> Prediction:
        """Radiance, displayed as the truth is, or by its own log average if that is not known."""
        if not example.color.any():
            tone = ToneParams(**self.card.tone)
            own = [exposure_of(image, tone) for image in (shading, color)]
            example = replace(example, exposure_shading=own[0], exposure_color=own[1])
        display = tonemap(color, color_exposure(example, self.card.exposure))
        light = tonemap(shading, example.exposure_shading)
        return Prediction(name, light, display, (shading, color))

    @torch.no_grad()
    def _run(
        self, name: str, call: Callable[[Tensors], torch.Tensor], inputs: Tensors
    ) -> torch.Tensor:
        return tiled(call, self.cards[name].architecture, inputs, self.tile)


def in_the_light_of_training(example: Example, card: ModelCard) -> Example:
    """The view with shadows if the network was trained with them, without if not.

    Raises `InputError` where they are missing.
    """
    if not card.training.get("shadows"):
        return replace(example, visibility=None)
    if example.visibility is None:
        raise InputError(
            f"{example.name}: comes without the shadows of its lights, which the network takes; "
            "set illumination.shadow_rays to 8, then run: pbrnet illumination"
        )
    return example


def needed(method: str) -> tuple[str, ...]:
    """Return the names of a method's networks; the last one predicts its picture."""
    if method in PRODUCTS:
        return ("shading",)
    return ("shading", "composition") if method == "pbrnet" else (method,)


def available(models: Path) -> list[str]:
    """Return the methods whose networks are all in the folder, the preferred one first."""
    return [
        method
        for method in dict.fromkeys((*_PREFERRED, *PREDICTABLE))
        if all((models / f"{name}.safetensors").is_file() for name in needed(method))
    ]


def load_networks(models: Path, methods: Sequence[str] = ("pbrnet",), tile: int = 0) -> Networks:
    """Load the networks of these methods, and no others.

    Raises `InputError` if a network is missing or damaged, if the composition network was trained
    on another shading network, if the methods' colours are of different exposure policies, or if
    `tile` is asked of a network that cannot be cut.
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
            "one beside it; train it again with: pbrnet train composition"
        )
    first, *others = dict.fromkeys(needed(method)[-1] for method in methods)
    card = cards[first]
    for name in others:
        other = cards[name]
        if (other.exposure, other.tone) != (card.exposure, card.tone):
            raise InputError(
                f"{models}/{name}.safetensors and {first}.safetensors show their colours "
                f"differently ({other.exposure} exposure, {other.tone}; {card.exposure} exposure, "
                f"{card.tone}); train both with the same parameters"
            )
    return Networks(tuple(methods), modules, cards, tile)
