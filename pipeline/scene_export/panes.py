"""Window panes as thin sheets of glass: scenes have portals in their place."""

from __future__ import annotations

import numpy as np

from pbrnet.pipeline.scene_export.content import Content, Piece
from pbrnet.pipeline.scene_export.looks import Look
from pbrnet.scenes.geometry.mesh import Mesh, faces_of_polygon
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
        polygon = np.array(portal.polygon)
        faces = faces_of_polygon(polygon, np.array(portal.normal))
        if not portal.panes or not len(faces):
            continue
        name = PANE_PREFIX + portal.id
        content.pieces[name] = Piece(name, Mesh(polygon, faces), number)
        content.panes[name] = portal
    if content.panes:
        content.materials.append(("window_pane", _GLASS, None))
    if any(portal.panes > 1 for portal in content.panes.values()):
        content.lost.note("windows of several panes have one sheet of glass")
