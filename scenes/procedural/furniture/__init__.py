"""Procedural furniture and fittings.

`FURNITURE_KINDS["sofa"].make(draw, style, width=2.0)` returns a `FurniturePiece`; equal random
generators and styles give equal pieces. `make_style(draw)` draws the style that all pieces of a
home share. A new kind is a `Spec` with a `piece` in one of the modules.
"""

from __future__ import annotations

import re

from pbrnet.scenes.procedural.furniture import (
    bathroom,
    beds,
    decoration,
    kitchen,
    lamps,
    plants,
    seating,
    storage,
    tables,
    textiles,
)
from pbrnet.scenes.procedural.furniture.spec import Spec
from pbrnet.scenes.procedural.furniture.style import Style, make_style

__all__ = ["FURNITURE_KINDS", "Style", "make_style"]

_MODULES = (seating, tables, storage, beds, kitchen, bathroom, lamps, textiles, plants, decoration)
FURNITURE_KINDS: dict[str, type[Spec]] = {  # "tv_stand": TvStand
    re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower(): kind
    for module in _MODULES
    for name, kind in vars(module).items()
    if isinstance(kind, type) and issubclass(kind, Spec) and kind.is_piece(module.__name__)
}
