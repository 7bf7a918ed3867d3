"""Baseline of the ground truth stage: a plain loop of `mi.render` over the views.

    python -m benchmarks.plain_loop DATA PARAMS [--joint]

Renders colour and textureless shading of every view under DATA, separately or (`--joint`) from one
trace of paths, and writes nothing.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from pbrnet.pipeline.params import load_params
from pbrnet.pipeline.passes.groundtruth import render_both
from pbrnet.pipeline.passes.settings import GroundTruthParams
from pbrnet.pipeline.render.scene import open_scene, set_variant
from pbrnet.pipeline.views import View, load_cameras
from pbrnet.scenes.contract import load_scene, scene_folders


def plain_sensor(view: View, sampler: str) -> Any:
    """Return a view's camera in the form of Mitsuba's documentation."""
    return mi.load_dict(
        {
            "type": "perspective",
            "fov": float(np.degrees(2 * np.arctan(view.width / 2 / view.K[0][0]))),
            "to_world": mi.ScalarTransform4f(view.pose @ np.diag([-1.0, -1.0, 1.0, 1.0])),
            "sampler": {"type": sampler},
            "film": {
                "type": "hdrfilm",
                "width": view.width,
                "height": view.height,
                "rfilter": {"type": "box"},
            },
        }
    )


def plain_loop(data: Path, truth: GroundTruthParams, grey: float) -> None:
    """Render all views of all scenes with Mitsuba's film and path tracer."""
    integrator = mi.load_dict({"type": "path", "max_depth": truth.max_depth})
    for folder in scene_folders(data / "scenes"):
        scene = open_scene(load_scene(folder))
        views = load_cameras(data / "cameras" / f"{folder.name}.json").views
        for world in (scene, scene.neutral(grey)):
            for view in views:
                sensor = plain_sensor(view, "multijitter")
                image = mi.render(
                    world.mitsuba, sensor=sensor, integrator=integrator, spp=truth.spp
                )
                np.array(image)


def joint_loop(data: Path, truth: GroundTruthParams, grey: float) -> None:
    """Render the same images from joint traces."""
    for folder in scene_folders(data / "scenes"):
        scene = open_scene(load_scene(folder))
        for view in load_cameras(data / "cameras" / f"{folder.name}.json").views:
            render_both(scene, view, truth, grey, seed=0)


if __name__ == "__main__":
    set_variant()
    loop = joint_loop if sys.argv[3:] == ["--joint"] else plain_loop
    params = load_params(Path(sys.argv[2]))
    loop(Path(sys.argv[1]), params.groundtruth, params.shading.albedo)
