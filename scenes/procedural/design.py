"""Design of a home: its plan, style and furniture, before it is lit and written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pbrnet.scenes.looks import HomeSettings
from pbrnet.scenes.procedural.furnishing.asset_sampler import AssetSampler, load_kind_index
from pbrnet.scenes.procedural.furnishing.placement import PlacedInRoom, place_furniture
from pbrnet.scenes.procedural.furniture.style import Style, make_style
from pbrnet.scenes.procedural.plan import Plan
from pbrnet.scenes.procedural.planning import make_plan
from pbrnet.scenes.seeds import generator


@dataclass(frozen=True)
class Design:
    """Plan, style and placed furniture of a home."""

    plan: Plan
    style: Style
    furniture: Sequence[PlacedInRoom]


def design_home(home: HomeSettings, assets: Path | None) -> Design:
    """Draw the plan of a home and furnish it; `assets` is the folder of converted catalogues."""
    plan = make_plan(generator(home.seed, "plan"), *home.rooms)
    style = draw_style(home)
    sampler = catalogue_sampler(home, assets)
    placed = place_furniture(home.draw("furniture", "furniture"), plan, style, sampler)
    return Design(plan, style, placed)


def draw_style(home: HomeSettings) -> Style:
    """Draw the style, which changes with finishes and furniture, and its colours and materials."""
    name = home.named({"finishes", "furniture"} <= {*home.varied}, "interior").pick(home.styles)
    return make_style(home.draw("finishes", "style"), name)


def catalogue_sampler(home: HomeSettings, assets: Path | None) -> AssetSampler | None:
    """The sampler of catalogue pieces; None if the home takes none."""
    if home.share <= 0 or assets is None:
        return None
    return AssetSampler(home.draw("furniture", "catalogue"), load_kind_index(assets), home)
