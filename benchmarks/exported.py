"""Mean luminance of an exported GLB in Blender Cycles against pbrnet's rendering of the scene.

    python -m benchmarks.exported data/scenes/home-0000 room-0-s3 --bpy PYTHON

PYTHON is an interpreter that has `bpy`. The view is one of the scene's camera file, at its size.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR

from benchmarks.bench import ROOT, pixels
from pbrnet.pipeline.passes.groundtruth import render_truth
from pbrnet.pipeline.passes.settings import GroundTruthParams
from pbrnet.pipeline.render.scene import open_scene, set_variant
from pbrnet.pipeline.scene_export.export import export_scene
from pbrnet.pipeline.views import View, load_cameras
from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.color import luminance
from pbrnet.scenes.contract import load_scene
from pbrnet.scenes.files import temporary_folder
from pbrnet.scenes.photometry import LUMEN

_PROGRAM = ROOT / "benchmarks" / "blender_export.py"
# Mitsuba counts the segments from the camera to the light, Cycles the bounces between.
_BOUNCES = GroundTruthParams().max_depth - 2


@dataclass(frozen=True)
class Opened:
    """The picture of Cycles in cd/m^2, (H, W, 3), and what Blender found in the file."""

    image: Float64Array
    found: dict[str, Any]  # version, objects, lamps, images, missing, seconds


def in_blender(bpy: Path, glb: Path, view: View, spp: int, threads: int) -> Opened:
    """Open a GLB in Blender and render the view, a camera of that name in the file.

    Raises `RuntimeError` with Blender's last words if it fails.
    """
    sky = glb.with_name(f"{glb.stem}-sky.exr")
    out, job = glb.with_suffix(".exr"), glb.with_suffix(".job")
    content = {
        "glb": str(glb),
        "sky": str(sky) if sky.exists() else "",
        "camera": view.view_id,
        "fov_x": 2 * math.atan(0.5 * view.width / view.K[0][0]),
        "width": view.width,
        "height": view.height,
        "spp": spp,
        "bounces": _BOUNCES,
        "threads": threads,
        "out": str(out),
    }
    job.write_text(json.dumps(content), encoding="utf-8")
    command = [str(bpy), "-P", str(_PROGRAM), str(job)]
    done = subprocess.run(command, capture_output=True, text=True)
    answers = [line[1:] for line in done.stdout.splitlines() if line.startswith("@")]
    if not answers:
        raise RuntimeError((done.stderr or done.stdout)[-1000:])
    with OpenEXR.File(str(out)) as file:
        return Opened(np.array(file.channels()["RGB"].pixels, np.float64), json.loads(answers[0]))


def in_pbrnet(folder: Path, view: View, spp: int) -> Float64Array:
    """Return pbrnet's picture of the view in cd/m^2, (H, W, 3)."""
    set_variant("auto")
    params = GroundTruthParams().sampled(spp)
    return pixels(render_truth(open_scene(load_scene(folder)), view, params, 0)) / LUMEN


def main() -> None:
    """Print what Blender found, and the ratio of mean luminance."""
    parser = argparse.ArgumentParser(description="An exported scene in Blender and in pbrnet.")
    parser.add_argument("scene", type=Path, help="scene folder in a data folder with cameras")
    parser.add_argument("view")
    parser.add_argument("--bpy", type=Path, required=True, help="interpreter that has bpy")
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--threads", type=int, default=2)
    options = parser.parse_args()
    cameras = options.scene.parent.parent / "cameras" / f"{options.scene.name}.json"
    (view,) = [one for one in load_cameras(cameras).views if one.view_id == options.view]
    with temporary_folder() as work:
        glb = work / f"{options.scene.name}.glb"
        export_scene(options.scene, "glb", glb)
        opened = in_blender(options.bpy, glb, view, options.spp, options.threads)
    ours = in_pbrnet(options.scene, view, options.spp)
    ratio = luminance(opened.image).mean() / luminance(ours).mean()
    print(json.dumps(opened.found))
    print(f"{options.scene.name} {view.view_id}: mean luminance of Cycles / pbrnet {ratio:.3f}")


if __name__ == "__main__":
    main()
