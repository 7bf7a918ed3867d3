"""Interior styles: shapes, colours, materials and density that belong together.

An `Interior` holds what a style draws from; `make_style` and `make_finishes` draw one home from it.
Repeated entries are as much more probable. The styles are in `interiors.yaml`; what one leaves out
is as in "eclectic".
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from pbrnet.scenes.checked import build
from pbrnet.scenes.files import data_beside
from pbrnet.scenes.params import STYLES, StyleName

Front = Literal["flat", "framed"]
Handle = Literal["bar", "knob", "edge"]
Legs = Literal["square", "tapered", "round", "metal"]


@dataclass(frozen=True)
class Interior:
    """Choices of a style: sRGB colours "#rrggbb", families of surfaces, shares of homes."""

    woods: tuple[str, ...]
    wood_families: tuple[str, ...]
    dark_woods: tuple[str, ...]
    lacquers: tuple[str, ...]
    wooden_cabinets: float
    kitchens: tuple[str, ...]
    wooden_kitchens: float
    stones: tuple[str, ...]
    stone_families: tuple[str, ...]
    stone_worktops: float
    metals: tuple[tuple[str, float], ...]  # colour, roughness
    upholstery: tuple[str, ...]
    cloths: tuple[str, ...]
    leathers: tuple[str, ...]
    leather: float  # share of homes whose sofa is of leather
    accents: tuple[str, ...]  # five or more
    cushion_cloths: tuple[str, ...]
    beddings: tuple[str, ...]
    bedding_cloths: tuple[str, ...]
    throw_cloths: tuple[str, ...]
    curtains: tuple[str, ...]
    curtain_cloths: tuple[str, ...]
    sheer_curtains: float
    curtained: float  # share of rooms whose windows have curtains
    rugs: tuple[str, ...]
    rug_families: tuple[str, ...]
    shades: tuple[str, ...]
    kelvins: tuple[float, ...]
    fronts: tuple[Front, ...]
    handles: tuple[Handle, ...]
    legs: tuple[Legs, ...]
    # Variants that the style has of a piece's feature; all of them where the feature is missing.
    shapes: dict[str, tuple[str, ...]]
    density: float  # things and optional furniture, relative to "eclectic"
    disorder: tuple[float, float]
    # Measured reflectances of paint: about 0.8 for fresh white, 0.5 to 0.7 for tints.
    walls: tuple[str, ...]
    wall_families: tuple[str, ...]
    accent_walls: tuple[str, ...]
    accent: float  # share of rooms with an accent wall
    papers: tuple[str, ...]
    papered: float  # share of accent walls that are papered
    bare: Literal["", "brick", "concrete", "boards"]  # what other accent walls are made of
    floors: tuple[str, ...]
    floor_families: tuple[str, ...]
    carpets: tuple[str, ...]
    carpeted: float  # share of bedrooms and studies
    floor_tiles: tuple[str, ...]
    floor_tile_families: tuple[str, ...]
    wall_tiles: tuple[str, ...]
    wall_tile_families: tuple[str, ...]
    frames: tuple[str, ...]
    doors: tuple[str, ...]
    panels: tuple[Literal["flat", "two", "four"], ...]
    glazing_bars: float
    cornices: tuple[float, ...]  # metres
    skirting: tuple[float, float]  # least and greatest height, metres
    beams: tuple[Literal["wood", "dark", "paint", "steel"], ...]


def _read() -> Mapping[StyleName, Interior]:
    """Read the styles from their file; `ParameterError` names a wrong or missing key."""
    found = data_beside(__file__)
    common = found["eclectic"]
    return MappingProxyType({name: build(Interior, common | found[name], name) for name in STYLES})


INTERIORS = _read()
