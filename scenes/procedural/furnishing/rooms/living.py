"""Living rooms: seating group, shelves, lamps, plants."""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.procedural.furnishing.furnisher import Furnisher
from pbrnet.scenes.procedural.furnishing.rooms.seats import (
    place_armchair,
    place_seating,
    place_second_seats,
)
from pbrnet.scenes.procedural.furnishing.rooms.tables import place_dining_group


def furnish_living(furnisher: Furnisher) -> None:
    """Furnish a living room."""
    sofa = place_seating(furnisher)
    if furnisher.chance(0.6) and all(item.kind != "tv_stand" for item in furnisher.space.items):
        stand = furnisher.along_wall("tv_stand")
        if stand is not None:
            width = float(np.ptp(stand.piece.bounds[:, 0])) - 0.1
            television = furnisher.make("television", width=min(1.2, width))
            furnisher.space.on_top(furnisher.rng, "television", television, stand, centre=True)
    dines_elsewhere = "dining" in {room.type for room in furnisher.plan.rooms} or any(
        opening.kind == "open" and furnisher.room.id in opening.rooms
        for opening in furnisher.plan.openings
    )
    if furnisher.area > 19 and not dines_elsewhere:
        place_dining_group(furnisher, small=True)
    for kind, probability in (("bookshelf", 0.8), ("sideboard", 0.45), ("console_table", 0.25)):
        if furnisher.wants(probability):
            furnisher.along_wall(kind)
    if sofa is None or furnisher.wants(0.5):
        place_armchair(furnisher, sofa)
    if furnisher.wants(0.8):
        furnisher.space.in_corner(furnisher.rng, "floor_lamp", furnisher.make("floor_lamp"))
    for _ in range(furnisher.number(1, 2)):
        furnisher.put_plant()
    if furnisher.area > 20 and furnisher.wants(0.4):
        furnisher.along_wall("bookshelf")
    place_second_seats(furnisher)
    if furnisher.wants(0.3):
        furnisher.space.anywhere(furnisher.rng, "pouf", furnisher.make("pouf"))
    furnisher.hang_pictures(furnisher.number(1, 4))
    if furnisher.wants(0.25):
        furnisher.hang_row(5)
    if furnisher.wants(0.4):
        furnisher.hang("wall_shelf")
    if furnisher.may_leave("wall_clock"):
        furnisher.hang("wall_clock")
    if furnisher.wants(0.25):
        furnisher.hang("wall_lamp")
