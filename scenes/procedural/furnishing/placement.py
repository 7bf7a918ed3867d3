"""Rule-based furnishing of a home, room by room.

Every room is furnished in the same order: curtains and radiators, the furniture of its room type,
a ceiling lamp, small objects on window sills and on furniture. Pieces that find no valid pose are
left out; `RoomSpace` decides which poses are valid.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from pbrnet.scenes.checked import build
from pbrnet.scenes.files import data_beside
from pbrnet.scenes.procedural.furnishing.asset_sampler import AssetSampler
from pbrnet.scenes.procedural.furnishing.clutter import leave_things
from pbrnet.scenes.procedural.furnishing.drapery import drape_cloth
from pbrnet.scenes.procedural.furnishing.extras import add_catalogue_extras
from pbrnet.scenes.procedural.furnishing.furnisher import Furnisher
from pbrnet.scenes.procedural.furnishing.rooms.bathroom import furnish_bathroom
from pbrnet.scenes.procedural.furnishing.rooms.bedroom import furnish_bedroom
from pbrnet.scenes.procedural.furnishing.rooms.dining import furnish_dining
from pbrnet.scenes.procedural.furnishing.rooms.hall import furnish_hall
from pbrnet.scenes.procedural.furnishing.rooms.kitchen import furnish_kitchen
from pbrnet.scenes.procedural.furnishing.rooms.living import furnish_living
from pbrnet.scenes.procedural.furnishing.rooms.study import furnish_study
from pbrnet.scenes.procedural.furnishing.rooms.windows import fill_sills, furnish_windows
from pbrnet.scenes.procedural.furnishing.space import PlacedPiece
from pbrnet.scenes.procedural.furniture import Style
from pbrnet.scenes.procedural.piece import FurniturePiece
from pbrnet.scenes.procedural.plan import Plan
from pbrnet.scenes.procedural.scene_item import Pose, SceneItem
from pbrnet.scenes.seeds import Draw


@dataclass(frozen=True)
class _Tables:
    """The tables of `placement.yaml`."""

    ceiling_lamps: dict[str, tuple[str, ...]]
    on_furniture: dict[str, tuple[tuple[str, ...], int, int]]


_TABLES = build(_Tables, data_beside(__file__))
CEILING_LAMPS = _TABLES.ceiling_lamps  # type of room -> kinds, each as likely
_FURNISH_ROOM: dict[str, Callable[[Furnisher], None]] = {
    "living": furnish_living,
    "bedroom": furnish_bedroom,
    "kitchen": furnish_kitchen,
    "bathroom": furnish_bathroom,
    "study": furnish_study,
    "dining": furnish_dining,
    "hall": furnish_hall,
}


@dataclass(frozen=True)
class PlacedInRoom:
    """A placed piece and the id of its room."""

    room: str
    placed: PlacedPiece

    def scene_items(self) -> list[SceneItem]:
        """The piece and the things that it holds as items of the scene."""
        return self.placed.scene_items(self.room)


def furnish(
    rng: Draw, plan: Plan, style: Style, sampler: AssetSampler | None = None
) -> list[SceneItem]:
    """Furnish all rooms of a plan; the items of `place_furniture`."""
    placed = place_furniture(rng, plan, style, sampler)
    return [item for each in placed for item in each.scene_items()]


def place_furniture(
    rng: Draw, plan: Plan, style: Style, sampler: AssetSampler | None = None
) -> list[PlacedInRoom]:
    """Furnish all rooms of a plan; with a `sampler`, some pieces come from catalogues."""
    items: list[PlacedInRoom] = []
    plants: list[FurniturePiece] = []
    for room in plan.rooms:
        furnisher = Furnisher(rng, plan, room, style, plants, sampler)
        _furnish_room(furnisher)
        if sampler is not None:
            add_catalogue_extras(furnisher.space, sampler)
        items += [PlacedInRoom(room.id, placed) for placed in furnisher.space.items]
    return items


def _furnish_room(furnisher: Furnisher) -> None:
    if furnisher.room.type not in ("kitchen", "bathroom"):
        furnish_windows(furnisher)
    _FURNISH_ROOM[furnisher.room.type](furnisher)
    _hang_ceiling_lamp(furnisher)
    leave_small_objects(furnisher)


def leave_small_objects(furnisher: Furnisher) -> None:
    """Leave cloth, small objects, switches and sockets in a furnished room."""
    drape_cloth(furnisher)
    fill_sills(furnisher)
    _place_small_objects(furnisher)
    leave_things(furnisher)


def _hang_ceiling_lamp(furnisher: Furnisher) -> None:
    """Hang a lamp from the ceiling, unless a small room already has a pendant lamp."""
    rng, space = furnisher.rng, furnisher.space
    hanging = any(item.kind == "pendant_lamp" for item in space.items)
    if hanging and furnisher.area < 16:
        return
    kind = rng.pick(CEILING_LAMPS[furnisher.room.type])
    drop = {"drop": min(0.5, furnisher.plan.height - 2.05)} if kind == "pendant_lamp" else {}
    lamp = furnisher.make(kind, **drop)
    middle = furnisher.space.middle()
    for attempt in range(12):
        x, y = middle + rng.normal(0, 0.05 + 0.1 * attempt, 2)
        pose = Pose(float(x), float(y), furnisher.plan.height, rng.pick([0.0, 90.0]))
        if space.try_place(kind, lamp, pose, zone=False, on_floor=False):
            return


def _place_small_objects(furnisher: Furnisher) -> None:
    """Place small objects on the support surfaces of the room's furniture."""
    rng = furnisher.rng
    for item in [*furnisher.space.items, *furnisher.space.niches]:
        if item.kind not in _TABLES.on_furniture or not item.piece.surfaces:
            continue
        kinds, low, high = _TABLES.on_furniture[item.kind]
        for _ in range(rng.whole(low, high + 1)):
            kind = rng.pick(kinds)
            # A niche was built for them.
            if item.kind != "niche" and not furnisher.may_leave(kind):
                continue
            yaw = rng.between(-25, 25)
            furnisher.space.on_top(rng, kind, furnisher.make(kind), item, yaw=yaw, tries=6)
