"""One method, loaded with the networks that it needs and no others, at any image size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import nn

from model.baselines.product import linear_product, product, product_linear
from model.data import Array, Example
from model.encoding import Tensors, color_exposure, encode, see_through, to_image
from model.hybrid import HybridNet
from model.inference import refuse_strangers
from model.methods import BASELINES, METHODS
from model.plus import PlusNet
from model.store import ModelCard, load_model
from model.tiles import margin, tiled
from pipeline.params import ToneParams
from pipeline.tonemap import Exposure, exposure_of, tonemap, untonemap

PRODUCTS = {"product": product, "product_linear": product_linear}
PREDICTABLE = ("pbrnet", *PRODUCTS, *BASELINES)
_WHITE = 1 - 1e-6  # sRGB of 1 is a little less in float32
_PREFERRED = ("pbrnet", "plus", *BASELINES, "product")  # where no method is named


@dataclass(frozen=True)
class Prediction:
    """Display values, float32 (H, W, 3), [0, 1]."""

    shading: Array | None  # None of methods that go straight to colour
    color: Array
    linear: tuple[Array, Array] | None = None  # shading and colour of methods that predict radiance


@dataclass(frozen=True)
class Radiance:
    """Linear HDR of a prediction, float32 (H, W, 3); see docs/use.md."""

    color: Array
    shading: Array | None
    clipped: Array  # bool (H, W): where a band of what was inverted is at white; a lower bound
    exposure: Exposure  # that colour was taken to have
    known: bool  # whether it is the true one, so that the unit is the scene's


@dataclass(frozen=True)
class Predictor:
    """A method with its networks; `tile` > 0 computes large images in pieces of that size."""

    method: str
    networks: dict[str, nn.Module]
    cards: dict[str, ModelCard]  # of the same names
    tile: int = 0

    @property
    def card(self) -> ModelCard:
        """The card of the network that makes the colour, or of the shading for a product."""
        return self.cards[needed(self.method)[-1]]

    @torch.no_grad()
    def predict(self, example: Example) -> Prediction:
        """Shading, if the method has any, and colour of a view; its truth is not looked at."""
        if isinstance(self.networks.get(self.method), HybridNet):
            return self._gathered(example)
        inputs = encode([example], self.method in METHODS and METHODS[self.method].direct)
        if "shading" not in self.networks:
            return self._directly(inputs)
        shading = self._run("shading", self.networks["shading"], inputs)
        display = to_image(shading)
        if self.method in PRODUCTS:
            given = see_through(example, self.card.albedo)
            color = PRODUCTS[self.method](given, display, example.exposure_shading, self.card)
            return Prediction(display, color)
        composition = self.networks["composition"]
        fed = {"shading": shading.float().clamp(0, 1), "reflectance": inputs["reflectance"]}
        composed = self._run(
            "composition", lambda given: composition(given["shading"], given["reflectance"]), fed
        )
        return Prediction(display, to_image(composed))

    def radiance(self, example: Example, prediction: Prediction) -> Radiance:
        """Undo the tone mapping of a prediction.

        A product is linear before it is displayed, so only its shading is inverted. The exposure
        is the example's: the true one if its truth is known; else scale 1 and training's median
        white.
        """
        color_by = color_exposure(example, self.card.exposure)
        known = bool(example.color.any())
        if prediction.linear is not None:
            light, color = prediction.linear
            nowhere = np.zeros(color.shape[:2], bool)
            return Radiance(color, light, nowhere, color_by, known=True)
        display = prediction.color
        shading: Array | None = None
        if prediction.shading is not None:
            shading = untonemap(prediction.shading, example.exposure_shading)
        if self.method in PRODUCTS and prediction.shading is not None:
            given = see_through(example, self.card.albedo)
            display = prediction.shading
            color = linear_product(given, display, example.exposure_shading, self.card)
            color_by = example.exposure_shading
        else:
            color = untonemap(display, color_by)
        clipped = np.any(display >= _WHITE, axis=-1)
        return Radiance(color.astype(np.float32), shading, clipped, color_by, known)

    def _gathered(self, example: Example) -> Prediction:
        """Radiance from noisy samples, displayed as the truth is, or where that is not known by
        its own log average."""
        network = self.networks[self.method]
        assert isinstance(network, HybridNet)
        both = self._run(
            self.method,
            lambda given: torch.cat(network.parts(given), dim=1),
            encode([example], noisy=True),
        )
        pixels = both[0].permute(1, 2, 0).cpu().numpy()
        shading, color = pixels[..., :3].copy(), pixels[..., 3:].copy()
        if not example.color.any():
            tone = ToneParams(**self.card.tone)
            own = [exposure_of(image, tone) for image in (shading, color)]
            example = replace(example, exposure_shading=own[0], exposure_color=own[1])
        display = tonemap(color, color_exposure(example, self.card.exposure))
        return Prediction(tonemap(shading, example.exposure_shading), display, (shading, color))

    def _directly(self, inputs: Tensors) -> Prediction:
        network = self.networks[self.method]
        if not isinstance(network, PlusNet):
            return Prediction(None, to_image(self._run(self.method, network, inputs)))
        both = self._run(self.method, lambda given: torch.cat(network.parts(given), dim=1), inputs)
        return Prediction(to_image(both[:, :3]), to_image(both[:, 3:]))

    def _run(
        self, name: str, call: Callable[[Tensors], torch.Tensor], inputs: Tensors
    ) -> torch.Tensor:
        return tiled(call, self.cards[name].architecture, inputs, self.tile)


def needed(method: str) -> tuple[str, ...]:
    """The networks that a method is made of; the last makes its picture."""
    if method in PRODUCTS:
        return ("shading",)
    return ("shading", "composition") if method == "pbrnet" else (method,)


def available(models: Path) -> list[str]:
    """Methods whose networks all lie in the folder, the one to prefer first."""
    return [
        method
        for method in dict.fromkeys((*_PREFERRED, *PREDICTABLE))
        if all((models / f"{name}.safetensors").is_file() for name in needed(method))
    ]


def load_predictor(models: Path, method: str, tile: int = 0) -> Predictor:
    """Read the networks of a method.

    Raises `InputError` if one is missing or damaged, if the composition network was trained on
    another shading network, or if `tile` is asked of a network that cannot be cut.
    """
    networks, cards = {}, {}
    for name in needed(method):
        networks[name], cards[name] = load_model(models / f"{name}.safetensors")
        if tile:
            margin(cards[name].architecture)
    if method == "pbrnet":
        refuse_strangers(models, cards["shading"], cards["composition"])
    return Predictor(method, networks, cards, tile)
