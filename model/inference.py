"""From a view to a picture through trained networks, and the plain product beside them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import nn

from model.data import Array, Example
from model.encoding import encode, see_through, to_image
from model.store import ModelCard, load_model
from pipeline.params import ToneParams
from pipeline.tonemap import Exposure, exposure_of, tonemap, untonemap
from scenes.errors import InputError


@dataclass(frozen=True)
class Networks:
    """The two-stage network, and the direct U-Net where it has been trained."""

    shading: nn.Module
    composition: nn.Module
    unet: nn.Module | None
    cards: dict[str, ModelCard]

    @property
    def card(self) -> ModelCard:
        """The composition network's card, which speaks for the pair."""
        return self.cards["composition"]

    @torch.no_grad()
    def predict_shading(self, example: Example) -> Array:
        """Display values float32 (H, W, 3)."""
        return to_image(self.shading(encode([example])))

    @torch.no_grad()
    def predict_color(self, example: Example, shading: Array) -> Array:
        """Display values float32 (H, W, 3), from `predict_shading`'s result."""
        batch = torch.from_numpy(shading.transpose(2, 0, 1).copy())[None]
        return to_image(self.composition(batch, encode([example])["reflectance"]))

    @torch.no_grad()
    def predict_directly(self, example: Example) -> Array:
        """Display values float32 (H, W, 3) of the direct U-Net."""
        if self.unet is None:
            raise InputError("models/unet.safetensors: no such model; pbrnet train unet makes it")
        return to_image(self.unet(encode([example])))


def load_networks(models: Path) -> Networks:
    """Read the trained networks; refuses a composition network trained on another shading one."""
    shading, shading_card = load_model(models / "shading.safetensors")
    composition, card = load_model(models / "composition.safetensors")
    if card.needs.get("shading") != shading_card.sha256:
        raise InputError(
            f"{models}/composition.safetensors was trained on another shading network than the "
            "one beside it; train it again with: pbrnet train composition"
        )
    cards = {"shading": shading_card, "composition": card}
    unet = None
    if (models / "unet.safetensors").is_file():
        unet, cards["unet"] = load_model(models / "unet.safetensors")
    for name, other in cards.items():
        if (other.exposure, other.tone) != (card.exposure, card.tone):
            raise InputError(
                f"{models}/{name}.safetensors and composition.safetensors show their colours "
                f"differently ({other.exposure} exposure, {other.tone}; {card.exposure} exposure, "
                f"{card.tone}); train both with the same parameters"
            )
    return Networks(shading, composition, unet, cards)


def product(example: Example, shading: Array, exposure: Exposure, card: ModelCard) -> Array:
    """A view's reflectance x shading, display values float32 (H, W, 3).

    `shading` holds display values of exposure `exposure`; a surface of reflectance `card.albedo`
    would look just so, hence the division. Under the policy `own` the product, like any image
    then, is exposed by its own log average.
    """
    reflectance = see_through(example, card.albedo)
    linear = untonemap(shading, exposure) * (reflectance / card.albedo)
    return tonemap(linear, product_exposure(linear, exposure, card))


def product_exposure(linear: Array, shading: Exposure, card: ModelCard) -> Exposure:
    """The exposure of a linear product under the card's policy."""
    if card.exposure == "shared":
        return shading
    return exposure_of(np.asarray(linear), ToneParams(**card.tone))


def likely_exposure(card: ModelCard) -> Exposure:
    """For a shading without known exposure: its scale cancels, its white is training's median."""
    return Exposure(1.0, card.white)
