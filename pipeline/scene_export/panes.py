"""Window panes as thin sheets of glass: scenes have portals in their place."""

from __future__ import annotations

import mapbox_earcut
import numpy as np

from pbrnet.pipeline.scene_export.content import Content, Piece
from pbrnet.pipeline.scene_export.looks import Look
from pbrnet.scenes.arrays import Float64Array, Int64Array
from pbrnet.scenes.geometry.mesh import Mesh
from pbrnet.scenes.models.restored import PANE_PREFIX
from pbrnet.scenes.models.stated import Statement

# A mirror that covers 8 %, what a sheet reflects head-on, and nothing of the rest: renderers sample
# sun and sky through it, which they do not through KHR_materials_transmission.
_GLASS = Look(
    base=(1.0, 1.0, 1.0),
    roughness=0.0,
    metallic=1.0,
    opacity=0.08,
    two_sided=True,
    stated=Statement("thindielectric"),
)


def add_panes(content: Content) -> None:
    """Add a sheet of glass to `content` for each portal with panes."""
    number = len(content.materials)
    for portal in content.scene.portals:
        mesh = _sheet(np.array(portal.polygon), np.array(portal.normal)) if portal.panes else None
        if mesh is None or not len(mesh.faces):
            continue
        name = PANE_PREFIX + portal.id
        content.pieces[name] = Piece(name, mesh, number)
        content.panes[name] = portal
    if content.panes:
        content.materials.append(("window_pane", _GLASS, None))
    if any(portal.panes > 1 for portal in content.panes.values()):
        content.lost.note("windows of several panes have one sheet of glass")


def _sheet(polygon: Float64Array, normal: Float64Array) -> Mesh:
    """A planar polygon (N, 3) as triangles whose front is on the side of `normal` (3,)."""
    flat = np.delete(polygon, int(np.argmax(np.abs(normal))), axis=1)
    faces: Int64Array = mapbox_earcut.triangulate_float64(flat, np.array([len(flat)], np.uint32))
    faces = faces.reshape(-1, 3).astype(np.int64)
    a, b, c = (polygon[faces[:, corner]] for corner in range(3))
    turned = np.cross(b - a, c - a) @ normal < 0
    faces[turned] = faces[turned][:, ::-1]
    return Mesh(polygon, faces)
