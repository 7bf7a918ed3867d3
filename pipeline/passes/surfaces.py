"""Frames of what pixel centres see: inputs, materials, labels and video, from the same rays."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping

from pbrnet.pipeline.channels import Kind
from pbrnet.pipeline.frames import Result
from pbrnet.pipeline.passes.inputs import VisibleSurfaces, inputs_of, visible_surfaces
from pbrnet.pipeline.passes.labels import labels_of
from pbrnet.pipeline.passes.materials import materials_of
from pbrnet.pipeline.passes.video import video_of
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.pipeline.views import View

Names = Collection[str] | None  # of a kind's channels, where not all of them are asked for
MAKERS: dict[Kind, Callable[[VisibleSurfaces, Names], Result]] = {
    "inputs": lambda surfaces, names: (inputs_of(surfaces), {}),
    "materials": lambda surfaces, names: materials_of(surfaces, names),
    "labels": lambda surfaces, names: labels_of(surfaces),
    "video": lambda surfaces, names: (video_of(surfaces), {}),
}


def render_surfaces(
    scene: RenderScene, view: View, kinds: Iterable[Kind] | Mapping[Kind, Names], seed: int = 0
) -> dict[Kind, Result]:
    """Render some kinds of `SURFACES`, each with the same bits alone and with the others.

    Of materials, the channels with the names that `kinds` has for them, if any, are enough.
    """
    names = kinds if isinstance(kinds, Mapping) else dict.fromkeys(kinds)
    surfaces = visible_surfaces(
        scene, view, colors="inputs" in names, textures="materials" in names
    )
    return {kind: MAKERS[kind](surfaces, names[kind]) for kind in names}
