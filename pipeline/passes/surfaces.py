"""Frames of what pixel centres see: inputs, materials, labels and video, from the same rays."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from pbrnet.pipeline.channels import Kind
from pbrnet.pipeline.frames import Result
from pbrnet.pipeline.passes.inputs import VisibleSurfaces, inputs_of, visible_surfaces
from pbrnet.pipeline.passes.labels import labels_of
from pbrnet.pipeline.passes.materials import materials_of
from pbrnet.pipeline.passes.video import video_of
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.pipeline.views import View

MAKERS: dict[Kind, Callable[[VisibleSurfaces], Result]] = {
    "inputs": lambda surfaces: (inputs_of(surfaces), {}),
    "materials": materials_of,
    "labels": labels_of,
    "video": lambda surfaces: (video_of(surfaces), {}),
}


def render_surfaces(
    scene: RenderScene, view: View, kinds: Iterable[Kind], seed: int = 0
) -> dict[Kind, Result]:
    """Render some kinds of `SURFACES`, each with the same bits alone and with the others."""
    kinds = tuple(kinds)
    surfaces = visible_surfaces(
        scene, view, colors="inputs" in kinds, textures="materials" in kinds
    )
    return {kind: MAKERS[kind](surfaces) for kind in kinds}
