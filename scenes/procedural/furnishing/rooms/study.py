"""Studies: desk, shelves, armchair."""

from __future__ import annotations

from pbrnet.scenes.procedural.furnishing.furnisher import Furnisher
from pbrnet.scenes.procedural.furnishing.rooms.desks import place_desk
from pbrnet.scenes.procedural.furnishing.rooms.seats import place_armchair


def furnish_study(furnisher: Furnisher) -> None:
    """Furnish a study."""
    rng, space = furnisher.rng, furnisher.space
    place_desk(furnisher)
    for _ in range(furnisher.number(1, 3)):
        furnisher.along_wall("bookshelf")
    if furnisher.wants(0.5):
        place_armchair(furnisher, None)
    if furnisher.wants(0.3):
        furnisher.along_wall("chest_of_drawers")
    if furnisher.wants(0.5):
        space.in_corner(rng, "floor_lamp", furnisher.make("floor_lamp"))
    if furnisher.wants(0.6):
        furnisher.put_plant()
    for kind, probability in (("waste_bin", 0.6), ("storage_box", 0.2)):
        if furnisher.wants(probability):
            space.in_corner(rng, kind, furnisher.make(kind)) or space.anywhere(
                rng, kind, furnisher.make(kind)
            )
    furnisher.lay_rug()
    furnisher.hang_pictures(furnisher.number(2, 4))
    if furnisher.wants(0.25):
        furnisher.hang_row(4)
    if furnisher.wants(0.6):
        furnisher.hang("wall_shelf")
    if furnisher.may_leave("wall_clock"):
        furnisher.hang("wall_clock")
