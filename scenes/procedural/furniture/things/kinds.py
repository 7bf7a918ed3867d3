"""Kinds of things that people leave in rooms, and the places where they are left.

`THINGS["mug"].make(draw, style)` returns a small `FurniturePiece`. The kinds are in `kinds.yaml`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, dataclass, fields
from functools import partial
from typing import Any

from pbrnet.scenes.errors import ParameterError
from pbrnet.scenes.files import data_beside
from pbrnet.scenes.procedural.furniture.things import ornaments, packages, soft, vessels
from pbrnet.scenes.procedural.furniture.things.thing import Thing
from pbrnet.scenes.procedural.piece import Anchor, FurniturePiece

_MODULES = {"ornaments": ornaments, "packages": packages, "soft": soft, "vessels": vessels}


@dataclass(frozen=True)
class Kind:
    """A kind of thing: `make(draw, style)` builds one; `places` are names of places for it."""

    name: str
    places: tuple[str, ...]
    make: Callable[..., FurniturePiece]
    category: str
    anchor: Anchor


def _kind(title: str, places: str, make: str, **row: Any) -> Kind:
    """A kind of the table; `ParameterError` names one whose specification is not of its options."""
    module, _, name = make.partition(".")
    spec = getattr(_MODULES.get(module), name.title().replace("_", ""), None)
    if not (isinstance(spec, type) and issubclass(spec, Thing)):
        raise ParameterError(f"{title}: there is no specification {make!r}")
    given = {"name": title} | row
    options = {key: tuple(each) if isinstance(each, list) else each for key, each in given.items()}
    known = {each.name: each for each in fields(spec)}
    needed = {key for key, each in known.items() if each.default is MISSING and not each.metadata}
    if wrong := (options.keys() - known) | (needed - {"style"} - options.keys()):
        raise ParameterError(f"{title}: {make}: unknown or missing: {', '.join(sorted(wrong))}")
    category, anchor = (row.get(key, getattr(spec.piece, key)) for key in ("category", "anchor"))
    return Kind(
        title.replace(" ", "_"),
        tuple(places.split()),
        partial(spec.make, **options),
        category,
        anchor,
    )


_KINDS = [_kind(title, **entry) for title, entry in data_beside(__file__).items()]
THINGS: dict[str, Kind] = {kind.name: kind for kind in _KINDS}
BY_PLACE: dict[str, tuple[str, ...]] = {
    place: tuple(kind.name for kind in _KINDS if place in kind.places)
    for place in sorted({place for kind in _KINDS for place in kind.places})
}
