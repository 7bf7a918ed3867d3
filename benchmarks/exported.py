"""Mean luminance of an exported GLB in Blender Cycles against pbrnet's rendering of the scene.

    python -m benchmarks.exported data/scenes/home-0000 room-0-s3 --bpy PYTHON

PYTHON is an interpreter that has `bpy`. The view is one of the scene's camera file, at its size.
"""

from __future__ import annotations

import argparse
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.bench import pixels
from benchmarks.clay import camera_for_blender, windows_of
from benchmarks.cycles import blender
from pbrnet.pipeline.passes.groundtruth import render_truth
from pbrnet.pipeline.passes.settings import GroundTruthParams
from pbrnet.pipeline.render.scene import open_scene, set_variant
from pbrnet.pipeline.scene_export.export import export_scene
from pbrnet.pipeline.views import View, load_cameras
from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.color import luminance
from pbrnet.scenes.contract import Scene, load_scene
from pbrnet.scenes.files import temporary_folder, write_json
from pbrnet.scenes.photometry import LUMEN

_PASSING = "KHR_materials_diffuse_transmission"


def write_job(scene: Scene, view: View, threads: int, folder: Path) -> None:
    """Export a scene to the folder, with `cycles.json` for `benchmarks/blender_program.py`."""
    glb = folder / f"{scene.scene_id}.glb"
    export_scene(scene.folder, "glb", glb)
    sky = glb.with_name(f"{glb.stem}-sky.exr")
    description = {
        "glb": str(glb),
        "thin": thin_sheets(glb.read_bytes()),
        "sky": str(sky) if sky.exists() else "",
        "camera": camera_for_blender(view),
        "windows": windows_of(scene.portals),
        "max_depth": GroundTruthParams().max_depth,
        "threads": threads,
    }
    write_json(folder / "cycles.json", description)


def thin_sheets(glb: bytes) -> dict[str, float]:
    """Return by material the share of diffuse light that passes; Blender does not read it."""
    (size,) = struct.unpack_from("<I", glb, 12)
    materials: list[dict[str, Any]] = json.loads(glb[20 : 20 + size]).get("materials", [])
    return {
        one["name"]: one["extensions"][_PASSING]["diffuseTransmissionFactor"]
        for one in materials
        if _PASSING in one.get("extensions", {})
    }


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
        write_job(load_scene(options.scene), view, options.threads, work)
        with blender(options.bpy, work) as other:
            image, spent = other.picture(options.spp, 0)
            print(json.dumps({**other.found, "seconds": spent.wall}))
    ours = in_pbrnet(options.scene, view, options.spp)
    ratio = luminance(np.asarray(image, np.float64)).mean() / luminance(ours).mean()
    print(f"{options.scene.name} {view.view_id}: mean luminance of Cycles / pbrnet {ratio:.3f}")


if __name__ == "__main__":
    main()
