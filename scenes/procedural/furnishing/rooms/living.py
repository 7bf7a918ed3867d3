"""Living rooms: a seating group, shelves, lamps, plants."""

from __future__ import annotations

from scenes.procedural.furnishing.furnisher import Furnisher
from scenes.procedural.furnishing.rooms.seats import (
    place_armchair,
    place_seating,
    place_second_seats,
)
from scenes.procedural.furnishing.rooms.tables import place_dining_group


def furnish_living(maker: Furnisher) -> None:
    """All of a living room, in order."""
    sofa = place_seating(maker)
    if maker.area > 19 and "dining" not in {room.type for room in maker.plan.rooms}:
        place_dining_group(maker, small=True)
    for kind, probability in (("bookshelf", 0.8), ("sideboard", 0.45), ("console_table", 0.25)):
        if maker.chance(probability):
            maker.along_wall(kind)
    if sofa is None or maker.chance(0.5):
        place_armchair(maker, sofa)
    if maker.chance(0.8):
        maker.space.in_corner(maker.rng, "floor_lamp", maker.make("floor_lamp"))
    for _ in range(int(maker.rng.integers(1, 3))):
        maker.put_plant()
    if maker.area > 20 and maker.chance(0.4):
        maker.along_wall("bookshelf")
    place_second_seats(maker)
    if maker.chance(0.3):
        maker.space.anywhere(maker.rng, "pouf", maker.make("pouf"))
    maker.hang_pictures(int(maker.rng.integers(1, 4)))
    if maker.chance(0.4):
        maker.hang("wall_shelf")
    if maker.chance(0.3):
        maker.hang("wall_clock")
    if maker.chance(0.25):
        maker.hang("wall_lamp")
