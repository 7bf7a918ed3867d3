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
from pbrnet.scenes.procedural.furniture.style import Style
from pbrnet.scenes.procedural.furniture.things import ornaments, packages, soft, vessels
from pbrnet.scenes.procedural.furniture.things.thing import Thing
from pbrnet.scenes.procedural.piece import Anchor, FurniturePiece
from pbrnet.scenes.seeds import Draw

_MODULES = {"ornaments": ornaments, "packages": packages, "soft": soft, "vessels": vessels}


@dataclass(frozen=True)
class Kind:
    """A kind of thing: `draw(draw, style)` specifies one; `places` are names of places for it."""

    name: str
    places: tuple[str, ...]
    draw: Callable[..., Thing]
    category: str
    anchor: Anchor

    def make(self, draw: Draw, style: Style, **given: Any) -> FurniturePiece:
        """Draw a specification and build it."""
        return self.draw(draw, style, **given).build()


def _kind(title: str, places: str, make: str, **row: Any) -> Kind:
    """A kind of the table; `ParameterError` names one whose specification is not of its options."""
    module, _, name = make.partition(".")
    spec = getattr(_MODULES.get(module), name.title().replace("_", ""), None)
    if not (isinstance(spec, type) and issubclass(spec, Thing)):
        raise ParameterError(f"{title}: there is no specification {make!r}")
    options: dict[str, Any] = {"name": title}
    options |= {key: tuple(each) if isinstance(each, list) else each for key, each in row.items()}
    known = {each.name: each.metadata.get("how", each.default) for each in fields(spec)}
    needed = {key for key, how in known.items() if how is MISSING} - {"style"}
    if wrong := (options.keys() - known) | (needed - options.keys()):
        raise ParameterError(f"{title}: {make}: unknown or missing: {', '.join(sorted(wrong))}")
    category, anchor = (row.get(key, getattr(spec.piece, key)) for key in ("category", "anchor"))
    draw = partial(spec.draw, **options)
    return Kind(title.replace(" ", "_"), tuple(places.split()), draw, category, anchor)


_KINDS = [_kind(title, **entry) for title, entry in data_beside(__file__).items()]
THINGS: dict[str, Kind] = {kind.name: kind for kind in _KINDS}
BY_PLACE: dict[str, tuple[str, ...]] = {
    place: tuple(kind.name for kind in _KINDS if place in kind.places)
    for place in sorted({place for kind in _KINDS for place in kind.places})
}
