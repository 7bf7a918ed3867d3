"""Extra items from catalogues: small objects on furniture, switches, toys, shoes, a piano.

They are placed last and by the same spatial rules, so they never displace other furniture.
"""

from __future__ import annotations

from pbrnet.scenes.procedural.furnishing.asset_sampler import AssetSampler
from pbrnet.scenes.procedural.furnishing.space import PlacedPiece, RoomSpace
from pbrnet.scenes.procedural.plan import Opening

# Kind of furniture -> kinds of objects placed on it, and their greatest number.
_ON_FURNITURE: dict[str, tuple[tuple[str, ...], int]] = {
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
# Room type -> (kind, position, probability).
_ON_FLOOR: dict[str, tuple[tuple[str, str, float], ...]] = {
    "living": (("living_wall", "wall", 0.5), ("living_floor", "corner", 0.7)),
    "bedroom": (("bedroom_floor", "corner", 0.7), ("bedroom_floor", "anywhere", 0.6)),
    "study": (("study_floor", "corner", 0.8),),
    "kitchen": (("kitchen_floor", "corner", 0.7),),
    "bathroom": (("bathroom_floor", "corner", 0.8),),
    "dining": (("living_floor", "corner", 0.4),),
}
_SOCKETS = 2  # greatest number of sockets in a room
_BESIDE_DOOR = 0.16  # metres from the opening to the centre of a switch


def add_catalogue_extras(space: RoomSpace, sampler: AssetSampler) -> None:
    """Add items of kinds that only catalogues have to a furnished room."""
    for kind, where, probability in _ON_FLOOR.get(space.room.type, ()):
        if sampler.chance(probability):
            _place_on_floor(space, sampler, kind, where)
    for opening in space.plan.openings:
        if space.room.id in opening.rooms and opening.kind in ("door", "entrance"):
            _hang_switch(space, sampler, opening)
    for _ in range(_SOCKETS):
        if sampler.chance(0.8):
            _hang(space, sampler, "wall_socket")
    if space.room.type == "bathroom" and sampler.chance(0.8):
        _hang(space, sampler, "paper_holder")
    for carrier in list(space.items):
        if carrier.kind in _ON_FURNITURE and carrier.piece.surfaces:
            _place_on_furniture(space, sampler, carrier)


def _place_on_floor(space: RoomSpace, sampler: AssetSampler, kind: str, where: str) -> None:
    piece = sampler.sample(kind)
    if piece is None:
        return
    if where == "wall":
        space.against_wall(sampler.rng, kind, piece, tries=40)
    elif where == "corner":
        if space.in_corner(sampler.rng, kind, piece, turned=False) is None:
            space.against_wall(sampler.rng, kind, piece, where="corner", tries=20, zone=False)
    else:
        space.anywhere(sampler.rng, kind, piece, tries=20)


def _hang_switch(space: RoomSpace, sampler: AssetSampler, opening: Opening) -> None:
    """Hang a light switch beside a door, on a side with enough wall."""
    piece = sampler.sample("wall_switch") if sampler.chance() else None
    if piece is None:
        return
    edge, width = opening.edge_in(space.room.id), opening.width
    for s in (-_BESIDE_DOOR, width + _BESIDE_DOOR):
        at = edge.at(s, 0.0)
        for wall in space.room.edges:
            along, depth = wall.coordinates(at)
            if (
                wall.faces_like(edge)
                and abs(depth) <= 1e-3
                and 0.06 < along < wall.length - 0.06
                and space.hang("wall_switch", piece, wall, along, piece.mount_height) is not None
            ):
                return


def _hang(space: RoomSpace, sampler: AssetSampler, kind: str) -> None:
    piece = sampler.sample(kind)
    if piece is not None:
        space.on_wall(sampler.rng, kind, piece)


def _place_on_furniture(space: RoomSpace, sampler: AssetSampler, carrier: PlacedPiece) -> None:
    kinds, most = _ON_FURNITURE[carrier.kind]
    for _ in range(most):
        if not sampler.chance(0.75):
            continue
        kind = sampler.rng.pick(kinds)
        piece = sampler.sample(kind)
        if piece is not None:
            space.on_top(
                sampler.rng, kind, piece, carrier, yaw=sampler.rng.between(-25, 25), tries=8
            )
