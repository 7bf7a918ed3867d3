"""The four kinds of frames in one table: how each is rendered, and all that determines its pixels.

A frame's fingerprint is a digest over exactly that: the pass and its revision, the parameters it
reads, the view's camera and size, the scene's content, the renderer, the seed. What does not
change a pixel (scores, the farm, training) is not in it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from pipeline import groundtruth, illumination, inputs
from pipeline.denoise import denoise, denoiser_version, grey_guide, guides
from pipeline.frames import Channels, Kind, fingerprint
from pipeline.groundtruth import render_truth
from pipeline.illumination import render_illumination
from pipeline.inputs import render_inputs
from pipeline.params import Params
from pipeline.renderer import RenderScene
from pipeline.views import View
from scenes.checked import plain
from scenes.seeds import derive

Render = Callable[[RenderScene, View, Params, int], tuple[Channels, dict[str, Any]]]


@dataclass(frozen=True)
class Pass:
    """One kind of frame: `render` gives its channels and what else goes into its attribute."""

    revision: int
    determined_by: Callable[[Params], dict[str, Any]]
    render: Render
    seeded: bool = False  # whether chance has a part in it


def _inputs(
    scene: RenderScene, view: View, params: Params, seed: int
) -> tuple[Channels, dict[str, Any]]:
    return render_inputs(scene, view), {}


def _illumination(
    scene: RenderScene, view: View, params: Params, seed: int
) -> tuple[Channels, dict[str, Any]]:
    return render_illumination(scene, view, params.illumination), {}


def _shading(
    scene: RenderScene, view: View, params: Params, seed: int
) -> tuple[Channels, dict[str, Any]]:
    grey = params.shading.albedo
    channels, stats = render_truth(scene.neutral(grey), view, params.groundtruth, seed)
    if params.groundtruth.denoise == "none":
        return channels, stats
    _, normal = guides(scene, view)
    clean = denoise(channels, grey_guide(normal, grey), normal)
    return clean, {**stats, "denoiser": denoiser_version()}


def _color(
    scene: RenderScene, view: View, params: Params, seed: int
) -> tuple[Channels, dict[str, Any]]:
    channels, stats = render_truth(scene, view, params.groundtruth, seed)
    if params.groundtruth.denoise == "none":
        return channels, stats
    return denoise(channels, *guides(scene, view)), {**stats, "denoiser": denoiser_version()}


def _truth_determined_by(params: Params) -> dict[str, Any]:
    used = params.groundtruth.denoise != "none"
    return {
        "truth": plain(params.groundtruth),
        "denoiser": [denoiser_version(), inputs.REVISION] if used else None,
    }


PASSES: dict[Kind, Pass] = {
    "inputs": Pass(inputs.REVISION, lambda params: {}, _inputs),
    "illumination": Pass(
        illumination.REVISION, lambda params: plain(params.illumination), _illumination
    ),
    "shading": Pass(
        groundtruth.REVISION,
        lambda params: {**_truth_determined_by(params), "shading": plain(params.shading)},
        _shading,
        seeded=True,
    ),
    "color": Pass(
        groundtruth.REVISION,
        _truth_determined_by,
        _color,
        seeded=True,
    ),
}


def pass_seed(kind: Kind, view: View, root: int) -> int:
    """The seed of one pass over one view, descended from the root seed."""
    return derive(root, "scene", view.scene_id, "view", view.view_id, kind)


def camera_of(view: View) -> View:
    """The part of a view that determines pixels: without its score and what was seen."""
    return replace(view, score=0.0, seen={})


def frame_fingerprint(
    kind: Kind, view: View, params: Params, scene_digest: str, renderer: str
) -> str:
    """The fingerprint of a frame; see this module's docstring for what is in it."""
    made_by = PASSES[kind]
    return fingerprint(
        kind=kind,
        revision=made_by.revision,
        params=made_by.determined_by(params),
        view=camera_of(view),
        scene=scene_digest,
        renderer=renderer,
        seed=pass_seed(kind, view, params.seed) if made_by.seeded else None,
    )
