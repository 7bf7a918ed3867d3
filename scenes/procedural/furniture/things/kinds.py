"""Kinds of things that people leave in rooms, and the places where they are left.

`THINGS["mug"].make(draw, style)` returns a small `FurniturePiece`. The kinds are in `kinds.yaml`.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from pbrnet.scenes.errors import ParameterError
from pbrnet.scenes.files import data_beside
from pbrnet.scenes.procedural.furniture.parts.build import Assembler
from pbrnet.scenes.procedural.furniture.things import ornaments, packages, sets, soft, vessels
from pbrnet.scenes.procedural.piece import Anchor, FurniturePiece

_MODULES = {"ornaments": ornaments, "packages": packages, "sets": sets, "soft": soft}
_MODULES["vessels"] = vessels
_OF_ALL = ("name", "category", "anchor")  # options of every generator


@dataclass(frozen=True)
class Thing:
    """A kind of thing: `make(draw, style)` builds one; `places` are names of places for it."""

    name: str
    places: tuple[str, ...]
    make: Callable[..., FurniturePiece]
    category: str
    anchor: Anchor


def _thing(title: str, places: str, make: str, **options: Any) -> Thing:
    """A kind of the table; `ParameterError` names one whose generator does not take its options."""
    module, _, generator = make.partition(".")
    assembler = getattr(_MODULES.get(module), generator, None)
    if not isinstance(assembler, Assembler):
        raise ParameterError(f"{title}: there is no generator {make!r}")
    options = {"name": title} | options
    own = {key: value for key, value in options.items() if key not in _OF_ALL}
    try:
        inspect.signature(assembler.add).bind(None, None, None, **own)
    except TypeError as error:
        raise ParameterError(f"{title}: {make}: {error}") from None
    category = options.get("category", assembler.category)
    maker = partial(assembler, **options)
    anchor = options.get("anchor", assembler.anchor)
    return Thing(title.replace(" ", "_"), tuple(places.split()), maker, category, anchor)


_KINDS = [_thing(title, **entry) for title, entry in data_beside(__file__).items()]
THINGS: dict[str, Thing] = {thing.name: thing for thing in _KINDS}
BY_PLACE: dict[str, tuple[str, ...]] = {
    place: tuple(thing.name for thing in _KINDS if place in thing.places)
    for place in sorted({place for thing in _KINDS for place in thing.places})
}
