"""Extra items from catalogues: small objects on furniture, switches, toys, shoes, a piano.

They are placed last and by the same spatial rules, so they never displace other furniture.
"""

from __future__ import annotations

from dataclasses import dataclass

from pbrnet.scenes.checked import build
from pbrnet.scenes.files import data_beside
from pbrnet.scenes.procedural.furnishing.asset_sampler import AssetSampler
from pbrnet.scenes.procedural.furnishing.search import SearchedSpace
from pbrnet.scenes.procedural.furnishing.space import PlacedPiece
from pbrnet.scenes.procedural.plan import Opening


@dataclass(frozen=True)
class _Extras:
    """The tables of `extras.yaml`."""

    on_furniture: dict[str, tuple[tuple[str, ...], int]]
    on_floor: dict[str, tuple[tuple[str, str, float], ...]]


_EXTRAS = build(_Extras, data_beside(__file__))
_SOCKETS = 2  # greatest number of sockets in a room
_BESIDE_DOOR = 0.16  # metres from the opening to the centre of a switch


def add_catalogue_extras(space: SearchedSpace, sampler: AssetSampler) -> None:
    """Add items of kinds that only catalogues have to a furnished room."""
    for kind, where, probability in _EXTRAS.on_floor.get(space.room.type, ()):
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
        if carrier.kind in _EXTRAS.on_furniture and carrier.piece.surfaces:
            _place_on_furniture(space, sampler, carrier)


def _place_on_floor(space: SearchedSpace, sampler: AssetSampler, kind: str, where: str) -> None:
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


def _hang_switch(space: SearchedSpace, sampler: AssetSampler, opening: Opening) -> None:
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


def _hang(space: SearchedSpace, sampler: AssetSampler, kind: str) -> None:
    piece = sampler.sample(kind)
    if piece is not None:
        space.on_wall(sampler.rng, kind, piece)


def _place_on_furniture(space: SearchedSpace, sampler: AssetSampler, carrier: PlacedPiece) -> None:
    kinds, most = _EXTRAS.on_furniture[carrier.kind]
    for _ in range(most):
        if not sampler.chance(0.75):
            continue
        kind = sampler.rng.pick(kinds)
        piece = sampler.sample(kind)
        if piece is not None:
            space.on_top(
                sampler.rng, kind, piece, carrier, yaw=sampler.rng.between(-25, 25), tries=8
            )
