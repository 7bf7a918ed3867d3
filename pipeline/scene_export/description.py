"""Descriptions of scenes in exported files, beyond geometry: labels, and the whole `scene.json`."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from pbrnet.pipeline.scene_export.content import Content
from pbrnet.pipeline.scene_export.outdoors import Outdoors
from pbrnet.scenes.arrays import as_triple
from pbrnet.scenes.checked import plain
from pbrnet.scenes.contract import Portal, SceneObject
from pbrnet.scenes.importing.semantics import NYU40_OF_CATEGORY, category_number

VERSION = 1
SUN = "sun"  # name of the light that stands for the sun


def description(content: Content, outdoors: Outdoors | None) -> dict[str, Any]:
    """Return the description from which `scenes/models/restored.py` restores the scene."""
    stated = {} if outdoors is None else {"sky": outdoors.stated}
    objects = tuple(_bounded(thing, content) for thing in content.scene.objects)
    return {
        "version": VERSION,
        "scene": plain(replace(content.scene, source=content.scene.origin, objects=objects)),
        "max_depth": content.max_depth,
        **stated,
    }


def _bounded(thing: SceneObject, content: Content) -> SceneObject:
    """The object with the bounds of its triangles: without vertices that none uses."""
    bounds = np.array([piece.mesh.bounds for piece in content.whole(thing)])
    if not len(bounds):
        return thing
    low, high = bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)
    return replace(thing, bbox_min=as_triple(low), bbox_max=as_triple(high))


def labels_of(thing: SceneObject) -> dict[str, Any]:
    """Return the labels of an object: id, name, category, room, NYU40 class, structure or not."""
    found = {
        "id": thing.id,
        "name": thing.name,
        "category": thing.category,
        "is_structure": thing.is_structure,
        "nyu40": NYU40_OF_CATEGORY[category_number(thing.category)],
    }
    return {**found, **({"room": thing.room} if thing.room else {})}


def pane_labels(portal: Portal) -> dict[str, Any]:
    """Return the labels of a sheet of glass in a portal."""
    return {"kind": "window pane", "portal": portal.id, "sheets": portal.panes}
