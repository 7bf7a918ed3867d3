"""What only catalogues have: small things on tables and shelves, switches, toys, shoes, a piano.

Placed last, by the same rules of space, so that they never take the place of what a room needs.
"""

from __future__ import annotations

from scenes.procedural.furnishing.asset_sampler import Shop
from scenes.procedural.furnishing.space import Item, RoomSpace
from scenes.procedural.plan import Opening

# Kind of carrier -> kinds of things put down there, and how many at most.
_PUT_DOWN: dict[str, tuple[tuple[str, ...], int]] = {
    "desk": (("desk_thing", "desk_thing", "books_stack", "crockery"), 4),
    "coffee_table": (("living_thing", "crockery", "books_stack", "living_thing"), 3),
    "side_table": (("living_thing", "crockery"), 1),
    "tv_stand": (("living_thing",), 2),
    "sideboard": (("living_thing", "vase", "crockery"), 3),
    "console_table": (("living_thing", "vase"), 2),
    "bookshelf": (("living_thing", "books_stack", "vase", "bedroom_thing"), 4),
    "wall_shelf": (("living_thing", "vase"), 1),
    "night_table": (("bedroom_thing", "desk_thing"), 1),
    "chest_of_drawers": (("bedroom_thing", "living_thing"), 3),
    "dining_table": (("crockery", "crockery", "bottle"), 3),
    "base_cupboard": (("kitchen_thing",), 2),
    "drawer_unit": (("kitchen_thing", "crockery"), 2),
    "wash_basin": (("toiletries",), 2),
    "washing_machine": (("toiletries",), 2),
    "bath_tub": (("toiletries",), 1),
}
# Room type -> (kind, how it stands, probability).
_STANDING: dict[str, tuple[tuple[str, str, float], ...]] = {
    "living": (("living_wall", "wall", 0.5), ("living_floor", "corner", 0.7)),
    "bedroom": (("bedroom_floor", "corner", 0.7), ("bedroom_floor", "anywhere", 0.6)),
    "study": (("study_floor", "corner", 0.8),),
    "kitchen": (("kitchen_floor", "corner", 0.7),),
    "bathroom": (("bathroom_floor", "corner", 0.8),),
    "dining": (("living_floor", "corner", 0.4),),
}
_SOCKETS = 2  # at most, besides the switch by the door
_BESIDE_DOOR = 0.16  # metres from the opening to the middle of a switch


def furnish_further(space: RoomSpace, shop: Shop) -> None:
    """Put the catalogues' further things into a furnished room."""
    for kind, where, probability in _STANDING.get(space.room.type, ()):
        if shop.chance(probability):
            _stand(space, shop, kind, where)
    for opening in space.plan.openings:
        if space.room.id in opening.rooms and opening.kind in ("door", "entrance"):
            _switch(space, shop, opening)
    for _ in range(_SOCKETS):
        if shop.chance(0.8):
            _hang(space, shop, "wall_socket")
    if space.room.type == "bathroom" and shop.chance(0.8):
        _hang(space, shop, "paper_holder")
    for carrier in list(space.items):
        if carrier.kind in _PUT_DOWN and carrier.piece.surfaces:
            _put_down(space, shop, carrier)


def _stand(space: RoomSpace, shop: Shop, kind: str, where: str) -> None:
    piece = shop.sell(kind)
    if piece is None:
        return
    if where == "wall":
        space.against_wall(shop.rng, kind, piece, tries=40)
    elif where == "corner":
        if space.in_corner(shop.rng, kind, piece, turned=False) is None:
            space.against_wall(shop.rng, kind, piece, where="corner", tries=20, zone=False)
    else:
        space.anywhere(shop.rng, kind, piece, tries=20)


def _switch(space: RoomSpace, shop: Shop, opening: Opening) -> None:
    """A light switch beside a door, on the side where there is wall for it."""
    piece = shop.sell("wall_switch") if shop.chance() else None
    if piece is None:
        return
    edge, width = space.edge_of(opening), opening.width
    for s in (-_BESIDE_DOOR, width + _BESIDE_DOOR):
        at = edge.at(s, 0.0)
        for wall in space.room.edges:
            along = (at[0] - wall.start[0]) * wall.along[0] + (at[1] - wall.start[1]) * wall.along[
                1
            ]
            away = (at[0] - wall.start[0]) * wall.inward[0] + (at[1] - wall.start[1]) * wall.inward[
                1
            ]
            same = wall.inward[0] * edge.inward[0] + wall.inward[1] * edge.inward[1] > 0.99
            if not same or abs(away) > 1e-3 or not 0.06 < along < wall.length - 0.06:
                continue
            if space.hang("wall_switch", piece, wall, along, piece.mount_height) is not None:
                return


def _hang(space: RoomSpace, shop: Shop, kind: str) -> None:
    piece = shop.sell(kind)
    if piece is not None:
        space.on_wall(shop.rng, kind, piece)


def _put_down(space: RoomSpace, shop: Shop, carrier: Item) -> None:
    kinds, most = _PUT_DOWN[carrier.kind]
    for _ in range(most):
        if not shop.chance(0.75):
            continue
        kind = kinds[shop.pick(len(kinds))]
        piece = shop.sell(kind)
        if piece is not None:
            space.on_top(shop.rng, kind, piece, carrier, yaw=shop.draw(-25, 25), tries=8)
