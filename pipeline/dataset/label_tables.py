"""Tables that explain the labels: names of classes, and the layout of a view's rooms."""

from __future__ import annotations

import json
from typing import Any

from pbrnet.pipeline.views import View
from pbrnet.scenes.checked import plain
from pbrnet.scenes.contract import Scene
from pbrnet.scenes.importing.semantics import (
    CATEGORY_LABELS,
    NYU13_NAMES,
    NYU13_OF_NYU40,
    NYU40_NAMES,
    NYU40_OF_CATEGORY,
)

# In the metadata of every shard, and beside the shards: what the numbers in label images mean.
CLASSES = {
    "category": list(CATEGORY_LABELS),
    "nyu40": list(NYU40_NAMES),
    "nyu13": list(NYU13_NAMES),
    "nyu40_of_category": list(NYU40_OF_CATEGORY),
    "nyu13_of_nyu40": list(NYU13_OF_NYU40),
}


def room_layout(scene: Scene, view: View) -> dict[str, Any]:
    """Return the rooms of a scene in world metres, and which of them the camera is in.

    Each room has its floor polygon, floor and ceiling height, and its `openings` to the outside:
    windows and doors with polygon, outward normal, and whether light passes them. `doors` are the
    door leaves of the whole scene, inner ones too, by their bounds.
    """
    rooms = []
    for room in scene.rooms:
        openings = [
            {key: value for key, value in plain(portal).items() if key != "room"}
            for portal in scene.portals
            if portal.room == room.id
        ]
        rooms.append({**plain(room), "openings": openings})
    doors = [
        {"object": item.id, "bbox_min": list(item.bbox_min), "bbox_max": list(item.bbox_max)}
        for item in scene.objects
        if item.category == "door"
    ]
    return {"room": view.room or None, "rooms": rooms, "doors": doors}


def json_text(value: Any) -> str:
    """Return compact JSON."""
    return json.dumps(value, ensure_ascii=False, separators=(",", ":"))
