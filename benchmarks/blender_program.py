"""Render server for Blender Cycles, run by an interpreter that has `bpy`.

    python -P blender_program.py SCENE.json

SCENE.json is written by `benchmarks.clay`: PLY meshes with a diffuse colour each, a camera, a
constant sky, and windows. The program imports nothing of pbrnet. For each line on standard input,
{"spp": 64, "seed": 1, "portals": false, "denoise": "", "out": "image.exr"}, it prints a line
that begins with "@": the rendering time in processor and wall seconds. A "camera" in the line
replaces that of SCENE.json.

The settings are those of a plain path tracer: no clamping, adaptive sampling or light tree;
one-pixel box filter, linear Rec. 709. "denoise" names the prefilter of the guides, albedo and
normal, for Open Image Denoise: "ACCURATE", as Blender sets it, or "FAST"; "QUICK" is "FAST", and
the denoiser's quality "FAST", too, in place of "HIGH"; "" is no denoiser. Data stay in memory
between renders (`use_persistent_data`), so that from the second render on only rendering is timed.
Writing the file is not.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from pathlib import Path
from typing import Any

import bpy
from mathutils import Matrix, Vector


def main(path: Path) -> None:
    """Build the scene, then render the requests until standard input ends."""
    description = json.loads(path.read_text(encoding="utf-8"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    for mesh in description["meshes"]:
        add_mesh(path.parent / mesh["file"], mesh["name"], mesh["reflectance"])
    add_sky(scene, description["sky"])
    add_camera(scene, description["camera"])
    portals = [add_portal(scene, corners) for corners in description["windows"]]
    settings(scene, description)
    answer(version=bpy.app.version_string, meshes=len(description["meshes"]))
    for line in sys.stdin:
        answer(**render(scene, portals, json.loads(line)))


def answer(**fields: Any) -> None:
    """Print one answer line; Blender itself prints to the same stream."""
    print("@" + json.dumps(fields), flush=True)


def add_mesh(file: Path, name: str, reflectance: list[float]) -> None:
    """Add a flat-shaded mesh with a diffuse material."""
    bpy.ops.wm.ply_import(filepath=str(file), forward_axis="Y", up_axis="Z", merge_verts=False)
    node = bpy.context.selected_objects[0]
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    diffuse.inputs["Color"].default_value = (*reflectance, 1.0)
    diffuse.inputs["Roughness"].default_value = 0.0
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(diffuse.outputs["BSDF"], output.inputs["Surface"])
    node.data.materials.clear()
    node.data.materials.append(material)
    node.data.shade_flat()


def add_sky(scene: Any, radiance: float) -> None:
    """Add a constant environment."""
    world = bpy.data.worlds.new("sky")
    world.use_nodes = True
    background = world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    background.inputs["Strength"].default_value = radiance
    scene.world = world


def add_camera(scene: Any, camera: dict[str, Any]) -> None:
    """Add a camera from `camera_to_world` in OpenCV axes; Blender's looks along -z, y up."""
    data = bpy.data.cameras.new("camera")
    data.sensor_fit = "HORIZONTAL"
    data.clip_start, data.clip_end = 1e-3, 1e5
    node = bpy.data.objects.new("camera", data)
    scene.collection.objects.link(node)
    scene.camera = node
    aim(scene, camera)


def aim(scene: Any, camera: dict[str, Any]) -> None:
    """Set pose, field of view and image size."""
    node, picture = scene.camera, scene.render
    node.data.angle = camera["fov_x"]
    node.matrix_world = Matrix(camera["camera_to_world"]) @ Matrix.Diagonal((1, -1, -1, 1))
    picture.resolution_x, picture.resolution_y = camera["width"], camera["height"]


def add_portal(scene: Any, corners: list[list[float]]) -> Any:
    """Add a light portal: a rectangle by a corner, its two neighbours and the inward normal."""
    corner, first, second, inward = (Vector(values) for values in corners)
    across, along = first - corner, second - corner
    data = bpy.data.lights.new("portal", "AREA")
    data.shape, data.size, data.size_y = "RECTANGLE", across.length, along.length
    data.cycles.is_portal = True
    node = bpy.data.objects.new("portal", data)
    scene.collection.objects.link(node)
    x, z = across.normalized(), -inward.normalized()  # lamps shine along their -z
    y = z.cross(x)
    turn = Matrix((x, y, z)).transposed().to_4x4()
    node.matrix_world = Matrix.Translation(corner + (across + along) / 2) @ turn
    return node


def settings(scene: Any, description: dict[str, Any]) -> None:
    """Set a plain path tracer with the given number of bounces."""
    cycles, picture = scene.cycles, scene.render
    picture.engine = "CYCLES"
    cycles.device = "CPU"
    picture.threads_mode, picture.threads = "FIXED", description["threads"]
    picture.resolution_percentage = 100
    picture.use_persistent_data = True
    picture.dither_intensity = 0.0
    picture.image_settings.file_format = "OPEN_EXR"
    picture.image_settings.color_mode = "RGB"
    picture.image_settings.color_depth = "32"
    picture.image_settings.exr_codec = "ZIP"
    cycles.use_adaptive_sampling = False
    cycles.denoiser, cycles.denoising_input_passes = "OPENIMAGEDENOISE", "RGB_ALBEDO_NORMAL"
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    cycles.pixel_filter_type = "BOX"
    # Bounces after the first hit; Mitsuba counts the segments from the camera to the light.
    bounces = description["max_depth"] - 2
    cycles.max_bounces = cycles.diffuse_bounces = bounces


def render(scene: Any, portals: list[Any], job: dict[str, Any]) -> dict[str, float]:
    """Render one image to a file; returns the seconds of rendering and denoising."""
    if "camera" in job:
        aim(scene, job["camera"])
    scene.cycles.samples, scene.cycles.seed = job["spp"], job["seed"]
    scene.cycles.use_denoising = bool(job["denoise"])
    if job["denoise"]:
        quick = job["denoise"] == "QUICK"
        scene.cycles.denoising_prefilter = "FAST" if quick else job["denoise"]
        scene.cycles.denoising_quality = "FAST" if quick else "HIGH"
    for portal in portals:
        portal.hide_render = not job["portals"]
    usage, started = resource.getrusage(resource.RUSAGE_SELF), time.perf_counter()
    bpy.ops.render.render()
    wall, after = time.perf_counter() - started, resource.getrusage(resource.RUSAGE_SELF)
    bpy.data.images["Render Result"].save_render(job["out"], scene=scene)
    cpu = after.ru_utime + after.ru_stime - usage.ru_utime - usage.ru_stime
    return {"cpu": cpu, "wall": wall}


if __name__ == "__main__":
    main(Path(sys.argv[1]))
