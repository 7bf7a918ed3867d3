"""Looks of generated homes: names of lights, styles and aspects, and the parameters they need."""

from __future__ import annotations

from typing import Literal, Protocol, get_args

LightSetting = Literal["day", "evening", "night", "mixed", "pbrs"]
Aspect = Literal["finishes", "furniture", "light", "outdoors"]
StyleName = Literal[
    "scandinavian", "mid-century", "industrial", "farmhouse", "classic", "minimal", "bohemian",
    "seventies", "japandi", "eclectic",
]  # fmt: skip
STYLES: tuple[StyleName, ...] = get_args(StyleName)


class LookParams(Protocol):
    """Parameters of looks that the generator reads, fields of `SceneParams`."""

    @property
    def vary(self) -> tuple[Aspect, ...]:
        """Aspects that are drawn anew for a variant."""

    @property
    def outdoors(self) -> str:
        """The surroundings of the home, "none" without any."""

    @property
    def styles(self) -> tuple[StyleName, ...]:
        """Interior styles that one is drawn from."""

    @property
    def texture_size(self) -> int:
        """Pixels per side of a texture."""

    @property
    def catalogue_share(self) -> float:
        """Probability that a piece comes from the catalogues."""

    @property
    def catalogue_triangles(self) -> int:
        """Most triangles of a catalogue piece."""


class HomeParams(LookParams, Protocol):
    """All parameters that the generator reads, fields of `SceneParams`."""

    @property
    def rooms_min(self) -> int:
        """Least number of rooms."""

    @property
    def rooms_max(self) -> int:
        """Greatest number of rooms."""
