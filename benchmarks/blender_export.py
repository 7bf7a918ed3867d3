"""Rendering of an exported GLB by Blender Cycles, run by an interpreter that has `bpy`.

    python -P blender_export.py JOB.json

JOB.json: {"glb": path, "sky": path or "", "camera": name, "fov_x": radians, "width", "height",
"spp", "bounces", "out": path of an EXR}. The program imports nothing of pbrnet and does what a user
does in Blender: import with the lighting mode "Unitless", sky image as world. It prints a line that
begins with "@": version, objects, images, those that are missing, lamps and seconds of rendering.

With "Unitless", the sun's strength is the file's lux, a lamp's watts are 4 pi candela, and emission
is in cd/m^2, so that all light has one unit and the picture is in cd/m^2. ("Standard" divides sun
and lamps by 683 lm/W, but not the emission of surfaces.)
"""

from __future__ import annotations

import json
import math
import sys
import time
from pathlib import Path
from typing import Any

import bpy


def main(path: Path) -> None:
    """Open the file, then render one of its cameras."""
    job = json.loads(path.read_text(encoding="utf-8"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(
        filepath=job["glb"], export_import_convert_lighting_mode="COMPAT", import_shading="NORMALS"
    )
    scene = bpy.context.scene
    if job["sky"]:
        add_sky(scene, job["sky"])
    scene.camera = next(one for one in scene.objects if one.type == "CAMERA"
                        and job["camera"] in (one.name, one.data.name))  # fmt: skip
    scene.camera.data.sensor_fit = (
        "HORIZONTAL"  # the file's camera keeps its vertical field of view
    )
    scene.camera.data.angle = job["fov_x"]
    settings(scene, job)
    started = time.perf_counter()
    bpy.ops.render.render()
    seconds = time.perf_counter() - started
    bpy.data.images["Render Result"].save_render(job["out"], scene=scene)
    images = [one for one in bpy.data.images if one.source == "FILE"]
    found = {
        "version": bpy.app.version_string,
        "objects": sum(one.type == "MESH" for one in scene.objects),
        "lamps": sum(one.type == "LIGHT" for one in scene.objects),
        "images": len(images),
        "missing": [one.name for one in images if 0 in tuple(one.size) or not one.has_data],
        "seconds": seconds,
    }
    print("@" + json.dumps(found), flush=True)


def add_sky(scene: Any, file: str) -> None:
    """Make the image of the sky the world: its middle towards +Y, right of it +X."""
    world = bpy.data.worlds.new("sky")
    world.use_nodes = True
    tree = world.node_tree
    image = tree.nodes.new("ShaderNodeTexEnvironment")
    image.image = bpy.data.images.load(file)
    image.image.colorspace_settings.name = "Linear Rec.709"
    place = tree.nodes.new("ShaderNodeMapping")
    place.inputs["Rotation"].default_value[2] = -math.pi / 2  # Blender's middle is +X
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    tree.links.new(coordinates.outputs["Generated"], place.inputs["Vector"])
    tree.links.new(place.outputs["Vector"], image.inputs["Vector"])
    tree.links.new(image.outputs["Color"], tree.nodes["Background"].inputs["Color"])
    scene.world = world


def settings(scene: Any, job: dict[str, Any]) -> None:
    """Set a path tracer without clamping, with caustics and as many bounces as ours."""
    cycles, picture = scene.cycles, scene.render
    picture.engine, cycles.device = "CYCLES", "CPU"
    picture.threads_mode, picture.threads = "FIXED", job.get("threads", 1)
    picture.resolution_x, picture.resolution_y = job["width"], job["height"]
    picture.resolution_percentage = 100
    picture.dither_intensity = 0.0
    picture.image_settings.file_format = "OPEN_EXR"
    picture.image_settings.color_mode = "RGB"
    picture.image_settings.color_depth = "32"
    cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising = job["spp"], False, False
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = cycles.blur_glossy = 0.0
    cycles.pixel_filter_type = "BOX"
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = job["bounces"]
    cycles.transmission_bounces = cycles.transparent_max_bounces = job["bounces"]


if __name__ == "__main__":
    main(Path(sys.argv[1]))
