"""Script for Blender's own Python: opens a .blend or .fbx file and writes it as glTF.

Arguments: source file, folder whose files it may use, output folder, seconds of a processor, bytes
of memory. Output: `scene.glb` and `notes.json`, or `message` with the reason of a failure. It
imports nothing of this project, because that Python is another one. No script of the file runs.
"""

from __future__ import annotations

import json
import math
import os
import resource
import sys
from pathlib import Path
from typing import Any

import bpy

LUMENS_PER_WATT = 683.0  # as Blender's glTF exporter converts lamps
_LIT_WORLD = 0.2  # strength of a world from which it is the scene's sky
_SURFACES = ("BSDF_PRINCIPLED", "EMISSION", "BACKGROUND", "OUTPUT_MATERIAL", "TEX_IMAGE")
_SIDES = 32  # of a round area lamp


class Notes:
    """Sentences on losses and changes, and the files that were used."""

    def __init__(self) -> None:
        self.notes: dict[str, list[str]] = {}
        self.files: list[str] = []
        self.unit = 1.0  # metres
        self.outdoors = False

    def note(self, sentence: str, detail: str = "") -> None:
        """Record a sentence, in which `{}` stands for the details."""
        self.notes.setdefault(sentence, []).append(detail[:120])

    def save(self, path: Path) -> None:
        """Write everything as JSON."""
        path.write_text(json.dumps(vars(self)), "utf-8")


def main(source: str, root: str, out: str, seconds: str, memory: str) -> None:
    """Open `source`, prepare it and export it into the folder `out`."""
    for kind, soft, hard in (
        (resource.RLIMIT_CPU, int(seconds), int(seconds) + 5),
        (resource.RLIMIT_AS, int(memory), int(memory)),
        (resource.RLIMIT_CORE, 0, 0),
    ):
        _, largest = resource.getrlimit(kind)  # of this process, which may be limited already
        if largest != resource.RLIM_INFINITY:
            soft, hard = min(soft, largest), min(hard, largest)
        resource.setrlimit(kind, (soft, hard))
    notes = Notes()
    _open(Path(source), notes)
    _check_images(Path(root), notes)
    for scene_object in list(bpy.context.scene.objects):
        _note_lost(scene_object, notes)
        if scene_object.type == "CAMERA" and scene_object.data.type == "PANO":
            # glTF has none, and the exporter of Blender 5 fails on one.
            notes.note("a panoramic camera was left out: {}", scene_object.name)
            bpy.data.objects.remove(scene_object)
            continue
        if scene_object.type == "LIGHT" and scene_object.data.type == "AREA":
            _area_lamp(scene_object)
    for tree in [material.node_tree for material in bpy.data.materials if material.use_nodes]:
        _emission_in_candela(tree, notes)
    for tree in bpy.data.node_groups:
        if tree.bl_idname == "ShaderNodeTree":
            _emission_in_candela(tree, notes)
    _world(notes)
    _export(Path(out) / "scene.glb")
    notes.save(Path(out) / "notes.json")


def _open(source: Path, notes: Notes) -> None:
    bpy.context.preferences.filepaths.use_scripts_auto_execute = False
    if source.suffix.lower() == ".blend":
        bpy.ops.wm.open_mainfile(filepath=str(source), load_ui=False, use_scripts=False)
        notes.unit = float(bpy.context.scene.unit_settings.scale_length)
        for library in bpy.data.libraries:
            path = Path(bpy.path.abspath(library.filepath)).resolve()
            notes.files.append(str(path))
            if not path.is_file():
                notes.note("what the file takes from a missing file was left out: {}", path.name)
        return
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if "fbx_import" in dir(bpy.ops.wm):  # from version 4.5 on
        bpy.ops.wm.fbx_import(filepath=str(source), import_colors="LINEAR")
    else:
        bpy.ops.import_scene.fbx(filepath=str(source))


def _check_images(root: Path, notes: Notes) -> None:
    """Remove images that are missing or lie outside `root`."""
    for image in list(bpy.data.images):
        if image.packed_file or image.source not in ("FILE", "TILED") or not image.filepath:
            continue
        path = Path(bpy.path.abspath(image.filepath, library=image.library)).resolve()
        if path.is_relative_to(root) and path.is_file():
            notes.files.append(str(path))
            continue
        name = Path(image.filepath.replace("\\", "/")).name
        found = next((one for one in sorted(root.rglob(name)) if one.is_file()), None)
        if found is not None:
            image.filepath = str(found)
            notes.files.append(str(found))
            notes.note("files were found under another path: {}", name)
        else:
            bpy.data.images.remove(image)
            notes.note("missing texture, replaced by the plain colour: {}", name)


def _note_lost(scene_object: Any, notes: Notes) -> None:
    if len(scene_object.particle_systems):
        notes.note("hair and particles were left out: {}", scene_object.name)
    if scene_object.type in ("VOLUME", "POINTCLOUD", "CURVES", "GREASEPENCIL", "LATTICE"):
        notes.note("an object of unsupported type was left out: {}", scene_object.name)


def _area_lamp(lamp: Any) -> None:
    """Add an emitting face in place of an area lamp, which glTF does not have."""
    light = lamp.data
    half_x = 0.5 * light.size
    half_y = 0.5 * (light.size_y if light.shape in ("RECTANGLE", "ELLIPSE") else light.size)
    if light.shape in ("DISK", "ELLIPSE"):
        turns = [2 * math.pi * step / _SIDES for step in range(_SIDES)]
        corners = [(half_x * math.cos(turn), -half_y * math.sin(turn), 0.0) for turn in turns]
        area = math.pi * half_x * half_y
    else:
        corners = [(-half_x, -half_y, 0), (-half_x, half_y, 0), (half_x, half_y, 0),
                   (half_x, -half_y, 0)]  # fmt: skip
        area = 4 * half_x * half_y
    scale = lamp.matrix_world.to_scale()
    area *= abs(scale.x * scale.y)
    if area <= 0 or light.energy <= 0:
        return
    name = f"lamp {lamp.name}"
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    surface = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    surface.inputs["Base Color"].default_value = (0, 0, 0, 1)
    surface.inputs["Emission Color"].default_value = (*light.color, 1)
    surface.inputs["Emission Strength"].default_value = light.energy / (math.pi * area)
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(corners, [], [tuple(range(len(corners)))])
    mesh.materials.append(material)
    made = bpy.data.objects.new(name, mesh)
    made.matrix_world = lamp.matrix_world.copy()
    made.hide_render = lamp.hide_render
    bpy.context.scene.collection.objects.link(made)


def _emission_in_candela(tree: Any, notes: Notes) -> None:
    """Multiply the emission of a node tree, in watts, by `LUMENS_PER_WATT`."""
    for node in tree.nodes:
        name = {"BSDF_PRINCIPLED": "Emission Strength", "EMISSION": "Strength"}.get(node.type)
        if name is not None and not node.inputs[name].is_linked:
            node.inputs[name].default_value *= LUMENS_PER_WATT
        elif node.type.startswith("BSDF_") and node.type not in _SURFACES:
            notes.note("materials of other nodes than Principled BSDF were approximated: {}",
                       node.type.removeprefix("BSDF_").lower())  # fmt: skip


def _world(notes: Notes) -> None:
    """Note a world that lights the scene; glTF has none."""
    world = bpy.context.scene.world
    tree = world.node_tree if world is not None else None
    for node in tree.nodes if tree is not None else ():
        if node.type == "BACKGROUND":
            strength = float(node.inputs["Strength"].default_value)
            color = node.inputs["Color"]
            level = 1.0 if color.is_linked else max(color.default_value[:3])
            if strength * level >= _LIT_WORLD:
                notes.outdoors = True


def _export(path: Path) -> None:
    operator = bpy.ops.export_scene.gltf
    wanted: dict[str, Any] = {
        "export_format": "GLB",
        "export_apply": True,  # modifiers
        "export_animations": False,
        "export_skins": False,
        "export_morph": False,
        "export_cameras": True,
        "export_lights": True,
        "export_import_convert_lighting_mode": "SPEC",
        "export_yup": True,
        "use_renderable": True,
        "use_active_scene": True,
    }
    known = {one.identifier for one in operator.get_rna_type().properties}
    operator(filepath=str(path), **{name: value for name, value in wanted.items() if name in known})


if __name__ == "__main__":
    words = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    status = 0
    try:
        main(*words)
    except Exception as error:  # Blender raises anything on a damaged file
        (Path(words[2]) / "message").write_text(f"{error}".strip()[-500:], "utf-8", "replace")
        status = 4
    sys.stdout.flush()
    os._exit(status)  # Blender's own end of a Python process may wait for ever
