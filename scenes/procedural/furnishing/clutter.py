"""Things that people leave: on worktops, desks, shelves, beside beds, on floors and walls.

How many there are is the home's degree of disorder. No kind is left twice in a room, but for
fittings. Valid poses are decided by `RoomSpace`, so nothing floats, meets or blocks a way.
"""

from __future__ import annotations

from dataclasses import dataclass

from pbrnet.scenes.checked import build
from pbrnet.scenes.files import data_beside
from pbrnet.scenes.procedural.furnishing.furnisher import Furnisher
from pbrnet.scenes.procedural.furnishing.space import PlacedPiece
from pbrnet.scenes.procedural.furniture.things.kinds import BY_PLACE
from pbrnet.scenes.procedural.furniture.things.packages import PowerCable
from pbrnet.scenes.procedural.plan import Opening
from pbrnet.scenes.procedural.scene_item import Pose


@dataclass(frozen=True)
class _Places:
    """The tables of `clutter.yaml`: names of places, and mean numbers of things there."""

    on_furniture: dict[str, tuple[str, float]]
    shelves: dict[str, str]
    floors: dict[str, tuple[tuple[str, float], ...]]
    walls: dict[str, tuple[str, float]]
    # Of cables from behind furniture: chance, and height where they end, metres.
    driven: dict[str, tuple[float, float]]


_PLACES = build(_Places, data_beside(__file__))
_HALL = 2.0  # mean number of things in the room behind the entrance
_SOCKETS = (1, 4)  # least and greatest number in a room
_SOCKET_HEIGHT = 0.3  # metres above the floor, of sockets with a cable
_BESIDE_DOOR = 0.17  # metres from the opening to the centre of a switch


def leave_things(furnisher: Furnisher) -> None:
    """Leave things in a furnished room, and mount its sockets, switches and detectors."""
    rng, space = furnisher.rng, furnisher.space
    _run_cables(furnisher)
    for carrier in [*space.items, *space.niches]:
        if carrier.kind in _PLACES.on_furniture and carrier.piece.surfaces:
            place, mean = _PLACES.on_furniture[carrier.kind]
            if place == "shelf" and carrier.kind != "bookshelf":
                place = _PLACES.shelves.get(furnisher.room.type, place)
            for _ in range(_count(furnisher, mean)):
                _leave_on(furnisher, place, carrier)
    for place, mean in _PLACES.floors.get(furnisher.room.type, ()):
        for _ in range(_count(furnisher, mean)):
            _leave_on_floor(furnisher, place)
    doors = [one for one in space.plan.openings if furnisher.room.id in one.rooms]
    for opening in doors:
        if opening.kind == "entrance":
            for _ in range(_count(furnisher, _HALL)):
                _leave_on_floor(furnisher, "hall")
            _mount_beside(furnisher, "entrance", opening, 1.0)
        if opening.kind in ("door", "entrance"):
            _mount_beside(furnisher, "door", opening, 0.0)
    place, mean = _PLACES.walls[furnisher.room.type]
    for _ in range(_count(furnisher, mean)):
        kind = _choose(furnisher, place)
        if kind is not None and furnisher.space.on_wall(rng, kind, furnisher.make(kind), tries=10):
            furnisher.left.add(kind)
    sockets = BY_PLACE["wall"]
    for _ in range(rng.whole(_SOCKETS[0], _SOCKETS[1] + 1)):
        kind = rng.pick(sockets)
        space.on_wall(rng, kind, furnisher.make(kind), tries=12)
    if furnisher.room.type in ("bathroom", "kitchen") and furnisher.chance(0.6):
        space.on_wall(rng, "vent", furnisher.make("vent"), tries=20)
    if furnisher.room.type not in ("bathroom", "kitchen") and furnisher.chance(0.6):
        x, y = space.middle() + rng.uniform(-0.7, 0.7, 2)
        pose = Pose(float(x), float(y), space.plan.height, 0.0)
        made = furnisher.make("smoke_detector")
        space.try_place("smoke_detector", made, pose, zone=False, on_floor=False)


def _count(furnisher: Furnisher, mean: float) -> int:
    """Number of things to leave, by the home's disorder and the density of its style."""
    mean *= furnisher.style.interior.density**0.7
    return int(furnisher.rng.poisson(mean * (0.9 + 1.2 * furnisher.style.disorder)))


def _choose(furnisher: Furnisher, place: str) -> str | None:
    kinds = [
        name for name in BY_PLACE[place] if name not in furnisher.left and furnisher.may_leave(name)
    ]
    return furnisher.rng.pick(kinds) if kinds else None


def _leave_on(furnisher: Furnisher, place: str, carrier: PlacedPiece) -> None:
    kind = _choose(furnisher, place)
    if kind is None:
        return
    rng = furnisher.rng
    straight = rng.random() > 0.4 + 0.6 * furnisher.style.disorder
    yaw = float(rng.uniform(-8, 8) if straight else rng.uniform(-180, 180))
    item = furnisher.space.on_top(rng, kind, furnisher.make(kind), carrier, yaw=yaw, tries=5)
    if item is not None:
        furnisher.left.add(kind)


def _leave_on_floor(furnisher: Furnisher, place: str) -> None:
    kind = _choose(furnisher, place)
    if kind is None:
        return
    rng, space, piece = furnisher.rng, furnisher.space, furnisher.make(kind)
    if place in ("play", "bed_floor", "bath_floor") and furnisher.chance(0.6):
        item = space.anywhere(rng, kind, piece, tries=6)
    else:
        where = "corner" if furnisher.chance(0.5) else "any"
        item = space.against_wall(rng, kind, piece, where=where, zone=False, tries=8)
    if item is not None:
        furnisher.left.add(kind)


def _mount_beside(furnisher: Furnisher, place: str, opening: Opening, offset: float) -> None:
    """Mount a switch or the like beside a door, on either side of it."""
    rng, space = furnisher.rng, furnisher.space
    kinds = BY_PLACE[place]
    kind = rng.pick(kinds)
    piece = furnisher.make(kind)
    edge = opening.edge_in(furnisher.room.id)
    middle = edge.at(0.5 * opening.width, 0.0)
    for wall in furnisher.room.edges:
        s, depth = wall.coordinates(middle)
        if abs(depth) > 1e-3 or not 0 < s < wall.length or not wall.faces_like(edge):
            continue
        away = 0.5 * opening.width + _BESIDE_DOOR + 0.15 * offset
        for side in (1.0, -1.0) if furnisher.chance(0.5) else (-1.0, 1.0):
            at = s + side * away
            if 0.1 < at < wall.length - 0.1 and space.hang(
                kind, piece, wall, at, piece.mount_height
            ):
                return


def _run_cables(furnisher: Furnisher) -> None:
    """Lead cables from furniture with a lamp or a device to sockets beside it."""
    rng, space = furnisher.rng, furnisher.space
    for item in list(space.items):
        chance, end = _PLACES.driven.get(item.kind, (0.0, 0.0))
        if not furnisher.chance(chance):
            continue
        for side in (1.0, -1.0) if furnisher.chance(0.5) else (-1.0, 1.0):
            if _lead(furnisher, item, side, rng.between(0.1, 0.4), end):
                break


def _lead(furnisher: Furnisher, item: PlacedPiece, side: float, run: float, end: float) -> bool:
    """Mount a socket `run` metres beside an item, and lead its cable there."""
    edge = furnisher.edge_behind(item)
    if edge is None:
        return False
    space = furnisher.space
    # The x axis of what hangs on a wall points against the wall's direction.
    beside = float(item.piece.bounds[0 if side > 0 else 1, 0])
    middle = item.along(edge)
    at = middle - beside + side * run
    if not 0.1 < at < edge.length - 0.1:
        return False
    cable = PowerCable.make(
        furnisher.rng, furnisher.style, run=side * run, end=end - _SOCKET_HEIGHT
    )
    return space.hang("cable", cable, edge, at, _SOCKET_HEIGHT) is not None
