"""Render server for Blender Cycles, run by an interpreter that has `bpy`.

    python -P blender_program.py SCENE.json

SCENE.json has a camera, the windows and the greatest depth. `benchmarks.clay` adds PLY meshes with
a diffuse colour each and a constant sky, `benchmarks.furnished` a GLB, the file of its sky or "",
and its thin sheets: by material the share of diffuse light that passes. The program imports nothing
of pbrnet.

A GLB is imported as a user does, with the lighting mode "Unitless": the sun's strength is the
file's lux, a lamp's watts are 4 pi candela, and emission is in cd/m^2, so that all light has one
unit and the picture is in cd/m^2. ("Standard" divides sun and lamps by 683 lm/W, but not the
emission of surfaces.) Materials are then changed to reflect what Mitsuba's do, thin sheets pass
light, and emitters are dark on their back.

For each line on standard input, {"spp": 64, "seed": 1, "denoise": "", "out": "image.exr"}, the
program prints a line that begins with "@": the rendering time in processor and wall seconds.
Further words: "camera" replaces that of SCENE.json; "portals", "guiding" and "light_tree" are true
or false; "noise" is the threshold of adaptive sampling, 0 for none.

The other settings are those of an unbiased path tracer: no clamping or blurred caustics, one-pixel
box filter, linear Rec. 709. "denoise" names the prefilter of the guides, albedo and normal, for
Open Image Denoise: "ACCURATE", as Blender sets it, or "FAST"; "QUICK" is "FAST", and the denoiser's
quality "FAST", too, in place of "HIGH"; "" is no denoiser. Data stay in memory between renders
(`use_persistent_data`), so that from the second render on only rendering is timed. Writing the file
is not.
"""

from __future__ import annotations

import json
import math
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
    if "glb" in description:
        open_glb(description["glb"], description["thin"])
    for mesh in description.get("meshes", ()):
        add_mesh(path.parent / mesh["file"], mesh["name"], mesh["reflectance"])
    add_sky(scene, description["sky"])
    add_camera(scene, description["camera"])
    portals = [add_portal(scene, corners) for corners in description["windows"]]
    settings(scene, description)
    images = [one for one in bpy.data.images if one.source == "FILE"]
    answer(
        version=bpy.app.version_string,
        objects=sum(one.type == "MESH" for one in scene.objects),
        lamps=sum(one.type == "LIGHT" for one in scene.objects) - len(portals),
        images=len(images),
        missing=[one.name for one in images if 0 in tuple(one.size)],
    )
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


def open_glb(file: str, thin: dict[str, float]) -> None:
    """Import a scene; give its materials the reflection that they have in Mitsuba."""
    bpy.ops.import_scene.gltf(
        filepath=file, export_import_convert_lighting_mode="COMPAT", import_shading="NORMALS"
    )
    for material in bpy.data.materials:
        surface = next(
            (one for one in material.node_tree.nodes if one.type == "BSDF_PRINCIPLED"), None
        )
        if surface is None:
            continue
        nodes = Nodes(material.node_tree, surface)
        nodes.darken_back()
        surface.distribution = "GGX"  # without the light of further bounces between microfacets
        surface.inputs["Sheen Weight"].default_value = 0.0  # far more than Disney's
        name = material.name.rpartition(".")[0] or material.name  # Blender numbers equal names
        through = thin.get(material.name, thin.get(name))
        if through is not None:
            nodes.let_through(through)
        elif nodes.is_matt():
            stated = dict(material.get("pbrnet") or {})
            if stated.get("bsdf") == "diffuse":
                nodes.add_diffuse(nodes.input("Base Color"))
            else:
                nodes.add_diffuse(nodes.disney(stated.get("lift", 1.0)))


class Nodes:
    """The nodes of a material, with the Principled BSDF that the importer made."""

    def __init__(self, tree: Any, surface: Any) -> None:
        self.tree, self.surface = tree, surface

    def add(self, kind: str, *given: Any, operation: str = "") -> Any:
        """Add a node, with a value or a socket for each input; None leaves one as it is."""
        made = self.tree.nodes.new(kind)
        if operation:
            made.operation = operation
        for socket, value in zip(made.inputs, given, strict=False):
            if isinstance(value, bpy.types.NodeSocket):
                self.tree.links.new(value, socket)
            elif value is not None:
                socket.default_value = value
        return made

    def math(self, operation: str, *given: Any) -> Any:
        """Return the result of an operation on numbers or sockets."""
        return self.add("ShaderNodeMath", *given, operation=operation).outputs[0]

    def input(self, name: str) -> Any:
        """Return the socket that an input of the surface is linked to, else its value."""
        socket = self.surface.inputs[name]
        return socket.links[0].from_socket if socket.links else socket.default_value

    def replace(self, shader: Any) -> None:
        """Put a shader in the place of the surface."""
        for link in list(self.surface.outputs["BSDF"].links):
            if link.to_node != shader.node:
                self.tree.links.new(shader, link.to_socket)

    def darken_back(self) -> None:
        """Let an emitter shine on its front alone."""
        strength = self.surface.inputs["Emission Strength"]
        if (most := strength.default_value) > 0:
            back = self.add("ShaderNodeNewGeometry").outputs["Backfacing"]
            self.tree.links.new(self.math("MULTIPLY_ADD", back, -most, most), strength)

    def let_through(self, share: float) -> None:
        """Make the surface a matt sheet that passes this share of its diffuse light."""
        color = self.input("Base Color")
        sides = [
            self.add(kind, color).outputs[0]
            for kind in ("ShaderNodeBsdfDiffuse", "ShaderNodeBsdfTranslucent")
        ]
        self.add_lobe(self.add("ShaderNodeMixShader", share, *sides).outputs[0])

    def is_matt(self) -> bool:
        """Return whether the surface is opaque and no metal: its metallic image counts 0 times."""
        metallic = self.surface.inputs["Metallic"]
        factor = metallic.default_value
        if metallic.links:
            factor = min(
                (one.default_value for one in metallic.links[0].from_node.inputs
                 if not one.links and one.type == "VALUE"), default=1.0,
            )  # fmt: skip
        opaque = self.input("Alpha") == 1.0 and self.input("Transmission Weight") == 0.0
        return bool(opaque and factor == 0.0)

    def disney(self, lift: float) -> Any:
        """Return the colour of a Lambertian lobe with the albedo of Disney's in each direction.

        Within 0.4 %, and 2.3 % where it is dark, rough and seen at 75 degrees. `lift` is the factor
        by which the exported base colour is greater.
        """
        rough, color = self.input("Roughness"), self.input("Base Color")
        far = self.add("ShaderNodeLayerWeight", 0.5, self.normal()).outputs["Facing"]  # 1 - cosine
        near = self.math("SUBTRACT", 1.0, far)
        # What grazing light and a grazing view gain or lose, by mean angles between them.
        light, view = (
            self.math("MULTIPLY_ADD", rough, self.math("MULTIPLY_ADD", near, share, 1.0), -0.5)
            for share in (1 / 4, 2 / 3)
        )
        factor = self.math(
            "MULTIPLY",
            self.math("MULTIPLY_ADD", light, 1 / (21 * lift), 1 / lift),
            self.math("MULTIPLY_ADD", view, self.math("POWER", far, 5.0), 1.0),
        )
        scaled = self.add("ShaderNodeVectorMath", color if isinstance(color, bpy.types.NodeSocket)
                          else tuple(color)[:3], operation="SCALE")  # fmt: skip
        self.tree.links.new(factor, scaled.inputs["Scale"])
        return scaled.outputs[0]

    def normal(self) -> Any:
        """Return the socket of the normal map, or None."""
        normal = self.input("Normal")
        return normal if isinstance(normal, bpy.types.NodeSocket) else None

    def add_diffuse(self, color: Any) -> None:
        """Put a Lambertian lobe in the place of the surface's diffuse one."""
        self.add_lobe(self.add("ShaderNodeBsdfDiffuse", color, 0.0, self.normal()).outputs[0])

    def add_lobe(self, lobe: Any) -> None:
        """Add a lobe to the specular one and the emission, as Mitsuba does, without the diffuse."""
        for link in list(self.surface.inputs["Base Color"].links):
            self.tree.links.remove(link)
        self.surface.inputs["Base Color"].default_value = (0.0, 0.0, 0.0, 1.0)
        both = self.add("ShaderNodeAddShader", lobe, self.surface.outputs["BSDF"])
        self.replace(both.outputs[0])


def add_sky(scene: Any, sky: float | str) -> None:
    """Make a constant radiance or an image the world: its middle towards +Y, right of it +X."""
    world = bpy.data.worlds.new("sky")
    world.use_nodes = True
    scene.world = world
    tree = world.node_tree
    background = tree.nodes["Background"]
    background.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    if not isinstance(sky, str) or not sky:
        background.inputs["Strength"].default_value = sky or 0.0
        return
    image = tree.nodes.new("ShaderNodeTexEnvironment")
    image.image = bpy.data.images.load(sky)
    image.image.colorspace_settings.name = "Linear Rec.709"
    place = tree.nodes.new("ShaderNodeMapping")
    place.inputs["Rotation"].default_value[2] = -math.pi / 2  # Blender's middle is +X
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    tree.links.new(coordinates.outputs["Generated"], place.inputs["Vector"])
    tree.links.new(place.outputs["Vector"], image.inputs["Vector"])
    tree.links.new(image.outputs["Color"], background.inputs["Color"])


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
    """Set an unbiased path tracer with the given number of bounces."""
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
    cycles.denoiser, cycles.denoising_input_passes = "OPENIMAGEDENOISE", "RGB_ALBEDO_NORMAL"
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = cycles.blur_glossy = 0.0
    cycles.pixel_filter_type = "BOX"
    # Bounces after the first hit; Mitsuba counts the segments from the camera to the light.
    bounces = description["max_depth"] - 2
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = bounces
    cycles.transmission_bounces = cycles.transparent_max_bounces = bounces


def render(scene: Any, portals: list[Any], job: dict[str, Any]) -> dict[str, float]:
    """Render one image to a file; returns the seconds of rendering and denoising."""
    if "camera" in job:
        aim(scene, job["camera"])
    cycles = scene.cycles
    cycles.samples, cycles.seed = job["spp"], job["seed"]
    cycles.use_guiding = job.get("guiding", False)
    cycles.use_light_tree = job.get("light_tree", False)
    cycles.use_adaptive_sampling = bool(job.get("noise"))
    if cycles.use_adaptive_sampling:
        cycles.adaptive_threshold = job["noise"]
    cycles.use_denoising = bool(job["denoise"])
    if job["denoise"]:
        quick = job["denoise"] == "QUICK"
        cycles.denoising_prefilter = "FAST" if quick else job["denoise"]
        cycles.denoising_quality = "FAST" if quick else "HIGH"
    for portal in portals:
        portal.hide_render = not job.get("portals", False)
    usage, started = resource.getrusage(resource.RUSAGE_SELF), time.perf_counter()
    bpy.ops.render.render()
    wall, after = time.perf_counter() - started, resource.getrusage(resource.RUSAGE_SELF)
    bpy.data.images["Render Result"].save_render(job["out"], scene=scene)
    cpu = after.ru_utime + after.ru_stime - usage.ru_utime - usage.ru_stime
    return {"cpu": cpu, "wall": wall}


if __name__ == "__main__":
    main(Path(sys.argv[1]))
