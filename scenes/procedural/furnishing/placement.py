"""Rule-based furnishing of a home, room by room.

Every room is furnished in the same order: curtains and radiators, the furniture of its room type,
a ceiling lamp, small objects on window sills and on furniture. Pieces that find no valid pose are
left out; `RoomSpace` decides which poses are valid.
"""

from __future__ import annotations

from collections.abc import Callable

from pbrnet.scenes.procedural.furnishing.asset_sampler import AssetSampler
from pbrnet.scenes.procedural.furnishing.clutter import leave_things
from pbrnet.scenes.procedural.furnishing.drapery import drape_cloth
from pbrnet.scenes.procedural.furnishing.extras import add_catalogue_extras
from pbrnet.scenes.procedural.furnishing.furnisher import Furnisher
from pbrnet.scenes.procedural.furnishing.rooms.bathroom import furnish_bathroom
from pbrnet.scenes.procedural.furnishing.rooms.bedroom import furnish_bedroom
from pbrnet.scenes.procedural.furnishing.rooms.dining import furnish_dining
from pbrnet.scenes.procedural.furnishing.rooms.hall import furnish_hall
from pbrnet.scenes.procedural.furnishing.rooms.kitchen import furnish_kitchen
from pbrnet.scenes.procedural.furnishing.rooms.living import furnish_living
from pbrnet.scenes.procedural.furnishing.rooms.study import furnish_study
from pbrnet.scenes.procedural.furnishing.rooms.windows import fill_sills, furnish_windows
from pbrnet.scenes.procedural.furniture import Style
from pbrnet.scenes.procedural.piece import FurniturePiece
from pbrnet.scenes.procedural.plan import Plan
from pbrnet.scenes.procedural.scene_item import Pose, SceneItem
from pbrnet.scenes.seeds import Draw

_FURNISH_ROOM: dict[str, Callable[[Furnisher], None]] = {
    "living": furnish_living,
    "bedroom": furnish_bedroom,
    "kitchen": furnish_kitchen,
    "bathroom": furnish_bathroom,
    "study": furnish_study,
    "dining": furnish_dining,
    "hall": furnish_hall,
}


def furnish(
    rng: Draw, plan: Plan, style: Style, sampler: AssetSampler | None = None
) -> list[SceneItem]:
    """Furnish all rooms of a plan; with a `sampler`, some pieces come from catalogues."""
    items: list[SceneItem] = []
    plants: list[FurniturePiece] = []
    for room in plan.rooms:
        furnisher = Furnisher(rng, plan, room, style, plants, sampler)
        _furnish_room(furnisher)
        if sampler is not None:
            add_catalogue_extras(furnisher.space, sampler)
        for placed in furnisher.space.items:
            items += placed.scene_items(room.id)
    return items


def _furnish_room(furnisher: Furnisher) -> None:
    if furnisher.room.type not in ("kitchen", "bathroom"):
        furnish_windows(furnisher)
    _FURNISH_ROOM[furnisher.room.type](furnisher)
    _hang_ceiling_lamp(furnisher)
    drape_cloth(furnisher)
    fill_sills(furnisher)
    _place_small_objects(furnisher)
    leave_things(furnisher)


def _hang_ceiling_lamp(furnisher: Furnisher) -> None:
    """Hang a lamp from the ceiling, unless a small room already has a pendant lamp."""
    rng, space = furnisher.rng, furnisher.space
    hanging = any(item.kind == "pendant_lamp" for item in space.items)
    if hanging and furnisher.area < 16:
        return
    kinds = {
        "study": ["ceiling_lamp", "spot_rail"],
        "kitchen": ["ceiling_lamp", "spot_rail"],
        "living": ["ceiling_lamp", "pendant_lamp"],
        "bedroom": ["ceiling_lamp", "ceiling_lamp", "pendant_lamp"],
        "dining": ["ceiling_lamp", "pendant_lamp"],
        "bathroom": ["ceiling_lamp"],
        "hall": ["ceiling_lamp", "spot_rail"],
    }[furnisher.room.type]
    kind = rng.pick(kinds)
    lamp = (
        furnisher.make(kind, drop=min(0.5, furnisher.plan.height - 2.05))
        if kind == "pendant_lamp"
        else furnisher.make(kind)
    )
    middle = furnisher.space.middle()
    for attempt in range(12):
        x, y = middle + rng.normal(0, 0.05 + 0.1 * attempt, 2)
        pose = Pose(float(x), float(y), furnisher.plan.height, rng.pick([0.0, 90.0]))
        if space.try_place(kind, lamp, pose, zone=False, on_floor=False):
            return


def _place_small_objects(furnisher: Furnisher) -> None:
    """Place small objects on the support surfaces of the room's furniture."""
    rng = furnisher.rng
    # Kind of furniture -> kinds of objects, least and greatest number of attempts.
    wanted: dict[str, tuple[tuple[str, ...], int, int]] = {
        "coffee_table": (("books_stack", "vase", "candle", "fruit_bowl", "laptop"), 0, 2),
        "side_table": (("books_stack", "small_plant", "candle", "vase"), 0, 2),
        "night_table": (("books_stack", "small_plant", "candle"), 0, 1),
        "tv_stand": (("vase", "small_plant", "books_stack", "candle"), 0, 2),
        "desk": (("books_stack", "small_plant", "laptop", "vase"), 0, 2),
        "dining_table": (("fruit_bowl", "vase", "crockery", "candle", "bottle"), 0, 2),
        "sideboard": (("vase", "books_stack", "small_plant", "candle", "table_lamp"), 1, 3),
        "console_table": (("vase", "small_plant", "table_lamp", "books_stack"), 0, 2),
        "chest_of_drawers": (("table_lamp", "vase", "books_stack", "small_plant"), 0, 2),
        "base_cupboard": (("kettle", "microwave", "bottle", "fruit_bowl", "crockery"), 0, 1),
        "drawer_unit": (("kettle", "crockery", "cooking_pot", "small_plant"), 0, 1),
        "wash_basin": (("toiletries", "candle"), 0, 1),
        "washing_machine": (("toiletries", "storage_box", "small_plant"), 0, 1),
        "toilet": (("small_plant", "candle"), 0, 1),
        "bookshelf": (("small_plant", "storage_box", "vase", "laptop"), 0, 2),
        "wardrobe": (("storage_box",), 0, 1),
        "fridge": (("storage_box", "small_plant", "microwave"), 0, 1),
        "wall_shelf": (("small_plant", "books_stack", "vase", "candle"), 0, 2),
        "bath_tub": (("toiletries", "candle"), 0, 1),
        "niche": (("vase", "books_stack", "books_stack", "small_plant", "candle"), 3, 6),
    }
    for item in [*furnisher.space.items, *furnisher.space.niches]:
        if item.kind not in wanted or not item.piece.surfaces:
            continue
        kinds, low, high = wanted[item.kind]
        for _ in range(rng.whole(low, high + 1)):
            kind = rng.pick(kinds)
            # A niche was built for them.
            if item.kind != "niche" and not furnisher.may_leave(kind):
                continue
            yaw = rng.between(-25, 25)
            furnisher.space.on_top(rng, kind, furnisher.make(kind), item, yaw=yaw, tries=6)
