"""Dining rooms: a table with chairs, sideboards."""

from __future__ import annotations

from scenes.procedural.furnishing.furnisher import Furnisher
from scenes.procedural.furnishing.rooms.tables import place_dining_group


def furnish_dining(maker: Furnisher) -> None:
    """All of a dining room, in order."""
    rng, space = maker.rng, maker.space
    place_dining_group(maker, small=False)
    for kind, probability in (("sideboard", 0.85), ("console_table", 0.3), ("bookshelf", 0.3)):
        if maker.chance(probability):
            maker.along_wall(kind)
    if maker.chance(0.3):
        maker.along_wall("bench")
    if maker.chance(0.4):
        space.in_corner(rng, "floor_lamp", maker.make("floor_lamp"))
    for _ in range(int(rng.integers(1, 3))):
        maker.put_plant()
    maker.hang_pictures(int(rng.integers(1, 4)))
    if maker.chance(0.3):
        maker.hang("wall_lamp")
