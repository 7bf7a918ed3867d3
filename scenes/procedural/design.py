"""Design of a home: its plan, style and furniture, before it is lit and written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pbrnet.scenes.looks import Aspect, HomeParams, LookParams
from pbrnet.scenes.procedural.furnishing.asset_sampler import AssetSampler, load_kind_index
from pbrnet.scenes.procedural.furnishing.placement import PlacedInRoom, place_furniture
from pbrnet.scenes.procedural.furniture.style import Style, make_style
from pbrnet.scenes.procedural.plan import Plan
from pbrnet.scenes.procedural.planning import make_plan
from pbrnet.scenes.seeds import Draw, generator


@dataclass(frozen=True)
class HomeSeeds:
    """Random generators of a home's aspects, specific to the variant where the aspect varies."""

    seed: int
    variant: int = 0
    varied: frozenset[Aspect] = frozenset()

    def draw(self, aspect: Aspect, *names: str) -> Draw:
        """The generator for the purpose that `names` state, which belongs to an aspect."""
        return self.named(aspect in self.varied, *names)

    def named(self, varies: bool, *names: str) -> Draw:
        """The generator for the purpose that `names` state."""
        return generator(self.seed, *names, *(("variant", self.variant) if varies else ()))


@dataclass(frozen=True)
class Design:
    """Plan, style and placed furniture of a home."""

    plan: Plan
    style: Style
    furniture: Sequence[PlacedInRoom]


def design_home(params: HomeParams, seeds: HomeSeeds, assets: Path | None) -> Design:
    """Draw the plan of a home and furnish it; `assets` is the folder of converted catalogues."""
    plan = make_plan(generator(seeds.seed, "plan"), params.rooms_min, params.rooms_max)
    style = draw_style(params, seeds)
    sampler = catalogue_sampler(params, seeds, assets)
    placed = place_furniture(seeds.draw("furniture", "furniture"), plan, style, sampler)
    return Design(plan, style, placed)


def draw_style(params: LookParams, seeds: HomeSeeds) -> Style:
    """Draw the style, which changes with finishes and furniture, and its colours and materials."""
    name = seeds.named({"finishes", "furniture"} <= seeds.varied, "interior").pick(params.styles)
    return make_style(seeds.draw("finishes", "style"), name)


def catalogue_sampler(
    params: LookParams, seeds: HomeSeeds, assets: Path | None
) -> AssetSampler | None:
    """The sampler of catalogue pieces; None if the home takes none."""
    if params.catalogue_share <= 0 or assets is None:
        return None
    rng = seeds.draw("furniture", "catalogue")
    return AssetSampler(rng, load_kind_index(assets), params)
