"""Dining rooms: table with chairs, sideboards."""

from __future__ import annotations

from pbrnet.scenes.procedural.furnishing.furnisher import Furnisher
from pbrnet.scenes.procedural.furnishing.rooms.tables import place_dining_group


def furnish_dining(furnisher: Furnisher) -> None:
    """Furnish a dining room."""
    rng, space = furnisher.rng, furnisher.space
    place_dining_group(furnisher, small=False)
    for kind, probability in (("sideboard", 0.85), ("console_table", 0.3), ("bookshelf", 0.3)):
        if furnisher.wants(probability):
            furnisher.along_wall(kind)
    if furnisher.wants(0.3):
        furnisher.along_wall("bench")
    if furnisher.wants(0.4):
        space.in_corner(rng, "floor_lamp", furnisher.make("floor_lamp"))
    for _ in range(furnisher.number(1, 2)):
        furnisher.put_plant()
    furnisher.hang_pictures(furnisher.number(2, 4))
    if furnisher.wants(0.25):
        furnisher.hang_row(4)
    if furnisher.wants(0.3):
        furnisher.hang("wall_lamp")
