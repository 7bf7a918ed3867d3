"""Looks of generated homes: names of lights, styles and aspects, and what determines a home."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, get_args

from pbrnet.scenes.checked import OPTIONAL
from pbrnet.scenes.seeds import Draw, generator

LightSetting = Literal["day", "evening", "night", "mixed", "pbrs"]
Aspect = Literal["finishes", "furniture", "light", "outdoors"]
StyleName = Literal[
    "scandinavian", "mid-century", "industrial", "farmhouse", "classic", "minimal", "bohemian",
    "seventies", "japandi", "eclectic",
]  # fmt: skip
STYLES: tuple[StyleName, ...] = get_args(StyleName)


@dataclass(frozen=True)
class HomeSettings:
    """All that determines a home but its id and catalogues: what its fingerprint is of.

    `rooms` are the least and the greatest number, `varied` the number of a variant and the aspects
    that are drawn anew for it. A `share` of the furniture comes from catalogues, whose index has
    the digest `catalogue`, in pieces of at most so many `triangles`.
    """

    seed: int
    lighting: LightSetting
    rooms: tuple[int, int] = (1, 6)
    styles: tuple[StyleName, ...] = STYLES
    texture_size: int = 256
    varied: tuple[()] | tuple[int, *tuple[Aspect, ...]] = ()
    share: float = field(default=0.0, metadata=OPTIONAL)
    triangles: int = field(default=0, metadata=OPTIONAL)
    catalogue: str = field(default="", metadata=OPTIONAL)
    outdoors: str = field(default="surroundings", metadata=OPTIONAL)

    def draw(self, aspect: Aspect, *names: str) -> Draw:
        """The generator for the purpose that `names` state, which belongs to an aspect."""
        return self.named(aspect in self.varied, *names)

    def named(self, varies: bool, *names: str) -> Draw:
        """The generator for the purpose that `names` state; of the variant, if that `varies`."""
        return generator(self.seed, *names, *(("variant", *self.varied[:1]) if varies else ()))
