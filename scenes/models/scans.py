"""Scans: meshes whose image was photographed, with the light of the place in it."""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.geometry.mesh import face_areas
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.shape import Shape

_LEAST_EXTENT = 2.0  # metres, of a mesh
_LEAST_SHARE = 0.15  # of its area that is level, and that is upright
_LEVEL, _UPRIGHT = 0.9, 0.3  # vertical parts of normals


def note_baked_light(shapes: list[Shape], changes: Changes) -> None:
    """Note meshes of floors and walls alike that one image colours, as scanners write them."""
    for shape in shapes:
        low, high = shape.mesh.bounds
        element = shape.surface.element
        image = None if element is None else element.find(".//texture[@type='bitmap']")
        if image is None or (high - low)[:2].max() < _LEAST_EXTENT:
            continue
        areas, normals = face_areas(shape.mesh.corners)
        slopes = np.abs(normals[:, 2])
        shares = (areas[slopes > _LEVEL].sum(), areas[slopes < _UPRIGHT].sum())
        if min(shares) >= _LEAST_SHARE * areas.sum():
            changes.note(
                "one image colours floors and walls alike, as in scans: the light and shadows of "
                "the place are in its colours, and are taken for reflectance: {}",
                shape.name,
            )
