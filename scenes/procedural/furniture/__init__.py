"""Procedural furniture and fittings.

`FURNITURE_KINDS["sofa"].make(rng, style, width=2.0)` returns a `FurniturePiece`; equal random
generators and styles give equal pieces. `make_style(rng)` draws the style that all pieces of a
home share.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from pbrnet.scenes.procedural.furniture import (
    bathroom,
    beds,
    decoration,
    kitchen,
    lamps,
    seating,
    storage,
    tables,
    textiles,
)
from pbrnet.scenes.procedural.furniture.style import Style, make_style
from pbrnet.scenes.procedural.piece import FurniturePiece

__all__ = ["FurnitureKind", "Style", "catalogue", "make_style"]

ROOMS = ("living", "bedroom", "kitchen", "bathroom", "study", "dining", "other")
DRY = ("living", "bedroom", "study", "dining", "other")


@dataclass(frozen=True)
class FurnitureKind:
    """A kind of furniture: `make(rng, style, **size options)` builds a piece, sizes in metres.

    `rooms` are the room types where it usually occurs.
    """

    name: str
    category: str
    rooms: tuple[str, ...]
    make: Callable[..., FurniturePiece]


_KINDS = (
    FurnitureKind("dining_chair", "seating", ("dining", "kitchen", "living"), seating.dining_chair),
    FurnitureKind("armchair", "seating", ("living", "bedroom", "study"), seating.armchair),
    FurnitureKind("sofa", "seating", ("living",), seating.sofa),
    FurnitureKind("stool", "seating", ("kitchen", "bathroom", "bedroom"), seating.stool),
    FurnitureKind("office_chair", "seating", ("study",), seating.office_chair),
    FurnitureKind("pouf", "seating", ("living", "bedroom"), seating.pouf),
    FurnitureKind("bench", "seating", ("dining", "bedroom", "other"), seating.bench),
    FurnitureKind("dining_table", "table", ("dining", "kitchen", "living"), tables.dining_table),
    FurnitureKind("round_table", "table", ("dining", "kitchen"), tables.round_table),
    FurnitureKind("coffee_table", "table", ("living",), tables.coffee_table),
    FurnitureKind("side_table", "table", ("living", "bedroom"), tables.side_table),
    FurnitureKind("desk", "table", ("study", "bedroom"), tables.desk),
    FurnitureKind("console_table", "table", ("other", "living", "dining"), tables.console_table),
    FurnitureKind("bookshelf", "storage", ("living", "study", "bedroom"), storage.bookshelf),
    FurnitureKind("wardrobe", "storage", ("bedroom",), storage.wardrobe),
    FurnitureKind("built_in_wardrobe", "storage", ("bedroom",), storage.built_in_wardrobe),
    FurnitureKind("chest_of_drawers", "storage", ("bedroom", "other"), storage.chest_of_drawers),
    FurnitureKind("sideboard", "storage", ("dining", "living"), storage.sideboard),
    FurnitureKind("tv_stand", "storage", ("living",), storage.tv_stand),
    FurnitureKind("night_table", "storage", ("bedroom",), storage.night_table),
    FurnitureKind("wall_shelf", "storage", DRY, storage.wall_shelf),
    FurnitureKind("wall_board", "storage", ("bathroom", "kitchen"), storage.wall_board),
    FurnitureKind("rack", "storage", ("bathroom", "kitchen", "study"), storage.rack),
    FurnitureKind("shoe_rack", "storage", ("other", "bedroom"), storage.shoe_rack),
    FurnitureKind("double_bed", "bed", ("bedroom",), beds.double_bed),
    FurnitureKind("single_bed", "bed", ("bedroom",), beds.single_bed),
    FurnitureKind("base_cupboard", "kitchen", ("kitchen",), kitchen.base_cupboard),
    FurnitureKind("drawer_unit", "kitchen", ("kitchen",), kitchen.drawer_unit),
    FurnitureKind("sink_unit", "kitchen", ("kitchen",), kitchen.sink_unit),
    FurnitureKind("hob_unit", "kitchen", ("kitchen",), kitchen.hob_unit),
    FurnitureKind("fridge", "kitchen", ("kitchen",), kitchen.fridge),
    FurnitureKind("wall_cupboard", "kitchen", ("kitchen",), kitchen.wall_cupboard),
    FurnitureKind("extractor_hood", "kitchen", ("kitchen",), kitchen.extractor_hood),
    FurnitureKind("kettle", "kitchen", ("kitchen",), kitchen.kettle),
    FurnitureKind("cooking_pot", "kitchen", ("kitchen",), kitchen.cooking_pot),
    FurnitureKind("microwave", "kitchen", ("kitchen",), kitchen.microwave),
    FurnitureKind("bath_tub", "bathroom", ("bathroom",), bathroom.bath_tub),
    FurnitureKind("wash_basin", "bathroom", ("bathroom",), bathroom.wash_basin),
    FurnitureKind("toilet", "bathroom", ("bathroom",), bathroom.toilet),
    FurnitureKind("shower", "bathroom", ("bathroom",), bathroom.shower),
    FurnitureKind("mirror_cabinet", "bathroom", ("bathroom",), bathroom.mirror_cabinet),
    FurnitureKind("towel_rail", "bathroom", ("bathroom",), bathroom.towel_rail),
    FurnitureKind("washing_machine", "bathroom", ("bathroom",), bathroom.washing_machine),
    FurnitureKind("toiletries", "bathroom", ("bathroom",), bathroom.toiletries),
    FurnitureKind("pendant_lamp", "lamp", ("dining", "kitchen", "living"), lamps.pendant_lamp),
    FurnitureKind("ceiling_lamp", "lamp", ROOMS, lamps.ceiling_lamp),
    FurnitureKind("spot_rail", "lamp", ("kitchen", "study", "other"), lamps.spot_rail),
    FurnitureKind("floor_lamp", "lamp", ("living", "bedroom", "study"), lamps.floor_lamp),
    FurnitureKind("table_lamp", "lamp", ("living", "bedroom"), lamps.table_lamp),
    FurnitureKind("desk_lamp", "lamp", ("study",), lamps.desk_lamp),
    FurnitureKind("wall_lamp", "lamp", ("living", "bedroom", "other"), lamps.wall_lamp),
    FurnitureKind("light_strip", "lamp", ("bathroom", "kitchen"), lamps.light_strip),
    FurnitureKind("curtains", "textile", DRY, textiles.curtains),
    FurnitureKind("rug", "textile", DRY, textiles.rug),
    FurnitureKind("cushion", "textile", ("living", "bedroom"), textiles.cushion),
    FurnitureKind("folded_blanket", "textile", ("living", "bedroom"), textiles.folded_blanket),
    FurnitureKind("plant", "decoration", ROOMS, decoration.plant),
    FurnitureKind("small_plant", "decoration", ROOMS, decoration.small_plant),
    FurnitureKind("vase", "decoration", DRY, decoration.vase),
    FurnitureKind("picture", "decoration", DRY, decoration.picture),
    FurnitureKind("wall_mirror", "decoration", ("other", "bedroom"), decoration.wall_mirror),
    FurnitureKind("floor_mirror", "decoration", ("bedroom", "other"), decoration.floor_mirror),
    FurnitureKind("television", "decoration", ("living",), decoration.television),
    FurnitureKind("monitor", "decoration", ("study",), decoration.monitor),
    FurnitureKind("laptop", "decoration", ("study", "living", "dining"), decoration.laptop),
    FurnitureKind("books_stack", "decoration", DRY, decoration.books_stack),
    FurnitureKind("fruit_bowl", "decoration", ("kitchen", "dining"), decoration.fruit_bowl),
    FurnitureKind("crockery", "decoration", ("kitchen", "dining"), decoration.crockery),
    FurnitureKind("bottle", "decoration", ("kitchen", "dining"), decoration.bottle),
    FurnitureKind("candle", "decoration", ("living", "dining", "bathroom"), decoration.candle),
    FurnitureKind("wall_clock", "decoration", ("kitchen", "study"), decoration.wall_clock),
    FurnitureKind("radiator", "decoration", ROOMS, decoration.radiator),
    FurnitureKind("coat_hooks", "decoration", ("other",), decoration.coat_hooks),
    FurnitureKind("storage_box", "decoration", ("bedroom", "study"), decoration.storage_box),
    FurnitureKind("waste_bin", "decoration", ("study", "bathroom"), decoration.waste_bin),
)  # fmt: skip
FURNITURE_KINDS: dict[str, FurnitureKind] = {kind.name: kind for kind in _KINDS}
