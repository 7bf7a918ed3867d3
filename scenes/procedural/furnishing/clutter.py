"""Things that people leave: on worktops, desks, shelves, beside beds, on floors and walls.

How many there are is the home's degree of disorder. No kind is left twice in a room, but for
fittings. Valid poses are decided by `RoomSpace`, so nothing floats, meets or blocks a way.
"""

from __future__ import annotations

from pbrnet.scenes.procedural.furnishing.cables import run_cables
from pbrnet.scenes.procedural.furnishing.furnisher import Furnisher
from pbrnet.scenes.procedural.furnishing.space import PlacedPiece
from pbrnet.scenes.procedural.furniture.things.kinds import BY_PLACE
from pbrnet.scenes.procedural.plan import Opening
from pbrnet.scenes.procedural.scene_item import Pose

# Kind of furniture -> place, mean number of things there in a home of middling disorder.
_ON: dict[str, tuple[str, float]] = {
    "base_cupboard": ("worktop", 3.6),
    "drawer_unit": ("worktop", 3.6),
    "sink_unit": ("sink", 3.2),
    "dining_table": ("dining", 4.5),
    "round_table": ("dining", 4.0),
    "coffee_table": ("coffee", 4.5),
    "side_table": ("coffee", 2.2),
    "desk": ("desk", 6.5),
    "night_table": ("bedside", 3.8),
    "bookshelf": ("shelf", 7.0),
    "wall_shelf": ("shelf", 3.5),
    "wall_board": ("shelf", 4.5),
    "rack": ("shelf", 7.0),
    "niche": ("shelf", 9.0),
    "shower": ("tub", 2.5),
    "sideboard": ("shelf", 4.5),
    "chest_of_drawers": ("dresser", 5.5),
    "console_table": ("hall_top", 4.6),
    "tv_stand": ("tv", 3.2),
    "wash_basin": ("bath", 5.0),
    "washing_machine": ("laundry", 3.0),
    "bath_tub": ("tub", 3.0),
    "toilet": ("toilet_top", 1.4),
    "wardrobe": ("top", 2.2),
    "fridge": ("top", 1.2),
    "bench": ("seat", 1.8),
    "storage_box": ("seat", 0.4),
}
# Type of room -> place whose things its shelves hold instead
_SHELF = {"bathroom": "bath", "kitchen": "worktop", "bedroom": "dresser"}
# Type of room -> places on its floor, mean number of things there.
_FLOOR: dict[str, tuple[tuple[str, float], ...]] = {
    "living": (("play", 1.0), ("floor", 1.6), ("tv_floor", 0.3)),
    "bedroom": (("bed_floor", 2.2), ("floor", 1.6), ("gym", 0.4)),
    "study": (("study_floor", 0.8), ("floor", 1.4), ("gym", 0.4)),
    "kitchen": (("kitchen_floor", 1.6),),
    "bathroom": (("bath_floor", 3.2),),
    "dining": (("play", 0.5), ("floor", 0.8)),
    "hall": (("floor", 1.4), ("hall", 2.6)),
}
# Type of room -> place on its walls, mean number of things there.
_WALLS: dict[str, tuple[str, float]] = {
    "living": ("dry_wall", 2.0),
    "bedroom": ("bed_wall", 3.8),
    "study": ("desk_wall", 3.0),
    "kitchen": ("kitchen_wall", 3.2),
    "bathroom": ("bath_wall", 4.4),
    "dining": ("dry_wall", 2.4),
    "hall": ("hall_wall", 3.6),
}
_HALL = 2.0  # mean number of things in the room behind the entrance
_SOCKETS = (1, 4)  # least and greatest number in a room
_BESIDE_DOOR = 0.17  # metres from the opening to the centre of a switch


def leave_things(furnisher: Furnisher) -> None:
    """Leave things in a furnished room, and mount its sockets, switches and detectors."""
    rng, space = furnisher.rng, furnisher.space
    run_cables(furnisher)
    for carrier in [*space.items, *space.niches]:
        if carrier.kind in _ON and carrier.piece.surfaces:
            place, mean = _ON[carrier.kind]
            if place == "shelf" and carrier.kind != "bookshelf":
                place = _SHELF.get(furnisher.room.type, place)
            for _ in range(_count(furnisher, mean)):
                _leave_on(furnisher, place, carrier)
    for place, mean in _FLOOR.get(furnisher.room.type, ()):
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
    place, mean = _WALLS[furnisher.room.type]
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
