"""Check of a home for light leaks, and slabs that seal those found.

Walls and slabs are built to meet, but drawn walls can miss each other or their rooms by
millimetres. Random walks from every room show whether light gets in (`light_walks`).
"""

from __future__ import annotations

import numpy as np
from shapely.geometry import Polygon

from pbrnet.scenes.contract import Portal, Room
from pbrnet.scenes.geometry.mesh import Mesh
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.reconstruction.gap_sealing import GAP_SEALING_ID, seal_gaps
from pbrnet.scenes.reconstruction.raycast import RayCaster
from pbrnet.scenes.reconstruction.rooms import FoundOpening, FoundRoom
from pbrnet.scenes.sweethome.furnishing.items import ItemPart, PlacedItem, SurfaceFinish

_GREY = SurfaceFinish(color=(0.5, 0.5, 0.5))


def seal_home(
    items: list[PlacedItem], rooms: list[Room], portals: list[Portal], changes: Changes
) -> list[PlacedItem]:
    """Return slabs behind the gaps through which light would leak, as at most one item.

    Light may leave `rooms` through `portals`, glass and sheer fabrics only. A home states its
    openings, so whatever else lets light in is sealed, also where the slab shows.
    """
    solid = [
        part.mesh.corners
        for item in items
        for part in item.parts
        if part.sphere is None and part.finish.kind not in ("glass", "sheer")
    ]
    if not rooms or not solid:
        return []
    corners = np.concatenate(solid)
    number_of = {room.id: number for number, room in enumerate(rooms)}
    found = [FoundRoom(Polygon(room.floor), room.floor_z, room.ceiling_z) for room in rooms]
    openings = [
        FoundOpening(number_of[portal.room], np.array(portal.polygon), np.array(portal.normal), 0.0)
        for portal in portals
        if portal.room is not None
    ]
    slabs, count = seal_gaps(corners, RayCaster(corners), found, openings, max_visible=1.0)
    if not count:
        return []
    changes.note(f"light leaked in through gaps: {count} slabs were added behind them")
    faces = np.arange(3 * len(slabs)).reshape(-1, 3)
    part = ItemPart(Mesh(slabs.reshape(-1, 3), faces), _GREY)
    return [PlacedItem(GAP_SEALING_ID, GAP_SEALING_ID, "structure", (part,), is_structure=True)]
