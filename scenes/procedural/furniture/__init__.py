"""Procedural furniture and fittings.

`FURNITURE_KINDS["sofa"].make(draw, style, width=2.0)` returns a `FurniturePiece`; equal random
generators and styles give equal pieces. `make_style(draw)` draws the style that all pieces of a
home share. A new kind is a `Spec` in one of the modules, and its name below.
"""

from __future__ import annotations

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

_KINDS = {
    seating: "dining_chair armchair sofa stool office_chair pouf bench",
    tables: "dining_table round_table coffee_table side_table desk console_table",
    storage: (
        "bookshelf wardrobe built_in_wardrobe chest_of_drawers sideboard tv_stand "
        "night_table wall_shelf wall_board rack shoe_rack"
    ),
    beds: "double_bed single_bed",
    kitchen: (
        "base_cupboard drawer_unit sink_unit hob_unit fridge wall_cupboard extractor_hood "
        "kettle cooking_pot microwave"
    ),
    bathroom: (
        "bath_tub wash_basin toilet shower mirror_cabinet towel_rail washing_machine toiletries"
    ),
    lamps: (
        "pendant_lamp ceiling_lamp spot_rail floor_lamp table_lamp desk_lamp wall_lamp light_strip"
    ),
    textiles: "curtains rug cushion folded_blanket",
    plants: "plant small_plant",
    decoration: (
        "vase picture wall_mirror floor_mirror television monitor "
        "laptop books_stack fruit_bowl crockery bottle candle wall_clock radiator "
        "coat_hooks storage_box waste_bin"
    ),
}
FURNITURE_KINDS: dict[str, type[Spec]] = {
    name: getattr(module, name.title().replace("_", ""))
    for module, names in _KINDS.items()
    for name in names.split()
}
