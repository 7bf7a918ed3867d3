"""Studies: a desk, shelves, an armchair."""

from __future__ import annotations

from scenes.procedural.furnishing.furnisher import Furnisher
from scenes.procedural.furnishing.rooms.desks import place_desk
from scenes.procedural.furnishing.rooms.seats import place_armchair


def furnish_study(maker: Furnisher) -> None:
    """All of a study, in order."""
    rng, space = maker.rng, maker.space
    place_desk(maker)
    for _ in range(int(rng.integers(1, 4))):
        maker.along_wall("bookshelf")
    if maker.chance(0.5):
        place_armchair(maker, None)
    if maker.chance(0.3):
        maker.along_wall("chest_of_drawers")
    if maker.chance(0.5):
        space.in_corner(rng, "floor_lamp", maker.make("floor_lamp"))
    if maker.chance(0.6):
        maker.put_plant()
    for kind, probability in (("waste_bin", 0.7), ("storage_box", 0.4)):
        if maker.chance(probability):
            space.in_corner(rng, kind, maker.make(kind)) or space.anywhere(
                rng, kind, maker.make(kind)
            )
    maker.lay_rug()
    maker.hang_pictures(int(rng.integers(1, 3)))
    if maker.chance(0.5):
        maker.hang("wall_shelf")
    if maker.chance(0.4):
        maker.hang("wall_clock")
