"""Furnishing by rules: what goes into a room of each kind, and where.

Every room is filled in the same order: what belongs to its windows, the groups that make the
room what it is, lamps, further pieces along free walls, things on the walls, small things on
surfaces. A piece that finds no place is left out; rules of space are in `space`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from scenes.procedural.furnishing.asset_sampler import Shop
from scenes.procedural.furnishing.extras import furnish_further
from scenes.procedural.furnishing.furnisher import Furnisher
from scenes.procedural.furnishing.rooms.bathroom import furnish_bathroom
from scenes.procedural.furnishing.rooms.bedroom import furnish_bedroom
from scenes.procedural.furnishing.rooms.dining import furnish_dining
from scenes.procedural.furnishing.rooms.kitchen import furnish_kitchen
from scenes.procedural.furnishing.rooms.living import furnish_living
from scenes.procedural.furnishing.rooms.study import furnish_study
from scenes.procedural.furnishing.rooms.windows import dress_windows, fill_sills
from scenes.procedural.furniture import Style
from scenes.procedural.piece import Piece
from scenes.procedural.plan import Plan
from scenes.procedural.scene_item import Pose, Thing

_PROGRAMMES: dict[str, Callable[[Furnisher], None]] = {
    "living": furnish_living,
    "bedroom": furnish_bedroom,
    "kitchen": furnish_kitchen,
    "bathroom": furnish_bathroom,
    "study": furnish_study,
    "dining": furnish_dining,
}


def furnish(
    rng: np.random.Generator, plan: Plan, style: Style, shop: Shop | None = None
) -> list[Thing]:
    """The furniture of a whole home, as things in the world; some of it from a `shop`."""
    things: list[Thing] = []
    plants: list[Piece] = []
    for room in plan.rooms:
        maker = Furnisher(rng, plan, room, style, plants, shop)
        _fill(maker)
        if shop is not None:
            furnish_further(maker.space, shop)
        things += [item.thing(room.id) for item in maker.space.items]
    return things


def _fill(maker: Furnisher) -> None:
    """Everything, in order."""
    if maker.room.type not in ("kitchen", "bathroom"):
        dress_windows(maker)
    _PROGRAMMES[maker.room.type](maker)
    _light_ceiling(maker)
    fill_sills(maker)
    _put_down(maker)


def _light_ceiling(maker: Furnisher) -> None:
    """A lamp under the ceiling, unless a pendant already hangs over a table nearby."""
    rng, space = maker.rng, maker.space
    hanging = any(item.kind == "pendant_lamp" for item in space.items)
    if hanging and maker.area < 16:
        return
    kinds = {
        "study": ["ceiling_lamp", "spot_rail"],
        "kitchen": ["ceiling_lamp", "spot_rail"],
        "living": ["ceiling_lamp", "pendant_lamp"],
        "bedroom": ["ceiling_lamp", "ceiling_lamp", "pendant_lamp"],
        "dining": ["ceiling_lamp", "pendant_lamp"],
        "bathroom": ["ceiling_lamp"],
    }[maker.room.type]
    kind = str(rng.choice(kinds))
    lamp = (
        maker.make(kind, drop=min(0.5, maker.plan.height - 2.05))
        if kind == "pendant_lamp"
        else maker.make(kind)
    )
    middle = maker.space.middle()
    for attempt in range(12):
        x, y = middle + rng.normal(0, 0.05 + 0.1 * attempt, 2)
        pose = Pose(float(x), float(y), maker.plan.height, float(rng.choice([0.0, 90.0])))
        if space.try_place(kind, lamp, pose, zone=False, on_floor=False):
            return


def _put_down(maker: Furnisher) -> None:
    """Small things where things are put down."""
    rng = maker.rng
    wanted: dict[str, tuple[tuple[str, ...], int, int]] = {
        "coffee_table": (("books_stack", "vase", "candle", "fruit_bowl", "laptop"), 1, 4),
        "side_table": (("books_stack", "small_plant", "candle", "vase"), 0, 2),
        "night_table": (("books_stack", "small_plant", "candle"), 0, 2),
        "tv_stand": (("vase", "small_plant", "books_stack", "candle"), 0, 3),
        "desk": (("books_stack", "small_plant", "books_stack", "vase"), 1, 4),
        "dining_table": (("fruit_bowl", "vase", "crockery", "candle", "bottle"), 1, 4),
        "sideboard": (("vase", "books_stack", "small_plant", "candle", "table_lamp"), 2, 4),
        "console_table": (("vase", "small_plant", "table_lamp", "books_stack"), 1, 4),
        "chest_of_drawers": (("table_lamp", "vase", "books_stack", "small_plant"), 1, 4),
        "base_cupboard": (("kettle", "microwave", "bottle", "fruit_bowl", "crockery"), 0, 2),
        "drawer_unit": (("kettle", "bottle", "crockery", "cooking_pot", "small_plant"), 0, 2),
        "sink_unit": (("bottle", "crockery"), 0, 1),
        "wash_basin": (("toiletries", "toiletries", "candle"), 1, 3),
        "washing_machine": (("toiletries", "storage_box", "small_plant"), 0, 2),
        "toilet": (("small_plant", "candle"), 0, 1),
        "bookshelf": (("small_plant", "storage_box", "vase"), 0, 2),
        "wardrobe": (("storage_box",), 0, 2),
        "fridge": (("storage_box", "small_plant"), 0, 1),
        "wall_shelf": (("small_plant", "books_stack", "vase", "candle"), 1, 3),
        "bath_tub": (("toiletries", "candle"), 0, 2),
    }
    for item in list(maker.space.items):
        if item.kind not in wanted or not item.piece.surfaces:
            continue
        kinds, low, high = wanted[item.kind]
        for _ in range(int(rng.integers(low, high + 1))):
            kind = str(rng.choice(kinds))
            yaw = float(rng.uniform(-25, 25))
            maker.space.on_top(rng, kind, maker.make(kind), item, yaw=yaw, tries=6)
