"""A single view of a scene, rendered in this process."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pbrnet.pipeline.channels import RGB
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.passes.registry import render, settings_of
from pbrnet.pipeline.render.scene import open_scene, set_variant
from pbrnet.pipeline.views import ImageParams, View, as_matrix, camera_model, look
from pbrnet.scenes.arrays import Float32Array
from pbrnet.scenes.contract import Scene, load_scene
from pbrnet.scenes.seeds import derive


def view_at(
    eye: Sequence[float],
    target: Sequence[float],
    image: ImageParams | None = None,
    name: str = "view",
) -> View:
    """Return a view from `eye` towards `target`, metres, z up; `image` gives size and lens."""
    pose = look(eye, np.subtract(target, eye))
    return View(
        "scene", name, camera_to_world=as_matrix(pose), **camera_model(image or ImageParams())
    )


def render_view(scene: Scene | Path, view: View, params: Params | None = None) -> Float32Array:
    """Path-trace the colour of a view: float32 (H, W, 3), linear radiance.

    `scene` is a scene or its folder. `params.groundtruth` has samples, depth and denoiser,
    `params.seed` the seed, `params.farm.variant` Mitsuba's variant. Raises `InputError` for a
    scene that cannot be opened.
    """
    params = params or Params()
    set_variant(params.farm.variant)
    opened = open_scene(scene if isinstance(scene, Scene) else load_scene(Path(scene)))
    seed = derive(params.seed, view.view_id)
    channels, _ = render(opened, view, settings_of(params, ["color"]), seed)["color"]
    return np.stack([channels[band] for band in RGB], axis=-1).astype(np.float32)
