"""From a view to a picture through trained networks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import nn

from model.data import Array, Example
from model.encoding import color_exposure, encode, to_image
from model.methods import METHODS
from model.store import ModelCard, load_model
from pipeline.tonemap import Exposure, tonemap
from scenes.errors import InputError


@dataclass(frozen=True)
class Networks:
    """The two-stage network, and the baselines that were asked for."""

    shading: nn.Module
    composition: nn.Module
    baselines: dict[str, nn.Module]  # by their names in the registry
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
    def predict_directly(self, name: str, example: Example) -> Array:
        """Display values float32 (H, W, 3) of colour, by another method of the registry.

        Radiance is displayed as the example's true colour is.
        """
        if METHODS[name].noisy:
            color = self.predict_radiance(name, example)[1]
            return tonemap(color, color_exposure(example, self.card.exposure))
        return to_image(self.baselines[name](encode([example], METHODS[name].direct)))

    @torch.no_grad()
    def predict_radiance(self, name: str, example: Example) -> tuple[Array, Array]:
        """Linear shading and colour, float32 (H, W, 3), by a method that takes noisy samples."""
        parts = self.baselines[name].parts(encode([example], noisy=True))  # type: ignore[operator]
        shading, color = (part[0].permute(1, 2, 0).cpu().numpy() for part in parts)
        return shading, color


def load_networks(models: Path, baselines: Sequence[str] = ()) -> Networks:
    """Read the trained networks, and these baselines.

    Raises `InputError` if one is missing, if the composition network was trained on another
    shading network, or if their colours are of different exposure policies.
    """
    shading, shading_card = load_model(models / "shading.safetensors")
    composition, card = load_model(models / "composition.safetensors")
    refuse_strangers(models, shading_card, card)
    cards = {"shading": shading_card, "composition": card}
    others = {}
    for name in baselines:
        others[name], cards[name] = load_model(models / f"{name}.safetensors")
    for name, other in cards.items():
        if (other.exposure, other.tone) != (card.exposure, card.tone):
            raise InputError(
                f"{models}/{name}.safetensors and composition.safetensors show their colours "
                f"differently ({other.exposure} exposure, {other.tone}; {card.exposure} exposure, "
                f"{card.tone}); train both with the same parameters"
            )
    return Networks(shading, composition, others, cards)


def refuse_strangers(models: Path, shading: ModelCard, composition: ModelCard) -> None:
    """Raise `InputError` unless the composition network was trained on this shading network."""
    if composition.needs.get("shading") != shading.sha256:
        raise InputError(
            f"{models}/composition.safetensors was trained on another shading network than the "
            "one beside it; train it again with: pbrnet train composition"
        )


def likely_exposure(card: ModelCard) -> Exposure:
    """For a shading without known exposure: its scale cancels, its white is training's median."""
    return Exposure(1.0, card.white)
